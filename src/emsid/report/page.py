"""A report as one HTML page without other files: it opens offline and is readable on a phone and on paper.

The plots are SVG and HTML (`emsid.report.page_plots`) and need no script; a short script adds zooming. Jinja escapes
all texts, and the content security policy of the page forbids loading anything.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path

from emsid.estimation.nonlinear.control import FREE, Control
from emsid.io.files import atomic_write
from emsid.report.document import Report
from emsid.report.page_plots import page_figure

FORMATS = ("svg", "pdf")
"""The formats of figures that `write_report` can write."""


def page(report: Report) -> str:
    """The report as HTML."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("emsid.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(report=report, plots=page_figure, script=any(report.figures))


def write_report(
    report: Report, folder: str | os.PathLike[str], control: Control = FREE, formats: Collection[str] = ("svg",)
) -> Path:
    """Write ``report.html``, and every figure as ``figures/<name>.svg`` for print, into a folder.

    Everything is drawn before anything is written.

    Args:
        report: what to write.
        folder: where to; it is made where it is missing.
        control: when to stop, and where to report progress.
        formats: of the files of the figures, of `FORMATS`; none for the page alone.

    Returns:
        The path of the page.

    Raises:
        FormatError: where the folder cannot be written to.
        Stopped: if ``control`` ends it; nothing is written then.
    """
    from emsid.report.figures import draw

    control.doing("writing the page")
    contents = page(report)
    drawings = {}
    figures = tuple(report.figures) if formats else ()
    for k, figure in enumerate(figures):
        control.doing(f"drawing {figure.name}", k, len(figures))
        drawings[figure.name] = draw(figure, formats)
    folder = Path(folder)
    for name, drawing in drawings.items():
        for suffix, content in drawing.items():
            atomic_write(folder / "figures" / f"{name}.{suffix}", content)
    atomic_write(folder / "report.html", contents)
    return folder / "report.html"
