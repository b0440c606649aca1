"""`refitted`: the structure of a fit, estimated from other data.

The search begins at the estimate and takes a few steps only, without intervals. Repeated with one part of the data left
out after another, it gives the error of a structure on data that it was not fitted to, at a small part of the cost of
full fits. `better_refit` estimates the parameters from all data, including those held back from the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending, Fit, fit_or_problem
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.without_samples import Mask
from emsid.models.extrapolation import Extremes, diverges, diverges_held
from emsid.models.free_run import free_run_error
from emsid.models.kinds import capabilities_of
from emsid.models.model import Model
from emsid.models.refit_data import Data, Linear
from emsid.record import Record


def refitted(
    fit: Fit[Any],
    records: Record | Sequence[Record],
    *,
    linear: Linear = least_squares,
    control: Control = FREE,
    left_out: Sequence[Mask] | None = None,
) -> Model:
    """The model of a fit with its parameters estimated from other data.

    Args:
        fit: its structure and the parameters that it estimated are kept, and its estimate begins the search.
        records: the other data, of the same channels and sample time.
        linear: fits a regression that was fitted one step ahead.
        control: when to stop.
        left_out: (N,) of every record, samples that are not fitted; a free run goes on through them.

    Raises:
        ModelError: for a kind of model that cannot be fitted again, or data that do not suit it.
        Stopped: if ``control`` stops it.
    """
    several = (records,) if isinstance(records, Record) else tuple(records)
    data = Data(several, linear, control, left_out)
    control.check()
    found = fit_or_problem(partial(capabilities_of(fit.model).refitted, fit, data))
    if control.ending is Ending.INTERRUPTED:
        raise Stopped(Ending.INTERRUPTED)
    return found


def better_refit(
    fit: Fit[Any], whole: Record, *, linear: Linear = least_squares, control: Control = FREE
) -> Model | None:
    """The model of a fit with its parameters from all data; None where it cannot be used or simulates them no better.

    Args:
        fit: to a part of the data.
        whole: all data.
        linear: as in `refitted`.
        control: likewise.

    Raises:
        Stopped: if ``control`` stops it.
    """
    try:
        again = refitted(fit, whole, linear=linear, control=control)
        better = free_run_error(again, (whole,)) < free_run_error(fit.model, (whole,))
    except EmsidError:  # the data do not suit it
        return None
    return again if better and is_safe(again, whole, fit.model) else None


def is_safe(model: Model, record: Record, known: Model | None = None) -> bool:
    """Whether a model, stable on a record, does not run away on inputs that the record lacks; a plant never does.

    Args:
        model: the model.
        record: what it is stable on.
        known: a model that it takes the place of; where that diverges while an extreme input is held, it may too.
    """
    if not capabilities_of(model).may_run_away:
        return True
    extremes = Extremes(record)
    if diverges(model, extremes.larger):
        return False
    return not diverges_held(model, extremes) or (known is not None and diverges_held(known, extremes))


def specification(fit: Fit[Any]) -> tuple[Any, dict[str, Any]]:
    """What `emsid.fit` takes to estimate the same parameters from other data, with intervals: subject and options.

    Raises:
        ModelError: for a kind of model that cannot be fitted again.
    """
    return capabilities_of(fit.model).specification(fit)
