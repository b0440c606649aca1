// The page: its tabs, the state from the server, and what it announces.
import { events, get, post } from "./api.js";
import { attempt, button, el, fill, message, tabs } from "./dom.js";
import * as data from "./data.js";
import * as models from "./models.js";
import * as compare from "./compare.js";
import * as use from "./use.js";
import * as live from "./live.js";

const PARTS = { data, models, compare, use, live };
const NAMES = { data: "Data", models: "Models", compare: "Compare", use: "Use", live: "Live" };
const COPIES = { "copy-command": "command", "copy-python": "script" };
const at = (id) => document.getElementById(id);
const hash = () => (location.hash.slice(1) in PARTS ? location.hash.slice(1) : "data");
export const app = { state: null, catalogue: null, part: hash(), known: {}, go, draw, refresh, stage: at("stage") };
let built = null, close = () => {}, asked = 0, taken = 0;

async function refresh() {
  app.catalogue ??= await get("catalogue");
  const mine = ++asked, state = await get("state");
  if (mine < taken) return;  // a later answer came before
  taken = mine;
  app.state = state;
  at("gone").hidden = true;
  draw();
}

function go(part) {
  app.part = part;
  history.replaceState(null, "", `#${part}`);
  draw();
}

// What is dragged stays where it is until it is dropped.
let held = false, late = false;
app.hold = (on) => { held = on; if (!on && late) draw(); };

// The settings are drawn anew; the plots only where something else is to be seen.
function draw() {
  late = held;
  if (held) return;
  const { state } = app, part = PARTS[app.part];
  fill(at("tabs"), tabs("", NAMES, app.part, go, "tab").map((tab) => { tab.setAttribute("aria-controls", "panel"); return tab; }));
  at("panel").setAttribute("aria-labelledby", `tab-${app.part}`);
  at("undo").disabled = !state.undo;
  at("redo").disabled = !state.redo;
  for (const [id, what] of Object.entries(COPIES)) at(id).disabled = !state[what];
  fill(at("side"), state.problem ? el("p", { class: "problem", role: "alert" }, state.problem) : null, part.side(app));
  const [key, build] = part.stage(app);
  if (built === `${app.part} ${key}`) return;
  built = `${app.part} ${key}`;
  close();
  close = () => {};
  at("stage").replaceChildren();
  at("stage").scrollTop = 0;
  const mine = built;
  attempt(async () => {
    const done = await build(app.stage, () => built === mine);
    if (typeof done !== "function") return;
    if (built === mine) close = done; else done();
  });
}

app.rebuild = () => { built = null; draw(); };

function announced(news) {
  if (news.kind === "state") attempt(refresh);
  else if (news.kind === "live") live.message(app, news.message);
  else if (news.kind === "run" && app.state) {
    const before = app.state.runs.find((run) => run.number === news.run.number);
    const changed = !before || before.state !== news.run.state || before.models.length !== news.run.models.length;
    app.state.runs = [{ stale: before?.stale ?? [], ...news.run }, ...app.state.runs.filter((run) => run.number !== news.run.number)]
      .sort((a, b) => b.number - a.number);
    if (changed) attempt(refresh);
    else app.progress?.(news.run);
  }
}

export async function copy(text) {
  const box = el("textarea", { readOnly: true, rows: 8, cols: 90, value: text, "aria-label": "Text to copy" });
  const dialog = el("dialog", { class: "card", "aria-label": "Copied text" }, el("p", {}, "Copied; here it is to select by hand:"), box,
    el("div", { class: "row" }, button("Close", () => dialog.close())));
  document.body.append(dialog);
  dialog.addEventListener("close", () => dialog.remove());
  dialog.showModal();
  box.select();
  try { await navigator.clipboard.writeText(text); } catch { document.execCommand("copy"); }
}

for (const what of ["undo", "redo"]) at(what).addEventListener("click", () => attempt(() => post(what)));
for (const [id, what] of Object.entries(COPIES)) at(id).addEventListener("click", () => copy(app.state[what]));
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || /^(input|textarea)$/i.test(event.target.tagName)) return;
  const what = { z: "undo", y: "redo" }[event.key];
  if (what) { event.preventDefault(); attempt(() => post(what)); }
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => app.state && app.rebuild());
let size = [innerHeight, innerWidth > 800], soon = 0;  // plots fill the height that there is
window.addEventListener("resize", () => {
  clearTimeout(soon);
  soon = setTimeout(() => {
    const now = [innerHeight, innerWidth > 800], other = Math.abs(now[0] - size[0]) > 80 || now[1] !== size[1];
    if (other) size = now;
    if (other && app.state) app.rebuild();
  }, 300);
});
window.addEventListener("stale", () => attempt(refresh, "The session has changed meanwhile. Look at it and do it again."));
window.addEventListener("hashchange", () => app.state && hash() !== app.part && go(hash()));
const gone = () => { at("gone").hidden = false; live.lost(); };
window.addEventListener("gone", gone);
events(announced, () => attempt(async () => { await refresh(); app.rebuild(); }, "connected again"), gone);
attempt(refresh).then(() => app.state || message("the server does not answer; start emsid studio again", true));
