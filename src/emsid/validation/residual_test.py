r"""Test whether the one-step errors of a model are white.

With autocorrelations r(k) of N errors, ``Q = N(N + 2) Σ r(k)²/(N − k)`` follows χ² of as many degrees of freedom as
lags if they are white (Ljung & Box, *On a measure of lack of fit in time series models*, Biometrika 65, 1978).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.models.model import Run
from emsid.record import Record
from emsid.validation.correlation import SIGNIFICANCE, autocorrelation

Array = NDArray[np.float64]

LAGS = 25
"""Lags that are tested, in samples."""
NOTABLE = 0.1
"""Smaller autocorrelations are accepted, even if they are significant in a long record."""


@dataclass(frozen=True)
class ResidualTest:
    """Test of the one-step errors of one output.

    Attributes:
        output: its name.
        lags: how many lags were tested.
        p_value: the chance of autocorrelations as large as these, if the one-step errors are white.
        largest_autocorrelation, at_lag: of the one-step errors, in absolute value.
    """

    output: str
    lags: int
    p_value: float
    largest_autocorrelation: float
    at_lag: int

    @property
    def white(self) -> bool:
        """Whether the one-step errors are white, or nearly white."""
        return self.p_value >= SIGNIFICANCE or self.largest_autocorrelation < NOTABLE


def residual_tests(record: Record, prediction: Run) -> list[ResidualTest]:
    """Test every output; no test for a record of few samples, or a prediction that diverged.

    Args:
        record: the measured data.
        prediction: the one-step prediction.
    """
    counted = prediction.counted
    if np.count_nonzero(counted) < 4 * LAGS or not np.isfinite(prediction.output[counted]).all():
        return []
    errors = np.where(counted[:, None], record.output - prediction.output, np.nan)
    return [
        _of_one_output(name, error, record)
        for name, error in zip(record.output_names, errors.T, strict=True)
        if np.nanstd(error) > 0
    ]


def _of_one_output(name: str, error: Array, record: Record) -> ResidualTest:
    from scipy.special import chdtrc

    r = np.asarray(autocorrelation(error, record.breaks, LAGS))[1:]
    lags, n = len(r), int(np.count_nonzero(np.isfinite(error)))
    q = n * (n + 2) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    k = int(np.argmax(np.abs(r)))
    return ResidualTest(name, lags, float(chdtrc(lags, q)), float(abs(r[k])), k + 1)
