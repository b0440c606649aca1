"""Sections of a test signal: short pieces from rest to rest, from which a design is put together.

A section is a shape, its size and its number of cycles. Every shape has no mean, so that a plant that is alike in both
directions returns to where it began, and ends with a pause in which it stops.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PAUSE = 0.05
"""The part of a section at its end at zero."""
SIZES = 10
"""Sizes of the library, from the break-away level to the limit, in equal ratios."""
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
    """A section.

    Attributes:
        shape: of one cycle.
        size: of the command.
        cycles: in the section.
        warp: exponent of time, ≠ 1 for cycles that get slower (> 1: faster).
    """

    shape: Callable[[Array], Array]
    size: float
    cycles: float
    warp: float = 1.0

    def signal(self, samples: int) -> Array:
        """(samples,) the command."""
        moving = max(round((1 - PAUSE) * samples), 1)
        phase = self.cycles * ((np.arange(moving) + 0.5) / moving) ** self.warp
        return np.concatenate([self.size * self.shape(phase), np.zeros(samples - moving)])

    def varied(self, rng: np.random.Generator, largest: float) -> Section:
        """A section near this one."""
        spread = float(rng.choice([0.05, 0.2, 0.6]))
        size = min(self.size * float(np.exp(spread * rng.standard_normal())), largest)
        cycles = max(1.0, round(2 * self.cycles * float(np.exp(spread * rng.standard_normal()))) / 2)
        warp = float(np.clip(self.warp * np.exp(0.3 * spread * rng.standard_normal()), 0.5, 2.0))
        shape = SHAPES[int(rng.integers(len(SHAPES)))] if rng.random() < 0.2 else self.shape
        return replace(self, shape=shape, size=size, cycles=cycles, warp=warp)


def library(least: float, largest: float, most_cycles: float) -> Iterator[Section]:
    """Sections of every shape, size and number of cycles.

    Args:
        least, largest: sizes of the command.
        most_cycles: in a section.
    """
    sizes = np.geomspace(min(least, largest), largest, SIZES).tolist()
    for shape in SHAPES:
        for size in sizes:
            for cycles in CYCLES:
                if cycles <= max(most_cycles, 1.0):
                    yield Section(shape, size, cycles)
