"""A report as one HTML page without other files: it opens offline and is readable on a phone and on paper.

The plots are SVG and HTML (`emsid.report.page`) and need no script; a short script adds zooming. Jinja escapes
all texts, and the content security policy of the page forbids loading anything.

Plots of the page: the values that the template writes as HTML and SVG, computed from a `Plot`.

The lines of a plot are SVG paths that stretch with the width of the page. Titles, ticks and legends are HTML, so their
letters keep their size on a phone. The same markup serves for screen and print, with and without scripts; a short
script adds zooming. Texts are not escaped here: the template escapes them.

The colours of the page, light and dark, and which of them stand on which.

A browser takes one of the two by the setting of the system; paper is light. The inks of figures are those of `Ink`,
which are chosen for white paper; in the dark each has a lighter one of the same hue. `PAIRS` are the pairs that must
contrast by WCAG 2.2: 4.5 to 1 for text (success criterion 1.4.3), 3 to 1 for lines and marks (1.4.11).
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from emsid.estimation.borders import border, tried
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.io.files import atomic_write, write_several
from emsid.report.document import Diagram, Figure, Ink, Plot, Report
from emsid.report.paths import Bar, Entry, Frame, Scale, Shape, bars, legends, names_of_points, shapes, x_scale, y_scale

if TYPE_CHECKING:
    from jinja2 import Environment


PAGE = "report.html"


def page(report: Report) -> str:
    """The report as HTML."""
    template = templates().get_template("page.html.j2")
    colours = {"light": LIGHT, "dark": DARK}
    plots: dict[str, PageFigure] = {}
    for figure in report.figures:
        with border(f"figure {figure.name}"):
            plots[figure.name] = page_figure(figure)
    report = report.with_figures(plots)
    return template.render(
        report=report, plots=lambda figure: plots[figure.name], script=any(report.figures), colours=colours
    )


@cache
def templates() -> Environment:
    """The templates of the page, each compiled once."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("emsid.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["flowing"] = _flowing
    environment.filters["breakable"] = _breakable
    environment.filters["variable"] = variable
    return environment


def _flowing(text: str) -> str:
    """A sentence whose lines end neither before a percent sign nor within a number or an option such as --fix."""
    from markupsafe import Markup, escape

    whole = _WHOLE.sub(r'<span class="whole">\g<0></span>', str(escape(text)))
    return Markup(whole.replace(" %", "\u00a0%"))


def _breakable(name: str) -> str:
    """A name such as rotor_friction.coulomb, whose lines may end after a dot or an underscore between letters."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"(?<=[a-z])([._])(?=[a-z])", r"\1<wbr>", str(escape(name))))


_WHOLE = re.compile(r"--[a-z][\w-]*|(?<![\w.)\]-])-?\d[\d.,]*e-\d+|(?<![\w.)\]-])-\d[\d.,]*\b")
"""An option, a number with a negative exponent and a negative number, in which a line could end after the hyphen."""


def report_files(
    report: Report,
    control: Control = FREE,
    formats: Collection[str] = ("svg",),
) -> dict[str, str | bytes]:
    """The content of every file of a report: every figure as ``figures/<name>.svg`` for print, and last the page.

    Args:
        report: what to draw.
        control: when to stop, and where to report progress.
        formats: ``svg``, ``pdf`` or both, for the files of the figures; none for the page alone.

    Returns:
        By their paths in a folder. A page that fails has the title, the sentences and the notices only.

    Raises:
        Stopped: if ``control`` ends it.
    """
    from emsid.report.figures import draw

    control.doing("writing the page")
    figures: list[Figure | Diagram] = [*report.figures, *report.diagrams] if formats else []
    contents = tried("page", lambda: page(report), "") or _plain(report)
    files: dict[str, str | bytes] = {}
    for k, figure in enumerate(figures):
        control.doing(f"drawing {figure.name}", k, len(figures))
        with border(f"figure {figure.name}"):
            files |= {f"figures/{figure.name}.{suffix}": content for suffix, content in draw(figure, formats).items()}
    control.check()
    return files | {PAGE: contents}


def _plain(report: Report) -> str:
    """The sentences of a report as HTML, without templates."""
    lines = (report.title, *report.summary, *(each.text for each in report.notices), *report.advice)
    body = "".join(f"<p>{escape(line)}</p>" for line in (*lines, "The rest of the page could not be made."))
    return f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(report.title)}</title>{body}</html>'


def write_files(files: Mapping[str, str | bytes], folder: str | os.PathLike[str]) -> Path:
    """Write the files of `report_files` into a folder, which is made where it is missing; the path of the page.

    Raises:
        FormatError: where the folder cannot be written to.
    """
    folder = Path(folder)
    write_several(atomic_write, [folder / name for name in files], files.values())
    return folder / PAGE


# Points of a line: about two in every pixel of a wide screen, the lowest and the highest value of each stretch.
PAGE_POINTS = 1600

# Coordinates inside a plot are integers from 0 to these limits: paths are short and can be enlarged twenty times.
WIDTH, HEIGHT = 20_000, 10_000

_ROW = 210  # the height of an ordinary plot, in pixels
_LETTER = 7.0  # the width of a digit of a tick, in pixels
_MINUS = 0.4  # how much wider than a digit a minus sign is, in digits
_NARROW = 270.0  # the width of a plot on a phone, in pixels
_TICKS = 6  # at most


@dataclass(frozen=True)
class PagePlot:
    """A plot as the template sets it.

    Attributes:
        title, x_title, y_title: texts.
        x, y: its scales.
        shapes: what is drawn, the first at the bottom.
        height: in pixels.
        room: width for the tick labels at its left, in pixels.
        legend: its own; empty where the figure has one for all its plots.
        bars: for a chart of names, which has no y axis.
        span: its width in columns.
        notes: positions in percent of width and height, and the texts there.
    """

    title: str
    x_title: str
    y_title: str
    x: Scale
    y: Scale
    shapes: tuple[Shape, ...]
    height: int
    room: int
    legend: tuple[Entry, ...]
    bars: tuple[Bar, ...]
    span: int
    notes: tuple[tuple[float, float, str], ...] = ()


@dataclass(frozen=True)
class PageFigure:
    """A figure as the template sets it.

    Attributes:
        plots: row by row.
        legend: for all its plots; empty where each has its own.
    """

    plots: tuple[PagePlot, ...]
    legend: tuple[Entry, ...]


def page_figure(figure: Figure) -> PageFigure:
    """A figure as the template sets it: plots of one width, with one legend or one each."""
    shared, own = legends(figure)
    frames = [_frame(plot) for plot in figure.plots]
    room = max(_tick_room(frame.y) for frame in frames)
    plots = tuple(
        _page_plot(plot, frame, room, entries) for plot, frame, entries in zip(figure.plots, frames, own, strict=True)
    )
    return PageFigure(plots, shared)


def _frame(plot: Plot) -> Frame:
    return Frame(x_scale([plot], _TICKS, _NARROW / _LETTER), y_scale(plot, _TICKS), WIDTH, HEIGHT, PAGE_POINTS)


def _tick_room(y: Scale) -> int:
    letters = (len(text) + _MINUS * text.count("\N{MINUS SIGN}") for _, text in y.ticks)
    return round(max(letters, default=0) * _LETTER) + 12


def _page_plot(plot: Plot, frame: Frame, room: int, legend: tuple[Entry, ...]) -> PagePlot:
    x, y = frame.x, frame.y
    rows = tuple(bars(plot, x)) if plot.y.names else ()
    drawn = () if rows else tuple(each for mark in plot.marks for each in shapes(mark, frame) if each.path)
    y_title = "" if rows else plot.y.title
    height, notes = round(_ROW * plot.height), () if rows else tuple(names_of_points(plot, x, y))
    return PagePlot(plot.title, plot.x.title, y_title, x, y, drawn, height, room, legend, rows, plot.span, notes)


LIGHT = {
    "text": "#22262e",
    "quiet": "#5d6470",
    "line": "#e1e5ea",
    "paper": "#ffffff",
    "ground": "#f7f8fa",
    "accent": "#1c5d99",
    "best": "#eef6ef",
    "warn": "#c47500",
    "problem": "#d1242f",
    "shade": "#c3c9d2",
    "axis": "#858a93",
    "grid": "#e4e7eb",
    "box": "#f3f7fb",
    **{ink.name.lower(): ink.value for ink in Ink},
}
"""By name of the variable in the style sheet: text and secondary text; lines between rows; cards, tables and plots
(paper) on the ground; links; the row in bold; the edges of notices; the shadow at the edge of a table; axes, grid and
blocks of plots; inks."""
DARK = {
    "text": "#e3e6ea",
    "quiet": "#9aa3af",
    "line": "#343a44",
    "paper": "#1d2127",
    "ground": "#15181d",
    "accent": "#7fb6e8",
    "best": "#20332a",
    "warn": "#f0a030",
    "problem": "#ff6b6b",
    "shade": "#000000",
    "axis": "#868e9a",
    "grid": "#2b3038",
    "box": "#222a33",
    "blue": "#5aa9e6",
    "red": "#ff6b6b",
    "navy": "#b9c8f5",
    "green": "#3fbf8f",
    "orange": "#f0a030",
    "purple": "#d08fcd",
    "grey": "#9aa3af",
    "black": "#e3e6ea",
}
"""The same on a dark screen."""

TEXT, MARK = 4.5, 3.0
PAIRS = (
    *((front, back, TEXT) for front in ("text", "quiet", "accent") for back in ("ground", "paper", "box")),
    ("text", "best", TEXT),
    *((mark, "paper", MARK) for mark in ("axis", "warn", "problem", *(ink.name.lower() for ink in Ink))),
)
"""Foreground, background, and the least ratio of their contrast."""

_NAMES = {ink.value: ink.name.lower() for ink in Ink}


def variable(colour: str) -> str:
    """The colour of an ink as a variable of the style sheet.

    >>> variable(Ink.RED.value)
    'var(--red)'
    """
    return f"var(--{_NAMES[colour]})"
