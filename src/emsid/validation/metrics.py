"""Error measures as functions of measured and modelled output, both (N, ny)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.models.free_run import mean_squared_error as mean_squared_error

Array = NDArray[np.float64]

FEWEST = 50
"""Errors from fewer samples say little about a model."""
SMALL = 0.02
"""An error, or a difference of errors, below this share of the output's deviation is small on any data."""


def fit_percent(measured: Array, modelled: Array) -> float:
    """100·(1 − ‖y − ŷ‖/‖y − ȳ‖), the mean over channels; 100 is perfect, 0 as good as the mean, and below is worse.

    Minus infinity for a run that diverged. A channel whose measured output is constant has no fit and is left out of
    the mean; NaN where all channels are constant.

    Args:
        measured: (N, ny) y.
        modelled: (N, ny) ŷ.
    """
    error = np.linalg.norm(measured - modelled, axis=0)
    if not np.isfinite(error).all():
        return float("-inf")
    moves = np.ptp(measured, axis=0) > 0
    if not moves.any():
        return float("nan")
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    return float(np.mean(100.0 * (1.0 - error[moves] / spread[moves])))
