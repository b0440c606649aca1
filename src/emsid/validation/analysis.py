r"""Everyday analysis of any model in one call: what it does to a step, its poles, its residuals, its forecast.

A function takes a model or a fit. Of a fit, curves have a confidence band. `step`, `impulse`, `bode`, `pole_map` and
`residuals` also take a list of models, whose results are drawn in one picture: ``emsid.bode([first, second]).plot()``.
A model that lacks what is asked for says so.

**Forecast.** From the last measured sample on, the error of the forecast k samples ahead is

    y(t + k) − ŷ(t + k) = e(t + k) + h₁ e(t + k − 1) + … + hₖ₋₁ e(t + 1),      hⱼ = ∂ŷ(t + j)/∂e(t),

with white noise e of the variance of the fit; the hⱼ are found by moving one measured output. The uncertainty of the
parameters comes on top. A model without a noise model has hⱼ = 0: its error is taken as white.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Fit
from emsid.models.bands import Band, with_error
from emsid.models.kinds import capabilities_of
from emsid.models.linear.system import LinearSystem
from emsid.models.measured_response import frequency_response
from emsid.models.starting import start
from emsid.models.verbs import as_model, for_model
from emsid.record import FrequencyResponse, Record
from emsid.validation.bands import LONGEST, frequency_response_band, step_response_band
from emsid.validation.comparison import Assessment, as_fit, assess
from emsid.validation.correlation import NonlinearTest, ResidualTest, residual_tests
from emsid.validation.responses import Analysed, BodeCurve, ModeTable, PoleMap, TimeResponse, of_each

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

NUDGE = 1e-3
"""The move of a measured output that shows how the forecast follows it, in standard deviations of the noise."""

PEAKS = 0.5**0.5
"""Im s/|s| of a pair of poles of damping ratio 1/√2; with more damping its response has no peak."""


# --- linear parts ----------------------------------------------------------------------------------------------------


@np.errstate(all="ignore")  # of a model whose numbers overflow
def linearize(model: Any, at: float = 0.0) -> LinearSystem:
    """The linear system that a model is, or near which it is for small changes about a constant input.

    A plant is taken in motion, in continuous time, without dry friction, dead zone and limits.

    Args:
        model: a model, a fit or a plant.
        at: the constant input, in its unit.

    Raises:
        ModelError: for a model without a linear part, or that does not come to rest at this input.
    """
    if isinstance(model, LinearSystem):
        return model
    subject = as_model(model)
    try:
        part = capabilities_of(subject).linear_part(subject, at)
        if all(np.isfinite(matrix).all() for matrix in (part.a, part.b, part.c, part.d)):
            return replace(part, channels=model.channels) if isinstance(model, Fit) else part
    except ArithmeticError:
        pass
    raise ModelError(f"{subject.name} has no linear part with finite numbers; identify it again")


def poles(model: Any, at: float = 0.0) -> Complex:
    """(n,) the poles of `linearize`: in z of a model in discrete time, in 1/s of a plant.

    Args:
        model: a model, a fit or a plant.
        at: the constant input about which it is linearised.
    """
    return linearize(model, at).poles


def zeros(model: Any, at: float = 0.0) -> Complex:
    """The finite zeros of `linearize`.

    Args:
        model: a model, a fit or a plant with as many inputs as outputs.
        at: the constant input about which it is linearised.
    """
    return linearize(model, at).zeros


@of_each
def pole_map(model: Any, at: float = 0.0) -> PoleMap:
    """Poles and zeros of `linearize`, with the standard errors of the poles where the model is a fit.

    Args:
        model: a model, a fit, a plant or a `LinearSystem`; or several in a list.
        at: the constant input about which it is linearised.
    """
    part = linearize(model, at)
    here = part.poles

    def parts(moved: Any) -> Array:
        there = linearize(moved, at).poles
        moved_here = there[_nearest(here, there)]  # fails where their numbers differ
        return np.stack([moved_here.real, moved_here.imag])

    real, imaginary = with_error(model, parts)[1] if isinstance(model, Fit) else np.full((2, len(here)), np.nan)
    zeros = part.zeros if part.d.shape[0] == part.d.shape[1] else np.zeros(0, dtype=complex)
    return PoleMap(here, zeros, real + 1j * imaginary, part.dt, part.name)


@of_each
def modes(model: Any, at: float = 0.0, level: float = 0.95) -> ModeTable:
    """Resonances and antiresonances of `linearize`: natural frequency and damping, with intervals where it is a fit.

    These are pairs of poles and zeros with a damping ratio between −1/√2 and 1/√2, as others make no peak and no dip.
    Those of a model in discrete time are what its samples say in continuous time, s = ln(z)/dt; a real z has none.

    Args:
        model: a model, a fit, a plant or a `LinearSystem`; or several in a list.
        at: the constant input about which it is linearised.
        level: of the intervals.
    """

    def pairs(moved: Any) -> list[Complex]:
        part = linearize(moved, at)
        square = part.d.shape[0] == part.d.shape[1]
        several = [part.poles, part.zeros if square else np.zeros(0, dtype=complex)]
        if part.dt is not None:
            several = [np.log(each[each.imag != 0]) / part.dt for each in several]
        return [each[each.imag > PEAKS * np.abs(each)] for each in several]

    here = pairs(model)
    order = np.argsort(np.abs(np.concatenate(here)))

    def numbers(moved: Any) -> Array:
        parts = []
        for own, there in zip(here, pairs(moved), strict=True):  # fails where their numbers differ
            s = there[_nearest(own, there)]
            parts.append(np.stack([np.abs(s) / (2 * np.pi), -s.real / np.abs(s)]))
        return np.asarray(np.concatenate(parts, axis=1)[:, order])

    value = numbers(model)
    error = with_error(model, numbers)[1] if isinstance(model, Fit) else np.full_like(value, np.nan)
    kinds = np.repeat(["resonance", "antiresonance"], [len(each) for each in here])[order]
    return ModeTable(tuple(kinds.tolist()), value[0], value[1], error[0], error[1], level, linearize(model, at).name)


def _nearest(here: Complex, there: Complex) -> NDArray[np.int64]:
    """Which points of one set belong to those of another, so that the sum of their distances is the least."""
    distances = np.abs(here[:, None] - there)
    if distances.size:
        nearest: NDArray[np.int64] = distances.argmin(axis=1)
        if len(set(nearest.tolist())) == len(nearest):  # no sum is less
            return np.asarray(nearest)
    from scipy.optimize import linear_sum_assignment  # takes a sixth of a second to import

    return np.asarray(linear_sum_assignment(distances)[1])


def to_discrete(model: Any, dt: float, at: float = 0.0) -> LinearSystem:
    """The linear part of a model at another sample time, or that of a plant at one, for inputs that are held.

    Args:
        model: a model, a fit, a plant or a `LinearSystem`.
        dt: sample time in s.
        at: the constant input about which it is linearised.
    """
    return linearize(model, at).to_discrete(dt)


def to_continuous(model: Any, at: float = 0.0) -> LinearSystem:
    """The linear part of a model in continuous time, with the same samples for inputs that are held.

    Args:
        model: a model, a fit, a plant or a `LinearSystem`.
        at: the constant input about which it is linearised.
    """
    return linearize(model, at).to_continuous()


# --- responses -------------------------------------------------------------------------------------------------------


def _fit_and_time(model: Any, dt: float | None) -> tuple[Fit[Any], float]:
    """A fit of the model, and its sample time.

    Raises:
        ModelError: where no sample time is known.
    """
    fit = model if isinstance(model, Fit) else as_fit(as_model(model))
    known = dt or fit.model.dt or (fit.channels.dt if fit.channels is not None else None)
    if known is None:
        raise ModelError(f"{fit.model.name} runs at any sample time; give one, dt=… in s", arguments=("dt",))
    return fit, known


def _outputs(fit: Fit[Any], count: int) -> tuple[tuple[str, str], ...]:
    """Name and unit of every output of a fit."""
    known = fit.channels.outputs if fit.channels is not None else ()
    return known if len(known) == count else tuple((f"y{k + 1}", "") for k in range(count))


def _over_time(fit: Fit[Any], band: Band, quantity: str) -> TimeResponse:
    """A curve over time as the response of a model."""
    outputs = _outputs(fit, band.value.shape[1] if band.value.ndim > 1 else 1)
    return TimeResponse(band.x, band.value, band.standard_error, band.level, fit.model_name, quantity, outputs)


def _inputs(model: Any) -> int:
    """How many inputs a model has, where it has a linear part; else one."""
    try:
        return int(linearize(model).b.shape[1])
    except ModelError:
        return 1


@of_each
def step(
    model: Any, size: float = 1.0, *, at: float = 0.0, dt: float | None = None, input: int = 0, level: float = 0.95
) -> TimeResponse:
    """The response to a step of one input from rest, until it settles, with a band where the model is a fit.

    Args:
        model: a model, a fit or a plant; or several in a list.
        size: of the step, in the unit of the input.
        at: the input before it.
        dt: sample time in s of a model that has none.
        input: which input steps, from 0.
        level: of the band.

    Raises:
        ModelError: for a model without a sample time, or an input that it does not have.
    """
    fit, time = _fit_and_time(model, dt)
    command = np.zeros((LONGEST, max(_inputs(fit.model), input + 1)))
    command[:, input] = at
    like = Record(command, np.zeros(LONGEST), time)
    band = step_response_band(fit, like, size=size, start=at, input=input, level=level)
    return _over_time(fit, band, "Step response")


@of_each
def impulse(
    model: Any, size: float = 1.0, *, at: float = 0.0, dt: float | None = None, input: int = 0, level: float = 0.95
) -> TimeResponse:
    """The response to a pulse of one sample with this area, until it settles: to size/dt during one sample.

    Args:
        model: a model, a fit or a plant; or several in a list.
        size: area of the pulse, in the unit of the input times seconds.
        at: the input before and after it.
        dt: sample time in s of a model that has none.
        input: which input has the pulse, from 0.
        level: of the band.

    Raises:
        ModelError: as `step` does.
    """
    fit, time = _fit_and_time(model, dt)
    settled = len(step(fit, at=at, dt=time, input=input).x)
    rest = np.zeros(max(_inputs(fit.model), input + 1))
    rest[input] = at

    def response(moved: Any) -> Array:
        late = moved.latency
        command = np.tile(rest, (settled + late, 1))
        command[0, input] += size / time
        return np.asarray(moved.run(moved.at_rest(rest, time), command)[0][late:])

    band = Band(time * np.arange(settled, dtype=float), *with_error(fit, response), level)
    return _over_time(fit, band, "Impulse response")


@of_each
def bode(
    model: Any, *, at: float = 0.0, dt: float | None = None, output: int = 0, input: int = 0, level: float = 0.95
) -> BodeCurve:
    """Magnitude and phase up to half the sampling rate, with bands where the model is a fit.

    Those of a record are by averaged windows, with their coherence; those of a `FrequencyResponse` are its own.

    Args:
        model: a model, a fit or a plant, a frequency response, or a record; or several of them in a list.
        at: the constant input about which it is linearised.
        dt: sample time in s of a model that has none.
        output, input: of a model with several, from 0.
        level: of the bands.

    Raises:
        ModelError: for a model without a frequency response.
        DataError: for a channel that a measured response does not have.
    """
    if isinstance(model, Record):
        model = frequency_response(model, "welch")
    if isinstance(model, FrequencyResponse):
        return measured_curve(model.path(output, input), level)
    fit, time = _fit_and_time(model, dt)
    return frequency_response_band(fit, time, output=output, input=input, around=at, level=level)


def measured_curve(response: FrequencyResponse, level: float = 0.95) -> BodeCurve:
    """Magnitude and phase of one path that was measured, with its levels of noise and distortion.

    Args:
        response: of one input and one output.
        level: of the bands.
    """
    f, columns = response.frequency, response.columns()
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.full(len(f), np.nan) if response.total is None else response.total[:, 0, 0]
        relative = np.sqrt(variance / 2) / np.abs(response.response[:, 0, 0])
    magnitude = Band(f, columns["magnitude"], 20 / np.log(10) * relative, level)
    levels = {name: values for name, values in columns.items() if name in ("noise", "distortion", "even")}
    phase = Band(f, columns["phase"], np.degrees(relative), level)
    return BodeCurve(magnitude, phase, response.name, columns.get("coherence"), levels)


# --- against data ----------------------------------------------------------------------------------------------------


def predict(model: Any, record: Record, horizon: int = 1) -> Record:
    """The record with the outputs as predicted ``horizon`` samples ahead of the last measured one that is used.

    Args:
        model: a model, a fit or a plant.
        record: with measured outputs; those that start a segment are repeated.
        horizon: samples ahead.

    Raises:
        ModelError: for a record of other channels, or a prediction that diverges.
        DataError: for a record without outputs.
    """
    record = for_model(model, record)
    subject = as_model(model, record)
    run = subject.predict(record, horizon)
    if run.diverged_at is not None:
        raise ModelError(f"{subject.name}: the prediction diverges at sample {run.diverged_at}")
    return replace(record, output=run.output, name=f"{record.name}, {horizon} ahead by {subject.name}")


def forecast(model: Any, record: Record, inputs: ArrayLike, *, level: float = 0.95) -> TimeResponse:
    """The outputs after a record, for inputs that are known, with a band for noise and parameters of a fit.

    Args:
        model: a fit; of a model alone there is no band.
        record: what was measured so far.
        inputs: (N,) or (N, nu) the inputs after it.
        level: of the band.

    Returns:
        Values (N,), or (N, ny) of several outputs, over the time of the record that goes on.

    Raises:
        ModelError: for a record of other channels.
        DataError: for a record that is too short or has no outputs, or a number in place of inputs.
    """
    record = for_model(model, record)
    fit = model if isinstance(model, Fit) else as_fit(as_model(model, record))
    u = np.asarray(inputs, dtype=float)
    if not u.ndim:
        raise DataError(f"a forecast needs the inputs after the record, one for each sample ahead; got {inputs!r}")
    u = u[:, None] if u.ndim == 1 else u
    last = record.segments[-1]
    if not last.output.shape[1]:
        raise DataError(f"{record.name} has no output to forecast from; simulate it")

    def ahead(moved: Any) -> Array:
        outputs = moved.run(moved.initial(last, len(last)), u)[0]
        return np.asarray(outputs[:, 0] if outputs.shape[1] == 1 else outputs)

    value, error = with_error(fit, ahead)
    if np.isfinite(fit.noise_variance):
        noise = _noise_ahead(fit, last, u).reshape(value.shape)
        error = np.sqrt(np.where(np.isfinite(error), error, 0.0) ** 2 + noise)
    time = float(last.time[-1]) + record.dt * np.arange(1, len(u) + 1, dtype=float)
    return _over_time(fit, Band(np.asarray(time, dtype=float), value, error, level), "Forecast")


def _noise_ahead(fit: Fit[Any], last: Record, u: Array) -> Array:
    """(N, ny) the variance of the noise in a forecast."""
    size, outputs = float(np.sqrt(fit.noise_variance)), last.output.shape[1]
    follows = np.zeros((len(u), outputs))
    follows[0] = 1.0
    try:
        runs = []
        for moved in (0.0, NUDGE * size):
            running = start(fit.model, record=last)
            y = running.step(u[0])
            running.correct(y + moved)
            runs.append(running.predict(u[1:]).reshape(-1, outputs) if len(u) > 1 else np.zeros((0, outputs)))
        follows[1:] = (runs[1] - runs[0]) / (NUDGE * size) if size > 0 else 0.0
    except ModelError:  # without a model of its noise
        pass
    return np.asarray(size**2 * np.cumsum(follows**2, axis=0))


@dataclass(frozen=True, eq=False, repr=False)
class Residuals(Analysed):
    """What a model leaves of the measured outputs, with its tests.

    Attributes:
        free_run: a record with measured minus simulated outputs, without the samples that start the model.
        one_step: the same of the prediction one sample ahead.
        whiteness: whether the one-step errors of every output are white; empty where there are too few samples.
        inputs: the errors of the free run of every output against nonlinear functions of the inputs.
        assessment: the runs from which they are.
    """

    free_run: Record
    one_step: Record
    whiteness: tuple[ResidualTest, ...]
    inputs: tuple[tuple[NonlinearTest, ...], ...]
    assessment: Assessment

    @property
    def of(self) -> str:  # type: ignore[override]
        """The name of the model."""
        return self.assessment.row.model

    def columns(self) -> dict[str, NDArray[Any]]:
        """Time, inputs and the errors of the free run."""
        errors = self.free_run
        channels = [*zip(errors.input_names, errors.input.T, strict=True)]
        return {"t": errors.time, **dict(channels), **dict(zip(errors.output_names, errors.output.T, strict=True))}

    def __str__(self) -> str:
        rms = np.sqrt(np.mean(self.free_run.output**2, axis=0))
        lines = [
            f"{name}: {size:.4g} {unit}".rstrip()
            for name, size, unit in zip(self.free_run.output_names, rms, self.free_run.output_units, strict=True)
        ]
        for test in self.whiteness:
            word = "white" if test.white else "not white"
            lines.append(
                f"one-step errors of {test.output}: {word} (p = {test.p_value:.2g}; largest autocorrelation "
                f"{test.largest_autocorrelation:.2f} at lag {test.at_lag})"
            )
        return "\n".join(["RMS error of the free run", *lines])


@of_each
def residuals(model: Any, record: Record) -> Residuals:
    """Measured minus simulated outputs, with tests of whiteness and of what the inputs still explain.

    Args:
        model: a model, a fit or a plant; or several in a list.
        record: with measured outputs.

    Raises:
        ModelError: for a record of other channels, or a run that diverges.
        DataError: where no sample is left after the start of the model.
    """
    record = for_model(model, record)
    fit = model if isinstance(model, Fit) else as_fit(as_model(model, record))
    found = assess(fit, record)
    if found.simulation.diverged_at is not None:
        raise ModelError(f"{fit.model.name}: the free run diverges at sample {found.simulation.diverged_at}")
    counted = found.simulation.counted

    def errors(output: Array) -> Record:
        whole = replace(record, output=np.where(counted[:, None], record.output - output, 0.0))
        return whole if counted.all() else whole.mask(~counted)

    tests = tuple(residual_tests(record, found.prediction))
    left, ahead = errors(found.simulation.output), errors(found.prediction.output)
    return Residuals(left, ahead, tests, found.nonlinear_tests, found)
