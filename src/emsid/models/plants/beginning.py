"""The state of a plant at the start of a record, as its first samples show it.

A position keeps for ever what its start was off by, so where a model is less exact than the sensor, a free start would
be bent to make up for errors that come later. It is then taken from the first samples alone: from a polynomial of
second order through as many of them as it fits as well as their noise allows. A start that was estimated from a whole
record is believed only where it agrees with that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.record import Record

Array = NDArray[np.float64]

SAMPLES = (20, 40, 80, 160)
"""Through how many samples a polynomial is laid, at least and at most."""
WORSE = 1.5
"""A polynomial through more samples must leave no more than this many times the variance."""
AGREES = 5.0
"""By how many standard deviations an estimated start may differ from what the first samples show."""


class Beginning(NamedTuple):
    """What the first samples of a position show, as (value, standard deviation)."""

    speed: tuple[float, float]
    position: tuple[float, float]


def starts_from_samples(plant: Plant, signals: Sequence[Signal]) -> bool:
    """Whether the start of a free run can be taken from the first samples: where a position is all that is measured."""
    return plant.driven is not None and tuple(signals) == (Signal.POSITION,)


def agrees(segment: Record, speed: float, position: float) -> bool:
    """Whether a speed and a position at the start are such as the first samples of a measured position show.

    Few samples are looked at: of many, a polynomial is off by more than their noise.
    """
    seen = beginning(segment.output[: SAMPLES[0], 0], segment.dt)
    both = ((speed, *seen.speed), (position, *seen.position))
    return all(abs(found - value) <= AGREES * deviation for found, value, deviation in both)


def beginning(y: Array, dt: float) -> Beginning:
    """Speed and position at the first sample of a measured position (N,)."""
    found = Beginning((0.0, np.inf), (float(y[0]), 0.0))
    least = np.inf
    for samples in sorted({min(count, len(y)) for count in SAMPLES}):
        if samples < 4:
            break
        powers = np.vander(np.arange(samples) * dt, 3, increasing=True)
        coefficients = np.linalg.lstsq(powers, y[:samples], rcond=None)[0]
        variance = float(np.sum((powers @ coefficients - y[:samples]) ** 2)) / (samples - 3)
        if variance > WORSE * least:
            break
        least = min(least, variance)
        position, speed = np.sqrt(variance * np.diag(np.linalg.inv(powers.T @ powers)))[:2]
        found = Beginning((float(coefficients[1]), float(speed)), (float(coefficients[0]), float(position)))
    return found
