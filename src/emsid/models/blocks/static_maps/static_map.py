"""What every static map can do, and what a cascade may ask of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
