"""Every friction law in a motor with a shaft or an inductance: against SciPy, in its limits, and in fits."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import emsid
from emsid.models.plants.cogging import Cogging
from emsid.models.starting import start
from emsid.plant import (
    Friction,
    FrictionLaw,
    GaussianStribeck,
    LawParameter,
    LoadFriction,
    Measure,
    Motor,
    PowerFriction,
    State,
    Taylor,
    friction_law,
    simulate,
)
from emsid.plant.constants import Extra
from emsid.plant.reference import simulate_reference
from simulated_plants import two_sines

CHANNELS = ("current", "rotor_speed", "load_speed", "twist", "load_angle")
LOADED = replace(Motor(), load_friction=Friction((2e-3, 3e-3), 1e-3, 0.5))
GEAR = replace(
    LOADED,
    rotor_friction=LoadFriction(4e-3, 2e-3, 0.3, 0.1, 0.05),
    load_friction=LoadFriction(2e-3, 1e-3, 0.5, 0.08, 0.02),
)
MOTORS = {
    "gaussian": replace(LOADED, rotor_friction=GaussianStribeck(8e-3, (2e-3, 3e-3), 0.3)),
    "load": GEAR,
    "power": replace(LOADED, rotor_friction=PowerFriction(4e-3, 2e-3, 0.3, 0.1, 0.05, 0.02, 0.01)),
}


@friction_law("square of the tests")
@dataclass(frozen=True)
class Square(FrictionLaw):
    """A law that is not compiled."""

    dry: float = 0.0
    drag: float = 0.0
    parameters = (
        LawParameter("dry", "α₀", Measure.FORCE, "dry friction"),
        LawParameter("drag", "α₂", Measure.OTHER, "drag by speed squared"),
    )
    level = staticmethod(lambda speed, numbers, side: numbers[side, 0] + numbers[side, 1] * speed**2)


@pytest.mark.parametrize("name", MOTORS)
def test_agrees_with_scipy_restarted_at_every_event(name: str) -> None:
    motor, dt = MOTORS[name], 2e-3
    voltage = two_sines(150, dt)
    expected, transitions = simulate_reference(motor, voltage, dt, tolerance=1e-10)
    result = simulate(motor, voltage, dt, energy=True)
    assert result.events.transitions == transitions >= 6
    for k, channel in enumerate(CHANNELS):
        size = np.abs(expected[:, k]).max()
        np.testing.assert_allclose(getattr(result, channel), expected[:-1, k], rtol=0, atol=1e-7 * size)
    assert abs(result.energy.imbalance) < 1e-9 * result.energy.electrical
    assert result.energy.rotor_friction > 0.05 * result.energy.electrical


@pytest.mark.parametrize("order", [2, 4])
def test_order_of_convergence_is_the_order_of_the_series(order: int) -> None:
    dt, voltage = 2e-3, np.repeat([3.0, 5.0, 4.0, 6.0], 5)  # no corner of the law
    motor, start = MOTORS["gaussian"], State(1.0, 40.0, 40.0)
    exact = simulate(motor, voltage, dt, initial=start, method=Taylor(20, 1e-15)).load_speed
    steps = dt / np.array([8, 16, 32])
    runs = [simulate(motor, voltage, dt, initial=start, method=Taylor(order, np.inf, step)) for step in steps]
    errors = np.array([np.sqrt(np.mean((run.load_speed - exact) ** 2)) for run in runs])
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), order, atol=0.15)


def test_the_law_of_the_paper_is_the_same_by_series_and_by_polynomials() -> None:
    voltage = two_sines(300, 2e-3)
    for motor in (LOADED, LOADED.rigid(), replace(LOADED, shaft_backlash=0.05)):
        series = simulate(motor, voltage, 2e-3)
        other = simulate(motor, voltage, 2e-3, extra=Extra(1e-300))
        size = np.abs(series.load_speed).max()
        np.testing.assert_allclose(other.load_speed, series.load_speed, atol=1e-8 * size)
        assert other.events.transitions == series.events.transitions >= 5


@pytest.mark.parametrize("law", [LoadFriction(0.01, 3e-3, 0.3, 0.1, 0.05), GaussianStribeck(0.01, 3e-3, 0.3)])
def test_one_mass_is_the_limit_of_a_small_inductance_and_of_a_stiff_shaft(law: FrictionLaw) -> None:
    """Both engines, with friction by the square of the speed, cogging and a load too.

    The load of a gear on the rotor is that of the shaft, so with the inertia of the load: there is no such limit.
    """
    u, dt, signals = two_sines(200, 2e-3)[:, None], 2e-3, (emsid.plants.Signal.SPEED,)
    whole = replace(Motor(), inductance=0.0, rotor_friction=law, load_friction=Friction())
    extras = {"quadratic_viscous": 2e-6, "cogging": Cogging(sine_1=2e-3), "load_torque": 1e-3}
    limit = emsid.MotorPlant(whole.rigid(), steps=64, **extras).simulate(u, dt, np.zeros(2), signals)

    def away(motor: Motor) -> float:
        near = emsid.MotorPlant(motor, **extras).simulate(u, dt, np.zeros(2), signals)
        return float(np.sqrt(np.mean((near - limit) ** 2)) / np.std(limit))

    far, near = (away(replace(whole.rigid(), inductance=each)) for each in (1e-3, 1e-4))
    assert near < min(0.12 * far, 2e-3)
    if isinstance(law, GaussianStribeck):
        far, near = (away(replace(whole, shaft_stiffness=each, shaft_damping=0.05)) for each in (1e2, 1e4))
        assert near < min(0.3 * far, 5e-4)
    assert np.count_nonzero(limit == 0.0) > 10


def test_a_gear_rests_exactly_up_to_its_level_under_load() -> None:
    """Both engines: K_m·i against a load torque; |τ_m − τ_e| grows with both."""
    law = LoadFriction(0.01, load=0.2)
    motor = replace(Motor(), inductance=2e-3, rotor_friction=law, load_friction=Friction(), voltage_dead_zone=None)
    for outside in (0.0, 0.02):
        breaks = (0.01 + 1.2 * outside) / 0.8  # made − outside = level(made + outside)
        for factor, moves in ((0.999, False), (1.001, True)):
            volts = factor * breaks * motor.resistance / motor.motor_constant
            held = simulate(motor.rigid(), np.full(200, volts), 1e-3, disturbance=outside)
            assert (held.final.load_speed > 0) is moves


def test_a_law_in_plain_python_is_the_same_as_a_compiled_one() -> None:
    plain = replace(Motor(), rotor_friction=Square(8e-3, 1e-6), load_friction=Friction())
    voltage = two_sines(20, 2e-3, 3.0)
    known = replace(plain, rotor_friction=Friction(8e-3)).rigid()
    expected = simulate(known, voltage, 2e-3, extra=Extra(1e-6)).load_speed
    np.testing.assert_allclose(simulate(plain.rigid(), voltage, 2e-3).load_speed, expected, atol=1e-9)


@pytest.mark.parametrize("rigid", [True, False])
def test_parameters_are_recovered_and_kept_in_a_file(rigid: bool, tmp_path) -> None:
    motor = replace(GEAR, load_friction=Friction())
    truth = emsid.MotorPlant(motor.rigid() if rigid else motor)
    model, u = emsid.PlantModel(truth, (emsid.plants.Signal.SPEED,)), two_sines(250, 2e-3, 3.0)
    output = emsid.simulate(model, u, dt=2e-3).output
    record = emsid.Record(u, output, 2e-3, input_units=("V",), output_units=("rad/s",))
    free = ["rotor_friction.coulomb", "rotor_friction.load", "inductance"]
    begun = truth.with_values(dict(zip(free, (6e-3, 0.05, 3e-3), strict=True)))
    fit = emsid.fit(begun, record, free=free)
    for name in free:
        assert fit[name].value == pytest.approx(truth.value(name), rel=1e-4)
    emsid.save(fit, tmp_path / "motor.json")
    again = emsid.load(tmp_path / "motor.json")
    assert again.model.plant.value("rotor_friction.load") == fit[free[1]].value
    np.testing.assert_array_equal(
        emsid.simulate(again.model, u, dt=2e-3).output, emsid.simulate(fit.model, u, dt=2e-3).output
    )
    running = start(model, dt=2e-3)
    stepped = np.array([running.step(float(each)) for each in u[:60]]).reshape(-1, 1)
    np.testing.assert_allclose(stepped, output[:60], atol=1e-9)
