// Pictures: traces with uPlot, maps on a canvas. Colours come from the page's theme.

import { significant } from "/web/numbers.js";

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// `series`: [{label, values, colour, dash, points, right}], all over the same x; those on the `right` have an axis of
// their own, `rightLabel`. `marks`: [{x, label}], as lines across; `units`: of x and of the values, for the numbers under
// the cursor. Returns the plot; the old one goes.
export function plot(box, old, { x, series, xLabel, yLabel, rightLabel, height = 220, legend = true, onZoom, onBrush, onClick, bands, shared, marks = [], units = ["", ""] }) {
  const width = Math.max(box.clientWidth, 260);
  const on = { onZoom, onBrush, onClick, marks };
  const thin = x.length > width ? 1 / devicePixelRatio : 1.4; // dense traces as hairlines: painted ten times as fast
  const key = JSON.stringify([width, height, thin, xLabel, yLabel, rightLabel, legend, series.map((one) => [one.label, one.colour, one.dash])]);
  if (old?.key === key) { // the same picture of other data
    Object.assign(old.on, on);
    old.setData([x, ...series.map((one) => one.values)]);
    return old;
  }
  if (old) old.destroy();
  const axis = { stroke: colour("muted"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line") } };
  const made = new uPlot(
    {
      width, height, legend: { show: legend },
      cursor: { drag: { x: Boolean(onZoom || onBrush), y: false, setScale: false }, sync: shared ? { key: shared } : undefined },
      scales: { x: { time: false } },
      axes: [
        { ...axis, label: xLabel || undefined }, { ...axis, label: yLabel, size: 70 },
        ...(rightLabel ? [{ ...axis, label: rightLabel, size: 70, side: 1, scale: "right", grid: { show: false } }] : []),
      ],
      series: [
        { label: xLabel.replace(/ \[.*/, "") || "time", value: told(units[0], 5) },
        ...series.map((one) => ({
          label: one.label, value: told(units[1], 4), scale: one.right ? "right" : "y", stroke: one.colour, width: one.width || thin, dash: one.dash,
          paths: one.points ? () => null : undefined, points: { show: Boolean(one.points), size: 5, fill: one.colour },
          spanGaps: false,
        })),
      ],
      bands,
      hooks: {
        draw: [(u) => { drawMarks(u, on.marks); box.dataset.drawn = Number(box.dataset.drawn || 0) + 1; }],
        setSelect: [
          (u) => {
            const dragged = on.onBrush || on.onZoom;
            if (!dragged || u.select.width < 3) return;
            dragged(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          },
        ],
        ready: [
          (u) => {
            u.over.addEventListener("dblclick", () => on.onZoom && on.onZoom(null, null));
            let down = 0;
            u.over.addEventListener("mousedown", (event) => { down = event.clientX; });
            u.over.addEventListener("click", (event) => {
              if (on.onClick && Math.abs(event.clientX - down) < 4) on.onClick(u.posToVal(u.cursor.left, "x"), event.shiftKey);
            });
          },
        ],
      },
    },
    [x, ...series.map((one) => one.values)],
    box,
  );
  return Object.assign(made, { key, on });
}

const told = (unit, digits) => (u, value) => (value === null || value === undefined ? "–" : `${significant(value, digits)} ${unit}`.trim());

// Lines across a plot, with a word on those that leave room for one.
function drawMarks(u, marks) {
  const { left, top, width, height } = u.bbox, pen = u.ctx;
  pen.save();
  Object.assign(pen, { strokeStyle: colour("muted"), fillStyle: colour("muted"), font: `${12 * devicePixelRatio}px system-ui, sans-serif` });
  pen.setLineDash([4, 4]);
  let free = left;
  for (const { x, label } of marks) {
    const at = u.valToPos(x, "x", true);
    if (at < left || at > left + width) continue;
    pen.beginPath();
    pen.moveTo(at, top);
    pen.lineTo(at, top + height);
    pen.stroke();
    const wide = pen.measureText(label).width + 8;
    const begin = at + wide > left + width ? at - wide : at + 4;
    if (begin < free) continue;
    pen.fillText(label, begin, top + 14 * devicePixelRatio);
    free = begin + wide;
  }
  pen.restore();
}

// Rms over two coordinates; `onCell` is told which field was clicked, or chosen by arrows and Enter.
export function heat(canvas, { values, columns, rows, labels, largest, onCell }) {
  const pen = canvas.getContext("2d"), dots = devicePixelRatio || 1;
  const wide = canvas.clientWidth || 480, high = rows > 2 ? Math.round(0.62 * wide) : 150;
  Object.assign(canvas, { width: wide * dots, height: high * dots });
  canvas.style.height = `${high}px`;
  pen.scale(dots, dots);
  const left = 56, bottom = 38, top = labels.y ? 24 : 8, width = wide - left - 10, height = high - bottom - top;
  pen.fillStyle = colour("paper");
  pen.fillRect(0, 0, wide, high);
  const [cold, warm] = [channels(colour("map-cold")), channels(colour("map-warm"))];
  for (let i = 0; i < columns; i++)
    for (let j = 0; j < rows; j++) {
      const value = values[j * columns + i];
      if (value === null) continue;
      const share = Math.min(1, value / largest);
      pen.fillStyle = `rgb(${cold.map((c, n) => Math.round(c + (warm[n] - c) * share)).join(",")})`;
      pen.fillRect(left + (i * width) / columns, top + ((rows - 1 - j) * height) / rows, width / columns + 0.5, height / rows + 0.5);
    }
  pen.strokeStyle = colour("line");
  pen.strokeRect(left, top, width, height);
  pen.fillStyle = colour("muted");
  pen.font = "13px system-ui, sans-serif";
  const write = (text, align, x, y) => { pen.textAlign = align; pen.fillText(text, x, y); };
  write(labels.left, "left", left, high - 22);
  write(labels.right, "right", left + width, high - 22);
  write(labels.x, "center", left + width / 2, high - 5);
  write(labels.top, "right", left - 5, top + (rows > 2 ? 12 : height / 4 + 5));
  write(labels.bottom, "right", left - 5, top + (rows > 2 ? height : (3 * height) / 4 + 5));
  if (labels.y) write(labels.y, "left", left, 16);
  const frame = (i, j) => { pen.strokeStyle = colour("ink"); pen.lineWidth = 2; pen.strokeRect(left + (i * width) / columns, top + ((rows - 1 - j) * height) / rows, width / columns, height / rows); pen.lineWidth = 1; };
  if (canvas.chosen) frame(...canvas.chosen);
  const choose = (i, j, also) => { canvas.chosen = [i, j]; onCell(i, j, also); };
  canvas.onclick = (event) => {
    const i = Math.floor(((event.offsetX - left) / width) * columns);
    const j = rows - 1 - Math.floor(((event.offsetY - top) / height) * rows);
    if (i >= 0 && i < columns && j >= 0 && j < rows) choose(i, j, event.shiftKey);
  };
  canvas.onkeydown = (event) => {
    const step = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!step) return;
    event.preventDefault();
    const [i, j] = canvas.chosen || [-1, 0];
    choose(Math.min(columns - 1, Math.max(0, i + step[0])), Math.min(rows - 1, Math.max(0, j + step[1])), event.shiftKey);
  };
}

const channels = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

// Rows of a bar chart with words: [{name, value, text, weak, title, onClick}].
export function bars(box, rows, floor) {
  box.replaceChildren();
  const largest = Math.max(...rows.map((row) => Math.abs(row.value)), floor || 0, 1e-300);
  for (const row of rows) {
    const line = document.createElement("div");
    line.className = "row";
    const name = document.createElement(row.onClick ? "button" : "span");
    name.textContent = row.name;
    if (row.onClick) Object.assign(name, { type: "button", className: "link", onclick: row.onClick, title: row.title });
    if (row.onClick) line.onclick = (event) => { if (event.target !== name) row.onClick(event); };
    const track = document.createElement("div");
    track.className = "track";
    const fill = document.createElement("div");
    fill.className = row.weak ? "fill weak" : "fill";
    fill.style.width = `${(100 * Math.max(row.value, 0)) / largest}%`;
    track.append(fill);
    if (floor) {
      const mark = document.createElement("div");
      mark.className = "floor";
      mark.style.left = `${(100 * floor) / largest}%`;
      mark.title = "noise floor, an estimate";
      track.append(mark);
    }
    const text = document.createElement("span");
    text.textContent = row.text;
    line.append(name, track, text);
    box.append(line);
  }
}
