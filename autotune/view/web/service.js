// The service's page: axes, what they are doing, what waits for a person, and how they have been.

import { ask, NoToken, post, setToken, takeToken } from "/web/api.js";
import { sure } from "/web/axes.js";
import { quantity } from "/web/numbers.js";
import { colour, plot } from "/web/plots.js";

const $ = (id) => document.getElementById(id);
const SECONDS = 2;
const plots = {};
let shown = ""; // axis of the history
let known = ""; // what the lists were made of
let newest = ""; // job that had ended last when the history was drawn
let units = {}; // of motion, by axis

const say = (text, problem = false) => { $("status").textContent = text; $("status").classList.toggle("problem", problem); };
const element = (name, text, attributes = {}) => Object.assign(document.createElement(name), { textContent: text, ...attributes });
const when = (text) => (text ? new Date(text).toLocaleString() : "–");

function askForToken(why) {
  return new Promise((done) => {
    const box = $("token-box");
    $("token-why").textContent = `${why}. It is kept in this tab only.`;
    box.onclose = () => { if (box.returnValue === "go") setToken($("token").value); done(box.returnValue === "go"); };
    if (!box.open) box.showModal();
  });
}

async function doing(path, body, told) {
  try {
    await post(path, body);
    say(told);
  } catch (error) {
    if (error instanceof NoToken && (await askForToken(error.message))) return doing(path, body, told);
    say(error.message, true);
  }
  return refresh();
}

const MOVES = {
  check: ["Check", "A gentle look: the axis moves a little, for a minute at most."],
  run: ["Tune", "The axis is tuned: it moves within its limits for minutes. Nobody is asked at the machine."],
  rollback: ["Roll back", "What the drive held before the last commit is written to it again. The axis does not move.", "The drive will be written to"],
};

function card(axis, proposals) {
  const box = element("article", "");
  box.append(element("h3", axis.name));
  const job = axis.job;
  const state = job ? `${job.kind} ${job.state}${job.stage ? `, ${job.stage}` : ""}${job.waits_for ? `: waits for ${job.waits_for}` : ""}` : axis.state;
  box.append(element("p", state, { className: "verdict" }));
  if (job?.fraction !== null && job?.fraction !== undefined) box.append(element("progress", "", { value: job.fraction, ariaLabel: `Progress of ${axis.name}` }));
  if (axis.last_check) box.append(element("p", `Last check ${when(axis.last_check.at)}: ${axis.last_check.sentence || ""}`, { className: "quiet" }));
  box.append(element("p", `Next check ${when(axis.next_check)}. ${axis.held ? "" : "Another program has the link."}`, { className: "quiet" }));
  const tools = element("div", "", { className: "tools" });
  for (const [kind, [name, why, title]] of Object.entries(MOVES)) {
    const button = element("button", name, { type: "button", disabled: Boolean(job) });
    button.dataset.kind = kind;
    button.onclick = async () => { if (await sure(`${axis.name}: ${why}`, title)) doing(`/api/axes/${axis.name}/jobs`, { kind }, `${name} of ${axis.name} begins.`); };
    tools.append(button);
  }
  if (job) {
    const stop = element("button", "Stop", { type: "button" });
    stop.onclick = () => doing(`/api/jobs/${job.id}/stop`, {}, `${job.kind} of ${axis.name} is being stopped.`);
    tools.append(stop);
  }
  for (const one of proposals.filter((p) => p.axis === axis.name && p.state === "open")) {
    box.append(element("p", one.sentence));
    const yes = element("button", "Approve", { type: "button", className: "primary" });
    yes.onclick = async () => { if (await sure(`${axis.name}: it is written to the drive for good, and the axis moves to measure it again. Nobody is asked at the machine.`)) doing(`/api/proposals/${one.id}/approve`, {}, `Approved: it is written to ${axis.name}.`); };
    const no = element("button", "Reject", { type: "button" });
    no.onclick = () => doing(`/api/proposals/${one.id}/reject`, {}, `Rejected: ${axis.name} stays as it is.`);
    tools.append(yes, no);
  }
  box.append(tools);
  return box;
}

async function refresh() {
  try {
    const [axes, proposals, health, reports, jobs] = await Promise.all([
      ask("/api/axes"), ask("/api/proposals?limit=20"), health_(), ask("/api/reports"), ask("/api/jobs?state=done&limit=10"),
    ]);
    const made = JSON.stringify([axes, proposals, health, reports, jobs]);
    if (made !== known) {
      const focus = document.activeElement?.dataset?.kind && document.activeElement.closest("article")?.querySelector("h3").textContent + document.activeElement.dataset.kind;
      $("axes").replaceChildren(...axes.map((axis) => card(axis, proposals)));
      for (const button of document.querySelectorAll("#axes button")) if (focus && button.closest("article").querySelector("h3").textContent + button.dataset.kind === focus) button.focus();
      firstThings(axes, proposals, health);
      listReports(reports, jobs, proposals);
      listJobs(jobs, proposals);
      tellEnded(axes, jobs, proposals);
      units = Object.fromEntries(axes.map((axis) => [axis.name, axis.motion_unit]));
      $("history-of").replaceChildren(...axes.map((axis) => new Option(axis.name, axis.name, false, axis.name === shown)));
      known = made;
    }
    if (!shown && axes.length) shown = axes[0].name;
    if (shown && newest !== (jobs[0]?.id || "none")) { newest = jobs[0]?.id || "none"; await history(); }
    if ($("status").textContent === "Loading …") say(`${axes.length} ${axes.length === 1 ? "axis" : "axes"}.`);
    if ($("status").textContent.startsWith("The program does not answer")) say("The service answers again.");
  } catch (error) {
    if (error instanceof NoToken) { if (await askForToken(error.message)) return refresh(); }
    say(error.message, true);
  }
}

async function health_() {
  const answer = await fetch("/healthz");
  return answer.json();
}

function firstThings(axes, proposals, health) {
  const things = Object.entries(health.problems || {}).map(([name, text]) => `${name}: ${text}`);
  for (const one of proposals.filter((p) => p.state === "open")) things.push(`${one.axis} waits for a person: ${one.sentence}`);
  for (const axis of axes) if (axis.job) things.push(`${axis.name}: ${axis.job.kind} ${axis.job.state}`);
  $("first").replaceChildren(...(things.length ? things : ["Nothing waits for a person."]).map((text) => element("li", text)));
}

const WORDS = { run: "tuning", check: "check", rollback: "roll-back", commit: "commit", decide: "deciding experiment" };

const DECIDED = { open: "proved, waits for a person", approved: "proved, approved", rejected: "proved, rejected", superseded: "proved, superseded by a later one" };

// How a job ended; a tuning that was proved and left to a person goes by what became of that.
function came(job, proposals) {
  const own = job.kind === "run" ? proposals.find((one) => one.run === job.run) : null;
  return DECIDED[own?.state] || String(job.outcome || "").replaceAll("_", " ");
}

function listJobs(jobs, proposals) {
  $("jobs").replaceChildren(...jobs.map((one) => {
    const item = element("li", "");
    item.append(element("strong", `${one.axis}, ${WORDS[one.kind] || one.kind}: ${came(one, proposals)}`), ` ${when(one.finished)}. ${one.sentence || ""}`);
    return item;
  }));
  if (!jobs.length) $("jobs").replaceChildren(element("li", "No job has ended yet."));
}

let under = new Map(); // jobs that were under way, and their axes

function tellEnded(axes, jobs, proposals) {
  for (const [id, axis] of under) {
    const ended = jobs.find((one) => one.id === id);
    if (ended) say(`${axis}, ${WORDS[ended.kind] || ended.kind}: ${came(ended, proposals)}. ${ended.sentence || ""}`, Boolean(ended.exit_code) && ended.outcome !== "not_applied");
  }
  under = new Map(axes.filter((axis) => axis.job).map((axis) => [axis.job.id, axis.name]));
}

function listReports(reports, jobs, proposals) {
  $("reports").replaceChildren(
    ...reports.slice(0, 50).map((one) => {
      const item = element("li", ""), job = jobs.find((other) => other.run === one.run);
      const link = element("a", `${one.axis}, ${one.run}`, { href: `/api/reports/${one.id}`, target: "_blank", rel: "noopener" });
      item.append(link, job ? ` ${WORDS[job.kind] || job.kind}: ${came(job, proposals)}` : "");
      return item;
    }),
  );
  if (!reports.length) $("reports").replaceChildren(element("li", "No run has left a report yet."));
}

const NO_MEASURE = new Set(["id", "exit_code", "temperature", "missed", "samples", "change"]);

const MEASURES = { level: "friction", uncompensated: "peak error without feedforward" };
const unitOf = (name) => (name.startsWith("level") ? { rad: "N m", m: "N" } : { rad: "rad", m: "m" })[units[shown]] || "";

async function history() {
  const found = await ask(`/api/axes/${shown}/history`);
  $("sentences").replaceChildren(...found.sentences.map((text) => element("li", text)));
  $("events").replaceChildren(...found.events.slice(-100).reverse().map((one) => element("li", `${when(one.at)} ${one.kind}: ${one.sentence}`)));
  const checks = found.checks;
  const time = checks.map((one) => new Date(one.at).getTime() / 86400e3);
  const relative = (name) => {
    const values = checks.map((one) => (typeof one[name] === "number" ? one[name] : null));
    const first = values.find((value) => value !== null && value !== 0);
    return { first, values: values.map((value) => (value === null || !first ? null : (100 * value) / first)) };
  };
  const measured = (one, name) => typeof one[name] === "number" && !NO_MEASURE.has(name) && !(name.endsWith("_error") && name.slice(0, -6) in one);
  const names = [...new Set(checks.flatMap((one) => Object.keys(one).filter((name) => measured(one, name))))];
  const inks = ["blue", "orange", "grey"];
  const series = names.slice(0, 3).map((name, i) => { const { first, values } = relative(name); return { label: `${MEASURES[name] || name.replaceAll("_", " ")} (100 % is ${quantity(first, unitOf(name))})`, values, colour: colour(inks[i]), width: 2 }; });
  const warm = checks.some((one) => typeof one.temperature === "number");
  if (warm) series.push({ label: "temperature [°C]", values: checks.map((one) => one.temperature ?? null), colour: colour("green"), width: 1.4, dash: [6, 4], right: true });
  $("history").hidden = time.length < 2 || !series.length;
  if ($("history").hidden) { if (plots.history) plots.history.destroy(); plots.history = null; return; }
  const last = time[time.length - 1];
  const marks = found.events.map((one) => ({ x: new Date(one.at).getTime() / 86400e3 - last, label: one.kind.replaceAll("_", " ") })).sort((a, b) => a.x - b.x);
  const x = time.map((t) => t - last), latest = marks.length ? marks[marks.length - 1].x : 0;
  if (latest > 0) { // what has happened since the last check is to be seen, too
    x.push(latest);
    for (const one of series) one.values.push(null);
  }
  plots.history = plot($("history"), plots.history, {
    x, series, marks, xLabel: "days from the last check", yLabel: "% of the first", rightLabel: warm ? "temperature [°C]" : undefined, height: 280,
    onZoom: (from, to) => (from === null ? history() : plots.history.setScale("x", { min: from, max: to })),
  });
}

$("history-of").onchange = (event) => { shown = event.target.value; history().catch((error) => say(error.message, true)); };
takeToken();
refresh();
setInterval(() => { if (!document.hidden) refresh(); }, SECONDS * 1000);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (shown) history().catch(() => {}); });
document.addEventListener("visibilitychange", () => { if (!document.hidden) { known = ""; refresh(); } });
