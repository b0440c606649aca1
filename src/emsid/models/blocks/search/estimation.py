r"""Wiener–Hammerstein models and their relatives from records alone.

`estimation`, `hammerstein`, `wiener` and `hammerstein_wiener` need no more than a record. What is not given is
chosen on held-back data (`cross_validation`):

1. the orders worth trying and the input delay, from the measured frequency response (`orders`);
2. pairs of filters to start from (`starts`), the best of them refined and judged, then the static map between
   them and its size (`choice`);
3. the winner fitted to all identification data (`fitting`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from emsid.errors import ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.linear.least_squares import check_excitation
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.threads import one_blas_thread
from emsid.findings import Finding
from emsid.models.blocks.cascade import SAMPLES_PER_STATE, Cascade, check_channels
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import conclude, fit_cascade
from emsid.models.blocks.search.choice import Choice, improving, placed, searched
from emsid.models.blocks.search.cross_validation import as_arrays, held_back
from emsid.models.blocks.search.orders import SAMPLES_PER_PARAMETER, filter_parameters, input_delay
from emsid.models.blocks.search.topologies import (
    DEFAULTS,
    HAMMERSTEIN,
    HAMMERSTEIN_WIENER,
    WIENER,
    WIENER_HAMMERSTEIN,
    CascadeSearch,
    Orders,
    Topology,
)
from emsid.models.terms import check_whole
from emsid.record import Record
from emsid.record.holding_back import Round

# An input of two levels has to change so often to tell anything of a map behind a filter.
CHANGES = 5


def wiener_hammerstein(
    records: Record | Sequence[Record], orders: tuple[int, int] | None = None, settings: CascadeSearch = DEFAULTS
) -> Fit[Cascade]:
    """Filter, static map, filter.

    Args:
        records: one input and one output each.
        orders: of the two filters; each has as many poles, and one numerator coefficient more.
        settings: everything else.

    Raises:
        ModelError: for records of other channels or too short for the orders, an input that does not excite the map.
    """
    return estimate(WIENER_HAMMERSTEIN, records, orders or (None, None), settings)


def hammerstein(
    records: Record | Sequence[Record], order: int | None = None, settings: CascadeSearch = DEFAULTS
) -> Fit[Cascade]:
    """Static map, then a filter of this order.

    Args:
        records, settings: as in `wiener_hammerstein`.
        order: of the filter, chosen on held-back data where it is None.
    """
    return estimate(HAMMERSTEIN, records, (None, order), settings)


def wiener(
    records: Record | Sequence[Record], order: int | None = None, settings: CascadeSearch = DEFAULTS
) -> Fit[Cascade]:
    """A filter of this order, then a static map.

    Args:
        records, settings: as in `wiener_hammerstein`.
        order: of the filter, chosen on held-back data where it is None.
    """
    return estimate(WIENER, records, (order, None), settings)


def hammerstein_wiener(
    records: Record | Sequence[Record], order: int | None = None, settings: CascadeSearch = DEFAULTS
) -> Fit[Cascade]:
    """Static map, a filter of this order, and a second map of the same family.

    Args:
        records, settings: as in `wiener_hammerstein`.
        order: of the filter, chosen on held-back data where it is None.
    """
    return estimate(HAMMERSTEIN_WIENER, records, (None, order), settings)


@one_blas_thread()
def estimate(
    topology: Topology,
    records: Record | Sequence[Record],
    orders: Orders,
    settings: CascadeSearch,
    control: Control = FREE,
) -> Fit[Cascade]:
    """A structure of any of the topologies; see `estimation`.

    Where ``control`` ends the choices, the best model so far is kept.

    Raises:
        Stopped: where there is none yet.
    """
    several = [records] if isinstance(records, Record) else list(records)
    if not several:
        raise ModelError(f"{topology.name}: no record to identify from; give one or several")
    template = Cascade((Rational(np.ones(1)),), name=topology.name)
    for record in several:
        check_channels(template, record)
    _check_excitation(topology, several)
    _check_size(topology, several, orders, settings)
    shown, rounds = held_back(several, settings)
    _check_judges(topology, rounds, orders)
    delay = settings.delay
    if delay is None:
        delay = 0 if settings.families[0].folds else input_delay(topology, as_arrays(shown), orders)
    longest = max(len(u) for u, _ in as_arrays(shown))
    if delay >= longest:
        raise ModelError(f"{topology.name}: a delay of {delay} in a stretch of {longest} samples; give a smaller one")
    template = replace(template, delay=delay)
    best: Choice | None = None
    try:
        for choice in improving(topology, shown, rounds, orders, settings, template, control):
            best = choice
        assert best is not None
        control.doing(f"fitting {topology.name} to all data")
        found = searched(
            placed(best, several, settings),
            several,
            transient=settings.transient,
            loss=settings.loss,
            max_iterations=settings.max_iterations,
            control=control.during(f"fitting {topology.name}"),
        )
        return conclude(found.minimum, found.problem, settings.loss)
    except Stopped as stopped:
        if best is None:
            raise
        fit = fit_cascade(best.model, several, transient=settings.transient, max_iterations=0)
        cut_short = Finding("choices-cut-short", topology.name, {"cancelled": stopped.ending is Ending.INTERRUPTED})
        return replace(fit, ending=stopped.ending, findings=(cut_short,))


def _check_excitation(topology: Topology, records: Sequence[Record]) -> None:
    for record in records:
        check_excitation(record)
    levels = np.unique(np.concatenate([record.input[:, 0] for record in records]))
    changes = sum(int(np.count_nonzero(np.diff(u))) for u, _ in as_arrays(records))
    if len(levels) == 2 and changes < CHANGES:
        raise ModelError(
            f"{topology.name}: the input changes {changes} time{'s' * (changes != 1)} between two values, too seldom "
            "to separate a static map from a filter. Use an input of many levels, or of many changes"
        )
    if len(levels) == 2 and not topology.first:
        raise ModelError(
            f"{topology.name}: the input takes two values only, {levels[0]:g} and {levels[1]:g}; a static map of it "
            "looks like a gain then. Use an input of many levels"
        )


def _check_size(topology: Topology, records: Sequence[Record], orders: Orders, settings: CascadeSearch) -> None:
    if not (isinstance(orders, tuple | list) and len(orders) == 2):
        raise ModelError(f"{topology.name}: orders {orders!r}; give one for each filter, such as (1, 2)")
    least = 0 if topology.first and topology.second else 1
    for order in orders:
        if order is not None:
            check_whole(f"{topology.name}: order", order, least, "orders count poles")
    parameters = filter_parameters(topology, orders) + (settings.size or 4)
    samples = sum(len(record) for record in records)
    if samples < SAMPLES_PER_PARAMETER * parameters:
        raise ModelError(
            f"{topology.name}: about {parameters} parameters for {samples} samples; give smaller orders, fewer knots, "
            "or a longer record"
        )


def _check_judges(topology: Topology, rounds: Sequence[Round], orders: Orders) -> None:
    """Refuse orders whose free run takes longer to start than the data go on that are to judge it."""
    needed = SAMPLES_PER_STATE * sum(order or 0 for order in orders)
    longest = min(max((len(u) for u, _ in as_arrays(unseen)), default=0) for _, unseen in rounds)
    if needed >= longest:
        raise ModelError(
            f"{topology.name}: with these orders a free run takes {needed} samples to start, and what is held back to "
            f"judge it has {longest}; give smaller orders or a longer record"
        )
