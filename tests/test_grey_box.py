"""The grey box: motion, recovery, what is not identifiable, bad input, and real recordings."""

import runpy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit

from coverage_grey_box import FREE, MOTOR, coverage, least_share, simulated_record
from emsid.errors import DataError, FormatError, ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.uncertainty.identifiability import identifiability
from emsid.findings import Finding
from emsid.io import read, read_datasheet
from emsid.models.model import Model
from emsid.models.plants.datasheet import Given, applicable, datasheet
from emsid.models.plants.drive import Bridge, Drive, Feed
from emsid.models.plants.free_run_error import Recent
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.one_mass import Sliding, move
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.parameters import Signal, parts, without_overlap
from emsid.models.plants.search.choice import STARTS, choose
from emsid.models.plants.search.diagnostics import dead_zone_curve, friction_curve, likelihood_profile, stops
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.refinements.usual import by_direction, coasting_bridge, late_command, stribeck
from emsid.models.plants.search.result import Status
from emsid.models.plants.sensor import Sensor
from emsid.plant import DeadZoneLaw, Friction, Motor, State, simulate
from emsid.plant.motor import Parameter
from emsid.record import Record, concatenate
from emsid.validation.metrics import fit_percent

DT = 5e-3
T = DT * np.arange(2000)
VOLTAGE = 3 * np.sin(2 * np.pi * 0.4 * T) + 2 * np.sin(2 * np.pi * 1.3 * T)
RIGID = Motor(inductance=0.0).rigid()
SPEED = (Signal.SPEED,)


def record_of(plant, command=VOLTAGE, noise=0.0, seed=0, unit="rad/s", signals=SPEED):
    output = plant.simulate(command[:, None], DT, np.zeros(plant.states), signals)
    output = output + noise * np.random.default_rng(seed).standard_normal(output.shape)
    return Record(command, output, DT, output_units=(unit,) * len(signals))


def codes(fit):
    return [finding.code for finding in fit.findings]


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


# --- motion ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "friction", [Friction(8e-3), Friction((8e-3, 5e-3)), Friction()], ids=["coulomb", "directions", "none"]
)
def test_one_mass_moves_exactly_as_the_plant_does(friction):
    motor = replace(RIGID, rotor_friction=friction)
    for initial in (0.0, 12.0, -7.0):
        exact = simulate(motor, VOLTAGE, DT, initial=State(0.0, initial, initial))
        fast = DrivenMotor(motor).simulate(VOLTAGE[:, None], DT, np.array([initial, 0.0]), SPEED)[:, 0]
        assert np.max(np.abs(fast - exact.load_speed)) < 1e-8
        assert np.array_equal(fast == 0, exact.load_held)


def moved_slowly(mass, friction, force, damping, dt, late, steps, speed, position):
    """`move` as anybody would write it: small steps, in which friction takes from the speed but never turns it."""
    speeds, positions = np.empty(len(force) - 1), np.empty(len(force) - 1)
    for k in range(len(speeds)):
        speeds[k], positions[k] = speed, position
        for part, whole in ((k, late * dt), (k + 1, (1 - late) * dt)):
            h = whole / steps
            for _ in range(steps):
                side = 0 if (speed > 0 or (speed == 0 and force[part] > 0)) else 1
                coulomb, excess, rate = friction.numbers[side]
                level = coulomb + excess * np.exp(-rate * abs(speed))
                drag = damping[part] + friction.viscous[side]
                pushed = (speed + h * force[part] / mass) / (1 + h * drag / mass)
                speed = np.sign(pushed) * max(abs(pushed) - h * level / mass, 0.0)
                position += h * speed
    return speeds, positions


@pytest.mark.parametrize("seed", range(4))
def test_the_compiled_motion_is_the_limit_of_the_slow_one(seed):
    rng = np.random.default_rng(seed)
    law = Friction(
        tuple(rng.uniform(0.2, 1.0, 2)), tuple(rng.uniform(0.0, 0.5, 2) * (seed % 2)), tuple(rng.uniform(1, 5, 2))
    )
    friction = Sliding.of(law, rng.uniform(0, 2, 2))
    force, damping = np.repeat(3 * rng.standard_normal(13), 5), np.repeat(rng.uniform(0.1, 1.0, 13), 5)
    start = (0.05, float(rng.uniform(0, 1)))
    speeds, positions = np.empty(64), np.empty(64)
    move(0.7, friction, force, damping, *start, 20, 0.4, 1.0, speeds, positions)
    differences = []
    for steps in (40, 160):
        slow = moved_slowly(0.7, friction, force, damping, *start, steps, 0.4, 1.0)
        differences.append(max(np.max(np.abs(speeds - slow[0])), np.max(np.abs(positions - slow[1]))))
    assert differences[0] < 0.02 * np.max(np.abs(speeds))
    assert differences[1] < 0.4 * differences[0]  # of first order, towards the same motion


def test_a_stribeck_excess_is_of_second_order_in_the_step():
    exact = simulate(RIGID, VOLTAGE, DT).load_speed
    runs = [DrivenMotor(RIGID, steps=n).simulate(VOLTAGE[:, None], DT, np.zeros(2), SPEED)[:, 0] for n in (4, 8, 16)]
    errors = [np.sqrt(np.mean((run - exact) ** 2)) for run in runs]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[0] < 1e-3 * np.std(exact)
    assert np.all(orders > 1.6)


@pytest.mark.parametrize("motor", [replace(RIGID, rotor_friction=Friction(8e-3)), Motor()], ids=["rigid", "two masses"])
def test_half_a_sample_late_is_a_delay_of_one_at_half_the_sample_time(motor):
    late = DrivenMotor(motor, Drive(delay=1.5 * DT)).simulate(VOLTAGE[:, None], DT, np.zeros(2), SPEED)
    twice = np.repeat(VOLTAGE, 2)
    fine = DrivenMotor(motor, Drive(delay=3 * DT / 2)).simulate(twice[:, None], DT / 2, np.zeros(2), SPEED)
    assert np.allclose(late, fine[::2], atol=1e-7)


def test_a_bridge_that_coasts_brakes_in_proportion_to_its_duty():
    motor = replace(RIGID, rotor_friction=Friction(), load_friction=Friction(), voltage_dead_zone=None)
    command = np.full(2000, 6.0)
    final = [
        DrivenMotor(motor, Drive(supply=24.0, freewheel=f)).simulate(command[:, None], DT, np.zeros(2), SPEED)[-1, 0]
        for f in (0.0, 1.0)
    ]
    k, r, b = motor.motor_constant, motor.resistance, motor.rotor_viscous + motor.load_viscous
    assert final == pytest.approx([6 * k / r / (k**2 / r + b), 6 * k / r / (0.25 * k**2 / r + b)], rel=1e-6)


def test_a_drive_has_another_gain_beyond_its_knee_and_is_limited_by_its_supply():
    drive = Drive(gain=0.5, supply=6.0, knee=4.0, beyond=2.0)
    command = np.array([0.0, 6.0, 8.0, 9.0, 20.0, -9.0, -20.0])
    assert drive.terminals(command[:, None], DT)[0][1:] == pytest.approx([0.0, 3.0, 4.0, 5.0, 6.0, -5.0, -6.0])


def test_codes_brake_and_coast():
    motor = replace(RIGID, rotor_friction=Friction(), load_friction=Friction())
    drive = Drive(codes=((1000.0, Bridge.BRAKE), (999.0, Bridge.COAST)))
    k, r, b = motor.motor_constant, motor.resistance, motor.rotor_viscous + motor.load_viscous
    inertia = motor.rotor_inertia + motor.load_inertia
    for code, damping in ((1000.0, k**2 / r + b), (999.0, b)):
        command = np.full(20, code)
        run = DrivenMotor(motor, drive).simulate(command[:, None], DT, np.array([50.0, 0.0]), SPEED)[:, 0]
        assert run == pytest.approx(50 * np.exp(-damping / inertia * DT * np.arange(20)), rel=1e-9)


def test_the_state_of_the_bridge_may_have_a_column_of_its_own():
    codes = ((1.0, Bridge.BRAKE), (2.0, Bridge.COAST))
    state = np.zeros(len(VOLTAGE))
    state[500:700], state[1200:1500] = 1.0, 2.0
    among = np.where(state == 1, 1000.0, np.where(state == 2, 999.0, VOLTAGE))
    plain = DrivenMotor(RIGID, Drive(codes=((1000.0, Bridge.BRAKE), (999.0, Bridge.COAST))))
    beside = DrivenMotor(RIGID, Drive(codes=codes))
    start = np.zeros(2)
    expected = plain.simulate(among[:, None], DT, start, SPEED)
    found = beside.simulate(np.column_stack([VOLTAGE, state]), DT, start, SPEED)
    assert np.array_equal(found, expected)
    record = Record(
        np.column_stack([VOLTAGE, state]), found + 0.1 * np.random.default_rng(0).standard_normal(found.shape), DT
    )
    fit = choose(replace(beside, motor=replace(RIGID, motor_constant=0.07, rotor_inertia=5e-5)), record, refinements=(),
                 fixed={"resistance": 2.0})  # fmt: skip
    k = fit.names.index("motor_constant")
    assert abs(fit.estimate[k] - RIGID.motor_constant) < 4 * fit.standard_error[k] < 0.1 * RIGID.motor_constant
    assert rms(fit.simulated()[0] - record.output) < 0.11
    with pytest.raises(DataError, match="2 inputs for rigid-motor"):
        simulation_error(DrivenMotor(RIGID), record)


@pytest.mark.parametrize(
    ("feed", "unit", "scale"), [(Feed.CURRENT, "A", 0.2), (Feed.TORQUE, "N*m", 0.01)], ids=["current", "torque"]
)
def test_a_motor_is_fed_with_what_the_command_is_in(feed, unit, scale):
    motor = replace(RIGID, voltage_dead_zone=None, load_inertia=1e-15, load_viscous=0.0, rotor_viscous=4e-5)
    truth = DrivenMotor(replace(motor, rotor_friction=Friction(3e-3), load_friction=Friction()), feed=feed)
    record = replace(record_of(truth, scale * VOLTAGE, 0.1), input_units=(unit,))
    # As a voltage would do it without back electromotive force: the resistance large, the voltage larger.
    far = replace(truth.motor, resistance=1e9)
    made = 1e9 * scale * VOLTAGE / (1.0 if feed is Feed.CURRENT else motor.motor_constant)
    exact = DrivenMotor(far).simulate(made[:, None], DT, np.zeros(2), SPEED)
    assert truth.simulate(record.input, DT, np.zeros(2), SPEED) == pytest.approx(exact, abs=1e-4)
    fit = choose(STARTS["rigid-motor"], record, fixed={"motor_constant": 0.05}, refinements=())
    assert fit.model.plant.feed is feed
    for name in ("rotor_inertia", "rotor_viscous", "rotor_friction.coulomb"):
        k = fit.names.index(name)
        assert abs(fit.estimate[k] - truth.value(name)) < 4 * fit.standard_error[k]
        assert fit.standard_error[k] < 0.01 * truth.value(name)
    again = GreyBox.from_data(fit.model.to_data())
    assert np.array_equal(again.simulate(record).output, fit.model.simulate(record).output)
    with pytest.raises(ModelError, match="one mass only"):
        simulation_error(Motor(), record)


def test_a_motor_fed_with_a_current_is_identified_up_to_its_constant():
    motor = replace(
        RIGID, load_inertia=1e-15, load_viscous=0.0, load_friction=Friction(), rotor_friction=Friction(3e-3)
    )
    truth = DrivenMotor(replace(motor, voltage_dead_zone=None), feed=Feed.CURRENT)
    record = replace(record_of(truth, 0.3 * VOLTAGE, 0.1), input_units=("A",))
    fit = simulation_error(motor, record)
    assert fit.names == ("rotor_viscous", "rotor_inertia", "rotor_friction.coulomb")
    combinations = {each.quantity.name: each for each in fit.combinations}
    exact = {quantity.name: quantity.value for quantity in truth.quantities()}
    for name in ("acceleration per ampere", "mechanical time constant"):
        assert combinations[name].quantity.value == pytest.approx(exact[name], rel=0.05)


@pytest.mark.parametrize("unit", ["rad/s", "m", "ohm", "kg"])
@pytest.mark.parametrize("plant", [RIGID, LinearAxis()], ids=["motor", "axis"])
def test_a_command_in_the_unit_of_something_else_is_refused(unit, plant):
    record = replace(record_of(DrivenMotor(RIGID)), input_units=(unit,), output_units=("",))
    with pytest.raises(DataError, match=f"is in {unit}, and .* takes"):
        simulation_error(plant, record)


@pytest.mark.parametrize(("resting", "neutral"), [(5, 0.0), (25, 1e-3)])
def test_a_short_step_from_rest_is_judged_alike_with_a_lag_and_without(resting, neutral):
    """The rise is all that such a record shows; the samples that start a lag in motion contain it."""
    u = np.where(np.arange(120) < resting, neutral, 6.0)
    plain = replace(MOTOR, motor=replace(MOTOR.motor, rotor_friction=Friction(8e-3)))
    lagging = replace(plain, sensor=Sensor(lag=0.2 * DT))
    record = Record(u, lagging.simulate(u[:, None], DT, np.zeros(3), SPEED), DT)
    runs = [GreyBox(plant, SPEED).simulate(record) for plant in (plain, lagging)]
    assert all(run.counted.all() for run in runs)
    np.testing.assert_allclose(runs[1].output, record.output, atol=1e-9)
    assert 97 < fit_percent(record.output, runs[0].output) < 100


def test_a_sensor_scales_lags_and_averages():
    motor = DrivenMotor(replace(RIGID, rotor_friction=Friction(8e-3)))
    plain = record_of(motor).output[:, 0]
    position = record_of(motor, signals=(Signal.POSITION,), unit="rad").output[:, 0]
    shown = record_of(replace(motor, sensor=Sensor(ratio=10.0, offset=0.5, average=True))).output[:, 0]
    assert shown[1:] == pytest.approx(np.diff(position) / DT / 10 + 0.5)
    lagging = record_of(replace(motor, sensor=Sensor(lag=0.02))).output[:, 0]
    assert np.sqrt(np.mean((lagging[4:] - plain[:-4]) ** 2)) < 0.3 * np.sqrt(np.mean((lagging - plain) ** 2))


def test_the_shortest_lag_of_a_sensor_has_an_effect_in_proportion():
    """A search that has taken a lag to zero can leave it again."""
    u = np.repeat([0.0, 6.0, -3.0], 20)[:, None]
    shown = [replace(MOTOR, sensor=Sensor(lag=lag * DT)).simulate(u, DT, np.zeros(3), SPEED) for lag in (0.0, 1e-7)]
    assert (shown[1] - shown[0])[1:] / 1e-7 == pytest.approx(-np.diff(shown[0], axis=0), rel=1e-4, abs=1e-6)


# --- recovery -------------------------------------------------------------------------------------------------------


def test_a_motor_is_recovered_from_start_values_half_off():
    start = MOTOR.with_values(
        {name: MOTOR.value(name) * factor for name, factor in zip(FREE, (1.5, 0.5, 1.5, 0.5), strict=True)}
    )
    fit = simulation_error(start, record_of(MOTOR), free=FREE)
    assert fit.ending is Ending.CONVERGED
    assert fit.estimate == pytest.approx([MOTOR.value(name) for name in FREE], rel=1e-5)


def test_an_axis_is_recovered_from_its_position_without_start_values():
    truth = LinearAxis(80.0, (150.0, 200.0), Friction((30.0, 20.0)), offset=0.0)
    free = (
        "mass", "viscous_friction.forward", "viscous_friction.backward",
        "friction.coulomb.forward", "friction.coulomb.backward",
    )  # fmt: skip
    record = record_of(truth, 30 * VOLTAGE, unit="m", signals=(Signal.POSITION,))
    fit = simulation_error(LinearAxis(), record, free=free)
    assert fit.estimate == pytest.approx([80.0, 150.0, 200.0, 30.0, 20.0], rel=1e-4)


@pytest.mark.parametrize("factors", [(1.5, 0.5, 1.5, 0.5), (0.5, 1.5, 0.5, 1.5), (0.5, 0.5, 2.5, 1.5)])
def test_two_masses_are_recovered_from_beside_another_resonance(factors):
    truth = DrivenMotor(Motor(load_friction=Friction(), rotor_friction=Friction(8e-3)))
    free = ("motor_constant", "rotor_inertia", "shaft_stiffness", "rotor_friction.coulomb")
    start = truth.with_values({name: truth.value(name) * f for name, f in zip(free, factors, strict=True)})
    fit = simulation_error(start, record_of(truth, VOLTAGE[:600]), free=free)
    assert fit.ending is Ending.CONVERGED
    assert fit.names == free
    assert fit.estimate == pytest.approx([truth.value(name) for name in free], rel=1e-6)


def test_several_records_share_parameters_and_not_initial_states():
    pieces = []
    for speed in (0.0, 30.0, -20.0):
        output = MOTOR.simulate(VOLTAGE[:500, None], DT, np.array([speed, 0.0]), SPEED)
        noise = 0.1 * np.random.default_rng(int(speed) + 100).standard_normal(output.shape)
        pieces.append(Record(VOLTAGE[:500], output + noise, DT, output_units=("rad/s",)))
    apart = simulation_error(MOTOR, pieces, free=FREE)
    joined = simulation_error(MOTOR, concatenate(pieces), free=FREE)
    assert apart.estimate == pytest.approx(joined.estimate, rel=1e-12)
    assert [state[0] for state in apart.states] == pytest.approx([0.0, 30.0, -20.0], abs=0.3)


def test_a_measured_current_identifies_the_resistance():
    signals = (Signal.SPEED, Signal.CURRENT)
    output = MOTOR.simulate(VOLTAGE[:, None], DT, np.zeros(2), signals)
    output = output + np.random.default_rng(1).standard_normal(output.shape) * (0.05, 0.002)
    record = Record(VOLTAGE, output, DT, output_names=("speed", "current"), output_units=("rad/s", "A"))
    fit = simulation_error(MOTOR, record, free=("resistance", *FREE))
    assert fit.names == ("resistance", *FREE)
    assert "not-identifiable" not in codes(fit)
    assert fit.estimate[:2] == pytest.approx([MOTOR.value("resistance"), MOTOR.value("motor_constant")], rel=0.01)


def test_intervals_contain_the_true_values_with_coloured_noise_and_quantisation():
    shares = coverage(25)  # 300 records by `make coverage`
    assert tuple(shares) == FREE
    assert min(shares.values()) >= least_share(25)


def test_errors_that_are_forgotten_find_the_same_parameters():
    record = record_of(MOTOR, noise=0.05)
    plain, recent = (simulation_error(MOTOR, record, free=FREE, weighting=w) for w in (Recent(10.0), Recent(0.2, 2)))
    spread = np.hypot(plain.standard_error, recent.standard_error)
    assert np.all(np.abs(plain.estimate - recent.estimate) < 5 * spread)


# --- what is identifiable ---------------------------------------------------------------------------------------------


def test_voltage_and_speed_identify_combinations_only():
    record = record_of(MOTOR, noise=0.05)
    fit = simulation_error(MOTOR, record, free=("resistance", "rotor_viscous", *FREE))
    assert set(fit.names).isdisjoint({"resistance", "rotor_viscous"})
    status = {row.name: row.status for row in fit.table}
    assert status["resistance"] is Status.KEPT
    assert status["rotor_inertia"] is Status.CONDITIONAL
    assert status["voltage_dead_zone.half_width"] == "estimated"
    (finding,) = [each for each in fit.findings if each.code == "not-identifiable"]
    assert "resistance" in finding.data["parameters"]
    true = {q.name: q.value for q in MOTOR.quantities()}
    combinations = {c.quantity.name: c for c in fit.combinations}
    assert {"mechanical time constant", "speed per volt", "acceleration per volt"} <= set(combinations)
    assert "electromechanical time constant" not in combinations
    for name, combination in combinations.items():
        assert abs(combination.quantity.value - true[name]) < 4 * combination.standard_error, name


@pytest.mark.parametrize("kept", [1.0, 1.5, 3.0])
def test_what_only_the_start_does_not_separate_is_estimated(kept):
    """Where q is 1, p and q are the same gain; the start of p must not decide where the search ends."""
    table = tuple(Parameter(name, name, "1", "of the gain") for name in "pq")

    def gain(p, q):
        both = lambda x, u, v: [v[0] * v[1] * x[0] + (v[1] - 1) ** 2 * x[0] ** 3]  # noqa: E731
        return OwnPlant(lambda x, u, v: [5 * (u[0] - x[0])], both, table, (p, q), 1)

    rng = np.random.default_rng(4)
    u = np.repeat(rng.standard_normal(30), 10)[:, None]
    y = gain(2.0, 1.5).simulate(u, 0.1, np.zeros(1), SPEED) + 0.01 * rng.standard_normal((300, 1))
    fit = simulation_error(gain(kept, 1.0), Record(u, y, 0.1))
    assert fit.names == ("p", "q")
    assert fit.estimate == pytest.approx([2.0, 1.5], rel=2e-3)


def test_steps_from_rest_do_not_separate_a_dead_zone_from_coulomb_friction():
    steps = [record_of(MOTOR, np.repeat([0.0, v], [20, 200]), noise=0.02) for v in (2.0, 3.0, 5.0, -2.0, -4.0)]
    fit = simulation_error(MOTOR, steps, free=FREE)
    status = {row.name: row.status for row in fit.table}
    assert {status["voltage_dead_zone.half_width"], status["rotor_friction.coulomb"]} <= {
        Status.KEPT,
        Status.CONDITIONAL,
    }
    assert Status.KEPT in status.values()
    combinations = {c.quantity.name: c.quantity.value for c in fit.combinations}
    true = {q.name: q.value for q in MOTOR.quantities()}
    assert combinations["break-away voltage forward"] == pytest.approx(true["break-away voltage forward"], rel=0.02)


def test_a_record_that_determines_nothing_gives_one_finding_and_no_estimates():
    rng = np.random.default_rng(0)
    noise = np.convolve(rng.standard_normal(804), np.ones(5), "valid")  # a sensor's that filters, or of vibrations
    fit = simulation_error(MOTOR, Record(1e-3 * rng.standard_normal(800), noise, DT, output_units=("rad/s",)))
    assert fit.names == ()
    assert {row.status for row in fit.table} == {Status.KEPT}
    assert "nothing-identifiable" in codes(fit)
    curve = friction_curve(fit, 11)
    assert np.array_equal(curve.low, curve.y)


def test_identifiability_of_a_product():
    x = np.random.default_rng(0).standard_normal((50, 2))
    jacobian = np.column_stack([3.0 * x[:, 0], 2.0 * x[:, 0], x[:, 1]])  # a·b and c at a = 2, b = 3, c = 1
    found = identifiability([jacobian], np.array([2.0, 3.0, 1.0]), ("a", "b", "c"), 0.01)
    assert found.groups == (("a", "b"),)
    assert found.determines(np.array([1.0, 1.0, 0.0]))
    assert not found.determines(np.array([1.0, 0.0, 0.0]))
    assert found.without(["a"]).groups == ()


# --- datasheets -----------------------------------------------------------------------------------------------------

SHEET = """
[motor]
resistance = { value = "2 ohm", tolerance = "10 %" }
motor_constant = "50 mV*s"
rotor_inertia = "unknown"
load_inertia = { value = 1e-4, tolerance = 0.2 }
inductance = "1 mH"
shaft_stiffness = "20 N*m"
drive.supply = "24 V"

[motor.rotor_friction]
coulomb = ["4 mN*m", "5 mN*m"]
"""


def test_a_datasheet_is_read_with_its_units_tolerances_and_unknowns(tmp_path):
    path = tmp_path / "motor.toml"
    path.write_text(SHEET)
    sheet = read_datasheet(path)
    assert {name: (given.value, given.tolerance) for name, given in sheet.items()} == {
        "resistance": (2.0, 0.1),
        "motor_constant": (pytest.approx(0.05), None),
        "rotor_inertia": (None, None),
        "load_inertia": (1e-4, 0.2),
        "inductance": (pytest.approx(1e-3), None),
        "shaft_stiffness": (20.0, None),
        "drive.supply": (24.0, None),
        "rotor_friction.coulomb.forward": (pytest.approx(4e-3), None),
        "rotor_friction.coulomb.backward": (pytest.approx(5e-3), None),
    }
    assert set(sheet) - set(applicable(sheet, MOTOR)) == {"inductance", "shaft_stiffness"}
    assert applicable(sheet, LinearAxis()) == {}
    axis = datasheet("linear-axis", {"mass": "95 kg", "drive": {"gain": "35 N"}, "viscous_friction": "unknown"})
    assert axis == {"mass": Given(95.0), "drive.gain": Given(35.0), "viscous_friction": Given(None)}


def test_a_datasheet_gives_the_start_and_the_bounds_of_a_search():
    sheet = datasheet(
        "motor",
        {
            "resistance": {"value": MOTOR.value("resistance"), "tolerance": 0},
            "motor_constant": {"value": 1.04 * MOTOR.value("motor_constant"), "tolerance": "10 %"},
            "rotor_inertia": "unknown",
        },
    )
    fit = simulation_error(
        MOTOR.with_values({"rotor_inertia": 1e-3}), record_of(MOTOR, noise=0.05), datasheet=sheet, free=FREE
    )
    rows = {row.name: row for row in fit.table}
    assert rows["motor_constant"].datasheet == pytest.approx(0.052)
    assert rows["motor_constant"].value == pytest.approx(MOTOR.value("motor_constant"), rel=0.02)
    assert rows["rotor_inertia"].datasheet is None
    assert rows["rotor_inertia"].value == pytest.approx(MOTOR.value("rotor_inertia"), rel=0.05)


@pytest.mark.parametrize(
    ("resistance", "constant", "inertia", "coulomb", "volts"),
    [(20.0, 2e-3, 2e-9, 5e-5, 3.0), (0.5, 2.0, 0.5, 20.0, 200.0)],
    ids=["coreless", "traction"],
)
def test_motors_of_any_size_are_found_from_a_record_alone(resistance, constant, inertia, coulomb, volts):
    motor = replace(
        RIGID, resistance=resistance, motor_constant=constant, rotor_inertia=inertia, load_inertia=1e-3 * inertia,
        rotor_friction=Friction(coulomb), load_friction=Friction(), rotor_viscous=0.0, load_viscous=0.0,
        voltage_dead_zone=None,
    )  # fmt: skip
    clean = record_of(DrivenMotor(motor), VOLTAGE / 5 * volts)
    noise = 0.01 * np.std(clean.output)
    record = replace(clean, output=clean.output + noise * np.random.default_rng(0).standard_normal((2000, 1)))
    fit = choose(STARTS["rigid-motor"], record[:1400], refinements=(late_command,))
    run = fit.model.simulate(record[1400:])
    assert rms((run.output - record.output[1400:])[run.counted]) == pytest.approx(noise, rel=0.1)


@pytest.mark.parametrize("stage", ["trying 1 refinements", "adding refinements"])
def test_interrupting_the_choice_of_refinements_keeps_the_plain_motor(stage):
    seen = []
    control = Control(report=lambda activity: seen.append(activity.doing), cancelled=lambda: stage in " ".join(seen))
    record = record_of(MOTOR, noise=0.1)[:1200]
    fit = choose(MOTOR, record, refinements=(late_command,), control=control)
    assert fit.ending is Ending.INTERRUPTED
    assert fit.findings[0].code == "choice-interrupted"
    assert fit.model.plant.value("motor_constant") == pytest.approx(MOTOR.value("motor_constant"), rel=0.05)


def test_an_interrupted_choice_begins_no_search_for_its_intervals(monkeypatch):
    seen, steps = [], []

    def watched(*args, max_iterations, **more):
        found = gauss_newton(*args, max_iterations=max_iterations, **more)
        steps.append(max_iterations)
        return found

    monkeypatch.setattr("emsid.models.plants.search.continuation.gauss_newton", watched)
    control = Control(
        report=lambda activity: seen.append(activity.doing), cancelled=lambda: "adding refinements" in " ".join(seen)
    )
    record = record_of(MOTOR.with_values({"drive.delay": 0.5 * DT}), noise=0.1)[:1200]
    fit = choose(MOTOR, record, refinements=(late_command,), control=control)
    assert fit.ending is Ending.INTERRUPTED
    last = len(steps) - steps[::-1].index(0) - 1
    assert steps[last:] == [0]  # it is evaluated; structures that do as well are not looked for
    assert fit.model.plant.value("motor_constant") == pytest.approx(MOTOR.value("motor_constant"), rel=0.05)


def test_a_choice_of_refinements_without_time_is_not_interrupted(monkeypatch):
    seen = []
    clock = SimpleNamespace(monotonic=lambda: 2.0 * any("adding refinements" in each for each in seen))
    monkeypatch.setattr("emsid.estimation.nonlinear.control.time", clock)
    control = Control(deadline=1.0, report=lambda activity: seen.append(activity.doing))
    fit = choose(MOTOR, record_of(MOTOR, noise=0.1)[:600], refinements=(late_command,), control=control)
    assert fit.ending is Ending.OUT_OF_BUDGET
    assert fit.findings[0].code == "choice-interrupted"


def test_refinements_keep_to_a_datasheet():
    truth = LinearAxis(80.0, (150.0, 220.0), Friction(25.0), drive=Drive(delay=0.02))
    record = record_of(truth, 30 * VOLTAGE[:1200], noise=1e-4, unit="m", signals=(Signal.POSITION,))
    sheet = datasheet(
        "linear-axis",
        {
            "viscous_friction": {"value": 210.0, "tolerance": "25 %"},
            "mass": {"value": 80.0, "tolerance": 0.0},
            "drive.delay": "unknown",
        },
    )
    fit = choose(LinearAxis(), record, datasheet=sheet, refinements=(by_direction,))
    plant = fit.model.plant
    assert fit.limits["viscous_friction.forward"] == pytest.approx((157.5, 262.5))
    assert plant.value("viscous_friction.forward") == pytest.approx(157.5)  # as far as the datasheet lets it
    assert plant.value("viscous_friction.backward") > 200.0
    assert plant.value("drive.delay") > 0.01
    assert plant.value("mass") == 80.0


@pytest.mark.parametrize(
    ("fixed", "offset", "left"),
    [
        ({"friction.coulomb": 25.0}, -8.0, {"offset": -8.0}),
        ({"friction.coulomb.forward": 25.0}, -8.0, {"offset": -8.0, "friction.coulomb.backward": 25.0}),
        ({"offset": -8.0}, -8.0, {"friction.coulomb": 25.0}),
        ({"viscous_friction.backward": 220.0}, 0.0, {"friction.coulomb": 25.0}),
        ({}, -8.0, {"friction.coulomb.forward": 17.0, "friction.coulomb.backward": 33.0}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, dict) else None,
)
def test_fixed_values_stay_fixed_where_a_parameter_is_split_by_direction(fixed, offset, left):
    truth = LinearAxis(80.0, (150.0, 220.0), Friction(25.0), offset)
    record = record_of(truth, 30 * VOLTAGE[:1200], noise=1e-5, unit="m", signals=(Signal.POSITION,))
    fit = choose(LinearAxis(), record, fixed=fixed, refinements=(by_direction,))
    plant = fit.model.plant
    assert {row.name: row.value for row in fit.table if row.status is Status.FIXED} == fixed
    assert all(plant.value(name) == value for name, value in fixed.items())
    assert set(left) <= set(fit.names)
    assert not set(fixed) & set(fit.names)
    found = left | {"mass": 80.0, "viscous_friction.forward": 150.0, "viscous_friction.backward": 220.0}
    assert {name: plant.value(name) for name in found} == pytest.approx(found, rel=1e-3)


def test_a_parameter_that_is_known_in_one_direction_is_estimated_in_the_other():
    motor = MOTOR.with_values({"rotor_friction.coulomb.backward": 9e-3})
    sheet = {"voltage_dead_zone.b_l": Given(-0.4), "rotor_friction.coulomb.backward": Given(None)}
    known = {"resistance": MOTOR.value("resistance"), "rotor_viscous": MOTOR.value("rotor_viscous")}
    fit = simulation_error(
        motor, record_of(motor, noise=0.05), fixed=known | {"rotor_friction.coulomb.forward": 6e-3}, datasheet=sheet
    )
    assert "rotor_friction.coulomb.backward" in fit.names
    assert "rotor_friction.coulomb" not in fit.names
    assert fit.model.plant.value("rotor_friction.coulomb.forward") == 6e-3
    assert fit.model.plant.value("rotor_friction.coulomb.backward") == pytest.approx(9e-3, rel=0.02)


def test_of_names_that_share_a_value_one_replaces_the_other():
    level, forward, backward = (f"rotor_friction.coulomb{side}" for side in ("", ".forward", ".backward"))
    zone = "voltage_dead_zone"
    assert parts(MOTOR, level) == (forward, backward)
    assert set(parts(MOTOR, f"{zone}.half_width")) == {f"{zone}.b_l", f"{zone}.b_r"}
    assert parts(MOTOR, "resistance") == ()
    assert without_overlap(MOTOR, (level, "resistance"), ()) == (level, "resistance")
    assert without_overlap(MOTOR, (level, "resistance"), ("resistance", forward)) == (backward,)
    assert without_overlap(MOTOR, (level, forward), ()) == (backward, forward)
    assert without_overlap(MOTOR, (level, forward), (level,)) == ()
    with pytest.raises(ModelError, match="has no parameter 'mass'"):
        without_overlap(MOTOR, (level,), ("mass",))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"resistence": 2.0}, r"motor has no parameter 'resistence'; did you mean resistance\?"),
        ({"rotor_friction": {"columb": 2.0}}, r"motor has no parameter 'rotor_friction\.columb'"),
        ({"resistance": -2.0}, "motor resistance is -2 Ω; it must be positive and finite"),
        ({"resistance": "inf"}, "motor resistance is 'inf'; give a number in ohm"),
        ({"resistance": float("inf")}, "motor resistance is inf Ω; it must be positive and finite"),
        ({"rotor_viscous": -2.0}, "it cannot be negative and must be finite"),
        ({"drive": {"freewheel": 2.0}}, "it must be from 0 to 1 and finite"),
        ({"resistance": "2 V"}, "motor resistance is '2 V', which is not in ohm"),
        ({"resistance": True}, "motor resistance is True; give a number in ohm"),
        ({"resistance": {"tolerance": "10 %"}}, "motor resistance has tolerance; write { value"),
        ({"resistance": {"value": 2.0, "plusminus": 0.1}}, "motor resistance has value, plusminus; write { value"),
        ({"resistance": {"value": "unknown", "tolerance": 0.1}}, "motor resistance is unknown and has a tolerance"),
        ({"resistance": {"value": 2.0, "tolerance": "10"}}, "has a tolerance of '10'; write it as '10 %' or 0.1"),
        ({"resistance": {"value": 2.0, "tolerance": 10}}, "has a tolerance of 10; write it as '10 %' or 0.1"),
        ({"resistance": [1.0, 2.0]}, "only frictions take a pair"),
        ({"rotor_friction": {"coulomb": [1.0, 2.0, 3.0]}}, "only frictions take a pair"),
        (
            {"rotor_friction": {"coulomb": 1e-3, "coulomb.forward": 2e-3}},
            "rotor_friction.coulomb and rotor_friction.coulomb.forward are the same thing in part",
        ),
    ],
)
def test_a_datasheet_that_cannot_be_is_refused_in_one_line(table, message):
    with pytest.raises(ModelError, match=message) as refused:
        datasheet("motor", table)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("resistance = 2", FormatError, r"there is no table \[motor\] or \[linear-axis\]"),
        ("[motor]\n[driver]", FormatError, r"driver outside of \[motor\]"),
        ("[motor", FormatError, "this is not TOML"),
        ("[motor]\nresistance = '2 V'", ModelError, "sheet.toml: motor resistance is '2 V'"),
    ],
)
def test_a_file_that_is_no_datasheet_is_refused_with_its_path(tmp_path, text, error, message):
    path = tmp_path / "sheet.toml"
    path.write_text(text)
    with pytest.raises(error, match=message):
        read_datasheet(path)


def test_a_datasheet_of_no_plant_is_refused():
    with pytest.raises(ModelError, match="no datasheet of a spring; there are motor, linear-axis"):
        datasheet("spring", {})


# --- the model ------------------------------------------------------------------------------------------------------


def test_it_is_a_model_that_comes_back_from_data():
    plant = replace(
        MOTOR, drive=Drive(2.0, 0.1, 24.0, 0.003, 9.0, 1.5, 0.5, ((999.0, Bridge.COAST),)), sensor=Sensor(lag=0.01)
    )
    for one in (plant, DrivenMotor(Motor()), LinearAxis(3.0, (1.0, 2.0), dead_zone=DeadZoneLaw(-1, 2))):
        model = GreyBox(one, SPEED)
        assert isinstance(model, Model)
        assert GreyBox.from_data(model.to_data()).plant == one
        assert model.name in model.equation()
    with pytest.raises(ModelError, match="not a grey-box model"):
        GreyBox.from_data({"plant": {}})


def test_a_free_run_starts_from_the_first_samples_and_a_prediction_is_closer():
    record = record_of(MOTOR, noise=0.2)
    model = GreyBox(MOTOR.with_values({"motor_constant": 0.052}), SPEED)
    late = record[300:]
    free, ahead = model.simulate(late, 5), model.predict(late, 1, 5)
    assert not free.counted[:5].any()
    assert free.counted[5:].all()
    errors = [np.mean((late.output - run.output)[run.counted] ** 2) for run in (free, ahead)]
    assert errors[1] < 0.5 * errors[0]


def test_curves_standstills_and_profile_of_a_fit():
    fit = simulation_error(MOTOR, simulated_record(np.random.default_rng(3)), free=FREE)
    friction = friction_curve(fit, 51)
    assert np.all((friction.low <= friction.y) & (friction.y <= friction.high))
    assert friction.y[25] == 0
    zone = dead_zone_curve(fit, 51)
    assert zone is not None
    assert zone.support.sum() > 0
    sticking = np.concatenate([run[:, 0] == 0 for run in fit.simulated()])
    assert len(stops(fit)) == np.count_nonzero(np.diff(np.concatenate([[0], sticking, [0]])) == 1)
    profile = likelihood_profile(fit, "motor_constant")
    assert profile.interval == pytest.approx(tuple(fit.interval()[0]), rel=2e-3)
    with pytest.raises(ModelError, match="was not estimated; profiles can be had of motor_constant"):
        likelihood_profile(fit, "inductance")


# --- likelihood profiles --------------------------------------------------------------------------------------------


def lag_of(gain, start):
    """dx/dt = 5(u − x), y = gain(p)·x: only the gain is a parameter."""
    table = (Parameter("p", "p", "1", "what the gain depends on"),)
    return OwnPlant(lambda x, u, p: [5 * (u[0] - x[0])], lambda x, u, p: [gain(p[0]) * x[0]], table, (start,), 1)


def noisy_lag(noise, samples=120):
    rng = np.random.default_rng(4)
    u = np.repeat(rng.standard_normal(samples // 10), 10)[:, None]
    y = lag_of(lambda p: p, 1.0).simulate(u, 0.1, np.zeros(1), SPEED)
    return Record(u, y + noise * rng.standard_normal(y.shape), 0.1)


def test_the_profile_of_what_the_output_is_linear_in_is_its_quadratic_approximation():
    profile = likelihood_profile(simulation_error(lag_of(lambda p: p, 0.8), noisy_lag(1.0)), "p")
    steps = (profile.values - profile.estimate) / profile.standard_error
    end = np.sqrt(profile.limit)
    assert steps == pytest.approx([-3, -2.25, -end, -1.5, -0.75, 0, 0.75, 1.5, end, 2.25, 3], abs=0.01)
    colour = profile.deviance[-1] / 9
    assert profile.deviance == pytest.approx(colour * steps**2, rel=1e-4, abs=1e-9)
    assert colour == pytest.approx(1.0, rel=0.01)
    assert profile.between(np.array(profile.interval)) == pytest.approx([profile.limit] * 2)
    assert profile.limit == pytest.approx(3.841459)


def test_a_profile_interval_does_not_depend_on_how_a_parameter_is_written():
    record = noisy_lag(3.0)
    plain = likelihood_profile(simulation_error(lag_of(lambda p: p, 0.8), record), "p")
    bent_fit = simulation_error(lag_of(lambda p: p**3, 0.8), record)
    bent = likelihood_profile(bent_fit, "p")
    low, high = bent.interval
    assert (low**3, high**3) == pytest.approx(plain.interval, rel=1e-3)
    (approximate,) = bent_fit.interval()
    assert np.max(np.abs(approximate - bent.interval)) > 0.1 * np.ptp(approximate)  # which does depend on it


def test_a_profile_ends_at_a_bound_and_is_open_where_the_record_sets_none():
    record = noisy_lag(0.4)
    saturating = simulation_error(lag_of(lambda p: 1.05 * np.tanh(p), 1.5), record)
    profile = likelihood_profile(saturating, "p")
    assert profile.interval[1] == np.inf
    assert 0 < profile.interval[0] < profile.estimate
    assert np.isfinite(profile.interval[0])
    assert profile.interval[1] == np.inf
    bounds = {"p": (0.0, profile.estimate + 1.0)}
    bounded = likelihood_profile(simulation_error(lag_of(lambda p: 1.05 * np.tanh(p), 1.5), record, bounds=bounds), "p")
    assert bounded.interval[1] == bounds["p"][1]
    assert bounded.interval[0] == pytest.approx(profile.interval[0], rel=0.01)


def test_a_profile_fits_every_other_parameter_and_the_initial_states():
    fit = simulation_error(MOTOR, [simulated_record(np.random.default_rng(k), samples=500) for k in (1, 2)], free=FREE)
    profile = likelihood_profile(fit, "rotor_inertia")
    value = float(profile.values[-1])
    again = simulation_error(
        fit.model.plant.with_values({"rotor_inertia": value}),
        fit.segments,
        free=[name for name in FREE if name != "rotor_inertia"],
        find_start=False,
    )
    deviance = 2 * (again.cost - fit.cost) / fit.noise_variance / fit.colour[FREE.index("rotor_inertia")]
    assert profile.deviance[-1] == pytest.approx(deviance, rel=1e-3)


def test_an_interrupted_profile_raises_stopped():
    fit = simulation_error(MOTOR, simulated_record(np.random.default_rng(3), samples=300), free=FREE[:2])
    calls = iter(range(1000))

    with pytest.raises(Stopped):
        likelihood_profile(fit, "motor_constant", control=Control(cancelled=lambda: next(calls) == 12))


def test_standstills_are_those_of_the_motor_and_not_of_the_sensor_and_say_in_which_segment():
    sensor = Sensor(ratio=-3.0, lag=0.03, offset=0.2, average=True)
    plant = replace(MOTOR, sensor=sensor)
    commands = (VOLTAGE[:400], np.repeat([0.0, 4.0, 0.0], 100))
    pieces = [replace(record_of(plant, u), name=name) for u, name in zip(commands, ("sines", "pulse"), strict=True)]
    pieces[1] = replace(pieces[1], times=(7.0,))
    fit = simulation_error(plant, pieces, free=("motor_constant",), find_start=False)
    found = stops(fit)
    assert [fit.segments[stop.segment].name for stop in found][-2:] == ["pulse", "pulse"]
    for k, u in enumerate(commands):
        exact = simulate(MOTOR.motor, u, DT).load_held
        shown = np.zeros(len(u), dtype=bool)
        for stop in found:
            if stop.segment == k:
                first, last = np.rint((np.array([stop.start, stop.end]) - fit.segments[k].time[0]) / DT).astype(int)
                shown[first : last + 1] = True
        assert np.array_equal(shown, exact)
        assert exact.any()
    speeds = np.abs(simulate(MOTOR.motor, commands[0], DT).load_speed)
    assert friction_curve(fit, 11).x[-1] == pytest.approx(np.max(speeds), rel=1e-4)  # of the motor, not of the log


def test_refinements_are_kept_only_where_they_help():
    plain = choose(MOTOR, record_of(MOTOR, noise=0.1)[:1200], refinements=(coasting_bridge, stribeck))
    assert not any("freewheel" in name for name in plain.names)
    coasting = replace(MOTOR, drive=Drive(supply=6.0, freewheel=1.0))
    fit = choose(MOTOR, record_of(coasting, noise=0.1)[:1200], refinements=(coasting_bridge, stribeck))
    assert fit.model.plant.value("drive.freewheel") == pytest.approx(1.0, abs=0.1)


def test_a_plant_of_the_users_own():
    @njit
    def derivative(x, u, p):
        return np.array([x[1], -p[0] * np.sin(x[0]) - p[1] * x[1] + u[0]])

    @njit
    def output(x, u, p):
        return x[:1]

    table = (Parameter("g", "g/l", "1/s^2", "gravity over length"), Parameter("d", "d", "1/s", "damping"))
    truth = OwnPlant(derivative, output, table, (9.0, 0.5), 2, name="pendulum")
    record = record_of(truth, VOLTAGE, signals=SPEED, unit="rad")
    slow = replace(truth, derivative=derivative.py_func, output=output.py_func)
    assert np.allclose(slow.simulate(VOLTAGE[:50, None], DT, np.zeros(2), SPEED), record.output[:50], atol=1e-12)
    fit = simulation_error(truth.with_values({"g": 7.0, "d": 1.0}), record)
    assert fit.estimate == pytest.approx([9.0, 0.5], rel=1e-5)
    with pytest.raises(ModelError, match="is not registered and cannot be saved"):
        fit.model.to_data()


@pytest.fixture(scope="module")
def coupled_drives():
    """The example of a user's own plant; its file runs from any folder."""
    return runpy.run_path(str(Path(__file__).parents[1] / "examples" / "coupled_drives.py"))


def test_the_example_finds_the_drives_that_it_simulated(coupled_drives, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fit, outside = coupled_drives["main"]([])
    assert fit.names == coupled_drives["PLANT"].default_free
    assert outside == pytest.approx([0.01, 0.01], rel=0.3)  # its noise
    assert (tmp_path / "coupled-drives.svg").exists()


@pytest.mark.long
@pytest.mark.recordings
def test_the_example_has_its_published_error_on_the_recordings(coupled_drives, recordings, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, outside = coupled_drives["main"]([str(recordings / "coupled_drives" / "uniform_first400.csv")])
    assert outside == pytest.approx([0.112, 0.103], rel=0.02)


# --- bad input ------------------------------------------------------------------------------------------------------

GOOD = record_of(MOTOR)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"free": ["resistence"]}, r"rigid-motor has no parameter 'resistence'; did you mean resistance\?"),
        ({"free": ["shaft_stiffness"]}, "rigid-motor has no parameter 'shaft_stiffness'"),
        ({"free": ["resistance"], "fixed": {"resistance": 1.0}}, "resistance is both free and fixed at 1"),
        ({"free": ["resistance"], "bounds": {"resistance": (3.0, 4.0)}}, "of resistance exclude its start 2"),
        ({"free": ["resistance"], "bounds": {"resistance": (4.0, 3.0)}}, "they must ascend"),
        ({"free": ["resistance"], "bounds": {"inductance": (0.0, 1.0)}}, "bounds for inductance, which is not free"),
        (
            {
                "free": ["resistance"],
                "datasheet": {"resistance": Given(2.0, 0.1)},
                "bounds": {"resistance": (5.0, 6.0)},
            },
            "they contradict each other",
        ),
        (
            {"fixed": {"resistance": 9.0}, "datasheet": {"resistance": Given(2.0, 0.1)}},
            r"resistance is fixed at 9 and the datasheet has it within \[1.8, 2.2\]",
        ),
        ({"free": ["rotor_friction.coulomb", "rotor_friction.coulomb.forward"]}, "are the same thing in part"),
        (
            {"free": ["rotor_friction.coulomb"], "fixed": {"rotor_friction.coulomb.forward": 1e-3}},
            "rotor_friction.coulomb and rotor_friction.coulomb.forward are the same thing in part",
        ),
        ({"free": []}, "no parameter of rigid-motor is free"),
        ({"fixed": {"resistance": -1.0}}, "motor resistance is -1 Ω; it must be positive"),
    ],
)
def test_impossible_arguments_are_refused(arguments, message):
    with pytest.raises(ModelError, match=message):
        simulation_error(MOTOR, GOOD, **arguments)


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (replace(GOOD, output=np.zeros(2000)), "output y1 stays at 0 throughout; nothing moves"),
        (replace(GOOD, input=np.full(2000, 3.0)), "input u1 stays at 3 throughout; nothing drives it"),
        (replace(GOOD, output_units=("m/s",)), "is in m/s, rigid-motor gives a speed in rad/s"),
        (replace(GOOD, input=np.ones((2000, 2)), input_names=(), input_units=()), "2 inputs for rigid-motor"),
    ],
)
def test_records_of_other_channels_are_refused(record, message):
    with pytest.raises(DataError, match=message):
        simulation_error(MOTOR, record, free=FREE)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Given(float("nan")), "datasheet value nan; give a finite number"),
        (lambda: Given(None, 0.1), "datasheet tolerance 0.1 of None"),
        (lambda: Given(1.0, -0.1), "datasheet tolerance -0.1 of 1.0"),
        (lambda: Recent(0.0), r"0\.0 s, order 1; give a positive time"),
        (lambda: Drive(gain=0.0), "drive with gain 0.0 .*the gain not 0"),
        (lambda: Drive(delay=-1.0), "drive with a delay of -1.0 s"),
        (lambda: Drive(supply=0.0), "drive with a supply of 0.0 V"),
        (lambda: Drive(freewheel=0.5), "needs its supply voltage: give drive.supply"),
        (lambda: Drive(freewheel=2.0, supply=1.0), "drive with freewheel 2.0"),
        (lambda: Drive(knee=0.0), "drive with a knee at 0.0 V"),
        (lambda: Drive(beyond=-1.0), "-1.0 times beyond"),
        (lambda: Sensor(ratio=0.0), "sensor with ratio 0.0 .*the ratio not 0"),
        (lambda: Sensor(lag=-1.0), "sensor with a lag of -1.0 s"),
        (lambda: LinearAxis(mass=0.0), "a mass of 0.0 kg"),
        (lambda: LinearAxis(viscous_friction=-1.0), r"viscous friction \(-1.0, -1.0\)"),
        (lambda: LinearAxis(offset=np.inf), "an offset of inf N"),
    ],
)
def test_values_that_are_not_physical_are_refused_by_name(build, message):
    with pytest.raises(ModelError, match=message):
        build()


@pytest.mark.parametrize(
    ("arguments", "side", "because"),
    [
        ({"bounds": {"motor_constant": (0.0501, 0.06)}}, "lower", "bounds"),
        ({"bounds": {"motor_constant": (0.04, 0.0499)}}, "upper", "bounds"),
        ({"datasheet": {"motor_constant": Given(0.055, 0.05)}}, "lower", "datasheet"),
        ({"fixed": {"voltage_dead_zone.half_width": 1.2}}, "lower", "physical"),
    ],
    ids=["lower", "upper", "datasheet", "physical"],
)
def test_a_parameter_at_a_bound_is_found_with_the_origin_of_the_bound(arguments, side, because):
    free = [name for name in FREE if name not in arguments.get("fixed", {})]
    start = MOTOR.with_values({"motor_constant": arguments.get("bounds", {}).get("motor_constant", (0.055,))[0]})
    fit = simulation_error(start, GOOD, free=free, **arguments)
    (finding,) = [each for each in fit.findings if each.code == "parameter-at-bound"]
    (row,) = [row for row in fit.table if row.status is Status.AT_BOUND]
    assert finding == Finding("parameter-at-bound", row.name, {"side": side, "bound": row.value, "because": because})


@pytest.mark.parametrize(
    ("wanted", "ending", "code"), [(3, Ending.CONVERGED, "minimum-not-smooth"), (7, Ending.STALLED, "search-stalled")]
)
def test_a_fit_that_stalls_says_whether_others_end_there_too(monkeypatch, wanted, ending, code):
    def in_steps(error, dt):  # its derivative leads astray
        return np.round(error, 3)

    monkeypatch.setattr("emsid.estimation.nonlinear.restarts.AGREEING", wanted)  # of 6
    bounds = {"motor_constant": (0.0501, 0.06)}
    fit = simulation_error(
        MOTOR.with_values({"motor_constant": 0.0501}),
        GOOD,
        free=FREE,
        bounds=bounds,
        weighting=in_steps,
        find_start=False,
    )
    assert fit.ending is ending
    assert {code, "parameter-at-bound"} <= set(codes(fit))
    (said,) = [finding for finding in fit.findings if finding.code == code]
    assert said.data["starts"] == 7
    assert 4 <= said.data["agreeing"] <= 7


def test_a_parameter_whose_bounds_are_one_value_is_not_reported_at_a_bound():
    fit = simulation_error(MOTOR, GOOD, free=FREE, datasheet={"motor_constant": Given(0.051, 0.0)})
    assert "parameter-at-bound" not in codes(fit)


# --- real recordings ------------------------------------------------------------------------------------------------


def errors(fit):
    return np.concatenate([run - record.output for run, record in zip(fit.simulated(), fit.segments, strict=True)])


@pytest.fixture(scope="module")
def emps(recordings):
    """The first 60 % of the record, as force and position."""
    record = read(recordings / "emps" / "DATA_EMPS.mat", input="vir", output="qm", time="t", scale={"vir": 35.15065})
    return record.split(0.6)[0]


@pytest.mark.recordings
def test_emps_has_the_published_parameters_where_errors_are_seen_as_accelerations(emps):
    fit = simulation_error(LinearAxis(), emps, weighting=Recent(0.02, 2))
    assert fit.estimate == pytest.approx([95.1089, 203.5034, 20.3935, -3.1648], rel=0.05)


@pytest.mark.long
@pytest.mark.recordings
def test_emps_has_more_friction_in_one_direction(emps):
    fit = choose(LinearAxis(), emps)
    plant = fit.model.plant
    assert rms(errors(fit)) < 0.7e-3
    assert plant.value("viscous_friction.backward") == pytest.approx(232, rel=0.05)
    assert plant.value("viscous_friction.forward") == pytest.approx(151, rel=0.05)  # its start taken from the samples
    assert plant.value("offset") == 0


@pytest.mark.long
@pytest.mark.recordings
def test_a_motor_on_a_bridge_that_coasts(recordings):
    record = read(
        recordings / "dc_motor_bidirectional" / "testBench_testAll_10ms.dat",
        input="PWM", output="mVel", dt=0.010048, mask="abs(PWM) > 255",
    )  # fmt: skip
    train, test = record.split(0.5)
    fit = choose(DrivenMotor(replace(RIGID, voltage_dead_zone=DeadZoneLaw(-1.0, 1.0))), train)
    run = fit.model.simulate(test)
    assert fit_percent(test.output[run.counted], run.output[run.counted]) > 97.0


@pytest.mark.long
@pytest.mark.recordings
def test_one_geared_motor_from_steps_both_ways(recordings):
    steps = [
        read(path, input="Commanded_PWM", output="Motor_Speed(RPM)", time="Timestamp(ms)",
             units={"Motor_Speed(RPM)": "rpm"})
        for path in sorted((recordings / "dc_motor_jga25_steps").glob("*.csv"))
    ]  # fmt: skip
    steps = [replace(one, input=one.input[2::5], output=one.output[2::5], dt=5e-3) for one in steps]  # a 200 Hz loop
    motor = replace(
        RIGID, resistance=2.0, motor_constant=0.07, rotor_inertia=5e-5, rotor_viscous=1e-5, load_viscous=0.0,
        load_inertia=1e-6, rotor_friction=Friction(0.05, 0.04, 0.3), load_friction=Friction(), voltage_dead_zone=None,
    )  # fmt: skip
    drive = Drive(gain=12 / 4800, supply=13.0, knee=10.0, beyond=1.5, delay=6e-3)
    fit = simulation_error(
        DrivenMotor(motor, drive, Sensor(offset=0.127)),
        steps,
        free=(
            "motor_constant", "rotor_inertia", "rotor_friction.coulomb.forward", "rotor_friction.coulomb.backward",
            "rotor_friction.stribeck", "rotor_friction.stribeck_rate",
            "drive.supply", "drive.knee", "drive.beyond", "drive.delay",
        ),
        bounds={"drive.beyond": (1.0, 8.0)},
        find_start=False,
    )  # fmt: skip
    assert len(fit.segments) == 26
    error, output = errors(fit), np.concatenate([one.output for one in steps])
    assert fit_percent(output, output + error) > 97.0
    assert rms(error) < 20 * np.pi / 30  # half of what the encoder resolves in 5 ms
    combinations = {c.quantity.name: c.quantity.value for c in fit.combinations}
    stays, starts = 901 * drive.gain, 1299 * drive.gain  # commands that it stood still at and moved at
    assert stays <= combinations["break-away voltage forward"] <= starts
    assert stays <= combinations["break-away voltage backward"] <= starts
