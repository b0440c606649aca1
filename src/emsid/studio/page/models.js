// Models: which to fit and how, the runs with their progress, and the ranked results.
import { get, post } from "./api.js";
import { attempt, el, number, table } from "./dom.js";

// What a result is not about; nothing for one of the present data.
export function otherData(run) {
  return run.stale.length ? el("p", { class: "problem" }, `Not a result of the present data; different: ${run.stale.join(", ")}.`) : "";
}

export function showModels(main, app) {
  const { state } = app, step = state.step;
  if (!step.files.length) { main.append(el("p", {}, "There are no data yet: drop a file in the part Data.")); return; }
  const begin = el("button", { class: "main", id: "fit", onclick: () => attempt(async () => {
    await apply(form, known, boxes, unseen, step); await post("run"); }) }, "Fit");
  const boxes = state.catalogue.models.map((model) => [model, el("input", { type: "checkbox", value: model.name, checked: step.models.includes(model.name) })]);
  const unseen = el("input", { size: 6, value: step.unseen, "aria-label": "Part kept unseen" });
  const fields = state.catalogue.options;
  const form = fields.map(({ name, meaning }) => [name, el("input", {
    value: [].concat(step.options[name] ?? "").join(","), "aria-label": name, title: meaning, list: name === "static" ? "families" : "" })]);
  const known = el("textarea", { rows: 3, cols: 44, placeholder: "resistance = 2 ohm ± 5 %", "aria-label": "Known values, one a line",
    value: Object.entries(step.options.fixed ?? {}).map(([name, value]) => `${name} = ${value}`).join("\n") });
  main.append(el("h2", {}, "Which models"),
    el("div", { class: "row" }, begin, el("label", {}, "Part kept unseen ", unseen)),
    el("p", { class: "quiet" }, "None chosen: the usual ones that suit the record."),
    el("div", { class: "models" }, boxes.map(([model, box]) => el("label", {}, box, el("span", {}, model.name, " ", el("span", { class: "quiet" }, model.summary))))),
    el("details", { open: Object.keys(step.options).length > 0 }, el("summary", {}, "Options and known values"),
      el("fieldset", {}, el("legend", {}, "Known values, as in a datasheet: name = value unit ± tolerance, one a line"), known,
        el("details", {}, el("summary", {}, "Names of parameters"), el("p", { class: "quiet" }, state.catalogue.parameters.map((each) => each.name).join(", ")))),
      el("div", { class: "options" }, fields.map(({ name, meaning, unit }, k) => el("label", { title: meaning },
        name.replace("_", " ") + (unit ? ` [${unit}]` : ""), form[k][1]))),
      el("datalist", { id: "families" }, state.catalogue.static.map((name) => el("option", { value: name })))));
  main.append(el("h2", {}, "Runs"));
  const bars = new Map();
  for (const run of state.runs) main.append(runView(run, app, bars));
  app.progress = (run) => bars.get(run.number)?.(run);
  if (!state.runs.length) main.append(el("p", { class: "quiet" }, "None yet: press Fit."));
}

async function apply(form, known, boxes, unseen, step) {
  const options = Object.fromEntries(form.map(([name, input]) => [name, input.value.trim()]));
  options.fixed = Object.fromEntries(known.value.split("\n").map((line) => line.split("=").map((part) => part.trim())).filter((parts) => parts[0] && parts[1]));
  const models = boxes.filter(([, box]) => box.checked).map(([, box]) => box.value);
  const asked = { models, options, unseen: Number(unseen.value) };
  const filled = Object.fromEntries(Object.entries(options).filter(([, value]) => value && (typeof value !== "object" || Object.keys(value).length)));
  const same = JSON.stringify([models, asked.unseen, filled]) === JSON.stringify([step.models, step.unseen, step.options]);
  if (!same) await post("edit", asked);
}

function runView(run, app, bars) {
  const card = el("section", { class: "card", "aria-label": `Run ${run.number}` });
  const title = el("h3", {}, `Run ${run.number}: ${run.state}`);
  card.append(title, otherData(run), el("p", { class: "quiet" }, `${(run.task.files ?? []).join(", ")} – ${(run.task.models ?? []).join(", ") || "the usual models"}`));
  if (run.state === "running" || run.state === "waiting") {
    const bar = el("progress", { "aria-label": "Progress" }), doing = el("span", {});
    const update = (now) => {
      const at = now.progress ?? {};
      doing.textContent = ` ${now.ending ? "ending with what it has: " : ""}${at.doing ?? "starting"}${at.total ? ` (${at.done} of ${at.total})` : ""}`;
      if (at.total) { bar.max = at.total; bar.value = at.done; } else bar.removeAttribute("value");
    };
    update(run);
    bars.set(run.number, update);
    card.append(el("div", { class: "row" }, bar, doing, el("button", { onclick: () => attempt(() => post("cancel", { run: run.number })) }, "Cancel")));
    if (run.models.length) card.append(el("p", {}, `found so far: ${run.models.join(", ")}`));
  } else if (run.state === "done") {
    result(card, run, app);
  } else {
    card.append(el("p", { class: "problem" }, run.message ?? ""), run.models.length ? el("p", {}, `models kept: ${run.models.join(", ")}`) : "");
  }
  return card;
}

async function result(card, run, app) {
  const found = await get(`runs/${run.number}/shown`);
  const file = (name) => `api/runs/${run.number}/file/${encodeURIComponent(name)}`;
  card.append(found.summary.map((text) => el("p", {}, text))[0] ?? "");
  const rows = found.ranking.map((row) => [row.model, row.fit === null ? "diverges" : `${row.fit.toFixed(1)} %`, number(row.rmse), `${row.parameters}`]);
  card.append(table({ header: ["Model", "Fit of the free run", `RMSE [${found.units[0] || "–"}]`, "Parameters"], rows, caption: "Ranked by free run on unseen data" },
    (row) => (row[0] === found.chosen ? "chosen" : "")));
  card.append(el("ul", {}, found.findings.map((each) => el("li", { class: each.severity }, each.text, " ", run.stale.length ? null : action(each.edit)))));
  const allow = el("input", { type: "checkbox" });
  const assumed = found.assumed ?? [];
  card.append(...(found.assumptions ?? []).map((text) => el("p", { class: "problem" }, text)));
  if (assumed.length) card.append(el("label", {}, allow, ` write ${assumed.join(", ")} into exports all the same`));
  card.append(el("div", { class: "row" },
    el("button", { class: "main", onclick: () => { app.run = run.number; app.go("compare"); } }, "Compare"),
    el("button", { onclick: () => { app.run = run.number; app.go("play"); } }, "Play"),
    el("a", { href: file("report.html"), target: "_blank", rel: "noopener" }, "Report"),
    el("a", { href: file(found.usable ? "best.json" : `${found.chosen}.json`), download: "" }, "Model file"),
    el("a", { href: file("result.json"), download: "" }, "result.json"),
    app.state.formats.map((format) => el("button", { onclick: () => attempt(() => save(run.number, found.chosen, format, allow.checked ? assumed : [])) }, `Export ${format}`))));
}

async function save(run, model, format, assume) {
  const response = await fetch("api/export", { method: "POST", body: JSON.stringify({ run, model, format, assume }) });
  if (!response.ok) throw new Error(await response.text());
  const link = el("a", { href: URL.createObjectURL(await response.blob()), download: `${model}-${format}.zip` });
  link.click();
  URL.revokeObjectURL(link.href);
}

function action(edit) {
  if (!edit) return null;
  const { again, ...change } = edit;
  const text = change.models ? (change.models.length ? `Fit ${change.models.join(", ")}` : "Fit the usual models")
    : change.given ? `Fit again with ${Object.entries(change.given).map(([name, value]) => `${name} ${typeof value === "object" ? JSON.stringify(value) : value}`).join(", ")}` : "Fit again";
  return el("button", { onclick: () => attempt(async () => { if (Object.keys(change).length) await post("edit", change); await post("run"); }) }, text);
}
