"""The page of the studio in headless Chromium: from a file to a model, in two tabs, by keys, narrow, live.

With a folder in EMSID_PICTURES, the tests leave pictures of the page there, which the documentation shows.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tarfile
import time
from base64 import b64decode
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest

pytest.importorskip("selenium")
from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait

from emsid.studio import uplot
from live_sessions import lines

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="needs Debian's chromium and chromium-driver"),
    pytest.mark.skipif(not uplot.is_there(), reason="needs uPlot: python -m emsid.studio.uplot"),
    pytest.mark.xdist_group("browser"),  # one browser and one server for all
]
FLAGS = (
    "headless no-sandbox disable-gpu disable-quic no-first-run disable-background-networking "
    "disable-component-update disable-sync hide-scrollbars"
)
ROWS = "[...document.querySelectorAll('#stage .scroll tbody tr')]"
CELLS = f"return {ROWS}.map((row) => [...row.cells].map((x) => x.innerText))"
PICTURES = os.environ.get("EMSID_PICTURES")


@dataclass
class Page:
    """The page of a server in a browser."""

    browser: Any
    address: str
    narrow: bool = False

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

        def found() -> Any:
            there = self.all(selector)
            return len(there) >= count and there[0]

        return self.until(found)

    def all(self, selector: str) -> list[Any]:
        found: list[Any] = self.browser.find_elements(By.CSS_SELECTOR, selector)
        return found

    def attribute(self, selector: str, name: str) -> Any:
        """An attribute of an element, which may be drawn anew meanwhile."""
        return self.until(lambda: [self.find(selector).get_attribute(name)])[0]

    def send(self, selector: str, *keys: str) -> None:
        """Send keys, or the name of a file, to an element, which may be drawn anew meanwhile."""

        def sent() -> bool:
            self.find(selector).send_keys(*keys)
            return True

        self.until(sent)

    def press(self, text: str) -> None:
        """Press the button with this text, once it is there."""

        def pressed() -> bool:
            self.browser.find_element(By.XPATH, f"//button[.='{text}']").click()
            return True

        self.until(pressed)

    def click(self, selector: str) -> None:
        """Click on an element, once it is there."""

        def clicked() -> bool:
            self.browser.find_element(By.CSS_SELECTOR, selector).click()
            return True

        self.until(clicked)

    def leave(self) -> None:
        """Close every tab but one, end what runs, and forget what the browser wrote."""
        for handle in self.browser.window_handles[1:]:
            self.browser.switch_to.window(handle)
            self.browser.close()
        self.browser.switch_to.window(self.browser.window_handles[0])
        self.browser.get("about:blank")  # the page would ask for what is removed
        self.post("live/stop")

        def ended() -> bool:
            going = [run["number"] for run in self.state()["runs"] if run["state"] in ("running", "waiting")]
            for number in going:
                self.post("cancel", {"run": number})  # a second time, at once
            return not going and not self.state()["live"]["running"]

        self.until(ended)
        self.browser.get_log("browser")

    def share(self, selector: str, x: float, y: float = 0.5) -> tuple[int, int]:
        """A point of an element that is brought into view, as pixels of the window."""
        script = "arguments[0].scrollIntoView({block: 'center'}); return arguments[0].getBoundingClientRect().toJSON()"
        box = self.browser.execute_script(script, self.find(selector))
        return int(box["x"] + x * box["width"]), int(box["y"] + y * box["height"])

    def drag(self, begin: tuple[int, int], end: tuple[int, int]) -> None:
        """Press the mouse at a point of the window, move it to another one and release it."""
        mouse = ActionChains(self.browser, 50).w3c_actions
        move = mouse.pointer_action
        move.move_to_location(*begin).pointer_down()
        for k in (1, 2, 3):
            move.move_to_location(*(round(a + (b - a) * k / 3) for a, b in zip(begin, end, strict=True)))
        move.pointer_up()
        mouse.perform()

    def drawn(self) -> dict[str, float]:
        """The part that was asked for last, without the room on both sides."""
        asked = self.browser.execute_script("return window.asked.at(-1) ?? null")
        assert asked is not None
        room = (asked["to"] - asked["from"]) / 6
        return {"first": asked["from"] + room, "last": asked["to"] - room}

    def open_all(self) -> None:
        """Open every section of the settings."""
        self.browser.execute_script("document.querySelectorAll('#side details').forEach((x) => { x.open = true })")

    def refused(self) -> None:
        """The console says that requests were refused, and nothing else."""
        assert all("400 (Bad Request)" in each["message"] for each in self.browser.get_log("browser"))

    def type(self, label: str, text: str) -> None:
        """Write into a field, and leave it."""

        def typed() -> bool:
            field = self.browser.find_element(By.CSS_SELECTOR, f"[aria-label='{label}']")
            if not field.is_displayed():  # its section came after the others were opened
                self.open_all()
            field.send_keys(Keys.CONTROL + "a" + Keys.NULL, text, Keys.TAB)  # clearing it would be a change of its own
            return True

        self.until(typed)

    def text(self) -> str:
        return str(self.browser.find_element(By.ID, "panel").text)

    def says(self, text: str, seconds: float = 60) -> None:
        self.until(lambda: text in self.text(), seconds)

    def choose(self, label: str, value: str) -> None:
        """Choose in a menu."""

        def chosen() -> bool:
            Select(self.browser.find_element(By.CSS_SELECTOR, f"[aria-label='{label}']")).select_by_value(value)
            return True

        self.until(chosen)

    def size(self, width: int, height: int, dark: bool = False) -> None:
        """Give the page a size; narrow ones are those of a telephone."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        self.narrow = width < 500

    def fits(self) -> None:
        """Nothing of the page lies beside the window."""
        self.until(lambda: self.browser.execute_script("return document.documentElement.scrollWidth <= innerWidth"), 10)

    def picture(self, name: str, dark: bool = False, width: int = 1280, height: int = 900) -> None:
        """Keep a picture for the documentation."""
        if PICTURES and not self.narrow:
            self.size(width, height, dark)
            time.sleep(1.5)  # plots are drawn anew in their size
            content = b64decode(self.browser.execute_cdp_cmd("Page.captureScreenshot", {"format": "png"})["data"])
            (Path(PICTURES) / f"studio-{name}.png").write_bytes(content)
            self.size(1280, 900)


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
    options = webdriver.ChromeOptions()
    for flag in FLAGS.split():
        options.add_argument(f"--{flag}")
    options.add_argument(f"--user-data-dir={tmp_path_factory.mktemp('profile')}")
    options.add_experimental_option("prefs", {"download.default_directory": str(downloads)})
    options.binary_location = str(CHROMIUM)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(str(DRIVER), env=dict(os.environ)))
    yield driver
    driver.quit()


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Page]:
    """The page without data; what it writes to the console fails the test, and nothing of it is left for the next."""
    page = Page(browser, address)
    page.leave()
    page.size(1280, 900)
    nothing = {"files": [], "unseen_files": [], "other_files": [], "models": [], "options": {}, "unseen": 0.3}
    page.post("edit", nothing)
    yield page
    said = [each["message"] for each in browser.get_log("browser")]
    page.leave()
    assert said == []


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


ASKED = """window.asked = [];
    const before = window.fetch;
    window.fetch = (path, options) => {
        if (/api.(window|pairs)/.test(path)) asked.push(JSON.parse(options.body));
        return before(path, options);
    };"""
"""Keeps what the page asks for, to see which part of the data it draws."""


def read(path: Path) -> Any:
    return json.loads(path.read_bytes())


def finished(page: Page, count: int = 1) -> dict[str, Any]:
    """The last run, once all of so many have ended."""

    def ended() -> Any:
        runs = page.state()["runs"]
        return len(runs) >= count and all(run["state"] not in ("running", "waiting") for run in runs) and runs[0]

    run: dict[str, Any] = page.until(ended, 120)
    return run


@pytest.mark.parametrize("width", [1280, 390])
def test_a_first_user_gets_from_a_file_to_a_model_elsewhere(
    page: Page, width: int, downloads: Path, tmp_path: Path
) -> None:
    """Own file, role and unit, mask by mouse, filter, two fits, cancel, unseen file, views, exports, reload, tab."""
    page.size(width, 900)
    file, other = tmp_path / f"log{width}.csv", tmp_path / f"unseen{width}.csv"
    hostile = "<img src=x onerror=document.title=1>"
    file.write_bytes(table(other=hostile))
    other.write_bytes(table(300, other=hostile))
    runs = len(page.state()["runs"])
    page.open("data")
    page.says("Or begin with an example")
    page.picture("first")
    page.send("#pick-files", str(file))
    page.find(".uplot", 2)
    page.fits()
    assert page.browser.title == "emsid studio"
    assert hostile in page.text()
    page.type("Unit of speed", "rpm")
    page.until(lambda: page.state()["records"][0]["channels"][1]["unit"] == "rad/s")
    page.choose(f"Role of {hostile}", "input")
    page.until(lambda: page.state()["records"][0]["inputs"] == 2)
    page.choose(f"Role of {hostile}", "")
    page.until(lambda: page.state()["records"][0]["inputs"] == 1)
    time.sleep(1)  # the plots of the last correction are there
    page.press("Select")
    plot = page.find(".u-over", 2)
    page.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", plot)
    span = plot.size["width"]
    drag = ActionChains(page.browser, 50).move_to_element_with_offset(plot, -span // 4, 0).click_and_hold()
    drag.move_by_offset(span // 20, 0).move_by_offset(span // 20, 0).release().perform()
    page.until(lambda: float(page.attribute("[aria-label='From [s]']", "value")) > 0.3)
    page.press("Leave out")
    page.until(lambda: 340 <= page.state()["records"][0]["samples"] <= 370)
    page.open_all()
    page.type("Filter [Hz]", "fast")  # it is not taken, and stays to be corrected
    page.press("Apply")
    page.until(lambda: page.attribute("[aria-label='Filter [Hz]']", "aria-invalid") == "true")
    assert page.attribute("[aria-label='Filter [Hz]']", "value") == "fast"
    page.type("Filter [Hz]", "20")
    assert page.attribute("[aria-label='Filter [Hz]']", "aria-invalid") is None
    page.press("Apply")
    page.until(lambda: next(iter(page.state()["step"]["given"].values())).get("filter") == 20)
    page.picture("data")
    page.press("Undo")
    page.until(lambda: "filter" not in next(iter(page.state()["step"]["given"].values())))
    page.refused()  # also by the preview of what was typed
    page.press("Models")
    both = "document.querySelectorAll('input[value=arx], input[value=output-error]').forEach((each) => each.click())"
    page.find("input[value=output-error]")
    page.browser.execute_script(both)  # faster than the server answers: no change is lost
    page.until(lambda: {*page.state()["step"]["models"]} == {"arx", "output-error"})
    page.open_all()
    for order in ("na", "nb", "nk"):
        page.type(order, "1")
    page.until(lambda: page.state()["step"]["options"] == {"na": 1, "nb": 1, "nk": 1})
    page.fits()
    page.press("Fit")
    assert finished(page, runs + 1)["state"] == "done"
    page.find("#stage .card table")
    page.picture("models")
    page.post("edit", {"models": ["wiener-hammerstein"], "options": {}})  # as another tab does; this one follows
    page.until(lambda: page.find("input[value=wiener-hammerstein]").is_selected())
    page.press("Fit")
    page.press("Cancel")
    assert finished(page, runs + 2)["state"] in ("done", "failed", "ended")
    page.press("Data")
    page.open_all()
    page.send("#pick-unseen_files", str(other))
    page.until(lambda: page.state()["step"]["unseen_files"] == [other.name])
    page.press("Compare")
    number = page.state()["runs"][1]["number"]
    wanted = {f"arx (run {number})", f"output-error (run {number})"}
    of_run = {model["id"] for model in page.state()["models"] if model["run"] == number}

    def chosen() -> bool:
        boxes = page.all(".chosen input")
        other = [box for box in boxes if box.is_selected() is not (box.get_attribute("value") in of_run)]
        for box in other[:1]:
            box.click()  # the list is sorted anew as errors arrive, which may move another box there
        return bool(boxes) and not other

    page.until(chosen)
    page.find("#shown .uplot", 2)
    page.says("Free run on " + other.name)
    page.picture("compare", dark=True)
    for view in ("Bode", "Step", "Poles", "Correlation", "Parameters"):
        page.press(view)

        def overlaid() -> bool:
            legend = page.browser.find_element(By.CSS_SELECTOR, "#shown > .legend").text
            return all(name in legend for name in wanted)

        page.until(overlaid)
        page.fits()
        if view == "Bode":
            page.find("#shown .uplot", 3)  # magnitude, phase, and the coherence of the data
            page.picture("bode")
    page.press("Use")
    page.find("#stage .uplot", 2)
    page.says("answered in")
    page.fits()
    page.choose("Input", "step")
    page.picture("use")
    for format in ("c99", "fmu"):
        before = len(list(downloads.glob(f"*{format}*.zip")))
        page.choose("Format", format)
        page.press("Export")
        page.until(lambda format=format, before=before: len(list(downloads.glob(f"*{format}*.zip"))) > before)
    page.browser.refresh()
    page.until(lambda: page.find("#tab-use[aria-selected=true]"))
    page.find("#stage .uplot", 2)
    first = page.browser.current_window_handle
    page.browser.switch_to.new_window("tab")
    page.open("compare")
    page.find("#shown .uplot", 2)
    page.browser.close()
    page.browser.switch_to.window(first)


def test_what_is_copied_repeats_a_fit(page: Page, tmp_path: Path) -> None:
    page.post("files?name=log.csv", body=table())
    page.post("edit", {"models": ["arx"], "options": {"na": "1", "nb": "1", "nk": "1"}})
    page.post("run")
    run = finished(page)
    page.open("models")
    page.press("Copy as Python")
    script = tmp_path / "fit.py"
    script.write_text(page.attribute("dialog textarea", "value"), "utf-8")
    page.press("Close")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=True)
    assert "arx" in done.stdout
    page.open("compare")
    page.find("#shown .uplot", 2)
    page.click("[aria-label='Copy the comparison as Python']")
    script.write_text(page.attribute("dialog textarea", "value"), "utf-8")
    page.press("Close")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=True)
    assert "Comparison" in done.stdout or "arx" in done.stdout
    assert run["state"] == "done"


@pytest.fixture(scope="module")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The program that looks for what people who cannot see or use a mouse would miss."""
    folder = tmp_path_factory.mktemp("axe")
    try:
        subprocess.run(
            ["npm", "pack", "axe-core@4.10.3", "-s"], cwd=folder, check=True, capture_output=True, timeout=120
        )
    except (OSError, subprocess.SubprocessError):
        pytest.skip("needs npm and its registry")
    with tarfile.open(next(folder.glob("*.tgz"))) as package:
        member = package.extractfile("package/axe.min.js")
        assert member is not None
        return member.read().decode()


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_axe_finds_nothing_in_any_part(page: Page, axe: str, dark: bool) -> None:
    page.open("data")
    violations = []
    found = "const done = arguments[0]; axe.run().then((x) => done(x.violations.map((v) => [v.id, v.nodes[0].html])))"

    def look(what: str) -> None:
        time.sleep(1)
        page.open_all()
        page.browser.execute_script(axe)
        violations.extend(f"{what}: {name} {html}" for name, html in page.browser.execute_async_script(found))

    page.size(1280, 900, dark)
    look("first screen")
    page.post("example", {"name": "motor"})
    page.post("edit", {"models": ["arx", "output-error"], "options": {"na": "1", "nb": "1", "nk": "1"}})
    page.post("run")
    finished(page)
    for part in ("data", "models", "compare", "use", "live"):
        page.open(part)
        look(part)
    page.open("compare")
    for view in ("Bode", "Poles", "Parameters"):
        page.press(view)
        page.find("#shown > .legend")
        look(view)
    assert not violations, "\n".join(violations)


def test_keys_alone_lead_from_an_example_to_a_view(page: Page) -> None:
    page.open("data")
    page.says("Or begin with an example")

    def focused() -> list[str | None]:
        """The names of the control that has the focus; it may be drawn anew meanwhile."""
        found = page.browser.switch_to.active_element
        return [found.get_attribute("aria-label"), found.get_attribute("value"), found.text]

    def reach(name: str, key: str) -> None:
        """Move the focus with Tab until it is on a control, and press a key there."""
        for _ in range(150):
            ActionChains(page.browser).send_keys(Keys.TAB).perform()
            if name in page.until(focused):
                ActionChains(page.browser).send_keys(key).perform()
                return
        raise AssertionError(f"{name} is not reached")

    reach("motor with a dead zone", Keys.ENTER)
    page.find(".uplot", 2)
    reach("Data", Keys.ARROW_RIGHT)
    reach("arx", Keys.SPACE)
    page.until(lambda: page.state()["step"]["models"] == ["arx"])
    page.until(lambda: page.browser.switch_to.active_element.get_attribute("value") == "arx")  # it is where it was
    page.browser.execute_script("document.getElementById('tab-models').focus()")
    reach("Fit", Keys.ENTER)
    finished(page)
    page.find("#stage .card table")
    reach("Models", Keys.ARROW_RIGHT)
    page.find("#shown .uplot", 2)
    reach("Free run", Keys.END)
    page.find("#shown > .legend")
    assert page.browser.switch_to.active_element.text == "Parameters"


def test_drafts_scroll_and_zoom_survive_what_another_page_does(page: Page) -> None:
    page.post("files?name=log.csv", body=table())
    page.open("data")
    page.find(".uplot", 2)

    def typed() -> bool:
        page.open_all()  # once the look is there, which has the field
        page.browser.find_element(By.CSS_SELECTOR, "[aria-label='Filter [Hz]']").send_keys("12")
        return True

    page.until(typed)
    page.browser.execute_script("document.getElementById('side').scrollTop = 200")
    page.send(".plot", "+")
    page.click("[aria-label='Filter [Hz]']")
    page.post("edit", {"unseen": 0.41})
    page.until(
        lambda: page.browser.execute_script("return document.activeElement.getAttribute('aria-label')") == "Filter [Hz]"
    )
    value = "return document.querySelector(\"[aria-label='Filter [Hz]']\").value"  # at once, as the page is drawn anew
    assert page.browser.execute_script(value) == "12"
    assert page.browser.execute_script("return document.getElementById('side').scrollTop") >= 200
    page.press("Models")
    page.until(lambda: page.attribute("[aria-label='Part kept unseen']", "value") == "0.41")
    page.press("Data")
    assert page.attribute("[aria-label='Filter [Hz]']", "value") == "12"
    page.press("Discard")
    page.until(lambda: page.attribute("[aria-label='Filter [Hz]']", "value") == "")


def test_a_page_says_that_the_server_is_gone_and_comes_back_with_it(page: Page, tmp_path: Path) -> None:
    with serving(tmp_path / "s") as address:
        page.browser.get(f"{address}#data")
        page.says("Or begin with an example")
    page.until(lambda: page.find("#gone").is_displayed())
    with serving(tmp_path / "s") as again:
        assert again == address
        page.until(lambda: not page.find("#gone").is_displayed(), 20)
        with urlopen(f"{again}api/example", json.dumps({"name": "axis"}).encode(), timeout=60):
            page.find(".uplot", 2)
        page.browser.get("about:blank")
    page.browser.get_log("browser")  # of the connections that were refused


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
        assert page.attribute("[aria-label='Part kept unseen']", "value") == "0.4"
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
        field = "[aria-label='Part kept unseen']"
        page.until(lambda: page.attribute(field, "aria-invalid") == "true", 10)
        assert page.attribute(field, "value") == "0.2"  # what was typed stays, to be given again
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
    page.until(lambda: "different: mask" not in page.text())


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
    page.browser.execute_script(ASKED)

    def drawn(first: float, last: float) -> None:
        """Wait until this part of both channels is asked for, with a quarter more on both sides."""
        asked = page.browser.execute_script("return asked")[-2:]
        assert {each["columns"][0] for each in asked} == {"voltage", "speed"}
        room = (last - first) / 4
        ends = [float(each[end]) for each in asked for end in ("from", "to")]
        assert ends == pytest.approx([first - room, last + room] * 2)

    for key, first, last in (("+", 0.9975, 2.9925), (Keys.ARROW_RIGHT, 1.49625, 3.49125), ("0", 0, 3.99)):
        page.send(".plot", key)
        page.shows(partial(drawn, first, last))
    plot = page.find(".u-over")
    ActionChains(page.browser).scroll_from_origin(ScrollOrigin.from_element(plot), 0, -400).perform()
    page.until(lambda: page.browser.execute_script("return asked.at(-1).to - asked.at(-1).from") < 4)


def test_the_wheel_zooms_about_the_cursor_and_a_drag_moves_and_selects(page: Page) -> None:
    page.post("files?name=log.csv", body=table())
    page.open("data")
    page.find(".uplot", 2)
    page.browser.execute_script(ASKED)
    x, y = page.share(".u-over", 0.25)
    wheel = ScrollOrigin.from_viewport(x, y)
    ActionChains(page.browser).scroll_from_origin(wheel, 0, -400).perform()
    zoomed = 3.99 / np.e
    first = 0.25 * (3.99 - zoomed)  # what is below the cursor stays there
    near = partial(pytest.approx, abs=0.02)
    page.shows(lambda: _equal(page.drawn(), {"first": near(first), "last": near(first + zoomed)}))
    page.drag(page.share(".u-over", 0.5), page.share(".u-over", 0.3))
    first += 0.2 * zoomed
    page.shows(lambda: _equal(page.drawn(), {"first": near(first), "last": near(first + zoomed)}))
    page.press("Select")
    page.drag(page.share(".u-over", 0.2), page.share(".u-over", 0.6))
    ends = [near(first + 0.2 * zoomed), near(first + 0.6 * zoomed)]
    boxes = [page.find(f"[aria-label='{name} [s]']") for name in ("From", "To")]
    page.shows(lambda: _equal([float(box.get_attribute("value")) for box in boxes], ends))


def _equal(found: Any, wanted: Any) -> None:
    assert found == wanted


def test_the_edge_of_the_unseen_part_is_dragged(page: Page) -> None:
    page.post("files?name=log.csv", body=table())
    page.open("data")
    page.find(".uplot", 2)
    page.drag(page.share(".u-over", 0.7), page.share(".u-over", 0.5))
    page.until(lambda: page.state()["step"]["unseen"] == pytest.approx(0.5, abs=0.02))
    page.press("Undo")
    page.until(lambda: page.state()["step"]["unseen"] == 0.3)


def test_a_dataset_is_dragged_to_what_it_is_used_for(page: Page) -> None:
    for name in ("first", "second"):
        page.post(f"files?name={name}.csv", body=table())
    page.post("edit", {"files": (names := page.state()["step"]["files"])})
    page.open("data")
    page.find(".group li", 2)
    for kind, list_ in (("unseen", "unseen_files"), ("not used", "other_files"), ("to fit", "files")):

        def moved(kind: str = kind, list_: str = list_) -> bool:
            if names[1] not in page.state()["step"][list_]:
                item = page.find(f".group li:has([aria-label='Use {names[1]}'])")
                ActionChains(page.browser, 100).drag_and_drop(item, page.find(f"[aria-label='Data {kind}']")).perform()
            return names[1] in page.find(f"[aria-label='Data {kind}']").text

        page.until(moved)
    assert page.state()["step"]["files"] == names


def test_show_at_a_finding_leads_to_its_mark(page: Page) -> None:
    lines_ = table(2000).decode().splitlines()
    gone = lines_[:1501] + lines_[1561:]
    page.post("files?name=gap.csv", body="\n".join(gone).encode())
    page.open("data")
    page.find(".uplot", 2)
    page.browser.execute_script(ASKED)
    page.click("[aria-label='Show gap in the plot']")
    page.shows(lambda: _equal(page.drawn()["first"] < 15.0 < 15.6 < page.drawn()["last"], True))
    assert page.drawn()["last"] - page.drawn()["first"] < 2.0
    assert page.find(".marks [aria-pressed=true]").text == "gap × 1"


def test_a_column_is_plotted_against_another_and_a_further_one_beside(page: Page) -> None:
    page.post("files?name=log.csv", body=table())
    page.open("data")
    page.find(".uplot", 2)
    page.click("[aria-label='Plot other']")
    page.find(".uplot", 3)
    page.browser.execute_script(ASKED)
    page.choose("x axis", "voltage")
    page.until(lambda: len(page.all(".uplot")) == 1)
    page.until(
        lambda: page.browser.execute_script("return asked.filter((each) => each.columns[0] === 'voltage').length") == 2
    )
    assert page.find("#stage .legend").text.split("\n") == ["speed", "other"]
    page.choose("x axis", "")
    page.find(".uplot", 3)


def test_what_is_compared_prints_on_one_page(page: Page) -> None:
    page.post("files?name=log.csv", body=table())
    page.post("edit", {"models": ["arx", "output-error"], "options": {"na": "1", "nb": "1", "nk": "1"}})
    page.post("run")
    finished(page)
    page.open("compare")
    page.find("#shown table")
    for view, count in (("Free run", 2), ("Bode", 2), ("Parameters", 0)):
        page.press(view)
        page.until(lambda view=view: page.attribute("#shown", "aria-labelledby") is not None)
        page.until(
            lambda count=count: len(page.all("#shown .uplot")) >= count and page.all("#shown .legend, #shown table")
        )
        time.sleep(0.5)
        shown = b64decode(page.browser.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})["data"])
        assert shown.count(b"/Type /Page\n") == 1, view
        if PICTURES:
            (Path(PICTURES) / f"print-{view}.pdf").write_bytes(shown)


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
        plot = page.find("[aria-label='Output over time']")

        def shown() -> list[float]:
            return [float(word) for word in str(plot.get_attribute("aria-description")).split()[1::2]]

        first, last = shown()
        plot.send_keys("+")
        zoomed = pytest.approx([first + (last - first) / 4, last - (last - first) / 4], rel=1e-4)
        page.until(lambda: shown() == zoomed)
        time.sleep(1.5)  # it is drawn anew every second, and stays where it is
        assert shown() == zoomed
        page.press("Stop")
        page.says("the source has ended")
        alarms = page.text()
        page.press("Fit this record")
        page.until(lambda: page.state()["step"]["files"] == ["record.csv"])
    assert {name: float(value) for name, value, _ in rows} == {
        "a1": pytest.approx(-0.9, abs=0.03),
        "b1": pytest.approx(0.1, abs=0.01),
        "static gain over the range of the input [rad/(s*V)]": pytest.approx(1.0, abs=0.2),
        "time constant [s]": pytest.approx(0.0949, rel=0.2),
    }
    assert "has changed" in alarms
    written = {path.name for path in next(session.glob("live-*")).iterdir()}
    assert {"report.html", "log.txt"} <= written
