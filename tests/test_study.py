"""The study of the paper: what its numbers must show, on this motor and on others."""

from dataclasses import replace

import numpy as np
import pytest

from emsid.errors import DataError
from emsid.estimation.fit import Ending
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.models.plants.motor import DrivenMotor
from emsid.models.regression.structures import wiener_hammerstein_regression
from emsid.plant import Bench, Friction, Motor
from emsid.report.study_page import study_report, summary_table
from emsid.study.models import BLOCKS, FRICTION, FULL, LINEAR, ONE_MASS, PAPER, TWO_MASSES, structures
from emsid.study.setup import EXPERIMENT, SIMULATION, Settings, load_friction_difference, measure
from emsid.study.summary import findings, study_data, summary
from emsid.study.workflow import study
from emsid.validation.comparison import assess


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
        for data in ("identification", "unseen")
    } | {
        (experiment, model, "gn", data)
        for model, experiment in (
            (BLOCKS, "simulation"),
            (BLOCKS, "experiment"),
            (ONE_MASS, "simulation"),
            (ONE_MASS, "experiment"),
            (TWO_MASSES, "simulation"),
        )
        for data in ("identification", "unseen")
    }
    keys = {"experiment", "model", "method", "data", "one_step_mse", "simulation_mse", "fit_percent"}
    assert all(keys <= row.keys() for row in study_data(result)["rows"])


def test_friction_regression_is_far_better_in_free_run(result):
    simulation = result.part(SIMULATION)
    linear, friction = (simulation.on_unseen(model).row.simulation_mse for model in (LINEAR, FRICTION))
    assert linear / friction > 1000


@pytest.mark.parametrize(("model", "ratio"), [(ONE_MASS, 557), (TWO_MASSES, 1e20)])
def test_physical_motor_beats_the_largest_ratio_of_the_paper(result, model, ratio):
    simulation = result.part(SIMULATION)
    linear, physical = (simulation.on_unseen(each).row.simulation_mse for each in (LINEAR, model))
    assert linear / physical >= ratio


def test_the_whole_motor_is_found_from_half_as_much_again(result):
    fit = result.part(SIMULATION).on_unseen(TWO_MASSES).fit
    assert result.part(SIMULATION).models[-1] == TWO_MASSES
    assert TWO_MASSES not in result.part(EXPERIMENT).models
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
    for part, bench in zip(result.parts, (result.settings.bench, Bench()), strict=True):
        fit = part.on_unseen(ONE_MASS).fit
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
        paper, blocks = (part.on_unseen(model).row.simulation_mse for model in (PAPER, BLOCKS))
        assert paper / blocks > 150


def test_even_polynomial_hardly_helps_a_symmetric_dead_zone(result):
    for part in result.parts:
        linear, paper = (part.on_unseen(model).row.simulation_mse for model in (LINEAR, PAPER))
        assert linear / paper == pytest.approx(1, abs=0.05)


def test_one_step_errors_hide_what_free_runs_show(result):
    linear = result.part(SIMULATION).on_unseen(LINEAR).row
    assert linear.simulation_mse > 1000 * linear.one_step_mse


def test_recursive_ends_where_batch_does(result):
    compared = []
    for part in result.parts:
        for model in (LINEAR, PAPER, FULL, FRICTION):
            batch, recursive = (part.on_unseen(model, method).fit for method in ("ls", "rls"))
            assert np.all(np.abs(recursive.estimate - batch.estimate) < 2 * batch.standard_error)
            if batch.condition < 1e5:  # beyond, the initial covariance is not large against what the data say
                np.testing.assert_allclose(recursive.estimate, batch.estimate, rtol=1e-4, atol=1e-6)
                compared.append(model)
    assert compared == [LINEAR, PAPER, FRICTION, PAPER, FRICTION]


def test_a_linear_motor_needs_no_nonlinear_model():
    motor = replace(Motor(), rotor_friction=Friction(), load_friction=Friction(), voltage_dead_zone=None)
    settings, rng = Settings(motor=motor, duration=5.0), np.random.default_rng(0)
    first, second = (measure(settings, Bench(), kind, rng) for kind in ("identification", "unseen"))
    linear = structures(first, settings.knots)[0]
    assert linear.name == LINEAR
    assert assess(least_squares(linear, first), second).row.fit_percent > 99.99


def test_load_friction_check_follows_the_motor():
    small, variance = load_friction_difference(Settings(duration=5.0))
    heavy = replace(Motor(), load_friction=Friction(5e-3))
    large, _ = load_friction_difference(Settings(motor=heavy, duration=5.0))
    assert 0 < small < 1e-6 * variance < large
    none, _ = load_friction_difference(Settings(motor=replace(Motor(), load_friction=Friction()), duration=5.0))
    assert none == 0


def found(result, code):
    return [finding for finding in findings(result) if finding.code == code]


def without_searches(patch):
    """Studies fit their regressions only."""
    patch.setattr("emsid.study.workflow.searches", lambda *_, **__: {})


@pytest.fixture(scope="module")
def heavy():
    """A study of a motor with friction on the load that matters, and more friction forward than backward."""
    rotor = Friction((0.012, 0.008), stribeck=0.002, stribeck_rate=0.3)
    motor = replace(Motor(), load_friction=Friction(5e-3), rotor_friction=rotor)
    with pytest.MonkeyPatch.context() as patch:
        without_searches(patch)
        return study(Settings(motor=motor, duration=5.0))


def test_friction_on_the_load_is_negligible_for_the_one_motor_and_not_for_another(result, heavy):
    for each, negligible in ((result, True), (heavy, False)):
        (finding,) = found(each, "study-load-friction")
        assert finding.data["negligible"] == negligible
        assert finding.data["mse"] == each.load_friction_mse


def test_even_terms_are_named_where_the_motor_is_the_same_in_both_directions(result, heavy):
    named = found(result, "study-even-terms")
    assert [finding.data["study"] for finding in named] == [EXPERIMENT, SIMULATION]
    for finding in named:
        linear, paper = (result.part(finding.data["study"]).on_unseen(model).row for model in (LINEAR, PAPER))
        assert finding.data["better"] == linear.simulation_mse / paper.simulation_mse
    assert not found(heavy, "study-even-terms")


def test_what_checks_the_estimator_only_is_said_where_it_stands(result):
    (finding,) = found(result, "study-own-simulator")
    assert (finding.subject, finding.data["study"]) == (TWO_MASSES, SIMULATION)
    assert [finding.subject for finding in found(result, "study-noise-free")] == [SIMULATION]
    checked = [(row.study, row.model) for part in result.parts for row in summary(part) if row.check]
    assert checked == [(SIMULATION, TWO_MASSES)]
    table = summary_table(result.part(SIMULATION))
    (row,) = [row for row in table.rows if "a check of the estimator, not a result" in row[1]]
    assert row[0] == TWO_MASSES
    assert row[5:] == ("check only", "check only", "", "")
    (best,) = table.emphasised
    assert table.rows[best][0] == ONE_MASS


def test_one_step_and_recursive_findings_hold_the_largest_of_their_study(result):
    for part, one, two in zip(
        result.parts, found(result, "study-one-step"), found(result, "study-recursive-and-batch"), strict=True
    ):
        rows = [row for row in part.rows if row.data == "unseen"]
        assert one.data["ratio"] == max(row.simulation_mse / row.one_step_mse for row in rows)
        batch, recursive = (part.on_unseen(two.subject, method).row.simulation_mse for method in ("ls", "rls"))
        assert two.data["difference"] == abs(recursive / batch - 1)


def test_the_summary_holds_ratios_to_the_linear_model_and_the_papers(result):
    for part, paper in zip(result.parts, ((24.2, 2.83), (22.0, 557.0)), strict=True):
        rows = {row.model: row for row in summary(part)}
        assert tuple(rows) == part.models
        assert rows[LINEAR].better_identification == rows[LINEAR].better_unseen == 1
        linear, friction = (part.on_unseen(model).row.simulation_mse for model in (LINEAR, FRICTION))
        assert rows[FRICTION].better_unseen == linear / friction
        published = (rows[PAPER].paper_identification, rows[PAPER].paper_unseen)
        assert published == pytest.approx(paper, rel=0.01)
        assert rows[FRICTION].paper_unseen is None


def test_the_page_opens_with_a_table_for_each_study_the_experiment_first(result):
    page = study_report(result)
    captions = [table.caption for table in page.opening.tables]
    assert [caption.split(":")[0] for caption in captions] == ["Experiment", "Simulation"]
    for table, part in zip(page.opening.tables, result.parts, strict=True):
        assert [row[0] for row in table.rows] == list(part.models)
    assert len(page.summary) == 1
    titles = [section.title for section in page.sections]
    assert titles.index("The experiment study") < titles.index("The simulation study")


def test_seed_decides_the_noise_and_nothing_else():
    settings = Settings(duration=2.0)
    one, same, other = (
        measure(settings, Bench.typical(), "identification", np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.output, same.output)
    assert np.any(one.output != other.output)
    np.testing.assert_array_equal(one.input, other.input)


@pytest.fixture
def regressions_only(monkeypatch):
    """A study without the models that need a search, for tests of what happens around the models."""
    without_searches(monkeypatch)


def test_records_of_the_user_take_the_place_of_the_bench(regressions_only):
    settings = Settings(duration=5.0)
    rng = np.random.default_rng(5)
    records = tuple(measure(settings, Bench.typical(), kind, rng) for kind in ("identification", "unseen"))
    done = study(settings, records)
    experiment = done.part(EXPERIMENT)
    assert not found(done, "study-virtual-bench")
    assert experiment.identification is records[0]
    assert experiment.unseen is records[1]


def cancelled_at(doing):
    """A control that is cancelled when something is done."""
    heard = []
    return Control(cancelled=lambda: doing in heard, report=lambda activity: heard.append(activity.doing))


def test_an_interrupted_study_keeps_its_finished_part(regressions_only):
    kept = study(Settings(duration=2.0), control=cancelled_at(f"{SIMULATION}: {PAPER}"))
    assert kept.interrupted
    assert [(part.name, part.interrupted) for part in kept.parts] == [(EXPERIMENT, False), (SIMULATION, True)]
    assert kept.part(SIMULATION).models == (LINEAR,)
    assert study_report(kept).sections


def test_a_study_interrupted_in_a_search_keeps_what_the_regressions_show():
    kept = study(Settings(duration=2.0), control=cancelled_at(f"{EXPERIMENT}: {ONE_MASS}"))
    assert kept.interrupted
    (part,) = kept.parts
    assert part.interrupted
    assert ONE_MASS not in part.models
    assert {LINEAR, FRICTION, BLOCKS} <= set(part.models)
    assert study_report(kept).sections


def test_a_study_cancelled_before_its_first_model_has_no_result():
    with pytest.raises(Stopped):
        study(Settings(duration=2.0), control=Control(cancelled=lambda: True))


def test_too_short_a_study_is_refused():
    with pytest.raises(DataError, match="duration"):
        Settings(duration=0.1)


def test_two_records_with_the_same_input_are_refused(result):
    record = result.part(SIMULATION).identification
    with pytest.raises(DataError, match="have the same input"):
        study(records=(record, record))


def test_a_model_that_cannot_be_fitted_is_named(result, monkeypatch):
    def defeated(*_):
        raise np.linalg.LinAlgError("no convergence")

    monkeypatch.setattr("emsid.study.models.estimate_cascade", defeated)
    part = study(replace(result.settings, duration=4.0)).part(SIMULATION)
    assert BLOCKS not in part.models
    assert list(part.failed) == [BLOCKS]
    assert "out of range (no convergence)" in part.failed[BLOCKS]
    shorter = replace(result, parts=(part,))
    (finding,) = found(shorter, "study-model-failed")
    assert (finding.subject, finding.data["problem"]) == (BLOCKS, part.failed[BLOCKS])
    assert not found(result, "study-model-failed")


def test_a_regression_that_the_data_do_not_determine_is_named(result):
    part = result.part(SIMULATION)
    assert not found(result, "study-rank-deficient")
    levels = np.sign(part.identification.input - np.mean(part.identification.input))  # of two levels, so u² is constant
    fit = least_squares(wiener_hammerstein_regression(na=1, nb=2, degree=2), replace(part.identification, input=levels))
    assert fit.ending is Ending.RANK_DEFICIENT
    (finding,) = found(replace(result, parts=(replace(part, fits=(fit,)),)), "study-rank-deficient")
    data = {"study": SIMULATION, "method": "ls", "rank": fit.rank, "parameters": len(fit.names)}
    assert (finding.subject, finding.data) == (fit.model.name, data)
    assert fit.rank < len(fit.names)
