// Live: a running source with its parameters over time, alarms, and the state of the connection.
import { question } from "./api.js";
import { attempt, button, el, field, drafts, labelled, number, table, withUnit } from "./dom.js";
import { Chart, Group, color } from "./plot.js";

const KEPT = 4000;
const FIELDS = [["source", "Source", "serial:///dev/ttyACM0", "A serial port, socket://host:port, or a file"], ["structure", "Structure", "arx", ""], ["na", "na", "1", "Coefficients of past outputs"], ["nb", "nb", "1", "Coefficients of past inputs"],
  ["header", "Columns without header", "t[ms],u[V],y[rpm]", "Where the source sends no names"], ["input", "Input column", "", ""], ["output", "Output column", "", ""], ["time", "Time column", "", ""], ["dt", "Sample time [s]", "", ""], ["baud", "Baud rate", "115200", ""], ["forgetting", "Forgetting factor", "0.995", ""]];
const live = fresh();
let show = () => {}, asked = 0;

function fresh() { return { rows: [], start: null, last: null, alarms: [], problem: "", ended: false, came: 0, lost: false }; }

function alarm(at, text) { live.alarms = [{ at, text }, ...live.alarms].slice(0, 20); }

export function lost() { live.lost = true; show(); }

export function message(app, news) {
  live.lost = false;
  live.came = performance.now();
  if (news.kind === "start") { Object.assign(live, fresh(), { start: news, came: performance.now() }); if (app.part === "live") app.rebuild(); return; }
  if (news.kind === "estimate") {
    live.last = news;
    live.rows.push([news.time, news.output, news.prediction, news.input?.[0] ?? null, ...news.parameters.flatMap((each) => [each.value, each.half_width])]);
    if (live.rows.length > KEPT) live.rows = live.rows.filter((_, k) => k % 2 || k > KEPT / 2);  // the older half is thinned
  } else if (news.kind === "finding") alarm(news.time, news.text);
  else if (news.kind === "ended") {
    Object.assign(live, { ended: true, problem: news.problem });
    alarm(live.last?.time ?? null, news.problem || "the source has ended; record and report are in the session");
  }
  if (!asked) asked = requestAnimationFrame(() => { asked = 0; show(); });
}

export function side(app) {
  const begin = (event) => {
    event.preventDefault();
    attempt(async () => {
      await question("live", Object.fromEntries(FIELDS.map(([name]) => [name, drafts.get(`live ${name}`) ?? ""])));
      if (live.ended) Object.assign(live, fresh());
      await app.refresh();
      show();
    });
  };
  return [el("h2", {}, "A running source"), el("form", { onsubmit: begin }, FIELDS.map(([name, text, placeholder, about]) => field(`live ${name}`, text, "", null, { placeholder, about })),
    el("div", { class: "row" }, el("button", { class: "main" }, "Follow"), button("Stop", () => question("live/stop")), button("Fit this record", async () => { await question("live/take"); app.go("data"); }, { title: "Adds the record of the source to the data" }))),
  app.state.live.problem ? el("p", { class: "problem" }, app.state.live.problem) : null];
}

export function stage(app) { return [`${live.start?.source} ${live.start?.parameters}`, (place) => build(place, app)]; }

function build(place, app) {
  const status = el("p", { role: "status" }), below = el("div"), group = new Group([0, 1]);
  const boxes = [0, 1, 2].map(() => el("div", { class: "plot" }));
  const hint = el("p", { class: "quiet" }, "Name a serial port, a network address or a file on the left and press Follow: output, input and parameters with their intervals are drawn here, with an alarm where the system changes.");
  place.append(status, ...(live.start ? boxes : [hint]), below);
  if (!live.start) boxes.forEach((box) => { box.hidden = true; place.append(box); });
  const names = live.start?.parameters ?? [], [out, into] = [live.start?.output, live.start?.inputs?.[0]];
  const title = (channel, otherwise) => (channel ? withUnit(channel.name, channel.unit) : otherwise), room = Math.max(420, place.clientHeight - 190);
  const output = new Chart(boxes[0], { y: { title: title(out, "output") }, group, height: Math.floor(room * 0.38), label: "Output over time", curves: [{ label: "output", color: color(null), width: 1.6 }, { label: "predicted", color: color(1) }] });
  const input = new Chart(boxes[1], { y: { title: title(into, "input") }, group, height: Math.floor(room * 0.24), label: "Input over time", curves: [{ label: "input", color: color(0) }] });
  const parameters = names.length ? new Chart(boxes[2], { y: { title: "Parameters ± 95 %" }, group, height: Math.floor(room * 0.38), label: "Parameters over time",
    curves: names.flatMap((label, k) => [{ label, color: color(k), width: 1.8 }, { label: `${label} low`, color: color(k), width: 0.8, dash: "dotted", quiet: true }, { label: `${label} high`, color: color(k), width: 0.8, dash: "dotted", quiet: true }]) }) : null;
  const column = (k) => live.rows.map((row) => row[k]);
  show = () => {
    const seconds = (performance.now() - live.came) / 1000, { last } = live;
    const text = live.lost ? "the server does not answer" : live.ended ? "ended" : !live.start ? (app.state.live.running ? "waiting for the source" : "no source is followed") : seconds > 3 ? `connected; silent for ${seconds.toFixed(0)} s` : "connected";
    const count = last ? `${last.samples ?? ""} samples, ${number(last.rate, 3)} per s` : "";
    if (status.textContent !== `${text}${count && `: ${count}`}`) status.textContent = `${text}${count && `: ${count}`}`;
    status.className = live.lost || live.problem ? "problem" : "";
    if (live.rows.length > 1) {
      const t = column(0);
      const follows = `${group.range}` === `${group.ends}`;  // a part that was zoomed to stays, until 0 or a double click
      group.ends = [t[0], t.at(-1)];
      if (follows) group.range = group.ends;
      const low = thinned(t, [column(1), column(2)], output.width), drive = thinned(t, [column(3)], input.width);
      output.put([low.t, ...low.rows]);
      input.put([drive.t, ...drive.rows]);
      parameters?.put([t, ...names.flatMap((_, k) => { const v = column(4 + 2 * k), h = column(5 + 2 * k); return [v, v.map((x, n) => (h[n] === null ? null : x - h[n])), v.map((x, n) => (h[n] === null ? null : x + h[n]))]; })]);
    }
    const row = (each) => [each.unit ? withUnit(each.name, each.unit) : each.name, number(each.value), each.half_width === null || each.half_width === undefined ? "–" : `± ${number(each.half_width)}`];
    const rows = [...(last?.parameters ?? []), ...(last?.physical ?? [])].map(row);
    below.replaceChildren(rows.length ? table({ header: ["Parameter", "Value", "95 %"], rows, caption: count }) : "",
      live.alarms.length ? el("section", { "aria-label": "Alarms" }, el("h3", {}, "Alarms"), el("ul", {}, live.alarms.map((each) => el("li", { class: "warning" }, each.at === null ? "" : `${number(each.at, 6)} s: `, each.text)))) : "");
  };
  show();
  const clock = setInterval(show, 1000);
  return () => { show = () => {}; clearInterval(clock); group.close(); };
}

// The lowest and highest value in every pixel.
function thinned(t, rows, width) {
  if (t.length <= 2 * width) return { t, rows };
  const size = Math.ceil(t.length / width), places = [];
  for (let a = 0; a < t.length; a += size) places.push([a, Math.min(a + size, t.length)]);
  const ends = (values, [a, b]) => { let low = null, high = null; for (let k = a; k < b; k++) if (values[k] !== null) { low = low === null ? values[k] : Math.min(low, values[k]); high = high === null ? values[k] : Math.max(high, values[k]); } return [low, high]; };
  return { t: places.flatMap(([a]) => [t[a], t[a]]), rows: rows.map((values) => places.flatMap((part) => ends(values, part))) };
}
