"""A report as one HTML page without other files: it opens offline and is readable on a phone and on paper.

The plots are SVG and HTML (`emsid.report.page_plots`) and need no script; a short script adds zooming. Jinja escapes
all texts, and the content security policy of the page forbids loading anything.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Mapping
from functools import cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from emsid.estimation.borders import border, tried
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.io.files import atomic_write, write_several
from emsid.report.document import Diagram, Figure, Report
from emsid.report.page_plots import PageFigure, page_figure
from emsid.report.palette import DARK, LIGHT, variable

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
