"""How the general motor, with shaft or inductance, is simulated: its steps, its first state, and when it is rigid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.plant import Motor, Taylor

Array = NDArray[np.float64]

LONG_STEPS = Taylor(order=20, most_steps=200)
"""Sample times are long compared with electrical time constants and resonances; a high order needs fewer steps.

A motor that needs more steps is refused, so that a search stays clear of it.
"""
SHORT_STEPS = Taylor(order=8, tolerance=1e-6)
"""In single precision, in which terms of order 20 overflow: through stops and reversals the free run of motors is then
within 4·10⁻⁶ of its deviation, measured."""
STIFFEST = 60.0
"""The fastest motion of a shaft in radians per sample; a stiffer or more damped shaft is simulated as rigid."""


def in_steady_state(motor: Motor, volts: Array, speed: float, angle: float) -> Array:
    """(5,) the state of a motor that turns at a speed with the current of a constant voltage (1,)."""
    across = volts[0] if motor.voltage_dead_zone is None else motor.voltage_dead_zone(volts)[0]
    return np.array([(across - motor.motor_constant * speed) / motor.resistance, speed, speed, 0.0, angle])


def without_shaft(names: Sequence[str]) -> list[str]:
    """Those of the names that one mass without inductance has; none where no name is of a shaft."""
    if not any(name.startswith("shaft_") for name in names):
        return []
    left = [name for name in names if not name.startswith("shaft_") and name != "inductance"]
    if "rotor_inertia" in left and "load_inertia" in left:  # one mass has only their sum
        left.remove("load_inertia")
    return left


def is_stiff(motor: Motor, dt: float) -> bool:
    """Whether a shaft is too stiff to be simulated over pieces of ``dt``; it is then rigid."""
    return not motor.is_rigid and not motor.shaft_backlash and _fastest(motor) * dt > STIFFEST


def _fastest(motor: Motor) -> float:
    """How fast rotor and load come together, in rad/s: their resonance without damping, or the damping alone."""
    share = 1 / motor.rotor_inertia + 1 / motor.load_inertia
    return max(float(np.sqrt(motor.shaft_stiffness * share)), motor.shaft_damping * share)
