// Plots. A chart has curves over x that are loaded for the part that is shown, or marks of a figure of the report.
// Charts of a group show the same part of x, have one cursor, and one selection.
import uPlot from "./vendor/uPlot.esm.js";
import { el } from "./dom.js";

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const color = (k) => (k === null ? style("--quiet") : style(`--s${k % 6}`));
// A measurement lies below the models that follow it closely, and is wider.
export const faint = () => `color-mix(in srgb, ${style("--quiet")} 45%, ${style("--paper")})`;
const INKS = { BLUE: "--quiet", RED: "--s1", NAVY: "--s0", ORANGE: "--s3", GREEN: "--s2", PURPLE: "--s4", GREY: "--quiet", BLACK: "--ink" };
const SHADES = { gap: "--edge", outlier: "--s1", saturation: "--s3", standstill: "--s2", jitter: "--s5", unseen: "--s4", selection: "--accent" };
const DASHES = { dashed: [7, 4], dotted: [2, 3], "dash-dotted": [8, 3, 2, 3] };
const finite = (x) => x !== null && Number.isFinite(x);

function ticks(values, log) {
  return values.map((x) => {
    if (x === null || (log && Math.abs(Math.log10(x) % 1) > 1e-6)) return "";
    const size = Math.abs(x);
    return size && (size < 1e-3 || size >= 1e6) ? x.toExponential().replace(/(\.\d{3})\d+/, "$1") : `${Number(x.toPrecision(7))}`;
  });
}

export class Group {
  constructor(ends, known = null) {
    Object.assign(this, { ends, range: known?.range ?? ends, selection: known?.selection ?? null, mode: known?.mode ?? "pan", charts: new Set(), onSelect: null, known });
    this.sync = uPlot.sync(`group ${Math.random()}`);
  }

  zoom(first, last) {
    this.range = [first, last];
    if (this.known) this.known.range = this.range;
    for (const chart of this.charts) chart.show();
  }

  select(range) {
    this.selection = range;
    if (this.known) this.known.selection = range;
    for (const chart of this.charts) chart.plot?.redraw(false);
    if (range) this.onSelect?.(...range);
  }

  close() { for (const chart of this.charts) chart.close(); }
}

export class Chart {
  // x, y: {title, log, range}; curves: [{label, color, dash, width}] with load(first, last, width): a promise of {t, rows};
  // or marks with inks: the numbers of colours by ink. spans(): shaded parts of x.
  constructor(place, { x = {}, y = {}, curves = [], marks = [], inks = {}, load = null, group = null, height = 220, spans = () => [], label }) {
    const extent = marks.length ? extents(marks) : null;
    this.xr = x.range ?? (extent && padded(extent.x, x.log, 0));
    this.yr = y.range ?? (extent && padded(extent.y, y.log));
    Object.assign(this, { place, load, marks, inks, spans, group: group ?? new Group(this.xr), height, home: this.yr, busy: false });
    const axis = { stroke: style("--ink"), grid: { stroke: style("--edge"), width: 0.5 }, ticks: { stroke: style("--edge"), width: 0.5 }, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    this.plot = new uPlot({
      width: this.width, height, ms: 1,
      cursor: { sync: { key: this.group.sync.key }, drag: { x: false, y: false, setScale: false }, points: { show: curves.length > 0 } },
      legend: { show: curves.length > 0, live: true },
      scales: { x: { time: false, distr: x.log ? 3 : 1, range: () => this.group.range },
        y: { distr: y.log ? 3 : 1, range: (u, low, high) => this.yr ?? padded([low ?? 0, high ?? 1], y.log) } },
      axes: [{ ...axis, label: x.title ?? "Time [s]", labelSize: 18, size: 34, values: (u, v) => ticks(v, x.log) },
        { ...axis, label: y.title, labelSize: 18, size: 62, space: 26, values: (u, v) => ticks(v, y.log) }],
      series: [{ label: x.title ?? "Time [s]", value: (u, v) => (v === null ? "–" : Number(v.toPrecision(7))) },
        ...(curves.length ? curves : [{}]).map((curve) => ({ label: curve.label, stroke: curve.color, width: curve.width ?? 1.3, dash: DASHES[curve.dash], spanGaps: false,
          show: curves.length > 0, class: curve.quiet ? "off" : undefined, points: { show: false }, value: (u, v) => (v === null || v === undefined ? "–" : `${Number(v.toPrecision(5))}`) }))],
      hooks: { setScale: [(u, key) => key === "x" && place.setAttribute("aria-description", `from ${Number(u.scales.x.min?.toPrecision(6))} to ${Number(u.scales.x.max?.toPrecision(6))}`)],
        drawClear: [() => this.shade()], draw: [() => this.marks.length && this.draw()] },
    }, [extent ? this.xr : [], ...(curves.length ? curves : [0]).map(() => (extent ? [null, null] : []))], place);
    place.tabIndex = 0;
    place.setAttribute("role", "group");
    place.setAttribute("aria-label", label ?? y.title ?? "plot");
    if (marks.length) place.append(legend(marks.filter((mark) => !(mark.ink in inks)), (mark) => this.ink(mark)));  // models have one of their own
    place.addEventListener("keydown", (event) => this.key(event));
    this.pointer(this.plot.over);
    this.observer = new ResizeObserver(() => { if (Math.abs(this.plot.width - this.width) > 4) { this.plot.setSize({ width: this.width, height }); this.show(); } });
    this.observer.observe(place);
    this.group.charts.add(this);
    this.ready = this.show();
  }

  get width() { return Math.max(this.place.clientWidth - 2, 200); }

  // The known part is shown at once; the samples of the new one follow.
  async show() {
    if (!this.plot) return;
    this.plot.setScale("x", { min: this.group.range[0], max: this.group.range[1] });
    if (!this.load) return;
    if (this.busy) { this.again = true; return; }
    this.busy = true;
    const [first, last] = this.group.range, room = (last - first) / 4;
    try {
      const found = await this.load(first - room, last + room, Math.round(this.width * 1.5));
      if (this.plot) { this.plot.setData([found.t, ...found.rows], false); this.plot.setScale("x", { min: this.group.range[0], max: this.group.range[1] }); }
    } catch (problem) { this.failed?.(problem); }
    this.busy = false;
    if (this.again) { this.again = false; await this.show(); }
  }

  put(data) { if (this.plot) this.plot.setData(data, true); }

  all() { this.yr = this.home; this.group.zoom(...this.group.ends); }

  move(share, factor, about = 0.5) {
    const log = this.plot.scales.x.distr === 3, on = (v) => (log ? Math.log(v) : v), back = (v) => (log ? Math.exp(v) : v);
    const [a, b] = this.group.range.map(on), [first, last] = this.group.ends.map(on);
    const span = Math.min((b - a) * factor, last - first), begin = a + about * (b - a) + share * (b - a) - about * span;
    const start = Math.min(Math.max(begin, first), last - span);
    this.group.zoom(back(start), back(start + span));
  }

  moveY(share, factor, about = 0.5) {
    const { min, max } = this.plot.scales.y, at = min + about * (max - min), span = (max - min) * factor;
    this.yr = [at - about * span + share * span, at - about * span + span + share * span];
    this.plot.setScale("y", {});
    this.plot.redraw(true, true);
  }

  key(event) {
    const steps = { ArrowLeft: [-0.25, 1], ArrowRight: [0.25, 1], "+": [0, 0.5], "-": [0, 2] };
    if (event.key === "0") this.all();
    else if (event.key === "s") this.group.onMode?.();
    else if (event.key === "ArrowUp" || event.key === "ArrowDown") this.moveY(event.key === "ArrowUp" ? 0.15 : -0.15, 1);
    else if (steps[event.key]) this.move(...steps[event.key]);
    else return;
    event.preventDefault();
  }

  // The wheel zooms about the cursor (with Shift over y), a drag moves, and selects where that is chosen or Shift is held.
  pointer(over) {
    const share = (event) => { const box = over.getBoundingClientRect(); return [(event.clientX - box.left) / box.width, 1 - (event.clientY - box.top) / box.height]; };
    over.addEventListener("wheel", (event) => {
      event.preventDefault();
      const factor = Math.exp((event.deltaY || event.deltaX) / 400), [x, y] = share(event);
      if (event.shiftKey) this.moveY(0, factor, y); else this.move(0, factor, x);
    }, { passive: false });
    over.addEventListener("dblclick", () => this.all());
    let last = null, selecting = false, split = null;
    const value = (x) => this.plot.posToVal(x * over.clientWidth, "x");
    over.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      over.setPointerCapture(event.pointerId);
      last = share(event);
      const edge = this.group.split?.();
      split = finite(edge) && Math.abs(this.plot.valToPos(edge, "x") - last[0] * over.clientWidth) < 6 ? edge : null;
      selecting = split === null && this.group.onSelect && (this.group.mode === "select" || event.shiftKey) ? value(last[0]) : false;
    });
    over.addEventListener("pointermove", (event) => {
      if (!last) return;
      const now = share(event);
      if (split !== null) this.group.onSplit(value(now[0]), false);
      else if (selecting !== false) this.group.select([Math.min(selecting, value(now[0])), Math.max(selecting, value(now[0]))]);
      else { this.move(last[0] - now[0], 1); if (this.marks.length && this.yr) this.moveY(last[1] - now[1], 1); last = now; }
    });
    over.addEventListener("pointerup", (event) => { if (split !== null) this.group.onSplit(value(share(event)[0]), true); last = split = null; });
  }

  ink(mark) {
    const inks = this.inks;
    return mark.ink in inks ? color(inks[mark.ink]) : style(INKS[mark.ink] ?? "--ink");
  }

  clipped(work) {
    const { ctx, bbox } = this.plot;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    work(ctx, bbox);
    ctx.restore();
  }

  shade() {
    const chosen = this.group.selection ? [{ kind: "selection", first: this.group.selection[0], last: this.group.selection[1] }] : [];
    this.clipped((ctx, box) => {
      for (const span of [...this.spans(), ...chosen]) {
        const [left, right] = [span.first, span.last].map((v) => this.plot.valToPos(v, "x", true));
        if (right < box.left || left > box.left + box.width) continue;
        ctx.globalAlpha = span.strong || span.kind === "outlier" ? 0.6 : 0.2;
        ctx.fillStyle = style(SHADES[span.kind] ?? "--edge");
        ctx.fillRect(left, box.top, Math.max(right - left, 2), box.height);
        if (span.kind === "unseen") { ctx.globalAlpha = 1; ctx.fillRect(left - 1.5, box.top, 3, box.height); }
      }
    });
  }

  draw() {
    const { plot } = this, X = (v) => plot.valToPos(v, "x", true), Y = (v) => plot.valToPos(v, "y", true), ratio = devicePixelRatio;
    this.clipped((ctx, box) => {
      for (const mark of this.marks) {
        ctx.strokeStyle = ctx.fillStyle = this.ink(mark);
        ctx.lineWidth = (mark.width ?? 1.2) * 1.2 * ratio;
        ctx.setLineDash(mark.ink in this.inks ? [] : (DASHES[mark.dash] ?? []).map((x) => x * ratio));
        ctx.globalAlpha = 1;
        ctx.beginPath();
        if (mark.kind === "line") {
          let open = false;
          mark.x.forEach((x, k) => {
            if (!finite(x) || !finite(mark.y[k])) { open = false; return; }
            if (open && mark.stairs) ctx.lineTo(X(x), Y(mark.y[k - 1]));
            ctx[open ? "lineTo" : "moveTo"](X(x), Y(mark.y[k]));
            open = true;
          });
          ctx.stroke();
        } else if (mark.kind === "band") {
          const known = mark.x.map((_, k) => k).filter((k) => finite(mark.lower[k]) && finite(mark.upper[k]));
          known.forEach((k, n) => ctx[n ? "lineTo" : "moveTo"](X(mark.x[k]), Y(mark.upper[k])));
          known.reverse().forEach((k) => ctx.lineTo(X(mark.x[k]), Y(mark.lower[k])));
          ctx.globalAlpha = 0.18;
          ctx.fill();
        } else if (mark.kind === "points") {
          const size = (mark.x.length > 500 ? 1.5 : 4) * (mark.size ?? 1) * ratio;
          mark.x.forEach((x, k) => { if (finite(x) && finite(mark.y[k])) { ctx.moveTo(X(x) + size, Y(mark.y[k])); ctx.arc(X(x), Y(mark.y[k]), size, 0, 7); } });
          if (mark.size < 1) ctx.stroke(); else ctx.fill();
        } else if (mark.kind === "level") {
          ctx.moveTo(box.left, Y(mark.value));
          ctx.lineTo(box.left + box.width, Y(mark.value));
          ctx.stroke();
        } else if (mark.kind === "histogram") {
          if (mark.backdrop) continue;
          mark.heights.forEach((h, k) => { if (h > 0) { ctx.lineTo(X(mark.edges[k]), Y(h)); ctx.lineTo(X(mark.edges[k + 1]), Y(h)); } });
          ctx.stroke();
        } else if (mark.kind === "spans") {
          ctx.globalAlpha = 0.15;
          for (const [a, b] of mark.edges) ctx.fillRect(X(a), box.top, X(b) - X(a), box.height);
        }
      }
    });
  }

  close() {
    this.observer.disconnect();
    this.group.charts.delete(this);
    this.plot.destroy();
    this.plot = null;
  }
}

function extents(marks) {
  const x = [], y = [];
  const add = (list, values) => { for (const v of values) if (finite(v)) { list[0] = Math.min(list[0] ?? v, v); list[1] = Math.max(list[1] ?? v, v); } };
  for (const mark of marks) {
    add(x, mark.x ?? (mark.backdrop ? [] : mark.edges ?? []).flat());
    add(y, mark.y ?? (mark.kind === "level" ? [mark.value] : (mark.backdrop ? [] : mark.heights ?? [])));
    if (mark.kind === "band" && !y.length) { add(y, mark.lower); add(y, mark.upper); }
  }
  return { x: x.length ? x : [0, 1], y: y.length ? y : [0, 1] };
}

function padded([low, high], log, room = 0.06) {
  if (log) { const least = low > 0 ? low : high / 1e4 || 1e-3; return [least, Math.max(high, least * 10)]; }
  const pad = room * (high - low) || (room ? Math.abs(high) * 0.1 || 1 : 0);
  return low === high && !pad ? [low - 1, high + 1] : [low - pad, high + pad];
}

function legend(marks, ink) {
  const named = marks.filter((mark) => mark.label);
  return el("ul", { class: "legend" }, named.map((mark) => {
    const dot = el("span", { class: "swatch" });
    dot.style.background = ink(mark);
    return el("li", {}, dot, mark.label);
  }));
}

// The plots of figures of the report, as many beside each other as there is room for.
export function figures(place, plots, inks = {}, room = 0) {
  const grid = el("div", { class: "figures" });
  place.append(grid);
  const height = plots.length > 2 ? 250 : Math.max(250, Math.floor(room / Math.max(plots.length, 1)) - 70);
  const shared = new Map();
  const charts = plots.map((plot) => {
    const box = el("div", { class: "plot" });
    grid.append(el("section", { "aria-label": plot.title || plot.y.title }, plot.title ? el("h3", {}, plot.title) : null, box));
    const chart = new Chart(box, { x: plot.x, y: plot.y, marks: plot.marks, inks, height, group: shared.get(plot.x.title) });
    if (/^(Time|Frequency)/.test(plot.x.title) && !shared.has(plot.x.title)) shared.set(plot.x.title, chart.group);
    return chart;
  });
  return () => charts.forEach((chart) => chart.close());
}
