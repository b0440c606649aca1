"""Plants, commands and simulated records that several test files share."""

import numpy as np

from emsid.models.plants.drive import Drive
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor
from emsid.plant import Motor
from emsid.record import Record

DT = 5e-3
T = DT * np.arange(2000)
VOLTAGE = 3 * np.sin(2 * np.pi * 0.4 * T) + 2 * np.sin(2 * np.pi * 1.3 * T)
LEVELS = np.repeat(np.random.default_rng(0).uniform(-12, 12, 80), 20)  # steps, each held for 20 samples
RIGID = Motor(inductance=0.0).rigid()
SPEED = (Signal.SPEED,)
USUAL = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")
LATE = DrivenMotor(RIGID, Drive(delay=1.4 * DT), Sensor(ratio=30.0, lag=4 * DT))


def record_of(plant, command=VOLTAGE, noise=0.0, seed=0, unit="rad/s", signals=SPEED):
    """A record of the plant from rest; the noise is a standard deviation in the unit of the output."""
    output = plant.simulate(command[:, None], DT, np.zeros(plant.states), signals)
    output = output + noise * np.random.default_rng(seed).standard_normal(output.shape)
    return Record(command, output, DT, output_units=(unit,) * len(signals))


def driven(drive=Drive(), noise=0.1, signals=(Signal.SPEED,), motor=RIGID):  # noqa: B008  (frozen)
    """A record of one mass from rest, driven by LEVELS; the noise is a share of the output's standard deviation."""
    plant = DrivenMotor(motor, drive)
    output = plant.simulate(LEVELS[:, None], DT, np.zeros(2), signals)
    output = output + noise * np.std(output, axis=0) * np.random.default_rng(1).standard_normal(output.shape)
    units = {Signal.SPEED: "rad/s", Signal.CURRENT: "A"}
    return Record(LEVELS, output, DT, output_units=tuple(units[signal] for signal in signals))


def codes(fit):
    """The codes of its findings, in their order."""
    return [finding.code for finding in fit.findings]


def rms(error):
    """The root mean square."""
    return float(np.sqrt(np.mean(error**2)))


def two_sines(n: int, dt: float, volts: float = 2.0) -> np.ndarray:
    """(n,) a voltage that turns a motor to and fro."""
    t = dt * np.arange(n)
    return volts * (np.sin(2 * np.pi * 4 * t) + 0.45 * np.sin(2 * np.pi * 9 * t))
