"""Random systems of many kinds to judge a recommendation on: a record, and one of another kind of input.

The kinds are linear systems, cascades of a filter, a curve and a filter, feedback through a curve, motors and axes. The
records have 300 to 20,000 samples and noise of 0.3 to 10 %. Every third one drifts: a slow disturbance is added to the
output, or the force on the axis, of the fitted record only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from emsid.record import Record
from independent.cases import axis, levels, motor, ramps, sines
from independent.nonlinear_systems import integrated

Array = NDArray[np.float64]
Rng = np.random.Generator


class Pair(NamedTuple):
    """Records of one system.

    Attributes:
        kind: of the system.
        fitted: what to identify from.
        unseen: a record of another kind of input.
    """

    kind: str
    fitted: Record
    unseen: Record


def curve(rng: Rng) -> Callable[[Array], Array]:
    """A static map at random: dead zone, saturation, polynomial, one-sided gain or a step of friction."""
    a, b = rng.uniform(0.1, 0.4), rng.uniform(0.4, 0.9)
    choices: list[Callable[[Array], Array]] = [
        lambda x: np.sign(x) * np.maximum(np.abs(x) - a, 0.0),
        lambda x: np.clip(x, -b, b),
        lambda x: np.tanh(x / b),
        lambda x: x + b * x**2 + a * x**3,
        lambda x: np.where(x > 0, x, b * x),
        lambda x: x + a * np.tanh(x / 0.05),
    ]
    return choices[int(rng.integers(len(choices)))]


def filter_of(rng: Rng, order: int, cut: float) -> Callable[[Array], Array]:
    """A low pass of unit gain, or one with a resonance, at a part ``cut`` of the sampling frequency."""
    if order == 2 and rng.random() < 0.5:
        pole = np.exp(2 * np.pi * cut * complex(-rng.uniform(0.15, 0.5), 1.0))
        a = np.real(np.poly([pole, pole.conjugate()]))
        return lambda u: np.asarray(lfilter([0.0, a.sum()], a, u))
    b, a = butter(order, 2 * cut)
    return lambda u: np.asarray(lfilter(np.r_[0.0, b], a, u))


def inputs(rng: Rng, samples: int, hold: float) -> tuple[Array, Array]:
    """(N,) two inputs of different kinds, the second within nine tenths of the range of the first."""
    kinds = [levels, ramps, sines]
    first, second = rng.permutation(3)[:2]
    return kinds[first](samples, rng, hold), 0.9 * kinds[second](samples, rng, hold)


def linear(rng: Rng, samples: int) -> tuple[Array, Array, Array, Array]:
    """Inputs and outputs of a linear system of order 1 to 3."""
    cut = np.exp(rng.uniform(np.log(0.005), np.log(0.05)))
    g = filter_of(rng, int(rng.integers(1, 4)), cut)
    u, v = inputs(rng, samples, float(np.clip(0.3 / cut, 8, samples / 20)))
    return u, v, g(u), g(v)


def cascade(rng: Rng, samples: int) -> tuple[Array, Array, Array, Array]:
    """Those of a static map with a filter before it, after it, or both."""
    cut = np.exp(rng.uniform(np.log(0.01), np.log(0.08)))
    before, after = (filter_of(rng, int(rng.integers(1, 3)), cut * rng.uniform(0.7, 2.0)) for _ in range(2))
    f, where = curve(rng), int(rng.integers(3))

    def run(u: Array) -> Array:
        x = f(before(u) if where != 1 else u)
        return after(x) if where != 2 else x

    u, v = inputs(rng, samples, float(np.clip(0.3 / cut, 8, samples / 20)))
    return u, v, run(u), run(v)


def feedback(rng: Rng, samples: int) -> tuple[Array, Array, Array, Array]:
    """Those of a mass with a spring and a damper, one of which is a curve."""
    omega = 2 * np.pi * np.exp(rng.uniform(np.log(0.008), np.log(0.04)))  # in rad per sample
    zeta, size, spring = rng.uniform(0.1, 0.8), rng.uniform(0.3, 3.0), rng.random() < 0.5

    def rate(x: Array, u: float) -> Array:
        extra = omega**2 * size * x[0] ** 3 if spring else omega**2 * 0.15 * np.tanh(x[1] / (0.02 * omega))
        return np.array([x[1], omega**2 * (u - x[0]) - 2 * zeta * omega * x[1] - extra])

    def run(u: Array) -> Array:
        return integrated(rate, np.zeros(2), np.repeat(u, 4), 1.0, 4)[:, 0]

    u, v = inputs(rng, samples, float(np.clip(2 / omega, 8, samples / 20)))
    return u, v, run(u), run(v)


KINDS = {"linear": linear, "cascade": cascade, "feedback": feedback}
PLANTS = ("motor", "axis")


def pair(seed: int, shortest: float = 300, longest: float = 20_000) -> Pair:
    """System number ``seed``; the kinds take turns.

    Args:
        seed: of everything.
        shortest, longest: numbers of samples, between which every length is drawn with the same relative chance.
    """
    rng = np.random.default_rng([11, seed])
    samples = int(np.exp(rng.uniform(np.log(shortest), np.log(longest))))
    kind = (*KINDS, *PLANTS)[seed % (len(KINDS) + len(PLANTS))]
    drifts = rng.random() < 1 / 3
    noise = np.exp(rng.uniform(np.log(0.003), np.log(0.1)))
    if kind in PLANTS:
        case = motor(1000 + seed, samples) if kind == "motor" else axis(1000 + seed, drifts, samples)
        units = (("N",), ("m",)) if case.shows_position else (("V",), ("rad/s",))
        fitted, unseen = (
            replace(each, input_units=units[0], output_units=units[1]) for each in (case.fitted, case.unseen)
        )
        if kind == "motor" and drifts:
            fitted = replace(fitted, output=fitted.output + drift(rng, fitted.output))
        return Pair(f"{kind}{', drift' * drifts}", fitted, unseen)
    u, v, y, z = KINDS[kind](rng, samples)
    if rng.random() < 0.5:
        sigma = noise * np.std(y)
        e = [lfilter([np.sqrt(1 - 0.81)], [1, -0.9], rng.standard_normal(samples)) for _ in range(2)]
    else:
        sigma, e = noise * np.std(y), [rng.standard_normal(samples) for _ in range(2)]
    offset = rng.uniform(-1, 1) * np.std(y)
    y = y + offset + sigma * e[0]
    if drifts:
        y = y + drift(rng, y)[:, 0] if y.ndim > 1 else y + drift(rng, y[:, None])[:, 0]
    return Pair(f"{kind}{', drift' * drifts}", Record(u, y, 0.01), Record(v, z + offset + sigma * e[1], 0.01))


def drift(rng: Rng, output: Array) -> Array:
    """(N, 1) a random walk of 5 % of the standard deviation of an output."""
    walk = np.cumsum(rng.standard_normal(len(output)))
    return np.asarray(0.05 * np.std(output) * ((walk - walk.mean()) / np.std(walk))[:, None])
