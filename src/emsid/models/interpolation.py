"""Band-limited interpolation of an input between its samples."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Interpolation between samples uses this many samples on either side.
INTERPOLATION_REACH = 16
# The shape of the window: the stop band of the low-pass is 90 dB below its pass band.
KAISER = 9.0


def interpolated(u: Array, factor: int) -> Array:
    """(N·factor,) the band-limited signal through samples u (N,), continued point-symmetrically at its ends.

    Within `INTERPOLATION_REACH` samples of an end it is an extrapolation. The result is cached and read-only, because a
    search needs the same one thousands of times.
    """
    return u if factor == 1 else _interpolated(np.asarray(u, dtype=float).tobytes(), factor)


def between(u: Array, factor: int) -> Array:
    """((N − 2·reach)·factor,) the band-limited signal through samples u (N,), from the sample ``reach`` on.

    ``reach`` is `INTERPOLATION_REACH`: the samples at either end only support the interpolation. Every one of the
    ``factor`` values in a sample interval is the convolution with a part of the low-pass of its own (polyphase form).
    """
    low_pass = _low_pass(factor)
    parts = [np.convolve(u[min(k, 1) :], low_pass[k::factor], "valid") for k in range(factor)]
    return np.column_stack(parts).reshape(-1)


@lru_cache(maxsize=64)
def _interpolated(samples: bytes, factor: int) -> Array:
    u, reach = np.frombuffer(samples), INTERPOLATION_REACH
    around = np.pad(u, reach, "reflect", reflect_type="odd") if len(u) > reach else np.pad(u, reach, "edge")
    fine = between(around, factor)
    fine.flags.writeable = False
    return fine


@lru_cache
def _low_pass(factor: int) -> Array:
    """(2·reach·factor + 1,) the ideal low-pass in a Kaiser window, with the sum ``factor``."""
    half = INTERPOLATION_REACH * factor
    taps = np.sinc(np.arange(-half, half + 1) / factor) * np.kaiser(2 * half + 1, KAISER)
    scaled: Array = taps * factor / taps.sum()
    return scaled
