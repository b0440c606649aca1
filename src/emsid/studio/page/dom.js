// Elements made from data: text is always text, never markup. What is typed survives a redraw until it is taken.

export function el(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === null || value === undefined) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "class") element.className = value;
    else if (key in element && key !== "list" && key !== "form") element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false && child !== ""));
  return element;
}

export function message(text, bad = false) {
  const place = document.getElementById("message");
  place.textContent = text;
  place.classList.toggle("bad", bad);
}

// Do what a control asks for; an error is shown in words. Work that takes long is said to go on.
export async function attempt(work, done = "") {
  const slow = setTimeout(() => message("working …"), 400);
  try {
    await work();
    message(done);
    return true;
  } catch (problem) {
    message(problem.message, true);
    return false;
  } finally {
    clearTimeout(slow);
  }
}

export const button = (text, work, more = {}) => el("button", { type: "button", onclick: () => attempt(work), ...more }, text);

export const select = (label, value, options, work, more = {}) => el("select", { "aria-label": label, onchange: (event) => attempt(() => work(event.target.value)), ...more },
  options.map((option) => {
    const [name, text] = Array.isArray(option) ? option : [option, option];
    return el("option", { value: name, selected: `${name}` === `${value}` }, text);
  }));

export const labelled = (text, control) => el("label", { class: "field" }, el("span", {}, text), control);

// What was typed and is not taken yet, and why it was refused, by the key of its field.
export const drafts = new Map(), refused = new Map(), taking = new Set();

// A field whose text is taken as it is left; text that is refused stays, marked, with the reason below it.
export function field(key, label, value, take, { about = "", type = "input", list = null, now = null, ...more } = {}) {
  const why = el("span", { class: "problem", id: `why ${key}`.replaceAll(" ", "-") });
  const box = el(type, { value: drafts.get(key) ?? `${value ?? ""}`, "aria-label": label, title: about, list, ...more });
  const mark = () => {
    why.textContent = refused.get(key) ?? "";
    box.classList.toggle("draft", drafts.has(key));
    if (refused.has(key)) { box.setAttribute("aria-invalid", "true"); box.setAttribute("aria-describedby", why.id); } else box.removeAttribute("aria-invalid");
  };
  box.addEventListener("input", () => { drafts.set(key, box.value); refused.delete(key); mark(); now?.(box.value); });
  box.addEventListener("change", async () => {
    if (!take) return;
    const text = box.value.trim(), work = take(text);
    taking.add(work);
    try {
      await work;
      if (box.value.trim() === text) drafts.delete(key);
      refused.delete(key);
    } catch (problem) { refused.set(key, problem.message); }
    taking.delete(work);
    mark();
  });
  mark();
  return el("label", { class: "field" }, el("span", {}, label), box, why);
}

// Sections that can be closed stay as they were left.
const opened = new Map();
export function details(title, open, ...children) {
  const box = el("details", { open: opened.get(title) ?? open }, el("summary", {}, title), children);
  // The event "toggle" would come after a redraw that is already waiting, which would close it again.
  new MutationObserver(() => opened.set(title, box.open)).observe(box, { attributes: true, attributeFilter: ["open"] });
  return box;
}

// Put other children into a place; focus, caret and scroll stay where they were.
export function fill(place, ...children) {
  const name = (element) => element.getAttribute?.("aria-label") || element.textContent;
  const active = place.contains(document.activeElement) ? document.activeElement : null, called = active && name(active);
  const caret = active && "selectionStart" in active ? [active.selectionStart, active.selectionEnd] : null, top = place.scrollTop;
  place.replaceChildren(...el("div", {}, children).childNodes);
  place.scrollTop = top;
  const again = active && [...place.querySelectorAll(active.tagName)].find((element) => name(element) === called);
  again?.focus({ preventScroll: true });
  if (caret && again) try { again.setSelectionRange(...caret); } catch { /* a kind of field without a caret */ }
}

export function table(part, className = () => "") {
  const head = part.header.map((text) => el("th", { scope: "col" }, text));
  const texts = part.texts ?? 1;
  const rows = part.rows.map((row) =>
    el("tr", { class: className(row) }, row.map((cell, k) => el("td", { class: k < texts ? "" : "number" }, cell instanceof Node ? cell : `${cell}`))));
  const caption = part.caption ? el("caption", {}, part.caption) : null;
  return el("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": part.caption || part.header.join(", ") },
    el("table", {}, caption, el("thead", {}, el("tr", {}, head)), el("tbody", {}, rows)),
    part.note ? el("p", { class: "quiet" }, part.note) : null);
}

export function number(x, digits = 4) {
  if (x === null || x === undefined || !Number.isFinite(Number(x))) return "–";
  return Number(Number(x).toPrecision(digits)).toString();
}

export const withUnit = (name, unit) => (unit && unit !== "1" && !name.includes(`[${unit}]`) ? `${name} [${unit}]` : name);

// Tabs inside a part: arrows, Home and End choose, and the focus stays on the chosen one.
export function tabs(label, names, chosen, choose, id = "view") {
  const all = Object.entries(names);
  const key = (event, k) => {
    const next = { ArrowRight: k + 1, ArrowLeft: k - 1, Home: 0, End: all.length - 1 }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    const name = all[(next + all.length) % all.length][0];
    choose(name);
    document.getElementById(`${id}-${name}`)?.focus();
  };
  return all.map(([name, text], k) => el("button", { role: "tab", type: "button", id: `${id}-${name}`, "aria-selected": `${name === chosen}`,
    tabIndex: name === chosen ? 0 : -1, onclick: () => choose(name), onkeydown: (event) => key(event, k) }, text));
}
