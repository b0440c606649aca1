"""From results to content: each figure and table of a report as a pure function of what it shows.

What these return is plain data (`emsid.report.document`), to be put into the sections of a report. The numbers of the
paper's figures and tables that they correspond to stand in their docstrings.
"""

from emsid.report.views.conventions import channel_axis, labels
from emsid.report.views.free_run import measured_and_simulated, ranking, responses
from emsid.report.views.motor import nonlinearities
from emsid.report.views.record import critical_intervals, inputs
from emsid.report.views.recursion import convergence
from emsid.report.views.residuals import residuals
from emsid.report.views.sections import model_section
from emsid.report.views.tables import Reference, motor_table, parameter_table, regressor_column, results_table

__all__ = [
    "Reference",
    "channel_axis",
    "convergence",
    "critical_intervals",
    "inputs",
    "labels",
    "measured_and_simulated",
    "model_section",
    "motor_table",
    "nonlinearities",
    "parameter_table",
    "ranking",
    "regressor_column",
    "residuals",
    "responses",
    "results_table",
]
