"""The contrast of the page's colours by WCAG 2.2, and that a page is light or dark by the system's setting."""

import re

import numpy as np
import pytest

from emsid.report.document import Ink, Report, Section
from emsid.report.page import DARK, LIGHT, PAIRS, TEXT, page


def luminance(colour: str) -> float:
    """Relative luminance of sRGB, as WCAG defines it."""
    share = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_the_contrast_is_that_of_wcag():
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)  # the known grey that just fails for text


@pytest.mark.parametrize("colours", [LIGHT, DARK], ids=["light", "dark"])
def test_text_and_marks_contrast_with_what_they_stand_on(colours):
    low = {
        (front, back): round(contrast(colours[front], colours[back]), 2)
        for front, back, least in PAIRS
        if contrast(colours[front], colours[back]) < least
    }
    assert not low


def test_light_and_dark_have_the_same_names_and_an_ink_each():
    assert LIGHT.keys() == DARK.keys()
    inks = {ink.name.lower() for ink in Ink}
    assert inks <= LIGHT.keys()
    for colours in (LIGHT, DARK):
        assert len({colours[ink] for ink in inks}) == len(inks)
    assert {front for front, _, least in PAIRS if least == TEXT} >= {"text", "quiet", "accent"}


def test_a_page_is_dark_on_a_dark_screen_only_and_has_no_colour_besides():
    html = page(Report("A page", (), (Section("One"),)))
    style = html[html.index("<style>") : html.index("</style>")]
    used = set(re.findall(r"var\(--([a-z]+)\)", html)) - {"columns", "height", "room"}
    assert used <= LIGHT.keys()
    dark = style[style.index("@media screen and (prefers-color-scheme: dark)") :]
    assert f"--paper: {DARK['paper']};" in dark
    written = re.findall(r"#[0-9a-f]{6}\b", style)
    assert sorted(written) == sorted([*LIGHT.values(), *DARK.values()])
