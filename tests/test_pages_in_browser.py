"""Pages in headless Chromium: their width on a phone, what stands first, their print, darkness and motion."""

from __future__ import annotations

import re
from base64 import b64decode
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import emsid
from browser import CHROMIUM, DRIVER, chromium
from emsid.controllers.verb import compensated
from emsid.experiment_design import design
from emsid.fleets.page import fleet_report
from emsid.report.control_page import compensation_report
from emsid.report.design_page import design_report
from emsid.report.document import Report, Section
from emsid.report.identification_page import report
from emsid.report.page import page
from emsid.report.views.analysis import model_figures
from live_sessions import lines, tracked
from test_report_palette import contrast

pytest.importorskip("selenium")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="needs Debian's chromium and chromium-driver"),
    pytest.mark.xdist_group("browser"),
]
LONG = "a_very_long_name_of_a_channel_of_the_second_axis_of_the_machine_without_a_blank"
PAPER = re.compile(rb"/Type\s*/Page\b")


def motor(seed: int, samples: int = 800) -> emsid.Record:
    """The speed of a rigid motor at random steps of voltage, with noise and long names."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-10, 10, samples // 20), 20)
    plant = emsid.plants.rigid_motor().with_values({"rotor_friction.coulomb": 8e-3})
    y = emsid.simulate(plant, u, dt=0.005).output[:, 0] + 0.05 * rng.standard_normal(samples)
    names = ((f"{LONG}_voltage",), (f"{LONG}_speed",))
    return emsid.Record(u, y, 0.005, *names, ("V",), ("rad/s",), name=f"{LONG}-{seed}.csv")


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Report]:
    """A page of every kind, the names in it as long as nobody should write them."""
    free = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")
    options = emsid.Options(free=free, fixed={"R": 2.0}, na=1, nb=1, nk=1)
    found = emsid.identify(motor(5), motor(6), models=("arx", "friction-narx", "rigid-motor"), options=options)
    fits = list(found.fits)
    plant = next(fit for fit in fits if fit.model_name == "rigid-motor")
    session, _ = tracked(lines(600).replace(b"u[V]", f"{LONG}[V]".encode()), folder=tmp_path_factory.mktemp("log"))
    from emsid.report.tracking_page import tracking_report

    shown = Section("", figures=model_figures(fits, [(0.0, 5.0)], found.unseen))
    return {
        "identify": report(found),
        "show": Report(LONG, (LONG,), (), opening=shown),
        "compensate": compensation_report(*compensated(plant.model, dt=0.005)),
        "design": design_report(design(plant, limit=6.0, duration=2.0, dt=0.005)),
        "track": tracking_report(session),
        "fleet": fleet_report(emsid.Fleet(()), LONG),
    }


@pytest.fixture(scope="module")
def pages(reports: dict[str, Report], tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The address of every page."""
    folder = tmp_path_factory.mktemp("pages")
    for name, each in reports.items():
        (folder / f"{name}.html").write_text(page(each), "utf-8")
    return {name: (folder / f"{name}.html").as_uri() for name in reports}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with chromium(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


@pytest.fixture
def screen(browser: Any) -> Iterator[Any]:
    """Open an address on a screen of a width, with media features and for a medium."""

    def opened(address: str, width: int = 1280, media: str = "", **features: str) -> None:
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        named = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media, "features": named})
        browser.get(address)

    yield opened
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})


@pytest.mark.parametrize("name", ["identify", "show", "compensate", "design", "track", "fleet"])
def test_a_page_is_no_wider_than_a_phone_and_has_no_empty_figure(
    name: str, pages: dict[str, str], browser: Any, screen: Any
) -> None:
    screen(pages[name], width=390)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    empty = "return [...document.querySelectorAll('.area svg')].filter((each) => !each.querySelector('path')).length"
    assert browser.execute_script(empty) == 0


def test_the_verdict_stands_first_then_the_free_run_on_unseen_data(
    reports: dict[str, Report], pages: dict[str, str], browser: Any, screen: Any
) -> None:
    screen(pages["identify"])
    top = "return document.querySelector(arguments[0]).getBoundingClientRect().top"
    order = ["h1", "p.lead", "figure", ".facts", "nav", "section h2"]
    places = [browser.execute_script(top, each) for each in order]
    assert places == sorted(places)
    assert browser.execute_script("return document.querySelector('figure').id") == "best-free-run"
    assert browser.execute_script(top, "figure") < 900
    lead = browser.execute_script("return document.querySelector('p.lead').textContent")
    assert lead.replace("\N{NO-BREAK SPACE}", " ") == reports["identify"].summary[0]
    drawn = browser.execute_script("return [...document.querySelectorAll('figure')].map((each) => each.id)")
    assert {"steps-and-poles", "frequency-response", "front"} <= set(drawn)
    titles = (
        "return [...document.querySelectorAll('#frequency-response .y.axis-title')].map((each) => each.textContent)"
    )
    assert browser.execute_script(titles) == ["Magnitude [dB]", "Phase [deg]", "Coherence [–]"]


def test_a_unit_stands_once_in_a_title(pages: dict[str, str], browser: Any, screen: Any) -> None:
    screen(pages["identify"])
    titles = browser.execute_script(
        "return [...document.querySelectorAll('.axis-title, h3, th')].map((each) => each.textContent)"
    )
    assert titles
    assert not [each for each in titles if re.search(r"\[([^\]]+)\].*\[\1\]", each)]


def test_a_print_is_white_and_short_and_covers_nothing(pages: dict[str, str], browser: Any, screen: Any) -> None:
    screen(pages["identify"], width=700, media="print", prefers_color_scheme="dark")
    grounds = (
        "return ['html', 'body', 'header', '.notices li', '.table', 'tr:not(.best) td'].map((each) => "
        "getComputedStyle(document.querySelector(each)).backgroundColor)"
    )
    assert set(browser.execute_script(grounds)) <= {"rgb(255, 255, 255)", "rgba(0, 0, 0, 0)"}
    wide = (
        "return [...document.querySelectorAll('table')].filter((each) => "
        "each.getBoundingClientRect().right > innerWidth + 1).length"
    )
    assert browser.execute_script(wide) == 0
    over = (
        "return [...document.querySelectorAll(':has(> .scroll)')].map((each) => ['::before', '::after'].map((edge) => "
        "getComputedStyle(each, edge)).some((style) => style.content !== 'none' && style.display !== 'none'))"
    )
    assert not any(browser.execute_script(over))
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    a4 = {"paperWidth": 8.27, "paperHeight": 11.69, "printBackground": True}
    printed = b64decode(browser.execute_cdp_cmd("Page.printToPDF", a4)["data"])
    assert len(PAPER.findall(printed)) <= 9  # of three models, with long names


def test_texts_contrast_in_the_dark(pages: dict[str, str], browser: Any, screen: Any) -> None:
    screen(pages["identify"], prefers_color_scheme="dark")
    found = browser.execute_script(
        """return ['p.lead', 'p', 'td', 'th', 'figcaption', '.notices li', '.facts dd', '.axis-title'].map((name) => {
            let each = document.querySelector(name), back = each;
            while (getComputedStyle(back).backgroundColor === 'rgba(0, 0, 0, 0)') back = back.parentElement;
            return [name, getComputedStyle(each).color, getComputedStyle(back).backgroundColor];
        })"""
    )

    def hexadecimal(colour: str) -> str:
        return "#" + "".join(f"{int(part):02x}" for part in re.findall(r"\d+", colour)[:3])

    assert {name for name, front, back in found if contrast(hexadecimal(front), hexadecimal(back)) < 4.5} == set()
    assert hexadecimal(found[0][2]) != "#ffffff"


@pytest.mark.parametrize(("wanted", "behaviour"), [("reduce", "auto"), ("no-preference", "smooth")])
def test_nothing_scrolls_smoothly_for_whom_motion_is_reduced(
    wanted: str, behaviour: str, pages: dict[str, str], browser: Any, screen: Any
) -> None:
    screen(pages["design"], prefers_reduced_motion=wanted)
    assert browser.execute_script("return getComputedStyle(document.documentElement).scrollBehavior") == behaviour
