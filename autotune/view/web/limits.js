// What the chosen recordings used of the axis's limits: travel, speed and torque.

import { quantity, significant } from "/web/numbers.js";

const AT = 1e-3; // of what is allowed: a drive that clamps its torque records the limit itself, rounded

// `limits` by axis, of the service: they hold for recordings of that axis as its file is now.
export function showUsed(box, about, recordings, limits) {
  const alike = new Set(recordings.map((one) => `${one.motion_unit}, ${one.torque_unit}`)).size === 1;
  const known = alike ? limits?.[recordings[0].axis] : null;
  const held = known && recordings.every((one) => one.axis === recordings[0].axis && one.fingerprint === known.fingerprint) ? known : null;
  box.replaceChildren(...(alike ? rowsOf(recordings, held) : []).map(line));
  about.textContent = recordings.length ? wordsOf(recordings, alike, known, held) : "";
}

function rowsOf(recordings, known) {
  const { motion_unit: motion, torque_unit: force } = recordings[0];
  const low = Math.min(...recordings.map((one) => one.position[0])), high = Math.max(...recordings.map((one) => one.position[1]));
  const speeds = recordings.map((one) => one.speed).filter((speed) => speed !== null);
  const speed = speeds.length ? Math.max(...speeds) : null, torque = Math.max(...recordings.map((one) => one.largest_torque));
  const own = recordings.map((one) => one.torque_limit), of = force === "A" || force === "V" ? null : known?.torque; // an axis file's is in N m or N
  const limit = of ?? (own.includes(null) ? null : Math.min(...own));
  return [
    travel(low, high, known, motion),
    share("speed", speed, known?.speed ?? null, `${motion}/s`),
    share("torque", torque, limit, force),
  ];
}

function travel(low, high, known, unit) {
  const shown = `${quantity(low, unit)} to ${quantity(high, unit)}`;
  if (!known) return { name: "travel", text: shown, from: 0, to: null };
  const { position_min: first, position_max: last } = known, at = (place) => (place - first) / (last - first);
  const used = `${significant(100 * (at(high) - at(low)), 2)} %`;
  return { name: "travel", text: `${used}: ${shown}, of ${quantity(first, unit)} to ${quantity(last, unit)}`, from: at(low), to: at(high) };
}

function share(name, value, limit, unit) {
  if (value === null) return { name, text: "not recorded", from: 0, to: null };
  if (!limit) return { name, text: quantity(value, unit), from: 0, to: null };
  return { name, text: `${significant((100 * value) / limit, 2)} %: ${quantity(value, unit)} of ${quantity(limit, unit)}`, from: 0, to: value / limit };
}

// A track is the whole of what is allowed; without a limit there is none. Beyond it the bar is full and marked.
function line({ name, text, from, to }) {
  const row = document.createElement("div"), parts = [name, "", text].map(() => document.createElement("span"));
  row.className = "row";
  parts[0].textContent = name;
  const over = to !== null && Math.max(to - 1, -from) > AT, at = to !== null && !over && Math.max(to - 1, -from) > -AT;
  parts[2].textContent = over ? `${text}: beyond the limit` : at ? `${text}: at the limit` : text;
  if (to !== null) {
    const fill = document.createElement("div"), [first, last] = [from, to].map((part) => Math.min(1, Math.max(0, part)));
    parts[1].className = "track";
    fill.className = over || at ? "fill over" : "fill";
    Object.assign(fill.style, { marginLeft: `${100 * first}%`, width: `${100 * (last - first)}%` });
    parts[1].append(fill);
  }
  row.append(...parts);
  return row;
}

function wordsOf(recordings, alike, known, held) {
  if (!alike) return "The chosen recordings are in different units: choose those of one axis to see what they used of its limits.";
  const what = "Travel, speed and torque that the chosen recordings used";
  if (held) return `${what}, of the limits of axis ${recordings[0].axis}.`;
  const torque = recordings.every((one) => one.torque_limit !== null) ? " The torque's limit is the recordings' own." : "";
  const why = known
    ? `They are not all of axis ${recordings[0].axis} as its file is now, so that its limits are not compared.`
    : "Limits of travel and speed are known where a service has the axis.";
  return `${what}. ${why}${torque}`;
}
