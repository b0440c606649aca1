r"""Whether what a model leaves of the output still holds something that a better model would explain.

Two questions (Ljung, *System Identification*, 2nd ed., sec. 16.6):

- Are the one-step errors white? With autocorrelations r(k), ``Q = N(N + 2) Σ r(k)²/(N − k)`` follows χ² of as many
  degrees of freedom as lags if they are (Ljung & Box, *Biometrika* 65, 1978).
- Are the free-run errors correlated with past inputs? Normalised as in `correlation`, each correlation follows the
  standard normal distribution if they are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.models.model import Run
from emsid.record import Record
from emsid.validation.correlation import autocorrelation, cross_correlation

Array = NDArray[np.float64]

LAGS = 25
"""Lags that are tested, in samples."""
SIGNIFICANCE = 0.01
"""Chance of rejecting a model whose errors are white."""
NOTABLE = 0.1
"""Autocorrelations below this do no harm, however significant a long record makes them."""
DEVIATIONS = 4.0
"""A correlation with the input is significant from this many standard deviations on; 26 are looked at."""


@dataclass(frozen=True)
class ResidualTest:
    """The errors of a model on one output.

    Attributes:
        output: its name.
        lags: how many lags were tested.
        p_value: the chance of autocorrelations as large as these, if the one-step errors are white.
        largest_autocorrelation, at_lag: of the one-step errors, in absolute value.
        largest_input_correlation: of the free-run error with a past input, in standard deviations.
        input: the name of that input.
        input_lag: how many samples earlier.
    """

    output: str
    lags: int
    p_value: float
    largest_autocorrelation: float
    at_lag: int
    largest_input_correlation: float
    input: str
    input_lag: int

    @property
    def white(self) -> bool:
        """Whether the one-step errors are white, or as good as white."""
        return self.p_value >= SIGNIFICANCE or self.largest_autocorrelation < NOTABLE

    @property
    def follows_input(self) -> bool:
        """Whether the free-run error depends on the input."""
        return self.largest_input_correlation > DEVIATIONS


def residual_tests(record: Record, prediction: Run, simulation: Run) -> list[ResidualTest]:
    """The errors of every output that a model simulates to the end; none for records of fewer samples than lags.

    Args:
        record: what was measured.
        prediction: one step ahead.
        simulation: the free run.
    """
    counted = simulation.counted & prediction.counted
    if np.count_nonzero(counted) < 4 * LAGS or not np.isfinite(simulation.output[counted]).all():
        return []
    tests = []
    for channel, name in enumerate(record.output_names):
        ahead, free = (
            np.where(counted, (record.output - run.output)[:, channel], np.nan) for run in (prediction, simulation)
        )
        if np.nanstd(ahead) > 0 and np.nanstd(free) > 0:
            tests.append(_of_one_output(name, ahead, free, record))
    return tests


def _of_one_output(name: str, ahead: Array, free: Array, record: Record) -> ResidualTest:
    from scipy.special import chdtrc

    r = np.asarray(autocorrelation(ahead, record.breaks, LAGS))[1:]
    lags, n = len(r), int(np.count_nonzero(np.isfinite(ahead)))
    q = n * (n + 2) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    past = []
    for u in record.input.T:
        both_ways = cross_correlation(free, u, record.breaks, LAGS)
        past.append(np.abs(both_ways[len(both_ways) // 2 :]))  # the input now and earlier
    largest = [float(np.max(each)) for each in past]
    k = int(np.argmax(largest))
    return ResidualTest(
        output=name,
        lags=lags,
        p_value=float(chdtrc(lags, q)),
        largest_autocorrelation=float(np.max(np.abs(r))),
        at_lag=int(np.argmax(np.abs(r))) + 1,
        largest_input_correlation=largest[k],
        input=record.input_names[k],
        input_lag=int(np.argmax(past[k])),
    )
