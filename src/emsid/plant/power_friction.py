r"""Friction of a gear that drives in another way than it is driven: worm gears and harmonic drives.

With τ_m and τ_e of `load_friction`, the torque of the motor and that from outside have factors of their own,

    T_f(ω) = {K_c + |K_m·τ_m − K_e·τ_e| + exp(−α₂·|ω|)·[K_cs + |K_ms·τ_m − K_es·τ_e|]}·sgn(ω),

the model M5 of Duclusaud et al. with their exponent α = 1 and their speed θ̇_s = 1/α₂. With K_m = K_e and K_ms = K_es it
is `load_friction`.

References:
    Duclusaud, Passault, Padois, Ly, *Extended friction models for the physics simulation of servo actuators*,
    arXiv 2410.08650 (2024), model M5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.plant.friction import Friction, LawParameter, Level, friction_law
from emsid.plant.load_friction import ByLoad, Pair
from emsid.plant.parameter import Measure

Array = NDArray[np.float64]


@njit(nogil=True, error_model="numpy", inline="always")
def by_power(speed: float, numbers: Array, side: int, motor: float, outside: float) -> float:
    """The torque against the motion for one direction: M5."""
    near = np.exp(-numbers[side, 2] * speed)
    level = numbers[side, 0] + abs(numbers[side, 3] * motor - numbers[side, 4] * outside)
    return float(level + near * (numbers[side, 1] + abs(numbers[side, 5] * motor - numbers[side, 6] * outside)))


_FACTORS = (
    LawParameter("motor", "K_m", Measure.FACTOR, "Coulomb level per torque of the motor"),
    LawParameter("outside", "K_e", Measure.FACTOR, "Coulomb level per torque from outside"),
    LawParameter("motor_stribeck", "K_ms", Measure.FACTOR, "Stribeck excess per torque of the motor"),
    LawParameter("outside_stribeck", "K_es", Measure.FACTOR, "Stribeck excess per torque from outside"),
)


@friction_law("load-by-power")
@dataclass(frozen=True)
class PowerFriction(ByLoad):
    """Friction by load that differs where the motor drives the load and where the load drives the motor.

    >>> PowerFriction(0.02, motor=0.1, outside=0.3).breakaway
    (0.02, 0.02)

    Args:
        coulomb, stribeck, stribeck_rate: without load, as in `LoadFriction`.
        motor, outside: K_m and K_e, the level per torque of the motor and from outside.
        motor_stribeck, outside_stribeck: K_ms and K_es, the excess at standstill likewise.

    Raises:
        ModelError: for a value that is negative or not finite.
    """

    motor: Pair = 0.0
    outside: Pair = 0.0
    motor_stribeck: Pair = 0.0
    outside_stribeck: Pair = 0.0

    parameters: ClassVar[tuple[LawParameter, ...]] = (*Friction.parameters, *_FACTORS)
    level: ClassVar[Level] = by_power
