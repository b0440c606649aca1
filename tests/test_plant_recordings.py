"""Plants on real recordings: EMPS, a motor on a bridge, and a geared motor."""

from dataclasses import replace

import numpy as np
import pytest

from emsid.io import read
from emsid.models.plants.drive import Drive
from emsid.models.plants.free_run_error import Recent
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.sensor import Sensor
from emsid.plant import DeadZoneLaw, Friction
from emsid.validation.comparison import fit_percent
from simulated_plants import RIGID, rms


@pytest.fixture(scope="module")
def emps(recordings):
    """The first 60 % of the record, as force and position."""
    record = read(recordings / "emps" / "DATA_EMPS.mat", input="vir", output="qm", time="t", scale={"vir": 35.15065})
    return record.split(0.6)[0]


@pytest.mark.recordings
def test_emps_has_the_published_parameters_where_errors_are_seen_as_accelerations(emps):
    fit = simulation_error(LinearAxis(), emps, weighting=Recent(0.02, 2))
    assert fit.estimate == pytest.approx([95.1089, 203.5034, 20.3935, -3.1648], rel=0.05)


def errors(fit):
    return np.concatenate([run - record.output for run, record in zip(fit.simulated(), fit.segments, strict=True)])


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
