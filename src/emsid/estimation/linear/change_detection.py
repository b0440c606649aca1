"""Detection of changes by cumulative sums of the prediction error, with a stated rate of false alarms.

The error ε of a sample, divided by its standard deviation, is z ~ N(0, 1) as long as the model holds. Three cumulative
sums of log-likelihood ratios (Page, *Biometrika* 41, 1954) look for a level of z above or below zero by `SHIFT`, as a
load makes it, and for a larger spread, σ² → `RATIO`·σ², as another inertia makes it under an input that varies::

    g ← max(0, g + s(z))        s = ±δz − δ²/2,    s = ½(z²(1 − 1/ρ) − ln ρ)

An alarm is given where a sum exceeds its threshold. The mean number of samples between false alarms, for errors that
are white and Gaussian, is that of a Markov chain on a grid of sums (Brook and Evans, *Biometrika* 59, 1972); the
threshold is chosen for a given number. Where a sum passes it while the sums are only observed, the errors are not
white, and the threshold is raised. The last sample at which the sum was zero estimates when the change happened.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import erf, log, sqrt

import numba
import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]

SHIFT, RATIO = 1.0, 3.0
"""The change of the level, in standard deviations, and of the variance, for which the sums are made."""

KINDS = ("level", "level", "spread")
"""What each sum looks for: a higher level, a lower one, a larger spread."""

# Larger errors count as this many standard deviations, so that a single outlier gives no alarm.
LARGEST = 4.0
# The variance of the errors follows them at this rate, down to this part of its first value.
VARIANCE_RATE, VARIANCE_FLOOR = 1e-3, 0.25
# Noise grows with the output (ripple, gain noise), so every octave of its size has a variance of its own: their number,
# and the lowest, as an exponent of two.
OCTAVES, LOWEST = 40, -24
# An octave has its variance after this part of the settling.
SHARE = 4
GRID = 120  # sums in the Markov chain

# Errors that are not white, as of a structure that misses a part of the motion, make larger sums. Where a sum exceeds
# its threshold while it is only observed, the threshold is this many times its largest value.
MARGIN = 4.0

# The state: samples so far, three sums, the samples since each was zero, their largest values while they were observed,
# the highest octave of the output, and for every octave a number of samples, the variance, and its first value.
_COUNT, _SUMS, _SINCE, _LARGEST, _TOP, _FIRST = 0, 1, 4, 7, 10, 11
_STATE = _FIRST + 3 * OCTAVES


@dataclass(frozen=True)
class Alarm:
    """A change of the prediction error.

    Attributes:
        index: the sample of the alarm, in the errors that were given.
        since: the number of samples from the estimated change to the alarm.
        kind: ``level`` or ``spread``.
    """

    index: int
    since: int
    kind: str


@dataclass(frozen=True)
class ChangeDetector:
    """Cumulative sums of the prediction error.

    Args:
        run: the mean number of samples between false alarms, for white Gaussian errors.
        settling: the number of samples at the beginning, and after an alarm, that give no alarm. The first half
            estimates the variance; in the second half the sums are observed. They are observed again where the output
            is larger than ever before, as when a motor starts.
        margin: multiplies the thresholds, at least 1; false alarms are then rarer than stated. It lets pass the short
            bursts of error of a structure that misses a part of the motion, as at a reversal with friction.

    Raises:
        ModelError: for numbers out of range.
    """

    run: float = 1e6
    settling: int = 200
    margin: float = 1.0

    def __post_init__(self) -> None:
        if not 100 <= self.run <= 1e12:
            raise ModelError(f"{self.run:g} samples between false alarms; give a number from 100 to 1e12")
        if not self.settling >= 10:
            raise ModelError(f"{self.settling} samples of settling; give at least 10")
        if not self.margin >= 1:
            raise ModelError(f"margin {self.margin} of the thresholds; give at least 1")

    @property
    def thresholds(self) -> Array:
        """(3,) of the sums; each has a third of the false alarms."""
        level, spread = (threshold(kind, 3 * self.run) for kind in ("level", "spread"))
        return self.margin * np.array([level, level, spread])

    def start(self) -> Array:
        """The state before the first sample, an array of numbers."""
        return np.zeros(_STATE)

    def update(
        self, state: Array, errors: Array, variances: Array, outputs: Array | None = None
    ) -> tuple[Array, Alarm | None]:
        """The state after these errors, up to and with the first alarm.

        Args:
            state: from `start` or an earlier update.
            errors: (m,) prediction errors by the estimate before each sample.
            variances: (m,) the variance of each as a multiple of that of the noise, 1 + ζ.
            outputs: (m,) the measured outputs; the noise may grow with their size.
        """
        after = state.copy()
        sizes = np.ones(len(errors)) if outputs is None else outputs
        found = int(scan(after, errors, variances, sizes, self.thresholds, float(self.settling)))
        if found < 0:
            return after, None
        index, kind = divmod(found, 3)
        return self.start(), Alarm(index, int(after[_SINCE + kind]), KINDS[kind])


@numba.njit(cache=True, nogil=True)
def scan(state: Array, errors: Array, variances: Array, outputs: Array, thresholds: Array, settling: float) -> int:
    """Update the sums in ``state``; returns 3·(index of an alarm) + (its sum), or −1."""
    for t in range(len(errors)):
        square = errors[t] * errors[t] / variances[t]
        size = abs(outputs[t])
        octave = min(max(int(np.floor(np.log2(size))) - LOWEST, 0), OCTAVES - 1) if size > 0.0 else 0
        own = state[_FIRST + 3 * octave : _FIRST + 3 * octave + 3]
        state[_COUNT] += 1.0
        own[0] += 1.0
        if octave > state[_TOP]:
            state[_TOP], state[_COUNT] = octave, min(state[_COUNT], settling / 2)
        if own[0] <= settling / SHARE or not own[1] > 0.0:
            own[1] += (square - own[1]) / own[0]
            own[2] = own[1]
            continue
        z = min(max(errors[t] / np.sqrt(own[1] * variances[t]), -LARGEST), LARGEST)
        own[1] = max(own[1] * (1.0 + VARIANCE_RATE * (z * z - 1.0)), VARIANCE_FLOOR * own[2])
        if state[_COUNT] <= settling / 2:
            continue
        for k in range(3):
            if k == 2:
                step = 0.5 * (z * z * (1.0 - 1.0 / RATIO) - np.log(RATIO))
            else:
                step = (1.0 - 2.0 * k) * SHIFT * z - 0.5 * SHIFT * SHIFT
            total = state[_SUMS + k] + step
            state[_SINCE + k] += 1.0
            if total <= 0.0:
                total, state[_SINCE + k] = 0.0, 0.0
            state[_SUMS + k] = total
            if state[_COUNT] <= settling:
                state[_LARGEST + k] = max(state[_LARGEST + k], total)
            elif total > thresholds[k] and (
                state[_LARGEST + k] <= thresholds[k] or total > MARGIN * state[_LARGEST + k]
            ):
                return 3 * t + k
    return -1


@cache
def threshold(kind: str, run: float) -> float:
    """The threshold of a sum at which a false alarm comes once in ``run`` samples.

    Args:
        kind: of `KINDS`.
        run: in samples.
    """
    low, high = 0.1, 60.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if average_run(kind, middle) < run else (low, middle)
    return high


def average_run(kind: str, limit: float) -> float:
    """The mean number of samples to a false alarm of a sum with the threshold ``limit``."""
    below = _level_below if kind == "level" else _spread_below
    width = 2 * limit / (2 * GRID - 1)  # the first state is the sum zero, and half as wide
    sums = width * np.arange(GRID)
    reached = below(sums[None, :] + width / 2 - sums[:, None])
    moves = np.diff(reached, axis=1, prepend=0.0)
    runs = np.linalg.solve(np.eye(GRID) - moves, np.ones(GRID))
    return float(runs[0]) if runs[0] > 0 else float("inf")


def _normal(x: Array) -> Array:
    values: Array = 0.5 * (1 + np.vectorize(erf)(x / sqrt(2.0)))
    return values


def _level_below(step: Array) -> Array:
    """The probability that the step of a sum for the level is smaller."""
    return _normal((step + SHIFT**2 / 2) / SHIFT)


def _spread_below(step: Array) -> Array:
    """The probability that the step of the sum for the spread is smaller."""
    square = np.maximum((2 * step + log(RATIO)) / (1 - 1 / RATIO), 0.0)
    return 2 * _normal(np.sqrt(square)) - 1
