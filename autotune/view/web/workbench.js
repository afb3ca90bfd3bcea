// The workbench. Models and choices live in this page; recordings are known to the program by their content.

import { ask, compute, Gone, NoToken, post, send, setToken, takeToken } from "/web/api.js";
import { binned, quantity, range, rms, scaleOf, significant } from "/web/numbers.js";
import { bars, colour, heat, plot } from "/web/plots.js";

const $ = (id) => document.getElementById(id);
const MOST_BYTES = 1e9;
const BINS = 40;
const LOGARITHMIC = new Set(["travel_since_reversal", "time_since_reversal"]);

const state = {
  recordings: [], // {id, name, …, chosen, leftOut: [[first, last]], file}
  versions: [], // {text, label, error, floor, parameters, previous}
  at: -1,
  compared: null, // of the present model
  before: null, // of the one before
  diagnosis: null,
  shown: { id: null, start: null, end: null },
  cursors: [null, null],
  selection: null, // a test of rows
  about: { effects: {}, formats: [] },
  job: null,
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

async function work(kind, wish) {
  for (const button of document.querySelectorAll("[data-works], #fit, #compare, #diagnose, #add")) button.disabled = true;
  $("work").hidden = false;
  $("bar").removeAttribute("value");
  try {
    return await compute(
      { kind, ...wish },
      (job) => { $("doing").textContent = `${kind}: ${job.message || "waiting"} (${Math.round(job.seconds)} s)`; },
      (id) => { state.job = id; },
    );
  } finally {
    state.job = null;
    $("work").hidden = true;
    refreshButtons();
  }
}

function askForToken(why) {
  const box = $("token-box");
  $("token-why").textContent = why || "This page needs the token that the program printed.";
  if (!box.open) box.showModal();
}

function chosen() {
  const list = state.recordings.filter((one) => one.chosen);
  return { recordings: list.map((one) => one.id), left_out: list.map((one) => one.leftOut) };
}

const model = () => (state.at >= 0 ? state.versions[state.at] : null);
const unit = () => state.recordings[0]?.torque_unit || "N m";
const motion = () => state.recordings[0]?.motion_unit || "rad";

function refreshButtons() {
  const some = state.recordings.some((one) => one.chosen);
  $("fit").disabled = !some;
  $("compare").disabled = $("diagnose").disabled = !some || !model();
  $("add").disabled = !some || !model() || !document.querySelector("#candidates input:checked");
  $("undo").disabled = state.at < 1;
  $("save").disabled = !model();
}

// ---------------------------------------------------------------- recordings

async function take(fileList) {
  for (const file of fileList) {
    if (file.size > MOST_BYTES) {
      say(`${file.name} has ${(file.size / 1e9).toFixed(1)} GB; a page can send 1 GB. Name it on the command line: autotune workbench ${file.name}`, true);
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

function adopt(view, file = null) {
  const known = state.recordings.find((one) => one.id === view.id);
  if (!known) state.recordings.push({ ...view, chosen: true, leftOut: [], file });
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
      const controller = one.controller ? one.controller : "controller found from the data";
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
    for (const name of ["unit", "controller"]) if (given.get(name)) options[name] = given.get(name);
    for (const name of ["period", "torque_limit"]) if (given.get(name)) options[name] = Number(given.get(name));
    try {
      const query = `name=${encodeURIComponent(file.name)}&options=${encodeURIComponent(JSON.stringify(options))}`;
      adopt(await send(`/api/workbench/import?${query}`, file), file);
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
      if (!one.file) throw error;
      await send(`/api/workbench/recordings?name=${encodeURIComponent(one.name)}`, one.file);
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
  const common = { xLabel: "time [s]", shared: "time", onZoom: zoom, onClick: setCursor };
  const where = scaleOf(trace.position, one.motion_unit);
  const motions = [["reference", "grey", [5, 4]], ["position", "blue"]]
    .filter(([name]) => trace[name])
    .map(([name, ink, dash]) => ({ label: name, values: trace[name].map((v) => (v === null ? null : v * where.factor)), colour: colour(ink), dash }));
  plots.motion = plot($("trace-motion"), plots.motion, { ...common, x: trace.time, series: motions, yLabel: `position [${where.unit}]` });
  const force = scaleOf(trace.torque, one.torque_unit);
  const series = [{ label: "torque", values: trace.torque.map((v) => (v === null ? null : v * force.factor)), colour: colour("grey") }];
  plots.torque = plot($("trace-torque"), plots.torque, { ...common, x: trace.time, series: [...series, ...modelSeries(trace.time, force.factor)], yLabel: `torque [${force.unit}]` });
  showCursors();
}

// The model's torque and its error, where the present recording alone was compared, on the trace's time.
function modelSeries(time, factor) {
  const rows = state.compared?.rows;
  if (!rows || state.compared.of !== state.shown.id) return [];
  const model = [], error = [];
  let k = 0;
  for (const t of time) {
    while (k + 1 < rows.time.length && rows.time[k + 1] <= t) k++;
    const near = Math.abs(rows.time[k] - t) < 0.1;
    model.push(near ? (rows.torque[k] - rows.error[k]) * factor : null);
    error.push(near ? rows.error[k] * factor : null);
  }
  return [
    { label: "model", values: model, colour: colour("blue") },
    { label: "measured − model", values: error, colour: colour("orange") },
  ];
}

function zoom(start, end) {
  show(state.shown.id, start, end);
}

function move(share, width = 1) {
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
  const tell = (letter, one) => one && `${letter} ${significant(one.time, 5)} s: ${names.map((name, i) => `${name} ${significant(one.values[i])}`).join(", ")}`;
  const apart = at && bt ? `B − A ${significant(bt.time - at.time, 4)} s: ${names.map((name, i) => `${name} ${significant(bt.values[i] - at.values[i])}`).join(", ")}` : null;
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
    localStorage.setItem("autotune-workbench", JSON.stringify({ versions: state.versions, at: state.at }));
  } catch {
    say("The browser keeps no more; save the model to a file.", true);
  }
}

function recall() {
  try {
    const kept = JSON.parse(localStorage.getItem("autotune-workbench") || "null");
    if (kept && kept.versions.length) Object.assign(state, { versions: kept.versions, at: kept.at });
  } catch {
    localStorage.removeItem("autotune-workbench");
  }
}

async function fit() {
  const found = await attempt(() => again(() => work("fit", chosen())));
  if (!found) return;
  if (!found.model) return say(`No model: ${found.reason}`, true);
  adoptModel({ text: found.model, label: "base model", error: null, floor: null, parameters: found.parameters, previous: {} });
  say(`Fitted: misses the torque by ${significant(100 * found.relative_error)} %. ${found.notes.join(" ")}`);
  await compare();
}

async function compare() {
  const wish = { ...chosen(), model: model().text };
  const found = await attempt(() => again(() => work("compare", wish)));
  if (!found) return;
  found.of = wish.recordings.length === 1 ? wish.recordings[0] : null;
  state.before = state.compared;
  state.compared = found;
  state.selection = null;
  if (model().error === null) { model().error = found.error_rms; model().floor = found.noise_floor_rms; remember(); }
  showModel();
  showWhere();
  await attempt(draw);
}

async function addChosen() {
  const effects = [...document.querySelectorAll("#candidates input:checked")].map((box) => box.value);
  const found = await attempt(() => again(() => work("add", { ...chosen(), model: model().text, effects })));
  if (!found) return;
  const first = found.steps[0];
  if (model().unseen === undefined) Object.assign(model(), { error: first.error_before, unseen: found.unseen });
  adoptModel({
    text: found.model, label: `+ ${effects.join(", ").replaceAll("_", " ")}`, error: found.error_after,
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
    .map((one) => ({ name: one.label, value: one.error, text: quantity(one.error, unit()) }));
  bars($("stairs"), rows, now?.floor || null);
  showParameters(now);
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

function undo() {
  state.at -= 1;
  state.compared = null;
  state.diagnosis = null;
  remember();
  showModel();
  showDiagnosis();
  say(`Back to ${model().label}.`);
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

function showWhere() {
  const rows = state.compared?.rows;
  $("where").hidden = !rows;
  $("where-none").hidden = Boolean(rows);
  if (!rows) return;
  const names = Object.keys(rows).filter((name) => !["torque", "error"].includes(name));
  const best = Object.entries(state.compared.where).sort((a, b) => b[1] - a[1]);
  const now = $("coordinate").value || best.find(([name]) => names.includes(name))?.[0] || "velocity";
  $("coordinate").replaceChildren(
    ...names.map((name) => {
      const share = state.compared.where[name];
      const text = `${name.replaceAll("_", " ")}${share === undefined ? "" : ` (${Math.round(100 * share)} % of the error follows it)`}`;
      return new Option(text, name, false, name === now);
    }),
  );
  const regimes = Object.entries(state.compared.regimes).filter(([, value]) => value !== null)
    .map(([name, value]) => ({ name: name.replaceAll("_", " "), value, text: quantity(value, unit()) }));
  bars($("regimes"), regimes, state.compared.noise_floor_rms);
  drawWhere();
}

function coordinateLabel(name) {
  const units = { position: motion(), velocity: `${motion()}/s`, acceleration: `${motion()}/s²`, time: "s", temperature: "°C", travel_since_reversal: `log10 ${motion()}`, time_since_reversal: "log10 s" };
  return `${name.replaceAll("_", " ")} [${units[name] || ""}]`;
}

function drawWhere() {
  const rows = state.compared.rows, name = $("coordinate").value;
  const keep = state.selection || (() => true);
  const x = rows[name], error = rows.error, velocity = rows.velocity;
  const [low, high] = range(x);
  const centre = Array.from({ length: BINS }, (_, k) => low + ((k + 0.5) / BINS) * (high - low));
  const force = scaleOf(error, unit());
  const series = [];
  const bandList = [];
  for (const [label, ink, side] of [["forwards", "blue", (k) => velocity[k] > 0], ["backwards", "orange", (k) => velocity[k] < 0]]) {
    const { mean, spread } = binned(x, error, (k) => side(k) && keep(k), BINS, low, high);
    const at = (sign) => mean.map((m, i) => (m === null ? null : (m + sign * spread[i]) * force.factor));
    series.push({ label, values: at(0), colour: colour(ink), width: 2 });
    series.push({ label: `${label} + error`, values: at(1), colour: colour(ink), width: 0.5, dash: [2, 3] });
    series.push({ label: `${label} − error`, values: at(-1), colour: colour(ink), width: 0.5, dash: [2, 3] });
  }
  const pick = (value) => {
    const bin = Math.min(BINS - 1, Math.max(0, Math.floor(((value - low) / (high - low)) * BINS)));
    const from = low + (bin / BINS) * (high - low), to = low + ((bin + 1) / BINS) * (high - low);
    select((k) => x[k] >= from && x[k] <= to, `${name.replaceAll("_", " ")} from ${significant(from)} to ${significant(to)}`);
  };
  plots.where = plot($("by-coordinate"), plots.where, { x: centre, series, bands: bandList, xLabel: coordinateLabel(name), yLabel: `error [${force.unit}]`, onClick: pick, height: 280, legend: false });
  $("by-coordinate").onkeydown = (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    state.place = Math.min(BINS - 1, Math.max(0, (state.place ?? (step > 0 ? -1 : BINS)) + step));
    pick(centre[state.place]);
  };
  drawMap(rows, keep);
  drawOrders();
}

function drawMap(rows, keep) {
  const columns = 24, lines = 16;
  const trimmed = (values) => { const sorted = Float64Array.from(values).sort(); const at = (q) => sorted[Math.floor(q * (sorted.length - 1))]; return [at(0.005), at(0.995)]; };
  const [vl, vh] = trimmed(rows.velocity), [al, ah] = trimmed(rows.acceleration);
  const cell = (k) => {
    const i = Math.floor(((rows.velocity[k] - vl) / (vh - vl)) * columns), j = Math.floor(((rows.acceleration[k] - al) / (ah - al)) * lines);
    return i < 0 || j < 0 || i >= columns || j >= lines ? -1 : j * columns + i;
  };
  const n = new Float64Array(columns * lines), sum = new Float64Array(columns * lines);
  for (let k = 0; k < rows.error.length; k++) {
    const c = cell(k);
    if (c >= 0 && keep(k)) { n[c]++; sum[c] += rows.error[k] ** 2; }
  }
  const values = Array.from(n, (count, c) => (count < 3 ? null : Math.sqrt(sum[c] / count)));
  const largest = Math.max(...values.filter((v) => v !== null), 1e-300);
  const labels = { left: significant(vl), right: significant(vh), x: `velocity [${motion()}/s], up to ${quantity(largest, unit())} rms`, top: significant(ah), bottom: significant(al) };
  heat($("map"), { values, columns, rows: lines, labels, largest, onCell: (i, j) => select((k) => cell(k) === j * columns + i, "one field of velocity and acceleration") });
}

function drawOrders() {
  const { order, amplitude } = state.compared.spectrum;
  const turn = motion() === "rad" ? 2 * Math.PI : 1;
  const force = scaleOf(amplitude, unit());
  plots.orders = plot($("orders"), plots.orders, {
    x: order.map((one) => one * turn), height: 240, legend: false,
    series: [{ label: "amplitude", values: amplitude.map((one) => one * force.factor), colour: colour("blue") }],
    xLabel: motion() === "rad" ? "order [cycles per revolution]" : "order [cycles per metre]", yLabel: `error [${force.unit}]`,
    onZoom: (start, end) => { if (start === null) drawOrders(); else plots.orders.setScale("x", { min: start, max: end }); },
  });
  $("orders-caption").textContent = order.length ? "Order spectrum of the error over position; drag to look closer, double click to see all." : "The travel is too short for an order spectrum.";
}

function select(test, words) {
  state.selection = test;
  const error = state.compared.rows.error;
  let n = 0, all = 0, own = 0;
  for (let k = 0; k < error.length; k++) { all += error[k] ** 2; if (test(k)) { n++; own += error[k] ** 2; } }
  $("selected").textContent = `${words}: ${n} of ${error.length} samples, ${Math.round((100 * own) / all)} % of the squared error, rms ${quantity(rms(error, test), unit())}`;
  drawWhere();
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
  const list = found ? [...found.candidates].sort((a, b) => b.gain - a.gain) : [];
  $("candidates").replaceChildren(...list.map((one) => candidateRow(one, found)));
  refreshButtons();
}

function candidateRow(one, found) {
  const item = document.createElement("li"), label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox";
  box.value = one.effect;
  box.checked = found.effects.includes(one.effect);
  box.onchange = refreshButtons;
  const strong = document.createElement("strong");
  strong.textContent = one.effect.replaceAll("_", " ");
  label.append(box, " ", strong, ` takes ${significant(100 * one.gain)} % of the squared error away${one.accepted ? "" : ", not accepted"}: ${one.why}`);
  const more = document.createElement("details"), head = document.createElement("summary");
  head.textContent = "What it is";
  more.append(head);
  for (const [name, text] of [["Looks like", one.looks_like], ["Caused by", one.cause], ["What to do", one.remedy]]) {
    const line = document.createElement("p");
    line.className = "quiet";
    line.textContent = `${name}: ${text}`;
    more.append(line);
  }
  item.append(label, more);
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
  $("closer").onclick = () => move(0, 0.5);
  $("earlier").onclick = () => move(-0.5);
  $("later").onclick = () => move(0.5);
  $("leave-out").onclick = leaveOut;
  $("put-back").onclick = () => { for (const one of state.recordings) one.leftOut = []; say("All ranges are fitted again."); };
  $("fit").onclick = fit;
  $("compare").onclick = () => compare();
  $("diagnose").onclick = diagnose;
  $("add").onclick = addChosen;
  $("undo").onclick = undo;
  $("save").onclick = save;
  $("stop").onclick = () => state.job && attempt(() => post(`/api/workbench/jobs/${state.job}/stop`, {}));
  $("coordinate").onchange = drawWhere;
  $("unselect").onclick = () => { state.selection = null; $("selected").textContent = ""; drawWhere(); };
  $("open-model").onchange = async (event) => {
    const file = event.target.files[0];
    if (!file) return;
    adoptModel({ text: await file.text(), label: file.name, error: null, floor: null, parameters: null, previous: {} });
    say(`${file.name} is open.`);
  };
  $("token-box").onclose = () => { setToken($("token").value); begin(); };
  const redraw = () => { attempt(draw); if (state.compared) drawWhere(); };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
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
