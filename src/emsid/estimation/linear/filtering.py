r"""Rational filters over rows of signals, compiled.

    A(q) y(t) = B(q) x(t)        A = 1 + a₁q⁻¹ + …,  B = b₀ + b₁q⁻¹ + …

in the transposed direct form, from a state of zero. `scipy.signal` does the same, but takes most of a second to import.
"""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def filtered(above: ArrayLike, below: ArrayLike, signals: ArrayLike) -> Array:
    """The signals (N,) or (k, N) through B/A, before which they were zero.

    Args:
        above: (≥ 1,) b₀, b₁, …
        below: (≥ 1,) the leading coefficient of A, which is not zero, and a₁, a₂, …
        signals: each row is filtered on its own.
    """
    a, b = np.atleast_1d(np.asarray(below, dtype=float)), np.atleast_1d(np.asarray(above, dtype=float))
    width = max(len(a), len(b))
    both = np.zeros((2, width))
    both[0, : len(b)], both[1, : len(a)] = b / a[0], a / a[0]
    values = np.array(signals, dtype=float, order="C")
    _filter_rows(both[0], both[1], values.reshape(-1, values.shape[-1]))
    return values


LARGEST = 0.999
"""A root that is mirrored ends at most this far out, relative to the circle."""


@numba.njit(cache=True, nogil=True)
def _filter_rows(b: Array, a: Array, rows: Array) -> None:
    """Filter every row in place; a and b have the same length, and a[0] = 1."""
    order = len(a) - 1
    state = np.empty(order + 1)
    for k in range(len(rows)):
        state[:] = 0.0
        row = rows[k]
        for t in range(len(row)):
            x = row[t]
            y = state[0] + b[0] * x
            for j in range(order):
                state[j] = state[j + 1] + b[j + 1] * x - a[j + 1] * y
            row[t] = y


def mirrored(polynomial: Sequence[float] | Array, circle: float = 1.0) -> Array:
    """A polynomial 1 + a₁q⁻¹ + … with its roots outside a circle mirrored into it, and those on it moved inside."""
    roots = np.roots(np.asarray(polynomial, dtype=float))
    if not len(roots):
        return np.ones(1)
    size = np.maximum(np.abs(roots), 1e-300)
    inside = roots * np.where(size >= circle, circle / size * np.minimum(circle / size, LARGEST), 1.0)
    return np.real(np.poly(inside))
