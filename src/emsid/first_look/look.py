"""The first look at a file: what its columns hold, which are input, output and time, and how to read it.

Everything that is not given is guessed, and every guess has a confidence. `FirstLook.reading` holds the arguments of
`emsid.read` with which the file becomes a record. A column that is neither input nor output may be a load, a second
output, a better sensor or a sign; findings name it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import as_names
from emsid.errors import DataError, EmsidError
from emsid.estimation.threads import one_blas_thread
from emsid.findings import Finding
from emsid.first_look.brushless import LONGEST, Axes, axes, findings_about, fit_of, phases_in, reading_of, shown_by
from emsid.first_look.clock import Clock, contradiction, find_clock, stated_clock
from emsid.first_look.columns import FEWEST_LEVELS, Column, Stretch, column_of_numbers
from emsid.first_look.data_advice import TOLERANCE, advice, useless
from emsid.first_look.dynamics import acts_in_its_own_row
from emsid.first_look.examined import Response, response_of
from emsid.first_look.faults import is_stuck
from emsid.first_look.hanging import as_angle
from emsid.first_look.kinds import FileKind, Kind, kind_of
from emsid.first_look.levels import JUMP, MOST, PART, SAME, SAMPLES, UNSURE
from emsid.first_look.masks import mask_of, masked_outliers, mends
from emsid.first_look.names import ColumnQuantity, Meaning, meaning_of, units_of_device
from emsid.first_look.responses import ANSWERED, SEEN, answers
from emsid.first_look.roles import Roles, find_roles, with_responses
from emsid.first_look.standstill import returns_to_zero
from emsid.io.axes import with_axes
from emsid.io.columns import Columns, Excerpt, as_numbers, errors_of
from emsid.io.edges import sources, with_edges
from emsid.io.messages import numeric_columns, on_one_clock, with_clocks_of_messages
from emsid.io.other_files import with_other_files
from emsid.io.reading import ParsedFile, parsed_file, read, read_columns, with_names_of
from emsid.io.selection import MOST_SKIPPED
from emsid.presentation import Presented
from emsid.record import Record
from emsid.record.frames import frame
from emsid.record.time_axis import SECONDS

Array = NDArray[np.float64]

CONSTANT = "output-constant"
USELESS = frozenset(
    {
        "record-too-short",
        "channel-constant",
        "channel-out-of-scale",
        CONSTANT,
        "all-standstill",
        "output-noise-only",
        "not-readable",
        "no-role-found",
        "phases-of-motor",
        "steady-states",
    }
)
"""Findings with which there is nothing to identify."""


NO_INTEGRAL = -2 * SEEN
"""In nats: with less, a column is no position, whatever its name says. Of six recorded positions none is below −3; the
angle of a servo and counts since the row before are below −19."""
_TIME = ColumnQuantity.TIME
_POSITION = ColumnQuantity.POSITION
_MOTIONS = (_POSITION, ColumnQuantity.SPEED)


@dataclass(frozen=True, repr=False)
class FirstLook(Presented):
    """What a file holds, and how to read it. It prints as a table.

    Args:
        path: the file.
        rows: the number of its rows.
        columns: facts about every column.
        others: entries of the file that are no columns, and why.
        clock: the sample time and where it comes from.
        roles: the guessed input and output.
        reading: arguments of `emsid.read`, given or guessed.
        mends: further arguments of `emsid.read`, which leave out or correct what findings say is wrong with the data.
        fit: further arguments of `emsid.identify`: the model that the columns are of; empty for the usual ones.
        record: what these arguments read; None where they do not suffice.
        response: delay and sign of the response of the first output to the first input.
        findings: what was noticed.
        tolerance: singular values of the lagged input below this share of the largest are no excitation.
        header: the lines above the header of the table.
        stated: the clock that the file states besides its columns.
        system: number of the system that it is of, among files that are looked at together.
        kind: what the file is.
        copy_of: an earlier one of these files that has the same samples; empty where there is none.
        looked_at: the rows of an excerpt that this is a look at; 0 for a look at the whole file.
    """

    path: str
    rows: int
    columns: tuple[Column, ...]
    others: Mapping[str, str]
    clock: Clock
    roles: Roles
    reading: Mapping[str, Any]
    mends: Mapping[str, Any] = field(default_factory=dict)
    fit: Mapping[str, Any] = field(default_factory=dict)
    record: Record | None = None
    response: Response = field(default_factory=lambda: Response(None, 0, 0.0))
    findings: tuple[Finding, ...] = ()
    tolerance: float = TOLERANCE
    header: tuple[str, ...] = ()
    stated: Clock | None = None
    system: int = 0
    kind: Kind = field(default_factory=lambda: Kind(FileKind.DYNAMIC))
    copy_of: str = ""
    looked_at: int = 0

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with a row for every column of the file: kind, quantity, unit and range.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        columns = self.columns
        texts = {
            "column": [each.name for each in columns],
            "kind": [each.kind for each in columns],
            "quantity": [str(each.meaning.quantity) for each in columns],
            "unit": [each.meaning.unit or "" for each in columns],
        }
        numbers = {name: [getattr(each, name) for each in columns] for name in ("missing", "low", "high", "distinct")}
        return frame({name: np.array(values) for name, values in (texts | numbers).items()}, library)

    def __repr__(self) -> str:
        read = ", ".join(f"{name} {self.reading[name]}" for name in ("input", "output") if self.reading.get(name))
        return f"FirstLook({self.name}: {self.rows} rows, {len(self.columns)} columns; {read or self.kind})"

    @property
    def name(self) -> str:
        """The name of the file without its folder."""
        return Path(self.path).name

    @property
    def read_as(self) -> str:
        """The same for files that are read alike."""
        return repr(sorted({**self.reading, **self.fit}.items(), key=str))

    @property
    def useless(self) -> frozenset[str]:
        """The codes of the findings with which there is nothing to identify."""
        return USELESS & {finding.code for finding in self.findings}

    def __getitem__(self, name: str) -> Column:
        """A column by its name."""
        return next(column for column in self.columns if column.name == name)


@one_blas_thread()
def describe(path: Any, *, tolerance: float = TOLERANCE, **reading: Any) -> FirstLook:
    """Look at a file: its columns, the likely input, output and time, and the quality of the data.

    Args:
        path: the file, of any format that `emsid.read` reads; or a data frame.
        tolerance: singular values of the lagged input below this share of the largest are no excitation.
        reading: arguments of `emsid.read` that are known, such as ``output`` or ``dt``; the others are guessed.

    Returns:
        What was found; it prints as a table. ``emsid.read(path, **look.reading)`` reads the record.

    Raises:
        FormatError: where the file cannot be read at all.
        DataError: where an argument that is given cannot be used.
    """
    parsed = parsed_file(path, in_part=True, dbc=reading.get("dbc"))
    file = parsed.path
    with errors_of(file):
        named = [name for side in ("input", "output") for name in as_names(reading.get(side) or ())]
        with_counts, missed = with_edges(parsed.columns, named)
        parsed = replace(parsed, columns=with_counts)
        turned = _with_axes(parsed, reading)
        reading = with_names_of(turned, reading)
    given = {side: as_names(reading.get(side) or ()) for side in ("input", "output")}
    named = [name for names in given.values() for name in names]
    raw, called = with_other_files(turned, file, named, reading.get("time"), read_columns)
    raw, of_file = _by_messages(raw, file.name, reading.get("time") or ""), raw
    raw = _on_one_clock(raw, reading.get("time") or "")
    rows = Counter(len(series) for series in raw.series.values()).most_common(1)[0][0]
    columns = {name: _column(name, raw) for name in raw.series}
    for name, unit in units_of_device([*columns]).items():
        said = columns[name].meaning
        columns[name] = replace(columns[name], meaning=replace(said, unit=said.unit or unit))
    looked_at = 0 if raw.excerpt is None else rows
    rows = rows if raw.excerpt is None else raw.excerpt.rows
    counted = {channel for name in columns for channel in sources(name, raw)}
    table = [column for column in columns.values() if column.rows == rows and column.name not in counted]
    stated = stated_clock(raw, file.name)
    clock = find_clock(table, stated, reading.get("time") or "")
    known = tuple(_bare([called.get(name, name) for name in names]) for names in given.values())
    motor = axes(table) if not any(known) and clock.dt <= LONGEST else {}
    if motor:
        rotor = reading_of(motor)
        known = (motor[ColumnQuantity.VOLTAGE, "q"].name, rotor["output"][-1])
    roles = find_roles(table, clock.column, *known)
    columns = _with_responses_to_codes(columns, roles)
    noticed: list[Finding] = [*missed]
    if raw.clocks and not of_file.clocks:
        rows = max(map(len, of_file.series.values()))
        data = {"rows": rows, "columns": [roles.input, roles.output]}
        noticed.append(Finding("rows-of-messages", file.name, data))
    proposal = _proposal(raw, columns, clock, roles, motor)
    if motor:
        proposal |= rotor
    electrical = [name for name, unit in proposal["units"].items() if unit == "erpm"]
    if electrical and not {*electrical} & {*reading.get("units", {})}:
        pairs = reading.get("pole_pairs")
        noticed.append(Finding("speed-electrical", electrical[0], {"pole_pairs": pairs}))
        proposal["pole_pairs"] = pairs or 1
    sign = None if motor or "direction" in reading else sign_of_input(table, roles)
    if sign is not None:
        noticed.append(sign)
        proposal["direction"] = {roles.input: sign.data["column"]} if "column" in sign.data else None
    noticed += [] if motor else further_channels(table, roles, file.name)
    look = FirstLook(
        str(file),
        rows,
        tuple(columns.values()),
        raw.others,
        clock,
        roles,
        _completed(reading, proposal),
        tolerance=tolerance,
        header=tuple(raw.preamble),
        stated=stated,
        looked_at=looked_at,
    )
    if "dt" in reading:
        clock = replace(clock, confidence=1.0)
    what = kind_of(table, clock, roles)
    shown = what.finding(file.name, look.clock.dt)
    if what.encoders:
        with_counts, missed = with_edges(parsed.columns, [finding.data["counts"] for finding in shown])
        again = describe(replace(parsed, columns=with_counts), tolerance=tolerance, **reading)
        return replace(again, kind=what, findings=(*shown, *missed, *again.findings))
    if shown:
        return replace(look, kind=what, findings=tuple(shown))
    if motor:
        return _of_motor(look, parsed, noticed, motor)
    if phases := [] if any(known) else phases_in(table, file.name):
        return replace(look, kind=what, findings=(*noticed, *phases))
    look = _with_hanging_angle(look, parsed, set(reading))
    noticed += _about_columns(look, set(reading))
    look = _with_record(look, parsed, noticed, set(reading))
    return replace(look, kind=kind_of(table, clock, roles, look.useless) if look.useless else what)


def _with_axes(parsed: ParsedFile, reading: Mapping[str, Any]) -> Columns:
    """The columns with the axes of the phases that are given, as `emsid.read` has them; not of an excerpt."""
    if parsed.columns.excerpt is not None:
        return parsed.columns
    phases, units, angle = reading.get("phases") or {}, reading.get("units") or {}, reading.get("rotor_angle")
    turned = reading.get("pole_pairs"), reading.get("electrical_angle", False), reading.get("power_invariant", False)
    return with_axes(parsed.columns, phases, angle, *turned, units, parsed.path.name)[0]


def _on_one_clock(raw: Columns, time: str) -> Columns:
    """The columns at the times of one clock, if the file has several: the given one, or that with most samples.

    Columns that are there for less than half of its time, such as the few messages of a start, are left out.
    """
    if not raw.clocks:
        return raw
    clocks = {clock: as_numbers(raw.series[clock]) for clock in raw.clocks.values()}
    leading = time if time in clocks else max(clocks, key=lambda each: len(clocks[each]))
    begin, end = clocks[leading][[0, -1]]
    short = {name for name, t in clocks.items() if min(end, t[-1]) - max(begin, t[0]) < (end - begin) / 2}
    series = {name: each for name, each in raw.series.items() if raw.clocks.get(name) not in short}
    kept = {name: clock for name, clock in raw.clocks.items() if name in series}
    return on_one_clock(replace(raw, series=series, clocks=kept), leading, series)


def _with_responses_to_codes(columns: Mapping[str, Column], roles: Roles) -> dict[str, Column]:
    """The columns, where the codes of the input say what the output does there, or are no codes if it follows them."""
    u, y = columns.get(roles.input), columns.get(roles.output)
    if u is None or y is None or not u.codes or len(u.values) != len(y.values):
        return dict(columns)
    if roles.levels:
        return {**columns, u.name: column_of_numbers(u.name, u.kind, u.meaning, u.values, codes=False)}
    return {**columns, u.name: replace(u, codes=with_responses(u.codes, u.values, y.movement))}


def _completed(given: Mapping[str, Any], proposal: Mapping[str, Any]) -> dict[str, Any]:
    """The given arguments of `emsid.read` with what is proposed for the others; a given clock replaces the proposed."""
    known = {**proposal, **given}
    replaced: tuple[str, ...] = ()
    if "dt" in given and "time" not in given:
        replaced = ("time", "time_unit", "resample")
    elif "time" in given and "dt" not in given:
        replaced = ("dt",)
    return {name: value for name, value in known.items() if value not in (None, {}, "") and name not in replaced}


def _by_messages(raw: Columns, name: str, time: str) -> Columns:
    """The columns at the times of the most frequent message, if the file has a row for every message."""
    rows = max(len(series) for series in raw.series.values())
    if raw.excerpt is not None or not any(series.null_count() > MOST_SKIPPED * rows for series in raw.series.values()):
        return raw
    table = [_column(each, raw) for each, series in raw.series.items() if len(series) == rows]
    time = time or find_clock(table, stated_clock(raw, name)).column
    if time not in raw.series:
        return raw
    apart = with_clocks_of_messages(raw, time, numeric_columns(raw, time))
    return on_one_clock(apart, time, apart.series) if apart.clocks else raw


def _with_record(look: FirstLook, parsed: ParsedFile, noticed: list[Finding], given: set[str]) -> FirstLook:
    """The look with its record, if it can be read, and the findings about that."""
    missing = [name for name in ("input", "output") if not look.reading.get(name)]
    if missing:
        return replace(look, findings=(*noticed, Finding("no-role-found", look.name, {"roles": missing})))
    try:
        record = read(parsed, **look.reading)
    except EmsidError as problem:
        if not isinstance(problem, DataError) or {"input", "output"} <= given:
            raise
        if given and describe(parsed).record is not None:  # what is given is the cause
            raise
        reason = str(problem).removeprefix(f"{look.path}: ")
        failed = Finding("not-readable", look.name, {"reason": reason, "arguments": list(problem.arguments)})
        return replace(look, findings=(*noticed, failed))
    found, proposed = response_of(record), look.reading["output"]
    guessed = "output" not in given and proposed == look.roles.output
    if guessed and found and found.integral > SEEN and not returns_to_zero(record.output[:, 0]):
        noticed.append(Finding("position-differentiated", proposed, {"input": look.roles.input}))
        look = replace(look, reading={**look.reading, "output": f"d({proposed})"})
        return _with_record(look, parsed, noticed, given)
    found = found or Response(None, 0, 0.0)
    known = {"shift", "direction"} & set(look.reading) or parsed.columns.clocks  # nothing else: rows move
    if not known and not any(useless(record)) and _acts_in_its_own_row(look, found):
        noticed.append(Finding("command-before-its-row", look.roles.input, {"output": look.roles.output}))
        look = replace(look, reading={**look.reading, "shift": {look.roles.input: -1}})
        return _with_record(look, parsed, noticed, given | {"shift"})
    about = (each for each in advice(record, found, look.tolerance) if each.code != "command-before-its-row")
    findings = [*record.findings, *noticed, *about]  # of the row, the columns of the file decide
    masked = () if "mask" in given else look.columns
    findings, further = mends(findings, masked, look.reading.get("mask", ""))
    return replace(look, mends=further, record=record, response=found, findings=tuple(findings))


def _of_motor(look: FirstLook, parsed: ParsedFile, noticed: Sequence[Finding], motor: Axes) -> FirstLook:
    """The look at a log of a brushless motor with its record, and what that can determine."""
    fit = fit_of(motor, look.reading)
    findings = [*noticed, *_about_clock(look.clock, look)]
    try:
        record = read(parsed, **look.reading)
    except DataError as problem:
        reason = str(problem).removeprefix(f"{look.path}: ")
        failed = Finding("not-readable", look.name, {"reason": reason, "arguments": list(problem.arguments)})
        return replace(look, findings=(*findings, failed))
    shown = shown_by(record, fit)
    findings = [*record.findings, *findings, *findings_about(look.name, motor, fit, shown)]
    if shown is not None and not shown.moving:  # a speed that is noise would only say that the flux is zero
        still = {
            place: column for place, column in motor.items() if column.meaning.quantity is not ColumnQuantity.SPEED
        }
        look = replace(look, reading={**look.reading, **reading_of(still)})
        record = read(parsed, **look.reading)
    return replace(look, fit=fit, record=record, findings=tuple(findings))


def _channels(look: FirstLook) -> tuple[Column | None, Column | None]:
    """The columns of the guessed input and output."""
    named = {column.name: column for column in look.columns}
    return named.get(look.roles.input), named.get(look.roles.output)


def _with_hanging_angle(look: FirstLook, parsed: ParsedFile, given: set[str]) -> FirstLook:
    """The look with a position as its output where that is an angle that hangs, which its speed alone does not show."""
    _, position = _channels(look)
    if (
        "output" in given
        or not look.reading.get("input")
        or position is None
        or position.meaning.quantity is not _POSITION
    ):
        return look
    reading = {**look.reading, "output": position.name}
    with suppress(EmsidError):
        units = as_angle(read(parsed, **reading))
        if units is not None:
            return replace(look, reading={**reading, "units": {**reading.get("units", {}), **units}})
    return look


def _acts_in_its_own_row(look: FirstLook, response: Response) -> bool:
    """Whether a held input moves the output in its own row already: it acts before the row that it is written into."""
    u, y = _channels(look)
    if u is None or y is None or len(u.values) != len(y.values) or not response.sign:
        return False
    answer = _steps(y.signal) if look.reading["output"] == f"d({y.name})" else y.signal
    return acts_in_its_own_row(u.signal, answer, response.sign)


def _steps(position: Array) -> Array:
    """(N,) the change of a position since the row before; NaN where it jumps, as at a reset."""
    change = np.diff(position, prepend=np.nan)
    return np.where(np.abs(change) > JUMP * np.nanpercentile(np.abs(change), 95), np.nan, change)


def _column(name: str, raw: Columns) -> Column:
    series = raw.series[name]
    kind = "times" if series.dtype.is_temporal() else "numbers"
    values = as_numbers(series)
    said = meaning_of(name, raw.units.get(name, ""), values)
    known = len(series) - series.null_count()
    if not (series.dtype.is_numeric() or kind == "times") and np.isfinite(values).sum() < MOST * max(known, 1):
        found = Column(name, "text", said, len(series), missing=series.null_count())
        return found if raw.excerpt is None else _with_facts(found, raw.excerpt)
    found = column_of_numbers(name, kind, said, values)
    return found if raw.excerpt is None else _with_facts(found, raw.excerpt)


def _with_facts(column: Column, excerpt: Excerpt) -> Column:
    """A column of an excerpt with what is known of all rows of its file."""
    facts, edges = excerpt.table.facts, np.cumsum([len(each) for each in excerpt.stretches])[:-1]
    low, high = column.low, column.high
    if column.name in facts.ranges and not column.codes:
        (low, _), (high, _) = facts.ranges[column.name]
    missing = facts.missing[column.name]
    return replace(column, rows=excerpt.rows, missing=missing, low=low, high=high, breaks=tuple(edges.tolist()))


def _bare(given: Sequence[str]) -> str:
    """The column of the first channel that is given; empty where none is."""
    first = next(iter(given), "")
    inner = re.fullmatch(r"d\((.+)\)", first)
    return inner[1] if inner else first


def _proposal(raw: Columns, columns: Mapping[str, Column], clock: Clock, roles: Roles, motor: Axes) -> dict[str, Any]:
    """Arguments of `emsid.read` as guessed."""
    used = [columns[name] for name in (roles.input, roles.output) if name in columns]
    output = columns.get(roles.output)
    kinds = [columns[name].meaning.quantity if name in columns else None for name in (roles.input, roles.output)]
    # a position that follows a reference, or another position, is no integral of it; nor are counts since the last row
    follows = kinds[0] in (ColumnQuantity.REFERENCE, _POSITION) or roles.integral < NO_INTEGRAL
    position = kinds[1] is _POSITION and not follows
    reading: dict[str, Any] = {
        "input": roles.input,
        "output": f"d({roles.output})" if position else roles.output,
        "mask": mask_of(used, output),
        "wrap": {column.name: column.period for column in used if column.period},
        "units": {column.name: unit for column in used if (unit := _convertible(column.meaning))},
    }
    if clock.column:
        reading["time"] = clock.column
        said = columns[clock.column].meaning.unit
        reading["time_unit"] = clock.unit if clock.unit and said not in SECONDS and clock.unit != "s" else None
        reading["rows"] = clock.rows
        reading["resample"] = None if clock.axis is None or clock.axis.regular else True
    else:
        reading["dt"] = clock.dt
    names = {*(column.name for column in (*used, *motor.values())), *([clock.column] if clock.column else [])}
    bad = sum(columns[name].missing for name in names if not columns[name].gaps) + len(raw.damaged)
    reading["skip_bad_rows"] = True if bad else None
    return reading


def _convertible(said: Meaning) -> str:
    """A unit that converts without further numbers; empty where there is none."""
    return said.unit if not re.search(r"pwm|count|sample|percent|%", said.unit) else ""


def _about_columns(look: FirstLook, given: set[str]) -> list[Finding]:
    """Findings about the guesses, and about the columns that are used."""
    findings = _about_clock(look.clock, look)
    roles = look.roles
    used = [column for column in look.columns if column.name in (roles.input, roles.output)]
    for side, name, sure in (
        ("input", roles.input, roles.input_confidence),
        ("output", roles.output, roles.output_confidence),
    ):
        if name and sure < UNSURE:
            findings.append(Finding("role-uncertain", name, {"role": side, "confidence": sure}))
    if roles.others:
        pairs = [list(pair) for pair in roles.others]
        findings.append(
            Finding("several-experiments", look.name, {"chosen": [roles.input, roles.output], "pairs": pairs})
        )
    for column in used:
        findings += _about_column(column, look, given)
    if "mask" not in given:
        findings += masked_outliers(used, next((each for each in used if each.name == roles.output), None))
    return findings + _about_references(look)


def _about_references(look: FirstLook) -> list[Finding]:
    """Columns that are named as references, and that the output follows, or another measured motion."""
    roles, findings = look.roles, []
    motions = sorted(
        (each for each in look.columns if each.name == roles.output or each.meaning.quantity in _MOTIONS),
        key=lambda each: each.name != roles.output,
    )
    for column in look.columns:
        named = column.meaning.quantity is ColumnQuantity.REFERENCE and column.name not in (roles.input, roles.output)
        follows = next((each.name for each in motions if named and _follows(each, column)), "")
        if follows:
            findings.append(Finding("reference-column", column.name, {"input": roles.input, "follows": follows}))
    return findings


def _follows(column: Column, reference: Column) -> bool:
    """Whether one column has nearly the course of another."""
    if len(column.values) != len(reference.values) or column.constant or reference.constant:
        return False
    both = np.stack([reference.signal, column.signal])
    return bool(np.corrcoef(both[:, np.isfinite(both).all(axis=0)])[0, 1] > MOST)


def _about_column(column: Column, look: FirstLook, given: set[str]) -> list[Finding]:
    name, findings = column.name, []
    if column.codes:
        codes = [
            {"value": code.value, "count": code.count, "share": code.share, "response": code.response}
            for code in column.codes
        ]
        findings.append(Finding("isolated-values", name, {"codes": codes, "low": column.low, "high": column.high}))
    if column.period and "wrap" not in given:
        findings.append(Finding("position-wraps", name, {"period": column.period}))
    if column.gaps:
        findings.append(Finding("values-missing", name, {"count": column.missing, "rows": column.rows}))
    stuck = next((each for each in column.stuck if _is_stuck(look, column, each)), None)
    if stuck is not None:
        data = {"row": stuck.start, "length": stuck.length, "value": stuck.value}
        findings.append(Finding("value-stuck", name, data))
    if name == look.roles.output and look.reading.get("output") == f"d({name})" and "output" not in given:
        findings.append(Finding("position-differentiated", name, {"input": ""}))
    position = next((each for each in look.columns if abs(per_change(column, each) - 1) < SAME), None)
    if position is not None:
        findings.append(Finding("difference-of-position", name, {"position": position.name}))
    return findings


def _is_stuck(look: FirstLook, output: Column, stretch: Stretch) -> bool:
    """Whether an output stays at one value although its input changes."""
    u, _ = _channels(look)
    if u is None or len(u.values) != len(output.values):
        return False
    return is_stuck(u.signal, output.signal, stretch)


def _about_clock(clock: Clock, look: FirstLook) -> list[Finding]:
    given, dt = {"dt", "time_unit"} & set(look.reading), look.reading.get("dt")
    if dt is not None and dt != clock.dt:
        return list(contradiction(look.stated, look.name, dt))
    if clock.source == "nothing" and dt == clock.dt:
        texts = [each.name for each in look.columns if each.kind == "text" and each.meaning.quantity is _TIME]
        return [Finding("sample-time-unknown", look.name, {"assumed": clock.dt, "texts": texts})]
    findings = []
    if clock.unit_confidence < 1 and clock.unit != "s" and given:
        data = {"unit": clock.unit, "dt": clock.dt, "confidence": clock.unit_confidence, "source": clock.source}
        findings.append(Finding("time-unit-assumed", clock.column or look.name, data))
    elif clock.source not in ("column", "nothing") and "dt" in look.reading:
        findings.append(Finding("sample-time-from-text", look.name, {"dt": clock.dt, "source": clock.source}))
    if clock.axis is not None and not clock.axis.regular and look.reading.get("resample"):
        axis = clock.axis
        data = {"gaps": len(axis.gaps), "longest": max(axis.lengths, default=0.0), "duplicates": len(axis.duplicates)}
        findings.append(Finding("clock-irregular", clock.column, data | {"jitter": axis.jitter, "dt": axis.dt}))
    return findings


DERIVED = 0.999
"""The correlation of a speed with the change of a count that it was derived from, at least: rounding leaves less."""


def sign_of_input(columns: Sequence[Column], roles: Roles) -> Finding | None:
    """A finding about an input without a sign: which column has it, or that none has it and the output goes both ways.

    Args:
        columns: of the file, equally long.
        roles: which of them are input and output.
    """
    named = {column.name: column for column in columns}
    u, y = named.get(roles.input), named.get(roles.output)
    if u is None or y is None or not u.low >= 0 or u.constant:
        return None
    two_valued = [each for each in columns if each.distinct == 2 and each not in (u, y)]
    if roles.direction:
        return Finding("direction-column", u.name, {"column": roles.direction, "output": y.name})
    if u.meaning.quantity not in (ColumnQuantity.DUTY, ColumnQuantity.VOLTAGE) or u.low > PART * u.high:
        return None  # pulses and commands about a middle have no sign
    speed = y.movement[np.isfinite(y.movement)]
    forward, backward = (np.percentile(speed, 95), -np.percentile(speed, 5)) if len(speed) else (0.0, 0.0)
    if min(forward, backward) < PART * max(forward, backward) or not min(forward, backward) > 0:
        return None
    return Finding("sign-lost", u.name, {"output": y.name, "candidates": [each.name for each in two_valued]})


def further_channels(columns: Sequence[Column], roles: Roles, file: str) -> Iterable[Finding]:
    """A finding about columns that may be channels too.

    Args:
        columns: of the file, equally long.
        roles: which of them are input and output.
        file: its name.
    """
    named = {column.name: column for column in columns}
    u, y = named.get(roles.input), named.get(roles.output)
    if u is None or y is None or roles.others:
        return
    rest = [each for each in columns if each.kind == "numbers" and not each.constant and each not in (u, y)]
    torques = [each for each in rest if each.meaning.quantity is ColumnQuantity.TORQUE]
    is_electrical = u.meaning.quantity in (ColumnQuantity.VOLTAGE, ColumnQuantity.DUTY)
    loads = [each.name for each in torques if is_electrical and _acts(each, u, y)]
    currents = [each.name for each in rest if is_electrical and each.meaning.quantity is ColumnQuantity.CURRENT]
    is_speed = y.meaning.quantity is ColumnQuantity.SPEED
    counts = [each for each in rest if is_speed and each.meaning.quantity is ColumnQuantity.POSITION]
    sensors = [each.name for each in counts if per_change(y, each)]
    data = {"inputs": loads, "outputs": currents, "positions": sensors}
    if loads or currents or sensors:
        yield Finding("further-channels", file, data)


def _acts(load: Column, u: Column, y: Column) -> bool:
    """Whether a torque acts on the output, and is not computed from the current that drives it."""
    if not len(load.values) == len(y.values) == len(u.values):
        return False
    table = np.column_stack([each.signal for each in (u, load, y)])
    found = answers(table[np.isfinite(table).all(axis=1)], inputs=[0, 1])
    clear = {pair: answer.clear for pair, answer in found.items()}
    return clear.get((1, 2), 0.0) >= ANSWERED > clear.get((0, 1), 0.0)


def per_change(speed: Column, position: Column) -> float:
    """The ratio of a speed to the change of a position from row to row; 0 where the speed is not computed from it."""
    if len(speed.values) != len(position.values) or len(speed.values) < FEWEST_LEVELS:
        return 0.0
    rows = slice(max(len(speed.values) - SAMPLES, 0) // 2, (len(speed.values) + SAMPLES) // 2)
    change, said = np.diff(position.signal[rows]), speed.signal[rows][1:]
    known = np.isfinite(change) & np.isfinite(said)
    if not (known.any() and np.ptp(change[known]) and np.ptp(said[known])):
        return 0.0
    change, said = change[known], said[known]
    return float(change @ said / (change @ change)) if np.corrcoef(change, said)[0, 1] > DERIVED else 0.0
