"""How often what ``emsid identify`` shows as known is true: ``python bench/known.py [0-13] [setting …]``.

Motors with random parameters, integrated exactly: between samples the speed is a piece of an exponential for each sign.
Only the resistance is given, or nothing. A setting is what the sensor, the loop or the load adds; every parameter and
characteristic that counts as known is compared with its true value.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from math import exp, inf, log

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.signal import lfilter

import emsid
from arguments import numbers
from targets import Target, show

Array = NDArray[np.float64]
SAMPLES, DT, COUNTS = 2000, 5e-3, 2000
SETTINGS = ("white noise", "AR(1)", "counts", "averaged", "closed loop", "load", "nothing given")
LEAST = 92.0
"""The share of 95 % intervals that are to hold the truth, in percent."""


@dataclass(frozen=True)
class Truth:
    """A motor in SI units."""

    resistance: float
    constant: float
    inertia: float
    viscous: float
    coulomb: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Truth:
        """With viscous friction of up to a twentieth of the damping by the back-EMF."""
        resistance, constant = rng.uniform(0.4, 1.2), rng.uniform(0.015, 0.04)
        inertia, coulomb = rng.uniform(0.6e-5, 2e-5), rng.uniform(2e-3, 6e-3)
        return cls(resistance, constant, inertia, rng.uniform(0, 0.05) * constant**2 / resistance, coulomb)

    @property
    def values(self) -> dict[str, float]:
        """What may be known of it, by the beginning of its name."""
        damping = self.constant**2 / self.resistance + self.viscous
        volts = self.resistance * self.coulomb / self.constant
        return {
            "motor_constant": self.constant,
            "rotor_inertia": self.inertia,
            "rotor_viscous": self.viscous,
            "rotor_friction.coulomb": self.coulomb,
            "mechanical time constant": self.inertia / damping,
            "speed per volt": self.constant / self.resistance / damping,
            **dict.fromkeys(("Coulomb voltage", "voltage lost", "break-away voltage"), volts),
        }

    def run(self, u: Array, load: Array, reference: Array | None) -> tuple[Array, Array]:
        """(N,) speed and angle at the samples; with a reference of the speed, a controller changes u in place."""
        damping = self.constant**2 / self.resistance + self.viscous
        tau, speed, angle = self.inertia / damping, np.zeros(len(u)), np.zeros(len(u))
        x = a = 0.0
        for k in range(len(u)):
            speed[k], angle[k] = x, a
            if reference is not None:
                u[k] = np.clip(0.03 * (reference[k] - x) + reference[k] * self.constant + u[k] / 8, -10, 10)
            torque, left = self.constant * u[k] / self.resistance - load[k], DT
            while left > 0 and (x or abs(torque) > self.coulomb):
                sign = np.sign(x or torque)
                steady = (torque - sign * self.coulomb) / damping
                stops = tau * log((x - steady) / -steady) if x and steady * sign < 0 else inf
                step = min(left, stops)
                fades = exp(-step / tau)
                a += steady * step + (x - steady) * tau * (1 - fades)
                x = 0.0 if stops <= left else steady + (x - steady) * fades
                left -= step
        return speed, angle


def recorded(setting: str, seed: int) -> tuple[emsid.Record, Truth]:
    """A record of the motor of a seed in a setting."""
    rng = np.random.default_rng([seed, 7])
    truth = Truth.drawn(rng)
    u, t = np.repeat(rng.uniform(-8, 8, SAMPLES // 20), 20), np.linspace(0, 1, SAMPLES)
    load = 0.3 * truth.coulomb * np.sin(2 * np.pi * rng.uniform(0.5, 1.5) * t + rng.uniform(0, 6))
    reference = np.repeat(rng.uniform(-200, 200, SAMPLES // 40), 40)
    if setting == "closed loop":
        u = rng.uniform(-8, 8, SAMPLES)
    speed, angle = truth.run(u, load * (setting == "load"), reference if setting == "closed loop" else None)
    noise = 0.01 * np.std(speed) * rng.standard_normal(SAMPLES)
    if setting == "AR(1)":
        noise = lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], noise)
    y, unit = speed + noise, "rad/s"
    if setting == "counts":
        y, unit = np.round(angle * COUNTS / (2 * np.pi)) * 2 * np.pi / COUNTS, "rad"
    elif setting == "averaged":
        y = np.diff(angle, prepend=0.0) / DT + noise
    return emsid.Record(u, y, DT, input_units=("V",), output_units=(unit,)), truth


def judged(setting: str, seed: int) -> list[tuple[str, bool]]:
    """Every known quantity, and whether its interval holds the truth."""
    record, truth = recorded(setting, seed)
    fixed = None if setting == "nothing given" else {"resistance": truth.resistance}
    result = emsid.identify(record, models="rigid-motor", fixed=fixed)
    known = [(row.name, row.interval) for row in result.known if row.interval is not None]
    known += [
        (each.name, (each.value - each.half_width, each.value + each.half_width))
        for each in result.characteristics
        if each.shown and each.significant and each.half_width is not None
    ]
    found = []
    for name, interval in known:
        for begins, true in truth.values.items():
            if name.startswith(begins):
                low, high = sorted(abs(end) for end in interval)
                found.append((begins, low <= true <= high))
    return found


def main() -> None:
    """Print a line for every setting and the targets."""
    words = sys.argv[1:]
    settings = [each for each in words if each in SETTINGS] or SETTINGS
    seeds = next((numbers(each) for each in words if each not in SETTINGS), range(14))
    targets = []
    for setting in settings:
        found = [each for seed in seeds for each in judged(setting, seed)]
        inside, every = Counter(name for name, yes in found if yes), Counter(name for name, _ in found)
        print(f"{setting}: {', '.join(f'{name} {inside[name]}/{count}' for name, count in every.items())}", flush=True)
        share = 100 * inside.total() / max(every.total(), 1)
        targets.append(Target(f"{setting}: % of what is known that is true", share, LEAST, least=True))
    show(targets, Console())


if __name__ == "__main__":
    main()
