"""Settings in which a small structure is not the whole truth: what it lacks, how a sample is taken, slow noise, clocks.

In every setting a motor constant, an inertia and a Coulomb level are estimated, with two outputs the resistance too;
what else the plant has is neutral. The motor is that of `settings`, simulated by `OneMass`; with two outputs it is
`armature`, as `OneMass` shows no current.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import emsid
from emsid.record import Record
from independent import armature
from independent.one_mass import OneMass
from independent.settings import DT, RESISTANCE, TRUTH, levels, mass_of

Array = NDArray[np.float64]
Rng = np.random.Generator
FREE = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")
SAMPLES = 1500
PLAIN = replace(mass_of(TRUTH), dead_zone=0.0)
"""The motor without a dead zone."""
NOISE = 0.5
"""Standard deviation of the noise on the speed, in rad/s."""


WITHOUT_VISCOUS = {"resistance": RESISTANCE, "rotor_viscous": 0.0}
"""Else its weak prior makes intervals so wide that they hold the truth in spite of the misfit."""


class Misfit(NamedTuple):
    """A setting.

    Attributes:
        record: makes one from a generator of random numbers.
        free: the parameters that are estimated.
        known: values that are given, and right.
        truth: of the parameters.
    """

    record: Callable[[Rng], Record]
    free: tuple[str, ...] = FREE
    known: Mapping[str, float] = {"resistance": RESISTANCE}
    truth: Mapping[str, float] = TRUTH

    def fit(self, seed: int) -> emsid.Fit:
        """The small structure, fitted to one record."""
        record = self.record(np.random.default_rng([31, seed]))
        return emsid.fit(emsid.plants.rigid_motor(), record, free=self.free, fixed=self.known, search=False, threads=1)


def shown(volts: Array, speed: Array, dt: float = DT) -> Record:
    """A record of voltage and speed."""
    return Record(volts, speed, dt, input_units="V", output_units="rad/s")


def of(rng: Rng, mass: OneMass = PLAIN, noise: Callable[[Rng], Array] | None = None) -> Record:
    """A motor with white noise, or another one, on its speed."""
    volts, within = levels(rng, SAMPLES)
    speed = mass.run(within, DT)[0][:SAMPLES]
    return shown(volts, speed + (NOISE * rng.standard_normal(SAMPLES) if noise is None else noise(rng)))


def drifting(rng: Rng, grows: float = 0.2, parts: int = 30) -> Record:
    """The resistance grows over the record, from the value that is given."""
    volts, within = levels(rng, SAMPLES)
    speeds, state = [], (0.0, 0.0)
    for k, part in enumerate(np.split(np.arange(SAMPLES), parts)):
        warm = 1.0 + grows * (k + 0.5) / parts
        mass = replace(PLAIN, gain=PLAIN.gain / warm, damping=PLAIN.damping / warm)
        speed, position = mass.run(within[part], DT, state=state)
        state = float(speed[-1]), float(position[-1])
        speeds.append(speed[:-1])
    return shown(volts, np.concatenate(speeds) + NOISE * rng.standard_normal(SAMPLES))


CURRENT = {"motor_constant": 0.045, "rotor_inertia": 3e-5, "rotor_friction.coulomb": 6e-3, "resistance": 1.1}
INDUCTANCE = {"inductance": 4e-4}


def current_and_encoder(rng: Rng, dt: float = 0.01) -> Record:
    """The speed is the mean between readings of an encoder of 500 lines, the current is that at the sample."""
    volts = np.repeat(rng.uniform(-12, 12, SAMPLES // 10), 10)
    motion = armature.motion(volts, dt, 1.1, INDUCTANCE["inductance"], 0.045, 3e-5, 6e-3, 0.0)
    counts = np.round(motion.angle * 2000 / (2 * np.pi))
    speed = np.diff(counts, prepend=counts[0]) * 2 * np.pi / 2000 / dt
    current = motion.current + 0.05 * rng.standard_normal(SAMPLES)
    outputs = np.column_stack([speed, current])
    return Record(volts, outputs, dt, input_units="V", output_units=("rad/s", "A"))


def averaged_ramps(rng: Rng) -> Record:
    """Slow ramps, the speed is the mean over the sample before."""
    times = np.r_[0.0, np.cumsum(rng.uniform(80, 200, SAMPLES // 80))]
    volts = np.interp(np.arange(SAMPLES), times, np.r_[0.0, rng.uniform(-6, 6, len(times) - 1)])
    position = PLAIN.run(volts, DT)[1][:SAMPLES]
    return shown(volts, np.diff(position, prepend=0.0) / DT + NOISE * rng.standard_normal(SAMPLES))


def jittered(rng: Rng, jitter: float = 0.06) -> Record:
    """The rows are equidistant and their stamps are late by a part of the sample time, at random."""
    volts, within = levels(rng, SAMPLES)
    speed = PLAIN.run(within, DT)[0][:SAMPLES] + NOISE * rng.standard_normal(SAMPLES)
    stamps = (np.arange(SAMPLES) + rng.uniform(0, jitter, SAMPLES)) * DT
    columns = {"t": stamps, "volts": volts, "speed": speed}
    units = {"volts": "V", "speed": "rad/s"}
    return Record.from_frame(columns, input="volts", output="speed", time="t", units=units)


def coloured(rng: Rng, pole: float) -> Array:
    """(N,) noise of this pole in steady state."""
    white = rng.standard_normal(SAMPLES + 2000)
    return np.asarray(NOISE * np.sqrt(1 - pole**2) * lfilter([1.0], [1.0, -pole], white)[2000:])


def walk(rng: Rng) -> Array:
    """(N,) a random walk from zero."""
    return 0.05 * NOISE * np.cumsum(rng.standard_normal(SAMPLES))


STRIBECK = replace(PLAIN, stribeck=(4e-3 / TRUTH["rotor_inertia"],) * 2, stribeck_speed=8.0)
MISFITS: dict[str, Misfit] = {
    "no dead zone": Misfit(of),
    "dead zone, not modelled": Misfit(partial(of, mass=mass_of(TRUTH))),
    "Stribeck, not modelled": Misfit(partial(of, mass=STRIBECK), known=WITHOUT_VISCOUS),
    "resistance drifts": Misfit(drifting),
    "current and averaged speed": Misfit(current_and_encoder, tuple(CURRENT), INDUCTANCE, CURRENT),
    "averaged, slow ramps": Misfit(averaged_ramps),
    "AR(1), pole 0.99": Misfit(partial(of, noise=partial(coloured, pole=0.99))),
    "random walk": Misfit(partial(of, noise=walk)),
    "jittered stamps": Misfit(jittered),
}
"""The settings by name."""
