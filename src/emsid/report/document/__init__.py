"""The content of a report as plain data: no plotting library, no HTML, no file.

A `Report` is a list of sections, a section has paragraphs, tables and figures, a `Figure` has plots, and a plot has
marks on two axes. `emsid.report.views` turns results into these, `emsid.report.figures` draws them for print and
`emsid.report.page_plots` for a screen, and `emsid.report.page` sets them in a page. Arrays here have all samples; the
drawing modules reduce them by `emsid.report.thinning`.
"""

from emsid.report.document.diagrams import (
    Box,
    Circle,
    Diagram,
    Text,
    Wire,
)
from emsid.report.document.plots import (
    Axis,
    Band,
    Bars,
    Dash,
    Figure,
    Histogram,
    Ink,
    Level,
    Line,
    Mark,
    Plot,
    Points,
    Spans,
    Stroke,
)
from emsid.report.document.sections import (
    Fact,
    Notice,
    Report,
    Section,
    Table,
    Term,
)

__all__ = [
    "Axis",
    "Band",
    "Bars",
    "Box",
    "Circle",
    "Dash",
    "Diagram",
    "Fact",
    "Figure",
    "Histogram",
    "Ink",
    "Level",
    "Line",
    "Mark",
    "Notice",
    "Plot",
    "Points",
    "Report",
    "Section",
    "Spans",
    "Stroke",
    "Table",
    "Term",
    "Text",
    "Wire",
]
