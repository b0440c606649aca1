"""Static maps whose input leaves, on unseen data, the range that it has in the data of the fit.

A model may stay within the range of its own input and still leave that of a map inside it, such as the displacement of
a spring at resonance. There the map is only a continuation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.feedback.model import FeedbackModel
from emsid.record import Record
from emsid.validation.feedback_curves import visited_in_free_run

Array = NDArray[np.float64]

BEYOND = 0.1
"""A map is continued if its input leaves the range of the fit by more than this fraction of it."""


def about_the_maps(model: Any, record: Record, unseen: Record, seen: bool) -> list[Finding]:
    """One finding for every static map that the free run over unseen data continues beyond the data of the fit.

    Args:
        model: the chosen one; of other models than cascades and feedback models there is nothing to say.
        record: what it was fitted to.
        unseen: what it is judged on.
        seen: whether that is a part of the record.
    """
    if seen or not isinstance(model, FeedbackModel | Cascade):
        return []
    try:
        fitted, new = map_inputs(model, record), map_inputs(model, unseen)
    except EmsidError:
        return []
    found = []
    for k, (known, z) in enumerate(zip(fitted.T, new.T, strict=True), start=1):
        low, high = float(known.min()), float(known.max())
        slack = BEYOND * (high - low)
        beyond = (z < low - slack) | (z > high + slack)
        if beyond.any():
            data = {
                "map": k if fitted.shape[1] > 1 else None,
                "low": float(z.min()),
                "high": float(z.max()),
                "fitted_low": low,
                "fitted_high": high,
                "share": float(beyond.mean()),
                "seen": seen,
            }
            found.append(Finding("map-beyond-range", model.name, data))
    return found


def map_inputs(model: FeedbackModel | Cascade, record: Record) -> Array:
    """(K, m) the inputs of the static maps in the free run over a record.

    Segments begin in the state that their first samples show, those of a cascade at rest at the first input.

    Raises:
        ModelError: if the run of a feedback model diverges.
    """
    if isinstance(model, FeedbackModel):
        return visited_in_free_run(model, record).z
    at = [k for k, block in enumerate(model.blocks) if isinstance(block, StaticMap)]
    signals = [model.signals_from_rest(segment.input[:, 0]) for segment in record.segments]
    return np.column_stack([np.concatenate([each[k] for each in signals]) for k in at]) if at else np.zeros((0, 0))
