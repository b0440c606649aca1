"""Definitions of the terms in tables and figures."""

from emsid.report.document import Term

FREE_RUN = Term(
    "Free run",
    "simulation from the input alone: the model uses its own past outputs, never measured ones.",
)
ONE_STEP = Term(
    "One step ahead",
    "the model predicts the next sample from the measured past; models are not ranked by this error.",
)
FIT = Term(
    "Fit",
    "100·(1 − ‖error‖/‖output − mean‖): 100 % is exact, 0 % is no better than the mean of the output.",
)
MSE = Term("MSE, RMSE", "mean square error and its root; the RMSE is in the unit of the output.")
METHOD = Term(
    "Method",
    "LS: least squares. RLS: recursive least squares, sample by sample. GN: Gauss–Newton, a search for the smallest "
    "error of the free run.",
)
