"""Parameters of simulated plants are recovered from exact, noisy, quantised and short records."""

from dataclasses import replace

import numpy as np
import pytest

from coverage_grey_box import (
    FREE,
    MOTOR,
    coverage,
    least_share,
)
from emsid.errors import DataError
from emsid.estimation.estimates import Status
from emsid.estimation.fit import Ending
from emsid.models.plants.drive import Drive
from emsid.models.plants.free_run_error import Recent
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.choice import STARTS, choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.plant import Friction, Motor
from emsid.record import Record, concatenate
from simulated_plants import DT, LATE, LEVELS, RIGID, SPEED, USUAL, VOLTAGE, driven, record_of, rms


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
    fit = choose(STARTS["rigid-motor"], record[:1400], effects=("delay",))
    run = fit.model.simulate(record[1400:])
    assert rms((run.output - record.output[1400:])[run.counted]) == pytest.approx(noise, rel=0.1)


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


def test_steps_logged_from_their_edge_on_are_accepted():
    plant, rng = DrivenMotor(RIGID), np.random.default_rng(6)
    steps = []
    for volts in (-12.0, -8.0, -4.0, 3.0, 6.0, 9.0):
        inputs = np.full((150, 1), volts)
        run = plant.simulate(inputs, DT, np.zeros(2), (Signal.SPEED,))
        steps.append(Record(inputs, run + 0.1 * rng.standard_normal(run.shape), DT, output_units=("rad/s",)))
    fit = simulation_error(plant, steps, free=("motor_constant", "rotor_inertia"))
    assert fit.estimate == pytest.approx([RIGID.motor_constant, RIGID.rotor_inertia], rel=2e-3)
    with pytest.raises(DataError, match="input u1 stays at -12 throughout; nothing drives it"):
        simulation_error(plant, steps[:1])


def test_errors_that_are_forgotten_find_the_same_parameters():
    record = record_of(MOTOR, noise=0.05)
    plain, recent = (simulation_error(MOTOR, record, free=FREE, weighting=w) for w in (Recent(10.0), Recent(0.2, 2)))
    spread = np.hypot(plain.standard_error, recent.standard_error)
    assert np.all(np.abs(plain.estimate - recent.estimate) < 5 * spread)


# --- drive and sensor ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("drive", "names"),
    [
        (Drive(supply=8.0), ("drive.supply",)),
        (Drive(knee=5.0, beyond=0.5), ("drive.knee", "drive.beyond")),
        (Drive(supply=np.max(np.abs(LEVELS)), freewheel=0.6), ("drive.freewheel",)),
    ],
    ids=["supply", "knee", "freewheel"],
)
def test_limits_of_the_drive_are_found_where_none_are_given(drive, names):
    fit = simulation_error(DrivenMotor(RIGID), driven(drive, 0.002), free=(*USUAL, *names))
    assert fit.names == (*USUAL, *names)
    truth = [DrivenMotor(RIGID, drive).value(name) for name in fit.names]
    assert fit.estimate == pytest.approx(truth, rel=0.01)


KNEES = [(5.0, 0.5), (9.0, 0.0), (5.0, 1.5), (9.0, 2.0), (4.0, 3.0)]


@pytest.mark.parametrize(
    ("knee", "beyond", "noise"),
    [
        *((*knee, 0.1) for knee in KNEES),
        (*KNEES[0], 0.002),
        *(pytest.param(*knee, 0.002, marks=pytest.mark.long) for knee in KNEES[1:]),
    ],
)
def test_a_knee_is_found_whichever_way_the_command_bends_there(knee, beyond, noise):
    record = driven(Drive(knee=knee, beyond=beyond), noise)
    fit = simulation_error(DrivenMotor(RIGID), record, free=(*USUAL, "drive.knee", "drive.beyond"))
    assert fit.names[-2:] == ("drive.knee", "drive.beyond")
    assert fit.estimate[-2:] == pytest.approx([knee, beyond], abs=0.01 if noise < 0.1 else 0.25)
    assert np.all(np.abs(fit.estimate[-2:] - [knee, beyond]) < 4 * fit.standard_error[-2:])
    assert 2 * fit.cost == pytest.approx(len(record) * noise**2 * np.var(record.output), rel=0.03)


def test_delay_and_lag_are_both_found_from_the_counts_of_an_encoder():
    count = 2 * np.pi / 600
    at_rest = np.array([0.0, 0.0, 0.0, 1.0])
    exact = LATE.simulate(LEVELS[:, None], DT, at_rest, (Signal.POSITION,))
    record = Record(LEVELS, np.round(exact / count) * count, DT, output_units=("rad",))
    start = STARTS["rigid-motor"].with_values({"voltage_dead_zone.half_width": 0.1})
    fit = choose(start, record, fixed={"sensor.ratio": 30.0}, effects=("delay", "lag"))
    found = {row.name: row for row in fit.table}
    assert found["drive.delay"].value == pytest.approx(1.4 * DT, abs=0.1 * DT)
    assert found["sensor.lag"].value == pytest.approx(4 * DT, abs=0.2 * DT)
    assert np.std(fit.simulated()[0] - record.output) == pytest.approx(count / np.sqrt(12), rel=0.05)


def test_a_drift_of_the_load_does_not_make_the_resistance_look_identifiable():
    """What looks like a drift is a part of the torque, which scales with K/R, and a position shows no scale."""
    count = 2 * np.pi / 600
    exact = LATE.simulate(LEVELS[:, None], DT, np.array([0.0, 0.0, 0.0, 1.0]), (Signal.POSITION,))
    record = Record(LEVELS, np.round(exact / count) * count, DT, output_units=("rad",))
    fit = choose(STARTS["rigid-motor"], record, fixed={"sensor.ratio": 30.0}, effects=("dead-zone", "delay", "lag"))
    assert "load-drifts" in {each.code for each in fit.findings}
    status = {row.name: row.status for row in fit.table}
    assert status["resistance"] is Status.KEPT


# --- noise -----------------------------------------------------------------------------------------------------------


def test_intervals_contain_the_true_values_with_coloured_noise_and_quantisation():
    shares = coverage(25, samples=500)  # 300 records by `make coverage`
    assert tuple(shares) == FREE
    assert min(shares.values()) >= least_share(25)


def test_exact_data_leave_the_uncertainty_of_the_simulation():
    fit = simulation_error(DrivenMotor(RIGID).with_values({"motor_constant": 0.075}), driven(noise=0.0), free=USUAL)
    truth = np.array([RIGID.motor_constant, RIGID.rotor_inertia, RIGID.rotor_friction.coulomb[0]])
    assert np.all(np.abs(fit.estimate - truth) < 1.96 * fit.standard_error)
    assert np.all(fit.standard_error < 1e-9 * truth)


@pytest.mark.parametrize(
    ("plant", "seeds"), [(DrivenMotor(RIGID), (2,)), (LinearAxis(), (2, 3, 4, 5))], ids=["motor", "axis"]
)
def test_motion_far_below_the_noise_is_accepted(plant, seeds):
    signal = Signal.SPEED if isinstance(plant, DrivenMotor) else Signal.POSITION
    exact = plant.simulate(40 * LEVELS[:, None], DT, np.zeros(2), (signal,))
    unit = "rad/s" if signal is Signal.SPEED else "m"
    name = "motor_constant" if isinstance(plant, DrivenMotor) else "mass"
    errors, deviations = [], []
    for seed in seeds:
        output = exact + 3 * np.std(exact) * np.random.default_rng(seed).standard_normal(exact.shape)
        fit = simulation_error(plant, Record(40 * LEVELS, output, DT, output_units=(unit,)))
        k = fit.names.index(name)
        errors.append(fit.estimate[k] / plant.value(name) - 1)
        deviations.append(fit.standard_error[k] / plant.value(name))
    assert np.all(np.abs(errors) < 3 * np.array(deviations))
    assert 3 * np.mean(deviations) < 0.5
    assert np.sqrt(np.mean(np.square(errors))) < 0.15


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("resolution", [0.0, 1.0], ids=["fine", "coarse"])
def test_an_output_of_noise_alone_is_refused(seed, resolution):
    noise = 0.4 * np.random.default_rng(seed).standard_normal(len(LEVELS))
    shown = np.round(noise / resolution) * resolution if resolution else noise
    with pytest.raises(DataError, match="output y1 is noise that has nothing to do with the input; nothing moves"):
        simulation_error(MOTOR, Record(0.01 * LEVELS, 3.0 + shown, DT, output_units=("rad/s",)), free=FREE)


def test_one_output_that_moves_is_enough():
    record = driven(noise=0.01)
    noise = 100 * np.random.default_rng(3).standard_normal(len(record))  # no current of this motor shows in it
    both = Record(record.input, np.column_stack([record.output[:, 0], noise]), DT, output_units=("rad/s", "A"))
    fit = simulation_error(DrivenMotor(RIGID), both, free=USUAL)
    assert fit.names == USUAL
    truth = np.array([DrivenMotor(RIGID).value(name) for name in USUAL])
    assert np.all(np.abs(fit.estimate - truth) < 3 * fit.standard_error)
    assert fit.standard_error[0] < 0.1 * truth[0]
