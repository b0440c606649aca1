"""The motor of the paper with its shaft, (4.1)–(4.11), integrated by SciPy with friction that is smooth around rest.

It shares no code and no method with `emsid.plant`, which locates where friction sticks and solves the pieces exactly:
here sgn(ω) is tanh(ω/ε), and LSODA chooses its own steps within every sample.
"""

from __future__ import annotations

from math import exp, tanh
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

SMOOTH = 1e-3
"""ε in rad/s."""


def load_speed(values: dict[str, Any], voltage: Array, dt: float) -> Array:
    """(N,) speed of the load in rad/s at the samples, from rest, for a voltage (N,) held over every sample.

    Args:
        values: of `dataclasses.asdict` of a motor whose frictions and dead zone are alike in both directions.
        voltage: in V.
        dt: sample time in s.
    """
    r, l_a, k = (values[name] for name in ("resistance", "inductance", "motor_constant"))
    j_m, j_l = values["rotor_inertia"], values["load_inertia"]
    b_m, b_l = values["rotor_viscous"], values["load_viscous"]
    k_s, b_s, gap = values["shaft_stiffness"], values["shaft_damping"], 0.5 * values["shaft_backlash"]
    zone = values["voltage_dead_zone"]["b_r"]
    rotor, load = ({name: pair[0] for name, pair in values[f"{side}_friction"].items()} for side in ("rotor", "load"))

    def friction(speed: float, law: dict[str, float]) -> float:
        return tanh(speed / SMOOTH) * (law["coulomb"] + law["stribeck"] * exp(-law["stribeck_rate"] * abs(speed)))

    def slope(_: float, x: Array, armature: float) -> list[float]:
        current, motor, turned, twist = x
        pressed = twist - min(max(twist, -gap), gap)
        shaft = k_s * pressed + (b_s * (motor - turned) if pressed or not gap else 0.0)
        return [
            (armature - r * current - k * motor) / l_a,
            (k * current - shaft - b_m * motor - friction(motor, rotor)) / j_m,
            (shaft - b_l * turned - friction(turned, load)) / j_l,
            motor - turned,
        ]

    state, speeds = np.zeros(4), np.empty(len(voltage))
    for t, u in enumerate(voltage):
        speeds[t] = state[2]
        through = np.sign(u) * max(abs(u) - zone, 0.0)
        piece = solve_ivp(slope, (0.0, dt), state, "LSODA", t_eval=[dt], args=(through,), rtol=1e-8, atol=1e-9)
        state = piece.y[:, -1]
    return speeds
