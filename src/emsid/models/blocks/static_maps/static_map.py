"""The interface of a static map: its curve, its scale, its start values, its drawing and its file format.

A new map is a class in its own file and one line of registration (`registry`). The program uses maps through this
interface only and does not test their type or name. A new map must define the abstract methods; the others have
defaults that suit most maps. `NumberedMap` is that of maps whose parameters are a few named numbers. The inverse of a
monotone map is found by bisection.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.findings import Finding

Array = NDArray[np.float64]
M = TypeVar("M", bound="StaticMap")


class Scaling(Enum):
    """Which of the maps o·f(x/i) the family of f contains."""

    FREE = "free"  # all of them
    JOINT = "joint"  # those with o = |i|
    NONE = "none"


class Pieces(NamedTuple):
    """A map as polynomials between break points, for compiled loops.

    Attributes:
        edges: (K,) the left end of each piece; the first is −∞.
        origins: (K,) where the powers of each piece are zero.
        coefficients: (K, d + 1) of the powers of x − origin, the constant first.
        jump: amplitude of sgn(x), which is added.
        width: if positive, the sign is tanh(x/width).
    """

    edges: Array
    origins: Array
    coefficients: Array
    jump: float = 0.0
    width: float = 0.0

    @classmethod
    def lines(cls, corners: ArrayLike, slopes: ArrayLike, value: float) -> Pieces:
        """Straight lines: k corners, k + 1 slopes, and the value at the first corner."""
        at, steep = np.asarray(corners, dtype=float), np.asarray(slopes, dtype=float)
        values = value + np.concatenate([[0.0], np.cumsum(steep[1:-1] * np.diff(at))])
        origins = np.concatenate([at[:1], at])
        return cls(np.concatenate([[-np.inf], at]), origins, np.column_stack([[values[0], *values], steep]))


class StaticMap(ABC):
    """A static map y(t) = f(x(t), θ).

    Attributes:
        kind: its name in files and tables, and for ``static``: ``dead-zone``.
        scaling: which factors its family can take, see `Scaling`.
        absorbs_shift: whether its family contains f(x − x₀).
        owns_level: whether its family contains f + c.
        sizes: numbers of knots (or degrees) that a search chooses from; empty if there is one size only.
        smooth: whether a penalty keeps it smooth, see `roughness`. Then its size needs no choice: a search compares
            models with the smallest and fits the largest.
        loses_sign: whether signs must be recovered before a linear model can start the search.
        tried: whether a search tries it if no static map is given; a map that loses the sign, where the output is
            rectified.
    """

    kind: ClassVar[str]
    scaling: ClassVar[Scaling] = Scaling.FREE
    absorbs_shift: ClassVar[bool] = True
    owns_level: ClassVar[bool] = False
    sizes: ClassVar[tuple[int, ...]] = ()
    smooth: ClassVar[bool] = False
    loses_sign: ClassVar[bool] = False
    tried: ClassVar[bool] = False

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
        """Parameters that fix its scale, and its level if it has one."""

    @property
    @abstractmethod
    def steepness(self) -> float:
        """The characteristic slope, which the normalisation λ₁ = 1 sets to one."""

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

    def inverse(self, z: ArrayLike) -> Array:
        """x with f(x) = z.

        Raises:
            ModelError: if there is none, or none is known.
        """
        raise ModelError(f"the inverse of a {self.kind} map is not known")

    @abstractmethod
    def scaled(self, input: float, output: float) -> Self:
        """The map output·f(x/input), of the same family.

        Raises:
            ModelError: if the family does not contain it; see `scaling`.
        """

    @abstractmethod
    def expression(self, x: str) -> str:
        """f(x) as text."""

    @abstractmethod
    def to_data(self) -> dict[str, Any]:
        """Everything that `block_from_data` needs, in built-in types."""

    @classmethod
    @abstractmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The map described by `to_data`."""

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> StaticMap:
        """The map of this family that is closest to points (x, z) of a curve, up to a constant level.

        Args:
            x, z: (m,) the points.
            size: one of `sizes`; 0 if there are none.

        Raises:
            ModelError: if the family has no start from data; then the search needs a map with start values.
        """
        raise ModelError(f"a {cls.kind} map has no start from data; give one with start values")

    @classmethod
    def trials(cls, x: Array) -> tuple[StaticMap, ...]:
        """Maps, linear in their parameters, that test whether the signal x (m,) suits; empty to use a spline."""
        return ()

    @property
    def size(self) -> int:
        """Its number of knots, or its degree; 0 if there is one size only."""
        return 0

    def roughness(self) -> Array | None:
        """(k, p) R with ‖Rθ‖² = ∫f″(x)² dx, for a map that is fitted with a penalty on it; None for the others."""
        return None

    def at_bends(self, x: Array) -> StaticMap:
        """About the same curve over data x (m,), its knots closer together where it bends; itself if it has none."""
        return self

    def on_range(self, low: float, high: float) -> StaticMap:
        """The same curve, with parameters that inputs in this range determine best; itself if there is no choice."""
        return self

    def with_more_knots(self) -> StaticMap:
        """The same curve with another knot between each two; itself if it has none."""
        return self

    def steeper(self) -> StaticMap:
        """The same map with a smooth jump that is half as wide; itself if it has none."""
        return self

    def pieces(self) -> Pieces | None:
        """The map as polynomials between break points; None if it is none, and compiled loops cannot evaluate it."""
        return None

    def check(self) -> None:
        """Refuse parameters outside the family.

        Raises:
            Infeasible: with the parameters.
        """
        return

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """Findings on parts of the map that its input x (m,) does not determine."""
        return ()

    def bends_over(self, x: Array) -> bool:
        """Whether enough of its inputs x (m,) are on either side of a bend; without it the map is a straight line."""
        return True

    def meaning(self, name: str) -> str:
        """The meaning of a parameter in a few words."""
        return self.kind

    def marks(self) -> tuple[Array, str]:
        """Inputs at which a drawing marks the curve, and their name: ``knots``."""
        return np.zeros(0), ""

    def breaks(self, low: float, high: float) -> Array:
        """Inputs between ``low`` and ``high`` that a drawing must include, around jumps and kinks."""
        return np.zeros(0)

    def summary(self, x: str) -> str:
        """A short form of `expression`: long lists are counted."""
        return self.expression(x)

    @property
    def states(self) -> int:
        """None: a static map has no memory."""
        return 0

    def output(self, x: Array, state: Array) -> Array:
        """(N,) f(x)."""
        return self.value(x)

    def run(self, x: Array, state: Array) -> tuple[Array, Array]:
        """(N,) f(x), and no state."""
        return self.value(x), state

    def push(self, x: Array, rows: Array) -> None:
        """Multiply every row (k, N) by the slope, in place."""
        rows *= self.slope(x)

    def gradient(self, x: Array, y: Array) -> Array:
        """(p, N) ∂f/∂θ."""
        return self.parameter_gradient(x)

    def state_gradient(self, samples: int) -> Array:
        """(0, N)."""
        return np.zeros((0, samples))

    def visited(self, x: Array, y: Array, times: NDArray[np.intp]) -> Array:
        """(0, m)."""
        return np.zeros((0, len(times)))

    def resting(self, level: float) -> tuple[Array, float]:
        """No state, and f of the level."""
        return np.zeros(0), float(self.value(np.array([level]))[0])

    def equation(self, x: str, y: str) -> str:
        """``y(t) = f(x(t))``."""
        return f"{y}(t) = {self.expression(f'{x}(t)')}"


def closest(blank: M, x: Array, z: Array) -> M:
    """The map that is closest to points, up to a constant level.

    Args:
        blank: a map that is linear in its parameters, which are replaced.
        x, z: (m,) the points.
    """
    rows = blank.parameter_gradient(x)
    if not blank.owns_level:
        rows = np.vstack([rows, np.ones_like(x)])
    return blank.with_parameters(combination(rows, z)[: len(blank.parameters)])


def combination(rows: Array, z: Array) -> Array:
    """(k,) the θ for which θ·rows (k, m) is closest to z (m,)."""
    information = Information.empty(len(rows)).add_columns(np.ascontiguousarray(np.vstack([rows, z])))
    return information.solve(1e-9).estimate


@dataclass(frozen=True, eq=False)
class NumberedMap(StaticMap):
    """A map whose first fields are its parameters.

    Attributes:
        letters: the letters of the parameters in formulas and files.
        slope_letter: the letter of the characteristic slope; empty if that slope is one and not a parameter.
        meanings: the meaning of each letter in a few words.
        ends: the letters of a lower and an upper end, of which the lower one must not exceed the upper one; or empty.
    """

    letters: ClassVar[tuple[str, ...]]
    slope_letter: ClassVar[str]
    meanings: ClassVar[Mapping[str, str]] = {}
    ends: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            if not np.isfinite(getattr(self, name)):
                raise ModelError(f"{self.kind} with {name} = {getattr(self, name)}; give finite numbers")

    @property
    def names(self) -> tuple[str, ...]:
        """The letters."""
        return self.letters

    @property
    def parameters(self) -> Array:
        """(p,) the first fields."""
        return np.array([getattr(self, name) for name in self._first_fields()])

    @property
    def anchors(self) -> tuple[int, ...]:
        """The characteristic slope."""
        return (self.letters.index(self.slope_letter),) if self.slope_letter else ()

    @property
    def steepness(self) -> float:
        """The characteristic slope."""
        return float(self.parameters[self.anchors[0]]) if self.slope_letter else 1.0

    def with_parameters(self, theta: Array) -> Self:
        """The map with other parameters; ends that would cross meet halfway."""
        values = dict(zip(self.letters, theta.tolist(), strict=True))
        if self.ends and values[self.ends[0]] > values[self.ends[1]]:
            values |= dict.fromkeys(self.ends, 0.5 * sum(values[letter] for letter in self.ends))
        return replace(self, **dict(zip(self._first_fields(), values.values(), strict=True)))

    def check(self) -> None:
        """Refuse ends that have crossed.

        Raises:
            Infeasible: with the ends.
        """
        values = dict(zip(self.letters, self.parameters.tolist(), strict=True))
        if self.ends and not values[self.ends[0]] <= values[self.ends[1]]:
            low, high = (f"{letter} = {values[letter]:.6g}" for letter in self.ends)
            raise Infeasible(f"{self.kind} from {low} to {high}; {self.ends[0]} must not exceed {self.ends[1]}")

    def meaning(self, name: str) -> str:
        """The meaning of its letter."""
        return f"{self.kind}: {self.meanings[name]}" if name in self.meanings else self.kind

    def to_data(self) -> dict[str, Any]:
        """All fields, parameters by their letters."""
        values = (getattr(self, field.name) for field in fields(self))
        return {"kind": self.kind, **dict(zip(self._keys(), values, strict=True))}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The map described by `to_data`."""
        return cls(*(float(data[key]) for key in cls._keys()))

    @classmethod
    def _first_fields(cls) -> list[str]:
        return [field.name for field in fields(cls)[: len(cls.letters)]]

    @classmethod
    def _keys(cls) -> tuple[str, ...]:
        return (*cls.letters, *(field.name for field in fields(cls)[len(cls.letters) :]))


def numbers_of(values: Array) -> Array:
    """The values that are not NaN, in one dimension."""
    numbers: Array = values[~np.isnan(values)]
    return numbers


def inverse_with_straight_ends(function: StaticMap, knots: Array, z: ArrayLike) -> Array:
    """x with f(x) = z, for a monotone f that is straight below the first and above the last of its knots (K,)."""
    target = np.asarray(z, dtype=float)
    ends = knots[[0, -1]]
    known = numbers_of(target)
    extremes = np.array([known.min(), known.max()]) if known.size else np.empty(0)
    beyond = ends + (extremes[:, None] - function.value(ends)) / function.slope(ends)
    reach = np.append(ends, beyond)
    return monotone_inverse(function, reach.min(), reach.max(), target)


def monotone_inverse(function: StaticMap, low: float, high: float, z: ArrayLike) -> Array:
    """x in [low, high] with f(x) = z, by bisection to the last bit, for a monotone f."""
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
