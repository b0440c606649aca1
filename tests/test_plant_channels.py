"""What the channels of a record are to a plant: their units, signs and codes."""

from dataclasses import replace

import numpy as np
import pytest

from emsid.errors import DataError, ModelError
from emsid.findings import Finding
from emsid.identification.workflow import identify
from emsid.models.plants.drive import Bridge, Drive, Feed
from emsid.models.plants.grey_box import GreyBox, assumptions, check_channels
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.choice import STARTS, choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.options import Options
from emsid.plant import Friction, Motor
from emsid.record import Record
from emsid.report.views.grey_box import units_taken
from simulated_plants import DT, LEVELS, RIGID, SPEED, USUAL, VOLTAGE, driven, record_of, rms

CODED = np.where(np.arange(len(LEVELS)) % 400 < 50, 999.0, LEVELS)


# --- units -----------------------------------------------------------------------------------------------------------


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
    fit = choose(STARTS["rigid-motor"], record, fixed={"motor_constant": 0.05}, effects=())
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


@pytest.mark.parametrize(
    ("plant", "units", "message"),
    [
        (
            DrivenMotor(RIGID),
            ("V", ""),
            r"; name the one that drives it, or say which values of a second are codes",
        ),
        (
            DrivenMotor(RIGID, Drive(codes=((2.0, Bridge.BRAKE),))),
            ("V", "", ""),
            "3 inputs .* and the one with its codes",
        ),
    ],
)
def test_too_many_inputs_are_refused(plant, units, message):
    inputs = np.column_stack([LEVELS] * len(units))
    with pytest.raises(DataError, match=message):
        simulation_error(plant, Record(inputs, LEVELS, DT, input_units=units, output_units=("rad/s",)))


def test_the_assumed_unit_of_a_channel_is_a_finding():
    record = Record(LEVELS, LEVELS, DT, input_names=("u",), output_names=("y",), output_units=("",))
    assert assumptions(STARTS["rigid-motor"], record) == [
        Finding("unit-assumed", "rigid-motor", {"channel": "y", "signal": "speed", "unit": "rad/s"}),
        Finding("command-unit-assumed", "rigid-motor", {"channel": "u", "unit": "volts", "given": ""}),
    ]
    assert [finding.data["unit"] for finding in assumptions(STARTS["linear-axis"], record)] == ["m", "newtons"]
    said = replace(record, input_units=("V",), output_units=("rad/s",))
    assert assumptions(STARTS["rigid-motor"], said) == []


@pytest.mark.parametrize(
    ("command", "unit", "full"),
    [
        (np.round(LEVELS / np.max(np.abs(LEVELS)) * 255), "", 255.0),
        (np.round(LEVELS / np.max(np.abs(LEVELS)) * 250), "", None),  # no limit of any timer
        (LEVELS / np.max(np.abs(LEVELS)) * 255, "", None),  # no whole numbers
        (np.round(LEVELS / np.max(np.abs(LEVELS)) * 100), "V", None),
    ],
)
def test_a_command_that_ends_like_a_duty_is_asked_about(command, unit, full):
    record = Record(command, LEVELS, DT, input_names=("PWM",), input_units=(unit,), output_units=("rad/s",))
    said = [
        assumption.data
        for assumption in assumptions(STARTS["rigid-motor"], record)
        if assumption.code == "command-may-be-duty"
    ]
    assert said == ([{"channel": "PWM", "full": full}] if full else [])


def test_codes_need_no_unit():
    plant = DrivenMotor(RIGID, Drive(codes=((2.0, Bridge.BRAKE),)))
    inputs = np.column_stack([LEVELS, np.where(np.arange(len(LEVELS)) % 400 < 50, 2.0, 0.0)])
    record = Record(
        inputs,
        plant.simulate(inputs, DT, np.zeros(2), (Signal.SPEED,)),
        DT,
        input_names=("volts", "state"),
        input_units=("V", ""),
        output_names=("speed",),
        output_units=("rad/s",),
    )
    fit = simulation_error(plant, record, free=USUAL)
    assert units_taken(fit) == ""
    said = units_taken(replace(fit, segments=(replace(record, input_units=("", "")),)))
    assert said.startswith("The record has no unit for volts; it is read as SI.")


# --- signs -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.002, 0.2])
@pytest.mark.parametrize("plant", [DrivenMotor(RIGID), LinearAxis()], ids=["motor", "axis"])
def test_an_output_with_the_wrong_sign_is_refused(plant, noise):
    signal = Signal.SPEED if isinstance(plant, DrivenMotor) else Signal.POSITION
    exact = plant.simulate(LEVELS[:, None], DT, np.zeros(2), (signal,))
    measured = exact + noise * np.std(exact) * np.random.default_rng(4).standard_normal(exact.shape)
    unit = "rad/s" if signal is Signal.SPEED else "m"
    record = Record(LEVELS, measured, DT, output_units=(unit,), input_names=("v",), output_names=("w",), name="log")
    assert simulation_error(plant, record).names
    message = r"log: 'w' goes against 'v'; if that is how .* turn the sign of one of them with scale w=-1"
    with pytest.raises(DataError, match=message):
        simulation_error(plant, replace(record, output=-record.output))


def two_channels(noise):
    record = driven(noise=noise, signals=(Signal.SPEED, Signal.CURRENT))
    return replace(record, input_names=("v",), output_names=("w", "i"), name="log")


@pytest.mark.parametrize("noise", [0.002, 0.5])
def test_channels_with_the_right_signs_are_fitted(noise):
    fit = simulation_error(DrivenMotor(RIGID), two_channels(noise))
    assert fit.model.plant.value("motor_constant") == pytest.approx(RIGID.motor_constant, rel=0.02)


@pytest.mark.parametrize("noise", [0.002, 0.5])
@pytest.mark.parametrize(
    ("signs", "words"),
    [
        ((1, -1), r"'i' goes against 'v'; .* turn the sign of i with scale i=-1"),
        ((-1, 1), r"'w' goes against 'v'; .* turn the sign of w with scale w=-1"),
        ((-1, -1), r"'w' and 'i' go against 'v'; .* turn the sign of v with scale v=-1"),
    ],
)
def test_the_channel_with_the_wrong_sign_is_named(signs, words, noise):
    record = two_channels(noise)
    with pytest.raises(DataError, match=f"log: {words}"):
        simulation_error(DrivenMotor(RIGID), replace(record, output=record.output * np.array(signs)))


def test_a_current_alone_may_have_the_wrong_sign():
    record = replace(driven(signals=(Signal.CURRENT,)), input_names=("v",), output_names=("i",))
    with pytest.raises(DataError, match=r"'i' goes against 'v'; .* turn the sign of one of them with scale i=-1"):
        simulation_error(DrivenMotor(RIGID), replace(record, output=-record.output))


def test_a_motor_that_lowers_a_load_gives_power_back_and_is_no_wrong_sign():
    lowering = DrivenMotor(RIGID, load_torque=-0.05)
    volts = 3.0 + 0.25 * LEVELS
    exact = lowering.simulate(volts[:, None], DT, np.zeros(2), (Signal.SPEED, Signal.CURRENT))
    noisy = exact + 0.01 * np.std(exact, axis=0) * np.random.default_rng(1).standard_normal(exact.shape)
    record = Record(volts, noisy, DT, output_units=("rad/s", "A"))
    assert np.mean(volts * noisy[:, 1]) < -1.0
    free = ("resistance", "load_torque", *USUAL[:2])  # of torques of one sign only the sum is identifiable
    fit = simulation_error(lowering.with_values({"load_torque": 0.0}), record, free=free)
    assert fit.model.plant.value("load_torque") == pytest.approx(-0.05, rel=0.02)


# --- codes -----------------------------------------------------------------------------------------------------------


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
    fit = choose(replace(beside, motor=replace(RIGID, motor_constant=0.07, rotor_inertia=5e-5)), record, effects=(),
                 fixed={"resistance": 2.0})  # fmt: skip
    k = fit.names.index("motor_constant")
    assert abs(fit.estimate[k] - RIGID.motor_constant) < 4 * fit.standard_error[k] < 0.1 * RIGID.motor_constant
    assert rms(fit.simulated()[0] - record.output) < 0.11
    with pytest.raises(DataError, match="2 inputs for rigid-motor"):
        simulation_error(DrivenMotor(RIGID), record)


def test_a_code_that_never_occurs_is_a_finding():
    record, options = driven(noise=0.01), Options(codes=((999.0, Bridge.COAST), (LEVELS[5], Bridge.BRAKE)))
    result = identify(record, models=("rigid-motor",), options=replace(options, free=USUAL))
    absent = [finding for finding in result.findings if finding.code == "code-never-occurs"]
    assert absent == [Finding("code-never-occurs", "u1", {"value": 999.0})]


@pytest.mark.parametrize(("model", "unit", "nothing"), [("linear-axis", "N", "force"), ("rigid-motor", "A", "torque")])
def test_codes_without_a_bridge_mean_no_drive_or_are_refused(model, unit, nothing):
    plant = replace(STARTS[model], drive=Drive(codes=((999.0, Bridge.COAST),)))
    if unit == "A":
        plant = replace(plant, feed=Feed.CURRENT)
    exact = plant.simulate(CODED[:, None], DT, np.zeros(2), (Signal.SPEED,))
    stopped = plant.simulate(np.where(CODED == 999.0, 0.0, CODED)[:, None], DT, np.zeros(2), (Signal.SPEED,))
    assert np.array_equal(exact, stopped)
    shown = "m/s" if unit == "N" else "rad/s"
    record = Record(CODED, exact, DT, input_units=(unit,), output_units=(shown,), name="log")
    options = Options(free=plant.default_free[1:], codes=((999.0, Bridge.COAST),))
    result = identify(record, models=(model,), options=options)
    assert Finding("codes-without-bridge", model, {"codes": [999.0], "nothing": nothing}) in assumptions(plant, record)
    assert result.chosen.model.plant.drive.codes == options.codes
    with pytest.raises(ModelError, match=f"{model} has no bridge here that could brake with 999; say that nothing dri"):
        identify(record, models=(model,), options=replace(options, codes=((999.0, Bridge.BRAKE),)))


def test_codes_with_a_bridge_are_no_finding():
    record = Record(CODED, LEVELS, DT, input_units=("V",), output_units=("rad/s",))
    coded = replace(STARTS["rigid-motor"], drive=Drive(codes=((999.0, Bridge.BRAKE),)))
    assert assumptions(coded, record) == []
    check_channels(coded, (Signal.SPEED,), record)


def test_a_motor_with_a_shaft_that_coasts_is_refused_with_what_to_do():
    coded = replace(STARTS["motor"], drive=Drive(codes=((999.0, Bridge.COAST),)))
    record = Record(CODED, LEVELS, DT, input_units=("V",), output_units=("rad/s",))
    with pytest.raises(
        ModelError, match=r"without inductance only; choose rigid-motor, or leave out these samples with a mask"
    ):
        simulation_error(coded, record)
