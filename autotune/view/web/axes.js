// Axes that a service has: a motion is asked about, begun, watched, and its recording fetched.

import { ask, NoToken, post } from "/web/api.js";

const $ = (id) => document.getElementById(id);
const SECONDS = 0.5;

export function sure(why, title = "The axis will move") {
  return new Promise((done) => {
    $("sure-title").textContent = title;
    $("sure-why").textContent = why;
    $("sure-box").onclose = () => done($("sure-box").returnValue === "yes");
    $("sure-box").returnValue = "";
    $("sure-box").showModal();
  });
}

// A job of an axis to its end; `told` hears it on the way, `started` its id.
export async function jobOf(axis, wish, told, started) {
  let job = await post(`/api/axes/${axis}/jobs`, wish);
  started(job.id);
  let failures = 0;
  while (job.state !== "done") {
    told(job);
    await new Promise((done) => setTimeout(done, 1000 * SECONDS));
    try {
      job = await ask(`/api/jobs/${job.id}`);
      failures = 0;
    } catch (error) {
      if (error instanceof NoToken || ++failures > 60) throw error; // a service that is started again goes on with it
    }
  }
  return job;
}

// The recordings that a run has left, taken to the workbench; `source` takes them there again.
export async function recordingsOf(axis, run) {
  const found = (await ask(`/api/axes/${axis}/recordings`)).filter((one) => one.run === run);
  return Promise.all(found.map(async (one) => {
    const source = `/api/workbench/from-run/${one.id}`;
    return { ...(await post(source, {})), source };
  }));
}
