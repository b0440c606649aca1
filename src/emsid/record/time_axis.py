"""The time column of a record: whether its samples are equidistant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError

Array = NDArray[np.float64]


class TimeAxis(NamedTuple):
    """The regularity of a time column; as a string, a report in one line.

    Attributes:
        samples: the number of samples.
        dt: sample time in seconds. For regular samples it is the shortest decimal number that fits all of them, so that
            times written with few digits give the intended sample time; otherwise it is the median interval.
        deviation: largest difference of an interval from ``dt``, in seconds, without gaps and duplicates; zero if it
            is below the rounding of the times.
        gaps: index of every sample that is more than 1.5·dt later than the previous one.
        lengths: of these gaps, in seconds.
        duplicates: index of every sample that is not later than the previous one.
        place: format of an index in messages, ``sample {}``.
    """

    samples: int
    dt: float
    deviation: float
    gaps: tuple[int, ...] = ()
    lengths: tuple[float, ...] = ()
    duplicates: tuple[int, ...] = ()
    place: str = "sample {}"

    @property
    def jitter(self) -> float:
        """The largest deviation as a fraction of the sample time."""
        return self.deviation / self.dt

    @property
    def regular(self) -> bool:
        """Whether the samples count as equidistant: no gap, no duplicate, jitter below 5 %."""
        return not self.gaps and not self.duplicates and self.jitter < 0.05

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
    dt = _simplest(float(np.median(forward)), digits)
    gap, back = steps > 1.5 * dt, steps <= 0
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
    )
    if not axis.regular:
        return axis
    dt = _simplest_step(t)
    return axis._replace(dt=dt, deviation=deviation(dt))


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


def _simplest_step(t: Array) -> float:
    """The sample time of regular times ``t`` (N,): the decimal number of fewest digits near their mean interval.

    It shifts the last sample by no more than the scatter of the times, and by less than half a sample.
    """
    k = np.arange(len(t))
    first = float(t[1] - t[0])
    if np.array_equal(t[0] + first * k, t):
        return first
    mean = float(t[-1] - t[0]) / (len(t) - 1)
    scatter = float(np.max(np.abs(t - t[0] - mean * k))) + rounding(t)
    return _simplest(mean, min(scatter, mean / 2) / (len(t) - 1))


def _simplest(value: float, allowed: float) -> float:
    """The decimal number of fewest digits that differs from a value by at most ``allowed``."""
    candidates = (float(f"{value:.{digits}g}") for digits in range(1, 17))
    return next((number for number in candidates if abs(number - value) <= allowed), value)


def rounding(t: Array) -> float:
    """How far the difference of two times (N,) may be off because they are stored with limited digits."""
    return 4 * float(np.finfo(float).eps) * float(np.max(np.abs(t)))
