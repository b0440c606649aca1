"""The inverse of the static map of a cascade, over the values that the map takes.

A map that is strictly monotone between two inputs has an inverse there. A dead zone is flat about zero; its inverse
jumps and gives the middle of the zone for the output 0. A map that turns back has no inverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]

JUMP = 1e-9
"""Half the width, of the range of outputs, of a jump of the inverse in a table."""


@dataclass(frozen=True, eq=False)
class MapInverse:
    """The inverse of a static map; `emsid.compensate` makes it of a cascade.

    Attributes:
        name: of the model.
        map: the static map.
        reach: the largest output of a table of it.
    """

    name: str
    map: Any
    reach: float = 1.0

    @classmethod
    def of(cls, cascade: Any, reach: float | None = None) -> Self:
        """The inverse of the one static map of a cascade.

        Args:
            cascade: the model.
            reach: the largest output of the map that is wanted; by default that at ten times the corner of the map.

        Raises:
            ModelError: for a cascade with another number of maps, or a map without an inverse.
        """
        maps = [block for block in cascade.blocks if hasattr(block, "kind") and hasattr(block, "inverse")]
        if len(maps) != 1:
            raise ModelError(f"{cascade.name} has {len(maps)} static maps; an inverse is made of exactly one")
        ends = _ends(maps[0])
        values = np.abs(maps[0].value(ends))
        found = cls(cascade.name, maps[0], float(values.max()) if reach is None else reach)
        found(maps[0].value(ends))
        return found

    def __call__(self, wanted: ArrayLike) -> Array:
        """The input of the map for its wanted output, of any shape.

        Raises:
            ModelError: outside the range in which the map has an inverse.
        """
        return np.asarray(self.map.inverse(wanted))

    def table(self, points: int) -> tuple[Array, Array, float]:
        """Outputs of the map (rising), the inputs for them, and the error of straight lines between.

        Where the inverse jumps at 0, as that of a dead zone does, two points stand on either side of the jump.
        """
        low, high = sorted(self.map.value(_ends(self.map)).tolist())
        outputs = np.linspace(low, high, points)
        if low < 0 < high:
            near = JUMP * (high - low)
            outputs = np.unique(np.concatenate([outputs[np.abs(outputs) > near], [-near, near]]))
        inputs = self(outputs)
        middles = 0.5 * (outputs[1:] + outputs[:-1])
        apart = np.diff(outputs) > 4 * JUMP * (high - low)
        error = np.abs(self(middles) - 0.5 * (inputs[1:] + inputs[:-1]))[apart]
        return outputs, inputs, float(np.max(error, initial=0.0))


def _ends(function: Any) -> Array:
    """Two inputs between which the table of a map lies: those that it was fitted between, or ten corners."""
    knots = getattr(function, "knots", None)
    if knots is not None:
        return np.array([knots[0], knots[-1]], dtype=float)
    if hasattr(function, "low") and hasattr(function, "high") and not hasattr(function, "slope_between"):
        return np.array([function.low, function.high], dtype=float)
    corners = [abs(float(getattr(function, name))) for name in ("b_l", "b_r", "b", "width") if hasattr(function, name)]
    if hasattr(function, "slope_between"):  # a saturation: up to its limits
        return np.array([function.low, function.high], dtype=float) / float(function.slope_between)
    size = 10.0 * max([*corners, 0.1])
    return np.array([-size, size])
