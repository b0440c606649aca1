"""How much narrower intervals a designed experiment gives than a multisine of the same amplitude and duration.

python bench/design.py [SEEDS]

The motors are simulated here, in small fixed steps. What the fits keep, resistance and viscous friction, is not what
the motors have. Every motor is fitted to a first record, the experiment is designed on this fit, and the motor is run
with the design and with multisines; the fits to both give the intervals.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from numpy.typing import NDArray

import emsid
from emsid.excitation import SIGNALS

Array = NDArray[np.float64]
DT, PARTS, LIMIT, DURATION, NOISE = 5e-3, 25, 12.0, 20.0, 0.2
FREE = (
    "motor_constant",
    "rotor_inertia",
    "rotor_friction.coulomb",
    "rotor_friction.stribeck",
    "rotor_friction.stribeck_rate",
    "voltage_dead_zone.half_width",
)
WANTED = ("rotor_friction.coulomb", "voltage_dead_zone.half_width")
MULTISINES = 3
"""Multisines of random phases, whose mean width is compared."""


def simulated(voltage: Array, of: dict[str, float], rng: np.random.Generator) -> emsid.Record:
    """The record of a motor with Coulomb and Stribeck friction and a dead zone, by steps of Euler's method."""
    speed, read, h = 0.0, np.empty(len(voltage)), DT / PARTS
    for k, command in enumerate(voltage.tolist()):
        read[k] = speed
        volts = max(abs(command) - of["zone"], 0.0) * (1.0 if command > 0 else -1.0)
        for _ in range(PARTS):
            torque = of["K"] * (volts - of["K"] * speed) / of["R"] - of["B"] * speed
            level = of["coulomb"] + of["stribeck"] * 2.718281828459045 ** (-of["rate"] * abs(speed))
            free = speed + h / of["J"] * torque
            speed = max(abs(free) - h * level / of["J"], 0.0) * (1.0 if free > 0 else -1.0)
    output = read + NOISE * rng.standard_normal(len(read))
    names = {"input_names": ("voltage",), "output_names": ("speed",)}
    return emsid.Record(voltage, output, DT, input_units=("V",), output_units=("rad/s",), **names)


def gains(seed: int) -> tuple[dict[str, float], float]:
    """Of a motor, by how many times the interval of every wanted parameter is narrower, and the predicted gain."""
    rng = np.random.default_rng(seed)
    usual = {"R": 2.3, "K": 0.05, "J": 5e-5, "B": 3e-5, "coulomb": 0.02, "stribeck": 0.008, "rate": 0.5, "zone": 0.5}
    of = {name: value * float(np.exp(0.15 * rng.standard_normal())) for name, value in usual.items()}
    plant = emsid.plants.rigid_motor()
    known = {"resistance": 2.0, "rotor_viscous": 1e-5}
    first = simulated(SIGNALS["sines"](1200, DT, 8.0, rng), of, rng)
    fit = emsid.fit(plant, first, free=FREE, fixed=known)
    found = emsid.design(fit, limit=LIMIT, duration=DURATION, dt=DT, wanted=WANTED, seed=seed)

    def widths(voltage: Array) -> Array:
        again = emsid.fit(fit.model.plant, simulated(voltage, of, rng), free=FREE, fixed=known)
        return np.array([again[name].standard_error for name in WANTED])

    samples = len(found.record.input)
    rivals = [
        widths(SIGNALS["multisine"](samples, DT, LIMIT, np.random.default_rng(1000 + seed + 100 * k)))
        for k in range(MULTISINES)
    ]
    narrower = np.mean(rivals, axis=0) / widths(found.record.input[:, 0])
    predicted = found.standard["multisine"].size / found.best.size
    return dict(zip(WANTED, narrower.tolist(), strict=True)), predicted


if __name__ == "__main__":
    every = []
    for seed in range(int(sys.argv[1]) if len(sys.argv) > 1 else 20):
        begun = time.perf_counter()
        narrower, predicted = gains(seed)
        every.append([*narrower.values(), predicted])
        print(seed, *(f"{each:.2f}" for each in every[-1]), f"{time.perf_counter() - begun:.0f} s", flush=True)
    least, median, most = np.quantile(every, [0.0, 0.5, 1.0], axis=0)
    for name, *row in zip((*WANTED, "predicted, of both"), least, median, most, strict=True):
        print(f"{name}: {row[0]:.2f} to {row[2]:.2f}, median {row[1]:.2f}")
