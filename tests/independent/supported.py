"""Thirty plants to judge verdicts on: a record of one kind of input, one of another kind at 0.8 of the amplitude.

Every plant is written as its equations and integrated by small Runge–Kutta steps; none of the program's models is used.
A seed draws its parameters, its inputs and its noise. The error of the true simulator on the second record is what the
noise and the sensor leave, so no model can be expected to do better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import copysign, sin, sqrt, tanh
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from emsid.record import Record
from independent import armature
from independent.cases import axis, levels, ramps, sines
from independent.one_mass import OneMass

Array = NDArray[np.float64]
Rng = np.random.Generator
Input = Callable[[int, Rng, float], Array]
Simulate = Callable[[Array, float, Array], Array]
"""Output (N,) without noise from an input (N,), the sample time in s and factors of the parameters."""

LOWER = 0.8
"""The amplitude of the second input over that of the first."""
REST = 10
"""Samples before the input begins."""


class Pair(NamedTuple):
    """Two records of a plant.

    Attributes:
        fitted: what to identify from.
        unseen: of another kind of input.
        noise: root mean square error of the true simulator on the second one.
    """

    fitted: Record
    unseen: Record
    noise: float


@dataclass(frozen=True)
class Plant:
    """A plant and the two experiments with it.

    Attributes:
        run: simulates it.
        fitted, judged: the kinds of input.
        dt: sample time in s.
        hold: samples for which an input lasts about.
        amplitude, centre: of the input; it begins at the centre.
        noise: standard deviation over that of the first output.
        pole: of the noise.
        units: of the input and the output.
        later: simulates the second experiment, where the plant has changed meanwhile.
        samples: of each record.
    """

    run: Simulate
    fitted: Input
    judged: Input
    dt: float = 0.01
    hold: float = 40
    amplitude: float = 1.0
    centre: float = 0.0
    noise: float = 0.01
    pole: float = 0.0
    units: tuple[str, str] = ("", "")
    later: Simulate | None = None
    samples: int = 1000

    def pair(self, seed: int) -> Pair:
        """The two records of a seed."""
        rng = np.random.default_rng([23, seed])
        factors = np.exp(0.15 * rng.standard_normal(8))
        inputs, outputs = [], []
        for kind, size, run in ((self.fitted, 1.0, self.run), (self.judged, LOWER, self.later or self.run)):
            wave = np.concatenate([np.zeros(REST), kind(self.samples - REST, rng, self.hold)])
            inputs.append(self.centre + size * self.amplitude * wave)
            outputs.append(run(inputs[-1], self.dt, factors))
        sigma = self.noise * float(np.std(outputs[0]))
        white = sqrt(1 - self.pole**2) * rng.standard_normal((2, self.samples + 500))
        errors = sigma * lfilter([1.0], [1.0, -self.pole], white)[:, 500:]
        return self._pair(inputs, outputs, errors)

    def _pair(self, inputs: list[Array], outputs: list[Array], errors: Array) -> Pair:
        records = [
            Record(u, y + e, self.dt, input_units=self.units[0], output_units=self.units[1])
            for u, y, e in zip(inputs, outputs, errors, strict=True)
        ]
        return Pair(records[0], records[1], float(np.sqrt(np.mean(errors[1] ** 2))))


@dataclass(frozen=True)
class Counted(Plant):
    """A plant whose output is a position in turns of an encoder, of which differences are shown."""

    counts: float = 400.0

    def _pair(self, inputs: list[Array], outputs: list[Array], errors: Array) -> Pair:
        """The mean speed over every sample from whole counts; the position is what the plant gives."""
        shown = [np.diff(np.round(output * self.counts), prepend=0.0) / self.counts / self.dt for output in outputs]
        mean = [np.diff(output, prepend=0.0) / self.dt for output in outputs]
        return super()._pair(inputs, mean, np.array([a - b for a, b in zip(shown, mean, strict=True)]))


def two_levels(samples: int, rng: Rng, hold: float) -> Array:
    """(N,) a random binary signal."""
    wave = np.repeat(rng.choice([-1.0, 1.0], samples), np.maximum(1, rng.poisson(hold / 2, samples)))
    return wave[:samples]


def solved(
    rate: Callable[[list[float], float], list[float]], state: list[float], u: Array, dt: float, finer: int
) -> Array:
    """(N, n) states at the samples, for an input (N,) held over every sample, by the classical Runge–Kutta scheme."""
    h, states = dt / finer, np.empty((len(u), len(state)))
    for t, now in enumerate(u.tolist()):
        states[t] = state
        for _ in range(finer):
            a = rate(state, now)
            b = rate([x + 0.5 * h * v for x, v in zip(state, a, strict=True)], now)
            c = rate([x + 0.5 * h * v for x, v in zip(state, b, strict=True)], now)
            d = rate([x + h * v for x, v in zip(state, c, strict=True)], now)
            state = [x + h / 6 * (p + 2 * q + 2 * r + s) for x, p, q, r, s in zip(state, a, b, c, d, strict=True)]
    return states


def motor(u: Array, dt: float, k: Array, position: bool = False, **changes: object) -> Array:
    """Speed of a motor of 24 V with a time constant of 80 ms, 200 rad/s and Coulomb friction of 8 % of the torque.

    Args:
        u, dt, k: see `Simulate`.
        position: gives the position in turns.
        changes: of `OneMass`.
    """
    gain, level = 100.0 * k[0], 190.0 * k[1]
    usual = {"gain": gain, "damping": 12.0 * k[2], "coulomb": (level, level), "smooth": 0.05}
    found = OneMass(**{**usual, **changes}).run(u, dt)[int(position)][: len(u)]  # type: ignore[arg-type]
    return found / (2 * np.pi) if position else found


def asymmetric(u: Array, dt: float, k: Array) -> Array:
    """Friction that is larger backward."""
    return motor(u, dt, k, coulomb=(150.0 * k[1], 330.0 * k[1]))


def stribeck(u: Array, dt: float, k: Array) -> Array:
    """Friction that falls by a half once the motor turns."""
    return motor(u, dt, k, coulomb=(150.0, 150.0), stribeck=(200.0 * k[3], 200.0 * k[3]), stribeck_speed=12.0)


def unbalance(u: Array, dt: float, k: Array) -> Array:
    """A mass off the axis, as large as three times the friction."""
    return motor(u, dt, k, coulomb=(90.0, 90.0), cogging=(2 * np.pi, 0.0, 300.0 * k[3]))


def fan(u: Array, dt: float, k: Array) -> Array:
    """Torque by the square of the speed."""
    return motor(u, dt, k, damping=3.0, quadratic=0.06 * k[3])


def dead_zone(u: Array, dt: float, k: Array) -> Array:
    """A drive that does nothing below 2.5 V."""
    return motor(u, dt, k, dead_zone=2.5 * k[3])


def inductive(u: Array, dt: float, k: Array) -> Array:
    """An electrical time constant of 40 ms beside a mechanical one of about 60 ms."""
    return armature.speed(u, dt, 1.0, 0.04 * k[0], 0.1 * k[1], 6e-4 * k[2], 0.05, 0.0)


def worm(u: Array, dt: float, k: Array) -> Array:
    """A worm gear: its friction is a share of what it transmits, so that braking differs from driving."""

    def rate(x: list[float], volts: float) -> list[float]:
        w, force = x[0], 100.0 * k[0] * volts
        side = tanh(w / 0.5)
        return [force - 8.0 * k[2] * w - side * (120.0 * k[1] + 0.35 * abs(force))]

    return solved(rate, [0.0], u, dt, 120)[:, 0]


def bridge(u: Array, dt: float, k: Array) -> Array:
    """A bridge whose dead time takes 2 V from the voltage against the direction of the current."""

    def rate(x: list[float], volts: float) -> list[float]:
        rest = volts - 0.12 * k[0] * x[0]
        current = copysign(max(abs(rest) - 2.0 * k[3], 0.0), rest)
        return [90.0 * k[1] * current - tanh(x[0] / 0.5) * 150.0 * k[2]]

    return solved(rate, [0.0], u, dt, 60)[:, 0]


def warming(u: Array, dt: float, k: Array, first: float = 1.0, last: float = 1.35) -> Array:
    """A motor whose resistance rises over the record."""
    speeds, w, h = np.empty(len(u)), 0.0, dt / 60
    for t, volts in enumerate(u.tolist()):
        speeds[t] = w
        r = first + (last - first) * t / len(u)
        for _ in range(60):
            w += h * ((100.0 * k[0] * volts - 12.0 * k[2] * w) / r - tanh(w / 0.5) * 250.0 * k[1])
    return speeds


def shaft(u: Array, dt: float, k: Array, frequency: float = 18.0, gap: float = 0.0, load_side: bool = False) -> Array:
    """Speed of a motor that turns a load by a spring.

    Args:
        u, dt, k: see `Simulate`.
        frequency: of the resonance, in Hz.
        gap: of the backlash, in rad.
        load_side: gives the speed of the load instead.
    """
    own, load = 1e-4, 1.5e-4 * k[0]
    stiffness = (2 * np.pi * frequency) ** 2 * own * load / (own + load)
    damping = 0.06 * sqrt(stiffness * own)

    def rate(x: list[float], volts: float) -> list[float]:
        w, v, twist = x
        pressed = twist - min(max(twist, -gap / 2), gap / 2)
        torque = stiffness * pressed + (damping * (w - v) if pressed or not gap else 0.0)
        drive = 0.05 * k[1] * (volts - 0.05 * k[1] * w)
        return [
            (drive - torque - 0.006 * k[2] * tanh(w / 0.5)) / own,
            (torque - 0.008 * k[3] * tanh(v / 0.5)) / load,
            w - v,
        ]

    return solved(rate, [0.0, 0.0, 0.0], u, dt, 24)[:, int(load_side)]


def carriage(u: Array, dt: float, k: Array) -> Array:
    """Speed of a slide under a force, with a constant load and friction that differs by direction."""
    mass = OneMass(
        gain=0.4 * k[0], viscous=(6.0, 7.5 * k[1]), coulomb=(2.2, 2.8 * k[2]), offset=0.8 * k[3], smooth=2e-3
    )
    return mass.run(u, dt)[0][: len(u)]


def valve(u: Array, dt: float, k: Array) -> Array:
    """Position of a cylinder behind a valve with an overlap, whose flow has the square root of the pressure."""

    def rate(x: list[float], spool: float) -> list[float]:
        opened = copysign(max(abs(x[0]) - 0.08 * k[1], 0.0), x[0])
        flow = opened * (1.0 if opened > 0 else 0.8 * k[2])
        return [(spool - x[0]) / 0.03, 0.3 * k[0] * flow]

    return solved(rate, [0.0, 0.0], u, dt, 4)[:, 1]


def filtered(u: Array, dt: float, k: Array, after: int = 0) -> Array:
    """A linear system of third order with a pair of complex poles at 2.5 Hz, and a dead time in samples."""

    def rate(x: list[float], now: float) -> list[float]:
        omega = 15.7 * k[0]
        return [x[1], omega**2 * (x[2] - x[0]) - 0.5 * k[1] * omega * x[1], (now - x[2]) / (0.06 * k[2])]

    y = solved(rate, [0.0, 0.0, 0.0], u, dt, 2)[:, 0]
    return np.concatenate([np.zeros(after), y])[: len(u)]


def late(u: Array, dt: float, k: Array, after: int = 12) -> Array:
    """A first-order lag of 0.3 s behind a dead time in samples."""
    y = solved(lambda x, now: [(2.0 * k[0] * now - x[0]) / (0.3 * k[1])], [0.0], u, dt, 1)[:, 0]
    return np.concatenate([np.zeros(after), y])[: len(u)]


def cascade(u: Array, dt: float, k: Array, f: Callable[[Array], Array], before: bool, behind: bool) -> Array:
    """A static map with a filter before it, behind it, or both."""
    b, a = butter(2, 0.06 * k[0])
    c, d = butter(1, 0.05 * k[1])
    x = lfilter(np.r_[0.0, b], a, u) if before else u
    z = f(x)
    return np.asarray(lfilter(np.r_[0.0, c], d, z) if behind else z)


def radiating(u: Array, dt: float, k: Array) -> Array:
    """Temperature above 300 K of a body that radiates."""

    def rate(x: list[float], power: float) -> list[float]:
        hot = 300.0 + x[0]
        return [6.0 * k[0] * power - 0.01 * k[1] * x[0] - 8e-11 * k[2] * (hot**4 - 300.0**4)]

    return solved(rate, [0.0], u, dt, 4)[:, 0]


def heating(u: Array, dt: float, k: Array) -> Array:
    """Temperature of two bodies that exchange heat, linear."""

    def rate(x: list[float], power: float) -> list[float]:
        return [5.0 * k[0] * power - 0.25 * k[1] * (x[0] - x[1]), 0.08 * k[2] * (x[0] - x[1]) - 0.03 * x[1]]

    return solved(rate, [0.0, 0.0], u, dt, 2)[:, 1]


def tanks(u: Array, dt: float, k: Array) -> Array:
    """Level of the lower of two tanks with free outlets."""

    def rate(x: list[float], pump: float) -> list[float]:
        upper, lower = sqrt(max(x[0], 0.0)), sqrt(max(x[1], 0.0))
        return [0.05 * k[0] * max(pump, 0.0) - 0.06 * k[1] * upper, 0.06 * k[1] * upper - 0.055 * k[2] * lower]

    start = (0.05 * k[0] * float(u[0])) ** 2
    return solved(rate, [start / (0.06 * k[1]) ** 2, start / (0.055 * k[2]) ** 2], u, dt, 2)[:, 1]


def hardening(u: Array, dt: float, k: Array) -> Array:
    """A mass on a spring that grows stiff."""
    omega = 12.0 * k[0]

    def rate(x: list[float], force: float) -> list[float]:
        return [x[1], omega**2 * (force - x[0] - 1.5 * k[1] * x[0] ** 3) - 0.5 * k[2] * omega * x[1]]

    return solved(rate, [0.0, 0.0], u, dt, 2)[:, 0]


def pendulum(u: Array, dt: float, k: Array) -> Array:
    """Angle of a pendulum that a torque lifts to about 60 degrees."""

    def rate(x: list[float], torque: float) -> list[float]:
        return [x[1], 75.0 * k[0] * (torque - sin(x[0])) - 5.0 * k[1] * x[1]]

    return solved(rate, [0.0, 0.0], u, dt, 2)[:, 0]


def slewing(u: Array, dt: float, k: Array) -> Array:
    """A lag whose actuator moves at a limited rate."""

    def rate(x: list[float], now: float) -> list[float]:
        return [min(max((now - x[0]) / 0.02, -4.0 * k[0]), 4.0 * k[0]), (x[0] - x[1]) / (0.15 * k[1])]

    return solved(rate, [0.0, 0.0], u, dt, 10)[:, 1]


@dataclass(frozen=True)
class Moved:
    """An axis under a position controller: its command and its position."""

    drifts: bool = False

    def pair(self, seed: int) -> Pair:
        """The two records of a seed."""
        case = axis(500 + seed, self.drifts, 2_000, LOWER)
        return Pair(case.fitted, case.unseen, case.error_of_truth(case.unseen))


VOLTS = {"amplitude": 24.0, "units": ("V", "rad/s")}


def of_motor(run: Simulate, fitted: Input = levels, judged: Input = ramps, **others: object) -> Plant:
    """A motor of 24 V whose speed is shown."""
    return Plant(run, fitted, judged, **{**VOLTS, **others})  # type: ignore[arg-type]


def with_map(f: Callable[[Array], Array], before: bool, behind: bool, fitted: Input, judged: Input) -> Plant:
    """A `cascade` with 2 % noise."""
    run = partial(cascade, f=f, before=before, behind=behind)
    return Plant(run, fitted, judged, hold=25, noise=0.02)


PLANTS: dict[str, Plant | Moved] = {
    "motor": of_motor(motor),
    "asymmetric friction": of_motor(asymmetric),
    "worm gear": of_motor(worm),
    "backlash": of_motor(partial(shaft, gap=0.3), dt=4e-3, hold=60),
    "dead time of a bridge": of_motor(bridge, judged=sines),
    "drifting resistance": of_motor(warming, later=partial(warming, first=1.35, last=1.35)),
    "unbalance": of_motor(unbalance, noise=0.005),
    "encoder": Counted(partial(motor, position=True), levels, ramps, amplitude=24.0, units=("V", "rad/s"), noise=0.0),
    "electrical time constant": of_motor(inductive, judged=sines),
    "Stribeck": of_motor(stribeck),
    "dead zone": of_motor(dead_zone, sines, levels),
    "fan": of_motor(fan),
    "binary motor": of_motor(motor, two_levels, ramps),
    "slide": Plant(carriage, levels, ramps, dt=5e-3, hold=100, amplitude=60.0, units=("N", "m/s")),
    "axis": Moved(),
    "axis with drift": Moved(drifts=True),
    "two masses, 18 Hz": of_motor(shaft, dt=5e-3, hold=60),
    "two masses, 60 Hz": of_motor(partial(shaft, frequency=60.0), dt=2e-3, hold=80),
    "valve": Plant(valve, levels, sines, noise=0.005),
    "linear, white": Plant(filtered, levels, sines, noise=0.05),
    "linear, coloured": Plant(filtered, sines, levels, noise=0.05, pole=0.95),
    "binary thermal": Plant(heating, two_levels, levels, dt=1.0, amplitude=0.5, centre=1.0, noise=0.01),
    "saturation": with_map(lambda x: np.clip(x, -0.45, 0.45), True, True, levels, sines),
    "Hammerstein": with_map(lambda x: np.sign(x) * np.maximum(np.abs(x) - 0.25, 0), False, True, levels, sines),
    "Wiener": with_map(lambda x: x + 0.5 * x**2 + 0.3 * x**3, True, False, levels, sines),
    "radiation": Plant(radiating, levels, sines, dt=2.0, amplitude=1.0, centre=1.2, hold=60),
    "tanks": Plant(tanks, levels, sines, dt=4.0, amplitude=2.0, centre=3.0, hold=40, noise=0.02),
    "dead time": Plant(late, levels, sines, hold=60, noise=0.03),
    "dead time, third order": Plant(partial(filtered, after=8), sines, levels, noise=0.03),
    "hardening spring": Plant(hardening, levels, sines, noise=0.01),
    "pendulum": Plant(pendulum, levels, sines, amplitude=0.8, units=("N·m", "rad")),
    "limited rate": Plant(slewing, levels, sines, noise=0.01),
}
"""The plants by name."""
