"""The data of a session: what the first look finds, the record that is read, and marks on its plot.

Windows of long signals: the lowest and highest value in every pixel, as float32.

A window of W pixels takes one pass over its samples, whatever their number: two values a pixel show every extreme,
which thinning would lose. Times are relative to the beginning of the window, of which float32 resolves a
ten-millionth.
"""

from __future__ import annotations

import subprocess
import sys
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from threading import Lock, RLock, Thread
from time import sleep
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

import emsid
from emsid.errors import DataError, EmsidError
from emsid.estimation.borders import border
from emsid.findings import Finding, plain
from emsid.first_look.outliers import outliers_of
from emsid.first_look.standstill import at_rest
from emsid.io import ParsedFile, read_columns
from emsid.io.columns import errors_of, from_arrays
from emsid.io.large import held_excerpt
from emsid.io.reading import prepared
from emsid.record import Record
from emsid.record.joining import check_same_channels
from emsid.record.time_axis import NOTABLE, SECONDS
from emsid.report.views.first_look import HEADER, column_table, lines
from emsid.studio.session import KINDS, Session, named
from emsid.studio.words import field_name, said
from emsid.wording import sentence, severity

KEPT = 8
"""Files, looks and records that are kept in memory."""
MOST_BYTES = 500_000_000
"""Memory of these, beside the last few: a record of two million samples with its plots takes 100 MB."""
LONG = 20_000
"""Samples; a look at a longer file, which takes half a second or more, is repeated in the background after a change."""
EXCERPT = 1 << 17
"""Rows of the first look at a longer file, which takes 2 s of processor time; at two million rows it takes 25 s. The
look at all rows follows in a process of its own, so that it does not hold up the answers of the server."""
PAUSE = 1.0
"""Seconds before a look in the background: longer than changes that follow each other take."""
MOST_PAIRS = 8000
"""Points in a plot of a column against another."""
MOST_MARKS = 200
"""Marks in a plot; more cannot be told apart."""
SHORTEST = 5
"""Equal samples at the extreme of a channel that are marked as saturation."""
PREPARED = ("filter", "decimate", "detrend")
"""Arguments of `emsid.read` that it applies to the record that the others give."""
OWN = ("mask", "rows")
"""Arguments of `emsid.read` about samples, which concern the file that they were said of and no other."""
NEAR = 10
"""Samples between two jittering steps that are marked as one stretch."""
SENTENCES = {
    "gap": ("gap", "missing", "mask", "segment", "break"),
    "outlier": ("outlier",),
    "saturation": ("saturat", "cut-off", "limit"),
    "standstill": ("standstill", "motion"),
    "jitter": ("jitter", "clock-irregular"),
}
"""Parts of the codes of the findings that belong to a kind of mark."""


def arguments(given: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `emsid.read` from their form in JSON, in which rows are a pair."""
    rows = given.get("rows")
    return {**given, "rows": slice(*rows)} if isinstance(rows, (list, tuple)) else dict(given)


def as_json(reading: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `emsid.read` for JSON; numbers have the digits with which they are written on a command line."""

    def plainly(value: Any) -> Any:
        if isinstance(value, slice):
            return [value.start, value.stop]
        if isinstance(value, Mapping):
            return {name: plainly(each) for name, each in value.items()}
        return float(f"{value:.10g}") if isinstance(value, float) else value

    return {name: plainly(value) for name, value in reading.items()}


@dataclass(frozen=True)
class Look:
    """What the page shows of a first look, in built-in types, so that another process can make it.

    Args:
        reading: arguments of `emsid.read` that were found.
        mends: further ones, which leave out what findings say is wrong.
        findings: code, subject and data of each.
        rows, caption, lines: the table of the columns, and what is known besides.
        units: of the columns.
        clock: name and unit of the time column, and the sample time in s.
        whole: whether all rows were looked at with all arguments that are given.
    """

    reading: dict[str, Any]
    mends: dict[str, Any]
    findings: list[dict[str, Any]]
    rows: list[list[str]]
    caption: str
    lines: list[str]
    units: dict[str, str]
    clock: tuple[str, str, float]
    whole: bool

    @classmethod
    def at(cls, parsed: ParsedFile, given: Mapping[str, Any], most: int | None = None) -> Look:
        """Look at a file, or at an excerpt of about ``most`` rows.

        Raises:
            EmsidError: where what is given cannot be used.
        """
        part = parsed.columns if most is None else held_excerpt(parsed.columns, most)
        look, whole = emsid.describe(replace(parsed, columns=part), **arguments(given)), part is parsed.columns
        table = column_table(look, 60)
        return cls(
            as_json(look.reading),
            as_json(look.mends),
            [plain(f.to_data()) for f in look.findings if whole or f.code != "read-in-part"],  # a fit takes all rows
            [list(map(str, row)) for row in table.rows],
            table.caption,
            [line for line in lines(look) if not line.startswith("- ")],
            {column.name: column.meaning.unit for column in look.columns},
            (look.clock.column, look.clock.unit, look.clock.dt),
            whole,
        )

    @classmethod
    def expected(cls, reading: Mapping[str, Any]) -> Look:
        """What is known before a look at a file whose reading is known."""
        return cls(as_json(reading), {}, [], [], "", [], {}, ("", "", 0.0), False)


class Data:
    """Files, looks and records of a session, each made once.

    Args:
        session: whose data they are.
        announce: called where a look that took long is there.
    """

    def __init__(self, session: Session, announce: Callable[[], None]) -> None:
        self.session, self.announce = session, announce
        self._made: OrderedDict[str, Any] = OrderedDict()
        self._making: dict[str, Lock] = {}
        self._names: dict[str, set[str]] = {}
        self._looks: dict[str, dict[str, Look]] = {}
        self._last: dict[str, tuple[dict[str, Any], Look]] = {}
        self._wanted: dict[str, dict[str, Any]] = {}
        self._looking: dict[str, subprocess.Popen[bytes] | None] = {}
        self._count = 0
        self._lock = RLock()

    def _once(self, key: str, make: Callable[[], Any]) -> Any:
        with self._lock:
            own = self._making.setdefault(key, Lock())
        with own:  # others wait for the same thing only
            with self._lock:
                known = key in self._made
                found = self._made.get(key)
            if not known:
                found = make()
            with self._lock:
                self._made[key] = found
                self._made.move_to_end(key)
                self._making.pop(key, None)
                held = sum(map(_bytes, self._made.values()))
                while len(self._made) > 4 * KEPT or (held > MOST_BYTES and len(self._made) > KEPT):
                    held -= _bytes(self._made.popitem(last=False)[1])
        return found

    def parsed(self, name: str) -> ParsedFile:
        """The columns of a file, read once while it does not change."""
        path = self.session.path(name)
        key = f"file {name} {self.session.stamp(name)}"
        return self._once(key, lambda: ParsedFile(path, read_columns(path)))  # type: ignore[no-any-return]

    def expect(self, name: str, reading: Mapping[str, Any]) -> None:
        """Read a file like this until it was looked at, which is done in the background."""
        self._last[self._stamp(name)] = {}, Look.expected(reading)

    def _stamp(self, name: str) -> str:
        return f"{name} {self.session.stamp(name)}"

    def _latest(self, name: str, given: Mapping[str, Any]) -> tuple[Mapping[str, Any], Look]:
        """The look with these arguments; of a long file, the last one with its arguments, and a new one follows.

        Raises:
            EmsidError: where the file cannot be looked at like this.
        """
        stamp = self._stamp(name)
        with self._lock:
            known = self._looks.get(stamp, {}).get(str(sorted(given.items(), key=str)))
            last = self._last.get(stamp)
        if known is not None:
            self._last[stamp] = dict(given), known
            return given, known
        parsed = self.parsed(name)
        if last is None or (last[1].whole and self._length(parsed) < LONG):
            made: Look = self._once(f"look {stamp} {given}", lambda: Look.at(parsed, given, EXCERPT))
            last = self._keep(stamp, given, made)
            if made.whole:
                return last
        with self._lock:
            if self._wanted.get(name) != given:
                self._wanted[name] = dict(given)
                process = self._looking.get(name)
                if process is not None:  # its look is of other arguments
                    process.kill()
            if name not in self._looking:
                self._looking[name] = None
                Thread(target=self._follow, args=(name,), daemon=True).start()
        return last

    @staticmethod
    def _length(parsed: ParsedFile) -> int:
        return max(map(len, parsed.columns.series.values()))

    def _keep(self, stamp: str, given: Mapping[str, Any], look: Look) -> tuple[dict[str, Any], Look]:
        with self._lock:
            if look.whole:
                known = self._looks.setdefault(stamp, {})
                known[str(sorted(given.items(), key=str))] = look
                while len(known) > KEPT:
                    del known[next(iter(known))]
            self._last[stamp] = dict(given), look
            self._count += 1
            return self._last[stamp]

    def _follow(self, name: str) -> None:
        """Look at a file until there is a look with the arguments that were asked for last.

        It begins after a pause, so that the answer to the correction itself, and those that follow, do not wait for it.
        """
        while True:
            sleep(PAUSE)
            given, stamp, problems = self._wanted[name], self._stamp(name), list[EmsidError]()
            with border("look", report=problems.append):
                parsed = self.parsed(name)
                small = self._length(parsed) <= EXCERPT
                self._keep(stamp, given, Look.at(parsed, given) if small else self._elsewhere(name, given))
            with self._lock:
                if self._wanted[name] == given:
                    del self._wanted[name], self._looking[name]
                    break
        if problems:  # what is known stays
            self._keep(stamp, given, replace(self._last[stamp][1], whole=True))
        self.announce()

    def _elsewhere(self, name: str, given: Mapping[str, Any]) -> Look:
        """A look at all rows in another process.

        Raises:
            DataError: where the file cannot be looked at like this, or the process was ended.
        """
        words = [sys.executable, "-m", "emsid.studio.look", str(self.session.path(name))]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
            with self._lock:
                self._looking[name] = process
            found, _ = process.communicate(msgspec.json.encode(given))
        with self._lock:
            self._looking[name] = None
        with suppress(msgspec.MsgspecError):
            return msgspec.json.decode(found, type=Look)
        raise DataError(found.decode(errors="replace") or "the file could not be looked at")

    def close(self) -> None:
        """End the looks in the background."""
        with self._lock:
            for process in self._looking.values():
                if process is not None:
                    process.kill()

    def _columns(self, name: str) -> set[str]:
        """The names of the columns of a file."""
        key = f"{name} {self.session.stamp(name)}"
        if key not in self._names:
            self._names[key] = set(self.parsed(name).columns.series)
        return self._names[key]

    def _leader(self, step: Mapping[str, Any], name: str) -> str:
        """The file like which another one is read: the first one if it has the same columns, else itself."""
        first = step["files"][0] if step["files"] else name
        return first if name == first or self._columns(name) == self._columns(first) else name

    def reading(self, step: Mapping[str, Any], name: str, own: bool = True) -> dict[str, Any]:
        """The arguments of `emsid.read` for a file, for JSON: those found, repairs, and corrections.

        Where a look takes long, the corrections are put into the last one: what is shown is what is fitted. A file with
        the same columns as the first one is read like it; what was said of samples stays with its file.

        Args:
            step: with this file.
            name: of the file.
            own: whether what was said of samples of the file belongs to them.
        """
        leader = self._leader(step, name)
        said = {**step["given"].get(leader, {})}
        if leader != name or not own:
            said = {key: value for key, value in said.items() if key not in OWN}
            said |= step["given"].get(name, {}) if own else {}
        before, look = self._latest(leader, said)
        reading = {**look.reading, **{key: value for key, value in look.mends.items() if key not in said}}
        if before != said:
            reading = {key: value for key, value in reading.items() if key in said or key not in before}
            for key, value in said.items():
                both = isinstance(value, Mapping) and isinstance(reading.get(key), Mapping)
                reading[key] = {**reading[key], **value} if both else value
        return as_json({key: value for key, value in reading.items() if value not in ("", None, {}, [])})

    def record(self, step: Mapping[str, Any], name: str) -> Record:
        """The record in a file."""
        return self._read(name, self.reading(step, name))

    def _read(self, name: str, reading: Mapping[str, Any]) -> Record:
        """A record; those that differ in their preparation only are made of one that is read once."""
        given, parsed = arguments(reading), self.parsed(name)
        last = {key: given.pop(key) for key in PREPARED if key in given}
        plainly: Record = self._of("record", name, as_json(given), lambda: emsid.read(parsed, **given))
        if not last:
            return plainly
        with errors_of(parsed.path):
            return self._of("record", name, reading, lambda: prepared(plainly, **last))  # type: ignore[no-any-return]

    def _of(self, what: str, name: str, reading: Mapping[str, Any], make: Callable[[], Any]) -> Any:
        """Something of the record in a file, made once while neither the file nor its reading changes."""
        return self._once(f"{what} {name} {self.session.stamp(name)} {reading}", make)

    def _signal(self, name: str, reading: Mapping[str, Any], column: str) -> Signal:
        """A channel of the record in a file, or another column of the file at the same samples; contiguous."""

        def make() -> Signal:
            record = self._read(name, reading)
            if column in (*record.input_names, *record.output_names):
                return Signal(record.time, np.ascontiguousarray(record.channel(column)), record.dt)
            other = self._beside(name, reading, column, self.parsed(name))
            return Signal(other.time, np.ascontiguousarray(other.output[:, 0]), other.dt)

        return self._of(f"signal {column}", name, reading, make)  # type: ignore[no-any-return]

    def signals(self, step: Mapping[str, Any], asked: Mapping[str, Any]) -> list[Signal]:
        """Signals that are asked for: ``file``, ``columns``, and perhaps ``given``, arguments that replace others.

        Raises:
            DataError: where there is no such file.
            EmsidError: where it cannot be read with these arguments.
        """
        name = asked["file"]
        if name not in named(step):
            raise DataError("there is no such file")
        reading = {**self.reading(step, name), **asked.get("given", {})}
        reading = {key: value for key, value in reading.items() if value not in ("", None, {}, [])}
        found = [self._signal(name, reading, str(column)) for column in asked["columns"]]
        time = found[0].time
        return [
            each
            if len(each.time) == len(time)
            else replace(each, time=time, values=np.interp(time, each.time, each.values))
            for each in found
        ]

    def pairs(self, step: Mapping[str, Any], asked: Mapping[str, Any]) -> bytes:
        """The values of two columns at the same samples between two times, thinned: their number, x and y."""
        x, y = self.signals(step, asked)
        a, b = np.searchsorted(x.time, [float(asked["from"]), float(asked["to"])])
        rows = slice(int(a), int(b) + 1, max(1, int(b - a) // MOST_PAIRS + 1))
        both = [each.values[rows].astype("<f4") for each in (x, y)]
        return np.uint32(len(both[0])).tobytes() + b"".join(each.tobytes() for each in both)

    def described(self, step: Mapping[str, Any], name: str) -> dict[str, Any]:
        """Everything about a file, for the page.

        Raises:
            DataError: where there is no such file.
            EmsidError: where it cannot be read.
        """
        if name not in named(step):
            raise DataError("there is no such file")
        reading, leader = self.reading(step, name), self._leader(step, name)
        given = step["given"].get(name, {}) if leader == name else reading
        before, look = self._latest(name, given)
        notes: list[dict[str, Any]] = [
            {
                "code": finding.code,
                "text": sentence(finding, field_name),
                "severity": severity(finding).value,
                "given": channels_for(finding, reading),
                "kind": _kind(finding),
            }
            for finding in (Finding(**each) for each in look.findings)
        ]
        found: dict[str, Any] = {
            "file": name,
            "header": HEADER,
            "rows": look.rows,
            "caption": look.caption,
            "lines": look.lines,
            "findings": notes,
            "reading": reading,
            "like": "" if leader == name else leader,
            "looking": before != given or not look.whole,
            "units": look.units,
            "marks": [],
        }
        with border("marks"):
            record = self._read(name, reading)
            jitters = any(part in each["code"] for each in notes for part in SENTENCES["jitter"])
            of_clock = self._jitter(name, *look.clock) if jitters else []
            shown = self._of(f"marks {jitters}", name, reading, lambda: [*marks(record), *of_clock])
            found["marks"] = [{**mark, "text": _text(mark["kind"], notes)} for mark in shown]
        return plain(found)  # type: ignore[no-any-return]

    def summary(self, step: Mapping[str, Any], name: str) -> dict[str, Any]:
        """The channels of a record, or why there are none."""
        problems: list[EmsidError] = []
        kind = next(kind for kind in KINDS if name in step[kind])
        found: dict[str, Any] = {"file": name, "kind": kind, "columns": [], "channels": []}
        with border(name, report=problems.append):
            found["columns"] = sorted(self._columns(name), key=list(self.parsed(name).columns.series).index)
            return found | self._channels(step, name)
        return {**found, "problem": said(problems[0], self.session.folder)}

    def _channels(self, step: Mapping[str, Any], name: str) -> dict[str, Any]:
        record, unlike = self.record(step, name), ""
        if name in (*step["files"][1:], *step["unseen_files"]):
            try:
                check_same_channels(self.record(step, step["files"][0]), record)
            except EmsidError as problem:
                unlike = f"{problem}; or remove one of the files"

        def channels() -> list[dict[str, Any]]:
            units, values = (*record.input_units, *record.output_units), np.hstack([record.input, record.output])
            names = (*record.input_names, *record.output_names)
            ends = zip(np.nanmin(values, axis=0).tolist(), np.nanmax(values, axis=0).tolist(), strict=True)
            return [
                {"name": n, "unit": u, "low": low, "high": high}
                for n, u, (low, high) in zip(names, units, ends, strict=True)
            ]

        time = record.time
        return {
            "unlike": unlike,
            "samples": len(record),
            "dt": record.dt,
            "first": float(time[0]),
            "last": float(time[-1]),
            "channels": self._of("channels", name, self.reading(step, name), channels),
            "inputs": len(record.input_names),
            "reading": self.reading(step, name),
            "look": self._count,
        }

    def _jitter(self, name: str, time: str, unit: str, dt: float) -> list[dict[str, Any]]:
        """Where the times of a file jitter, by its time column, the unit of that and its sample time in s."""
        column = self.parsed(name).columns.series.get(time)
        values = None if column is None else np.asarray(column)
        return (
            []
            if values is None or values.dtype.kind not in "iuf"
            else list(jittering(values * SECONDS.get(unit, 1.0), dt))
        )

    def _beside(self, name: str, reading: Mapping[str, Any], column: str, parsed: ParsedFile) -> Record:
        """The record of a file with another column as its output, at the same samples, not filtered."""
        of_values = ("filter", "decimate", "detrend", "signals")
        known = {key: value for key, value in arguments(reading).items() if key not in of_values}
        outputs = known["output"]
        first = str(outputs if isinstance(outputs, str) else outputs[0]).removeprefix("d(").removesuffix(")")
        for key in ("wrap", "shift", "direction", "scale", "offset", "units"):
            known[key] = {each: v for each, v in known.get(key, {}).items() if each != first} or None
        return emsid.read(parsed, **{**known, "output": column})

    def rows(self, step: Mapping[str, Any], name: str, first: float, last: float) -> tuple[int, int]:
        """The data rows of a file, from A up to but not B, that the samples between two times are from.

        The record is read again with the number of the row as its output.

        Raises:
            DataError: where samples are not from rows of one table, or none lie between the times.
        """
        parsed = self.parsed(name)
        lengths = {len(series) for series in parsed.columns.series.values()}
        if len(lengths) != 1:
            raise DataError("the columns of this file have different lengths, so it has no rows; use rows or mask")
        count, number = lengths.pop(), "row number of the studio"
        series = {**parsed.columns.series, **from_arrays([(number, np.arange(count, dtype=float))]).series}
        counted = ParsedFile(parsed.path, replace(parsed.columns, series=series))
        record = self._beside(name, self.reading(step, name), number, counted)
        inside = record.output[(record.time >= first) & (record.time <= last), 0]
        if not len(inside):
            raise DataError("no sample lies between these times")
        return int(np.floor(inside.min())), int(np.ceil(inside.max())) + 1


def _bytes(found: Any) -> int:
    """The memory of arrays in what was made of a file."""
    if isinstance(found, ParsedFile):
        return sum(int(series.estimated_size()) for series in found.columns.series.values())
    arrays = (found.input, found.output) if isinstance(found, Record) else ()
    return sum(each.nbytes for each in ((found.time, found.values) if isinstance(found, Signal) else arrays))


def _kind(finding: Finding) -> str:
    """The kind of the marks that belong to a finding; empty where there are none. A clock with gaps may jitter, too."""
    if finding.code == "clock-irregular" and finding.data.get("gaps"):
        return "gap"
    return next((kind for kind, parts in SENTENCES.items() if any(part in finding.code for part in parts)), "")


def _text(kind: str, said: list[dict[str, Any]]) -> str:
    """The sentence that belongs to a mark; empty where the first look has none."""
    of_kind = [each["text"] for each in said if each["kind"] == kind]
    also = [each["text"] for each in said if any(part in each["code"] for part in SENTENCES[kind])]
    return next(iter([*of_kind, *also]), "")


def marks(record: Record) -> Iterator[dict[str, Any]]:
    """Gaps, outliers, saturation and standstill of a record, as stretches of time."""
    time = record.time
    for edge in record.breaks[:MOST_MARKS]:
        yield {"kind": "gap", "first": float(time[edge - 1]), "last": float(time[edge])}
    for channel in record.output_names:  # an input that is held at its extremes is a choice
        x = record.channel(channel)
        for low in (True, False):
            extreme = x == (x.min() if low else x.max())
            if np.ptp(x) and len(np.unique(x[:1000])) > 3:
                yield from _stretches(extreme, time, "saturation", channel, SHORTEST)
    for k, channel in enumerate(record.output_names):
        y = np.ascontiguousarray(record.output[:, k])
        for place in outliers_of(y)[0][:MOST_MARKS]:
            yield {"kind": "outlier", "first": float(time[place]), "last": float(time[place]), "channel": channel}
        yield from _stretches(at_rest(y), time, "standstill", channel, max(SHORTEST, len(record) // 100))


def jittering(time: NDArray[np.float64], dt: float) -> Iterator[dict[str, Any]]:
    """Stretches in which steps of time differ from the sample time by half of the most that one does, or more.

    Args:
        time: (N,) as in the file, in s.
        dt: sample time in s.
    """
    step = np.diff(time)
    off = np.where((step > 0) & (step < 1.5 * dt), abs(step - dt), 0.0)  # longer ones are gaps
    most = off.max(initial=0.0)
    if most <= NOTABLE * dt:
        return
    places = np.flatnonzero(off >= most / 2)
    runs = np.split(places, np.flatnonzero(np.diff(places) > NEAR) + 1)
    for run in sorted(runs, key=len, reverse=True)[:MOST_MARKS]:
        yield {"kind": "jitter", "first": float(time[run[0]]), "last": float(time[run[-1] + 1])}


def _stretches(
    where: NDArray[np.bool_], time: NDArray[np.float64], kind: str, channel: str, shortest: int
) -> Iterator[dict[str, Any]]:
    edges = np.flatnonzero(np.diff(where.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    long = edges[edges[:, 1] - edges[:, 0] >= shortest]
    for a, b in long[np.argsort(long[:, 0] - long[:, 1])][:MOST_MARKS]:
        yield {"kind": kind, "first": float(time[a]), "last": float(time[b - 1]), "channel": channel}


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


Edit = dict[str, Any]
PHYSICAL = ["rigid-motor", "arx"]
"""Models to compare where a physical one is proposed."""

FREE_RUN = "-free-run"
"""The end of the names of regressions that are fitted to the free run."""


def fit_free_run(finding: Finding, record: Record) -> Edit:
    """The same regression fitted to the free run; of a linear one that is output-error."""
    from emsid.identification.candidates import CANDIDATES

    name = f"{finding.model}{FREE_RUN}"
    return {"models": [name if name in CANDIDATES else "output-error"]}


EDITS: dict[str, Callable[[Finding, Record], Edit]] = {
    "next-physical-model": lambda finding, record: {"models": PHYSICAL},
    "regression-biased": fit_free_run,
    "map-is-straight": lambda finding, record: {"models": ["output-error"]},
    "interrupted": lambda finding, record: {"again": True},
    "response-negative": lambda finding, record: {"given": {"scale": {record.input_names[0]: -1.0}}},
}
"""By the code of a finding: the changed parts of a step; ``given`` are arguments of `emsid.read`, and ``again`` fits
again without a change."""


def edit_for(finding: Finding, record: Record) -> Edit | None:
    """The change that a finding proposes; None where it proposes none that can be made here."""
    return EDITS[finding.code](finding, record) if finding.code in EDITS else None


def channels_for(finding: Finding, reading: Mapping[str, Any]) -> Edit | None:
    """The arguments of `emsid.read` with the further channels that a first look proposes; None where it has none.

    A position takes the place of the speed that comes from it; a load and a current are used beside what is.
    """
    if finding.code != "further-channels":
        return None
    found = finding.data
    if found["positions"]:
        return {"output": found["positions"][0]}
    role, more = ("output", found["outputs"]) if found["outputs"] else ("input", found["inputs"])
    present = reading[role]
    return {role: [*([present] if isinstance(present, str) else present), *more]}
