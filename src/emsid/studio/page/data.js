// Data: datasets with their roles, units and preparation on the left; their plots, marks and selections on the right.
import { binary, get, post, unpack, upload } from "./api.js";
import { attempt, button, details, drafts, el, field, labelled, number, refused, select, table, withUnit } from "./dom.js";
import { Chart, Group, color } from "./plot.js";

const KINDS = { files: "to fit", unseen_files: "unseen", other_files: "not used" };
const ROLES = [["", "–"], ["input", "input"], ["output", "output"], ["derivative", "output: its derivative"], ["time", "time"]];
const LABELS = new Set(["input", "output", "time", "units"]);
const six = (x) => Number(x.toPrecision(7)).toString();
const looks = { key: null, data: null };

const chosen = (app) => app.state.records.find((record) => record.file === app.file) ?? app.state.records[0];
const read = (file) => get(`data?${new URLSearchParams({ file })}`);

// Correct how the chosen file is read; a correction that depends on the reading is a function of it, as it may have changed
// since it was drawn.
const edit = (app, given, { file } = chosen(app)) => post("edit", async () => ({ file, given: typeof given === "function" ? given((await read(file)).reading) : given }));
const known = (app, file) => (app.known[file] ??= {});

// The look at the chosen file is fetched apart from the state, which is there at once.
async function look(app) {
  const record = chosen(app), key = `${record.file} ${app.state.version} ${record.look}`;
  if (looks.key === key) return;
  looks.key = key;
  await attempt(async () => {
    const found = await read(record.file);
    if (looks.key !== key) return;
    looks.data = found;
    if (app.part === "data") app.draw();
    app.marks?.();
  });
}

export function side(app) {
  const { state } = app, record = chosen(app);
  if (!record) return [el("h2", {}, "Data"), pickers(app)];
  look(app);
  const data = looks.data?.file === record.file ? looks.data : null;
  return [
    el("h2", {}, "Datasets"), datasets(app), pickers(app),
    el("h2", {}, record.file),
    record.problem ? el("p", { class: "problem" }, record.problem) : null,
    record.unlike ? el("p", { class: "problem" }, record.unlike) : null,
    data?.like ? el("p", { class: "quiet" }, `Read like ${data.like}; what is set here is its own.`) : null,
    data ? [columns(app, record, data), preparation(app, record, data), findings(app, data)] : el("p", { class: "quiet" }, "looking at the file …"),
  ];
}

function pickers(app) {
  const box = (label, kind) => labelled(label, el("input", { type: "file", multiple: true, id: `pick-${kind}`, "aria-label": label,
    onchange: (event) => send(event.target.files, kind) }));
  return app.state.step.files.length
    ? details("Add files", false, box("Add to fit", "files"), box("Add unseen data", "unseen_files"), box("Add to look at", "other_files"))
    : box("Choose files", "files");
}

function send(list, kind) {
  return attempt(async () => { for (const file of list) await upload(file, "files", kind); });
}

// A place for files of the computer, and for datasets that are moved.
function target(kind, element, onName = null) {
  element.addEventListener("dragover", (event) => { event.preventDefault(); element.classList.add("over"); });
  element.addEventListener("dragleave", () => element.classList.remove("over"));
  element.addEventListener("drop", (event) => {
    event.preventDefault();
    element.classList.remove("over");
    const name = event.dataTransfer.getData("text/plain");
    if (event.dataTransfer.files.length) send(event.dataTransfer.files, kind);
    else if (name && onName) attempt(() => onName(name));
  });
  return element;
}

function assign(name, kind) {
  return post("edit", (step) => {
    const lists = Object.fromEntries(Object.keys(KINDS).map((key) => [key, step[key].filter((each) => each !== name)]));
    if (kind) lists[kind].push(name);
    if (!lists.files.length && lists.other_files.length && !lists.unseen_files.length) lists.files = [lists.other_files.shift()];
    return lists;
  });
}

function datasets(app) {
  const groups = Object.entries(KINDS).map(([kind, title]) => {
    const items = app.state.step[kind].map((name) => {
      const current = chosen(app).file === name, record = app.state.records.find((each) => each.file === name);
      return el("li", { draggable: true, class: current ? "current" : "", ondragend: () => app.hold(false),
        ondragstart: (event) => { event.dataTransfer.setData("text/plain", name); app.hold(true); } },
        button(name, () => { app.file = name; app.draw(); }, { "aria-pressed": `${current}`, class: "plain" }),
        el("span", { class: "quiet" }, record.samples ? `${record.samples.toLocaleString("en")} samples` : ""),
        select(`Use ${name}`, kind, Object.entries(KINDS), (value) => assign(name, value)),
        button("×", () => assign(name, null), { "aria-label": `Remove ${name}`, title: "Remove" }));
    });
    return target(kind, el("section", { class: "group", "aria-label": `Data ${title}` }, el("h3", {}, title),
      items.length ? el("ul", {}, items) : el("p", { class: "quiet" }, "drop data here")), (name) => assign(name, kind));
  });
  return el("div", { class: "groups" }, groups);
}

const list = (value) => [].concat(value ?? []);

function roleOf(name, reading) {
  if (list(reading.input).includes(name)) return "input";
  if (list(reading.output).includes(name)) return "output";
  if (list(reading.output).includes(`d(${name})`)) return "derivative";
  return reading.time === name ? "time" : "";
}

function correctRole(app, name, role) {
  return edit(app, (reading) => {
    const without = (values) => list(values).filter((each) => each !== name && each !== `d(${name})`), given = {};
    const set = (key, values) => { if (`${values}` !== `${list(reading[key])}`) given[key] = values.length > 1 ? values : values[0] ?? null; };
    set("input", [...without(reading.input), ...(role === "input" ? [name] : [])]);
    set("output", [...without(reading.output), ...(role === "output" ? [name] : role === "derivative" ? [`d(${name})`] : [])]);
    if (role === "time") Object.assign(given, { time: name, dt: null });
    else if (reading.time === name) given.time = null;
    return given;
  });
}

function columns(app, record, data) {
  const shown = drawnColumns(app, record);
  const rows = data.rows.map((row) => {
    const name = row[0], units = data.reading.units ?? {};
    const toggle = el("input", { type: "checkbox", checked: shown.some((each) => bare(each) === name), "aria-label": `Plot ${name}`, onchange: (event) => {
      known(app, record.file).columns = event.target.checked ? [...shown, name] : shown.filter((each) => bare(each) !== name);
      app.draw();
    } });
    const unit = field(`unit ${record.file} ${name}`, `Unit of ${name}`, units[name] ?? "", (text) => edit(app, (reading) => {
      const { [name]: _, ...others } = reading.units ?? {};
      return { units: text ? { ...others, [name]: text } : others };
    }), { placeholder: data.units[name] || "SI", list: "units", size: 6 });
    return el("tr", { title: row.slice(1).join(" · ") }, el("td", {}, toggle), el("td", {}, name),
      el("td", {}, select(`Role of ${name}`, roleOf(name, data.reading), ROLES, (role) => correctRole(app, name, role))), el("td", { class: "bare" }, unit));
  });
  return [el("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": "Columns" }, el("table", {},
    el("thead", {}, el("tr", {}, ["Plot", "Column", "Use as", "Unit"].map((text) => el("th", { scope: "col" }, text)))), el("tbody", {}, rows))),
  el("datalist", { id: "units" }, app.catalogue.units.map((unit) => el("option", { value: unit }))),
  details("About the columns", false, table({ header: data.header, rows: data.rows, caption: data.caption }), data.lines.map((line) => el("p", { class: "quiet" }, line)))];
}

const text = (value) => (value === null || value === undefined || value === false ? "" : Array.isArray(value) ? value.map((x) => x ?? "").join(":")
  : typeof value === "object" ? Object.entries(value).map(([name, each]) => `${name}=${each}`).join(", ") : `${value}`);

// What is typed is drawn beside the present record at once; it is taken with Apply.
function preparation(app, record, data) {
  const fields = app.catalogue.reading.filter((each) => !LABELS.has(each.name)), key = (each) => `prepare ${record.file} ${each.name}`;
  const typed = () => Object.fromEntries(fields.filter((each) => drafts.has(key(each))).map((each) => [each.name, drafts.get(key(each)).trim() || null]));
  const preview = () => { known(app, record.file).preview = Object.keys(typed()).length ? typed() : null; bar(); app.preview?.(); };
  const apply = async () => {
    const given = typed();
    for (const name of Object.keys(given)) refused.delete(`prepare ${record.file} ${name}`);
    try { await edit(app, given); } catch (problem) {
      const wrong = fields.find((each) => problem.message.includes(`“${each.label}”`)) ?? fields.find((each) => each.name in given);
      if (wrong) refused.set(key(wrong), problem.message);
      app.draw();
      throw problem;
    }
    discard();
  };
  const discard = () => { for (const each of fields) { drafts.delete(key(each)); refused.delete(key(each)); } preview(); app.draw(); };
  const buttons = [button("Apply", apply, { class: "main" }), button("Discard", discard)];
  const bar = () => buttons.forEach((each) => { each.disabled = !Object.keys(typed()).length; });
  const raw = el("input", { type: "checkbox", checked: known(app, record.file).raw ?? false, onchange: (event) => { known(app, record.file).raw = event.target.checked; app.preview?.(); } });
  const box = (each) => (each.kind === "switch"
    ? el("label", { class: "check", title: each.meaning }, el("input", { type: "checkbox", checked: Boolean(data.reading[each.name]), onchange: (event) => attempt(() => edit(app, { [each.name]: event.target.checked || null })) }), each.label)
    : field(key(each), each.label + (each.unit ? ` [${each.unit}]` : ""), text(data.reading[each.name]), null,
      { about: each.meaning, placeholder: each.metavar, now: preview, onkeydown: (event) => { if (event.key === "Enter") attempt(apply); } }));
  const inside = details("Preparation", fields.some((each) => drafts.has(key(each))), fields.map(box), el("div", { class: "row" }, buttons),
    el("label", { class: "check" }, raw, "show the record before filter, trend and decimation beside it"));
  bar();
  return inside;
}

function findings(app, data) {
  return [el("h2", {}, "What the first look found", data.looking ? el("span", { class: "quiet" }, " (looking again …)") : null),
    el("ul", { class: "findings" }, data.findings.map((each) => {
      const marks = data.marks.filter((mark) => mark.kind === each.kind);
      return el("li", { class: each.severity }, each.text, " ",
        marks.length ? button(`Show ${marks.length}`, () => app.showMarks?.(each.kind), { "aria-label": `Show ${each.kind} in the plot` }) : null, " ",
        each.given ? button(`Use ${Object.entries(each.given).map(([name, value]) => `${text(value)} as ${name}`).join(", ")}`, () => edit(app, each.given)) : null);
    }))];
}

const bare = (name) => name.replace(/^d\((.*)\)$/, "$1");

function drawnColumns(app, record) {
  const own = record.channels.map((each) => each.name), wanted = known(app, record.file).columns;
  return wanted ? wanted.map((name) => own.find((each) => bare(each) === bare(name)) ?? name) : own;
}

export function stage(app) {
  const record = chosen(app);
  if (!record) return ["nothing", (place) => first(place, app)];
  if (!record.samples) return [`problem ${record.file} ${record.problem}`, (place) => { place.append(el("p", {}, "There is no record yet: choose what is input and output in the table of the columns.")); }];
  const { columns: _, overlay, against } = known(app, record.file), names = drawnColumns(app, record);
  const key = JSON.stringify([{ ...record, look: 0 }, names, overlay, against]);
  return [key, (place) => (against ? scatter(place, app, record, names, against) : plots(place, app, record, names))];
}

function first(place, app) {
  const examples = app.catalogue.examples.map((each) => el("li", {}, el("button", { type: "button", onclick: (event) => {
    const about = event.target.nextElementSibling;
    event.target.setAttribute("aria-busy", "true");
    about.textContent = "The record is being simulated. The first time after an installation this also compiles, which takes up to half a minute.";
    attempt(() => post("example", { name: each.name }));
  } }, each.title), el("p", { class: "quiet", role: "status" }, each.about)));
  place.append(el("div", { class: "first" }, el("h2", {}, "From a record to a model"),
    el("ol", {}, ["Load a record of what went into a drive and what came out, such as voltage and speed: CSV, Excel, MAT, Parquet, logs of boards.", "Check the roles and units that were found, leave out what is wrong, and keep a part unseen.",
      "Fit models, compare them on unseen data, and export the best one."].map((each) => el("li", {}, each))),
    target("files", el("div", { class: "drop" }, el("p", {}, "Drop a file with a record here"),
      el("p", {}, el("button", { type: "button", class: "main", onclick: () => document.getElementById("pick-files").click() }, "Choose a file")))),
    el("h3", {}, "Or begin with an example"), el("ul", { class: "examples" }, examples)));
}

function tools(place, app, record, group, names) {
  const mine = known(app, record.file), range = mine.selection ?? [record.first, record.last];
  const from = el("input", { size: 9, value: six(range[0]), "aria-label": "From [s]" }), to = el("input", { size: 9, value: six(range[1]), "aria-label": "To [s]" });
  const act = (kind) => post("brush", { kind, file: record.file, first: Number(from.value), last: Number(to.value) });
  const typed = () => group.select([Number(from.value), Number(to.value)]);
  from.addEventListener("change", typed);
  to.addEventListener("change", typed);
  const mode = el("button", { type: "button", "aria-pressed": `${group.mode === "select"}`, title: "Key s in a plot; or hold Shift while dragging", onclick: () => group.onMode() }, "Select");
  group.onMode = () => { mine.mode = group.mode = group.mode === "select" ? "pan" : "select"; mode.setAttribute("aria-pressed", `${group.mode === "select"}`); };
  group.onSelect = (a, b) => { from.value = six(a); to.value = six(b); };
  const others = ["", ...record.columns.filter((each) => !names.includes(each)), ...names];
  const overlay = el("input", { type: "checkbox", checked: mine.overlay ?? false, onchange: (event) => { mine.overlay = event.target.checked; app.draw(); } });
  place.append(el("div", { class: "row bar", role: "group", "aria-label": `Selection in ${record.file}` },
    mode, el("label", {}, "from ", from), el("label", {}, " to ", to), " s",
    button("Zoom", () => group.zoom(Number(from.value), Number(to.value))), button("All", () => group.zoom(record.first, record.last)),
    button("+", () => [...group.charts][0]?.move(0, 0.5), { "aria-label": "Zoom in" }), button("−", () => [...group.charts][0]?.move(0, 2), { "aria-label": "Zoom out" }),
    button("Leave out", () => act("mask"), { title: "Mask the selection" }), button("Keep only this", () => act("cut"), { title: "Cut to the selection" }),
    button("Unseen from here on", () => act("split"), { title: "Fit before the beginning of the selection, rank on the rest; its edge can be dragged" }),
    el("label", { class: "check" }, overlay, "one plot"),
    labelled("x axis", select("x axis", mine.against ?? "", others.map((each) => [each, each || "time"]), (value) => { mine.against = value; app.draw(); }))),
  el("p", { class: "quiet" }, `${record.samples.toLocaleString("en")} samples, one every ${number(record.dt)} s. The wheel zooms, a drag moves; in a plot: arrows, + and −, 0 for all.`));
}

function plots(place, app, record, names) {
  const mine = known(app, record.file), ends = [record.first, record.last];
  const group = new Group(ends, mine.range && mine.range[1] <= ends[1] && mine.range[0] >= ends[0] ? mine : Object.assign(mine, { range: ends, selection: null }));
  const unit = (name) => record.channels.find((each) => each.name === name)?.unit ?? "";
  const split = () => app.splitting ?? (app.state.step.unseen_files.length || app.state.step.files.length !== 1 || record.kind !== "files" ? null
    : record.first + (1 - app.state.step.unseen) * (record.last - record.first));
  group.split = split;
  group.onSplit = (at, done) => {
    app.splitting = done ? null : at;
    for (const chart of group.charts) chart.plot.redraw(false);
    if (done) attempt(() => post("brush", { kind: "split", file: record.file, first: at, last: record.last }));
  };
  const marks = () => (looks.data?.file === record.file ? looks.data.marks : []);
  const spans = () => [...marks().map((mark) => ({ ...mark, strong: mark.kind === mine.marked })), ...(split() === null ? [] : [{ kind: "unseen", first: split(), last: record.last }])];
  tools(place, app, record, group, names);
  const some = mine.overlay ? [names] : names.map((name) => [name]);
  const used = [...place.children].reduce((sum, each) => sum + each.offsetHeight + 12, 0);
  const height = Math.max(150, Math.floor((place.clientHeight - used - 60) / Math.max(some.length, 1)) - 45);
  const charts = some.filter((each) => each.length).map((columns) => {
    const box = el("div", { class: "plot" });
    place.append(box);
    const others = () => [mine.preview && { given: mine.preview }, mine.raw && { given: { filter: null, detrend: null, decimate: null, scale: null, offset: null, shift: null } }];
    const load = async (a, b, width) => {
      const window = async (more) => unpack(await binary("window", { file: record.file, columns, from: a, to: b, width, ...more }), a);
      const now = await window({}), rows = [...now.rows];
      for (const more of others()) {
        const found = more ? await window(more) : null;  // empty where what is typed is not complete
        rows.push(...columns.map((_, k) => (found?.rows.length ? aligned(found.t, found.rows[k], now.t) : now.t.map(() => null))));
      }
      return { t: now.t, rows };
    };
    const curve = (name, k, more = {}) => ({ label: withUnit(name, unit(name)), color: color(names.indexOf(columns[k])), ...more });
    return new Chart(box, { y: { title: columns.map((name) => withUnit(name, unit(name))).join(", ") }, load, group, height, spans,
      label: `${columns.join(", ")} over time`,
      curves: [...columns.map((name, k) => curve(name, k)), ...columns.map((name, k) => curve(`${name} as typed`, k, { color: color(1), width: 2 })), ...columns.map((name, k) => curve(`${name} before`, k, { color: color(null), dash: "dotted" }))] });
  });
  const visible = () => { for (const chart of charts) {
    const n = (chart.plot.series.length - 1) / 3;
    for (let k = 1; k <= 3 * n; k++) chart.plot.setSeries(k, { show: k <= n || (k <= 2 * n ? Boolean(mine.preview) : Boolean(mine.raw)) });
    chart.place.querySelectorAll(".u-series").forEach((row, k) => row.classList.toggle("off", k > n && !(k <= 2 * n ? mine.preview : mine.raw)));
  } };
  visible();
  let soon = 0;
  app.preview = () => { visible(); clearTimeout(soon); soon = setTimeout(() => charts.forEach((chart) => chart.show()), 120); };
  app.marks = () => { for (const chart of charts) chart.plot?.redraw(false); legend(); };
  app.showMarks = (kind) => {
    const of = marks().filter((mark) => mark.kind === kind), next = of[((mine.marked === kind ? mine.at ?? -1 : -1) + 1) % of.length];
    Object.assign(mine, { marked: kind, at: of.indexOf(next) });
    const room = Math.max((next.last - next.first) * 0.5, (record.last - record.first) / 100);
    group.zoom(Math.max(next.first - room, record.first), Math.min(next.last + room, record.last));
    legend();
  };
  const below = el("div", { class: "marks" });
  place.append(below);
  const legend = () => {
    const kinds = [...new Set(marks().map((mark) => mark.kind))];
    below.replaceChildren(...kinds.map((kind) => button(`${kind} × ${marks().filter((mark) => mark.kind === kind).length}`, () => app.showMarks(kind),
      { title: marks().find((mark) => mark.kind === kind).text, "aria-pressed": `${kind === mine.marked}` })));
  };
  legend();
  return () => { app.preview = app.marks = app.showMarks = null; group.close(); };
}

// Values at other times, by the nearest one before.
function aligned(t, values, times) {
  let k = 0;
  return times.map((time) => { while (k < t.length - 1 && t[k + 1] <= time) k++; return values[k] ?? null; });
}

async function scatter(place, app, record, names, against) {
  const group = new Group([record.first, record.last], known(app, record.file));
  tools(place, app, record, group, names);
  const marks = await Promise.all(names.filter((name) => name !== against).map(async (name, k) => {
    const buffer = await binary("pairs", { file: record.file, columns: [against, name], from: group.range[0], to: group.range[1] });
    const { t, rows } = unpack(buffer, 0);
    return { kind: "points", x: t, y: rows[0], label: name, ink: ["NAVY", "RED", "GREEN", "ORANGE", "PURPLE"][k % 5], size: 1.2 };
  }));
  if (!marks.length) { place.append(el("p", {}, "Choose a further column to plot.")); return null; }
  const box = el("div", { class: "plot" });
  place.append(box);
  const chart = new Chart(box, { x: { title: against }, y: { title: names.filter((name) => name !== against).join(", ") }, marks, height: Math.max(300, place.clientHeight - 140), label: `against ${against}` });
  return () => chart.close();
}
