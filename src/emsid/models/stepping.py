"""A model that runs sample by sample from Python, in a few microseconds each.

`Model.advance` is `Model.run` for one sample: it makes arrays for one number. A `Stepper` keeps the state in arrays
that one compiled call changes in place. Both give the same numbers, and each continues from the other's state.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.models.model import Model

Array = NDArray[np.float64]


class Stepper(ABC):
    """A model between two samples; `emsid.start` makes it.

    Args:
        model: what runs.
        inputs, outputs: how many it has.
    """

    __slots__ = ("_u", "_y", "model")

    def __init__(self, model: Model, inputs: int, outputs: int) -> None:
        self.model, self._u, self._y = model, np.zeros(inputs), np.zeros(outputs)

    @property
    def inputs(self) -> int:
        """How many inputs a step takes."""
        return len(self._u)

    def step(self, u: ArrayLike) -> Any:
        """The output for the input of one sample, after which the model is one sample further.

        A model that interpolates its input needs the next samples; its output is then `Model.latency` samples late.

        Args:
            u: one number, or (nu,) one for each input.

        Returns:
            A number, or (ny,) where there are several outputs.

        Raises:
            ModelError: for something else than numbers, or another number of them.
        """
        try:
            self._u[...] = u
        except (TypeError, ValueError):
            raise ModelError(f"{self.model.name}: an input {u!r}; give {len(self._u)} numbers, or one") from None
        self._advance()
        y = self._y
        return y.item() if len(y) == 1 else y.copy()

    @abstractmethod
    def _advance(self) -> None:
        """Write the output for the input into ``_y``, and change the state."""

    @property
    @abstractmethod
    def state(self) -> Any:
        """The present state, as `Model.run` takes it."""

    def predict(self, inputs: ArrayLike) -> Array:
        """The outputs for inputs that may follow, from the present state, which does not change.

        Args:
            inputs: (N,) or (N, nu) the next inputs.

        Returns:
            (N,), or (N, ny) where there are several outputs.
        """
        u = np.asarray(inputs, dtype=float)
        outputs = self.model.run(self.state, u[:, None] if u.ndim == 1 else u)[0]
        return outputs[:, 0] if len(self._y) == 1 else outputs

    def correct(self, y: ArrayLike) -> None:
        """Take the measured output of the last sample, so that the next step predicts from it.

        Args:
            y: one number, or (ny,) where there are several outputs.

        Raises:
            ModelError: for a model of the input alone, which has no model of its noise, or before the first step.
        """
        raise ModelError(
            f"{self.model.name} has no model of its noise, so a measured output does not change its state; arx, "
            "armax, box-jenkins and state-space have one"
        )


class PlainStepper(Stepper):
    """Any model, by its own `run`: slower, and for models that have Python functions of the user in them."""

    __slots__ = ("_state",)

    def __init__(self, model: Model, state: Any, inputs: int = 1) -> None:
        """
        Args:
            model: what runs.
            state: where it begins.
            inputs: how many it has.
        """
        outputs, _ = model.run(state, np.zeros((1, inputs)))
        super().__init__(model, inputs, outputs.shape[1])
        self._state = state

    def _advance(self) -> None:
        outputs, self._state = self.model.run(self._state, self._u[None, :].copy())
        self._y[:] = outputs[0]

    @property
    def state(self) -> Any:
        """The present state."""
        return self._state
