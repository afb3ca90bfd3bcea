// The workbench. Models and choices live in this page; recordings are known to the program by their content.

import { ask, compute, Gone, NoToken, post, send, setToken, takeToken } from "/web/api.js";
import { jobOf, recordingsOf, sure } from "/web/axes.js";
import { showUsed } from "/web/limits.js";
import { canOverlay, layOver, newOverlay, overlaid } from "/web/overlay.js";
import { quantity, range, scaleOf, significant } from "/web/numbers.js";
import { bars, colour, plot } from "/web/plots.js";
import { drawWhere, selectAll, selectedStretches, selection, selectTime, showWhere, undoSelection } from "/web/where.js";

const $ = (id) => document.getElementById(id);
const KEPT = "autotune-workbench";
const MOST_GAP = 0.1; // s, between compared rows: over more no line is drawn
const WORTH = 0.005; // of the squared error: a candidate that takes less away stands in the list of the others

const state = {
  recordings: [], // {id, name, …, chosen, leftOut: [[first, last]], file}
  versions: [], // {text, label, error, floor, parameters, previous}
  at: -1,
  compared: null, // of the present model
  beside: null, // {label, compared}: another model, or another day
  diagnosis: null,
  shown: { id: null, start: null, end: null },
  cursors: [null, null],
  about: { effects: {}, formats: [], axes: [] }, // axes: of the service, where there is one
  job: null, // address of what is under way
};
const plots = {};

// ---------------------------------------------------------------- words and work

function say(text, problem = false) {
  $("status").textContent = text;
  $("status").classList.toggle("problem", problem);
}

async function attempt(what) {
  try {
    return await what();
  } catch (error) {
    if (error instanceof NoToken) askForToken(error.message);
    say(error.message, true);
    return null;
  }
}

function busy() {
  for (const button of document.querySelectorAll("#fit, #compare, #diagnose, #add, #decide-play, #send-model")) button.disabled = true;
  $("work").hidden = false;
  $("bar").removeAttribute("value");
}

async function work(kind, wish) {
  busy();
  try {
    return await compute(
      { kind, ...wish },
      (job) => { $("doing").textContent = `${kind}: ${job.message || "waiting"} (${Math.round(job.seconds)} s)`; },
      (id) => { state.job = `/api/workbench/jobs/${id}`; },
    );
  } finally {
    idle();
  }
}

function idle() {
  state.job = null;
  $("work").hidden = true;
  refreshButtons();
}

function askForToken(why) {
  const box = $("token-box");
  $("token-why").textContent = why || "This page needs the token: of the address that the program printed, or the service's own (runs/.service/token).";
  if (!box.open) box.showModal();
}

function chosen() {
  const list = state.recordings.filter((one) => one.chosen);
  return { recordings: list.map((one) => one.id), left_out: list.map((one) => one.leftOut) };
}

const model = () => (state.at >= 0 ? state.versions[state.at] : null);
// Units are those of what is shown: of the comparison, else of the recordings that are chosen.
const first = () => state.recordings.find((one) => one.chosen) || state.recordings[0];
const unit = () => state.compared?.torque_unit || model()?.unit || first()?.torque_unit || "N m";
const motion = () => first()?.motion_unit || "rad";

function refreshButtons() {
  const some = state.recordings.some((one) => one.chosen);
  $("fit").disabled = !some;
  $("compare").disabled = $("diagnose").disabled = !some || !model();
  $("add").disabled = !some || !model() || !document.querySelector("#missing input:checked");
  $("undo").disabled = state.at < 1;
  $("redo").disabled = state.at + 1 >= state.versions.length;
  $("save").disabled = !model();
  $("decide-play").disabled = $("send-model").disabled = false;
  listAxes();
  showUsed($("used"), $("used-about"), state.recordings.filter((one) => one.chosen), state.about.limits);
}

// ---------------------------------------------------------------- recordings

async function take(fileList) {
  for (const file of fileList) {
    const most = state.about.most_bytes || 1e9;
    if (file.size > most) {
      say(`${file.name} has ${(file.size / 1e9).toFixed(1)} GB; a page can send ${Number((most / 1e9).toPrecision(3))} GB. Name it on the command line: autotune workbench ${file.name}`, true);
      continue;
    }
    say(`Reading ${file.name} …`);
    try {
      adopt(await send(`/api/workbench/recordings?name=${encodeURIComponent(file.name)}`, file), file);
    } catch (error) {
      if (error instanceof NoToken) { askForToken(error.message); return; }
      say(error.message, true);
      askAbout(file, error.message);
    }
  }
}

// `address`: where its file is sent again to a program that was started anew.
function adopt(view, file = null, address = `/api/workbench/recordings?name=${encodeURIComponent(view.name)}`) {
  const known = state.recordings.find((one) => one.id === view.id);
  if (!known) state.recordings.push({ ...view, chosen: true, leftOut: [], file, address });
  say(`${view.name}: ${view.rows} rows, ${significant(view.seconds)} s${view.remarks.length ? `. ${view.remarks.join(" ")}` : ""}`);
  listRecordings();
  if (!state.shown.id) show(view.id);
}

function listRecordings() {
  $("list").replaceChildren(
    ...state.recordings.map((one) => {
      const item = document.createElement("li");
      const label = document.createElement("label");
      const box = document.createElement("input");
      box.type = "checkbox";
      box.checked = one.chosen;
      box.onchange = () => { one.chosen = box.checked; refreshButtons(); };
      const controller = one.controller ? one.controller.replace(/\d+\.\d{5,}/g, (text) => String(Number(Number(text).toPrecision(5)))) : "controller found from the data";
      label.append(box, ` ${one.name}: ${significant(one.seconds)} s at ${significant(1 / one.period)} Hz, travel ${quantity(one.travel, one.motion_unit)}, up to ${quantity(one.largest_torque, one.torque_unit)}, ${controller}`);
      const away = document.createElement("button");
      away.type = "button";
      away.textContent = "Remove";
      away.setAttribute("aria-label", `Remove ${one.name}`);
      away.onclick = () => {
        state.recordings = state.recordings.filter((other) => other !== one);
        if (state.shown.id === one.id) state.shown.id = null;
        listRecordings();
        if (state.recordings[0]) show(state.recordings[0].id);
      };
      item.append(label, " ", away);
      return item;
    }),
  );
  $("trace-of").replaceChildren(...state.recordings.map((one) => new Option(one.name, one.id, false, one.id === state.shown.id)));
  refreshButtons();
}

function askAbout(file, why) {
  const form = $("import");
  form.hidden = false;
  $("import-why").textContent = `${file.name}: ${why}`;
  const ending = file.name.split(".").pop().toLowerCase();
  if (state.about.formats.includes(ending)) $("import-format").value = ending;
  form.onsubmit = async (event) => {
    event.preventDefault();
    const given = new FormData(form);
    const options = { format: given.get("format"), columns: String(given.get("columns")).split(/\s+/).filter(Boolean) };
    for (const name of ["unit", "torque_unit", "controller"]) if (given.get(name)) options[name] = given.get(name);
    for (const name of ["period", "torque_limit", "resolution"]) if (given.get(name)) options[name] = Number(given.get(name));
    const address = `/api/workbench/import?name=${encodeURIComponent(file.name)}&options=${encodeURIComponent(JSON.stringify(options))}`;
    try {
      adopt(await send(address, file), file, address);
      form.hidden = true;
    } catch (error) {
      $("import-why").textContent = error.message;
    }
  };
  $("import-format").focus();
}

// A program that was started again knows no recordings: what the page still holds is sent again.
async function again(work) {
  try {
    return await work();
  } catch (error) {
    if (!(error instanceof Gone)) throw error;
    for (const one of state.recordings) {
      if (!one.file && !one.source) throw error;
      if (one.source) await post(one.source, {});
      else await send(one.address, one.file);
    }
    return work();
  }
}

// ---------------------------------------------------------------- over time

async function show(id, start = null, end = null) {
  state.shown = { id, start, end };
  $("trace-of").value = id;
  await attempt(() => again(draw));
}

async function draw() {
  const { id, start, end } = state.shown;
  if (!id) return;
  const one = state.recordings.find((other) => other.id === id);
  const points = Math.min(2000, Math.max(200, $("trace-torque").clientWidth));
  const limits = start === null ? "" : `&start=${start}&end=${end}`;
  const trace = await ask(`/api/workbench/recordings/${id}/trace?columns=reference,position,torque&points=${points}${limits}`);
  if (state.shown.id !== id) return;
  state.shown.whole = trace.whole;
  const common = { shared: "time", onZoom: zoom, onClick: setCursor };
  const where = scaleOf(trace.position, one.motion_unit);
  const motions = [["reference", "grey", [5, 4]], ["position", "blue"]]
    .filter(([name]) => trace[name])
    .map(([name, ink, dash]) => ({ label: name, values: trace[name].map((v) => (v === null ? null : v * where.factor)), colour: colour(ink), dash }));
  plots.motion = plot($("trace-motion"), plots.motion, { ...common, x: trace.time, xLabel: "", series: motions, yLabel: `position [${where.unit}]`, units: ["s", where.unit] });
  const force = scaleOf(trace.torque, one.torque_unit);
  const series = [{ label: "torque", values: trace.torque.map((v) => (v === null ? null : v * force.factor)), colour: colour("grey") }];
  plots.torque = plot($("trace-torque"), plots.torque, { ...common, x: trace.time, xLabel: "time [s]", height: 280, series: [...series, ...modelSeries(trace.time, force.factor)], yLabel: `torque [${force.unit}]`, units: ["s", force.unit] });
  state.shown.unit = force.unit;
  showCursors();
}

// The model's torque and its error, where the present recording alone was compared, on the trace's time.
function modelSeries(time, factor) {
  const rows = state.compared?.rows;
  if (!rows || state.compared.of !== state.shown.id) return [];
  const error = onto(time, rows.time, rows.error, factor), torque = onto(time, rows.time, rows.torque, factor);
  const over = state.diagnosis && overlaid();
  return [
    { label: "model", values: torque.map((one, i) => (one === null ? null : one - error[i])), colour: colour("blue") },
    { label: "measured − model", values: error, colour: colour("orange") },
    ...(over ? [{ label: over.label, values: onto(time, over.time, over.values, factor), colour: colour("green") }] : []),
    ...selectedSeries(time, rows, factor),
  ];
}

// Values of rows at the places of a trace; nothing where no row is near.
function onto(time, rows, values, factor) {
  const found = [];
  let k = 0;
  for (const t of time) {
    while (k + 1 < rows.length && rows[k + 1] <= t) k++;
    const n = k + 1 < rows.length ? k + 1 : k, gap = rows[n] - rows[k];
    const near = gap > 0 ? gap < MOST_GAP && t >= rows[k] : Math.abs(rows[k] - t) < MOST_GAP;
    found.push(near ? (values[k] + (gap > 0 ? ((t - rows[k]) / gap) * (values[n] - values[k]) : 0)) * factor : null);
  }
  return found;
}

// The error of the samples that are selected in the pictures below, as points; at most one for each place shown.
function selectedSeries(time, rows, factor) {
  const chosen = selection();
  if (!chosen) return [];
  const values = time.map(() => null);
  let at = 0;
  for (let k = 0; k < rows.time.length; k++) {
    if (rows.time[k] < time[0] || rows.time[k] > time[time.length - 1] || !chosen.test(k)) continue;
    while (at + 1 < time.length && time[at + 1] <= rows.time[k]) at++;
    values[at] = rows.error[k] * factor;
  }
  return [{ label: "selected", values, colour: colour("ink"), points: true }];
}

function zoom(start, end) {
  show(state.shown.id, start, end);
}

function along(share, width = 1) {
  const whole = state.shown.whole;
  if (!whole) return;
  const start = state.shown.start ?? whole[0], end = state.shown.end ?? whole[1];
  const middle = (start + end) / 2 + share * (end - start), half = ((end - start) * width) / 2;
  show(state.shown.id, Math.max(whole[0], middle - half), Math.min(whole[1], middle + half));
}

function setCursor(time, second) {
  state.cursors[second ? 1 : 0] = time;
  showCursors();
}

function showCursors() {
  const [a, b] = state.cursors;
  if (a === null && b === null) return;
  const read = (time) => {
    if (time === null) return null;
    const data = plots.torque.data;
    let k = data[0].findIndex((t) => t >= time);
    if (k < 0) k = data[0].length - 1;
    return { time: data[0][k], values: data.slice(1).map((column) => column[k]) };
  };
  const [at, bt] = [read(a), read(b)];
  const names = plots.torque.series.slice(1).map((one) => one.label);
  const each = (value) => names.map((name, i) => `${name} ${significant(value(i))} ${state.shown.unit}`).join(", ");
  const tell = (letter, one) => one && `${letter} ${significant(one.time, 5)} s: ${each((i) => one.values[i])}`;
  const apart = at && bt ? `B − A ${significant(bt.time - at.time, 4)} s: ${each((i) => (at.values[i] === null || bt.values[i] === null ? null : bt.values[i] - at.values[i]))}` : null;
  $("cursors").textContent = [tell("A", at), tell("B", bt), apart].filter(Boolean).join(" · ");
}

// ---------------------------------------------------------------- model

function adoptModel(version) {
  state.versions = [...state.versions.slice(0, state.at + 1), version];
  state.at = state.versions.length - 1;
  state.diagnosis = null;
  remember();
  showModel();
}

function remember() {
  try {
    localStorage.setItem(KEPT, JSON.stringify({ versions: state.versions, at: state.at }));
  } catch {
    say("The browser keeps no more; save the model to a file.", true);
  }
}

function recall() {
  try {
    const kept = JSON.parse(localStorage.getItem(KEPT) || "null");
    if (kept && kept.versions.length) Object.assign(state, { versions: kept.versions, at: kept.at });
  } catch {
    localStorage.removeItem(KEPT);
  }
}

async function fit() {
  const found = await attempt(() => again(() => work("fit", chosen())));
  if (!found) return;
  if (!found.model) return say(`No model: ${found.reason}`, true);
  adoptModel({ text: found.model, label: "base model", unit: found.torque_unit, error: null, floor: null, parameters: found.parameters, previous: {} });
  say(`Fitted: misses the torque by ${significant(100 * found.relative_error)} %. ${found.notes.join(" ")}`);
  await compare();
}

async function compare() {
  const wish = { ...chosen(), model: model().text };
  const found = await attempt(() => again(() => work("compare", wish)));
  if (!found) return;
  found.of = wish.recordings.length === 1 ? wish.recordings[0] : null;
  state.beside = null;
  state.compared = found;
  model().unit = found.torque_unit;
  if (model().error === null) { model().error = found.error_rms; model().floor = found.noise_floor_rms; remember(); }
  $("beside").value = "";
  $("beside-legend").textContent = "";
  showModel();
  drawError();
  await attempt(draw);
}

async function addChosen() {
  const effects = [...document.querySelectorAll("#missing input:checked")].map((box) => box.value);
  const found = await attempt(() => again(() => work("add", { ...chosen(), model: model().text, effects })));
  if (!found) return;
  const first = found.steps[0];
  if (model().unseen === undefined) Object.assign(model(), { error: first.error_before, unseen: found.unseen });
  adoptModel({
    text: found.model, label: `+ ${effects.join(", ").replaceAll("_", " ")}`, unit: found.torque_unit, error: found.error_after,
    floor: found.noise_floor_rms, parameters: found.parameters, previous: found.previous, unseen: found.unseen,
  });
  const fall = 100 * (1 - found.error_after / first.error_before);
  say(`Error on ${found.unseen}: ${quantity(first.error_before, unit())} before, ${quantity(found.error_after, unit())} after (${significant(fall)} % less)`);
  await compare();
}

function showModel() {
  const now = model();
  const compared = state.compared;
  const figures = [];
  if (now && compared) {
    figures.push(["error", quantity(compared.error_rms, unit())], ["of the torque", `${significant(100 * compared.relative_error)} %`]);
    const floor = compared.noise_floor_interval;
    figures.push(["noise floor, an estimate", floor ? `${quantity(compared.noise_floor_rms, unit())} (${quantity(floor[0], unit())} to ${quantity(floor[1], unit())})` : "unknown: nothing was recorded twice"]);
    if (state.beside) figures.push([state.beside.label, quantity(state.beside.compared.error_rms, unit())]);
    if (compared.position_error_rms) figures.push(["position, simulated", quantity(compared.position_error_rms, motion())]);
  }
  $("figures").replaceChildren(
    ...figures.map(([name, value]) => {
      const box = document.createElement("div"), strong = document.createElement("b");
      strong.textContent = value;
      box.append(strong, name);
      return box;
    }),
  );
  const rows = state.versions.slice(0, state.at + 1).filter((one) => one.error !== null)
    .map((one) => ({ name: one.label, value: one.error, text: quantity(one.error, one.unit || unit()) }));
  bars($("stairs"), rows, now?.floor || null);
  showParameters(now);
  listBeside();
  refreshButtons();
}

function showParameters(now) {
  const table = $("parameters");
  table.replaceChildren();
  if (!now?.parameters) return;
  const head = table.createTHead().insertRow();
  for (const name of ["parameter", "before", "now", "± (standard error)", "unit"]) {
    const cell = document.createElement("th");
    cell.textContent = name;
    head.append(cell);
  }
  const body = table.createTBody();
  for (const [name, value] of Object.entries(now.parameters)) {
    const row = body.insertRow();
    const texts = [name, now.previous?.[name] === undefined ? "" : significant(now.previous[name], 4), significant(value.value, 4), significant(value.standard_error, 2), value.unit];
    texts.forEach((text, i) => { const cell = row.insertCell(); cell.textContent = text; if (i > 0 && i < 4) cell.className = "n"; });
  }
}

function step(by) {
  state.at += by;
  state.compared = null;
  state.diagnosis = null;
  remember();
  showModel();
  showDiagnosis();
  say(`Now at ${model().label}.`);
  attempt(compare);
}

function save() {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([model().text], { type: "application/toml" }));
  link.download = "model.toml";
  link.click();
  URL.revokeObjectURL(link.href);
  say("Saved as model.toml in the browser's folder for downloads.");
}

// ---------------------------------------------------------------- where it fails

function drawError() {
  showWhere(state.compared, { beside: state.beside, motion: motion(), torque: unit(), changed: () => attempt(draw) });
}

// What can stand beside the present comparison: another model on the same recordings, or this model on another day.
function listBeside() {
  const options = [new Option("nothing else", "")];
  state.versions.forEach((one, i) => { if (i !== state.at) options.push(new Option(`model: ${one.label} (step ${i + 1})`, `model:${i}`)); });
  for (const one of state.recordings) {
    const alone = state.recordings.filter((other) => other.chosen);
    if (!(alone.length === 1 && alone[0] === one)) options.push(new Option(`recording: ${one.name}`, `recording:${one.id}`));
  }
  const now = options.some((one) => one.value === $("beside").value) ? $("beside").value : "";
  $("beside").replaceChildren(...options);
  $("beside").value = now;
  $("beside").disabled = !state.compared || options.length < 2;
}

async function putBeside() {
  const [kind, which] = $("beside").value.split(/:(.*)/);
  state.beside = null;
  if (kind) {
    const wish = kind === "model" ? { ...chosen(), model: state.versions[Number(which)].text } : { recordings: [which], model: model().text };
    const label = $("beside").selectedOptions[0].textContent.replace(/^[a-z]+: /, "");
    const found = await attempt(() => again(() => work("compare", wish)));
    if (found) {
      state.beside = { label, compared: found };
      say(`${label}: error ${quantity(found.error_rms, unit())}; ${model().label}: ${quantity(state.compared.error_rms, unit())}.`);
    } else $("beside").value = "";
  }
  $("beside-legend").textContent = state.beside ? `; dashed: ${state.beside.label}` : "";
  showModel();
  drawError();
}

function leaveSelected() {
  const one = state.recordings.find((other) => other.id === state.compared.of);
  if (!one) return say("Choose one recording alone and compare: then its selected samples can be left out.", true);
  const stretches = selectedStretches();
  one.leftOut.push(...stretches);
  return say(`${stretches.length} stretches of ${one.name} are left out of fits from now on.`);
}

// Where the compared motion turns round next, seen from the beginning of what is shown.
function nextReversal() {
  const rows = state.compared?.rows, whole = state.shown.whole;
  if (!rows || state.compared.of !== state.shown.id || !whole) return say("Compare a model with this recording alone first.", true);
  const { time, velocity } = rows, after = state.shown.start === null ? whole[0] : (state.shown.start + state.shown.end) / 2 + 1e-9;
  const largest = range(velocity.map(Math.abs))[1];
  for (let k = 1; k + 1 < time.length; k++)
    if (time[k] > after && velocity[k - 1] * velocity[k] < 0 && Math.abs(velocity[k + 1]) > 1e-3 * largest) return show(state.shown.id, time[k] - 0.25, time[k] + 0.25);
  return say("No reversal follows in this recording.", true);
}

// ---------------------------------------------------------------- what is missing

async function diagnose() {
  const found = await attempt(() => again(() => work("diagnose", { ...chosen(), model: model().text })));
  if (!found) return;
  state.diagnosis = found;
  showDiagnosis();
  say(found.sentence);
}

function showDiagnosis() {
  const found = state.diagnosis;
  $("verdict").textContent = found ? found.sentence : "";
  $("next").textContent = found?.next_experiment ? `Next: ${found.next_experiment}` : "";
  newOverlay(found?.overlay || null, { motion: motion(), torque: found?.torque_unit || unit(), changed: () => attempt(draw) });
  listAxes();
  const list = found ? [...found.candidates].sort((a, b) => b.gain - a.gain) : [];
  const helps = (one) => one.accepted || one.gain > WORTH || found.effects.includes(one.effect);
  const [some, none] = [list.filter(helps), list.filter((one) => !helps(one))];
  $("candidates").replaceChildren(...some.map((one) => candidateRow(one, found)));
  $("others").hidden = !none.length;
  $("others-title").textContent = `${none.length} ${some.length ? "more candidates" : "candidates"} that take nothing away`;
  $("others-list").replaceChildren(...none.map((one) => candidateRow(one, found)));
  refreshButtons();
}

// Axes that a motion can be asked of: the one that the chosen recordings name, else any.
function listAxes() {
  const named = new Set(state.recordings.filter((one) => one.chosen && one.axis).map((one) => one.axis));
  const axes = state.about.axes.filter((name) => !named.size || named.has(name));
  for (const [box, wanted] of [["decide", state.diagnosis?.rivals], ["send", model()]]) {
    $(box).hidden = !wanted || !axes.length;
    const list = $(`${box}-axis`);
    list.replaceChildren(...axes.map((name) => new Option(name, name, false, name === list.value)));
  }
}

// Has an axis do what was asked about; the job when it has ended well, else null.
async function move(axis, why, wish) {
  if (!(await sure(`${axis}: ${why} Nobody is asked at the machine.`))) return null;
  busy();
  try {
    const job = await jobOf(
      axis, wish,
      (one) => {
        $("doing").textContent = `${axis}: ${one.waits_for ? `waits for ${one.waits_for}` : one.stage || one.state}`;
        if (one.fraction != null) $("bar").value = one.fraction;
      },
      (id) => { state.job = `/api/jobs/${id}`; },
    );
    say(`${axis}: ${job.sentence}`, Boolean(job.exit_code) && job.outcome !== "not_applied");
    return job;
  } catch (error) {
    if (error instanceof NoToken) askForToken(error.message);
    say(error.message, true);
    return null;
  } finally {
    idle();
  }
}

async function decide() {
  const axis = $("decide-axis").value, effects = state.diagnosis.rivals;
  const what = effects.length ? effects.join(", ").replaceAll("_", " ") : "what may be missing";
  const job = await move(axis, `it moves within its limits for a minute at most, to tell apart ${what}.`, { kind: "decide", effects });
  if (!job || job.exit_code) return;
  await attempt(async () => { for (const view of await recordingsOf(axis, job.run)) adopt(view); });
  say(`${axis}: ${job.sentence}`);
}

async function sendModel() {
  const axis = $("send-axis").value;
  const why = "it is tuned, with this model in place of the one that the tuning would find: it moves within its limits for minutes. What is proved waits for approval on the axes' page.";
  await move(axis, why, { kind: "run", model: model().text, commit: "ask" });
}

function candidateRow(one, found) {
  const item = document.createElement("li"), label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox";
  box.value = one.effect;
  box.checked = found.effects.includes(one.effect);
  box.onchange = refreshButtons;
  const strong = document.createElement("strong");
  strong.textContent = one.effect.replaceAll("_", " ");
  label.append(box, " ", strong, one.gain > WORTH ? ` takes ${significant(100 * one.gain)} % of the squared error away${one.accepted ? "" : ", not accepted"}: ${one.why}` : `: ${one.why.replace(/-(?=\d)/g, "−")}`);
  const more = document.createElement("details"), head = document.createElement("summary");
  head.textContent = "What it is";
  more.append(head);
  for (const [name, text] of [["Looks like", one.looks_like], ["Caused by", one.cause], ["What to do", one.remedy]]) {
    const line = document.createElement("p");
    line.className = "quiet";
    line.textContent = `${name}: ${text}`;
    more.append(line);
  }
  item.append(label, " ");
  if (canOverlay(one.effect)) {
    const over = document.createElement("button");
    Object.assign(over, { type: "button", textContent: "Lay over the error", onclick: () => layOver(one.effect) });
    over.id = `over-${one.effect}`;
    over.setAttribute("aria-label", `Lay ${strong.textContent} over the error`);
    item.append(over);
  }
  item.append(more);
  return item;
}

// ---------------------------------------------------------------- begin

function leaveOut() {
  const one = state.recordings.find((other) => other.id === state.shown.id);
  const { start, end } = state.shown;
  if (!one || start === null) return say("Drag over a range first; what is shown is what is left out.", true);
  one.leftOut.push([start, end]);
  say(`${significant(start, 4)} to ${significant(end, 4)} s of ${one.name} are left out of fits from now on.`);
}

function wire() {
  $("choose").onchange = (event) => take(event.target.files);
  const drop = $("drop");
  for (const name of ["dragover", "dragenter"]) drop.addEventListener(name, (event) => { event.preventDefault(); drop.classList.add("over"); });
  for (const name of ["dragleave", "drop"]) drop.addEventListener(name, () => drop.classList.remove("over"));
  drop.addEventListener("drop", (event) => { event.preventDefault(); take(event.dataTransfer.files); });
  $("import-cancel").onclick = () => { $("import").hidden = true; };
  $("trace-of").onchange = (event) => show(event.target.value);
  $("whole").onclick = () => show(state.shown.id);
  $("closer").onclick = () => along(0, 0.5);
  $("earlier").onclick = () => along(-0.5);
  $("later").onclick = () => along(0.5);
  $("leave-out").onclick = leaveOut;
  $("put-back").onclick = () => { for (const one of state.recordings) one.leftOut = []; say("All ranges are fitted again."); };
  $("fit").onclick = fit;
  $("compare").onclick = () => compare();
  $("diagnose").onclick = diagnose;
  $("add").onclick = addChosen;
  $("undo").onclick = () => step(-1);
  $("redo").onclick = () => step(1);
  $("beside").onchange = putBeside;
  $("save").onclick = save;
  $("decide-play").onclick = decide;
  $("send-model").onclick = sendModel;
  $("stop").onclick = () => state.job && attempt(() => post(`${state.job}/stop`, {}));
  $("coordinate").onchange = drawWhere;
  $("unselect").onclick = selectAll;
  $("selection-back").onclick = undoSelection;
  $("leave-selected").onclick = leaveSelected;
  $("reversal").onclick = nextReversal;
  $("select-shown").onclick = () => {
    const { id, start, end, whole } = state.shown;
    if (!state.compared || state.compared.of !== id) return say("Compare a model with this recording alone first.", true);
    return selectTime(start ?? whole[0], end ?? whole[1]);
  };
  $("open-model").onchange = async (event) => {
    const file = event.target.files[0];
    if (!file) return;
    adoptModel({ text: await file.text(), label: file.name, error: null, floor: null, parameters: null, previous: {} });
    say(`${file.name} is open.`);
  };
  $("token-box").onclose = () => { setToken($("token").value); begin(); };
  const redraw = () => { attempt(draw); if (state.compared) drawWhere(); };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  addEventListener("storage", (event) => { // another tab of this browser
    if (event.key === KEPT && event.newValue) say("Another tab has changed the models that this browser keeps. This tab goes on with its own; save the one that you want to have after both are closed.", true);
  });
  let waiting = 0;
  addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(redraw, 200); });
}

async function begin() {
  await attempt(async () => {
    state.about = await ask("/api/workbench/about");
    $("import-format").replaceChildren(...state.about.formats.map((name) => new Option(name)));
    for (const view of await ask("/api/workbench/recordings")) adopt(view);
    showModel();
    if (!state.recordings.length) say("Drop a recording to begin.");
  });
}

recall();
wire();
refreshButtons();
if (takeToken()) begin();
else askForToken();
