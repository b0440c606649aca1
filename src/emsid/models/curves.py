"""The curves of a fitted model with their confidence bands, as numbers for a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Fit
from emsid.models.bands import Band
from emsid.record import Record

Array = NDArray[np.float64]
Quantity = tuple[str, str]
"""A name and a unit."""


@dataclass(frozen=True, eq=False)
class BandedCurve:
    """A curve of a model with its band.

    Attributes:
        model: its name.
        kind: ``step response``, ``magnitude`` or ``phase`` (of the frequency response), ``static map``, ``map in
            feedback``, ``friction`` or ``dead zone``.
        x_name, x_unit, name, unit: of the two axes; units are empty where they are not known.
        input, output: channels of the record that a response leads from and to.
        x: (m,) values on the first axis.
        value, low, high: (m,) the curve, and the edges of its band; these are NaN for a fit without intervals, and all
            are NaN for friction and dead zone beyond the speeds and commands of the record.
        level: of the band.
    """

    model: str
    kind: str
    x_name: str
    x_unit: str
    name: str
    unit: str
    input: str
    output: str
    x: Array
    value: Array
    low: Array
    high: Array
    level: float

    def to_data(self) -> dict[str, Any]:
        """By name, numbers as lists with six digits."""
        arrays = {name: getattr(self, name).tolist() for name in ("x", "value", "low", "high")}
        return vars(self) | {name: [float(f"{value:.6g}") for value in values] for name, values in arrays.items()}


def banded_curve(
    fit: Fit[Any],
    record: Record,
    kind: str,
    band: Band,
    x: Quantity,
    y: Quantity,
    *,
    input: int = 0,
    output: int = 0,
    column: int | None = None,
) -> BandedCurve:
    """A curve of a model, or one column of several, with its band.

    Args:
        fit: of the model.
        record: whose channels it leads between.
        kind, x, y: see `BandedCurve`.
        band: with the values.
        input, output: the channels.
        column: of the values, where they are those of several outputs.
    """
    value, low, high = (each if column is None else each[:, column] for each in (band.value, band.low, band.high))
    channels = record.input_names[input], record.output_names[output]
    return BandedCurve(fit.model.name, kind, *x, *y, *channels, band.x, value, low, high, band.level)


def input_of(record: Record, channel: int = 0) -> Quantity:
    """Name and unit of an input."""
    return record.input_names[channel], record.input_units[channel]


def output_of(record: Record, channel: int = 0) -> Quantity:
    """Name and unit of an output."""
    return record.output_names[channel], record.output_units[channel]
