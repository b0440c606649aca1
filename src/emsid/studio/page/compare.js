// Compare: any models on any data. Models and data are chosen on the left, the views of all of them are overlaid on the right.
import { binary, get, question, save, unpack, upload } from "./api.js";
import { attempt, button, el, field, labelled, number, select, table, tabs, withUnit } from "./dom.js";
import { Chart, Group, color, faint, figures } from "./plot.js";
import { copy } from "./main.js";

const VIEWS = { runs: "Free run", residual: "Residuals", correlation: "Correlation", step: "Step", impulse: "Impulse", bode: "Bode", poles: "Poles", curves: "Friction and maps", parameters: "Parameters" };
const ABOUT = { step: true, impulse: true, bode: true, poles: true };
const settings = { view: "runs", file: null, part: null, input: 0, output: 0, size: null, at: 0 };
const ranked = { key: null, found: null };

export const label = (model) => (model.run ? `${model.name} (run ${model.run})` : model.name);

// The data on which models are run: those that are unseen, if nothing else was chosen.
export function dataset(app, chosen = settings) {
  const records = app.state.records.filter((record) => record.samples), { step } = app.state;
  const file = records.find((record) => record.file === chosen.file) ?? records.find((record) => record.kind === "unseen_files") ?? records[0];
  if (!file) return null;
  const divided = file.kind === "files" && !step.unseen_files.length;
  return { file: file.file, part: chosen.part && chosen.file === file.file ? chosen.part : divided ? "unseen" : "all" };
}

export function dataChoice(app, chosen, change) {
  const parts = { all: "", unseen: ", unseen part", fitted: ", fitted part" };
  const options = app.state.records.filter((record) => record.samples).flatMap((record) =>
    (record.kind === "files" && !app.state.step.unseen_files.length ? ["unseen", "fitted", "all"] : ["all"]).map((part) => [JSON.stringify([record.file, part]), `${record.file}${parts[part]}`]));
  const now = dataset(app, chosen);
  return labelled("Data", select("Data", now && JSON.stringify([now.file, now.part]), options, (value) => { [chosen.file, chosen.part] = JSON.parse(value); change(); }));
}

const picked = (app) => {
  const all = app.state.models.map((model) => model.id);
  app.compared = (app.compared ?? app.state.models.filter((model) => model.run === (app.state.models.findLast((each) => each.run) ?? model).run).slice(0, 3).map((model) => model.id)).filter((id) => all.includes(id));
  return app.compared;
};

export function adder() {
  return labelled("Add a model file", el("input", { type: "file", accept: ".json", multiple: true, "aria-label": "Add a model file",
    onchange: (event) => attempt(async () => { for (const file of event.target.files) await upload(file, "models"); }) }));
}

async function rank(app) {
  const data = dataset(app), models = picked(app), key = JSON.stringify([models, data, app.state.version]);
  if (ranked.key === key) return;
  Object.assign(ranked, { key, found: null });
  if (!models.length || !data) return;
  await attempt(async () => {
    const found = await question("ranking", { models, data });
    if (ranked.key !== key) return;
    ranked.found = found;
    if (app.part === "compare") app.draw();
  });
}

export function side(app) {
  if (!app.state.models.length) return [el("p", {}, "There are no models yet: fit some in the part Models, or add a model file."), adder()];
  rank(app);
  const chosen = picked(app), order = ranked.found?.rows.map((row) => row.id) ?? [];
  const place = (model) => (order.includes(model.id) ? order.indexOf(model.id) : chosen.includes(model.id) ? 500 : 1000 + app.state.models.indexOf(model));
  const rows = [...app.state.models].sort((a, b) => place(a) - place(b)).map((model) => {
    const dot = el("span", { class: "swatch" }), row = ranked.found?.rows.find((each) => each.id === model.id), problem = ranked.found?.problems[model.id];
    dot.style.background = color(model.number);
    const stale = app.state.runs.find((run) => run.number === model.run)?.stale ?? [];
    const level = model.verdict?.level, doubtful = ["implausible", "unusable"].includes(level);
    return el("li", { title: model.verdict?.text ?? "" }, el("label", { class: "check" }, el("input", { type: "checkbox", value: model.id, checked: chosen.includes(model.id), disabled: chosen.length >= 5 && !chosen.includes(model.id),
      onchange: (event) => { app.compared = event.target.checked ? [...picked(app), model.id] : picked(app).filter((id) => id !== model.id); app.draw(); } }), dot, el("span", {}, label(model))),
    el("span", { class: "number" }, row ? (row.fit === null ? "diverges" : `${row.fit.toFixed(1)} %`) : ""),
    doubtful ? el("span", { class: "warning" }, level) : null, stale.length ? el("span", { class: "quiet" }, `fitted to other data; different: ${stale.join(", ")}`) : null, problem ? el("span", { class: "problem" }, problem) : null);
  });
  const found = ranked.found, set = (name) => (value) => { settings[name] = value; app.draw(); };
  const channels = (name, list) => (list?.length > 1 ? labelled(name, select(name, settings[name.toLowerCase()], list.map(([each], k) => [k, each]), (value) => set(name.toLowerCase())(Number(value)))) : null);
  return [dataChoice(app, settings, () => app.draw()),
    el("h2", {}, "Models, the best first"), el("ul", { class: "chosen", "aria-label": "Models to compare" }, rows), adder(),
    channels("Input", found?.inputs), channels("Output", found?.outputs),
    ABOUT[settings.view] ? [settings.view === "step" || settings.view === "impulse" ? field("step size", "Size of the step", number(settings.size ?? found?.size ?? 1), async (text) => set("size")(Number(text))) : null,
      field("step at", "Linearised about the input", settings.at, async (text) => set("at")(Number(text)))] : null,
    el("div", { class: "row" }, button("Print", () => print()), button("Copy as Python", async () => copy((await question("program", { models: chosen, data: dataset(app) })).script), { "aria-label": "Copy the comparison as Python" }))];
}

export function stage(app) {
  const models = picked(app), data = dataset(app);
  const key = JSON.stringify([models, data, settings, ranked.found?.size, app.state.version]);
  return [key, (place, current) => build(place, app, models, data, current)];
}

async function build(place, app, models, data, current) {
  if (!models.length) { place.append(el("p", {}, app.state.models.length ? "Choose models on the left." : "There is no model yet.")); return null; }
  const view = settings.view, panel = el("div", { role: "tabpanel", id: "shown", tabIndex: -1, "aria-labelledby": `view-${view}` });
  const choose = (name) => { settings.view = name; app.draw(); };
  place.append(el("div", { role: "tablist", "aria-label": "Views", class: "row views" }, tabs("Views", VIEWS, view, choose)), panel);
  const numbers = models.map((id) => app.state.models.find((model) => model.id === id));
  if (view === "parameters") return parameters(panel, app, numbers, current);
  if (!data && (view === "runs" || view === "residual" || view === "correlation")) { panel.append(el("p", {}, "There are no data to run them on.")); return null; }
  if (view === "runs" || view === "residual") return runs(panel, models, numbers, data, place, current, view);
  const size = settings.size ?? ranked.found?.size ?? 1;
  const found = await question("view", { view, models, data, input: settings.input, output: settings.output, size, at: settings.at });
  if (!current()) return null;
  problems(panel, found.problems, numbers);
  if (!found.plots.length) { panel.append(el("p", {}, "None of these models has this view.")); return null; }
  const caption = [...new Set(found.plots.map((plot) => plot.caption).filter(Boolean))];
  legend(panel, numbers);
  const close = figures(panel, found.plots, Object.fromEntries(Object.entries(found.inks).map(([ink, k]) => [ink, numbers[k].number])), place.clientHeight - 90);
  panel.append(...caption.map((text) => el("p", { class: "quiet" }, text)));
  return close;
}

function problems(place, found, models) {
  for (const [id, text] of Object.entries(found)) place.append(el("p", { class: "warning" }, `${label(models.find((each) => each.id === id) ?? { name: id })}: ${text}`));
}

function legend(place, models) {
  place.append(el("ul", { class: "legend" }, models.map((model) => {
    const dot = el("span", { class: "swatch" });
    dot.style.background = color(model.number);
    return el("li", {}, dot, label(model));
  })));
}

async function runs(place, models, numbers, data, pane, current, view) {
  const found = await question("ranking", { models, data });
  if (!current()) return null;
  problems(place, found.problems, numbers);
  const group = new Group([found.first, found.last]), room = Math.max(260, pane.clientHeight - 120), each = room / found.outputs.length;
  for (const [output, [name, unit]] of found.outputs.entries()) {
    const load = (part) => async (a, b, width) => {
      const window = unpack(await binary("runs", { models, data, output, from: a, to: b, width }), a);
      return { t: window.t, rows: part === "left" ? window.rows.slice(models.length + 1) : window.rows.slice(0, models.length + 1) };
    };
    const curves = numbers.map((model) => ({ label: label(model), color: color(model.number) }));
    const add = (title, part, height, more) => {
      const box = el("div", { class: "plot" });
      place.append(box);
      return new Chart(box, { y: { title: withUnit(title, unit) }, curves: [...more, ...curves], load: load(part), group, height: Math.max(Math.floor(height) - 50, 170), label: `${title} over time` });
    };
    if (view === "runs") add(name, "runs", each * 0.6, [{ label: "measured", color: faint(), width: 4 }]);
    add(`residual of ${name}`, "left", each * (view === "runs" ? 0.4 : 1), []);
  }
  const rows = found.rows.map((row) => [label(numbers.find((model) => model.id === row.id)), row.fit === null ? "diverges" : `${row.fit.toFixed(2)} %`, number(row.rmse), `${row.parameters}`, row.data]);
  place.append(table({ header: ["Model", "Fit of the free run", "RMSE", "Parameters", "Data"], rows, caption: `Free run on ${data.file}` }));
  return () => group.close();
}

// Intervals as bars, one row for every parameter and model, on an axis of its own.
async function parameters(place, app, models, current) {
  const found = await Promise.all(models.map((model) => get(`about?${new URLSearchParams({ model: model.id })}`)));
  if (!current()) return null;
  const names = [...new Set(found.flatMap((each) => each.parameters.map((row) => row.name)))];
  legend(place, models);
  const rows = names.flatMap((name) => {
    const own = found.map((each) => each.parameters.find((row) => row.name === name));
    const ends = own.filter(Boolean).flatMap((row) => [row.value, row.low, row.high]).filter((x) => x !== null && Number.isFinite(x));
    const low = Math.min(...ends), span = Math.max(...ends) - low || Math.abs(low) || 1;
    const at = (x) => Math.min(Math.max(5 + 90 * ((x - low) / span), 0), 100);
    return own.map((row, k) => {
      if (!row) return null;
      const bar = el("span", { class: "interval" }), whole = el("span", { class: "reach" }), dot = el("span", { class: "estimate" });
      whole.style.left = `${at(row.low ?? row.value)}%`;
      whole.style.width = `${at(row.high ?? row.value) - at(row.low ?? row.value)}%`;
      dot.style.left = `${at(row.value)}%`;
      whole.style.background = dot.style.background = color(models[k].number);
      if (!row.plain) whole.classList.add("conditional");
      bar.append(whole, dot);
      return [el("span", { title: row.about }, withUnit(name, row.unit)), label(models[k]), bar, number(row.value, 5), row.low === null ? "–" : `${number(row.low)} … ${number(row.high)}`, el("span", { class: row.plain ? "" : "warning" }, row.status)];
    }).filter(Boolean);
  });
  place.append(rows.length ? table({ header: ["Parameter", "Model", "95 % interval", "Estimate", "Ends", "Status"], rows, texts: 3, caption: "Parameters with 95 % intervals; pale bars hold only if assumed values are right" }) : el("p", {}, "These models have no table of parameters."),
    ...found.map((each, k) => (each.equation ? [el("h3", {}, label(models[k])), el("pre", { tabIndex: 0 }, each.equation)] : [])).flat(),
    el("div", { class: "row" }, models.map((model) => button(`Save ${label(model)}`, () => save(`model?${new URLSearchParams({ model: model.id })}`, null, `${model.name}.json`)))));
  return null;
}
