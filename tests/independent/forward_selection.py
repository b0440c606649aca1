"""Forward selection of columns by its definition: each step fits every possible next model by least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def best_columns(regression: Array, target: Array, most: int) -> tuple[list[int], list[float]]:
    """The columns in the order in which each leaves the smallest sum of squares, and the fraction it takes away."""
    chosen: list[int] = []
    gains: list[float] = []
    last = power = float(target @ target)
    while len(chosen) < most:
        left = [k for k in range(regression.shape[1]) if k not in chosen]
        rests = {k: rest_of(regression[:, [*chosen, k]], target) for k in left}
        best = min(left, key=lambda k: rests[k])
        chosen.append(best)
        gains.append((last - rests[best]) / power)
        last = rests[best]
    return chosen, gains


def rest_of(columns: Array, target: Array) -> float:
    """‖y − Φθ‖² of the least-squares solution."""
    rest = target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]
    return float(rest @ rest)
