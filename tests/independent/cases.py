"""Random motors and axes: a record to fit, a record of another kind of input to judge on, and the truth.

Ten motors show their speed in white noise; ten axes, moved by a position controller, show their position through an
encoder, and ten more do so under a slow random drift of the force. Every third or so has a Stribeck excess, a dead
zone, a delay, a bridge that coasts, a constant load, friction that differs by direction.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from emsid.record import Record
from independent.one_mass import OneMass

Array = NDArray[np.float64]


class Case(NamedTuple):
    """A plant and two experiments with it.

    Attributes:
        truth: the plant.
        fitted: a record to identify from.
        unseen: a record of another kind of input.
        shows_position: whether the output is a position, else it is a speed.
    """

    truth: OneMass
    fitted: Record
    unseen: Record
    shows_position: bool

    def error_of_truth(self, record: Record) -> float:
        """RMSE of the true parameters' free run from rest: noise and drift."""
        run = self.truth.run(record.input[:, 0], record.dt)[int(self.shows_position)][: len(record)]
        return float(np.sqrt(np.mean((record.output[:, 0] - run) ** 2)))


@cache
def motor(seed: int, samples: int = 4000) -> Case:
    """A motor: command to speed, 1 % noise."""
    rng = np.random.default_rng([1, seed])
    dt = float(rng.choice([1e-3, 2e-3, 5e-3, 1e-2]))
    time_constant = dt * np.exp(rng.uniform(np.log(3), np.log(300)))
    top, largest = np.exp(rng.uniform(np.log(5), np.log(500))), float(rng.choice([1, 12, 24, 100, 255]))
    gain = top / time_constant / largest
    level = rng.uniform(0.02, 0.12) * gain * largest
    some = rng.random(6) < (0.3, 0.3, 0.4, 0.25, 0.4, 0.3)
    truth = OneMass(
        gain=gain,
        damping=1 / time_constant,
        coulomb=(level, level * (rng.uniform(1.2, 1.6) if some[0] else 1.0)),
        stribeck=(0.5 * level, 0.5 * level) if some[1] else (0.0, 0.0),
        stribeck_speed=0.03 * top,
        dead_zone=0.06 * largest if some[2] else 0.0,
        coasting=0.9 if some[3] else 0.0,
        full=largest,
        delay=dt * rng.uniform(0.3, 2.0) if some[4] else 0.0,
        offset=0.3 * level if some[5] else 0.0,
        smooth=2e-4 * top,
    )
    hold = float(np.clip(3 * time_constant / dt, 20, samples / 20))
    inputs = levels(samples, rng, hold), (ramps if seed % 2 else sines)(samples, rng, 2 * hold)
    fitted, unseen = (
        Record(largest * u, truth.run(largest * u, dt)[0][:samples] + 0.01 * top * rng.standard_normal(samples), dt)
        for u in inputs
    )
    return Case(truth, fitted, unseen, False)


@cache
def axis(seed: int, drifts: bool, samples: int = 8000, judged: float = 1.0) -> Case:
    """An axis under position control: command to position, by an encoder of 0.2 mm with 0.3 mm noise.

    The reference of the second record is multiplied by ``judged``.
    """
    rng = np.random.default_rng([2, seed, drifts])
    dt = float(rng.choice([1e-3, 2e-3, 5e-3]))
    time_constant = dt * np.exp(rng.uniform(np.log(100), np.log(1000)))
    top, largest = 0.3, float(rng.choice([1, 10, 100]))
    gain = 3 * top / time_constant / largest
    level = rng.uniform(0.02, 0.08) * gain * largest
    some = rng.random(4) < (0.4, 0.4, 0.3, 0.5)
    truth = OneMass(
        gain=gain,
        viscous=(1 / time_constant, (1.4 if some[0] else 1.0) / time_constant),
        coulomb=(level, level * (rng.uniform(1.05, 1.2) if some[1] else 1.0)),
        stribeck=(0.3 * level, 0.3 * level) if some[2] else (0.0, 0.0),
        stribeck_speed=0.05 * top,
        offset=0.15 * level if some[3] else 0.0,
        smooth=5e-6 * top,  # at six times as much, estimates are biased by three standard errors
    )
    t = np.arange(samples)
    wave = np.sin(2 * np.pi * 5.3 * t / samples + rng.uniform(0, 6)) * np.sin(2 * np.pi * 1.7 * t / samples)
    decay = np.exp(-100 / samples)
    steps = levels(samples, rng, samples / 9)
    for _ in range(2):
        steps = lfilter([1 - decay], [1, -decay], steps)
    fitted, unseen = (
        _controlled(truth, 0.15 * reference, dt, largest, rng, 0.04 * level if drifts else 0.0)
        for reference in (wave, judged * steps)
    )
    return Case(truth, fitted, unseen, True)


def _controlled(
    truth: OneMass, reference: Array, dt: float, largest: float, rng: np.random.Generator, drift: float
) -> Record:
    """What a position controller, which looks every four samples, makes of a reference."""
    samples, every = len(reference), 4
    stiffness = 12.0 * largest
    damping = 1.6 * np.sqrt(stiffness * truth.gain) / truth.gain
    walk = np.cumsum(rng.standard_normal(samples))
    disturbance = drift * walk / np.std(walk)
    u, position = np.zeros(samples), np.zeros(samples)
    v = x = 0.0
    for first in range(0, samples, every):
        here = slice(first, min(first + every, samples))
        u[here] = np.clip(stiffness * (reference[first] - x) - damping * v, -largest, largest)
        speeds, positions = truth.run(u[here], dt, disturbance[here], (v, x))
        position[here] = positions[:-1]
        v, x = float(speeds[-1]), float(positions[-1])
    step = 2e-4
    return Record(u, step * np.round((position + 3e-4 * rng.standard_normal(samples)) / step), dt)


def levels(samples: int, rng: np.random.Generator, hold: float) -> Array:
    """(N,) levels between −1 and 1, some of them 0, each held for about so many samples."""
    u, first = np.zeros(samples), 0
    while first < samples:
        last = first + int(rng.uniform(0.5, 1.5) * hold) + 1
        u[first:last] = 0.0 if rng.random() < 0.15 else rng.uniform(-1, 1)
        first = last
    return u / np.max(np.abs(u))


def ramps(samples: int, rng: np.random.Generator, hold: float) -> Array:
    """(N,) ramps from level to level, each of which is held."""
    corners, times = [0.0], [0.0]
    while times[-1] < samples:
        level = rng.choice([-1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0]) * rng.uniform(0.7, 1)
        length = rng.uniform(0.5, 1.5) * hold + 2
        times += [times[-1] + length / 3, times[-1] + length]
        corners += [level, level]
    return np.interp(np.arange(samples), times, corners)


def sines(samples: int, rng: np.random.Generator, hold: float) -> Array:
    """(N,) thirty sines with periods from about a fifth of to ten times ``hold``, the largest value 1."""
    frequency = np.exp(rng.uniform(np.log(0.05 / hold), np.log(2.0 / hold), 30))
    phase = 2 * np.pi * (frequency[:, None] * np.arange(samples) + rng.random((30, 1)))
    u = np.sum(np.sin(phase) / np.sqrt(1 + frequency[:, None] * hold), axis=0)
    return u / np.max(np.abs(u))


KINDS: dict[str, Callable[[int], Case]] = {
    "motor": motor,
    "axis": partial(axis, drifts=False),
    "axis with drift": partial(axis, drifts=True),
}
CASES: dict[str, Callable[[], Case]] = {
    f"{kind} {k}": partial(make, k) for kind, make in KINDS.items() for k in range(10)
}
"""Thirty cases by name."""


def named(which: str) -> dict[str, Callable[[], Case]]:
    """The cases whose names begin like this, or others of one kind by their seeds: ``axis with drift 100-109``."""
    kind, _, seeds = which.rpartition(" ")
    first, several, last = seeds.partition("-")
    if kind in KINDS and several:
        return {f"{kind} {k}": partial(KINDS[kind], k) for k in range(int(first), int(last) + 1)}
    return {name: make for name, make in CASES.items() if name.startswith(which)}
