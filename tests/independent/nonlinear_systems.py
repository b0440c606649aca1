"""Simulated nonlinear systems to judge black-box models on: an oscillator, two tanks, a generator, two drives.

Every function returns records to fit and to judge on, and the standard deviation of the noise: no model does better.
The integrator is a plain Runge–Kutta scheme of its own on a finer grid; none of the program's models is used.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from emsid import Record

Array = NDArray[np.float64]


class System(NamedTuple):
    """Records of one system.

    Attributes:
        fitted: the record that a model is fitted to.
        unseen: records of another kind.
        noise: standard deviation of the measurement noise.
    """

    fitted: Record
    unseen: dict[str, Record]
    noise: float


def integrated(rate: Callable[[Array, float], Array], state: Array, input: Array, dt: float, finer: int) -> Array:
    """States (N, n) at every ``finer``-th sample of the input, by the classical Runge–Kutta scheme.

    The input is linear between the samples of the fine grid, which are ``dt / finer`` apart.
    """
    step = dt / finer
    states = np.empty((len(input) // finer, len(state)))
    for k in range(len(states) * finer):
        if k % finer == 0:
            states[k // finer] = state
        now, after = input[k], input[min(k + 1, len(input) - 1)]
        middle = 0.5 * (now + after)
        a = rate(state, now)
        b = rate(state + 0.5 * step * a, middle)
        c = rate(state + 0.5 * step * b, middle)
        d = rate(state + step * c, after)
        state = state + step / 6 * (a + 2 * b + 2 * c + d)
    return states


def band_limited(rng: np.random.Generator, samples: int, finer: int, highest: float, flat: bool) -> Array:
    """A periodic signal of unit RMS on the fine grid, with energy up to a fraction of the sampling frequency.

    Args:
        rng: for its phases, and amplitudes unless it is flat.
        samples: of the coarse grid.
        finer: samples of the fine grid for each of the coarse one.
        highest: frequency over the sampling frequency.
        flat: a multisine of random phases, or Gaussian noise.
    """
    lines = int(highest * samples)
    size = np.ones(lines) if flat else rng.rayleigh(size=lines)
    spectrum = np.zeros(samples * finer // 2 + 1, dtype=complex)
    spectrum[1 : lines + 1] = size * np.exp(2j * np.pi * rng.uniform(size=lines))
    signal = np.fft.irfft(spectrum)
    return np.asarray(signal / np.std(signal))


def others(values: tuple[float, ...], seed: int, spread: float) -> tuple[float, ...]:
    """Parameters that differ from these by factors with a standard deviation of about ``spread``."""
    rng = np.random.default_rng([seed, 1])
    return tuple(float(each) for each in np.array(values) * np.exp(spread * rng.standard_normal(len(values))))


def duffing(
    samples: int = 16_384,
    seed: int = 0,
    noise: float = 0.004,
    spread: float = 0.0,
    asymmetry: float = 0.0,
    amplitude: float = 1.0,
) -> System:
    """An oscillator with a hardening spring, excited by a multisine, by noise of growing amplitude, and by a sweep.

    y″ + 2ζω y′ + ω²(y + α y² + κ y³) = ω² u at 610 Hz with a resonance at 70 Hz. The noise of the measurement is a
    fraction ``noise`` of the output's standard deviation, α is ``asymmetry``. At an ``amplitude`` of 1.4 the sweep, of
    growing amplitude from 5 to 150 Hz, jumps from one branch of the resonance to the other.
    """
    rng, dt, finer = np.random.default_rng(seed), 1 / 610.0, 8
    omega, zeta, kappa = others((2 * np.pi * 70.0, 0.05, 6.0), seed, spread)

    def rate(x: Array, u: float) -> Array:
        force = u - x[0] - asymmetry * x[0] ** 2 - kappa * x[0] ** 3
        return np.array([x[1], omega**2 * force - 2 * zeta * omega * x[1]])

    def record(u: Array, name: str) -> tuple[Record, Array]:
        y = integrated(rate, np.zeros(2), u, dt, finer)[:, 0]
        return Record(u[::finer], y, dt, name=name), y

    size = 0.035 * amplitude
    fitted, y = record(size * band_limited(rng, samples, finer, 0.33, True), "multisine")
    growing = band_limited(rng, samples // 2, finer, 0.33, False)
    growing *= size * np.linspace(0, 1, len(growing)) * 1.6
    other, _ = record(size * band_limited(rng, samples // 4, finer, 0.33, True), "another multisine")
    judge, _ = record(growing, "growing noise")
    grown = np.arange(samples * finer) / (samples * finer)
    turns = samples * dt * (5 * grown + (150 - 5) * grown**2 / 2)
    sweep, _ = record(2 * size * grown * np.sin(2 * np.pi * turns), "growing sweep")
    sigma = noise * float(np.std(y))
    return System(_noisy(fitted, sigma, rng), {r.name: _noisy(r, sigma, rng) for r in (other, judge, sweep)}, sigma)


def tanks(samples: int = 1024, seed: int = 0, noise: float = 0.1, spread: float = 0.0) -> System:
    """Two tanks above one another, both of which overflow; the level of the lower one in V is measured.

    The levels follow x₁′ = −k√x₁ + p·u and x₂′ = k√x₁ − k√x₂ and end at 10; some of what the upper tank loses falls
    into the lower one.
    """
    rng, dt, finer = np.random.default_rng(seed), 4.0, 8
    between, out, pump, caught = others((0.06, 0.055, 0.05, 0.3), seed, spread)

    def rate(x: Array, u: float) -> Array:
        upper, lower = np.sqrt(max(x[0], 0.0)), np.sqrt(max(x[1], 0.0))
        first = -between * upper + pump * u
        lost = max(first, 0.0) if x[0] >= 10 else 0.0
        second = between * upper - out * lower + caught * lost
        if x[1] >= 10:
            second = min(second, 0.0)
        return np.array([first - lost, second])

    def record(name: str) -> Record:
        u = np.clip(3.2 + 1.5 * band_limited(rng, samples, finer, 0.05, True), 0, 10)
        y = integrated(rate, np.array([5.0, 5.0]), u, dt, finer)[:, 1]
        return _noisy(Record(u[::finer], np.minimum(y, 10.0), dt, name=name), noise, rng)

    fitted, other = record("one realisation"), record("another realisation")
    return System(fitted, {other.name: other}, noise)


def generator(samples: int = 500, seed: int = 0, noise: float = 20.0, spread: float = 0.0) -> System:
    """A motor with a generator as load: dead zone and saturating magnetisation, a large offset, steps as input."""
    rng, dt, finer = np.random.default_rng(seed), 0.05, 4
    offset, limit, slow, fast = others((0.3, 3.0, 0.35, 0.05), seed, spread)

    def rate(x: Array, u: float) -> Array:
        drive = np.tanh((u - offset) / limit) * 6000.0
        return np.array([(drive - x[0]) / slow, (x[0] - x[1]) / fast])

    def record(name: str) -> Record:
        levels = rng.uniform(0.5, 4.5, size=samples // 8 + 1)
        u = np.repeat(levels, 8 * finer)[: samples * finer]
        y = integrated(rate, np.array([2000.0, 2000.0]), u, dt, finer)[:, 1] + 500.0
        return _noisy(Record(u[::finer], y, dt, name=name), noise, rng)

    fitted, other = record("one sequence"), record("another sequence")
    return System(fitted, {other.name: other}, noise)


def coupled_drives(samples: int = 500, seed: int = 0, noise: float = 0.02, spread: float = 0.0) -> System:
    """Two motors that drive a pulley on a springy belt; the sensor shows the absolute speed only."""
    rng, dt, finer = np.random.default_rng(seed), 0.02, 4
    stiffness, damping, gain, slow = others((60.0, 2.5, 3.0, 0.3), seed, spread)

    def rate(x: Array, u: float) -> Array:
        return np.array([x[1], stiffness * (gain * x[2] - x[0]) - damping * x[1], (u - x[2]) / slow])

    def record(name: str) -> Record:
        u = np.repeat(rng.choice([-1.5, -1.0, -0.5, 0.5, 1.0, 1.5], size=samples // 5 + 1), 5 * finer)
        u = u[: samples * finer] + 0.5
        y = np.abs(integrated(rate, np.zeros(3), u, dt, finer)[:, 0])
        return _noisy(Record(u[::finer], y, dt, name=name), noise, rng)

    fitted, other = record("one sequence"), record("another sequence")
    return System(fitted, {other.name: other}, noise)


def _noisy(record: Record, sigma: float, rng: np.random.Generator) -> Record:
    noise = sigma * rng.standard_normal(len(record))
    return Record(record.input, record.output[:, 0] + noise, record.dt, name=record.name)


class Simulated(Protocol):
    """Makes a system of other parameters for every seed; without ``spread`` of the usual ones."""

    def __call__(self, *, seed: int = 0, spread: float = 0.0) -> System: ...


def asymmetric(seed: int = 0, spread: float = 0.0) -> System:
    """The oscillator with a spring that is harder on one side."""
    return duffing(seed=seed, spread=spread, asymmetry=1.5)


SYSTEMS: dict[str, Simulated] = {
    "oscillator": duffing,
    "asymmetric oscillator": asymmetric,
    "two tanks": tanks,
    "generator": generator,
    "coupled drives": coupled_drives,
}
