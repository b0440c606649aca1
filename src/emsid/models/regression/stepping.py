"""A regression sample by sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.models.regression.narx import Narx
from emsid.models.regression.recursion import Recursion, advance_one, recursion
from emsid.models.stepping import Stepper

Array = NDArray[np.float64]


class RegressionStepper(Stepper):
    """A regression: its state is its last outputs and inputs.

    A measured output takes the place of the computed one, so that the next step is the prediction one sample ahead.
    """

    __slots__ = ("_begun", "_coefficient", "_past_u", "_past_y", "_recursion")

    def __init__(self, model: Narx, state: Array) -> None:
        """
        Args:
            model: what runs.
            state: (memory, 1 + nu) where it begins; see `Narx.at_rest`.
        """
        super().__init__(model, model.structure.inputs, 1)
        memory = model.structure.memory
        self._recursion = recursion(model.structure.regressors, model.parameters)
        self._past_y, self._past_u = np.zeros(memory + 1), np.zeros((model.structure.inputs, memory + 1))
        self._past_y[1:], self._past_u[:, 1:] = state[:, 0], state[:, 1:].T
        self._coefficient = np.empty((2 + len(self._recursion.lags) + len(self._recursion.outputs.signs), 1))
        self._begun = False

    def _advance(self) -> None:
        take(self._past_y, self._past_u, self._recursion, self._coefficient, self._u, self._y)
        self._begun = True

    @property
    def state(self) -> Array:
        """(memory, 1 + nu) the last outputs and inputs, the newest last."""
        return np.column_stack([self._past_y[1:], self._past_u[:, 1:].T])

    def correct(self, y: ArrayLike) -> None:
        """Take the measured output of the last sample; see `Stepper.correct`."""
        if not self._begun:
            raise ModelError(f"{self.model.name}: correct takes the output of the last step; call step first")
        self._past_y[-1] = np.asarray(y, dtype=float).item()


@njit(nogil=True)
def take(past_y: Array, past_u: Array, model: Recursion, coefficient: Array, u: Array, y: Array) -> None:
    """Move outputs (memory + 1,) and inputs (nu, memory + 1) by one sample, and write its output into y (1,)."""
    memory = len(past_y) - 1
    for i in range(memory):
        past_y[i] = past_y[i + 1]
        for k in range(len(u)):
            past_u[k, i] = past_u[k, i + 1]
    for k in range(len(u)):
        past_u[k, memory] = u[k]
    advance_one(past_y, past_u, model, coefficient, memory)
    y[0] = past_y[memory]
