"""Choice of start values, static map and size by the free-run error on unseen data.

Pairs of filters from all sources are scored (`sources`), the best few are refined on a part of the record, on all
cores, and their free run on unseen data ranks them (`refinement`). The best is refined again with more steps per
sample. The family of the static map, if none is given, and then its size (knots, degree) are chosen in the same way.
All comparisons use free runs, not one-step predictions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.search.cross_validation import Round, as_arrays, shortened
from emsid.models.blocks.search.map_families import POLYNOMIAL, Family
from emsid.models.blocks.search.order_growth import larger_cascades
from emsid.models.blocks.search.orders import map_sizes, oversamplings
from emsid.models.blocks.search.refinement import (
    Choice,
    Plan,
    evident,
    refined,
    simplest,
    with_knots_at_bends,
    with_steeper_maps,
)
from emsid.models.blocks.search.sources import exchanged, ordered_starts
from emsid.models.blocks.search.starts import at_higher_rate, started
from emsid.models.blocks.search.topologies import CascadeSearch, Orders, Topology
from emsid.models.blocks.static_maps import StaticMap
from emsid.record import Record
from emsid.selection.improvement import better, matters

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
