"""The expectation of a static map whose input has noise on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.blocks.static_maps.static_map import StaticMap

Array = NDArray[np.float64]

# Points of the Gauss–Hermite rule, for a smooth map and for one that may have kinks.
SMOOTH_POINTS, POINTS = 5, 15


@dataclass(frozen=True, eq=False)
class ExpectedMap(StaticMap):
    """E f(x + w) for normal w of zero mean: the mean output of a map f whose input x has noise w on it.

    It has the parameters of f and the spread of w, so that a fit of it estimates f. It exists during a fit only, and is
    in no file.

    Args:
        of: f.
        spread: standard deviation of w, in the unit of x.
    """

    of: StaticMap
    spread: float

    kind: ClassVar[str] = "expected"

    def __post_init__(self) -> None:
        for what in ("scaling", "absorbs_shift", "owns_level", "smooth"):
            object.__setattr__(self, what, getattr(self.of, what))

    @property
    def names(self) -> tuple[str, ...]:
        """Those of f, and the spread."""
        return (*self.of.names, "spread")

    @property
    def parameters(self) -> Array:
        """(p + 1,) those of f, and the spread."""
        return np.append(self.of.parameters, self.spread)

    @property
    def anchors(self) -> tuple[int, ...]:
        """Those of f."""
        return self.of.anchors

    @property
    def steepness(self) -> float:
        """That of f."""
        return self.of.steepness

    def with_parameters(self, theta: Array) -> ExpectedMap:
        """The expectation of f with other parameters."""
        return ExpectedMap(self.of.with_parameters(theta[:-1]), float(theta[-1]))

    def value(self, x: Array) -> Array:
        """E f(x + w)."""
        return self._mean(lambda x, point: self.of.value(x), x)

    def slope(self, x: Array) -> Array:
        """E f′(x + w)."""
        return self._mean(lambda x, point: self.of.slope(x), x)

    def parameter_gradient(self, x: Array) -> Array:
        """(p + 1, N) E ∂f/∂θ (x + w), and E f′(x + w)·w/σ, for the spread σ."""

        def rows(x: Array, point: float) -> Array:
            return np.concatenate([self.of.parameter_gradient(x), point * self.of.slope(x)[None]])

        return self._mean(rows, x)

    def scaled(self, input: float, output: float) -> ExpectedMap:
        """The expectation of the scaled map; the noise has the scale of the input."""
        return ExpectedMap(self.of.scaled(input, output), self.spread * abs(input))

    def roughness(self) -> Array | None:
        """That of f, to which the spread adds none."""
        rows = self.of.roughness()
        return None if rows is None else np.pad(rows, ((0, 0), (0, 1)))

    def check(self) -> None:
        """As f does."""
        self.of.check()

    def expression(self, x: str) -> str:
        """The mean of f."""
        return f"mean of {self.of.expression(f'({x} + w)')}"

    def to_data(self) -> dict[str, Any]:
        """Not possible.

        Raises:
            ModelError: always; f can be saved.
        """
        raise ModelError("the expectation of a map is not saved; save the map")

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> ExpectedMap:
        """Not possible, as `to_data`.

        Raises:
            ModelError: always.
        """
        raise ModelError("the expectation of a map is in no file")

    def _mean(self, function: Callable[[Array, float], Array], x: Array) -> Array:
        """The mean of a function of x + w, and of w over its standard deviation."""
        points, weights = _normal_rule(SMOOTH_POINTS if self.of.smooth else POINTS)
        total = weights[0] * function(x + self.spread * points[0], points[0])
        for point, weight in zip(points[1:], weights[1:], strict=True):
            total += weight * function(x + self.spread * point, point)
        return np.asarray(total)


@lru_cache
def _normal_rule(count: int) -> tuple[Array, Array]:
    """Points and weights of the mean over a normal variable of unit variance."""
    points, weights = np.polynomial.hermite_e.hermegauss(count)
    return points, weights / weights.sum()
