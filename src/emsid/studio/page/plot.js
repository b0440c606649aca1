// A plot over time whose windows come from the server, linked with others of its group in zoom and cursor.
import uPlot from "./vendor/uPlot.esm.js";

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const color = (k) => style(`--s${k % 6}`);

export class Group {
  constructor() {
    this.plots = new Set();
    this.sync = uPlot.sync(`group ${Math.random()}`);
    this.range = null;
  }

  zoom(first, last) {
    this.range = [first, last];
    for (const plot of this.plots) plot.show(first, last);
  }

  close() {
    for (const plot of this.plots) plot.close();
    this.plots.clear();
  }
}

export class TimePlot {
  // labels: of the lines; load(first, last, width): a promise of {t, rows}; marks: [{first, last, kind}]
  constructor(place, { labels, unit, title, height = 180, load, ends, group, marks = [], onBrush = null, time = "Time [s]", from = 0 }) {
    Object.assign(this, { place, load, ends, group, marks, onBrush });
    const axis = { stroke: style("--ink"), grid: { stroke: style("--edge"), width: 0.5 }, ticks: { stroke: style("--edge") } };
    this.plot = new uPlot({
      width: this.width, height, title: title ?? undefined,
      cursor: { sync: { key: group.sync.key }, drag: { x: true, y: false, setScale: !onBrush } },
      legend: { live: true },
      scales: { x: { time: false, range: () => this.shown ?? this.ends } },
      axes: [{ ...axis, label: time, labelSize: 20, size: 40 }, { ...axis, label: unit, labelSize: 20, size: 62 }],
      series: [{ label: "t" }, ...labels.map((label, k) => ({ label, stroke: color(k + from), width: 1.2, spanGaps: false }))],
      hooks: {
        setSelect: [(u) => this.selected(u)],
        drawClear: [(u) => this.drawMarks(u)],
      },
    }, [[], ...labels.map(() => [])], place);
    this.plot.over.addEventListener("dblclick", () => group.zoom(...this.ends));
    this.plot.over.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    place.tabIndex = 0;
    place.addEventListener("keydown", (event) => this.key(event));
    this.observer = new ResizeObserver(() => {
      if (Math.abs(this.plot.width - this.width) > 4) { this.plot.setSize({ width: this.width, height }); this.show(...(this.shown ?? this.ends)); }
    });
    this.observer.observe(place);
    group.plots.add(this);
    this.ready = this.show(...(group.range ?? ends));
  }

  get width() { return Math.max(this.place.clientWidth, 200); }

  async show(first, last) {
    const asked = this.asked = (this.asked ?? 0) + 1;
    const found = await this.load(first, last, this.width);
    if (asked !== this.asked || !this.plot) return;
    this.shown = [first, last];
    this.plot.setData([found.t, ...found.rows], true);
  }

  selected(u) {
    if (u.select.width < 3) return;
    const range = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
    if (this.onBrush) this.onBrush(...range);
    else this.group.zoom(...range);
  }

  clear() { this.plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false); }

  move(share, factor) {
    const [a, b] = this.shown ?? this.ends, span = Math.min((b - a) * factor, this.ends[1] - this.ends[0]);
    const middle = (a + b) / 2 + share * (b - a);
    const first = Math.min(Math.max(middle - span / 2, this.ends[0]), this.ends[1] - span);
    this.group.zoom(first, first + span);
  }

  wheel(event) {
    if (!event.ctrlKey && !event.shiftKey) return;
    event.preventDefault();
    this.move(event.shiftKey ? Math.sign(event.deltaY || event.deltaX) / 8 : 0, event.ctrlKey ? Math.exp(event.deltaY / 300) : 1);
  }

  key(event) {
    const steps = { ArrowLeft: [-0.25, 1], ArrowRight: [0.25, 1], "+": [0, 0.5], "-": [0, 2] };
    if (event.key === "0") this.group.zoom(...this.ends);
    else if (steps[event.key]) this.move(...steps[event.key]);
    else return;
    event.preventDefault();
  }

  drawMarks(u) {
    const inks = { gap: "--edge", outlier: "--s1", saturation: "--s3", standstill: "--s2", jitter: "--s5", split: "--s4" };
    for (const mark of this.marks) {
      const left = u.valToPos(mark.first, "x", true), right = u.valToPos(mark.last, "x", true);
      if (right < u.bbox.left || left > u.bbox.left + u.bbox.width) continue;
      u.ctx.save();
      u.ctx.globalAlpha = mark.kind === "outlier" ? 0.8 : 0.22;
      u.ctx.fillStyle = style(inks[mark.kind] ?? "--edge");
      const a = Math.max(left, u.bbox.left), b = Math.min(right, u.bbox.left + u.bbox.width);
      u.ctx.fillRect(a, u.bbox.top, Math.max(b - a, 2), u.bbox.height);
      u.ctx.restore();
    }
  }

  close() {
    this.observer.disconnect();
    this.plot.destroy();
    this.plot = null;
  }
}

// A plot of arrays that are here already: live signals and played runs.
export function arrays(place, labels, unit, height = 220) {
  const axis = { stroke: style("--ink"), grid: { stroke: style("--edge"), width: 0.5 } };
  const plot = new uPlot({
    width: Math.max(place.clientWidth, 200), height,
    scales: { x: { time: false } },
    hooks: { destroy: [() => watch.disconnect()] },
    axes: [{ ...axis, label: "Time [s]", labelSize: 20, size: 40 }, { ...axis, label: unit, labelSize: 20, size: 62 }],
    series: [{ label: "t" }, ...labels.map((label, k) => ({ label, stroke: color(k), width: 1.2 }))],
  }, [[], ...labels.map(() => [])], place);
  const watch = new ResizeObserver(() => {
    if (Math.abs(plot.width - place.clientWidth) > 4) plot.setSize({ width: Math.max(place.clientWidth, 200), height });
  });
  watch.observe(place);
  return plot;
}
