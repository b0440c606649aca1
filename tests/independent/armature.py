"""A motor with inductance as one mass, by small steps of the midpoint rule, with friction that is smooth around rest.

L·di/dt = D(u) − R·i − K·ω,      J·dω/dt = K·i − T·tanh(ω/ε)
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEPS = 400
"""Steps in every sample."""


@numba.njit(cache=True)
def speed(u, dt, resistance, inductance, constant, inertia, friction, dead_zone, smooth=0.05):  # type: ignore[no-untyped-def]
    """(N,) speed at the samples, from rest without current, for a voltage (N,) held over every sample."""
    i = w = 0.0
    speeds, h = np.empty(len(u)), dt / STEPS
    for t in range(len(u)):
        speeds[t] = w
        volts = np.sign(u[t]) * max(abs(u[t]) - dead_zone, 0.0)
        for _ in range(STEPS):
            i_half = i + 0.5 * h * (volts - resistance * i - constant * w) / inductance
            w_half = w + 0.5 * h * (constant * i - friction * np.tanh(w / smooth)) / inertia
            i += h * (volts - resistance * i_half - constant * w_half) / inductance
            w += h * (constant * i_half - friction * np.tanh(w_half / smooth)) / inertia
    return speeds
