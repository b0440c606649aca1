r"""The time column of a record: its unit, and whether its samples are equidistant.

The unit is the one that is given, the end of the name, or that of the function that the column is named after.

**Late stamps.** Rows that a timer samples and that are stamped late are equidistant, although their stamps are not.
With nₖ the number of a row, counted with the rows that were lost, the stamps are tₖ = a + T·nₖ + rₖ. The slope T is the
median of the slopes between rows that are half a record apart (a Theil–Sen estimate with N/2 pairs): a minority of late
stamps does not move it. The rows are equidistant where every rₖ is within half a sample of a straight line, so that no
stamp belongs to another row, and the means of rₖ over some rows move by less than half a sample: a row that is lost or
written twice moves them by a whole one, and a clock that drifts moves them steadily.

**Samples at equidistant times**, from samples at measured times: between its samples an input is constant (it comes
from a digital output). A step of it goes to the row whose time is nearest, so that it is as often early as late: the
value at the new times would be late by half a sample on average, and a lag or an inertia estimated from it too large.

References:
    Sen, *Estimates of the regression coefficient based on Kendall's tau*, Journal of the American Statistical
    Association 63 (1968).
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.findings import Finding

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


SECONDS = {
    "ns": 1e-9,
    "us": 1e-6,
    "µs": 1e-6,  # the micro sign
    "μs": 1e-6,  # the Greek letter
    "ms": 1e-3,
    "msec": 1e-3,
    "s": 1.0,
    "sec": 1.0,
    "seconds": 1.0,
    "min": 60.0,
    "h": 3600.0,
}
CLOCK_NAMES = {"millis": "ms", "micros": "us", "ms_today": "ms"}
"""Units of columns by names of boards and firmware: functions of Arduino, and the clock of a VESC."""
UNIT_IN_NAME = re.compile(r"[\s_]*(?:[(\[{]\s*(?P<bracketed>[^)\]}]+?)\s*[)\]}]|_(?P<suffix>ns|us|ms|s))$")
_RATE = re.compile(r"(\d+(?:\.\d+)?(?:e[+-]?\d+)?)\s*([kM]?)Hz")
"""Of ticks that a time column counts."""


def seconds_in_unit(column: str, given: str | None = None, stated: str = "") -> float:
    """Seconds in one unit of a time column; one in which nothing says a unit is in seconds.

    >>> seconds_in_unit("t"), seconds_in_unit("time_ms"), seconds_in_unit("Timestamp(us)"), seconds_in_unit("t", "min")
    (1.0, 0.001, 1e-06, 60.0)

    Args:
        column: its name.
        given: the unit that the user gives.
        stated: the one that the file states elsewhere.

    Raises:
        DataError: for a unit that is given and not one of time.
    """
    if given is not None:
        if given not in SECONDS and not _RATE.fullmatch(given):
            known = ", ".join(SECONDS)
            raise DataError(f"time unit {given!r} is not understood; give one of {known}, or a rate, 8kHz")
        return seconds_of(given)
    written = UNIT_IN_NAME.search(column)
    in_name = written["bracketed"] or written["suffix"] if written else CLOCK_NAMES.get(column.lower(), "s")
    return SECONDS.get(stated or in_name, 1.0)


def seconds_of(unit: str) -> float:
    """Seconds in a unit, or in a tick of a rate; one in which it is unknown.

    >>> seconds_of("ms"), seconds_of("8kHz"), seconds_of("")
    (0.001, 0.000125, 1.0)
    """
    rate = _RATE.fullmatch(unit)
    if rate is None or not float(rate[1]):
        return SECONDS.get(unit, 1.0)
    return 1 / (float(rate[1]) * {"": 1.0, "k": 1e3, "M": 1e6}[rate[2]])


FEWEST = 8
"""Through the stamps of fewer rows, a straight line shows neither steps nor drift."""
MEANS = 25
"""Rows in a mean: noise of half a sample moves it by a tenth of a sample, and so 100 means by less than 0.3.
As many before and after a long step say by their medians whether rows were lost there, or one stamp was late."""
SLOWLY = 0.5
"""Means may move by less than this many samples: halfway to the sample by which a lost row moves them."""
_SPAN = 32
"""Rows over which the sample time is taken at first: few enough that most spans have no lost row."""


class Timer(NamedTuple):
    """The straight line of the stamps.

    Attributes:
        numbers: (N,) the number of every row on the timer, counted with the rows that were lost.
        dt: the sample time in seconds.
        error: the largest distance of a stamp from the line in seconds.
    """

    numbers: NDArray[np.intp]
    dt: float
    error: float


def timer_of(t: Array) -> Timer | None:
    """The timer that sampled the rows with these stamps (N,) in seconds; None where they are really irregular."""
    if len(t) < FEWEST or not t[-1] > t[0]:
        return None
    rows = np.arange(len(t))
    whole = _line(t, rows)
    if whole is not None:
        return whole
    span = min(_SPAN, len(t) // 2)
    dt = float(np.median(t[span:] - t[:-span])) / span
    for lost in (_rounded, _by_medians) if dt > 0 else ():
        line = _line(t, rows + np.append(0, np.cumsum(lost(t, dt))))
        if line is not None:
            return line
    return None


def on_timer(t: Array) -> Array:
    """(N,) the stamps where their timer puts them; the stamps themselves where they are really irregular."""
    timer = timer_of(t)
    return t if timer is None else t[0] + timer.dt * (timer.numbers - timer.numbers[0])


def _line(t: Array, numbers: NDArray[np.intp]) -> Timer | None:
    """The line of stamps over the numbers of their rows; None where they are not close to one."""
    half = len(t) // 2
    dt = float(np.median((t[half:] - t[:-half]) / (numbers[half:] - numbers[:-half])))
    away = t - dt * numbers
    error = float(np.ptp(away)) / 2
    size = max(min(MEANS, len(t) // 4), 1)
    means = away[: len(t) // size * size].reshape(-1, size).mean(axis=1)
    return Timer(numbers, dt, error) if error < dt / 2 * (1 - 1e-6) and np.ptp(means) < SLOWLY * dt else None


def _rounded(t: Array, dt: float) -> NDArray[np.intp]:
    """(N - 1,) the rows lost in every step, by the length of the step alone: for stamps of little jitter."""
    lost: NDArray[np.intp] = np.maximum(np.rint(np.diff(t) / dt) - 1, 0).astype(np.intp)
    return lost


def _by_medians(t: Array, dt: float) -> NDArray[np.intp]:
    """(N - 1,) the rows lost in every step, by the stamps of several rows before and after it, longest steps first."""
    away = t - dt * np.arange(len(t))
    lost = np.zeros(len(t) - 1, dtype=np.intp)
    steps = np.diff(t)
    for k in sorted(np.flatnonzero(steps > 1.5 * dt), key=lambda k: -steps[k]):
        moved = np.median(away[k + 1 : k + 1 + MEANS]) - np.median(away[max(k + 1 - MEANS, 0) : k + 1])
        lost[k] = max(int(np.rint(moved / dt)), 0)
        away[k + 1 :] -= lost[k] * dt
    return lost


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
