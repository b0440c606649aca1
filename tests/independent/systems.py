"""The systems of the baseline, by family: the plants of `supported`, and more of the kinds that those have few of.

Difference equations with noise inside are simulated with it and without it: the difference is the error of the true
model, which knows everything but the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import sin, sqrt, tanh
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from emsid.record import Record, concatenate
from independent.cases import levels, sines
from independent.process_noise import FIRST, SECOND, circuit
from independent.supported import LOWER, PLANTS, REST, Input, Pair, Plant, motor, of_motor, shaft, solved, with_map

Array = NDArray[np.float64]


class System(Protocol):
    """Gives two records for a seed."""

    def pair(self, seed: int) -> Pair: ...


@dataclass(frozen=True)
class Disturbed:
    """A difference equation with noise inside.

    Attributes:
        run: output (N,) from an input (N,), white noise (N,) and factors of the parameters.
        fitted, judged: the kinds of input.
        noise: standard deviation of the white noise.
        hold: samples for which an input lasts about.
        samples: of each record.
    """

    run: Callable[[Array, Array, Array], Array]
    fitted: Input
    judged: Input
    noise: float
    hold: float = 20
    samples: int = 1000

    def pair(self, seed: int) -> Pair:
        """The two records of a seed."""
        rng = np.random.default_rng([29, seed])
        factors = np.exp(0.15 * rng.standard_normal(8))
        records = []
        for kind, size in ((self.fitted, 1.0), (self.judged, LOWER)):
            u = size * np.concatenate([np.zeros(REST), kind(self.samples - REST, rng, self.hold)])
            e = self.noise * rng.standard_normal(self.samples)
            records.append(Record(u, self.run(u, e, factors), 0.01))
        errors = records[1].output[:, 0] - self.run(records[1].input[:, 0], np.zeros(self.samples), factors)
        return Pair(records[0], records[1], float(np.sqrt(np.mean(errors**2))))


@dataclass(frozen=True)
class Realisations:
    """Records of one circuit with noise inside, judged without that noise on a multisine and a sweep together.

    Attributes:
        count: of the realisations of the multisine, in steady state.
        period: samples of each.
    """

    count: int = 10
    period: int = 2048

    def pair(self, seed: int) -> Pair:
        """All realisations of a seed, and both other records."""
        made = circuit(self.count, self.period, seed=seed)
        return Pair(concatenate(made.fitted), concatenate(list(made.unseen.values())), made.noise)


def loaded(u: Array, dt: float, k: Array) -> Array:
    """A motor with a constant load, whose command acts 1.3 samples late."""
    return motor(u, dt, k, offset=150.0 * k[3], delay=1.3 * dt)


def limited_drive(u: Array, dt: float, k: Array) -> Array:
    """A motor whose drive gives no more than 14 V of 24."""
    return motor(u, dt, k, limit=14.0 * k[3])


def one_sided_drag(u: Array, dt: float, k: Array) -> Array:
    """A motor with viscous friction that is larger forward."""
    return motor(u, dt, k, damping=6.0 * k[2], viscous=(8.0 * k[3], 2.0))


def averaged(u: Array, dt: float, k: Array) -> Array:
    """A motor whose sensor shows the mean speed over every sample."""
    return 2 * np.pi * np.diff(motor(u, dt, k, position=True), prepend=0.0) / dt


def joint(u: Array, dt: float, k: Array) -> Array:
    """Angle of a joint with gravity and dry friction."""

    def rate(x: list[float], torque: float) -> list[float]:
        return [x[1], 75.0 * k[0] * (torque - sin(x[0])) - 4.0 * k[1] * x[1] - 6.0 * k[2] * tanh(x[1] / 0.05)]

    return solved(rate, [0.0, 0.0], u, dt, 20)[:, 0]


def far_side(u: Array, dt: float, k: Array) -> Array:
    """Speed of the load behind a shaft."""
    return shaft(u, dt, k, load_side=True)


def coupled(u: Array, dt: float, k: Array) -> Array:
    """Two motors on a springy belt, of which the absolute speed is shown."""

    def rate(x: list[float], now: float) -> list[float]:
        return [x[1], 60.0 * k[0] * (3.0 * k[1] * x[2] - x[0]) - 2.5 * k[2] * x[1], (now - x[2]) / (0.3 * k[3])]

    return np.abs(solved(rate, [0.0, 0.0, 0.0], u, dt, 4)[:, 0])


def overflowing(u: Array, dt: float, k: Array) -> Array:
    """Level of the lower of two tanks, both of which overflow at 10; some of what the upper one loses is caught."""

    def rate(x: list[float], pump: float) -> list[float]:
        upper, lower = sqrt(max(x[0], 0.0)), sqrt(max(x[1], 0.0))
        first = 0.05 * k[0] * max(pump, 0.0) - 0.06 * k[1] * upper
        lost = max(first, 0.0) if x[0] >= 10 else 0.0
        second = 0.06 * k[1] * upper - 0.055 * k[2] * lower + 0.3 * lost
        return [first - lost, min(second, 0.0) if x[1] >= 10 else second]

    return np.minimum(solved(rate, [5.0, 5.0], u, dt, 8)[:, 1], 10.0)


def dry(u: Array, dt: float, k: Array) -> Array:
    """A mass on a spring with dry friction."""
    omega = 12.0 * k[0]

    def rate(x: list[float], force: float) -> list[float]:
        return [x[1], omega**2 * (force - x[0] - 0.12 * k[1] * tanh(x[1] / 0.05)) - 0.3 * k[2] * omega * x[1]]

    return solved(rate, [0.0, 0.0], u, dt, 20)[:, 0]


POLES = [1.0, -1.5, 0.56]
"""Of the linear difference equations."""


def arx(u: Array, e: Array, k: Array, numerator: tuple[float, ...] = (1.0,)) -> Array:
    """A linear equation with white noise in it, or with noise of this numerator."""
    return np.asarray(lfilter([0.0, 0.04 * k[0], 0.02 * k[1]], POLES, u) + lfilter(numerator, POLES, e))


def armax(u: Array, e: Array, k: Array) -> Array:
    """The same with a moving average of the noise."""
    return arx(u, e, k, (1.0, -0.8, 0.3))


def equation(step: Callable[[Array, Array, int], float]) -> Callable[[Array, Array, Array], Array]:
    """The run of y(t) = step(y, u, t) + e(t); what is before the record is zero."""

    def run(u: Array, e: Array, k: Array) -> Array:
        y, past = np.zeros(len(u) + 2), np.concatenate([np.zeros(2), k[0] * u])
        for t in range(2, len(y)):
            y[t] = step(y, past, t) + e[t - 2]
        return y[2:]

    return run


def inner_noise(u: Array, e: Array, k: Array) -> Array:
    """Two filters around a saturation, with the noise before it."""
    return np.asarray(lfilter(*SECOND, np.clip(2.5 * k[0] * lfilter(*FIRST, u) + lfilter(*butter(2, 0.4), e), -1, 1)))


MORE: dict[str, tuple[str, System]] = {
    "load and delay": ("motors", of_motor(loaded)),
    "limited drive": ("motors", of_motor(limited_drive)),
    "one-sided drag": ("motors", of_motor(one_sided_drag, judged=sines)),
    "averaged speed": ("motors", of_motor(averaged, hold=12)),
    "joint": ("joints", Plant(joint, levels, sines, amplitude=0.9, units=("N·m", "rad"), noise=0.005)),
    "load of a shaft": ("shafts", of_motor(far_side, dt=5e-3, hold=60)),
    "ARX": ("regressions", Disturbed(arx, levels, sines, 0.003)),
    "ARMAX": ("regressions", Disturbed(armax, sines, levels, 0.005)),
    "bilinear": (
        "regressions",
        Disturbed(
            equation(lambda y, u, t: 0.75 * y[t - 1] + 0.25 * u[t - 1] + 0.2 * u[t - 1] * y[t - 1]),
            levels, sines, 0.003, hold=10,
        ),
    ),
    "polynomial": (
        "regressions",
        Disturbed(
            equation(lambda y, u, t: 0.5 * y[t - 1] - 0.1 * y[t - 2] + 0.8 * u[t - 2] + 0.3 * u[t - 1] * abs(u[t - 1])
                     - 0.1 * y[t - 1] ** 2),
            levels, sines, 0.01, hold=10,
        ),
    ),
    "rectifier": ("cascades", with_map(lambda x: np.where(x > 0, x, 0.3 * x), True, True, levels, sines)),
    "noise inside": ("cascades", Disturbed(inner_noise, sines, levels, 0.08, hold=15, samples=2000)),
    "ten realisations": ("cascades", Realisations()),
    "coupled drives": ("feedback", Plant(coupled, levels, sines, dt=0.02, hold=30)),
    "overflow": ("feedback", Plant(overflowing, levels, sines, dt=4.0, amplitude=3.0, centre=3.2, hold=20)),
    "dry oscillator": ("feedback", Plant(dry, levels, sines, noise=0.005)),
}  # fmt: skip
"""Family and system by name."""
OF_PLANTS: Mapping[str, tuple[str, ...]] = {
    "motors": ("motor", "asymmetric friction", "worm gear", "dead time of a bridge", "drifting resistance", "unbalance",
               "encoder", "electrical time constant", "Stribeck", "dead zone", "fan", "binary motor"),
    "axes": ("slide", "axis", "axis with drift"),
    "shafts": ("backlash", "two masses, 18 Hz", "two masses, 60 Hz"),
    "joints": ("pendulum",),
    "linear": ("linear, white", "linear, coloured", "binary thermal", "dead time", "dead time, third order"),
    "cascades": ("saturation", "Hammerstein", "Wiener"),
    "feedback": ("valve", "radiation", "tanks", "hardening spring", "limited rate"),
}  # fmt: skip
"""The plants of `supported` by family."""
SYSTEMS: dict[str, tuple[str, System]] = {
    **{name: (family, PLANTS[name]) for family, names in OF_PLANTS.items() for name in names},
    **MORE,
}
"""Family and system by name: all of the baseline."""
