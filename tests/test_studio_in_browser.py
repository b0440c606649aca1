"""The page of the studio in headless Chromium: from a file to a model, in two tabs, by keys, narrow, live.

With a folder in EMSID_PICTURES, the tests leave pictures of the page there, which the documentation shows.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import socket
import subprocess
import sys
import time
from base64 import b64decode
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import parse_qs, urlsplit
from urllib.request import urlopen

import numpy as np
import pytest

pytest.importorskip("selenium")
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from browser import CHROMIUM, DRIVER, chromium
from emsid.studio import uplot
from live_sessions import lines

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="needs Debian's chromium and chromium-driver"),
    pytest.mark.skipif(not uplot.is_there(), reason="needs uPlot: python -m emsid.studio.uplot"),
    pytest.mark.xdist_group("browser"),  # one browser and one server for all
]
CELLS = "return [...document.querySelectorAll('.scroll tbody tr')].map((row) => [...row.cells].map((x) => x.innerText))"
PICTURES = os.environ.get("EMSID_PICTURES")


@dataclass
class Page:
    """The page of a server in a browser."""

    browser: Any
    address: str

    def post(self, path: str, content: dict[str, Any] | None = None, body: bytes | None = None) -> Any:
        """Ask the server beside the page, as another page would."""
        sent = json.dumps(content or {}).encode() if body is None else body
        with urlopen(f"{self.address}api/{path}", sent, timeout=60) as answer:
            return json.load(answer)

    def state(self) -> dict[str, Any]:
        with urlopen(f"{self.address}api/state", timeout=60) as answer:
            found: dict[str, Any] = json.load(answer)
        return found

    def open(self, part: str) -> None:
        """Load the page anew, at one of its parts."""
        self.browser.get("about:blank")
        self.browser.get(f"{self.address}#{part}")
        self.find(f"#tab-{part}[aria-selected=true]")

    def until(self, found: Callable[[], Any], seconds: float = 60) -> Any:
        """What a function finds, as soon as that is something; elements that are replaced meanwhile are looked for."""
        waiting = WebDriverWait(self.browser, seconds, 0.05, ignored_exceptions=[WebDriverException])
        return waiting.until(lambda _: found())

    def shows(self, check: Callable[[], None]) -> None:
        """Wait until a check does not fail."""

        def holds() -> bool:
            with suppress(AssertionError):
                check()
                return True
            return False

        self.until(holds, 10)

    def find(self, selector: str, count: int = 1) -> Any:
        """The first element of a selector, once there are so many."""
        return self.until(lambda: len(self.all(selector)) >= count and self.all(selector)[0])

    def all(self, selector: str) -> list[Any]:
        found: list[Any] = self.browser.find_elements(By.CSS_SELECTOR, selector)
        return found

    def press(self, text: str) -> None:
        """Press the button with this text, once it is there."""

        def pressed() -> bool:
            self.browser.find_element(By.XPATH, f"//button[.='{text}']").click()
            return True

        self.until(pressed)

    def type(self, label: str, text: str) -> None:
        """Write into a field, and leave it."""

        def typed() -> bool:
            field = self.browser.find_element(By.CSS_SELECTOR, f"[aria-label='{label}']")
            field.clear()
            field.send_keys(text, Keys.TAB)
            return True

        self.until(typed)

    def text(self) -> str:
        return str(self.browser.find_element(By.ID, "main").text)

    def says(self, text: str, seconds: float = 60) -> None:
        self.until(lambda: text in self.text(), seconds)

    def picture(self, name: str, dark: bool = False, width: int = 1280, height: int = 900) -> None:
        """Keep a picture for the documentation."""
        if PICTURES:
            tell = self.browser.execute_cdp_cmd
            size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
            tell("Emulation.setDeviceMetricsOverride", size)
            scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
            tell("Emulation.setEmulatedMedia", {"features": [scheme]})
            time.sleep(0.5)  # plots are drawn anew in their size
            content = b64decode(tell("Page.captureScreenshot", {"format": "png"})["data"])
            (Path(PICTURES) / f"studio-{name}.png").write_bytes(content)
            tell("Emulation.clearDeviceMetricsOverride", {})
            tell("Emulation.setEmulatedMedia", {"features": []})


@contextmanager
def serving(session: Path) -> Iterator[str]:
    """A server of a session, as a user starts it; its address."""
    words = [sys.executable, "-m", "emsid", "studio", "--session", str(session), "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().split()[-1]
        finally:
            server.terminate()


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("studio") / "session"


@pytest.fixture(scope="module")
def address(session: Path) -> Iterator[str]:
    with serving(session) as found:
        yield found


@pytest.fixture(scope="module")
def downloads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("downloads")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory, downloads: Path) -> Iterator[Any]:
    profile = tmp_path_factory.mktemp("profile")
    with chromium(profile, **{"download.default_directory": str(downloads)}) as driver:
        yield driver


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Page]:
    """The page without data; what it writes to the console fails the test."""
    page = Page(browser, address)
    page.post("edit", {"files": [], "models": [], "options": {}, "unseen": 0.3})
    yield page
    assert [each["message"] for each in browser.get_log("browser")] == []


def table(rows: int = 400, other: str = "other") -> bytes:
    """A first-order motor, and a column without a meaning."""
    rng = np.random.default_rng(3)
    u, y = np.repeat(rng.uniform(-5, 5, rows // 10), 10), 0.0
    text = [f't,voltage,speed,"{other}"']
    for k in range(rows):
        noise = 0.05 * rng.standard_normal(2)
        text.append(f"{k / 100:.2f},{u[k]:.5f},{y + noise[0]:.5f},{noise[1]:.5f}")
        y = 0.9 * y + 0.5 * u[k]
    return "\n".join(text).encode()


def test_a_first_user_gets_from_a_file_to_a_comparison(
    page: Page, session: Path, downloads: Path, tmp_path: Path, command: Callable[..., int]
) -> None:
    """Load, correct a unit, mask, split, fit, compare, play, copy as command and run it, export, and reopen."""
    file = tmp_path / "log.csv"
    hostile = "<img src=x onerror=document.title=1>"
    file.write_bytes(table(other=hostile))
    page.open("data")
    page.find("#pick").send_keys(str(file))
    page.find(".uplot", 2)
    assert page.browser.title == "emsid studio"
    assert hostile in page.text()
    page.type("Unit of speed", "rpm")
    page.until(lambda: page.state()["data"]["records"][0]["channels"][1]["unit"] == "rad/s")
    page.type("From [s]", "1")
    page.type("To [s]", "1.19")
    page.press("Leave out")
    page.says("380 samples")
    page.type("From [s]", "3")
    page.press("Unseen from here on")
    page.until(lambda: page.state()["step"]["unseen"] == pytest.approx(100 / 380))
    page.picture("data", height=1300)
    page.press("Models")
    page.find("input[value=arx]").click()
    page.find("input[value=output-error]").click()
    page.find("summary").click()
    for order in ("na", "nb", "nk"):
        page.type(order, "1")
    page.press("Fit")
    page.press("Compare")
    page.find(".uplot", 2)
    page.browser.refresh()  # the run is still there
    page.until(lambda: any("y(t) =" in each.text for each in page.all("main pre")))
    (poles,) = (row[1:] for row in page.browser.execute_script(CELLS) if row[0] == "1")
    assert [float(pole) for pole in poles] == pytest.approx([0.9, 0.9], abs=0.01)
    page.picture("compare", dark=True, height=1300)
    page.press("Play")
    page.says("answered in")
    compare_sliders(page)
    page.picture("play")
    page.browser.set_window_size(500, 900)
    page.until(lambda: page.browser.execute_script("return document.documentElement.scrollWidth <= innerWidth"), 10)
    page.press("Copy as command")
    words = shlex.split(page.find("dialog textarea").get_attribute("value"))
    page.press("Close")
    assert command(*words[1:], "--out", tmp_path / "again") == 0
    run = page.state()["runs"][0]["number"]
    own, again = (read(path / "result.json") for path in (session / "runs" / run, tmp_path / "again"))
    assert (own["fits"], own["rows"]) == (again["fits"], again["rows"])
    page.press("Models")
    page.press("Export c99")
    page.until(lambda: list(downloads.glob("*c99.zip")))
    with serving(shutil.copytree(session, tmp_path / "copy")) as copy:
        page.browser.get(f"{copy}#compare")
        page.find(".uplot", 2)
        page.browser.get("about:blank")


def read(path: Path) -> Any:
    return json.loads(path.read_bytes())


def compare_sliders(page: Page) -> None:
    """Every parameter has a slider with its name, and moving one changes the answer."""
    run, model = page.state()["runs"][0]["number"], page.find("[aria-label=Model]").get_attribute("value")
    with urlopen(f"{page.address}api/runs/{run}/sliders/{model}", timeout=60) as answer:
        names = [each["name"] for each in json.load(answer)]
    assert [each.get_attribute("aria-label") for each in page.all("input[type=range]")] == names
    assert "[object" not in page.text()
    box = f"[aria-label='{names[0]} as a number']"
    before = page.find(box).get_attribute("value")
    page.find("input[type=range]").send_keys(Keys.PAGE_UP)
    assert page.find(box).get_attribute("value") != before
    page.press("As estimated")
    assert page.find(box).get_attribute("value") == before


def test_two_tabs_show_one_session_and_a_reload_in_the_middle_of_a_fit_finds_it(page: Page) -> None:
    browser, progress = page.browser, "progress"
    page.open("models")
    page.says("no data yet")
    first = browser.current_window_handle
    browser.switch_to.new_window("tab")
    page.open("models")
    page.says("no data yet")
    second = browser.current_window_handle
    page.post("example", {"name": "motor"})
    page.find("#fit")
    browser.switch_to.window(first)  # it was told too
    page.press("Fit")
    page.find(progress)
    browser.refresh()
    page.find(progress)
    browser.switch_to.window(second)
    page.press("Cancel")
    page.until(lambda: not page.all(progress))
    number = page.state()["runs"][0]["number"]
    assert f"Run {number}: " in page.text()
    browser.switch_to.window(first)
    page.until(lambda: not page.all(progress))
    assert f"Run {number}: " in page.text()
    browser.switch_to.window(second)
    browser.close()
    browser.switch_to.window(first)


def test_eight_tabs_share_one_stream_of_messages(page: Page) -> None:
    """A browser opens six connections to one server; the tab that listens may be closed."""
    browser = page.browser
    first = browser.current_window_handle
    page.open("models")
    page.says("no data yet")
    for _ in range(7):
        browser.switch_to.new_window("tab")
        page.open("models")
        page.says("no data yet", 10)
    others = [handle for handle in browser.window_handles if handle != first]
    keeper = others.pop()
    page.post("edit", {"unseen": 0.4})
    page.post("example", {"name": "motor"})
    for handle in (first, *others):
        browser.switch_to.window(handle)
        page.find("#fit")
        assert page.find("[aria-label='Part kept unseen']").get_attribute("value") == "0.4"
    for handle in (first, *others):
        browser.switch_to.window(handle)
        browser.close()
    browser.switch_to.window(keeper)
    page.find("#fit")
    page.post("edit", {"files": []})
    page.says("no data yet", 10)


def test_a_refused_change_draws_the_page_anew(page: Page) -> None:
    tell = page.browser.execute_cdp_cmd
    tell("Network.enable", {})
    tell("Network.setBlockedURLs", {"urls": ["*/api/events"]})  # this page learns nothing of other changes
    try:
        page.post("example", {"name": "motor"})
        page.open("models")
        page.find("#fit")
        page.post("edit", {"unseen": 0.45})
        number = len(page.state()["runs"])
        page.type("Part kept unseen", "0.2")
        page.press("Fit")
        page.until(lambda: "has changed meanwhile" in page.find("#message").text, 10)
        page.until(lambda: page.find("[aria-label='Part kept unseen']").get_attribute("value") == "0.45", 10)
        assert (len(page.state()["runs"]), page.state()["step"]["unseen"]) == (number, 0.45)
    finally:
        tell("Network.setBlockedURLs", {"urls": []})
        page.open("data")
        page.browser.get_log("browser")  # of the requests that were blocked and refused


def test_a_result_of_other_data_is_called_so(page: Page) -> None:
    page.post("files?name=log.csv", body=table())
    page.post("edit", {"models": ["arx"], "options": {"na": "1", "nb": "1", "nk": "1"}})
    number = page.post("run")["run"]
    page.until(lambda: page.state()["runs"][0]["state"] == "done")
    page.open("models")
    page.find(f"[aria-label='Run {number}'] table")
    assert "Not a result of the present data" not in page.find(f"[aria-label='Run {number}']").text
    name = page.state()["step"]["files"][0]
    page.post("brush", {"kind": "mask", "file": name, "first": 1.0, "last": 1.5})
    page.until(lambda: "different: mask" in page.find(f"[aria-label='Run {number}']").text)
    page.open("compare")
    page.says("different: mask")
    page.post("undo")
    page.until(lambda: "different:" not in page.text())


def test_arrows_change_the_part_and_keep_the_focus_on_its_tab(page: Page) -> None:
    page.open("data")
    chosen = []
    page.browser.execute_script("document.getElementById('tab-data').focus()")
    for key in (Keys.ARROW_RIGHT, Keys.END, Keys.ARROW_RIGHT, Keys.ARROW_LEFT, Keys.HOME):
        page.browser.switch_to.active_element.send_keys(key)
        found = page.browser.switch_to.active_element
        assert found.get_attribute("aria-selected") == "true"
        assert len(page.all("[role=tab][tabindex='0']")) == 1
        chosen.append(found.get_attribute("id").removeprefix("tab-"))
    assert chosen == ["models", "live", "data", "live", "data"]


def test_arrows_move_a_plot_and_the_others_with_it(page: Page) -> None:
    page.post("files?name=log.csv", body=table())
    page.open("data")
    page.find(".uplot", 2)
    asked = "return performance.getEntriesByType('resource').map((each) => each.name)"

    def drawn(first: float, last: float) -> None:
        """Wait until this part of both channels is drawn."""
        names = [name for name in page.browser.execute_script(asked) if "/window?" in name][-2:]
        parts = [parse_qs(urlsplit(name).query) for name in names]
        assert {part["channel"][0] for part in parts} == {"voltage", "speed"}
        assert [float(part[end][0]) for part in parts for end in ("from", "to")] == pytest.approx([first, last] * 2)

    for key, first, last in (("+", 0.9975, 2.9925), (Keys.ARROW_RIGHT, 1.49625, 3.49125), ("0", 0, 3.99)):
        page.find(".plot").send_keys(key)
        page.shows(partial(drawn, first, last))


@contextmanager
def source() -> Iterator[str]:
    """A port that sends a first-order motor whose gain falls to half in the middle, faster than it would run."""
    listener, content = (
        socket.create_server(("127.0.0.1", 0)),
        lines(4000, step=3000, dt=0.01).splitlines(keepends=True),
    )

    def send() -> None:
        with suppress(OSError):
            connection = listener.accept()[0]
            with connection:
                for k in range(0, len(content), 50):
                    connection.sendall(b"".join(content[k : k + 50]))
                    time.sleep(0.01)
                time.sleep(60)  # the board is quiet, and still there

    Thread(target=send, daemon=True).start()
    with listener:
        yield f"socket://127.0.0.1:{listener.getsockname()[1]}"


def test_a_running_source_is_followed_with_parameters_and_alarms(page: Page, session: Path) -> None:
    page.open("live")
    with source() as address:
        page.type("Source", address)
        page.type("na", "1")
        page.type("nb", "1")
        page.press("Follow")
        page.says("4000 samples")
        rows = page.browser.execute_script(CELLS)
        page.picture("live")
        page.press("Stop")
        page.says("the source has ended")
    assert {name: float(value) for name, value, _ in rows} == {
        "a1": pytest.approx(-0.9, abs=0.03),
        "b1": pytest.approx(0.1, abs=0.01),
        "static gain over the range of the input": pytest.approx(1.0, abs=0.2),
        "time constant": pytest.approx(0.0949, rel=0.2),
    }
    assert "has changed" in page.text()
    written = {path.name for path in next(session.glob("live-*")).iterdir()}
    assert {"report.html", "log.txt"} <= written
