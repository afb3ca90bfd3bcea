// What the page asks the service. Every failure is an Error with a sentence for the person who reads it.

let token = "";

export function takeToken() {
  const match = /[#&]token=([^&]+)/.exec(location.hash);
  if (match) {
    token = decodeURIComponent(match[1]);
    sessionStorage.setItem("autotune-token", token);
    history.replaceState(null, "", location.pathname);
  } else {
    token = sessionStorage.getItem("autotune-token") || "";
  }
  return token !== "";
}

export function setToken(value) {
  token = value.trim();
  sessionStorage.setItem("autotune-token", token);
}

export class NoToken extends Error {}
export class Gone extends Error {}

export async function ask(path, options = {}) {
  if (options.method && !token) throw new NoToken("This needs the service's token");
  const headers = { ...(options.headers || {}), ...(token ? { Authorization: `Bearer ${token}` } : {}) };
  let answer;
  try {
    answer = await fetch(path, { ...options, headers });
  } catch {
    throw new Error("The program does not answer. It may have been ended or be starting again; nothing on this page is lost.");
  }
  if (answer.ok) return answer.json();
  const detail = await sentence(answer);
  if (answer.status === 401 || answer.status === 403) throw new NoToken(detail);
  if (answer.status === 404) throw new Gone(detail);
  throw new Error(detail);
}

async function sentence(answer) {
  try {
    const { detail } = await answer.json();
    if (typeof detail === "string") return detail;
    return detail.map((one) => `${one.loc.slice(1).join(".")}: ${one.msg}`).join("; ");
  } catch {
    return `The program answered ${answer.status} ${answer.statusText}.`;
  }
}

export const post = (path, body) =>
  ask(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });

export const send = (path, file) =>
  ask(path, { method: "POST", headers: { "Content-Type": "application/octet-stream" }, body: file });

// Runs a computation to its end; `told` hears {steps, message, seconds} on the way.
export async function compute(wish, told, started) {
  let job = await post("/api/workbench/jobs", wish);
  started(job.id);
  let failures = 0;
  while (job.state === "queued" || job.state === "running") {
    await new Promise((done) => setTimeout(done, 300));
    try {
      job = await ask(`/api/workbench/jobs/${job.id}`);
      failures = 0;
    } catch (error) {
      if (error instanceof Gone || error instanceof NoToken || ++failures > 10) throw error;
    }
    told(job);
  }
  if (job.state === "stopped") throw new Error("Stopped.");
  if (job.error) throw new Error(job.error);
  return job.answer;
}
