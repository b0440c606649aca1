"""A first look at a file as a table, as lines of text with curves in braille letters, and as a page."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.arguments import as_names
from emsid.errors import listed
from emsid.findings import Finding
from emsid.first_look import FirstLook, Group, without_findings_of_all
from emsid.first_look.columns import Column
from emsid.first_look.names import ColumnQuantity
from emsid.first_look.nonlinearity import distortion_of
from emsid.record import Record
from emsid.report.document import Axis, Figure, Ink, Line, Notice, Plot, Points, Report, Section, Stroke, Table
from emsid.report.numbers import number
from emsid.report.views.conventions import TIME, channel_axis, in_words, timeline, with_gaps
from emsid.units import in_unit, plain_unit, readable_unit
from emsid.wording import Severity, Spelling, as_python, sentence, severity
from emsid.wording.lists import duration, how_sure

HEADER = ("Column", "Role", "Quantity", "Unit", "Notes", "From", "To", "Step")
NAMED = 3
"""Of more files than this, some are named and the number is given."""


def column_table(look: FirstLook, most: int | None = None) -> Table:
    """Every column with its range and the guesses about it.

    Args:
        look: what is shown.
        most: of more columns than this, only as many are shown: those with a role, then the first ones.
    """
    rows = [_row(column, look) for column in look.columns]
    rows += [(name, "", "", "", reason, "", "", "") for name, reason in look.others.items()]
    caption = f"{look.name}: {look.kind}, {look.rows:,} row{'s' * (look.rows != 1)}"
    caption += f", of which {look.looked_at:,} were looked at" * bool(look.looked_at)
    if most is not None and len(rows) > most:
        caption += f", {len(rows):,} columns, of which {most} are shown"
        first = sorted(range(len(rows)), key=lambda k: not rows[k][HEADER.index("Role")])[:most]
        rows = [rows[k] for k in sorted(first)]
    return Table(HEADER, tuple(rows), caption, text_columns=5)


def _row(column: Column, look: FirstLook) -> tuple[str, ...]:
    said = column.meaning
    quantity = "" if said.quantity is ColumnQuantity.UNKNOWN else str(said.quantity)
    unit = readable_unit(said.unit) if said.unit else ""
    span = (number(column.low), number(column.high)) if isfinite(column.low) else ("", "")
    step = number(column.step) if column.step else ""
    return (column.name, role(column, look), quantity, unit, _notes(column), *span, step)


def role(column: Column, look: FirstLook) -> str:
    """The guessed role of a column, and how sure it is; empty where it has none."""
    roles = look.roles
    found = {
        look.clock.column: ("time", look.clock.confidence),
        roles.output: ("output", roles.output_confidence),
        roles.input: ("input", roles.input_confidence),
    }.get(column.name)
    if found is None:
        sides = (side for side in ("input", "output") if column.name in as_names(look.reading.get(side) or ()))
        return next(sides, "reference" if column.meaning.quantity is ColumnQuantity.REFERENCE else "")
    return f"{found[0]} ({how_sure(found[1])})"


def _notes(column: Column) -> str:
    notes = [{"text": "text", "times": "dates or times"}.get(column.kind, "")]
    empty = column.missing == column.rows
    notes += ["constant" if column.constant and column.kind == "numbers" and not empty else ""]
    notes += ["empty" if empty else f"{column.missing:,} missing" if column.missing else ""]
    notes += [f"also {', '.join(f'{code.value:g}' for code in column.codes)}" if column.codes else ""]
    notes += [f"starts again after {column.period:.10g}" if column.period else ""]
    return ", ".join(filter(None, notes))


def lines(look: FirstLook, argument: Spelling = as_python) -> list[str]:
    """The clock, the record, the likeliest pairs with their evidence, and every finding, as lines of text."""
    clock, record = look.clock, look.record
    found = []
    if clock.column and clock.axis is not None:
        found.append(f"time column {clock.column}: {clock.axis}")
    kind = look.kind.evidence.get(look.kind.kind, {})
    for what, reasons in (
        (f"{clock.column or 'none'} is the time column", clock.evidence),
        (f"it is {look.kind}", kind),
    ):
        if reasons:
            shown = ", ".join(f"{reason} {weight:+.2g}" for reason, weight in reasons.items())
            found.append(f"why {what}, in log-odds: {shown}")
    if record is not None:
        found.append(f"record: {in_words(record)}")
    if len(look.roles.tried) > 1:
        pairs = (f"{u} → {y} {100 * left:.2g} %" for u, y, left in look.roles.tried)
        found.append(f"likeliest pairs, and what a simple response leaves of the output's variance: {', '.join(pairs)}")
    return [*found, *(f"- {sentence(finding, argument)}" for finding in look.findings)]


def _called(group: Group) -> str:
    """The name of a group of several files."""
    names = [look.name for look in group.looks]
    return f"{listed(names) if len(names) <= NAMED else f'{len(names)} files, such as {names[0]},'} together"


def about(name: str, said: str) -> str:
    """A sentence with the name of its file before it, unless it begins with that.

    >>> about("a.csv", "u is constant."), about("a.csv", "a.csv: the sample time is not given."), about("", "u stays.")
    ('a.csv: u is constant.', 'a.csv: the sample time is not given.', 'u stays.')
    """
    return said if not name or said.startswith(name) else f"{name}: {said}"


def of_all_files(divided: Sequence[Group], argument: Spelling = as_python) -> Iterable[tuple[str, tuple[str, ...]]]:
    """For each group of several files its name, and what these show together."""
    for group in divided:
        if group.findings:
            yield _called(group), tuple(sentence(finding, argument) for finding in group.findings)


def curves(look: FirstLook, width: int, height: int = 4) -> list[str]:
    """The first input and output in braille, with their ranges; nothing without a record."""
    if look.record is None:
        return []
    _, samples = timeline(look.record)
    result = []
    names = [*look.record.input_names[:1], *look.record.output_names[:1]]
    units = [*look.record.input_units[:1], *look.record.output_units[:1]]
    for name, unit in zip(names, units, strict=True):
        values = with_gaps(look.record.channel(name), samples)
        ends = [number(float(f(values))) for f in (np.nanmax, np.nanmin)]
        room = max(map(len, ends))
        drawn = braille(values, max(width - room - 2, 10), height)
        labels = [ends[0], *[""] * (height - 2), ends[1]]
        result += [in_unit(name, unit)]
        result += [f"{label:>{room}} {row}" for label, row in zip(labels, drawn, strict=True)]
    return result


def figure(look: FirstLook, name: str = "record") -> Figure | None:
    """The first inputs and outputs over time, where there are lines to draw."""
    if look.record is None or len(look.record) < 2:
        return None
    return over_time(look.record, name, f"Inputs and outputs of {look.name}.", channel_axis, 0.8)


def distortion_figure(look: FirstLook, name: str = "distortion") -> Figure | None:
    """The output of a periodic input over frequency: where the input is, even and odd distortion, and noise."""
    repeated = None if look.record is None or not look.record.output.shape[1] else distortion_of(look.record)
    if look.record is None or repeated is None:
        return None
    found, period = repeated
    frequency = np.arange(1, len(found.amplitude) + 1) / (period * look.record.dt)
    least = 1e-6 * float(found.amplitude.max())  # a logarithmic axis has no zero

    def points(where: NDArray[np.bool_], label: str, ink: Ink) -> Points:
        return Points(frequency[where], np.maximum(found.amplitude[where], least), label, ink)

    marks = (
        Line(frequency[found.band], np.maximum(found.noise[found.band], least), "noise", Stroke(Ink.GREY)),
        points(found.even, "even distortion", Ink.ORANGE),
        points(found.odd, "odd distortion", Ink.GREEN),
        points(found.excited, "at frequencies of the input", Ink.BLUE),
    )
    output, unit = look.record.output_names[0], look.record.output_units[0]
    plot = Plot(marks, Axis("Frequency", "Hz", log=True), Axis("Amplitude", plain_unit(unit), log=True))
    caption = (
        f"Amplitude of {output} over {found.periods} periods of {duration(period * look.record.dt)}. Distortion "
        "above the noise shows a nonlinear relation: even where it is unsymmetric, odd for dead zone, friction and "
        "saturation."
    )
    return Figure(name, caption, (plot,))


def over_time(record: Record, name: str, caption: str, axis: Callable[[str, str], Axis], height: float) -> Figure:
    """Every input and output of a record over time.

    Args:
        record: what is shown.
        name, caption: of the figure.
        axis: for the name and the unit of a channel.
        height: of each plot, in rows of ordinary height.
    """
    t, samples = timeline(record)
    plots = []
    for values, names, units in (
        (record.input, record.input_names, record.input_units),
        (record.output, record.output_names, record.output_units),
    ):
        for x, channel, unit in zip(values.T, names, units, strict=True):
            line = Line(t, with_gaps(x, samples), stroke=Stroke(width=0.9), stairs=values is record.input)
            plots.append(Plot((line,), TIME, axis(channel, unit), height=height))
    return Figure(name, caption, tuple(plots), shared_x=True)


_NEXT = (
    "There is nothing to identify here; see above what is missing.",
    "Run this, with corrections if a guess is wrong:",
    "Run these, with corrections if a guess is wrong:",
)
"""What to do next, by the number of commands."""


def report(
    looks: Sequence[FirstLook],
    together: Sequence[Finding],
    divided: Sequence[Group],
    commands: Sequence[str],
    argument: Spelling = as_python,
) -> Report:
    """A page about some files.

    Args:
        looks: one for each file.
        together: findings about all of them.
        divided: the files for each command, with what these show together.
        commands: what to run next.
        argument: how names of arguments are written.
    """
    looks = [without_findings_of_all(look, divided) for look in looks]
    sections = []
    for k, look in enumerate(looks, 1):
        drawn = tuple(filter(None, (figure(look, f"record-{k}"), distortion_figure(look, f"distortion-{k}"))))
        noticed = tuple(sentence(finding, argument) for finding in look.findings)
        clock = tuple(line for line in lines(look) if not line.startswith("- "))
        sections.append(Section(look.name, clock, tables=(column_table(look),), figures=drawn, remarks=noticed))
    sections += [Section(title, remarks=said) for title, said in of_all_files(divided, argument)]
    found = [("", finding) for finding in together]
    found += [(_called(group), finding) for group in divided for finding in group.findings]
    found += [(look.name, finding) for look in looks for finding in look.findings]
    notices = [
        Notice(about(name if len(looks) > 1 else "", sentence(finding, argument)), severity(finding).value)
        for name, finding in found
        if severity(finding) is not Severity.INFO
    ]
    return Report(
        title=f"First look at {looks[0].name}" if len(looks) == 1 else f"First look at {len(looks)} files",
        summary=("What the columns hold is guessed from their names and numbers.",),
        sections=(
            *sections,
            Section("Next", (_NEXT[min(len(commands), 2)],), tuple(commands)),
        ),
        notices=tuple(dict.fromkeys(notices)),
        imprint="emsid describe",
    )


# The bit of every dot of a braille letter, by row and column (Unicode 15, section 21.1).
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_BLANK = 0x2800


def braille(values: ArrayLike, width: int, height: int) -> list[str]:
    """A line through values (N,) as rows of braille letters; every column of dots spans the values that fall into it.

    Every letter shows two columns of four dots.

    >>> braille([0.0, 1.0, 2.0, 3.0], 2, 1)
    ['⡠⠊']

    Args:
        values: NaN leaves a gap.
        width: letters in a row.
        height: rows.
    """
    y = np.asarray(values, dtype=float)
    low, high = (float(f(y)) for f in (np.nanmin, np.nanmax))
    levels, columns = 4 * height, min(2 * width, max(len(y), 1))
    span = high - low or 1.0
    rows = (levels - 1) - np.rint((np.nan_to_num(y, nan=low) - low) / span * (levels - 1)).astype(int)
    dots: NDArray[np.bool_] = np.zeros((levels, 2 * width), dtype=bool)
    edges = np.linspace(0, len(y), columns + 1).astype(int)
    places = np.linspace(0, 2 * width - 1, columns).astype(int)
    for k, place in enumerate(places):
        part = slice(edges[k], max(edges[k + 1], edges[k] + 1))
        known = rows[part][np.isfinite(y[part])]
        if len(known):
            dots[known.min() : known.max() + 1, place] = True
    letters = (dots.reshape(height, 4, width, 2) * _DOTS[None, :, None, :]).sum(axis=(1, 3))
    return ["".join(chr(_BLANK + int(bits)) for bits in row) for row in letters]
