"""A motor with inductance as one mass, by small steps of the midpoint rule, with friction that is smooth around rest.

L·di/dt = D(u) − R·i − K·ω,      J·dω/dt = K·i − T·tanh(ω/ε)
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEPS = 400
"""Steps in every sample."""


class Motion(NamedTuple):
    """Speed, angle and current (N,) at the samples."""

    speed: Array
    angle: Array
    current: Array

    def mean_speed(self, dt: float) -> Array:
        """(N,) the mean over the sample before each, as from counting the edges of an encoder."""
        mean: Array = np.diff(self.angle, prepend=self.angle[0]) / dt
        return mean


def motion(
    u: Array, dt: float, resistance: float, inductance: float, constant: float, inertia: float, friction: float,
    dead_zone: float,
) -> Motion:  # fmt: skip
    """From rest without current, for a voltage (N,) held over every sample and not yet acting at its beginning."""
    return Motion(*_run(u, dt, resistance, inductance, constant, inertia, friction, dead_zone))


def speed(u, dt, resistance, inductance, constant, inertia, friction, dead_zone):  # type: ignore[no-untyped-def]
    """(N,) the speed of `motion`."""
    return motion(u, dt, resistance, inductance, constant, inertia, friction, dead_zone).speed


@numba.njit(cache=True)
def _run(u, dt, resistance, inductance, constant, inertia, friction, dead_zone, smooth=0.05):  # type: ignore[no-untyped-def]
    i = w = x = 0.0
    speeds, angles, currents, h = np.empty(len(u)), np.empty(len(u)), np.empty(len(u)), dt / STEPS
    for t in range(len(u)):
        speeds[t], angles[t], currents[t] = w, x, i
        volts = np.sign(u[t]) * max(abs(u[t]) - dead_zone, 0.0)
        for _ in range(STEPS):
            i_half = i + 0.5 * h * (volts - resistance * i - constant * w) / inductance
            w_half = w + 0.5 * h * (constant * i - friction * np.tanh(w / smooth)) / inertia
            i += h * (volts - resistance * i_half - constant * w_half) / inductance
            w += h * (constant * i_half - friction * np.tanh(w_half / smooth)) / inertia
            x += h * w_half
    return speeds, angles, currents
