"""Confidence bands of runs, responses, maps and friction: against closed forms, and by repetition."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid.blocks import DeadZone, Rational
from emsid.estimation.fit import Fit
from emsid.identification import curves
from emsid.models.bands import with_error
from emsid.validation import (
    free_run_band,
    frequency_response_band,
    friction_band,
    static_map_band,
    step_response_band,
)
from emsid.validation.bands import usual_step
from emsid.validation.comparison import as_fit

DT, POLE, GAIN = 0.01, 0.9, 3.0


def record(seed, noise=0.05, samples=600, of=lambda u: u):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, samples // 6), 6)
    y = lfilter([0.0, GAIN * (1 - POLE)], [1.0, -POLE], of(u)) + noise * rng.standard_normal(samples)
    return emsid.Record(u, y, DT, input_units=("V",), output_units=("rad/s",))


def arx(a=-POLE, b=GAIN * (1 - POLE), deviation=(1e-3, 3e-3)):
    """A fit with these estimates and independent errors."""
    model = emsid.arx(1, 1).model(np.array([a, b]), record(0))
    return Fit(model, model.structure.parameter_names, np.array([a, b]), np.diag(deviation) ** 2, 1.0, 500.0, 1.0, 2)


def test_the_band_of_a_curve_that_is_linear_in_the_estimate_is_exact():
    band = static_map_band(arx(deviation=(0.0, 3e-3)), record(0))
    assert band.value == pytest.approx(GAIN * band.x)
    assert band.standard_error == pytest.approx(np.abs(band.x) * 3e-3 / (1 - POLE))
    assert band.high - band.value == pytest.approx(1.959964 * band.standard_error)


def test_bands_follow_the_delta_method_where_errors_are_small():
    fit, known = arx(deviation=(1e-6, 1e-6)), record(1)
    steps = step_response_band(fit, known, size=1.0)
    n = np.arange(0.0, len(steps.x))  # the first input acts one sample later
    by_pole = GAIN * (1 - POLE) * ((1 - POLE**n) / (1 - POLE) ** 2 - n * POLE ** (n - 1) / (1 - POLE))
    by_gain = (1 - POLE**n) / (1 - POLE)
    assert steps.value[:, 0] == pytest.approx(GAIN * (1 - POLE**n), abs=1e-9)
    assert steps.standard_error[:, 0] == pytest.approx(1e-6 * np.hypot(by_pole, by_gain), rel=1e-3, abs=1e-12)
    assert steps.x[1] == pytest.approx(DT)


def test_a_frequency_response_has_bands_of_magnitude_and_phase():
    fit = arx(deviation=(0.0, 3e-3))
    found = frequency_response_band(fit, DT)
    z = np.exp(-2j * np.pi * found.magnitude.x * DT)
    truth = GAIN * (1 - POLE) * z / (1 - POLE * z)
    assert found.magnitude.value == pytest.approx(20 * np.log10(np.abs(truth)))
    assert found.phase.value == pytest.approx(np.degrees(np.unwrap(np.angle(truth))))
    relative = 3e-3 / (GAIN * (1 - POLE))
    assert found.magnitude.standard_error == pytest.approx(np.full(len(z), 20 / np.log(10) * relative), rel=1e-3)
    assert np.max(found.phase.standard_error) < 1e-9


def test_bands_cover_the_truth_as_often_as_they_say():
    fresh, exact = record(99, noise=0.0), arx().model
    free = exact.simulate(fresh).output
    steps = exact.run(exact.at_rest(), np.ones((500, 1)))[0]
    inside = []
    for seed in range(40):
        fit = emsid.fit(emsid.arx(1, 1), record(seed), free_run=True)
        fit = replace(fit, model=replace(fit.model, start=0))
        bands = (
            (free_run_band(fit, fresh, transient=1), free),
            (step_response_band(fit, fresh, size=1.0), steps),
            (levels := static_map_band(fit, fresh), GAIN * levels.x),
        )
        for band, truth in bands:
            within = (band.low <= truth[: len(band.x)]) & (truth[: len(band.x)] <= band.high)
            inside.append(np.mean(within[2:]))
    shares = np.mean(np.reshape(inside, (-1, 3)), axis=0)
    assert np.all(shares > 0.86)  # three standard errors of 40 records below 0.95
    assert np.all(shares < 1.0)


def covered(curve, truth):
    """The share of a curve's band that contains the truth, where the band has a width."""
    low, high = curve.low, curve.high
    return np.mean(((low <= truth) & (truth <= high))[high > low])


def of_cascades(seed):
    known = record(seed, of=lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.3, 0.0))
    fit = emsid.fit(emsid.Cascade((DeadZone(-0.2, 0.2, 1, 1), Rational([0.2], [-0.8], 1))), known)
    step = step_response_band(fit, known, size=1.0, start=0.0)
    yield covered(step, lfilter([0.0, GAIN * (1 - POLE)], [1.0, -POLE], np.full(len(step.x), 0.7))[:, None])
    response = frequency_response_band(fit, DT).magnitude
    z = np.exp(-2j * np.pi * response.x * DT)
    yield covered(response, 20 * np.log10(np.abs((1 - POLE) * z / (1 - POLE * z))))  # the gain is in the map


def of_regressions(seed):
    rng = np.random.default_rng(seed)
    u, y = np.repeat(rng.uniform(-3, 3, 100), 6), np.zeros(600)
    for k in range(599):
        y[k + 1] = POLE * y[k] + 0.3 * u[k] - 0.1 * np.tanh(y[k] / 0.3)
    known = emsid.Record(u, y + 0.02 * rng.standard_normal(600), DT)
    fit = emsid.fit(emsid.Structure.parse("y(t-1)", "u(t-1)", "tanh(y(t-1)/0.3)"), known, free_run=True)
    friction, levels = friction_band(fit, known), static_map_band(fit, known)
    yield covered(friction, np.tanh(friction.x / 0.3) / 3)
    yield covered(levels, levels.x * 0.3 / (1 - POLE))


def of_feedback(seed):
    def run(u):
        y = np.zeros(len(u))
        for k in range(len(u) - 1):
            y[k + 1] = 0.5 * y[k] + 0.5 * u[k] - 0.25 * np.clip(y[k], -1, 1)
        return y

    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-4, 4, 100), 6)
    known = emsid.Record(u, run(u) + 0.05 * rng.standard_normal(600), DT)
    start = emsid.FeedbackModel([[0.55, 0.45, -0.2], [1, 0, 0], [1, 0, 0]], (emsid.blocks.Saturation(),), dt=DT)
    fit = emsid.fit(start, known)
    levels, step = static_map_band(fit, known), step_response_band(fit, known, size=3.0, start=0.0)
    yield covered(levels, np.where(np.abs(levels.x) < 1.5, levels.x / 1.5, levels.x - 0.5 * np.sign(levels.x)))
    yield covered(step, run(np.full(len(step.x) + 1, 3.0))[:-1, None])
    inner = next(curve for curve in curves(fit, known) if curve.kind == "map in feedback")
    assert np.all(inner.high - inner.low > 0)


def of_plants(seed):
    rng, signals = np.random.default_rng(seed), (emsid.plants.Signal.SPEED,)
    u, plant = np.repeat(rng.uniform(-10, 10, 60), 15)[:, None], emsid.plants.rigid_motor()
    y = plant.simulate(u, 0.005, np.zeros(2), signals)
    noisy = y + 0.5 * rng.standard_normal(y.shape)
    record = emsid.Record(u, noisy, 0.005, input_units=("V",), output_units=("rad/s",))
    fit = emsid.fit(plant, record, search=False)
    friction, zone = emsid.plants.friction_curve(fit), emsid.plants.dead_zone_curve(fit)
    yield covered(friction, plant.friction_characteristic().law(friction.x))
    yield covered(zone, plant.dead_zone_characteristic().law(zone.x))


@pytest.mark.parametrize(
    ("of_kind", "records"),
    [
        (of_cascades, 12),
        (of_regressions, 20),
        pytest.param(of_feedback, 40, marks=pytest.mark.long),
        pytest.param(of_plants, 20, marks=pytest.mark.long),
    ],
)
def test_bands_of_nonlinear_models_contain_the_truth(of_kind, records):
    """The points of a curve are dependent, so each counts as one number: at least three standard errors below 0.95."""
    shares = np.mean([list(of_kind(seed)) for seed in range(records)], axis=0)
    assert np.all(shares > 0.95 - 3 * np.sqrt(0.95 * 0.05 / records))


def test_a_cascade_has_the_bands_of_its_map_and_of_its_filters_in_a_row():
    known = record(3, of=lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.3, 0.0))
    model = emsid.Cascade((DeadZone(-0.3, 0.3), Rational([0.1], [-POLE], 1)), name="hammerstein", dt=DT)
    names = ("f.b_r", "G.a1")
    estimate = np.array([0.3, -POLE])
    fit = Fit(model, names, estimate, np.diag([1e-4, 1e-6]), 1.0, 500.0, 1.0, 2)
    zone = static_map_band(fit, known)
    inside = (zone.x > -0.2) & (zone.x < 0.2)
    assert np.all(zone.standard_error[inside] == 0)
    assert np.all(zone.standard_error[zone.x > 0.35] == pytest.approx(0.01))
    response = frequency_response_band(fit, DT)
    assert response.magnitude.value[0] == pytest.approx(0.0, abs=0.05)  # a gain of one
    assert np.all(response.magnitude.standard_error > 0)
    run = free_run_band(fit, known)
    assert np.isnan(run.value[: model.memory]).all()
    assert np.all(run.standard_error[model.memory :] > 0)


def test_a_plant_has_bands_and_one_that_cannot_be_moved_says_so():
    plant = emsid.plants.rigid_motor()
    u = np.repeat(np.random.default_rng(4).uniform(-10, 10, 30), 10)[:, None]
    signals = (emsid.plants.Signal.SPEED,)
    y = plant.simulate(u, 0.005, np.zeros(plant.states), signals)
    known = emsid.Record(u, y, 0.005, input_units=("V",), output_units=("rad/s",))
    model = emsid.PlantModel(plant, signals)
    value = plant.value("motor_constant")
    fit = Fit(model, ("motor_constant",), np.array([value]), np.array([[(0.01 * value) ** 2]]), 1.0, 300.0, 1.0, 1)
    step = step_response_band(fit, known, size=6.0)
    assert 0.001 < step.standard_error[-1, 0] / step.value[-1, 0] < 0.02
    found = frequency_response_band(fit, 0.005)
    assert found.magnitude.standard_error[0] > 0
    for structure in (emsid.state_space(1), emsid.armax(1, 1, 1)):
        unmoved = Fit(emsid.fit(structure, known).model, ("a",), np.ones(1), np.eye(1), 1.0, 300.0, 1.0, 1)
        with pytest.raises(emsid.ModelError, match="no band"):
            free_run_band(unmoved, known)


def test_friction_of_a_regression_is_in_units_of_the_input():
    structure = emsid.Structure.parse("y(t-1)", "u(t-1)", "sign(y(t-1))")
    known = record(5)
    fit = Fit(
        structure.model(np.array([POLE, 0.3, -0.06]), known),
        structure.parameter_names,
        np.array([POLE, 0.3, -0.06]),
        np.diag([0.0, 0.0, 1e-6]),
        1.0,
        500.0,
        1.0,
        3,
    )
    band = friction_band(fit, known)
    assert band.value[band.x > 0] == pytest.approx(0.2)  # 0.06/0.3
    assert band.value[band.x < 0] == pytest.approx(-0.2)
    assert band.standard_error[band.x > 0] == pytest.approx(1e-3 / 0.3)
    with pytest.raises(emsid.ModelError, match="no term that is nonlinear"):
        friction_band(arx(), known)
    product = emsid.Structure.parse("y(t-1)*u(t-1)").model(np.array([0.1]), known)
    with pytest.raises(emsid.ModelError, match="products"):
        friction_band(replace(fit, model=product), known)


def test_a_parameter_without_a_variance_adds_nothing_and_an_unstable_side_is_left_out():
    known = record(6)
    fit = arx(deviation=(np.inf, 1e-3))
    assert np.all(np.isfinite(free_run_band(fit, known).standard_error[1:]))
    edge = arx(a=-0.99, deviation=(0.5, 0.0))  # a pole of 1.49 on one side
    assert np.all(np.isfinite(free_run_band(edge, known).standard_error[1:]))


def test_what_does_not_come_to_rest_has_no_such_curve():
    known, grows = record(7), emsid.Structure.parse("y(t-1)*u(t-1)", "1")
    theta = np.array([1.5, 0.1])  # y = 0.1/(1 - 1.5u), and it grows without end at u = 1
    fit = Fit(grows.model(theta, known), grows.parameter_names, theta, np.eye(2), 1, 9, 1, 2)
    with pytest.raises(emsid.ModelError, match="does not come to rest at an input of"):
        static_map_band(fit, known)
    with pytest.raises(emsid.ModelError, match="does not come to rest at an input of 1"):
        frequency_response_band(fit, DT, around=1.0)
    plant = emsid.plants.rigid_motor()
    with pytest.raises(emsid.ModelError, match="curves of its drive"):
        static_map_band(replace(fit, model=emsid.PlantModel(plant, (emsid.plants.Signal.SPEED,))), known)


def response_to_a_small_sine(model, f, around):
    """The complex gain of a model at f (Hz), by simulation about the rest at an input."""
    n, size = np.arange(6000), 1e-4
    u = around + size * np.sin(2 * np.pi * f * DT * n)
    y = model.run(model.at_rest(around), u[:, None])[0][model.latency :, 0][2000:]
    n = n[: 6000 - model.latency][2000:]
    phase = 2 * np.pi * f * DT * n
    sine, cosine, _ = np.linalg.lstsq(np.column_stack([np.sin(phase), np.cos(phase), np.ones(len(n))]), y)[0]
    return (sine + 1j * cosine) / size


CURVED = emsid.Structure.parse("y(t-1)", "tanh(y(t-1)/0.5)", "u(t-1)", "u(t-2)^2*y(t-1)", "max(u(t)-0.1, 0)")
BENT = CURVED.model(np.array([0.8, -0.1, 0.3, -0.1, 0.2]), record(0))
LOOP = emsid.FeedbackModel(
    [[0.8, 0.1, 0.3, -0.1], [-0.1, 0.7, 0.2, 0.1], [1.0, 0.2, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]],
    (emsid.blocks.Polynomial(np.array([0.0, 0.5, 0.0, 0.3])),),
    delay=2,
)  # fmt: skip


@pytest.mark.parametrize(
    "model",
    [BENT, LOOP, replace(LOOP, oversampling=3, held=True), replace(LOOP, oversampling=2)],
    ids=["regression", "feedback", "held", "interpolated"],
)
def test_the_response_about_a_rest_is_that_to_a_small_sine(model):
    nothing = Fit(model, (), np.empty(0), np.empty((0, 0)), np.nan, 0.0, np.nan, 0)
    found = frequency_response_band(nothing, DT, around=0.4)
    gain = response_to_a_small_sine(model, found.magnitude.x[200], 0.4)
    assert found.magnitude.value[200] == pytest.approx(20 * np.log10(abs(gain)), abs=1e-3)
    turns = (found.phase.value[200] - np.degrees(np.angle(gain))) / 360
    assert turns == pytest.approx(round(turns), abs=1e-4)


def test_a_feedback_model_has_the_bands_of_its_responses_and_of_its_rest():
    """At rest y = u − k·sat(y): a slope of 1/(1 + k) within the limits, and of one beyond."""
    k = 0.5  # y(t+1) = 0.5 y(t) + 0.5 u(t) − 0.5 k w(t), w = y within ±1 and ±1 beyond
    model = emsid.FeedbackModel([[0.5, 0.5, -0.5 * k], [1, 0, 0], [1, 0, 0]], (emsid.blocks.Saturation(),), dt=DT)
    known = record(9, of=lambda u: u)
    known = replace(known, input=4 * known.input)
    name = "x1.w"
    fit = Fit(model, (name,), np.array([-0.5 * k]), np.array([[1e-6]]), 1.0, 500.0, 1.0, 1)
    band = static_map_band(fit, known)
    straight = np.abs(band.x) < 1 + k - 0.05
    assert band.value[straight] == pytest.approx(band.x[straight] / (1 + k))
    assert band.value[band.x > 1 + k] == pytest.approx(band.x[band.x > 1 + k] - k)
    assert band.standard_error[band.x > 1 + k] == pytest.approx(2e-3)  # dy/dk = −1, and k = −2·(x1.w)
    assert band.standard_error[straight] == pytest.approx(2e-3 * np.abs(band.x[straight]) / (1 + k) ** 2, rel=1e-3)
    inner, outer = (frequency_response_band(fit, DT, around=level).magnitude for level in (0.5, 3.0))
    assert 10 ** (inner.value[0] / 20) == pytest.approx(1 / (1 + k), rel=1e-3)
    assert 10 ** (outer.value[0] / 20) == pytest.approx(1.0, rel=1e-3)
    assert np.all(inner.standard_error > 0)
    assert np.all(step_response_band(fit, known).standard_error[2:] > 0)
    (inner,) = (curve for curve in curves(fit, known) if curve.kind == "map in feedback")
    assert inner.value == pytest.approx(np.clip(inner.x, -1, 1))
    assert np.isnan(inner.low).all()  # no parameter of the map is estimated
    run = free_run_band(fit, known)
    above, below = (
        model.with_estimates(fit.names, fit.estimate + step).simulate(known).output for step in (1e-3, -1e-3)
    )
    assert np.isnan(run.standard_error[: model.memory]).all()
    own = slice(model.memory + 5, None)
    assert run.standard_error[own] == pytest.approx(np.abs(above - below)[own] / 2, rel=0.05, abs=1e-5)
    from emsid.report.views import banded
    from emsid.report.views.analysis import model_figures

    (static,) = banded(fit, known)
    assert "without friction" not in static.caption
    responses = model_figures([fit], [usual_step(known.input[:, 0])], known)
    drawn = {figure.name: figure.caption for figure in responses}
    assert list(drawn) == ["steps-and-poles", "frequency-response"]
    assert "linearised where they rest after the step, at 3.18 V" in drawn["frequency-response"]
    assert "Step of u1 from 0 to 3.18 V." in drawn["steps-and-poles"]


def test_the_page_draws_what_a_model_has_with_its_bands():
    from emsid.report.document import Band
    from emsid.report.views import banded, measured_and_simulated
    from emsid.validation import validate

    known = record(8)
    fit = emsid.fit(emsid.arx(1, 1), known, free_run=True)
    (figure,) = banded(fit, known)
    assert figure.name == "arx-static-map"
    assert isinstance(figure.plots[0].marks[0], Band)
    assert "over a constant input, without friction, with 95 % band." in figure.caption
    seen = validate(fit, known)
    run = measured_and_simulated(seen, band=free_run_band(fit, known, transient=seen.fit.model.memory))
    assert isinstance(run.plots[0].marks[0], Band)
    assert not isinstance(measured_and_simulated(seen).plots[0].marks[0], Band)


@pytest.mark.parametrize("why", ["biased", "undetermined"])
def test_a_fit_without_intervals_has_curves_without_a_band(why):
    from emsid.report.document import Line
    from emsid.report.views import banded

    known = record(8, noise=0.3)
    fit = emsid.fit(emsid.arx(1, 1), known) if why == "biased" else arx(deviation=(np.inf, np.inf))
    assert fit.biased == (why == "biased")
    for band in (free_run_band(fit, known), step_response_band(fit, known), static_map_band(fit, known)):
        assert np.isnan(band.standard_error).all()
        assert np.isfinite(band.value).any()
    for figure in banded(fit, known):
        assert "no band, as this fit has no intervals" in figure.caption
        assert all(isinstance(mark, Line) for plot in figure.plots for mark in plot.marks)


def test_a_cascade_whose_search_stalled_has_a_map_without_a_band():
    from emsid.report.document import Band
    from emsid.report.views.cascade import frequency_responses, static_maps

    known = record(9, of=lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.3, 0.0))
    fit = emsid.fit(emsid.Cascade((DeadZone(-0.2, 0.2, 1, 1), Rational([0.2], [-0.8], 1))), known)
    assert np.isfinite(static_map_band(fit, known).standard_error).all()
    stalled = replace(fit, covariance=np.diag(np.full(len(fit.names), np.inf)))
    assert not stalled.has_intervals
    assert np.isnan(static_map_band(stalled, known).standard_error).all()
    for one in (fit, stalled):
        figures = (static_maps(one, known), frequency_responses(one, known.dt))
        drawn = {any(isinstance(mark, Band) for plot in figure.plots for mark in plot.marks) for figure in figures}
        assert drawn == {one.has_intervals}
        assert {("with 95 % band" in figure.caption) for figure in figures} == drawn
        assert {("no band, as this fit has no intervals" in figure.caption) for figure in figures} == {
            not one.has_intervals
        }


def test_every_static_map_of_a_cascade_is_among_its_curves():
    blocks = (DeadZone(-0.2, 0.2, 1, 1), Rational([0.2], [-0.8], 1), emsid.blocks.Saturation(-0.5, 0.5, 1))
    model = emsid.Cascade(blocks, dt=DT)
    known = record(9)
    found = [curve for curve in curves(as_fit(model), known) if curve.kind == "static map"]
    assert [(each.x_name, each.name) for each in found] == [(f"input of map {k}", f"output of map {k}") for k in (1, 2)]
    for each, map_ in zip(found, (blocks[0], blocks[2]), strict=True):
        np.testing.assert_allclose(each.value, map_.value(each.x))
    with pytest.raises(emsid.ModelError, match="no static map 2"):
        static_map_band(as_fit(model), known, map=2)


@pytest.mark.parametrize("variance", [1e-6, np.inf])
def test_the_maps_of_a_feedback_model_have_a_band_where_the_fit_has_intervals(variance):
    from emsid.report.document import Band
    from emsid.report.views.cascade import maps_in_feedback

    count = len(LOOP.parameters)
    fit = Fit(LOOP, LOOP.names, LOOP.parameters, np.diag(np.full(count, variance)), 1.0, 600.0, 1.0, count)
    figure = maps_in_feedback(fit, record(3), "feedback")
    drawn = any(isinstance(mark, Band) for plot in figure.plots for mark in plot.marks)
    assert drawn == fit.has_intervals == np.isfinite(variance)
    assert ("with 95 % band" in figure.caption) == drawn
    assert ("no band, as this fit has no intervals" in figure.caption) != drawn


def test_equal_poles_of_a_feedback_model_are_all_seen():
    """Points that are drawn later are smaller, so that they do not cover the others."""
    from emsid.report.document import Points
    from emsid.report.views.cascade import poles_by_level

    count = len(LOOP.parameters)
    fit = Fit(LOOP, LOOP.names, LOOP.parameters, np.eye(count), 1.0, 600.0, 1.0, count)
    drawn = [mark for mark in poles_by_level(fit, record(3), "feedback").plots[0].marks if isinstance(mark, Points)]
    sizes = [mark.size for mark in drawn]
    assert len(sizes) == 3
    assert all(later <= 0.7 * earlier for earlier, later in itertools.pairwise(sizes))


# --- linear models with a noise model --------------------------------------------------------------------------------

TWO = emsid.StateSpaceModel(
    np.array([[0.9, 0.2], [-0.1, 0.7]]),
    np.array([[1.0, 0.0], [0.2, 0.5]]),
    np.array([[1.0, 0.0], [0.5, 2.0]]),
    np.array([[0.0, 0.1], [0.0, 0.0]]),
    np.zeros((2, 2)),
    np.array([1.0, -4.0]),
    DT,
)


def coloured(seed, samples=400):
    """A record of (1 − 1.5q⁻¹ + 0.7q⁻²) y = (q⁻¹ + 0.5q⁻²) u + (1 − q⁻¹ + 0.2q⁻²) e."""
    rng = np.random.default_rng(seed)
    u, below = rng.choice([-1.0, 1.0], samples), [1.0, -1.5, 0.7]
    y = lfilter([0.0, 1.0, 0.5], below, u) + lfilter([1.0, -1.0, 0.2], below, 0.5 * rng.standard_normal(samples))
    return emsid.Record(u, y + 3.0, DT)


@pytest.mark.parametrize(("direct", "noise"), [(False, False), (True, False), (False, True), (True, True)])
def test_a_state_space_model_is_that_of_its_coefficients(direct, noise):
    outputs = 1 if noise else 2
    model = replace(
        TWO,
        c=TWO.c[:outputs],
        d=TWO.d[:outputs] * direct,
        k=np.array([[0.3], [0.1]]) if noise else TWO.k,
        level=TWO.level[:outputs],
    )
    names, values = model.coefficients(direct, noise)
    again = model.with_estimates(names, values)
    frequency = np.array([0.0, 1.0, 10.0, 50.0])
    np.testing.assert_allclose(again.response(frequency), model.response(frequency), rtol=1e-10, atol=1e-12)
    u = np.random.default_rng(0).standard_normal((50, 2))
    np.testing.assert_allclose(again.run(again.at_rest(), u)[0], model.run(model.at_rest(), u)[0], atol=1e-9)
    if noise:
        np.testing.assert_allclose(again.coefficients(direct, noise)[1], values, atol=1e-9)


@pytest.mark.parametrize(
    ("structure", "options"),
    [
        (emsid.armax(2, 2, 2), {}),
        (emsid.box_jenkins(2, 2, 2, 2), {}),
        (emsid.state_space(2, horizon=8), {}),
        (emsid.arx(2, 2, constant=True), {"free_run": True}),
    ],
    ids=["armax", "box-jenkins", "state-space", "output-error"],
)
def test_the_bands_of_linear_models_contain_the_truth(structure, options):
    """Frequency and step response of the system of Ljung's examples, each band at a few points."""
    inside = []
    for seed in range(12):
        known = coloured(seed)
        fit = emsid.fit(structure, known, **options)
        response = frequency_response_band(fit, DT).magnitude
        z = np.exp(-2j * np.pi * response.x * DT)
        exact = 20 * np.log10(np.abs((z + 0.5 * z**2) / (1 - 1.5 * z + 0.7 * z**2)))
        step = step_response_band(fit, known, size=1.0, start=0.0)
        steps = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], np.ones(len(step.x)))
        rise = np.array([2, 4, 8, 20])
        inside.append(np.abs(exact - response.value)[[0, 150, 250, 290]] <= response.half[[0, 150, 250, 290]])
        inside.append(np.abs(steps + 3.0 - step.value[:, 0])[rise] <= step.half[rise, 0])
    assert 0.86 < np.mean(inside) <= 1.0  # 96 dependent numbers of nominal level 0.95


def test_bands_of_an_armax_model_are_those_of_the_delta_method():
    fit = emsid.fit(emsid.armax(2, 2, 2), coloured(1, 2000))
    found = frequency_response_band(fit, DT)
    z = np.exp(-2j * np.pi * found.magnitude.x * DT)
    a, b = fit.estimate[:2], fit.estimate[2:4]
    above, below = b[0] * z + b[1] * z**2, 1 + a[0] * z + a[1] * z**2
    slope = np.array([-z / below, -(z**2) / below, z / above, z**2 / above]).T  # of log G
    spread = np.sqrt(np.einsum("fi,ij,fj->f", slope.real, fit.covariance[:4, :4], slope.real))
    np.testing.assert_allclose(found.magnitude.standard_error, 20 / np.log(10) * spread, rtol=0.02)


def test_several_inputs_and_outputs_have_a_band_for_each_pair():
    rng = np.random.default_rng(2)
    u = rng.standard_normal((600, 2))
    y = TWO.run(np.zeros(2), u)[0] + 0.1 * rng.standard_normal((600, 2))
    known = emsid.Record(u, y, DT)
    fit = emsid.fit(emsid.state_space(2, direct=True, horizon=6), known, free_run=True)
    for i, k in ((0, 0), (0, 1), (1, 0), (1, 1)):
        found = frequency_response_band(fit, DT, output=i, input=k).magnitude
        exact = 20 * np.log10(np.abs(TWO.response(found.x)[:, i, k]))
        assert np.mean(np.abs(exact - found.value) <= 1.6 * found.half) > 0.9
        assert np.all(found.standard_error > 0)
    step = step_response_band(fit, known, size=1.0, start=0.0, input=1)
    exact = TWO.run(np.zeros(2), np.tile([0.0, 1.0], (len(step.x), 1)))[0]
    assert np.mean(np.abs(exact - step.value) <= 1.6 * step.half) > 0.9
    assert free_run_band(fit, known).value.shape == (600, 2)
    for wrong in ({"output": 2}, {"input": -1}):
        with pytest.raises(emsid.ModelError, match="count from 0"):
            frequency_response_band(fit, DT, **wrong)
    from emsid.report.views.analysis import model_figures

    figures = model_figures([fit], [usual_step(u) for u in known.input.T], known)
    assert [figure.name for figure in figures] == ["steps-and-poles", *_numbered("frequency-response", 4)]
    captions = [figure.caption for figure in figures]
    assert "Step of u1" in captions[0]
    assert "Step of u2" in captions[0]
    assert [caption.split(" From ")[1] for caption in captions[1:]] == [
        "u1 to y1.", "u1 to y2.", "u2 to y1.", "u2 to y2.",
    ]  # fmt: skip
    # A curve of the model and one of the record, both with bands, and the coherence of the record.
    (magnitude, phase, coherence) = figures[1].plots
    assert len(magnitude.marks) == len(phase.marks) == 4
    assert np.all(coherence.marks[0].y <= 1.0)


def _numbered(name, count):
    return [name, *(f"{name}-{k}" for k in range(1, count))]


def test_a_step_is_upwards_unless_the_input_goes_mostly_down() -> None:
    up = np.linspace(-3.0, 2.0, 101)
    assert usual_step(up) == (0.0, pytest.approx(1.5))
    assert usual_step(np.linspace(-3.0, 0.5, 101)) == (0.0, pytest.approx(-2.65))
    assert usual_step(np.linspace(1.0, 2.0, 101)) == (pytest.approx(1.1), pytest.approx(1.9))
    assert usual_step(np.linspace(-10.0, -1.0, 101)) == (pytest.approx(-9.1), pytest.approx(-1.9))


def test_a_curve_that_is_infinite_somewhere_has_its_band_elsewhere_and_no_warning():
    fit = arx(deviation=(1e-3, 1e-3))
    value, error = with_error(fit, lambda model: model.parameters / np.array([1.0, 0.0]))
    assert np.isinf(value[1])
    assert np.isnan(error[1])
    assert error[0] == pytest.approx(1e-3, rel=1e-6)
    _, large = with_error(fit, lambda model: model.parameters * 1e250)
    assert large == pytest.approx(1e247 * np.ones(2), rel=1e-6)


def test_a_state_from_which_a_run_overflows_is_left_out_without_a_warning():
    u = np.repeat(np.random.default_rng(0).uniform(-6, 6, 20), 10)
    known = emsid.Record(u, 0.01 * np.cumsum(u) + 5, 0.01)
    for b, a in ((1.0, -1e30), (1.0, -3.0)):
        cascade = emsid.blocks.Cascade((Rational(np.array([b]), np.array([a, 0.2])), DeadZone()), dt=0.01)
        assert emsid.validate(cascade, known).findings[0].code == "free-run-diverged"
        assert np.shape(cascade.initial(known, 50).blocks) == (2,)
