"""Detection of changes by cumulative sums of the prediction error, with a stated rate of false alarms.

The error ε of a sample, divided by its standard deviation, is z. Where the structure misses a part of the motion, the z
of neighbouring samples are correlated, so they are first made white by an autoregression from their autocorrelations,
which are learnt on the way (Levinson and Durbin; Box and Jenkins, *Time Series Analysis*, appendix A3.2)::

    w = (z(t) − a₁z(t − 1) − … − aₚz(t − p)) / σ

w ~ N(0, 1) as long as the model holds. Three cumulative sums of log-likelihood ratios (Page, *Biometrika* 41, 1954)
look for a level of w above or below zero by `SHIFT`, as a load makes it, and for a larger spread, σ² → `RATIO`·σ², as
another inertia makes it under an input that varies::

    g ← max(0, g + s(w))        s = ±δw − δ²/2,    s = ½(w²(1 − 1/ρ) − ln ρ)

An alarm is given where a sum exceeds its threshold. The mean number of samples between false alarms, for errors that
are Gaussian, is that of a Markov chain on a grid of sums (Brook and Evans, *Biometrika* 59, 1972); the threshold is
chosen for a given number. Bursts of error, as at every reversal with friction, make larger sums than Gaussian errors
do. Such sums, which return to zero without an alarm, raise the threshold, and are forgotten slowly. The last sample at
which the sum was zero estimates when the change happened.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import erf, log, sqrt

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import ModelError

Array = NDArray[np.float64]

SHIFT, RATIO = 1.0, 3.0
"""The change of the level, in standard deviations, and of the variance, for which the sums are made."""

KINDS = ("level", "level", "spread")
"""What each sum looks for: a higher level, a lower one, a larger spread."""

ORDER = 4
"""Order p of the autoregression that makes the errors white."""

# Larger errors count as this many standard deviations, so that a single outlier gives no alarm.
LARGEST = 4.0
# The variances of the errors follow them at this rate, down to this part of their first values.
VARIANCE_RATE, VARIANCE_FLOOR = 1e-3, 0.25
# Memory of the autocorrelations, as the weight of a new sample.
CORRELATION_RATE = 2e-4
# Noise grows with the output (ripple, gain noise), so every octave of its size has variances of its own: their number,
# and the lowest, as an exponent of two.
OCTAVES, LOWEST = 40, -24
# The variance of ε in an octave is learnt in this part of the settling, and that of its white part in the next.
SHARE = 4
GRID = 120  # sums in the Markov chain

# A sum gives an alarm only where it is this many times the largest earlier one that gave no alarm, and this many times
# that which gave an alarm of its kind before. Both are halved in the third number times the settling.
MARGIN, AGAIN, HALVED = 1.5, 2.0, 30

# The state: samples so far, three sums, the samples since each was zero, their highest values since then, the largest
# that gave no alarm, the highest octave of the output; the samples in the autocorrelations, these, the last z; for
# every octave a number of samples, the variance of ε, its first value, that of its white part, and its first value.
_COUNT, _SUMS, _SINCE, _PEAK, _LARGEST, _TOP, _KNOWN = 0, 1, 4, 7, 10, 13, 14
_CORRELATION = _KNOWN + 1
_PAST = _CORRELATION + ORDER + 1
_FIRST, _EACH = _PAST + ORDER, 5
_STATE = _FIRST + _EACH * OCTAVES


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
        run: the mean number of samples between false alarms, for Gaussian errors.
        settling: the number of samples at the beginning that give no alarm. The first half estimates variances and
            autocorrelations; in the second half the sums are observed, and begin anew after it. They are observed
            again, for as long as this half, after an alarm, and where the output is larger than ever before, as when a
            motor starts.
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
        usual = self.thresholds / self.margin
        found = int(scan(after, errors, variances, sizes, self.thresholds, usual, float(self.settling)))
        if found < 0:
            return after, None
        index, kind = divmod(found, 3)
        alarm = Alarm(index, int(after[_SINCE + kind]), KINDS[kind])
        after[_LARGEST + kind] = AGAIN / MARGIN * after[_SUMS + kind]
        after[_SUMS:_LARGEST] = 0.0
        after[_COUNT] = self.settling // 2
        return after, alarm


@njit(nogil=True)
def scan(
    state: Array,
    errors: Array,
    variances: Array,
    outputs: Array,
    thresholds: Array,
    usual: Array,
    settling: float,
) -> int:
    """Update the sums in ``state``; returns 3·(index of an alarm) + (its sum), or −1."""
    kept, work = 0.5 ** (1.0 / (HALVED * settling)), np.zeros((2, ORDER))
    for t in range(len(errors)):
        size = abs(outputs[t])
        octave = min(max(int(np.floor(np.log2(size))) - LOWEST, 0), OCTAVES - 1) if size > 0.0 else 0
        state[_COUNT] += 1.0
        if octave > state[_TOP]:
            state[_TOP], state[_COUNT] = octave, min(state[_COUNT], settling / 2)
        if settling - 1.0 < state[_COUNT] <= settling:  # what the sums have reached by now is no change
            state[_LARGEST:_TOP] = np.maximum(state[_LARGEST:_TOP], state[_PEAK:_LARGEST])
            state[_SUMS:_LARGEST] = 0.0
        white = whitened(state, octave, errors[t] / np.sqrt(variances[t]), settling / SHARE, work)
        if state[_COUNT] <= settling / 2 or np.isnan(white):
            continue
        for k in range(3):
            if k == 2:
                step = 0.5 * (white * white * (1.0 - 1.0 / RATIO) - np.log(RATIO))
            else:
                step = (1.0 - 2.0 * k) * SHIFT * white - 0.5 * SHIFT * SHIFT
            total = state[_SUMS + k] + step
            state[_SINCE + k] += 1.0
            state[_LARGEST + k] *= kept
            if total <= 0.0:
                state[_LARGEST + k] = max(state[_LARGEST + k], state[_PEAK + k])
                total, state[_SINCE + k], state[_PEAK + k] = 0.0, 0.0, 0.0
            state[_SUMS + k], state[_PEAK + k] = total, max(state[_PEAK + k], total)
            limit = thresholds[k]
            if state[_LARGEST + k] > usual[k]:  # larger than those of Gaussian errors
                limit = max(limit, MARGIN * state[_LARGEST + k])
            if state[_COUNT] > settling and total > limit:
                return 3 * t + k
    return -1


@njit(nogil=True)
def whitened(state: Array, octave: int, error: float, learning: float, work: Array) -> float:
    """The white error w of a sample; NaN while the variances of its octave are not known.

    Args:
        state: of the detector; its autocorrelations, past errors and variances are updated.
        octave: of the output.
        error: ε of the sample, divided by √(1 + ζ).
        learning: the number of samples from which a variance is learnt.
        work: (2, p) to work in.
    """
    own = state[_FIRST + _EACH * octave : _FIRST + _EACH * (octave + 1)]
    own[0] += 1.0
    if own[0] <= learning or not own[1] > 0.0:
        own[1] += (error * error - own[1]) / own[0]
        own[2] = own[1]
    past = state[_PAST : _PAST + ORDER]
    z = min(max(error / np.sqrt(own[1]), -2 * LARGEST), 2 * LARGEST) if own[1] > 0.0 else 0.0
    white = z - predicted(state[_CORRELATION : _CORRELATION + ORDER + 1], past, work)
    _correlate(state, z)
    if own[0] <= learning:
        return np.nan
    own[1] = max(own[1] * (1.0 + VARIANCE_RATE * (z * z - 1.0)), VARIANCE_FLOOR * own[2])
    if own[0] <= 2 * learning or not own[3] > 0.0:
        own[3] += (white * white - own[3]) / (own[0] - learning)
        own[4] = own[3]
        return np.nan
    white = min(max(white / np.sqrt(own[3]), -LARGEST), LARGEST)
    own[3] = max(own[3] * (1.0 + VARIANCE_RATE * (white * white - 1.0)), VARIANCE_FLOOR * own[4])
    return float(white)


@njit(nogil=True)
def _correlate(state: Array, z: float) -> None:
    """Update the autocorrelations and the past errors."""
    past = state[_PAST : _PAST + ORDER]
    state[_KNOWN] += 1.0
    rate = max(1.0 / state[_KNOWN], CORRELATION_RATE)
    state[_CORRELATION] += rate * (z * z - state[_CORRELATION])
    for k in range(ORDER):
        state[_CORRELATION + k + 1] += rate * (z * past[k] - state[_CORRELATION + k + 1])
    for k in range(ORDER - 1, 0, -1):
        past[k] = past[k - 1]
    past[0] = z


@njit(nogil=True)
def predicted(correlation: Array, past: Array, work: Array) -> float:
    """The next value of an autoregression with these autocorrelations, by Levinson's recursion.

    Args:
        correlation: (p + 1,) from lag 0.
        past: (p,) the last values, the newest first.
        work: (2, p) to work in.
    """
    weights, before = work[0], work[1]
    weights[:] = 0.0
    left = correlation[0]
    for k in range(ORDER):
        if not left > 1e-6 * correlation[0]:
            break
        rest = correlation[k + 1]
        for j in range(k):
            rest -= weights[j] * correlation[k - j]
        partial = min(max(rest / left, -0.999), 0.999)
        before[:] = weights
        for j in range(k):
            weights[j] = before[j] - partial * before[k - 1 - j]
        weights[k] = partial
        left *= 1.0 - partial * partial
    total = 0.0
    for j in range(ORDER):
        total += weights[j] * past[j]
    return float(total)


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
