"""Polynomials as arrays of coefficients, lowest order first, compiled: value, integral of a product, first zero.

First zeros are isolated by bounds on the remaining terms of the polynomial, so two crossings in one step are not
missed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit

Array = NDArray[np.float64]

_kernel = njit(nogil=True, error_model="numpy", fastmath={"contract"})
_FINEST = 1e-13  # of an interval, the shortest that is halved
_ROUNDING = 1e-16  # of half an interval, where a zero in it is known


@_kernel
def polynomial_value(c: Array, t: float) -> float:
    """Σ c_k·t^k."""
    total = 0.0
    for k in range(len(c) - 1, -1, -1):
        total = total * t + c[k]
    return total


@_kernel
def product_integral(a: Array, b: Array, step: float) -> float:
    """∫ a(t)·b(t) dt from 0 to ``step``."""
    total, power = 0.0, step
    for j in range(len(a)):
        inner = 0.0
        for k in range(len(b) - 1, -1, -1):
            inner = inner * step + b[k] / (j + k + 1)
        total += a[j] * inner * power
        power *= step
    return total


@_kernel
def first_below(bound: float, factor: float, series: Array, step: float, margin: Array, centred: Array) -> float:
    """The instant at which ``bound + factor·series`` first falls below zero; infinite if not within ``step``.

    If it is exactly zero at the start, the sign of its first nonzero coefficient decides.
    """
    first, n = 0, len(series)
    for k in range(n):
        margin[k] = factor * series[k]
    margin[0] += bound
    while first < n and margin[first] == 0.0:
        first += 1
    if first == n:
        return np.inf
    if margin[first] < 0.0:
        return 0.0
    return first_zero(margin[first:], step, centred)


@_kernel
def first_zero(p: Array, end: float, c: Array) -> float:
    """The first t in (0, end] where the polynomial ``p``, positive at 0, falls to zero; infinite if there is none.

    Bounds around the middle of an interval, with coefficients ``c``, decide about it: it has no zero if the other terms
    are smaller than the constant, and at most one if they are smaller than the slope. Otherwise it is halved.
    """
    n = len(p)
    rest = 0.0
    for k in range(n - 1, 0, -1):
        rest = (rest + abs(p[k])) * end
    if p[0] > rest:
        return np.inf
    a, width = 0.0, end
    while a < end:
        r = 0.5 * width
        for k in range(n):
            c[k] = p[k]
        for i in range(n - 1):
            for j in range(n - 2, i - 1, -1):
                c[j] += (a + r) * c[j + 1]
        rest, bend, power = 0.0, 0.0, r
        for k in range(1, n):
            rest += abs(c[k]) * power
            if k > 1:
                bend += k * abs(c[k]) * power / r
            power *= r
        if c[0] <= rest:
            if n > 1 and abs(c[1]) > bend:
                if polynomial_value(c[:n], r) <= 0.0:
                    return min(a + r + _zero_within(c[:n], r), end)
            elif width > _FINEST * end:
                width = r
                continue
            elif c[0] <= 0.0:
                return a + r
        a += width
        width = min(2.0 * width, end - a)
    return np.inf


@_kernel
def _zero_within(c: Array, r: float) -> float:
    """The zero in [−r, r] of a polynomial that decreases there: Newton's method inside a bracket."""
    low, high, t = -r, r, 0.0
    for _ in range(100):
        value, slope = 0.0, 0.0
        for k in range(len(c) - 1, -1, -1):
            slope = slope * t + value
            value = value * t + c[k]
        if value > 0.0:
            low = t
        else:
            high = t
        guess = t - value / slope if slope != 0.0 else low
        if not low < guess < high:
            guess = 0.5 * (low + high)
        if abs(guess - t) <= _ROUNDING * r:
            return guess
        t = guess
    return t
