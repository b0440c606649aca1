// Live: a running source with its parameters and alarms.
import { post } from "./api.js";
import { attempt, el, number, table } from "./dom.js";
import { arrays } from "./plot.js";

const KEPT = 2000;
const live = { t: [], y: [], p: [], u: [], of: [], start: null, last: null, alarms: [] };
let show = () => {};

export function liveMessage(message) {
  if (message.kind === "start") Object.assign(live, { t: [], y: [], p: [], u: [], of: message.parameters.map(() => []), start: message, last: null, alarms: [] });
  else if (message.kind === "estimate") {
    live.last = message;
    for (const [list, value] of [[live.t, message.time], [live.y, message.output], [live.p, message.prediction], [live.u, message.input?.[0] ?? null], ...live.of.map((list, k) => [list, message.parameters[k].value])]) {
      list.push(value);
      if (list.length > KEPT) list.shift();
    }
  } else if (message.kind === "finding") live.alarms.unshift(message.text);
  else if (message.kind === "ended") live.alarms.unshift(message.problem || "the source has ended; record and report are in the session");
  show(message);
}

export function showLive(main, app) {
  const field = (name, label, placeholder = "", size = 10) => el("label", {}, label, el("input", { name, placeholder, size, "aria-label": label }));
  const form = el("form", { class: "options", onsubmit: (event) => {
    event.preventDefault();
    attempt(() => post("live", Object.fromEntries(new FormData(form))));
  } }, field("source", "Source", "serial:///dev/ttyACM0", 28), field("structure", "Structure", "arx"), field("na", "na"), field("nb", "nb"),
  field("header", "Columns without header", "t[ms],u[V],y[rpm]", 18), field("input", "Input column"), field("output", "Output column"), field("time", "Time column"), field("dt", "Sample time"),
  el("button", { class: "main" }, "Follow"), el("button", { type: "button", onclick: () => attempt(() => post("live/stop")) }, "Stop"));
  const upper = el("div", { class: "plot" }), lower = el("div", { class: "plot" }), below = el("div", { "aria-live": "polite" }), past = el("div", { class: "plot" });
  main.append(el("h2", {}, "A running source"), form, upper, lower, below, past);
  const output = arrays(upper, ["output", "predicted"], "", 240), input = arrays(lower, ["input"], "", 130);
  let history = null;
  app.close = () => { show = () => {}; output.destroy(); input.destroy(); history?.destroy(); };
  show = (message) => {
    if (message?.kind === "start") history = history?.destroy();
    if (live.start) history ??= arrays(past, live.start.parameters, "over its present value", 180);
    history?.setData([live.t, ...live.of.map((values) => values.map((value) => value / values.at(-1)))]);
    output.setData([live.t, live.y, live.p]);
    input.setData([live.t, live.u]);
    const rows = (live.last?.parameters ?? []).map((each, k) => [`${each.name}: ${live.start.meanings[k]}`, number(each.value), each.half_width === null ? "–" : `± ${number(each.half_width)}`]);
    const physical = (live.last?.physical ?? []).map((each) => [each.name, number(each.value), each.half_width === null || each.half_width === undefined ? "–" : `± ${number(each.half_width)}`]);
    below.replaceChildren(rows.length ? table({ header: ["Parameter", "Value", "95 %"], rows: [...rows, ...physical], caption: `${live.last.samples ?? ""} samples` }) : "",
      el("ul", {}, live.alarms.slice(0, 20).map((text) => el("li", {}, text))));
  };
  show();
  if (app.state.live.problem) below.append(el("p", { class: "problem" }, app.state.live.problem));
}
