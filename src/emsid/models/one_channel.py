"""Records for models with one input and one output, such as cascades and feedback models."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.models.free_run import RunMethods, check_sample_time
from emsid.models.model import Model, levels
from emsid.record import Record

Array = NDArray[np.float64]
Segments = Sequence[tuple[Array, Array]]
"""(u, y) of every segment."""


class Adjustable(Protocol):
    """A model whose parameters can be given other values."""

    @property
    def names(self) -> tuple[str, ...]:
        """(p,) a name for every parameter."""
        ...

    @property
    def parameters(self) -> Array:
        """(p,) their values."""
        ...

    def with_parameters(self, theta: Array, /) -> Self:
        """The same model with other parameters (p,), unchecked."""
        ...

    def check(self) -> None:
        """Refuse parameters of a model that cannot be run."""
        ...


Adjusted = TypeVar("Adjusted", bound=Adjustable)


class OneChannelMethods(RunMethods):
    """The methods of `RunMethods`, and `advance`, `check_record` and `with_estimates`, for one input and one output."""

    def advance(self: Model, state: Any, u: ArrayLike) -> tuple[Array, Any]:
        """The output (1,) for the input of one sample, `latency` samples late, and the state after it."""
        outputs, state = self.run(state, levels(self.name, u, 1)[None, :])
        return outputs[0], state

    def check_record(self: Model, record: Record) -> None:
        """Refuse a record that has not one input and one output; the output may be missing.

        Raises:
            ModelError: with the channels to choose from.
        """
        check_one_channel(self.name, record, outputs=(0, 1))

    def parameter_values(self: Adjustable) -> dict[str, float]:
        """The value of every parameter by name."""
        return dict(zip(self.names, self.parameters.tolist(), strict=True))

    def with_estimates(self: Adjusted, names: Sequence[str], values: Array) -> Adjusted:
        """The same model with other values of some parameters, by name.

        Raises:
            Infeasible: for parameters of a model that cannot be run.
        """
        theta = self.parameters.copy()
        theta[[self.names.index(name) for name in names]] = values
        moved = self.with_parameters(theta)
        moved.check()
        return moved


def check_one_channel(name: str, record: Record, outputs: Sequence[int] = (1,)) -> None:
    """Refuse a record that has not one input and one output.

    Args:
        name: of the model.
        record: a record.
        outputs: the allowed numbers of outputs.

    Raises:
        ModelError: with the channels to choose from.
    """
    for side, names in (("input", record.input_names), ("output", record.output_names)):
        if len(names) not in (outputs if side == "output" else (1,)):
            raise ModelError(
                f"{name} has one {side} and {record.name} {len(names)}; choose one of {', '.join(names) or 'them'}"
            )


def segments_longer_than(samples: int, model: Model, records: Iterable[Record]) -> Segments:
    """(u, y) of every segment with more than this number of samples.

    Args:
        samples: that the start of a run takes.
        model: with one input and one output.
        records: at the sample time of the model.

    Raises:
        ModelError: for records of other channels or another sample time, or if no segment is long enough.
    """
    segments = []
    for record in records:
        check_one_channel(model.name, record)
        check_sample_time(model, record)
        segments += [
            (np.ascontiguousarray(piece.input[:, 0]), np.ascontiguousarray(piece.output[:, 0]))
            for piece in record.segments
            if len(piece) > samples
        ]
    if not segments:
        raise ModelError(
            f"{model.name}: no segment is longer than the {samples} samples that its start takes; give more data or "
            "smaller orders"
        )
    return tuple(segments)
