"""The page of the studio in headless Chromium: from an example to a model, with the keyboard and on a phone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("selenium")
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from emsid.studio import uplot

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="needs Debian's chromium and chromium-driver"),
    pytest.mark.skipif(not uplot.is_there(), reason="needs uPlot: python -m emsid.studio.uplot"),
]
FLAGS = (
    "headless no-sandbox disable-gpu disable-quic no-first-run disable-background-networking "
    "disable-component-update disable-sync"
)


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    words = [sys.executable, "-m", "emsid", "studio", "--session", str(tmp_path / "session"), "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield server.stdout.readline().split()[-1]
        server.terminate()


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    for flag in FLAGS.split():
        options.add_argument(f"--{flag}")
    options.add_argument(f"--user-data-dir={tmp_path / 'profile'}")
    options.binary_location = str(CHROMIUM)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(str(DRIVER), env=dict(os.environ)))
    yield driver
    driver.quit()


def test_a_first_user_gets_from_a_file_to_a_comparison(address: str, browser: Any, tmp_path: Path) -> None:
    def until(found: Any, seconds: float = 60) -> Any:
        return WebDriverWait(browser, seconds).until(found)

    def button(text: str) -> Any:
        return until(lambda d: d.find_element(By.XPATH, f"//main//button[.='{text}']"))

    file = tmp_path / "log.csv"
    rows = [(k / 100, 3.0 if k // 25 % 2 else -2.0 + k // 100) for k in range(400)]
    y, lines = 0.0, ["t,voltage,<img src=x onerror=document.title=1>"]
    for t, u in rows:
        lines.append(f"{t:.2f},{u},{y:.5f}")
        y = 0.9 * y + 0.5 * u
    file.write_text("\n".join(lines))
    browser.get(address)
    until(lambda d: d.find_element(By.ID, "pick")).send_keys(str(file))
    until(lambda d: len(d.find_elements(By.CSS_SELECTOR, ".uplot")) == 2)
    assert browser.title == "emsid studio"
    browser.find_element(By.ID, "tab-models").click()
    until(lambda d: d.find_element(By.XPATH, "//input[@value='arx']")).click()
    browser.find_element(By.ID, "fit").click()
    button("Compare").click()
    until(lambda d: len(d.find_elements(By.CSS_SELECTOR, ".uplot")) == 2)
    browser.refresh()  # the run is still there
    until(lambda d: d.find_element(By.XPATH, "//main//pre[contains(., 'y(t)')]"))
    browser.find_element(By.ID, "tab-play").click()
    until(lambda d: "answered in" in d.find_element(By.ID, "main").text)
    browser.set_window_size(500, 900)
    until(lambda d: d.execute_script("return document.documentElement.scrollWidth <= window.innerWidth"), 10)
    assert [each["message"] for each in browser.get_log("browser")] == []
