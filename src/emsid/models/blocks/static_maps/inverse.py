"""The inverse of a monotone map."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.models.blocks.static_maps.static_map import StaticMap

Array = NDArray[np.float64]


def numbers_of(values: Array) -> Array:
    """The values that are not NaN, in one dimension."""
    numbers: Array = values[~np.isnan(values)]
    return numbers


def inverse_with_straight_ends(function: StaticMap, knots: Array, z: ArrayLike) -> Array:
    """x with f(x) = z, for a monotone f that is straight below the first and above the last of its knots (K,)."""
    target = np.asarray(z, dtype=float)
    ends = knots[[0, -1]]
    known = numbers_of(target)
    extremes = np.array([known.min(), known.max()]) if known.size else np.empty(0)
    beyond = ends + (extremes[:, None] - function.value(ends)) / function.slope(ends)
    reach = np.append(ends, beyond)
    return monotone_inverse(function, reach.min(), reach.max(), target)


def monotone_inverse(function: StaticMap, low: float, high: float, z: ArrayLike) -> Array:
    """x in [low, high] with f(x) = z, by bisection to the last bit, for a monotone f."""
    target = np.asarray(z, dtype=float)
    grid = function.value(np.linspace(low, high, 513))
    rising = bool(grid[-1] > grid[0])
    if not np.all(np.diff(grid) > 0 if rising else np.diff(grid) < 0):
        raise ModelError(f"a {function.kind} map has an inverse only where it is monotone")
    margin = 1e-9 * abs(grid[-1] - grid[0])
    if np.any((target < grid.min() - margin) | (target > grid.max() + margin)):
        raise ModelError(f"the inverse of this {function.kind} is asked for outside the range that it was fitted on")
    left, right = np.full(target.shape, low), np.full(target.shape, high)
    for _ in range(64):
        middle = 0.5 * (left + right)
        beyond = (function.value(middle.ravel()).reshape(target.shape) < target) == rising
        left, right = np.where(beyond, middle, left), np.where(beyond, right, middle)
    return np.where(np.isnan(target), np.nan, 0.5 * (left + right))
