"""Starts of feedback models whose output shows magnitudes only, as that of a sensor that loses the sign.

Such an output is no linear function of the input, so neither a linear model nor a direction found from one is a start.
Sign recovery (`emsid.models.blocks.search.sign_recovery`) gives the filter before the sensor; with the sensor's curve
and a filter of first order behind it this is a Wiener–Hammerstein model, which is a feedback model too. There the curve
acts on all states as well, so that what it shows of friction in the loop is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from emsid.errors import EmsidError, ModelError
from emsid.estimation.nonlinear.control import Control
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import search
from emsid.models.blocks.search.cross_validation import as_arrays
from emsid.models.blocks.search.map_families import family_of
from emsid.models.blocks.search.starts import scanned, sign_recovery_candidates, started
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.feedback.fitting import Found, searched
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.starts import in_observer_form
from emsid.models.one_channel import segments_longer_than
from emsid.record import Record

MAGNITUDE = family_of("abs")
KNOTS = 6
"""Of the sensor's curve."""
BEHIND = 1
"""Order of the filter behind the sensor."""
TRIED, STEPS = 3, 40
"""The number of starts of an order that are refined, and the steps of each."""


def of_magnitudes(records: Sequence[Record], order: int, control: Control) -> Found:
    """The best model of one curve that loses the sign, refined from the filters that sign recovery finds.

    Args:
        records: one input and one output each.
        order: of the filter before the curve; the model has `BEHIND` more states.
        control: when to stop.

    Raises:
        ModelError: where no start leads to a model.
    """
    segments, dt = as_arrays(records), records[0].dt
    found = []
    for pair, level in sign_recovery_candidates(segments, (order, BEHIND), np.random.default_rng(0), control):
        template = Cascade((Rational(np.ones(1)),), input_offset=level, dt=dt)
        with suppress(ModelError):
            found += scanned([pair], segments, MAGNITUDE.trial, template, 1)
    best: Found | None = None
    for candidate in sorted(found, key=lambda each: each.error)[:TRIED]:
        with suppress(EmsidError):
            cascade = started(candidate.cascade, lambda x, z: MAGNITUDE.start(x, z, KNOTS), segments)
            minimum, problem = search(
                cascade, records, max_iterations=STEPS, tolerance=0.2, covariances=False, control=control.quietly()
            )
            model = as_feedback(problem.model(minimum.estimate))
            new = searched(model, segments_longer_than(model.memory, model, records), 0, STEPS, 0.1, control)
            best = new if best is None or new.error < best.error else best
    if best is None:
        raise ModelError(f"feedback: no model of order {order} whose output loses the sign")
    return best


def as_feedback(cascade: Cascade) -> FeedbackModel:
    """A Wiener–Hammerstein model as a feedback model with the same output.

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
    offset = -cascade.input_offset * first.resting(1.0)[1]
    return FeedbackModel(
        matrix, (curve,), np.array([offset]), cascade.output_offset, cascade.delay, cascade.oversampling, dt=cascade.dt
    )
