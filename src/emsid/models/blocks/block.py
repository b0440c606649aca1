r"""The interface of a block of a cascade, and the kinds of block in model files.

A block turns a signal x(t) into a signal y(t). A fit needs the derivative of y with respect to all that it depends on,

    δy = push(δx) + Σₖ gradientₖ δθₖ + Σⱼ state_gradientⱼ δsⱼ,

its input, its parameters θ and, for a filter, its initial state s. All derivatives are exact. `filters` and
`static_maps` contain the blocks of the program; any object that implements `Block` can be part of a cascade.
"""

from __future__ import annotations

from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import STATIC_MAPS

Array = NDArray[np.float64]


@runtime_checkable
class Block(Protocol):
    """A filter or a static map, with its parameters."""

    @property
    def names(self) -> tuple[str, ...]:
        """A name for every parameter."""
        ...

    @property
    def parameters(self) -> Array:
        """(p,) θ."""
        ...

    @property
    def states(self) -> int:
        """The number of states; zero for a static map."""
        ...

    @property
    def anchors(self) -> tuple[int, ...]:
        """Parameters that are fixed to remove the redundant scale of the block (and its level, if it has one)."""
        ...

    def with_parameters(self, theta: Array) -> Self:
        """The same block with other parameters θ (p,)."""
        ...

    def check(self) -> None:
        """Refuse parameters of a block that cannot be run.

        Raises:
            Infeasible: for an unstable filter, or a dead zone with crossed edges.
        """
        ...

    def output(self, x: Array, state: Array) -> Array:
        """(N,) y for x (N,), starting from a state (s,)."""
        ...

    def run(self, x: Array, state: Array) -> tuple[Array, Array]:
        """(N,) y for x (N,), starting from a state (s,), and the state (s,) after it."""
        ...

    def push(self, x: Array, rows: Array) -> None:
        """Turn derivatives of x, the rows (k, N), into derivatives of y, in place."""
        ...

    def gradient(self, x: Array, y: Array) -> Array:
        """(p, N) the derivative of y with respect to each parameter."""
        ...

    def state_gradient(self, samples: int) -> Array:
        """(s, N) the derivative of y with respect to each element of the initial state."""
        ...

    def visited(self, x: Array, y: Array, times: NDArray[np.intp]) -> Array:
        """(s, m) the state before some samples (m,) of the input x (N,), given the output y (N,)."""
        ...

    def resting(self, level: float) -> tuple[Array, float]:
        """The steady state (s,) for a constant input, and the constant output."""
        ...

    def equation(self, x: str, y: str) -> str:
        """The block as text, from signal ``x`` to signal ``y``."""
        ...

    def to_data(self) -> dict[str, Any]:
        """Everything that `block_from_data` needs, in built-in types."""
        ...


def block_from_data(data: dict[str, Any]) -> Block:
    """The block described by `to_data`.

    Raises:
        ModelError: for data that do not describe a block.
    """
    try:
        kind = data["kind"]
        if kind == Rational.kind:
            return Rational.from_data(data)
        static = STATIC_MAPS[kind].from_data(data)
        with np.errstate(all="ignore"):
            pieces = static.pieces()
    except (KeyError, TypeError, ValueError) as problem:
        raise ModelError(
            f"not a block: {problem!r}; the kinds are {', '.join((Rational.kind, *STATIC_MAPS))}"
        ) from None
    if pieces is not None and not np.isfinite(np.concatenate([pieces.coefficients.ravel(), pieces.origins])).all():
        raise ModelError(f"a static map {kind} whose curve is not finite")
    return static
