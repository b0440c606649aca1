"""How plants move: as the reference simulators do, through drive, shaft and sensor."""

from dataclasses import replace

import numpy as np
import pytest

from coverage_grey_box import (
    MOTOR,
)
from emsid.errors import ModelError
from emsid.models.plants.cogging import Cogging
from emsid.models.plants.drive import Bridge, Drive
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.lost_motion import Body
from emsid.models.plants.motor import DrivenMotor, MotorPlant
from emsid.models.plants.one_mass import Sliding, move
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.choice import STARTS
from emsid.models.plants.sensor import Sensor
from emsid.plant import DeadZoneLaw, Friction, Motor, State, simulate
from simulated_plants import DT, RIGID, SPEED, VOLTAGE, record_of

# --- one mass --------------------------------------------------------------------------------------------------------


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
    speeds, positions, none, motion = np.empty(65), np.empty(65), np.zeros(64), np.array([0.4, 1.0])
    move(Body(0.7, 0.0), friction, force, damping, none, *start, 20, 0, motion, speeds, positions, none)
    speeds, positions = speeds[:-1], positions[:-1]
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


# --- drive and sensor ------------------------------------------------------------------------------------------------


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
    assert drive.applied(command[:, None])[0] == pytest.approx([0.0, 3.0, 4.0, 5.0, 6.0, -5.0, -6.0])


def test_codes_brake_and_coast():
    motor = replace(RIGID, rotor_friction=Friction(), load_friction=Friction())
    drive = Drive(codes=((1000.0, Bridge.BRAKE), (999.0, Bridge.COAST)))
    k, r, b = motor.motor_constant, motor.resistance, motor.rotor_viscous + motor.load_viscous
    inertia = motor.rotor_inertia + motor.load_inertia
    for code, damping in ((1000.0, k**2 / r + b), (999.0, b)):
        command = np.full(20, code)
        run = DrivenMotor(motor, drive).simulate(command[:, None], DT, np.array([50.0, 0.0]), SPEED)[:, 0]
        assert run == pytest.approx(50 * np.exp(-damping / inertia * DT * np.arange(20)), rel=1e-9)


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


# --- inductance ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("henry", "viscous"), [(1e-5, 0.0), (2e-3, 4e-6), (0.05, 0.0)], ids=["fast", "usual", "slow"])
@pytest.mark.parametrize(
    ("friction", "steps", "within"),
    [(Friction((4e-3, 6e-3)), 2, 1e-9), (Friction(4e-3, 3e-3, 0.2), 2, 3e-3), (Friction(4e-3, 3e-3, 0.2), 16, 1e-4)],
    ids=["constant", "stribeck", "stribeck in small steps"],
)
def test_one_mass_with_an_inductance_moves_as_by_series(henry, viscous, friction, steps, within):
    """Exact through stops, releases and reversals with constant friction; of second order in the steps with others."""
    motor = Motor(2.0, henry, 0.05, 2e-5, viscous, load_inertia=1e-6, load_viscous=0.0, rotor_friction=friction)
    motor = replace(motor, load_friction=Friction(), voltage_dead_zone=DeadZoneLaw(-0.2, 0.3)).rigid()
    u = np.repeat(np.random.default_rng(1).uniform(-3, 3, 60), 15)
    u[0] = 0.0
    plant = MotorPlant(motor, load_torque=5e-4, steps=steps)
    signals = (Signal.SPEED, Signal.POSITION, Signal.CURRENT)
    run = plant.simulate(u[:, None], 2e-3, np.zeros(2), signals)
    exact = simulate(motor, u, 2e-3, disturbance=5e-4)
    expected = np.column_stack([exact.load_speed, exact.load_angle, exact.current])
    assert len(exact.events.time) > 30
    assert (np.abs(run - expected).max(axis=0) < within * expected.std(axis=0)).all()


def test_an_inductance_of_zero_is_the_limit_of_a_small_one_with_every_force():
    forces = {"quadratic_viscous": 1e-7, "cogging": Cogging(0.5, 1e-3, 5e-4), "viscous_backward": 2e-6}
    motor = replace(MOTOR.motor, inductance=0.0)
    u = np.repeat([0.0, 6.0, -3.0, 1.0], 20)[:, None]
    shown = [
        MotorPlant(replace(motor, inductance=henry), drive=Drive(delay=0.4 * DT), **forces).simulate(
            u, DT, np.zeros(3), SPEED
        )
        for henry in (0.0, 1e-7, 2e-7)
    ]
    first, second = (np.max(np.abs(each - shown[0])) for each in shown[1:])
    assert 0 < first < 1e-3 * np.ptp(shown[0])
    assert second == pytest.approx(2 * first, rel=0.05)


# --- shaft and steps -------------------------------------------------------------------------------------------------


def test_a_very_stiff_shaft_is_simulated_as_rigid_and_a_less_stiff_one_nearly_so():
    u = np.repeat(np.random.default_rng(0).uniform(-10, 10, 20), 10)[:, None]
    motor = STARTS["motor"].with_values({"rotor_inertia": 1e-4, "load_inertia": 1e-4, "inductance": 1e-3})
    runs = [
        motor.with_values({"shaft_stiffness": stiffness}).simulate(u, 1e-2, np.zeros(3), (Signal.SPEED,))
        for stiffness in (0.9 * 1800.0, 1.1 * 1800.0, 1e12)  # 60 rad per sample in between
    ]
    assert np.array_equal(runs[1], runs[2])
    assert 0 < np.max(np.abs(runs[0] - runs[1])) < 1e-2 * np.ptp(runs[1])


def test_a_strongly_damped_shaft_is_simulated_as_rigid_and_takes_no_longer():
    u = np.repeat(np.random.default_rng(0).uniform(-10, 10, 20), 10)[:, None]
    motor = STARTS["motor"].with_values({"rotor_inertia": 1e-4, "load_inertia": 1e-4, "inductance": 1e-3})
    runs = [
        motor.with_values({"shaft_stiffness": 1e-3, "shaft_damping": damping}).simulate(
            u, 1e-2, np.zeros(3), (Signal.SPEED,)
        )
        for damping in (0.95 * 0.3, 1.1 * 0.3, 1e4)  # 60 rad per sample in between; by steps the last takes minutes
    ]
    assert np.array_equal(runs[1], runs[2])
    assert 0 < np.max(np.abs(runs[0] - runs[1])) < 1e-2 * np.ptp(runs[1])


def test_a_motor_that_takes_too_many_steps_is_refused_at_once():
    u = np.ones((3000, 1))
    motor = STARTS["motor"].with_values({"inductance": 1e-7})
    with pytest.raises(ModelError, match="out of all proportion"):
        motor.simulate(u, 1e-2, np.zeros(3), (Signal.SPEED,))


@pytest.mark.parametrize("plant", [DrivenMotor(Motor().rigid()), LinearAxis()])
@pytest.mark.parametrize("steps", [0, -1, 1.5, []])
def test_steps_per_sample_are_a_positive_whole_number(plant, steps):
    with pytest.raises(ModelError, match=r"steps per sample; give a positive whole number"):
        replace(plant, steps=steps)
