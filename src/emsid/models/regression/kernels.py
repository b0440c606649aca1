"""Compiled computation of the regression Φ from tables of regressors: as blocks of columns, or as a factor R."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.estimation.linear.information import TILE, copy_square, reflect, workspace
from emsid.estimation.linear.least_squares import two_product
from emsid.models.regression.regressors import Tables
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
