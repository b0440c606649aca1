"""What acts on a plant before its record begins, which matters where the drive has a delay.

The records come from the tests' own simulator, with a command of zero for some time before the first sample.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from emsid import Record
from emsid.models.plants.drive import Hold
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.initial_state import InitialMotion, initial_motion, starts_at_rest
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.state import HELD
from emsid.plant import DeadZoneLaw, Motor
from independent.one_mass import OneMass

Array = NDArray[np.float64]

DT, LEAD = 5e-3, 20
RIGID = DrivenMotor(replace(Motor(), inductance=0.0).rigid())
FREE = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb", "drive.delay")
TRUTH = OneMass(gain=400.0, damping=20.0, coulomb=(250.0, 250.0), smooth=0.01)


def counted(values: Array, step: float) -> Array:
    """Values as a counter shows them."""
    return step * np.floor(values / step + 0.3)


def recorded(u: Array, delay: float, unit: str, step: float, noise: float, lead: int = 0) -> Record:
    """A record from rest, which begins ``lead`` samples before the first command."""
    whole = np.concatenate([np.zeros(LEAD), u])
    speed, position = replace(TRUTH, delay=delay * DT).run(whole, DT)
    y = (speed if unit == "rad/s" else position)[: len(whole)]
    y = counted(y, step) if step else y
    y = y + noise * np.random.default_rng(1).standard_normal(len(y))
    cut = slice(LEAD - lead, None)
    return Record(whole[cut], y[cut], DT, output_units=(unit,))


@pytest.mark.parametrize(
    ("unit", "step", "noise", "delay"),
    [
        ("rad/s", 0.0, 1.0, 1.0),
        ("rad/s", 0.0, 1.0, 5.0),
        ("rad/s", 0.5, 0.0, 2.5),
        ("rad", 0.02, 0.0, 2.5),
        ("rad", 0.02, 0.0, 5.0),
        ("rad", 0.02, 0.0, 0.5),
        ("rad", 0.005, 0.0, 1.0),
        ("rad", 0.005, 0.0, 1.5),
        ("rad", 0.0, 0.02, 2.5),
    ],
)
def test_a_record_may_begin_with_a_step(unit, step, noise, delay):
    """A fit is as good, and the free run on another record is, as with samples from before the step."""
    u = np.repeat([9.0, -5.0, 0.0, 12.0], [80, 50, 40, 80])
    model, error = {}, {}
    for lead in (0, LEAD):
        record = recorded(u, delay, unit, step, noise, lead)
        fit = simulation_error(RIGID, record, free=FREE, fixed={"voltage_dead_zone.half_width": 0.0}, hold="zero")
        assert fit.model.plant.drive.delay == pytest.approx(delay * DT, abs=0.1 * DT)
        model[lead], error[lead] = fit.model, np.sqrt(2 * fit.cost / len(record))
    assert error[0] < 1.15 * error[LEAD]
    new = recorded(-0.7 * u, delay, unit, 0.0, 0.0)
    alike = [np.std(each.simulate(new).output - new.output) for each in model.values()]
    assert alike[0] < 1.5 * alike[1] + 0.1 * (noise + step)


@pytest.mark.parametrize("delay", [2, 4])
def test_a_record_may_begin_where_the_command_before_it_begins_to_act(delay):
    """Its first speed is that of a record from rest, which the command moves only after the delay."""
    u = np.repeat([9.0, -5.0, 0.0, 12.0], [80, 50, 40, 80])
    record, exact = (recorded(u, delay, "rad/s", 0.0, noise, -delay) for noise in (1.0, 0.0))
    fit = simulation_error(RIGID, record, free=FREE, fixed={"voltage_dead_zone.half_width": 0.0}, hold="zero")
    assert fit.model.plant.drive.delay == pytest.approx(delay * DT, abs=0.1 * DT)
    assert fit.cost < 0.5 * np.sum((record.output - exact.output) ** 2)


PLANTS = {
    "motor": RIGID.with_values({"load_torque": 0.05}),
    "dead zone": replace(RIGID, motor=replace(RIGID.motor, voltage_dead_zone=DeadZoneLaw(-1.0, 2.0)), load_torque=0.05),
    "two masses": DrivenMotor(Motor(inductance=3e-3)),
    "axis": LinearAxis(offset=3.0),
}


@pytest.mark.parametrize("plant", list(PLANTS.values()), ids=list(PLANTS))
@pytest.mark.parametrize("hold", [Hold.ZERO, Hold.FIRST])
def test_until_the_first_command_acts_a_plant_at_rest_is_held(plant: DrivenPlant, hold: Hold):
    """A command that balances the load for some time before gives the same run."""
    plant = plant.with_drive(gain=0.8, offset=0.1, delay=3.5 * DT, hold=hold)
    held = np.zeros(plant.states)
    held[HELD] = 1.0
    u = np.repeat([[7.0], [-3.0]], 15, axis=0)
    signals = (Signal.POSITION, Signal.SPEED)
    run = plant.simulate(u, DT, held, signals)
    balance = np.full((LEAD, 1), plant.holding(0.0, 0.0) / 0.8 - 0.1)
    whole = plant.simulate(np.concatenate([balance, u]), DT, np.zeros(3), signals)
    np.testing.assert_allclose(run, whole[LEAD:], rtol=1e-6, atol=1e-9)
    assert np.max(np.abs(run[:3])) < 1e-9
    assert np.max(np.abs(plant.simulate(u, DT, np.zeros(3), signals)[:3])) > 1e-3


@pytest.mark.parametrize(
    ("speed", "command", "held"),
    [
        (0.0, 12.0, True),
        (0.0, 0.1, True),
        (1.0, 12.0, True),
        (-1.0, 12.0, True),
        (60.0, 12.0, False),
        (1.0, 0.1, False),
    ],
)
def test_a_plant_is_at_rest_where_the_first_command_would_have_moved_it_by_more(speed, command, held):
    plant = RIGID.with_drive(delay=2.5 * DT)
    record = Record(np.full(20, command), np.full(20, speed), DT, output_units=("rad/s",))
    assert bool(plant.first_state((Signal.SPEED,), record)[HELD]) is held


def test_a_command_that_does_not_move_it_leaves_a_plant_at_rest():
    model = GreyBox(RIGID.with_drive(delay=2.5 * DT), (Signal.SPEED,))
    record = Record(np.full(50, 0.1), np.zeros(50), DT, output_units=("rad/s",))
    assert not model.simulate(record).output.any()


def test_a_current_does_not_show_whether_a_motor_is_at_rest():
    record = Record(np.full(20, 12.0), np.zeros(20), DT, output_units=("A",))
    assert not RIGID.first_state((Signal.CURRENT,), record)[HELD]


def test_a_counter_at_rest_until_a_step_shows_no_speed():
    t = np.arange(100) * DT
    late = np.maximum(t - 6 * DT, 0.0)
    step = 0.02
    found = initial_motion(counted(200.0 * late**2, step), DT)
    assert (found.speed[0], found.position[0]) == (0.0, 0.0)
    assert found.position[1] == pytest.approx(step / np.sqrt(12.0))
    slow = initial_motion(counted(1.0 * t, step), DT)  # four samples for a count
    assert abs(slow.speed[0] - 1.0) < 3 * slow.speed[1]
    assert isinstance(slow, InitialMotion)


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.45])
def test_an_encoder_whose_first_counts_are_equal_may_be_in_motion(speed):
    t = np.arange(200.0)
    assert not any(starts_at_rest(np.floor(speed * t + first)) for first in np.linspace(0.0, 1.0, 50))
    assert starts_at_rest(np.floor(speed * np.maximum(t - 4.0, 0.0) ** 2))


def test_few_equal_samples_of_a_noisy_encoder_show_no_rest():
    rng = np.random.default_rng(5)
    y = np.round(0.5 * np.arange(20_000.0) + 1.5 * rng.standard_normal(20_000))
    equal = [k for k in range(len(y) - 40) if np.ptp(y[k : k + 3]) == 0][:400]
    assert len(equal) == 400
    assert sum(starts_at_rest(y[k : k + 40]) for k in equal) < 0.2 * len(equal)
