r"""What poles of sampled models say in continuous time: time constants, natural frequencies and damping ratios.

A pole z is s = ln(z)/T. A real one decays with the time constant −1/s; a pair of complex ones oscillates with the
natural frequency ω₀ = |s| and the damping ratio ζ = −Re(s)/|s|, and has no time constant of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FASTER = 5.0
"""A pair that decays this many times faster than the slowest pole hardly shows in a response (dominant poles)."""


class Oscillation(NamedTuple):
    """A pair of complex poles.

    Attributes:
        frequency: natural, in rad/s.
        damping: its ratio; below 0 it grows.
    """

    frequency: float
    damping: float


def time_constants(poles: NDArray[Any], dt: float) -> list[float]:
    """Of the real poles between 0 and 1, in s, the slowest first."""
    real = [float(p.real) for p in np.asarray(poles, dtype=complex) if abs(p.imag) < 1e-9 and 0 < p.real < 1]
    return [-dt / float(np.log(pole)) for pole in sorted(real, reverse=True)]


def oscillation(poles: NDArray[Any], dt: float) -> Oscillation | None:
    """The slowest pair of complex poles; None where there is none, or where all decay fast beside the slowest pole.

    >>> pair = oscillation(np.exp(0.01 * np.array([-1 + 10j, -1 - 10j])), 0.01)
    >>> round(pair.frequency, 6), round(pair.damping, 6)
    (10.049876, 0.099504)
    """
    poles = np.asarray(poles, dtype=complex)
    stable = poles[(np.abs(poles) > 0) & (np.abs(poles) < 1)]
    pairs = stable[stable.imag > 1e-9]
    if not len(pairs):
        return None
    slowest = pairs[np.argmax(np.abs(pairs))]
    if np.log(np.abs(slowest)) < FASTER * np.log(np.max(np.abs(stable))):
        return None
    s = np.log(slowest) / dt
    return Oscillation(float(np.abs(s)), float(-s.real / np.abs(s)))
