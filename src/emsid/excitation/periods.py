"""Inputs that repeat exactly, and the average of outputs over their periods.

In steady state the output of a stable system repeats with its input, and only noise differs between periods. The
average over K periods has 1/K of the variance of the noise, in 1/K of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_PERIOD = 1_000
"""Samples of the shortest period that is looked for; an average over a shorter one is a very short record."""
SAME = 1e-9
"""An input repeats if no sample differs from that a period before by more than this part of the largest."""
UNSETTLED = 2.0
"""The first period is not in steady state if the second differs from it by more than this factor of what later ones do,
in mean square."""


@dataclass(frozen=True, eq=False)
class Period:
    """One period of an input in steady state, and the output averaged over several.

    Attributes:
        input: (P,) u.
        output: (P,) the mean of y.
        averages: how many periods it is the mean of.
        variance: of the noise on y, from its variance over periods; 0 for one period.
    """

    input: Array
    output: Array
    averages: int
    variance: float


def period_of(u: Array, least: int = LEAST_PERIOD) -> int | None:
    """The shortest period, in samples, of an input (N,) with at least two; None if it does not repeat.

    Args:
        u: the input.
        least: the shortest period that counts.
    """
    samples = len(u)
    if samples < 2 * least:
        return None
    bound = SAME * float(np.max(np.abs(u)))
    level = u - u.mean()
    size = 2 ** int(np.ceil(np.log2(2 * samples)))
    spectrum = np.fft.rfft(level, size)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)[: samples // 2 + 1]
    power = np.concatenate([[0.0], np.cumsum(level**2)])
    lags = np.arange(samples // 2 + 1)
    missed = power[samples - lags] + power[samples] - power[lags] - 2 * products
    for lag in np.flatnonzero(missed <= 1e-6 * power[samples]):
        if lag >= least and np.max(np.abs(u[lag:] - u[:-lag])) <= bound:
            return int(lag) if np.ptp(u) > 0 else None
    return None


def averaged(u: Array, y: Array, period: int) -> Period:
    """The last period of an input (N,), with the output (N,) averaged over all periods in steady state.

    Args:
        u, y: at least one period; samples before the first whole one are left out.
        period: P.
    """
    count = len(u) // period
    blocks = y[len(y) - count * period :].reshape(count, period)
    if count > 1 and _begins_unsettled(blocks):
        blocks = blocks[1:]
    mean = blocks.mean(axis=0)
    variance = float(np.sum((blocks - mean) ** 2) / ((len(blocks) - 1) * period)) if len(blocks) > 1 else 0.0
    return Period(u[len(u) - period :], mean, len(blocks), variance)


def _begins_unsettled(blocks: Array) -> bool:
    """Whether the first of several periods (K, P) differs from the others by more than they do from each other."""
    changes = np.diff(blocks, axis=0) ** 2
    quarter = max(blocks.shape[1] // 4, 1)
    usual = changes[1:, :quarter] if len(changes) > 1 else changes[:, -quarter:]
    return bool(np.mean(changes[0, :quarter]) > UNSETTLED * np.mean(usual))
