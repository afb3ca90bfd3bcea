// Numbers as people write them, and statistics of rows.

const PREFIXES = [[1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];

export function significant(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.floor(Math.log10(Math.abs(value)));
  if (size < -4 || size > 6) return value.toExponential(digits - 1).replace("e", " × 10^").replace("-", "−");
  return value.toFixed(Math.max(0, digits - 1 - size)).replace("-", "−");
}

export function quantity(value, unit) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const plain = ["N m", "N", "A", "V", "rad", "m", "rad/s", "m/s", "s"].includes(unit);
  const [size, prefix] = plain && value !== 0 ? PREFIXES.find(([s]) => Math.abs(value) >= 0.999 * s) || PREFIXES[3] : PREFIXES[0];
  return `${significant(value / size)} ${prefix}${unit}`.trim();
}

export function scaleOf(values, unit) {
  let largest = 0;
  for (const v of values) if (v !== null && Number.isFinite(v) && Math.abs(v) > largest) largest = Math.abs(v);
  const [size, prefix] = largest > 0 ? PREFIXES.find(([s]) => largest >= 0.999 * s) || PREFIXES[3] : PREFIXES[0];
  return { factor: 1 / size, unit: prefix + unit };
}

// Mean and standard error of `error` in bins of `values`, of the rows for which `keep` says so.
export function binned(values, error, keep, count, low, high) {
  const n = new Float64Array(count), sum = new Float64Array(count), square = new Float64Array(count);
  for (let k = 0; k < values.length; k++) {
    if (!keep(k)) continue;
    const bin = Math.min(count - 1, Math.max(0, Math.floor(((values[k] - low) / (high - low)) * count)));
    n[bin]++; sum[bin] += error[k]; square[bin] += error[k] * error[k];
  }
  const mean = [], spread = [], rms = [];
  for (let b = 0; b < count; b++) {
    if (n[b] < 4) { mean.push(null); spread.push(null); rms.push(null); continue; }
    const m = sum[b] / n[b];
    mean.push(m);
    spread.push(Math.sqrt(Math.max(square[b] / n[b] - m * m, 0) / (n[b] - 1)));
    rms.push(Math.sqrt(square[b] / n[b]));
  }
  return { mean, spread, rms, n };
}

export function range(values) {
  let low = Infinity, high = -Infinity;
  for (const v of values) { if (v < low) low = v; if (v > high) high = v; }
  return low < high ? [low, high] : [low - 0.5, low + 0.5];
}

export function rms(values, keep = () => true) {
  let sum = 0, n = 0;
  for (let k = 0; k < values.length; k++) if (keep(k)) { sum += values[k] * values[k]; n++; }
  return n ? Math.sqrt(sum / n) : NaN;
}
