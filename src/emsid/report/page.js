"use strict";
// Zooming: drag over what is to be enlarged, double-click for the whole; plots of a linked figure keep one x axis.
// With a finger, two of them enlarge x; one scrolls the page. With the keyboard, + and − enlarge and reduce x about its
// middle, arrows move it, and Escape shows the whole. The plots themselves are drawn by the page, not here.
const WIDTH = 20000, HEIGHT = 10000;

function scale(text) {
  const [low, high, log] = text.split(" ");
  return {low: +low, high: +high, log: log === "log"};
}

function label(value) {
  const digits = Number(value.toPrecision(8));
  const text = digits !== 0 && (Math.abs(digits) >= 1e8 || Math.abs(digits) < 1e-4) ? digits.toExponential() : String(digits);
  return text.replace("e+", "e").replaceAll("-", "\u2212");
}

function ticks(low, high, log, most) {
  if (log && high - low >= 1.7) {
    const every = Math.max(1, Math.ceil((high - low) / most)), found = [];
    for (let n = Math.ceil(low / every) * every; n <= high; n += every) found.push([n, label(Number("1e" + n))]);
    return found;
  }
  if (log) {
    const found = [];
    for (const v of evenly(10 ** low, 10 ** high, most)) if (v > 0) found.push([Math.log10(v), label(v)]);
    return found;
  }
  return evenly(low, high, most).map(v => [v, label(v)]);
}

function evenly(low, high, most) {
  const power = 10 ** Math.floor(Math.log10((high - low) / most));
  for (const factor of [1, 2, 5, 10, 20, 50]) {
    const step = factor * power, first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
    if (last - first + 1 <= most) {
      const digits = Math.min(20, Math.max(0, 1 - Math.floor(Math.log10(step))));
      return Array.from({length: last - first + 1}, (_, k) => Number(((first + k) * step).toFixed(digits)));
    }
  }
  return [];
}

function prepare(area) {
  const svg = area.querySelector("svg");
  const plot = {area, svg, x: scale(area.dataset.x), y: scale(area.dataset.y), group: area.closest("[data-linked]")};
  plot.view = whole();
  area.classList.add("zoomable");
  area.tabIndex = 0;
  area.setAttribute("role", "group");
  area.setAttribute("aria-label", svg.getAttribute("aria-label"));
  plot.readout = document.createElement("div");
  plot.readout.className = "readout";
  area.append(plot.readout);
  return plot;
}

function whole() { return {x0: 0, x1: 1, y0: 0, y1: 1}; }

function show(plot, view) {
  plot.view = view;
  const {x0, x1, y0, y1} = view;
  plot.svg.setAttribute("viewBox", `${WIDTH * x0} ${HEIGHT * (1 - y1)} ${WIDTH * (x1 - x0)} ${HEIGHT * (y1 - y0)}`);
  for (const old of plot.area.querySelectorAll("i, b.grid")) old.remove();
  for (const note of plot.area.querySelectorAll("em")) {
    const [left, bottom] = note.dataset.at.split(" ").map(v => v / 100);
    note.hidden = left < x0 || left > x1 || bottom < y0 || bottom > y1;
    note.style.left = 100 * (left - x0) / (x1 - x0) + "%";
    note.style.bottom = 100 * (bottom - y0) / (y1 - y0) + "%";
  }
  const part = (axis, a, b) => [axis.low + a * (axis.high - axis.low), axis.low + b * (axis.high - axis.low)];
  const [left, right] = part(plot.x, x0, x1), [low, high] = part(plot.y, y0, y1);
  const add = (kind, name, side, place, text) => {
    const tick = document.createElement(kind);
    tick.className = name;
    tick.style[side] = 100 * place + "%";
    tick.textContent = text;
    plot.area.insertBefore(tick, plot.svg);
  };
  for (const [v, text] of ticks(low, high, plot.y.log, 6)) {
    add("b", "grid", "bottom", (v - low) / (high - low), "");
    add("i", "y", "bottom", (v - low) / (high - low), text);
  }
  const most = Math.max(2, Math.min(9, Math.floor(plot.area.clientWidth / 70)));
  for (const [v, text] of ticks(left, right, plot.x.log, most)) add("i", "x", "left", (v - left) / (right - left), text);
}

function showLinked(plot, view) {
  show(plot, view);
  if (plot.group)
    for (const other of plots)
      if (other !== plot && other.group === plot.group) show(other, {...other.view, x0: view.x0, x1: view.x1});
}

const NARROWEST = 0.001;

function afterKey(view, key) {
  const width = view.x1 - view.x0, middle = (view.x0 + view.x1) / 2;
  const along = (from, size) => {
    const x0 = Math.min(1 - size, Math.max(0, from));
    return {...view, x0, x1: x0 + size};
  };
  const about = size => along(middle - size / 2, size);
  switch (key) {
    case "+": case "=": return about(Math.max(NARROWEST, width / 2));
    case "-": case "_": return about(Math.min(1, 2 * width));
    case "ArrowLeft": return along(view.x0 - width / 4, width);
    case "ArrowRight": return along(view.x0 + width / 4, width);
    case "Escape": case "0": return whole();
  }
  return null;
}

function at(plot, event) {
  const box = plot.area.getBoundingClientRect();
  const clip = v => Math.min(1, Math.max(0, v));
  return {x: clip((event.clientX - box.left) / box.width), y: clip(1 - (event.clientY - box.top) / box.height)};
}

function read(plot, place) {
  const value = (axis, a, b, share) => {
    const v = axis.low + (a + share * (b - a)) * (axis.high - axis.low);
    return label(Number((axis.log ? 10 ** v : v).toPrecision(4)));
  };
  const {x0, x1, y0, y1} = plot.view;
  plot.readout.textContent = `${value(plot.x, x0, x1, place.x)}, ${value(plot.y, y0, y1, place.y)}`;
}

function listen(plot) {
  let start = null, frame = null;
  const box = end => {
    const sideways = Math.abs(end.y - start.y) * plot.area.clientHeight < 16;
    return {x0: Math.min(start.x, end.x), x1: Math.max(start.x, end.x),
            y0: sideways ? 0 : Math.min(start.y, end.y), y1: sideways ? 1 : Math.max(start.y, end.y)};
  };
  plot.area.addEventListener("pointerdown", event => {
    if (event.pointerType === "touch" || event.button) return;
    start = at(plot, event);
    plot.area.setPointerCapture(event.pointerId);
    frame = document.createElement("div");
    frame.className = "frame";
    plot.area.append(frame);
    event.preventDefault();
  });
  plot.area.addEventListener("pointermove", event => {
    const place = at(plot, event);
    read(plot, place);
    if (!start) return;
    const {x0, x1, y0, y1} = box(place);
    Object.assign(frame.style, {left: 100 * x0 + "%", width: 100 * (x1 - x0) + "%", bottom: 100 * y0 + "%", height: 100 * (y1 - y0) + "%"});
  });
  plot.area.addEventListener("pointerleave", () => { if (!start) plot.readout.textContent = ""; });
  plot.area.addEventListener("pointerup", event => {
    if (!start) return;
    const {x0, x1, y0, y1} = box(at(plot, event)), old = plot.view;
    start = null;
    frame.remove();
    if ((x1 - x0) * plot.area.clientWidth < 6) return;
    const within = (a, b, share) => a + share * (b - a);
    showLinked(plot, {x0: within(old.x0, old.x1, x0), x1: within(old.x0, old.x1, x1),
                      y0: within(old.y0, old.y1, y0), y1: within(old.y0, old.y1, y1)});
  });
  plot.area.addEventListener("pointercancel", () => { start = null; frame?.remove(); });
  plot.area.addEventListener("dblclick", () => showLinked(plot, whole()));
  plot.area.addEventListener("keydown", event => {
    const view = event.ctrlKey || event.metaKey || event.altKey ? null : afterKey(plot.view, event.key);
    if (!view) return;
    event.preventDefault();
    showLinked(plot, view);
  });
  let fingers = null;
  plot.area.addEventListener("touchstart", event => {
    if (event.touches.length === 2) fingers = {places: [...event.touches].map(t => at(plot, t).x).sort((a, b) => a - b), view: plot.view};
  }, {passive: true});
  plot.area.addEventListener("touchmove", event => {
    if (!fingers || event.touches.length !== 2) return;
    event.preventDefault();
    const now = [...event.touches].map(t => at(plot, t).x).sort((a, b) => a - b), {places, view} = fingers;
    const spread = Math.max(now[1] - now[0], 0.02) / Math.max(places[1] - places[0], 0.02);
    const width = Math.min(1, (view.x1 - view.x0) / spread);
    const held = view.x0 + (places[0] + places[1]) / 2 * (view.x1 - view.x0);
    const x0 = Math.min(1 - width, Math.max(0, held - width * (now[0] + now[1]) / 2));
    showLinked(plot, {...view, x0, x1: x0 + width});
  }, {passive: false});
  plot.area.addEventListener("touchend", event => { if (event.touches.length < 2) fingers = null; });
}

document.documentElement.classList.remove("no-script");
const plots = [...document.querySelectorAll(".area")].map(prepare);
plots.forEach(listen);

// A table or a text that scrolls can be reached and scrolled with the keyboard in every browser, and shows where it goes on.
function more(box) {
  box.classList.toggle("more", box.scrollLeft + box.clientWidth < box.scrollWidth - 2);
  box.classList.toggle("below", box.scrollTop + box.clientHeight < box.scrollHeight - 2);
}

function reach() {
  for (const box of document.querySelectorAll(".scroll, pre")) {
    if (box.matches(".scroll")) more(box);
    if (box.scrollWidth > box.clientWidth || box.scrollHeight > box.clientHeight) box.tabIndex = 0;
    else box.removeAttribute("tabindex");
  }
}
reach();
addEventListener("resize", reach);
document.querySelectorAll(".scroll").forEach(box => box.addEventListener("scroll", () => more(box), {passive: true}));

// A click on the head of a column, or Enter, sorts the rows of a table by it, and once more the other way round.
function prepareTable(table) {
  const heads = [...table.querySelectorAll("thead th")], body = table.tBodies[0];
  if (body.rows.length < 3) return;
  heads.forEach((head, column) => {
    head.tabIndex = 0;
    head.classList.add("sortable");
    const sort = () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      heads.forEach(each => each.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      const rows = [...body.rows].map(row => [cellValue(row.cells[column].textContent), row]);
      rows.sort(([a], [b]) => compareCells(a, b, up ? 1 : -1)).forEach(([, row]) => body.append(row));
    };
    head.addEventListener("click", sort);
    head.addEventListener("keydown", event => { if (event.key === "Enter") sort(); });
  });
}

function cellValue(text) {
  const number = Number.parseFloat(text.replaceAll("\u2212", "-").replace(/^[±×>\s]+/, "").replaceAll(",", ""));
  return Number.isNaN(number) ? text.trim() : number;
}

// Numbers come before texts, and empty cells and dashes last, either way round.
function compareCells(a, b, sign) {
  const rank = value => typeof value === "number" ? 0 : value === "" || value === "\u2013" ? 2 : 1;
  if (rank(a) !== rank(b)) return rank(a) - rank(b);
  return sign * (typeof a === "number" ? a - b : a.localeCompare(b));
}

document.querySelectorAll("table").forEach(prepareTable);
