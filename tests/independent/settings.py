"""Adverse settings of one motor: records of it whose noise, sensor or input is not what an estimator would like.

Every setting simulates the same motor by `OneMass` and shows its speed. Its inputs are levels of random height that are
held for a while, and slow sines on top of them that change at every sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from emsid.record import Record
from independent.one_mass import FINE, OneMass

Array = NDArray[np.float64]

RESISTANCE = 1.0
TRUTH: Mapping[str, float] = {
    "motor_constant": 0.05,
    "rotor_inertia": 2.5e-4,
    "rotor_friction.coulomb": 6e-3,
    "voltage_dead_zone.half_width": 0.4,
}
"""The motor: V·s/rad, kg·m², N·m and V. Its time constant is 0.1 s."""
DT = 5e-3


def mass_of(truth: Mapping[str, float]) -> OneMass:
    """The same motor divided by its inertia."""
    constant, inertia, level, width = truth.values()
    return OneMass(
        gain=constant / RESISTANCE / inertia,
        damping=constant**2 / RESISTANCE / inertia,
        coulomb=(level / inertia, level / inertia),
        dead_zone=width,
        smooth=5e-3,
    )


@dataclass(frozen=True)
class Setting:
    """How a record is made.

    Attributes:
        noise: standard deviation of the noise on the speed, in rad/s.
        pole: of the noise.
        quantum: step of the speed, in rad/s.
        counts: counts per radian of an encoder whose differences are the speed; 0 for a tachometer.
        continuous: whether the input is a sum of sines that go on between the samples.
        changes: what differs of the motor.
        resistance: the value that a fit is given.
    """

    noise: float = 0.5
    pole: float = 0.0
    quantum: float = 0.0
    counts: float = 0.0
    continuous: bool = False
    changes: Mapping[str, float] = field(default_factory=dict)
    resistance: float = RESISTANCE

    @property
    def truth(self) -> dict[str, float]:
        """The parameters of the motor."""
        return {**TRUTH, **self.changes}

    def record(self, seed: int, samples: int = 1500) -> Record:
        """One record."""
        rng = np.random.default_rng([3, seed])
        command, within = _sines(rng, samples) if self.continuous else levels(rng, samples)
        speed, position = (each[:samples] for each in mass_of(self.truth).run(within, DT))
        if self.counts:
            counted = np.round((position + self.noise / self.counts * rng.standard_normal(samples)) * self.counts)
            speed = np.diff(counted, prepend=counted[0]) / self.counts / DT
        else:
            white = np.sqrt(1 - self.pole**2) * rng.standard_normal(samples + 200)
            speed = speed + self.noise * lfilter([1.0], [1.0, -self.pole], white)[200:]
        if self.quantum:
            speed = self.quantum * np.round(speed / self.quantum)
        return Record(command, speed, DT, input_units=("V",), output_units=("rad/s",))


def levels(rng: np.random.Generator, samples: int) -> tuple[Array, Array]:
    """(N,) volts held over every sample: levels and a sine on them."""
    t = np.arange(samples) * DT
    levels = np.repeat(rng.uniform(-2, 2, samples // 50 + 1), 50)[:samples]
    volts = 3 * np.sin(2 * np.pi * 0.4 * t + rng.uniform(0, 6)) + levels
    return volts, volts


def _sines(rng: np.random.Generator, samples: int) -> tuple[Array, Array]:
    """(N,) volts at the samples, and (N, FINE) in the middle of every part of a sample."""
    frequency, phase = rng.uniform(0.2, 4.0, 6), rng.uniform(0, 6.28, 6)

    def volts(t: Array) -> Array:
        waves = np.sin(2 * np.pi * frequency[:, None] * t + phase[:, None])
        return np.minimum(t / 0.2, 1.0) * 1.6 * waves.sum(axis=0)

    t = np.arange(samples * FINE) + 0.5
    return volts(np.arange(samples) * DT), volts(t / FINE * DT).reshape(samples, FINE)


SETTINGS: Mapping[str, Setting] = {
    "white": Setting(),
    "coloured": Setting(pole=0.9),
    "quantised": Setting(noise=0.2, quantum=2.0),
    "encoder": Setting(noise=0.3, counts=500.0),
    "continuous input": Setting(continuous=True),
    "absent dead zone": Setting(changes={"voltage_dead_zone.half_width": 0.0}),
    "wrong fixed value": Setting(resistance=1.1),
}
"""The settings by name."""
