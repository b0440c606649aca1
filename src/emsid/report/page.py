"""A report as one HTML page that opens anywhere: no network, no other file, readable on a phone and on paper.

On a screen the figures are Plotly's, drawn as they come into view; in print, and where scripts are off, the ones that
Matplotlib drew stand in their place. Every text goes through Jinja's escaping, and the page forbids itself, by its
content security policy, to load anything.
"""

from __future__ import annotations

import os
from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path

from emsid.io.files import atomic_write
from emsid.report.document import Report
from emsid.report.drawing import Draughtsman, Progress
from emsid.report.figures import Drawing
from emsid.report.page_plots import interactive, plotly_source


def page(report: Report, drawings: Mapping[str, Drawing] | None = None) -> str:
    """The report as HTML.

    Args:
        report: what it says and shows.
        drawings: its figures by name, if they have been drawn already.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    if drawings is None:
        drawings = Draughtsman().finish(report.figures, lambda what, fraction: None)
    environment = Environment(
        loader=PackageLoader("emsid.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(
        report=report,
        interactive=interactive,
        drawn={name: b64encode(drawing.svg).decode("ascii") for name, drawing in drawings.items()},
        plotly=plotly_source() if drawings else "",
    )


def write_report(
    report: Report,
    folder: str | os.PathLike[str],
    progress: Progress = lambda what, fraction: None,
    draughtsman: Draughtsman | None = None,
) -> Path:
    """Write ``report.html``, and every figure as ``figures/<name>.svg`` and ``.pdf``, into a folder.

    Everything is drawn before anything is written.

    Args:
        report: what to write.
        folder: where to; it is made where it is missing.
        progress: called with what is being done and the fraction done.
        draughtsman: who draws, and may have begun.

    Returns:
        The path of the page.

    Raises:
        FormatError: where the folder cannot be written to.
    """
    draughtsman = draughtsman or Draughtsman()
    drawings = draughtsman.finish(report.figures, lambda what, fraction: progress(what, 0.9 * fraction))
    progress("writing the report", 0.9)
    contents = page(report, drawings)
    folder = Path(folder)
    for name, drawing in drawings.items():
        atomic_write(folder / "figures" / f"{name}.svg", drawing.svg)
        atomic_write(folder / "figures" / f"{name}.pdf", drawing.pdf)
    atomic_write(folder / "report.html", contents)
    progress("written", 1.0)
    return folder / "report.html"
