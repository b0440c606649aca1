"""Friction whose excess near rest fades as a Gaussian of the speed, as lubricated bearings and gears often have it.

    T_f(ω) = [α₀ + α₁·exp(−(α₂·ω)²)]·sgn(ω)

Near rest it is flat, where that of (4.7) falls steepest. As in (4.7), 1/α₂ is the speed at which the excess has fallen
to 37 %.

References:
    Armstrong-Hélouvry, Dupont, Canudas de Wit, *A survey of models, analysis tools and compensation methods for the
    control of machines with friction*, Automatica 30 (1994), on the exponent of the Stribeck curve, 1 or 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.plant.friction import Friction, FrictionLaw, LawParameter, Level, friction_law

Array = NDArray[np.float64]


@njit(nogil=True, error_model="numpy", inline="always")
def gaussian_excess(speed: float, numbers: Array, side: int) -> float:
    """α₀ + α₁·exp(−(α₂·ω)²) for one direction."""
    part = numbers[side, 2] * speed
    return float(numbers[side, 0] + numbers[side, 1] * np.exp(-part * part))


@friction_law("gaussian-stribeck")
@dataclass(frozen=True)
class GaussianStribeck(FrictionLaw):
    """Coulomb friction with an excess near rest that fades as a Gaussian.

    >>> GaussianStribeck(0.02, stribeck=0.01, stribeck_rate=0.5).breakaway
    (0.03, 0.03)

    Args:
        coulomb: Coulomb level α₀ in N·m (N for an axis); one number for both directions or a pair (forward, backward).
        stribeck: the excess α₁ at standstill, likewise.
        stribeck_rate: α₂ in s/rad (s/m), likewise.

    Raises:
        ModelError: for a value that is negative or not finite.
    """

    coulomb: float | tuple[float, float] = 0.0
    stribeck: float | tuple[float, float] = 0.0
    stribeck_rate: float | tuple[float, float] = 0.0

    parameters: ClassVar[tuple[LawParameter, ...]] = Friction.parameters
    level: ClassVar[Level] = gaussian_excess

    @cached_property
    def varies(self) -> NDArray[np.bool_]:
        """(2,) whether there is an excess, by direction."""
        return np.asarray(np.array(self.stribeck) > 0)

    @property
    def reach(self) -> float:
        """Three times the speed at which the slowest excess has fallen to 37 %; 10 rad/s without one."""
        rates = [rate for excess, rate in self.numbers[:, 1:] if excess > 0]
        slowest = min(rates, default=0.0)
        return float(3 / slowest) if slowest > 0 else 10.0
