r"""Wiener–Hammerstein models and their relatives from records alone.

`wiener_hammerstein`, `hammerstein`, `wiener` and `hammerstein_wiener` need no more than a record. What is not given is
chosen on held-back data, the last quarter of every record, or the records given as ``validation``. A quarter of a short
record says little; there each quarter is held back in turn:

1. the order, by the description length of a rational fit to the measured frequency response;
2. the input delay, the least with which that order fits the response;
3. for each oversampling to be tried, pairs of filters from all sources of `starts`, each scored by one linear problem;
4. the best few refined by `fit_cascade` on a part of the record, on all cores, and judged by their held-back free run;
5. the family of the static map likewise, where none is given, and then its size (knots, degree);
6. the winner fitted to all identification data.

Free runs are compared throughout, never one-step predictions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.frequency_response import fit_rational, frequency_response
from emsid.estimation.gauss_newton import Iteration, Minimum
from emsid.estimation.least_squares import check_excitation
from emsid.estimation.losses import SQUARES, Loss
from emsid.estimation.threads import one_blas_thread
from emsid.models.cascade import (
    SAMPLES_PER_STATE,
    Cascade,
    FreeRun,
    check_channels,
    conclude,
    fit_cascade,
    search,
)
from emsid.models.families import COULOMB, DEAD_ZONE, PIECEWISE_LINEAR, POLYNOMIAL, SATURATION, SPLINE, Family
from emsid.models.filters import Rational
from emsid.models.starts import (
    Filters,
    linear_candidates,
    random_candidates,
    regression_candidate,
    scanned,
    started,
    unfolded_candidates,
)
from emsid.models.static_maps import CubicSpline, DeadZone, PiecewiseLinear, Saturation, StaticMap
from emsid.models.terms import check_whole
from emsid.record import Record, concatenate

Array = NDArray[np.float64]
Progress = Callable[[str, Iteration | None], None]
T = TypeVar("T")
# What identifies and what judges.
Round = tuple[Sequence[Record], Sequence[Record]]

# How much of each record serves to identify while choices are made; the rest judges them.
IDENTIFY = 0.75
# Records of fewer samples together are short: each of so many parts judges once.
SHORT, FOLDS = 4_000, 4
# Refinements for a choice see no more samples than this, and take no more steps.
CHOICE_SAMPLES, CHOICE_STEPS = 8_000, 25
# So many segments of about one length are a series of experiments.
SERIES = 8
# Candidates refined per oversampling, and where chance had to help.
REFINED, REFINED_RANDOM = 4, 24
# Of these, how many go on with a map of the family asked for.
REFINED_MAPS = 2
# How many standard errors from the minimum a refinement for a choice may end, and what a few more steps must save.
CHOICE_TOLERANCE, CHOICE_WORTH = 0.2, 1e-3
# Chance is not called in where a start leaves less than this part of the output unexplained.
LINEAR_SUFFICES = 0.5
# A more complex alternative must be this much better on held-back data.
WORTH = 0.98
LARGEST_ORDER = 8
# Where there are two filters, so many orders below that of the response are tried.
LOWER = 2
# Orders tried before and behind a map that loses the sign.
FOLDED_FIRST, FOLDED_SECOND = (1, 2, 3, 4), (0, 1)
# The longest delay looked for; one is as good as another within this part of the squared error and the noise of it.
LONGEST_DELAY, DELAY_SLACK = 20, 0.1
# An input that keeps its value this often from one sample to the next is held between them.
HELD = 0.5
# Every parameter should have this many samples to it.
SAMPLES_PER_PARAMETER = 5
# What `advice` calls seldom (part of the samples), cancelled (part of the distance to the unit circle) and straight.
SELDOM, CANCELS, STRAIGHT = 0.002, 0.05, 0.01


@dataclass(frozen=True)
class Layout:
    """Which filters a structure has beside the map that is looked for.

    Attributes:
        name: of the structure.
        first, second: whether there is a filter before the map, and one after it.
        outer: whether a second map follows the second filter.
    """

    name: str
    first: bool
    second: bool
    outer: bool = False


WIENER_HAMMERSTEIN = Layout("wiener-hammerstein", first=True, second=True)
HAMMERSTEIN = Layout("hammerstein", first=False, second=True)
WIENER = Layout("wiener", first=True, second=False)
HAMMERSTEIN_WIENER = Layout("hammerstein-wiener", first=False, second=True, outer=True)

LAYOUTS: dict[str, Layout] = {
    layout.name: layout for layout in (WIENER_HAMMERSTEIN, HAMMERSTEIN, WIENER, HAMMERSTEIN_WIENER)
}


@dataclass(frozen=True, eq=False)
class Options:
    """What may be given to the estimation of a cascade; what is None is chosen on held-back data.

    Attributes:
        static: family of the static map, see `families`; None chooses among `CHOSEN_FAMILIES`.
        size: its number of knots, or degree; given without a family, it is one of a spline.
        delay: from the input to its first effect, in samples.
        oversampling: how many times faster than the record the blocks run; None tries 1 and 2.
        validation: records that judge the choices, in place of the last quarter of the identification records.
        skip: samples left out at the start of every segment; None estimates the starting states.
        loss: what the final fit minimises.
        workers: threads for what can be tried at the same time.
        max_iterations, max_seconds: budget of the final fit.
        rng: source of the random starts.
        progress: called with what is being done, and with every step of the final fit.

    Raises:
        ModelError: for numbers that are no counts.
    """

    static: Family | None = SPLINE
    size: int | None = None
    delay: int | None = None
    oversampling: int | None = None
    validation: Record | Sequence[Record] | None = None
    skip: int | None = None
    loss: Loss = SQUARES
    workers: int = 2
    max_iterations: int = 150
    max_seconds: float = np.inf
    rng: np.random.Generator | None = None
    progress: Progress | None = None

    def __post_init__(self) -> None:
        for what, value, least, why in (
            ("delay", self.delay, 0, "a model cannot look ahead"),
            ("oversampling", self.oversampling, 1, "blocks run at least as fast as the record"),
            ("size", self.size, 0, "this is a number of knots, or a degree"),
            ("skip", self.skip, 0, "these are samples to be left out"),
            ("workers", self.workers, 1, "somebody has to do the work"),
        ):
            if value is not None:
                check_whole(what, value, least, why)

    @property
    def families(self) -> tuple[Family, ...]:
        """Those that the map may be of."""
        if self.static is None:
            return CHOSEN_FAMILIES if self.size is None else (SPLINE,)
        return (self.static,)

    def tell(self, what: str, iteration: Iteration | None = None) -> None:
        """Report progress, if anybody listens."""
        if self.progress is not None:
            self.progress(what, iteration)


# What a map may be where nobody says; the spline leads, as trials are splines.
CHOSEN_FAMILIES = (SPLINE, PIECEWISE_LINEAR, POLYNOMIAL, DEAD_ZONE, SATURATION, COULOMB)

DEFAULTS = Options()


def wiener_hammerstein(
    records: Record | Sequence[Record], orders: tuple[int, int] | None = None, options: Options = DEFAULTS
) -> Fit[Cascade]:
    """Filter, static map, filter.

    Args:
        records: one input and one output each.
        orders: of the two filters; each has as many poles, and one numerator coefficient more.
        options: everything else.

    Raises:
        ModelError: for records of other channels or too short for the orders, an input that does not excite the map.
    """
    return estimate(WIENER_HAMMERSTEIN, records, orders or (None, None), options)


def hammerstein(
    records: Record | Sequence[Record], order: int | None = None, options: Options = DEFAULTS
) -> Fit[Cascade]:
    """Static map, then a filter of this order.

    Args:
        records, options: as in `wiener_hammerstein`.
        order: of the filter, chosen on held-back data where it is None.
    """
    return estimate(HAMMERSTEIN, records, (None, order), options)


def wiener(records: Record | Sequence[Record], order: int | None = None, options: Options = DEFAULTS) -> Fit[Cascade]:
    """A filter of this order, then a static map.

    Args:
        records, options: as in `wiener_hammerstein`.
        order: of the filter, chosen on held-back data where it is None.
    """
    return estimate(WIENER, records, (order, None), options)


def hammerstein_wiener(
    records: Record | Sequence[Record], order: int | None = None, options: Options = DEFAULTS
) -> Fit[Cascade]:
    """Static map, a filter of this order, and a second map of the same family.

    Args:
        records, options: as in `wiener_hammerstein`.
        order: of the filter, chosen on held-back data where it is None.
    """
    return estimate(HAMMERSTEIN_WIENER, records, (None, order), options)


@one_blas_thread()
def estimate(
    layout: Layout,
    records: Record | Sequence[Record],
    orders: tuple[int | None, int | None],
    options: Options,
) -> Fit[Cascade]:
    """A structure of any of the layouts; see `wiener_hammerstein`.

    Ctrl-C ends it with the best model so far and `Ending.INTERRUPTED`, once there is one.
    """
    several = [records] if isinstance(records, Record) else list(records)
    if not several:
        raise ModelError(f"{layout.name}: no record to identify from; give one or several")
    template = Cascade((Rational(np.ones(1)),), name=layout.name)
    for record in several:
        check_channels(template, record)
    _check_excitation(layout, several)
    _check_size(layout, several, orders, options)
    shown, rounds = _held_back(several, options)
    _check_judges(layout, rounds, orders)
    delay = options.delay
    if delay is None:
        delay = 0 if options.families[0].folds else _delay(layout, _pairs(shown), orders)
    longest = max(len(u) for u, _ in _pairs(shown))
    if delay >= longest:
        raise ModelError(f"{layout.name}: a delay of {delay} in a stretch of {longest} samples; give a smaller one")
    template = replace(template, delay=delay)
    best: Choice | None = None
    try:
        for choice in _improving(layout, shown, rounds, orders, options, template):
            best = choice
        assert best is not None
        options.tell(f"fitting {layout.name} to all data")
        found = _searched(
            _placed(best, several, options),
            several,
            skip=options.skip,
            loss=options.loss,
            max_iterations=options.max_iterations,
            max_seconds=options.max_seconds,
            progress=lambda iteration: options.tell(f"fitting {layout.name}", iteration),
        )
        return conclude(found.minimum, found.problem, options.loss)
    except KeyboardInterrupt:
        if best is None:
            raise
        fit = fit_cascade(best.model, several, skip=options.skip, max_iterations=0)
        return replace(fit, ending=Ending.INTERRUPTED, message="interrupted during the choices; the best is kept")


# -------------------------------------------------------------------------------------------------------- choices


@dataclass(frozen=True, eq=False)
class Choice:
    """A refined model on its way to be chosen.

    Attributes:
        model: with all its parameters.
        error: root mean square of its held-back free-run error.
        known: the same on the data that it was refined on.
        size: of its map.
        family: of its map, None for a trial map.
    """

    model: Cascade
    error: float
    known: float
    size: int = 0
    family: Family | None = None


@dataclass(frozen=True, eq=False)
class Plan:
    """A model to be refined, with the family and size of its map, if that is no trial map."""

    model: Cascade
    family: Family | None = None
    size: int = 0


def _improving(
    layout: Layout,
    shown: Sequence[Record],
    rounds: Sequence[Round],
    orders: tuple[int | None, int | None],
    options: Options,
    template: Cascade,
) -> Iterator[Choice]:
    """Better and better choices, the last one final: first the filters, with a trial map, then the map."""
    part, families = _shortened(shown), options.families
    sizes = {family: _sizes(family, layout, shown, orders, options) for family in families}
    direct = families[0].direct and not layout.outer
    best: Choice | None = None
    for rate in _rates(shown) if options.oversampling is None else (options.oversampling,):
        options.tell(f"start values at {rate} times the sampling rate")
        starts = _starts(layout, shown, orders, options, replace(template, oversampling=rate))
        options.tell(f"refining {len(starts)} of them")
        plans = [Plan(start, families[0], sizes[families[0]][0]) if direct else Plan(start) for start in starts]
        refined = _refined(plans, part, rounds, options.workers)
        if not refined:
            continue
        first = _simplest(refined, _complexity)
        refined = [first, *(choice for choice in refined if choice is not first)]
        if not direct:
            options.tell(f"static map: {families[0].name}")
            typical = sizes[families[0]][len(sizes[families[0]]) // 2]
            placed = [
                Plan(_with_map(choice.model, layout, families[0], typical, part), families[0], typical)
                for choice in refined[:REFINED_MAPS]
            ]
            refined = _refined(placed, part, rounds, options.workers)
        choice = _simplest(refined, _complexity)
        if best is None or choice.error < WORTH * best.error:
            best = choice
            yield best
    assert best is not None

    def better(best: Choice, others: Sequence[tuple[Family, int]]) -> Choice:
        plans = [Plan(_with_map(best.model, layout, family, size, part), family, size) for family, size in others]
        found = _refined(plans, part, rounds, options.workers, rival=best) if plans else []
        return _simplest([best, *found], _complexity)

    if len(families) > 1:
        options.tell("family of the static map")
        best = better(best, [(family, sizes[family][len(sizes[family]) // 2]) for family in families[1:]])
        yield best
    assert best.family is not None
    options.tell(f"size of the {best.family.name}")
    yield better(best, [(best.family, size) for size in sizes[best.family] if size != best.size])


def _simplest(choices: Sequence[Choice], complexity: Callable[[Choice], int]) -> Choice:
    """The choice to which nothing more complex is worth its complexity.

    A complex model that runs worse than a simpler one even on what it was refined on was lucky where it was judged.
    """
    chosen, *others = sorted(choices, key=lambda choice: (complexity(choice), choice.error))
    for choice in others:
        if choice.error < WORTH * chosen.error and choice.known < chosen.known:
            chosen = choice
    return chosen


def _complexity(choice: Choice) -> int:
    return len(choice.model.parameters)


def _starts(
    layout: Layout,
    records: Sequence[Record],
    orders: tuple[int | None, int | None],
    options: Options,
    template: Cascade,
) -> list[Cascade]:
    """The cascades worth refining, from all sources, best first; the best of every order before the rest."""
    segments = _delayed(records, template.delay)
    rng = np.random.default_rng(0) if options.rng is None else options.rng
    leading = options.families[0]
    if leading.folds and layout.first:
        unfolding = []
        for share in _folded_shares(layout, orders):
            with suppress(ModelError):
                for pair, level in unfolded_candidates(segments, share, rng):
                    around = replace(template, input_offset=level)
                    unfolding += scanned([pair], segments, leading.trial, around, options.workers)
        if unfolding:
            return [candidate.cascade for candidate in unfolding]
    totals = _totals(layout, segments, orders)
    pairs: list[Filters] = []
    for total in totals:
        for first, second in _shares(layout, orders, total):
            with suppress(ModelError):  # too short for a frequency response: the other sources remain
                pairs += linear_candidates(segments, (first, second), total, template.oversampling)
            if layout.second and template.oversampling == 1:
                with suppress(ModelError):
                    _, behind = regression_candidate(records, second or 0, 3, max(template.delay, 0))
                    pairs.append((_through(first) if layout.first else None, behind))
    found = scanned(pairs, segments, leading.trial, template, options.workers)
    level = float(np.std(np.concatenate([y for _, y in segments])))
    if (found and found[0].error < LINEAR_SUFFICES * level) or template.oversampling > 1:
        best_of_order = {_order(candidate.cascade): candidate for candidate in reversed(found)}
        ahead = [candidate for candidate in found if candidate in best_of_order.values()]
        behind_them = [candidate for candidate in found if candidate not in ahead]
        # With two filters it takes several starts of an order to find how its poles are shared out.
        lower = len(ahead) - 1 if layout.first and layout.second else 0
        return [candidate.cascade for candidate in (ahead + behind_them)[: REFINED + lower]]
    draws: list[Filters] = []
    for first, second in _shares(layout, orders, totals[-1]):
        draws += random_candidates((first, second), len(segments[0][0]), rng)
    found += scanned(draws, segments, leading.trial, template, options.workers)
    found.sort(key=lambda candidate: candidate.error)
    return [candidate.cascade for candidate in found[:REFINED_RANDOM]]


def _kind(cascade: Cascade) -> tuple[tuple[str, int], ...]:
    """What every block is, and how many parameters it has."""
    return tuple((type(block).__name__, len(block.parameters)) for block in cascade.blocks)


def _order(cascade: Cascade) -> int:
    return sum(len(block.denominator) for block in cascade.blocks if isinstance(block, Rational))


def _refined(
    plans: Sequence[Plan],
    part: Sequence[Record],
    rounds: Sequence[Round],
    workers: int,
    rival: Choice | None = None,
) -> list[Choice]:
    """The plans refined on a part of the data and judged round by round, best first; failures are left out.

    So are those that are no match for the rival, if there is one; then nothing need be left.

    Raises:
        ModelError: where one is needed and none is left.
    """
    budget: dict[str, Any] = {"max_iterations": CHOICE_STEPS, "tolerance": CHOICE_TOLERANCE, "worth": CHOICE_WORTH}

    def refine(plan: Plan) -> Choice:
        found = _searched(plan.model, part, **budget)
        return Choice(found.model, np.inf, found.error, plan.size, plan.family)

    def judge(choice: Choice) -> Choice:
        models = [
            choice.model if len(rounds) == 1 else _searched(choice.model, rest, **budget).model for rest, _ in rounds
        ]
        held = [_free_run_error(model, unseen) for model, (_, unseen) in zip(models, rounds, strict=True)]
        return replace(choice, error=float(np.sqrt(np.mean(np.square(held)))))

    problems: list[Exception] = []
    refined = _successes(refine, plans, workers, problems)
    judged: list[Choice] = []
    if len(rounds) > 1:  # every round costs a fit, which only the best of its kind is worth
        kinds = {(_kind(each.model), each.size): each for each in sorted(refined, key=lambda each: -each.known)}
        refined = sorted(kinds.values(), key=lambda each: each.known)
        if rival is None:
            judged, refined = _successes(judge, refined[:1], workers, problems), refined[1:]
        # All data judge in turn, so that what is worse than this even on what it was refined on has lost.
        best = min((choice.error for choice in (*judged, rival) if choice), default=np.inf)
        refined = [choice for choice in refined if choice.known < best / WORTH]
    judged = sorted([*judged, *_successes(judge, refined, workers, problems)], key=lambda choice: choice.error)
    if rival is None and not judged:
        name = plans[0].model.name if plans else "cascade"
        why = f" ({problems[0]})" if problems else ""
        raise ModelError(f"{name}: no start describes the record{why}; check channels, units, delay and length")
    return judged


def _successes(
    step: Callable[[T], Choice], items: Sequence[T], workers: int, problems: list[Exception]
) -> list[Choice]:
    """What a step gives for each item, where it does not fail or run away; why others fail joins the problems."""

    def attempt(item: T) -> Choice | None:
        try:
            choice = step(item)
        except (ModelError, np.linalg.LinAlgError) as problem:
            problems.append(problem)
            return None
        return None if np.isnan([choice.known, choice.error]).any() else choice

    with ThreadPoolExecutor(workers) as pool:
        return [choice for choice in pool.map(attempt, items) if choice is not None]


@dataclass(frozen=True, eq=False)
class Found:
    """What a search found.

    Attributes:
        minimum, problem: as `search` gives them.
        records: what it was fitted to.
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
        return _free_run_error(self.model, self.records)

    @property
    def drifts(self) -> bool:
        """Whether its free run is further off than that of the start."""
        before = np.concatenate(self.problem.residuals(self.problem.start))
        return not self.error <= np.sqrt(np.mean(before**2))


def _searched(start: Cascade, records: Sequence[Record], *, skip: int | None = None, **budget: Any) -> Found:
    """`search`, but the free run on the records gets no worse than that of the start.

    States that are estimated along with a very slow pole describe a drift, which a free run, whose states are found
    from a few samples, cannot repeat. Where that has happened, the states are found as a free run finds them and held.
    """
    free = Found(*search(start, records, skip=skip, **budget), records)
    if skip is not None or free.minimum.ending is Ending.INTERRUPTED or not free.drifts:
        return free
    held = Found(*search(start, records, skip=start.memory, **budget), records)
    if held.minimum.ending is Ending.INTERRUPTED:
        return held
    # Once more with the states that it has now.
    again = Found(*search(held.model, records, skip=start.memory, **budget), records)
    return min(held, again, key=lambda found: found.error)


def _with_map(model: Cascade, layout: Layout, family: Family, size: int, part: Sequence[Record]) -> Cascade:
    """The model with its map replaced by one of the family, and the outer map, if any.

    That begins as a straight line; one of the same family that is there already stays as it is.
    """
    segments = _pairs(part)
    start = started(model, lambda x, z: family.start(x, z, size), segments)
    if layout.outer and len(start.blocks) > 2 and type(start.blocks[0]) is not type(start.blocks[-1]):
        start = started(start, lambda x, z: family.start(x, z, size), segments, -1)
    if layout.outer and len(start.blocks) == 2:
        y = np.concatenate([start.output(u, start.resting(float(u[0]))) for u, _ in segments])
        start = replace(start, blocks=(*start.blocks, family.start(y, y, size)), output_offset=0.0)
    return start


def _placed(choice: Choice, records: Sequence[Record], options: Options) -> Cascade:
    """The choice with its knots spread over all of the data."""
    family = choice.family
    if family is None or not family.sizes or len(choice.model.blocks) < 2:
        return choice.model
    return started(choice.model, lambda x, z: family.start(x, z, choice.size), _pairs(records))


def _free_run_error(model: Cascade, records: Sequence[Record]) -> float:
    square, count = 0.0, 0
    for record in records:
        run = model.simulate(record)
        error = (run.output - record.output)[run.counted]
        square, count = square + float(np.sum(error**2)), count + len(error)
    return float(np.sqrt(square / count))


# ---------------------------------------------------------------------------------------------- orders, delay, data


def _totals(
    layout: Layout, segments: Sequence[tuple[Array, Array]], orders: tuple[int | None, int | None]
) -> list[int]:
    """Orders of the best linear approximation to try: what is given; or what describes the response most briefly.

    To a response, a nonlinearity can look like poles and zeros, so lower orders are tried too: all of them where there
    is one filter only, and some where there are two, as every one of them can be shared out in many ways.
    """
    most = _total(layout, segments, orders)
    if any(order is not None for order in orders):
        return [most]
    return list(range(max(most - LOWER, 2) if layout.first and layout.second else 1, most + 1))


def _total(layout: Layout, segments: Sequence[tuple[Array, Array]], orders: tuple[int | None, int | None]) -> int:
    """The order that is given, or that describes the frequency response most briefly."""
    given_orders = [order for order in orders if order is not None]
    if given_orders:
        return sum(given_orders)
    least = 2 if layout.first and layout.second else 1
    try:
        response = frequency_response(segments)
    except ModelError:
        return least
    points = 2 * len(response.frequency)
    largest = min(LARGEST_ORDER, (points - 2) // 6)
    costs = {n: fit_rational(response, n + 1, n)[2] for n in range(least, max(largest, least) + 1)}
    scale = max(min(costs.values()) / points, 1e-12)
    return min(costs, key=lambda n: costs[n] / scale + (2 * n + 1) * np.log(points))


def _rates(records: Sequence[Record]) -> tuple[int, ...]:
    """Multiples of the sampling rate to try: one where the input is a command that is held, like a drive's."""
    held = np.mean(np.concatenate([np.diff(u) == 0 for u, _ in _pairs(records)]))
    return (1,) if held > HELD else (1, 2)


def _shares(layout: Layout, orders: tuple[int | None, int | None], total: int) -> list[tuple[int | None, int | None]]:
    """The orders of the two filters that a total order may stand for."""
    if not layout.first:
        return [(None, total)]
    if not layout.second:
        return [(total, None)]
    if orders[0] is not None and orders[1] is not None:
        return [(orders[0], orders[1])]
    return [(first, total - first) for first in range(1, total)]


def _folded_shares(layout: Layout, orders: tuple[int | None, int | None]) -> list[tuple[int, int | None]]:
    """Orders to try where the frequency response tells none, because the sign was lost."""
    first = FOLDED_FIRST if orders[0] is None else (orders[0],)
    second: tuple[int | None, ...] = (None,)
    if layout.second:
        second = FOLDED_SECOND if orders[1] is None else (orders[1],)
    return list(product(first, second))


def _delay(layout: Layout, segments: Sequence[tuple[Array, Array]], orders: tuple[int | None, int | None]) -> int:
    """The least delay with which the orders describe the measured frequency response about as well as with the best."""
    total = _total(layout, segments, orders)
    try:
        response = frequency_response(segments)
    except ModelError:
        return 0
    noise = 2 * len(response.frequency)
    costs: list[float] = []
    for delay in range(LONGEST_DELAY + 1):
        ahead = np.exp(2j * np.pi * response.frequency * delay)
        try:
            costs.append(fit_rational(replace(response, value=response.value * ahead), total + 1, total)[2])
        except ModelError:  # more coefficients than the response has points
            return 0
        if costs[0] < 2 * noise:  # as good as can be without any
            return 0
    return next(k for k, cost in enumerate(costs) if cost <= (1 + DELAY_SLACK) * min(costs) + noise)


def _held_back(records: Sequence[Record], options: Options) -> tuple[list[Record], list[Round]]:
    """What choices may be made from, and the rounds in which they are judged, each on data that it does not fit."""
    if options.validation is not None:
        judge = [options.validation] if isinstance(options.validation, Record) else list(options.validation)
        return list(records), [(records, [record[:CHOICE_SAMPLES] for record in judge])]
    if sum(len(record) for record in records) < SHORT:
        return list(records), [_without_fold(records, k) for k in range(FOLDS)]
    halves = [record.hold_back(1 - IDENTIFY) if _is_series(record) else record.split(IDENTIFY) for record in records]
    identify = [first for first, _ in halves]
    return identify, [(identify, [second[:CHOICE_SAMPLES] for _, second in halves])]


def _without_fold(records: Sequence[Record], k: int) -> Round:
    """Every record without its k-th part, and those parts."""
    rest, parts = [], []
    for record in records:
        first, last = (int(len(record) * edge / FOLDS) for edge in (k, k + 1))
        gone = np.zeros(len(record), dtype=bool)
        gone[first:last] = True
        rest.append(record.mask(gone))
        parts.append(record[first:last])
    return rest, parts


def _is_series(record: Record) -> bool:
    """Whether a record is of many experiments, such as steps of ascending height, none of which stands for the rest."""
    return len(record.segments) >= SERIES and max(map(len, record.segments)) * SERIES <= 2 * len(record)


def _shortened(records: Sequence[Record]) -> list[Record]:
    """The start of every record, or every few experiments of a series, together about as long as a choice needs."""
    share = max(CHOICE_SAMPLES // len(records), 1)
    return [
        concatenate(record.segments[:: -(-len(record) // share)])
        if _is_series(record)
        else record[: max(share, min(len(record), 500))]
        for record in records
    ]


def _pairs(records: Sequence[Record]) -> list[tuple[Array, Array]]:
    return [(piece.input[:, 0], piece.output[:, 0]) for record in records for piece in record.segments]


def _delayed(records: Sequence[Record], delay: int) -> list[tuple[Array, Array]]:
    """(u, y) of every segment with the delay taken off."""
    return [(u[: len(u) - delay], y[delay:]) for u, y in _pairs(records) if len(u) > delay]


def _through(order: int | None) -> Rational:
    """A filter of this order that passes its input on."""
    size = order or 0
    return Rational(np.eye(size + 1)[0], np.zeros(size))


def _check_excitation(layout: Layout, records: Sequence[Record]) -> None:
    for record in records:
        check_excitation(record)
    levels = np.unique(np.concatenate([record.input[:, 0] for record in records]))
    if len(levels) == 2 and not layout.first:
        raise ModelError(
            f"{layout.name}: the input takes two values only, {levels[0]:g} and {levels[1]:g}; a static map of it "
            "cannot be told from a gain. Use an input of many levels"
        )


def _filter_parameters(layout: Layout, orders: tuple[int | None, int | None]) -> int:
    """Coefficients of the filters, of first order where nothing is said."""
    there = [order for order, wanted in zip(orders, (layout.first, layout.second), strict=True) if wanted]
    return sum(2 * (1 if order is None else order) + 1 for order in there)


def _sizes(
    family: Family,
    layout: Layout,
    records: Sequence[Record],
    orders: tuple[int | None, int | None],
    options: Options,
) -> tuple[int, ...]:
    """The sizes of a family to try: what is given, or those that the records can carry, the least in any case."""
    if options.size is not None:
        return (options.size,)
    room = sum(len(record) for record in records) / SAMPLES_PER_PARAMETER - _filter_parameters(layout, orders)
    sizes = family.sizes or (0,)
    return (sizes[0], *(size for size in sizes[1:] if size <= room))


def _check_size(
    layout: Layout, records: Sequence[Record], orders: tuple[int | None, int | None], options: Options
) -> None:
    if len(orders) != 2:
        raise ModelError(f"{layout.name}: {len(orders)} orders; give one for each filter")
    least = 0 if layout.first and layout.second else 1
    for order in orders:
        if order is not None:
            check_whole(f"{layout.name}: order", order, least, "orders count poles")
    parameters = _filter_parameters(layout, orders) + (options.size or 4)
    samples = sum(len(record) for record in records)
    if samples < SAMPLES_PER_PARAMETER * parameters:
        raise ModelError(
            f"{layout.name}: about {parameters} parameters for {samples} samples; give smaller orders, fewer knots, or "
            "a longer record"
        )


def _check_judges(layout: Layout, rounds: Sequence[Round], orders: tuple[int | None, int | None]) -> None:
    """Refuse orders whose free run takes longer to start than the data go on that are to judge it."""
    needed = SAMPLES_PER_STATE * sum(order or 0 for order in orders)
    longest = min(max((len(u) for u, _ in _pairs(unseen)), default=0) for _, unseen in rounds)
    if needed >= longest:
        raise ModelError(
            f"{layout.name}: with these orders a free run takes {needed} samples to start, and what is held back to "
            f"judge it has {longest}; give smaller orders or a longer record"
        )


# --------------------------------------------------------------------------------------------------------- advice


def advice(fit: Fit[Cascade], records: Record | Sequence[Record]) -> list[str]:
    """What in a fitted cascade the records cannot tell, in sentences; empty where all is well.

    Args:
        fit: the cascade as fitted.
        records: what it was fitted to.
    """
    several = [records] if isinstance(records, Record) else list(records)
    model = fit.model
    pairs = _pairs(several)
    sentences = []
    for k, block in enumerate(model.blocks):
        if isinstance(block, Rational):
            sentences += _about_filter(block, k)
        elif isinstance(block, StaticMap):
            x = np.concatenate([model.signals(u, model.resting(float(u[0])))[k] for u, _ in pairs])
            sentences += _about_map(block, x, k)
    lost = [
        name for name, variance in zip(fit.names, np.diag(fit.covariance), strict=True) if not np.isfinite(variance)
    ]
    if lost and fit.ending is not Ending.RANK_DEFICIENT:  # which says it itself
        sentences.append(f"The records cannot tell {', '.join(lost)} from other parameters.")
    return sentences


def _about_filter(block: Rational, k: int) -> list[str]:
    sentences = []
    for pole in block.poles:
        if pole.imag < 0 or abs(pole) < 1e-6:
            continue
        near = [zero for zero in block.zeros if abs(zero - pole) < CANCELS * max(1 - abs(pole), 1e-3)]
        if near:
            where = f"{pole.real:.4g}" + (f" ± {pole.imag:.4g}i" if pole.imag else "")
            sentences.append(
                f"Block {k + 1}: a zero all but cancels the pole at {where}; an order lower would do as well."
            )
    return sentences


def _about_map(block: StaticMap, x: Array, k: int) -> list[str]:
    if isinstance(block, DeadZone):
        sides = [
            ("left", "b_l, m_l", np.mean(x < block.b_l)),
            ("right", "b_r, m_r", np.mean(x > block.b_r)),
        ]
        sentences = [
            f"Block {k + 1}: the signal hardly leaves the dead zone on the {side} ({100 * part:.2g} % of samples); "
            f"{names} are not known. Drive it harder."
            for side, names, part in sides
            if part < SELDOM
        ]
        inside = np.mean((x > block.b_l) & (x < block.b_r))
        if not sentences and inside < SELDOM:
            sentences.append(f"Block {k + 1}: the signal is hardly ever inside the dead zone; there may be none.")
        return sentences
    if isinstance(block, Saturation):
        linear = block.slope_between * x
        limits = [("low", np.mean(linear <= block.low)), ("high", np.mean(linear >= block.high))]
        return [
            f"Block {k + 1}: the signal hardly reaches the {side} limit; it is not known. Drive it harder."
            for side, part in limits
            if part < SELDOM
        ]
    if isinstance(block, CubicSpline | PiecewiseLinear):
        nearest = np.searchsorted(0.5 * (block.knots[1:] + block.knots[:-1]), x)
        empty = np.flatnonzero(np.bincount(nearest, minlength=len(block.knots)) < SAMPLES_PER_PARAMETER)
        if len(empty):
            where = ", ".join(f"{block.knots[j]:.4g}" for j in empty)
            return [f"Block {k + 1}: hardly any data around the knots at {where}; use fewer knots or a larger input."]
        slopes = block.slope(np.asarray(np.quantile(x, np.linspace(0.01, 0.99, 99)), dtype=float))
        if np.ptp(slopes) < STRAIGHT * np.max(np.abs(slopes)):
            return [f"Block {k + 1}: the map is a straight line where the data are; a linear model would do as well."]
    return []
