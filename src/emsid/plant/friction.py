"""Friction of a sliding body, one pure function per law.

The torque that friction takes from a body turning at ω is, with sgn(0) = 0 (4.8),

    T_f(ω) = [α₀ + α₁·exp(−α₂·|ω|)]·sgn(ω)                                (4.7)

a Coulomb level α₀ and a Stribeck excess α₁ that fades with speed at the rate α₂. At ω = 0 the law is a set,
not a number: friction balances any torque up to the break-away level α₀ + α₁. The laws below give the sliding value;
the set is what `emsid.plant.simulation` makes of `Friction.breakaway`. All of them work on arrays of any shape.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]


def sign(speed: ArrayLike) -> Array:
    """sgn(ω) (4.8): 1 forward, −1 backward, 0 at rest."""
    return np.asarray(np.sign(np.asarray(speed, dtype=float)))


def coulomb(speed: ArrayLike, level: ArrayLike) -> Array:
    """α₀·sgn(ω): the first part of (4.7), in N·m.

    Args:
        speed: ω in rad/s.
        level: α₀ in N·m.
    """
    return np.asarray(level, dtype=float) * sign(speed)


def stribeck(speed: ArrayLike, excess: ArrayLike, rate: ArrayLike) -> Array:
    """α₁·exp(−α₂·|ω|)·sgn(ω): the second part of (4.7), in N·m.

    Args:
        speed: ω in rad/s.
        excess: α₁ in N·m, what the torque at standstill has beyond the Coulomb level.
        rate: α₂ in s/rad; 1/α₂ is the speed at which the excess has fallen to 37 %.
    """
    w = np.asarray(speed, dtype=float)
    fading: Array = np.exp(-np.asarray(rate, dtype=float) * np.abs(w))
    return np.asarray(excess, dtype=float) * fading * sign(w)


def viscous(speed: ArrayLike, coefficient: ArrayLike) -> Array:
    """B·ω: the viscous part, which (4.4) and (4.5) keep apart from (4.7), in N·m.

    Args:
        speed: ω in rad/s.
        coefficient: B in N·m·s/rad.
    """
    torque: Array = np.asarray(coefficient, dtype=float) * np.asarray(speed, dtype=float)
    return torque


class Sliding(NamedTuple):
    """The three numbers of (4.7) in one direction of motion: α₀ and α₁ in N·m, α₂ in s/rad."""

    coulomb: float
    stribeck: float
    stribeck_rate: float


@dataclass(frozen=True)
class Friction:
    """Coulomb and Stribeck friction (4.7), with levels that may differ by direction.

    >>> Friction(0.02, stribeck=(0.01, 0.015), stribeck_rate=0.5).breakaway
    (0.03, 0.035)

    Args:
        coulomb: Coulomb level α₀ in N·m; one number for both directions or a pair (forward, backward).
        stribeck: Stribeck excess α₁ in N·m at standstill; a number or a pair.
        stribeck_rate: Stribeck rate α₂ in s/rad; a number or a pair.

    Raises:
        ModelError: for a value that is negative or not finite.
    """

    coulomb: float | tuple[float, float] = 0.0
    stribeck: float | tuple[float, float] = 0.0
    stribeck_rate: float | tuple[float, float] = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, _pair(field.name, getattr(self, field.name)))

    @property
    def forward(self) -> Sliding:
        """The numbers that hold for ω > 0."""
        return self._sliding(0)

    @property
    def backward(self) -> Sliding:
        """The numbers that hold for ω < 0."""
        return self._sliding(1)

    @property
    def breakaway(self) -> tuple[float, float]:
        """α₀ + α₁ (forward, backward) in N·m: the net torque a body at rest holds against."""
        forward, backward = self.forward, self.backward
        return forward.coulomb + forward.stribeck, backward.coulomb + backward.stribeck

    def torque(self, speed: ArrayLike) -> Array:
        """T_f(ω) (4.7) in N·m while sliding at ``speed`` in rad/s, of any shape; 0 at ω = 0."""
        w = np.asarray(speed, dtype=float)
        level, excess, rate = (
            np.where(w < 0, backward, forward) for forward, backward in zip(self.forward, self.backward, strict=True)
        )
        return coulomb(w, level) + stribeck(w, excess, rate)

    def _sliding(self, direction: int) -> Sliding:
        return Sliding(*(getattr(self, field.name)[direction] for field in fields(self)))


def _pair(name: str, value: object) -> tuple[float, float]:
    """A number for both directions, or (forward, backward), as two checked numbers."""
    pair = tuple(value) if isinstance(value, (tuple, list)) else (value, value)
    if len(pair) != 2 or not all(isinstance(v, (int, float, np.number)) for v in pair):
        raise ModelError(f"friction {name} is {value!r}; give a number or a pair (forward, backward)")
    forward, backward = (float(v) for v in pair)
    if not (isfinite(forward) and isfinite(backward) and min(forward, backward) >= 0):
        raise ModelError(f"friction {name} is {value!r}; it cannot be negative and must be finite")
    return forward, backward
