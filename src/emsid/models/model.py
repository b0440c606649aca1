"""The interface of every model, and the result of a run.

A model is a state machine. Its state at a sample and the inputs from there on determine its outputs. The state is an
argument and a result:

    state = model.at_rest(0.0)                   # or model.initial(segment, samples)
    y, state = model.advance(state, u)           # one sample
    outputs, state = model.run(state, inputs)    # many, compiled

Sample by sample, in blocks and at once give the same numbers. `free_run` defines how a run starts and when it has
diverged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.record import Record

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """The output of a model over a record.

    Attributes:
        output: (N, ny) model output; in the transient of every segment, the measured output.
        counted: (N,) whether the sample is after the transient; only these samples enter errors. A segment that begins
            at rest has no transient.
        diverged_at: the first sample at which the run has diverged, or None. From there to the end of its segment the
            output is NaN.
    """

    output: Array
    counted: NDArray[np.bool_]
    diverged_at: int | None = None

    def __repr__(self) -> str:
        size, outputs = self.output.shape
        ended = "" if self.diverged_at is None else f", diverged at sample {self.diverged_at}"
        return f"Run({size} samples, {outputs} output{'s' * (outputs != 1)}{ended})"


def check_samples(model: str, what: str, samples: int | None, least: int) -> None:
    """Refuse a number of samples that is not whole, or too small."""
    if samples is not None and not (isinstance(samples, int | np.integer) and samples >= least):
        raise ModelError(f"{model}: {what} of {samples}; give a whole number of samples, at least {least}")


def levels(model: str, level: ArrayLike, inputs: int) -> Array:
    """(nu,) constant inputs from one number or one for each input.

    Raises:
        ModelError: for another number of inputs.
    """
    array = np.asarray(level, dtype=float)
    if array.ndim > 1 or (array.ndim == 1 and len(array) != inputs):
        raise ModelError(f"{model}: an input of shape {array.shape} for {inputs} inputs; give one number for each")
    return np.array(np.broadcast_to(array, (inputs,)))


@runtime_checkable
class Model(Protocol):
    """Anything that can be run, compared, saved and reported.

    A model is a value that includes its parameters. ``memory`` is the number of samples of a segment that give its
    initial state; a longer ``transient`` makes it possible to compare several models on the same samples.
    """

    @property
    def name(self) -> str:
        """Its name in tables and files."""
        ...

    @property
    def dt(self) -> float | None:
        """Its sample time in s; None for a model that runs at any sample time."""
        ...

    @property
    def memory(self) -> int:
        """The number of samples of a segment that give its initial state."""
        ...

    @property
    def latency(self) -> int:
        """The delay in samples of the output of `run` and `advance`; zero unless the model interpolates its input,
        which needs the next samples."""
        ...

    def check_record(self, record: Record) -> None:
        """Refuse a record of other channels; its outputs may be missing.

        Raises:
            ModelError, DataError: with the difference.
        """
        ...

    def at_rest(self, level: ArrayLike = 0.0, dt: float | None = None) -> Any:
        """The steady state for a constant input ``level``.

        Args:
            level: one number, or (nu,) one for each input.
            dt: sample time in s, for models that have none of their own.
        """
        ...

    def initial(self, segment: Record, samples: int) -> Any:
        """The state after the first ``samples`` samples of a segment, estimated from their measured outputs.

        Args:
            segment: without a gap; only the first ``samples`` outputs are used, and perhaps more inputs.
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
            transient: samples that start a segment in motion, at least `memory`, which is the default.
            dt: sample time in s of inputs alone, for models that have none of their own.
        """
        ...

    def predict(self, record: Record, horizon: int = 1, transient: int | None = None) -> Run:
        """The output ``horizon`` samples ahead of the last measured output that is used."""
        ...

    def equation(self) -> str:
        """The model as text, with numbers."""
        ...

    def to_data(self) -> dict[str, Any]:
        """Everything that `from_data` needs, in built-in types."""
        ...

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The model described by `to_data`.

        Raises:
            ModelError: for data that do not describe a model.
        """
        ...
