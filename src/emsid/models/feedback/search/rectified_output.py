"""Starts of feedback models whose output is rectified: a sensor loses the sign.

Such an output is no linear function of the input, so neither a linear model nor a direction found from one is a start.
Sign recovery (`emsid.models.blocks.search.sign_recovery`) gives the filter before the sensor; with the sensor's curve
and a filter behind it this is a Wiener–Hammerstein model, which is a feedback model too. The curve is |z|, or an even
spline, which rounds the corner of |z| only where data show it; behind it the sensor may have a lag.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.nonlinear.control import Control
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import search
from emsid.models.blocks.search.cross_validation import as_arrays
from emsid.models.blocks.search.map_families import Family, family_of
from emsid.models.blocks.search.sign_recovery import may_be_rectified
from emsid.models.blocks.search.starts import sign_recovery_candidates, started
from emsid.models.blocks.search.trials import scanned
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.feedback.fitting import Found, searched
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.starts import in_observer_form
from emsid.models.feedback.search.trials import FeedbackSearch, SearchData, Trial
from emsid.models.one_channel import Segments, segments_longer_than
from emsid.record import Record

Array = NDArray[np.float64]

ABS, SPLINE = family_of("abs"), family_of("even-spline")
SENSORS = ((ABS, 0, 0), (SPLINE, 8, 0), (SPLINE, 8, 1))
"""Family and number of knots of the sensor's curve, and the order of the filter behind it."""
ORDERS = (2, 3, 4)
"""Orders that are tried if none is given."""
TRIED, ITERATIONS = 3, 40
"""The number of starts of an order that are refined, and the steps of each."""


def with_sensor(data: SearchData, settings: FeedbackSearch) -> Iterator[Trial]:
    """Models of one step per sample whose output loses the sign, where that of the records may have."""
    if settings.static or settings.delay or (settings.oversampling or 1) > 1 or not may_be_rectified(data.fitted):
        return
    for order in ORDERS if settings.order is None else (settings.order,):
        data.control.doing(f"rectified output of order {order}")
        with suppress(EmsidError):
            for found, knots in rectified_models(data.fitted, order, data.control):
                yield data.judged(found, ABS, knots)


def rectified_models(records: Sequence[Record], states: int, control: Control) -> list[tuple[Found, int]]:
    """Models of one curve that loses the sign, refined from the filters that sign recovery finds.

    Args:
        records: one input and one output each.
        states: of the model.
        control: when to stop.

    Returns:
        For each of `SENSORS`, the best model and the number of its knots.

    Raises:
        ModelError: where no start leads to a model.
    """
    segments, found = as_arrays(records), []
    starts = {behind: _starts(segments, (states - behind, behind), records[0].dt, control) for _, _, behind in SENSORS}
    for family, knots, behind in SENSORS:
        refined = list[Found]()
        for start in starts[behind]:
            with suppress(EmsidError):
                refined.append(_refined(started(start, partial(_curve, family, knots), segments), records, control))
        if refined:
            found.append((min(refined, key=lambda each: each.error), knots))
    if not found:
        raise ModelError(f"feedback: no model of order {states} whose output loses the sign")
    return found


def _starts(segments: Segments, orders: tuple[int, int], dt: float, control: Control) -> list[Cascade]:
    """The best starts, by the error with |z| between the filters.

    Args:
        segments: (u, y) of each.
        orders: of the filter before the sensor and of that behind it.
        dt: in seconds.
        control: when to stop.
    """
    candidates = []
    for pair, level in sign_recovery_candidates(segments, orders, np.random.default_rng(0), control):
        template = Cascade((Rational(np.ones(1)),), input_offset=level, dt=dt)
        with suppress(ModelError):
            candidates += scanned([pair], segments, ABS.trial, template, 1)
    return [each.cascade for each in sorted(candidates, key=lambda each: each.error)[:TRIED]]


def _curve(family: Family, knots: int, x: Array, z: Array) -> StaticMap:
    return family.start(x, z, knots)


def _refined(start: Cascade, records: Sequence[Record], control: Control) -> Found:
    """The feedback model near a cascade that is fitted first, from its initial states.

    The first samples of a rectified output fit states of either sign, and the search leaves neither.
    """
    minimum, problem = search(
        start, records, max_iterations=ITERATIONS, tolerance=0.2, covariances=False, control=control.quietly()
    )
    cascade = problem.model(minimum.estimate)
    model, moved = as_feedback(cascade)
    segments = segments_longer_than(model.memory, model, records)
    states = [x + moved for x in problem.states(minimum.estimate)]
    return searched(model, segments, 0, ITERATIONS, 0.1, control, states=states)


def as_feedback(cascade: Cascade) -> tuple[FeedbackModel, Array]:
    """A Wiener–Hammerstein model as a feedback model before a sensor, and by how much its states are larger.

    Args:
        cascade: filter, map, filter, each filter with as many numerator coefficients behind the first as poles.
    """
    first, curve, second = cascade.blocks
    assert isinstance(first, Rational)
    assert isinstance(second, Rational)
    assert isinstance(curve, StaticMap)
    before, behind = in_observer_form(*first.transfer), in_observer_form(*second.transfer)
    n1, n2 = len(before) - 1, len(behind) - 1
    n = n1 + n2
    matrix = np.zeros((n + 2, n + 2))
    matrix[np.ix_([*range(n1), n], [*range(n1), n])] = before
    own = [*range(n1, n), n + 1]
    matrix[np.ix_(own, own)] = behind
    rest, gain = first.resting(1.0)
    offset, moved = np.array([-cascade.input_offset * gain]), cascade.input_offset * np.append(rest, np.zeros(n2))
    output_offset, delay, steps = cascade.output_offset, cascade.delay, cascade.oversampling
    model = FeedbackModel(matrix, (curve,), offset, output_offset, delay, steps, dt=cascade.dt, sensor=n2)
    return model, moved
