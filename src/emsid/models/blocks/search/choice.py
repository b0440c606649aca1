"""Choice of start values, static map and size by the free-run error on unseen data.

For each oversampling, pairs of filters from all sources are scored (`sources`), the best few are refined on a part of
the record, on all cores, and their free run on unseen data ranks them (`refinement`). The family of the static map, if
none is given, and then its size (knots, degree) are chosen in the same way. All comparisons use free runs, not one-step
predictions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.cross_validation import Round, as_arrays, shortened
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.search.order_growth import larger_cascades
from emsid.models.blocks.search.orders import map_sizes, oversamplings
from emsid.models.blocks.search.refinement import Choice, Plan, bends, refined, simplest
from emsid.models.blocks.search.sources import ordered_starts
from emsid.models.blocks.search.starts import grown, started
from emsid.models.blocks.search.topologies import CascadeSearch, Orders, Topology
from emsid.record import Record
from emsid.selection.improvement import better

# The number of refined starts that continue with a map of the required family; fits to a short record take little time.
REFINED_MAPS, REFINED_MAPS_SHORT = 2, 6


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
        starts = ordered_starts(topology, shown, orders, settings, replace(template, oversampling=rate), control)
        control.doing(f"refining {len(starts)} of them")
        plans = [Plan(start, correlated=leading.smooth) for start in starts]
        if direct:
            plans = [Plan(start, leading, sizes[leading][0]) for start in starts]
        found = refined(plans, part, rounds, settings.threads, control, best)
        if found and (not direct or (short and len(sizes[leading]) > 1)):
            first = simplest(found)
            found = [first, *(choice for choice in found if choice is not first)]
            control.doing(f"static map: {leading.name}")
            placed = [
                Plan(_with_map(choice.model, topology, leading, typical, part), leading, typical)
                for choice in found[: REFINED_MAPS_SHORT if short else REFINED_MAPS]
            ]
            kept = found if direct else []
            found = [*kept, *refined(placed, part, rounds, settings.threads, control, best)]
        if found:
            leader = simplest(found)
            if best is None or better(leader.unseen, best.unseen):
                for best in _of_higher_orders(leader, topology, part, rounds, orders, settings, control):
                    yield best
    assert best is not None

    def refined_further(best: Choice, others: Sequence[tuple[Family, int]]) -> Choice:
        plans = [Plan(_with_map(best.model, topology, family, size, part), family, size) for family, size in others]
        found = refined(plans, part, rounds, settings.threads, control, best) if plans else []
        return simplest([best, *found])

    if len(families) > 1:
        control.doing("family of the static map")
        best = refined_further(best, [(family, _typical(family, sizes[family], False)) for family in families[1:]])
        yield best
    assert best.family is not None
    if best.family.plain:
        control.doing(f"{best.family.plain.name} in place of the {best.family.name}")
        plan = Plan(_with_map(best.model, topology, best.family.plain, 0, part), best.family.plain)
        plainer = refined([plan], part, rounds, settings.threads, control, best)
        best = next((choice for choice in plainer if not bends(best, choice)), best)
    if best.family in sizes and not best.family.smooth:
        control.doing(f"size of the {best.family.name}")
        best = refined_further(best, [(best.family, size) for size in sizes[best.family] if size != best.size])
    yield from _of_higher_orders(best, topology, part, rounds, orders, settings, control)


def _of_higher_orders(
    best: Choice,
    topology: Topology,
    part: Sequence[Record],
    rounds: Sequence[Round],
    orders: Orders,
    settings: CascadeSearch,
    control: Control,
) -> Iterator[Choice]:
    """The choice, and others with filters of higher orders, each better than the previous; see `larger_cascades`.

    A short record shows too little for that: what another pole explains there may be friction.
    """
    yield best
    if len(rounds) > 1:
        return
    control.doing("higher orders")
    while larger := larger_cascades(best.model, topology, orders, part):
        plans = [Plan(each, best.family, best.size) for each in larger]
        choice = simplest([best, *refined(plans, part, rounds, settings.threads, control, best)])
        if choice is best:
            return
        best = _from_new_starts(choice, topology, part, rounds, settings, control)
        yield best


def _from_new_starts(
    choice: Choice,
    topology: Topology,
    part: Sequence[Record],
    rounds: Sequence[Round],
    settings: CascadeSearch,
    control: Control,
) -> Choice:
    """The choice, or the same structure from the starts for its orders, if that fits its data better.

    A search from a smaller model with a pole more may end at zeros that suit the smaller one only.
    """
    family = choice.family
    if family is None:
        return choice
    sizes = iter([len(block.denominator) for block in choice.model.blocks if isinstance(block, Rational)])
    orders = (next(sizes) if topology.first else None, next(sizes) if topology.second else None)
    starts = ordered_starts(topology, part, orders, settings, choice.model, control)
    plans = [Plan(_with_map(start, topology, family, choice.size, part), family, choice.size) for start in starts]
    found = refined(plans, part, rounds, settings.threads, control, choice)
    return min([choice, *found], key=lambda each: each.known)


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
        (larger,) = refined([plan], shortened(shown), rounds, settings.threads, control)
        return min(best, larger, key=lambda choice: choice.known)
    return best


def _typical(family: Family, sizes: Sequence[int], short: bool) -> int:
    """The size that compares a family with others: the first of a short record or a smooth map, or else the middle."""
    return sizes[0] if short or family.smooth else sizes[len(sizes) // 2]


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
