"""From a record to a ranked list of models."""

import numpy as np
import pytest

import emsid
from emsid.errors import DataError, ModelError
from emsid.identification.candidates import CANDIDATES, Options, Regression, stribeck_speeds
from emsid.identification.workflow import identify, remarks
from emsid.models.blocks.search.map_families import FAMILIES
from emsid.models.plants.datasheet import Given
from emsid.selection.coordinate_search import coordinate_search


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


def test_ranks_by_free_run_on_unseen_data():
    result = identify(system(2000, 1), system(1000, 2))
    errors = [row.simulation_mse for row in result.verification.rows]
    assert errors == sorted(errors)
    assert result.chosen.model.name == "friction-narx"
    assert result.verification.best.row.fit_percent > 97
    assert {row.samples for row in result.verification.rows} == {
        1000 - max(f.model.memory for f in result.verification.fits)
    }


def test_without_validation_the_end_of_the_record_is_kept_unseen():
    record = system(1000, 3)
    result = identify(record, models=["arx"], unseen=0.4)
    assert len(result.record) == 600
    np.testing.assert_array_equal(result.unseen.output, record.output[600:])


def test_validation_data_have_no_influence_on_the_models():
    record, blocks = system(1000, 4), Options(orders=(1, 1))
    fits = [identify(record, system(500, seed), options=blocks).verification.fits for seed in (5, 6)]
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
    result = identify(system(800, 8), models=["arx"], options=Options(forgetting=0.999))
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


def test_progress_names_the_candidate_and_ends_at_one():
    seen = []
    identify(system(400, 13), models=["arx"], progress=lambda what, fraction: seen.append((what, fraction)))
    assert {what for what, _ in seen} == {"arx"}
    assert seen[-1][1] == 1.0
    assert all(0 <= fraction <= 1 for _, fraction in seen)


def test_refusals():
    record = system(400, 14)
    with pytest.raises(ModelError, match="arxx"):
        identify(record, models=["arxx"])
    with pytest.raises(DataError, match="sampled every"):
        identify([record, emsid.Record(record.input, record.output, 0.02)])
    flat = emsid.Record(np.ones(100), record.output[:100], 0.01)
    with pytest.raises(DataError, match="nothing can be identified"):
        identify(flat)


@pytest.mark.parametrize("name", [name for name, each in CANDIDATES.items() if isinstance(each, Regression)])
def test_every_regression_gives_a_model_that_saves_and_loads(name, tmp_path):
    from emsid.io import load, save

    record = system(600, 15)
    model = identify(record, models=[name]).chosen.model
    save(model, tmp_path / "model.json")
    again = load(tmp_path / "model.json")
    np.testing.assert_array_equal(again.simulate(record).output, model.simulate(record).output)


def test_a_motor_is_recognised_from_its_record_alone(tmp_path):
    from emsid.excitation import SIGNALS
    from emsid.io import load, save
    from emsid.plant import Bench, Motor

    rng = np.random.default_rng(0)
    record = Bench.typical().run(Motor(), SIGNALS["multisine"](800, 0.005, 6.0, rng), 0.005, rng)
    result = identify(record, models=["arx", "rigid-motor"])
    assert result.chosen.model.name == "rigid-motor"
    assert result.verification.best.row.fit_percent > 98
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
    result = identify(steps, models=["arx"], unseen=0.25)
    assert result.unseen.name == "one in 4 of 8 records"
    assert np.array_equal(result.unseen.input, emsid.concatenate([steps[3], steps[7]]).input)
    assert len(result.record.segments) == 6
    assert not result.seen
    few = identify(steps[:7], models=["arx"], unseen=0.25)
    assert np.array_equal(few.unseen.input, emsid.concatenate(steps[:7]).split(0.75)[1].input)


def test_several_outputs_are_said_each_in_its_unit():
    from emsid.models.plants.motor import DrivenMotor
    from emsid.models.plants.parameters import Signal
    from emsid.plant import Motor

    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-8, 8, 60), 10)
    plant = DrivenMotor(Motor(inductance=0.0).rigid())
    y = plant.simulate(u[:, None], 0.005, np.zeros(2), (Signal.SPEED, Signal.CURRENT))
    y += np.std(y, axis=0) * 0.01 * rng.standard_normal(y.shape)
    record = emsid.Record(u, y, 0.005, output_names=("speed", "current"), output_units=("rad/s", "A"))
    result = identify(record, models=["rigid-motor"])
    speed, current = result.verification.best.row.outputs
    (sentence,) = [sentence for sentence in remarks(result) if "RMSE" in sentence]
    assert sentence == (
        f"rigid-motor: on unseen data, the RMSE of the free run is speed {speed.simulation_rmse:.4g} rad/s (a fit of "
        f"{speed.fit_percent:.1f} %); current {current.simulation_rmse:.4g} A (a fit of {current.fit_percent:.1f} %)."
    )
    assert speed.fit_percent > 98
    assert current.fit_percent > 98


def test_a_profile_of_a_parameter_that_was_split_is_one_of_each_direction(monkeypatch):
    from dataclasses import replace

    from emsid.models.plants.linear_axis import LinearAxis
    from emsid.models.plants.parameters import Signal
    from emsid.models.plants.search.choice import by_direction
    from emsid.plant import Friction

    rng = np.random.default_rng(0)
    force = np.repeat(rng.uniform(-100, 100, 60), 20)[:, None]
    truth = LinearAxis(80.0, (150.0, 220.0), Friction((25.0, 15.0)))
    position = truth.simulate(force, 0.005, np.zeros(2), (Signal.POSITION,))
    noisy = position + 1e-5 * rng.standard_normal(position.shape)
    record = emsid.Record(force, noisy, 0.005, input_units=("N",), output_units=("m",))
    monkeypatch.setitem(CANDIDATES, "linear-axis", replace(CANDIDATES["linear-axis"], refinements=(by_direction,)))
    seen = []
    result = identify(
        record,
        models=["linear-axis"],
        options=Options(profile=("friction.coulomb", "mass", "friction.coulomb.forward")),
        progress=lambda what, fraction: seen.append(what),
    )
    levels = {each.name: each for each in result.profiles["linear-axis"]}
    assert list(levels) == ["friction.coulomb.forward", "friction.coulomb.backward", "mass"]
    for name, value in (("friction.coulomb.forward", 25.0), ("friction.coulomb.backward", 15.0), ("mass", 80.0)):
        error = levels[name].standard_error
        assert levels[name].interval == pytest.approx((value, value), abs=5 * error)
    assert "linear-axis: mass" in seen


def test_what_a_choice_of_free_parameters_leaves_as_it_is_built_in_is_said():
    from emsid.models.plants.linear_axis import LinearAxis
    from emsid.models.plants.parameters import Signal
    from emsid.plant import Friction

    rng = np.random.default_rng(0)
    force = np.repeat(rng.uniform(-10, 10, 30), 20)[:, None]
    position = LinearAxis(1.0, 2.0, Friction(0.1)).simulate(force, 0.005, np.zeros(2), (Signal.POSITION,))
    record = emsid.Record(force, position, 0.005, input_units=("N",), output_units=("m",))

    def said(**options):
        return identify(record, models=["linear-axis"], options=Options(free=("mass",), **options)).asides

    words = "linear-axis: held at what is built in: "
    assert said() == (f"{words}viscous_friction 1 N·s/m, friction.coulomb 0.1 N; give --fix or --datasheet.",)
    sheet = {"friction.coulomb": Given(0.1), "viscous_friction": Given(None)}
    assert said(datasheet=sheet) == (f"{words}viscous_friction 1 N·s/m; give --fix or --datasheet.",)
    one_way = {"viscous_friction": 2.0, "friction.coulomb.forward": 0.1}
    assert said(fix=one_way) == (f"{words}friction.coulomb.backward 0.1 N; give --fix or --datasheet.",)
    assert said(fix={"viscous_friction": 2.0, "friction.coulomb": 0.1}) == ()


def test_wishes_are_refused_before_anything_is_fitted(monkeypatch):
    monkeypatch.setattr("emsid.identification.candidates.choose", None)
    record = system(400, 14)
    with pytest.raises(ModelError, match=r"motor has no parameter 'mass'; it has resistance, "):
        identify(record, models=["arx", "rigid-motor"], options=Options(profile=("mass",)))
    fixed = {"rotor_friction.coulomb.forward": 1e-3, "rotor_friction.coulomb.backward": 1e-3, "shaft_stiffness": 9.0}
    with pytest.raises(ModelError, match=r"coulomb is fixed, so it has no profile; rigid-motor also has ") as refused:
        identify(record, models=["rigid-motor"], options=Options(fix=fixed, profile=("rotor_friction.coulomb",)))
    assert "rotor_friction.coulomb" not in str(refused.value).partition("also has")[2].split(", ")
    with pytest.raises(ModelError, match="the datasheet says nothing of arx; choose a model that it is for: linear-"):
        identify(record, models=["arx"], options=Options(datasheet={"mass": Given(1.0)}))


@pytest.mark.parametrize(
    ("wishes", "message"),
    [
        (
            {"free": ("mass", "offset"), "profile": ("viscous_friction",)},
            "viscous_friction is not free, so it has no profile; free are mass, offset: add it, or take a profile of "
            "one of these",
        ),
        (
            {"free": ("friction.coulomb",), "profile": ("friction.coulomb.forward",)},
            "friction.coulomb.forward is not free, so it has no profile; free are friction.coulomb: add it, or take a "
            "profile of one of these",
        ),
        ({"free": ("mass",), "profile": ("weight",)}, "linear-axis has no parameter 'weight'; it has mass, "),
        ({"free": ("weight",)}, "linear-axis has no parameter 'weight'; it has mass, "),
        ({"fix": {"weight": 1.0}}, "linear-axis has no parameter 'weight'; it has mass, "),
    ],
)
def test_a_profile_of_what_is_not_free_is_refused_before_anything_is_fitted(monkeypatch, wishes, message):
    for search in ("choose", "simulation_error", "least_squares"):
        monkeypatch.setattr(f"emsid.identification.candidates.{search}", lambda *_, **__: pytest.fail("fitted"))
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
    options = Options(free=("mass", "friction.coulomb.forward"), profile=("friction.coulomb",))
    (profile,) = identify(record, models=["linear-axis"], options=options).profiles["linear-axis"]
    assert profile.name == "friction.coulomb.forward"
    assert profile.interval == pytest.approx((0.1, 0.1), abs=5 * profile.standard_error)


def test_coordinate_search_prefers_the_simpler_of_equals():
    def error(choice):
        return abs(choice["a"] - 2) + 0.001 * choice["b"]

    assert coordinate_search(error, {"a": (1, 2, 3), "b": (1, 5, 9)}) == {"a": 2, "b": 1}
    assert coordinate_search(lambda choice: 1.0, {"a": (1, 2), "b": (3, 4)}) == {"a": 1, "b": 3}
    assert coordinate_search(lambda choice: float("inf"), {"a": (1, 2)}) == {"a": 1}


def test_models_of_one_input_leave_none_of_several_out_in_silence():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((300, 2))
    record = emsid.Record(u, np.cumsum(u[:, 0] - u[:, 1]), 0.1, input_names=("left", "right"))
    result = identify(record, models=("arx", "friction-narx", "wiener-hammerstein-regression"))
    assert [fit.model.name for fit in result.verification.fits] == ["arx"]
    assert result.failed["friction-narx"].startswith("friction-narx has one input and")
    assert "left, right" in result.failed["wiener-hammerstein-regression"]


def test_unseen_data_in_which_the_input_never_changes_are_said_to_judge_nothing():
    record = system(600, 15)
    held = emsid.Record(np.full(200, 2.0), system(200, 16).output, 0.01, input_names=("PWM",))
    words = remarks(identify(record, held, models=["arx"]))
    assert (
        "PWM is 2 throughout the unseen data, which tell no more than where a model comes to rest: judge on data in "
        "which it changes (--validate, --unseen)." in words
    )
    assert not any("models guess" in sentence for sentence in words)


@pytest.mark.parametrize(("factor", "said"), [(0.9, False), (1.05, False), (2.0, True)])
def test_unseen_data_beyond_what_was_identified_from_are_said_to_make_models_guess(factor, said):
    def driven(seed, largest):
        u = np.random.default_rng(seed).uniform(-1, 1, 300)
        u[100], u[200] = -1, 1
        u *= largest
        y = np.zeros(300)
        for t in range(1, 300):
            y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1]
        return emsid.Record(u, y, 0.01, input_names=("PWM",))

    words = remarks(identify(driven(0, 100), driven(1, 100 * factor), models=["arx"]))
    sentence = (
        "PWM goes from -200 to 200 in the unseen data, and from -100 to 100 in what was identified from: beyond that, "
        "models guess."
    )
    assert [each for each in words if "models guess" in each] == [sentence] * said


def test_a_best_model_that_is_no_better_than_the_mean_is_said_to_be_none():
    rng = np.random.default_rng(17)
    noise = emsid.Record(rng.uniform(-1, 1, 400), rng.standard_normal(400), 0.01, output_names=("speed",))
    sentence = "No model is better on unseen data than the mean of speed."
    result = identify(noise, models=["arx"])
    assert result.verification.best.row.fit_percent < 0
    assert remarks(result)[1] == sentence
    assert sentence not in remarks(identify(system(600, 18), models=["arx"]))


def test_knots_are_set_aside_for_a_map_that_has_none():
    options = Options(static=FAMILIES["dead-zone"], knots=5, orders=(1,))
    result = identify(system(600, 19), models=["hammerstein", "friction-narx"], options=options)
    sentence = "hammerstein: a map of the family dead-zone has no knots; knots was set aside for it."
    assert result.asides == (sentence,)


def test_a_failure_names_its_model_once():
    record = system(600, 20)
    two_levels = emsid.Record(np.sign(record.input), record.output, 0.01)
    words = remarks(identify(two_levels, models=["arx", "hammerstein"]))
    assert words[-1].startswith("hammerstein could not be fitted: the input takes two values only, -1 and 1; ")


def test_speeds_of_a_stribeck_excess_are_numbers_to_be_read():
    record = emsid.Record(np.arange(40.0), np.linspace(-56.0, 28.7695, 40), 0.01)
    assert stribeck_speeds(record) == (1.68, 5.6)


def test_data_of_another_sample_time_judge_no_model_that_counts_samples(monkeypatch):
    monkeypatch.setattr("emsid.identification.candidates.estimate_cascade", lambda *_: pytest.fail("fitted"))
    record = system(400, 21)
    other = emsid.Record(record.input[::2], record.output[::2], 0.02, name="slow log")
    with pytest.raises(DataError) as refused:
        identify(record, other, models=["hammerstein", "rigid-motor"])
    assert str(refused.value) == (
        "slow log is sampled every 0.02 s and record every 0.01 s, so it cannot judge hammerstein; resample one of "
        "them, or check the unit of its times"
    )
