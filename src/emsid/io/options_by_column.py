"""Arguments of `emsid.read` that are given by column: what they do to a column, and which they may name.

A counter or an angle that starts again after a period, such as an encoder of 16 bits, is made continuous. A column is
moved by whole rows, as for a logger that writes a command into the row after the one where it acts. A signal is
differentiated, for records that contain a position instead of a speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.io.columns import Columns, as_numbers, nearest
from emsid.io.selection import check_column
from emsid.units import column_of

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


def shifted(columns: Columns, rows: Mapping[str, float], direction: Mapping[str, str]) -> Columns:
    """The columns of a file, some of them moved; their first or last value fills the rows without one, of an excerpt
    in each stretch.

    Args:
        columns: of the file.
        rows: by column, to later rows; negative to earlier ones.
        direction: by column, the column with its sign, which is moved along.

    Raises:
        DataError: for a column that does not exist, and a number that is not whole or too large.
    """
    import polars as pl

    series = dict(columns.series)
    for name, number in rows.items():
        check_column(name, columns)
        if not abs(number) < len(series[name]) or number != int(number):  # not a number is not less
            raise DataError(
                f"shift of {name!r} is {number:g}; give a whole number of rows, fewer than there are",
                arguments=("shift",),
            )
        for each in (name, *([direction[name]] if name in direction else [])):
            check_column(each, columns)
            parts = [series[each][there] for there in columns.stretches]
            edge = 0 if number > 0 else -1
            series[each] = pl.concat(part.shift(int(number), fill_value=part[edge]) for part in parts)
    return replace(columns, series=series) if rows else columns


ORDER = 3


def derivative(values: NDArray[np.float64], dt: float, window: int) -> NDArray[np.float64]:
    """The time derivative of a signal by a Savitzky–Golay filter, which is symmetric and has no delay.

    At every sample a cubic is fitted by least squares to the ``window`` samples around it, and its slope there is the
    derivative; over the first and last half window the slopes of the outermost cubic are taken. Slopes of polynomials
    up to the third degree are exact. With the window of 9 samples the result follows the true derivative within 1 % up
    to a twentieth of the sampling frequency and within 3 dB up to a seventh; a longer window smooths more.

    Args:
        values: (N, channels) samples without a gap, N ≥ ``window``.
        dt: sample time in seconds.
        window: number of samples, odd, more than 3.

    Returns:
        (N, channels) the derivative, in units of ``values`` per second.
    """
    from scipy.signal import savgol_filter

    check_window(window)
    return np.asarray(savgol_filter(values, window, ORDER, deriv=1, delta=dt, axis=0, mode="interp"))


def check_window(window: int) -> None:
    """Refuse a window that is even or too short for a cubic."""
    if window <= ORDER or window % 2 == 0:
        raise DataError(f"a derivative over {window} samples; give an odd number of at least {ORDER + 2}")


def surplus_units(units: Mapping[str, str], sources: Mapping[str, str], columns: Columns) -> dict[str, Finding]:
    """Units of columns of the file that are no channels, with a finding for each; they may be of another command.

    Args:
        units: by column.
        sources: the column of each channel.
        columns: of the file.
    """
    channels = list(sources)
    known = {*channels, *sources.values()}
    return {
        name: Finding("unit-not-used", name, {"unit": unit, "channels": channels})
        for name, unit in units.items()
        if name not in known and column_of(name, columns.series) in columns.series
    }


def check_options(options: Mapping[str, Mapping[str, object]], sources: Mapping[str, str]) -> None:
    """Refuse an option for a column that is not a channel: the name is misspelt.

    Args:
        options: by name, its values by column.
        sources: the column of each channel; that of a derivative has another name.

    Raises:
        DataError: that names the column, and the nearest one.
    """
    known = dict.fromkeys(sources.values())
    for option, by_column in options.items():
        allowed = (
            [*known, *(name for name, column in sources.items() if name != column)] if option == "units" else [*known]
        )
        for name in by_column:
            if name not in allowed:
                raise DataError(
                    f"{option} is given for {name!r}, which is neither input nor output{nearest(name, allowed)}; "
                    f"these are {', '.join(allowed)}"
                )
