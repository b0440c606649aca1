"""The study of the paper: what its numbers must show, on this motor and on others."""

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from emsid.cli.commands.study import _print
from emsid.errors import DataError
from emsid.estimation.fit import Ending
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.excitation import sines
from emsid.models.plants.motor import DrivenMotor
from emsid.models.regression.structures import friction_narx, wiener_hammerstein_regression
from emsid.plant import Bench, Friction, Motor
from emsid.record import Record
from emsid.report.document import Wire
from emsid.report.numbers import number
from emsid.report.study_page import WORST, beside, lead_inputs, models_table, study_report, study_rows, times
from emsid.study.models import (
    BLOCKS,
    CHOSEN,
    EXPERIMENT,
    FIXED,
    FRICTION,
    FULL,
    INPUTS,
    LINEAR,
    ONE_MASS,
    PAPER,
    SIMULATION,
    START,
    TWO_MASSES,
    Settings,
    load_friction_difference,
    measure,
    structures,
    two_masses,
)
from emsid.study.summary import about_the_survey, findings, headline, paper_ratios, study_data, summary
from emsid.study.survey import (
    FREE_RUN,
    HIGHEST_ORDER,
    ONE_STEP,
    load_friction,
    recorded,
    records,
    regressions,
    rotor_level,
)
from emsid.study.workflow import study
from emsid.validation.comparison import assess
from emsid.wording import sentence
from emsid.wording.claims import claim
from independent.two_masses import load_speed

sys.path.insert(0, str(Path(__file__).parents[1] / "bench"))
from survey import (
    FAMILY,
    READINGS,
    by_direction,
    compare,
    largest,
    motors,
    over_inputs,
    ratios,
)
from survey import row as two_mass_row


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


def test_all_models_are_compared_on_the_same_samples(result):
    for part in result.parts:
        assert len({row.samples for row in part.rows}) == 1


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
    statuses = {row.name: row.status for row in fit.table}
    assert {name for name, status in statuses.items() if status == "fixed"} == set(FIXED)
    assert {statuses[name] for name in fit.names} <= {"estimated", "depends on kept values"}


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
    patch.setattr("emsid.study.workflow.chosen", lambda *_: {})


@pytest.fixture(scope="module")
def heavy():
    """A study of a motor with friction on the load that matters, and more friction forward than backward."""
    rotor = Friction((0.012, 0.008), stribeck=0.002, stribeck_rate=0.3)
    motor = replace(Motor(), load_friction=Friction(5e-3), rotor_friction=rotor)
    with pytest.MonkeyPatch.context() as patch:
        without_searches(patch)
        return study(Settings(motor=motor, duration=5.0))


def test_friction_on_the_load_is_judged_by_what_it_costs(result):
    (finding,) = found(result, "study-load-friction")
    curve, data = result.load_friction, finding.data
    assert data["mse"] == result.load_friction_mse
    assert curve.differences[0] == 0
    # Nearly without noise, the difference grows with the square of the friction.
    np.testing.assert_allclose(curve.differences[-1] / curve.differences[-3], 4, rtol=0.05)
    assert max(curve.errors) < 1.05 * min(curve.errors)
    assert data["unfair_from"] is None
    assert 0.05 < data["visible_from"] < 0.075
    level = rotor_level(result.settings.motor)
    motor = replace(result.settings.motor, load_friction=Friction(data["visible_from"] * level))
    settings, rng = replace(result.settings, motor=motor), np.random.default_rng(1)
    unseen = measure(settings, Bench(), "unseen", rng)
    without = measure(replace(settings, motor=replace(motor, load_friction=Friction())), Bench(), "unseen", rng)
    difference = np.mean((unseen.output - without.output) ** 2)
    assert difference == pytest.approx(np.interp(data["visible_from"], curve.fitted, curve.errors), rel=0.02)


def test_all_models_of_a_motor_are_judged_on_the_same_samples(result):
    assert result.part(SIMULATION).on_unseen(BLOCKS).fit.model.memory == START
    assessed = [each for pair in regressions(FAMILY[0], Settings(duration=2.0)) for each in pair]
    assert {each.row.samples for each in assessed} == {len(assessed[0].record) - START}


def test_a_rotor_without_friction_has_no_curve_of_load_friction(result):
    motor = replace(Motor(), rotor_friction=Friction())
    blocks = result.part(SIMULATION).on_unseen(BLOCKS).fit.model
    assert load_friction(replace(result.settings, motor=motor), blocks) is None
    assert not found(replace(result, load_friction=None), "study-load-friction")


def test_even_terms_are_named_where_the_motor_is_the_same_in_both_directions(result, heavy):
    (finding,) = found(result, "study-even-terms")
    assert [each["study"] for each in finding.data["studies"]] == [part.called for part in result.parts]
    assert [part.called for part in result.parts] == ["virtual bench", SIMULATION]
    for each, part in zip(finding.data["studies"], result.parts, strict=True):
        linear, paper = (part.on_unseen(model).row for model in (LINEAR, PAPER))
        assert each["better"] == linear.simulation_mse / paper.simulation_mse
    assert not found(heavy, "study-even-terms")


def test_a_study_without_records_of_the_user_is_of_a_virtual_bench(result):
    assert [finding.subject for finding in found(result, "study-virtual-bench")] == [EXPERIMENT]


def test_what_checks_the_estimator_only_is_said_where_it_stands(result):
    (finding,) = found(result, "study-own-simulator")
    assert (finding.subject, finding.data["study"]) == (TWO_MASSES, SIMULATION)
    assert [finding.subject for finding in found(result, "study-noise-free")] == [SIMULATION]
    checked = [(row.study, row.model) for part in result.parts for row in summary(part) if row.check]
    assert checked == [(SIMULATION, TWO_MASSES)]
    table = models_table(study_rows(result), lead_inputs(result))
    (row,) = [row for row in table.rows if "a check of the estimator, not a result" in row[-1]]
    assert row[:-1] == (TWO_MASSES, "10", "", "", "check only", "", "")
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


def test_the_page_opens_with_three_sentences_and_one_picture(result, heavy):
    page = study_report(result)
    (picture,) = page.opening.figures
    codes = [finding.code for finding in headline(findings(result))]
    assert codes == ["study-best-model", "study-paper-ratios", "study-even-terms"]
    assert page.summary[:3] == tuple(sentence(finding) for finding in headline(findings(result)))
    assert "virtual bench" in page.summary[3]
    assert [section.title for section in page.sections[:2]] == ["The virtual bench", "The simulation"]
    assert page.summary[1].startswith("The paper's nonlinear model is worse than its linear one: MSE ratio ×0.9")
    assert "on the virtual bench (paper: ×2.83)" in page.summary[1]
    assert not page.opening.tables
    through_zero, ratios = picture.plots
    lines = {mark.label: mark for mark in through_zero.marks}
    assert list(lines) == ["measured", LINEAR, PAPER, ONE_MASS]
    assert lines["measured"].y.min() < 0 < lines["measured"].y.max()
    bars, paper = ratios.marks
    rows = [row for row in summary(result.part(EXPERIMENT)) if not row.check]
    assert list(bars.values) == [row.better_unseen for row in rows]
    assert (list(paper.x), [rows[int(k)].model for k in paper.y]) == (pytest.approx([2.83], rel=0.01), [PAPER])
    # On a motor with unequal directions the reason is another one.
    assert [finding.code for finding in headline(findings(heavy))][2] == "study-what-decides"


def test_the_papers_tables_stand_beside_those_of_the_study(result):
    page = study_report(result)
    titles = [section.title for section in page.sections]
    published, models = page.sections[titles.index("The paper's tables beside this study")].tables
    assert [row[:2] for row in published.rows] == [
        (study, data) for study in ("virtual bench", SIMULATION) for data in ("identification", "unseen")
    ]
    assert published.rows[3][2:5] == ("0.002264", "4.063e-6", "×557")
    unseen = result.part(SIMULATION).on_unseen
    here = [unseen(model).row.simulation_mse for model in (LINEAR, PAPER)]
    assert published.rows[3][5:8] == (*map(number, here), beside(here[0] / here[1]))
    assert [row[0] for row in models.rows] == list(result.part(SIMULATION).models)
    many = {row.model: row for row in recorded().inputs}
    for row in models.rows[1:-1]:
        for part, cell in zip(result.parts, row[3:5], strict=True):
            on_linear, on_model = (part.on_unseen(model).row.simulation_mse for model in (LINEAR, row[0]))
            assert cell == beside(on_linear / on_model)
        assert row[5] == beside(many[row[0]].median)
    (paper,) = [row for row in models.rows if row[0] == PAPER]
    assert all(cell.endswith(", worse") for cell in paper[3:6])


def test_findings_about_the_paper_are_one_table_of_claims(result):
    page = study_report(result)
    (table,) = next(section for section in page.sections if section.title == "Claims of the paper").tables
    compared = [finding for finding in findings(result) if claim(finding) is not None]
    assert len(table.rows) == len({finding.code for finding in compared}) == 10
    text = " ".join(row[1] for row in table.rows)
    assert all(sentence(finding) in text for finding in compared)
    assert all(paper and found and where for paper, found, where in table.rows)


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
    assert experiment.called == EXPERIMENT
    assert study_report(done).title == f"Models of {records[0].name}"
    (ratios,) = found(done, "study-paper-ratios")
    assert {row["study"] for row in ratios.data["rows"]} == {SIMULATION}
    assert not lead_inputs(done)  # the inputs of the survey are not the user's
    assert experiment.identification is records[0]
    assert experiment.unseen is records[1]


def test_the_ratios_of_the_paper_stand_beside_those_of_free_run_and_one_step(result):
    published = {(EXPERIMENT, "identification"): 24.2, (EXPERIMENT, "unseen"): 2.83} | {
        (SIMULATION, "identification"): 22.0,
        (SIMULATION, "unseen"): 557.0,
    }
    rows = [row for part in result.parts for row in paper_ratios(part)]
    assert {(row.study, row.data): row.paper for row in rows} == pytest.approx(published, rel=0.01)
    for row in rows:
        part = result.part(row.study)
        on = part.on_unseen if row.data == "unseen" else part.on_identification
        linear, paper = on(LINEAR).row, on(PAPER).row
        assert row.free_run == linear.simulation_mse / paper.simulation_mse
        assert row.one_step == linear.one_step_mse / paper.one_step_mse
    assert [row["paper"] for row in study_data(result)["paper_ratios"]] == [row.paper for row in rows]


@pytest.mark.parametrize("name", ["alike", "slopes-0.5", "coulomb-by-direction"])
def test_recorded_motors_are_those_of_this_program(name):
    case = next(case for case in FAMILY if case.name == name)
    kept = next(row for row in recorded().motors if row.motor == name)
    now = compare(case, Settings(), searched=False)
    assert (now.linear_fit_percent, now.even_share) == pytest.approx(
        (kept.linear_fit_percent, kept.even_share), rel=1e-3, abs=1e-6
    )
    assert now.unseen == pytest.approx({model: kept.unseen[model] for model in now.unseen}, rel=1e-2)


def test_a_physical_motor_by_direction_finds_unequal_slopes():
    case = next(case for case in FAMILY if case.name == "slopes-0.5")
    fit = by_direction(records(case, Settings(duration=8.0))[0])
    estimate = dict(zip(fit.names, fit.estimate, strict=True))
    assert estimate["voltage_dead_zone.m_l"] == pytest.approx(0.5, rel=0.01)


def test_even_error_decides_whether_quadratic_terms_help():
    rows = recorded().motors
    assert len(rows) == len(FAMILY) == 10
    for row in rows:
        assert (row.unseen[PAPER] > 1.05) == (row.even_share > 0.01)
    (finding,) = [each for each in about_the_survey(recorded(), Settings()) if each.code == "study-what-decides"]
    assert finding.data["odd"] == pytest.approx({"motors": 4, "lowest": 0.989, "highest": 0.999}, abs=1e-3)
    assert finding.data["even"] == pytest.approx({"motors": 6, "lowest": 1.12, "highest": 15.18}, rel=1e-3)
    assert min(finding.data["always"].values()) > 150


def test_the_largest_ratio_is_found_again_at_its_motor_and_reading():
    kept = {(row.reading, row.error): row for row in recorded().largest}
    assert len(kept) == 2 * len(READINGS)
    for reading in (READINGS[0], READINGS[-1]):
        row = kept[reading.name, FREE_RUN]
        motor = next(motor for about, motor in motors() if about == row.motor)
        assert ratios(motor, reading)[FREE_RUN][1] == pytest.approx(row.unseen, rel=1e-3)
    (finding,) = [each for each in about_the_survey(recorded(), Settings()) if each.code == "study-largest-ratio"]
    assert finding.data["usual"]["unseen"] == pytest.approx(19.74, rel=1e-3)
    assert finding.data["one_step"] < 1.1
    assert finding.data["reached"] == ["nearly one sine, 10 times as high"]  # and in no other


def test_the_largest_ratio_of_a_reading_may_be_interrupted_between_motors():
    asked = iter([False, False, True])
    with pytest.raises(Stopped):
        largest(READINGS[0], 0.5, Control(cancelled=lambda: next(asked)))


def test_the_survey_of_inputs_is_found_again_for_one_pair():
    (paper, *_) = over_inputs(Settings(duration=2.0), 1)
    assert (paper.model, paper.median) == (PAPER, paper.lowest)
    kept = {row.model: row for row in recorded().inputs}
    assert all(row.inputs == 30 for row in kept.values())
    assert kept[PAPER].highest < 1.2  # no better than linear over thirty pairs
    assert kept[FRICTION].median > 400
    assert kept[ONE_MASS].lowest > 1000


def test_the_readme_leads_with_the_recorded_survey():
    text = " ".join((Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8").split())
    for row in recorded().inputs:
        assert f"| {times(row.median)} | {times(row.lowest)} to {times(row.highest)} |" in text
    free, ahead = ([row for row in recorded().largest if row.error == error] for error in (FREE_RUN, ONE_STEP))
    most = times(max(row.unseen for row in free))
    assert f"{times(free[0].unseen)} with inputs like the paper's ({times(ahead[0].unseen)} one step ahead)" in text
    assert f"and {most} with nearly one sine ten times as fast" in text


def test_a_recorded_survey_says_so_and_speaks_of_its_own_motor():
    kept, other = recorded(), Settings(motor=replace(Motor(), resistance=3.0))
    codes = [finding.code for finding in about_the_survey(kept, Settings())]
    assert {"study-survey-recorded", "study-many-inputs", "study-two-masses"} <= set(codes)
    codes = [finding.code for finding in about_the_survey(kept, other)]
    assert not {"study-many-inputs", "study-two-masses"} & set(codes)


def test_inputs_are_shown_with_what_they_excite(result):
    for part in result.parts:
        assert [excitation.order for excitation in part.excitations] == [4, 4]
        (finding,) = [each for each in found(result, "study-excitation") if each.subject == part.name]
        assert (finding.data["order"], finding.data["parameters"]) == (4, 8)
        assert finding.data["crest_factor"] == pytest.approx(1.95, abs=0.01)
        assert (finding.data["richer"] is None) == (part.name == SIMULATION)
    richer = result.richer
    assert richer.excitation.order == HIGHEST_ORDER
    assert richer.excitation.conditions[PAPER] < 0.2 * result.part(EXPERIMENT).excitations[0].conditions[PAPER]
    two, _ = richer.errors[LINEAR]
    assert two == pytest.approx(result.part(EXPERIMENT).on_unseen(LINEAR).row.simulation_mse, rel=1e-2)


def test_a_free_run_that_diverges_leaves_a_study_that_can_be_written(result):
    richer = replace(result.richer, errors={LINEAR: (39.3, float("inf"))})
    part = result.part(EXPERIMENT)
    seen, unseen = part.assessed[0]
    lost = replace(unseen, row=replace(unseen.row, simulation_mse=float("inf")))
    diverged = replace(part, assessed=((seen, lost), *part.assessed[1:]))
    changed = replace(result, richer=richer, parts=(diverged, *result.parts[1:]))
    json.dumps(study_data(changed), allow_nan=False)
    assert [row.data for row in paper_ratios(diverged)] == ["identification"]
    finding = next(each for each in found(changed, "study-excitation") if each.data["richer"])
    assert finding.data["richer"]["errors"] == {LINEAR: [39.3, None]}
    assert "(diverges)" in claim(finding).found


def test_without_inputs_nothing_is_said_about_them(result):
    parts = tuple(replace(part, excitations=()) for part in result.parts)
    assert not found(replace(result, parts=parts), "study-excitation")


def test_the_initial_covariance_is_a_ridge(result):
    for part in result.parts:
        for row in part.priors:
            np.testing.assert_allclose(row.recursive[:5], row.ridge[:5], rtol=0.02, atol=1e-7)
    worst = next(row for row in result.part(SIMULATION).priors if row.model == FULL)
    assert worst.condition > 1e9
    assert worst.usual == pytest.approx(-0.28, abs=0.01)
    assert worst.vanishes_at == 1e12
    (finding,) = [each for each in found(result, "study-recursive-and-batch") if each.data["study"] == SIMULATION]
    assert (finding.subject, finding.data["condition"], finding.data["ridge"]) == (
        FULL,
        worst.condition,
        worst.ridge_usual,
    )


def test_two_masses_on_records_of_another_integrator():
    """At 5 ms the shaft rings at 145 Hz between the samples; what makes the motor slow is found all the same."""
    settings = Settings(duration=4.0)
    voltage = sines(800, settings.dt, *INPUTS["identification"])
    speed = load_speed(asdict(settings.motor), voltage, settings.dt)
    record = Record(voltage, speed, settings.dt, input_units="V", output_units="rad/s")
    own = Bench().run(settings.motor, voltage, settings.dt, np.random.default_rng(0))
    assert np.abs(own.output[:, 0] - speed).max() < 0.005
    row = two_mass_row("SciPy", two_masses(settings.motor, record), settings.motor)
    assert set(row.fixed) == set(FIXED)
    assert abs(row.errors["motor_constant"]) < 1e-4
    assert max(map(abs, row.errors.values())) < 0.15
    kept = {mass.record: mass for mass in recorded().two_masses}
    assert kept["own simulator, without noise"].covered == 10
    assert kept["own simulator, fixed values 10 % too large"].covered == 0


def test_on_records_of_the_user_sizes_are_chosen_and_the_papers_models_stay(monkeypatch):
    settings = Settings(duration=4.0)
    rng = np.random.default_rng(5)
    pair = tuple(measure(settings, Bench.typical(), kind, rng) for kind in ("identification", "unseen"))
    asked = []

    def stub(name):
        def fit(record, options, control):
            asked.append((name, record, dict(options.fixed), options.given))
            return least_squares(replace(friction_narx(na=1, nb=1), name=name), record)

        return fit

    monkeypatch.setattr("emsid.study.models.CANDIDATES", {name: stub(name) for name in CHOSEN})
    monkeypatch.setattr("emsid.study.workflow.searches", lambda *_, **__: {})
    part = study(settings, pair).part(EXPERIMENT)
    assert part.models == (LINEAR, PAPER, FULL, FRICTION, BLOCKS, ONE_MASS)
    assert [(name, given) for name, _, _, given in asked] == [(FRICTION, []), (BLOCKS, []), (ONE_MASS, [])]
    assert all(record is pair[0] for _, record, _, _ in asked)
    rows = {row.model: row.meaning for row in summary(part, own_records=True)}
    assert rows[FRICTION].endswith("chosen")
    assert rows[PAPER] == summary(part)[1].meaning
    heavy = replace(settings, motor=replace(Motor(), resistance=3.0))
    asked.clear()
    study(heavy, pair)
    assert [known for _, _, known, _ in asked] == [{}, {}, {"resistance": 3.0}]


def test_the_page_draws_the_papers_diagrams_and_says_where_the_linear_model_is_worst(result):
    page = study_report(result)
    assert [diagram.name for diagram in page.diagrams] == [
        "motor-schematic",
        "block-diagram",
        "experimental-setup",
        "identification-loop",
    ]
    for diagram in page.diagrams:
        for shape in diagram.shapes:
            points = shape.points if isinstance(shape, Wire) else ((shape.x, shape.y),)
            assert all(0 <= x <= diagram.width and 0 <= y <= diagram.height for x, y in points)
    captions = {figure.name: figure.caption for figure in page.figures}
    assert all(WORST in captions[name] for name in ("experiment-responses", "simulation-responses", "motor-responses"))
    assert {"load-friction", "simulation-priors"} <= set(captions)


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
    part = study(replace(result.settings, duration=2.0)).part(SIMULATION)
    assert BLOCKS not in part.models
    assert list(part.failed) == [BLOCKS]
    assert "out of range (no convergence)" in str(part.failed[BLOCKS])
    shorter = replace(result, parts=(part,))
    (finding,) = found(shorter, "study-model-failed")
    assert (finding.subject, finding.data["internal"]) == (BLOCKS, False)
    assert "out of range (no convergence)" in finding.data["problem"]
    assert not found(result, "study-model-failed")


@pytest.mark.parametrize("width", [80, 160])
def test_the_terminal_shows_at_most_thirty_lines(result, capsys, monkeypatch, width):
    monkeypatch.setattr("emsid.cli.terminal.WIDE", width)
    _print(result, details=False)
    lines = capsys.readouterr().out.splitlines()
    assert all(any(line.startswith(model) for line in lines) for model in result.part(SIMULATION).models)
    assert "…" not in "".join(lines)  # no cell is cut
    assert sum(max(1, -(-len(line) // width)) for line in lines) <= 30 - 1  # and one for where the files are
    _print(result, details=True)
    longer = capsys.readouterr().out
    assert longer.startswith("\n".join(lines[:5]))
    assert "Claims of the paper" in longer


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
