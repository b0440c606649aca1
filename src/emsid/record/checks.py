"""Checks of the arrays and numbers of a record. Other values are refused, and nothing is converted silently."""

from __future__ import annotations

import operator
import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.record.argument_types import NUMBER_LIST, PAIRS, TEXT, TEXT_LIST, TEXTS, WHOLE_LIST, Kind, brief, items_of
from emsid.record.time_axis import TimeAxis

Array = NDArray[np.float64]


def as_channels(values: ArrayLike, side: str, named: int) -> Array:
    """The samples (N, channels), read-only. More channels than samples are accepted only if ``named`` confirms them."""
    array = real_numbers(values, side)
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2:
        raise DataError(f"{side} has shape {array.shape}; give (N,) or (N, channels)")
    if array.shape[1] > array.shape[0] > 0 and array.shape[1] != named:
        raise DataError(f"{side} has shape {array.shape}: more channels than samples; samples go down, channels across")
    return array


def real_numbers(values: ArrayLike, side: str) -> Array:
    """The values as a read-only array; copied unless they are read-only already, as in a part of a record."""
    given: NDArray[Any] | None
    try:
        given = np.asarray(values)
        array = given.astype(np.float64, copy=False) if given.dtype.kind in "biufO" else None
    except (TypeError, ValueError, OverflowError):  # strings among numbers, rows of unequal length
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


SIGNALS = ("speed", "rotor speed", "load speed", "position", "current")
"""What an output may measure; a speed of a plant with two masses is that of its load."""


def named_signals(record: Any) -> dict[str, str]:
    """The signals of the outputs of a record in their spelling; ``rotor_speed`` and ``rotor-speed`` are one.

    Raises:
        DataError: for something else, or another channel.
    """
    found = {name: re.sub("[_-]", " ", signal.strip().lower()) for name, signal in record.signals.items()}
    for name, signal in found.items():
        if name not in record.output_names:
            outputs = ", ".join(record.output_names)
            raise DataError(
                f"{record.name}: a signal is given for {name!r}, which is no output; these are {outputs}",
                arguments=("signals",),
            )
        if signal not in SIGNALS:
            known = ", ".join(each.replace(" ", "_") for each in SIGNALS)
            raise DataError(
                f"{name!r} cannot be the signal {record.signals[name]!r}; there are {known}", arguments=("signals",)
            )
    return found


KINDS = {
    "signals": TEXTS,
    "name": TEXT,
    "breaks": WHOLE_LIST,
    "times": NUMBER_LIST,
    "sources": TEXT_LIST,
    "findings": items_of(Finding),
    "conversions": PAIRS,
    "time_axis": Kind(lambda value: isinstance(value, TimeAxis), "a TimeAxis"),
}
"""The types of the fields of a record that are no arrays."""


def segments_of(record: Any) -> dict[str, tuple[Any, ...]]:
    """The fields of a record about its segments, completed.

    Raises:
        DataError: for breaks, times and sources that do not agree.
    """
    name, breaks = record.name, tuple(int(b) for b in record.breaks)
    edges = (0, *breaks, len(record))
    if any(b <= a for a, b in pairwise(edges)):
        raise DataError(f"{name}: breaks {brief(breaks)} must ascend inside 1 … {len(record) - 1}")
    times = tuple(float(t) for t in record.times) or tuple(edge * record.dt for edge in edges[:-1])
    if len(times) != len(edges) - 1:
        raise DataError(f"{name}: {len(times)} segment times for {len(edges) - 1} segments")
    sources, before = tuple(record.sources), tuple(record.before) if any(record.before) else ()
    for what, values in (("sources", sources), ("parts before", before)):
        if values and len(values) != len(edges) - 1:
            raise DataError(f"{name}: {len(values)} segment {what} for {len(edges) - 1} segments")
    return {"breaks": breaks, "times": times, "sources": sources, "before": before}


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
