"""Checks of the arrays and numbers of a record. Other values are refused, and nothing is converted silently."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError

Array = NDArray[np.float64]


def as_channels(values: ArrayLike, side: str, named: int) -> Array:
    """The samples (N, channels), read-only. More channels than samples are accepted only if ``named`` confirms them."""
    array = _real_numbers(values, side)
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2:
        raise DataError(f"{side} has shape {array.shape}; give (N,) or (N, channels)")
    if array.shape[1] > array.shape[0] > 0 and array.shape[1] != named:
        raise DataError(f"{side} has shape {array.shape}: more channels than samples; samples go down, channels across")
    return array


def _real_numbers(values: ArrayLike, side: str) -> Array:
    """The values as a read-only array; copied unless they are read-only already, as in a part of a record."""
    given: NDArray[Any] | None
    try:
        given = np.asarray(values)
        array = given.astype(np.float64, copy=False) if given.dtype.kind in "biufO" else None
    except (TypeError, ValueError):  # strings among numbers, rows of unequal length
        given = array = None
    if array is None:
        found = {"c": "complex numbers", "U": "text", "S": "text"}.get(given.dtype.kind if given is not None else "")
        raise DataError(
            f"{side} holds {found or 'something else than numbers'}; give real numbers, (N,) or (N, channels)"
        )
    owner = array
    while isinstance(owner.base, np.ndarray):
        owner = owner.base
    if owner.flags.writeable:
        array = array.copy("K")
        array.flags.writeable = False  # set on the array itself, so that views of it need no copy
    return array


def whole_number(value: object, least: int, problem: str) -> int:
    """The value as a whole number of at least ``least``; otherwise a `DataError` with the message ``problem``."""
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = least - 1
    if number < least:
        raise DataError(problem)
    return number


def check_finite(values: Array, names: Sequence[str], where: str) -> None:
    """Refuse values (N, channels) that are no numbers, naming the channel and the sample."""
    for k, name in enumerate(names):
        column = values[:, k]
        with np.errstate(over="ignore", invalid="ignore"):
            suspect = not np.isfinite(column.sum())
        if suspect and not np.isfinite(column).all():
            bad = int(np.flatnonzero(~np.isfinite(column))[0])
            raise DataError(f"{where}: channel {name!r} is {column[bad]} at sample {bad}; mask or repair it")
