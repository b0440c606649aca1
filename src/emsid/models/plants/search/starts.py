r"""Starting values of a grey box from nothing but its records.

With every signal passed through the same filter, the derivatives of a speed or a position are outputs of that filter
too, and one mass is linear in what it takes to say how it moves:

    dv/dt = gain·D(u) − damping·v − c·sgn(v) − offset.

This is regressed on the samples that move, for several filters and several widths of the dead zone; the simulation
error of each decides which is the start (`estimation`). It is inverse dynamics least squares as
robotics uses it (Gautier, Khalil), with 1/(1 + τs)² run forward and backward as the filter.

A mass that settles within a few samples has no derivative to be seen. What it shows is where it settles,

    v = (gain·D(u) − c·sgn(v) − offset)/damping,

which is regressed too, and tried with several dampings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.one_mass import Motion
from emsid.record import Record

Array = NDArray[np.float64]

FILTERS = (1.0, 3.0, 8.0, 20.0)
"""Time constants of the filter, in samples."""
DEAD_ZONES = (0.0, 0.05, 0.1, 0.2, 0.35)
"""Half widths of the dead zone, as a part of the largest command."""
SETTLING = (0.5, 1.5, 5.0, 15.0)
"""Time constants of a mass that settles quickly, in samples."""


def motions(
    segments: Sequence[Record], channel: int, is_position: bool, dead_zone: bool, offset: float = 0.0
) -> Iterator[Motion]:
    """One mass as several regressions see it.

    Args:
        segments: records without gaps, driven by their first input.
        channel: the output that shows speed or position.
        is_position: which of the two.
        dead_zone: whether to try dead zones.
        offset: of the command.
    """
    largest = max(float(np.max(np.abs(s.input[:, 0]))) for s in segments)
    for samples in FILTERS:
        for part in DEAD_ZONES if dead_zone else (0.0,):
            width = part * largest
            rows = [
                _rows(segment, channel, is_position, samples, width, offset)
                for segment in segments
                if len(segment) > 12
            ]
            if not rows:
                continue
            matrix = np.concatenate(rows)
            if len(matrix) < 12:
                continue
            gain, damping, coulomb, drop = _solved(matrix[:, :-1], matrix[:, -1])
            if gain != 0:
                yield Motion(gain, max(damping, 0.0), coulomb, drop, width)
            if samples == FILTERS[0]:
                gain, coulomb, drop = _solved(matrix[:, [0, 2, 3]], -matrix[:, 1])
                if gain != 0:
                    for time in SETTLING:
                        rate = 1 / (time * segments[0].dt)
                        yield Motion(rate * gain, rate, rate * coulomb, rate * drop, width)


def _solved(matrix: Array, right: Array) -> list[float]:
    """The least-squares solution, whatever the units of the columns; zeros where it is not finite."""
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    found = np.linalg.lstsq(matrix / scale, right, rcond=1e-10)[0] / scale
    return [float(x) for x in found] if np.isfinite(found).all() else [0.0] * len(scale)


def _rows(segment: Record, channel: int, is_position: bool, samples: float, width: float, offset: float) -> Array:
    """(n, 5) rows of [D(u), −v, −sgn(v), −1 | dv/dt], filtered, of the samples that move."""
    dt = segment.dt
    u = segment.input[:, 0] + offset
    drive = np.maximum(u - width, 0.0) + np.minimum(u + width, 0.0)
    y = segment.output[:, channel]
    speed = np.gradient(_smooth(y, samples), dt) if is_position else _smooth(y, samples)
    moving = np.abs(speed) > 0.03 * np.max(np.abs(speed))
    sliding = np.where(moving, np.sign(speed), 0.0)
    held = np.concatenate([drive[:1], drive[:-1]])  # what acted over the sample before
    columns = [0.5 * (drive + held), -speed, -sliding, -np.ones(len(u))]
    filtered = [_smooth(c, samples) if k != 1 else c for k, c in enumerate(columns)]
    table = np.column_stack([*filtered, np.gradient(speed, dt)])
    kept = moving & np.roll(moving, 1) & np.roll(moving, -1)
    kept[:3] = kept[-3:] = False
    return np.asarray(table[kept])


def _smooth(values: Array, samples: float) -> Array:
    """Through 1/(1 + τs) forward and backward, so that nothing is delayed; τ in samples."""
    from scipy.signal import filtfilt

    decay = np.exp(-1.0 / samples)
    padding = min(int(3 * samples) + 3, len(values) - 1)
    smooth: Array = filtfilt([1.0 - decay], [1.0, -decay], values, padlen=padding)
    return smooth
