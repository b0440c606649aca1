"""The recommended model from all data.

Where few data were held back, its parameters are estimated again from all data, from the known estimate
(`emsid.models.refitting`). Its structure was chosen on the fitted part alone. Where the error of a feedback model or of
a plant is much larger on the held-back part, that part shows something that its structure lacks, such as a tank that
overflows only there, or tells apart what the fitted part does not, such as friction and a load that drifts. Order and
maps, or refinements, are then chosen again from all data, by the same search. So they are for every short record of a
sensor that loses the sign, from which a part shows too little. Cascades, whose structure differs less, gain nothing by
that. Of the two structures the one stands whose errors are smaller on stretches of all data that are left out in turn
(`ranking.in_turn`). The errors that are reported stay those of the fit that has not seen the held-back part.
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending, Fit, fit_or_problem
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.identification.candidates import CANDIDATES
from emsid.identification.compared import Compared
from emsid.identification.options import Options
from emsid.identification.ranking import MANY, in_turn
from emsid.identification.verdict import fails_on_unseen
from emsid.models.kinds import capabilities_of
from emsid.models.model import Model
from emsid.models.refitting import better_refit, is_safe
from emsid.record import Record
from emsid.record.holding_back import SHORT

MOST = 50_000
"""A structure is not chosen twice from as many samples: every search takes seconds for them."""


class FromAllData(NamedTuple):
    """A model with its parameters from all data.

    Attributes:
        model: the model.
        searched: whether its structure is chosen from all data too.
        larger: whether its error on unseen data is much larger than on those fitted.
    """

    model: Model
    searched: bool
    larger: bool


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
    few, best = len(held_back) < MANY, judged.best.model
    of_magnitudes = capabilities_of(best).hides_the_sign(best) and len(whole) < SHORT
    larger = len(whole) < MOST and _structure_is_doubtful(judged)
    if not (few or larger or of_magnitudes):
        return None
    refit = _refit(judged, whole, options, control) if few else None
    if larger or of_magnitudes:
        with suppress(Stopped):
            anew = _searched(judged.best.model.name, whole, options, control)
            start = judged.on_unseen.best.transient
            # The search chose that of magnitudes by errors on data left out.
            if anew is not None and (of_magnitudes or _better(anew, judged.best, whole, start, options, control)):
                return FromAllData(anew.model, True, larger)
    return None if refit is None else FromAllData(refit, False, larger)


def _better(anew: Fit[Any], known: Fit[Any], whole: Record, start: int, options: Options, control: Control) -> bool:
    """Whether a structure has the smaller errors on stretches of all data that are left out in turn."""
    one, other = in_turn((anew, known), whole, start, options, control)
    return one.errors.mean <= other.errors.mean


def _refit(judged: Compared, whole: Record, options: Options, control: Control) -> Model | None:
    """The refit of the recommended model, which the ranking knows where it has seen all data."""
    known = next(each for each in judged.ranking if each.fit is judged.best)
    if known.included and judged.on_choice is None:
        return known.refit
    with suppress(Stopped):
        return better_refit(judged.best, whole, linear=options.estimate, control=control)
    return None


def _structure_is_doubtful(judged: Compared) -> bool:
    """Whether the error of the recommended model is much larger on unseen data; its kind is then searched anew."""
    anew = getattr(CANDIDATES.get(judged.best.model.name), "searched_anew", False)
    return anew and fails_on_unseen(judged.on_unseen.best, judged.on_record)


def _searched(name: str, whole: Record, options: Options, control: Control) -> Fit[Any] | None:
    """A model with its structure from all data; None where the search finds none or is stopped, or it runs away."""
    try:
        control.doing(f"{name} from all data")
        fit = fit_or_problem(partial(CANDIDATES[name], whole, options, control))
    except (EmsidError, Stopped):
        return None
    return fit if fit.ending is not Ending.INTERRUPTED and is_safe(fit.model, whole) else None
