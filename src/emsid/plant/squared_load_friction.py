r"""Friction of a gear with an excess near rest by the square of its load, as of harmonic drives.

`power_friction` with a further term in the brackets of the excess,

    Q = K_eq·τ_e² where |τ_m| > |τ_e|,   K_mq·τ_m² else,   and 0 where both torques turn the same way,

the model M6 of Duclusaud et al. That Q is 0 where both torques turn the same way is how the authors' program has it.

References:
    Duclusaud, Passault, Padois, Ly, *Extended friction models for the physics simulation of servo actuators*,
    arXiv 2410.08650 (2024), model M6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.plant.friction import LawParameter, Level, friction_law
from emsid.plant.load_friction import Pair
from emsid.plant.parameter import Measure
from emsid.plant.power_friction import PowerFriction, by_power

Array = NDArray[np.float64]


@njit(nogil=True, error_model="numpy", inline="always")
def by_power_squared(speed: float, numbers: Array, side: int, motor: float, outside: float) -> float:
    """The torque against the motion for one direction: M6."""
    square = 0.0
    if motor * outside < 0.0:
        driving = abs(motor) > abs(outside)
        square = numbers[side, 8] * outside * outside if driving else numbers[side, 7] * motor * motor
    return float(by_power(speed, numbers, side, motor, outside) + np.exp(-numbers[side, 2] * speed) * square)


@friction_law("load-squared")
@dataclass(frozen=True)
class SquaredLoadFriction(PowerFriction):
    """`PowerFriction` with an excess near rest by the square of the load.

    Args:
        coulomb, stribeck, stribeck_rate, motor, outside, motor_stribeck, outside_stribeck: as in `PowerFriction`.
        motor_squared, outside_squared: K_mq and K_eq in 1/(N·m).

    Raises:
        ModelError: for a value that is negative or not finite.
    """

    motor_squared: Pair = 0.0
    outside_squared: Pair = 0.0

    parameters: ClassVar[tuple[LawParameter, ...]] = (
        *PowerFriction.parameters,
        LawParameter("motor_squared", "K_mq", Measure.PER_FORCE, "excess by the square of the torque of the motor"),
        LawParameter("outside_squared", "K_eq", Measure.PER_FORCE, "excess by the square of the torque from outside"),
    )
    level: ClassVar[Level] = by_power_squared
