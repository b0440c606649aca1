// Requests to the server, relative to the address of the page, which contains the token.

const shown = { version: null };

async function checked(response) {
  if (response.status === 409) window.dispatchEvent(new Event("stale"));
  if (!response.ok) throw new Error(await response.text() || `the server answered ${response.status}`);
  return response;
}

export async function get(path) {
  const found = await (await checked(await fetch(`api/${path}`))).json();
  if (path === "state") shown.version = found.version;
  return found;
}

export async function post(path, content = {}) {
  const body = JSON.stringify(content);
  const headers = shown.version === null ? {} : { "If-Match": `${shown.version}` };
  const found = await (await checked(await fetch(`api/${path}`, { method: "POST", body, headers }))).json();
  shown.version = found?.version ?? shown.version;
  return found;
}

export async function upload(file, unseen) {
  const address = `api/files?name=${encodeURIComponent(file.name)}&unseen=${unseen ? 1 : 0}`;
  await checked(await fetch(address, { method: "POST", body: file }));
}

// Signals as binary windows: [ends: 2 float64], count: uint32, then float32 times from `first` on and one row a signal.
// uPlot draws a gap where a value is null.
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

export async function binary(path, content) {
  const options = content ? { method: "POST", body: JSON.stringify(content) } : {};
  return (await checked(await fetch(`api/${path}`, options))).arrayBuffer();
}

// Messages from the server. A browser opens few connections to one server, so one tab, which holds a lock, listens and
// passes messages on to the others; as it closes, the next one gets the lock. `null` says that messages may be missing.
export function events(onMessage, onReturn) {
  const name = `emsid ${location.pathname}`, others = new BroadcastChannel(name);
  const take = (message) => (message === null ? onReturn() : onMessage(message));
  const pass = (message) => { take(message); others.postMessage(message); };
  others.onmessage = (event) => take(event.data);
  let waited = true;
  navigator.locks.request(name, { ifAvailable: true }, (lock) => { if (lock) { waited = false; return listen(); } return null; })
    .then(() => waited && navigator.locks.request(name, listen));

  function listen() {
    const source = new EventSource("api/events");
    let lost = waited;
    source.onmessage = (event) => pass(JSON.parse(event.data));
    source.onerror = () => { lost = true; };
    source.onopen = () => { if (lost) { lost = false; pass(null); } };
    return new Promise(() => {});  // until this tab is closed
  }
}
