"""`Record`, the one data type of the program, and its operations.

A record is a sampled experiment: inputs ``(N, nu)`` and outputs ``(N, ny)`` at a constant sample time. It may
hold several *segments*, pieces without a gap. Masking bad samples and joining experiments both make segments. No
lagged value, filter or simulation crosses a break between segments. Every function that identifies, validates, plots
or exports takes one or several records and works segment by segment. Trends are removed and samples decimated and
filtered within each segment, (N, channels) at a time.

Arrays and numbers are checked when a record is made: other values are refused, and nothing is converted silently.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from math import nan
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.arguments import as_names
from emsid.errors import DataError
from emsid.findings import Finding
from emsid.presentation import Presented
from emsid.record.argument_types import (
    NUMBER,
    NUMBER_LIST,
    PAIRS,
    SLICE,
    TEXT,
    TEXT_LIST,
    TEXTS,
    UNITS,
    WHOLE,
    WHOLE_LIST,
    Kind,
    brief,
    check_types,
    items_of,
    names_of,
    typed,
)
from emsid.record.frames import FrameMethods, numbers, seconds
from emsid.record.time_axis import TimeAxis, about_time, equidistant, on_timer, time_axis
from emsid.units import SI, called, name_and_unit, readable_unit, si_unit

Array = NDArray[np.float64]


def as_channels(values: ArrayLike, side: str, named: int) -> Array:
    """The samples (N, channels), read-only. More channels than samples are accepted only if ``named`` confirms them."""
    array = real_numbers(values, side)
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2:
        raise DataError(f"{side} has shape {array.shape}; give (N,) or (N, channels)")
    if array.shape[1] > array.shape[0] > 0 and array.shape[1] != named:
        raise DataError(f"{side} has shape {array.shape}: more channels than samples; samples go down, channels across")
    return array


def real_numbers(values: ArrayLike, side: str) -> Array:
    """The values as a read-only array; copied unless they are read-only already, as in a part of a record."""
    given: NDArray[Any] | None
    try:
        given = np.asarray(values)
        array = given.astype(np.float64, copy=False) if given.dtype.kind in "biufO" else None
    except (TypeError, ValueError, OverflowError):  # strings among numbers, rows of unequal length
        given = array = None
    if array is None:
        found = {"c": "complex numbers", "U": "text", "S": "text"}.get(given.dtype.kind if given is not None else "")
        raise DataError(
            f"{side} holds {found or 'something else than numbers'}; give real numbers, (N,) or (N, channels)"
        )
    owner = array
    while isinstance(owner.base, np.ndarray):
        owner = owner.base
    if owner.flags.writeable:
        array = array.copy("K")
        array.flags.writeable = False  # set on the array itself, so that views of it need no copy
    return array


SIGNALS = ("speed", "rotor speed", "load speed", "position", "current")
"""What an output may measure; a speed of a plant with two masses is that of its load."""


def named_signals(record: Any) -> dict[str, str]:
    """The signals of the outputs of a record in their spelling; ``rotor_speed`` and ``rotor-speed`` are one.

    Raises:
        DataError: for something else, or another channel.
    """
    found = {name: re.sub("[_-]", " ", signal.strip().lower()) for name, signal in record.signals.items()}
    for name, signal in found.items():
        if name not in record.output_names:
            outputs = ", ".join(record.output_names)
            raise DataError(
                f"{record.name}: a signal is given for {name!r}, which is no output; these are {outputs}",
                arguments=("signals",),
            )
        if signal not in SIGNALS:
            known = ", ".join(each.replace(" ", "_") for each in SIGNALS)
            raise DataError(
                f"{name!r} cannot be the signal {record.signals[name]!r}; there are {known}", arguments=("signals",)
            )
    return found


KINDS = {
    "signals": TEXTS,
    "name": TEXT,
    "breaks": WHOLE_LIST,
    "times": NUMBER_LIST,
    "sources": TEXT_LIST,
    "findings": items_of(Finding),
    "conversions": PAIRS,
    "time_axis": Kind(lambda value: isinstance(value, TimeAxis), "a TimeAxis"),
}
"""The types of the fields of a record that are no arrays."""


def segments_of(record: Any) -> dict[str, tuple[Any, ...]]:
    """The fields of a record about its segments, completed.

    Raises:
        DataError: for breaks, times and sources that do not agree.
    """
    name, breaks = record.name, tuple(int(b) for b in record.breaks)
    edges = (0, *breaks, len(record))
    if any(b <= a for a, b in pairwise(edges)):
        raise DataError(f"{name}: breaks {brief(breaks)} must ascend inside 1 … {len(record) - 1}")
    times = tuple(float(t) for t in record.times) or tuple(edge * record.dt for edge in edges[:-1])
    if len(times) != len(edges) - 1:
        raise DataError(f"{name}: {len(times)} segment times for {len(edges) - 1} segments")
    sources, before = tuple(record.sources), tuple(record.before) if any(record.before) else ()
    for what, values in (("sources", sources), ("parts before", before)):
        if values and len(values) != len(edges) - 1:
            raise DataError(f"{name}: {len(values)} segment {what} for {len(edges) - 1} segments")
    return {"breaks": breaks, "times": times, "sources": sources, "before": before}


def whole_number(value: object, least: int, problem: str) -> int:
    """The value as a whole number of at least ``least``; otherwise a `DataError` with the message ``problem``."""
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = least - 1
    if number < least:
        raise DataError(problem)
    return number


def check_finite(values: Array, names: Sequence[str], where: str) -> None:
    """Refuse values (N, channels) that are no numbers, naming the channel and the sample."""
    for k, name in enumerate(names):
        column = values[:, k]
        with np.errstate(over="ignore", invalid="ignore"):
            suspect = not np.isfinite(column.sum())
        if suspect and not np.isfinite(column).all():
            bad = int(np.flatnonzero(~np.isfinite(column))[0])
            raise DataError(f"{where}: channel {name!r} is {column[bad]} at sample {bad}; mask or repair it")


OfRecord = TypeVar("OfRecord", bound=Any)


class UnitMethods:
    """`convert` and `in_si` of a record."""

    @typed(units=UNITS)
    def convert(self: OfRecord, units: Mapping[str, str | None] | None = None, **scales: float) -> OfRecord:
        """Convert every channel with a unit to SI, or the named channels to the given units.

        Args:
            units: the new unit of each channel to convert, None for SI; without this argument all become SI.
            scales: the scales of counts and PWM, see `emsid.units.conversion`: ``counts_per_revolution``,
                ``supply_voltage``, ``pwm_full_scale``.
        """
        from emsid.units import conversion

        present = dict(zip(self.input_names + self.output_names, self.input_units + self.output_units, strict=True))
        wanted = {name: None for name, unit in present.items() if unit} if units is None else dict(units)
        result = self
        for given, target in wanted.items():
            name = self._own_name(given)
            gain, offset, unit = conversion(present[name], target, sample_time=self.dt, **scales)
            result = result.scale(name, gain, offset, unit)
        return result

    def in_si(self: OfRecord, **scales: float) -> OfRecord:
        """The record with every channel in SI whose unit can be converted; the record itself where all are.

        Counts and PWM of unknown size, and units that are not understood, remain. `emsid.fit`, `emsid.identify`,
        `emsid.simulate` and the functions that judge a fit convert their records in this way.

        Args:
            scales: as in `convert`.
        """
        sizes = {"sample_time": self.dt, **scales}
        units = dict(zip(self.input_names + self.output_names, self.input_units + self.output_units, strict=True))
        other = [name for name, unit in units.items() if unit and unit not in SI and si_unit(unit, **sizes)]
        result: OfRecord = self.convert(dict.fromkeys(other), **scales) if other else self
        return result


class FileRows(NamedTuple):
    """The rows of a file larger than memory that a segment of an excerpt stands for.

    Attributes:
        read: reads samples of the file: from the row ``first`` to ``stop``, in parts; each begins with ``lead`` samples
            before it, where they are in its segment, and has the sample time ``dt`` (`emsid.io.reading.Blocks`).
        first: the first of these rows.
        at: the row of the first sample of the segment.
        stop: the row of the next segment, or the one after the last row.
    """

    read: Callable[[int, int, int, float], Iterator[Record]] | None
    first: int
    at: int
    stop: int


@dataclass(frozen=True, eq=False, repr=False)
class Record(Presented, FrameMethods, UnitMethods):
    """A sampled experiment. Its samples are read-only and independent of the arrays it was made from.

    Args:
        input: (N, nu) inputs; a 1-D array is one channel.
        output: (N, ny) outputs; a 1-D array is one channel. Omit it if only an input is known.
        dt: sample time in seconds; required.
        input_names, output_names: a name for every channel, ``u1, u2, …`` and ``y1, y2, …`` by default; a string is the
            name of one channel.
        input_units, output_units: a unit for every channel, in the same form; empty if unknown.
        breaks: the first sample of every further segment, ascending; empty for a record without gaps.
        times: the time in seconds of the first sample of every segment; by default the segments follow each other.
        name: the source of the record, for messages and figures.
        sources: of several experiments that were joined, the name of the one that each segment is from; else empty.
        time_axis: the regularity of the time column in the file; None if the sample time was given instead.
        findings: what was noticed when the file was read.
        conversions: by channel, gain and offset from the numbers of the file to the values of the channel; empty for a
            record that was not read from a file.
        before: by segment, the samples right before it, or None; empty where nothing is known before any. They are no
            part of the record. A free run begins with them, so that it enters the segment in the state that the inputs
            have led to (see `part`).
        excerpt_of: by segment, the rows of a larger file that it stands for, see `FileRows`; empty for other records.
        signals: by output, what it measures, where its unit does not say it to a plant: ``"rotor speed"``,
            ``"load speed"``, ``"speed"``, ``"position"`` or ``"current"``.

    Raises:
        DataError: for arrays of other shapes, unequal lengths, no sample, values that are not finite, a bad sample
            time, a name used twice.
    """

    input: Array
    output: Array = None  # type: ignore[assignment]  # an array once it is made
    dt: float = nan
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    breaks: tuple[int, ...] = ()
    times: tuple[float, ...] = ()
    name: str = "record"
    sources: tuple[str, ...] = ()
    time_axis: TimeAxis | None = None
    findings: tuple[Finding, ...] = ()
    conversions: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    before: tuple[Record | None, ...] = ()
    signals: Mapping[str, str] = field(default_factory=dict)
    excerpt_of: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        check_types(self.__dict__, KINDS | {"before": items_of(Record), "excerpt_of": items_of(FileRows)})
        for each in ("input_names", "output_names", "input_units", "output_units"):
            self._put(each, names_of(getattr(self, each), each, self.name))
        if self.output is None:
            self._put("output", np.empty((np.shape(self.input)[0] if np.ndim(self.input) else 0, 0)))
        for side in ("input", "output"):
            names = getattr(self, f"{side}_names")
            self._put(side, as_channels(getattr(self, side), f"{self.name}: {side}", len(names)))
        if len(self.input) != len(self.output):
            raise DataError(
                f"{self.name}: input has {len(self.input)} samples and output {len(self.output)}; they must agree"
            )
        if not len(self.input):
            raise DataError(f"{self.name}: there are no samples; a record needs at least one")
        if not (NUMBER.fits(self.dt) and np.isfinite(float(self.dt)) and self.dt > 0):
            given = "no sample time" if self.dt is nan else f"sample time {brief(self.dt)} s"
            raise DataError(f"{self.name}: {given}; give a positive number of seconds as dt")
        self._put("dt", float(self.dt))
        self._complete_channels()
        self._complete_segments()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """A record from another process is read-only too."""
        self.__dict__.update(state)
        for array in (self.input, self.output):
            array.flags.writeable = False

    def _put(self, field: str, value: object) -> None:
        """Set a field while the record is made; it is frozen for everybody else."""
        object.__setattr__(self, field, value)

    def _complete_channels(self) -> None:
        """Complete the names and units of the channels, and refuse wrong ones and values that are not finite."""
        for side, letter in (("input", "u"), ("output", "y")):
            width = getattr(self, side).shape[1]
            names = getattr(self, f"{side}_names") or tuple(f"{letter}{k + 1}" for k in range(width))
            units = getattr(self, f"{side}_units") or ("",) * width
            for what, values in (("names", names), ("units", units)):
                if len(values) != width:
                    raise DataError(f"{self.name}: {len(values)} {side} {what} for {width} {side} channels")
            self._put(f"{side}_names", names)
            self._put(f"{side}_units", units)
            check_finite(getattr(self, side), names, self.name)
        channels = self.input_names + self.output_names
        self._put("signals", named_signals(self))
        twice = next((name for name in channels if channels.count(name) > 1), None)
        if twice is not None:
            raise DataError(f"{self.name}: two channels are called {twice!r}; every channel needs its own name")

    def _complete_segments(self) -> None:
        """Complete the times of the segments, and refuse breaks, times and sources that do not agree."""
        for what, values in segments_of(self).items():
            self._put(what, values)
        if len(self.excerpt_of) != len(self.times):
            self._put("excerpt_of", ())

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        *,
        input: str | Sequence[str],
        output: str | Sequence[str] = (),
        time: str | None = None,
        dt: float | None = None,
        units: Mapping[str, str] | None = None,
        resample: bool = False,
        name: str = "frame",
    ) -> Record:
        """A record from the columns of a pandas frame, a Polars frame, or a dictionary of arrays.

        >>> Record.from_frame({"t": [0.0, 0.1, 0.2], "v": [0, 1, 1], "w": [0, 0, 2.5]}, input="v", output="w", time="t")
        Record(frame: 3 samples, dt 0.1 s; v, w)

        Args:
            frame: where the columns are.
            input, output: the input and the output columns; one name or several.
            time: the column with the time, or the name of the index of a pandas frame: dates and times, or numbers in
                the unit in ``units`` or at the end of the name (``time_ms``), else seconds. Without it and without
                ``dt``, the index is the time.
            dt: sample time in seconds, if there is no time column.
            units: the unit of each column; these channels are converted to SI, as by `emsid.read`.
            resample: resample an irregular time axis to an equidistant one; inputs are held, outputs interpolated.
            name: of the record.

        Raises:
            DataError: for a column that does not exist, is named twice or holds no numbers; for an irregular time,
                units of other columns, or a missing sample time.
        """
        inputs, outputs = as_names(input), as_names(output)
        given = dict(units or {})
        unit_of_time = None if time is None or time in (*inputs, *outputs) else given.pop(time, None)
        strange = [column for column in given if column not in (*inputs, *outputs)]
        if strange:
            raise DataError(
                f"{name}: units are given for {strange[0]!r}, which is neither input nor output, nor the time"
            )
        at = None if dt is not None and time is None else seconds(frame, time, unit_of_time)
        if at is None and dt is None:
            raise DataError(f"{name}: no sample time; give dt in seconds, or the time column")
        axis = None if at is None else time_axis(at)
        if axis is not None and not (axis.regular or resample):
            raise DataError(f"{name}: the time is not regular: {axis}; give resample=True to make it equidistant")
        if axis is not None and dt is not None and not resample and not np.isclose(dt, axis.dt, rtol=0.01, atol=0.0):
            raise DataError(f"{name}: the time has a step of {axis.dt:g} s and dt is {dt:g} s; leave one of them out")
        record = cls(
            numbers(frame, inputs),
            numbers(frame, outputs),
            axis.dt if axis is not None and dt is None else dt,  # type: ignore[arg-type]
            inputs,
            outputs,
            tuple(given.get(column, "") for column in inputs),
            tuple(given.get(column, "") for column in outputs),
            times=() if at is None else (float(at[0]),),
            name=name,
            time_axis=axis,
            findings=() if axis is None else tuple(about_time(axis, name, dt, resample)),
        )
        if resample and at is not None:
            record = record.resample(on_timer(at) if axis is not None and axis.gaps else at, dt)
        return record.convert() if given else record

    def __len__(self) -> int:
        return len(self.input)

    def __repr__(self) -> str:
        channels = ", ".join(
            f"{name_and_unit(name)[0]} [{readable_unit(unit)}]" if unit else name
            for name, unit in zip(
                self.input_names + self.output_names, self.input_units + self.output_units, strict=True
            )
        )
        pieces = f" in {len(self.breaks) + 1} segments" if self.breaks else ""
        return f"Record({self.name}: {len(self)} samples{pieces}, dt {self.dt:g} s; {channels})"

    def __str__(self) -> str:
        return repr(self)  # a record has no table, so that to print one loads no report

    @property
    def time(self) -> Array:
        """(N,) time of every sample in seconds."""
        edges = (0, *self.breaks, len(self))
        return np.concatenate(
            [start + self.dt * np.arange(b - a) for start, (a, b) in zip(self.times, pairwise(edges), strict=True)]
        )

    @property
    def experiments(self) -> tuple[str, ...]:
        """The name of the experiment that each segment is from: its own name, unless experiments were joined."""
        return self.sources or (self.name,) * (len(self.breaks) + 1)

    @property
    def segments(self) -> tuple[Record, ...]:
        """The pieces without a gap, each as a record (views, no copies)."""
        edges = (0, *self.breaks, len(self))
        return tuple(self[a:b] for a, b in pairwise(edges)) if self.breaks else (self,)

    def __getitem__(self, rows: slice) -> Record:
        """Samples ``rows`` (a slice without a step), keeping breaks and time.

        What is before the first of them is left out, unless a segment begins there; see `part`.
        """
        if not SLICE.fits(rows) or rows.step not in (None, 1):
            raise DataError(f"{self.name}: a record is sliced as record[a:b], without a step")
        start, stop, _ = rows.indices(len(self))
        if stop <= start:
            raise DataError(f"{self.name}: rows {rows.start}:{rows.stop} select none of its {len(self)} samples")
        edges = (0, *self.breaks)
        first = max(k for k, edge in enumerate(edges) if edge <= start)
        inside = [(b, t) for b, t in zip(self.breaks, self.times[1:], strict=True) if start < b < stop]
        lead = self.before[first] if self.before and start == edges[first] else None
        before = (lead, *self.before[first + 1 :])[: len(inside) + 1]
        return self._having(
            input=self.input[start:stop],
            output=self.output[start:stop],
            breaks=tuple(b - start for b, _ in inside),
            times=(self.times[first] + (start - edges[first]) * self.dt, *(t for _, t in inside)),
            sources=self.sources[first : first + len(inside) + 1],
            before=before if any(each is not None for each in before) else (),
            excerpt_of=self._rows_of(start, stop, first, first + len(inside) + 1),
        )

    def _rows_of(self, start: int, stop: int, first: int, last: int) -> tuple[FileRows, ...]:
        """The rows of a larger file that samples ``start`` to ``stop`` stand for, in segments ``first`` to ``last``."""
        found = list(self.excerpt_of[first:last])
        if found:
            edges = (0, *self.breaks, len(self))
            if stop < edges[last]:
                found[-1] = found[-1]._replace(stop=found[-1].at + stop - edges[last - 1])
            if start > edges[first]:
                at = found[0].at + start - edges[first]
                found[0] = found[0]._replace(first=at, at=at)
        return tuple(found)

    def blocks(self, lead: int) -> Iterator[Record]:
        """The record itself; of an excerpt of a larger file, all samples that it stands for, in parts one by one.

        Args:
            lead: the samples before those of a part that are repeated at its start, where they are in its segment.

        Raises:
            DataError: for a row of the file that cannot be read.
        """
        joined: list[FileRows] = []
        for each in self.excerpt_of:
            if joined and joined[-1].read is each.read and joined[-1].stop == each.first:
                joined[-1] = joined[-1]._replace(stop=each.stop)
            else:
                joined.append(each)
        if not joined:
            yield self
        for rows in joined:
            assert rows.read is not None  # it is set by the reader
            yield from rows.read(rows.first, rows.stop, lead, self.dt)

    def _having(self, **changes: Any) -> Record:
        """The same with parts of its own values, which need no check: a search takes thousands of segments."""
        made = object.__new__(type(self))
        made.__dict__.update({each.name: self.__dict__[each.name] for each in fields(self)} | changes)
        return made

    @typed(first=WHOLE, stop=WHOLE)
    def part(self, first: int, stop: int) -> Record:
        """Samples ``first`` to ``stop``, with the samples before them from the beginning of the segment.

        A free run over the part begins with these and goes on through it; errors are those of the part alone.
        """
        part: Record = _part_with_lead(self, first, stop)
        return part

    @typed(fraction=NUMBER)
    def split(self, fraction: float) -> tuple[Record, Record]:
        """The first ``fraction`` of the samples, to fit, and the rest, as unseen data.

        A free run over the rest begins with the first part, see `part`.

        Raises:
            DataError: for a fraction that leaves either part without a sample.
        """
        if not 0 < fraction < 1:
            raise DataError(f"{self.name}: cannot split at {fraction}; give a fraction between 0 and 1")
        at = round(fraction * len(self))
        if not 0 < at < len(self):
            raise DataError(f"{self.name}: {len(self)} samples cannot be split at {fraction:g}; record longer")
        return self[:at], self.part(at, len(self))

    def mask(self, leave_out: ArrayLike) -> Record:
        """The record without the samples where ``leave_out`` (N,) is true. Every gap starts a new segment.

        Raises:
            DataError: for a mask of another length, or one that leaves nothing.
        """
        out = np.asarray(leave_out, dtype=bool)
        if out.shape != (len(self),):
            raise DataError(f"{self.name}: a mask of shape {out.shape} for {len(self)} samples")
        if out.all():
            raise DataError(f"{self.name}: the mask leaves no sample; relax it")
        kept = np.flatnonzero(~out)
        starts = np.flatnonzero(np.diff(kept, prepend=kept[0] - 1) > 1)
        if self.breaks:
            starts = np.union1d(starts, np.searchsorted(kept, self.breaks))
        starts = starts[(starts > 0) & (starts < len(kept))]
        begins = kept[np.concatenate([[0], starts]).astype(int)]
        of = np.searchsorted(self.breaks, begins, "right")
        whole = [at in (0, *self.breaks) for at in begins]
        ends, edges = kept[np.append(starts, len(kept)).astype(int) - 1] + 1, (0, *self.breaks, len(self))
        return replace(
            self,
            input=self.input[kept],
            output=self.output[kept],
            breaks=tuple(int(b) for b in starts),
            times=tuple(float(t) for t in self.time[begins]),
            before=tuple(self.before[k] if all_ else None for k, all_ in zip(of, whole, strict=True))
            if self.before
            else (),
            sources=tuple(self.sources[k] for k in of) if self.sources else (),
            excerpt_of=tuple(
                FileRows(
                    rows.read,
                    rows.first if begin == edges[k] else int(rows.at + begin - edges[k]),
                    int(rows.at + begin - edges[k]),
                    rows.stop if end == edges[k + 1] else int(rows.at + end - edges[k]),
                )
                for k, begin, end in zip(of, begins, ends, strict=True)
                for rows in self.excerpt_of[k : k + 1]
            ),
        )

    @typed(name=TEXT)
    def channel(self, name: str) -> Array:
        """(N,) the samples of one channel by name; a unit in brackets may be left out.

        Raises:
            DataError: where there is no such channel, or several.
        """
        own = self._own_name(name)
        if own in self.input_names:
            return self.input[:, self.input_names.index(own)]
        return self.output[:, self.output_names.index(own)]

    def _own_name(self, name: str) -> str:
        """The name of the channel that is called so, with or without its unit."""
        units = dict(zip(self.input_names + self.output_names, self.input_units + self.output_units, strict=True))
        found = called(name, units)
        if len(found) > 1:
            raise DataError(f"{self.name}: several channels are called {name!r}: {', '.join(found)}; give the unit too")
        if not found:
            raise DataError(f"{self.name}: no channel {name!r}; there are {', '.join(units)}")
        return found[0]

    def detrend(self, order: int = 0) -> Record:
        """The record minus a polynomial in time of this order, fitted to every channel over the whole record.

        Order 0 subtracts the mean. All segments share one polynomial, so they keep one operating point.

        Raises:
            DataError: for an order above `LARGEST_TREND`.
        """
        problem = f"{self.name}: detrending of order {brief(order)}; give 0 (mean), 1 (line) or at most {LARGEST_TREND}"
        order = whole_number(order, 0, problem)
        if order > LARGEST_TREND:
            raise DataError(f"{problem}, because a higher order subtracts the motion too", arguments=("detrend",))
        u, y = (without_trend(values, self.time, order) for values in (self.input, self.output))
        return replace(self, input=u, output=y, before=(), excerpt_of=())

    def decimate(self, factor: int) -> Record:
        """Every ``factor``-th sample after a zero-phase FIR anti-alias filter, segment by segment.

        Raises:
            DataError: where a segment is too short for the filter (20 samples of the slow rate).
        """
        problem = f"{self.name}: cannot decimate by {brief(factor)}; give a whole number of at least 1"
        factor = whole_number(factor, 1, problem)
        if factor == 1:
            return self
        shortest = min(map(len, self.segments))
        if shortest <= DECIMATED * factor:
            raise DataError(
                f"{self.name}: a segment of {shortest} samples is too short to decimate by "
                f"{brief(factor)}; it needs more than {brief(DECIMATED * factor)}"
            )
        inputs = [decimated(segment.input, factor) for segment in self.segments]
        outputs = [decimated(segment.output, factor) for segment in self.segments]
        return replace(
            self,
            input=np.concatenate(inputs),
            output=np.concatenate(outputs),
            dt=self.dt * factor,
            breaks=tuple(np.cumsum([len(piece) for piece in inputs[:-1]])),
            time_axis=None,
            before=(),
            excerpt_of=(),
        )

    @typed(dt=NUMBER)
    def resample(self, time: ArrayLike, dt: float | None = None) -> Record:
        """The record at equidistant times, from the times at which it was measured.

        Inputs are held from sample to sample (they come from a digital output), outputs are interpolated linearly.
        Where the new sample time is longer than the old one, decimate first: this function does not filter.

        Args:
            time: (N,) the time of every sample in seconds, ascending; of samples with equal times the last is used.
                The record's own ``dt`` is ignored, and it must be a single segment.
            dt: the new sample time in seconds; by default that of `time_axis`.

        Raises:
            DataError: if the times do not ascend or do not match the record, or if the new sample time is unreasonable.
        """
        t = real_numbers(time, f"{self.name}: time")
        if t.shape != (len(self),) or self.breaks:
            raise DataError(f"{self.name}: resampling takes one segment and a time for each of its samples")
        step = time_axis(t).dt if dt is None else float(dt)
        try:
            u, y = equidistant(t, self.input, self.output, step)
        except DataError as error:
            raise DataError(f"{self.name}: {error}") from None
        return replace(self, input=u, output=y, dt=step, times=(float(t[0]),), time_axis=None, before=(), excerpt_of=())

    @typed(cutoff=NUMBER)
    def lowpass(self, cutoff: float) -> Record:
        """Every channel through a Butterworth low-pass filter of order 4, forwards and backwards, segment by segment.

        The filter has no delay. It is the same for inputs and outputs, so that linear relations between them remain.

        Args:
            cutoff: frequency in Hz at which the amplitude is halved.

        Raises:
            DataError: for a frequency that is not between 0 and half the sampling frequency, or a segment that is too
                short for the filter.
        """
        if not LOWEST / self.dt <= cutoff < 0.5 / self.dt:
            least = LOWEST / self.dt if 0 < cutoff < LOWEST / self.dt else 0
            raise DataError(
                f"{self.name}: a cutoff of {cutoff:g} Hz; give one between {least:g} and {0.5 / self.dt:g} Hz, half "
                "the sampling frequency",
                arguments=("filter",),
            )
        shortest = min(map(len, self.segments))
        if shortest <= FILTERED:
            raise DataError(
                f"{self.name}: a segment of {shortest} samples is too short to filter; {FILTERED + 1} are needed"
            )

        def filtered(side: str) -> Array:
            return np.concatenate([low_passed(getattr(piece, side), cutoff, self.dt) for piece in self.segments])

        output = filtered("output") if self.output.shape[1] else self.output
        return replace(self, input=filtered("input"), output=output, before=(), excerpt_of=())

    @typed(name=TEXT, gain=NUMBER, offset=NUMBER, unit=TEXT)
    def scale(self, name: str, gain: float, offset: float = 0.0, unit: str | None = None) -> Record:
        """Channel ``name`` replaced by gain·x + offset, with its new unit."""
        name = self._own_name(name)
        changes: dict[str, Any] = {
            "excerpt_of": (),
            "before": [each and each.scale(name, gain, offset, unit) for each in self.before],
        }
        for side in ("input", "output"):
            names: tuple[str, ...] = getattr(self, f"{side}_names")
            if name in names:
                k = names.index(name)
                values, units = getattr(self, side).copy(), list(getattr(self, f"{side}_units"))
                with np.errstate(over="ignore", invalid="ignore"):  # refused by the new record
                    values[:, k] = gain * values[:, k] + offset
                units[k] = units[k] if unit is None else unit
                changes |= {side: values, f"{side}_units": tuple(units)}
        if name in self.conversions:
            first, added = self.conversions[name]
            changes["conversions"] = {**self.conversions, name: (gain * first, gain * added + offset)}
        return replace(self, **changes)

    def converted(self, name: str, number: float) -> float:
        """The value of channel ``name`` where the file has this number.

        The sample closest to the result is returned if it differs by rounding only, so that values can be compared.
        """
        gain, offset = self.conversions.get(self._own_name(name), (1.0, 0.0))
        value, samples = gain * number + offset, self.channel(name)
        closest = float(samples[np.argmin(np.abs(samples - value))])
        return closest if np.isclose(closest, value, rtol=1e-9, atol=1e-12 * float(np.ptp(samples))) else value


def _part_with_lead(record: Record, first: int, stop: int) -> Record:
    """Samples ``first`` to ``stop`` of a record; ``before`` of the part has those from the beginning of its segment."""
    here = record[first:stop]
    number = int(np.searchsorted(record.breaks, first, "right"))
    edge = (0, *record.breaks)[number]
    if first == edge:
        return here
    known = record.before[number] if record.before else None
    lead = replace(record[edge:first], before=())
    if known is not None:
        u, y = np.concatenate([known.input, lead.input]), np.concatenate([known.output, lead.output])
        lead = replace(lead, input=u, output=y, times=known.times)
    rest = record.before[number + 1 : number + 1 + len(here.breaks)] or (None,) * len(here.breaks)
    return replace(here, before=(lead, *rest))


LARGEST_TREND = 5
"""The largest order of a trend. One of a higher order follows the motion, which is then subtracted too."""
DECIMATED, FILTERED = 20, 15
"""Samples of the slow rate, and of the record, that a segment must exceed for a filter to settle within it."""
LOWEST = 1e-5
"""The lowest cutoff as a part of the sampling frequency: below, the filter's poles lose half of their digits."""


def without_trend(values: Array, time: Array, order: int) -> Array:
    """The samples minus a polynomial of this order in the time (N,), fitted to every channel."""
    span = time[-1] - time[0]
    within = 2 * (time - time[0]) / span - 1 if span else np.zeros_like(time)
    powers = np.polynomial.legendre.legvander(within, order)
    size = np.maximum(np.abs(values).max(axis=0, initial=0.0), np.finfo(float).tiny)  # LAPACK must not overflow
    return np.asarray(values - size * (powers @ np.linalg.lstsq(powers, values / size, rcond=None)[0]))


def decimated(values: Array, factor: int) -> Array:
    """Every ``factor``-th sample after a zero-phase FIR anti-alias filter.

    `scipy.signal.decimate` assumes that the signal is zero before its start. Subtracting the first value avoids a false
    transient where the signal starts at a constant level.
    """
    from scipy.signal import decimate

    return np.asarray(decimate(values - values[:1], factor, ftype="fir", axis=0) + values[:1])


def low_passed(values: Array, cutoff: float, dt: float) -> Array:
    """The samples through a Butterworth filter of order 4, forwards and backwards, at a sample time of ``dt`` in s."""
    from scipy.signal import butter, sosfiltfilt

    return np.asarray(sosfiltfilt(butter(4, cutoff, fs=1 / dt, output="sos"), values, axis=0))
