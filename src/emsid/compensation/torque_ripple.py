r"""The inverse of a brushless motor's torque over its angle: what cancels cogging and the ripple by current.

The motor (`emsid.models.plants.brushless`) moves its load with the torque

    T_w = T·(1 + T_r(θ)) − T_c(θ),        T = 3/2·p·(ψ + (L_d − L_q)·i_d)·i_q.

A torque T_w that is wanted therefore needs T = (T_w + T_c(θ))/(1 + T_r(θ)) of the currents, and with i_d the q-current
i_q = T/(3/2·p·(ψ + (L_d − L_q)·i_d)). The estimates are compensated, not the ends of their intervals: cancelling too
much leaves as much as cancelling too little.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]

LARGEST = 0.9
"""A ripple by current that is larger takes nearly all torque away at some angle, and is no result to compensate."""


@dataclass(frozen=True, eq=False)
class RippleCompensation:
    """The inverse of a torque over the angle; `emsid.compensate` makes it of a brushless motor.

    Attributes:
        name: of the model.
        constant: torque per q-current without d-current, 3/2·p·ψ, in N·m/A.
        reluctance: torque per product of both currents, 3/2·p·(L_d − L_q), in N·m/A².
        cogging: (n, 3) periods per turn, cosine and sine in N·m.
        ripple: (n, 3) the same of the torque by current, as parts of it.
    """

    name: str
    constant: float
    reluctance: float
    cogging: Array
    ripple: Array

    @classmethod
    def of(cls, model: Any) -> Self:
        """That of a model of a brushless motor.

        Raises:
            ModelError: for one without harmonics, or with a ripple as large as its torque.
        """
        plant = model.plant
        if not (plant.cogging or plant.torque_ripple):
            raise ModelError(
                f"{model.name} has neither cogging nor ripple of its torque; identify it from a log with the angle, of "
                "a turn at least"
            )
        cogging, ripple = (
            np.array([tuple(each) for each in some], dtype=float).reshape(-1, 3)
            for some in (plant.cogging, plant.torque_ripple)
        )
        turn = 1.5 * plant.pole_pairs
        found = cls(
            model.name, turn * plant.flux, turn * (plant.inductance_d - plant.inductance_q), cogging, ripple
        )  # fmt: skip
        if float(np.max(np.abs(found.part(np.linspace(0, 2 * np.pi, 3600))))) > LARGEST:
            raise ModelError(f"{model.name}: the ripple by current is as large as the torque, which has no inverse")
        if not found.constant > 0:
            raise ModelError(f"{model.name} has no flux linkage of magnets, so that no q-current has a known torque")
        return found

    def cogging_torque(self, angle: ArrayLike) -> Array:
        """T_c in N·m, which acts against the motion, at angles of the shaft in rad, of any shape."""
        return _sum(self.cogging, angle)

    def part(self, angle: ArrayLike) -> Array:
        """T_r, the ripple of the torque by current as a part of it, at angles of the shaft in rad."""
        return _sum(self.ripple, angle)

    def torque(self, wanted: ArrayLike, angle: ArrayLike) -> Array:
        """The torque of the currents in N·m that moves the load with the torque that is wanted."""
        return np.asarray((np.asarray(wanted, dtype=float) + self.cogging_torque(angle)) / (1.0 + self.part(angle)))

    def current(self, wanted: ArrayLike, angle: ArrayLike, d_current: ArrayLike = 0.0) -> Array:
        """The q-current in A for the torque that is wanted, with a d-current in A."""
        per = self.constant + self.reluctance * np.asarray(d_current, dtype=float)
        return np.asarray(self.torque(wanted, angle) / per)

    def table(self, points: int) -> Array:
        """(points, 4) of equal parts of a turn: angle in rad in their middle, T_c in N·m, 1/(1 + T_r), and i_q in A.

        The q-current cancels cogging; that of a controller is multiplied by the third column and added.
        """
        angle = (np.arange(points) + 0.5) * 2 * np.pi / points
        factor = 1.0 / (1.0 + self.part(angle))
        return np.column_stack([angle, self.cogging_torque(angle), factor, self.current(0.0, angle)])


def _sum(harmonics: Array, angle: ArrayLike) -> Array:
    at = np.asarray(angle, dtype=float)
    total = np.zeros(at.shape)
    for number, cosine, sine in harmonics.tolist():
        total = total + cosine * np.cos(number * at) + sine * np.sin(number * at)
    return total
