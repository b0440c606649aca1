r"""Confidence bands of what a fitted model does: its free run, step response, frequency response, maps and friction.

The estimate has the covariance of its fit, which allows for coloured residuals and model error; `emsid.models.bands`
takes it to a curve.

The bands are about the parameters: with another record of the same length, the curve would lie there. Noise, and what
the structure lacks, come on top. Parameters that the data do not determine are kept. A fit without intervals, of a
biased regression or of a search that did not end at a minimum, has curves without a band: their standard errors are
NaN.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 9.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.models.bands import Band as Band
from emsid.models.bands import banded, with_error
from emsid.models.characteristics import check_channel
from emsid.models.kinds import capabilities_of
from emsid.models.model import Model
from emsid.record import Record
from emsid.validation.responses import BodeCurve

Array = NDArray[np.float64]

FREQUENCIES, DECADES = 300, 3.0
"""Points of a frequency response, and the decades that it covers."""
LONGEST = 5_000
"""Samples of a step response."""
SETTLED = 0.01
"""A step response is shown until it stays within this share of its end, and half as long again."""


def free_run_band(fit: Fit[Any], record: Record, *, level: float = 0.95, transient: int | None = None) -> Band:
    """The free run over a record; x is its time in s, NaN stands before the end of a transient.

    Args:
        fit: of a model with a covariance.
        record: with the channels of the model.
        level: of the band.
        transient: see `emsid.validation.validate`.

    Raises:
        ModelError: for a record that the model cannot be run on, or a model whose parameters cannot be moved.
    """

    def curve(model: Model) -> Array:
        run = model.simulate(record, transient)
        return np.where(run.counted[:, None], run.output, np.nan)

    time = np.concatenate([segment.time for segment in record.segments])
    exact = capabilities_of(fit.model).free_run_error(fit, record, transient) if fit.has_bands else None
    if exact is not None:
        return Band(time, curve(fit.model), exact, level)
    return banded(fit, curve, time, level)


@np.errstate(all="ignore")  # of a run that diverges
def step_response_band(
    fit: Fit[Any],
    record: Record,
    *,
    size: float | None = None,
    start: float | None = None,
    input: int = 0,
    level: float = 0.95,
) -> Band:
    """The response of every output to a step of one input from rest, over time in s.

    Args:
        fit: of a model with a covariance.
        record: whose sample time and ranges of the inputs are taken.
        size: of the step; by default up to the 90 % quantile of the input in this record.
        start: the input before the step; by default zero where the input of the record goes there, otherwise its 10 %
            quantile.
        input: which input steps, from 0; all others stay at zero where they go there, otherwise at their mean.
        level: of the band.

    Raises:
        ModelError: for an input that the record does not have, a plant with several inputs, or a model whose parameters
            cannot be moved.
    """
    check_channel(fit.model, "input", input, record.input.shape[1])
    if record.input.shape[1] > 1 and not capabilities_of(fit.model).takes_all_inputs:
        raise ModelError(f"{fit.model.name}: its second input is no command, so it has no step response")
    u, dt = record.input[:, input], record.dt
    before, after = usual_step(u)
    before = before if start is None else start
    height = after - before if size is None else size
    rest = np.array([0.0 if x.min() <= 0.0 <= x.max() else x.mean() for x in record.input.T])
    rest[input] = before
    stepped = rest + height * (np.arange(len(rest)) == input)

    def response(model: Model, samples: int) -> Array:
        late = model.latency
        state = model.at_rest(rest, dt)
        if rest.any():
            state = model.run(state, np.tile(rest, (samples, 1)))[1]
        return model.run(state, np.tile(stepped, (samples + late, 1)))[0][late:]

    nominal = response(fit.model, min(len(record), LONGEST))
    samples = _until_settled(nominal)
    return banded(fit, lambda model: response(model, samples), dt * np.arange(samples, dtype=float), level)


def usual_step(u: Array) -> tuple[float, float]:
    """The levels before and after a step that suits an input (N,): from zero, if it goes there, to a 90 % quantile.

    Otherwise it is from the 10 % to the 90 % quantile. A step from zero is downwards only where the input goes more
    than twice as far down as up.
    """
    low, high = (float(np.quantile(u, share)) for share in (0.1, 0.9))
    if not u.min() <= 0.0 <= u.max():
        return low, high
    return 0.0, high if 2 * abs(high) >= abs(low) else low


def frequency_response_band(
    fit: Fit[Any], dt: float, *, output: int = 0, input: int = 0, around: float = 0.0, level: float = 0.95
) -> BodeCurve:
    """The frequency response of a model, about a constant input.

    It is that of a linear model, of the filters of a cascade in a row, of a plant in motion, or of a nonlinear
    regression or a feedback model that is linearised where it rests at a constant input.

    Args:
        fit: of a regression, a polynomial or state-space model, a cascade, a feedback model or a plant.
        dt: sample time of the record in s; frequencies go up to half the sampling rate.
        output, input: of a model with several, from 0.
        around: the constant input about which a model is linearised.
        level: of the bands.

    Raises:
        ModelError: for a model without a frequency response, without these channels, or that does not rest there.
    """
    top = 0.5 / dt
    f, kind = np.geomspace(top / 10**DECADES, top, FREQUENCIES), capabilities_of(fit.model)

    def logarithm(model: Any) -> Array:
        return _log_parts(np.asarray(np.log(kind.frequency_response(model, f, dt, output, input, around))))

    value, spread = with_error(fit, logarithm)
    to_db, to_degrees = 20 / np.log(10), 180 / np.pi
    return BodeCurve(
        Band(f, to_db * value[:, 0], to_db * spread[:, 0], level),
        Band(f, to_degrees * value[:, 1], to_degrees * spread[:, 1], level),
        fit.model_name,
    )


def static_map_band(fit: Fit[Any], record: Record, *, map: int = 0, level: float = 0.95) -> Band:
    """The static map of a model over its input.

    Of a cascade it is one of its static maps, over the signal that enters it in the record. Of other models it is the
    output at rest over a constant input; of a regression without products of input and output, from all terms but those
    that are nonlinear in past outputs (friction).

    Args:
        fit: of a model of one input and one output; not of a plant, whose drive and friction have curves of their own.
        record: with the inputs to show.
        map: which static map of a cascade, from 0.
        level: of the band.

    Raises:
        ModelError: for a model without this static map, or one that does not come to rest at every input.
    """
    return capabilities_of(fit.model).static_map(fit, record, map, level)


def friction_band(fit: Fit[Any], record: Record, *, level: float = 0.95) -> Band:
    """Friction of a regression over the output, as the part of the input that it takes up.

    It is what the terms that are nonlinear in past outputs do at a constant output, divided by the slope of the input
    over its range. `emsid.plants.friction_curve` is that of a plant.

    Args:
        fit: of a regression with such terms.
        record: with the range of input and output.
        level: of the band.

    Raises:
        ModelError: for a model without such terms, or with products of input and output.
    """
    return capabilities_of(fit.model).friction(fit, record, level)


def _until_settled(response: Array) -> int:
    """The samples of a step response to show."""
    end, reach = response[-1], np.max(np.abs(response - response[0]), axis=0)
    away = np.flatnonzero(np.any(np.abs(response - end) > SETTLED * reach, axis=1))
    settled = int(away[-1]) + 2 if len(away) else 2
    return min(len(response), max(20, settled * 3 // 2))


def _log_parts(logarithm: NDArray[np.complex128]) -> Array:
    """(m, 2) log magnitude, and phase without jumps, in rad."""
    return np.column_stack([logarithm.real, np.unwrap(logarithm.imag)])
