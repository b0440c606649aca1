"""`run_without`: the free run of a model whose parameters are fitted again without some of the outputs.

Repeated for one part of the data after another, it gives the errors of a structure on data that its parameters are not
from. The inputs of the samples that are left out are known, so a free run passes through them: no record is cut into
pieces whose initial states, unknown too, would be estimated from a few samples, and every sample that is left out
counts. The search begins at the known estimate and takes a few steps.

A regression that predicts one step ahead, and a kind of model without such a search, is fitted to what remains of the
record, in pieces (`emsid.models.refitting`), and runs over all of it.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Ending, Fit, fit_or_problem
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.models.blocks import fitting as cascades
from emsid.models.blocks.cascade import Cascade
from emsid.models.feedback import fitting as feedback
from emsid.models.feedback.model import FeedbackModel
from emsid.models.free_run import free_run
from emsid.models.refitting import SAVING, STEPS, Linear, refitted
from emsid.models.regression import free_run_fit as regressions
from emsid.models.regression.narx import Narx
from emsid.record import Record

Array = NDArray[np.float64]


def run_without(
    fit: Fit[Any],
    record: Record,
    out: NDArray[np.bool_],
    *,
    linear: Linear = least_squares,
    control: Control = FREE,
    steps: int = STEPS,
) -> Array:
    """(N, ny) the free run over a record, from the start of every segment, of a model fitted without some outputs.

    Args:
        fit: its structure and the parameters that it estimated are kept, and its estimate begins the search.
        record: with the channels of the model.
        out: (N,) which samples have outputs that are not fitted. Where a part of a segment is, so are the samples that
            start it; otherwise they only give the initial state, by the model as it was.
        linear: fits a regression that was fitted one step ahead.
        control: when to stop.
        steps: the most steps of a search for a free run.

    Returns:
        NaN where a segment is too short to run the model, and in the first samples, which start it.

    Raises:
        ModelError: for a kind of model that cannot be fitted again, or data that do not suit it.
        Stopped: if ``control`` stops it.
    """
    control.check()
    run: Array = fit_or_problem(partial(_run, fit, record, out, linear, control, steps))
    if control.ending is Ending.INTERRUPTED:
        raise Stopped(Ending.INTERRUPTED)
    return run


def _run(fit: Fit[Any], record: Record, out: NDArray[np.bool_], linear: Linear, control: Control, steps: int) -> Array:
    model, quiet = fit.model, control.quietly()
    places = [place for place in pairwise((0, *record.breaks, len(record))) if place[1] - place[0] > model.memory]
    if not places:
        raise ModelError(f"{model.name}: no segment is longer than the {model.memory} samples that start it")
    kept = [~out[first:stop] for first, stop in places]
    for each in kept:
        each[: model.memory] |= each.any()
    if isinstance(model, FeedbackModel | Cascade):
        pairs = [
            (np.ascontiguousarray(record.input[first:stop, 0]), np.ascontiguousarray(record.output[first:stop, 0]))
            for first, stop in places
        ]
        if isinstance(model, FeedbackModel):
            residuals = feedback.residuals_without(model, pairs, kept, steps, SAVING, quiet)
        else:
            residuals = cascades.residuals_without(fit, pairs, kept, steps, SAVING, quiet)
    elif isinstance(model, Narx) and fit.method == "gn":
        pieces = [record[first:stop] for first, stop in places]
        residuals = regressions.residuals_without(fit, pieces, kept, steps, SAVING, quiet)
    else:
        found = free_run(refitted(fit, record.mask(out), linear=linear, control=control), record)
        return np.where(found.counted[:, None], found.output, np.nan)
    run = np.full_like(record.output, np.nan)
    for (_, stop), residual in zip(places, residuals, strict=True):
        run[stop - len(residual) : stop, 0] = record.output[stop - len(residual) : stop, 0] + residual
    return run
