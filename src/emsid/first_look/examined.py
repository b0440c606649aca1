"""What the checks of a record share: its first input and output, and a linear model of them, all without outliers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from emsid.first_look.baseline import Baseline, baseline
from emsid.first_look.drift import Drift, drift_of
from emsid.first_look.dynamics import Response
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.first_look.outliers import without_outliers
from emsid.first_look.standstill import at_rest, near_zero
from emsid.record import Record

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Examined:
    """The first input and output of a record, and a linear model of them.

    Attributes:
        measured: with an output.
        response: of its first output to its first input.
        tolerance: singular values of the lagged input below this share of the largest are no excitation.
    """

    measured: Record
    response: Response
    tolerance: float

    @cached_property
    def record(self) -> Record:
        """What was measured, without outliers of the first output: a few of them hide everything else."""
        return without_outliers(self.measured)

    @property
    def u(self) -> Array:
        """(N,) the first input."""
        return self.record.input[:, 0]

    @property
    def y(self) -> Array:
        """(N,) the first output."""
        return self.record.output[:, 0]

    @property
    def input(self) -> str:
        """The name of the first input."""
        return self.record.input_names[0]

    @property
    def output(self) -> str:
        """The name of the first output."""
        return self.record.output_names[0]

    @cached_property
    def drift(self) -> Drift | None:
        """The drift of the first output, if it has one; a position keeps every disturbance, and drifts anyway."""
        return None if is_position(self.record) else drift_of(self.record, self.linear, self.linear_without_trend)

    @property
    def still(self) -> Array:
        """(N,) the first output less what it drifts to at rest."""
        return self.y if self.drift is None else self.y - self.drift.at_rest

    @cached_property
    def near_zero(self) -> NDArray[np.bool_]:
        """(N,) whether the output is close to zero: at rest, or passing through."""
        return near_zero(self.still)

    @cached_property
    def resting(self) -> NDArray[np.bool_]:
        """(N,) whether the output is at rest."""
        return at_rest(self.still)

    @cached_property
    def linear(self) -> Baseline | None:
        """A linear model of the first output, where there is one."""
        return baseline(self.record, self.response.delay)

    @cached_property
    def linear_without_trend(self) -> Baseline | None:
        """The same of the record without its trends, which a slow pole would follow."""
        return baseline(self.record.detrend(1), self.response.delay)

    @property
    def delay(self) -> int | None:
        """Samples from the input to its first effect: as the response shows it, or fewer in the linear model."""
        shown = self.response.delay
        return shown if shown is None or self.linear is None else min(shown, self.linear.delay)


def units_of(record: Record) -> dict[str, str]:
    """The unit of every channel by its name; a column such as ``speed (RPM)`` may be in another one."""
    return dict(zip(record.input_names + record.output_names, record.input_units + record.output_units, strict=True))


def is_position(record: Record) -> bool:
    """Whether the first output is a position, by its name and unit; of a name such as ``y``, by its unit."""
    unit = next(iter(record.output_units), "")
    said = meaning(record.output_names[0], unit).quantity
    return (meaning("", unit).quantity if said is ColumnQuantity.OUTPUT else said) is ColumnQuantity.POSITION
