r"""Confidence bands of what a fitted model does: its free run, step response, frequency response, maps and friction.

The estimate has the covariance P of its fit, which allows for coloured residuals and model error. With P = L·Lᵀ, a
curve c(θ) changes by δⱼ = ½[c(θ + Lⱼ) − c(θ − Lⱼ)] over a standard error in the direction of column Lⱼ, and its
variance is Σ δⱼ². For a curve that is linear in θ this is the delta method; otherwise the finite steps average its
slope over the interval (the sigma points of Julier and Uhlmann). Where one side cannot be run, the other one counts;
where neither can, the step is shortened. Of feedback models the steps are small (`FIRST_ORDER`).

The bands are about the parameters: with another record of the same length, the curve would lie there. Noise, and what
the structure lacks, come on top. Parameters that the data do not determine are kept. A fit without intervals, of a
biased regression or of a search that did not end at a minimum, has curves without a band: their standard errors are
NaN.

References:
    Julier, Uhlmann, *Unscented filtering and nonlinear estimation*, Proceedings of the IEEE 92 (2004). Ljung, *System
    Identification*, 2nd ed. (1999), sec. 9.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.fitting import static_band
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.feedback.model import FeedbackModel
from emsid.models.model import Model
from emsid.models.plants.grey_box import GreyBox
from emsid.models.regression.narx import Narx
from emsid.models.regression.regressors import Regressor
from emsid.record import Record
from emsid.record.frames import frame
from emsid.validation.feedback_curves import feedback_at_rest, feedback_run_error
from emsid.validation.frequency_responses import check_channel, frequency_response, output_at_rest

Array = NDArray[np.float64]
Curve = Callable[[Any], NDArray[Any]]

NEGLIGIBLE = 1e-12
"""Directions of the scaled covariance with a smaller share of the largest variance are rounding."""
SHORTER = (1.0, 0.125, 0.015625)
"""Steps that are tried, in standard errors."""
FIRST_ORDER = (0.01, 0.001)
"""The same for feedback models. Elements of their matrices may be known badly where what the model does is known well,
so that it is bent over a step of one standard error."""
POINTS, FREQUENCIES, DECADES = 201, 300, 3.0
"""Points of a map, points of a frequency response, and the decades that it covers."""
AT_REST = 41
"""Points of a map of which each takes a run to rest."""
LONGEST = 5_000
"""Samples of a step response."""
SETTLED = 0.01
"""A step response is shown until it stays within this share of its end, and half as long again."""


@dataclass(frozen=True, eq=False)
class Band:
    """A curve with its confidence band.

    Attributes:
        x: (m,) time in s, frequency in Hz, or the input of a map.
        value: (m,) or (m, ny) the curve.
        standard_error: of the same shape, to first order; NaN where the fit has no intervals.
        level: of the band.
    """

    x: Array
    value: Array
    standard_error: Array
    level: float

    @property
    def known(self) -> bool:
        """Whether there is a band, or only a curve."""
        return bool(np.isfinite(self.standard_error).any())

    @property
    def half(self) -> Array:
        """Half the width of the band."""
        from scipy.special import ndtri

        return float(ndtri(0.5 + self.level / 2)) * self.standard_error

    @property
    def low(self) -> Array:
        """The lower edge."""
        return self.value - self.half

    @property
    def high(self) -> Array:
        """The upper edge."""
        return self.value + self.half

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with ``x``, ``value``, ``low`` and ``high``; of several outputs, these are numbered.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        columns = {"x": self.x}
        for name, values in (("value", self.value), ("low", self.low), ("high", self.high)):
            each = values[:, None] if values.ndim == 1 else values
            columns |= {name if each.shape[1] == 1 else f"{name}_{k + 1}": column for k, column in enumerate(each.T)}
        return frame(columns, library)


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """A frequency response with bands.

    Attributes:
        magnitude: in dB over Hz.
        phase: in degrees over Hz.
    """

    magnitude: Band
    phase: Band


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
    # The derivatives of a feedback model are exact, and its start takes a search.
    if isinstance(fit.model, FeedbackModel) and fit.has_bands:
        return Band(time, curve(fit.model), feedback_run_error(fit, record, transient), level)
    return _band(fit, curve, time, level)


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
    if record.input.shape[1] > 1 and isinstance(fit.model, GreyBox):
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
    return _band(fit, lambda model: response(model, samples), dt * np.arange(samples, dtype=float), level)


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
) -> FrequencyResponse:
    """The frequency response of a model, see `emsid.validation.frequency_responses`.

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
    f = np.geomspace(top / 10**DECADES, top, FREQUENCIES)

    def logarithm(model: Any) -> NDArray[np.complex128]:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.log(frequency_response(model, f, dt, output=output, input=input, around=around)))

    value, spread = with_error(fit, lambda model: _log_parts(logarithm(model)))
    to_db, to_degrees = 20 / np.log(10), 180 / np.pi
    return FrequencyResponse(
        Band(f, to_db * value[:, 0], to_db * spread[:, 0], level),
        Band(f, to_degrees * value[:, 1], to_degrees * spread[:, 1], level),
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
    model = fit.model
    if isinstance(model, Cascade):
        found = [k for k, block in enumerate(model.blocks) if isinstance(block, StaticMap)]
        if not 0 <= map < len(found):
            raise ModelError(f"{model.name} has no static map {map}; it has {len(found)}, counted from 0")
        k = found[map]
        u = [segment.input[:, 0] for segment in record.segments]
        entering = np.concatenate([model.signals_from_rest(each)[k] for each in u])
        x = np.linspace(float(entering.min()), float(entering.max()), POINTS)
        value, error = static_band(fit, k, x).T
        return Band(x, value, error if fit.has_bands else np.full(len(x), np.nan), level)
    low, high = float(record.input.min()), float(record.input.max())
    if isinstance(model, GreyBox):
        raise ModelError(f"{model.name} is a plant; it has curves of its drive and of its friction")
    if record.input.shape[1] * record.output.shape[1] > 1:
        raise ModelError(f"{model.name} has several inputs or outputs, so it has no curve of a map")
    if not isinstance(model, Narx) or _has_products(model):
        x = np.linspace(low, high, AT_REST)
        if isinstance(model, FeedbackModel):
            return _band(fit, feedback_at_rest(model, x), x, level)
        return _band(fit, lambda moved: np.array([output_at_rest(moved, each) for each in x]), x, level)
    terms = _of_one_side(model)
    x = np.linspace(low, high, POINTS)

    def at_rest(moved: Narx) -> Array:
        inputs = _sum(moved, terms[1], x) + _sum(moved, terms[None], x)
        return np.asarray(inputs / (1.0 - _sum(moved, _linear(terms[0]), np.ones(1))))

    return _band(fit, at_rest, x, level)


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
    terms = _of_one_side(fit.model)
    bent = [k for k in terms[0] if k not in _linear(terms[0])]
    if not bent:
        raise ModelError(f"{fit.model.name} has no term that is nonlinear in past outputs")
    low, high = np.quantile(record.input, (0.01, 0.99))
    x = np.linspace(float(record.output.min()), float(record.output.max()), POINTS)

    def friction(moved: Narx) -> Array:
        slope = np.diff(_sum(moved, terms[1], np.array([low, high])))[0] / (high - low)
        return np.asarray(-_sum(moved, {k: terms[0][k] for k in bent}, x) / slope)

    return _band(fit, friction, x, level)


def _until_settled(response: Array) -> int:
    """The samples of a step response to show."""
    end, reach = response[-1], np.max(np.abs(response - response[0]), axis=0)
    away = np.flatnonzero(np.any(np.abs(response - end) > SETTLED * reach, axis=1))
    settled = int(away[-1]) + 2 if len(away) else 2
    return min(len(response), max(20, settled * 3 // 2))


def _band(fit: Fit[Any], curve: Curve, x: Array, level: float) -> Band:
    value, error = with_error(fit, curve)
    return Band(x, value, error, level)


def with_error(fit: Fit[Any], curve: Curve) -> tuple[Array, Array]:
    """A curve and its standard error."""
    here = np.asarray(curve(fit.model), dtype=float)
    if not fit.has_bands or fit.method == "file":  # a model alone has no estimates
        return here, np.full_like(here, np.nan)
    variance, directions = np.zeros_like(here), _directions(fit.covariance)
    if directions:
        _move_of(fit.model)(fit.names, fit.estimate)  # refuses other parameters than the model's own
    steps = FIRST_ORDER if isinstance(fit.model, FeedbackModel) else SHORTER
    for direction in directions:
        for step in steps:
            change = _change(fit, curve, here, step * direction)
            if change is not None:
                variance += (change / step) ** 2
                break
    return here, np.sqrt(variance)


def _directions(covariance: Array) -> list[Array]:
    """The columns of L with P = L·Lᵀ, for the parameters of finite variance."""
    deviation = np.sqrt(np.diag(covariance))
    known = np.flatnonzero(np.isfinite(deviation) & (deviation > 0))
    if not len(known):
        return []
    scale = deviation[known]
    size, axes = np.linalg.eigh(covariance[np.ix_(known, known)] / np.outer(scale, scale))
    columns = []
    for k in np.flatnonzero(size > NEGLIGIBLE * size[-1]):
        column = np.zeros(len(covariance))
        column[known] = scale * np.sqrt(size[k]) * axes[:, k]
        columns.append(column)
    return columns


def _change(fit: Fit[Any], curve: Curve, here: Array, move: Array) -> Array | None:
    """The change of a curve over a move of the estimate; None where it cannot be computed."""
    above, below = (_moved(fit, curve, here, fit.estimate + side * move) for side in (1, -1))
    if above is not None and below is not None:
        return (above - below) / 2
    return above - here if above is not None else here - below if below is not None else None


def _moved(fit: Fit[Any], curve: Curve, here: Array, theta: Array) -> Array | None:
    """The curve of the model with another estimate; None where that cannot be run, or diverges."""
    try:
        with np.errstate(all="ignore"):
            found = np.asarray(curve(_move_of(fit.model)(fit.names, theta)), dtype=float)
    except (EmsidError, Infeasible, ValueError, ArithmeticError):
        return None
    return found if np.isfinite(found[np.isfinite(here)]).all() else None


def _move_of(model: Any) -> Callable[[Sequence[str], Array], Any]:
    """The method of a model that gives it other estimates.

    Raises:
        ModelError: for a model without one.
    """
    move = getattr(model, "with_estimates", None)
    if move is None:
        raise ModelError(f"{model.name}: the parameters of this kind of model cannot be moved, so it has no band")
    return move  # type: ignore[no-any-return]


def _log_parts(logarithm: NDArray[np.complex128]) -> Array:
    """(m, 2) log magnitude, and phase without jumps, in rad."""
    return np.column_stack([logarithm.real, np.unwrap(logarithm.imag)])


def _of_one_side(model: Any) -> dict[int | None, dict[int, Regressor]]:
    """The regressors of past outputs (0), of past inputs (1) and constants (None), by their places.

    Raises:
        ModelError: for a model that is no regression of one input, or has products of input and output.
    """
    if not isinstance(model, Narx) or model.structure.inputs != 1:
        raise ModelError(f"{model.name} is no regression of one input")
    sides: dict[int | None, dict[int, Regressor]] = {0: {}, 1: {}, None: {}}
    if _has_products(model):
        raise ModelError(f"{model.name} has products of input and output, so its friction is not one curve")
    for k, regressor in enumerate(model.structure.regressors):
        sides[next((factor.channel for factor in regressor.factors), None)][k] = regressor
    return sides


def _has_products(model: Narx) -> bool:
    """Whether a term of a regression is a product of input and output."""
    return any(len({factor.channel for factor in each.factors}) > 1 for each in model.structure.regressors)


def _linear(regressors: dict[int, Regressor]) -> dict[int, Regressor]:
    """Those that are a past signal itself."""
    return {k: each for k, each in regressors.items() if each.is_linear}


def _sum(model: Narx, regressors: dict[int, Regressor], x: Array) -> Array:
    """(m,) what regressors add to the output where their signal has been constant at x (m,)."""
    total = np.zeros(len(x))
    for k, regressor in regressors.items():
        value = np.full(len(x), -model.parameters[k] if regressor.negative else model.parameters[k])
        for factor in regressor.factors:
            value = value * factor.transform.definition(x, factor.parameter) ** factor.power
        total += value
    return total
