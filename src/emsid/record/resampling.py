"""Samples at equidistant times, from samples at measured times.

Between its samples an input is constant (it comes from a digital output). A step of it goes to the row whose time is
nearest, so that it is as often early as late: the value at the new times would be late by half a sample on average,
and a lag or an inertia estimated from it too large.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.record.time_axis import rounding

Array = NDArray[np.float64]


def equidistant(time: Array, input: Array, output: Array, step: float) -> tuple[Array, Array]:
    """Inputs and outputs at the times ``time[0] + k * step``.

    Inputs are constant from sample to sample, outputs are interpolated linearly.

    Args:
        time: (N,) the time of every sample in seconds; of samples with equal times the last is used.
        input: (N, nu) inputs.
        output: (N, ny) outputs.
        step: between the new samples, in seconds.

    Raises:
        DataError: where the time goes back, or the step is too short for the time.
    """
    if not 1e-8 * (time[-1] - time[0]) < step < np.inf:
        raise DataError(f"cannot resample {time[-1] - time[0]:g} s to a sample time of {step:g} s; give another")
    last = np.append(np.diff(time) != 0, True)
    t, u, y = time[last], input[last], output[last]
    if np.any(np.diff(t) <= 0):
        raise DataError("the time column goes back; sort the file by time first")
    late = min(1e-9 * step + rounding(t), step / 2)  # by how much rounding may make a time later than the grid
    grid = t[0] + step * np.arange(int(np.floor((t[-1] - t[0] + late) / step)) + 1)
    columns = [np.interp(grid, t, y[:, k]) for k in range(y.shape[1])]
    return u[held_at(t, grid + late, step)], np.column_stack(columns) if columns else np.empty((len(grid), 0))


def held_at(time: Array, rows: Array, step: float) -> NDArray[np.intp]:
    """(M,) the sample of an input that holds for most of each row of another clock.

    >>> held_at(np.arange(4.0), np.array([0.2, 1.6, 2.2]), 1.0)
    array([0, 2, 2])

    Args:
        time: (N,) of its samples, ascending.
        rows: (M,) times of the rows.
        step: how long a row lasts.
    """
    nearest = np.searchsorted(time, rows + (0.5 + 1e-9) * step, side="right") - 1
    return np.asarray(np.clip(nearest, 0, len(time) - 1))
