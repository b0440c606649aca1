"""The output of any model in its steady state at a constant input, found by running it."""

from __future__ import annotations

from typing import Any

import numpy as np

from emsid.errors import ModelError

MOVES = 1e-6
"""A model is at rest where its output moves by less than this share of itself: rounding, and the ripple of an
interpolated input."""


def settled(model: Any, level: float, inputs: int = 1) -> float:
    """The first output in the steady state that a model reports, if it stays there.

    Args:
        model: of any kind.
        level: the constant input.
        inputs: how many there are, all at this level.

    Raises:
        ModelError: where it does not.
    """
    late = model.latency
    out = model.run(model.at_rest(level), np.full((model.memory + late + 2, inputs), level))[0][late:, 0]
    if not np.isfinite(out).all() or np.ptp(out) > MOVES * np.abs(out).max():
        raise ModelError(f"{model.name} does not come to rest at an input of {level:g}")
    return float(out[-1])


def check_channel(model: Any, what: str, number: int, count: int) -> None:
    """Refuse the number of an input or output that there is not.

    Raises:
        ModelError: with the numbers that there are.
    """
    if not 0 <= number < count:
        raise ModelError(f"{model.name}: {what} {number} of {count}; they count from 0", arguments=(what,))
