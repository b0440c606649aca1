"""Speeds in records: the largest speed of a mass, and the rates of Stribeck friction that its samples resolve."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.motion_regression import smoothed, speed_of
from emsid.models.plants.parameters import Signal
from emsid.record import Record

Array = NDArray[np.float64]

GONE = 3.0
"""An excess of friction is gone where it is e⁻³, 5 % of that at rest."""
WINDOWS = tuple(2**k for k in range(9))
"""Time constants in samples of the filters for changes of speed."""


def motion_channel(signals: Sequence[Signal]) -> tuple[int | None, bool]:
    """The first output that is a motion, None without one, and whether it is a position."""
    for k, signal in enumerate(signals):
        if signal is not Signal.CURRENT:
            return k, signal is Signal.POSITION
    return None, False


def top_speed(segments: Sequence[Record], channel: int, is_position: bool) -> float:
    """The largest speed of an output, without a few samples."""
    several = [segment for segment in segments if len(segment) > 1 or not is_position]
    speeds = [speed_of(segment.output[:, channel], segment.dt, is_position) for segment in several]
    return float(np.percentile(np.abs(np.concatenate(speeds)), 99)) or 1.0


def resolved_rate(segments: Sequence[Record], signals: Sequence[Signal]) -> float:
    """The largest rate of Stribeck friction that samples resolve; infinite where no motion is seen.

    With a larger rate the excess disappears within the smallest usual change of speed in the record. At larger rates
    the cost has many minima, in which single reversals stick for a few samples more or fewer.

    The change of the filtered speed over one time constant of the filter is computed. With a short time constant it is
    mostly noise; with longer ones it falls until it is mostly motion. In exact samples it is motion from the start. So
    noise that is sampled faster does not lower the rate.
    """
    channel, is_position = motion_channel(signals)
    if channel is None:
        return inf
    change = inf
    for window in WINDOWS:
        seen = _usual_change(segments, channel, is_position, window)
        if seen >= change:
            break
        change = seen
    return GONE / change if 0 < change < inf else inf


def _usual_change(segments: Sequence[Record], channel: int, is_position: bool, window: int) -> float:
    """The median change of speed in ``window`` samples, filtered with that time constant; infinite if too short."""
    changes = []
    for segment in segments:
        if len(segment) > window + 1:
            speed = speed_of(smoothed(segment.output[:, channel], window), segment.dt, is_position)
            changes.append(np.abs(speed[window:] - speed[:-window]))
    return float(np.median(np.concatenate(changes))) if changes else inf
