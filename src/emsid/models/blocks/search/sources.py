"""Starts of a search for a cascade: pairs of filters from all sources of `starts`, in the order to refine them.

Every pair is scored by one linear problem, with a trial map. Where none of those from the frequency response explains
the output, also after it is refined, the map may lose the sign, and signs are recovered.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import Control
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.cross_validation import delayed
from emsid.models.blocks.search.orders import (
    measured_response,
    order_shares,
    sign_recovery_orders,
    total_orders,
)
from emsid.models.blocks.search.starts import (
    delay_exchanged,
    divided_anew,
    linear_candidates,
    regression_candidate,
    sign_recovery_candidates,
)
from emsid.models.blocks.search.topologies import CascadeSearch, Orders, Topology
from emsid.models.blocks.search.trials import Candidate, Filters, scanned
from emsid.models.free_run import free_run_error
from emsid.models.one_channel import Segments
from emsid.record import Record
from emsid.record.holding_back import SHORT

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
