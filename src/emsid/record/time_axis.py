"""The time column of a record: whether its samples are equidistant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.record.timer import timer_of

Array = NDArray[np.float64]


BRIDGED = 10
"""Resampling interpolates over gaps shorter than this many sample times; a longer gap ends a segment."""


NOTABLE = 0.01
"""Steps of time that differ by a larger share of the sample time are mentioned: rounding to three digits makes it."""


class TimeAxis(NamedTuple):
    """The regularity of a time column; as a string, a report in one line.

    Attributes:
        samples: the number of samples.
        dt: sample time in seconds. For regular samples it is the shortest decimal number that fits all of them, so that
            times written with few digits give the intended sample time; otherwise it is the mean interval without gaps.
        deviation: largest difference of an interval from ``dt``, in seconds, without gaps and duplicates; zero if it
            is below the rounding of the times.
        gaps: index of every sample before which rows of the timer were lost; without a timer, of every one that is more
            than 1.5·dt later than the previous one.
        lengths: of these gaps, in seconds.
        duplicates: index of every sample that is not later than the previous one.
        place: format of an index in messages, ``sample {}``.
        stamp_error: the largest distance in seconds of a time from the straight line over the numbers of the samples,
            where a timer sampled them (see `timer`) and only the times jitter; None for other samples.
    """

    samples: int
    dt: float
    deviation: float
    gaps: tuple[int, ...] = ()
    lengths: tuple[float, ...] = ()
    duplicates: tuple[int, ...] = ()
    place: str = "sample {}"
    stamp_error: float | None = None

    @property
    def jitter(self) -> float:
        """The largest deviation as a fraction of the sample time."""
        return self.deviation / self.dt

    @property
    def regular(self) -> bool:
        """Whether the samples count as equidistant: no gap, no duplicate; sampled by a timer, or jitter below 5 %."""
        return not self.gaps and not self.duplicates and (self.stamp_error is not None or self.jitter < 0.05)

    def __str__(self) -> str:
        step = f" (largest deviation of a step {_duration(self.deviation, 2)})" if self.deviation else ""
        return (
            f"{self.samples:,} samples, dt {_duration(self.dt)}, jitter {100 * self.jitter:.2g} %{step}, "
            f"{self._counted('gap', self.gaps)}, {self._counted('duplicate', self.duplicates)}"
        )

    def _counted(self, what: str, where: tuple[int, ...]) -> str:
        """The number of gaps or duplicates, and where they are."""
        if not where:
            return f"no {what}s"
        many = len(where) > 1
        places = [f"{'first ' if many else ''}at {self.place.format(where[0])}"]
        if what == "gap":
            longest = max(range(len(where)), key=self.lengths.__getitem__)
            at = f" at {self.place.format(where[longest])}" if longest else ""
            places.append(f"{'longest ' if many else ''}{_duration(self.lengths[longest], 3)}{at}")
        return f"{len(where):,} {what}{'s' * many} ({', '.join(places)})"


def time_axis(time: ArrayLike) -> TimeAxis:
    """The regularity of a time column (N,) in seconds.

    Raises:
        DataError: for fewer than two times, times that are not finite, or a constant time.
    """
    t = _checked(time)
    steps = np.diff(t)
    forward = steps[steps > 0]
    digits = rounding(t)
    dt = float(np.median(forward))
    timer = timer_of(t)
    if timer is None:
        gap, back = steps > 1.5 * dt, steps <= 0
    else:
        gap, back = np.diff(timer.numbers) > 1, np.zeros(len(steps), dtype=bool)
        dt = timer.dt
    ordinary = steps[~gap & ~back]

    def deviation(dt: float) -> float:
        largest = float(np.max(np.abs(ordinary - dt), initial=0.0))
        return largest if largest > digits else 0.0

    axis = TimeAxis(
        samples=len(t),
        dt=dt,
        deviation=deviation(dt),
        gaps=tuple(int(k) + 1 for k in np.flatnonzero(gap)),
        lengths=tuple(float(length) for length in steps[gap]),
        duplicates=tuple(int(k) + 1 for k in np.flatnonzero(back)),
        stamp_error=None if timer is None else timer.error,
    )
    if axis.regular:
        dt = _simplest_step(t, dt if timer is not None else float(t[-1] - t[0]) / (len(t) - 1))
    elif timer is not None:
        dt = _simplest(dt, (timer.error + digits) / int(timer.numbers[-1]))
    else:
        dt = _simplest(dt if axis.jitter < 0.05 else _mean_step(forward), digits)
    return axis._replace(dt=dt, deviation=deviation(dt))


def about_time(axis: TimeAxis, name: str, dt: float | None = None, resample: bool = False) -> list[Finding]:
    """What to know about the times of a record: that they jitter, or that it is resampled.

    Args:
        axis: of the times.
        name: of the record.
        dt: the sample time in seconds that is given, if any.
        resample: whether the record is resampled.
    """
    if resample:
        return [Finding("data-resampled", name, {"dt": float(dt or axis.dt)})]
    if not axis.regular or axis.jitter <= NOTABLE:
        return []
    off = axis.deviation if axis.stamp_error is None else axis.stamp_error
    data = {"jitter": float(off / axis.dt), "deviation": float(off), "dt": float(dt or axis.dt)}
    return [Finding("clock-jitters", name, data)]


def _mean_step(forward: Array) -> float:
    """The mean of irregular steps, without those that are gaps of many of them."""
    return float(np.mean(forward[forward < BRIDGED * np.median(forward)]))


def _checked(time: ArrayLike) -> Array:
    """(N,) the times, checked for use as times of samples.

    Raises:
        DataError: see `time_axis`.
    """
    t = np.asarray(time, dtype=float)
    if t.ndim != 1 or len(t) < 2:
        raise DataError(
            f"the time column has {t.size} sample{'s' * (t.size != 1)}, and a sample time needs two; take more rows, "
            "or give dt in its place",
            arguments=("dt",),
        )
    if not np.isfinite(t).all():
        raise DataError(
            f"the time column has no finite value at sample {int(np.flatnonzero(~np.isfinite(t))[0])}; repair it or "
            "mask that sample"
        )
    if not np.any(np.diff(t) > 0):
        raise DataError(
            f"the time never advances, it is {t[0]:g} s at first and {t[-1]:g} s at last; name the column that holds "
            "the time, or give dt in its place",
            arguments=("time", "dt"),
        )
    return t


def _duration(seconds: float, digits: int = 6) -> str:
    """A duration as text: ``5 ms``."""
    size, unit = next((pair for pair in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")) if seconds >= pair[0]), (1e-9, "ns"))
    return f"{seconds / size:.{digits}g} {unit}"


def _simplest_step(t: Array, mean: float) -> float:
    """The sample time of regular times ``t`` (N,): the decimal number of fewest digits near their mean interval.

    It shifts the last sample by no more than the scatter of the times, and by less than half a sample.
    """
    k = np.arange(len(t))
    first = float(t[1] - t[0])
    if np.array_equal(t[0] + first * k, t):
        return first
    scatter = float(np.max(np.abs(t - t[0] - mean * k))) + rounding(t)
    return _simplest(mean, min(scatter, mean / 2) / (len(t) - 1))


def _simplest(value: float, allowed: float) -> float:
    """The decimal number of fewest digits that differs from a value by at most ``allowed``."""
    candidates = (float(f"{value:.{digits}g}") for digits in range(1, 17))
    return next((number for number in candidates if abs(number - value) <= allowed), value)


def rounding(t: Array) -> float:
    """How far the difference of two times (N,) may be off because they are stored with limited digits."""
    return 4 * float(np.finfo(float).eps) * float(np.max(np.abs(t)))
