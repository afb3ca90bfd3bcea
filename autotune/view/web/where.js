// Where the model fails: pictures of one error, and the selection of samples that they share.
// A selection is a test of rows with its words; the last one counts, the others can be gone back to.

import { binned, quantity, range, rms, scaleOf, significant } from "/web/numbers.js";
import { bars, colour, heat, plot } from "/web/plots.js";

const $ = (id) => document.getElementById(id);
export const BINS = 40;
const CREST = 0.5; // cos above it: a third of every period
const LOW = 50; // orders that are shown at first, and whatever the largest wave is at
const NOT_A_COORDINATE = new Set(["torque", "error", "kind"]);
const view = { compared: null, beside: null, selections: [], place: null, motion: "rad", torque: "N m", changed: () => {} };
const plots = {};

export const selection = () => view.selections[view.selections.length - 1] || null;
const keep = () => selection()?.test || (() => true);
const spoken = (name) => name.replaceAll("_", " ");

// `beside`: {label, compared} or null; `changed` is called when other pictures have to follow the selection.
export function showWhere(compared, { beside = null, motion, torque, changed }) {
  if (compared !== view.compared) view.selections = [];
  Object.assign(view, { compared, beside, motion, torque, changed });
  const rows = compared?.rows;
  $("where").hidden = !rows;
  $("where-none").hidden = Boolean(rows);
  if (!rows) return;
  const names = Object.keys(rows).filter((name) => !NOT_A_COORDINATE.has(name));
  const best = Object.entries(compared.where).sort((a, b) => b[1] - a[1]);
  const now = $("coordinate").value || best.find(([name]) => names.includes(name))?.[0] || "velocity";
  $("coordinate").replaceChildren(
    ...names.map((name) => {
      const share = compared.where[name];
      return new Option(`${spoken(name)}${share === undefined ? "" : ` (${Math.round(100 * share)} % of the error follows it)`}`, name, false, name === now);
    }),
  );
  drawWhere();
}

export function drawWhere() {
  if (!view.compared) return;
  const rows = view.compared.rows;
  tellSelection(rows);
  drawRegimes(rows);
  drawCoordinate(rows);
  drawMap(rows);
  drawPlaces(rows);
  drawOrders();
}

// ---------------------------------------------------------------- the selection

export function select(test, words, also = false) {
  const before = also ? selection() : null;
  view.selections.push(before ? { test: (k) => before.test(k) || test(k), words: `${before.words}, or ${words}` } : { test, words });
  drawWhere();
  view.changed();
}

export function selectTime(from, to) {
  const time = view.compared.rows.time;
  select((k) => time[k] >= from && time[k] <= to, `${significant(from, 4)} to ${significant(to, 4)} s`);
}

export function undoSelection() {
  view.selections.pop();
  drawWhere();
  view.changed();
}

export function selectAll() {
  view.selections = [];
  drawWhere();
  view.changed();
}

// Stretches of time that the selection covers, for leaving them out.
export function selectedStretches(most = 500) {
  const chosen = selection(), time = view.compared?.rows.time;
  if (!chosen || !time) return [];
  const step = time.length > 1 ? medianStep(time) : 0;
  const found = [];
  for (let k = 0; k < time.length; k++) {
    if (!chosen.test(k)) continue;
    const last = found[found.length - 1];
    if (last && time[k] - last[1] < 2.5 * step && time[k] >= last[1]) last[1] = time[k];
    else found.push([time[k], time[k]]);
  }
  return found.slice(0, most).map(([a, b]) => [a - step / 2, b + step / 2]);
}

function medianStep(time) {
  const steps = [];
  for (let k = 1; k < Math.min(time.length, 2000); k++) steps.push(time[k] - time[k - 1]);
  steps.sort((a, b) => a - b);
  return steps[Math.floor(steps.length / 2)];
}

function tellSelection(rows) {
  const chosen = selection();
  $("unselect").disabled = $("selection-back").disabled = $("leave-selected").disabled = !chosen;
  if (!chosen) { $("selected").textContent = "All samples. A click in any picture selects samples in all of them; Shift adds to them."; return; }
  let n = 0, all = 0, own = 0;
  for (let k = 0; k < rows.error.length; k++) { all += rows.error[k] ** 2; if (chosen.test(k)) { n++; own += rows.error[k] ** 2; } }
  $("selected").textContent = `${chosen.words}: ${n} of ${rows.error.length} samples, ${Math.round((100 * own) / all)} % of the squared error, rms ${n ? quantity(rms(rows.error, chosen.test), view.torque) : "–"}`;
}

// ---------------------------------------------------------------- pictures

function drawRegimes(rows) {
  const kept = keep(), kinds = view.compared.kinds;
  const list = [];
  kinds.forEach((name, bit) => {
    if (view.compared.regimes[name] === null) return;
    const inside = (k) => (rows.kind[k] >> bit) & 1;
    const value = rms(rows.error, (k) => inside(k) && kept(k));
    const text = Number.isFinite(value) ? quantity(value, view.torque) : "none selected";
    list.push({ name: spoken(name), value: Number.isFinite(value) ? value : 0, text, onClick: (event) => select(inside, spoken(name), event.shiftKey), title: `Select the samples of ${spoken(name)}` });
    const other = view.beside?.compared.regimes[name];
    if (other) list.push({ name: `… ${view.beside.label}`, value: other, text: quantity(other, view.torque), weak: true });
  });
  bars($("regimes"), list, view.compared.noise_floor_rms);
}

export function coordinateUnit(name, motion = view.motion) {
  const units = { position: motion, velocity: `${motion}/s`, acceleration: `${motion}/s²`, time: "s", temperature: "°C", travel_since_reversal: `log10 ${motion}`, time_since_reversal: "log10 s" };
  return units[name] || "";
}

export function coordinateLabel(name, motion = view.motion) {
  const unit = coordinateUnit(name, motion);
  return unit ? `${spoken(name)} [${unit}]` : spoken(name);
}

export function byDirection(rows, name, low, high, kept, values = rows.error) {
  const sides = [["forwards", "blue", (k) => rows.velocity[k] > 0], ["backwards", "orange", (k) => rows.velocity[k] < 0]];
  return sides.map(([label, ink, side]) => ({ label, ink, ...binned(rows[name], values, (k) => side(k) && kept(k), BINS, low, high) }));
}

function drawCoordinate(rows) {
  const name = $("coordinate").value, x = rows[name];
  const [low, high] = range(x), width = (high - low) / BINS;
  const centre = Array.from({ length: BINS }, (_, k) => low + (k + 0.5) * width);
  const force = scaleOf(view.beside ? [...rows.error, ...view.beside.compared.rows.error] : rows.error, view.torque);
  const series = [];
  for (const { label, ink, mean, spread } of byDirection(rows, name, low, high, keep())) {
    const at = (sign) => mean.map((m, i) => (m === null ? null : (m + sign * spread[i]) * force.factor));
    series.push({ label, values: at(0), colour: colour(ink), width: 2 });
    series.push({ label: `${label} + error`, values: at(1), colour: colour(ink), width: 0.5, dash: [2, 3] });
    series.push({ label: `${label} − error`, values: at(-1), colour: colour(ink), width: 0.5, dash: [2, 3] });
  }
  const other = view.beside?.compared.rows;
  if (other?.[name]) for (const { label, ink, mean } of byDirection(other, name, low, high, () => true))
    series.push({ label: `${label}, ${view.beside.label}`, values: mean.map((m) => (m === null ? null : m * force.factor)), colour: colour(ink), width: 1.2, dash: [8, 4] });
  const within = (from, to, also) => select((k) => x[k] >= from && x[k] <= to, `${spoken(name)} from ${significant(from)} to ${significant(to)} ${coordinateUnit(name)}`, also);
  const pick = (value, also) => {
    const bin = Math.min(BINS - 1, Math.max(0, Math.floor((value - low) / width)));
    within(low + bin * width, low + (bin + 1) * width, also);
  };
  plots.where = plot($("by-coordinate"), plots.where, { x: centre, series, xLabel: coordinateLabel(name), yLabel: `error [${force.unit}]`, onClick: pick, onBrush: within, height: 280, legend: false });
  $("by-coordinate").onkeydown = (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    view.place = Math.min(BINS - 1, Math.max(0, (view.place ?? (step > 0 ? -1 : BINS)) + step));
    pick(centre[view.place], event.shiftKey);
  };
}

// Rms error in fields of two coordinates, and which field a row is in.
function field(u, v, [ul, uh], [vl, vh], columns, lines, error) {
  const cell = (k) => {
    const i = Math.floor(((u(k) - ul) / (uh - ul)) * columns), j = Math.floor(((v(k) - vl) / (vh - vl)) * lines);
    return i < 0 || j < 0 || i > columns || j > lines ? -1 : Math.min(j, lines - 1) * columns + Math.min(i, columns - 1);
  };
  const n = new Float64Array(columns * lines), sum = new Float64Array(columns * lines), kept = keep();
  for (let k = 0; k < error.length; k++) {
    const c = cell(k);
    if (c >= 0 && kept(k)) { n[c]++; sum[c] += error[k] ** 2; }
  }
  const values = Array.from(n, (count, c) => (count < 3 ? null : Math.sqrt(sum[c] / count)));
  return { cell, values, largest: Math.max(...values.filter((one) => one !== null), 1e-300) };
}

const trimmed = (values) => { const sorted = Float64Array.from(values).sort(); const at = (q) => sorted[Math.floor(q * (sorted.length - 1))]; return [at(0.005), at(0.995)]; };

function drawMap(rows) {
  const columns = 24, lines = 16;
  const [us, vs] = [trimmed(rows.velocity), trimmed(rows.acceleration)];
  const { cell, values, largest } = field((k) => rows.velocity[k], (k) => rows.acceleration[k], us, vs, columns, lines, rows.error);
  const labels = { left: significant(us[0]), right: significant(us[1]), x: `velocity [${view.motion}/s], up to ${quantity(largest, view.torque)} rms`, top: significant(vs[1]), bottom: significant(vs[0]), y: `acceleration [${view.motion}/s²]` };
  const onCell = (i, j, also) => select((k) => cell(k) === j * columns + i, `velocity from ${significant(us[0] + (i * (us[1] - us[0])) / columns)} ${view.motion}/s and acceleration from ${significant(vs[0] + (j * (vs[1] - vs[0])) / lines)} ${view.motion}/s², one field`, also);
  heat($("map"), { values, columns, rows: lines, labels, largest, onCell });
}

function drawPlaces(rows) {
  const columns = 40, us = range(rows.position);
  const { cell, values, largest } = field((k) => rows.position[k], (k) => (rows.velocity[k] > 0 ? 1 : rows.velocity[k] < 0 ? 0 : NaN), us, [0, 1.5], columns, 2, rows.error);
  const labels = { left: significant(us[0]), right: significant(us[1]), x: `position [${view.motion}], up to ${quantity(largest, view.torque)} rms`, top: "forw.", bottom: "backw.", y: "" };
  const onCell = (i, j, also) => select((k) => cell(k) === j * columns + i, `position from ${significant(us[0] + (i * (us[1] - us[0])) / columns)} ${view.motion}, ${j ? "forwards" : "backwards"}`, also);
  heat($("places"), { values, columns, rows: 2, labels, largest, onCell });
}

function drawOrders() {
  const { order, amplitude, phase } = view.compared.spectrum, position = view.compared.rows.position;
  const turn = view.motion === "rad" ? 2 * Math.PI : 1;
  const force = scaleOf([...amplitude, ...(view.beside?.compared.spectrum.amplitude || [])], view.torque);
  const series = [{ label: "amplitude", values: amplitude.map((one) => one * force.factor), colour: colour("blue") }];
  const other = view.beside?.compared.spectrum;
  if (other?.order.length) {
    const step = (other.order[other.order.length - 1] - other.order[0]) / Math.max(other.order.length - 1, 1) || 1;
    const at = (one) => other.amplitude[Math.round((one - other.order[0]) / step)];
    series.push({ label: view.beside.label, values: order.map((one) => (at(one) === undefined ? null : at(one) * force.factor)), colour: colour("grey"), dash: [6, 4] });
  }
  const pick = (value, also) => {
    let k = 0;
    for (let i = 1; i < order.length; i++) if (Math.abs(order[i] * turn - value) < Math.abs(order[k] * turn - value)) k = i;
    for (const i of [k - 2, k - 1, k + 1, k + 2]) if (amplitude[i] > amplitude[k]) k = i; // the peak beside the click
    select((i) => Math.cos(2 * Math.PI * order[k] * position[i] + phase[k]) > CREST, `crests of order ${significant(order[k] * turn, 4)} (${quantity(amplitude[k], view.torque)})`, also);
  };
  plots.orders = plot($("orders"), plots.orders, {
    x: order.map((one) => one * turn), height: 240, legend: false, series,
    xLabel: view.motion === "rad" ? "order [cycles per revolution]" : "order [cycles per metre]", yLabel: `error [${force.unit}]`,
    onZoom: (start, end) => plots.orders.setScale("x", start === null ? { min: 0, max: order[order.length - 1] * turn } : { min: start, max: end }),
    onClick: order.length ? pick : undefined,
  });
  if (order.length) plots.orders.setScale("x", { min: 0, max: Math.min(order[order.length - 1] * turn, Math.max(LOW, 1.2 * turn * order[amplitude.indexOf(Math.max(...amplitude))])) });
  $("orders").onkeydown = (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step || !order.length) return;
    event.preventDefault();
    const peaks = order.map((_, i) => i).sort((a, b) => amplitude[b] - amplitude[a]).slice(0, 20).sort((a, b) => a - b);
    view.peak = Math.min(peaks.length - 1, Math.max(0, (view.peak ?? (step > 0 ? -1 : peaks.length)) + step));
    pick(order[peaks[view.peak]] * turn, event.shiftKey);
  };
  $("orders-caption").textContent = order.length
    ? "Order spectrum of the error over position: a click selects the samples on an order's crests; drag to look closer, double click to see all."
    : "The travel is too short for an order spectrum.";
}
