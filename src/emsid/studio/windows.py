"""Windows of long signals: the lowest and highest value in every pixel, as float32.

A window of W pixels takes one pass over its samples, whatever their number: two values a pixel show every extreme,
which thinning would lose. Times are relative to the beginning of the window, of which float32 resolves a
ten-millionth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WIDEST = 4000
"""Most pixels of a window: those of a large screen."""


@dataclass(frozen=True, eq=False)
class Signal:
    """A signal over time.

    Args:
        time: (N,) ascending, in s.
        values: (N,) NaN where there is none.
        dt: sample time in s; a longer step is a gap.
    """

    time: Array
    values: Array
    dt: float

    def window(self, first: float, last: float, width: int) -> tuple[Array, Array]:
        """Times and values to draw between two times: all samples where they are few, else two a pixel.

        The samples before and after the window are part of it, so that its line reaches its edges. NaN is a gap.
        """
        width = min(max(width, 1), WIDEST)
        a = max(int(np.searchsorted(self.time, first, "left")) - 1, 0)
        b = min(int(np.searchsorted(self.time, last, "right")) + 1, len(self.time))
        t, x = self.time[a:b], self.values[a:b]
        if len(t) <= 2 * width:
            gaps = np.flatnonzero(np.diff(t) > 1.5 * self.dt)
            return np.insert(t, gaps + 1, t[gaps] + self.dt), np.insert(x, gaps + 1, np.nan)
        starts = np.linspace(0, len(t), width, endpoint=False).astype(int)
        times = np.repeat(t[starts], 2)
        extremes = np.column_stack([np.fmin.reduceat(x, starts), np.fmax.reduceat(x, starts)]).ravel()
        ends = np.append(starts[1:], len(t)) - 1
        step = (t[ends] - t[starts]).max() if width > 1 else 0.0
        gaps = np.flatnonzero(t[starts[1:]] - t[ends[:-1]] > max(step / 2, 1.5 * self.dt)) * 2 + 2
        return np.insert(times, gaps, times[gaps - 1] + self.dt), np.insert(extremes, gaps, np.nan)


def packed(signals: list[Signal], first: float, last: float, width: int) -> bytes:
    """Windows of signals with the same times: the number of points, their times from ``first`` on, and the values."""
    drawn = [signal.window(first, last, width) for signal in signals]
    rows = [(drawn[0][0] - first).astype("<f4"), *(values.astype("<f4") for _, values in drawn)]
    return np.uint32(len(rows[0])).tobytes() + b"".join(row.tobytes() for row in rows)
