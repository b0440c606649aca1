"""Refinement of cascades on a part of a record, and their free-run errors on unseen data, which rank them.

A refinement for a choice is a short search without covariances. Where several splits hold data back, a model is fitted
again to the rest of each, in a few steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar, Unpack

import numpy as np

from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.threads import in_threads
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.fitting import FreeRun, Search, search
from emsid.models.blocks.search.cross_validation import Round, as_arrays
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.free_run import free_run_error
from emsid.record import Record
from emsid.selection.improvement import STRETCHES, StretchErrors, better, matters, schwarz_gain

T = TypeVar("T")

# More starts than this take `FIRST_STEPS` steps each, and only the best `FINISHED` are refined further.
FINISHED, FIRST_STEPS = 12, 5
# Limits of a refinement for a choice: steps, distance to the minimum in standard errors, and relative reduction of the
# cost over a few steps.
CHOICE_STEPS, CHOICE_TOLERANCE, CHOICE_SAVING = 25, 0.2, 1e-3
# Of a short record only this many kinds of model are compared by cross-validation. The others are worse on the data
# that they were refined on.
COMPARED = 4
# Steps of a fit to the parts of a short record that are not held back: it starts at the minimum of the whole. A sum of
# squared errors on unseen data that is this many times larger than that of another model ends a comparison.
REFIT_STEPS, MUCH_WORSE = 5, 2.0
# The most times that knots are placed anew.
PLACEMENTS = 3
# The error of a model that has not been run on unseen data.
UNKNOWN = StretchErrors.of(np.array([np.inf]))


@dataclass(frozen=True, eq=False)
class Choice:
    """A refined model, to be compared with others.

    Attributes:
        model: the model with all its parameters.
        unseen: its free-run error on unseen data.
        known: the same on the data that it was refined on.
        independent: the number of independent samples in its errors there.
        determined: the number of parameters and initial states that these data determine, and no penalty.
        size: the size of its map.
        family: the family of its map; None for a trial map.
    """

    model: Cascade
    unseen: StretchErrors
    known: float
    size: int = 0
    family: Family | None = None
    independent: float = 0.0
    determined: float = 0.0

    @property
    def error(self) -> float:
        """Root mean square of its free-run error on unseen data."""
        return float(np.sqrt(self.unseen.mean))


@dataclass(frozen=True, eq=False)
class Plan:
    """A model to refine, with the family and size of its map, unless it is a trial map.

    A trial map that another kind of curve replaces may follow slow residuals (`correlated`).
    """

    model: Cascade
    family: Family | None = None
    size: int = 0
    correlated: bool = True


def refined(
    plans: Sequence[Plan],
    part: Sequence[Record],
    rounds: Sequence[Round],
    threads: int,
    control: Control,
    rival: Choice | None = None,
    compared: Callable[[Choice], bool] = lambda choice: True,
) -> list[Choice]:
    """The plans refined on a part of the data and ranked by cross-validation, best first; failures are left out.

    Plans that are worse than the rival, if there is one, are left out too, and those that are not to be ``compared`` by
    what they reach on this part, so the list may be empty. Without ``rounds`` nothing is compared on unseen data: the
    best of every kind are returned, those that fit this part best first.

    Raises:
        ModelError: if there is no rival and every plan fails.
    """
    budget = _limits(CHOICE_STEPS, control)

    def refine(plan: Plan) -> Choice:
        found = searched(plan.model, part, **(budget | Search(correlated=plan.correlated)))
        evidence = effective_samples(found.minimum.residuals), found.determined
        return Choice(found.model, UNKNOWN, found.error, plan.size, plan.family, *evidence)

    def compare(choice: Choice) -> Choice:
        return replace(choice, unseen=unseen_errors(choice.model, rounds, control, best))

    problems: list[Exception] = []
    if len(plans) > FINISHED:
        plans = promising(plans, part, budget, threads, control)
    found = [choice for choice in _successes(refine, plans, threads, control, problems) if compared(choice)]
    ranked: list[Choice] = []
    best = None if rival is None or len(rounds) == 1 else rival.unseen
    if len(rounds) != 1:  # every split costs a fit, so only the best of each kind is compared
        found = _best_of_kinds(found)
    if not rounds:
        ranked, found = found, []
    elif len(rounds) > 1:
        if rival is None:
            ranked, found = _successes(compare, found[:1], threads, control, problems), found[1:]
            best = ranked[0].unseen if ranked else None
        if best is not None:
            # A choice that is worse than this on the data that it was refined on cannot be the best on unseen data.
            found = [choice for choice in found if not matters(best.mean, choice.known**2)]
    ranked = sorted([*ranked, *_successes(compare, found, threads, control, problems)], key=lambda choice: choice.error)
    if rival is None and not ranked:
        name = plans[0].model.name if plans else "cascade"
        why = f" ({problems[0]})" if problems else ""
        raise ModelError(
            f"{name}: no start value leads to a model of the record{why}; check channels, units, delay and length"
        )
    return ranked


def _best_of_kinds(choices: Sequence[Choice]) -> list[Choice]:
    """The best choice of every kind on the data that it was refined on, `COMPARED` at most, best first."""
    kinds = {(_kind(choice.model), choice.size): choice for choice in sorted(choices, key=lambda choice: -choice.known)}
    return sorted(kinds.values(), key=lambda choice: choice.known)[:COMPARED]


def _limits(steps: int, control: Control) -> Search:
    """The options of a refinement for a choice, with at most `steps` steps."""
    return Search(
        max_iterations=steps,
        tolerance=CHOICE_TOLERANCE,
        least_saving=CHOICE_SAVING,
        covariances=False,
        control=control.quietly(),
    )


def promising(
    plans: Sequence[Plan], part: Sequence[Record], how: Search, threads: int, control: Control
) -> Sequence[Plan]:
    """The `FINISHED` plans that are best after `FIRST_STEPS` steps of a search, continued from there; best first.

    Where every search fails, the plans are returned as they are, so that their refinement says why.
    """
    few = Search(max_iterations=FIRST_STEPS)

    def approach(plan: Plan) -> Choice:
        minimum, problem = search(plan.model, part, **(how | few | Search(correlated=plan.correlated)))
        error = float(np.sqrt(2 * minimum.cost / minimum.samples))
        return Choice(problem.model(minimum.estimate), UNKNOWN, error, plan.size, plan.family)

    found = sorted(_successes(approach, plans, threads, control, []), key=lambda choice: choice.known)
    best = found[:FINISHED]
    return [replace(plans[0], model=each.model, family=each.family, size=each.size) for each in best] or plans


def unseen_errors(
    model: Cascade, rounds: Sequence[Round], control: Control, rival: StretchErrors | None
) -> StretchErrors:
    """The free-run errors of a model on the unseen data of all splits, fitted again to the rest of each of several.

    Raises:
        ModelError: where a free run diverges, or the errors are much larger than those of the rival, if any; the other
            splits are then left out.
    """
    stretches, parts = STRETCHES // len(rounds), dict[int, StretchErrors]()
    for k in _hardest_first(rival, len(rounds)):
        fitted = model if len(rounds) == 1 else _refitted(model, rounds[k].known, control)
        parts[k] = StretchErrors.of(rounds[k].squared_errors(fitted), stretches)
        if not np.isfinite(parts[k].mean):
            raise ModelError(f"{model.name}: the free run diverges on the data held back")
        so_far = sum(float(part.means @ part.samples) for part in parts.values())
        if rival is not None and so_far > MUCH_WORSE * rival.means @ rival.samples:
            raise ModelError(f"{model.name}: the error on the data held back is much larger than that of another model")
    return StretchErrors.joined([parts[k] for k in range(len(rounds))])


def _hardest_first(rival: StretchErrors | None, rounds: int) -> list[int]:
    """The order of splits that excludes a poor model soonest: first those with most of the rival's error.

    Args:
        rival: errors of another model on all splits, one after the other, if there are any.
        rounds: the number of splits.
    """
    if rival is None:
        return list(range(rounds))
    errors = [float(part.sum()) for part in np.array_split(rival.means * rival.samples, rounds)]
    return sorted(range(rounds), key=lambda k: -errors[k])


def _refitted(model: Cascade, records: Sequence[Record], control: Control) -> Cascade:
    """A model that is fitted to all of the data, fitted to a part of them in a few steps."""
    minimum, problem = search(model, records, **_limits(REFIT_STEPS, control))
    return problem.model(minimum.estimate)


def _successes(
    step: Callable[[T], Choice], items: Sequence[T], threads: int, control: Control, problems: list[Exception]
) -> list[Choice]:
    """The results of a step for each item; errors of items that fail or diverge are added to ``problems``."""

    def attempt(item: T) -> Choice | None:
        try:
            choice = step(item)
        except (ModelError, np.linalg.LinAlgError) as problem:
            problems.append(problem)
            return None
        return choice if np.isfinite(choice.known) else None

    with in_threads(threads) as in_turn:
        found = [choice for choice in in_turn(attempt, items) if choice is not None]
    control.check()  # a refinement that was cut short is not compared
    return found


@dataclass(frozen=True, eq=False)
class Found:
    """The result of a search.

    Attributes:
        minimum, problem: from `search`.
        records: the records that it was fitted to.
    """

    minimum: Minimum
    problem: FreeRun
    records: Sequence[Record]

    @cached_property
    def model(self) -> Cascade:
        """The cascade at the minimum."""
        return self.problem.model(self.minimum.estimate)

    @cached_property
    def error(self) -> float:
        """Root mean square of its free-run error on the records that it was fitted to."""
        return float(np.sqrt(free_run_error(self.model, self.records)))

    @property
    def determined(self) -> float:
        """The number of parameters and initial states that the data determine, and no penalty."""
        square, variance = 2 * self.minimum.cost, self.minimum.noise_variance
        return self.minimum.samples - square / variance if variance > 0 else 0.0

    @property
    def drifts(self) -> bool:
        """Whether its free-run error is larger than that of the start."""
        before = np.concatenate(self.problem.residuals(self.problem.start))
        return not self.error <= np.sqrt(np.mean(before**2))


def searched(start: Cascade, records: Sequence[Record], **how: Unpack[Search]) -> Found:
    """`search`, with a free-run error on the records that is not larger than that of the start.

    States that are estimated together with a very slow pole can describe a drift. A free run, whose states are
    estimated from a few samples, cannot reproduce it. Then the states are estimated as in a free run, and fixed.
    """
    free = Found(*search(start, records, **how), records)
    control = how.get("control", FREE)
    if how.get("transient") is not None or control.ending or not free.drifts:
        return free
    how["transient"] = start.memory
    held = Found(*search(start, records, **how), records)
    if control.ending:
        return held
    # Repeat with states estimated for the new parameters.
    again = Found(*search(held.model, records, **how), records)
    return min(held, again, key=lambda found: found.error)


def with_steeper_jumps(found: Found, **how: Unpack[Search]) -> Found:
    """The fit, or one whose smooth jumps are half as wide, and half again, as long as the error falls.

    A filter before a jump cannot be fitted, as the derivative of the jump is zero, or infinite. A smooth one can; its
    width starts far above that of a jump, which only a filter close to that of the system shows.

    Args:
        found: from `searched`.
        how: of further searches.
    """
    while (start := with_steeper_maps(found.model)) is not None:
        steeper = searched(start, found.records, **how)
        before, after = (2 * each.minimum.cost / each.minimum.samples for each in (found, steeper))
        if how.get("control", FREE).ending or not matters(after, before):
            break
        found = steeper
    return found


def with_steeper_maps(cascade: Cascade) -> Cascade | None:
    """The cascade with smooth jumps that are half as wide; None if it has none."""
    blocks = tuple(block.steeper() if isinstance(block, StaticMap) else block for block in cascade.blocks)
    same = all(new is old for new, old in zip(blocks, cascade.blocks, strict=True))
    return None if same else replace(cascade, blocks=blocks)


def with_knots_at_bends(start: Cascade, records: Sequence[Record], control: Control) -> Cascade:
    """The cascade, or one whose splines have their knots where they bend, where Schwarz's criterion prefers that.

    A spline with few knots rounds a kink, wherever it is. The rounded curve shows where that is, so knots move there;
    the next curve shows it better.

    Args:
        start: the cascade.
        records: to compare fits on.
        control: when to stop.
    """
    if _at_bends(start, records) is None:
        return start
    best, kept = start, searched(start, records, **_limits(CHOICE_STEPS, control))
    for _ in range(PLACEMENTS):
        moved = _at_bends(kept.model, records)
        assert moved is not None
        found = searched(moved, records, **_limits(CHOICE_STEPS, control))
        control.check()
        # The place of the knots counts as one parameter.
        independent, more = effective_samples(found.minimum.residuals), found.determined - kept.determined + 1
        if not schwarz_gain(found.error**2, kept.error**2, independent, more) > 0:
            break
        best, kept = found.model, found
    return best


def _at_bends(cascade: Cascade, records: Sequence[Record]) -> Cascade | None:
    """The cascade with the knots of its maps where they bend; None if no map has such knots."""
    runs = [cascade.signals_from_rest(u) for u, _ in as_arrays(records)]
    blocks = tuple(
        block.at_bends(np.concatenate([signals[k] for signals in runs])) if isinstance(block, StaticMap) else block
        for k, block in enumerate(cascade.blocks)
    )
    same = all(new is old for new, old in zip(blocks, cascade.blocks, strict=True))
    return None if same else replace(cascade, blocks=blocks)


def simplest(choices: Sequence[Choice]) -> Choice:
    """The simplest choice that no more complex one improves by more than noise, see `better`.

    A complex model with a larger free-run error than a simpler one on the data that it was refined on is not chosen.
    """
    chosen, *others = sorted(choices, key=lambda choice: (len(choice.model.parameters), choice.error))
    for choice in others:
        if better(choice.unseen, chosen.unseen) and choice.known < chosen.known:
            chosen = choice
    return chosen


def evident(choice: Choice, simpler: Choice, weights: int = 0) -> bool:
    """Whether the data that two models were refined on show that the larger one is better, by Schwarz's criterion.

    Correlated errors, as those of a wrong model, contain fewer independent samples.

    Args:
        choice: the larger model.
        simpler: the other one.
        weights: how many weights of penalties the data have chosen besides; each counts as one more parameter.
    """
    more = choice.determined - simpler.determined + weights
    return schwarz_gain(choice.known**2, simpler.known**2, choice.independent, more) > 0


def _kind(cascade: Cascade) -> tuple[tuple[str, int], ...]:
    """The type and the number of parameters of every block."""
    return tuple((type(block).__name__, len(block.parameters)) for block in cascade.blocks)
