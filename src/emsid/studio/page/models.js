// Models: which to fit and how on the left; the runs with their progress and ranked results on the right.
import { get, post, question } from "./api.js";
import { attempt, button, details, drafts, el, field, number, refused, table, taking, withUnit } from "./dom.js";
import { Chart, Group, color } from "./plot.js";

export function side(app) {
  const { state, catalogue } = app, step = state.step;
  if (!step.files.length) return [el("p", {}, "There are no data yet: load a record in the part Data.")];
  const change = (work) => post("edit", work);
  const box = (model) => el("label", { class: "check", title: model.summary }, el("input", { type: "checkbox", value: model.name, checked: step.models.includes(model.name),
    onchange: (event) => attempt(() => change(({ models }) => ({ models: event.target.checked ? [...models, model.name] : models.filter((each) => each !== model.name) }))) }),
  el("span", {}, model.name, " ", el("span", { class: "quiet" }, model.summary)));
  const options = (some) => change((now) => ({ options: { ...now.options, ...some } }));
  const fixed = Object.entries(step.options.fixed ?? {}).map(([name, value]) => `${name} = ${value}`).join("\n");
  const usual = catalogue.models.filter((model) => model.usual), others = catalogue.models.filter((model) => !model.usual);
  const used = new Set(step.models.length ? catalogue.models.filter((each) => step.models.includes(each.name)).flatMap((each) => each.uses) : catalogue.options.map((each) => each.name));
  const fields = catalogue.options.map((each) => ({ ...each, box: field(`option ${each.name}`, each.label.length > 2 ? withUnit(each.label, each.unit) : each.name, [].concat(step.options[each.name] ?? "").join(","),
    (text) => options({ [each.name]: text }), { about: each.meaning, placeholder: each.metavar, list: each.name === "static" ? "families" : null }) }));
  const needed = fields.filter((each) => used.has(each.name) || each.name in step.options), rest = fields.filter((each) => !needed.includes(each));
  return [
    el("div", { class: "row sticky" }, el("button", { type: "button", class: "main", id: "fit", onclick: () => attempt(fit) }, "Fit"), el("span", { class: "quiet" }, step.models.length ? `${step.models.length} chosen` : "the usual models that suit the record")),
    field("unseen", "Part kept unseen", step.unseen, (text) => post("edit", { unseen: Number(text) }), { disabled: step.unseen_files.length > 0, about: "A fraction of the record, on which models are ranked" }),
    el("h2", {}, "Models"), el("div", { class: "models" }, usual.map(box)), details("Further models", others.some((each) => step.models.includes(each.name)), others.map(box)),
    el("h2", {}, "Known values"), field("known", "Known values, one a line", fixed, async (text) => options({ fixed: table_of(text) }), { type: "textarea", rows: 3, placeholder: "resistance = 2 ohm ± 5 %" }),
    details("Names of parameters", false, el("p", { class: "quiet" }, catalogue.parameters.map((each) => withUnit(each.name, each.unit)).join(", "))),
    details("Options", Object.keys(step.options).some((name) => name !== "fixed") || fields.some((each) => drafts.has(`option ${each.name}`)), needed.map((each) => each.box), rest.length ? details("Options of other models", false, rest.map((each) => each.box)) : null),
    el("datalist", { id: "families" }, catalogue.static.map((name) => el("option", { value: name }))),
  ];
}

// The field that is left by pressing Fit is taken first; while one is refused, there is no fit without it.
async function fit() {
  await new Promise((done) => setTimeout(done, 0));
  await Promise.allSettled([...taking]);
  await new Promise((done) => setTimeout(done, 0));
  const wrong = [...refused].find(([key]) => /^(option|unseen|known)/.test(key));
  if (wrong) throw new Error(wrong[1]);
  await post("run");
}

function table_of(text) {
  const lines = text.split("\n").map((line) => line.trim()).filter(Boolean);
  const wrong = lines.find((line) => !/^[^=]+=\s*\S/.test(line));
  if (wrong) throw new Error(`“${wrong}” is not understood; write one value a line, as resistance = 2 ohm ± 5 %`);
  return Object.fromEntries(lines.map((line) => [line.slice(0, line.indexOf("=")).trim(), line.slice(line.indexOf("=") + 1).trim()]));
}

export function stage(app) {
  const key = JSON.stringify(app.state.runs.map((run) => [run.number, run.state, run.models, run.stale, run.ending]));
  return [key, (place, current) => build(place, app, current)];
}

async function build(place, app, current) {
  place.append(el("h2", {}, "Runs"));
  if (!app.state.runs.length) { place.append(el("p", { class: "quiet" }, "None yet: press Fit. Each run fits the chosen models to the data and ranks them on unseen data.")); return null; }
  const bars = new Map(), closes = [];
  for (const run of app.state.runs) place.append(view(run, app, bars, closes, current));
  app.progress = (run) => bars.get(run.number)?.(run);
  const clock = setInterval(() => { for (const update of bars.values()) update(null); }, 500);
  return () => { clearInterval(clock); app.progress = null; closes.forEach((close) => close()); };
}

function view(run, app, bars, closes, current) {
  const card = el("section", { class: "card", "aria-label": `Run ${run.number}` });
  const models = (run.task.models ?? []).join(", ") || "the usual models";
  card.append(el("h3", {}, `Run ${run.number}: ${run.state}`), el("p", { class: "quiet" }, `${(run.task.files ?? []).join(", ")} – ${models}`));
  if (run.stale.length) card.append(el("p", { class: "problem" }, `Not a result of the present data; different: ${run.stale.join(", ")}.`));
  if (run.state === "running" || run.state === "waiting") running(card, run, bars, closes);
  else if (run.state === "done") result(card, run, app, current);
  else card.append(el("p", { class: "problem" }, run.message ?? ""), run.models.length ? el("p", {}, `models kept: ${run.models.join(", ")}`) : "");
  return card;
}

const clockOf = (seconds) => `${Math.floor(seconds / 60)}:${`${Math.floor(seconds % 60)}`.padStart(2, "0")}`;

function running(card, run, bars, closes) {
  const bar = el("progress", { "aria-label": "Progress" }), doing = el("span", {}), fits = el("ul", { "aria-label": "Best so far" }), box = el("div", { class: "plot" });
  card.append(el("div", { class: "row" }, bar, doing, button("Cancel", () => question("cancel", { run: run.number }), { title: "Ends with the best so far; a second time, at once" })), fits, box);
  let last = run, came = performance.now(), chart = null, names = [];
  const update = (now) => {
    if (now) { last = now; came = performance.now(); }
    const at = last.progress ?? {}, seconds = (at.seconds ?? 0) + (performance.now() - came) / 1000;
    doing.textContent = ` ${clockOf(seconds)} – ${last.ending ? "ending with what it has: " : ""}${at.doing ?? "starting"}${at.total ? ` (${at.done} of ${at.total})` : ""}`;
    if (at.total) { bar.max = at.total; bar.value = at.done; } else bar.removeAttribute("value");
    if (!now) return;
    fits.replaceChildren(...Object.entries(last.fits ?? {}).map(([model, fit]) => el("li", {}, `${model}: fits ${fit === null ? "–" : `${fit.toFixed(1)} %`} of the data that it was fitted to`)));
    const search = Object.entries(last.search ?? {}).filter(([, points]) => points.length > 1);
    if (!search.length) return;
    if (!chart || `${names}` !== `${search.map(([name]) => name)}`) {
      names = search.map(([name]) => name);
      chart?.close();
      chart = new Chart(box, { y: { title: "Lowest cost so far", log: true }, group: new Group([0, 1]), height: 200, label: "Cost of the searches over time",
        curves: names.map((label, k) => ({ label, color: color(k), width: 2 })) });
    }
    const t = [...new Set(search.flatMap(([, points]) => points.map(([x]) => x)))].sort((a, b) => a - b);
    const rows = search.map(([, points]) => { let k = -1; return t.map((x) => { while (k < points.length - 1 && points[k + 1][0] <= x) k++; return k < 0 ? null : Math.max(points[k][1], 1e-300); }); });
    chart.group.range = chart.group.ends = [t[0], t.at(-1)];
    chart.put([t, ...rows]);
  };
  update(run);
  bars.set(run.number, update);
  closes.push(() => chart?.close());
}

async function result(card, run, app, current) {
  const found = await get(`runs/${run.number}/shown`);
  if (!current()) return;
  const file = (name) => `api/runs/${run.number}/file/${encodeURIComponent(name)}`;
  const rows = found.ranking.map((row) => [row.model, row.fit === null ? "diverges" : `${row.fit.toFixed(1)} %`, number(row.rmse), `${row.parameters}`, found.verdicts[row.model]?.level ?? ""]);
  const select = async (part) => { app.compared = app.state.models.filter((each) => each.run === run.number).map((each) => each.id).slice(0, 5); app.go(part); };
  card.append(found.summary[0] ? el("p", {}, found.summary[0]) : "",
    table({ header: ["Model", "Fit of the free run", `RMSE [${found.unit || "–"}]`, "Parameters", "Verdict"], rows, caption: `Run ${run.number}, ranked by free run on unseen data` }, (row) => (row[0] === found.chosen ? "chosen" : "")),
    el("div", { class: "row" }, button("Compare", () => select("compare"), { class: "main" }),
      button("Use", () => { app.model = `${run.number}/${found.chosen}`; app.go("use"); }),
      el("a", { href: file("report.html"), target: "_blank", rel: "noopener" }, "Report"), el("a", { href: file(found.usable ? "best.json" : `${found.chosen}.json`), download: "" }, "Model file"),
      el("a", { href: file("result.json"), download: "" }, "result.json")),
    el("ul", { class: "findings" }, found.findings.map((each) => el("li", { class: each.severity }, each.text, " ", run.stale.length ? null : action(each.edit)))));
}

function action(edit) {
  if (!edit) return null;
  const { again, ...change } = edit;
  const text = change.models ? (change.models.length ? `Fit ${change.models.join(", ")}` : "Fit the usual models")
    : change.given ? `Fit again with ${Object.entries(change.given).map(([name, value]) => `${name} ${typeof value === "object" ? JSON.stringify(value) : value}`).join(", ")}` : "Fit again";
  return button(text, async () => { if (Object.keys(change).length) await post("edit", change); await post("run"); });
}
