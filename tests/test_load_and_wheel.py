"""A load among the inputs of a plant, and the speed of a wheel: against an independent integration, and recovered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import emsid
from emsid.errors import DataError
from emsid.estimation.nonlinear.control import FREE
from emsid.identification.candidates import usual_for
from emsid.models.plants.drive import Bridge, Drive, Hold
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.sensor import Sensor
from emsid.plant import Friction, Motor
from emsid.record import Record
from emsid.record.holding_back import excerpt
from independent.cases import axis

R, K, J, B, L, DT, N = 2.0, 0.05, 1e-4, 1e-5, 2e-3, 0.01, 200
MASS = J + 1e-12  # with the load inertia
BARE = replace(
    Motor(),
    resistance=R, motor_constant=K, inductance=0.0, rotor_inertia=J, rotor_viscous=B, load_inertia=1e-12,
    load_viscous=0.0, rotor_friction=Friction(), load_friction=Friction(), voltage_dead_zone=None,
)  # fmt: skip
ONE_MASS = BARE.rigid()
SPEED = (Signal.SPEED,)


def inputs(samples: int = N, seed: int = 0) -> np.ndarray:
    """Steps of voltage and of load torque at different samples."""
    rng = np.random.default_rng(seed)
    volts, load = rng.uniform(-12, 12, samples // 10), rng.uniform(-0.05, 0.05, samples // 8)
    return np.column_stack([np.repeat(volts, 10), np.repeat(load, 8)[:samples]])


def integrated(right, begun: list[float], u: np.ndarray, delay: float = 0.0) -> np.ndarray:
    """(N, n) the states at the samples of dx/dt = f(x, volts, load); volts are late, the load is not."""
    x = np.array(begun)
    seen = [x]
    for k in range(len(u) - 1):
        inner = [delay % DT] if delay % DT else []
        for begin, end in zip([0.0, *inner], [*inner, DT], strict=True):
            which = max(int(np.floor((k * DT + 0.5 * (begin + end) - delay) / DT)), 0)
            arguments = (u[which, 0], u[k, 1])
            x = solve_ivp(
                lambda t, x, *a: right(x, *a), (begin, end), x, "DOP853", args=arguments, rtol=1e-12, atol=1e-12
            ).y[:, -1]
        seen.append(x)
    return np.array(seen)


@pytest.mark.parametrize("delay", [0.0, 0.013])
def test_one_mass_under_a_load_moves_as_an_independent_integration(delay):
    """The load acts at once, also where the command is late by a part of a sample."""
    u = inputs()
    motor = DrivenMotor(ONE_MASS, Drive(loaded=True, delay=delay))
    speed = integrated(lambda x, v, load: [(K * (v - K * x[0]) / R - B * x[0] - load) / MASS], [0.0], u, delay)
    np.testing.assert_allclose(motor.simulate(u, DT, np.zeros(4), SPEED), speed, atol=1e-8)


def test_a_motor_with_a_shaft_has_the_load_behind_it():
    u, (stiffness, damping, inertia) = inputs(), (0.5, 1e-3, 2e-4)
    shafted = replace(
        BARE, inductance=L, load_inertia=inertia, shaft_stiffness=stiffness, shaft_damping=damping, load_viscous=B
    )

    def right(x, v, load):
        i, rotor, turning, twist = x
        shaft = stiffness * twist + damping * (rotor - turning)
        return [
            (v - R * i - K * rotor) / L, (K * i - shaft - B * rotor) / J, (shaft - B * turning - load) / inertia,
            rotor - turning,
        ]  # fmt: skip

    motor = DrivenMotor(shafted, Drive(loaded=True))
    seen = motor.simulate(u, DT, np.zeros(4), (Signal.SPEED, Signal.ROTOR_SPEED, Signal.CURRENT))
    np.testing.assert_allclose(
        seen, integrated(right, [u[0, 0] / R, 0.0, 0.0, 0.0], u)[:, [2, 1, 0]], rtol=1e-6, atol=1e-6
    )


def test_a_straight_load_is_exact_in_its_mean_over_the_pieces_of_a_sample():
    """A slow sine, whose response in steady state is known."""
    t, rate = np.arange(600) * DT, 3.0
    u = np.column_stack([np.zeros(600), 0.02 * np.sin(rate * t)])
    motor = DrivenMotor(ONE_MASS, Drive(loaded=True, hold=Hold.FIRST))
    speed = motor.simulate(u, DT, np.zeros(4), SPEED)[:, 0]
    known = np.imag(-0.02 * np.exp(1j * rate * t) / (1j * rate * J + K**2 / R + B))
    np.testing.assert_allclose(speed[200:], known[200:], atol=2e-4 * np.abs(known).max())


@pytest.mark.parametrize("hold", [Hold.ZERO, Hold.FIRST])
@pytest.mark.parametrize("delay", [0.0, 0.013])
@pytest.mark.parametrize("axis", [False, True])
def test_blocks_and_single_samples_give_the_same_as_one_run(hold, delay, axis):
    u, drive = inputs(), Drive(loaded=True, hold=hold, delay=delay)
    plant = LinearAxis(drive=drive) if axis else DrivenMotor(ONE_MASS, drive, Sensor(lag=0.02, average=0.5))
    whole = plant.simulate(u, DT, np.zeros(4), SPEED)
    state = plant.start(np.zeros(4), u[0], DT, SPEED)
    parts = []
    for block in np.split(u, [1, 2, 90]):
        y, state = plant.run(state, block, SPEED)
        parts.append(y)
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    np.testing.assert_array_equal(plant.simulate(u[:50], DT, np.zeros(4), SPEED), whole[:50])


def test_codes_of_the_bridge_stand_before_the_load():
    u = inputs()
    coded = np.column_stack([u[:, 0], np.where(np.arange(N) < 100, 0.0, 7.0), u[:, 1]])
    motor = DrivenMotor(ONE_MASS, Drive(loaded=True, codes=((7.0, Bridge.BRAKE),)))
    braked = np.column_stack([np.where(np.arange(N) < 100, u[:, 0], 0.0), u[:, 1]])
    plain = DrivenMotor(ONE_MASS, Drive(loaded=True))
    np.testing.assert_array_equal(
        motor.simulate(coded, DT, np.zeros(4), SPEED), plain.simulate(braked, DT, np.zeros(4), SPEED)
    )


def record(plant, u, units, output="rad/s", noise=0.0, signals=SPEED):
    y = plant.simulate(u, DT, np.zeros(4), signals)
    y = y + noise * np.std(y) * np.random.default_rng(1).standard_normal(y.shape)
    return Record(u, y, DT, input_units=units, output_units=(output,))


def test_the_parameters_of_a_loaded_motor_are_recovered(tmp_path):
    """The load gives the torque its scale, so inertia and friction need no value that is known."""
    motor = DrivenMotor(replace(ONE_MASS, rotor_friction=Friction(4e-3)), Drive(loaded=True))
    measured = record(motor, inputs(1600), ("V", "N*m"), noise=0.002)
    names = ("motor_constant", "resistance", "rotor_inertia", "rotor_friction.coulomb")
    fit = emsid.fit(emsid.plants.rigid_motor(), measured, free=names, fixed={"rotor_viscous": B})
    for name, value in {
        "motor_constant": K,
        "resistance": R,
        "rotor_inertia": J,
        "rotor_friction.coulomb": 4e-3,
    }.items():
        assert fit[name].value == pytest.approx(value, rel=0.02), name
        assert fit[name].interval[0] <= value <= fit[name].interval[1], name
    assert fit.model.plant.drive.loaded
    emsid.save(fit, tmp_path / "motor.json")
    assert emsid.load(tmp_path / "motor.json").model.plant.drive == fit.model.plant.drive


def test_identify_recognises_the_load_by_its_unit():
    measured = record(DrivenMotor(ONE_MASS, Drive(loaded=True)), inputs(400), ("V", "N*m"))
    assert "rigid-motor" in usual_for(measured)
    assert "rigid-motor" not in usual_for(replace(measured, input_units=("V", "A")))
    assert "linear-axis" in usual_for(replace(measured, input_units=("N", "N"), output_units=("m/s",)))
    with pytest.raises(DataError, match=r"2 inputs for rigid-motor.*a load as the last one, in N\*m"):
        emsid.fit(emsid.plants.rigid_motor(), replace(measured, input_units=("V", "A")))


def test_the_linear_part_of_a_loaded_motor_has_the_load_as_an_input():
    for plant in (DrivenMotor(ONE_MASS, Drive(loaded=True)), LinearAxis(drive=Drive(loaded=True))):
        part = plant.linearised(SPEED)
        gain = part.d - part.c[:, :1] @ np.linalg.solve(part.a[:1, :1], part.b[:1])
        u = np.tile([0.5, 0.01], (4000, 1))
        plain = plant.with_frictions(dict.fromkeys(plant.frictions, Friction()))
        assert plain.simulate(u, DT, np.zeros(4), SPEED)[-1, 0] == pytest.approx((gain @ u[0]).item(), rel=1e-6)


# --- the speed of a wheel ---------------------------------------------------------------------------------------------


def test_a_wheel_reads_its_radius_times_the_speed_over_the_gear():
    u = inputs()[:, :1]
    plain = DrivenMotor(ONE_MASS).simulate(u, DT, np.zeros(4), (Signal.SPEED, Signal.POSITION))
    wheel = DrivenMotor(ONE_MASS, sensor=Sensor(ratio=4.0, radius=0.03))
    np.testing.assert_allclose(wheel.simulate(u, DT, np.zeros(4), (Signal.SPEED, Signal.POSITION)), 0.0075 * plain)
    assert wheel.channels.units[Signal.SPEED] == "m/s"
    assert wheel.handles["sensor.offset"].parameter.unit == "m/s"


@pytest.mark.parametrize("known", [{"sensor.radius": 0.03, "resistance": R}, {"motor_constant": K, "resistance": R}])
def test_a_motor_is_recovered_from_the_speed_of_its_wheel(known):
    """With the radius, or with the motor constant and a free radius."""
    motor = DrivenMotor(replace(ONE_MASS, rotor_friction=Friction(4e-3)), sensor=Sensor(radius=0.03))
    measured = record(motor, inputs(1200)[:, :1], ("V",), "m/s", noise=0.002)
    free = ("rotor_inertia", "rotor_friction.coulomb", *({"sensor.radius", "motor_constant"} - known.keys()))
    fit = emsid.fit(emsid.plants.rigid_motor(), measured, free=free, fixed={**known, "rotor_viscous": B})
    for name, value in {"motor_constant": K, "rotor_inertia": J, "sensor.radius": 0.03}.items():
        assert fit.model.plant.value(name) == pytest.approx(value, rel=0.01), name


def test_the_radius_decides_whether_metres_per_second_are_of_a_motor():
    measured = record(DrivenMotor(ONE_MASS, sensor=Sensor(radius=0.03)), inputs(400)[:, :1], ("V",), "m/s")
    assert "linear-axis" in usual_for(measured)
    assert "rigid-motor" in usual_for(measured, ("sensor.radius",))
    with pytest.raises(DataError, match=r"give the radius of its wheel, sensor\.radius"):
        emsid.fit(emsid.plants.rigid_motor(), measured)


def test_the_data_decide_whether_a_slow_output_without_a_name_is_a_position():
    measured = axis(700, False, 700).fitted
    assert usual_for(measured, control=FREE)[-1] == "linear-axis"
    speed = np.gradient(measured.output[:, 0], measured.dt)
    assert usual_for(replace(measured, output=speed), control=FREE)[-1] == "rigid-motor"


def test_a_parameter_without_an_effect_at_the_end_of_a_search_has_no_interval():
    """The smoothing of the search gives an effect to the level of a friction that is never overcome."""
    measured = excerpt(axis(800, False, 2_000).fitted, 1_000)
    motor = PLANTS["rigid-motor"].start.driven.for_command(measured)
    assert np.isfinite(simulation_error(motor, measured, max_iterations=5, find_start=False).cost)


def test_a_loaded_motor_runs_from_rest_and_sample_by_sample():
    model = emsid.PlantModel(DrivenMotor(ONE_MASS, Drive(loaded=True)), SPEED)
    command = Record(inputs(), dt=DT, input_units=("V", "N*m"))
    whole = emsid.simulate(model, command).output
    state = model.at_rest(0.0, DT)
    for u, y in zip(command.input[:20], whole, strict=False):
        shown, state = model.advance(state, u)
        np.testing.assert_array_equal(shown, y)
