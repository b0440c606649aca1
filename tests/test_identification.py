"""From a record to a ranked list of models."""

from dataclasses import replace

import numpy as np
import pytest

import emsid
from conftest import try_few_refinements
from emsid.errors import DataError, ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding
from emsid.first_look import examined
from emsid.identification import regressions
from emsid.identification.candidates import CANDIDATES, USUAL, usual_for, with_unit_of_name
from emsid.identification.regressions import REGRESSIONS, coordinate_search, stribeck_speeds
from emsid.identification.task import unused_requests
from emsid.identification.workflow import identify
from emsid.models.plants.datasheet import Given
from emsid.models.plants.drive import Feed
from emsid.options import Options
from emsid.report.identification_page import report
from emsid.selection.improvement import StretchErrors


def system(samples, seed, noise=0.01):
    """y(t) = 1.5y(t−1) − 0.7y(t−2) + 0.4·max(u(t−2) − 0.5, 0) − 0.3·sign(y(t−1)) and white noise on the output."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-3, 3, samples // 5), 5)
    y = np.zeros(samples)
    for t in range(2, samples):
        y[t] = (
            1.5 * y[t - 1] - 0.7 * y[t - 2] + 0.4 * max(u[t - 2] - 0.5, 0) + 0.2 * u[t - 2] - 0.05 * np.sign(y[t - 1])
        )
    return emsid.Record(u, y + noise * rng.standard_normal(samples), 0.01)


QUICK = ("arx", "wiener-hammerstein-regression", "friction-narx", "hammerstein")
"""The usual models with a shorter cascade; `test_cli` fits the usual ones."""


def with_code(result, code):
    return [finding for finding in result.findings if finding.code == code]


def test_ranks_by_free_run_on_unseen_data():
    blocks = Options(orders=(1,), static="dead-zone", nk=2)
    result = identify(system(500, 1), system(250, 2), models=QUICK, options=blocks)
    errors = [row.simulation_mse for row in result.on_unseen.rows]
    assert errors == sorted(errors)
    assert result.chosen.model.name in ("friction-narx", "friction-narx-free-run")
    assert result.on_unseen.best.row.fit_percent > 97
    assert {row.samples for row in result.on_unseen.rows} == {250 - max(f.model.memory for f in result.on_unseen.fits)}


def test_orders_are_searched_once_for_the_fits_one_step_ahead_and_to_the_free_run(monkeypatch):
    searched = []
    monkeypatch.setattr(regressions, "coordinate_search", lambda *a, **how: searched.append(a) or search(*a, **how))
    record, search = system(300, 1), coordinate_search
    one, free = (CANDIDATES[name](record, Options(), FREE) for name in ("friction-narx", "friction-narx-free-run"))
    assert len(searched) == 1
    assert set(free.model.structure.labels) <= set(one.model.structure.labels)
    CANDIDATES["friction-narx"](record, Options(ridge=1.0), FREE)
    CANDIDATES["friction-narx"](system(300, 1), Options(), FREE)
    assert len(searched) == 3


def test_how_the_output_answers_the_input_is_found_once(monkeypatch):
    """It takes a sixth of an identification of regressions, and several checks ask for it."""
    asked, found = [], examined.answers
    monkeypatch.setattr(examined, "answers", lambda *given: asked.append(given) or found(*given))
    identify(system(500, 1), models=["arx"])
    assert len(asked) == 1
    identify(system(500, 1), system(250, 2), models=["arx"])
    assert len(asked) == 2


def test_without_validation_the_end_of_the_record_is_kept_unseen():
    record = system(1000, 3)
    result = identify(record, models=["arx"], unseen=0.4)
    assert len(result.record) == 600
    np.testing.assert_array_equal(result.unseen.output, record.output[600:])


def test_validation_data_have_no_influence_on_the_models():
    record, blocks = system(200, 4), Options(orders=(1,), static="dead-zone", nk=2)  # the rest is chosen
    models = ("arx", "friction-narx", "hammerstein")
    fits = [identify(record, system(150, seed), models=models, options=blocks).fits for seed in (5, 6)]
    assert len(fits[0]) == 3
    for fit in fits[0]:
        twin = next(other for other in fits[1] if other.model.name == fit.model.name)
        np.testing.assert_array_equal(fit.estimate, twin.estimate)


def test_orders_are_found_from_noise_free_data():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(800)
    y = np.zeros(800)
    for t in range(3, 800):
        y[t] = 0.5 * y[t - 1] - 0.3 * y[t - 2] + 0.7 * u[t - 3]
    chosen = identify(emsid.Record(u, y, 0.1), models=["arx"]).chosen
    found = dict(zip(chosen.model.structure.labels, chosen.estimate, strict=True))
    assert found.pop("-y(t-1)") == pytest.approx(-0.5)
    assert found.pop("-y(t-2)") == pytest.approx(0.3)
    assert found.pop("u(t-3)") == pytest.approx(0.7)
    assert all(label.startswith("u(") and abs(value) < 1e-12 for label, value in found.items())


def test_what_is_given_is_kept():
    options = Options(na=3, nb=1, nk=2, knots=4)
    result = identify(system(800, 7), models=["friction-narx"], options=options)
    texts = result.chosen.model.structure.labels
    assert "-y(t-3)" in texts
    assert "-y(t-4)" not in texts
    assert sum("max(u(t-2)" in text for text in texts) == 4


def test_recursive_estimation_on_request():
    options = Options(na=2, nb=2, nk=1, forgetting=0.999)
    result = identify(system(800, 8), models=["arx"], options=options)
    chosen = result.chosen
    assert chosen.method == "rls"
    expected = emsid.recursive_least_squares(chosen.model.structure, result.record, forgetting=0.999)
    np.testing.assert_array_equal(chosen.estimate, expected.estimate)
    assert np.any(chosen.estimate != emsid.least_squares(chosen.model.structure, result.record).estimate)


def test_several_records_are_experiments():
    pieces = [system(400, seed) for seed in (9, 10, 11)]
    result = identify(pieces, system(400, 12), models=["arx"])
    assert len(result.record) == 1200
    assert result.record.breaks == (400, 800)


def test_activities_name_the_model_and_count_real_steps():
    seen = []
    identify(system(400, 13), models=["arx"], control=Control(report=seen.append))
    assert seen[0].doing == "arx (1 of 1): fitting"
    counted = [each for each in seen if each.doing == "arx (1 of 1): choosing orders"]
    assert [each.done for each in counted] == list(range(1, 29))  # 2 rounds of 4 delays, 4 and 4 orders, constant
    assert {each.total for each in counted} == {28}


def test_refusals():
    record = system(400, 14)
    with pytest.raises(ModelError, match="arxx"):
        identify(record, models=["arxx"])
    with pytest.raises(DataError, match="sampled every"):
        identify([record, emsid.Record(record.input, record.output, 0.02)])
    flat = emsid.Record(np.ones(100), record.output[:100], 0.01)
    with pytest.raises(DataError, match="nothing can be identified"):
        identify(flat)


@pytest.mark.parametrize("name", REGRESSIONS)
def test_every_regression_gives_a_model_that_saves_and_loads(name, tmp_path):
    from emsid.io import load, save

    record = system(200, 15)
    model = identify(record, models=[name]).chosen.model
    save(model, tmp_path / "model.json")
    again = load(tmp_path / "model.json")
    np.testing.assert_array_equal(again.simulate(record).output, model.simulate(record).output)


@pytest.mark.parametrize("all_refinements", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_motor_is_recognised_from_its_record_alone(all_refinements, tmp_path, monkeypatch):
    from emsid.excitation import SIGNALS
    from emsid.io import load, save
    from emsid.plant import Bench, Motor

    if not all_refinements:
        try_few_refinements(monkeypatch)
    rng = np.random.default_rng(0)
    record = Bench.typical().run(Motor(), SIGNALS["multisine"](800, 0.005, 6.0, rng), 0.005, rng)
    result = identify(record, models=["arx", "rigid-motor"])
    assert result.chosen.model.name == "rigid-motor"
    assert result.on_unseen.best.row.fit_percent > 98
    save(result.chosen.model, tmp_path / "motor.json")
    again = load(tmp_path / "motor.json")
    np.testing.assert_array_equal(again.simulate(record).output, result.chosen.model.simulate(record).output)


def test_of_many_records_some_are_kept_unseen_and_not_the_last():
    rng = np.random.default_rng(4)
    steps = []
    for k in range(8):
        u = np.repeat(rng.uniform(-k - 1, k + 1, 20), 10)
        y = np.zeros_like(u)
        for t in range(1, len(u)):
            y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1]
        steps.append(emsid.Record(u, y, 0.01, name=f"step {k}"))
    few_terms = Options(na=1, nb=1, nk=1)
    result = identify(steps, models=["arx"], unseen=0.25, options=few_terms)
    assert result.unseen.name == "one in 4 of 8 records"
    assert np.array_equal(result.unseen.input, emsid.concatenate([steps[3], steps[7]]).input)
    assert len(result.record.segments) == 6
    assert not result.seen
    few = identify(steps[:7], models=["arx"], unseen=0.25, options=few_terms)
    assert np.array_equal(few.unseen.input, emsid.concatenate(steps[:7]).split(0.75)[1].input)


def test_several_outputs_have_errors_in_their_units():
    from emsid.models.plants.motor import DrivenMotor
    from emsid.models.plants.parameters import Signal
    from emsid.plant import Motor

    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-8, 8, 40), 10)
    plant = DrivenMotor(Motor(inductance=0.0).rigid())
    y = plant.simulate(u[:, None], 0.005, np.zeros(2), (Signal.SPEED, Signal.CURRENT))
    y += np.std(y, axis=0) * 0.01 * rng.standard_normal(y.shape)
    record = emsid.Record(u, y, 0.005, output_names=("speed", "current"), output_units=("rad/s", "A"))
    result = identify(record, models=["rigid-motor"])
    speed, current = result.on_unseen.best.row.outputs
    (found,) = with_code(result, "free-run-error")
    assert found.model == "rigid-motor"
    assert [each["name"] for each in found.data["outputs"]] == ["speed", "current"]
    assert [each["unit"] for each in found.data["outputs"]] == ["rad/s", "A"]
    assert [each["rmse"] for each in found.data["outputs"]] == [speed.simulation_rmse, current.simulation_rmse]
    assert [each["fit_percent"] for each in found.data["outputs"]] == [speed.fit_percent, current.fit_percent]
    assert speed.fit_percent > 98
    assert current.fit_percent > 98


def test_another_kind_of_model_for_a_plant_keeps_its_place_among_all(monkeypatch):
    before = list(CANDIDATES)
    for name in ("linear-axis", "arx"):
        with monkeypatch.context() as patch:
            patch.setitem(CANDIDATES, name, CANDIDATES[name])
            assert list(CANDIDATES) == before
        assert list(CANDIDATES) == before


def test_a_profile_of_a_parameter_that_was_split_is_one_of_each_direction(monkeypatch):
    from dataclasses import replace

    from emsid.models.plants.linear_axis import LinearAxis
    from emsid.models.plants.parameters import Signal
    from emsid.plant import Friction

    rng = np.random.default_rng(0)
    force = np.repeat(rng.uniform(-100, 100, 60), 20)[:, None]
    truth = LinearAxis(80.0, (150.0, 220.0), Friction((25.0, 15.0)))
    position = truth.simulate(force, 0.005, np.zeros(2), (Signal.POSITION,))
    noisy = position + 1e-5 * rng.standard_normal(position.shape)
    record = emsid.Record(force, noisy, 0.005, input_units=("N",), output_units=("m",))
    monkeypatch.setitem(
        CANDIDATES,
        "linear-axis",
        replace(CANDIDATES["linear-axis"], effects=("coulomb-by-direction", "viscous-by-direction")),
    )
    seen = []
    result = identify(
        record,
        models=["linear-axis"],
        options=Options(profile=("viscous_friction", "mass", "viscous_friction.forward")),
        control=Control(report=lambda activity: seen.append(activity.doing)),
    )
    levels = {each.name: each for each in result.profiles["linear-axis"]}
    assert list(levels) == ["viscous_friction.forward", "viscous_friction.backward", "mass"]
    for name, value in (("viscous_friction.forward", 150.0), ("viscous_friction.backward", 220.0), ("mass", 80.0)):
        error = levels[name].standard_error
        assert levels[name].interval == pytest.approx((value, value), abs=5 * error)
    assert "linear-axis (profile 3 of 3): mass" in seen
    (mass,) = [each for each in with_code(result, "profile-interval") if each.subject == "mass"]
    low, high = levels["mass"].interval
    assert mass.data == {"model": "linear-axis", "level": 0.95, "low": low, "high": high, "unit": "kg"}
    assert not with_code(result, "profile-failed")


def test_usual_parameters_that_are_not_free_are_neutral():
    from emsid.models.plants.linear_axis import LinearAxis
    from emsid.models.plants.parameters import Signal
    from emsid.plant import Friction

    rng = np.random.default_rng(0)
    force = np.repeat(rng.uniform(-10, 10, 30), 20)[:, None]
    position = LinearAxis(1.0, 2.0, Friction(0.1)).simulate(force, 0.005, np.zeros(2), (Signal.POSITION,))
    record = emsid.Record(force, position, 0.005, input_units=("N",), output_units=("m",))

    def said(**options):
        result = identify(record, models=["linear-axis"], options=Options(free=("mass",), **options))
        found = with_code(result, "built-in-values-kept")
        assert all(finding.model == "linear-axis" for finding in found)
        return [each for finding in found for each in finding.data["parameters"]]

    assert said() == []  # what is not estimated is neutral, and the score names what is missing
    result = identify(record, models=["linear-axis"], options=Options(free=("mass",)))
    assert with_code(result, "effect-missing")[0].data["effect"] in ("viscous", "coulomb")
    assert said(fixed={"viscous_friction": 2.0, "friction.coulomb": 0.1}) == []


def test_wishes_are_refused_before_anything_is_fitted(monkeypatch):
    monkeypatch.setattr("emsid.identification.candidates.choose", None)
    record = system(400, 14)
    with pytest.raises(ModelError, match=r"motor has no parameter 'mass'; it has resistance, "):
        identify(record, models=["arx", "rigid-motor"], options=Options(profile=("mass",)))
    fixed = {"rotor_friction.coulomb.forward": 1e-3, "rotor_friction.coulomb.backward": 1e-3, "shaft_stiffness": 9.0}
    with pytest.raises(ModelError, match=r"coulomb is fixed, so it has no profile; rigid-motor also has ") as refused:
        identify(record, models=["rigid-motor"], options=Options(fixed=fixed, profile=("rotor_friction.coulomb",)))
    assert "rotor_friction.coulomb" not in str(refused.value).partition("also has")[2].split(", ")
    with pytest.raises(ModelError, match="the datasheet has no parameter of arx; choose a model that has"):
        identify(record, models=["arx"], options=Options(datasheet={"mass": Given(1.0)}))


@pytest.mark.parametrize(
    ("wishes", "message"),
    [
        (
            {"free": ("mass", "offset"), "profile": ("viscous_friction",)},
            "viscous_friction is not estimated, so it has no profile; add it to the free parameters, or take a profile "
            "of one of these: mass, offset",
        ),
        (
            {"free": ("friction.coulomb",), "profile": ("friction.coulomb.forward",)},
            "friction.coulomb.forward is not estimated, so it has no profile; add it to the free parameters, or take "
            "a profile of one of these: friction.coulomb",
        ),
        ({"free": ("mass",), "profile": ("weight",)}, "linear-axis has no parameter 'weight'; it has mass, "),
        ({"free": ("weight",)}, "linear-axis has no parameter 'weight'; it has mass, "),
        ({"fixed": {"weight": 1.0}}, "linear-axis has no parameter 'weight'; it has mass, "),
    ],
)
def test_a_profile_of_what_is_not_free_is_refused_before_anything_is_fitted(monkeypatch, wishes, message):
    candidates = "emsid.identification.candidates"
    estimator = "emsid.estimation.linear.least_squares.least_squares"
    for search in (f"{candidates}.choose", f"{candidates}.simulation_error", estimator):
        monkeypatch.setattr(search, lambda *_, **__: pytest.fail("fitted"))
    with pytest.raises(ModelError) as refused:
        identify(system(400, 14), models=["arx", "linear-axis"], options=Options(**wishes))
    assert str(refused.value).startswith(message)


def test_a_profile_may_be_asked_for_by_the_name_of_both_directions_where_one_is_free():
    from emsid.models.plants.linear_axis import LinearAxis
    from emsid.models.plants.parameters import Signal

    force = np.repeat(np.random.default_rng(0).uniform(-10, 10, 60), 20)[:, None]
    position = LinearAxis().simulate(force, 0.005, np.zeros(2), (Signal.POSITION,))
    position += 1e-4 * np.random.default_rng(1).standard_normal(position.shape)
    record = emsid.Record(force, position, 0.005, input_units=("N",), output_units=("m",))
    options = Options(
        free=("mass", "friction.coulomb.forward"),
        fixed={"viscous_friction": 1.0, "friction.coulomb.backward": 0.1},
        profile=("friction.coulomb",),
    )
    (profile,) = identify(record, models=["linear-axis"], options=options).profiles["linear-axis"]
    assert profile.name == "friction.coulomb.forward"
    assert profile.interval == pytest.approx((0.1, 0.1), abs=5 * profile.standard_error)


def test_coordinate_search_prefers_the_simpler_of_equals():
    def everywhere(mse):
        return StretchErrors.of(np.full(160, mse))

    def error(choice):
        return everywhere(1 + abs(choice["a"] - 2) - 0.001 * choice["b"])

    assert coordinate_search(error, {"a": (1, 2, 3), "b": (1, 5, 9)}) == {"a": 2, "b": 1}
    assert coordinate_search(lambda choice: everywhere(1.0), {"a": (1, 2), "b": (3, 4)}) == {"a": 1, "b": 3}
    assert coordinate_search(lambda choice: everywhere(np.inf), {"a": (1, 2)}) == {"a": 1}


def test_models_of_one_input_leave_none_of_several_out_in_silence():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((300, 2))
    record = emsid.Record(u, np.cumsum(u[:, 0] - u[:, 1]), 0.1, input_names=("left", "right"))
    result = identify(record, models=("arx", "friction-narx", "wiener-hammerstein-regression"))
    assert [fit.model.name for fit in result.on_unseen.fits] == ["arx"]
    failed = with_code(result, "model-failed")
    assert [finding.model for finding in failed] == ["friction-narx", "wiener-hammerstein-regression"]
    assert all("left, right" in finding.data["reason"] for finding in failed)


def test_a_constant_input_in_unseen_data_is_found():
    record = system(600, 15)
    held = emsid.Record(np.full(200, 2.0), system(200, 16).output, 0.01, input_names=("PWM",))
    result = identify(record, held, models="arx")
    (found,) = with_code(result, "input-constant")
    assert found == Finding("input-constant", "PWM", {"inputs": [{"name": "PWM", "level": 2.0}], "seen": False})
    assert not with_code(result, "input-beyond-range")
    assert not with_code(identify(record, models="arx"), "input-constant")


@pytest.mark.parametrize(("factor", "said"), [(0.9, False), (1.05, False), (2.0, True)])
def test_an_input_beyond_the_range_fitted_to_is_found(factor, said):
    def driven(seed, largest):
        u = np.random.default_rng(seed).uniform(-1, 1, 300)
        u[100], u[200] = -1, 1
        u *= largest
        y = np.zeros(300)
        for t in range(1, 300):
            y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1]
        return emsid.Record(u, y, 0.01, input_names=("PWM",))

    found = with_code(identify(driven(0, 100), driven(1, 100 * factor), models=["arx"]), "input-beyond-range")
    data = {"low": -200.0, "high": 200.0, "fitted_low": -100.0, "fitted_high": 100.0, "seen": False}
    assert found == [Finding("input-beyond-range", "PWM", data)] * said


def test_a_best_model_that_is_no_better_than_the_mean_is_found():
    rng = np.random.default_rng(17)
    noise = emsid.Record(rng.uniform(-1, 1, 400), rng.standard_normal(400), 0.01, output_names=("speed",))
    result = identify(noise, models=["arx"])
    assert result.on_unseen.best.row.fit_percent < 0
    assert with_code(result, "no-better-than-mean") == [Finding("no-better-than-mean", "speed", {"seen": False})]
    assert not with_code(identify(system(600, 18), models=["arx"]), "no-better-than-mean")


def test_knots_are_set_aside_for_a_map_that_has_none():
    options = Options(static="dead-zone", knots=5, orders=(1,), na=2, nb=1, nk=2)
    result = identify(system(300, 19), models=["hammerstein", "friction-narx"], options=options)
    data = {"model": "hammerstein", "family": "dead-zone"}
    assert with_code(result, "knots-not-used") == [Finding("knots-not-used", "hammerstein", data)]


def test_a_failure_names_its_model_once():
    record = system(600, 20)
    two_levels = emsid.Record(np.sign(record.input), record.output, 0.01)
    (failed,) = with_code(identify(two_levels, models=["arx", "hammerstein"]), "model-failed")
    assert failed.model == "hammerstein"
    assert failed.data["reason"].startswith("the input takes two values only, -1 and 1; ")


def test_speeds_of_a_stribeck_excess_are_numbers_to_be_read():
    record = emsid.Record(np.arange(40.0), np.linspace(-56.0, 28.7695, 40), 0.01)
    assert stribeck_speeds(record) == (1.68, 5.6)


def test_discrete_models_are_not_compared_on_data_of_another_sample_time(monkeypatch):
    fit = "emsid.models.blocks.search.estimation.CascadeStructure.fit"
    monkeypatch.setattr(fit, lambda *_, **__: pytest.fail("fitted"))
    record = system(400, 21)
    other = emsid.Record(record.input[::2], record.output[::2], 0.02, name="slow log")
    with pytest.raises(DataError) as refused:
        identify(record, other, models=["hammerstein", "rigid-motor"])
    assert str(refused.value) == (
        "slow log is sampled every 0.02 s and record every 0.01 s, so hammerstein cannot be simulated on it; resample "
        "one of them, or check the unit of its times"
    )


def test_a_page_of_the_command_line_names_options():
    """The page is read by somebody who typed a command, or by somebody who called a function."""
    result = identify(system(600, 15), models="arx", options=Options(na=1, nb=1, nk=1))

    def texts(page):
        remarks = [remark for section in page.sections for remark in section.remarks]
        return " ".join([notice.text for notice in page.notices] + list(page.advice) + remarks)

    typed, called = texts(report(result, lambda name: f"--{name}")), texts(report(result))
    assert "--unseen" in typed
    assert typed.replace("--", "") == called


@pytest.mark.parametrize(
    ("units", "output", "plants"),
    [
        (("V", "rad/s"), "y", ["rigid-motor"]),
        (("V", "rad"), "angle", ["rigid-motor"]),
        (("", ""), "y", ["rigid-motor"]),
        (("", ""), "speed", ["rigid-motor"]),
        (("", ""), "position", ["linear-axis"]),
        (("N", "m"), "y", ["linear-axis"]),
        (("A", "rad/s"), "y", ["rigid-motor"]),
        (("N*m", "rad"), "q", ["rigid-motor"]),
        (("N*m", ""), "position", ["rigid-motor"]),
        (("N*m", "m"), "x", ["linear-axis"]),
        (("Pa", "K"), "y", []),
    ],
)
def test_a_motor_or_an_axis_is_tried_by_default_where_units_and_names_allow_it(units, output, plants):
    nothing = np.zeros(400)
    record = emsid.Record(nothing, nothing, 0.01, "u", output, input_units=units[0], output_units=units[1])
    assert usual_for(record) == (*USUAL, *plants)


def test_knots_are_not_used_where_the_map_of_a_feedback_model_has_none():
    record = emsid.Record(np.zeros(400), np.zeros(400), 0.01)
    options = Options(static="dead-zone", knots=5)
    assert Finding("knots-not-used", "feedback", {"model": "feedback", "family": "dead-zone"}) in unused_requests(
        {}, ["feedback"], options, record
    )
    assert CANDIDATES["feedback"]._structure(options).search.size == 0


@pytest.mark.parametrize(
    ("input", "output", "plants"),
    [
        ("u", "temperature", []),
        ("u", "upper_level", []),
        ("pump", "y", []),
        ("valve", "flow_rate", []),
        ("heater", "T", []),
        ("u", "Druck", []),
        ("pump", "pump_speed", ["rigid-motor"]),
        ("voltage", "pump_speed", ["rigid-motor"]),
        ("PWM", "rpm", ["rigid-motor"]),
        ("u", "y", ["rigid-motor"]),
    ],
)
def test_no_motor_is_tried_where_a_channel_without_a_unit_is_called_that_of_a_process(input, output, plants):
    record = emsid.Record(np.zeros(400), np.zeros(400), 0.01, input, output)
    assert usual_for(record) == (*USUAL, *plants)


def test_a_unit_in_the_name_of_a_level_makes_no_motion_of_it():
    record = emsid.Record(np.zeros(400), np.zeros(400), 0.01, "u [V]", "level [m]", "V", "m")
    assert usual_for(record) == USUAL
    given = replace(record, output_names=("level",))
    assert usual_for(given) != USUAL


@pytest.mark.parametrize(
    ("name", "plant", "unit"),
    [("torque_estimate", "rigid-motor", "N*m"), ("current", "rigid-motor", "A"), ("force", "linear-axis", "N")],
)
def test_an_input_that_is_called_a_current_a_torque_or_a_force_is_no_voltage(name, plant, unit):
    record = emsid.Record(np.zeros(400), np.zeros(400), 0.01, name, "speed")
    assert usual_for(record) == (*USUAL, plant)
    assert with_unit_of_name(record).input_units == (unit,)
    assert with_unit_of_name(replace(record, input_units=("V",))).input_units == ("V",)


def test_a_motor_is_driven_by_a_column_that_is_called_a_current():
    rng = np.random.default_rng(4)
    current = np.repeat(rng.uniform(-2, 2, 40), 20)
    speed = np.zeros(800)
    for k in range(1, 800):  # a current accelerates without a back electromotive force
        speed[k] = 0.98 * speed[k - 1] + 3 * current[k - 1]
    record = emsid.Record(current, speed + rng.standard_normal(800), 0.01, "current", "speed")
    result = identify(record, 0.3, models="rigid-motor")
    assert result.fits[0].model.plant.feed is Feed.CURRENT
    (said,) = (each for each in result.findings if each.code == "command-unit-assumed")
    assert (said.data["channel"], said.data["unit"]) == ("current", "amperes")


def test_records_of_several_channels_are_of_no_plant_by_default():
    record = emsid.Record(np.zeros((400, 2)), np.zeros(400), 0.01)
    assert usual_for(record) == USUAL


def test_a_short_record_gets_no_feedback_model_by_default():
    assert usual_for(emsid.Record(np.zeros(399), np.zeros(399), 0.01)) == (
        *(name for name in USUAL if name != "feedback"),
        "rigid-motor",
    )
