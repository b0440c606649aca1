"""`refitted`: a model estimated from other data, as far as a budget goes.

In a few steps from the estimate, with one part of the data left out after another, it gives the error of a structure on
data that it was not fitted to, at a small part of the cost of full fits. To all data, it gives the parameters that are
handed over. With intervals, it finishes a model that was chosen on an excerpt. `usable_refit` keeps a result only where
it can take the place of the known model.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from emsid.errors import ModelError
from emsid.estimation.borders import border
from emsid.estimation.fit import Ending, Fit, fit_or_problem
from emsid.estimation.nonlinear.control import Stopped
from emsid.models.extrapolation import Extremes, diverges, diverges_held
from emsid.models.free_run import free_run_error
from emsid.models.kinds import capabilities_of
from emsid.models.model import Model
from emsid.models.refit_data import Budget, Data
from emsid.record import Record, concatenate


def refitted(fit: Fit[Any], data: Data, budget: Budget = Budget.FEW) -> Fit[Any]:
    """A fit to other data.

    Args:
        fit: its structure and the parameters that it estimated are kept, and its estimate begins the search.
        data: the other data.
        budget: how far it is fitted; `Budget.SEARCH` chooses the structure anew.

    Raises:
        ModelError: for a kind of model that cannot be fitted again, or data that do not suit it.
        Stopped: if the control of the data stops it.
    """
    data.control.check()
    found: Fit[Any]
    if budget is not Budget.SEARCH:
        found = fit_or_problem(partial(capabilities_of(fit.model).refitted, fit, data, budget))
    elif data.search is None:
        raise ModelError(f"{fit.model.name}: no search for such a model is known; give one")
    else:
        found = fit_or_problem(partial(data.search, concatenate(data.records), data.control))
    if data.control.ending is Ending.INTERRUPTED:
        raise Stopped(Ending.INTERRUPTED)
    return found


def usable_refit(fit: Fit[Any], data: Data, budget: Budget = Budget.FEW) -> Fit[Any] | None:
    """A fit to a record if it can replace the known one; else None.

    It does not run away on inputs that the record lacks. After a few steps only, it also has to simulate the record
    better.

    Args:
        fit: to a part of the data.
        data: all of them, one record.
        budget: how far it is fitted.

    Raises:
        Stopped: if the control of the data stops it.
    """
    (whole,) = data.records
    with border(f"fit of {fit.model.name} to other data", fit.model.name, expected=True):
        again = refitted(fit, data, budget)
        few = budget is Budget.FEW
        if few and not free_run_error(again.model, (whole,)) < free_run_error(fit.model, (whole,)):
            return None
        return again if is_safe(again.model, whole, fit.model) else None
    return None


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
