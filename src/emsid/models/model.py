"""What every model can do, and what a run of one gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.record import Record

Array = NDArray[np.float64]

# A free run this many times larger than anything measured has left the world that the model describes.
RUNAWAY = 1e3


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


@runtime_checkable
class Model(Protocol):
    """Anything that can be compared, saved and reported.

    A model is a value: its parameters are in it. ``memory`` is how many samples of a segment it needs to start; a
    longer start may be asked for by ``transient``, so that several models are judged on the same samples.
    """

    @property
    def name(self) -> str:
        """What it is called in tables and files."""
        ...

    @property
    def memory(self) -> int:
        """How many samples of every segment start it."""
        ...

    def simulate(self, record: Record, transient: int | None = None) -> Run:
        """Free run: after the start of a segment the model sees inputs only."""
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
