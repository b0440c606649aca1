"""The search for a plant: units do not matter, starts come from the samples, and the choice holds on unseen records.

The records come from simulators of the tests' own, which share nothing with `emsid.plant`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from emsid import Record
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.plants.drifting_load import PIECES, DriftingLoad, LoadDrift
from emsid.models.plants.drive import Hold
from emsid.models.plants.free_run_error import FreeRunError, Recent, all_alike
from emsid.models.plants.initial_state import InitialState, agree, initial_motion
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search import choice, continuation
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.estimation import begun_again, beside_kinks, simulation_error
from emsid.models.plants.search.load_drift import chosen as drift_of
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.plants.search.scaling import Scaling
from emsid.models.plants.search.task import prepare
from emsid.models.plants.search.thinning import thinned
from emsid.models.plants.search.trials import Trial, Trials
from emsid.plant import Friction, GaussianStribeck, Motor, simulate
from independent.cases import CASES, KINDS, levels, sines
from independent.one_mass import OneMass

Array = NDArray[np.float64]
RIGID, AXIS = PLANTS["rigid-motor"].start, PLANTS["linear-axis"].start


def known(name: str, samples: int | None = None) -> Record:
    """The first samples of a record, with the unit of its output."""
    case = CASES[name]()
    return replace(case.fitted[:samples], output_units=("m" if case.shows_position else "rad/s",))


@cache
def chosen(name: str, samples: int | None = None) -> GreyBoxFit:
    """The plant chosen for the first samples of a record."""
    return choose(AXIS if CASES[name]().shows_position else RIGID, known(name, samples))


# --- units ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "signal", "values"),
    [
        (
            "rigid-motor",
            Signal.SPEED,
            {
                "drive.supply": 250.0,
                "drive.freewheel": 0.7,
                "drive.delay": 0.003,
                "voltage_dead_zone.half_width": 9.0,
                "rotor_friction.stribeck": 0.01,
                "load_torque": 0.02,
            },
        ),
        ("motor", Signal.SPEED, {}),
        ("linear-axis", Signal.POSITION, {"friction.stribeck": 0.05, "friction.stribeck_rate": 3.0, "offset": 2.0}),
    ],
)
def test_a_plant_in_units_of_its_record_moves_in_them(name, signal, values):
    plant = PLANTS[name].start.with_values(values)
    u = np.repeat(np.random.default_rng(0).uniform(-200, 200, 40), 50)
    y = plant.simulate(u[:, None], 1e-3, np.zeros(3), (signal,))
    scaling = Scaling.of(plant, Record(u, y, 1e-3))
    record, scaled = scaling.record(Record(u, y, 1e-3), (signal,)), scaling.to(plant, 1)
    assert np.max(np.abs(record.input)) == np.max(np.abs(record.output)) == 1.0
    assert np.allclose(scaled.simulate(record.input, 1e-3, np.zeros(3), (signal,)), record.output, atol=1e-12)
    back = scaling.back(scaled, plant)
    assert all(back.value(handle) == pytest.approx(plant.value(handle), rel=1e-14) for handle in plant.handles)


@pytest.mark.parametrize(
    ("command", "output"),
    [*(pytest.param(*each, marks=pytest.mark.long) for each in ((1.0, 10.0), (12 / 255, 1.0))), (20.0, 0.03)],
)
@pytest.mark.parametrize("case", [("motor 1",), pytest.param(("motor 4", 1200), marks=pytest.mark.long)])
def test_a_choice_does_not_depend_on_the_units_of_channels(case, command, output):
    record = known(*case)
    other = replace(record, input=command * record.input, output=output * record.output)
    here, there = chosen(*case), choose(RIGID, other)
    assert there.names == here.names
    runs = [fit.model.simulate(each) for fit, each in ((here, record), (there, other))]
    counted = runs[0].counted
    assert runs[1].output[counted] / output == pytest.approx(runs[0].output[counted], abs=1e-3 * np.ptp(record.output))


# --- the start ------------------------------------------------------------------------------------------------------


def test_the_first_samples_of_a_position_show_where_it_starts():
    t = 1e-3 * np.arange(300)
    exact = 0.2 + 0.3 * t - 0.5 * t**2
    noise = 1e-4 * np.random.default_rng(0).standard_normal(300)
    seen = initial_motion(exact + noise, 1e-3)
    assert abs(seen.speed[0] - 0.3) < 4 * seen.speed[1] < 0.02
    assert abs(seen.position[0] - 0.2) < 4 * seen.position[1] < 4e-4
    record = Record(t, exact + noise, 1e-3)
    assert agree([record], [np.array([0.3, 0.2])])
    assert not agree([record], [np.array([0.3, 0.201])])
    assert not agree([record], [np.array([0.9, 0.2])])
    assert not agree([record, record], [np.array([0.3, 0.2]), np.zeros(2)])


def test_a_start_that_bends_is_taken_from_fewer_samples():
    t = 1e-3 * np.arange(300)
    seen = initial_motion(np.cos(20 * t) + 1e-6 * np.random.default_rng(0).standard_normal(300), 1e-3)
    assert abs(seen.position[0] - 1.0) < 1e-4
    assert abs(seen.speed[0]) < 0.05  # of 20 at most


# --- the choice -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9])
def test_samples_that_hang_together_count_for_fewer(pole):
    white = np.random.default_rng(1).standard_normal(40_000)
    error = lfilter([1.0], [1.0, -pole], white)
    assert effective_samples([error]) == pytest.approx(len(error) * (1 - pole) / (1 + pole), rel=0.15)


@pytest.mark.parametrize(
    "name",
    [
        "motor 1",
        "axis 6",
        "axis with drift 8",
        *(
            pytest.param(each, marks=pytest.mark.long)
            for each in ("motor 0", "motor 4", "motor 9", "axis 1", "axis with drift 4")
        ),
    ],
)
def test_a_chosen_plant_is_as_good_as_the_truth_on_another_kind_of_input(name):
    case, fit = CASES[name](), chosen(name)
    run = fit.model.plant.simulate(case.unseen.input, case.unseen.dt, np.zeros(3), fit.model.signals)
    error = float(np.sqrt(np.mean((case.unseen.output - run) ** 2)))
    assert error < 1.3 * case.error_of_truth(case.unseen)


@pytest.mark.parametrize(("name", "drifts"), [("axis with drift 8", True), ("axis 6", False)])
def test_a_choice_sees_a_load_that_drifts(name, drifts):
    fit = chosen(name)
    assert isinstance(fit.weighting, tuple) is drifts
    found = [finding.data["parameters"] for finding in fit.findings if finding.code == "load-drifts"]
    assert found == ([["offset"]] if drifts else [])


@pytest.mark.parametrize(
    ("drift", "cogging", "noise", "seen"),
    [(0.0, 0.0, 3e-4, False), (0.05, 0.0, 3e-4, True), (0.0, 0.2, 3e-6, False)],
)
def test_a_drift_is_seen_where_it_leaves_noise(drift, cogging, noise, seen):
    truth = OneMass(viscous=(2.0, 2.0), coulomb=(0.3, 0.3), cogging=(0.01, cogging, 0.0), smooth=1e-4)
    rng, samples = np.random.default_rng(7), 1200
    u = 3 * lfilter([0.02], [1, -0.98], levels(samples, rng, 100))
    walk = np.cumsum(rng.standard_normal(samples))
    run = truth.run(u, 5e-3, drift * walk / np.std(walk))[1][:samples]
    record = Record(u, run + noise * rng.standard_normal(samples), 5e-3, output_units="m")
    trials = Trials((record,), (Signal.POSITION,), {})
    start = AXIS.with_values({"mass": 1.1, "viscous_friction": 2.2, "friction.coulomb": 0.3})
    assert (drift_of(trials, [start], start.default_free) is not None) is seen


def test_a_fit_under_a_drift_has_smaller_errors_which_its_intervals_include():
    truth = OneMass(viscous=(2.0, 2.0), coulomb=(0.3, 0.3), offset=0.1, smooth=1e-4)
    names, right, samples = ("mass", "viscous_friction", "friction.coulomb", "offset"), np.array([1, 2, 0.3, 0.1]), 1200
    start = AXIS.with_values({"mass": 1.1, "viscous_friction": 2.2, "friction.coulomb": 0.3})
    errors = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        u = 3 * lfilter([0.02], [1, -0.98], levels(samples, rng, 100))
        walk = np.cumsum(rng.standard_normal(samples))
        run = truth.run(u, 5e-3, 0.05 * walk / np.std(walk))[1][:samples]
        record = Record(u, run + 3e-4 * rng.standard_normal(samples), 5e-3, output_units="m")
        drift = drift_of(Trials((record,), (Signal.POSITION,), {}), [start], names).weighting
        how = {"free": names, "find_start": False, "hold": "zero"}
        plain, under = (simulation_error(start, record, weighting=w, **how) for w in (all_alike, drift))
        errors.append([plain.estimate - right, under.estimate - right, under.standard_error])
        assert "load-drifts" in [finding.code for finding in under.findings]
    before, after, deviations = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (after < 0.5 * before).all()
    assert (after < 2 * deviations).all()


def test_a_free_run_is_trusted_until_a_drift_moves_it_by_more_than_the_noise():
    """Without friction the variance of the position under a walk of the force is q·t⁵/20 for a mass of 1 kg."""
    plant = AXIS.with_values({"mass": 1.0, "viscous_friction": 0.0, "friction.coulomb": 0.0})
    u = np.sin(np.arange(2000) / 50)[:, None]
    run = plant.simulate(u, 2e-3, np.zeros(3), (Signal.POSITION,))
    segment, force, drift = Record(u, run, 2e-3), plant.largest_force(u), LoadDrift(0.05, np.inf, 1e-3)
    around = DriftingLoad.around(plant, segment, np.zeros(3), (Signal.POSITION,), drift, np.zeros(PIECES))
    assert around.trusted(4.0) == pytest.approx((20 * (1e-3 / (0.05 * force)) ** 2) ** 0.2, rel=0.05)
    still = replace(around, drift=drift._replace(rate=0.0))
    assert still.trusted(4.0) == 4.0


@pytest.mark.parametrize("returns", [False, True])
def test_a_drift_that_returns_is_told_from_a_walk(returns):
    truth, samples = OneMass(viscous=(2.0, 2.0), coulomb=(0.3, 0.3), smooth=1e-4), 1200
    rng = np.random.default_rng(1)
    u = 3 * lfilter([0.02], [1, -0.98], levels(samples, rng, 100))
    drift = lfilter([1], [1, -np.exp(-1 / 40) if returns else -1], rng.standard_normal(samples))
    run = truth.run(u, 5e-3, 0.05 * drift / np.std(drift))[1][:samples]
    record = Record(u, run + 3e-4 * rng.standard_normal(samples), 5e-3, output_units="m")
    found = drift_of(Trials((record,), (Signal.POSITION,), {}), [AXIS.with_values({"mass": 1.1})], AXIS.default_free)
    assert np.isfinite(found.weighting[0].drift.time) == returns


@pytest.mark.parametrize(("first", "begins"), [(0, InitialState.REST), (1010, InitialState.FREE)])
def test_the_rate_of_a_drift_is_found_where_the_first_samples_show_the_speed_inexactly(first, begins):
    """A walk of 0.0034 of the largest force per √s, which seems ten times that if linearised at the speed shown."""
    case = KINDS["axis with drift"](1700)
    record, start = case.fitted[first:], AXIS.with_values({"mass": 1 / case.truth.gain})
    found = drift_of(Trials((record,), (Signal.POSITION,), {}), [start], AXIS.default_free)
    assert found.begins is begins
    assert 0.0017 < found.weighting[0].drift.rate < 0.0067


def test_a_load_that_does_not_change_is_that_of_the_plant():
    u, state = 3 * levels(300, np.random.default_rng(0), 30)[:, None], np.array([0.1, 0.2, 0.1])
    late, straight = AXIS.with_values({"drive.delay": 0.012}), AXIS.with_hold(Hold.FIRST)
    for plant, load in ((AXIS, 0.2), (late, 0.2), (straight, 0.2), (DrivenMotor(Motor()), 1e-3)):
        drift = np.full(300, load / plant.largest_force(u))
        under = plant.simulate(u, 5e-3, state, (Signal.POSITION,), drift)
        loaded = plant.with_values({plant.load_name: plant.value(plant.load_name) + load})
        assert np.allclose(under, loaded.simulate(u, 5e-3, state, (Signal.POSITION,)), atol=1e-12)


def test_a_trial_without_free_parameters_is_not_begun_again():
    record = Record(np.ones(50), np.zeros(50), 1e-2, output_units="rad/s")
    trials = Trials((record,), (Signal.SPEED,), {})
    rest = Trial(RIGID, (), [RIGID.first_state((Signal.SPEED,), record)], 0.0, [record.output[:, 0]])
    assert trials.around(rest, np.random.default_rng(0), 2, 2).ends == ()


def test_equal_starts_of_a_trial_take_their_steps_once(monkeypatch):
    u = 12 * levels(300, np.random.default_rng(0), 30)
    speed = RIGID.simulate(u[:, None], 1e-2, np.zeros(RIGID.states), (Signal.SPEED,))
    trials = Trials((Record(u, speed, 1e-2, output_units="rad/s"),), (Signal.SPEED,), {})
    name, each_step, begun = "rotor_inertia", Trials._each_step, []
    monkeypatch.setattr(Trials, "_each_step", lambda self, problem: begun.append(problem) or each_step(self, problem))
    near, far = (RIGID.with_values({name: part * RIGID.value(name)}) for part in (0.8, 0.7))
    several = trials.fitted([near, far, near, far], [name])
    assert len(begun) == 2
    once = trials.fitted([near, far], [name])
    assert several is not None
    assert once is not None
    assert several.plant == once.plant


def test_a_lag_of_zero_does_not_stay_for_the_initial_reading_that_it_has():
    """The record begins within the delay after a jump of the command, so the first speed is not that of the motion."""
    truth = OneMass(gain=25.0, damping=10.0, coulomb=(20.0, 20.0), delay=6e-3, smooth=1e-2)
    rng = np.random.default_rng(0)
    u = 12 * levels(700, rng, 30)
    speed = truth.run(u, 1e-2)[0][:700] + 0.05 * rng.standard_normal(700)
    jumps = np.flatnonzero(np.abs(np.diff(u)) > 8) + 1
    first = int(jumps[jumps > 100][0])
    record = Record(u[first:], speed[first:], 1e-2, output_units="rad/s")
    fit = choose(RIGID, record, effects=("delay", "lag"))
    assert "sensor.lag" not in fit.names
    assert fit.model.plant.value("drive.delay") == pytest.approx(6e-3, rel=0.05)


def test_a_plant_without_a_refinement_does_not_get_it():
    fit = chosen("motor 1")
    assert not {"drive.freewheel", "drive.delay", "sensor.lag", "load_torque"} & set(fit.names)
    assert fit.model.plant.value("voltage_dead_zone.half_width") == pytest.approx(
        CASES["motor 1"]().truth.dead_zone, rel=0.2
    )


# --- refinements of the bridge ----------------------------------------------------------------------------------------


def bridge(seed: int = 0, most: float = 12.0, **changes: Any) -> tuple[OneMass, Record, Record]:
    """A motor behind a bridge, a record of levels to fit and one of sines to judge on, with 1 % noise."""
    truth = OneMass(
        **{"gain": 25.0, "damping": 10.0, "coulomb": (20.0, 20.0), "dead_zone": 0.5, "smooth": 1e-2, **changes}
    )
    rng = np.random.default_rng(seed)
    inputs = [most * levels(900, rng, 30), 12 * sines(900, rng, 60)]
    inputs[0][300:308] = 12.0
    runs = [truth.run(u, 1e-2)[0][:900] + 0.2 * rng.standard_normal(900) for u in inputs]
    return truth, *(Record(u, y, 1e-2, output_units="rad/s") for u, y in zip(inputs, runs, strict=True))


BRIDGES = {
    "drive.supply": ({"limit": 8.0}, ("supply",)),
    "drive.knee": ({"knee": 7.0, "beyond": 1.8}, ("knee",)),
    "voltage_dead_zone.m_l": ({"backward_gain": 1.04}, ("gain-by-direction",)),
    "rotor_friction.coulomb.backward": (
        {"backward_gain": 0.9, "coulomb": (26.0, 20.0)},
        ("gain-by-direction",),
    ),
    "rotor_friction.stribeck.backward": (
        {"stribeck": (4.0, 24.0), "stribeck_speed": 12.0},
        ("stribeck", "stribeck-by-direction"),
    ),
}


@pytest.mark.parametrize("name", BRIDGES)
def test_what_a_bridge_adds_is_found_where_it_is(name):
    changes, effects = BRIDGES[name]
    truth, fitted, unseen = bridge(**changes)
    fit = choose(RIGID, fitted, effects=("dead-zone", *effects))
    assert name in fit.names
    error = float(np.sqrt(np.mean((unseen.output - fit.model.simulate(unseen).output)[100:] ** 2)))
    best = float(np.sqrt(np.mean((unseen.output[:, 0] - truth.run(unseen.input[:, 0], 1e-2)[0][:900])[100:] ** 2)))
    assert error < 1.1 * best


def test_what_a_bridge_does_not_have_is_left_out():
    _, fitted, _ = bridge(seed=1)
    fit = choose(RIGID, fitted, effects=("dead-zone", "coasting", "supply", "knee", "gain-by-direction"))
    assert not {"drive.freewheel", "drive.supply", "drive.knee", "voltage_dead_zone.m_l"} & set(fit.names)


def test_directions_of_which_one_was_hardly_seen_are_not_told_apart():
    truth, fitted, _ = bridge(coulomb=(20.0, 40.0))
    u = np.abs(fitted.input)
    u[400:415] *= -1
    y = truth.run(u[:, 0], 1e-2)[0][:900] + 0.2 * np.random.default_rng(3).standard_normal(900)
    assert 0 < np.mean(y < -1) < 0.02
    few = Record(u, y, 1e-2, output_units="rad/s")
    for record, found in ((fitted, True), (few, False)):
        names = choose(RIGID, record, effects=("dead-zone", "coulomb-by-direction", "viscous-by-direction")).names
        assert ("rotor_friction.coulomb.backward" in names) is found


# --- structures that look alike ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("short_time", "law", "noise"),
    [
        ("drive.delay", GaussianStribeck(), 0.2),
        ("", Friction(), 0.2),
        ("inductance", Friction(), 0.4),  # with less noise, friction tells it from a lag
        pytest.param("drive.delay", Friction(), 0.2, marks=pytest.mark.long),
    ],
)
def test_what_a_time_constant_may_be_with_another_short_time_is_within_its_interval(short_time, law, noise):
    motor = replace(Motor(), rotor_friction=Friction(8e-3), load_friction=Friction(), inductance=3e-3).rigid()
    true = DrivenMotor(replace(motor, inductance=0.0)).quantities()[0]
    rng = np.random.default_rng(0)
    u = 4 * levels(1200, rng, 25)
    y = simulate(motor, u, 5e-3).load_speed + noise * rng.standard_normal(1200)
    others = (short_time, "rotor_viscous") if short_time == "inductance" else (short_time,) if short_time else ()
    fit = simulation_error(
        RIGID.with_frictions({"rotor_friction": law, "load_friction": Friction()}),
        Record(u, y, 5e-3, output_units="rad/s"),
        free=("motor_constant", "rotor_inertia", "rotor_friction.coulomb", "voltage_dead_zone.half_width", *others),
        fixed={"resistance": motor.resistance},
    )
    found = fit.combinations[0]
    assert found.quantity.name == true.name == "mechanical time constant"
    assert abs(found.quantity.value - true.value) < 2 * found.standard_error < 0.15 * true.value
    alike = next(finding for finding in fit.findings if finding.code == "alternatives-fit-as-well")
    assert alike.data["of"] == (short_time or None)
    missing = {"inductance"} if short_time else {"drive.delay", "inductance"}
    assert missing - {short_time} <= set(alike.data["instead"])


def test_a_motor_that_is_as_it_is_modelled_has_no_alternatives():
    _, fitted, _ = bridge()
    fit = simulation_error(RIGID, fitted)
    assert "alternatives-fit-as-well" not in [finding.code for finding in fit.findings]


def test_a_trial_begins_no_free_run_after_the_search_was_ended():
    """Those of a plant with a stiff shaft take seconds, and a round has dozens of starts."""
    record = Record(np.ones(100), np.arange(100.0), 0.01, output_units="rad/s")
    trials = Trials((record,), (Signal.SPEED,), {}, control=Control(cancelled=lambda: True))
    for ranked in (trials.by_cost, trials.fitted, trials.promising):
        with pytest.raises(Stopped):
            ranked([RIGID, RIGID], ("motor_constant",))


def test_a_fit_that_is_interrupted_before_its_first_step_takes_few_free_runs(monkeypatch):
    """It has no stages, needs no exact derivatives, and says which values it has."""
    runs, run = [], FreeRunError._run
    monkeypatch.setattr(FreeRunError, "_run", lambda self, *args: runs.append(args[0]) or run(self, *args))
    u = 8 * levels(150, np.random.default_rng(3), 15)
    record = Record(u, simulate(Motor(), u, 2e-3).load_speed, 2e-3, output_units="rad/s")
    free = ("motor_constant", "load_inertia", "shaft_stiffness", "rotor_friction.coulomb")
    options = {"find_start": False, "max_iterations": 0, "control": Control(cancelled=lambda: True)}
    fit = simulation_error(DrivenMotor(Motor()), record, free=free, **options)
    assert fit.ending is Ending.INTERRUPTED
    assert fit.names == free
    assert fit.estimate == pytest.approx([DrivenMotor(Motor()).value(name) for name in free])
    assert np.isfinite(fit.standard_error).all()
    assert len(runs) <= 2 + len(free)  # at the start, and each parameter and an initial state moved


def test_a_search_that_has_taken_friction_to_zero_begins_again_inside():
    truth = OneMass(
        gain=25.0, damping=10.0, coulomb=(20.0, 20.0), stribeck=(15.0, 15.0), stribeck_speed=2.0, smooth=1e-2
    )
    u = 12 * levels(600, np.random.default_rng(0), 30)
    speed = truth.run(u, 1e-2)[0][:600] + 0.2 * np.random.default_rng(0).standard_normal(600)
    fixed = {"resistance": 1.0, "voltage_dead_zone.half_width": 0.0, "rotor_viscous": 0.0, "motor_constant": 0.4}
    free = ("rotor_friction.coulomb", "rotor_friction.stribeck", "rotor_friction.stribeck_rate")
    corner = {free[0]: 0.0, free[1]: 0.4, free[2]: 0.01, "rotor_inertia": 0.016}
    start, record = RIGID.with_values({**fixed, **corner}), Record(u, speed, 1e-2, output_units="rad/s")
    stuck = continuation.search(prepare(start, record, free=free[1:], fixed=fixed), start, 60)
    reached = beside_kinks(prepare(start, record, free=free, fixed=fixed), stuck, 60)
    assert stuck.minimum.cost > 1.3 * reached.minimum.cost
    assert reached.minimum.cost == pytest.approx(0.5 * 600 * 0.2**2, rel=0.1)
    assert reached.ends[0] == stuck.minimum.cost


@pytest.mark.parametrize("knee", [20.0, 32.0])
def test_a_search_comes_back_from_a_wrong_knee(knee):
    """A command in steps makes a kink at every level, and beside a wrong knee the motor constant has no effect."""
    rng, fixed = np.random.default_rng(2), {"resistance": 1.0, "rotor_viscous": 0.0, "rotor_friction.coulomb": 0.0}
    true = {"motor_constant": 4.8, "rotor_inertia": 21.0, "voltage_dead_zone.half_width": 8.0}
    true |= {"drive.knee": 64.0, "drive.beyond": 0.05}
    u = np.round(250 * levels(1500, rng, 75))
    speed = RIGID.with_values(fixed | true).simulate(u[:, None], 5e-3, np.zeros(3), (Signal.SPEED,))[:, 0]
    record = Record(u, speed + 0.1 * rng.standard_normal(1500), 5e-3, output_units="rad/s")
    off = {name: value * 2 ** rng.uniform(-1, 1) for name, value in true.items()} | {"drive.knee": knee}
    start = RIGID.with_values(fixed | off)
    task = prepare(start, record, free=tuple(true), fixed=fixed, from_datasheet=False)
    stuck = continuation.search(task, start, 60)
    assert stuck.cost > 1.2 * 0.5 * 1500 * 0.1**2
    assert beside_kinks(task, stuck, 60).cost == pytest.approx(0.5 * 1500 * 0.1**2, rel=0.1)


@pytest.mark.parametrize("lag", [0.5, 2.0])
def test_a_search_comes_back_from_a_delay_beyond_a_whole_sample(lag):
    """A held command acts at other samples there, and a lag makes up for a part of it."""
    rng, dt = np.random.default_rng(3), 0.02
    fixed = {"resistance": 1.0, "rotor_viscous": 0.0, "rotor_friction.coulomb": 0.05}
    true = {"motor_constant": 0.36, "rotor_inertia": 0.01, "drive.delay": 0.95 * dt, "sensor.lag": 0.3 * dt}
    truth = RIGID.with_values({**fixed, **true})
    u = 2 * levels(600, rng, 3)
    speed = truth.simulate(u[:, None], dt, np.zeros(3), (Signal.SPEED,))[:, 0] + 0.05 * rng.standard_normal(600)
    off = {"rotor_inertia": 0.016, "drive.delay": 1.7 * true["drive.delay"], "sensor.lag": lag * true["sensor.lag"]}
    record = Record(u, speed, dt, output_units="rad/s")
    fit = simulation_error(truth.with_values(off), record, free=tuple(true), fixed=fixed, hold="zero")
    assert fit.model.plant.value("drive.delay") == pytest.approx(true["drive.delay"], rel=0.01)


def test_a_stalled_search_of_two_masses_says_how_many_starts_agree():
    u = 8 * levels(150, np.random.default_rng(3), 15)
    speed = simulate(Motor(), u, 2e-3).load_speed + 0.5 * np.random.default_rng(0).standard_normal(150)
    record, start = Record(u, speed, 2e-3, output_units="rad/s"), DrivenMotor(Motor())
    task = prepare(start, record, free=("motor_constant", "shaft_stiffness", "rotor_friction.coulomb"))
    found = continuation.search(task, start, 20)
    stall = Finding("search-stalled", "", {"steps": 1, "offset": 1.0})
    stalled = found._replace(minimum=replace(found.minimum, ending=Ending.STALLED, findings=(stall,)))
    minimum = begun_again(task, stalled, 20).minimum
    assert minimum.ending is Ending.CONVERGED
    (said,) = [finding.data for finding in minimum.findings if finding.code == "minimum-not-smooth"]
    assert said["starts"] == 7
    assert said["agreeing"] >= 4


@pytest.mark.parametrize(
    ("speed", "position", "expected"),
    [(0.0, 0.0, InitialState.REST), (0.0, 0.02, InitialState.FREE), (0.4, 0.0, InitialState.FREE)],
)
def test_a_position_starts_at_rest_at_zero_where_the_record_allows_it(speed, position, expected):
    truth = OneMass(gain=1.0, viscous=(2.0, 2.0), coulomb=(0.3, 0.3), smooth=1e-4)
    u = 3 * lfilter([0.02], [1, -0.98], levels(1500, np.random.default_rng(2), 150))
    y = truth.run(u, 5e-3, 0.0, (speed, position))[1][:1500]
    record = Record(u, y + 1e-3 * np.random.default_rng(0).standard_normal(1500), 5e-3, output_units="m")
    fit = simulation_error(AXIS, record, hold="zero")
    assert fit.begins is expected
    assert abs(fit.states[0][0] - speed) < 0.03
    assert abs(fit.states[0][1] - position) < 5e-4
    errors = np.abs(fit.estimate - [1.0, 2.0, 0.3, 0.0]) / fit.standard_error
    assert errors.max() < 4


def test_a_choice_says_how_many_searches_agree_where_its_last_step_removed_something():
    record = replace(KINDS["motor"](3, samples=600).fitted, output_units=("rad/s",))
    found = next(finding.data for finding in choose(RIGID, record).findings if finding.code == "searches-agreeing")
    assert found["searches"] == found["agreeing"] == 1 + choice.AGREEING


def test_a_choice_settles_the_start_once_the_plant_fits():
    """The four parameters to begin with fit worse than the samples show the start; the chosen plant does not."""
    case = KINDS["axis"](609, samples=4000)
    fit = choose(AXIS, replace(case.fitted, output_units=("m",)))
    run = fit.model.plant.simulate(case.fitted.input, case.fitted.dt, fit.states[0], fit.model.signals)
    left = np.sqrt(np.mean((case.fitted.output - run) ** 2))
    assert left < 1.01 * case.error_of_truth(case.fitted)
    assert not [name for name in fit.names if "stribeck" in name]


@pytest.mark.parametrize("find_start", [True, False])
def test_a_search_from_the_true_values_keeps_what_a_start_that_is_off_would_take_to_zero(find_start):
    """The first samples show the start so badly that Stribeck friction goes to zero with it."""
    case = KINDS["axis"](904)
    mass = 1 / case.truth.gain
    level, excess = np.mean(case.truth.coulomb) * mass, case.truth.stribeck[0] * mass
    known = {
        "mass": mass,
        "viscous_friction": case.truth.viscous[0] * mass,
        "friction.coulomb": level,
        "friction.stribeck": excess,
        "friction.stribeck_rate": 1 / case.truth.stribeck_speed,
        "offset": (case.truth.coulomb[0] - level / mass) * mass,
    }
    record = replace(case.fitted, output_units=("m",))
    fit = simulation_error(AXIS.with_values(known), record, free=tuple(known), hold="zero", find_start=find_start)
    assert fit.cost < 1.01 * 0.5 * len(record) * case.error_of_truth(record) ** 2
    assert fit.model.plant.value("friction.stribeck") == pytest.approx(excess, rel=0.1)


# --- slow drift ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("change", "drifts"), [(0.5, True), (0.0, False)])
def test_an_offset_that_drifts_is_said_and_is_within_its_interval(change, drifts):
    truth = OneMass(gain=1.0, viscous=(2.0, 2.0), coulomb=(0.3, 0.3), smooth=1e-4)
    u = 3 * lfilter([0.02], [1, -0.98], levels(2400, np.random.default_rng(2), 150))
    position = truth.run(u, 5e-3, change * np.linspace(0, 1, 2400))[1][:2400]
    record = Record(u, position + 1e-3 * np.random.default_rng(0).standard_normal(2400), 5e-3, output_units="m")
    fit = simulation_error(AXIS, record, hold="zero", fixed={"mass": 1.0})
    found = [finding for finding in fit.findings if finding.code == "parameter-drifts"]
    assert ("offset" in [finding.subject for finding in found]) is drifts
    assert bool(found) is drifts
    offset = fit.names.index("offset")
    assert abs(fit.estimate[offset] - change / 2) < 3 * fit.standard_error[offset]


@pytest.mark.parametrize("walks", [True, False])
def test_the_interval_of_a_load_includes_the_mean_of_its_drift(walks):
    truth = OneMass(gain=1.0, viscous=(2.0, 2.0), coulomb=(0.3, 0.3), smooth=1e-4)
    errors, deviations = [], []
    for seed in range(5):
        rng, samples = np.random.default_rng(seed), 1200
        u = 3 * lfilter([0.02], [1, -0.98], levels(samples, rng, 100))
        walk = np.cumsum(rng.standard_normal(samples)) / np.sqrt(samples)
        position = truth.run(u, 5e-3, 0.03 * walk * walks)[1][:samples]
        record = Record(u, position + 1e-4 * rng.standard_normal(samples), 5e-3, output_units="m")
        known = {"mass": 1.0, "viscous_friction": 2.0, "friction.coulomb": 0.3}
        fit = simulation_error(AXIS, record, free=["offset"], fixed=known, hold="zero", weighting=Recent(0.1, 2))
        assert walks is ("load-drifts" in [finding.code for finding in fit.findings])
        errors.append(float(fit.estimate[0]))
        deviations.append(float(fit.standard_error[0]))
    assert np.max(np.abs(errors) / deviations) < 3
    assert 0.01 < np.mean(deviations) < 0.05 if walks else np.mean(deviations) < 0.002


# --- fewer samples --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("straight", [False, True])
def test_a_motion_is_nearly_the_same_in_fewer_samples(straight):
    rng = np.random.default_rng(3)
    u = lfilter([0.002], [1.0, -0.998], 20 * rng.standard_normal(20_000))[:, None]
    hold = Hold.FIRST if straight else Hold.ZERO
    plant = AXIS.with_values({"mass": 2.0, "friction.coulomb": 0.05}).with_hold(hold)
    y = plant.simulate(u, 1e-3, np.zeros(3), (Signal.POSITION,))
    fewer = thinned(Record(u, y, 1e-3), straight)
    assert len(fewer) == 20_000 // 3
    assert fewer.dt == pytest.approx(3e-3)
    run = plant.with_hold(Hold.ZERO).simulate(fewer.input, fewer.dt, np.zeros(3), (Signal.POSITION,))
    assert np.max(np.abs(run - fewer.output)) < 2e-4 * np.ptp(y)
    wrong = thinned(Record(u, y, 1e-3), not straight)
    late = plant.with_hold(Hold.ZERO).simulate(wrong.input, fewer.dt, np.zeros(3), (Signal.POSITION,))
    assert np.max(np.abs(late - fewer.output)) > 2 * np.max(np.abs(run - fewer.output))


def test_short_records_and_short_segments_keep_all_samples():
    u = np.random.default_rng(0).standard_normal(20_000)
    short, gaps = Record(u[:6000], u[:6000], 1e-3), Record(u, u, 1e-3, breaks=(50,))
    assert thinned(short, False) is short
    assert thinned(gaps, False) is gaps


def test_a_speed_is_thinned_where_samples_lie_between_their_neighbours():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, 130), 100)
    slow, fast = (lfilter([1 - pole], [1, -pole], u) + 0.01 * rng.standard_normal(13_000) for pole in (0.99, 0.5))
    assert len(thinned(Record(u, slow, 1e-3), False, speed=True)) == 6500
    assert len(thinned(Record(u, fast, 1e-3), False, speed=True)) == 13_000


# --- long records ---------------------------------------------------------------------------------------------------
