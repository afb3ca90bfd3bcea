// What a candidate explains, laid over what the model misses: over its coordinate, by direction, and over time.

import { quantity, range, rms, scaleOf } from "/web/numbers.js";
import { colour, plot } from "/web/plots.js";
import { BINS, byDirection, coordinateLabel, coordinateUnit } from "/web/where.js";

const $ = (id) => document.getElementById(id);
const view = { found: null, effect: null, motion: "rad", torque: "N m", changed: () => {} };
let picture = null;

const spoken = (name) => name.replaceAll("_", " ");

// The candidate that is laid over: {label, time, values}, or null.
export function overlaid() {
  if (!view.effect) return null;
  return { label: `${spoken(view.effect)} would explain`, time: view.found.rows.time, values: view.found.contributions[view.effect] };
}

// `found`: {rows, contributions, follows} of a diagnosis, or null; `changed` is called when the traces have to follow.
export function newOverlay(found, { motion, torque, changed }) {
  Object.assign(view, { found, effect: null, motion, torque, changed });
  draw();
}

export const canOverlay = (effect) => Boolean(view.found?.contributions[effect]);

export function layOver(effect) {
  view.effect = effect;
  if (effect) {
    const names = Object.keys(view.found.rows).filter((name) => !["time", "error"].includes(name));
    $("overlay-over").replaceChildren(...names.map((name) => new Option(spoken(name), name, false, name === view.found.follows[effect])));
  }
  draw();
  view.changed();
}

function draw() {
  $("overlay").hidden = !view.effect;
  if (!view.effect) return;
  const { rows, contributions } = view.found, values = contributions[view.effect], name = $("overlay-over").value;
  const [low, high] = range(rows[name]), width = (high - low) / BINS;
  const centre = Array.from({ length: BINS }, (_, k) => low + (k + 0.5) * width);
  const missed = byDirection(rows, name, low, high, () => true), explained = byDirection(rows, name, low, high, () => true, values);
  const force = scaleOf([...missed, ...explained].flatMap((one) => one.mean), view.torque);
  const scaled = (mean) => mean.map((one) => (one === null ? null : one * force.factor));
  const series = missed.flatMap((one, i) => [
    { label: `${one.label}, missed`, values: scaled(one.mean), colour: colour(one.ink), width: 2 },
    { label: `${one.label}, ${spoken(view.effect)}`, values: scaled(explained[i].mean), colour: colour(one.ink), width: 2, dash: [6, 4] },
  ]);
  picture = plot($("overlay-plot"), picture, { x: centre, series, xLabel: coordinateLabel(name, view.motion), yLabel: `torque [${force.unit}]`, units: [coordinateUnit(name, view.motion), force.unit], height: 260 });
  const left = rows.error.map((one, k) => one - values[k]);
  $("overlay-caption").textContent = `What the model misses (solid) and what ${spoken(view.effect)} would explain of it (dashed), mean by direction; rms ${quantity(rms(rows.error), view.torque)} without, ${quantity(rms(left), view.torque)} with it, on the rows that were fitted. It is in the torque over time, too.`;
}

$("overlay-over").onchange = draw;
$("overlay-off").onclick = () => layOver(null);
