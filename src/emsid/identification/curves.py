"""The curves of a fitted model with their confidence bands, as numbers for a file: what the page draws.

A curve that a model does not have is left out: a static map of a model that does not come to rest, friction of a model
without any. See `emsid.validation.bands` for the meaning of every curve and its band.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any

from emsid.estimation.borders import border
from emsid.estimation.fit import Fit
from emsid.models.curves import BandedCurve, banded_curve, output_of
from emsid.models.kinds import capabilities_of
from emsid.record import Record
from emsid.validation.bands import frequency_response_band, step_response_band, usual_step


def curves(fit: Fit[Any], record: Record) -> tuple[BandedCurve, ...]:
    """Step and frequency responses of all channels, static map, friction and dead zone, as far as the model has them.

    Args:
        fit: of any kind of model.
        record: with its sample time, channels and ranges.
    """
    found: list[BandedCurve] = []
    for view in _views(fit, record):
        with border(f"curves of {fit.model.name}", fit.model.name, expected=True):
            found += view()
    return tuple(found)


def _views(fit: Fit[Any], record: Record) -> Iterator[Callable[[], list[BandedCurve]]]:
    inputs, outputs = range(record.input.shape[1]), range(record.output.shape[1])
    for k in inputs:
        yield partial(_step, fit, record, k)
    for i, k in product(outputs, inputs):
        yield partial(_frequency, fit, record, i, k)
    yield from capabilities_of(fit.model).curves(fit, record)


def _step(fit: Fit[Any], record: Record, input: int) -> list[BandedCurve]:
    band = step_response_band(fit, record, input=input)
    make = partial(banded_curve, fit, record, "step response", band, ("time", "s"), input=input)
    return [make(output_of(record, k), output=k, column=k) for k in range(band.value.shape[1])]


def _frequency(fit: Fit[Any], record: Record, output: int, input: int) -> list[BandedCurve]:
    around = usual_step(record.input[:, input])[1]
    both = frequency_response_band(fit, record.dt, output=output, input=input, around=around)
    return [
        banded_curve(fit, record, kind, band, ("frequency", "Hz"), (kind, unit), input=input, output=output)
        for kind, band, unit in (("magnitude", both.magnitude, "dB"), ("phase", both.phase, "deg"))
    ]
