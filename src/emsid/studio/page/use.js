// Use: one model with sliders and an input that is chosen or drawn, exports, and what is made of it.
import { binary, get, question, save, unpack } from "./api.js";
import { attempt, button, details, drafts, el, field, labelled, number, select, table, withUnit } from "./dom.js";
import { Chart, Group, color, faint, figures } from "./plot.js";
import { adder, dataChoice, dataset, label } from "./compare.js";

const chosen = { file: null, part: null }, input = { kind: "own", amplitude: null, duration: null, input: 0, output: 0, points: [] };
const state = { model: null, about: null, values: {}, made: null, play: () => {} };
const KINDS = [["own", "the record's own"], ["step", "step"], ["sine", "sine"], ["ramp", "ramp"], ["drawn", "drawn by hand"]];
const MAKES = {
  control: ["Cascade of controllers", [["bandwidth", "Bandwidth [Hz]", "the fastest"], ["overshoot", "Overshoot", "0.05"], ["dt", "Sample time [s]", "of the record"], ["encoder", "Encoder counts per revolution"], ["delay", "Delay [s]", "one sample"], ["limit", "Largest command"], ["loop", "Outer loop", "position or speed"]]],
  compensate: ["Compensation of friction and dead zone", [["dt", "Sample time [s]", "of the record"], ["encoder", "Encoder counts per revolution"], ["limit", "Largest command"], ["amplitude", "Largest speed [rad/s]"]]],
  design: ["Next experiment", [["limit", "Largest command"], ["duration", "Duration [s]"], ["limit_speed", "Largest speed"], ["limit_travel", "Largest travel"], ["limit_slew", "Fastest change per s"]]],
};
const FRIENDLY = { c99: "C", fmu: "FMU", arduino: "Arduino", matlab: "MATLAB", modelica: "Modelica", mujoco: "MuJoCo", urdf: "URDF", control: "python-control" };

const current = (app) => app.state.models.find((model) => model.id === app.model) ?? app.state.models.findLast((model) => model.chosen) ?? app.state.models.at(-1);
const range = (app) => { const record = app.state.records.find((each) => each.file === dataset(app, chosen)?.file), channel = record?.channels[input.input];
  return { amplitude: channel ? Number(((channel.high - channel.low) / 2 || 1).toPrecision(2)) : 1, duration: record ? Number(Math.min(record.last - record.first, 1000 * record.dt).toPrecision(3)) : 2 }; };
const asked = (app) => ({ ...input, amplitude: input.amplitude ?? range(app).amplitude, duration: input.duration ?? range(app).duration });

async function load(app, model) {
  if (state.model === model.id) return;
  Object.assign(state, { model: model.id, about: null, values: {}, made: null });
  await attempt(async () => {
    const found = await get(`about?${new URLSearchParams({ model: model.id })}`);
    if (state.model === model.id) { state.about = found; app.draw(); }
  });
}

export function side(app) {
  const model = current(app);
  if (!model) return [el("p", {}, "There are no models yet: fit some in the part Models, or add a model file."), adder()];
  load(app, model);
  const about = state.about, names = app.state.models.map((each) => [each.id, label(each)]);
  const set = (name) => async (text) => { input[name] = text === "" ? null : Number(text); app.draw(); };
  const channels = (key, list, title) => (list?.length > 1 ? labelled(title, select(title, input[key], list.map(([name], k) => [k, name]), (value) => { input[key] = Number(value); app.draw(); })) : null);
  return [labelled("Model", select("Model", model.id, names, (value) => { app.model = value; app.draw(); })), dataChoice(app, chosen, () => app.draw()),
    el("h2", {}, "Simulate"), labelled("Input", select("Input", input.kind, KINDS, (value) => { input.kind = value; app.draw(); })),
    channels("input", about?.inputs, "Which input"), channels("output", about?.outputs, "Which output"),
    input.kind === "own" ? null : [field("amplitude", withUnit("Amplitude", about?.inputs[input.input]?.[1]), asked(app).amplitude, set("amplitude")), field("duration", "Duration [s]", asked(app).duration, set("duration"))],
    about ? parameters(app, about) : null,
    el("h2", {}, "Export"), about ? exports_(app, model, about) : null,
    el("h2", {}, "Make"), Object.entries(MAKES).map(([what, [title, fields]]) => make(app, model, what, title, fields))];
}

function parameters(app, about) {
  const row = (each) => {
    const now = state.values[each.name] ?? each.value;
    const bar = el("input", { type: "range", min: 0, max: 1000, value: 1000 * (now - each.low) / (each.high - each.low), "aria-label": each.name });
    const box = el("input", { size: 9, value: number(now), "aria-label": `${each.name} as a number` });
    const take = (x) => { state.values[each.name] = x; state.play(); };
    bar.addEventListener("input", () => { const x = each.low + (each.high - each.low) * bar.value / 1000; box.value = number(x); take(x); });
    box.addEventListener("change", () => { const x = Number(box.value); box.toggleAttribute("aria-invalid", !Number.isFinite(x)); if (Number.isFinite(x)) { bar.value = 1000 * (x - each.low) / (each.high - each.low); take(x); } });
    return el("div", { class: "slider" }, el("span", {}, withUnit(each.name, each.unit)), bar, box);
  };
  const known = about.sliders.filter((each) => each.known), rest = about.sliders.filter((each) => !each.known);
  return [details("Parameters", false, button("As estimated", () => { state.values = {}; app.draw(); state.play(); }), known.map(row), known.length && rest.length ? details("Parameters that were not estimated", false, rest.map(row)) : rest.map(row))];
}

function exports_(app, model, about) {
  const allow = el("input", { type: "checkbox" });
  const formats = select("Format", state.format ?? "c99", app.catalogue.formats.map((name) => [name, FRIENDLY[name] ?? name]), (value) => { state.format = value; });
  return [labelled("Format", formats), about.assumptions.map((text) => el("p", { class: "warning" }, text)),
    about.assumed.length ? el("label", { class: "check" }, allow, `write ${about.assumed.join(", ")} all the same`) : null,
    el("div", { class: "row" }, button("Export", () => save("export", { model: model.id, format: formats.value, assume: allow.checked ? about.assumed : [] }, `${model.name}-${formats.value}.zip`), { class: "main" }),
      button("Model file", () => save(`model?${new URLSearchParams({ model: model.id })}`, null, `${model.name}.json`)))];
}

function make(app, model, what, title, fields) {
  const key = (name) => `${what} ${name}`;
  const work = async () => {
    const options = Object.fromEntries(fields.map(([name]) => [name, drafts.get(key(name))]).filter(([, value]) => value));
    state.made = { title, model: label(model), ...await question("use", { model: model.id, what, options }) };
    app.draw();
  };
  return details(title, fields.some(([name]) => drafts.has(key(name))), fields.map(([name, text, placeholder]) => field(key(name), text, "", null, { placeholder: placeholder ?? "" })), button("Make", work, { class: "main", "aria-label": `Make: ${title}` }));
}

export function stage(app) {
  const model = current(app), key = JSON.stringify([model?.id, dataset(app, chosen), asked(app), state.made?.number, state.about?.label]);
  return [key, (place) => build(place, app, model)];
}

async function build(place, app, model) {
  const data = dataset(app, chosen);
  if (!model || !data) { place.append(el("p", {}, "A model and a record are needed: the record gives the sample time and its input.")); return null; }
  const time = el("span", { class: "quiet" }), canvas = el("canvas", { class: "draw", width: 1000, height: 140, hidden: input.kind !== "drawn", "aria-label": "Draw the input here", role: "img" });
  const upper = el("div", { class: "plot" }), lower = el("div", { class: "plot" });
  place.append(el("h2", {}, `${label(model)}: free run`, " ", time), canvas, upper, lower);
  const [inputs, outputs] = [state.about?.inputs, state.about?.outputs], room = Math.max(320, place.clientHeight - (input.kind === "drawn" ? 310 : 150));
  const group = new Group([0, 1]);
  const name = (list, k, otherwise) => (list?.[k] ? withUnit(...list[k]) : otherwise);
  const output = new Chart(upper, { y: { title: name(outputs, input.output, "output") }, group, height: Math.floor(room * 0.62), label: "Output over time",
    curves: [{ label: "measured", color: faint(), width: 4 }, { label: "simulated", color: color(model.number) }] });
  const given = new Chart(lower, { y: { title: name(inputs, input.input, "input") }, group, height: Math.floor(room * 0.38), label: "Input over time", curves: [{ label: "input", color: color(0) }] });
  let busy = false, again = false;
  state.play = async () => {
    if (busy) { again = true; return; }
    busy = true;
    await attempt(async () => {
      const begun = performance.now();
      const { ends, t, rows: [u, y, measured] } = unpack(await binary("play", { model: model.id, data, values: state.values, input: asked(app), width: Math.max(upper.clientWidth, 200) }), null, true);
      if (!output.plot) return;
      if (`${group.ends}` !== `${ends}`) { group.ends = ends; group.range = ends; }
      output.put([t, measured, y]);
      given.put([t, u]);
      time.textContent = `answered in ${Math.round(performance.now() - begun)} ms`;
    });
    busy = false;
    if (again) { again = false; state.play(); }
  };
  draw(canvas, app);
  if (input.kind !== "drawn" || input.points.length > 1) await state.play();
  let close = () => {};
  if (state.made) {
    const made = state.made, box = el("section", { class: "card", "aria-label": made.title });
    place.append(box);
    box.append(el("h3", {}, `${made.title} for ${made.model}`), ...made.lines.map((text) => el("p", {}, text)), ...made.tables.map((each) => table(each)), el("p", { class: "quiet" }, made.files.join(", ")),
      button("Save the files", () => save(`use/${made.number}`, null, `${model.name}-${made.number}.zip`), { class: "main" }));
    close = figures(box, made.plots);
  }
  return () => { state.play = () => {}; group.close(); close(); };
}

function draw(canvas, app) {
  const context = canvas.getContext("2d"), last = { at: null };
  const line = (from, to) => {
    context.strokeStyle = getComputedStyle(canvas).color;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(from[0] * 1000, from[1] * 140);
    context.lineTo(to[0] * 1000, to[1] * 140);
    context.stroke();
  };
  const scale = () => { const { amplitude, duration } = asked(app); return [duration, amplitude]; };
  const back = ([t, u]) => { const [duration, amplitude] = scale(); return [t / duration, (1 - u / amplitude) / 2]; };
  input.points.slice(1).forEach((point, k) => line(back(input.points[k]), back(point)));
  const at = (event) => { const box = canvas.getBoundingClientRect(); return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height]; };
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); context.clearRect(0, 0, 1000, 140); input.points = []; last.at = at(event); });
  canvas.addEventListener("pointermove", (event) => {
    if (!last.at) return;
    const [x, y] = at(event), [duration, amplitude] = scale();
    line(last.at, [x, y]);
    input.points.push([x * duration, (1 - 2 * y) * amplitude]);
    last.at = [x, y];
  });
  canvas.addEventListener("pointerup", () => { last.at = null; if (input.points.length > 1) state.play(); });
}
