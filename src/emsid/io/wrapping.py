"""Counters and angles that start again after a period, such as an encoder of 16 bits, made continuous."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.io.columns import Columns, as_numbers
from emsid.io.selection import check_column

Array = NDArray[np.float64]


def unwrapped(values: Array, period: float) -> Array:
    """The values with whole periods added, so that no step between neighbours is longer than half a period.

    >>> unwrapped(np.array([250.0, 254.0, 2.0, 6.0]), 256)
    array([250., 254., 258., 262.])

    Args:
        values: (N,) of a counter or an angle; NaN where there is none.
        period: after which it starts again, in units of ``values``.
    """
    result, known = values.copy(), np.isfinite(values)
    result[known] = np.unwrap(values[known], period=period)
    return result


def continuous(columns: Columns, periods: Mapping[str, float]) -> Columns:
    """The columns of a file, those with a period made continuous.

    Args:
        columns: of the file.
        periods: by column.

    Raises:
        DataError: for a column that does not exist, and a period that is not positive.
    """
    import polars as pl

    series = dict(columns.series)
    for name, period in periods.items():
        check_column(name, columns)
        if not 0 < period < np.inf:
            raise DataError(f"wrap of {name!r} is {period:g}; give a positive number", arguments=("wrap",))
        series[name] = pl.Series(name, unwrapped(as_numbers(series[name]), period)).fill_nan(None)
    return replace(columns, series=series) if periods else columns
