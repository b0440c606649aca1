r"""Maps that lose the sign of their input, f(−x) = f(x): |x|, and an even spline.

A pulse counter without direction, or a rectifier, shows magnitudes only. Real ones round the kink and are not straight.
The even spline is a natural cubic spline s of |x|. It has a kink at zero, or none where s begins with a slope of zero.
The penalty on ∫s″(x)² dx leaves c + k|x|, so |x| is its smooth limit. Both sides of zero share its values, so it has
half as many unknowns as a spline over both, and holds where one side was hardly visited.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.findings import Finding
from emsid.models.blocks.static_maps.static_map import NumberedMap, Pieces, Scaling, StaticMap, closest
from emsid.models.blocks.static_maps.through_points import CubicSpline, ThroughPoints, spread_knots

Array = NDArray[np.float64]

NO_INVERSE = "a map that loses the sign has no inverse"


@dataclass(frozen=True, eq=False)
class Abs(NumberedMap):
    """f(x) = |x|: a sensor that loses the sign."""

    kind: ClassVar[str] = "abs"
    letters: ClassVar[tuple[str, ...]] = ()
    slope_letter: ClassVar[str] = ""
    sizes: ClassVar[tuple[int, ...]] = (0, 10)
    loses_sign: ClassVar[bool] = True
    scaling: ClassVar[Scaling] = Scaling.JOINT
    absorbs_shift: ClassVar[bool] = False

    def value(self, x: Array) -> Array:
        """|x|."""
        value: Array = np.abs(x)
        return value

    def slope(self, x: Array) -> Array:
        """sgn(x)."""
        slope: Array = np.sign(x)
        return slope

    def pieces(self) -> Pieces:
        """Two lines."""
        return Pieces.lines([0.0], [-1.0, 1.0], 0.0)

    def parameter_gradient(self, x: Array) -> Array:
        """(0, N)."""
        return np.zeros((0, len(x)))

    def inverse(self, z: ArrayLike) -> Array:
        """Not available: the sign is lost.

        Raises:
            ModelError: always.
        """
        raise ModelError(NO_INVERSE)

    def scaled(self, input: float, output: float) -> Abs:
        """The map itself, if output = |input|."""
        if not np.isclose(output, abs(input)):
            raise ModelError("|x| can take a factor in only where it gives the same factor out")
        return self

    def expression(self, x: str) -> str:
        """abs(x)."""
        return f"abs({x})"

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> StaticMap:
        """|x|, or an even spline with ``size`` knots, because real sensors round the kink and are not straight."""
        return EvenSpline.started(x, z, size) if size else cls()

    @classmethod
    def trials(cls, x: Array) -> tuple[StaticMap, ...]:
        """|x| itself."""
        return (cls(),)

    def breaks(self, low: float, high: float) -> Array:
        """The kink at zero."""
        return _around_zero(low, high)


@dataclass(frozen=True, eq=False)
class EvenSpline(ThroughPoints):
    """The natural cubic spline of |x| through the points (knotₖ, valueₖ), which loses the sign.

    >>> EvenSpline([0.0, 1.0, 2.0], [0.0, 1.0, 2.0]).value(np.array([-1.5, 0.0, 1.0]))
    array([1.5, 0. , 1. ])

    Args:
        knots: (K,) ascending from zero or above.
        values: (K,) f at the knots.

    Raises:
        ModelError: for knots that do not ascend from zero or above, or another number of values.
    """

    kind: ClassVar[str] = "even-spline"
    absorbs_shift: ClassVar[bool] = False
    loses_sign: ClassVar[bool] = True
    sizes: ClassVar[tuple[int, ...]] = (10, 20)
    smooth: ClassVar[bool] = True
    word: ClassVar[str] = "even_spline"
    of_knots: ClassVar[tuple[str, ...]] = ("curvatures",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.knots[0] < 0:
            raise ModelError(f"{self.kind}: the knots must ascend from zero or above")

    @cached_property
    def curvatures(self) -> Array:
        """(K, K) those of `half`."""
        return CubicSpline(self.knots, self.values).curvatures

    @cached_property
    def half(self) -> CubicSpline:
        """The spline s of |x|."""
        spline = CubicSpline(self.knots, self.values)
        spline.__dict__["curvatures"] = self.curvatures
        return spline

    def value(self, x: Array) -> Array:
        """s(|x|)."""
        return self.half.value(np.abs(x))

    def slope(self, x: Array) -> Array:
        """sgn(x) s′(|x|)."""
        return np.asarray(np.sign(x) * self.half.slope(np.abs(x)))

    def parameter_gradient(self, x: Array) -> Array:
        """(K, N) the cardinal splines at |x|."""
        return self.half.parameter_gradient(np.abs(x))

    def roughness(self) -> Array:
        """(K − 2, K) that of `half`."""
        return self.half.roughness()

    def pieces(self) -> Pieces:
        """Those of `half` from zero on, and their mirror images."""
        edges, origins, coefficients, *_ = self.half.pieces()
        starts = np.append(0.0, edges[1:])
        mirrored = coefficients * np.array([1.0, -1.0, 1.0, -1.0])
        return Pieces(
            np.concatenate([[-np.inf], -starts[:0:-1], starts]),
            np.concatenate([-origins[::-1], origins]),
            np.vstack([mirrored[::-1], coefficients]),
        )

    def inverse(self, z: ArrayLike) -> Array:
        """Not available: the sign is lost.

        Raises:
            ModelError: always.
        """
        raise ModelError(NO_INVERSE)

    def scaled(self, input: float, output: float) -> Self:
        """Knots times \\|input\\|, values times output."""
        return replace(self, knots=self.knots * abs(input), values=self.values * output)

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> EvenSpline:
        """A map with ``size`` knots, placed by `spread_knots`."""
        return closest(cls(spread_knots(np.abs(x), size), np.zeros(size)), x, z)

    @classmethod
    def trials(cls, x: Array) -> tuple[StaticMap, ...]:
        """|x|, from which it begins."""
        return (Abs(),)

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """Knots without data around them."""
        return tuple(finding for finding in self.half.findings(np.abs(x)) if finding.code != "map-is-straight")

    def meaning(self, name: str) -> str:
        """The knot of this value."""
        return f"value at {self.knots[self.names.index(name)]:.4g} and at its mirror image"

    def marks(self) -> tuple[Array, str]:
        """The knots on both sides."""
        return np.unique(np.concatenate([-self.knots, self.knots])), "knots"

    def breaks(self, low: float, high: float) -> Array:
        """The kink at zero."""
        return _around_zero(low, high)


def _around_zero(low: float, high: float) -> Array:
    """Zero and inputs next to it, if it is between ``low`` and ``high``."""
    tiny = 1e-9 * (high - low)
    return np.array([-tiny, 0.0, tiny]) if low < 0 < high else np.zeros(0)
