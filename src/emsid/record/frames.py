"""Columns of a data frame as arrays, and arrays as a data frame: of pandas or Polars.

Frames and dictionaries of arrays are read by ``frame[name]``, so neither library is imported. Narwhals makes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.record.time_axis import seconds_in_unit

Array = NDArray[np.float64]


def frame(columns: Mapping[str, Array], library: str = "polars") -> Any:
    """A data frame of this library.

    Args:
        columns: (N,) arrays by name.
        library: ``"polars"``, ``"pandas"``, or another one that narwhals knows.

    Raises:
        DataError: for a library that is unknown or not installed.
    """
    import narwhals

    try:
        return narwhals.from_dict(dict(columns), backend=library).to_native()  # type: ignore[arg-type]
    except (ImportError, ValueError, TypeError) as problem:
        raise DataError(f"no frame of {library!r} can be made ({problem}); give 'polars' or 'pandas'") from None


class FrameMethods:
    """`to_frame` of a record."""

    def to_frame(self: Any, library: str = "polars", *, units: bool = False) -> Any:
        """A data frame with the time ``t`` in seconds and a column for every channel.

        >>> import emsid
        >>> emsid.Record([0.0, 1.0], [2.0, 3.0], 0.1, "v", "w", "V", "rad/s").to_frame(units=True).columns
        ['t [s]', 'v [V]', 'w [rad/s]']

        Args:
            library: ``"polars"`` or ``"pandas"``.
            units: whether names end with the unit in brackets.

        Raises:
            DataError: for another library, or one that is not installed.
        """
        channels = (("t", "s"), *zip(self.input_names, self.input_units, strict=True))
        channels = (*channels, *zip(self.output_names, self.output_units, strict=True))
        names = [f"{name} [{unit}]" if units and unit else name for name, unit in channels]
        columns = np.column_stack([self.time, self.input, self.output]).T
        return frame(dict(zip(names, columns, strict=True)), library)


def numbers(frame: Any, names: Sequence[str]) -> Array:
    """(N, columns) the named columns as numbers; missing values become NaN.

    Raises:
        DataError: for a column that is not there or that holds no numbers.
    """
    columns = [_as_floats(_column(frame, name), f"column {name!r}") for name in names]
    lengths = {name: len(column) for name, column in zip(names, columns, strict=True)}
    if len(set(lengths.values())) > 1:
        raise DataError(f"columns of different lengths: {lengths}; they must agree")
    return np.column_stack(columns) if columns else np.empty((_length(frame), 0))


def seconds(frame: Any, time: str | None, unit: str | None = None) -> Array | None:
    """(N,) the time of every row in seconds; None if the frame has no time.

    Args:
        frame: where to look.
        time: the column, or the name of the index of a pandas frame; None takes that index, unless it is a row number.
        unit: of the time; by default the one in the name of the column, else seconds. Dates and times need none.

    Raises:
        DataError: for a column that is not there, or that holds no times, and for a unit that is not one of time.
    """
    index = getattr(frame, "index", None)
    if callable(index):  # of a list or a tuple
        index = None
    if time is None:
        return None if index is None or type(index).__name__ == "RangeIndex" else _as_seconds(index, "the index", unit)
    if time not in column_names(frame) and index is not None and getattr(index, "name", None) == time:
        return _as_seconds(index, f"index {time!r}", unit, time)
    return _as_seconds(_column(frame, time), f"column {time!r}", unit, time)


def _as_seconds(values: Any, what: str, unit: str | None, name: str = "") -> Array:
    kind = str(getattr(values, "dtype", "")).lower()
    if kind.startswith("datetime"):
        array: Any = np.asarray(values, dtype="datetime64[ns]")  # of times with a zone, in UTC
    else:
        array = np.asarray(values.to_numpy() if hasattr(values, "to_numpy") else values)
    if array.dtype.kind in "mM":
        result: Array = (array - array[:1]) / np.timedelta64(1, "s")
        return result
    return seconds_in_unit(name or str(getattr(values, "name", None) or ""), unit) * _as_floats(values, what)


def _as_floats(values: Any, what: str) -> Array:
    try:
        try:
            array = values.to_numpy(dtype=np.float64, na_value=np.nan)  # pandas, with its own kinds of missing values
        except (AttributeError, TypeError):
            array = np.asarray(values.to_numpy() if hasattr(values, "to_numpy") else values)
            if array.dtype.kind not in "biufO":
                raise ValueError(array.dtype) from None
            array = array.astype(np.float64)
    except (TypeError, ValueError):
        raise DataError(f"{what} holds something else than numbers; convert it, or name another column") from None
    if array.ndim != 1:
        raise DataError(f"{what} has shape {array.shape}; give each column its own name, and one value to a row")
    return np.asarray(array, dtype=np.float64)


def _column(frame: Any, name: str) -> Any:
    names = column_names(frame)
    if name not in names:
        raise DataError(f"there is no column {name!r}; there are {', '.join(map(str, names))}")
    return frame[name]


def column_names(frame: Any) -> list[Any]:
    """The names of the columns of a frame.

    Raises:
        DataError: for something without columns.
    """
    found = getattr(frame, "columns", None)
    if found is None:
        found = frame.keys() if hasattr(frame, "keys") else getattr(getattr(frame, "dtype", None), "names", None)
    if found is None:
        raise DataError(f"a {type(frame).__name__} has no columns; give a data frame, or a dictionary of arrays")
    return list(found)


def _length(frame: Any) -> int:
    return len(frame[next(iter(column_names(frame)))])
