"""Static maps whose input leaves, on unseen data, the range that it has in the data of the fit.

A model may stay within the range of its own input and still leave that of a map inside it, such as the displacement of
a spring at resonance. There the map is only a continuation.
"""

from __future__ import annotations

from typing import Any

from emsid.errors import EmsidError
from emsid.findings import Finding
from emsid.models.kinds import capabilities_of
from emsid.record import Record

BEYOND = 0.1
"""A model extrapolates if an input, of its own or of a map, leaves its range in the fit by more than this fraction."""


def about_the_maps(model: Any, record: Record, unseen: Record, seen: bool) -> list[Finding]:
    """One finding for every static map that the free run over unseen data continues beyond the data of the fit.

    Args:
        model: the chosen one; of one without static maps there is nothing to say.
        record: what it was fitted to.
        unseen: what it is judged on.
        seen: whether that is a part of the record.
    """
    if seen:
        return []
    kind = capabilities_of(model)
    try:
        fitted, new = kind.maps_in_use(model, record), kind.maps_in_use(model, unseen)
    except EmsidError:
        return []
    found = []
    for k, (one, other) in enumerate(zip(fitted, new, strict=True), start=1):
        known, z = one.input, other.input
        low, high = float(known.min()), float(known.max())
        slack = BEYOND * (high - low)
        beyond = (z < low - slack) | (z > high + slack)
        if beyond.any():
            data = {
                "map": k if len(fitted) > 1 else None,
                "low": float(z.min()),
                "high": float(z.max()),
                "fitted_low": low,
                "fitted_high": high,
                "share": float(beyond.mean()),
                "seen": seen,
            }
            found.append(Finding("map-beyond-range", model.name, data))
    return found
