"""Choice of start values, static map, size and orders by the free-run error on unseen data.

Pairs of filters from all sources are scored, the best few are refined on a part of the record, on all
cores, and their free run on unseen data ranks them (`refinement`). The best is refined again with more steps per
sample. The family of the static map, if none is given, and then its size (knots, degree) are chosen in the same way.
All comparisons use free runs, not one-step predictions.

**Higher orders.** A frequency response in which a static map leaves distortion shows fewer poles than the system has.
The error of the fitted cascade shows those that are missing. A pole p that a zero cancels, (1 − pq⁻¹)/(1 − pq⁻¹),
changes nothing; the derivative with respect to the zero is the output s of the filter through a lag,

    ∂y/∂z = −F · q⁻¹/(1 − pq⁻¹) s,

where F stands for the linearised blocks behind it. One linear problem gives the part of the squared error that this
direction explains in addition to the parameters of the cascade (Rao's score test). The larger filter starts with the
pole that explains most.

**Order of the pairs.** Every pair of filters from the sources of `starts` is scored by one linear problem, with a trial
map. Where none of those from the frequency response explains the output, also after it is refined, the map may lose the
sign, and signs are recovered.

References:
    Rao, *Large sample tests of statistical hypotheses concerning several parameters*, Mathematical Proceedings of the
    Cambridge Philosophical Society 44 (1948).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import FreeRun, search
from emsid.models.blocks.search.cross_validation import (
    CascadeSearch,
    Orders,
    Round,
    Topology,
    as_arrays,
    delayed,
    shortened,
)
from emsid.models.blocks.search.map_families import POLYNOMIAL, Family
from emsid.models.blocks.search.orders import (
    LARGEST_ORDER,
    SAMPLES_PER_PARAMETER,
    map_sizes,
    measured_response,
    order_shares,
    oversamplings,
    sign_recovery_orders,
    total_orders,
)
from emsid.models.blocks.search.refinement import (
    Choice,
    Plan,
    evident,
    refined,
    simplest,
    with_knots_at_bends,
    with_steeper_maps,
)
from emsid.models.blocks.search.starts import (
    at_higher_rate,
    delay_exchanged,
    divided_anew,
    linear_candidates,
    regression_candidate,
    sign_recovery_candidates,
    started,
    with_cancelled_pole,
)
from emsid.models.blocks.search.trials import Candidate, Filters, scanned
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.free_run import free_run_error
from emsid.models.one_channel import Segments
from emsid.record import Record
from emsid.record.holding_back import SHORT
from emsid.selection.improvement import better, matters, schwarz_gain

Array = NDArray[np.float64]


# A cascade whose error is below this fraction of the output, a thousandth of its power, explains the output: no further
# sources of starts are needed.
EXPLAINED = 0.03


@dataclass(frozen=True, eq=False)
class Task:
    """A cascade to choose, and the data that choose it.

    Attributes:
        topology: of the cascade.
        fitted: the records that choices are made from.
        rounds: their splits into fitted and unseen data.
        orders: that are given, of the filters before and after the map.
        settings: options of the search.
        template: offsets, delay and name of the cascade.
        control: when to stop.
    """

    topology: Topology
    fitted: Sequence[Record]
    rounds: Sequence[Round]
    orders: Orders
    settings: CascadeSearch
    template: Cascade
    control: Control = FREE

    @cached_property
    def part(self) -> list[Record]:
        """The records that models are refined on."""
        return shortened(self.fitted)

    @property
    def short(self) -> bool:
        """Whether the records are so short that several splits compare models."""
        return len(self.rounds) > 1

    def explains(self, choice: Choice) -> bool:
        """Whether a choice leaves a negligible part of the output of the data that it was refined on."""
        return choice.known < self._enough

    @cached_property
    def _enough(self) -> float:
        return EXPLAINED * float(np.std(np.concatenate([y for _, y in as_arrays(self.part)])))

    def sizes(self, family: Family) -> tuple[int, ...]:
        """The sizes of a family of maps to try."""
        return map_sizes(family, self.topology, self.fitted, self.orders, self.settings)

    def typical(self, family: Family) -> int:
        """The size that compares a family with others: the first of a smooth map, or else the middle."""
        sizes = self.sizes(family)
        return sizes[0] if family.smooth else sizes[len(sizes) // 2]

    def refined_starts(self, template: Cascade, plan: Callable[[Cascade], Plan]) -> list[Choice]:
        """Choices from the starts of these orders, best first; from more sources until one explains the output.

        Args:
            template: offsets, delay, oversampling and name.
            plan: what to refine of a start.

        Raises:
            ModelError: if every plan fails.
        """
        found: list[Choice] = []
        problem: ModelError | None = None
        for starts in ordered_starts(self.topology, self.fitted, self.orders, self.settings, template, self.control):
            self.control.doing(f"refining {len(starts)} start values")
            try:
                found += self.refined([plan(start) for start in starts])
            except ModelError as failed:
                problem = failed
            if any(map(self.explains, found)):
                break
        if problem and not found:
            raise problem
        return sorted(found, key=lambda choice: choice.error)

    def refined(
        self,
        plans: Sequence[Plan],
        rival: Choice | None = None,
        compared: Callable[[Choice], bool] = lambda choice: True,
    ) -> list[Choice]:
        """Plans refined and ranked, see `refined`."""
        return refined(plans, self.part, self.rounds, self.settings.threads, self.control, rival, compared)

    def plan(self, model: Cascade, family: Family, size: int) -> Plan:
        """To refine the model with its map replaced by one of the family.

        The outer map, if any, is replaced too: it starts as a straight line, or is kept where it is of this family.
        """
        segments = as_arrays(self.part)
        start = started(model, lambda x, z: family.start(x, z, size), segments)
        if self.topology.outer and len(start.blocks) > 2 and type(start.blocks[0]) is not type(start.blocks[-1]):
            start = started(start, lambda x, z: family.start(x, z, size), segments, -1)
        if self.topology.outer and len(start.blocks) == 2:
            y = np.concatenate([start.output(u, start.resting(float(u[0]))) for u, _ in segments])
            start = replace(start, blocks=(*start.blocks, family.start(y, y, size)), output_offset=0.0)
        return Plan(start, family, size)


def improving(task: Task) -> Iterator[Choice]:
    """Successive choices, each better than the previous: filters with a map of the first family, then the map."""
    settings = task.settings
    first, *higher = oversamplings(task.fitted) if settings.oversampling is None else (settings.oversampling,)
    small = best = _with_filters_exchanged(task, simplest(_from_starts(task, first)))
    for best in _of_higher_orders(task, small):
        yield best
    for rate in higher:
        task.control.doing(f"{rate} steps per sample")
        # A pole that was added at one step per sample may only imitate what that step cannot show.
        sources = [small] if best is small else [small, best]
        found = task.refined(
            [Plan(at_higher_rate(source.model, rate), source.family, source.size) for source in sources], best
        )
        if found and better((choice := simplest(found)).unseen, best.unseen):
            for best in _of_higher_orders(task, choice):
                yield best
    best = _of_best_family(task, best)
    yield best
    yield from _of_higher_orders(task, _of_best_size(task, _without_bends(task, best)))


def _from_starts(task: Task, rate: int) -> list[Choice]:
    """Choices with a map of the first family, refined from all starts at a sampling rate."""
    family, (leading, *_) = task.settings.families[0], task.sizes(task.settings.families[0])
    task.control.doing(f"start values at {rate} times the sampling rate")
    direct = family.direct and not task.topology.outer

    def plan(start: Cascade) -> Plan:
        return Plan(start, family, leading) if direct else Plan(start, correlated=family.smooth)

    template = replace(task.template, oversampling=rate)
    # In a short record trial maps are not compared on unseen data: of the best of every kind all continue.
    trials = task if direct or not task.short else replace(task, rounds=())
    found = trials.refined_starts(template, plan)
    others = task.sizes(family)[int(direct) :]
    if direct and not (task.short and others):
        return found
    task.control.doing(f"static map: {family.name}")
    size = others[0] if task.short or family.smooth else others[len(others) // 2]
    plans = [task.plan(each.model, family, size) for each in (found if task.short else [simplest(found)])]
    return [*(found if direct else []), *task.refined(plans)]


def _with_filters_exchanged(task: Task, best: Choice) -> Choice:
    """The choice, or the same structure with poles and zeros divided otherwise between its filters, if it is better.

    A frequency response shows zeros beyond the band of the input only roughly, so no division of them may be close to
    that of the system. Those of a fitted cascade are closer, even where its search ended at another minimum.
    """
    task.control.doing("poles and zeros exchanged between the filters")
    while True:
        plans = [Plan(each, best.family, best.size) for each in exchanged(best.model, task.part)]
        found = task.refined(plans, best)
        ahead = [each for each in found if matters(each.known**2, best.known**2) and each.error < best.error]
        if not ahead:
            return best
        best = ahead[0]


def _of_best_family(task: Task, best: Choice) -> Choice:
    """The choice, or a better one with a map of another family; with a straight line, if none is better than that.

    Without the line, a linear system gets the map that suits the noise best, such as limits that few samples reach.
    """
    others = task.settings.families[1:]
    if others:
        task.control.doing("family of the static map")
    plans = [task.plan(best.model, family, task.typical(family)) for family in others]
    found = [_with_steeper_jumps(task, each) for each in task.refined(plans, best, partial(_bent, task))]
    if POLYNOMIAL in others and not task.topology.outer:  # beside the others it never fits best
        found += task.refined([task.plan(best.model, POLYNOMIAL, 1)], best)
    return simplest([best, *found])


def _with_steeper_jumps(task: Task, choice: Choice) -> Choice:
    """The choice, or the same with smooth jumps that are half as wide, and half again, as long as they are better.

    What a jump that is too smooth leaves looks like missing poles. The last fit narrows it further, see
    `with_steeper_jumps`.
    """
    while (steeper := with_steeper_maps(choice.model)) is not None:
        found = task.refined([Plan(steeper, choice.family, choice.size)], choice)
        if not found or not better(found[0].unseen, choice.unseen):
            break
        choice = found[0]
    return choice


def _bent(task: Task, choice: Choice) -> bool:
    """Whether the data that a choice was refined on show bends of its maps."""
    model = choice.model
    runs = [model.signals_from_rest(u) for u, _ in as_arrays(task.part)]
    return all(
        block.bends_over(np.concatenate([signals[k] for signals in runs]))
        for k, block in enumerate(model.blocks)
        if isinstance(block, StaticMap)
    )


def _without_bends(task: Task, best: Choice) -> Choice:
    """The choice, or the same with the plain map of its family where the data do not show the bends of its own."""
    assert best.family is not None
    plain = best.family.plain
    if plain is None:
        return best
    task.control.doing(f"{plain.name} in place of the {best.family.name}")
    found = task.refined([task.plan(best.model, plain, 0)], best, lambda choice: not evident(best, choice, weights=1))
    return next(iter(found), best)


def _of_best_size(task: Task, best: Choice) -> Choice:
    """The choice, or a better one with a map of another size."""
    family = best.family
    if family not in task.settings.families or family.smooth:
        return best
    task.control.doing(f"size of the {family.name}")
    plans = [task.plan(best.model, family, size) for size in task.sizes(family) if size != best.size]
    return simplest([best, *task.refined(plans, best)])


def _of_higher_orders(task: Task, best: Choice) -> Iterator[Choice]:
    """The choice, and others with filters of higher orders, each better than the previous; see `larger_cascades`.

    In the parts of a short record another pole may explain what is friction; it has to be evident in the whole too.
    """
    yield best
    task.control.doing("higher orders")
    while larger := larger_cascades(best.model, task.topology, task.orders, task.part):
        plans = [Plan(each, best.family, best.size) for each in larger]
        choice = simplest([best, *task.refined(plans, best, partial(_may_replace, task, best))])
        if choice is best:
            return
        # Zeros in the wrong filter look like poles that are missing.
        best = _with_filters_exchanged(task, choice)
        yield best


def _may_replace(task: Task, smaller: Choice, larger: Choice) -> bool:
    """Whether cross-validation decides between two orders; of a short record the larger one has to be evident too."""
    return not task.short or evident(larger, smaller)


def with_spread_knots(task: Task, best: Choice, records: Sequence[Record]) -> Cascade:
    """The model of the choice with knots spread over all data; a smooth map gets as many as its family has.

    If their number is given, they then move to where the map bends, as few knots round a kink wherever it is. The usual
    number is enough everywhere; there, knots that move make fits of a rounded map slightly worse.
    """
    model = with_knots(task, best, records)
    if best.family is None or not best.family.smooth or task.settings.size is None:
        return model
    task.control.doing(f"knots of the {best.family.name}")
    return with_knots_at_bends(model, task.part, task.control)


def with_knots(task: Task, choice: Choice, records: Sequence[Record]) -> Cascade:
    """The model of the choice with knots spread over records; a smooth map gets as many as its family has."""
    family = choice.family
    if family is None or not family.sizes or len(choice.model.blocks) < 2:
        return choice.model
    sizes = map_sizes(family, task.topology, records, task.orders, task.settings)
    size = sizes[-1] if family.smooth else choice.size
    return started(choice.model, lambda x, z: family.start(x, z, size), as_arrays(records))


# Time constants of the poles that are tried, in steps of the filter.
TIME_CONSTANTS = 2.0 ** np.arange(-1, 10)
# Parts of a derivative that the others explain up to rounding.
ROUNDING = 1e-6


def larger_cascades(
    model: Cascade,
    topology: Topology,
    orders: Orders,
    records: Sequence[Record],
) -> list[Cascade]:
    """The cascade with one pole and zero more in a filter, for every filter whose error shows that one is missing.

    The part of the squared error that is explained has to matter, and more than chance by Schwarz's criterion.

    Args:
        model: fitted to the records.
        topology: of the cascade.
        orders: that are given, of the filters before and after the map; the others may rise.
        records: to which it is fitted.
    """
    filters = [k for k, block in enumerate(model.blocks) if isinstance(block, Rational)]
    there = (topology.first, topology.second)
    most = [LARGEST_ORDER if order is None else 0 for order, used in zip(orders, there, strict=True) if used]
    open_ = [k for k, order in zip(filters, most, strict=True) if len(_filter(model, k).denominator) < order]
    room = sum(len(record) for record in records) / SAMPLES_PER_PARAMETER - len(model.parameters)
    if not open_ or room < 2:
        return []
    minimum, problem = search(model, records, max_iterations=0, covariances=False)
    model = problem.model(minimum.estimate)
    poles = np.exp(-1 / TIME_CONSTANTS)
    larger = []
    for k, parts in zip(open_, explained(problem, minimum.estimate, open_, poles), strict=True):
        best = int(np.argmax(parts))
        left = 1.0 - float(parts[best])
        if matters(left, 1.0) and schwarz_gain(left, 1.0, minimum.samples, 2) > 0:
            block = with_cancelled_pole(_filter(model, k), poles[best])
            blocks = (*model.blocks[:k], block, *model.blocks[k + 1 :])
            larger.append(replace(model, blocks=blocks))
    return larger


def explained(problem: FreeRun, theta: Array, which: Sequence[int], poles: Array) -> Array:
    """(filters, poles) the part of the squared error that a pole and zero more in a filter explain, to first order.

    Args:
        problem: of the cascade.
        theta: its parameters and initial states.
        which: indices of the filters among the blocks.
        poles: (m,) real poles.
    """
    model, linearised = problem.model(theta), problem.linearised(theta)
    error = np.concatenate([residual for residual, _ in linearised])
    rows = np.concatenate([derivative for _, derivative in linearised])
    axes, sizes, _ = np.linalg.svd(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300), full_matrices=False)
    known = axes[:, sizes > ROUNDING * sizes[0]]
    error = error - known @ (known.T @ error)
    found = []
    for k in which:
        pushed = []
        for (u, _), states in zip(problem.segments, problem.states(theta), strict=True):
            signals = model.signals(u, states)
            moved = np.array([_lagged(signals[k + 1], pole) for pole in poles])
            for x, block in zip(signals[k + 1 : -1], model.blocks[k + 1 :], strict=True):
                block.push(x, moved)
            pushed.append(moved[:, :: model.oversampling][:, problem.transient :])
        new = np.concatenate(pushed, axis=1)
        before = np.linalg.norm(new, axis=1)
        new = new - (new @ known) @ known.T
        after = np.linalg.norm(new, axis=1)
        along = np.where(after > ROUNDING * before, new @ error / np.maximum(after, 1e-300), 0.0)
        found.append(along**2 / max(float(error @ error), 1e-300))
    return np.array(found)


def _filter(model: Cascade, k: int) -> Rational:
    block = model.blocks[k]
    assert isinstance(block, Rational)
    return block


def _lagged(signal: Array, pole: float) -> Array:
    """(N,) the signal through q⁻¹/(1 − pq⁻¹), from rest."""
    lag = Rational(np.array([0.0, 1.0]), np.array([-pole]))
    return lag.output(signal, lag.resting(float(signal[0]))[0])


# --- the order of the pairs -------------------------------------------------------------------------------------------

# Starts that are refined, without and with those from recovered signs.
REFINED, REFINED_RECOVERED = 4, 24
# Filters are the same if no coefficient differs by more than this part of the largest.
SAME = 1e-3
# Recovered signs are tried unless the error of another start is below this fraction of the output. In
# a short record they take little time.
LINEAR_SUFFICES, SUFFICES_SHORT = 0.5, 0.2


def ordered_starts(
    topology: Topology,
    records: Sequence[Record],
    orders: Orders,
    settings: CascadeSearch,
    template: Cascade,
    control: Control,
) -> Iterator[list[Cascade]]:
    """The cascades to refine, best first: those from the frequency response, and then, if need be, from other sources.

    Of the first ones the best of every order precede the rest.

    Raises:
        Stopped: by ``control``.
    """
    segments = delayed(records, template.delay)
    rng = np.random.default_rng(0) if settings.rng is None else settings.rng
    leading = settings.families[0]
    if leading.loses_sign and topology.first:
        recovered = _sign_recovery_starts(topology, segments, orders, settings, template, rng, control)
        if recovered:
            yield [candidate.cascade for candidate in recovered]
            return
    response = measured_response(segments, settings.period)  # without one, the other sources remain
    totals = total_orders(topology, response, orders)
    pairs: list[Filters] = []
    for total in totals:
        for first, second in order_shares(topology, orders, total):
            control.check()
            if response is not None:
                with suppress(ModelError):  # more coefficients than the response has points
                    pairs += linear_candidates(response, (first, second), total, template.oversampling)
            if topology.second and template.oversampling == 1:
                with suppress(ModelError):
                    _, behind = regression_candidate(records, second or 0, 3, max(template.delay, 0))
                    pairs.append((_through(first) if topology.first else None, behind))
    control.check()
    found = scanned(pairs, segments, leading.trial, template, settings.threads)
    level = float(np.std(np.concatenate([y for _, y in segments])))
    enough = SUFFICES_SHORT if sum(len(y) for _, y in segments) < SHORT else LINEAR_SUFFICES
    yield (ahead := refined_first([candidate.cascade for candidate in found]))
    if (found and found[0].error < enough * level) or template.oversampling > 1:
        return
    control.check()
    if topology.first:  # a map that is even about some level looks like no linear relation at all
        found += _sign_recovery_starts(topology, segments, orders, settings, template, rng, control)
    found.sort(key=lambda candidate: candidate.error)
    others = [candidate.cascade for candidate in found[:REFINED_RECOVERED]]
    yield [each for each in others if not any(each is start for start in ahead)]


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
    ahead = [k for k, order in enumerate(orders) if order not in orders[:k]]
    behind = [k for k in range(len(starts)) if k not in ahead]
    several = len(ahead) - 1 if orders and len(orders[0]) > 1 else 0
    return [starts[k] for k in (ahead + behind)[: REFINED + several]]


def exchanged(model: Cascade, records: Sequence[Record]) -> list[Cascade]:
    """The model with its filters exchanged in part, to refine.

    Poles and zeros are divided otherwise between the filters, of which the `REFINED` with the least error are taken, or
    a sample of delay is moved from one to the other.

    Args:
        model: the model.
        records: that the free runs are compared on.
    """
    others = [each for each in divided_anew(model) if not _same_filters(each, model)]
    return [*refined_first(sorted(others, key=lambda each: free_run_error(each, records))), *delay_exchanged(model)]


def _same_filters(start: Cascade, other: Cascade) -> bool:
    """Whether two starts have the same filters, up to rounding."""
    one, two = ([each for b in c.blocks if isinstance(b, Rational) for each in b.transfer] for c in (start, other))
    return len(one) == len(two) and all(
        len(a) == len(b) and np.abs(a - b).max() < SAME * np.abs(a).max() for a, b in zip(one, two, strict=True)
    )


def _through(order: int | None) -> Rational:
    """A filter of this order that passes its input on."""
    size = order or 0
    return Rational(np.eye(size + 1)[0], np.zeros(size))
