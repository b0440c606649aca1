"""Trends, decimation and low-pass filters of the samples of one segment, (N, channels) each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGEST_TREND = 5
"""The largest order of a trend. One of a higher order follows the motion, which is then subtracted too."""
DECIMATED, FILTERED = 20, 15
"""Samples of the slow rate, and of the record, that a segment must exceed for a filter to settle within it."""
LOWEST = 1e-5
"""The lowest cutoff as a part of the sampling frequency: below, the filter's poles lose half of their digits."""


def without_trend(values: Array, time: Array, order: int) -> Array:
    """The samples minus a polynomial of this order in the time (N,), fitted to every channel."""
    span = time[-1] - time[0]
    within = 2 * (time - time[0]) / span - 1 if span else np.zeros_like(time)
    powers = np.polynomial.legendre.legvander(within, order)
    size = np.maximum(np.abs(values).max(axis=0, initial=0.0), np.finfo(float).tiny)  # LAPACK must not overflow
    return np.asarray(values - size * (powers @ np.linalg.lstsq(powers, values / size, rcond=None)[0]))


def decimated(values: Array, factor: int) -> Array:
    """Every ``factor``-th sample after a zero-phase FIR anti-alias filter.

    `scipy.signal.decimate` assumes that the signal is zero before its start. Subtracting the first value avoids a false
    transient where the signal starts at a constant level.
    """
    from scipy.signal import decimate

    return np.asarray(decimate(values - values[:1], factor, ftype="fir", axis=0) + values[:1])


def low_passed(values: Array, cutoff: float, dt: float) -> Array:
    """The samples through a Butterworth filter of order 4, forwards and backwards, at a sample time of ``dt`` in s."""
    from scipy.signal import butter, sosfiltfilt

    return np.asarray(sosfiltfilt(butter(4, cutoff, fs=1 / dt, output="sos"), values, axis=0))
