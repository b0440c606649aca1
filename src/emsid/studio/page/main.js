// The page: its tabs, the state from the server, and what it announces.
import { events, get, post } from "./api.js";
import { attempt, el, message } from "./dom.js";
import { showData } from "./data.js";
import { showModels } from "./models.js";
import { showCompare } from "./compare.js";
import { showPlay } from "./play.js";
import { liveMessage, showLive } from "./live.js";

const PARTS = { data: ["Data", showData], models: ["Models", showModels], compare: ["Compare", showCompare],
  play: ["Play", showPlay], live: ["Live", showLive] };
const COPIES = { "copy-command": "command", "copy-python": "script" };
export const app = { state: null, part: location.hash.slice(1) in PARTS ? location.hash.slice(1) : "data", refresh, go, close: () => {} };

async function refresh() {
  app.state = await get("state");
  draw();
}

window.addEventListener("stale", () => attempt(refresh, "The session has changed meanwhile. Look at it and do it again."));

function go(part) {
  app.part = part;
  history.replaceState(null, "", `#${part}`);
  draw();
  document.getElementById("main").focus();
}

// Arrows, Home and End show the neighbouring, first and last part, and keep the focus on its tab.
function tabKey(event, part) {
  const names = Object.keys(PARTS), at = names.indexOf(part);
  const next = { ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: names.length - 1 }[event.key];
  if (next === undefined) return;
  event.preventDefault();
  go(names[(next + names.length) % names.length]);
  document.getElementById(`tab-${app.part}`).focus();
}

function draw() {
  const { state } = app;
  const tabs = Object.entries(PARTS).map(([part, [title]]) => el("button", {
    role: "tab", id: `tab-${part}`, "aria-selected": `${part === app.part}`, "aria-controls": "main",
    tabIndex: part === app.part ? 0 : -1, onclick: () => go(part), onkeydown: (event) => tabKey(event, part) }, title));
  const focused = document.activeElement?.id;
  document.getElementById("tabs").replaceChildren(...tabs);
  if (focused?.startsWith("tab-")) document.getElementById(focused)?.focus();
  document.getElementById("undo").disabled = !state.undo;
  document.getElementById("redo").disabled = !state.redo;
  for (const [id, what] of Object.entries(COPIES)) document.getElementById(id).disabled = !state[what];
  app.close();
  app.close = () => {};
  const main = document.getElementById("main");
  main.setAttribute("aria-labelledby", `tab-${app.part}`);
  main.replaceChildren();
  if (state.problem) main.append(el("p", { class: "problem", role: "alert" }, state.problem));
  (PARTS[app.part] ?? PARTS.data)[1](main, app);
}

function announced(news) {
  if (news.kind === "state") attempt(refresh);
  else if (news.kind === "live") liveMessage(news.message);
  else if (news.kind === "run" && app.state) {
    const before = app.state.runs.find((run) => run.number === news.run.number);
    const changed = !before || before.state !== news.run.state || before.models.length !== news.run.models.length;
    app.state.runs = [{ stale: before?.stale ?? [], ...news.run }, ...app.state.runs.filter((run) => run.number !== news.run.number)]
      .sort((a, b) => b.number - a.number);
    if (changed && ["models", "compare", "play"].includes(app.part)) draw();
    else app.progress?.(news.run);
  }
}

async function copy(text) {
  const box = el("textarea", { readOnly: true, rows: 6, cols: 90, value: text, "aria-label": "Text to copy" });
  const dialog = el("dialog", { class: "card" }, el("p", {}, "Copied; here it is to select by hand:"), box,
    el("div", { class: "row" }, el("button", { onclick: () => dialog.close() }, "Close")));
  document.body.append(dialog);
  dialog.addEventListener("close", () => dialog.remove());
  dialog.showModal();
  box.select();
  try { await navigator.clipboard.writeText(text); } catch { document.execCommand("copy"); }
}

for (const what of ["undo", "redo"]) document.getElementById(what).addEventListener("click", () => attempt(() => post(what)));
for (const [id, what] of Object.entries(COPIES)) document.getElementById(id).addEventListener("click", () => copy(app.state[what]));
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || /^(input|textarea)$/i.test(event.target.tagName)) return;
  const what = { z: "undo", y: "redo" }[event.key];
  if (what) { event.preventDefault(); attempt(() => post(what)); }
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => app.state && draw());
events(announced, () => attempt(refresh, "connected again"));
attempt(refresh).then(() => app.state || message("the server does not answer; start emsid studio again", true));
