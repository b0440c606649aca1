"""Linear models that run as a model in state space."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.models.free_run import RunMethods
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.linear.system import LinearSystem
from emsid.record import Record

Array = NDArray[np.float64]


class ThroughStateSpace(RunMethods, ABC):
    """A model whose runs, states and response are those of its `form`."""

    @property
    @abstractmethod
    def form(self) -> StateSpaceModel:
        """The same in state space."""

    @property
    def memory(self) -> int:
        """The number of samples of a segment that give its initial state."""
        return self.form.memory

    @property
    def latency(self) -> int:
        """Zero: the model does not interpolate its input."""
        return 0

    def check_record(self, record: Record) -> None:
        """Refuse a record of other channels; its outputs may be missing.

        Raises:
            ModelError: with the difference.
        """
        self.form.check_record(record)

    def at_rest(self, level: ArrayLike = 0.0, dt: float | None = None) -> Array:
        """The steady state for a constant input; zero for a model without one, such as an integrator."""
        return self.form.at_rest(level, dt)

    def initial(self, segment: Record, samples: int) -> Array:
        """The state after these samples, by least squares on their outputs, with the noise model if there is one."""
        return self.form.initial(segment, samples)

    def run(self, state: Array, inputs: Array) -> tuple[Array, Array]:
        """The outputs (N, 1) for inputs (N, nu), and the state after them."""
        return self.form.run(state, inputs)

    def advance(self, state: Array, u: ArrayLike) -> tuple[Array, Array]:
        """The output (1,) for the input (nu,) of one sample, and the state after it."""
        return self.form.advance(state, u)

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """(F, 1, nu) the frequency response from the inputs at frequencies (F,) in Hz."""
        return self.form.response(frequency)


def as_form(part: LinearSystem, level: float, start: int) -> StateSpaceModel:
    """A system of one output in discrete time as a model without noise, with its dead time as states.

    Args:
        part: in discrete time.
        level: the output at an input of zero.
        start: samples of a segment that give the initial state.
    """
    whole = part.with_past_inputs()
    none = np.zeros((len(whole.a), 1))
    return StateSpaceModel(
        whole.a, whole.b, whole.c, whole.d, none, np.array([level]), whole.dt or 1.0, start=start, name=part.name
    )
