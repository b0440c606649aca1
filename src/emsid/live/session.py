"""A session of tracking: what a receiver brings becomes a stream of messages, and in the end a record and a summary.

Every message is a dictionary that JSON can hold, with a ``kind``: ``start``, ``estimate``, ``finding`` or ``end``
(``docs/tracking.md``). The terminal and ``--json`` show these messages and nothing else. The session keeps the estimate
over time in constant memory (`History`).
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.estimation.borders import border
from emsid.estimation.fit import Fit
from emsid.estimation.linear.change_detection import ChangeDetector
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding, plain
from emsid.live.log import Log
from emsid.live.protocol import LineParser, Rows
from emsid.live.receiver import Piece, Receiver
from emsid.live.sources import record_of
from emsid.live.timeline import Stretch, Timeline
from emsid.live.tracking import Change, Physical, Tracker, Tracking
from emsid.models.regression.narx import Narx
from emsid.record import Record
from emsid.wording import sentence
from emsid.wording.terms import meanings

Array = NDArray[np.float64]

REMEMBERED = 2000
"""Points of the history of the estimate."""


@dataclass(eq=False)
class History:
    """The estimate over time, with at most `REMEMBERED` points: when it is full, every second point is dropped."""

    time: list[float] = field(default_factory=list)
    estimate: list[Array] = field(default_factory=list)
    half_width: list[Array] = field(default_factory=list)
    step: int = 1
    _count: int = 0

    def add(self, time: float, estimate: Array, half_width: Array) -> None:
        """Remember a point."""
        self._count += 1
        if self._count % self.step:
            return
        self.time.append(time)
        self.estimate.append(estimate)
        self.half_width.append(half_width)
        if len(self.time) >= REMEMBERED:
            for each in (self.time, self.estimate, self.half_width):
                del each[::2]
            self.step *= 2


Message = dict[str, Any]

UNCHANGED = 200
"""Samples after which an input that has not changed is said to excite nothing; a test signal changes sooner."""
SILENT = 5.0
"""Seconds without a byte after which a source is called silent."""
HEADER = 1.0
"""Seconds in which a connection may send its header; then lines are understood by their number of columns."""
PROOF = 3
"""Lines after a header that cannot be used, before the source is given up."""
GARBAGE = 50
"""Lines of which none is a sample, after which the source is given up."""
COLOURED = 0.3
"""Correlation of neighbouring prediction errors above which they are not white."""
SETTLING, SETTLING_EACH, SETTLING_TIME = 400, 40, 10.0
"""Samples, samples for each parameter, and seconds, after which changes are looked for."""
BURSTS = 3.0
"""The margin of the thresholds of changes, for bursts of error that are no change."""
FEWEST_TRACKED, MOST_PIECES = 20, 50
"""The samples of a piece of a long stretch at least, and the pieces of a stretch at most."""


@dataclass(frozen=True)
class Settings:
    """Settings of a session.

    Args:
        every: seconds between two messages with the estimate.
        duration: seconds of samples after which it ends; None to go on.
        patience: seconds to wait for the first sample; None to wait until it comes.
        dt: sample time in s; by default from the time column.
        false_alarm: mean time in s between false alarms of changes; 0 to look for none.
    """

    every: float = 0.2
    duration: float | None = None
    patience: float | None = None
    dt: float | None = None
    false_alarm: float = 0.0

    def __post_init__(self) -> None:
        for name, least in (
            ("every", 1e-3),
            ("duration", 1e-9),
            ("patience", 1e-3),
            ("dt", 1e-9),
            ("false_alarm", 0.0),
        ):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value >= least):
                raise DataError(f"{name} of {value:g} s; give a positive number", arguments=(name,))


@dataclass(eq=False)
class Session:
    """The results of a session; they grow while `messages` runs.

    Attributes:
        tracker: what is tracked.
        name: of the source.
        tracking: the state; None before the first sample.
        changes, gaps: what happened.
        findings: everything that was noticed, without the gaps.
        history: the estimate over time.
        recent: the last stretch of samples, with its predictions.
        counts: samples, lost, malformed, not_finite, repeated, skipped, gaps.
        dt: sample time in s.
        reason: why it ended.
    """

    tracker: Tracker
    name: str
    tracking: Tracking | None = None
    changes: list[Change] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    history: History = field(default_factory=History)
    recent: deque[tuple[Record, Array]] = field(default_factory=deque)
    counts: Counter[str] = field(default_factory=Counter)
    dt: float | None = None
    reason: str = ""

    @property
    def fit(self) -> Fit[Narx] | None:
        """The last estimate."""
        return None if self.tracking is None else self.tracker.fit(self.tracking)

    @property
    def physical(self) -> tuple[Physical, ...]:
        """The physical values of the last estimate."""
        return () if self.tracking is None else self.tracker.physical(self.tracking)

    def to_data(self) -> dict[str, Any]:
        """Everything but histories, in built-in types."""
        fit = self.fit
        return {
            "schema": 1,
            "source": self.name,
            "dt": self.dt,
            **{name: self.counts[name] for name in COUNTS},
            "reason": self.reason,
            "fit": None if fit is None else fit.to_data(),
            "physical": [_physical(each) for each in self.physical],
            "changes": [{"time": change.time, "since": change.since, "what": change.kind} for change in self.changes],
            "findings": [finding.to_data() for finding in self.findings],
        }


COUNTS = ("samples", "lost", "malformed", "not_finite", "repeated", "skipped", "gaps")


def messages(
    session: Session,
    receiver: Receiver,
    parser: LineParser,
    settings: Settings,
    log: Log | None = None,
    control: Control = FREE,
    state: Any = None,
) -> Iterator[Message]:
    """Track what a receiver brings, until it ends, the time is up, or the control is cancelled.

    Args:
        session: to be filled.
        receiver: the source.
        parser: of its lines.
        settings: of the session.
        log: of the receiver, to report where the disk does not take it.
        control: when to stop.
        state: of the recursion, to go on from.

    Raises:
        DataError: for a source that sends nothing, or nothing that is understood.
        FormatError: where the log cannot be written.
    """
    work = _Work(session, parser, settings, log, state)
    work.away = receiver.away
    while control.ending is None and not session.reason:
        for piece in receiver.wait(0.05):
            yield from work.take(piece)
            yield from work.periodic(receiver.heard)  # where many pieces wait, what is shown goes on, too
            if session.reason or control.ending is not None:
                break
        yield from work.periodic(receiver.heard)
    if not session.reason:
        session.reason = "stopped"
    if session.reason != "duration":
        yield from work.finish()
    if session.tracking is not None:
        yield work.estimate()
    elif parser.columns is None and parser.problem is not None:
        raise parser.problem
    elif session.reason != "stopped":
        raise DataError(f"{session.name} has ended without enough samples; {parser.lines} lines have come")
    yield from work.conclude()
    yield _message({"kind": "end", **session.to_data()})


class _Work:
    """The loop of `messages`, piece by piece."""

    def __init__(self, session: Session, parser: LineParser, settings: Settings, log: Log | None, state: Any) -> None:
        self.session, self.parser, self.settings, self.log = session, parser, settings, log
        self.timeline, self.away = Timeline(settings.dt), 0.0
        self.state, self.begun = state, time.monotonic()
        self.estimated = self.done = self.begun
        self.quiet = self.behind = self.waiting = False
        self.rates: deque[tuple[float, int]] = deque([(self.begun, 0)])
        self.reported = 0

    def take(self, piece: Piece) -> Iterator[Message]:
        """What follows from a piece."""
        session = self.session
        if piece.kind == "data":
            self.quiet = False
            yield from self.rows(self.parser.feed(piece.data))
            self.done = time.monotonic()
            if self.parser.columns is None and self.parser.problem is not None and self.parser.lines > PROOF:
                raise self.parser.problem
            waits = session.tracking is None and self.parser.columns is None and self.parser.implies
            if waits and self.parser.lines >= GARBAGE:
                raise DataError(
                    f"{session.name}: {self.parser.lines} lines have come and none is a header or numbers, such as "
                    f"{self.parser.example!r}; check the baud rate, and the lines that the board prints",
                    arguments=("baud", "header"),
                )
        elif piece.kind == "failed":
            raise DataError(piece.text)
        elif piece.kind == "ended":
            session.reason = "disconnected" if piece.text else "ended"
        else:
            self.parser.forget_rest()
            if piece.kind == "skipped":
                session.counts["skipped"] += piece.lines
                self.timeline.cut("skipped")
                yield self.found(Finding("samples-not-tracked", session.name, {"samples": piece.lines}))
            elif piece.kind == "disconnected":
                self.timeline.cut("disconnected")
                yield self.found(Finding("source-disconnected", session.name, {"wait": self.away}))

    def finish(self) -> Iterator[Message]:
        """The last line, and samples that waited for a sample time."""
        yield from self.rows(self.parser.flush())
        yield from self.stretches(self.timeline.rest())

    def rows(self, rows: Rows | None) -> Iterator[Message]:
        """Track further rows."""
        if rows is not None:
            yield from self.stretches(self.timeline.place(rows))

    def stretches(self, stretches: list[Stretch]) -> Iterator[Message]:
        """Track stretches of samples."""
        session, tracker = self.session, self.session.tracker
        for stretch in stretches:
            record = self.record(stretch)
            if session.tracking is None:
                session.dt = record.dt
                tracker = session.tracker = watching(tracker, record.dt, self.settings.false_alarm)
                session.tracking = tracker.start(self.state)
                yield self.start(record)
            if stretch.gap is not None:
                session.tracking = tracker.cut(session.tracking)
                session.counts["gaps"] += 1
                gap = stretch.gap
                data = {"time": gap.time, "samples": gap.samples, "cause": gap.cause}
                yield self.found(Finding("source-gap", session.name, data), keep=session.counts["gaps"] <= 20)
            for piece in pieces(record):
                session.tracking, changes, predictions = tracker.advance(session.tracking, piece)
                session.counts["samples"] += len(piece)
                with border("history of the estimate"):
                    self.remember(piece, predictions)
                for change in changes:
                    session.changes.append(change)
                    yield self.found(self.changed(change, piece))
            limit = self.settings.duration
            if limit is not None and session.counts["samples"] * record.dt >= limit:
                session.reason = "duration"
                return

    def changed(self, change: Change, record: Record) -> Finding:
        """A change as a finding, with the rate of false alarms."""
        detector = self.session.tracker.detector
        run = detector.run * record.dt if detector else None
        delay = change.time - change.since
        data = {"time": change.time, "since": change.since, "delay": delay, "what": change.kind, "false_alarm": run}
        return Finding("change-detected", record.output_names[0], data)

    def periodic(self, heard: float) -> Iterator[Message]:
        """Periodic messages: estimates, silence, malformed lines, a full disk.

        Args:
            heard: when bytes came last.
        """
        session, now = self.session, time.monotonic()
        silent = now - max(heard, self.done)
        self.parser.implies = self.parser.implies or now - self.begun > HEADER
        for name in ("lost", "repeated"):
            session.counts[name] = getattr(self.timeline, name)
        for name in ("malformed", "not_finite"):
            session.counts[name] = getattr(self.parser, name)
        if session.tracking is None:
            waited, patience = now - self.begun, self.settings.patience
            if patience is not None and waited > patience:
                raise DataError(f"{sentence(self.awaited())[:-1]} (waited {patience:g} s)", arguments=("patience",))
            if waited > SILENT and not self.waiting:
                self.waiting = True
                yield self.found(self.awaited(), keep=False)
        if silent > SILENT and session.tracking is not None and not self.quiet:
            self.quiet = True
            yield self.found(Finding("source-silent", session.name, {"seconds": silent}))
        if self.log is not None and bool(self.log.problem) is not self.behind:
            self.behind = not self.behind
            if self.behind:
                data = {"reason": self.log.problem, "bytes": self.log.pending}
                yield self.found(Finding("log-not-written", str(self.log.path), data))
        if now - self.estimated >= self.settings.every and session.tracking is not None:
            self.estimated = now
            yield from self.report_unused()
            yield from self.report_constant(UNCHANGED)
            yield self.estimate()

    def report_constant(self, samples: int) -> Iterator[Message]:
        """Say once that nothing excites the system, where no input has changed in so many samples."""
        session, tracking = self.session, self.session.tracking
        if tracking is None or tracking.last is None or tracking.samples < samples:
            return
        if np.any(tracking.highest > tracking.lowest) or "nothing-excites" in {each.code for each in session.findings}:
            return
        of = tracking.last
        inputs = [
            {"name": name, "level": float(level), "unit": unit}
            for name, level, unit in zip(of.input_names, tracking.highest, of.input_units, strict=True)
        ]
        yield self.found(Finding("nothing-excites", session.name, {"inputs": inputs, "samples": tracking.samples}))

    def report_unused(self) -> Iterator[Message]:
        """Report lines that are no samples: in one message during the session, and with their number at the end."""
        session, bad = self.session, self.parser.malformed + self.parser.not_finite
        if bad > self.reported:
            data = {"lines": self.parser.malformed, "not_finite": self.parser.not_finite}
            first, self.reported = not self.reported, bad
            found = Finding("lines-not-used", session.name, data | {"example": self.parser.example})
            session.findings = [finding for finding in session.findings if finding.code != found.code]
            message = self.found(found)
            if first:
                yield message

    def conclude(self) -> Iterator[Message]:
        """Findings at the end, about the lines and about the prediction errors."""
        yield from self.report_unused()
        yield from self.report_constant(1)
        tracking = self.session.tracking
        if tracking is not None and tracking.correlation > COLOURED:
            yield self.found(Finding("tracking-errors-coloured", data={"correlation": tracking.correlation}))

    def awaited(self) -> Finding:
        """That no sample has come yet, and what has."""
        data = {"lines": self.parser.lines, "example": self.parser.example}
        return Finding("source-awaited", self.session.name, data)

    def start(self, record: Record) -> Message:
        """The first message."""
        tracker = self.session.tracker
        detector = tracker.detector
        return _message(
            {
                "kind": "start",
                "source": self.session.name,
                "structure": tracker.recursion.structure.name,
                "equation": tracker.recursion.structure.equation(),  # type: ignore[attr-defined]
                "parameters": list(tracker.recursion.structure.parameter_names),
                "terms": [str(regressor) for regressor in tracker.recursion.structure.regressors],  # type: ignore[attr-defined]
                "meanings": list(meanings(tracker.recursion.structure, record)),
                "rule": _rule(tracker),
                "inputs": _channels(record.input_names, record.input_units),
                "output": _channels(record.output_names, record.output_units)[0],
                "dt": record.dt,
                "false_alarm": None if detector is None else detector.run * record.dt,
                "log": None if self.log is None else str(self.log.path),
            }
        )

    def estimate(self) -> Message:
        """The present state as a message."""
        session, now = self.session, time.monotonic()
        tracking = session.tracking
        if tracking is None or tracking.last is None:
            raise DataError(sentence(self.awaited()))
        while len(self.rates) > 1 and now - self.rates[0][0] > 2.0:
            self.rates.popleft()
        before, count = self.rates[0]
        self.rates.append((now, session.counts["samples"]))
        half = session.tracker.half_widths(tracking)
        names = session.tracker.recursion.structure.parameter_names
        values = zip(names, tracking.state.estimate.tolist(), half.tolist(), strict=True)
        last, model = tracking.last, session.tracker.model
        return _message(
            {
                "kind": "estimate",
                "time": last.times[0],
                **{name: session.counts[name] for name in COUNTS},
                "rate": (session.counts["samples"] - count) / max(now - before, 1e-3),
                "input": last.input[0].tolist(),
                "output": float(last.output[0, 0]),
                "prediction": tracking.prediction,
                "noise": float(np.sqrt(tracking.state.noise_variance)) if tracking.state.noise_variance >= 0 else None,
                "idle": tracking.state.idle,
                "parameters": [{"name": n, "value": v, "half_width": h} for n, v, h in values],
                "physical": [_physical(each) for each in session.tracker.physical(tracking)],
                "model": None if model is None else {"name": model.name, "output": tracking.model_output},
            }
        )

    def found(self, finding: Finding, keep: bool = True) -> Message:
        """A finding as a message."""
        if keep:
            self.session.findings.append(finding)
        tracking = self.session.tracking
        now = None if tracking is None or tracking.last is None else tracking.last.times[0]
        return _message({"kind": "finding", "time": now, **finding.to_data()})

    def record(self, stretch: Stretch) -> Record:
        """A stretch as a record."""
        columns = self.parser.columns
        assert columns is not None
        assert self.timeline.dt is not None
        return record_of(stretch, columns.channels, self.timeline.dt, self.session.name)

    def remember(self, record: Record, predictions: Array) -> None:
        """Keep the estimate for the history, and the last samples for a figure."""
        session = self.session
        assert session.tracking is not None
        half = session.tracker.half_widths(session.tracking)
        session.history.add(float(record.time[-1]), session.tracking.state.estimate, half)
        session.recent.append((record, predictions))
        while sum(len(each) for each, _ in session.recent) - len(session.recent[0][0]) > REMEMBERED:
            session.recent.popleft()


def watching(tracker: Tracker, dt: float, false_alarm: float) -> Tracker:
    """The tracker with a detector of changes.

    Args:
        tracker: without one.
        dt: sample time in s.
        false_alarm: mean time in s between false alarms; 0 for no detector.
    """
    if not false_alarm:
        return tracker
    each = SETTLING_EACH * len(tracker.recursion.structure.parameter_names)
    settling = max(SETTLING, each, round(SETTLING_TIME / dt))
    return replace(tracker, detector=ChangeDetector(max(false_alarm / dt, 100.0), settling, BURSTS))


def pieces(record: Record) -> list[Record]:
    """A stretch in pieces, after each of which the estimate is kept: a file comes in a few long stretches."""
    size = max(FEWEST_TRACKED, -(-len(record) // MOST_PIECES))
    return [record[start : start + size] for start in range(0, len(record), size)]


def _message(content: Message) -> Message:
    """The content in values that JSON can hold."""
    message: Message = plain(content)
    return message


def _rule(tracker: Tracker) -> str:
    rule = tracker.recursion.adaptation
    numbers = ", ".join(f"{name} {value}" for name, value in vars(rule).items())
    return f"{type(rule).__name__.lower()} {numbers}".strip()


def _channels(names: tuple[str, ...], units: tuple[str, ...]) -> list[dict[str, str]]:
    return [{"name": name, "unit": unit} for name, unit in zip(names, units, strict=True)]


def _physical(physical: Physical) -> dict[str, Any]:
    width = physical.half_width if physical.half_width is not None and isfinite(physical.half_width) else None
    return {"name": physical.name, "value": physical.value, "half_width": width, "unit": physical.unit}
