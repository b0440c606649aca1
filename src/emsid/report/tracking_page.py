"""The page of a tracking session: the estimate with its intervals, how it converged, what changed, the last samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from emsid.estimation.borders import collected, joined, tried
from emsid.live.session import COUNTS, Session
from emsid.report import views
from emsid.report.document import (
    Axis,
    Band,
    Dash,
    Figure,
    Ink,
    Line,
    Mark,
    Notice,
    Plot,
    Report,
    Section,
    Stroke,
    Table,
)
from emsid.report.numbers import number, slug
from emsid.report.views.record import settled_range
from emsid.units import plain_unit
from emsid.wording import Severity, sentence, severity
from emsid.wording.terms import meanings

MOST_PLOTS = 12
"""Plots of at most this many parameters; the table has all."""
WORDS = {
    "samples": "samples tracked",
    "lost": "samples lost",
    "malformed": "malformed lines",
    "not_finite": "samples that are not finite",
    "repeated": "repeated samples",
    "skipped": "samples in the log only",
    "gaps": "gaps",
}
ENDS = {
    "stopped": "it was stopped",
    "ended": "the source ended",
    "duration": "its time was up",
    "disconnected": "the source was disconnected",
}


def tracking_report(session: Session) -> Report:
    """The page of a session."""
    fit = session.fit
    assert fit is not None
    seconds = session.counts["samples"] * (session.dt or 0.0)
    found = session.findings
    sections: dict[str, Callable[[], Iterable[Section]]] = {
        "what happened": lambda: [
            Section(
                "What happened",
                remarks=tuple(map(sentence, found)) or ("Nothing unusual.",),
                tables=(_counts(session),),
            )
        ],
        "estimate over time": lambda: [Section("Estimate over time", figures=(convergence(session),))],
    }
    tables = {"parameters": lambda: _parameters(session), "physical values": lambda: _physical(session)}
    with collected() as noted:
        made = joined({f"section of the page: {part}": work for part, work in sections.items()})
        shown = [tried(f"table of the {part}", work, None) for part, work in tables.items()]
    return Report(
        title=f"Tracking of {session.name}",
        summary=(
            f"{fit.model.name} was tracked over {session.counts['samples']:,} samples ({seconds:.4g} s); then "
            f"{ENDS.get(session.reason, 'it ended')}. Predictions are one step ahead, from measured outputs.",
        ),
        sections=tuple(made),
        imprint=f"emsid track {session.name}",
        opening=Section(
            "",
            equations=(fit.model.equation(),),
            tables=tuple(filter(None, shown)),
            figures=tuple(filter(None, [tried("last samples", lambda: last_samples(session), None)])),
        ),
        notices=tuple(
            Notice(sentence(each), severity(each).value)
            for each in (*found, *noted)
            if severity(each) is Severity.PROBLEM or each in noted
        ),
    )


def _parameters(session: Session) -> Table:
    """The last estimate with its intervals."""
    fit = session.fit
    assert fit is not None
    halves = session.tracker.half_widths(session.tracking) if session.tracking else np.zeros(0)
    rows = tuple(
        (name, of, number(value), f"± {half:.2g}" if np.isfinite(half) else "unknown")
        for name, of, value, half in zip(
            fit.names, _meanings(session), fit.estimate.tolist(), halves.tolist(), strict=True
        )
    )
    head = ("Parameter", "Meaning", "Estimate", "95 % interval")
    return Table(head, rows, "The estimate at the end.", text_columns=2)


def _meanings(session: Session) -> tuple[str, ...]:
    """What every parameter multiplies, in words."""
    assert session.fit is not None
    return meanings(session.fit.model.structure, session.recent[0][0])


def _physical(session: Session) -> Table | None:
    """The physical values, if there are any."""
    rows = tuple(
        (
            each.name,
            number(each.value),
            "unknown" if each.half_width is None else f"± {each.half_width:.2g}",
            plain_unit(each.unit),
        )
        for each in session.physical
    )
    head = ("Quantity", "Value", "95 % interval", "Unit")
    return Table(head, rows, "Physical values at the end.", ends_in_text=True) if rows else None


def _counts(session: Session) -> Table:
    rows = tuple((WORDS[name], f"{session.counts[name]:,}") for name in COUNTS)
    return Table(("Count", "Number"), rows, "What the source has sent.")


def convergence(session: Session) -> Figure:
    """Every parameter over time with its interval, and the moments at which changes were detected."""
    history, fit = session.history, session.fit
    assert fit is not None
    time, estimates, halves = (np.array(each) for each in (history.time, history.estimate, history.half_width))
    order = np.argsort(time, kind="stable")
    time, estimates, halves = time[order], estimates[order], np.nan_to_num(halves[order])
    plots = []
    for k, (name, meaning) in list(enumerate(zip(fit.names, _meanings(session), strict=True)))[:MOST_PLOTS]:
        value, half = estimates[:, k], halves[:, k]
        wide = float(np.quantile(half[len(half) // 10 :], 0.75))
        low, high = settled_range(value, value[-1] + wide * np.array([-1.0, 1.0]))
        marks: list[Mark] = [
            Band(time, np.maximum(value - half, low), np.minimum(value + half, high), "95 % interval", Ink.BLUE),
            Line(time, value, "estimate", Stroke(Ink.BLUE)),
        ]
        for j, change in enumerate(session.changes):
            at = np.array([change.time, change.time])
            marks.append(Line(at, np.array([low, high]), "change" if not j else "", Stroke(Ink.RED, Dash.DASHED, 0.8)))
        plots.append(Plot(tuple(marks), Axis("Time", "s"), Axis(name, range=(low, high)), meaning))
    return Figure(
        f"{slug(fit.model.name)}-tracking",
        f"Estimates over time with 95 % intervals{'; dashed: detected changes' if session.changes else ''}.",
        tuple(plots),
        columns=min(2, len(plots)),
    )


def last_samples(session: Session) -> Figure:
    """Input, and measured and predicted output of the last samples."""
    records = [each for each, _ in session.recent]
    first = records[0]
    time = np.concatenate([each.time for each in records])
    output = np.concatenate([each.output[:, 0] for each in records])
    predicted = np.concatenate([each for _, each in session.recent])
    order = np.argsort(time, kind="stable")
    unit = views.channel_axis(first.output_names[0], first.output_units[0])
    inputs = np.concatenate([each.input for each in records])
    plots = [
        Plot(
            (
                Line(time[order], output[order], "measured", Stroke(Ink.BLACK)),
                Line(time[order], predicted[order], "predicted one step ahead", Stroke(Ink.RED, Dash.DASHED)),
            ),
            Axis("Time", "s"),
            unit,
        ),
        *(
            Plot(
                (Line(time[order], inputs[order, k], stairs=True),),
                Axis("Time", "s"),
                views.channel_axis(first.input_names[k], first.input_units[k]),
            )
            for k in range(inputs.shape[1])
        ),
    ]
    return Figure("last-samples", "The last samples.", tuple(plots), shared_x=True)
