"""Linear models sample by sample: a state-space model, and with it a model in polynomials.

With the innovation e = y − ŷ of the last sample, `correct` adds K·e to the state: the prediction of the innovations
form.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.models.linear.state_space import StateSpaceModel, run_in_place
from emsid.models.stepping import Stepper

Array = NDArray[np.float64]


class LinearStepper(Stepper):
    """A linear model in state space."""

    __slots__ = ("_begun", "_form", "_input", "_level", "_matrices", "_output", "_x")

    def __init__(self, model: Any, state: Array) -> None:
        """
        Args:
            model: a `StateSpaceModel`, or one with such a ``form``.
            state: (n,) where it begins.
        """
        form = model if isinstance(model, StateSpaceModel) else model.form
        super().__init__(model, form.b.shape[1], len(form.level))
        self._form = form
        self._matrices = (read_only(form.a), read_only(form.b), read_only(form.c), read_only(form.d))
        self._x, self._level, self._begun = np.array(state, dtype=float), form.level, False
        self._input, self._output = read_only(self._u[None, :]), self._y[None, :]

    def _advance(self) -> None:
        run_in_place(*self._matrices, self._x, self._input, self._output)
        self._y += self._level
        self._begun = True

    @property
    def form(self) -> StateSpaceModel:
        """The model in state space."""
        return self._form

    @property
    def state(self) -> Array:
        """(n,) the present state."""
        return self._x.copy()

    def correct(self, y: ArrayLike) -> None:
        """Take the measured output of the last sample; see `Stepper.correct`."""
        if not self._begun:
            raise ModelError(f"{self.model.name}: correct takes the output of the last step; call step first")
        if not self._form.k.any():
            super().correct(y)
        self._x += self._form.k @ (np.broadcast_to(np.asarray(y, dtype=float), self._y.shape) - self._y)
        self._begun = False  # an output is taken once
