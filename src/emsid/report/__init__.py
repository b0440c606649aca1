"""Reports: their content as plain data, views that make it from results, figures for print, and an HTML page.

The views of cascades and of physical models are in `emsid.report.views.cascade` and `emsid.report.views.grey_box`. They
are loaded when a section of such a model is made.

>>> from emsid import report
>>> contents = report.Report("A motor", ("It turns.",), (report.Section("Data"),))
>>> report.page(contents).startswith("<!DOCTYPE html>")
True
"""

from emsid.report.document import (
    Axis,
    Band,
    Bars,
    Dash,
    Fact,
    Figure,
    Histogram,
    Ink,
    Level,
    Line,
    Plot,
    Points,
    Report,
    Section,
    Spans,
    Stroke,
    Table,
)
from emsid.report.page import page, write_report
from emsid.report.thinning import thin
from emsid.report.views import (
    Reference,
    convergence,
    critical_intervals,
    inputs,
    measured_and_simulated,
    model_section,
    nonlinearities,
    parameter_table,
    ranking,
    residuals,
    responses,
    results_table,
)

__all__ = [
    "Axis",
    "Band",
    "Bars",
    "Dash",
    "Fact",
    "Figure",
    "Histogram",
    "Ink",
    "Level",
    "Line",
    "Plot",
    "Points",
    "Reference",
    "Report",
    "Section",
    "Spans",
    "Stroke",
    "Table",
    "convergence",
    "critical_intervals",
    "inputs",
    "measured_and_simulated",
    "model_section",
    "nonlinearities",
    "page",
    "parameter_table",
    "ranking",
    "residuals",
    "responses",
    "results_table",
    "thin",
    "write_report",
]
