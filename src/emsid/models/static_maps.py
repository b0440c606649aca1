r"""Static maps as blocks of a cascade: y(t) = f(x(t), θ), sample by sample.

Each gives its value, its slope ∂f/∂x, its gradient ∂f/∂θ and, where there is one, its inverse. At a kink the derivative
is that of one side.

**Scale.** Between two blocks of a cascade a factor can be moved without changing anything outside. A map says with
`scaling` whether its family holds, with f, every o·f(x/i) (it can take up any factor on either side), only those with
o = |i|, or none; with `absorbs_shift` whether it holds f(x − x₀), and with `owns_level` whether it holds f + c.

References:
    Kara, Abokoos, *A Simulation and Experimental Study on Identification of an Electromechanical System*, eqs. (3.2),
    (4.7) to (4.9). de Boor, *A Practical Guide to Splines*, rev. ed. (2001).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from enum import Enum
from functools import cached_property
from typing import Any, ClassVar, Self

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.gauss_newton import Infeasible
from emsid.models.terms import sum_of_terms, vector

Array = NDArray[np.float64]


class Scaling(Enum):
    """Which of the maps o·f(x/i) a family holds beside f."""

    FREE = "free"  # all of them
    JOINT = "joint"  # those with o = |i|
    NONE = "none"


class StaticMap(ABC):
    """y(t) = f(x(t), θ): what all static maps share; the rest is each map's own."""

    kind: ClassVar[str]
    scaling: ClassVar[Scaling] = Scaling.FREE
    absorbs_shift: ClassVar[bool] = True
    owns_level: ClassVar[bool] = False

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """A name for every parameter."""

    @property
    @abstractmethod
    def parameters(self) -> Array:
        """(p,) θ."""

    @property
    @abstractmethod
    def anchors(self) -> tuple[int, ...]:
        """Parameters that fix its scale, and its level where it owns one."""

    @property
    @abstractmethod
    def steepness(self) -> float:
        """The slope that stands for the whole map, the one that the normalisation λ₁ = 1 sets to one."""

    @abstractmethod
    def with_parameters(self, theta: Array) -> Self:
        """The same map with other parameters."""

    @abstractmethod
    def value(self, x: Array) -> Array:
        """(N,) f(x)."""

    @abstractmethod
    def slope(self, x: Array) -> Array:
        """(N,) ∂f/∂x."""

    @abstractmethod
    def parameter_gradient(self, x: Array) -> Array:
        """(p, N) ∂f/∂θ."""

    @abstractmethod
    def inverse(self, z: ArrayLike) -> Array:
        """x with f(x) = z.

        Raises:
            ModelError: where there is none.
        """

    @abstractmethod
    def scaled(self, input: float, output: float) -> Self:
        """The map output·f(x/input), of the same family.

        Raises:
            ModelError: where the family does not hold it; `scaling` says which it does.
        """

    @abstractmethod
    def expression(self, x: str) -> str:
        """f(x) as text."""

    @abstractmethod
    def to_data(self) -> dict[str, Any]:
        """Everything that `block_from_data` needs, in built-in types."""

    @abstractmethod
    def check(self) -> None:
        """Refuse parameters that make no map of this family."""

    @property
    def states(self) -> int:
        """None: a static map has no memory."""
        return 0

    def output(self, x: Array, state: Array) -> Array:
        """(N,) f(x)."""
        return self.value(x)

    def push(self, x: Array, rows: Array) -> None:
        """Every row (k, N), in place, times the slope."""
        rows *= self.slope(x)

    def gradient(self, x: Array, y: Array) -> Array:
        """(p, N) ∂f/∂θ."""
        return self.parameter_gradient(x)

    def state_gradient(self, samples: int) -> Array:
        """(0, N)."""
        return np.zeros((0, samples))

    def visited(self, x: Array, y: Array) -> Array:
        """(0, N)."""
        return np.zeros((0, len(x)))

    def resting(self, level: float) -> tuple[Array, float]:
        """No state, and f of the level."""
        return np.zeros(0), float(self.value(np.array([level]))[0])

    def equation(self, x: str, y: str) -> str:
        """``y(t) = f(x(t))``."""
        return f"{y}(t) = {self.expression(f'{x}(t)')}"


@dataclass(frozen=True, eq=False)
class Polynomial(StaticMap):
    """f(x) = Σₖ cₖ Pₖ(t), Legendre polynomials of t = (2x − low − high)/(high − low).

    The paper's Σ λₚxᵖ (3.2) in a basis that stays well conditioned at any degree; `powers` gives the λₚ.

    >>> Polynomial.from_powers([0.0, 1.0, 0.5], -2.0, 2.0).expression("x")
    '1*x + 0.5*x^2'

    Args:
        coefficients: (d + 1,) c₀, c₁, …
        low, high: interval on which the basis is orthogonal, the range of the data.
    """

    coefficients: Array
    low: float = -1.0
    high: float = 1.0

    kind: ClassVar[str] = "polynomial"
    owns_level: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", vector(self.coefficients, "polynomial coefficients"))
        if len(self.coefficients) < 2 or not (np.isfinite([self.low, self.high]).all() and self.low < self.high):
            raise ModelError(
                f"polynomial with {len(self.coefficients)} coefficients on [{self.low}, {self.high}]; give at least "
                "two on an interval that is finite and not empty"
            )

    @classmethod
    def from_powers(cls, powers: ArrayLike, low: float, high: float) -> Polynomial:
        """The polynomial Σₚ λₚ xᵖ, given λ₀, λ₁, …"""
        shifted = np.polynomial.Polynomial(vector(powers, "powers"))(
            np.polynomial.Polynomial([(low + high) / 2, (high - low) / 2])
        )
        coefficients = np.polynomial.legendre.poly2leg(shifted.coef)
        return cls(np.pad(coefficients, (0, np.size(powers) - len(coefficients))), low, high)

    @property
    def powers(self) -> Array:
        """(d + 1,) λ₀, λ₁, … of Σ λₚxᵖ."""
        centred = np.polynomial.Polynomial(np.polynomial.legendre.leg2poly(self.coefficients))
        width = self.high - self.low
        plain = centred(np.polynomial.Polynomial([-(self.low + self.high) / width, 2 / width])).coef
        return np.pad(plain, (0, len(self.coefficients) - len(plain)))

    @property
    def names(self) -> tuple[str, ...]:
        """c0, c1, …"""
        return tuple(f"c{k}" for k in range(len(self.coefficients)))

    @property
    def parameters(self) -> Array:
        """(d + 1,) c₀, c₁, …"""
        return self.coefficients

    @property
    def anchors(self) -> tuple[int, ...]:
        """The constant and the largest of the others."""
        return 0, 1 + int(np.argmax(np.abs(self.coefficients[1:])))

    @property
    def steepness(self) -> float:
        """λ₁, the slope at zero."""
        return float(self.slope(np.zeros(1))[0])

    def with_parameters(self, theta: Array) -> Polynomial:
        """With other coefficients."""
        return replace(self, coefficients=theta)

    def value(self, x: Array) -> Array:
        """Σ cₖPₖ(t)."""
        return np.asarray(np.polynomial.legendre.legval(self._centred(x), self.coefficients), dtype=float)

    def slope(self, x: Array) -> Array:
        """Σ cₖPₖ′(t) · 2/(high − low)."""
        derived = np.polynomial.legendre.legder(self.coefficients) * (2 / (self.high - self.low))
        return np.asarray(np.polynomial.legendre.legval(self._centred(x), derived), dtype=float)

    def parameter_gradient(self, x: Array) -> Array:
        """Pₖ(t)."""
        rows = np.polynomial.legendre.legvander(self._centred(x), len(self.coefficients) - 1).T
        return np.ascontiguousarray(rows)

    def inverse(self, z: ArrayLike) -> Array:
        """x between low and high, where the polynomial is monotone there."""
        return _monotone_inverse(self, self.low, self.high, z)

    def scaled(self, input: float, output: float) -> Polynomial:
        """Coefficients times ``output`` on the stretched interval; a mirrored one changes the odd signs."""
        ends = sorted((self.low * input, self.high * input))
        signs = np.where(np.arange(len(self.coefficients)) % 2, np.sign(input), 1.0)
        return Polynomial(self.coefficients * signs * output, *ends)

    def expression(self, x: str) -> str:
        """In powers of x."""
        return sum_of_terms(
            [(value, "" if k == 0 else x if k == 1 else f"{x}^{k}") for k, value in enumerate(self.powers)]
        )

    def check(self) -> None:
        """Nothing to refuse."""

    def to_data(self) -> dict[str, Any]:
        """Coefficients and interval."""
        return {
            "kind": self.kind,
            "coefficients": self.coefficients.tolist(),
            "low": self.low,
            "high": self.high,
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Polynomial:
        """The polynomial that `to_data` described."""
        return cls(data["coefficients"], float(data["low"]), float(data["high"]))

    def _centred(self, x: Array) -> Array:
        return (2 * x - self.low - self.high) / (self.high - self.low)


@dataclass(frozen=True, eq=False)
class _OfNumbers(StaticMap):
    """A map described by a few numbers, its fields, the first of which are its parameters."""

    letters: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            if not np.isfinite(getattr(self, name)):
                raise ModelError(f"{self.kind} with {name} = {getattr(self, name)}; give finite numbers")

    @property
    def names(self) -> tuple[str, ...]:
        """One for each of the first fields, as formulas and files have it."""
        return self.letters

    @property
    def parameters(self) -> Array:
        """(p,) the first fields."""
        return np.array([getattr(self, name) for name in self._first_fields()])

    def with_parameters(self, theta: Array) -> Self:
        """With other numbers in the first fields."""
        return replace(self, **dict(zip(self._first_fields(), theta.tolist(), strict=True)))

    def to_data(self) -> dict[str, Any]:
        """All fields, the parameters under their names."""
        values = (getattr(self, field.name) for field in fields(self))
        return {"kind": self.kind, **dict(zip(self._keys(), values, strict=True))}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The map that `to_data` described."""
        return cls(*(float(data[key]) for key in cls._keys()))

    @classmethod
    def _first_fields(cls) -> list[str]:
        return [field.name for field in fields(cls)[: len(cls.letters)]]

    @classmethod
    def _keys(cls) -> tuple[str, ...]:
        return (*cls.letters, *(field.name for field in fields(cls)[len(cls.letters) :]))


@dataclass(frozen=True, eq=False)
class DeadZone(_OfNumbers):
    """The dead zone (4.9): m_r(x − b_r) above b_r, m_l(x − b_l) below b_l, nothing between.

    >>> DeadZone(-0.2, 0.3, 1.0, 2.0).value(np.array([-1.2, 0.0, 1.3]))
    array([-1.,  0.,  2.])

    Args:
        b_l, b_r: where it ends on the left and on the right, in the input's unit, b_l ≤ b_r.
        m_l, m_r: slope to the left and to the right.
    """

    b_l: float
    b_r: float
    m_l: float = 1.0
    m_r: float = 1.0

    kind: ClassVar[str] = "dead-zone"
    letters: ClassVar[tuple[str, ...]] = ("b_l", "b_r", "m_l", "m_r")

    @property
    def anchors(self) -> tuple[int, ...]:
        """m_r."""
        return (3,)

    @property
    def steepness(self) -> float:
        """m_r."""
        return self.m_r

    def value(self, x: Array) -> Array:
        """(4.9)."""
        value: Array = self.m_r * np.maximum(x - self.b_r, 0) + self.m_l * np.minimum(x - self.b_l, 0)
        return value

    def slope(self, x: Array) -> Array:
        """m_r, 0 or m_l."""
        return self.m_r * (x > self.b_r) + self.m_l * (x < self.b_l)

    def parameter_gradient(self, x: Array) -> Array:
        """−m on the outer sides for the edges, the distance to the edge for the slopes."""
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
        """Edges times ``input``, slopes times output/input; a mirrored input exchanges left and right."""
        sides = [(self.b_l * input, self.m_l * output / input), (self.b_r * input, self.m_r * output / input)]
        (b_l, m_l), (b_r, m_r) = sides if input > 0 else sides[::-1]
        return DeadZone(b_l, b_r, m_l, m_r)

    def expression(self, x: str) -> str:
        """Two hinges."""
        return sum_of_terms([(self.m_r, f"max({x}{-self.b_r:+.6g}, 0)"), (self.m_l, f"min({x}{-self.b_l:+.6g}, 0)")])

    def check(self) -> None:
        """Refuse edges that have crossed."""
        if not self.b_l <= self.b_r:
            raise Infeasible(f"dead zone from b_l = {self.b_l:.6g} to b_r = {self.b_r:.6g}; b_l must not exceed b_r")


@dataclass(frozen=True, eq=False)
class Saturation(_OfNumbers):
    """f(x) = min(max(m·x, low), high).

    Args:
        slope_between: m, between the limits.
        low, high: limits of the output; they need not enclose zero, so that with an output offset they take up shifts.
    """

    slope_between: float
    low: float
    high: float

    kind: ClassVar[str] = "saturation"
    letters: ClassVar[tuple[str, ...]] = ("m", "low", "high")

    @property
    def anchors(self) -> tuple[int, ...]:
        """m."""
        return (0,)

    @property
    def steepness(self) -> float:
        """m."""
        return self.slope_between

    def value(self, x: Array) -> Array:
        """m·x, limited."""
        value: Array = np.clip(self.slope_between * x, self.low, self.high)
        return value

    def slope(self, x: Array) -> Array:
        """m between the limits, zero at them."""
        return self.slope_between * self._between(x)

    def parameter_gradient(self, x: Array) -> Array:
        """x between the limits; one where the limit holds."""
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

    def check(self) -> None:
        """Refuse limits that have crossed."""
        if not self.low < self.high:
            raise Infeasible(f"saturation from {self.low:.6g} to {self.high:.6g}; the limits must ascend")

    def _between(self, x: Array) -> Array:
        linear = self.slope_between * x
        return ((linear > self.low) & (linear < self.high)).astype(float)


@dataclass(frozen=True, eq=False)
class CoulombLinear(_OfNumbers):
    """f(x) = c·sgn(x) + m·x, dry friction beside viscous friction (4.7, 4.8).

    Args:
        coulomb: c, in the output's unit.
        linear: m.
        width: where positive, the sign is tanh(x/width), which a filter before it can be fitted through.
    """

    coulomb: float
    linear: float
    width: float = 0.0

    kind: ClassVar[str] = "coulomb"
    letters: ClassVar[tuple[str, ...]] = ("c", "m")
    absorbs_shift: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width < 0:
            raise ModelError(f"Coulomb map of width {self.width}; give zero or a positive number")

    @property
    def anchors(self) -> tuple[int, ...]:
        """m."""
        return (1,)

    @property
    def steepness(self) -> float:
        """m."""
        return self.linear

    def value(self, x: Array) -> Array:
        """c·sgn(x) + m·x."""
        return self.coulomb * self._sign(x) + self.linear * x

    def slope(self, x: Array) -> Array:
        """m, and c·(1 − tanh²)/width where the sign is smooth."""
        if not self.width:
            return np.full_like(x, self.linear)
        return self.linear + self.coulomb * (1 - self._sign(x) ** 2) / self.width

    def parameter_gradient(self, x: Array) -> Array:
        """sgn(x) and x."""
        return np.stack([self._sign(x), x])

    def inverse(self, z: ArrayLike) -> Array:
        """sgn(z)·max(|z| − c, 0)/m."""
        target = np.asarray(z, dtype=float)
        if not (self.linear > 0 and self.coulomb >= 0):
            raise ModelError("a Coulomb map has an inverse only for m > 0 and c ≥ 0")
        if self.width:
            reach = float(np.max(np.abs(_known(target)), initial=0.0)) / self.linear + self.width
            return _monotone_inverse(self, -reach, reach, target)
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

    def check(self) -> None:
        """Nothing to refuse."""

    def _sign(self, x: Array) -> Array:
        sign: Array = np.tanh(x / self.width) if self.width else np.sign(x)
        return sign


@dataclass(frozen=True, eq=False)
class _ThroughPoints(StaticMap):
    """A map through points (knotₖ, valueₖ), linear in the values, which are its parameters.

    So they, and their confidence, can be read off a plot.

    Args:
        knots: (K,) ascending, in the input's unit, at least two.
        values: (K,) f at the knots.

    Raises:
        ModelError: for knots that do not ascend or are not as many as the values.
    """

    knots: Array
    values: Array

    owns_level: ClassVar[bool] = True
    word: ClassVar[str]
    of_knots: ClassVar[tuple[str, ...]] = ()  # what is worked out from the knots alone

    def __post_init__(self) -> None:
        for field in ("knots", "values"):
            object.__setattr__(self, field, vector(getattr(self, field), f"{self.kind} {field}"))
        if len(self.knots) != len(self.values) or len(self.knots) < 2:
            raise ModelError(
                f"{self.kind}: {len(self.knots)} knots and {len(self.values)} values; give as many, at least two"
            )
        if np.any(np.diff(self.knots) <= 0):
            raise ModelError(f"{self.kind}: the knots must ascend")

    @property
    def names(self) -> tuple[str, ...]:
        """f1, f2, …, values at the knots."""
        return tuple(f"f{k + 1}" for k in range(len(self.knots)))

    @property
    def parameters(self) -> Array:
        """(K,) values."""
        return self.values

    @property
    def anchors(self) -> tuple[int, ...]:
        """The smallest and the largest value."""
        return tuple(sorted((int(np.argmin(self.values)), int(np.argmax(self.values)))))

    @property
    def steepness(self) -> float:
        """The mean slope between the outer knots."""
        return float((self.values[-1] - self.values[0]) / (self.knots[-1] - self.knots[0]))

    def with_parameters(self, theta: Array) -> Self:
        """With other values; what depends on the knots alone is kept."""
        new = replace(self, values=theta)
        for kept in self.of_knots:
            new.__dict__[kept] = getattr(self, kept)
        return new

    def scaled(self, input: float, output: float) -> Self:
        """Knots times ``input``, values times ``output``."""
        turned = slice(None) if input > 0 else slice(None, None, -1)
        return replace(self, knots=(self.knots * input)[turned], values=(self.values * output)[turned])

    def expression(self, x: str) -> str:
        """The points."""
        pairs = ", ".join(f"({k:.4g}, {v:.6g})" for k, v in zip(self.knots, self.values, strict=True))
        return f"{self.word}({x}; {pairs})"

    def check(self) -> None:
        """Nothing to refuse."""

    def to_data(self) -> dict[str, Any]:
        """Knots and values."""
        return {"kind": self.kind, "knots": self.knots.tolist(), "values": self.values.tolist()}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The map that `to_data` described."""
        return cls(data["knots"], data["values"])


class PiecewiseLinear(_ThroughPoints):
    """Straight lines between the points (knotₖ, valueₖ), and on in the direction of the last ones."""

    kind: ClassVar[str] = "piecewise-linear"
    word: ClassVar[str] = "linear"

    def value(self, x: Array) -> Array:
        """Interpolated."""
        piece, part = self._locate(x)
        return self.values[piece] * (1 - part) + self.values[piece + 1] * part

    def slope(self, x: Array) -> Array:
        """Slope of the piece."""
        piece, _ = self._locate(x)
        return (np.diff(self.values) / np.diff(self.knots))[piece]

    def parameter_gradient(self, x: Array) -> Array:
        """The hat functions."""
        piece, part = self._locate(x)
        rows = np.zeros((len(self.knots), len(x)))
        where = np.arange(len(x))
        rows[piece, where] = 1 - part
        rows[piece + 1, where] = part
        return rows

    def inverse(self, z: ArrayLike) -> Array:
        """By the same points read the other way, where they ascend or descend throughout."""
        steps = np.diff(self.values)
        if not (np.all(steps > 0) or np.all(steps < 0)):
            raise ModelError("a piecewise linear map has an inverse only where it is monotone")
        turned = slice(None) if steps[0] > 0 else slice(None, None, -1)
        return PiecewiseLinear(self.values[turned], self.knots[turned]).value(np.asarray(z, dtype=float))

    def _locate(self, x: Array) -> tuple[NDArray[np.intp], Array]:
        piece = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.knots) - 2)
        return piece, (x - self.knots[piece]) / np.diff(self.knots)[piece]


class CubicSpline(_ThroughPoints):
    """The natural cubic spline through (knotₖ, valueₖ), which goes on as a straight line at either end.

    Between knots f is a cubic, at them two derivatives are continuous, and the second is zero at both ends,
    where the lines begin. The second derivatives at the knots are linear in the values, M = T·values, T from
    a tridiagonal system (de Boor, ch. IV).
    """

    kind: ClassVar[str] = "spline"
    word: ClassVar[str] = "spline"
    of_knots: ClassVar[tuple[str, ...]] = ("curvatures",)

    @cached_property
    def curvatures(self) -> Array:
        """(K, K) T: second derivatives at the knots from the values."""
        h = np.diff(self.knots)
        size = len(self.knots)
        left, right = np.zeros((size, size)), np.zeros((size, size))
        left[0, 0] = left[-1, -1] = 1.0
        for k in range(1, size - 1):
            left[k, k - 1 : k + 2] = h[k - 1] / 6, (h[k - 1] + h[k]) / 3, h[k] / 6
            right[k, k - 1 : k + 2] = 1 / h[k - 1], -1 / h[k - 1] - 1 / h[k], 1 / h[k]
        return np.asarray(np.linalg.solve(left, right), dtype=float)

    def value(self, x: Array) -> Array:
        """f(x)."""
        return self._evaluate(x)[0]

    def slope(self, x: Array) -> Array:
        """f′(x)."""
        return self._evaluate(x)[1]

    def parameter_gradient(self, x: Array) -> Array:
        """(K, N) the cardinal splines, one at their own knot and zero at the others."""
        rows = np.empty((len(self.knots), x.size))
        spline_rows(self.knots, self.curvatures, x, rows)
        return rows

    def inverse(self, z: ArrayLike) -> Array:
        """x with f(x) = z, where the spline is monotone."""
        target = np.asarray(z, dtype=float)
        ends = np.array([self.knots[0], self.knots[-1]])
        slopes = self.slope(ends)
        if not np.all(slopes * slopes[0] > 0):
            raise ModelError("a spline has an inverse only where it is monotone")
        known = _known(target)
        extremes = (known.min(), known.max()) if known.size else ()
        reach = np.concatenate([ends, *(ends + (t - self.value(ends)) / slopes for t in extremes)])
        return _monotone_inverse(self, min(ends[0], reach.min()), max(ends[1], reach.max()), target)

    def _evaluate(self, x: Array) -> tuple[Array, Array]:
        at = np.asarray(x, dtype=float)
        out = np.empty((2, at.size))
        spline_values(self.knots, self.values, self.curvatures @ self.values, at.ravel(), out)
        return out[0].reshape(at.shape), out[1].reshape(at.shape)


@dataclass(frozen=True, eq=False)
class Abs(_OfNumbers):
    """f(x) = |x|: a sensor that loses the sign."""

    kind: ClassVar[str] = "abs"
    letters: ClassVar[tuple[str, ...]] = ()
    scaling: ClassVar[Scaling] = Scaling.JOINT
    absorbs_shift: ClassVar[bool] = False

    @property
    def anchors(self) -> tuple[int, ...]:
        """None."""
        return ()

    @property
    def steepness(self) -> float:
        """One."""
        return 1.0

    def value(self, x: Array) -> Array:
        """|x|."""
        value: Array = np.abs(x)
        return value

    def slope(self, x: Array) -> Array:
        """sgn(x)."""
        slope: Array = np.sign(x)
        return slope

    def parameter_gradient(self, x: Array) -> Array:
        """(0, N)."""
        return np.zeros((0, len(x)))

    def inverse(self, z: ArrayLike) -> Array:
        """There is none.

        Raises:
            ModelError: always.
        """
        raise ModelError("|x| has no inverse: the sign is lost")

    def scaled(self, input: float, output: float) -> Abs:
        """Itself, where output = |input|."""
        if not np.isclose(output, abs(input)):
            raise ModelError("|x| can take a factor in only where it gives the same factor out")
        return self

    def expression(self, x: str) -> str:
        """abs(x)."""
        return f"abs({x})"

    def check(self) -> None:
        """Nothing to refuse."""


@dataclass(frozen=True, eq=False)
class UserMap(StaticMap):
    """A static map of the user's own, y = f(x, θ), with its derivatives.

    Its scale is taken to be meant: no factor is moved through it. It may be without a value (NaN) somewhere: a search
    does not go there, but it cannot begin there.

    Args:
        function: f(x (N,), θ (p,)) → (N,).
        derivative: ∂f/∂x of the same arguments → (N,).
        jacobian: ∂f/∂θ of the same arguments → (p, N); not needed without parameters.
        parameters_now: (p,) θ.
        parameter_names: (p,) a name for every parameter.

    Raises:
        ModelError: for names and parameters of different number; when called, for results of a wrong shape, and for
            functions that fail.
    """

    function: Callable[[Array, Array], Array]
    derivative: Callable[[Array, Array], Array]
    jacobian: Callable[[Array, Array], Array] | None = None
    parameters_now: Array = ()  # type: ignore[assignment]  # made an array below
    parameter_names: tuple[str, ...] = ()

    kind: ClassVar[str] = "user"
    scaling: ClassVar[Scaling] = Scaling.NONE
    absorbs_shift: ClassVar[bool] = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters_now", vector(self.parameters_now, "user map parameters"))
        names = self.parameter_names or tuple(f"p{k + 1}" for k in range(len(self.parameters_now)))
        object.__setattr__(self, "parameter_names", names)
        if len(names) != len(self.parameters_now):
            raise ModelError(f"user map: {len(names)} names for {len(self.parameters_now)} parameters")
        if len(names) and self.jacobian is None:
            raise ModelError("user map: a map with parameters needs its derivative with respect to them")

    @property
    def names(self) -> tuple[str, ...]:
        """As given."""
        return self.parameter_names

    @property
    def parameters(self) -> Array:
        """(p,) θ."""
        return self.parameters_now

    @property
    def anchors(self) -> tuple[int, ...]:
        """None."""
        return ()

    @property
    def steepness(self) -> float:
        """One: no factor is moved through it."""
        return 1.0

    def with_parameters(self, theta: Array) -> UserMap:
        """With other parameters."""
        return replace(self, parameters_now=theta)

    def value(self, x: Array) -> Array:
        """f(x, θ)."""
        return self._called(self.function, x, x.shape, "function")

    def slope(self, x: Array) -> Array:
        """∂f/∂x."""
        return self._called(self.derivative, x, x.shape, "derivative")

    def parameter_gradient(self, x: Array) -> Array:
        """∂f/∂θ."""
        if self.jacobian is None:
            return np.zeros((0, len(x)))
        return self._called(self.jacobian, x, (len(self.parameters_now), len(x)), "jacobian")

    def inverse(self, z: ArrayLike) -> Array:
        """Not known.

        Raises:
            ModelError: always.
        """
        raise ModelError("the inverse of a user's own map is not known")

    def scaled(self, input: float, output: float) -> UserMap:
        """Itself, for factors of one."""
        if not (np.isclose(input, 1) and np.isclose(output, 1)):
            raise ModelError("no factor can be moved through a user's own map")
        return self

    def expression(self, x: str) -> str:
        """The function's name with its parameters."""
        values = (f"{n}={v:.6g}" for n, v in zip(self.names, self.parameters_now, strict=True))
        name = getattr(self.function, "__name__", "f")
        return f"{name if name.isidentifier() else 'f'}({', '.join([x, *values])})"

    def check(self) -> None:
        """Nothing to refuse."""

    def to_data(self) -> dict[str, Any]:
        """Not possible.

        Raises:
            ModelError: always; a function cannot be kept in a file.
        """
        raise ModelError("a user's own map is a function and cannot be saved; save its parameters instead")

    def _called(self, law: Callable[[Array, Array], Array], x: Array, shape: tuple[int, ...], what: str) -> Array:
        """What the user's code returns, or what is wrong with it."""
        try:
            array = np.asarray(law(x, self.parameters_now), dtype=float)
        except EmsidError:
            raise
        except Exception as problem:  # whatever a user's code may raise
            raise ModelError(f"the {what} of a user's map failed: {type(problem).__name__}: {problem}") from problem
        if array.shape != shape:
            raise ModelError(f"the {what} of a user's map returned shape {array.shape} where {shape} was due")
        return array


def _known(values: Array) -> Array:
    """Those that are not NaN, in one dimension."""
    known: Array = values[~np.isnan(values)]
    return known


def _monotone_inverse(function: StaticMap, low: float, high: float, z: ArrayLike) -> Array:
    """x in [low, high] with f(x) = z, by bisection to the last bit, for an f that is monotone there."""
    target = np.asarray(z, dtype=float)
    grid = function.value(np.linspace(low, high, 513))
    rising = bool(grid[-1] > grid[0])
    if not np.all(np.diff(grid) > 0 if rising else np.diff(grid) < 0):
        raise ModelError(f"a {function.kind} map has an inverse only where it is monotone")
    margin = 1e-9 * abs(grid[-1] - grid[0])
    if np.any((target < grid.min() - margin) | (target > grid.max() + margin)):
        raise ModelError(f"the inverse of this {function.kind} is asked for outside the range that it was fitted on")
    left, right = np.full(target.shape, low), np.full(target.shape, high)
    for _ in range(64):
        middle = 0.5 * (left + right)
        beyond = (function.value(middle.ravel()).reshape(target.shape) < target) == rising
        left, right = np.where(beyond, middle, left), np.where(beyond, right, middle)
    return np.where(np.isnan(target), np.nan, 0.5 * (left + right))


@numba.njit(cache=True, nogil=True)
def spline_values(knots: Array, values: Array, second: Array, x: Array, out: Array) -> None:
    """f and f′ of the natural cubic spline into the two rows of ``out``; see `CubicSpline`."""
    last = len(knots) - 1
    for t in range(len(x)):
        k = min(max(np.searchsorted(knots, x[t], side="right") - 1, 0), last - 1)
        h = knots[k + 1] - knots[k]
        chord = (values[k + 1] - values[k]) / h
        if x[t] < knots[0]:
            slope = chord - h * (2 * second[k] + second[k + 1]) / 6
            out[0, t] = values[0] + slope * (x[t] - knots[0])
            out[1, t] = slope
        elif x[t] > knots[last]:
            slope = chord + h * (second[k] + 2 * second[k + 1]) / 6
            out[0, t] = values[last] + slope * (x[t] - knots[last])
            out[1, t] = slope
        else:
            p, r = (x[t] - knots[k]) / h, (knots[k + 1] - x[t]) / h
            out[0, t] = (
                r * values[k]
                + p * values[k + 1]
                + h * h / 6 * ((r * r * r - r) * second[k] + (p * p * p - p) * second[k + 1])
            )
            out[1, t] = chord + h / 6 * ((3 * p * p - 1) * second[k + 1] - (3 * r * r - 1) * second[k])


@numba.njit(cache=True, nogil=True)
def spline_rows(knots: Array, curvatures: Array, x: Array, rows: Array) -> None:
    """The cardinal splines at x (N,) into ``rows`` (K, N): f depends on its values through f = Σ valuesⱼ rowsⱼ."""
    last = len(knots) - 1
    size = len(knots)
    tile = np.empty((64, size))
    for first in range(0, len(x), 64):
        height = min(64, len(x) - first)
        for i in range(height):
            v = x[first + i]
            k = min(max(np.searchsorted(knots, v, side="right") - 1, 0), last - 1)
            h = knots[k + 1] - knots[k]
            if v < knots[0]:
                d = v - knots[0]
                r, p = 1 - d / h, d / h
                cr, cp = -d * h / 3, -d * h / 6
            elif v > knots[last]:
                d = v - knots[last]
                r, p = -d / h, 1 + d / h
                cr, cp = d * h / 6, d * h / 3
            else:
                p, r = (v - knots[k]) / h, (knots[k + 1] - v) / h
                cr, cp = h * h / 6 * (r * r * r - r), h * h / 6 * (p * p * p - p)
            line = tile[i]
            for j in range(size):
                line[j] = cr * curvatures[k, j] + cp * curvatures[k + 1, j]
            line[k] += r
            line[k + 1] += p
        for j in range(size):
            for i in range(height):
                rows[j, first + i] = tile[i, j]
