r"""What a block of a cascade is, and the list of those that a model file may name.

A block turns a signal x(t) into a signal y(t). To be fitted it must say how y moves with everything it depends on,

    δy = push(δx) + Σₖ gradientₖ δθₖ + Σⱼ state_gradientⱼ δsⱼ,

its input, its parameters θ and, for a filter, the state s that it starts from. All derivatives are exact. `filters` and
`static_maps` hold the blocks that come with the program; any object that does what `Block` asks for may stand in a
cascade.
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
    """A filter or a static map, with its parameters in it."""

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
        """How many numbers the start of the block is described by; zero for a static map."""
        ...

    @property
    def anchors(self) -> tuple[int, ...]:
        """Parameters that, held fixed, take the freedom of scale (and level, where it owns one) out of the block."""
        ...

    def with_parameters(self, theta: Array) -> Self:
        """The same block with other parameters θ (p,)."""
        ...

    def check(self) -> None:
        """Refuse parameters that make no working block.

        Raises:
            Infeasible: for an unstable filter, a dead zone turned inside out.
        """
        ...

    def output(self, x: Array, state: Array) -> Array:
        """(N,) y for x (N,), starting from a state (s,)."""
        ...

    def run(self, x: Array, state: Array) -> tuple[Array, Array]:
        """(N,) y for x (N,), starting from a state (s,), and the state (s,) after it."""
        ...

    def push(self, x: Array, rows: Array) -> None:
        """Turn rows (k, N) of ways in which x moves, in place, into those in which y moves then."""
        ...

    def gradient(self, x: Array, y: Array) -> Array:
        """(p, N) how y moves with each parameter."""
        ...

    def state_gradient(self, samples: int) -> Array:
        """(s, N) how y moves with each element of the starting state."""
        ...

    def visited(self, x: Array, y: Array) -> Array:
        """(s, N) the states in which the block meets each sample of its input x (N,), y (N,) being its output."""
        ...

    def resting(self, level: float) -> tuple[Array, float]:
        """The state (s,) in which a constant input leaves the block at rest, and the constant output."""
        ...

    def equation(self, x: str, y: str) -> str:
        """The block as text, from signal ``x`` to signal ``y``."""
        ...

    def to_data(self) -> dict[str, Any]:
        """Everything that `block_from_data` needs, in built-in types."""
        ...


def block_from_data(data: dict[str, Any]) -> Block:
    """The block that its `to_data` described.

    Raises:
        ModelError: for data that describe no block.
    """
    try:
        kind = data["kind"]
        return Rational.from_data(data) if kind == Rational.kind else STATIC_MAPS[kind].from_data(data)
    except (KeyError, TypeError, ValueError) as problem:
        raise ModelError(
            f"not a block: {problem!r}; the kinds are {', '.join((Rational.kind, *STATIC_MAPS))}"
        ) from None
