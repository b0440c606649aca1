"""Two filters of third order around a saturation, with process noise before it: a circuit to judge cascades on.

    x = G₁u,      y = G₂ f(x + w) + e,      f(x) = max(−1, min(x, 1))

The process noise w is coloured and has a given part of the standard deviation of x. Periodic records are in steady
state. The records to judge on have no process noise, so that e alone is the error of the true model. The filters are
SciPy's; none of the program's models is used.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, cheby1, cheby2, lfilter

from emsid import Record

Array = NDArray[np.float64]

DT = 1 / 78_125.0
FIRST, SECOND = cheby1(3, 0.5, 0.12), cheby2(3, 40, 0.3)
HIGHEST = 0.19
"""The largest frequency of the inputs, as a part of the sampling frequency."""


class Circuit(NamedTuple):
    """Records of the circuit.

    Attributes:
        fitted: one record for each realisation of the multisine.
        unseen: without process noise: another multisine, and a sweep of the same level.
        noise: standard deviation of e.
        process: standard deviation of w.
    """

    fitted: list[Record]
    unseen: dict[str, Record]
    noise: float
    process: float


def circuit(
    realisations: int = 10,
    period: int = 16_384,
    periods: int = 1,
    seed: int = 0,
    process: float = 0.15,
    noise: float = 0.01,
    level: float = 1.0,
) -> Circuit:
    """Records of the circuit.

    Args:
        realisations: how many multisines.
        period: samples.
        periods: how many of each are measured, in steady state.
        seed: of the phases and the noise.
        process: standard deviation of w over that of x.
        noise: standard deviation of e over that of y.
        level: standard deviation of u.
    """
    rng = np.random.default_rng(seed)
    sigma = process * level * float(np.std(lfilter(*FIRST, multisine(rng, 16_384))[4_096:]))
    size = noise * float(np.std(output(level * multisine(rng, 16_384), 0.0, rng)))

    def record(u: Array, sigma: float, name: str, steady: bool = True) -> Record:
        once = np.concatenate([u[-period:], u]) if steady else u
        y = output(once, sigma, rng)[len(once) - len(u) :] + size * rng.standard_normal(len(u))
        return Record(u, y, DT, name=name)

    fitted = [
        record(np.tile(level * multisine(rng, period), periods), sigma, f"realisation {k + 1}")
        for k in range(realisations)
    ]
    t = np.arange(period)
    sweep = np.sqrt(2) * level * np.sin(np.pi * (HIGHEST * 0.8) / period * t**2)
    judges = [
        record(level * multisine(rng, period), 0.0, "multisine"),
        record(sweep, 0.0, "sweep", steady=False),
    ]
    return Circuit(fitted, {judge.name: judge for judge in judges}, size, sigma)


def multisine(rng: np.random.Generator, samples: int) -> Array:
    """(N,) a multisine of unit RMS and random phases, with equal amplitudes up to `HIGHEST`."""
    lines = int(HIGHEST * samples)
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[1 : lines + 1] = np.exp(2j * np.pi * rng.uniform(size=lines))
    signal = np.fft.irfft(spectrum, samples)
    return np.asarray(signal / np.std(signal))


def output(u: Array, sigma: float, rng: np.random.Generator) -> Array:
    """(N,) the output of the circuit from rest, without measurement noise."""
    white = lfilter(*butter(2, 0.4), rng.standard_normal(len(u) + 500))[500:]
    inside = lfilter(*FIRST, u) + (sigma / np.std(white) * white if sigma else 0.0)
    return np.asarray(lfilter(*SECOND, np.clip(inside, -1, 1)))
