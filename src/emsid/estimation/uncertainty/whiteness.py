r"""Whether the residual that a fit has minimised is white.

With autocorrelations r(k) of N residuals, ``Q = N(N + 2) Σ r(k)²/(N − k)`` over L lags follows χ² if they are white
(Ljung & Box, *On a measure of lack of fit in time series models*, Biometrika 65, 1978). An estimate bends the residual
towards white, so χ² has one degree of freedom less for every coefficient of a past output.
"""

from __future__ import annotations

from collections.abc import Sequence
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


def whiteness(pieces: Sequence[Array], coefficients: int, lags: int = LAGS) -> Whiteness | None:
    """The test of a residual in pieces (Nᵢ,); None for too few samples, or no residual at all.

    Args:
        pieces: without a gap each.
        coefficients: of past outputs that were estimated from the same samples.
        lags: to test; more where the coefficients would leave none.
    """
    from scipy.special import chdtrc

    lags = max(lags, 2 * coefficients)
    samples = sum(len(piece) for piece in pieces)
    power = sum(float(piece @ piece) for piece in pieces)
    if samples < 4 * lags or not power > 0:
        return None
    products = [sum(float(piece[k:] @ piece[: max(len(piece) - k, 0)]) for piece in pieces) for k in range(1, lags + 1)]
    r = np.array(products) / power
    q = samples * (samples + 2) * float(np.sum(r**2 / (samples - np.arange(1, lags + 1))))
    k = int(np.argmax(np.abs(r)))
    return Whiteness(lags, float(chdtrc(lags - coefficients, q)), float(r[k]), k + 1)
