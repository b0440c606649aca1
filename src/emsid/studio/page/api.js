// Requests to the server, relative to the address of the page, which contains the token.

// The state that is shown, and the version that the page's own changes have made since. Of answers that overtake each
// other the newest counts, except `anew`: after a refusal, and from a server that is back and counts from 0.
const shown = { state: null, version: null, anew: true };

async function checked(response) {
  if (response.status === 409) { shown.anew = true; window.dispatchEvent(new Event("stale")); }
  if (!response.ok) throw new Error(await response.text() || `the server answered ${response.status}`);
  return response;
}

async function ask(path, options) {
  try {
    return await checked(await fetch(`api/${path}`, options));
  } catch (problem) {
    if (!(problem instanceof TypeError)) throw problem;
    shown.anew = true;
    window.dispatchEvent(new Event("gone"));
    throw new Error("the server does not answer");
  }
}

export async function get(path) {
  const found = await (await ask(path)).json();
  if (path !== "state") return found;
  if (!shown.anew && found.version < shown.version) return shown.state;
  Object.assign(shown, { state: found, version: found.version, anew: false });
  return found;
}

// A change, made on the version that is shown. Changes of this page wait for each other, as one can leave fields faster
// than the server answers; content that depends on the step is a function of it.
let last = Promise.resolve();
export function post(path, content = {}) {
  const work = last.then(async () => {
    const depends = typeof content === "function", known = shown.state?.version === shown.version;
    const body = JSON.stringify(depends ? await content((known ? shown.state : await get("state")).step) : content);
    const headers = shown.version === null ? {} : { "If-Match": `${shown.version}` };
    const found = await (await ask(path, { method: "POST", body, headers })).json();
    shown.version = found?.version ?? shown.version;
    return found;
  });
  last = work.catch(() => {});
  return work;
}

// Questions and orders that change no step.
const sent = (path, content) => ask(path, { method: "POST", body: JSON.stringify(content) });
export const question = async (path, content) => (await sent(path, content)).json();
export const binary = async (path, content) => (await sent(path, content)).arrayBuffer();

export async function upload(file, place, kind) {
  await ask(`${place}?${new URLSearchParams({ name: file.name, kind })}`, { method: "POST", body: file });
}

// Save what the server answers as a file.
export async function save(path, content, name) {
  const response = content ? await sent(path, content) : await ask(path);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await response.blob());
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

// Signals as binary windows: [ends: 2 float64], count: uint32, then float32 times from `first` on and one row a signal.
// A gap is where a value is null.
export function unpack(buffer, first, withEnds) {
  const ends = withEnds ? [...new Float64Array(buffer.slice(0, 16))] : null, start = withEnds ? 16 : 0;
  const begin = first ?? ends[0], rows = [];
  const count = new Uint32Array(buffer.slice(start, start + 4))[0];
  for (let at = start + 4; count && at < buffer.byteLength; at += 4 * count) {
    rows.push(Array.from(new Float32Array(buffer.slice(at, at + 4 * count)), (x) => (Number.isNaN(x) ? null : x)));
  }
  const [t = [], ...values] = rows;
  return { ends, t: t.map((x) => x + begin), rows: values };
}

// Messages from the server. A browser opens few connections to one server, so one tab, which holds a lock, listens and
// passes messages on to the others; as it closes, the next one gets the lock. `null` says that messages may be missing,
// "gone" that the server does not answer.
export function events(onMessage, onReturn, onGone) {
  const name = `emsid ${location.pathname}`, others = new BroadcastChannel(name);
  const take = (message) => (message === null ? (shown.anew = true, onReturn()) : message === "gone" ? onGone() : onMessage(message));
  const pass = (message) => { take(message); others.postMessage(message); };
  others.onmessage = (event) => take(event.data);
  let waited = true, lost = false;
  navigator.locks.request(name, { ifAvailable: true }, (lock) => { if (lock) { waited = false; return listen(); } return null; })
    .then(() => waited && navigator.locks.request(name, () => { lost = true; return listen(); }));

  function connect() {
    const source = new EventSource("api/events");
    source.onmessage = (event) => pass(JSON.parse(event.data));
    source.onerror = () => {
      if (!lost) pass("gone");
      lost = true;
      if (source.readyState === EventSource.CLOSED) setTimeout(connect, 1000);
    };
    source.onopen = () => { if (lost) { lost = false; pass(null); } };
  }

  function listen() {
    connect();
    return new Promise(() => {});  // until this tab is closed
  }
}
