"""Checks of the arguments of test signals: sizes, amplitudes, frequencies, samples."""

from __future__ import annotations

import operator
from typing import SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.record import Record

Array = NDArray[np.float64]

# The longest signal: more than a day at 1 kHz, and small enough for the memory of a laptop.
MOST_SAMPLES = 10**8


def whole(value: SupportsIndex, what: str) -> int:
    """A whole number from 1 to `MOST_SAMPLES`; ``what`` names it in the message."""
    try:
        number = operator.index(value)
    except TypeError:
        number = 0
    if not 1 <= number <= MOST_SAMPLES:
        hint = ", by another duration or sample time" if what == "number of samples" else ""
        raise DataError(f"{what} {value}; give a whole number from 1 to {MOST_SAMPLES:,}{hint}")
    return number


def positive(value: float, what: str) -> float:
    """A finite number above zero."""
    if not (np.isfinite(value) and value > 0):
        raise DataError(f"{what} {value}; give a positive number")
    return float(value)


def vector(values: ArrayLike, what: str) -> Array:
    """(m,) finite numbers."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not np.isfinite(array).all():
        raise DataError(f"{what} of shape {array.shape}; give a one-dimensional list of finite numbers")
    return array


def check_frequency(frequency: float, dt: float) -> None:
    """Refuse a frequency in Hz that is negative, or not below half the sampling frequency."""
    nyquist = 0.5 / dt
    if not 0 <= frequency < nyquist:
        raise DataError(f"frequency {frequency:g} Hz; give one from 0 to below the Nyquist frequency of {nyquist:g} Hz")


def as_record(signal: Record | ArrayLike) -> Record:
    """A record unchanged; an array becomes the input of a record with a sample time of 1 s and no output."""
    if isinstance(signal, Record):
        return signal
    u = np.asarray(signal, dtype=np.float64)
    return Record(u, np.empty((len(u) if u.ndim else 0, 0)), dt=1.0, name="signal")
