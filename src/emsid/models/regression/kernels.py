"""Compiled computation of the regression Φ, as blocks of columns or as a factor R, and of the free run.

**The free run.** The past outputs in the regressors are those of the model. Every regressor is a product of lagged
inputs and lagged outputs. With the regressors grouped by their product ψₖ of lagged outputs::

    y(t) = c₀(t) + Σₖ cₖ(t) ψₖ(y(t − 1), y(t − 2), …)        cₖ(t) = Σ of θᵢ · (products of inputs)

the coefficients cₖ are computed for many samples at once, and the loop over samples only evaluates the sum.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.estimation.linear.information import TILE, add_multiple, copy_square, reflect, workspace
from emsid.estimation.linear.least_squares import two_product
from emsid.models.regression.regressors import Factor, Integers, Regressor, Tables, tables
from emsid.models.regression.transforms import transformed

Array = NDArray[np.float64]


@njit(nogil=True)
def fill(block: Array, tables: Tables, y: Array, u: Array, start: int, count: int) -> None:
    """Write samples ``start`` to ``start + count`` of [Φ y] into a block, whose rows are the columns of [Φ y].

    Args:
        block: (≥ n + 1, ≥ count).
        tables: the regressors.
        y, u: (N,) and (nu, N).
        start, count: the first sample and the number of samples.
    """
    signs, offsets, factors, parameters = tables
    for j in range(len(signs)):
        row = block[j, :count]
        row[:] = signs[j]
        for f in range(offsets[j], offsets[j + 1]):
            channel, lag, power, code = factors[f]
            signal = y if channel == 0 else u[channel - 1]
            multiply(row, signal[start - lag : start - lag + count], code, parameters[f], power)
    for i in range(count):
        block[len(signs), i] = y[start + i]


@njit(nogil=True)
def multiply(row: Array, x: Array, code: int, parameter: float, power: int) -> None:
    """Multiply a row by a power of a transform of x, in place."""
    if code == 0:  # loops that are vectorised
        for _ in range(power):
            for i in range(len(row)):
                row[i] *= x[i]
        return
    for i in range(len(row)):
        value = transformed(code, x[i], parameter)
        for _ in range(power):
            row[i] *= value


@njit(nogil=True)
def fill_rounding(lost: Array, tables: Tables, y: Array, u: Array, start: int) -> None:
    """Write the rounding errors of the products in `fill` into ``lost`` (n, count)."""
    signs, offsets, factors, parameters = tables
    for j in range(len(signs)):
        for i in range(lost.shape[1]):
            high, low = signs[j], 0.0
            for f in range(offsets[j], offsets[j + 1]):
                channel, lag, power, code = factors[f]
                signal = y if channel == 0 else u[channel - 1]
                value = transformed(code, signal[start + i - lag], parameters[f])
                for _ in range(power):
                    high, error = two_product(high, value)
                    low = low * value + error
            lost[j, i] = low


@njit(nogil=True)
def add_regression(factor: Array, tables: Tables, y: Array, u: Array, start: int) -> None:
    """Update a factor with samples ``start`` …, tile by tile, so that the regression stays in the cache."""
    top, tile = workspace(factor)
    for first in range(start, len(y), TILE):
        height = min(TILE, len(y) - first)
        fill(tile, tables, y, u, first, height)
        reflect(top, tile, height)
    copy_square(top, factor, len(factor))


# --- the free run -----------------------------------------------------------------------------------------------------


class Recursion(NamedTuple):
    """A model in the form that the kernels use."""

    weights: Array  # (n,) θ with the signs of the regressors
    coefficients: Integers  # (n,) the k of its cₖ
    inputs: Tables  # the input part of each regressor
    lags: Integers  # (p,) ψ₁ … ψₚ are y(t − lag), the newest last
    outputs: Tables  # ψₚ₊₁ …, products of outputs


def recursion(regressors: Sequence[Regressor], parameters: Array) -> Recursion:
    """Regressors with their parameters in the form that the kernels use."""
    parts = [tuple(f for f in regressor.factors if f.channel == 0) for regressor in regressors]
    plain = sorted({p for p in parts if p and p == (Factor(0, p[0].lag),)}, key=lambda p: -p[0].lag)
    others = sorted({p for p in parts if p}.difference(plain))
    place = {part: k for k, part in enumerate([(), *plain, *others])}
    return Recursion(
        np.where([regressor.negative for regressor in regressors], -parameters, parameters),
        np.array([place[part] for part in parts]),
        tables([Regressor(tuple(f for f in regressor.factors if f.channel)) for regressor in regressors]),
        np.array([part[0].lag for part in plain], dtype=np.int64),
        tables([Regressor(part) for part in others]),
    )


@njit(nogil=True)
def run_freely(y: Array, u: Array, recursion: Recursion, start: int) -> int:
    """Overwrite y (N,) from ``start`` on with the free run for the input u (nu, N).

    Returns the first sample that is not a number, where the run ends, or the number of samples.
    """
    coefficient = _coefficient_array(recursion, TILE)
    for first in range(start, len(y), TILE):
        count = min(TILE, len(y) - first)
        weigh(coefficient, u, recursion, first, count)
        reached = _advance(y, coefficient, recursion, first, 0, count)
        if reached < first + count:
            return reached
    return len(y)


@njit(nogil=True)
def advance_one(y: Array, u: Array, recursion: Recursion, coefficient: Array, t: int) -> None:
    """Overwrite y at one sample, as `run_freely` does; ``coefficient`` (…, ≥ 1) is a work array."""
    weigh(coefficient, u, recursion, t, 1)
    _advance(y, coefficient, recursion, t, 0, 1)


@njit(nogil=True)
def predict_ahead(
    result: Array, y: Array, u: Array, recursion: Recursion, memory: int, start: int, horizon: int
) -> None:
    """ŷ(t | t − horizon) for every t from ``start`` on: a free run of ``horizon`` steps for each t."""
    window = np.empty(memory + horizon)
    coefficient = _coefficient_array(recursion, TILE + horizon)
    for first in range(start, len(y), TILE):
        begin, end = max(first - horizon + 1, memory), min(first + TILE, len(y))
        weigh(coefficient, u, recursion, begin, end - begin)
        for t in range(first, end):
            origin = max(t - horizon + 1, memory)
            for i in range(memory):
                window[i] = y[origin - memory + i]
            _advance(window, coefficient, recursion, memory, origin - begin, t - origin + 1)
            result[t] = window[memory + t - origin]


@njit(nogil=True)
def _coefficient_array(recursion: Recursion, samples: int) -> Array:
    """An array for c₀, c₁, … of this many samples, with one row as a work array."""
    return np.empty((1 + len(recursion.lags) + len(recursion.outputs.signs) + 1, samples))


@njit(nogil=True)
def weigh(coefficient: Array, u: Array, recursion: Recursion, start: int, count: int) -> None:
    """Write the cₖ of samples ``start`` … into the first columns of ``coefficient``."""
    _, offsets, factors, parameters = recursion.inputs
    coefficient[:, :count] = 0.0
    product = coefficient[-1, :count]
    for j in range(len(recursion.weights)):
        product[:] = recursion.weights[j]
        for f in range(offsets[j], offsets[j + 1]):
            channel, lag, power, code = factors[f]
            multiply(product, u[channel - 1, start - lag : start - lag + count], code, parameters[f], power)
        add_multiple(coefficient[recursion.coefficients[j]], 1.0, product, count)


@njit(nogil=True)
def _advance(y: Array, coefficient: Array, recursion: Recursion, start: int, column: int, count: int) -> int:
    """Overwrite ``count`` samples of y from ``start`` on; their cₖ begin at ``column``.

    Returns the sample after the last, or the first that is not a number.
    """
    lags = recursion.lags
    _, offsets, factors, parameters = recursion.outputs
    for i in range(count):
        t = start + i
        total = coefficient[0, column + i]
        for k in range(len(offsets) - 1):
            product = coefficient[1 + len(lags) + k, column + i]
            for f in range(offsets[k], offsets[k + 1]):
                value = transformed(factors[f, 3], y[t - factors[f, 1]], parameters[f])  # no view of a row in a loop
                for _ in range(factors[f, 2]):
                    product *= value
            total += product
        for k in range(len(lags)):
            total += coefficient[1 + k, column + i] * y[t - lags[k]]
        y[t] = total
        if np.isnan(total):
            return t
    return start + count
