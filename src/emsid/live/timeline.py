"""Rows of a source on a regular time axis: the sample time, missing samples, clocks and counters that overflow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.live.protocol import Rows, joined

Array = NDArray[np.float64]

CLOCKS, COUNTERS = (2**32 * 1e-6, 2**32 * 1e-3), (2**8, 2**16, 2**32)
"""Where a clock of 32 bits in µs or ms, in s, and a sequence number of 8, 16 or 32 bits begin at zero again."""
NEAR, NEAR_COUNT = 5.0, 10
"""A step back is such a turn where at most this many seconds, or numbers without a clock, are missing there."""


@dataclass(frozen=True)
class Gap:
    """Missing samples before a stretch of samples.

    Attributes:
        time: of the first sample after it, in s.
        samples: how many are missing; None where it is not known.
        cause: ``lost``, ``unusable`` (lines that are no numbers), ``backwards`` (the time stepped back),
            ``disconnected`` or ``skipped`` (the tracker was too slow).
    """

    time: float
    samples: int | None
    cause: str


@dataclass(frozen=True, eq=False)
class Stretch:
    """Consecutive samples at a constant sample time.

    Attributes:
        time: of the first, in s.
        input, output: (m, nu) and (m,).
        gap: what is missing before it, or None where it continues the stretch before.
    """

    time: float
    input: Array
    output: Array
    gap: Gap | None = None

    def __len__(self) -> int:
        return len(self.output)


class Timeline:
    """Puts rows on a regular time axis and finds what is missing.

    Attributes:
        dt: sample time in s; None until it is known.
        lost: the number of samples that are missing so far.
        repeated: the number of rows with the time of the row before, which are left out.

    Args:
        dt: sample time in s; by default from the time column.
    """

    LEARNING = 20
    """The number of intervals from which the sample time is taken."""

    def __init__(self, dt: float | None = None) -> None:
        self.dt, self.lost, self.repeated = dt, 0, 0
        self._waiting: list[Rows] = []
        self._last: tuple[float, float] | None = None
        self._cause = ""
        self._base = 0.0
        self._turned, self._turned_number = 0.0, 0.0

    @property
    def time(self) -> float | None:
        """The time of the last row in s, without turns of the clock; None before the sample time is known."""
        return None if self._last is None else self._last[0]

    def cut(self, cause: str) -> None:
        """Whatever comes next comes after a gap."""
        self._cause = cause

    def place(self, rows: Rows, last: bool = False) -> list[Stretch]:
        """The rows as stretches without a gap.

        Args:
            rows: in the order of their arrival.
            last: whether no more will come, so that few rows must do to find the sample time.

        Raises:
            DataError: where there is neither a time column nor a sample time.
        """
        self._waiting.append(rows)
        rows = joined(self._waiting)
        if self.dt is None:
            if np.isnan(rows.time[:1]).any():
                raise DataError("the source has no time column; give its sample time", arguments=("dt",))
            if len(rows) <= self.LEARNING and not (last and len(rows) > 2):
                self._waiting = [rows]
                return []
            self.dt = sample_time(rows.time)
        self._waiting = []
        return self._placed(self._unturned(rows, self.dt), self.dt) if len(rows) else []

    def rest(self) -> list[Stretch]:
        """Rows that still waited for a sample time, at the end of a source."""
        rows = joined(self._waiting) if self._waiting else None
        self._waiting = []
        return [] if rows is None or len(rows) < 3 else self.place(rows, last=True)

    def _unturned(self, rows: Rows, dt: float) -> Rows:
        """The rows with a time and a number that increase where a clock or a counter overflows to zero."""
        time, number = rows.time + self._turned, rows.number + self._turned_number
        before = self._last or (time[0], number[0])
        step = np.diff(time, prepend=before[0])
        count = np.diff(number, prepend=before[1])
        for k in np.flatnonzero((step < 0) | (count < 0)).tolist():
            counter = next((turn for turn in COUNTERS if _is_turn(count[k] + turn, step[k] / dt)), 0.0)
            clock = next((turn for turn in CLOCKS if 0 < step[k] + turn <= NEAR), 0.0) if step[k] < 0 else 0.0
            if (count[k] < 0 and not counter) or (step[k] < 0 and not clock):
                again = not step[k] >= -NEAR  # a board that began again
                clock, counter = (-self._turned, -self._turned_number) if again else (0.0, 0.0)
            elif not count[k] < 0:
                counter = 0.0
            time[k:] += clock
            number[k:] += counter
            self._turned += clock
            self._turned_number += counter
        return replace(rows, time=time, number=number)

    def _placed(self, rows: Rows, dt: float) -> list[Stretch]:
        """The rows as stretches, divided where the time, the number or an unusable line shows a gap."""
        rows = self._without_repeats(rows, dt)
        if not len(rows):
            return []
        clocked, counted = not np.isnan(rows.time[0]), not np.isnan(rows.number[0])
        step, count = self._steps(rows, dt)
        back = step < 0
        jump = (count < 1) | (count > 1) if counted else np.zeros(len(rows), bool)
        jump |= np.abs(step - 1) > 0.5 if clocked else False
        starts = jump | back | (rows.broken & (np.rint(step) != 1 if clocked else True))
        if self._cause or self._last is None:
            starts[0] = True
        stretches = []
        edges = [*np.flatnonzero(starts).tolist(), len(rows)]
        if not starts[0]:
            edges.insert(0, 0)
        for first, stop in pairwise(edges):
            gap = None
            if starts[first] and self._last is not None:
                missing = count[first] - 1 if counted and count[first] >= 1 else step[first] - 1
                gap = self._gap(rows, first, missing, bool(back[first]))
            self._last = (float(rows.time[first]), float(rows.number[first]))
            stretches.append(Stretch(self._at(rows, first), rows.input[first:stop], rows.output[first:stop], gap))
            self._base += stop - first
        self._cause = ""
        self._last = (float(rows.time[-1]), float(rows.number[-1]))
        return stretches

    def _steps(self, rows: Rows, dt: float) -> tuple[Array, Array]:
        """(m,) each: the intervals before the rows, in sample times, and the differences of their numbers."""
        before = self._last or (rows.time[0] - dt, rows.number[0] - 1)
        step = np.ones(len(rows)) if np.isnan(rows.time[0]) else np.diff(rows.time, prepend=before[0]) / dt
        count = np.rint(step) if np.isnan(rows.number[0]) else np.diff(rows.number, prepend=before[1])
        return step, count

    def _without_repeats(self, rows: Rows, dt: float) -> Rows:
        """The rows without those that have the time of the row before, and no higher number."""
        while len(rows):
            step, count = self._steps(rows, dt)
            again = (step >= 0) & (step < 0.5)
            if not np.isnan(rows.number[0]):
                again &= ~(count > 0)
            if not again.any():
                break
            self.repeated += int(again.sum())
            rows = rows[~again]
        return rows

    def _gap(self, rows: Rows, first: int, missing: float, back: bool) -> Gap:
        """The gap before a row; its length is not known where the time steps back."""
        known = bool(missing >= 0.5) and not back
        cause = "backwards" if back else "unusable" if rows.broken[first] else "lost"
        if first == 0 and self._cause:
            cause = self._cause
        self.lost += round(missing) if known else 0
        return Gap(self._at(rows, first), round(missing) if known else None, cause)

    def _at(self, rows: Rows, k: int) -> float:
        """The time of a row; without a clock, the samples so far are counted."""
        return self._base * (self.dt or 0.0) if np.isnan(rows.time[k]) else float(rows.time[k])


def _is_turn(count: float, steps: float) -> bool:
    """Whether a counter went on by this number, while the clock, if there is one, went on by this many samples."""
    return abs(count - steps) < 1.5 and count >= 1 if steps > 0 else 1 <= count <= NEAR_COUNT


def sample_time(time: Array) -> float:
    """The sample time in s: the mean of the intervals that are near their median, with five digits.

    Raises:
        DataError: where the time does not increase.
    """
    steps = np.diff(time)
    median = float(np.median(steps[steps > 0])) if (steps > 0).any() else inf
    near = steps[np.abs(steps - median) < 0.5 * median]
    if not len(near):
        raise DataError("the time of the source does not increase; give its sample time", arguments=("dt",))
    return float(f"{near.mean():.5g}")
