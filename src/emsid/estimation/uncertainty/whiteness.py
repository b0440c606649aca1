r"""Whether the residual that a fit has minimised is white.

With autocorrelations r(k) of N residuals, ``Q = N(N + 2) Σ r(k)²/(N − k)`` over L lags follows χ² if they are white
(Ljung & Box, *On a measure of lack of fit in time series models*, Biometrika 65, 1978). An estimate makes the residual
look whiter than the noise is, which takes degrees of freedom from χ². Of an autoregression it takes one for every
coefficient; of a regression with inputs only as much as past residuals have in common with its regressors, see
`absorbed`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAGS = 25
"""Lags that are tested, in samples."""
SIGNIFICANCE = 0.01
"""Chance of calling a white residual coloured."""


class Whiteness(NamedTuple):
    """The test of a residual.

    Attributes:
        lags: how many were tested.
        p_value: the chance of autocorrelations as large as these in a white residual.
        largest: the autocorrelation of largest absolute value, with its sign.
        at_lag: its lag.
    """

    lags: int
    p_value: float
    largest: float
    at_lag: int

    @property
    def white(self) -> bool:
        """Whether the residual passes for white."""
        return self.p_value >= SIGNIFICANCE


def absorbed(pieces: Sequence[tuple[Array, Array]], lags: int = LAGS) -> float:
    """The degrees of freedom that an estimate by least squares takes from the autocorrelations of its residual.

    With R the derivative of the autocorrelations by the coefficients, the autocorrelations of the residual have the
    covariance (I − R(ΦᵀΦ)⁻¹Rᵀσ²)/N (Box and Pierce, *J. American Statistical Association* 65, 1970, for
    autoregressions). What that takes from all lags together is Σₖ ‖P·e(t − k)‖²/‖e‖² with P the projection on the
    regressors, less what chance has in common.

    Args:
        pieces: residual (Nᵢ,) and regressors (Nᵢ, p), which together have full rank.
        lags: that are tested.
    """
    inverse = np.linalg.inv(np.linalg.qr(np.concatenate([phi for _, phi in pieces]), mode="r"))
    power = sum(float(e @ e) for e, _ in pieces)
    samples, count = sum(len(e) for e, _ in pieces), len(inverse)
    shared = np.zeros((lags, count))
    for e, phi in pieces:
        basis = phi @ inverse
        shared += [basis[k:].T @ e[: max(len(e) - k, 0)] for k in range(1, lags + 1)]
    return float(np.clip(np.sum(shared**2) / power - lags * count / samples, 0.0, count))


def whiteness(pieces: Sequence[Array], coefficients: float, lags: int = LAGS) -> Whiteness | None:
    """The test of a residual in pieces (Nᵢ,); None for too few samples, or no residual at all.

    Args:
        pieces: without a gap each.
        coefficients: of past outputs that were estimated from the same samples, or what is `absorbed`.
        lags: to test; more where the coefficients would leave none.
    """
    from scipy.special import chdtrc

    lags = max(lags, ceil(2 * coefficients))
    samples = sum(len(piece) for piece in pieces)
    power = sum(float(piece @ piece) for piece in pieces)
    if samples < 4 * lags or not power > 0:
        return None
    products = [sum(float(piece[k:] @ piece[: max(len(piece) - k, 0)]) for piece in pieces) for k in range(1, lags + 1)]
    r = np.array(products) / power
    q = samples * (samples + 2) * float(np.sum(r**2 / (samples - np.arange(1, lags + 1))))
    k = int(np.argmax(np.abs(r)))
    return Whiteness(lags, float(chdtrc(lags - coefficients, q)), float(r[k]), k + 1)
