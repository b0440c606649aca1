"""The hyperbolic tangent: a saturation with rounded corners, and friction that is Coulomb's above a small speed.

Of the two numbers of the map, one is the slope at zero and the other the limit. A spline that has to show the same bend
needs several points on either side of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.findings import Finding
from emsid.models.blocks.static_maps.laws import Mask, seldom, unseen_limits
from emsid.models.blocks.static_maps.numbered_map import NumberedMap
from emsid.models.blocks.static_maps.static_map import Pieces, combination

Array = NDArray[np.float64]

# Inputs at which the bend may be, relative to the root mean square of the input, that a start is chosen from.
BENDS = np.geomspace(0.05, 5.0, 25)


@dataclass(frozen=True, eq=False)
class HyperbolicTangent(NumberedMap):
    """f(x) = c·tanh(m·x/c).

    >>> HyperbolicTangent(1.0, 2.0).value(np.array([-100.0, 0.0, 100.0]))
    array([-2.,  0.,  2.])

    Args:
        slope_at_zero: m.
        limit: c > 0, of the magnitude of the output.
    """

    slope_at_zero: float = 1.0
    limit: float = 1.0

    kind: ClassVar[str] = "tanh"
    letters: ClassVar[tuple[str, ...]] = ("m", "c")
    slope_letter: ClassVar[str] = "m"
    meanings: ClassVar[Mapping[str, str]] = {"m": "slope at zero", "c": "limit on either side"}
    absorbs_shift: ClassVar[bool] = False

    def value(self, x: Array) -> Array:
        """c·tanh(m·x/c)."""
        return np.asarray(self.limit * self._tangent(x))

    def slope(self, x: Array) -> Array:
        """m·(1 − tanh²)."""
        return np.asarray(self.slope_at_zero * (1 - self._tangent(x) ** 2))

    def pieces(self) -> Pieces:
        """No line, and a sign of this width."""
        m = self.slope_at_zero
        nothing = Pieces.lines([0.0], [0.0, 0.0], 0.0)
        return nothing._replace(jump=self.limit * float(np.sign(m)), width=self.limit / abs(m)) if m else nothing

    def parameter_gradient(self, x: Array) -> Array:
        """x·(1 − tanh²) for the slope at zero; tanh − m·x/c·(1 − tanh²) for the limit."""
        tangent = self._tangent(x)
        rest = x * (1 - tangent**2)
        return np.stack([rest, tangent - self.slope_at_zero / self.limit * rest])

    def inverse(self, z: ArrayLike) -> Array:
        """c/m·artanh(z/c), for \\|z\\| < c."""
        target = np.asarray(z, dtype=float)
        if self.slope_at_zero == 0 or np.any(np.abs(target) >= self.limit):
            raise ModelError(f"a hyperbolic tangent is inverted only between its limits ±{self.limit:g}")
        return np.asarray(self.limit / self.slope_at_zero * np.arctanh(target / self.limit))

    def scaled(self, input: float, output: float) -> HyperbolicTangent:
        """Slope times output/input, limit times \\|output\\|."""
        return HyperbolicTangent(self.slope_at_zero * output / input, self.limit * abs(output))

    def expression(self, x: str) -> str:
        """c·tanh(…)."""
        return f"{self.limit:.6g}*tanh({self.slope_at_zero / self.limit:.6g}*{x})"

    def check(self) -> None:
        """Refuse a limit that is not positive."""
        if not self.limit > 0:
            raise Infeasible(f"hyperbolic tangent with the limit {self.limit:.6g}; it must be positive")

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> HyperbolicTangent:
        """The best of several widths of the bend, with the best limit for it."""
        found = []
        for width in (BENDS * (float(np.sqrt(np.mean(x**2))) or 1.0)).tolist():
            rows = np.stack([np.tanh(x / width), np.ones_like(x)])
            height, level = combination(rows, z).tolist()
            found.append((float(np.sum((np.array([height, level]) @ rows - z) ** 2)), width, height))
        _, width, height = min(found, key=itemgetter(0))
        return cls(height / width, abs(height)) if height else cls()

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """A finding for a limit that the signal rarely comes near."""
        return unseen_limits(*self._near_limits(x))

    def bends_over(self, x: Array) -> bool:
        """Whether enough inputs are near one of the limits."""
        return not all(map(seldom, self._near_limits(x)))

    def marks(self) -> tuple[Array, str]:
        """Where the tangent at zero meets the limits."""
        if not self.slope_at_zero:
            return np.zeros(0), ""
        width = self.limit / abs(self.slope_at_zero)
        return np.array([-width, width]), "limits"

    def _tangent(self, x: Array) -> Array:
        return np.asarray(np.tanh(self.slope_at_zero / self.limit * np.asarray(x, dtype=float)))

    def _near_limits(self, x: Array) -> tuple[Mask, Mask]:
        """Whether the tangent at zero is beyond the lower and the upper limit."""
        linear = self.slope_at_zero * x
        return linear <= -self.limit, linear >= self.limit
