"""The recommended model from more data, by one refit of three budgets (`emsid.models.refitting`).

A long record is compared on an excerpt; the recommended model then continues from its estimates to all samples, with
intervals (`Budget.LAST`). Where few data were held back, its parameters are estimated again from all data, from the
known estimate (`Budget.FEW`). Its structure was chosen on the fitted part alone. Where the error of a feedback model
or of a plant is much larger on the held-back part, that part shows something that its structure lacks, such as a tank
that overflows only there, or tells apart what the fitted part does not, such as friction and a load that drifts. Order
and maps, or refinements, are then chosen again from all data, by the same search (`Budget.SEARCH`). So they are for
every short record of a sensor that loses the sign, from which a part shows too little. Cascades, whose structure
differs less, gain nothing by that. Of the two structures the one stands whose errors are smaller on stretches of all
data that are left out in turn (`ranking.in_turn`). The errors that are reported stay those of the fit that has not seen
the held-back part.
"""

from __future__ import annotations

from typing import Any

from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.findings import Finding
from emsid.identification.candidates import CANDIDATES, refit_data
from emsid.identification.compared import Compared
from emsid.identification.ranking import MANY, in_turn, ranked
from emsid.identification.verdict import fails_on_unseen
from emsid.models.kinds import capabilities_of
from emsid.models.model import Model
from emsid.models.refit_data import Budget
from emsid.models.refitting import usable_refit
from emsid.options import Options
from emsid.record import Record
from emsid.record.holding_back import SHORT
from emsid.selection.improvement import better
from emsid.validation.comparison import compare

SEARCHED_AGAIN = 50_000
"""A structure is not chosen twice from as many samples: every search takes seconds for them."""


def refit(fit: Fit[Any], data: Record, budget: Budget, options: Options, control: Control = FREE) -> Fit[Any] | None:
    """The model of a fit from other data.

    Args:
        fit: the model.
        data: to which it is fitted.
        budget: how far.
        options: how it was fitted.
        control: when to stop.

    Returns:
        None where there is no time, where the data do not suit it, or where the result cannot be used; see
        `usable_refit`.
    """
    doing = f"fitting {fit.model.name} to all data"
    kind = CANDIDATES.get(fit.model.name)
    search = None if kind is None else lambda record, control: kind(record, options, control)
    try:
        control.doing(doing)
        within = control if budget is Budget.FEW else control.during(doing)
        found = usable_refit(fit, refit_data(options, data, within, search=search), budget)
        if budget is not Budget.FEW:
            control.check()
    except Stopped:
        return None
    return found


def on_all_samples(judged: Compared, train: Record, options: Options, control: Control = FREE) -> Compared:
    """The comparison with the recommended model fitted to the whole record, from its estimates of the excerpt.

    The model of the excerpt is kept where there is no other, and where it is better by more than noise on the unseen
    data that chose.

    Args:
        judged: the models, fitted to an excerpt.
        train: all data to fit.
        options: how they were fitted.
        control: when to stop.
    """
    fit, found = judged.best, refit(judged.best, train, Budget.LAST, options, control)
    if found is None:
        return judged
    errors = {id(each.fit): each.errors for each in ranked(compare([fit, found], judged.chosen_on), None, options)}
    return judged if better(errors[id(fit)], than=errors[id(found)]) else judged.with_finished(found, train)


def from_all_data(
    judged: Compared, held_back: Record, whole: Record, options: Options, control: Control = FREE
) -> tuple[Model, Finding] | None:
    """The recommended model from all data, and a finding about that.

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
    rectified = capabilities_of(best).hides_the_sign(best) and len(whole) < SHORT
    larger = len(whole) < SEARCHED_AGAIN and _structure_is_doubtful(judged)
    anew = refit(judged.best, whole, Budget.SEARCH, options, control) if larger or rectified else None
    # The search chose that of a rectified output by errors on data left out.
    searched = anew is not None and (rectified or _better(anew, judged, whole, options, control))
    model = anew.model if searched and anew else _with_steps(judged, whole, options, control) if few else None
    if model is None:
        return None
    data = {"model": model.name, "samples": len(whole), "of": len(judged.record)}
    return model, Finding("fitted-to-all-data", whole.name, data | {"searched": searched, "larger": larger})


def _better(anew: Fit[Any], judged: Compared, whole: Record, options: Options, control: Control) -> bool:
    """Whether a structure has the smaller errors on stretches of all data that are left out in turn."""
    try:
        one, other = in_turn((anew, judged.best), whole, judged.on_unseen.best.transient, options, control)
    except Stopped:
        return False
    return one.errors.mean <= other.errors.mean


def _with_steps(judged: Compared, whole: Record, options: Options, control: Control) -> Model | None:
    """The recommended model with its parameters from all data, which the ranking knows where it has seen these."""
    known = next(each for each in judged.ranking if each.fit is judged.best)
    if known.included and judged.on_choice is None:
        return known.refit
    found = refit(judged.best, whole, Budget.FEW, options, control)
    return None if found is None else found.model


def _structure_is_doubtful(judged: Compared) -> bool:
    """Whether the error of the recommended model is much larger on unseen data; its kind is then searched anew."""
    anew = getattr(CANDIDATES.get(judged.best.model.name), "searched_anew", False)
    return anew and fails_on_unseen(judged.on_unseen.best, judged.on_record)
