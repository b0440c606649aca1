"""Maps with few parameters: dead zone, two slopes, saturation, Coulomb friction, absolute value, hyperbolic tangent.

**The hyperbolic tangent** is a saturation with rounded corners, and friction that is Coulomb's above a small speed. Of
its two numbers, one is the slope at zero and the other the limit. A spline that has to show the same bend needs several
points on either side of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.findings import Finding
from emsid.models.blocks.static_maps.static_map import (
    NumberedMap,
    Pieces,
    closest,
    combination,
    monotone_inverse,
    numbers_of,
)
from emsid.models.terms import sum_of_terms

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Points of a curve that give the start values of a map.
POINTS = 2_000
# Quantiles on either side that are tried as edges of a dead zone.
EDGES = 16
# Below this fraction of the samples, or with fewer of them, a side of a map is not reliably determined.
SELDOM, FEW = 0.002, 5


@dataclass(frozen=True, eq=False)
class DeadZone(NumberedMap):
    """The dead zone (4.9): m_r(x − b_r) above b_r, m_l(x − b_l) below b_l, zero between.

    >>> DeadZone(-0.2, 0.3, 1.0, 2.0).value(np.array([-1.2, 0.0, 1.3]))
    array([-1.,  0.,  2.])

    Args:
        b_l, b_r: its left and right edge, in the unit of the input, b_l ≤ b_r.
        m_l, m_r: slope to the left and to the right.
    """

    b_l: float = 0.0
    b_r: float = 0.0
    m_l: float = 1.0
    m_r: float = 1.0

    kind: ClassVar[str] = "dead-zone"
    letters: ClassVar[tuple[str, ...]] = ("b_l", "b_r", "m_l", "m_r")
    ends: ClassVar[tuple[str, ...]] = ("b_l", "b_r")
    slope_letter: ClassVar[str] = "m_r"
    tried: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "b_l": "left end of the zone",
        "b_r": "right end of the zone",
        "m_l": "slope on the left",
        "m_r": "slope on the right",
    }

    def value(self, x: Array) -> Array:
        """(4.9)."""
        value: Array = self.m_r * np.maximum(x - self.b_r, 0) + self.m_l * np.minimum(x - self.b_l, 0)
        return value

    def slope(self, x: Array) -> Array:
        """m_r, 0 or m_l."""
        return self.m_r * (x > self.b_r) + self.m_l * (x < self.b_l)

    def pieces(self) -> Pieces:
        """Three lines."""
        return Pieces.lines([self.b_l, self.b_r], [self.m_l, 0.0, self.m_r], 0.0)

    def parameter_gradient(self, x: Array) -> Array:
        """−m outside the zone for the edges, the distance to the edge for the slopes."""
        right, left = (x > self.b_r).astype(float), (x < self.b_l).astype(float)
        return np.stack([-self.m_l * left, -self.m_r * right, left * (x - self.b_l), right * (x - self.b_r)])

    def inverse(self, z: ArrayLike) -> Array:
        """z/m_r + b_r for positive z, z/m_l + b_l for negative z, and the middle of the zone for zero."""
        target = np.asarray(z, dtype=float)
        if not min(self.m_l, self.m_r) > 0:
            raise ModelError("a dead zone has an inverse only where both its slopes are positive")
        middle = 0.5 * (self.b_l + self.b_r)
        above, below = target / self.m_r + self.b_r, target / self.m_l + self.b_l
        return np.where(target == 0, middle, np.where(target > 0, above, below))

    def scaled(self, input: float, output: float) -> DeadZone:
        """Edges times ``input``, slopes times output/input; a mirrored input swaps left and right."""
        sides = [(self.b_l * input, self.m_l * output / input), (self.b_r * input, self.m_r * output / input)]
        (b_l, m_l), (b_r, m_r) = sides if input > 0 else sides[::-1]
        return DeadZone(b_l, b_r, m_l, m_r)

    def expression(self, x: str) -> str:
        """Two hinges."""
        return sum_of_terms([(self.m_r, f"max({x}{-self.b_r:+.6g}, 0)"), (self.m_l, f"min({x}{-self.b_l:+.6g}, 0)")])

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> DeadZone:
        """The best edges among quantiles of x, with the best slopes for them."""
        step = max(1, len(x) // POINTS)
        x, z = x[::step], z[::step]
        grid = np.quantile(x, np.linspace(0.02, 0.98, EDGES))
        sides = np.stack([np.minimum(x - grid[:, None], 0), np.maximum(x - grid[:, None], 0)])
        sides, z = sides - sides.mean(axis=2, keepdims=True), z - z.mean()
        # Least squares for all pairs of edges i, j at once: [a c; c b] [m_l; m_r] = [p; q].
        a, b = (np.sum(side**2, axis=1) for side in sides)
        c, (p, q) = sides[0] @ sides[1].T, sides @ z
        determinant = np.outer(a, b) - c**2
        known = np.triu(determinant > 1e-9 * np.outer(a, b))
        inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=known)
        m_l, m_r = inverse * (np.outer(p, b) - c * q), inverse * (a[:, None] * q - c * p[:, None])
        saved = np.where(known & (m_l * m_r > 0), m_l * p[:, None] + m_r * q, -np.inf)
        i, j = np.unravel_index(np.argmax(saved), saved.shape)
        if not np.isfinite(saved[i, j]):
            return cls(float(grid[0]), float(grid[-1]))
        return cls(float(grid[i]), float(grid[j]), float(m_l[i, j]), float(m_r[i, j]))

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """A finding for a side, or a zone, with too few samples."""
        sides = (
            ("left", ["b_l", "m_l"], x < self.b_l),
            ("right", ["b_r", "m_r"], x > self.b_r),
        )
        unseen = tuple(
            Finding("dead-zone-side-unseen", data={"side": side, "parameters": names, "share": float(np.mean(there))})
            for side, names, there in sides
            if seldom(there)
        )
        inside = (x > self.b_l) & (x < self.b_r)
        share = float(np.mean(inside))
        return unseen or ((Finding("dead-zone-unseen", data={"share": share}),) if seldom(inside) else ())

    def bends_over(self, x: Array) -> bool:
        """Whether enough inputs are in two of its three parts."""
        left, right = x < self.b_l, x > self.b_r
        return sum(not seldom(there) for there in (left, ~(left | right), right)) > 1

    def marks(self) -> tuple[Array, str]:
        """The ends of the zone."""
        return np.array([self.b_l, self.b_r]), "break points"


@dataclass(frozen=True, eq=False)
class TwoSlopes(NumberedMap):
    """m_r(x − b) above the corner b and m_l(x − b) below it, as of a drive that is stronger in one direction.

    A dead zone without a zone is the same, but at the bound of its family, where no search settles.

    >>> TwoSlopes(0.5, 1.0, 2.0).value(np.array([-0.5, 0.5, 1.5]))
    array([-1.,  0.,  2.])

    Args:
        b: the corner, in the unit of the input.
        m_l, m_r: slope to the left and to the right.
    """

    b: float = 0.0
    m_l: float = 1.0
    m_r: float = 1.0

    kind: ClassVar[str] = "two-slopes"
    letters: ClassVar[tuple[str, ...]] = ("b", "m_l", "m_r")
    slope_letter: ClassVar[str] = "m_r"
    tried: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {"b": "corner", "m_l": "slope on the left", "m_r": "slope on the right"}

    def value(self, x: Array) -> Array:
        """Two lines that meet at b."""
        value: Array = self.slope(x) * (x - self.b)
        return value

    def slope(self, x: Array) -> Array:
        """m_r or m_l."""
        return np.where(x > self.b, self.m_r, self.m_l)

    def pieces(self) -> Pieces:
        """Two lines."""
        return Pieces.lines([self.b], [self.m_l, self.m_r], 0.0)

    def parameter_gradient(self, x: Array) -> Array:
        """−m for the corner, the distance to it for the slopes."""
        return np.stack([-self.slope(x), np.minimum(x - self.b, 0), np.maximum(x - self.b, 0)])

    def inverse(self, z: ArrayLike) -> Array:
        """z/m + b, with the slope of the side that z is on."""
        target = np.asarray(z, dtype=float)
        if not self.m_l * self.m_r > 0:
            raise ModelError("two slopes have an inverse only where both are positive, or both negative")
        slope = np.where(target * self.m_r > 0, self.m_r, self.m_l)
        return np.asarray(target / slope + self.b)

    def scaled(self, input: float, output: float) -> TwoSlopes:
        """The corner times ``input``, slopes times output/input; a mirrored input swaps left and right."""
        m_l, m_r = (self.m_l, self.m_r) if input > 0 else (self.m_r, self.m_l)
        return TwoSlopes(self.b * input, m_l * output / input, m_r * output / input)

    def expression(self, x: str) -> str:
        """Two hinges."""
        moved = f"{x}{-self.b:+.6g}"
        return sum_of_terms([(self.m_r, f"max({moved}, 0)"), (self.m_l, f"min({moved}, 0)")])

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> TwoSlopes:
        """The best corner among quantiles of x, with the best slopes for it."""
        step = max(1, len(x) // POINTS)
        x, z = x[::step], z[::step]
        found = []
        for corner in np.quantile(x, np.linspace(0.02, 0.98, EDGES)).tolist():
            rows = np.stack([np.minimum(x - corner, 0), np.maximum(x - corner, 0), np.ones_like(x)])
            m_l, m_r, level = combination(rows, z).tolist()
            found.append((float(np.sum((np.array([m_l, m_r, level]) @ rows - z) ** 2)), cls(corner, m_l, m_r)))
        return min(found, key=itemgetter(0))[1]

    def bends_over(self, x: Array) -> bool:
        """Whether enough inputs are on both sides of the corner."""
        return not (seldom(x < self.b) or seldom(x > self.b))

    def marks(self) -> tuple[Array, str]:
        """The corner."""
        return np.array([self.b]), "break points"


@dataclass(frozen=True, eq=False)
class Saturation(NumberedMap):
    """f(x) = min(max(m·x, low), high).

    Args:
        slope_between: m, between the limits.
        low, high: limits of the output; they need not enclose zero, so that a shift of the input can be represented.
    """

    slope_between: float = 1.0
    low: float = -1.0
    high: float = 1.0

    kind: ClassVar[str] = "saturation"
    letters: ClassVar[tuple[str, ...]] = ("m", "low", "high")
    ends: ClassVar[tuple[str, ...]] = ("low", "high")
    slope_letter: ClassVar[str] = "m"
    tried: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {"m": "slope", "low": "lower limit", "high": "upper limit"}

    def value(self, x: Array) -> Array:
        """m·x, limited."""
        value: Array = np.clip(self.slope_between * x, self.low, self.high)
        return value

    def slope(self, x: Array) -> Array:
        """m between the limits, zero at them."""
        return self.slope_between * self._between(x)

    def pieces(self) -> Pieces:
        """Three lines, or one where the slope is zero."""
        m = self.slope_between
        if not m:
            return Pieces.lines([0.0], [0.0, 0.0], float(np.clip(0.0, self.low, self.high)))
        first, last = (self.low, self.high) if m > 0 else (self.high, self.low)
        return Pieces.lines([first / m, last / m], [0.0, m, 0.0], first)

    def parameter_gradient(self, x: Array) -> Array:
        """x between the limits; one at an active limit."""
        linear = self.slope_between * x
        return np.stack([x * self._between(x), (linear <= self.low).astype(float), (linear >= self.high).astype(float)])

    def inverse(self, z: ArrayLike) -> Array:
        """z/m, for z between the limits."""
        target = np.asarray(z, dtype=float)
        if self.slope_between == 0 or np.any((target < self.low) | (target > self.high)):
            raise ModelError(f"a saturation is inverted only between its limits {self.low:g} and {self.high:g}")
        return target / self.slope_between

    def scaled(self, input: float, output: float) -> Saturation:
        """Slope times output/input, limits times ``output``."""
        ends = sorted((self.low * output, self.high * output))
        return Saturation(self.slope_between * output / input, *ends)

    def expression(self, x: str) -> str:
        """min(max(…))."""
        return f"min(max({self.slope_between:.6g}*{x}, {self.low:.6g}), {self.high:.6g})"

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> Saturation:
        """The slope of the middle half, with limits inside the extremes of the curve."""
        low, high = np.quantile(x, [0.25, 0.75])
        middle = (x >= low) & (x <= high)
        slope, level = combination(np.stack([x[middle], np.ones(int(middle.sum()))]), z[middle])
        floor, ceiling = np.quantile(z - level, [0.02, 0.98])
        return cls(float(slope), float(floor), float(ceiling))

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """A finding for a limit that the signal rarely reaches."""
        return unseen_limits(*self._at_limits(x))

    def bends_over(self, x: Array) -> bool:
        """Whether enough inputs are at one of the limits."""
        return not all(map(seldom, self._at_limits(x)))

    def marks(self) -> tuple[Array, str]:
        """The inputs at which the limits begin."""
        if not self.slope_between:
            return np.zeros(0), ""
        return np.sort(np.array([self.low, self.high]) / self.slope_between), "limits"

    def _at_limits(self, x: Array) -> tuple[Mask, Mask]:
        """Whether an input is at the lower and at the upper limit."""
        linear = self.slope_between * x
        return linear <= self.low, linear >= self.high

    def _between(self, x: Array) -> Array:
        linear = self.slope_between * x
        return ((linear > self.low) & (linear < self.high)).astype(float)


@dataclass(frozen=True, eq=False)
class CoulombLinear(NumberedMap):
    """f(x) = c·sgn(x) + m·x, Coulomb and viscous friction (4.7, 4.8).

    Args:
        coulomb: c, in the output's unit.
        linear: m.
        width: if positive, the sign is tanh(x/width), so that a filter before it can be fitted.
    """

    coulomb: float = 0.0
    linear: float = 1.0
    width: float = 0.0

    kind: ClassVar[str] = "coulomb"
    letters: ClassVar[tuple[str, ...]] = ("c", "m")
    slope_letter: ClassVar[str] = "m"
    tried: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {"c": "height of the sign", "m": "slope"}
    absorbs_shift: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width < 0:
            raise ModelError(f"Coulomb map of width {self.width}; give zero or a positive number")

    def value(self, x: Array) -> Array:
        """c·sgn(x) + m·x."""
        return self.coulomb * self._sign(x) + self.linear * x

    def slope(self, x: Array) -> Array:
        """m, plus c·(1 − tanh²)/width if the sign is smooth."""
        if not self.width:
            return np.full_like(x, self.linear)
        return self.linear + self.coulomb * (1 - self._sign(x) ** 2) / self.width

    def pieces(self) -> Pieces:
        """One line, and the sign."""
        return Pieces.lines([0.0], [self.linear, self.linear], 0.0)._replace(jump=self.coulomb, width=self.width)

    def parameter_gradient(self, x: Array) -> Array:
        """sgn(x) and x."""
        return np.stack([self._sign(x), x])

    def inverse(self, z: ArrayLike) -> Array:
        """sgn(z)·max(|z| − c, 0)/m."""
        target = np.asarray(z, dtype=float)
        if not (self.linear > 0 and self.coulomb >= 0):
            raise ModelError("a Coulomb map has an inverse only for m > 0 and c ≥ 0")
        if self.width:
            reach = float(np.max(np.abs(numbers_of(target)), initial=0.0)) / self.linear + self.width
            return monotone_inverse(self, -reach, reach, target)
        return np.asarray(np.sign(target) * np.maximum(np.abs(target) - self.coulomb, 0) / self.linear)

    def scaled(self, input: float, output: float) -> CoulombLinear:
        """c times ±output, m times output/input."""
        return CoulombLinear(
            self.coulomb * output * float(np.sign(input)), self.linear * output / input, self.width * abs(input)
        )

    def expression(self, x: str) -> str:
        """c·sign(x) + m·x."""
        sign = f"tanh({x}/{self.width:.6g})" if self.width else f"sign({x})"
        return sum_of_terms([(self.coulomb, sign), (self.linear, x)])

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> CoulombLinear:
        """A sign smoothed over a twentieth of the spread of x, plus a linear term."""
        return closest(cls(0.0, 1.0, width=0.05 * float(np.std(x))), x, z)

    def steeper(self) -> CoulombLinear:
        """Half the width."""
        return replace(self, width=0.5 * self.width) if self.width else self

    def breaks(self, low: float, high: float) -> Array:
        """Both sides of the jump at zero."""
        tiny = 1e-9 * (high - low)
        return np.array([-tiny, tiny]) if low < 0 < high else np.zeros(0)

    def _sign(self, x: Array) -> Array:
        sign: Array = np.tanh(x / self.width) if self.width else np.sign(x)
        return sign


def unseen_limits(low: Mask, high: Mask) -> tuple[Finding, ...]:
    """A finding for a limit, lower or upper, that too few samples (N,) reach."""
    return tuple(
        Finding("limit-unseen", data={"side": side, "share": float(np.mean(there))})
        for side, there in (("low", low), ("high", high))
        if seldom(there)
    )


def seldom(there: Mask) -> bool:
    """Whether too few samples are there, of which (N,) says so, to determine that side of a map."""
    return bool(np.mean(there) < SELDOM or np.sum(there) < FEW)


# --- hyperbolic tangent -----------------------------------------------------------------------------------------------

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
