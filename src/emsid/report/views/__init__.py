"""Views: functions that make a figure or table of a report from a result.

They return plain data (`emsid.report.document`) for the sections of a report. Their docstrings have the numbers of the
corresponding figures and tables of the paper.
"""

from emsid.report.views.conventions import channel_axis
from emsid.report.views.front import motor_table, parameter_table, regressor_column, results_table
from emsid.report.views.grey_box import nonlinearities
from emsid.report.views.record import (
    convergence,
    critical_intervals,
    inputs,
    measured_and_simulated,
    ranking,
    responses,
)
from emsid.report.views.residuals import nonlinear_correlations, residuals
from emsid.report.views.sections import banded, model_section

__all__ = [
    "banded",
    "channel_axis",
    "convergence",
    "critical_intervals",
    "inputs",
    "measured_and_simulated",
    "model_section",
    "motor_table",
    "nonlinear_correlations",
    "nonlinearities",
    "parameter_table",
    "ranking",
    "regressor_column",
    "residuals",
    "responses",
    "results_table",
]
