"""Band-limited interpolation of an input between its samples."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Interpolation between samples uses this many samples on either side.
INTERPOLATION_REACH = 16


def interpolated(u: Array, factor: int) -> Array:
    """(N·factor,) the band-limited signal through samples u (N,), continued point-symmetrically at its ends.

    Within `INTERPOLATION_REACH` samples of an end it is an extrapolation. The result is cached and read-only, because a
    search needs the same one thousands of times.
    """
    return u if factor == 1 else _interpolated(np.asarray(u, dtype=float).tobytes(), factor)


def between(u: Array, factor: int) -> Array:
    """((N − 2·reach)·factor,) the band-limited signal through samples u (N,), from the sample ``reach`` on.

    ``reach`` is `INTERPOLATION_REACH`: the samples at either end only support the interpolation.
    """
    from scipy.signal import resample_poly

    at = INTERPOLATION_REACH * factor
    fine: Array = resample_poly(u, factor, 1, window=_low_pass(factor))[at:-at]
    return fine


@lru_cache(maxsize=64)
def _interpolated(samples: bytes, factor: int) -> Array:
    u, reach = np.frombuffer(samples), INTERPOLATION_REACH
    around = np.pad(u, reach, "reflect", reflect_type="odd") if len(u) > reach else np.pad(u, reach, "edge")
    fine = between(around, factor)
    fine.flags.writeable = False
    return fine


@lru_cache
def _low_pass(factor: int) -> Array:
    from scipy.signal import firwin

    low_pass: Array = firwin(2 * INTERPOLATION_REACH * factor + 1, 1 / factor, window=("kaiser", 9.0))
    return low_pass
