r"""Friction of a gear that grows with its load, and near rest.

With the torque τ_m of the motor and τ_e from outside (gravity, a constant load), both in the direction of positive
motion, a gear transmits a load in proportion to τ_m − τ_e, and

    T_f(ω) = {K_c + K_l·|τ_m − τ_e| + exp(−α₂·|ω|)·[K_cs + K_ls·|τ_m − τ_e|]}·sgn(ω).

These are the models M1 (all but K_c zero), M2 (K_l = K_ls = 0), M3 (K_cs = K_ls = 0) and M4 of Duclusaud et al. with
their exponent α = 1 and their speed θ̇_s = 1/α₂, where K_c is the Coulomb level α₀ and K_cs the Stribeck excess α₁ of
(4.7). Their viscous friction K_v is that of the plant. At rest friction balances any net torque τ_m + τ_e up to the
level at ω = 0: where |τ_m − τ_e| grows with the load faster than the net torque does, a gear locks itself.

Worm gears and harmonic drives drive in another way than they are driven: both torques have factors of their own,

    T_f(ω) = {K_c + |K_m·τ_m − K_e·τ_e| + exp(−α₂·|ω|)·[K_cs + |K_ms·τ_m − K_es·τ_e| + Q]}·sgn(ω),
    Q = K_eq·τ_e² where |τ_m| > |τ_e|,   K_mq·τ_m² else,   and 0 where both torques turn the same way.

With Q = 0 this is the model M5, and with it M6; that Q is 0 where both torques turn the same way is how the authors'
program has it. With K_m = K_e, K_ms = K_es and Q = 0 it is the law above.

References:
    Duclusaud, Passault, Padois, Ly, *Extended friction models for the physics simulation of servo actuators*,
    arXiv 2410.08650 (2024), models M1 to M6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.plant.friction import FRICTION_LAWS, Friction, FrictionLaw, LawParameter, Level, friction_law
from emsid.plant.parameter import Measure

Array = NDArray[np.float64]
Pair = float | tuple[float, float]


@njit(nogil=True, error_model="numpy", inline="always")
def with_load(speed: float, numbers: Array, side: int, motor: float, outside: float) -> float:
    """The torque against the motion for one direction, from the torques of the motor and from outside."""
    load = abs(motor - outside)
    near = np.exp(-numbers[side, 2] * speed)
    return float(numbers[side, 0] + numbers[side, 3] * load + near * (numbers[side, 1] + numbers[side, 4] * load))


@njit(nogil=True, error_model="numpy", inline="always")
def either_torque(speed: float, numbers: Array, side: int, motor: float, outside: float) -> float:
    """The same with factors for either torque."""
    near = abs(numbers[side, 5] * motor - numbers[side, 6] * outside)
    if motor * outside < 0.0:
        driving = abs(motor) > abs(outside)
        near += numbers[side, 8] * outside * outside if driving else numbers[side, 7] * motor * motor
    level = numbers[side, 0] + abs(numbers[side, 3] * motor - numbers[side, 4] * outside)
    return float(level + np.exp(-numbers[side, 2] * speed) * (numbers[side, 1] + near))


@dataclass(frozen=True)
class ByLoad(FrictionLaw):
    """What laws by load have in common: they begin with the numbers of (4.7), and end with factors of the load."""

    coulomb: Pair = 0.0
    stribeck: Pair = 0.0
    stribeck_rate: Pair = 0.0

    @cached_property
    def varies(self) -> NDArray[np.bool_]:
        """(2,) whether it differs from a Coulomb level, by direction."""
        return np.asarray((np.delete(self.numbers, [0, 2], axis=1) > 0).any(axis=1))

    @property
    def reach(self) -> float:
        """That of the same law without load."""
        return Friction(self.coulomb, self.stribeck, self.stribeck_rate).reach


@friction_law("load-dependent")
@dataclass(frozen=True)
class LoadFriction(ByLoad):
    """Coulomb and Stribeck friction that grow with the load of a gear.

    >>> LoadFriction(0.02, load=0.1).breakaway
    (0.02, 0.02)

    Args:
        coulomb: level K_c without load in N·m (N for an axis); one number, or a pair (forward, backward).
        stribeck: excess K_cs at standstill without load, likewise.
        stribeck_rate: α₂ in s/rad (s/m), likewise.
        load: K_l, the level per load.
        load_stribeck: K_ls, the excess at standstill per load.

    Raises:
        ModelError: for a value that is negative or not finite.
    """

    load: Pair = 0.0
    load_stribeck: Pair = 0.0

    parameters: ClassVar[tuple[LawParameter, ...]] = (
        *Friction.parameters,
        LawParameter("load", "K_l", Measure.FACTOR, "Coulomb level per load of the gear"),
        LawParameter("load_stribeck", "K_ls", Measure.FACTOR, "Stribeck excess at standstill per load of the gear"),
    )
    level: ClassVar[Level] = with_load


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
        motor_squared, outside_squared: K_mq and K_eq, the excess by the square of the torque, in 1/(N·m).

    Raises:
        ModelError: for a value that is negative or not finite.
    """

    motor: Pair = 0.0
    outside: Pair = 0.0
    motor_stribeck: Pair = 0.0
    outside_stribeck: Pair = 0.0
    motor_squared: Pair = 0.0
    outside_squared: Pair = 0.0

    parameters: ClassVar[tuple[LawParameter, ...]] = (
        *Friction.parameters,
        LawParameter("motor", "K_m", Measure.FACTOR, "Coulomb level per torque of the motor"),
        LawParameter("outside", "K_e", Measure.FACTOR, "Coulomb level per torque from outside"),
        LawParameter("motor_stribeck", "K_ms", Measure.FACTOR, "Stribeck excess per torque of the motor"),
        LawParameter("outside_stribeck", "K_es", Measure.FACTOR, "Stribeck excess per torque from outside"),
        LawParameter("motor_squared", "K_mq", Measure.PER_FORCE, "excess by the square of the torque of the motor"),
        LawParameter("outside_squared", "K_eq", Measure.PER_FORCE, "excess by the square of the torque from outside"),
    )
    level: ClassVar[Level] = either_torque


FRICTION_LAWS["load-squared"] = PowerFriction
"""The name in files that were written when this was a separate law."""
