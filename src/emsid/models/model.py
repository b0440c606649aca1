"""What every model can do, and what a run of one gives.

A model is a state machine. Its state says all that its outputs from one sample on depend on besides the inputs from
there on; it is a value that goes in and comes out:

    state = model.at_rest(0.0)                   # or model.initial(segment, samples)
    y, state = model.advance(state, u)           # one sample
    outputs, state = model.run(state, inputs)    # many, compiled

Sample by sample, in blocks and at once are the same numbers. What begins a run, and when one has diverged, is said in
`free_run` and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.record import Record

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Run:
    """The output of a model over a record.

    Attributes:
        output: (N, ny) model output; over the start of every segment, the measured output that started it.
        counted: (N,) whether the sample belongs to the run and not to the start of a segment; errors are taken there.
        diverged_at: the first sample at which the run had left all bounds, None for a run that stayed within. From
            there to the end of its segment the output is NaN.
    """

    output: Array
    counted: NDArray[np.bool_]
    diverged_at: int | None = None


def check_samples(model: str, what: str, samples: int | None, least: int) -> None:
    """Refuse what is no whole number of samples, or too few of them."""
    if samples is not None and not (isinstance(samples, int | np.integer) and samples >= least):
        raise ModelError(f"{model}: {what} of {samples}; give a whole number of samples, at least {least}")


def levels(model: str, level: ArrayLike, inputs: int) -> Array:
    """(nu,) constant inputs from one number or one for each input.

    Raises:
        ModelError: for another number of them.
    """
    array = np.asarray(level, dtype=float)
    if array.ndim > 1 or (array.ndim == 1 and len(array) != inputs):
        raise ModelError(f"{model}: an input of shape {array.shape} for {inputs} inputs; give one number for each")
    return np.array(np.broadcast_to(array, (inputs,)))


@runtime_checkable
class Model(Protocol):
    """Anything that can be run, compared, saved and reported.

    A model is a value: its parameters are in it. ``memory`` is how many samples of a segment it needs to start; a
    longer start may be asked for by ``transient``, so that several models are judged on the same samples.
    """

    @property
    def name(self) -> str:
        """What it is called in tables and files."""
        ...

    @property
    def dt(self) -> float | None:
        """The sample time that it is for, in s; None for a model that runs at any."""
        ...

    @property
    def memory(self) -> int:
        """How many samples of every segment start it."""
        ...

    @property
    def latency(self) -> int:
        """By how many samples the output of `run` and `advance` is behind their input; zero but where a model
        interpolates its input between samples, for which it has to see the next ones."""
        ...

    def check_record(self, record: Record) -> None:
        """Refuse a record of other channels; its outputs may be missing.

        Raises:
            ModelError, DataError: saying what is different.
        """
        ...

    def at_rest(self, level: ArrayLike = 0.0, dt: float | None = None) -> Any:
        """The state at rest, where a constant input ``level`` has stood for ever.

        Args:
            level: one number, or (nu,) one for each input.
            dt: sample time in s, for models that have none of their own.
        """
        ...

    def initial(self, segment: Record, samples: int) -> Any:
        """The state after the first ``samples`` samples of a segment, as their measured outputs suggest it.

        Args:
            segment: without a gap; of the outputs only the first ``samples`` are used, of the inputs perhaps more.
            samples: at least `memory`.
        """
        ...

    def run(self, state: Any, inputs: Array) -> tuple[Array, Any]:
        """The outputs (N, ny) for inputs (N, nu), and the state after them; see `latency`."""
        ...

    def advance(self, state: Any, u: ArrayLike) -> tuple[Array, Any]:
        """The output (ny,) for the input (nu,) of one sample, and the state after it: `run` for one sample."""
        ...

    def ahead(self, segment: Record, samples: int, horizon: int) -> Array:
        """(N − samples, ny) ŷ(t | t − horizon) from the sample ``samples`` of a segment on."""
        ...

    def simulate(self, record: Record | ArrayLike, transient: int | None = None, *, dt: float | None = None) -> Run:
        """Free run: after the start of a segment the model sees inputs only; see `emsid.models.free_run.free_run`.

        Args:
            record: a record, or inputs (N,) or (N, nu) alone.
            transient: samples of every segment that start it, at least `memory`, which is the default.
            dt: sample time in s of inputs alone, for models that have none of their own.
        """
        ...

    def predict(self, record: Record, horizon: int = 1, transient: int | None = None) -> Run:
        """The output ``horizon`` samples ahead of the measured outputs it may use."""
        ...

    def equation(self) -> str:
        """The model as text, with numbers."""
        ...

    def to_data(self) -> dict[str, Any]:
        """Everything that `from_data` needs, in built-in types."""
        ...

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The model that `to_data` described.

        Raises:
            ModelError: for data that describe no model.
        """
        ...
