// Data: files, what the first look found, corrections, and the record with its marks and the brush.
import { binary, post, unpack, upload } from "./api.js";
import { attempt, el, number } from "./dom.js";
import { Group, TimePlot } from "./plot.js";

const ROLES = ["", "input", "output", "time"];

export function showData(main, app) {
  const { state } = app, step = state.step;
  main.append(files(state, step));
  if (!step.files.length || !state.data?.header) return;
  const data = state.data;
  main.append(el("h2", {}, `Columns of ${step.files[0]}`), el("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": "Columns" }, columns(data)),
    clock(data), findings(data));
  const known = data.records.filter((record) => !record.problem);
  for (const { problem, unlike } of data.records) if (problem || unlike) main.append(el("p", { class: "problem" }, problem || unlike));
  if (!known.length) return;
  const groups = known.map((record) => plots(main, record, step));
  app.close = () => groups.forEach((group) => group.close());
}

function files(state, step) {
  const pick = (unseen) => el("input", { type: "file", multiple: true, id: unseen ? "pick-unseen" : "pick",
    "aria-label": unseen ? "Add unseen data" : "Choose files", onchange: (event) => send(event.target.files, unseen) });
  const box = el("div", { class: "drop",
    ondragover: (event) => { event.preventDefault(); box.classList.add("over"); },
    ondragleave: () => box.classList.remove("over"),
    ondrop: (event) => { event.preventDefault(); box.classList.remove("over"); send(event.dataTransfer.files, false); } },
    el("p", {}, step.files.length ? "Drop a further record here, or choose one: " : "Drop a file with a record here, or choose one: ", pick(false)),
    step.files.length
      ? el("p", {}, "Unseen data to rank on: ", pick(true))
      : el("p", {}, "or begin with an example: ", state.catalogue.examples.map((each) => [el("button", {
          onclick: () => attempt(() => post("example", { name: each.name })) }, each.title), " "])));
  const rows = [["files", "fit"], ["unseen_files", "unseen"]].flatMap(([key, role]) => step[key].map((name) =>
    el("li", {}, `${name} (${role}) `, el("button", {
      onclick: () => attempt(() => post("edit", moved(step, name, key))), title: "Use it as the other kind of data" },
    role === "fit" ? "use as unseen" : "use to fit"), " ",
    el("button", { onclick: () => attempt(() => post("edit", { [key]: step[key].filter((each) => each !== name) })) }, "remove"))));
  return el("section", {}, el("h2", {}, "Files"), rows.length ? el("ul", {}, rows) : null, box);
}

function moved(step, name, key) {
  const other = key === "files" ? "unseen_files" : "files";
  return { [key]: step[key].filter((each) => each !== name), [other]: [...step[other], name] };
}

function send(list, unseen) {
  attempt(async () => { for (const file of list) await upload(file, unseen); });
}

function roleOf(name, reading) {
  const same = (value) => [].concat(value ?? []).some((each) => each === name || each === `d(${name})`);
  return same(reading.input) ? "input" : same(reading.output) ? "output" : reading.time === name ? "time" : "";
}

function columns(data) {
  const head = [...data.header.slice(0, 1), "Use as", "Unit", ...data.header.slice(1)];
  const body = data.rows.map((row) => {
    const name = row[0], role = roleOf(name, data.reading);
    const unit = data.reading.units?.[name] ?? "";
    return el("tr", {}, el("td", {}, name),
      el("td", {}, el("select", { "aria-label": `Role of ${name}`, value: role, onchange: (event) => correctRole(name, event.target.value, data) },
        ROLES.map((each) => el("option", { value: each, selected: each === role }, each || "–")))),
      el("td", {}, el("input", { "aria-label": `Unit of ${name}`, size: 7, value: unit, placeholder: data.units[name] || "SI", list: "units",
        onchange: (event) => correctUnit(name, event.target.value.trim(), data) })),
      row.slice(1).map((cell, k) => el("td", { class: k < 4 ? "" : "number" }, cell)));
  });
  return el("table", {}, el("caption", {}, data.caption), el("thead", {}, el("tr", {}, head.map((text) => el("th", { scope: "col" }, text)))),
    el("tbody", {}, body), el("datalist", { id: "units" }, ["V", "A", "N", "m", "mm", "m/s", "rad", "deg", "rad/s", "deg/s", "rpm", "count", "pwm"]
      .map((unit) => el("option", { value: unit }))));
}

const edit = (given) => attempt(() => post("edit", { given }));

function correctRole(name, role, data) {
  const given = {};
  if (role === "time") Object.assign(given, { time: name, dt: null });
  else if (role) given[role] = name;
  else for (const each of ["input", "output", "time"]) if (roleOf(name, data.reading) === each) given[each] = null;
  edit(given);
}

function correctUnit(name, unit, data) {
  const units = { ...data.reading.units, [name]: unit };
  if (!unit) delete units[name];
  edit({ units });
}

function clock(data) {
  const field = (name, label, size = 10) => el("label", {}, label, el("input", {
    value: Array.isArray(data.reading[name]) ? data.reading[name].map((x) => x ?? "").join(":") : data.reading[name] ?? "", size,
    "aria-label": label, onchange: (event) => edit({ [name]: typed(name, event.target.value.trim()) }) }));
  return el("div", {}, data.lines.map((line) => el("p", { class: "quiet" }, line)),
    el("div", { class: "options" }, field("dt", "Sample time [s]"), field("time_unit", "Unit of the time"), field("rows", "Rows A:B"),
      field("mask", "Leave out where (mask)", 26), field("counts_per_revolution", "Counts per revolution"), field("supply_voltage", "Supply voltage [V]"),
      el("label", {}, "Irregular times", el("select", { "aria-label": "Irregular times",
        onchange: (event) => edit({ resample: event.target.value === "yes" ? true : null }) },
      ["as they are", "yes"].map((text) => el("option", { value: text, selected: (text === "yes") === Boolean(data.reading.resample) },
        text === "yes" ? "resample" : text))))));
}

function typed(name, text) {
  if (text === "") return name === "mask" ? "" : null;
  if (name === "rows") { const [a, b] = text.split(":"); return [a ? Number(a) : null, b ? Number(b) : null]; }
  return name === "mask" || name === "time_unit" ? text : Number(text);
}

function findings(data) {
  return el("section", {}, el("h2", {}, "What the first look found"),
    el("ul", {}, data.findings.map((each) => el("li", { class: each.severity }, each.text, " ", each.given ? el("button", { onclick: () => edit(each.given) },
      Object.entries(each.given).map(([role, names]) => `Use ${[].concat(names).join(", ")} as ${role}`)) : null))));
}

function plots(main, record, step) {
  const group = new Group(), ends = [record.first, record.last];
  const bar = el("div", { class: "row", role: "group", "aria-label": `Selection in ${record.file}` });
  const first = el("input", { size: 9, "aria-label": "From [s]" }), last = el("input", { size: 9, "aria-label": "To [s]" });
  const act = (kind) => attempt(() => post("brush", { kind, file: record.file, first: Number(first.value), last: Number(last.value) }));
  const button = (text, work, title) => el("button", { onclick: work, title }, text);
  bar.append(el("span", {}, "Drag in a plot to select, or type: from "), first, " to ", last, " s",
    button("Zoom", () => first.value && group.zoom(Number(first.value), Number(last.value)), "Show only this"),
    button("All", () => group.zoom(...ends), "Show the whole record"),
    button("Leave out", () => act("mask"), "Mask the selection"),
    button("Keep only this", () => act("cut"), "Cut to the selection"),
    button("Unseen from here on", () => act("split"), "Fit before the beginning of the selection, rank on the rest"));
  main.append(el("h2", {}, `Record ${record.file}`), el("p", { class: "quiet" },
    `${record.samples.toLocaleString("en")} samples, one every ${number(record.dt)} s. Keys in a plot: arrows, + and −, 0 for all; Ctrl+wheel zooms.`), bar);
  if (record.marks.length) main.append(legend(record.marks, group, ends));
  const marks = [...record.marks];
  if (!step.unseen_files.length && step.files.length === 1) {
    const begin = record.first + (1 - step.unseen) * (record.last - record.first);
    marks.push({ kind: "split", first: begin, last: record.last });
  }
  const onBrush = (a, b) => { first.value = number6(a); last.value = number6(b); };
  for (const channel of record.channels) {
    const place = el("div", { class: "plot", "aria-label": `${channel.name} over time` });
    main.append(place);
    const load = async (a, b, width) => {
      const ask = new URLSearchParams({ file: record.file, channel: channel.name, from: a, to: b, width });
      return unpack(await binary(`window?${ask}`), a);
    };
    new TimePlot(place, { labels: [channel.name], unit: channel.unit, load, ends, group, marks, onBrush });
  }
  onBrush(...ends);
  return group;
}

const number6 = (x) => Number(x.toPrecision(7)).toString();

function legend(marks, group, ends) {
  const kinds = [...new Set(marks.map((mark) => mark.kind))];
  return el("div", { class: "marks" }, kinds.map((kind) => {
    const some = marks.filter((mark) => mark.kind === kind), longest = some[0];
    const pad = Math.max((longest.last - longest.first) * 0.5, (ends[1] - ends[0]) / 100);
    return el("span", {}, el("button", { title: "Show the first", onclick: () => group.zoom(longest.first - pad, longest.last + pad) },
      `${kind} × ${some.length}`), " ", el("span", { class: "quiet" }, longest.text));
  }));
}
