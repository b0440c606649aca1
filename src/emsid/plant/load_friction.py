r"""Friction that grows with the load of a gear, and near rest.

With the torque τ_m of the motor and τ_e from outside (gravity, a constant load), both in the direction of positive
motion, a gear transmits a load in proportion to τ_m − τ_e, and

    T_f(ω) = {K_c + K_l·|τ_m − τ_e| + exp(−α₂·|ω|)·[K_cs + K_ls·|τ_m − τ_e|]}·sgn(ω).

These are the models M1 (all but K_c zero), M2 (K_l = K_ls = 0), M3 (K_cs = K_ls = 0) and M4 of Duclusaud et al. with
their exponent α = 1 and their speed θ̇_s = 1/α₂, where K_c is the Coulomb level α₀ and K_cs the Stribeck excess α₁ of
(4.7). Their viscous friction K_v is that of the plant. At rest friction balances any net torque τ_m + τ_e up to the
level at ω = 0: where |τ_m − τ_e| grows with the load faster than the net torque does, a gear locks itself.

References:
    Duclusaud, Passault, Padois, Ly, *Extended friction models for the physics simulation of servo actuators*,
    arXiv 2410.08650 (2024), models M1 to M4.
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

Array = NDArray[np.float64]
Pair = float | tuple[float, float]


@njit(nogil=True, error_model="numpy", inline="always")
def with_load(speed: float, numbers: Array, side: int, motor: float, outside: float) -> float:
    """The torque against the motion for one direction, from the torques of the motor and from outside."""
    load = abs(motor - outside)
    near = np.exp(-numbers[side, 2] * speed)
    return float(numbers[side, 0] + numbers[side, 3] * load + near * (numbers[side, 1] + numbers[side, 4] * load))


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
