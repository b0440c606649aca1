"""Autocorrelation of a residual and its correlation with an input, without products across a gap between segments.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 16.6 on residual analysis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# The length of every segment of a signal, and its Fourier transform.
Spectra = list[tuple[int, NDArray[np.complex128]]]


def autocorrelation(error: Array, breaks: Sequence[int], lags: int) -> Array:
    """(≤ lags + 1,) autocorrelation after removal of the mean, over pairs that are known and lie in one segment.

    Args:
        error: (N,) NaN where it is not known.
        breaks: the first sample of every segment but the first.
        lags: largest lag in samples.
    """
    lags = _longest_lag(error, breaks, lags)
    spectra = _spectra(np.nan_to_num(error - np.nanmean(error)), breaks)
    products = _lagged_products(spectra, spectra, lags)[lags:]
    return products / (products[0] or 1.0)


def cross_correlation(error: Array, u: Array, breaks: Sequence[int], lags: int) -> Array:
    """(≤ 2·lags + 1,) correlation of the error with the input τ samples earlier, τ = −lags … lags.

    It is divided by its standard deviation for independent signals: the sum of N products then has the variance
    N·Σ R_e(k)·R_u(k), in autocovariances (Ljung, eq. 16.68), here with a triangular window. All values are zero where
    one of the signals is zero.

    Args:
        error: (N,) NaN where it is not known.
        u: (N,) input.
        breaks: the first sample of every segment but the first.
        lags: largest lag in samples, in both directions.
    """
    lags = _longest_lag(error, breaks, lags)
    known = np.isfinite(error)
    nothing = np.zeros(2 * lags + 1)
    if not known.any():
        return nothing
    e = _spectra(np.where(known, error - float(np.mean(error[known])), 0.0), breaks)
    v = _spectra(u - float(np.mean(u[known])), breaks)
    own_e, own_v = (_lagged_products(x, x, lags)[lags:] for x in (e, v))
    weights = (2.0 - (np.arange(lags + 1) == 0)) * (1 - np.arange(lags + 1) / (lags + 1))
    variance = float(np.sum(weights * own_e * own_v)) / int(np.count_nonzero(known))
    if not variance > 0:
        return nothing
    shares = _lagged_products(e, v, lags) / np.sqrt(variance)
    return shares if np.isfinite(shares).all() else nothing


def _longest_lag(signal: Array, breaks: Sequence[int], lags: int) -> int:
    """The largest lag up to ``lags`` at which a segment has a pair of samples."""
    return min(lags, max(map(len, np.split(signal, list(breaks)))) - 1)


def _spectra(signal: Array, breaks: Sequence[int]) -> Spectra:
    pieces = np.split(signal, list(breaks))
    # Padded to at least twice the length, so that the correlation is not circular.
    return [(len(piece), np.fft.rfft(piece, 1 << (2 * len(piece) - 1).bit_length())) for piece in pieces]


def _lagged_products(a: Spectra, b: Spectra, lags: int) -> Array:
    """(2·lags + 1,) Σₜ a(t)·b(t − τ) for τ = −lags … lags, over pairs that lie in one segment."""
    sums = np.zeros(2 * lags + 1)
    for (samples, x), (_, y) in zip(a, b, strict=True):
        reach = min(lags, samples - 1)
        sums[lags - reach : lags + reach + 1] += np.fft.irfft(x * np.conj(y))[np.arange(-reach, reach + 1)]
    return sums
