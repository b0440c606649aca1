"""The study of the paper: what its numbers must show, on this motor and on others."""

from dataclasses import replace

import numpy as np
import pytest

from emsid.errors import DataError
from emsid.models.plants.motor import DrivenMotor
from emsid.plant import Bench, Friction, Motor
from emsid.study.workflow import (
    BLOCKS,
    FRICTION,
    FULL,
    LINEAR,
    ONE_MASS,
    PAPER,
    SIMULATION,
    TWO_MASSES,
    Settings,
    findings,
    load_friction_difference,
    measure,
    report,
    study,
)


@pytest.fixture(scope="module")
def result():
    return study()


def test_rows_are_complete(result):
    rows = {(row.experiment, row.model, row.method, row.data) for row in result.rows}
    assert rows == {
        (experiment, model, method, data)
        for experiment in ("simulation", "experiment")
        for model in (LINEAR, PAPER, FULL, FRICTION)
        for method in ("ls", "rls")
        for data in ("identification", "verification")
    } | {
        (experiment, model, "gn", data)
        for model, experiment in (
            (BLOCKS, "simulation"),
            (BLOCKS, "experiment"),
            (ONE_MASS, "simulation"),
            (ONE_MASS, "experiment"),
            (TWO_MASSES, "simulation"),
        )
        for data in ("identification", "verification")
    }
    keys = {"experiment", "model", "method", "data", "one_step_mse", "simulation_mse", "fit_percent"}
    assert all(keys <= row.keys() for row in result.to_data()["rows"])


def test_friction_regression_is_far_better_in_free_run(result):
    simulation = result.parts[0]
    linear, friction = (simulation.verified(model).row.simulation_mse for model in (LINEAR, FRICTION))
    assert linear / friction > 1000


@pytest.mark.parametrize(("model", "ratio"), [(ONE_MASS, 557), (TWO_MASSES, 1e20)])
def test_physical_motor_beats_the_largest_ratio_of_the_paper(result, model, ratio):
    simulation = result.parts[0]
    linear, physical = (simulation.verified(each).row.simulation_mse for each in (LINEAR, model))
    assert linear / physical >= ratio


def test_the_whole_motor_is_found_from_half_as_much_again(result):
    fit = result.parts[0].verified(TWO_MASSES).fit
    assert result.parts[0].models[-1] == TWO_MASSES
    truth = np.array([DrivenMotor(Motor()).value(name) for name in fit.names])
    assert len(truth) == 10
    assert np.all(np.abs(fit.estimate - truth) < 1.96 * fit.standard_error)
    assert np.all(fit.standard_error < 1e-7 * truth)
    assert {row.status for row in fit.table} == {"estimated"}


def test_physical_motor_tells_the_constants_that_the_plant_has_from_half_as_much_again(result):
    # The inertia is the exception: one mass has the difference of the two time constants, J·R/K² − L/R.
    truth = {"motor_constant": 0.05, "rotor_friction.coulomb": 8e-3, "voltage_dead_zone.half_width": 0.5}
    motor, electrical = Motor(), 2e-3 / 2.0
    mechanical = (motor.rotor_inertia + motor.load_inertia) * motor.resistance / motor.motor_constant**2
    for part, bench in zip(result.parts, (Bench(), result.settings.bench), strict=True):
        fit = part.verified(ONE_MASS).fit
        found = dict(zip(fit.names, zip(fit.estimate, fit.standard_error, strict=True), strict=True))
        for name, value in truth.items():
            estimate, error = found[name]
            assert abs(estimate - value) < 1.96 * error < 0.03 * value
        lumped = fit.model.plant.motor
        seen = (lumped.rotor_inertia + lumped.load_inertia) * lumped.resistance / lumped.motor_constant**2
        assert seen == pytest.approx(mechanical - electrical, rel=0.01)
        assert found["drive.delay"][0] == pytest.approx(electrical + bench.delay, rel=0.1)


def test_three_blocks_are_far_better_than_their_expansion(result):
    for part in result.parts:
        paper, blocks = (part.verified(model).row.simulation_mse for model in (PAPER, BLOCKS))
        assert paper / blocks > 150


def test_even_polynomial_hardly_helps_a_symmetric_dead_zone(result):
    for part in result.parts:
        linear, paper = (part.verified(model).row.simulation_mse for model in (LINEAR, PAPER))
        assert linear / paper == pytest.approx(1, abs=0.05)


def test_one_step_errors_hide_what_free_runs_show(result):
    linear = result.parts[0].verified(LINEAR).row
    assert linear.simulation_mse > 1000 * linear.one_step_mse


def test_recursive_ends_where_batch_does(result):
    compared = []
    for part in result.parts:
        for model in (LINEAR, PAPER, FULL, FRICTION):
            batch, recursive = (part.verified(model, method).fit for method in ("ls", "rls"))
            assert np.all(np.abs(recursive.estimate - batch.estimate) < 2 * batch.standard_error)
            if batch.condition < 1e5:  # beyond, the initial covariance is not large against what the data say
                np.testing.assert_allclose(recursive.estimate, batch.estimate, rtol=1e-4, atol=1e-6)
                compared.append(model)
    assert compared == [PAPER, FRICTION, LINEAR, PAPER, FRICTION]


def test_a_linear_motor_needs_no_nonlinear_model():
    motor = replace(Motor(), rotor_friction=Friction(), load_friction=Friction(), voltage_dead_zone=None)
    part = study(Settings(motor=motor, duration=5.0)).parts[0]
    assert part.verified(LINEAR).row.fit_percent > 99.99


def test_load_friction_check_follows_the_motor():
    small, variance = load_friction_difference(Settings(duration=5.0))
    heavy = replace(Motor(), load_friction=Friction(5e-3))
    large, _ = load_friction_difference(Settings(motor=heavy, duration=5.0))
    assert 0 < small < 1e-6 * variance < large
    none, _ = load_friction_difference(Settings(motor=replace(Motor(), load_friction=Friction()), duration=5.0))
    assert none == 0


def test_findings_are_computed(result):
    text = " ".join(findings(result))
    ratio = result.parts[0].verified(LINEAR).row.simulation_mse / result.parts[0].verified(FRICTION).row.simulation_mse
    assert f"1/{ratio:,.0f}" in text
    assert "is fair" in text
    heavy = replace(Motor(), load_friction=Friction(5e-3))
    other = study(Settings(motor=heavy, duration=5.0))
    assert "not fair" in " ".join(findings(other))


def test_seed_decides_the_noise_and_nothing_else():
    settings = Settings(duration=2.0)
    one, same, other = (
        measure(settings, Bench.typical(), "identification", np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.output, same.output)
    assert np.any(one.output != other.output)
    np.testing.assert_array_equal(one.input, other.input)


def test_records_of_the_user_take_the_place_of_the_bench():
    settings = Settings(duration=5.0)
    rng = np.random.default_rng(5)
    records = tuple(measure(settings, Bench.typical(), kind, rng) for kind in ("identification", "verification"))
    experiment = study(settings, records).parts[1]
    assert experiment.identification is records[0]
    assert experiment.verification is records[1]


def test_interrupted_study_keeps_its_finished_part():
    def stop_at_experiment(what, fraction):
        if what.startswith("experiment"):
            raise KeyboardInterrupt

    kept = study(Settings(duration=2.0), progress=stop_at_experiment)
    assert kept.interrupted
    assert [part.name for part in kept.parts] == ["simulation"]
    assert not any("experiment" in section.title for section in report(kept).sections)
    assert any("simulation" in section.title for section in report(kept).sections)


def test_a_study_interrupted_in_a_search_keeps_what_the_regressions_show():
    def stop_at_motor(what, fraction):
        if what == f"{SIMULATION}: {ONE_MASS}":
            raise KeyboardInterrupt

    kept = study(Settings(duration=2.0), progress=stop_at_motor)
    assert kept.interrupted
    (part,) = kept.parts
    assert part.interrupted
    assert ONE_MASS not in part.models
    assert {LINEAR, FRICTION, BLOCKS} <= set(part.models)
    assert report(kept).sections


def test_too_short_a_study_is_refused():
    with pytest.raises(DataError, match="duration"):
        Settings(duration=0.1)


def test_verifying_on_the_same_input_is_refused(result):
    record = result.parts[0].identification
    with pytest.raises(DataError, match="have the same input"):
        study(records=(record, record))


def test_a_model_that_cannot_be_fitted_is_named(result, monkeypatch):
    def defeated(*_):
        raise np.linalg.LinAlgError("no convergence")

    monkeypatch.setattr("emsid.study.workflow.wiener_hammerstein", defeated)
    part = study(replace(result.settings, duration=4.0)).parts[0]
    assert BLOCKS not in part.models
    assert list(part.failed) == [BLOCKS]
    assert "out of range (no convergence)" in part.failed[BLOCKS]
    shorter = replace(result, parts=(part,))
    assert f"{BLOCKS} could not be fitted: {part.failed[BLOCKS]}." in findings(shorter)
