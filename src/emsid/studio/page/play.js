// Play: a slider for every parameter, an input that is chosen or drawn, and the answer of the model at once.
import { binary, get, unpack } from "./api.js";
import { chooser } from "./compare.js";
import { attempt, el, number } from "./dom.js";
import { arrays } from "./plot.js";

export async function showPlay(main, app) {
  const choose = chooser(app, () => app.go("play"));
  if (!choose) { main.append(el("p", {}, "There is no result yet: fit models in the part Models.")); return; }
  const run = app.run, found = await get(`runs/${run}/shown`);
  if (!found.models.includes(app.model)) app.model = found.chosen;
  const model = app.model, rows = await get(`runs/${run}/sliders/${encodeURIComponent(model)}`);
  if (app.part !== "play") return;
  const values = {}, input = { kind: "own", amplitude: 1, duration: 2, points: [] };
  const pick = el("select", { "aria-label": "Model", onchange: (event) => { app.model = event.target.value; app.go("play"); } },
    found.models.map((name) => el("option", { value: name, selected: name === model }, name)));
  const time = el("span", { class: "quiet" });
  const upper = el("div", { class: "plot" }), lower = el("div", { class: "plot" });
  const canvas = el("canvas", { class: "draw", width: 1000, height: 140, hidden: true, "aria-label": "Draw the input here" });
  const kind = el("select", { "aria-label": "Input", onchange: (event) => { input.kind = event.target.value; canvas.hidden = input.kind !== "drawn"; play(); } },
    [["own", "the record's own"], ["step", "step"], ["sine", "sine"], ["ramp", "ramp"], ["drawn", "drawn"]].map(([value, text]) => el("option", { value }, text)));
  const field = (name, label) => el("label", {}, `${label} `, el("input", { size: 6, value: input[name], "aria-label": label,
    onchange: (event) => { input[name] = Number(event.target.value); play(); } }));
  main.append(el("div", { class: "row" }, choose, el("label", {}, "Model ", pick), el("label", {}, "Input ", kind),
    field("amplitude", "Amplitude"), field("duration", "Duration [s]"), time), canvas, upper, lower);
  const output = arrays(upper, ["measured", "simulated"], found.units[0], 260), given = arrays(lower, ["input"], "", 140);
  app.close = () => { output.destroy(); given.destroy(); };
  let busy = false, again = false;
  async function play() {
    if (busy) { again = true; return; }
    busy = true;
    await attempt(async () => {
      const begun = performance.now();
      const { t, rows: [u, y, measured] } = unpack(await binary("play", { run, model, values, input, width: Math.max(upper.clientWidth, 200) }), null, true);
      output.setData([t, measured, y]);
      given.setData([t, u]);
      time.textContent = `answered in ${Math.round(performance.now() - begun)} ms`;
    });
    busy = false;
    if (again) { again = false; play(); }
  }
  draw(canvas, input, play);
  const sliders = rows.map((row) => slider(row, values, play));
  main.append(el("h2", {}, "Parameters"), el("button", { onclick: () => { sliders.forEach((each) => each.reset()); play(); } }, "As estimated"),
    ...sliders.filter((each) => each.known).map((each) => each.element),
    sliders.every((each) => each.known) ? "" : el("details", {}, el("summary", {}, "Parameters that were not estimated"),
      sliders.filter((each) => !each.known).map((each) => each.element)));
  play();
}

function slider(row, values, play) {
  const range = el("input", { type: "range", min: 0, max: 1000, "aria-label": row.name });
  const box = el("input", { size: 9, "aria-label": `${row.name} as a number` });
  const set = (x) => { range.value = 1000 * (x - row.low) / (row.high - row.low); box.value = number(x); };
  const take = (x) => { values[row.name] = x; play(); };
  range.addEventListener("input", () => { const x = row.low + (row.high - row.low) * range.value / 1000; box.value = number(x); take(x); });
  box.addEventListener("change", () => { const x = Number(box.value); set(x); take(x); });
  set(row.value);
  return { element: el("div", { class: "slider" }, el("span", {}, row.unit ? `${row.name} [${row.unit}]` : row.name), range, box),
    known: row.known, reset: () => { delete values[row.name]; set(row.value); } };
}

function draw(canvas, input, play) {
  const context = canvas.getContext("2d");
  let last = null;
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); context.clearRect(0, 0, 1000, 140); input.points = []; last = at(event); });
  canvas.addEventListener("pointermove", (event) => {
    if (!last) return;
    const [x, y] = at(event);
    context.strokeStyle = getComputedStyle(canvas).color;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(last[0] * 1000, last[1] * 140);
    context.lineTo(x * 1000, y * 140);
    context.stroke();
    input.points.push([x * input.duration, (1 - 2 * y) * input.amplitude]);
    last = [x, y];
  });
  canvas.addEventListener("pointerup", () => { last = null; if (input.points.length > 1) play(); });
}
