"""Inputs that repeat exactly, and the average of outputs over their periods.

In steady state the output of a stable system repeats with its input, and only noise differs between periods. The
average over K periods has 1/K of the variance of the noise, in 1/K of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]

LEAST_PERIOD = 8
"""Samples of the shortest period that is looked for."""
SAME = 1e-6
"""An input repeats if no sample differs from that a period before by more than this part of its range."""
ANOTHER = 0.05
"""An input does not repeat with a given period if its difference from itself a period before has more than this part of
the power that the difference of independent signals has. Noise of a measured input has less."""
SHORTEST_GIVEN = 50
"""Samples of the shortest period that may be given: its average is all that a model is fitted to."""
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

    Where the input repeats, its mean square difference from itself a period before is zero; the transform of Fourier
    gives it for all periods at once.

    >>> period_of(np.tile([0.0, 1.0, 3.0, 2.0, 5.0, 1.0, 0.5, 0.2, 9.0], 3))
    9

    Args:
        u: the input.
        least: the shortest period that counts.
    """
    samples, reach = len(u), float(np.ptp(u)) if len(u) else 0.0
    if samples < 2 * least or not reach:
        return None
    level = u - u.mean()
    size = 1 << (2 * samples - 1).bit_length()
    spectrum = np.fft.rfft(level, size)
    lags = np.arange(samples // 2 + 1)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)[: len(lags)]
    power = np.concatenate([[0.0], np.cumsum(level**2)])
    missed = power[samples - lags] + power[samples] - power[lags] - 2 * products
    for lag in np.flatnonzero(missed[least:] <= 1e-6 * power[samples]) + least:
        if np.max(np.abs(u[lag:] - u[:-lag])) <= SAME * reach:
            return int(lag)
    return None


def averaged(u: Array, y: Array, period: int) -> Period:
    """The last period of an input (N,), with the output (N,) averaged over all periods in steady state.

    Args:
        u, y: at least one period; samples before the first whole one are left out.
        period: P.

    Raises:
        ModelError: for a period that is too short, or with which the input does not repeat.
    """
    _check_period(u, period)
    count = settled_periods(y, period)
    blocks = y[len(y) - count * period :].reshape(count, period)
    mean = blocks.mean(axis=0)
    variance = float(np.sum((blocks - mean) ** 2) / ((len(blocks) - 1) * period)) if len(blocks) > 1 else 0.0
    return Period(u[len(u) - period :], mean, len(blocks), variance)


def _check_period(u: Array, period: int) -> None:
    if period < SHORTEST_GIVEN:
        enough = -(-SHORTEST_GIVEN // period) * period
        raise ModelError(
            f"a period of {period} samples is too short for a fit to its average; give several as one, such as "
            f"{enough}, or 0 for an input that does not repeat",
            arguments=("period",),
        )
    before, after = u[: len(u) - period], u[period:]
    power = 2 * float(np.var(u))
    if len(after) < LEAST_PERIOD or not power:
        return
    missed = float(np.mean((after - before) ** 2)) / power
    if missed > ANOTHER:
        found = period_of(u)
        advice = f"it does with {found}" if found else "give its period, or 0 for an input that does not repeat"
        raise ModelError(
            f"the input does not repeat with a period of {period} samples; {advice}", arguments=("period",)
        )


def whole_periods(x: Array, period: int) -> Array:
    """(P, period, n) the whole periods at the end of a signal (N,) or (N, n)."""
    count = len(x) // period
    return x[len(x) - count * period :].reshape(count, period, -1)


def settled_periods(y: Array, period: int) -> int:
    """How many whole periods at the end of an output (N,) or (N, ny) are in steady state: all, or all but the first.

    Args:
        y: at least one period.
        period: in samples.
    """
    blocks = whole_periods(y, period)
    count = len(blocks)
    return count - (count > 1 and any(_begins_unsettled(blocks[:, :, k]) for k in range(blocks.shape[2])))


def _begins_unsettled(blocks: Array) -> bool:
    """Whether the first of several periods (K, P) differs from the others by more than they do from each other."""
    changes = np.diff(blocks, axis=0) ** 2
    quarter = max(blocks.shape[1] // 4, 1)
    usual = changes[1:, :quarter] if len(changes) > 1 else changes[:, -quarter:]
    return bool(np.mean(changes[0, :quarter]) > UNSETTLED * np.mean(usual))
