r"""Cogging: a force that repeats with position, caused by slots of a motor or turns of a screw.

Its period is found without a simulation. With all signals smoothed, the acceleration of one mass is linear in the
command, the speed and the direction. What this regression leaves is correlated with exp(2πi·x/P) for many periods P, of
which the travel has many; those with the largest correlation are the starts, with the motion from a regression with the
wave. A search from another period would not find it. Schwarz's criterion, with the number of independent errors of this
regression, says whether there is a wave at all: of simulated motors it prefers one by 240 and more where there is
cogging, and none by 7 where there is none.

Of a measured speed the position is the integral, from zero at the start of the record. So the record must be one
segment, as the position at the start of another one is not known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.motion_regression import motion_rows, smoothed, solved
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.starts import after_drive
from emsid.record import Record
from emsid.selection.improvement import schwarz_gain

Array = NDArray[np.float64]

SMOOTH = 3.0
"""Time constant of the filter, in samples."""
FEWEST_TURNS, MOST_TURNS, SPACING = 8.0, 120.0, 0.25
"""The fewest and the most periods in the whole travel that are tried, and their spacing; fewer periods look like
drift."""
TURNS = np.arange(FEWEST_TURNS, MOST_TURNS, SPACING)
STANDS_OUT = 15.0
"""A period is tried if its power is this many times the median."""
TRIED = 3
"""The most periods that are tried."""
FINER = np.linspace(-0.5, 0.5, 21)
"""Differences in turns, around each of them, that are compared in a regression."""
FEWEST = 100
"""The fewest samples in motion for a spectrum."""


def wave(
    plant: DrivenPlant, segments: Sequence[Record], signals: Sequence[Signal]
) -> tuple[Motion, tuple[float, float, float]] | None:
    """The motion of the regression with the best wave, and that wave: its period, cosine and sine.

    None if no wave stands out in the residual of a regression without one, or none is preferred to it.

    Args:
        plant: with its drive and dead zone.
        segments: the records.
        signals: of their outputs; the first one is used.
    """
    largest = max(float(np.max(np.abs(plant.drive.commands(segment.input)))) for segment in segments) or 1.0
    force = max(plant.largest_force(segment.input) for segment in segments)
    segments = after_drive(plant, [segment for segment in segments if len(segment) > 12])
    zone = next((plant.value(name) for name in plant.handles if name.endswith(".half_width")), 0.0)
    width = zone / abs(plant.drive.gain)
    is_position = signals[0] is Signal.POSITION
    tables = [motion_rows(segment, 0, is_position, SMOOTH, width, plant.drive.offset) for segment in segments]
    kept = [mask for _, mask in tables]
    if sum(int(mask.sum()) for mask in kept) < FEWEST:
        return None
    rows = np.concatenate([table for table, _ in tables])
    positions = [segment.output[:, 0] if is_position else _integral(segment) for segment in segments]
    left = rows[:, -1] - rows[:, :-1] @ np.array(solved(rows[:, :-1], rows[:, -1]))
    position = np.concatenate([x[mask] for x, mask in zip(positions, kept, strict=True)])
    travel = float(np.ptp(position))
    if not travel > 0:
        return None
    power = _power(left, position / travel)
    peaks = [k for k in np.argsort(-power) if power[k] == power[max(k - 2, 0) : k + 3].max()][:TRIED]
    tried = [TURNS[k] for k in peaks if power[k] > STANDS_OUT * np.median(power)]
    if not tried:
        return None
    turns = np.concatenate([each + FINER for each in tried])
    for part in (0.1, 0.0):
        waves = (_with_wave(rows, positions, kept, travel, each) for each in turns.tolist())
        rest, best, values = min(waves, key=lambda each: float(each[0] @ each[0]))
        turns = best + part * FINER
        if schwarz_gain(float(np.mean(rest**2)), float(np.mean(left**2)), effective_samples([rest]), 3) <= 0:
            return None
    gain, damping, coulomb, offset, cosine, sine = values
    if gain == 0:
        return None
    mass = force / largest / abs(gain)
    return Motion(gain, max(damping, 0.0), coulomb, offset, width), (travel / best, mass * cosine, mass * sine)


def _power(left: Array, way: Array) -> Array:
    """|mean(e·exp(2πi·n·s))|² for every n of `TURNS`, of an error e (N,) at places s (N,) along the travel.

    The turns are evenly spaced, so each wave is a product of the previous one and a constant factor.
    """
    wave, next_wave = np.exp(2j * np.pi * FEWEST_TURNS * way) * (left / len(left)), np.exp(2j * np.pi * SPACING * way)
    power = np.empty(len(TURNS))
    for k in range(len(TURNS)):
        power[k] = np.abs(wave.sum()) ** 2
        wave *= next_wave
    return power


def _integral(segment: Record) -> Array:
    """(N,) the integral of a measured speed, from zero."""
    speed = segment.output[:, 0]
    return np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) * segment.dt


def _with_wave(
    rows: Array, positions: Sequence[Array], kept: Sequence[NDArray[np.bool_]], travel: float, turns: float
) -> tuple[Array, float, list[float]]:
    """The residual (N,) of a regression with a wave, the number of turns in the travel, and the coefficients."""
    waves = []
    for x, mask in zip(positions, kept, strict=True):
        angle = 2 * np.pi * turns / travel * x
        waves.append(-smoothed(np.array([np.cos(angle), np.sin(angle)]), SMOOTH)[:, mask])
    matrix = np.column_stack([rows[:, :-1], *np.concatenate(waves, axis=1)])
    values = solved(matrix, rows[:, -1])
    return rows[:, -1] - matrix @ np.array(values), turns, values
