"""Orders, delay, oversampling and map sizes to try, estimated from the records before a cascade is fitted.

The order is that of the rational fit to the measured frequency response with the least description length. The delay
is the least one with which that order fits the response.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.rational import fit_rational, measured
from emsid.excitation.between_samples import repeats
from emsid.models.blocks.search.cross_validation import as_arrays
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.search.topologies import CascadeSearch, Orders, Topology
from emsid.record import FrequencyResponse, Record

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
