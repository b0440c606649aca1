"""Refinements of friction and drive: each is found where the independent simulator has it, and only there."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import cheby1, cheby2, lfilter

from emsid import Record, concatenate
from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import FREE
from emsid.identification import candidates
from emsid.models.plants.cogging import Cogging
from emsid.models.plants.grey_box import signals_of
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import MotorPlant
from emsid.models.plants.parameters import Signal
from emsid.models.plants.registry import PLANTS, plant_from_data, plant_to_data
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.moves import Situation, additions
from emsid.options import Options
from emsid.plant import Friction, GaussianStribeck, Motor
from emsid.study.demonstration import axis_record
from independent import armature, two_masses
from independent.cases import CASES, levels
from independent.nonlinear_systems import duffing
from independent.one_mass import OneMass

RIGID, AXIS = PLANTS["rigid-motor"].start, PLANTS["linear-axis"].start
ROUGH = LinearAxis(
    2.0, 3.0, Friction(1.0, 0.3, 20.0), 0.1, quadratic_viscous=4.0, cogging=Cogging(0.05, 0.5, 0.3, 0.1, -0.2)
)


def axis(noise: float = 1e-4, **changes: Any) -> Record:
    """The position of an axis of 1 kg under slow forces."""
    truth = OneMass(**{"gain": 1.0, "viscous": (2.0, 2.0), "coulomb": (0.3, 0.3), "smooth": 1e-4, **changes})
    rng = np.random.default_rng(2)
    u = 3 * lfilter([0.02], [1, -0.98], levels(800, rng, 100))
    return Record(u, truth.run(u, 5e-3)[1][:800] + noise * rng.standard_normal(800), 5e-3, output_units="m")


def motor(largest: float = 12.0, **changes: Any) -> Record:
    """The speed of a motor under levels of the voltage, with 1 % noise."""
    truth = OneMass(gain=25.0, damping=10.0, coulomb=(20.0, 20.0), dead_zone=0.5, smooth=1e-2, **changes)
    rng = np.random.default_rng(0)
    u = largest * levels(450, rng, 30)
    return Record(u, truth.run(u, 1e-2)[0][:450] + 0.2 * rng.standard_normal(450), 1e-2, output_units="rad/s")


@pytest.mark.parametrize("gaussian", [True, pytest.param(False, marks=pytest.mark.long)])
def test_the_shape_in_which_friction_fades_is_found(gaussian):
    truth = OneMass(
        gain=25.0, damping=10.0, coulomb=(20.0, 20.0), stribeck=(60.0, 60.0), stribeck_speed=8.0, gaussian=gaussian,
        smooth=1e-2,
    )  # fmt: skip
    time, rng = np.arange(450), np.random.default_rng(0)
    u = 6 * np.sin(2 * np.pi * time / 150) * (1 + 0.5 * np.sin(2 * np.pi * time / 450))
    speed = truth.run(u, 1e-2)[0][:450] + 0.1 * rng.standard_normal(450)
    fit = choose(RIGID, Record(u, speed, 1e-2, output_units="rad/s"), effects=("stribeck",))
    law = fit.model.plant.motor.rotor_friction
    assert isinstance(law, GaussianStribeck if gaussian else Friction)
    assert law.stribeck_rate[0] == pytest.approx(1 / 8.0, rel=0.02 if gaussian else 0.2)
    assert ("friction-fades-as-gaussian" in {each.code for each in fit.findings}) == gaussian
    assert plant_from_data(plant_to_data(fit.model.plant)).motor.rotor_friction == law


def effects(plant: Any, record: Record) -> set[str]:
    """What may be added to a plant."""
    at = Situation(plant, plant.default_free, record.segments, signals_of(plant, record))
    return {row.effect for row in additions(at, ())}


def turning(amplitude: float, seed: int) -> Record:
    """The speed of a motor whose torque repeats every half radian, with 1 % noise."""
    rng = np.random.default_rng(seed)
    cogging_of = (0.5, 0.6 * amplitude, 0.8 * amplitude)
    truth = OneMass(gain=25.0, damping=10.0, coulomb=(10.0, 10.0), smooth=1e-2, cogging=cogging_of)
    u = lfilter([0.05], [1, -0.95], 3 * levels(800, rng, 100))
    speed = truth.run(u, 5e-3)[0][:800] + 0.1 * rng.standard_normal(800)
    return Record(u, speed, 5e-3, output_units="rad/s")


def test_cogging_is_found_in_a_speed():
    record = turning(15.0, 2)
    plant = choose(RIGID, record, effects=("cogging",)).model.plant
    wave = np.array([plant.cogging.cosine_1, plant.cogging.sine_1]) / plant.value("rotor_inertia")
    assert plant.cogging.period == pytest.approx(0.5, rel=5e-3)
    assert wave == pytest.approx([9.0, 12.0], abs=1.0)
    assert "cogging" not in effects(RIGID, concatenate([record[:400], record[:400]]))  # the position of the second


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(1, 5))])
def test_no_cogging_is_found_in_a_speed_without(seed):
    fit = choose(RIGID, turning(0.0, seed), effects=("cogging",))
    assert "cogging.period" not in fit.names


def test_one_mass_is_taken_where_a_shaft_does_not_help(monkeypatch):
    one_mass = candidates.Physical("", RIGID, ("coasting",))
    monkeypatch.setitem(candidates.CANDIDATES, "rigid-motor", one_mass)
    truth = OneMass(gain=25.0, damping=10.0, coulomb=(20.0, 20.0), coasting=1.0, full=12.0, smooth=1e-2)
    rng = np.random.default_rng(0)
    u = 12.0 * levels(200, rng, 20)
    record = Record(u, truth.run(u, 1e-2)[0][:200] + 0.2 * rng.standard_normal(200), 1e-2, output_units="rad/s")
    alone, with_shaft = one_mass(record, Options()), candidates.Physical("", PLANTS["motor"].start, ())
    fit = with_shaft(record, Options())
    assert (fit.model.name, fit.cost) == ("rigid-motor", alone.cost)
    assert fit.findings[0].code == "no-shaft-needed"
    assert fit.findings[0].data["ratio"] < 0.5
    assert with_shaft._without_shaft(record, Options(fixed={"shaft_stiffness": 100.0}), FREE) is None


@pytest.mark.parametrize("width", [0.0, 0.1])
def test_backlash_is_found_where_it_is_only(width):
    truth = replace(Motor(), shaft_backlash=width, rotor_friction=Friction(8e-3))
    rng = np.random.default_rng(0)
    volts = 10 * levels(250, rng, 20)
    speed = two_masses.load_speed(asdict(truth), volts, 2e-3)
    record = Record(volts, speed + 0.6 * rng.standard_normal(250), 2e-3, output_units="rad/s")
    known = ("resistance", "inductance", "motor_constant", "rotor_viscous", "rotor_inertia", "shaft_damping")
    fixed = {name: getattr(truth, name) for name in known} | {"voltage_dead_zone.half_width": 0.5}
    fit = choose(PLANTS["motor"].start, record, fixed=fixed, effects=("backlash",))
    found = [row.interval for row in fit.table if row.name == "shaft_backlash"]
    assert len(found) == bool(width)
    assert all(low < width < high < 1.2 * width for low, high in found)


# --- the simulation ---------------------------------------------------------------------------------------------------


def test_forces_over_speed_and_position_are_simulated_with_second_order():
    u = np.repeat(np.random.default_rng(0).uniform(-8, 8, 40), 20)[:, None]
    runs = [replace(ROUGH, steps=n).simulate(u, 5e-3, np.zeros(2), (Signal.POSITION,)) for n in (200, 2, 8)]
    coarse, fine = (float(np.max(np.abs(run - runs[0]))) for run in runs[1:])
    assert coarse < 1e-4 * np.ptp(runs[0])
    assert fine < coarse / 8


def test_forces_over_speed_and_position_agree_with_the_other_simulator():
    truth = OneMass(
        gain=0.5, viscous=(1.5, 1.5), coulomb=(0.5, 0.5), quadratic=2.0, cogging=(0.05, 0.25, 0.15), smooth=1e-5
    )
    plant = LinearAxis(2.0, 3.0, Friction(1.0), quadratic_viscous=4.0, cogging=Cogging(0.05, 0.5, 0.3), steps=4)
    u = 6 * np.sin(2 * np.pi * np.arange(300) / 150)
    run = plant.simulate(u[:, None], 5e-3, np.zeros(2), (Signal.POSITION,))[:, 0]
    assert np.max(np.abs(run - truth.run(u, 5e-3)[1][:300])) < 2e-3 * np.ptp(run)


def test_a_mass_rests_where_cogging_holds_it():
    plant = LinearAxis(1.0, 1.0, Friction(0.1), cogging=Cogging(0.1, sine_1=1.0))  # a valley at 0
    at = [plant.simulate(np.zeros((800, 1)), 5e-3, np.array([0.0, x]), (Signal.POSITION,))[-1, 0] for x in (1e-3, 0.03)]
    assert at[0] == 1e-3  # friction holds it
    assert abs(at[1]) < 2e-3  # it has slid back


def test_friction_over_speed_and_position_is_saved_where_there_is_any():
    assert plant_from_data(plant_to_data(ROUGH)) == ROUGH
    assert not [name for name in plant_to_data(AXIS)["parameters"] if name.startswith(("cogging", "quadratic"))]
    assert "F_c(x)" in ROUGH.equations()
    assert "F_c(x)" not in AXIS.equations()


# --- what is found ----------------------------------------------------------------------------------------------------


def test_quadratic_friction_is_found_where_it_is():
    fit = choose(RIGID, motor(quadratic=0.05), effects=("quadratic",))
    inertia, found = (fit.model.plant.value(name) for name in ("rotor_inertia", "quadratic_viscous"))
    assert found / inertia == pytest.approx(0.05, rel=0.2)
    assert "quadratic_viscous" not in choose(RIGID, motor(), effects=("quadratic",)).names


BY_SIGN = {"viscous-by-direction": ("viscous_backward", "viscous", (2.0, 5.0), 3.0),
           "voltage-drop": ("voltage_drop", "drop", 20.0, 0.8)}  # fmt: skip
"""For an effect that depends on a sign its parameter, that of the other simulator, its value there and what it is."""


def jittered(seed: int, **changes: Any) -> Record:
    """The speed of a motor of 1 Ω and 0.04 N·m/A under levels, with coloured noise of 3 % and outliers."""
    truth = OneMass(gain=25.0, damping=1.0, coulomb=(15.0, 15.0), smooth=1e-2, **changes)
    rng = np.random.default_rng(seed)
    u = 12.0 * levels(800, rng, 30)
    speed, noise = truth.run(u, 1e-2)[0][:800], lfilter([1.0], [1.0, -0.7], rng.standard_t(3, 800))
    return Record(u, speed + 0.03 * np.std(speed) / np.std(noise) * noise, 1e-2, output_units="rad/s")


@pytest.mark.parametrize("effect", BY_SIGN)
@pytest.mark.parametrize("seed", [11, pytest.param(12, marks=pytest.mark.long)])
def test_what_depends_on_a_sign_is_found_where_it_is(effect, seed):
    name, other, there, value = BY_SIGN[effect]
    record, tried = jittered(seed, **{other: there}), tuple(BY_SIGN)
    fit = choose(RIGID, record, fixed={"resistance": 1.0}, effects=tried)
    assert effect in {
        row.effect for row in additions(Situation(RIGID, (), record.segments, (Signal.SPEED,)), (), tried)
    }
    (row,) = (row for row in fit.table if row.name == name)
    size = fit.model.plant.inertia_of_all if name == "viscous_backward" else 1.0
    assert row.value / size == pytest.approx(value, abs=3 * row.standard_error / size)
    assert 0 < row.interval[0] < row.interval[1] < 1.2 * value * size


@pytest.mark.parametrize("seed", [11, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(12, 16))])
def test_what_depends_on_a_sign_is_not_found_where_it_is_not(seed):
    fit = choose(RIGID, jittered(seed), fixed={"resistance": 1.0}, effects=tuple(BY_SIGN))
    assert not {"viscous_backward", "voltage_drop"} & {*fit.names}


def test_what_depends_on_a_sign_agrees_with_the_other_simulator_and_is_one_mass_only():
    truth = OneMass(gain=25.0, damping=1.0, viscous=(2.0, 5.0), coulomb=(15.0, 15.0), drop=20.0, smooth=1e-3)
    motor = Motor(1.0, 0.0, 0.04, 1.6e-3, 3.2e-3, load_inertia=1e-12, load_viscous=0.0, rotor_friction=Friction(0.024))
    whole = replace(motor, load_friction=Friction(), voltage_dead_zone=None)
    plant = MotorPlant(whole.rigid(), viscous_backward=4.8e-3, voltage_drop=0.8)
    u = 12 * np.sin(2 * np.pi * np.arange(300) / 70)
    run = plant.simulate(u[:, None], 1e-2, np.zeros(2), (Signal.SPEED,))[:, 0]
    assert np.max(np.abs(run - truth.run(u, 1e-2)[0][:300])) < 2e-3 * np.ptp(run)
    with pytest.raises(ModelError, match="one mass only"):
        replace(plant, motor=replace(whole, inductance=1e-3).rigid())
    same = replace(plant.motor, rotor_viscous=plant.motor.rotor_viscous + 2.4e-3)  # the mean of both directions
    straight = [each.linearised((Signal.SPEED,)).a for each in (plant, MotorPlant(same))]
    np.testing.assert_allclose(*straight)
    forward = replace(plant, viscous_backward=-4.8e-3).simulate(-u[:, None], 1e-2, np.zeros(2), (Signal.SPEED,))
    np.testing.assert_allclose(forward[:, 0], -run, atol=1e-9)  # the sign decides on the direction
    assert "V_d·sgn(i)" in plant.equations()
    assert "ΔB·min(ω, 0)" in plant.equations()


def test_a_dead_zone_that_differs_by_direction_is_found():
    record = motor()
    moved = replace(record, input=record.input + 0.6 * (record.input > 0))
    fit = choose(RIGID, moved, effects=("dead-zone", "dead-zone-by-direction"))
    found = [fit.model.plant.value(f"voltage_dead_zone.{side}") for side in ("b_l", "b_r")]
    assert found == pytest.approx([-0.5, 1.1], abs=0.05)


def test_stribeck_friction_is_found_without_a_start_for_its_rate():
    case = CASES["axis 5"]()
    record = Record(case.fitted.input, case.fitted.output, case.fitted.dt, output_units="m")
    fit = simulation_error(AXIS, record, free=(*AXIS.default_free, "friction.stribeck", "friction.stribeck_rate"))
    assert 2 * fit.cost / len(record) < 1.01 * case.error_of_truth(record) ** 2


def test_cogging_is_found_where_it_is():
    fit = choose(AXIS, axis(cogging=(0.02, 0.1, 0.05)), effects=("cogging",))
    found = dict(zip(fit.names, fit.estimate, strict=True))
    assert found["cogging.period"] == pytest.approx(0.02, rel=1e-3)
    assert np.hypot(found["cogging.cosine_1"] - 0.1, found["cogging.sine_1"] - 0.05) < 0.01
    assert "cogging.period" not in choose(AXIS, axis(), effects=("cogging",)).names


@pytest.mark.parametrize(("henry", "found"), [(1e-2, True), (1e-5, False)])
def test_an_inductance_is_found_where_the_sample_time_shows_it(henry, found):
    rng, dt = np.random.default_rng(0), 5e-3
    u = 8 * levels(450, rng, 25)
    u[:8] = 0.0  # what rests at first has no current
    y = armature.speed(u, dt, 1.0, henry, 0.05, 2.5e-4, 6e-3, 0.4) + 0.3 * rng.standard_normal(450)
    record = Record(u, y, dt, output_units="rad/s")
    fit = choose(RIGID, record, fixed={"resistance": 1.0}, effects=("dead-zone", "delay", "lag", "inductance"))
    assert ("inductance" in fit.names) is found
    assert not {"drive.delay", "sensor.lag"} & set(fit.names)
    if found:
        assert fit.estimate[fit.names.index("inductance")] == pytest.approx(henry, rel=0.05)
    assert "inductance" in effects(RIGID, record)


@pytest.mark.parametrize("part", [0.7, pytest.param(1.0, marks=pytest.mark.long)])
def test_the_axis_of_the_demo_has_no_refinement(part):
    record = axis_record()[: round(part * 2400)]  # its first samples show its start less exactly than the rest
    fit = choose(AXIS, record)
    assert fit.names == AXIS.default_free
    assert "load-drifts" not in [finding.code for finding in fit.findings]


@pytest.mark.parametrize(("load", "reading"), [(2.0, 0.0), (0.0, 0.2)], ids=["load", "sensor"])
def test_an_offset_of_the_sensor_is_told_from_a_constant_load(load, reading):
    record = motor(offset=load)
    shown = replace(record, output=record.output + reading)
    fit = choose(RIGID, shown, effects=("load", "sensor-offset"))
    assert ("load_torque" in fit.names, "sensor.offset" in fit.names) == (load > 0, reading > 0)
    if reading:
        row = next(row for row in fit.table if row.name == "sensor.offset")
        assert row.value == pytest.approx(reading, abs=3 * row.standard_error)


# --- a record of another system ---------------------------------------------------------------------------------------


def resonance() -> Record:
    """A damped oscillation that steps excite, with 1 % noise; no mass with friction can swing."""
    rng = np.random.default_rng(0)
    u = levels(450, rng, 30)
    y = lfilter([0.05], [1, -1.9, 0.95], u)
    return Record(u, y + 0.01 * np.std(y) * rng.standard_normal(450), 1e-2, output_units="rad/s")


def test_a_plant_that_leaves_several_times_what_a_linear_model_leaves_is_not_refined_further():
    tried = ("delay", "lag")
    ended = choose(RIGID, resonance(), effects=tried, linear=1e-3)
    (found,) = (each for each in ended.findings if each.code == "probably-another-system")
    assert found.data["left"] > 0.1
    assert found.data["linear"] == 1e-3
    usual = choose(RIGID, resonance(), effects=tried)
    assert "probably-another-system" not in [each.code for each in usual.findings]
    assert len(usual.names) >= len(ended.names)


def test_a_plant_that_leaves_several_times_what_a_regression_leaves_is_not_refined_further():
    asked = []

    def regression() -> float:
        asked.append(1)
        return 0.01

    ended = choose(RIGID, resonance(), effects=("delay", "lag"), linear=0.9, regression=regression)
    (found,) = (each for each in ended.findings if each.code == "probably-another-system")
    assert found.data["regression"] == 0.01
    assert found.data["left"] > 0.1
    assert asked == [1]
    choose(RIGID, motor(), effects=("delay",), linear=0.9, regression=regression)
    assert asked == [1]  # a motor leaves little, and is not compared


def test_a_motor_model_of_a_nonlinear_oscillator_is_given_up_early():
    """A linear model leaves 21 % of this oscillator, too much to tell that the best motor, with 28 %, is none."""
    record = duffing(2048, 2, noise=0.01, spread=0.2).unseen["another multisine"]
    fit = candidates.CANDIDATES["rigid-motor"](record, Options())
    (found,) = (each for each in fit.findings if each.code == "probably-another-system")
    assert found.data["linear"] > 0.2
    assert found.data["regression"] < 0.01
    assert len(fit.names) <= 5


def test_a_motor_is_compared_with_linear_models_of_several_orders(monkeypatch):
    """A model of fourth order leaves 6 % of two filters of third order; the plant would be refined for minutes."""
    rng = np.random.default_rng(0)
    u = lfilter(*cheby1(4, 1, 0.25), rng.standard_normal(2000))
    y = lfilter(*cheby2(3, 40, 0.3), lfilter(*cheby1(3, 0.5, 0.12), u))
    record = Record(u, y + 0.01 * np.std(y) * rng.standard_normal(2000), 1e-3)
    given = []
    monkeypatch.setattr(candidates, "choose", lambda *_, linear, **__: given.append(linear))
    candidates.CANDIDATES["rigid-motor"](record, Options())
    assert given[0] < 1e-3


def test_a_motor_is_refined_also_where_a_linear_model_leaves_nothing():
    fit = choose(RIGID, motor(), effects=("delay",), linear=0.0)
    assert "probably-another-system" not in [each.code for each in fit.findings]
