"""Sweeps, staircases and ramps: deterministic test signals.

References:
    Pintelon, R., Schoukens, J. (2012). System Identification: A Frequency Domain Approach, 2nd ed.
    Ljung, L. (1999). System Identification: Theory for the User, 2nd ed., chapter 13.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.excitation.checks import check_frequency, positive, vector, whole

Array = NDArray[np.float64]

Sweep = Callable[[Array, float, float], Array]
"""(elapsed fraction x of the sweep, first and last frequency in Hz) → ∫₀ˣ f(ξ) dξ in Hz."""


def linear_sweep(x: Array, first: float, last: float) -> Array:
    """∫₀ˣ f with f(ξ) = f₀ + (f₁ − f₀) ξ: equal time for every hertz.

    Args:
        x: (N,) the elapsed fraction of the sweep, 0 to 1.
        first, last: frequencies f₀ and f₁ in Hz.
    """
    return first * x + (last - first) * x**2 / 2


def logarithmic_sweep(x: Array, first: float, last: float) -> Array:
    """∫₀ˣ f with f(ξ) = f₀ (f₁/f₀)^ξ: equal time for every octave.

    Args:
        x: (N,) the elapsed fraction of the sweep, 0 to 1.
        first, last: frequencies f₀ and f₁ in Hz.

    Raises:
        DataError: for a frequency that is not positive.
    """
    if min(first, last) <= 0:
        raise DataError(f"a logarithmic sweep from {first:g} to {last:g} Hz; give positive frequencies")
    rate = np.log(last / first)
    return first * x if rate == 0 else first * np.expm1(rate * x) / rate


def chirp(
    samples: int, dt: float, first: float, last: float, amplitude: float = 1.0, sweep: Sweep = linear_sweep
) -> Array:
    """The swept sine u(t) = a sin(2π T ∫₀^{t/T} f(ξ) dξ), T = N·dt, starting at 0. Crest factor about √2.

    Args:
        samples: N, the number of samples.
        dt: sample time in seconds.
        first, last: frequencies f₀ and f₁ at both ends in Hz, below Nyquist; either may be the higher.
        amplitude: a, in the unit of the signal.
        sweep: the course of the frequency from one to the other: `linear_sweep`, `logarithmic_sweep` or your own.

    Raises:
        DataError: for a frequency that is negative or not below Nyquist, or a bad size.

    Source: Pintelon & Schoukens, chapter 5; Ljung, section 13.3.
    """
    count, step = whole(samples, "number of samples"), positive(dt, "sample time")
    a = positive(amplitude, "amplitude")
    check_frequency(first, dt)
    check_frequency(last, dt)
    return a * np.sin(2 * np.pi * count * step * sweep(np.arange(count) / count, first, last))


def staircase(samples: int, steps: int, amplitude: float = 1.0) -> Array:
    """Levels 0, a/n, …, a, …, 0, −a/n, …, −a, …, 0: up, down, negative, back, each of equal length.

    Every level but ±a is reached both rising and falling. The steady speeds therefore show the static curve with
    its dead zone, its Coulomb friction and its hysteresis.

    Args:
        samples: N, at least one for each of the 4n + 1 levels; their lengths differ by at most one sample.
        steps: n, the number of steps from 0 to a.
        amplitude: a, in the unit of the signal.

    Raises:
        DataError: for fewer samples than levels, or a bad size.

    >>> staircase(9, 2, 6.0)
    array([ 0.,  3.,  6.,  3.,  0., -3., -6., -3.,  0.])
    """
    count, n = whole(samples, "number of samples"), whole(steps, "number of steps")
    a = positive(amplitude, "amplitude")
    if count < 4 * n + 1:
        raise DataError(f"{count} samples for a staircase of {4 * n + 1} levels; give more samples or fewer steps")
    level = np.arange(count) * (4 * n + 1) // count
    return a * (_triangle(level, n) / n)


def _triangle(k: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """0 … n … 0 … −n … 0 for k = 0 … 4n."""
    return np.where(k <= 2 * n, n - np.abs(k - n), np.abs(k - 3 * n) - n)


def ramp(samples: int, corners: ArrayLike) -> Array:
    """Straight lines through the corner values at one slope |du/dt|, from the first value to the last.

    ``ramp(n, (0, 12, -12, 0))`` rises slowly, falls through zero and returns. The response shows the voltages
    at which the motor breaks away and stops, for both directions.

    Args:
        samples: N, at least 2.
        corners: (m ≥ 2,) values to reach, in the unit of the signal; a corner between two samples
            is missed by less than the change of one sample.

    Raises:
        DataError: for fewer than two corners, or two equal ones in a row.

    >>> ramp(5, (0.0, 2.0, 0.0))
    array([0., 1., 2., 1., 0.])
    """
    count = whole(samples, "number of samples")
    values = vector(corners, "corners")
    travel = np.abs(np.diff(values))
    if count < 2 or len(values) < 2 or np.any(travel == 0):
        raise DataError(
            f"a ramp of {count} samples through {values.tolist()}; give 2 or more of both, no two equal in a row"
        )
    passed = np.concatenate([[0.0], np.cumsum(travel)])
    return np.interp(np.linspace(0.0, passed[-1], count), passed, values)
