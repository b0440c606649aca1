"""What every static map says of itself: its curve, its scale, how a search starts it, how it is drawn and saved.

A new map is a class in a file of its own and one line of registration (`registry`): whatever the program asks of a map
is asked here, and nothing else in the program asks for its type or name. Only what is abstract has to be written; the
rest has a default that suits most maps.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.information import Information
from emsid.findings import Finding

Array = NDArray[np.float64]
M = TypeVar("M", bound="StaticMap")


class Scaling(Enum):
    """Which of the maps o·f(x/i) a family holds beside f."""

    FREE = "free"  # all of them
    JOINT = "joint"  # those with o = |i|
    NONE = "none"


class StaticMap(ABC):
    """y(t) = f(x(t), θ): what all static maps share; the rest is each map's own.

    Attributes:
        kind: its name in files and tables, and for ``static``: ``dead-zone``.
        scaling: which factors its family can take up, see `Scaling`.
        absorbs_shift: whether its family holds f(x − x₀) beside f.
        owns_level: whether its family holds f + c beside f.
        sizes: numbers of knots (or degrees) that a search chooses from; empty where there is one size only.
        loses_sign: whether signs must be recovered before a linear model can start the search.
        tried: whether a search tries it where no static map is given.
    """

    kind: ClassVar[str]
    scaling: ClassVar[Scaling] = Scaling.FREE
    absorbs_shift: ClassVar[bool] = True
    owns_level: ClassVar[bool] = False
    sizes: ClassVar[tuple[int, ...]] = ()
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

    def inverse(self, z: ArrayLike) -> Array:
        """x with f(x) = z.

        Raises:
            ModelError: where there is none, or none is known.
        """
        raise ModelError(f"the inverse of a {self.kind} map is not known")

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

    @classmethod
    @abstractmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The map that `to_data` described."""

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> StaticMap:
        """The map of this family that comes closest to points (x, z) of a curve, up to a constant level.

        Args:
            x, z: (m,) the points.
            size: one of `sizes`; 0 where there are none.

        Raises:
            ModelError: where the family cannot start itself; then a map with start values is given to the search.
        """
        raise ModelError(f"a {cls.kind} map has no start from data; give one with start values")

    @classmethod
    def trials(cls, x: Array) -> tuple[StaticMap, ...]:
        """Maps, linear in their parameters, that show whether the signal x (m,) suits; empty where a spline does."""
        return ()

    @property
    def size(self) -> int:
        """Its number of knots, or its degree; 0 where there is one size only."""
        return 0

    def check(self) -> None:
        """Refuse parameters that make no map of this family.

        Raises:
            Infeasible: saying which.
        """
        return

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """What the signal x (m,) that enters it leaves open about the map."""
        return ()

    def meaning(self, name: str) -> str:
        """What a parameter stands for, in a few words."""
        return self.kind

    def marks(self) -> tuple[Array, str]:
        """Inputs at which a drawing marks the curve, and what they are: ``knots``."""
        return np.zeros(0), ""

    def breaks(self, low: float, high: float) -> Array:
        """Inputs between ``low`` and ``high`` that a drawing must not skip, around jumps and kinks."""
        return np.zeros(0)

    def summary(self, x: str) -> str:
        """`expression`, what is long counted instead of listed."""
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


def closest(blank: M, x: Array, z: Array) -> M:
    """The map that comes closest to points up to a constant level.

    Args:
        blank: a map that is linear in its parameters; theirs are replaced.
        x, z: (m,) the points.
    """
    rows = blank.parameter_gradient(x)
    if not blank.owns_level:
        rows = np.vstack([rows, np.ones_like(x)])
    return blank.with_parameters(combination(rows, z)[: len(blank.parameters)])


def combination(rows: Array, z: Array) -> Array:
    """(k,) the θ for which θ·rows (k, m) comes closest to z (m,)."""
    information = Information.empty(len(rows)).add_columns(np.ascontiguousarray(np.vstack([rows, z])))
    return information.solve(1e-9).estimate
