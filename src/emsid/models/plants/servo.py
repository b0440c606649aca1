r"""A servo: the controller of a joint, to which a record gives only target positions.

With the target θ*, the angle θ of the joint and its speed ω, the controller makes at the joint the torque

    T = clip(k_p·(θ* − θ) − k_d·ω, ±T_max),

which it keeps for one of the steps of a sample (`DrivenMotor.steps`), as the digital controller of a servo does.
Behind a gear of n turns the motor has T/n. A record shows every torque in proportion to k_p only, so the scale of all
estimates is that of the gain that is given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isfinite, isnan

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.plants.drive import Feed
from emsid.models.plants.parameters import TINY, Handle, scalar
from emsid.plant import Measure, Motor, Parameter

Array = NDArray[np.float64]

SERVO = ("servo.proportional", "servo.derivative", "servo.limit")
"""The parameters of a servo."""
SERVO_STEPS = 5
"""Steps per sample of a servo: at the usual 5 ms, one of 1 kHz."""
NO_SERVO = np.empty(0)
"""No controller in the loop of one mass."""


@dataclass(frozen=True)
class Servo:
    """The controller of a servo.

    Args:
        proportional: k_p in N·m/rad.
        derivative: k_d in N·m·s/rad.
        limit: T_max in N·m; infinite for none.

    Raises:
        ModelError: for a value that is not physical.
    """

    proportional: float = 1.0
    derivative: float = 0.0
    limit: float = inf

    def __post_init__(self) -> None:
        gains = self.proportional, self.derivative
        if not (all(map(isfinite, gains)) and gains[0] > 0 and gains[1] >= 0):
            raise ModelError(f"servo with gains {gains[0]:g} and {gains[1]:g}; the first must be positive, both finite")
        if isnan(self.limit) or not self.limit > 0:
            raise ModelError(f"servo with a torque limit of {self.limit:g} N·m; it must be positive")

    def numbers(self, ratio: float) -> Array:
        """(4,) gains and limit, and joint turns per turn of the motor, for the loop of one mass."""
        return np.array([self.proportional, self.derivative, self.limit, 1.0 / ratio])

    def linear(self, motor: Motor, gain: float, spring: float, ratio: float) -> tuple[Motor, Feed, float, float]:
        """A motor, its feed, its gain and the torque per angle against it, which move as those that it controls."""
        damped = replace(motor, rotor_viscous=motor.rotor_viscous + self.derivative / ratio**2)
        return damped, Feed.TORQUE, gain * self.proportional / ratio, spring + self.proportional / ratio**2

    def torque(self, target: Array, angle: Array, speed: Array) -> Array:
        """T in N·m at the joint, for targets and angles in rad and speeds in rad/s."""
        wanted = self.proportional * (target - angle) - self.derivative * speed
        return np.clip(wanted, -self.limit, self.limit)


def servo_handles() -> dict[str, Handle]:
    """The handles of the controller of a joint, at the field ``servo`` of a plant."""

    def one(name: str, symbol: str, unit: str, about: str, measure: Measure, lower: float) -> dict[str, Handle]:
        return scalar(("servo", name), Parameter(f"servo.{name}", symbol, unit, about), measure, lower)

    return {
        **one("proportional", "k_p", "N*m/rad", "torque of the servo per error of its position", Measure.OTHER, TINY),
        **one("derivative", "k_d", "N*m*s/rad", "torque of the servo against its speed", Measure.DAMPING, 0.0),
        **one("limit", "T_max", "N*m", "largest torque of the servo", Measure.FORCE, TINY),
    }
