"""Columns of a data frame, in the form that every reader of a file gives."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from emsid.errors import DataError
from emsid.io.columns import Columns
from emsid.record.frames import column_names, numbers

if TYPE_CHECKING:
    import polars as pl

INDEX = "time"
"""The name of the column that an index without a name becomes."""


def columns_of_frame(frame: Any) -> Columns:
    """The columns of a pandas frame, a Polars frame or a dictionary of arrays; an index that is no row number is one.

    Raises:
        DataError: for something without columns.
    """
    found = {str(name): _series(str(name), frame[name], frame) for name in column_names(frame)}
    index = getattr(frame, "index", None)
    if index is not None and not callable(index) and type(index).__name__ != "RangeIndex":
        name = str(getattr(index, "name", None) or INDEX)
        if name not in found:
            found = {name: _series(name, index, {name: index}), **found}
    if not found:
        raise DataError("there is no column in this frame")
    return Columns(found)


def _series(name: str, values: Any, frame: Any) -> pl.Series:
    """A column as numbers, times or texts."""
    import polars as pl

    if isinstance(values, pl.Series):
        return values
    if str(getattr(values, "dtype", "")).lower().startswith(("datetime", "timedelta")):
        kind = "datetime64[ns]" if "date" in str(values.dtype).lower() else "timedelta64[ns]"
        return pl.Series(name, np.asarray(values, dtype=kind))
    try:
        return pl.Series(name, numbers(frame, [name])[:, 0]).fill_nan(None)
    except DataError:
        return pl.Series(name, [text if isinstance(text, str) else None for text in values], dtype=pl.String)
