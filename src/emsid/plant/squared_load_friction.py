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
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.plant.friction import Friction, FrictionLaw, LawParameter, Level, friction_law
from emsid.plant.parameter import Measure
from emsid.plant.power_friction import PowerFriction

Array = NDArray[np.float64]
Pair = float | tuple[float, float]


@njit(nogil=True, error_model="numpy", inline="always")
def by_power_squared(speed: float, numbers: Array, side: int, motor: float, outside: float) -> float:
    """The torque against the motion for one direction: M6."""
    square = 0.0
    if motor * outside < 0.0:
        driving = abs(motor) > abs(outside)
        square = numbers[side, 8] * outside * outside if driving else numbers[side, 7] * motor * motor
    near = np.exp(-numbers[side, 2] * speed)
    level = numbers[side, 0] + abs(numbers[side, 3] * motor - numbers[side, 4] * outside)
    more = numbers[side, 1] + abs(numbers[side, 5] * motor - numbers[side, 6] * outside)
    return float(level + near * (more + square))


@friction_law("load-squared")
@dataclass(frozen=True)
class SquaredLoadFriction(FrictionLaw):
    """`PowerFriction` with an excess near rest by the square of the load.

    Args:
        coulomb, stribeck, stribeck_rate, motor, outside, motor_stribeck, outside_stribeck: as in `PowerFriction`.
        motor_squared, outside_squared: K_mq and K_eq in 1/(N·m).

    Raises:
        ModelError: for a value that is negative or not finite.
    """

    coulomb: Pair = 0.0
    stribeck: Pair = 0.0
    stribeck_rate: Pair = 0.0
    motor: Pair = 0.0
    outside: Pair = 0.0
    motor_stribeck: Pair = 0.0
    outside_stribeck: Pair = 0.0
    motor_squared: Pair = 0.0
    outside_squared: Pair = 0.0

    parameters: ClassVar[tuple[LawParameter, ...]] = (
        *PowerFriction.parameters,
        LawParameter("motor_squared", "K_mq", Measure.PER_FORCE, "excess by the square of the torque of the motor"),
        LawParameter("outside_squared", "K_eq", Measure.PER_FORCE, "excess by the square of the torque from outside"),
    )
    level: ClassVar[Level] = by_power_squared

    @cached_property
    def varies(self) -> NDArray[np.bool_]:
        """(2,) whether it differs from a Coulomb level, by direction."""
        return np.asarray((np.delete(self.numbers, [0, 2], axis=1) > 0).any(axis=1))

    @property
    def reach(self) -> float:
        """That of the same law without load."""
        return Friction(self.coulomb, self.stribeck, self.stribeck_rate).reach
