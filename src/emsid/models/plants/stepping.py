"""A grey box sample by sample, by the sampler of its plant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.plant import Sampler
from emsid.models.plants.state import PlantState
from emsid.models.stepping import PlainStepper, Stepper

Array = NDArray[np.float64]


class PlantStepper(Stepper):
    """A plant with drive and sensor, or of a user whose functions can be compiled."""

    __slots__ = ("_sampler",)

    def __init__(self, model: GreyBox, sampler: Sampler, inputs: int) -> None:
        """
        Args:
            model: what runs.
            sampler: of its plant.
            inputs: how many it has.
        """
        super().__init__(model, inputs, len(model.signals))
        self._sampler = sampler

    @classmethod
    def of(cls, model: GreyBox, state: PlantState, inputs: int) -> Stepper:
        """The stepper of a grey box; a plain one where its plant is a function that cannot be compiled."""
        sampler = model.plant.sampler(state, model.signals)
        return PlainStepper(model, state, inputs) if sampler is None else cls(model, sampler, inputs)

    @property
    def sampler(self) -> Sampler:
        """The plant between two samples."""
        return self._sampler

    def _advance(self) -> None:
        self._sampler.advance(self._u, self._y)

    @property
    def state(self) -> PlantState:
        """The present state."""
        return self._sampler.state
