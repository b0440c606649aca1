"""A feedback model sample by sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.estimation.compiled import read_only
from emsid.models.feedback.kernels import LoopSignals, Tables, run, tables_of
from emsid.models.feedback.model import FeedbackModel, FeedbackState
from emsid.models.input_path import InputPath, enter
from emsid.models.stepping import PlainStepper, Stepper

Array = NDArray[np.float64]


class FeedbackStepper(Stepper):
    """A linear system with static maps in its feedback."""

    __slots__ = ("_numbers", "_past", "_signals", "_steps", "_tables", "_taps", "_x")

    def __init__(self, model: FeedbackModel, state: FeedbackState, tables: Tables) -> None:
        """
        Args:
            model: what runs.
            state: where it begins.
            tables: of its static maps.
        """
        super().__init__(model, 1, 1)
        path = InputPath(model.delay, model.oversampling, model.held)
        offsets = np.append(model.map_offsets, model.output_offset)
        self._numbers = (read_only(model.matrix), read_only(offsets), read_only(model.factors))
        self._tables, self._taps = tables, path.taps
        self._past, self._x = np.append(0.0, state.inputs), np.array(state.x, dtype=float)
        self._steps = np.empty(path.rate)
        self._signals = LoopSignals.empty(path.rate, model.states, len(model.maps))

    @classmethod
    def of(cls, model: FeedbackModel, state: FeedbackState) -> Stepper:
        """The stepper of a feedback model; a plain one where a map is a function of the user."""
        tables = tables_of(model.maps)
        return PlainStepper(model, state) if tables is None else cls(model, state, tables)

    def _advance(self) -> None:
        take(
            *self._numbers, self._tables, self._taps, self._past, self._steps, self._x, self._signals, self._u, self._y
        )

    @property
    def tables(self) -> Tables:
        """The static maps as numbers."""
        return self._tables

    @property
    def numbers(self) -> tuple[tuple[Array, Array, Array], Array, Array, Array]:
        """Matrix, offsets and factors; taps of the input; past inputs; the linear state."""
        return self._numbers, self._taps, self._past.copy(), self._x.copy()

    @property
    def state(self) -> FeedbackState:
        """The present state."""
        return FeedbackState(self._past[1:].copy(), self._x.copy())


@njit(nogil=True)
def take(
    matrix: Array,
    offsets: Array,
    factors: Array,
    tables: Tables,
    taps: Array,
    past: Array,
    steps: Array,
    x: Array,
    signals: LoopSignals,
    u: Array,
    y: Array,
) -> None:
    """Write the output of one sample into y (1,), and leave the state after it; NaN where it is not finite."""
    enter(taps, past, u[0], steps)
    reached = run(matrix, offsets, factors, tables, steps, x, signals)
    y[0] = signals.y[0] if reached > 0 else np.nan
