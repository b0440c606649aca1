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
from emsid.estimation.threads import one_blas_thread
from emsid.models.blocks.cascade import SAMPLES_PER_STATE, Cascade, check_channels
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import conclude, fit_cascade
from emsid.models.blocks.search.choice import Choice, improving, placed, searched
from emsid.models.blocks.search.cross_validation import Round, as_arrays, held_back
from emsid.models.blocks.search.orders import SAMPLES_PER_PARAMETER, filter_parameters, input_delay
from emsid.models.blocks.search.topologies import (
    DEFAULTS,
    HAMMERSTEIN,
    HAMMERSTEIN_WIENER,
    WIENER,
    WIENER_HAMMERSTEIN,
    Layout,
    Options,
    Orders,
)
from emsid.models.terms import check_whole
from emsid.record import Record

# An input of two levels has to change so often to tell anything of a map behind a filter.
CHANGES = 5


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
        records, options: as in `estimation`.
        order: of the filter, chosen on held-back data where it is None.
    """
    return estimate(HAMMERSTEIN, records, (None, order), options)


def wiener(records: Record | Sequence[Record], order: int | None = None, options: Options = DEFAULTS) -> Fit[Cascade]:
    """A filter of this order, then a static map.

    Args:
        records, options: as in `estimation`.
        order: of the filter, chosen on held-back data where it is None.
    """
    return estimate(WIENER, records, (order, None), options)


def hammerstein_wiener(
    records: Record | Sequence[Record], order: int | None = None, options: Options = DEFAULTS
) -> Fit[Cascade]:
    """Static map, a filter of this order, and a second map of the same family.

    Args:
        records, options: as in `estimation`.
        order: of the filter, chosen on held-back data where it is None.
    """
    return estimate(HAMMERSTEIN_WIENER, records, (None, order), options)


@one_blas_thread()
def estimate(
    layout: Layout,
    records: Record | Sequence[Record],
    orders: Orders,
    options: Options,
) -> Fit[Cascade]:
    """A structure of any of the layouts; see `estimation`.

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
    shown, rounds = held_back(several, options)
    _check_judges(layout, rounds, orders)
    delay = options.delay
    if delay is None:
        delay = 0 if options.families[0].folds else input_delay(layout, as_arrays(shown), orders)
    longest = max(len(u) for u, _ in as_arrays(shown))
    if delay >= longest:
        raise ModelError(f"{layout.name}: a delay of {delay} in a stretch of {longest} samples; give a smaller one")
    template = replace(template, delay=delay)
    best: Choice | None = None
    try:
        for choice in improving(layout, shown, rounds, orders, options, template):
            best = choice
        assert best is not None
        options.tell(f"fitting {layout.name} to all data")
        found = searched(
            placed(best, several, options),
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


def _check_excitation(layout: Layout, records: Sequence[Record]) -> None:
    for record in records:
        check_excitation(record)
    levels = np.unique(np.concatenate([record.input[:, 0] for record in records]))
    changes = sum(int(np.count_nonzero(np.diff(u))) for u, _ in as_arrays(records))
    if len(levels) == 2 and changes < CHANGES:
        raise ModelError(
            f"{layout.name}: the input changes {changes} time{'s' * (changes != 1)} between two values, which tells no "
            "static map from a filter. Use an input of many levels, or of many changes"
        )
    if len(levels) == 2 and not layout.first:
        raise ModelError(
            f"{layout.name}: the input takes two values only, {levels[0]:g} and {levels[1]:g}; a static map of it "
            "cannot be told from a gain. Use an input of many levels"
        )


def _check_size(layout: Layout, records: Sequence[Record], orders: Orders, options: Options) -> None:
    if not (isinstance(orders, tuple | list) and len(orders) == 2):
        raise ModelError(f"{layout.name}: orders {orders!r}; give one for each filter, such as (1, 2)")
    least = 0 if layout.first and layout.second else 1
    for order in orders:
        if order is not None:
            check_whole(f"{layout.name}: order", order, least, "orders count poles")
    parameters = filter_parameters(layout, orders) + (options.size or 4)
    samples = sum(len(record) for record in records)
    if samples < SAMPLES_PER_PARAMETER * parameters:
        raise ModelError(
            f"{layout.name}: about {parameters} parameters for {samples} samples; give smaller orders, fewer knots, or "
            "a longer record"
        )


def _check_judges(layout: Layout, rounds: Sequence[Round], orders: Orders) -> None:
    """Refuse orders whose free run takes longer to start than the data go on that are to judge it."""
    needed = SAMPLES_PER_STATE * sum(order or 0 for order in orders)
    longest = min(max((len(u) for u, _ in as_arrays(unseen)), default=0) for _, unseen in rounds)
    if needed >= longest:
        raise ModelError(
            f"{layout.name}: with these orders a free run takes {needed} samples to start, and what is held back to "
            f"judge it has {longest}; give smaller orders or a longer record"
        )
