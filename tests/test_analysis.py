"""Everyday analysis in one call: linear parts, responses, forecasts, residuals and spectra, of any kind of model."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import emsid
from emsid.models.linear.process_model import ProcessModel
from emsid.models.linear.state_space import run_linear
from emsid.models.linear.system import LinearSystem
from model_examples import ALL, DT, inputs

WITHOUT = ("own plant", "friction", "process, late")
at_dt = [
    name
    for name, model in ALL.items()
    if not any(word in name for word in WITHOUT) and model.dt and "oversampling" not in name
]


@pytest.fixture(scope="module")
def record() -> emsid.Record:
    """2000 samples of y(t) = 1.2 y(t−1) − 0.5 y(t−2) + 0.3 u(t−1) + e(t), e of size 0.01."""
    rng = np.random.default_rng(1)
    u, noise, y = rng.standard_normal(2000), 0.01 * rng.standard_normal(2000), np.zeros(2000)
    for t in range(2, 2000):
        y[t] = 1.2 * y[t - 1] - 0.5 * y[t - 2] + 0.3 * u[t - 1] + noise[t]
    return emsid.Record(u, y, DT, "voltage", "speed", "V", "rad/s")


@pytest.fixture(scope="module")
def fit(record: emsid.Record) -> emsid.Fit[Any]:
    return emsid.fit(emsid.arx(2, 1), record)


@pytest.mark.parametrize("name", at_dt)
def test_the_linear_part_is_the_response_to_a_small_step(name: str) -> None:
    model, small = ALL[name], 1e-6
    system = emsid.linearize(model)
    system = system if system.dt else system.to_discrete(DT)
    late, step = round(system.delay / DT), np.zeros((60, 1))
    step[5 + late :] = 1.0
    expected, _ = run_linear(system.a, system.b, system.c, system.d, np.zeros(len(system.a)), step)
    nothing, moved = np.zeros((60, 1)), np.zeros((60, 1))
    moved[5:] = small
    rest = model.at_rest(0.0, DT)
    found = (model.run(rest, moved)[0] - model.run(rest, nothing)[0]) / small
    np.testing.assert_allclose(found, expected, atol=1e-4 * max(1e-3, float(np.abs(expected).max())))


def test_of_the_paper_motor_the_pole_is_its_time_constant() -> None:
    plant = emsid.plants.rigid_motor()
    known = {quantity.name: quantity.value for quantity in plant.quantities()}
    slowest = emsid.poles(plant)
    assert 1 / known["mechanical time constant"] == pytest.approx(float(np.abs(slowest).max()))
    discrete = emsid.to_discrete(plant, 0.005)
    assert np.sort(np.abs(discrete.poles)) == pytest.approx(np.sort(np.exp(-0.005 * np.abs(slowest))))
    again = discrete.to_continuous()
    f = np.array([0.1, 1.0, 10.0])
    np.testing.assert_allclose(again.response(f), emsid.linearize(plant).response(f), rtol=1e-8)


def test_poles_and_zeros_of_an_arx(fit: emsid.Fit[Any]) -> None:
    assert np.sort_complex(emsid.poles(fit)) == pytest.approx(np.sort_complex(np.roots([1, *fit.estimate[:2]])))
    two = emsid.fit(emsid.arx(2, 2), emsid.simulate(ALL["arx"], inputs()))
    (zero,) = emsid.zeros(two)
    assert zero == pytest.approx(-two["b2"].value / two["b1"].value)


def test_a_negative_pole_has_no_continuous_time() -> None:
    system = LinearSystem(np.array([[-0.5]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)), 0.1)
    with pytest.raises(emsid.ModelError, match="zero or negative"):
        system.to_continuous()


def test_what_has_no_linear_part_says_so() -> None:
    with pytest.raises(emsid.ModelError, match="no linear part"):
        emsid.linearize(ALL["own plant"])
    with pytest.raises(emsid.ModelError, match="does not come to rest"):
        emsid.poles(ALL["friction"])
    with pytest.raises(emsid.ModelError, match="give one, dt"):
        emsid.step(emsid.plants.rigid_motor())


def test_responses_have_bands_and_agree(fit: emsid.Fit[Any]) -> None:
    step, pulse, bode = emsid.step(fit, 2.0), emsid.impulse(fit), emsid.bode(fit)
    gain = float(emsid.linearize(fit).gain[0, 0])
    assert step.value[-1, 0] == pytest.approx(2.0 * gain, rel=0.01)
    assert step.low[-1, 0] < 2.0 * 0.3 / 0.3 < step.high[-1, 0]
    np.testing.assert_allclose(2.0 * DT * np.cumsum(pulse.value[:, 0]), step.value[:, 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        bode.magnitude.value, 20 * np.log10(np.abs(emsid.linearize(fit).response(bode.magnitude.x)[:, 0, 0])), atol=1e-9
    )
    assert list(step.to_frame().columns) == ["t", "value", "low", "high"]
    assert np.isnan(emsid.step(fit.model).half).all()


def test_a_forecast_holds_what_comes_in_the_share_that_it_claims(record: emsid.Record, fit: emsid.Fit[Any]) -> None:
    inside = []
    for end in range(200, 1900, 20):
        ahead = emsid.forecast(fit, record[:end], record.input[end : end + 10])
        measured = record.output[end : end + 10, 0]
        inside.append((ahead.low <= measured) & (measured <= ahead.high))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
    assert ahead.half[0] == pytest.approx(1.96 * 0.01, rel=0.1)
    white = 0.01 * np.sqrt(1 + 1.2**2)  # of the model, two samples ahead
    assert ahead.half[1] == pytest.approx(1.96 * white, rel=0.1)
    assert ahead.x[0] == pytest.approx(record[:end].time[-1] + DT)


def test_predictions_are_records(record: emsid.Record, fit: emsid.Fit[Any]) -> None:
    ahead = emsid.predict(fit, record, 3)
    assert (ahead.output_names, ahead.output_units) == (("speed",), ("rad/s",))
    assert np.array_equal(ahead.output, fit.model.predict(record, 3).output)


def test_residuals_of_the_true_structure_are_white(record: emsid.Record, fit: emsid.Fit[Any]) -> None:
    found = fit.residuals(record)
    assert found.whiteness[0].white
    assert np.std(found.one_step.output) == pytest.approx(0.01, rel=0.05)
    assert len(found.one_step) == len(record) - fit.model.memory
    assert found.to_frame().columns == ["t", "voltage", "speed"]
    lower = emsid.residuals(emsid.fit(emsid.arx(1, 1), record), record)
    assert not lower.whiteness[0].white
    assert "not white" in str(lower)


def test_a_comparison_becomes_a_frame(record: emsid.Record, fit: emsid.Fit[Any]) -> None:
    frame = emsid.compare(fit, record).to_frame("pandas")
    np.testing.assert_array_equal(frame["speed"] - frame["speed by arx"], frame["error of speed by arx"])


def test_the_spectrum_of_a_linear_system_is_its_frequency_response(record: emsid.Record, fit: emsid.Fit[Any]) -> None:
    found = emsid.frequency_response(record, "welch")
    truth = emsid.linearize(fit).response(found.frequency)[:, 0, 0]
    error = np.abs(found.response[:, 0, 0] - truth)
    assert np.median(error / np.abs(truth)) < 0.05
    assert np.min(found.coherence) > 0.8
    noise = replace(record, output=np.random.default_rng(3).standard_normal((2000, 1)))
    assert np.median(emsid.frequency_response(noise, "welch").coherence) < 0.2
    with pytest.raises(emsid.DataError, match="does not change"):
        emsid.frequency_response(replace(record, input=np.ones((2000, 1))), "welch")


def test_advice_is_that_of_a_first_look(record: emsid.Record) -> None:
    advice = emsid.advice(record)
    assert "rich enough" in str(advice)
    assert all(isinstance(each, emsid.findings.Finding) for each in advice)


@pytest.mark.parametrize("delay", [0.0, 0.0237])
def test_a_process_is_recovered_with_its_time_constants(delay: float) -> None:
    truth = emsid.ProcessModel(2.5, (0.05, 0.21), 0.0, delay, 0.4, DT)
    u = np.random.default_rng(2).uniform(-1, 1, 60).repeat(25)
    clean = emsid.simulate(truth, u)
    record = replace(clean, output=clean.output + 0.01 * np.random.default_rng(3).standard_normal(clean.output.shape))
    fit = emsid.fit(emsid.process_model(poles=2, delay=delay > 0), record)
    assert fit.ending is emsid.Ending.CONVERGED
    found = {name: row.value for name, row in fit.parameters.items()}
    times = sorted((found["T1"], found["T2"]))
    assert times == pytest.approx([0.05, 0.21], rel=0.05)
    assert (found["gain"], found["offset"], found.get("delay", 0.0)) == pytest.approx((2.5, 0.4, delay), abs=5e-3)
    low, high = fit["gain"].interval
    assert low < 2.5 < high
    assert emsid.step(fit).known
    time = np.maximum(DT * np.arange(200) - delay, 0.0)
    exact = 2.5 * (1 + (0.05 * np.exp(-time / 0.05) - 0.21 * np.exp(-time / 0.21)) / (0.21 - 0.05)) + 0.4
    np.testing.assert_allclose(emsid.simulate(truth, np.ones(200)).output[:, 0], exact, atol=1e-9)


def test_the_response_of_a_process_needs_no_states_for_whole_samples_of_its_dead_time() -> None:
    f = np.geomspace(0.1, 49, 50)
    for delay in (0.0, 0.004, 0.03, 0.0999999999):
        model = ProcessModel(2.0, (0.08, 0.03), 0.02, delay, 0.1, 0.01)
        np.testing.assert_allclose(model.response(f), model.form.response(f), atol=1e-13)
    late = ProcessModel(2.0, (0.08, 0.03), 0.02, 90.0, 0.1, 0.01)  # 9,000 states, of 650 MB
    np.testing.assert_allclose(np.abs(late.response(f)), np.abs(replace(late, delay=0.0).response(f)))


def test_analyses_of_several_models_are_drawn_in_one_picture(record: emsid.Record, fit: emsid.Fit[Any]) -> None:
    first = emsid.fit(emsid.arx(1, 1), record)
    for several in (
        emsid.step([fit, first]),
        emsid.impulse([fit, first]),
        emsid.bode([fit, first, record]),
        emsid.pole_map([fit, first]),
        emsid.residuals([fit, first], record),
    ):
        alone = several[0]
        assert several.labels[:2] == ("arx", "arx, no. 2")
        assert len(several.plot().axes) >= 1
        assert len(several.plot().axes) == len(alone.plot().axes) or isinstance(alone, type(emsid.bode(fit)))
        frame = several.to_frame()
        assert frame.columns[0] == "model"
        assert frame.height == sum(each.to_frame().height for each in several)
        assert all(len(repr(each)) < 80 for each in (several, *several))
    np.testing.assert_array_equal(emsid.step([fit])[0].value, emsid.step(fit).value)


def test_the_frequency_response_of_a_record_has_the_response_of_the_system_in_its_band(
    record: emsid.Record, fit: emsid.Fit[Any]
) -> None:
    found = emsid.bode(record)
    true = 20 * np.log10(np.abs(emsid.linearize(fit).response(found.magnitude.x)[:, 0, 0]))
    inside = (found.magnitude.low <= true) & (true <= found.magnitude.high)
    assert 0.88 < inside.mean() <= 1.0
    assert found.coherence is not None
    assert found.coherence.min() > 0.9
    whole = emsid.frequency_response(record, "welch").to_frame()
    assert whole.columns == ["frequency", "magnitude", "phase", "deviation", "coherence"]


def test_the_errors_of_poles_are_those_that_they_have(record: emsid.Record) -> None:
    """Over 60 records of another noise; the poles are 0.6 ± 0.374i."""
    rng, maps = np.random.default_rng(2), []
    for _ in range(60):
        y, noise = np.zeros(500), 0.1 * rng.standard_normal(500)
        u = rng.standard_normal(500)
        for t in range(2, 500):
            y[t] = 1.2 * y[t - 1] - 0.5 * y[t - 2] + 0.3 * u[t - 1] + noise[t]
        found = emsid.pole_map(emsid.fit(emsid.arx(2, 1), emsid.Record(u, y, DT)))
        maps.append((found.poles[found.poles.imag > 0][0], found.standard_error[0]))
    poles, errors = np.array(maps).T
    for part in (np.real, np.imag):
        assert part(poles).std() == pytest.approx(np.nanmedian(part(errors)), rel=0.25)


def test_no_pole_belongs_to_an_angle_that_no_output_shows() -> None:
    plant = emsid.plants.rigid_motor()
    found = emsid.pole_map(plant)
    assert np.all(found.poles.real < 0)
    assert len(found.zeros) == 0
    assert np.isnan(found.standard_error).all()


def test_a_fit_has_a_frame_and_a_clear_error(fit: emsid.Fit[Any]) -> None:
    frame = fit.to_frame()
    assert frame.columns == ["parameter", "value", "unit", "low", "high", "status"]
    np.testing.assert_array_equal(frame["value"].to_numpy(), fit.estimate)
    with pytest.raises(AttributeError, match=r"a fit of arx has no attribute 'intervals'; did you mean interval\?"):
        _ = fit.intervals


def test_inputs_alone_run_at_the_sample_time_of_the_fit(record: emsid.Record) -> None:
    motor = emsid.fit(emsid.plants.rigid_motor(), record[:200], search=False, free="motor_constant")
    u = record.input[:50]
    np.testing.assert_array_equal(motor.simulate(u).output, motor.simulate(u, dt=record.dt).output)


def test_a_forecast_needs_inputs(record: emsid.Record, fit: emsid.Fit[Any]) -> None:
    with pytest.raises(emsid.DataError, match="needs the inputs after the record"):
        emsid.forecast(fit, record, 10)
    with pytest.raises(emsid.DataError, match=r"compare\(\[linear, motor\], record\)"):
        emsid.compare(record, [fit])


def test_names_of_matlab_say_what_to_write_here() -> None:
    """Every one says something; what it names exists."""
    for name, here in emsid.OF_MATLAB.items():
        with pytest.raises(AttributeError, match=f"emsid has no '{name}'; write "):
            getattr(emsid, name)
        for used in re.findall(r"emsid((?:\.\w+)+)", here):
            found: Any = emsid
            for part in used.split(".")[1:]:
                found = getattr(found, part)
    with pytest.raises(AttributeError, match=r"emsid has no 'residual'; did you mean residuals\?"):
        _ = emsid.residual


@pytest.mark.parametrize("name", ALL)
def test_a_model_prints_in_one_short_line(name: str) -> None:
    shown = repr(ALL[name])
    assert len(shown) < 100
    assert "array" not in shown
    assert "\n" not in shown


def test_an_identification_and_a_first_look_have_frames(record: emsid.Record) -> None:
    result = emsid.identify(record, models=["arx", "output-error"])
    frame = result.to_frame()
    assert frame.filter(frame["chosen"])["model"].to_list() == [result.chosen.model.name]
    assert set(frame["model"]) == {"arx", "output-error"}
    assert frame["simulation_rmse"].to_list() == [row.simulation_rmse for row in result.rows]
    assert set(frame["verdict"]) <= {"supported", "limited", "implausible", "unusable"}
    look = emsid.describe({"t": record.time, "u": record.input[:, 0], "y": record.output[:, 0]}).to_frame()
    assert look["column"].to_list() == ["t", "u", "y"]
    assert look["high"].to_list() == [record.time.max(), record.input.max(), record.output.max()]
