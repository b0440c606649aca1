"""Autocorrelation of a residual and its correlation with an input, without products across a gap between segments.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 16.6 on residual analysis.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SIGNIFICANCE = 0.01
"""The probability that a test of whiteness rejects a white residual, or one of independence an independent residual."""
LAGS = 50
"""Lags of the tests against functions of the inputs, in samples."""
EXCITED = 1e-2
"""Directions of lagged inputs with less than this part of the largest variance are not tested together."""
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
    e, v = _about_their_means(error, u, breaks)
    own_e, own_v = (_lagged_products(x, x, lags)[lags:] for x in (e, v))
    weights = (2.0 - (np.arange(lags + 1) == 0)) * (1 - np.arange(lags + 1) / (lags + 1))
    variance = float(np.sum(weights * own_e * own_v)) / int(np.count_nonzero(known))
    if not variance > 0:
        return nothing
    shares = _lagged_products(e, v, lags) / np.sqrt(variance)
    return shares if np.isfinite(shares).all() else nothing


class InputTest(NamedTuple):
    """Whether a residual is independent of the past of an input, with 99 % bands.

    Attributes:
        lags: how many were tested, from 0.
        largest: the largest correlation in absolute value, in standard deviations, with its sign.
        at_lag: the input is this many samples earlier.
        limit: that 99 of 100 independent residuals do not reach at any lag.
        p_value: of the portmanteau test, the chance of correlations at all lags as large together as these.
    """

    lags: int
    largest: float
    at_lag: int
    limit: float
    p_value: float

    @property
    def depends(self) -> bool:
        """Whether the residual depends on the input, by one lag or by all of them together."""
        return abs(self.largest) > self.limit or self.p_value < SIGNIFICANCE


def input_test(error: Array, u: Array, breaks: Sequence[int], lags: int) -> InputTest | None:
    """Test a residual against the past of an input, lag by lag and by a portmanteau test over all lags.

    The correlations r (lags + 1,) of independent signals have the covariance P, a Toeplitz matrix of
    Σ R_e(k)·R_u(k + τ) (Ljung, eq. 16.68), so that rᵀP⁻¹r follows χ². Directions of P that a smooth input hardly
    excites are left out.

    Args:
        error: (N,) NaN where it is not known.
        u: (N,) input.
        breaks: the first sample of every segment but the first.
        lags: the largest lag in samples.

    Returns:
        None where one of the signals is constant.
    """
    from scipy.linalg import toeplitz
    from scipy.special import chdtrc, ndtri

    both = cross_correlation(error, u, breaks, lags)
    past = both[len(both) // 2 :]
    if not past.any():
        return None
    k, most = int(np.argmax(np.abs(past))), len(past) - 1
    e, v = _about_their_means(error, u, breaks)
    own_e = _lagged_products(e, e, most) * (1 - np.abs(np.arange(-most, most + 1)) / (most + 1))
    own_u = _lagged_products(v, v, 2 * most)
    covariance = np.correlate(own_u, own_e, "valid")[most:]
    size, axes = np.linalg.eigh(toeplitz(covariance / covariance[0]))
    kept = size > EXCITED * size[-1]
    statistic = float(np.sum((axes.T[kept] @ past) ** 2 / size[kept]))
    p_value = float(chdtrc(int(np.count_nonzero(kept)), statistic))
    return InputTest(len(past), float(past[k]), k, float(-ndtri(0.005 / len(past))), p_value)


def _longest_lag(signal: Array, breaks: Sequence[int], lags: int) -> int:
    """The largest lag up to ``lags`` at which a segment has a pair of samples."""
    return min(lags, max(map(len, np.split(signal, list(breaks)))) - 1)


def _about_their_means(error: Array, u: Array, breaks: Sequence[int]) -> tuple[Spectra, Spectra]:
    """The spectra of an error, zero where it is not known, and of an input, both about their means where it is."""
    known = np.isfinite(error)
    centred = np.where(known, error - float(np.mean(error[known])), 0.0)
    return _spectra(centred, breaks), _spectra(u - float(np.mean(u[known])), breaks)


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
