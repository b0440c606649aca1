// Elements made from data: text is always text, never markup.

export function el(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "class") element.className = value;
    else if (key in element && key !== "list" && key !== "form") element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export function message(text, bad = false) {
  const place = document.getElementById("message");
  place.textContent = text;
  place.classList.toggle("bad", bad);
}

// Do what a control asks for; an error is shown in words.
export async function attempt(work, done = "") {
  try {
    await work();
    message(done);
  } catch (problem) {
    message(problem.message, true);
  }
}

export function table(part, className = () => "") {
  const head = part.header.map((text) => el("th", { scope: "col" }, text));
  const texts = part.texts ?? 1;
  const rows = part.rows.map((row) =>
    el("tr", { class: className(row) }, row.map((cell, k) => el("td", { class: k < texts ? "" : "number" }, `${cell}`))));
  const caption = part.caption ? el("caption", {}, part.caption) : null;
  return el("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": part.caption || "table" },
    el("table", {}, caption, el("thead", {}, el("tr", {}, head)), el("tbody", {}, rows)),
    part.note ? el("p", { class: "quiet" }, part.note) : null);
}

export function number(x) {
  return x === null || x === undefined ? "–" : Number(Number(x).toPrecision(4)).toString();
}
