r"""Splines of a known shape: odd ones, f(−x) = −f(x), and monotone ones, f′ > 0 everywhere or f′ < 0 everywhere.

A shape that a map is known to have halves its parameters or keeps it invertible, and it holds where data are rare.

**Odd.** A natural cubic spline through (±knotₖ, ±valueₖ) and the origin is odd; its parameters are the values at the
positive knots.

**Monotone.** The slope is a straight line between knots, with exp sₖ at knot k, and constant beyond the outer ones; so
it is positive for all values of the parameters. The map is its integral, a parabola between knots,

    f(x) = v ± Σₖ exp(sₖ) Hₖ(x),      Hₖ the integral of the hat function at knot k from the first knot.

The penalty is on the change of s, ∫s′(x)² dx, which a straight line does not have.

References:
    Ramsay, *Monotone regression splines in action*, Statistical Science 3 (1988). Eilers, Marx, *Flexible smoothing
    with B-splines and penalties*, Statistical Science 11 (1996).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.findings import Finding
from emsid.models.blocks.static_maps.static_map import Pieces, StaticMap, closest, inverse_with_straight_ends
from emsid.models.blocks.static_maps.through_points import CubicSpline, ThroughPoints, spread_knots, with_middles
from emsid.models.terms import vector

Array = NDArray[np.float64]

# The least slope of a monotone map at its start, relative to its mean slope.
LEAST_SLOPE = 0.02


@dataclass(frozen=True, eq=False)
class OddSpline(ThroughPoints):
    """The natural cubic spline through the origin, the points (knotₖ, valueₖ) and their mirror images.

    >>> OddSpline([1.0, 2.0], [1.0, 1.5]).value(np.array([-2.0, 0.0, 1.0]))
    array([-1.5,  0. ,  1. ])

    Args:
        knots: (K,) ascending, above zero.
        values: (K,) f at the knots.

    Raises:
        ModelError: for knots that do not ascend from zero, or another number of values.
    """

    kind: ClassVar[str] = "odd-spline"
    owns_level: ClassVar[bool] = False
    absorbs_shift: ClassVar[bool] = False
    sizes: ClassVar[tuple[int, ...]] = (10, 20)
    smooth: ClassVar[bool] = True
    word: ClassVar[str] = "odd_spline"
    fewest: ClassVar[int] = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.knots[0] <= 0:
            raise ModelError(f"{self.kind}: the knots must ascend from above zero")

    @cached_property
    def whole(self) -> CubicSpline:
        """The same map as a spline on both sides."""
        both = [np.concatenate([-each[::-1], [0.0], each]) for each in (self.knots, self.values)]
        return CubicSpline(*both)

    @property
    def anchors(self) -> tuple[int, ...]:
        """The largest value."""
        return (int(np.argmax(np.abs(self.values))),)

    @property
    def steepness(self) -> float:
        """The mean slope up to the last knot."""
        return float(self.values[-1] / self.knots[-1])

    def with_parameters(self, theta: Array) -> Self:
        """The map with other values; what depends on the knots alone is kept."""
        new = replace(self, values=theta)
        new.whole.__dict__["curvatures"] = self.whole.curvatures
        return new

    def value(self, x: Array) -> Array:
        """f(x)."""
        return self.whole.value(x)

    def slope(self, x: Array) -> Array:
        """f′(x)."""
        return self.whole.slope(x)

    def parameter_gradient(self, x: Array) -> Array:
        """(K, N) the cardinal splines of a knot minus those of its mirror image."""
        return self._odd(self.whole.parameter_gradient(x))

    def roughness(self) -> Array:
        """(2K − 1, K) that of the spline on both sides."""
        return np.ascontiguousarray(self._odd(self.whole.roughness().T).T)

    def pieces(self) -> Pieces:
        """Those of the spline on both sides."""
        return self.whole.pieces()

    def inverse(self, z: ArrayLike) -> Array:
        """x with f(x) = z, if the spline is monotone."""
        return self.whole.inverse(z)

    def scaled(self, input: float, output: float) -> Self:
        """Knots times \\|input\\|, values times output; a mirrored input changes the sign of the values."""
        return replace(self, knots=self.knots * abs(input), values=self.values * output * np.sign(input))

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> OddSpline:
        """A map with ``size`` knots on either side, placed by `spread_knots`."""
        knots = spread_knots(np.concatenate([-x, x]), 2 * size + 1)[size + 1 :]
        return closest(cls(knots, np.zeros(size)), x, z)

    def with_more_knots(self) -> OddSpline:
        """The same curve with another knot in the middle between each two, and before the first."""
        knots = with_middles(np.append(0.0, self.knots))[1:]
        return OddSpline(knots, self.value(knots))

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """Those of the spline on both sides, for the data and their mirror image."""
        return self.whole.findings(np.concatenate([-x, x]))

    def meaning(self, name: str) -> str:
        """The knot of this value."""
        return f"value at {self.knots[self.names.index(name)]:.4g}, and minus it at the mirror image"

    def marks(self) -> tuple[Array, str]:
        """The knots on both sides."""
        return self.whole.knots, "knots"

    def _odd(self, rows: Array) -> Array:
        """Rows (2K + 1, N) by value on both sides as rows (K, N) by value on the positive one."""
        count = len(self.knots)
        return np.asarray(rows[count + 1 :] - rows[:count][::-1])


@dataclass(frozen=True, eq=False)
class MonotoneSpline(StaticMap):
    """A map that only rises, or only falls: its slope is ± exp sₖ at knot k and a straight line between knots.

    >>> MonotoneSpline([0.0, 1.0], 0.5, [0.0, 0.0]).value(np.array([-1.0, 0.0, 2.0]))
    array([-0.5,  0.5,  2.5])

    Args:
        knots: (K,) ascending, at least two.
        first: v, the value at the first knot.
        logarithms: (K,) s, of the slope at the knots.
        falling: whether the slope is negative.

    Raises:
        ModelError: for knots that do not ascend, or another number of slopes.
    """

    knots: Array
    first: float
    logarithms: Array
    falling: bool = False

    kind: ClassVar[str] = "monotone-spline"
    owns_level: ClassVar[bool] = True
    sizes: ClassVar[tuple[int, ...]] = (20, 40)
    smooth: ClassVar[bool] = True
    tried: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for field in ("knots", "logarithms"):
            object.__setattr__(self, field, vector(getattr(self, field), f"{self.kind} {field}"))
        if len(self.knots) != len(self.logarithms) or len(self.knots) < 2:
            raise ModelError(
                f"{self.kind}: {len(self.knots)} knots and {len(self.logarithms)} slopes; give as many, at least two"
            )
        if np.any(np.diff(self.knots) <= 0) or not np.isfinite(self.first):
            raise ModelError(f"{self.kind}: the knots must ascend, and the first value be finite")

    @property
    def names(self) -> tuple[str, ...]:
        """f1, the value at the first knot, and s1, s2, …, logarithms of the slopes."""
        return ("f1", *(f"s{k + 1}" for k in range(len(self.knots))))

    @property
    def parameters(self) -> Array:
        """(K + 1,) the first value, then the logarithms of the slopes."""
        return np.concatenate([[self.first], self.logarithms])

    @property
    def anchors(self) -> tuple[int, ...]:
        """The first value and the largest slope."""
        return (0, 1 + int(np.argmax(self.logarithms)))

    @property
    def steepness(self) -> float:
        """The mean slope between the outer knots."""
        ends = self.value(self.knots[[0, -1]])
        return float((ends[1] - ends[0]) / (self.knots[-1] - self.knots[0]))

    @property
    def size(self) -> int:
        """The number of knots."""
        return len(self.knots)

    def with_parameters(self, theta: Array) -> Self:
        """The map with another first value and other slopes."""
        return replace(self, first=float(theta[0]), logarithms=theta[1:])

    def value(self, x: Array) -> Array:
        """f(x)."""
        at = np.asarray(x, dtype=float)
        piece, ahead, slopes = self._located(at)
        h = np.diff(self.knots)
        areas = np.concatenate([[0.0], np.cumsum(0.5 * h * (slopes[1:] + slopes[:-1]))])
        within = np.clip(ahead, 0.0, h[piece])
        bend = 0.5 * (slopes[piece + 1] - slopes[piece]) / h[piece]
        beyond = (ahead - within) * np.where(ahead < 0, slopes[0], slopes[-1])
        return np.asarray(self.first + areas[piece] + within * (slopes[piece] + bend * within) + beyond)

    def slope(self, x: Array) -> Array:
        """f′(x)."""
        return np.asarray(np.interp(x, self.knots, self._slopes))

    def parameter_gradient(self, x: Array) -> Array:
        """(K + 1, N) one, and the slope at each knot times the integral of its hat function."""
        h = np.diff(self.knots)
        rows = np.ones((len(self.knots) + 1, len(x)))
        for k, slope in enumerate(self._slopes):
            row = np.zeros(len(x))
            if k:
                part = np.clip((x - self.knots[k - 1]) / h[k - 1], 0.0, 1.0)
                row += 0.5 * h[k - 1] * part**2
            else:
                row += np.minimum(x - self.knots[0], 0.0)
            if k < len(h):
                part = np.clip((x - self.knots[k]) / h[k], 0.0, 1.0)
                row += h[k] * (part - 0.5 * part**2)
            else:
                row += np.maximum(x - self.knots[-1], 0.0)
            rows[k + 1] = slope * row
        return rows

    def roughness(self) -> Array:
        """(K − 1, K + 1) R with ‖Rθ‖² = ∫s′(x)² dx, zero for a straight line."""
        rows = np.diff(np.eye(len(self.knots)), axis=0) / np.sqrt(np.diff(self.knots))[:, None]
        return np.pad(rows, ((0, 0), (1, 0)))

    def pieces(self) -> Pieces:
        """A parabola between each two knots, and a line at either end."""
        slopes, values = self._slopes, self.value(self.knots)
        bends = np.diff(slopes) / np.diff(self.knots) / 2
        rows = np.column_stack([values[:-1], slopes[:-1], bends])
        ends = np.array([[values[0], slopes[0], 0.0], [values[-1], slopes[-1], 0.0]])
        edges, origins = np.append(-np.inf, self.knots), np.append(self.knots[0], self.knots)
        return Pieces(edges, origins, np.vstack([ends[:1], rows, ends[1:]]))

    def inverse(self, z: ArrayLike) -> Array:
        """x with f(x) = z, which always exists."""
        return inverse_with_straight_ends(self, self.knots, z)

    def scaled(self, input: float, output: float) -> Self:
        """Knots times input, slopes times output/input, the first value times output."""
        turned = slice(None) if input > 0 else slice(None, None, -1)
        first = self.first if input > 0 else float(self.value(self.knots[-1:])[0])
        return replace(
            self,
            knots=(self.knots * input)[turned],
            first=first * output,
            logarithms=(self.logarithms + np.log(abs(output / input)))[turned],
            falling=self.falling ^ (output * input < 0),
        )

    def expression(self, x: str) -> str:
        """The value at the first knot, then every knot with the slope there."""
        pairs = ", ".join(f"({k:.6g}, {s:.6g})" for k, s in zip(self.knots, self._slopes, strict=True))
        return f"monotone_spline({x}; {self.first:.6g}, {pairs})"

    def summary(self, x: str) -> str:
        """The number of knots."""
        way = "falling" if self.falling else "rising"
        span = f"from {self.knots[0]:.4g} to {self.knots[-1]:.4g}"
        return f"{way} monotone_spline({x}; {len(self.knots)} knots {span}, see the table)"

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> MonotoneSpline:
        """The slopes of the closest spline, as far as they have the sign of its mean slope."""
        spline = CubicSpline.started(x, z, size)
        falling = spline.steepness < 0
        least = LEAST_SLOPE * max(abs(spline.steepness), 1e-300)
        slopes = np.maximum(spline.slope(spline.knots) * (-1 if falling else 1), least)
        return cls(spline.knots, float(spline.values[0]), np.log(slopes), falling)

    def with_more_knots(self) -> MonotoneSpline:
        """The same curve with another knot in the middle between each two."""
        knots = with_middles(self.knots)
        return replace(self, knots=knots, logarithms=np.log(np.abs(self.slope(knots))))

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """Knots without data around them, and a map that is straight over the data."""
        return CubicSpline(self.knots, self.value(self.knots)).findings(x)

    def meaning(self, name: str) -> str:
        """The knot of this value or slope."""
        if name == "f1":
            return f"value at {self.knots[0]:.4g}"
        return f"logarithm of the slope at {self.knots[int(name[1:]) - 1]:.4g}"

    def marks(self) -> tuple[Array, str]:
        """The knots."""
        return self.knots, "knots"

    def to_data(self) -> dict[str, Any]:
        """Knots, first value and logarithms of the slopes."""
        return {
            "kind": self.kind,
            "knots": self.knots.tolist(),
            "first": self.first,
            "logarithms": self.logarithms.tolist(),
            "falling": self.falling,
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The map described by `to_data`."""
        return cls(data["knots"], float(data["first"]), data["logarithms"], bool(data["falling"]))

    @property
    def _slopes(self) -> Array:
        """(K,) slopes at the knots."""
        return np.asarray((-1.0 if self.falling else 1.0) * np.exp(self.logarithms))

    def _located(self, x: Array) -> tuple[NDArray[np.intp], Array, Array]:
        """The piece of every x, the distance from its left knot, and the slopes at the knots."""
        piece = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.knots) - 2)
        return piece, x - self.knots[piece], self._slopes
