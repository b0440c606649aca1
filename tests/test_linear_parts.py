"""The linear part of every model that has one, in python-control, gives the model's own output."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from emsid import Cascade, LinearAxis, ModelError, MotorPlant, RegressionModel, StateSpaceModel, Structure, arx
from emsid.models.blocks.filters import Rational
from emsid.models.plants.drive import Drive, Feed
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor
from emsid.plant import Friction, Motor
from model_examples import ALL, DT, OWN


@pytest.fixture(scope="module")
def control() -> Any:
    """python-control, which is imported by a test that runs and not by the collection."""
    return pytest.importorskip("control")


SMOOTH = replace(Motor(), rotor_friction=Friction(), load_friction=Friction(), voltage_dead_zone=None)
RIGID = SMOOTH.rigid()
QUICK = replace(RIGID, inductance=0.0)
EVERY = (Signal.SPEED, Signal.POSITION, Signal.CURRENT)
LAGGING = Sensor(ratio=3.0, lag=0.02)
PLANTS: dict[str, tuple[object, tuple[Signal, ...]]] = {
    "one mass": (MotorPlant(QUICK, Drive(gain=2.0)), EVERY),
    "one mass, slow sensor": (MotorPlant(QUICK, Drive(gain=2.0), LAGGING), EVERY),
    "one mass fed with a current": (MotorPlant(QUICK, Drive(gain=0.1), feed=Feed.CURRENT), EVERY),
    "one mass fed with a torque": (MotorPlant(QUICK, Drive(gain=0.001), feed=Feed.TORQUE), EVERY),
    "one mass with inductance": (MotorPlant(RIGID), EVERY),
    "two masses": (MotorPlant(SMOOTH, sensor=LAGGING), (*EVERY, Signal.ROTOR_SPEED)),
    "two masses without inductance": (
        MotorPlant(replace(SMOOTH, inductance=0.0)),
        (Signal.SPEED, Signal.POSITION, Signal.ROTOR_SPEED),
    ),
    "axis": (LinearAxis(2.0, 3.0, Friction(), drive=Drive(gain=4.0), sensor=Sensor(lag=0.02)), EVERY[:2]),
}


@pytest.mark.parametrize("name", PLANTS)
def test_a_plant_without_dry_friction_is_its_linear_part(name: str, control: Any) -> None:
    plant, signals = PLANTS[name]
    model = GreyBox(plant, signals)  # type: ignore[arg-type]
    u = np.repeat(np.random.default_rng(0).uniform(-3, 3, 20), 10)
    system = model.to_control()
    assert system.noutputs == len(signals)
    # Held inputs; what a sensor filters is a straight line between samples to it.
    held = control.sample_system(system, DT / 50, "zoh")
    expected = control.forced_response(held, inputs=np.repeat(u, 50)).outputs.reshape(len(signals), -1)[:, ::50]
    found = model.run(model.at_rest(0.0, DT), u[:, None])[0].T
    for signal, one, other in zip(signals, found, expected, strict=True):
        late = 1 if signal is Signal.CURRENT and system.D.any() else 0
        tolerance = 2e-2 if plant.sensor.lag else 1e-6  # type: ignore[attr-defined]
        assert np.max(np.abs(one - other)[late:]) < tolerance * np.max(np.abs(other)), signal


def test_arx_is_its_transfer_function(control: Any) -> None:
    model = ALL["arx"]
    assert isinstance(model, RegressionModel)
    u = np.random.default_rng(1).standard_normal(100)
    there = control.forced_response(model.to_control(), inputs=u).outputs
    np.testing.assert_allclose(np.ravel(there), model.simulate(u).output[:, 0], rtol=1e-9, atol=1e-12)


def test_two_inputs_have_a_transfer_function_each(control: Any) -> None:
    model = RegressionModel(arx(2, 2, inputs=2), np.array([-1.2, 0.4, 0.1, 0.05, 0.2, -0.1]), DT)
    system, u = model.to_control(), np.random.default_rng(2).standard_normal((100, 2))
    assert (system.ninputs, system.noutputs, system.dt) == (2, 1, DT)
    for k in range(2):
        alone = np.zeros_like(u)
        alone[:, k] = u[:, k]
        there = control.forced_response(system[0, k], inputs=u[:, k]).outputs
        np.testing.assert_allclose(np.ravel(there), model.simulate(alone).output[:, 0], rtol=1e-9, atol=1e-12)


def test_the_linear_terms_of_a_nonlinear_structure_are_converted(control: Any) -> None:
    model = RegressionModel(
        Structure.parse("-y(t-1)", "u(t-1)", "u(t-1)^2", "sign(y(t-1))"), np.array([-0.5, 2.0, 7.0, 9.0]), DT
    )
    assert model.to_control().dcgain() == pytest.approx(4.0)
    with pytest.raises(ModelError, match="no term that is linear in an input"):
        RegressionModel(Structure.parse("y(t-1)", "u(t-1)^2"), np.array([0.5, 1.0]), DT).to_control()


def test_filters_of_a_cascade_take_its_sample_time(control: Any) -> None:
    model = Cascade((Rational([0.3], [-0.7]),), oversampling=2, dt=DT)
    assert [system.dt for system in model.to_control()] == [DT / 2]
    with pytest.raises(ModelError, match="no sample time"):
        replace(model, dt=None).to_control()


def test_a_model_without_a_linear_part_is_refused(control: Any) -> None:
    with pytest.raises(ModelError, match="no linear part"):
        GreyBox(OWN, (Signal.SPEED,)).to_control()


@pytest.mark.parametrize("name", ["arx", "hammerstein", "rigid motor", "linear axis"])
def test_without_python_control_the_message_says_what_to_install(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ModelError, match=r"pip install emsid\[control\]"):
        ALL[name].to_control()  # type: ignore[attr-defined]


def test_a_state_space_model_runs_and_answers_as_in_python_control(control: Any) -> None:
    model = StateSpaceModel(
        np.array([[0.9, 0.2], [-0.1, 0.7]]),
        np.array([[1.0, 0.0], [0.2, 0.5]]),
        np.array([[1.0, 0.0], [0.5, 2.0]]),
        np.array([[0.0, 0.1], [0.0, 0.0]]),
        np.zeros((2, 2)),
        np.zeros(2),
        0.01,
    )
    u = np.random.default_rng(1).standard_normal((100, 2))
    theirs = control.forced_response(model.to_control(), inputs=u.T).outputs.T
    np.testing.assert_allclose(model.run(np.zeros(2), u)[0], theirs, atol=1e-12)
    frequency = np.array([0.1, 5.0, 40.0])
    answer = control.frequency_response(model.to_control(), 2 * np.pi * frequency).frdata.transpose(2, 0, 1)
    np.testing.assert_allclose(model.response(frequency), answer, rtol=1e-12)
