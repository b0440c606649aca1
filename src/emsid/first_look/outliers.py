"""Single samples of an output far from both neighbours, as errors of a sensor or of its transmission are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.findings import Finding
from emsid.first_look.levels import FEW, JUMP, SAME
from emsid.record import Record

Array = NDArray[np.float64]

IMPOSSIBLE = 1e3
"""A sample of an input is no command if it is that many times the range of all others away from its neighbours; a
single sample that is nearer may be an impulse."""


def outliers_of(y: Array) -> tuple[NDArray[np.intp], Array]:
    """The samples (M,) of y (N,) that are outliers, and how far (M,) each is from the middle of its neighbours.

    A sample is one if it is far away both for the steps of y and for its range. NaN is none.
    """
    low, high = np.minimum(y[:-2], y[2:]), np.maximum(y[:-2], y[2:])
    middle = np.clip(y[1:-1], low, high)
    away = np.abs(y[1:-1] - middle)
    steps = np.abs(np.diff(y))
    if not np.isfinite(steps).any():
        return np.zeros(0, np.intp), np.zeros(0)
    usual = max(float(np.nanpercentile(steps, 95)), 1e-9 * float(np.nanmax(y) - np.nanmin(y)))
    spread = 1.4826 * float(np.nanmedian(np.abs(y - np.nanmedian(y))))
    found = np.flatnonzero((away > JUMP * usual) & (away > 3 * spread) & (middle != y[1:-1]))
    found = found if len(found) < SAME * len(y) else found[:0]
    return found + 1, away[found]


def impossible_commands(u: Array) -> tuple[NDArray[np.intp], Array]:
    """The outliers of an input u (N,) that are no commands, as `outliers_of` gives them."""
    found, away = outliers_of(u)
    ordinary = np.delete(u, found)
    impossible = away > IMPOSSIBLE * (np.nanmax(ordinary) - np.nanmin(ordinary)) if len(found) else np.zeros(0, bool)
    return found[impossible], away[impossible]


def outliers_of_answer(y: Array, u: Array) -> tuple[NDArray[np.intp], Array]:
    """The outliers of an output y (N,) that answer no impulse of its input u (N,), as `outliers_of` gives them."""
    found, away = outliers_of(y)
    answers = np.isin(found[:, None] - np.arange(FEW), outliers_of(u)[0]).any(axis=1)
    return found[~answers], away[~answers]


def about_outliers(name: str, found: NDArray[np.intp], away: Array, **more: object) -> Finding:
    """The finding about the outliers of a channel, of which there is one at least.

    Args:
        name: of the channel.
        found, away: the samples and how far each is away, see `outliers_of`.
        more: what else it says: ``mask``, ``masked``.
    """
    data = {"count": len(found), "sample": int(found[0]), "size": float(away.max()), "confidence": 0.8, "mask": ""}
    return Finding("outliers", name, data | more)


def without_outliers(record: Record) -> Record:
    """The record with the middle of its neighbours in place of each outlier of the first output."""
    y = record.output[:, 0]
    found, _ = outliers_of(y)
    if not len(found):
        return record
    output = record.output.copy()
    output[found, 0] = np.median(np.stack([y[found - 1], y[found], y[found + 1]]), axis=0)
    return replace(record, output=output)


def limit_of_ordinary(y: Array, found: NDArray[np.intp]) -> float | None:
    """A short number between the largest ordinary sample of y (N,) and its outliers (M,); None where there is none."""
    if not len(found):
        return None
    size = np.abs(y)
    smallest, largest = float(size[found].min()), float(np.nanmax(np.delete(size, found)))
    limit = float(f"{(smallest + largest) / 2:.3g}")
    return limit if largest < limit < smallest else None
