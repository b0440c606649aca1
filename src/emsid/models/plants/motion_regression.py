r"""Linear regressions of the motion of one mass, with filtered signals.

All signals pass through the same filter, which also gives the derivatives of a speed or a position. The equation of one
mass is then linear in its coefficients:

    dv/dt = gain·D(u) − damping·v − c·sgn(v) − offset − waves.

This is the least-squares inverse dynamics of robotics (Gautier, Khalil), with 1/(1 + τs)² run forward and backward as
the filter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.filtering import filtered_both_ways
from emsid.record import Record

Array = NDArray[np.float64]

SLIDING, OFFSET = 2, 3
"""Columns of the regression: the direction of motion, and ones."""


def speed_of(output: Array, dt: float, is_position: bool) -> Array:
    """(N,) a speed, or the slope of a position; zero for a single sample."""
    return np.gradient(output, dt) if is_position and len(output) > 1 else output


def smoothed(values: Array, samples: float) -> Array:
    """Signals (N,) or (k, N) through 1/(1 + τs) forward and backward, so that nothing is delayed; τ in samples."""
    decay = np.exp(-1.0 / samples)
    padding = min(int(3 * samples) + 3, values.shape[-1] - 1)
    return filtered_both_ways([1.0 - decay], [1.0, -decay], values, padding)


def solved(matrix: Array, right: Array) -> list[float]:
    """The least-squares solution, independent of the units of the columns; zeros if it is not finite."""
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    found = np.linalg.lstsq(matrix / scale, right, rcond=1e-10)[0] / scale
    return [float(x) for x in found] if np.isfinite(found).all() else [0.0] * len(scale)


def motion_rows(
    segment: Record, channel: int, is_position: bool, samples: float, width: float, offset: float
) -> tuple[Array, NDArray[np.bool_]]:
    """(n, 5) rows of [D(u), −v, −sgn(v), −1 | dv/dt], `smoothed`, of the samples in motion, and (N,) a mask of these.

    Args:
        segment, channel, is_position, offset: see `motions`.
        samples: time constant of the filter, in samples.
        width: half the width of the dead zone.
    """
    dt = segment.dt
    u = segment.input[:, 0] + offset
    drive = np.maximum(u - width, 0.0) + np.minimum(u + width, 0.0)
    y = segment.output[:, channel]
    speed = speed_of(smoothed(y, samples), dt, is_position)
    moving = np.abs(speed) > 0.03 * np.max(np.abs(speed))
    sliding = np.where(moving, np.sign(speed), 0.0)
    held = np.concatenate([drive[:1], drive[:-1]])  # what acted over the sample before
    columns = [0.5 * (drive + held), -speed, -sliding, -np.ones(len(u))]
    filtered = [smoothed(c, samples) if k != 1 else c for k, c in enumerate(columns)]
    table = np.column_stack([*filtered, np.gradient(speed, dt)])
    kept = moving & np.roll(moving, 1) & np.roll(moving, -1)
    kept[:3] = kept[-3:] = False
    return np.asarray(table[kept]), kept


def rows_with_waves(
    segment: Record, channel: int, is_position: bool, samples: float, width: float, offset: float, turn: float
) -> Array:
    """The rows of `motion_rows`; before the last column those of a wave, if there is a ``turn``.

    Of a speed the position is the integral from zero.
    """
    table, kept = motion_rows(segment, channel, is_position, samples, width, offset)
    if not turn:
        return table
    y = segment.output[:, channel]
    position = y if is_position else np.cumsum(y) * segment.dt
    return np.column_stack([table[:, :-1], waves(position, samples, turn)[kept], table[:, -1]])


def waves(position: Array, samples: float, turn: float) -> Array:
    """(N, 2) columns of a wave of ``turn`` radians per unit of a position (N,), `smoothed`."""
    return np.asarray(-smoothed(np.array([np.cos(turn * position), np.sin(turn * position)]), samples).T)
