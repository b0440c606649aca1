"""Choice of start values, static map and size by the free-run error on unseen data.

For each oversampling, pairs of filters from all sources of `starts` are scored by one linear problem each. `fitting`
refines the best few on a part of the record, on all cores, and their free run on unseen data ranks them. The family of
the static map, if none is given, and then its size (knots, degree) are chosen in the same way. All comparisons use free
runs, not one-step predictions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar, Unpack

import numpy as np

from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import FreeRun, Search, search
from emsid.models.blocks.search.cross_validation import Round, as_arrays, delayed, shortened
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.search.orders import map_sizes, order_shares, oversamplings, sign_recovery_orders, total_orders
from emsid.models.blocks.search.starts import (
    RANDOM_DRAWS,
    Candidate,
    Filters,
    grown,
    linear_candidates,
    random_candidates,
    regression_candidate,
    scanned,
    sign_recovery_candidates,
    started,
)
from emsid.models.blocks.search.topologies import CascadeSearch, Orders, Topology
from emsid.models.free_run import free_run_error
from emsid.models.one_channel import Segments
from emsid.record import Record
from emsid.record.holding_back import SHORT
from emsid.selection.improvement import STRETCHES, StretchErrors, better, matters

T = TypeVar("T")

# Candidates refined per oversampling, without and with random starts.
REFINED, REFINED_RANDOM = 4, 24
# More starts than this take `FIRST_STEPS` steps each, and only the best so many are refined further.
FINISHED, FIRST_STEPS = 12, 5
# The number of these that continue with a map of the required family; fits to a short record take little time.
REFINED_MAPS, REFINED_MAPS_SHORT = 2, 6
# Filters are the same if no coefficient differs by more than this part of the largest.
SAME = 1e-3
# Limits of a refinement for a choice: steps, distance to the minimum in standard errors, and relative reduction of the
# cost over a few steps.
CHOICE_STEPS, CHOICE_TOLERANCE, CHOICE_SAVING = 25, 0.2, 1e-3
# Of a short record only this many kinds of model are compared by cross-validation. The others are worse on the data
# that they were refined on.
COMPARED = 4
# Steps of a fit to the parts of a short record that are not held back: it starts at the minimum of the whole. A sum of
# squared errors on unseen data that is this many times larger than that of another model ends a comparison.
REFIT_STEPS, HOPELESS = 5, 2.0
# Random starts and recovered signs are tried unless the error of another start is below this fraction of the output. In
# a short record they take little time.
LINEAR_SUFFICES, SUFFICES_SHORT = 0.5, 0.2
# The error of a model that has not been run on unseen data.
UNKNOWN = StretchErrors.of(np.array([np.inf]))


@dataclass(frozen=True, eq=False)
class Choice:
    """A refined model, to be compared with others.

    Attributes:
        model: the model with all its parameters.
        unseen: its free-run error on unseen data.
        known: the same on the data that it was refined on.
        size: the size of its map.
        family: the family of its map; None for a trial map.
    """

    model: Cascade
    unseen: StretchErrors
    known: float
    size: int = 0
    family: Family | None = None

    @property
    def error(self) -> float:
        """Root mean square of its free-run error on unseen data."""
        return float(np.sqrt(self.unseen.mean))


@dataclass(frozen=True, eq=False)
class Plan:
    """A model to refine, with the family and size of its map, unless it is a trial map.

    A trial map that another kind of curve replaces need not be believed: it follows slow residuals (`correlated`).
    """

    model: Cascade
    family: Family | None = None
    size: int = 0
    correlated: bool = True


def improving(
    topology: Topology,
    shown: Sequence[Record],
    rounds: Sequence[Round],
    orders: Orders,
    settings: CascadeSearch,
    template: Cascade,
    control: Control = FREE,
) -> Iterator[Choice]:
    """Successive choices, each better than the previous; first the filters with a trial map, then the map."""
    part, families = shortened(shown), settings.families
    sizes = {family: map_sizes(family, topology, shown, orders, settings) for family in families}
    leading, short = families[0], len(rounds) > 1
    direct = leading.direct and not topology.outer
    typical = _typical(leading, sizes[leading][int(direct) :] or sizes[leading], short)
    best: Choice | None = None
    for rate in oversamplings(shown) if settings.oversampling is None else (settings.oversampling,):
        control.doing(f"start values at {rate} times the sampling rate")
        starts = _starts(topology, shown, orders, settings, replace(template, oversampling=rate), control)
        control.doing(f"refining {len(starts)} of them")
        plans = [Plan(start, correlated=leading.smooth) for start in starts]
        if direct:
            plans = [Plan(start, leading, sizes[leading][0]) for start in starts]
        refined = _refined(plans, part, rounds, settings.threads, control, best)
        if refined and (not direct or (short and len(sizes[leading]) > 1)):
            first = _simplest(refined, _complexity)
            refined = [first, *(choice for choice in refined if choice is not first)]
            control.doing(f"static map: {leading.name}")
            placed = [
                Plan(_with_map(choice.model, topology, leading, typical, part), leading, typical)
                for choice in refined[: REFINED_MAPS_SHORT if short else REFINED_MAPS]
            ]
            kept = refined if direct else []
            refined = [*kept, *_refined(placed, part, rounds, settings.threads, control, best)]
        if refined:
            choice = _simplest(refined, _complexity)
            if best is None or better(choice.unseen, best.unseen):
                best = choice
                yield best
    assert best is not None

    def refined_further(best: Choice, others: Sequence[tuple[Family, int]]) -> Choice:
        plans = [Plan(_with_map(best.model, topology, family, size, part), family, size) for family, size in others]
        found = _refined(plans, part, rounds, settings.threads, control, best) if plans else []
        return _simplest([best, *found], _complexity)

    if len(families) > 1:
        control.doing("family of the static map")
        best = refined_further(best, [(family, _typical(family, sizes[family], False)) for family in families[1:]])
        yield best
    assert best.family is not None
    if best.family.smooth:
        return
    control.doing(f"size of the {best.family.name}")
    yield refined_further(best, [(best.family, size) for size in sizes[best.family] if size != best.size])


LARGE = 3
"""Filters of this order or more may miss the minimum of smaller ones from their own starts."""


def from_smaller(
    best: Choice,
    topology: Topology,
    shown: Sequence[Record],
    rounds: Sequence[Round],
    orders: Orders,
    settings: CascadeSearch,
    template: Cascade,
    control: Control = FREE,
) -> Choice:
    """The choice for given orders from `LARGE` on, or that which begins at the minimum of a model one order lower.

    A larger model has more minima and may be started far from its best. The smaller one is in it, with poles that zeros
    cancel; so a larger model never fits its own data worse.
    """
    given = [order for order in orders if order is not None]
    if len(given) != topology.first + topology.second or min(given) < LARGE:
        return best
    lower = (None if orders[0] is None else orders[0] - 1, None if orders[1] is None else orders[1] - 1)
    same = replace(settings, static=best.family or settings.static)
    with suppress(ModelError):  # without a start for the smaller one
        *_, small = improving(topology, shown, rounds, lower, same, template, control)
        control.doing("from the minimum of a smaller model")
        plan = Plan(grown(small.model, orders), small.family, small.size)
        (larger,) = _refined([plan], shortened(shown), rounds, settings.threads, control)
        return min(best, larger, key=lambda choice: choice.known)
    return best


def _typical(family: Family, sizes: Sequence[int], short: bool) -> int:
    """The size that compares a family with others: the first of a short record or a smooth map, or else the middle."""
    return sizes[0] if short or family.smooth else sizes[len(sizes) // 2]


def _simplest(choices: Sequence[Choice], complexity: Callable[[Choice], int]) -> Choice:
    """The simplest choice that no more complex one improves by more than noise, see `better`.

    A complex model with a larger free-run error than a simpler one on the data that it was refined on is not chosen.
    """
    chosen, *others = sorted(choices, key=lambda choice: (complexity(choice), choice.error))
    for choice in others:
        if better(choice.unseen, chosen.unseen) and choice.known < chosen.known:
            chosen = choice
    return chosen


def _complexity(choice: Choice) -> int:
    return len(choice.model.parameters)


def _starts(
    topology: Topology,
    records: Sequence[Record],
    orders: Orders,
    settings: CascadeSearch,
    template: Cascade,
    control: Control,
) -> list[Cascade]:
    """The cascades to refine, from all sources, best first; the best of every order precede the rest.

    Raises:
        Stopped: by ``control``.
    """
    segments = delayed(records, template.delay)
    rng = np.random.default_rng(0) if settings.rng is None else settings.rng
    leading = settings.families[0]
    if leading.loses_sign and topology.first:
        recovered = _sign_recovery_starts(topology, segments, orders, settings, template, rng, control)
        if recovered:
            return [candidate.cascade for candidate in recovered]
    totals = total_orders(topology, segments, orders, settings.period)
    pairs: list[Filters] = []
    for total in totals:
        for first, second in order_shares(topology, orders, total):
            control.check()
            with suppress(ModelError):  # too short for a frequency response: the other sources remain
                pairs += linear_candidates(segments, (first, second), total, template.oversampling, settings.period)
            if topology.second and template.oversampling == 1:
                with suppress(ModelError):
                    _, behind = regression_candidate(records, second or 0, 3, max(template.delay, 0))
                    pairs.append((_through(first) if topology.first else None, behind))
    control.check()
    found = scanned(pairs, segments, leading.trial, template, settings.threads)
    level = float(np.std(np.concatenate([y for _, y in segments])))
    enough = SUFFICES_SHORT if sum(len(y) for _, y in segments) < SHORT else LINEAR_SUFFICES
    if (found and found[0].error < enough * level) or template.oversampling > 1:
        return refined_first([candidate.cascade for candidate in found])
    if topology.first:  # a map that is even about some level looks like no linear relation at all
        found += _sign_recovery_starts(topology, segments, orders, settings, template, rng, control)
    draws: list[Filters] = []
    shares = order_shares(topology, orders, totals[-1])
    for first, second in shares:
        draws += random_candidates((first, second), len(segments[0][0]), rng, RANDOM_DRAWS // len(shares))
    found += scanned(draws, segments, leading.trial, template, settings.threads)
    found.sort(key=lambda candidate: candidate.error)
    return [candidate.cascade for candidate in found[:REFINED_RANDOM]]


def _sign_recovery_starts(
    topology: Topology,
    segments: Segments,
    orders: Orders,
    settings: CascadeSearch,
    template: Cascade,
    rng: np.random.Generator,
    control: Control,
) -> list[Candidate]:
    """Cascades with filters found by recovering the signs that a map before the output has lost."""
    found: list[Candidate] = []
    for share in sign_recovery_orders(topology, orders):
        with suppress(ModelError):
            for pair, level in sign_recovery_candidates(segments, share, rng, control):
                around = replace(template, input_offset=level)
                found += scanned([pair], segments, settings.families[0].trial, around, settings.threads)
    return found


def _kind(cascade: Cascade) -> tuple[tuple[str, int], ...]:
    """The type and the number of parameters of every block."""
    return tuple((type(block).__name__, len(block.parameters)) for block in cascade.blocks)


def refined_first(starts: Sequence[Cascade]) -> list[Cascade]:
    """The starts to refine, best first: the best of every pair of orders, and the best others, `REFINED` at least.

    Poles and zeros of a measured response are not exact, so the filters that divide them as the system does may rank
    behind others until all are refined. A zero far from the unit circle may be in either filter; that start is taken
    once.

    Args:
        starts: best first, with one filter or two.
    """
    starts = [start for k, start in enumerate(starts) if not k or not _same_filters(start, starts[k - 1])]
    orders = [tuple(len(b.denominator) for b in start.blocks if isinstance(b, Rational)) for start in starts]
    ahead = [k for k, each in enumerate(orders) if each not in orders[:k]]
    behind = [k for k in range(len(starts)) if k not in ahead]
    several = len(ahead) - 1 if orders and len(orders[0]) > 1 else 0
    return [starts[k] for k in (ahead + behind)[: REFINED + several]]


def _same_filters(start: Cascade, other: Cascade) -> bool:
    """Whether two starts have the same filters, up to rounding."""
    one, two = ([each for b in c.blocks if isinstance(b, Rational) for each in b.transfer] for c in (start, other))
    return len(one) == len(two) and all(
        len(a) == len(b) and np.abs(a - b).max() < SAME * np.abs(a).max() for a, b in zip(one, two, strict=True)
    )


def _refined(
    plans: Sequence[Plan],
    part: Sequence[Record],
    rounds: Sequence[Round],
    threads: int,
    control: Control,
    rival: Choice | None = None,
) -> list[Choice]:
    """The plans refined on a part of the data and ranked by cross-validation, best first; failures are left out.

    Plans that are worse than the rival, if there is one, are left out too, so the list may be empty.

    Raises:
        ModelError: if there is no rival and every plan fails.
    """
    budget: Search = {
        "max_iterations": CHOICE_STEPS,
        "tolerance": CHOICE_TOLERANCE,
        "least_saving": CHOICE_SAVING,
        "covariances": False,
        "control": control.quietly(),
    }

    def refine(plan: Plan) -> Choice:
        found = searched(plan.model, part, **(budget | Search(correlated=plan.correlated)))
        return Choice(found.model, UNKNOWN, found.error, plan.size, plan.family)

    def compare(choice: Choice) -> Choice:
        return replace(choice, unseen=unseen_errors(choice.model, rounds, control, best))

    problems: list[Exception] = []
    if len(plans) > FINISHED:
        plans = promising(plans, part, budget, threads, control)
    refined = _successes(refine, plans, threads, control, problems)
    ranked: list[Choice] = []
    best = None if rival is None or len(rounds) == 1 else rival.unseen
    if len(rounds) > 1:  # every split costs a fit, so only the best of each kind is compared
        kinds = {(_kind(each.model), each.size): each for each in sorted(refined, key=lambda each: -each.known)}
        refined = sorted(kinds.values(), key=lambda each: each.known)[:COMPARED]
        if rival is None:
            ranked, refined = _successes(compare, refined[:1], threads, control, problems), refined[1:]
            best = ranked[0].unseen if ranked else None
        if best is not None:
            # A choice that is worse than this on the data that it was refined on cannot be the best on unseen data.
            refined = [choice for choice in refined if not matters(best.mean, choice.known**2)]
    ranked = sorted(
        [*ranked, *_successes(compare, refined, threads, control, problems)], key=lambda choice: choice.error
    )
    if rival is None and not ranked:
        name = plans[0].model.name if plans else "cascade"
        why = f" ({problems[0]})" if problems else ""
        raise ModelError(
            f"{name}: no start value leads to a model of the record{why}; check channels, units, delay and length"
        )
    return ranked


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

    found = sorted(_successes(approach, plans, threads, control, []), key=lambda each: each.known)
    best = found[:FINISHED]
    return [replace(plans[0], model=each.model, family=each.family, size=each.size) for each in best] or plans


def unseen_errors(
    model: Cascade, rounds: Sequence[Round], control: Control, rival: StretchErrors | None
) -> StretchErrors:
    """The free-run errors of a model on the unseen data of all splits, fitted again to the rest of each of several.

    Raises:
        ModelError: where a free run diverges, or the errors are hopelessly larger than those of the rival, if any; the
            other splits are not looked at then.
    """
    parts: list[StretchErrors] = []
    for each in rounds:
        fitted = model if len(rounds) == 1 else _refitted(model, each.known, control)
        parts.append(StretchErrors.of(each.squared_errors(fitted), STRETCHES // len(rounds)))
        if not np.isfinite(parts[-1].mean):
            raise ModelError(f"{model.name}: the free run diverges on the data held back")
        so_far = sum(float(part.means @ part.samples) for part in parts)
        if rival is not None and so_far > HOPELESS * rival.means @ rival.samples:
            raise ModelError(f"{model.name}: the error on the data held back is much larger than that of another model")
    return StretchErrors.joined(parts)


def _refitted(model: Cascade, records: Sequence[Record], control: Control) -> Cascade:
    """A model that is fitted to all of the data, fitted to a part of them in a few steps."""
    minimum, problem = search(
        model,
        records,
        max_iterations=REFIT_STEPS,
        tolerance=CHOICE_TOLERANCE,
        least_saving=CHOICE_SAVING,
        covariances=False,
        control=control.quietly(),
    )
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

    with ThreadPoolExecutor(threads) as pool:
        found = [choice for choice in pool.map(attempt, items) if choice is not None]
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


def _with_map(model: Cascade, topology: Topology, family: Family, size: int, part: Sequence[Record]) -> Cascade:
    """The model with its map, and the outer map if any, replaced by one of the family.

    The outer map starts as a straight line; an outer map of the same family is kept.
    """
    segments = as_arrays(part)
    start = started(model, lambda x, z: family.start(x, z, size), segments)
    if topology.outer and len(start.blocks) > 2 and type(start.blocks[0]) is not type(start.blocks[-1]):
        start = started(start, lambda x, z: family.start(x, z, size), segments, -1)
    if topology.outer and len(start.blocks) == 2:
        y = np.concatenate([start.output(u, start.resting(float(u[0]))) for u, _ in segments])
        start = replace(start, blocks=(*start.blocks, family.start(y, y, size)), output_offset=0.0)
    return start


def with_spread_knots(
    choice: Choice, topology: Topology, orders: Orders, records: Sequence[Record], settings: CascadeSearch
) -> Cascade:
    """The model of the choice with knots spread over all data; a smooth map gets as many as its family has."""
    family = choice.family
    if family is None or not family.sizes or len(choice.model.blocks) < 2:
        return choice.model
    size = map_sizes(family, topology, records, orders, settings)[-1] if family.smooth else choice.size
    return started(choice.model, lambda x, z: family.start(x, z, size), as_arrays(records))


def _through(order: int | None) -> Rational:
    """A filter of this order that passes its input on."""
    size = order or 0
    return Rational(np.eye(size + 1)[0], np.zeros(size))
