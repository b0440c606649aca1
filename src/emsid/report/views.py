"""From results to content: each figure and table of a report as a pure function of what it shows.

What these return is plain data (`emsid.report.content`), to be put into the sections of a report. The numbers of the
paper's figures and tables that they correspond to stand in their docstrings.
"""

from emsid.report.conventions import labels
from emsid.report.free_run_views import measured_and_simulated, ranking, responses
from emsid.report.motor_views import nonlinearities
from emsid.report.record_views import critical_intervals, inputs
from emsid.report.recursion_views import convergence
from emsid.report.residual_views import residuals
from emsid.report.sections import model_section
from emsid.report.tables import Reference, motor_table, parameter_table, regressor_column, results_table

__all__ = [
    "Reference",
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
