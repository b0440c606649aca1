// Compare: measured and simulated outputs with linked zoom, and what the report says of each model side by side.
import { binary, get, unpack } from "./api.js";
import { el, table } from "./dom.js";
import { otherData } from "./models.js";
import { Group, TimePlot } from "./plot.js";

export function chooser(app, onChange) {
  const done = app.state.runs.filter((run) => run.state === "done");
  if (!done.length) return null;
  if (!done.some((run) => run.number === app.run)) app.run = (done.find((run) => !run.stale.length) ?? done[0]).number;
  return [el("label", {}, "Run ", el("select", { "aria-label": "Run", onchange: (event) => { app.run = event.target.value; onChange(); } },
    done.map((run) => el("option", { value: run.number, selected: run.number === app.run }, `${run.number}: ${run.task.files.join(", ")}${run.stale.length ? " (other data)" : ""}`)))),
    otherData(done.find((run) => run.number === app.run))];
}

export async function showCompare(main, app) {
  const choose = chooser(app, () => app.go("compare"));
  if (!choose) { main.append(el("p", {}, "There is no result yet: fit models in the part Models.")); return; }
  main.append(el("div", { class: "row" }, choose));
  const run = app.run, found = await get(`runs/${run}/shown`);
  if (app.part !== "compare" || run !== app.run) return;
  const picked = app.picked?.run === run ? app.picked : (app.picked = { run, names: found.models.slice(0, 2), part: "unseen" });
  const boxes = found.models.map((name) => el("label", {}, el("input", { type: "checkbox", checked: picked.names.includes(name),
    onchange: (event) => {
      picked.names = event.target.checked ? [...picked.names, name] : picked.names.filter((each) => each !== name);
      app.go("compare");
    } }), ` ${name}`));
  const part = el("select", { "aria-label": "Data", onchange: (event) => { picked.part = event.target.value; app.go("compare"); } },
    [["unseen", "on unseen data"], ["fitted", "on the data of the fit"]].map(([value, text]) => el("option", { value, selected: value === picked.part }, text)));
  main.append(el("div", { class: "row", role: "group", "aria-label": "Models to compare" }, boxes, part));
  if (!picked.names.length) return;
  const group = new Group();
  app.close = () => group.close();
  const query = (k) => new URLSearchParams([["part", picked.part], ["output", k], ...picked.names.map((name) => ["model", name])]);
  for (const [k, output] of found.outputs.entries()) {
    const begin = unpack(await binary(`runs/${run}/window?${query(k)}&width=2`), null, true);
    const load = (slice) => async (a, b, width) => {
      const window = unpack(await binary(`runs/${run}/window?${query(k)}&from=${a}&to=${b}&width=${width}`), a, true);
      return { t: window.t, rows: window.rows.slice(...slice) };
    };
    if (app.part !== "compare") return;
    const first = el("div", { class: "plot" }), second = el("div", { class: "plot" });
    main.append(el("h2", {}, `${output}: measured and simulated (free run)`), first, el("h2", {}, "Residual"), second);
    const count = picked.names.length, unit = found.units[k] || "";
    new TimePlot(first, { labels: ["measured", ...picked.names], unit, load: load([0, count + 1]), ends: begin.ends, group, height: 260 });
    new TimePlot(second, { labels: picked.names, unit, load: load([count + 1]), from: 1, ends: begin.ends, group, height: 170 });
  }
  main.append(el("h2", {}, "Parameters with 95 % intervals"), parameters(found, picked.names));
  if (picked.names.some((name) => found.poles?.[name]?.length)) main.append(el("h2", {}, "Poles near rest at the mean input"), poles(found, picked.names));
  main.append(el("h2", {}, "Side by side"), el("div", { class: "side" }, picked.names.map((name) => card(name, found, run))));
}

function parameters(found, names) {
  const of = Object.fromEntries(names.map((name) => [name, Object.fromEntries(found.parameters[name].map((row) => [row.name, row]))]));
  const all = [...new Set(names.flatMap((name) => found.parameters[name].map((row) => row.name)))];
  const unit = (each) => names.map((name) => of[name][each]?.unit).find(Boolean) ?? "";
  const rows = all.map((each) => [each, unit(each), ...names.map((name) => of[name][each]?.text ?? "")]);
  return table({ header: ["Parameter", "Unit", ...names], rows, texts: 2 });
}

function poles(found, names) {
  const most = Math.max(...names.map((name) => found.poles[name].length));
  const rows = Array.from({ length: most }, (_, k) => [`${k + 1}`, ...names.map((name) => found.poles[name][k] ?? "")]);
  return table({ header: ["Pole", ...names], rows });
}

function card(name, found, run) {
  const section = found.sections[name] ?? { paragraphs: [], equations: [], remarks: [], tables: [], figures: [] };
  return el("section", { class: "card", "aria-label": name }, el("h3", {}, name),
    found.verdicts[name] ? el("p", {}, found.verdicts[name]) : null,
    section.paragraphs.map((text) => el("p", {}, text)),
    section.equations.map((text) => el("pre", {}, text)),
    section.tables.map((each) => table(each)),
    section.figures.map((figure) => [el("img", { src: `api/runs/${run}/file/figures/${figure.name}.svg`, alt: figure.caption, loading: "lazy" }),
      el("p", { class: "quiet" }, figure.caption)]),
    section.remarks.length ? el("ul", {}, section.remarks.map((text) => el("li", {}, text))) : null);
}
