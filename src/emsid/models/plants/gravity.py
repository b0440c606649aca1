r"""Gravity on a joint: the torque of an arm that hangs, and the inertia of a known weight on it.

With the angle θ of the joint, measured from anywhere, and the angle θ₀ at which the arm hangs, gravity turns against

    T_g(θ) = (T_a + m·g·l)·sin(θ − θ₀),          J = J_a + m·l²,

where T_a and J_a are those of the arm itself, and m a weight at the distance l that is known, and that may differ by
record. Behind a gear of n turns of the motor per turn of the joint the motor turns by n·θ against T_g/n, and the weight
adds m·l²/n² to its inertia. T_g is a wave with one period per turn, so it moves the mass as cogging does (`one_mass`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import atan2, cos, hypot, inf, isfinite, pi, sin

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.estimates import Estimate
from emsid.findings import Finding
from emsid.models.plants.parameters import TINY, Handle, scalar
from emsid.plant import Measure, Parameter

Array = NDArray[np.float64]

STANDARD = 9.80665
"""Standard acceleration of free fall in m/s² (BIPM, SI brochure)."""
CONSTANTS = ("gravity.acceleration", "gravity.period")
"""Constants, which are not estimated unless they are asked for."""
STRENGTH = frozenset({"resistance", "motor_constant", "servo.proportional"})
"""Parameters that give the torque of a motor its size: beside one of them, only the ratio of gravity to it is known."""
SEEN = 2.448
"""Standard errors of a torque with an unknown angle, below which it may be zero: two normal numbers, its cosine and its
sine, have this length in 5 % of all cases (the root of χ² with two degrees of freedom)."""


@dataclass(frozen=True)
class Gravity:
    """The torque of gravity over the angle of a joint.

    Args:
        torque: T_a of the arm at horizontal in N·m, without the known weight.
        angle: θ₀ in rad, at which the arm hangs.
        mass: m of a known weight in kg.
        length: l in m, its distance from the axis.
        acceleration: g in m/s²; less for an axis that is not horizontal.
        period: one turn, in units of the angle.

    Raises:
        ModelError: for a value that is not finite, a torque, weight or length that is negative, or a period that is not
            positive.
    """

    torque: float = 0.0
    angle: float = 0.0
    mass: float = 0.0
    length: float = 0.0
    acceleration: float = STANDARD
    period: float = 2 * pi

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not isfinite(value) or (value < 0 and each.name != "angle") or (value == 0 and each.name == "period"):
                raise ModelError(f"gravity with {each.name} {value}; it must be finite and cannot be negative")

    @property
    def whole(self) -> float:
        """T_a + m·g·l in N·m."""
        return self.torque + self.mass * self.acceleration * self.length

    @property
    def inertia(self) -> float:
        """m·l² in kg·m²."""
        return self.mass * self.length**2

    def per_unit(self, ratio: float) -> float:
        """The phase in rad per unit of the angle of the motor."""
        return 2 * pi / (self.period * ratio)

    def wave(self, ratio: float) -> Array:
        """(n, 3) phase per unit of the angle of the motor, cosine and sine of the torque against it; n is 0 or 1."""
        phase, torque = 2 * pi * self.angle / self.period, self.whole / ratio
        rows = [(self.per_unit(ratio), -torque * sin(phase), torque * cos(phase))] if torque else []
        return np.array(rows).reshape(-1, 3)

    def against(self, position: float, ratio: float) -> float:
        """The torque in N·m against the motor at an angle of it."""
        return self.whole / ratio * sin(self.per_unit(ratio) * position - 2 * pi * self.angle / self.period)

    def of_wave(self, cosine: float, sine: float, ratio: float) -> dict[str, float]:
        """Torque and angle, by the names of `gravity_handles`, whose wave has these amplitudes against the motor."""
        torque = abs(ratio) * hypot(cosine, sine) - self.mass * self.acceleration * self.length
        side = 1.0 if ratio > 0 else -1.0
        angle = self.period / (2 * pi) * atan2(-side * cosine, side * sine)
        return {"gravity.torque": max(torque, 0.0), "gravity.angle": angle}

    def unseen(self, rows: Sequence[Estimate], groups: Sequence[Sequence[str]], span: float) -> list[Finding]:
        """The finding that records do not show the torque of the arm; see `Plant.unseen`."""
        name = "gravity.torque"
        row = next((each for each in rows if each.name == name and each.asked), None)
        if row is None or self.whole > self.torque:
            return []
        error, (low, high) = row.standard_error, row.interval or (0.0, inf)
        beside = {other for group in groups if name in group for other in group}
        if error is None and not (row.value == low == 0.0 or (beside and STRENGTH.isdisjoint(beside))):
            return []
        if error is not None and row.value > SEEN * error:
            return []
        data = {"moved": 360.0 * span / self.period, "most": high if isfinite(high) else None, "unit": row.unit}
        return [Finding("gravity-not-seen", name, data)]


def gravity_handles() -> dict[str, Handle]:
    """The handles of the gravity of a joint, at the field ``gravity`` of a plant."""
    found: dict[str, Handle] = {}
    for name, symbol, unit, description, measure, lower in (
        ("torque", "T_a", "N*m", "gravity torque of the arm at horizontal", Measure.FORCE, 0.0),
        ("angle", "θ₀", "rad", "angle at which the arm hangs", Measure.OTHER, -inf),
        ("mass", "m", "kg", "known weight on the arm", Measure.OTHER, 0.0),
        ("length", "l", "m", "distance of the weight from the axis", Measure.OTHER, 0.0),
        ("acceleration", "g", "m/s^2", "acceleration of free fall", Measure.OTHER, 0.0),
        ("period", "P_g", "rad", "one turn in units of the angle", Measure.OTHER, TINY),
    ):
        parameter = Parameter(f"gravity.{name}", symbol, unit, description)
        found |= scalar(("gravity", name), parameter, measure, lower)
    return found
