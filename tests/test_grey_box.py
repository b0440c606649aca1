"""A plant as a model: it comes back from a file, runs free, predicts, and prints its equations."""

from dataclasses import replace

import numpy as np
import pytest

from coverage_grey_box import MOTOR
from emsid.errors import ModelError
from emsid.models.model import Model
from emsid.models.plants.drive import Bridge, Drive, Feed
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.choice import STARTS
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.sensor import Sensor
from emsid.plant import DeadZoneLaw, Friction, Motor
from emsid.record import Record
from emsid.report.views.grey_box import plant_equations
from emsid.validation.comparison import fit_percent
from simulated_plants import DT, LATE, LEVELS, RIGID, SPEED, driven, record_of


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


@pytest.mark.parametrize("signal", [Signal.SPEED, Signal.POSITION])
def test_a_free_run_through_a_sensor_that_lags_may_begin_in_full_motion(signal):
    inputs = LEVELS[:, None]
    exact = Record(inputs, LATE.simulate(inputs, DT, np.zeros(2), (signal,)), DT)
    rest = replace(exact[990:], output_units=("rad/s" if signal is Signal.SPEED else "rad",))
    run = GreyBox(LATE, (signal,)).simulate(rest)
    error = np.abs(run.output - rest.output)[run.counted]
    assert len(error) == len(rest) - 20
    assert np.max(error) < 1e-6 * np.max(np.abs(rest.output))


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


def test_an_equation_leaves_out_what_the_plant_does_not_have():
    fit = simulation_error(STARTS["rigid-motor"], driven(noise=0.01), fixed={"resistance": 2.0})
    assert not any(name in fit.model.equation() for name in ("load_inertia", "cogging"))
    assert "resistance = 2 Ω, motor_constant = " in fit.model.equation()
    motion, numbers = plant_equations(fit)
    assert motion.startswith("0 = D_v(v_a) − R_a·i − K_m·ω\n")
    assert "resistance = 2 Ω" in numbers
    assert "N*m" not in numbers
    assert "kg·m²" in numbers


@pytest.mark.parametrize(
    ("unit", "motion", "without"),
    [("A", "K_m·i", ["resistance", "inductance"]), ("N*m", "T", ["resistance", "inductance", "motor_constant"])],
)
def test_a_motor_that_no_voltage_drives_has_no_electrical_equation(unit, motion, without):
    feed = Feed.CURRENT if unit == "A" else Feed.TORQUE
    inputs = LEVELS[:, None] * (0.1 if unit == "A" else 0.005)
    exact = DrivenMotor(RIGID, feed=feed).simulate(inputs, DT, np.zeros(2), (Signal.SPEED,))
    record = Record(inputs, exact, DT, input_units=(unit,), output_units=("rad/s",))
    fit = simulation_error(DrivenMotor(RIGID), record)
    equation, numbers = plant_equations(fit)
    assert equation == f"(J_m + J_L)·dω/dt = {motion} − (B_m + B_L)·ω − T_f(ω) − T_d"
    assert "rotor_inertia = " in numbers
    assert not any(f"{name} = " in numbers for name in without)
