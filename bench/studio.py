"""The studio measured in a browser: ``python bench/studio.py [examples] [rows] [live]``; needs Debian's Chromium.

========  ============================================================================================================
examples  from the click on an example of the first screen to its plots, in a server that has just started
rows      a record of two million rows: its upload; wheel, drag and keys from the event to the picture; edits
live      ten minutes of a running source (``live=600`` seconds): memory of the server and of the page, after a
          collection of what it does not use any more
========  ============================================================================================================

Wall times are those of the page: from the time stamp of an event to the first picture after it, and to the one that
has the samples of the new window. Beside them stands the processor time of the server.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

HOME = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(HOME / "tests"))

from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402

from arguments import asked_parts  # noqa: E402
from browser import chromium  # noqa: E402

ROWS = 2_000_000
QUIET = 0.4
"""Seconds without a request and without a picture after which a change is drawn completely."""
WATCH = """
window.seen = {events: [], paints: [], answers: [], open: 0};
for (const kind of ["wheel", "pointermove", "keydown", "click", "change"])
  addEventListener(kind, (event) => seen.events.push(event.timeStamp), true);
const pictures = CanvasRenderingContext2D.prototype, stroke = pictures.stroke;
let waiting = false;
pictures.stroke = function (...more) {
  if (!waiting) {
    waiting = true;
    requestAnimationFrame(() => {
      const after = new MessageChannel();
      after.port1.onmessage = () => { waiting = false; seen.paints.push(performance.now()); };
      after.port2.postMessage(0);
    });
  }
  return stroke.apply(this, more);
};
const before = window.fetch;
window.fetch = async (path, options) => {
  seen.open++;
  try { return await before(path, options); } finally { seen.open--; seen.answers.push([path, performance.now()]); }
};
"""


@dataclass
class Studio:
    """A server and a browser with its page."""

    browser: Any
    address: str
    process: subprocess.Popen[str]

    def run(self, script: str, *arguments: Any) -> Any:
        return self.browser.execute_script(script, *arguments)

    def until(self, found: Callable[[], Any], seconds: float = 300) -> Any:
        """What a function finds, as soon as that is something."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            with suppress(Exception):
                if value := found():
                    return value
            time.sleep(0.02)
        raise TimeoutError

    def find(self, selector: str) -> Any:
        return self.until(lambda: self.browser.find_element(By.CSS_SELECTOR, selector))

    @property
    def cpu(self) -> float:
        """Processor time of the server and of its processes, in s."""
        words = Path(f"/proc/{self.process.pid}/stat").read_text("utf-8").rpartition(")")[2].split()
        return sum(map(int, words[11:15])) / os.sysconf("SC_CLK_TCK")

    @property
    def memory(self) -> float:
        """Resident memory of the server, in MB."""
        text = Path(f"/proc/{self.process.pid}/status").read_text("utf-8")
        return int(text.partition("VmRSS:")[2].split()[0]) / 1024

    @property
    def heap(self) -> tuple[float, int]:
        """Memory of the page after a collection in MB, and the number of its elements."""
        self.browser.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
        rows = self.browser.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
        found = {row["name"]: row["value"] for row in rows}
        return found["JSHeapUsedSize"] / 2**20, int(found["Nodes"])

    def measured(self, what: str, work: Callable[[], Any], least: int = 1) -> list[float]:
        """Do something and print when the page is drawn: first, and completely; in ms from its first event."""
        self.run("Object.assign(seen, {events: [], paints: [], answers: []})")
        cpu = self.cpu
        work()
        self.until(lambda: self.run("return seen.paints.length && seen.answers.length") >= least)
        since = "performance.now() - Math.max(...seen.paints, ...seen.answers.map((x) => x[1]))"
        settled = f"return !seen.open && {since} > {1000 * QUIET}"
        self.until(lambda: self.run(settled))
        seen = self.run("return seen")
        begun = min(seen["events"])
        paints = [each - begun for each in seen["paints"] if each >= begun]
        drawn = [at for path, at in seen["answers"] if path.startswith(("api/window", "api/pairs"))]
        last = min((each for each in seen["paints"] if each >= max(drawn, default=begun)), default=np.nan) - begun
        spent = self.cpu - cpu
        print(
            f"{what:32s} first picture {min(paints):6.0f} ms, all of it {last:6.0f} ms; server {spent:5.2f} s",
            flush=True,
        )
        return [min(paints), last]


@contextmanager
def studio() -> Iterator[Studio]:
    """A new session in a browser."""
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-m", "emsid", "studio", "--session", f"{folder}/session", "--no-browser"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            address = process.stdout.readline().split()[-1]
            try:
                with chromium(Path(folder) / "profile") as browser:
                    browser.set_window_size(1280, 900)
                    browser.execute_cdp_cmd("Performance.enable", {})
                    browser.get(f"{address}#data")
                    browser.execute_script(WATCH)
                    yield Studio(browser, address, process)
            finally:
                process.terminate()


def examples() -> None:
    """The time to the plots of each example."""
    with studio() as page:
        names = [
            each.text for each in page.until(lambda: page.browser.find_elements(By.CSS_SELECTOR, ".examples button"))
        ]
    for name in names:
        with studio() as page:
            button = page.until(
                lambda page=page, name=name: next(
                    x for x in page.browser.find_elements(By.CSS_SELECTOR, ".examples button") if x.text == name
                )
            )
            page.measured(name, button.click)


def write_rows(path: Path) -> None:
    """A record of `ROWS` rows of a first-order motor: time, voltage, current and speed."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-5, 5, ROWS // 100), 100)
    y = lfilter([0, 0.5], [1, -0.98], u) + 0.05 * rng.standard_normal(ROWS)
    i = 0.3 * u - 0.01 * y + 0.02 * rng.standard_normal(ROWS)
    values = np.column_stack([np.arange(ROWS) / 1000, u, i, y])
    np.savetxt(path, values, ["%.3f", *["%.4f"] * 3], ",", header="t,voltage,current,speed", comments="")


def rows() -> None:
    """Two million rows."""
    with tempfile.TemporaryDirectory() as folder, studio() as page:
        file = Path(folder) / "rows.csv"
        write_rows(file)
        print(f"a file of {file.stat().st_size / 1e6:.0f} MB; load average {os.getloadavg()[0]:.1f}")
        page.measured("upload", lambda: page.find("#pick-files").send_keys(str(file)), 3)

        def looked() -> Any:
            return page.run("return document.querySelector('.findings') && !document.querySelector('#side h2 .quiet')")

        begun, cpu = time.monotonic(), page.cpu
        page.until(looked)
        passed, spent = time.monotonic() - begun, page.cpu - cpu
        print(f"{'its look is there after further':32s} {passed:5.1f} s; server {spent:5.1f} s, {page.memory:.0f} MB")
        waits: dict[str, list[float]] = {}

        def event(what: str, work: Callable[[], Any]) -> None:
            waits.setdefault(what.split()[0], []).append(page.measured(what, work)[1])

        plot = page.find(".u-over")
        origin = ScrollOrigin.from_element(plot)
        for k, by in enumerate([-120, -400, -400, -800, -1600, -1600, 400, 3200]):
            event(f"wheel {k}", lambda by=by: ActionChains(page.browser, 0).scroll_from_origin(origin, 0, by).perform())
        for key in ("+", "+", "+", Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, "-", "0"):
            event(f"key {key!r}", lambda key=key: page.find(".plot").send_keys(key))
        page.find(".plot").send_keys("+")
        time.sleep(1)
        for by in (-150, 200, 300):
            event(
                f"drag by {by} pixels",
                lambda by=by: (
                    ActionChains(page.browser, 0)
                    .move_to_element(plot)
                    .click_and_hold()
                    .move_by_offset(by, 0)
                    .release()
                    .perform()
                ),
            )
        for what, each in waits.items():
            print(f"{what}: all of it after {min(each):.0f} to {max(each):.0f} ms, median {np.median(each):.0f}")
        page.find(".plot").send_keys("0")
        page.run("document.querySelectorAll('#side details').forEach((x) => { x.open = true })")
        typed = lambda label, *text: page.find(f"[aria-label='{label}']").send_keys(*text)  # noqa: E731
        typed("From [s]", Keys.CONTROL + "a" + Keys.NULL, "100")
        typed("To [s]", Keys.CONTROL + "a" + Keys.NULL, "200", Keys.TAB)
        press = lambda text: page.browser.find_element(By.XPATH, f"//button[.='{text}']").click()  # noqa: E731
        edits: list[tuple[str, Callable[[], Any]]] = [
            ("edit: filter typed (preview)", lambda: typed("Filter [Hz]", "50")),
            ("edit: filter applied", lambda: press("Apply")),
            ("edit: undo", lambda: press("Undo")),
            ("edit: mask by mouse", lambda: press("Leave out")),
            ("edit: unit", lambda: typed("Unit of speed", Keys.CONTROL + "a" + Keys.NULL, "rpm", Keys.TAB)),
            ("edit: split", lambda: press("Unseen from here on")),
            ("edit: another column plotted", lambda: page.find("[aria-label='Plot current']").click()),
        ]
        for what, work in edits:
            page.measured(what, work)
        begun, cpu = time.monotonic(), page.cpu
        page.until(looked, 600)
        passed, spent = time.monotonic() - begun, page.cpu - cpu
        print(f"{'the look at the last edit':32s} {passed:5.1f} s; server {spent:5.1f} s, {page.memory:.0f} MB")


PARTS: dict[str, Callable[..., None]] = {"examples": examples, "rows": rows}


def live(seconds: float = 600) -> None:
    """A source of 200 samples a second, followed for some minutes."""
    import socket
    from threading import Thread

    listener, dt = socket.create_server(("127.0.0.1", 0)), 0.005

    def send() -> None:
        rng, y, k, u = np.random.default_rng(3), 0.0, 0, 0.0
        with suppress(OSError):
            connection = listener.accept()[0]
            connection.sendall(b"n,t[s],u[V],y[rad/s]\n")
            begun = time.monotonic()
            while True:
                while k * dt < time.monotonic() - begun:
                    u = rng.uniform(-1, 1) if k % 10 == 0 else u
                    connection.sendall(b"%d,%.4f,%.5f,%.6f\n" % (k, dt * k, u, y))
                    y = 0.9 * y + 0.2 * u + 0.01 * rng.standard_normal()
                    k += 1
                time.sleep(0.02)

    Thread(target=send, daemon=True).start()
    with studio() as page:
        page.find("#tab-live").click()
        for label, text in {"Source": f"socket://127.0.0.1:{listener.getsockname()[1]}", "na": "1", "nb": "1"}.items():
            page.find(f"[aria-label='{label}']").send_keys(text)
        page.until(lambda: page.browser.find_element(By.XPATH, "//button[.='Follow']")).click()
        page.find("#stage table")
        begun, rows = time.monotonic(), []
        while (passed := time.monotonic() - begun) < seconds:
            heap, nodes = page.heap
            rows.append([passed, page.memory, heap, nodes])
            said = page.find("#stage [role=status]").text
            print(
                f"{passed:5.0f} s   server {page.memory:6.1f} MB   page {heap:5.2f} MB, {nodes} nodes   {said}",
                flush=True,
            )
            time.sleep(min(30, seconds / 10))
        half = np.array(rows)[len(rows) // 2 :]
        for what, column, unit in (("server", 1, "MB"), ("page", 2, "MB"), ("nodes", 3, "")):
            slope = np.polyfit(half[:, 0], half[:, column], 1)[0] * 600
            first, last = half[0, column], half[-1, column]
            print(f"{what}: {first:.1f} {unit} in the middle, {last:.1f} at the end, {slope:+.2f} in ten minutes")


PARTS["live"] = live

if __name__ == "__main__":
    for part in asked_parts(__doc__, PARTS):
        name, _, value = part.partition("=")
        PARTS[name](*([float(value)] if value else []))
