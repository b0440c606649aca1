"""Orders, delay, oversampling and map sizes to try, estimated from the records before a cascade is fitted.

The order is that of the rational fit to the measured frequency response with the least description length. The delay
is the least one with which that order fits the response.

**More knots.** A map with few knots rounds its bends, and the residual r then depends on the input x of the map. Let F
be the derivative of the residual with respect to all parameters of the same cascade with another knot between each two.
To first order more knots lower the squares of r to min ‖r + Fp‖². Schwarz's criterion compares that with the same for
the parameters that the cascade has, both without penalties.

The bends of any curve matter less the smaller they are, and a long record shows all of them. So the error has to fall
by a part that matters. Where the number of knots is not given, those knots of a spline that have data around them are
added, as long as Schwarz's criterion prefers the fit with them: at little noise a kink needs more knots than most maps
do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import FREE
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import SQUARES, Infeasible, linearised
from emsid.estimation.nonlinear.rational import fit_rational, measured
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.excitation.between_samples import repeats
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.fitting import FreeRun, Search, freedom
from emsid.models.blocks.search.cross_validation import CascadeSearch, Orders, Topology, as_arrays
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.search.refinement import Found, searched
from emsid.models.blocks.static_maps import CubicSpline, StaticMap
from emsid.models.blocks.static_maps.through_points import with_data
from emsid.record import FrequencyResponse, Record
from emsid.selection.improvement import matters, schwarz_gain

Array = NDArray[np.float64]

LARGEST_ORDER = 8
# With two filters, this many orders below that of the response are tried.
LOWER = 2
# Orders tried before and after a map that loses the sign.
SIGNLESS_FIRST, SIGNLESS_SECOND = (1, 2, 3, 4), (0, 1, 2)
# Delays up to the first number are tried, and more as long as the best is among the last; two delays are equally good
# within this fraction of the squared error.
USUAL_DELAYS, LAST_DELAYS, DELAY_SLACK = 20, 5, 0.1
# A delay above this share of the longest segment is no delay of the system.
MOST_DELAY = 0.25
# The least number of samples for every parameter.
SAMPLES_PER_PARAMETER = 5


def measured_response(segments: Sequence[tuple[Array, Array]], period: int | None = None) -> FrequencyResponse | None:
    """The frequency response of (u, y) segments; None where they are too short for one, or the input is constant."""
    try:
        return measured(segments, period=period)
    except ModelError:
        return None


def total_orders(topology: Topology, response: FrequencyResponse | None, orders: Orders) -> list[int]:
    """Orders of the best linear approximation to try: the given ones, or that of least description length and below.

    A nonlinearity can look like poles and zeros in the response, so lower orders are tried too: all of them with one
    filter, and some with two, because each of them can be divided in many ways.

    Args:
        topology: of the cascade.
        response: measured.
        orders: that are given, of the filters before and after the map.
    """
    least, most = _least(topology, orders), _total(topology, response, orders)
    return list(range(max(most - LOWER, least) if topology.first and topology.second else least, most + 1))


def _total(topology: Topology, response: FrequencyResponse | None, orders: Orders) -> int:
    """The given order, or the one of least description length for the frequency response."""
    least = _least(topology, orders)
    if response is None or not _open(topology, orders):
        return least
    points = 2 * len(response.frequency)
    largest = min(LARGEST_ORDER, (points - 2) // 6)
    costs = {n: fit_rational(response, n + 1, n)[2] for n in range(least, max(largest, least) + 1)}
    scale = max(min(costs.values()) / points, 1e-12)
    return min(costs, key=lambda n: costs[n] / scale + (2 * n + 1) * np.log(points))


def _open(topology: Topology, orders: Orders) -> int:
    """The number of filters without a given order."""
    return sum(order is None for order, wanted in zip(orders, (topology.first, topology.second), strict=True) if wanted)


def _least(topology: Topology, orders: Orders) -> int:
    """The sum of the given orders, with one for every other filter."""
    return sum(order or 0 for order in orders) + _open(topology, orders)


def oversamplings(records: Sequence[Record]) -> tuple[int, ...]:
    """Multiples of the sampling rate to try: only one for an input that is held between samples, like a drive's."""
    return (1,) if repeats([u for u, _ in as_arrays(records)]) else (1, 2)


def order_shares(topology: Topology, orders: Orders, total: int) -> list[Orders]:
    """The pairs of filter orders that add up to a total order."""
    if not topology.first:
        return [(None, total)]
    if not topology.second:
        return [(total, None)]
    pairs = [(first, total - first) for first in range(total + 1)]
    return [
        pair
        for pair in pairs
        if all(own == given if given is not None else own for own, given in zip(pair, orders, strict=True))
    ]


def sign_recovery_orders(topology: Topology, orders: Orders) -> list[tuple[int, int | None]]:
    """Orders to try after a loss of the sign, which makes the frequency response useless."""
    first = SIGNLESS_FIRST if orders[0] is None else (orders[0],)
    second: tuple[int | None, ...] = (None,)
    if topology.second:
        second = SIGNLESS_SECOND if orders[1] is None else (orders[1],)
    return list(product(first, second))


def input_delay(
    topology: Topology, segments: Sequence[tuple[Array, Array]], orders: Orders, period: int | None = None
) -> int:
    """The least delay whose fit to the measured frequency response is about as good as the best."""
    response = measured_response(segments, period)
    if response is None:
        return 0
    total = _total(topology, response, orders)
    noise = 2 * len(response.frequency)
    costs: list[float] = []
    for delay in range(int(MOST_DELAY * max(len(u) for u, _ in segments)) + 1):
        if delay > USUAL_DELAYS and int(np.argmin(costs)) < delay - LAST_DELAYS:
            break
        try:
            costs.append(fit_rational(response.ahead(delay), total + 1, total)[2])
        except ModelError:  # more coefficients than the response has points
            return 0
        if costs[0] < 2 * noise:  # no delay already fits down to the noise
            return 0
    return next(k for k, cost in enumerate(costs) if cost <= (1 + DELAY_SLACK) * min(costs) + noise)


def map_sizes(
    family: Family,
    topology: Topology,
    records: Sequence[Record],
    orders: Orders,
    settings: CascadeSearch,
) -> tuple[int, ...]:
    """The sizes of a family to try: the given one, or those with enough samples, and always the least."""
    if settings.size is not None:
        return (settings.size,)
    room = sum(len(record) for record in records) / SAMPLES_PER_PARAMETER - filter_parameters(topology, orders)
    sizes = family.sizes or (0,)
    return (sizes[0], *(size for size in sizes[1:] if size <= room))


def filter_parameters(topology: Topology, orders: Orders) -> int:
    """The number of coefficients of the filters, which are of first order by default."""
    there = [order for order, wanted in zip(orders, (topology.first, topology.second), strict=True) if wanted]
    return sum(2 * (1 if order is None else order) + 1 for order in there)


# --- more knots -------------------------------------------------------------------------------------------------------

LEAST_FALL = 0.1
"""Too few knots are said where more of them lower the error by this part."""
ADDED_FALL = 0.03
"""Knots are added where they lower the error by this part, besides what as many parameters explain by chance."""
MOST_KNOTS = 160
"""A map gets no more knots than this."""


class Finer(NamedTuple):
    """A cascade with more knots in one map.

    Attributes:
        block: the index of the map.
        cascade: it has the same curves, and another knot between each two of this map.
        saved: by which part these knots lower the error, to first order.
        beyond_chance: the same without what as many parameters explain by chance.
        evident: whether Schwarz's criterion prefers them, without a penalty on either.
    """

    block: int
    cascade: Cascade
    saved: float
    beyond_chance: float
    evident: bool


def too_few_knots(minimum: Minimum, problem: FreeRun) -> tuple[Finding, ...]:
    """A finding for every map whose residual more knots would explain.

    Args:
        minimum, problem: of a fit, from `search`.
    """
    name = problem.cascade.name
    few = (each for each in _finer(minimum, problem) if each.evident and each.saved > LEAST_FALL)
    return tuple(Finding("too-few-knots", name, {"block": each.block + 1, "saved": each.saved}) for each in few)


def with_enough_knots(found: Found, **how: Unpack[Search]) -> Found:
    """The fit, or one whose splines have about twice the knots, and twice again, while Schwarz's criterion prefers it.

    Args:
        found: from `searched`.
        how: of further searches.
    """
    while (start := _with_finer_map(found)) is not None:
        larger = searched(start, found.records, **how)
        before, after = (2 * each.minimum.cost / each.minimum.samples for each in (found, larger))
        independent, more = effective_samples(larger.minimum.residuals), larger.determined - found.determined
        clear = schwarz_gain(after, before, independent, more) > 0
        if how.get("control", FREE).ending or not clear or not _less_noise(larger, found):
            break
        found = larger
    return found


def _less_noise(larger: Found, found: Found) -> bool:
    """Whether the variance of the noise falls by a part that matters: of a short record knots explain some of it."""
    return matters(larger.minimum.noise_variance, found.minimum.noise_variance)


def _with_finer_map(found: Found) -> Cascade | None:
    """The cascade with more knots in the spline where they lower the error most; None if they do in no map."""
    finer = (each for each in _finer(found.minimum, found.problem) if each.beyond_chance > ADDED_FALL)
    options = [each for each in finer if _has_room(each.cascade.blocks[each.block], found)]
    if not options:
        return None
    chosen = max(options, key=lambda option: option.saved)
    start, k = _where_data_are(chosen, found), chosen.block
    return start if len(start.blocks[k].parameters) > len(found.model.blocks[k].parameters) else None


def _where_data_are(finer: Finer, found: Found) -> Cascade:
    """The cascade with more knots, without those around which there are hardly any data."""
    k, spline = finer.block, finer.cascade.blocks[finer.block]
    assert isinstance(spline, CubicSpline)
    runs = zip(found.problem.segments, found.problem.states(found.minimum.estimate), strict=True)
    knots = with_data(spline.knots, np.concatenate([found.model.signals(u, states)[k] for (u, _), states in runs]))
    blocks = finer.cascade.blocks
    return replace(finer.cascade, blocks=(*blocks[:k], CubicSpline(knots, spline.value(knots)), *blocks[k + 1 :]))


def _has_room(block: object, found: Found) -> bool:
    """Whether a map is a spline of at most `MOST_KNOTS` knots, and has enough samples for each."""
    if not isinstance(block, CubicSpline):
        return False
    return block.size <= min(MOST_KNOTS, found.minimum.samples / SAMPLES_PER_PARAMETER)


def _finer(minimum: Minimum, problem: FreeRun) -> Iterator[Finer]:
    """For every map, the cascade with more knots in it, where they explain a part of the residual."""
    cascade = problem.model(minimum.estimate)
    maps = [(k, block) for k, block in enumerate(cascade.blocks) if isinstance(block, StaticMap)]
    finer = [(k, new) for k, block in maps if (new := block.with_more_knots()) is not block]
    if not finer:
        return
    square, rank = _remaining(problem, minimum.estimate)
    independent = effective_samples(minimum.residuals)
    for k, block in finer:
        larger = replace(cascade, blocks=(*cascade.blocks[:k], block, *cascade.blocks[k + 1 :]))
        same = replace(problem, cascade=larger, freedom=freedom(larger))
        theta = same.at_start(problem.states(minimum.estimate))
        try:
            least, more = _remaining(same, theta)
        except Infeasible:
            continue
        if 0 < least < square:
            added, left = more - rank, minimum.samples - rank
            by_chance = max(left - added, 1) / max(left, 1)
            saved, beyond = (1 - float(np.sqrt(part)) for part in (least / square, least / square / by_chance))
            yield Finer(k, larger, saved, beyond, schwarz_gain(least, square, independent, added) > 0)


def _remaining(problem: FreeRun, theta: Array) -> tuple[float, int]:
    """The least mean square of the linearised residual, and the rank of its derivative."""
    information = linearised(problem, theta, np.arange(len(theta)), SQUARES).information
    return float(information.factor[-1, -1] ** 2) / information.samples, information.solve().rank
