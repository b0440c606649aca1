"""Words of the field that tables and figures use, each defined once."""

from emsid.report.document import Term

FREE_RUN = Term(
    "Free run",
    "the model is given the input only and goes on from its own past outputs, never from measured ones; a simulation.",
)
ONE_STEP = Term(
    "One step ahead",
    "the model predicts the next sample from the measured past. These errors are small for almost any model.",
)
FIT = Term(
    "Fit",
    "100 % is a perfect match, 0 % no better than a constant at the mean of the measured output; it can be negative.",
)
MSE = Term("MSE, RMSE", "mean square error and its root; the RMSE is in the unit of the output.")
UNSEEN = Term("Unseen data", "data that no model was fitted to.")
METHOD = Term(
    "Method",
    "LS: least squares. RLS: recursive least squares, sample by sample. GN: Gauss–Newton, a search for the smallest "
    "error of the free run.",
)
TRANSIENT = Term(
    "Transient", "the samples that start a free run from measured values; they are left out of every error."
)
