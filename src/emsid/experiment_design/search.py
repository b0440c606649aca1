"""The search for a test signal: the best sections of a library, and then sections near them.

**Sections.** A test signal is put together from sections, short pieces from rest to rest. A section is a shape, its
size and its number of cycles. Every shape has no mean, so that a plant that is alike in both directions returns to
where it began, and ends with a pause in which it stops.

**The search.** The information of an experiment is nearly the sum of that of its sections, as each begins and ends at
rest. For a fixed number of sections, an exchange puts in the place of each the one of the library that lowers the
criterion most, until no exchange does. Then sections near the chosen ones are tried. With relative parameters the
criteria of the wanted ones are

    A:  trace of their covariance,           D:  logarithm of its determinant.

References:
    Fedorov, *Theory of Optimal Experiments* (1972), on the exchange.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from emsid.experiment_design.information import Sensitivities, covariance_of
from emsid.experiment_design.limits import Limits

Array = NDArray[np.float64]

PAUSE = 0.05
"""The part of a section at its end at zero."""
SIZES = 10
"""Sizes of the library, from the break-away level to the limit, in equal ratios; shared by several inputs."""
CYCLES = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Cycles in a section."""


def triangle(phase: Array) -> Array:
    """Slow passes through zero: dead zone and break-away."""
    return np.asarray(4 * np.abs((phase - 0.25) % 1.0 - 0.5) - 1.0)


def square(phase: Array) -> Array:
    """Steps from one direction to the other: inertia."""
    return np.where(phase % 1.0 < 0.5, 1.0, -1.0)


def steps(phase: Array) -> Array:
    """Up and down with a stop between: break-away, steady speed, coming to rest."""
    at = phase % 1.0
    return np.where(at < 0.25, 1.0, np.where((at >= 0.5) & (at < 0.75), -1.0, 0.0))


def stairs(phase: Array) -> Array:
    """Two levels each way: steady speeds, which separate damping from friction."""
    at = phase % 1.0
    level = np.where((at % 0.5) < 0.25, 1.0, 0.5)
    return np.where(at < 0.5, level, -level)


def pulses(phase: Array) -> Array:
    """Short kicks, after which it coasts."""
    at = phase % 1.0
    return np.where(at < 0.1, 1.0, np.where((at >= 0.5) & (at < 0.6), -1.0, 0.0))


def sine(phase: Array) -> Array:
    """A smooth course."""
    return np.asarray(np.sin(2 * np.pi * phase))


def two_sines(phase: Array) -> Array:
    """A slow sine with a fast one on it, which keeps it moving."""
    return np.asarray(0.6 * np.sin(2 * np.pi * phase) + 0.4 * np.sin(2 * np.pi * 7 * phase))


SHAPES: tuple[Callable[[Array], Array], ...] = (triangle, square, steps, stairs, pulses, sine, two_sines)


@dataclass(frozen=True)
class Section:
    """A short piece of a test signal, from rest to rest.

    Attributes:
        shape: of one cycle.
        size: of the command.
        cycles: in the section.
        warp: exponent of time, ≠ 1 for cycles that get slower (> 1: faster).
        input: the place of the command that it is of; the others are zero.
    """

    shape: Callable[[Array], Array]
    size: float
    cycles: float
    warp: float = 1.0
    input: int = 0

    def signal(self, samples: int, inputs: int) -> Array:
        """(samples, inputs) the commands."""
        moving = max(round((1 - PAUSE) * samples), 1)
        phase = self.cycles * ((np.arange(moving) + 0.5) / moving) ** self.warp
        found = np.zeros((samples, inputs))
        found[:moving, self.input] = self.size * self.shape(phase)
        return found

    def varied(self, rng: np.random.Generator, largest: float) -> Section:
        """A section near this one."""
        spread = float(rng.choice([0.05, 0.2, 0.6]))
        size = min(self.size * float(np.exp(spread * rng.standard_normal())), largest)
        cycles = max(1.0, round(2 * self.cycles * float(np.exp(spread * rng.standard_normal()))) / 2)
        warp = float(np.clip(self.warp * np.exp(0.3 * spread * rng.standard_normal()), 0.5, 2.0))
        shape = SHAPES[int(rng.integers(len(SHAPES)))] if rng.random() < 0.2 else self.shape
        return replace(self, shape=shape, size=size, cycles=cycles, warp=warp)


def library(least: float, largest: float, most_cycles: float, inputs: int) -> Iterator[Section]:
    """Sections of every shape, size and number of cycles, on every input.

    Args:
        least, largest: sizes of the command.
        most_cycles: in a section.
        inputs: how many there are; the number of sections is about the same for all.
    """
    sizes = np.geomspace(min(least, largest), largest, max(SIZES // inputs, 3)).tolist()
    for shape, size, cycles, input in product(SHAPES, sizes, CYCLES, range(inputs)):
        if cycles <= max(most_cycles, 1.0):
            yield Section(shape, size, cycles, input=input)


Criterion = Callable[[Array, Array], Array]

SECTIONS = 8
"""Sections of a signal: enough to mix three kinds in any ratio."""
TRIALS = 300
"""Sections near the chosen ones that are tried."""
SWEEPS = 20
"""The most rounds of exchanges; they end after three or four."""


def a_optimal(information: Array, wanted: Array) -> Array:
    """The mean square of the relative standard errors of the wanted parameters, of (…, p, p) information."""
    covariance = covariance_of(information)
    return np.asarray(np.mean(np.diagonal(covariance, axis1=-2, axis2=-1)[..., wanted], axis=-1))


def d_optimal(information: Array, wanted: Array) -> Array:
    """The geometric mean of the variances along the axes of the wanted parameters' region."""
    block = covariance_of(information)[..., wanted[:, None], wanted]
    _, logarithm = np.linalg.slogdet(block)
    return np.asarray(np.exp(logarithm / len(wanted)))


CRITERIA: dict[str, Criterion] = {"a": a_optimal, "d": d_optimal}


@dataclass(frozen=True, eq=False)
class _Tried:
    section: Section
    signal: Array
    information: Array


def searched(
    sensitivities: Sensitivities,
    limits: Limits,
    samples: int,
    least: float,
    wanted: Array,
    criterion: Criterion,
    rng: np.random.Generator,
) -> Array | None:
    """(samples, nc) the best commands found; None where no section is within the limits.

    Args:
        sensitivities: of the model.
        limits: of command and motion.
        samples: how many.
        least: the smallest size of a section, near the break-away level.
        wanted: indices of the wanted parameters.
        criterion: of `CRITERIA`.
        rng: for the sections near the chosen ones.
    """
    length, inputs = samples // SECTIONS, sensitivities.inputs

    def tried(section: Section) -> _Tried | None:
        signal = limits.scaled([sensitivities.model], section.signal(length, inputs), sensitivities.dt)
        if signal is None:
            return None
        return _Tried(section, signal, sensitivities.information(signal, wide=True))

    cycles = length / 10  # ten samples of every cycle
    pool = [each for section in library(least, limits.command, cycles, inputs) if (each := tried(section)) is not None]
    if not pool:
        return None
    chosen = _exchanged(pool, wanted, criterion)
    total = np.sum([each.information for each in chosen], axis=0)
    best = float(criterion(total, wanted))
    for _ in range(TRIALS):
        k = int(rng.integers(len(chosen)))
        other = tried(chosen[k].section.varied(rng, limits.command))
        if other is None:
            continue
        changed = total - chosen[k].information + other.information
        value = float(criterion(changed, wanted))
        if value < best:
            chosen[k], total, best = other, changed, value
    signal = np.concatenate([each.signal for each in chosen])
    return np.asarray(np.concatenate([signal, np.zeros((samples - len(signal), inputs))]))


def _exchanged(pool: Sequence[_Tried], wanted: Array, criterion: Criterion) -> list[_Tried]:
    """The sections whose sum has the best criterion, by exchange."""
    each = np.array([one.information for one in pool])
    chosen = [int(np.argmin(criterion(SECTIONS * each, wanted)))] * SECTIONS
    best = float(criterion(each[chosen].sum(axis=0), wanted))
    for _ in range(SWEEPS):
        before = best
        for k in range(SECTIONS):
            others = each[chosen].sum(axis=0) - each[chosen[k]]
            values = criterion(others + each, wanted)
            if float(values.min()) < best:
                chosen[k], best = int(np.argmin(values)), float(values.min())
        if best >= before * (1 - 1e-6):
            break
    return [pool[k] for k in chosen]
