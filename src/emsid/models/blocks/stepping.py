"""A cascade sample by sample: all blocks in one compiled call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.models.blocks.cascade import Cascade, CascadeState
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.blocks.static_maps.tables import Tables, tables_of, value_at
from emsid.models.input_path import InputPath, enter
from emsid.models.stepping import PlainStepper, Stepper

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Blocks(NamedTuple):
    """The blocks of a cascade, one after the other.

    Attributes:
        maps: (n,) the number of the static map of each block; −1 for a filter.
        first: (n + 1,) where the state of each block begins, and the number of states.
        above, below: numerators and denominators of all filters; that of a block begins at its first state plus its
            number, as it has one coefficient more than states.
    """

    maps: Integers
    first: Integers
    above: Array
    below: Array


class CascadeStepper(Stepper):
    """A cascade of filters and static maps."""

    __slots__ = ("_blocks", "_offsets", "_past", "_states", "_steps", "_tables", "_taps")

    def __init__(self, model: Cascade, state: CascadeState, tables: Tables) -> None:
        """
        Args:
            model: what runs.
            state: where it begins.
            tables: of its static maps.
        """
        super().__init__(model, 1, 1)
        path = InputPath(model.delay, model.oversampling)
        self._blocks, self._tables, self._taps = blocks_of(model), tables, path.taps
        self._offsets = np.array([model.input_offset, model.output_offset])
        self._past, self._states = np.append(0.0, state.inputs), np.array(state.blocks, dtype=float)
        self._steps = np.empty(path.rate)

    @classmethod
    def of(cls, model: Cascade, state: CascadeState) -> Stepper:
        """The stepper of a cascade; a plain one where a block is a function of the user."""
        maps = [block for block in model.blocks if isinstance(block, StaticMap)]
        tables = tables_of(maps)
        if tables is None or not all(isinstance(block, (Rational, StaticMap)) for block in model.blocks):
            return PlainStepper(model, state)
        return cls(model, state, tables)

    def _advance(self) -> None:
        take(
            self._taps,
            self._past,
            self._steps,
            self._offsets,
            self._blocks,
            self._tables,
            self._states,
            self._u,
            self._y,
        )

    @property
    def blocks(self) -> Blocks:
        """The blocks as numbers."""
        return self._blocks

    @property
    def tables(self) -> Tables:
        """The static maps as numbers."""
        return self._tables

    @property
    def numbers(self) -> tuple[Array, Array, Array, Array]:
        """Taps of the input, offsets of input and output, past inputs, states of the blocks."""
        return self._taps, self._offsets, self._past.copy(), self._states.copy()

    @property
    def state(self) -> CascadeState:
        """The present state."""
        return CascadeState(self._past[1:].copy(), self._states.copy())


def blocks_of(cascade: Cascade) -> Blocks:
    """The blocks of a cascade of filters and static maps."""
    maps, first = np.full(len(cascade.blocks), -1), np.zeros(len(cascade.blocks) + 1, dtype=np.int64)
    above: list[Array] = []
    below: list[Array] = []
    count = 0
    for k, block in enumerate(cascade.blocks):
        first[k + 1] = first[k] + block.states
        b = a = np.zeros(block.states + 1)
        if isinstance(block, Rational):
            b, a = block.transfer
        else:
            maps[k], count = count, count + 1
        above.append(b)
        below.append(a)
    return Blocks(maps, first, np.concatenate(above), np.concatenate(below))


@njit(nogil=True)
def take(
    taps: Array,
    past: Array,
    steps: Array,
    offsets: Array,
    blocks: Blocks,
    tables: Tables,
    states: Array,
    u: Array,
    y: Array,
) -> None:
    """Write the output of one sample into y (1,), and leave the states after it."""
    maps, first, above, below = blocks
    enter(taps, past, u[0], steps)
    for step in range(len(steps)):
        x = steps[step] - offsets[0]
        for k in range(len(maps)):
            if maps[k] >= 0:
                x = value_at(tables, maps[k], x)
                continue
            s, c, n = first[k], first[k] + k, first[k + 1] - first[k]
            out = above[c] * x + (states[s] if n else 0.0)
            for j in range(n):
                following = states[s + j + 1] if j + 1 < n else 0.0
                states[s + j] = following + above[c + j + 1] * x - below[c + j + 1] * out
            x = out
        if step == 0:
            y[0] = x + offsets[1]
