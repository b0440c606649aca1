"""The curves of a fitted model with their confidence bands, as numbers for a file: what the page draws.

A curve that a model does not have is left out: a static map of a model that does not come to rest, friction of a model
without any. See `emsid.validation.bands` for the meaning of every curve and its band.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.fit import Fit
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.feedback.model import FeedbackModel
from emsid.models.plants.search.diagnostics import Curve, dead_zone_curve, friction_curve
from emsid.models.plants.search.result import GreyBoxFit
from emsid.record import Record
from emsid.validation.bands import (
    POINTS,
    Band,
    frequency_response_band,
    friction_band,
    static_map_band,
    step_response_band,
    usual_step,
)
from emsid.validation.feedback_curves import visited_in_free_run
from emsid.validation.map_bands import map_band

Array = NDArray[np.float64]
Quantity = tuple[str, str]
"""A name and a unit."""
LEVEL = 0.95
"""Of all bands."""


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
        arrays = {name: _six_digits(getattr(self, name)) for name in ("x", "value", "low", "high")}
        return vars(self) | arrays


def curves(fit: Fit[Any], record: Record) -> tuple[BandedCurve, ...]:
    """Step and frequency responses of all channels, static map, friction and dead zone, as far as the model has them.

    Args:
        fit: of any kind of model.
        record: with its sample time, channels and ranges.
    """
    found: list[BandedCurve] = []
    for view in _views(fit, record):
        with suppress(EmsidError):
            found += view()
    return tuple(found)


def _views(fit: Fit[Any], record: Record) -> Iterator[Callable[[], list[BandedCurve]]]:
    inputs, outputs = range(record.input.shape[1]), range(record.output.shape[1])
    for k in inputs:
        yield partial(_step, fit, record, k)
    for i, k in product(outputs, inputs):
        yield partial(_frequency, fit, record, i, k)
    if isinstance(fit, GreyBoxFit):
        yield partial(_of_plant, fit, record)
    else:
        yield partial(_static_map, fit, record)
        yield partial(_friction, fit, record)
    if isinstance(fit.model, FeedbackModel):
        yield partial(_in_feedback, fit, record)


def _step(fit: Fit[Any], record: Record, input: int) -> list[BandedCurve]:
    band = step_response_band(fit, record, input=input)
    make = partial(_banded, fit, record, "step response", band, ("time", "s"), input=input)
    return [make(_output(record, k), output=k, column=k) for k in range(band.value.shape[1])]


def _frequency(fit: Fit[Any], record: Record, output: int, input: int) -> list[BandedCurve]:
    around = usual_step(record.input[:, input])[1]
    both = frequency_response_band(fit, record.dt, output=output, input=input, around=around)
    return [
        _banded(fit, record, kind, band, ("frequency", "Hz"), (kind, unit), input=input, output=output)
        for kind, band, unit in (("magnitude", both.magnitude, "dB"), ("phase", both.phase, "deg"))
    ]


def _static_map(fit: Fit[Any], record: Record) -> list[BandedCurve]:
    make = partial(_banded, fit, record, "static map")
    if not isinstance(fit.model, Cascade):
        return [make(static_map_band(fit, record), _input(record, 0), _output(record, 0))]
    maps = sum(isinstance(block, StaticMap) for block in fit.model.blocks)
    which = [f"map {k + 1}" for k in range(maps)] if maps > 1 else ["the map"]
    return [  # a cascade has no units between its blocks
        make(static_map_band(fit, record, map=k), (f"input of {each}", ""), (f"output of {each}", ""))
        for k, each in enumerate(which)
    ]


def _friction(fit: Fit[Any], record: Record) -> list[BandedCurve]:
    return [_banded(fit, record, "friction", friction_band(fit, record), _output(record, 0), _input(record, 0))]


def _in_feedback(fit: Fit[FeedbackModel], record: Record) -> list[BandedCurve]:
    """The maps of a feedback model over their inputs in the record, in the coordinates of the model."""
    model, found = fit.model, []
    seen = visited_in_free_run(model, record).z
    for k, (z, w) in enumerate(zip(model.numbered("z"), model.names_of_outputs, strict=True)):
        x = np.linspace(float(seen[:, k].min()), float(seen[:, k].max()), POINTS)
        found.append(_banded(fit, record, "map in feedback", map_band(fit, record, k, x), (z, ""), (w, "")))
    return found


def _of_plant(fit: GreyBoxFit, record: Record) -> list[BandedCurve]:
    plant, found = fit.model.plant, []
    friction, zone = plant.friction_characteristic(), plant.dead_zone_characteristic()
    through = dead_zone_curve(fit)
    if friction is not None:
        found.append(_of_curve(fit, record, "friction", friction_curve(fit), friction.x, friction.y))
    if zone is not None and through is not None:
        found.append(_of_curve(fit, record, "dead zone", through, zone.x, zone.y))
    return found


def _of_curve(fit: GreyBoxFit, record: Record, kind: str, curve: Curve, x: Quantity, y: Quantity) -> BandedCurve:
    visited = np.flatnonzero(curve.support)
    inside = np.zeros(len(curve.x), dtype=bool)
    if len(visited):
        inside[visited[0] : visited[-1] + 1] = True
    values, low, high = (np.where(inside, each, np.nan) for each in (curve.y, curve.low, curve.high))
    channels = record.input_names[0], record.output_names[0]
    return BandedCurve(fit.model.name, kind, *x, *y, *channels, curve.x, values, low, high, LEVEL)


def _banded(
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
    value, low, high = (each if column is None else each[:, column] for each in (band.value, band.low, band.high))
    channels = record.input_names[input], record.output_names[output]
    return BandedCurve(fit.model.name, kind, *x, *y, *channels, band.x, value, low, high, band.level)


def _input(record: Record, channel: int) -> Quantity:
    return record.input_names[channel], record.input_units[channel]


def _output(record: Record, channel: int) -> Quantity:
    return record.output_names[channel], record.output_units[channel]


def _six_digits(values: Array) -> list[float]:
    return [float(f"{value:.6g}") for value in values.tolist()]
