// Pictures: traces with uPlot, maps on a canvas. Colours come from the page's theme.

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// `series`: [{label, values, colour, dash, points}], all over the same x. Returns the plot; the old one goes.
export function plot(box, old, { x, series, xLabel, yLabel, height = 220, legend = true, onZoom, onClick, bands, scatter, shared }) {
  if (old) old.destroy();
  const width = Math.max(box.clientWidth, 260);
  const axis = { stroke: colour("muted"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line") } };
  const made = new uPlot(
    {
      width, height, legend: { show: legend },
      cursor: { drag: { x: Boolean(onZoom), y: false, setScale: false }, sync: shared ? { key: shared } : undefined },
      scales: { x: { time: false } },
      axes: [{ ...axis, label: xLabel }, { ...axis, label: yLabel, size: 70 }],
      series: [
        { label: xLabel },
        ...series.map((one) => ({
          label: one.label, stroke: one.colour, width: one.width || 1.4, dash: one.dash,
          paths: one.points ? () => null : undefined, points: { show: Boolean(one.points), size: 5, fill: one.colour },
          spanGaps: false,
        })),
      ],
      bands,
      hooks: {
        setSelect: [
          (u) => {
            if (!onZoom || u.select.width < 3) return;
            onZoom(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          },
        ],
        ready: [
          (u) => {
            u.over.addEventListener("dblclick", () => onZoom && onZoom(null, null));
            let down = 0;
            u.over.addEventListener("mousedown", (event) => { down = event.clientX; });
            u.over.addEventListener("click", (event) => {
              if (onClick && Math.abs(event.clientX - down) < 4) onClick(u.posToVal(u.cursor.left, "x"), event.shiftKey);
            });
          },
        ],
      },
    },
    [x, ...series.map((one) => one.values)],
    box,
  );
  return made;
}

// Rms over two coordinates; `cell` is told what was clicked.
export function heat(canvas, { values, columns, rows, labels, largest, onCell }) {
  const pen = canvas.getContext("2d");
  const left = 56, bottom = 34, width = canvas.width - left - 8, height = canvas.height - bottom - 8;
  pen.fillStyle = colour("paper");
  pen.fillRect(0, 0, canvas.width, canvas.height);
  const [r, g, b] = [0, 99, 168];
  for (let i = 0; i < columns; i++)
    for (let j = 0; j < rows; j++) {
      const value = values[j * columns + i];
      if (value === null) continue;
      const share = Math.min(1, value / largest);
      pen.fillStyle = `rgba(${Math.round(r + (240 - r) * share * share)},${Math.round(g + (120 - g) * share)},${Math.round(b * (1 - share))},${0.12 + 0.88 * share})`;
      pen.fillRect(left + (i * width) / columns, 8 + ((rows - 1 - j) * height) / rows, width / columns + 1, height / rows + 1);
    }
  pen.strokeStyle = colour("line");
  pen.strokeRect(left, 8, width, height);
  pen.fillStyle = colour("muted");
  pen.font = "13px system-ui, sans-serif";
  pen.textAlign = "left";
  pen.fillText(labels.left, left, canvas.height - 16);
  pen.textAlign = "right";
  pen.fillText(labels.right, left + width, canvas.height - 16);
  pen.textAlign = "center";
  pen.fillText(labels.x, left + width / 2, canvas.height - 3);
  pen.textAlign = "right";
  pen.fillText(labels.top, left - 4, 18);
  pen.fillText(labels.bottom, left - 4, height + 8);
  canvas.onclick = (event) => {
    const scale = canvas.width / canvas.clientWidth;
    const i = Math.floor(((event.offsetX * scale - left) / width) * columns);
    const j = rows - 1 - Math.floor(((event.offsetY * scale - 8) / height) * rows);
    if (i >= 0 && i < columns && j >= 0 && j < rows) onCell(i, j);
  };
}

// Rows of a bar chart with words: [{name, value, text, weak, title}].
export function bars(box, rows, floor) {
  box.replaceChildren();
  const largest = Math.max(...rows.map((row) => Math.abs(row.value)), floor || 0, 1e-300);
  for (const row of rows) {
    const line = document.createElement("div");
    line.className = "row";
    const name = document.createElement("span");
    name.textContent = row.name;
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
