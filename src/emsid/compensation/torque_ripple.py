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
from emsid.models.plants.brushless import Harmonic, over_angle

Array = NDArray[np.float64]

LARGEST = 0.9
"""A ripple by current that takes more of the torque away at some angle needs more than ten times the current there."""


@dataclass(frozen=True, eq=False)
class RippleCompensation:
    """The inverse of a torque over the angle; `emsid.compensate` makes it of a brushless motor.

    Attributes:
        name: of the model.
        constant: torque per q-current without d-current, 3/2·p·ψ, in N·m/A.
        reluctance: torque per product of both currents, 3/2·p·(L_d − L_q), in N·m/A².
        cogging: its harmonics in N·m.
        ripple: those of the torque by current, as parts of it.
    """

    name: str
    constant: float
    reluctance: float
    cogging: tuple[Harmonic, ...]
    ripple: tuple[Harmonic, ...]

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
        turn = 1.5 * plant.pole_pairs
        reluctance = turn * (plant.inductance_d - plant.inductance_q)
        found = cls(model.name, turn * plant.flux, reluctance, plant.cogging, plant.torque_ripple)
        if float(np.min(found.part(np.linspace(0, 2 * np.pi, 3600)))) < -LARGEST:
            raise ModelError(f"{model.name}: the ripple by current is as large as the torque, which has no inverse")
        if not found.constant > 0:
            raise ModelError(f"{model.name} has no flux linkage of magnets, so that no q-current has a known torque")
        return found

    def cogging_torque(self, angle: ArrayLike) -> Array:
        """T_c in N·m, which acts against the motion, at angles of the shaft in rad, of any shape."""
        return over_angle(self.cogging, np.asarray(angle, dtype=float))

    def part(self, angle: ArrayLike) -> Array:
        """T_r, the ripple of the torque by current as a part of it, at angles of the shaft in rad."""
        return over_angle(self.ripple, np.asarray(angle, dtype=float))

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
