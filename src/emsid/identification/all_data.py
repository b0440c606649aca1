"""The recommended model from all data.

Where few data were held back, its parameters are estimated again from all data, from the known estimate
(`emsid.models.refitting`). Its structure was chosen on the fitted part alone. Where the error of a feedback model or of
a plant is much larger on the held-back part, that part shows something that its structure lacks, such as a tank that
overflows only there, or tells apart what the fitted part does not, such as friction and a load that drifts. Order and
maps, or refinements, are then chosen again from all data, by the same search. Cascades, whose structure differs less,
gain nothing by that. The errors that are reported stay those of the fit that has not seen the held-back part.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending, fit_or_problem
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.identification.candidates import CANDIDATES, Feedback, Physical
from emsid.identification.compared import Compared
from emsid.identification.options import Options
from emsid.identification.ranking import MANY
from emsid.identification.verdict import larger_on_unseen
from emsid.models.free_run import free_run_error
from emsid.models.model import Model
from emsid.models.plants.grey_box import GreyBox
from emsid.models.refitting import refitted
from emsid.models.regression.search.judge import runs_away
from emsid.record import Record
from emsid.selection.improvement import matters

MOST = 50_000
"""A structure is not chosen twice from as many samples: every search takes seconds for them."""


class FromAllData(NamedTuple):
    """A model with its parameters from all data.

    Attributes:
        model: the model.
        searched: whether its structure is chosen from all data too.
    """

    model: Model
    searched: bool


def from_all_data(
    judged: Compared, held_back: Record, whole: Record, options: Options, control: Control = FREE
) -> FromAllData | None:
    """The recommended model from all data.

    Args:
        judged: the models, fitted to all data but those that were held back.
        held_back: these data.
        whole: all data.
        options: how the models were fitted.
        control: when to stop.

    Returns:
        None where the data are so many that it would change little, or where no fit simulates them better.
    """
    few, doubtful = len(held_back) < MANY, len(whole) < MOST and _structure_is_doubtful(judged)
    if not (few or doubtful):
        return None
    fit = judged.best
    error, found = free_run_error(fit.model, (whole,)), None
    if few:
        again = _sound(partial(refitted, fit, whole, linear=options.estimate, control=control), whole)
        if again is not None and again[1] < error:
            error, found = again[1], FromAllData(again[0], False)
    if doubtful:
        anew = _sound(partial(_searched, fit.model.name, whole, options, control), whole)
        if anew is not None and not matters(error, anew[1]):
            return FromAllData(anew[0], True)
    return found


def _structure_is_doubtful(judged: Compared) -> bool:
    """Whether the recommended model is a feedback model or a plant whose error is much larger on unseen data."""
    name = judged.best.model.name
    fitted = next(each for each in judged.on_record.assessments if each.row.model == name)
    unseen = judged.on_unseen.best
    return isinstance(CANDIDATES.get(name), (Feedback, Physical)) and larger_on_unseen(unseen, fitted) is not None


def _searched(name: str, whole: Record, options: Options, control: Control) -> Model:
    control.doing(f"{name} from all data")
    fit = fit_or_problem(partial(CANDIDATES[name], whole, options, control))
    if fit.ending is Ending.INTERRUPTED:
        raise Stopped(Ending.INTERRUPTED)
    model: Model = fit.model
    return model


def _sound(fitted: Callable[[], Any], whole: Record) -> tuple[Model, float] | None:
    """A model and its mean square error on all data; None where it is not found, or its free run runs away."""
    try:
        model = fitted()
        error = free_run_error(model, (whole,))
    except (EmsidError, Stopped):
        return None
    if not isinstance(model, GreyBox) and runs_away(model, whole):
        return None
    return model, error
