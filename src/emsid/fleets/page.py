"""The page of a fleet: which motors differ or have changed, every parameter over the motors and over time, failures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from emsid.estimation.estimates import HALF_WIDTH
from emsid.fleets.spread import Change, Outlier, Series, long_enough, reasons
from emsid.fleets.verb import Fleet
from emsid.fleets.work import FleetRow
from emsid.report.document import (
    Axis,
    Band,
    Fact,
    Figure,
    Ink,
    Level,
    Line,
    Notice,
    Plot,
    Points,
    Report,
    Section,
    Stroke,
    Table,
)
from emsid.report.numbers import estimate, first_up, number, slug
from emsid.units import plain_unit
from emsid.wording import Severity, Spelling, as_python, sentence, severity
from emsid.wording.lists import listed, shortened
from emsid.wording.live import EFFECTS, FACTORS

MARK = "*"
"""Behind the names of parameters that depend on assumed values."""
MOST_ROWS = 2_000
"""Rows of the table of all motors: a page of more is slow to open; the Parquet file has all."""
MOST_NAMED = 30
"""Motors whose series are drawn in colour, so that lines and legend stay readable."""
INKS = (Ink.RED, Ink.ORANGE, Ink.PURPLE, Ink.GREEN, Ink.NAVY)


def fleet_report(result: Fleet, source: str, argument: Spelling = as_python) -> Report:
    """The page of a fleet.

    Args:
        result: of `emsid.fleet`.
        source: what it was read from, in a few words.
        argument: how names of arguments are written in its findings.
    """
    good = len(result.rows) - len(result.failed)
    motors = {row.motor for row in result.rows}
    named = {outlier.motor for outlier in result.outliers} | {change.motor for change in result.changes}
    changed = long_enough(result.series)
    different = {outlier.parameter for outlier in result.outliers}
    series = [*result.series, *([result.noise] if result.noise is not None else [])]
    first, others = ([each for each in series if (each.parameter in different) is named] for named in (True, False))
    sections = [Section("Parameters over the motors", figures=(over_motors(result, others),))] if others else []
    if changed and good:
        sections.append(Section("Parameters over time", figures=(over_periods(result, changed),)))
    if result.failed:
        sections.append(Section("Without a model", tables=(_failures(result),)))
    sections.append(Section("All rows", tables=(_rows(result),)))
    return Report(
        title="Fleet",
        summary=(
            _named(result),
            f"{len(motors):,} motors of {source}: {good:,} of {len(result.rows):,} rows have a model."
            + " In a healthy fleet at most one run in 20 names any motor as different, and one in 20 as changed."
            * any(result.tested.values()),
            *(sentence(each, argument) for each in result.findings if each.code.startswith("fleet-too-")),
        ),
        facts=(
            Fact(f"{len(motors):,}", "motors"),
            Fact(f"{len(named)}", "named: different or changed"),
            Fact(f"{len(result.failed):,}", "rows without a model"),
        ),
        sections=tuple(sections),
        opening=Section(
            "",
            tables=tuple(filter(None, (_causes(result), _outliers(result), _changes(result)))),
            figures=(over_motors(result, first, "motors-that-differ"),) if first else (),
        ),
        notices=tuple(
            Notice(sentence(finding, argument), severity(finding).value)
            for finding in result.findings
            if severity(finding) is not Severity.INFO and not finding.subject
        ),
        imprint=f"emsid fleet {source}",
    )


def _named(result: Fleet) -> str:
    """The motors that differ or have changed, with the parameters in which they do; nothing where it was not tested."""
    parts, explained = [], {(each.motor, name) for each in result.causes for name in each.parameters}
    named: tuple[Sequence[Outlier | Change], ...] = result.outliers, result.changes
    for found, (effect, tested) in zip(named, result.tested.items(), strict=True):
        of: dict[str, list[str]] = {}
        for cause in result.causes if found is result.outliers else ():
            of[cause.motor] = [FACTORS[cause.causes[0]]]
        for each in found:
            if found is result.changes or (each.motor, each.parameter) not in explained:
                of.setdefault(each.motor, []).append(each.parameter)
        names = shortened([f"{motor} ({listed(parameters)})" for motor, parameters in of.items()])
        if of or tested:
            one, several = EFFECTS[effect]
            parts.append(f"{names} {several if len(of) > 1 else one}" if of else f"no motor {one}")
    return f"{first_up('; '.join(parts) or 'no motors were compared')}."


def _causes(result: Fleet) -> Table | None:
    rows = tuple(
        (
            cause.motor,
            " or ".join(FACTORS[each] for each in cause.causes),
            ", ".join(f"{name} × {ratio:.3g}" for name, ratio in cause.ratios.items()),
            f"{cause.factor:.3g}",
        )
        for cause in result.causes
    )
    head = ("Motor", "Cause", "Parameters, over those of the fleet", "Factor")
    return (
        Table(head, rows, "Motors in which one cause explains several differences.", text_columns=3) if rows else None
    )


def _outliers(result: Fleet) -> Table | None:
    rows = tuple(
        (
            outlier.motor,
            _marked(result, outlier.parameter),
            _shown(outlier.value, outlier.half_width),
            f"± {outlier.half_width:.2g}" if outlier.half_width else "unknown",
            number(outlier.centre),
            f"{outlier.deviation:.2g}",
            plain_unit(outlier.unit),
            f"{outlier.score:+.1f}",
        )
        for outlier in result.outliers
    )
    head = ("Motor", "Parameter", "Value", "95 % interval", "Fleet", "Deviation", "Unit", "Score")
    note = "Score: distance to the fleet, in standard deviations of motors and estimate together."
    return Table(head, rows, "Motors that differ from their fleet.", note, text_columns=2) if rows else None


def _shown(value: float, half_width: float) -> str:
    """A value with the digits that its interval supports; four where it has none."""
    return estimate(value, half_width) if half_width > 0 else number(value)


def _changes(result: Fleet) -> Table | None:
    rows = tuple(
        (
            change.motor,
            _marked(result, change.parameter),
            change.since,
            number(change.before),
            number(change.after),
            f"{change.after - change.before:+.2g} ± {change.half_width:.2g}",
            plain_unit(change.unit),
            f"{change.score:+.1f}",
        )
        for change in result.changes
    )
    head = ("Motor", "Parameter", "Since", "Before", "After", "Change", "Unit", "Score")
    return Table(head, rows, "Motors that have changed.", text_columns=3) if rows else None


def _failures(result: Fleet) -> Table:
    rows = tuple(
        (rows[0].reason, f"{len(rows):,}", ", ".join(map(_name, rows[:5])) + ", …" * (len(rows) > 5))
        for rows in reasons(result.rows).values()
    )
    return Table(("Reason", "Rows", "Motors"), rows, "Rows without a model, by reason.", ends_in_text=True)


def _name(row: FleetRow) -> str:
    return f"{row.motor} ({row.period})" if row.period else row.motor


def _rows(result: Fleet) -> Table:
    names = [each.parameter for each in result.series]
    units = {each.parameter: plain_unit(each.unit) for each in result.series}
    columns = (f"{_marked(result, name)} [{units[name] or '–'}]" for name in names)
    head = ("Motor", "Period", "Verdict", "Fit %", *columns)
    rows = tuple(
        (
            row.motor,
            row.period,
            "no model" if row.reason else row.verdict.removeprefix("model-"),
            number(row.fit_percent),
            *(
                _shown(row.estimates[name].value, row.estimates[name].half_width) if name in row.estimates else "–"
                for name in names
            ),
        )
        for row in result.rows[:MOST_ROWS]
    )
    caption = "Every motor and period."
    if len(result.rows) > MOST_ROWS:
        caption = f"The first {MOST_ROWS:,} of {len(result.rows):,} rows; the Parquet file has all."
    note = f"{MARK} depends on a value that is assumed, not measured." if result.assuming else ""
    return Table(head, rows, caption, note, text_columns=3)


def _marked(result: Fleet, parameter: str) -> str:
    """The name of a parameter, with a mark where it depends on an assumed value."""
    return f"{parameter} {MARK}" if parameter in result.assuming else parameter


def over_motors(result: Fleet, series: Sequence[Series], name: str = "over-motors") -> Figure:
    """Parameters of all motors in the order of their names, with intervals, ordinary range and outliers."""
    plots = []
    for each in series:
        means, errors = each.of_motors
        places = np.arange(float(len(means)))
        known = np.isfinite(means)
        marks: list[Band | Level | Line | Points] = []
        usual = result.ordinary.get(each.parameter)
        if usual is not None and usual.deviation > 0:
            reach = HALF_WIDTH * usual.deviation
            low, high = np.full(2, usual.centre - reach), np.full(2, usual.centre + reach)
            ends = np.array([-0.5, len(means) - 0.5])
            marks.append(Band(ends, low, high, "95 % of healthy motors", Ink.GREEN))
        bars = np.array([[x, x, np.nan] for x in places[known]]).ravel()
        ends = np.column_stack([means - HALF_WIDTH * errors, means + HALF_WIDTH * errors, np.full(len(means), np.nan)])
        if np.any(errors[known] > 0):
            marks.append(Line(bars, ends[known].ravel(), "95 % interval", Stroke(Ink.BLUE)))
        marks.append(Points(places[known], means[known], "motor", Ink.NAVY))
        named = [one.motor for one in result.outliers if one.parameter == each.parameter]
        at = np.array([each.motors.index(motor) for motor in named], dtype=int)
        if len(at):
            texts = tuple(named) if len(named) <= MOST_NAMED else ()
            marks.append(Points(places[at], means[at], "differs", Ink.RED, texts))
        span = _range(means[known], HALF_WIDTH * float(np.median(errors[known])))
        plots.append(
            Plot(
                tuple(marks),
                Axis("Motor", range=(-0.5, len(means) - 0.5), names=each.motors),
                Axis(_marked(result, each.parameter), each.unit, range=span),
            )
        )
    return Figure(
        name,
        "Estimates of all motors, in the order of their names.",
        tuple(plots),
        columns=min(2, len(plots)),
    )


def _range(values: np.ndarray, half_width: float = 0.0) -> tuple[float, float]:
    """All values with the interval of a typical one; wide ones may leave the plot, so that they do not flatten it."""
    low, high = float(values.min()) - half_width, float(values.max()) + half_width
    room = 0.15 * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room


def over_periods(result: Fleet, series: Sequence[Series]) -> Figure:
    """Every parameter of all motors over the periods; those that have changed in colour."""
    plots = []
    for each in series:
        time = np.arange(len(each.periods), dtype=np.float64)
        changed = [one.motor for one in result.changes if one.parameter == each.parameter][:MOST_NAMED]
        others = [k for k, motor in enumerate(each.motors) if motor not in changed]
        x = np.tile(np.append(time, np.nan), len(others))
        y = np.column_stack([each.values[others], np.full(len(others), np.nan)]).ravel()
        marks = [Line(x, y, "motor", Stroke(Ink.GREY, width=0.5))] if others else []
        for k, motor in enumerate(changed):
            values = each.values[each.motors.index(motor)]
            marks.append(Line(time, values, motor, Stroke(INKS[k % len(INKS)])))
        known = each.values[np.isfinite(each.values)]
        axes = Axis("Period", names=each.periods), Axis(_marked(result, each.parameter), each.unit, range=_range(known))
        plots.append(Plot(tuple(marks), *axes))
    first, last = series[0].periods[0], series[0].periods[-1]
    return Figure(
        f"over-periods-{slug(first)}" if slug(first) else "over-periods",
        f"Estimates over the periods from {first} to {last}; in colour the motors that have changed.",
        tuple(plots),
        columns=min(2, len(plots)),
    )
