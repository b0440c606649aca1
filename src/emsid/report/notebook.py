"""Results as text, as HTML for a notebook, and as Matplotlib figures, which `emsid.presentation` is given to show them.

The HTML of a result has its table and an embedded image, so that a notebook stays one file. All text that may come from
a file is escaped.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import replace
from functools import singledispatch
from html import escape
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.estimation.fit import Ending, Fit
from emsid.first_look import FirstLook
from emsid.identification import Identification
from emsid.models.plants.search.diagnostics import Curve
from emsid.models.plants.search.result import GreyBoxFit, Status
from emsid.record import FrequencyResponse, Record
from emsid.report.document import Axis, Bars, Figure, Plot, Table
from emsid.report.figures import draw, sheet
from emsid.report.numbers import estimate, less_than, number
from emsid.report.views import analysis, first_look
from emsid.report.views.conventions import channel_axis
from emsid.report.views.front import results_table
from emsid.report.views.grey_box import characteristic, cogging, dead_zone, friction, sticking
from emsid.report.views.record import measured_and_simulated, responses
from emsid.report.views.residuals import residuals
from emsid.units import readable_unit
from emsid.validation.analysis import Residuals, measured_curve
from emsid.validation.comparison import Assessment, Comparison
from emsid.validation.responses import Analysed, BodeCurve, PoleMap, Several, TimeResponse
from emsid.wording import Severity, severity
from emsid.wording import sentence as worded

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

MOST_DRAWN = 5
"""At most this many models are drawn in one plot, the best first."""
MOST_BARS = 24
"""At most this many parameters are drawn, those with the widest intervals first."""


class ParameterRow(NamedTuple):
    """A line of the table of a fit, as text."""

    name: str
    value: str
    interval: str
    unit: str


def parameter_rows(fit: Fit[Any]) -> list[ParameterRow]:
    """Every parameter with estimate, unit, and 95 % interval or the reason why there is none."""
    if fit.table:
        half = {name: (high - low) / 2 for name, (low, high) in zip(fit.names, fit.interval(), strict=True)}
        return [_row(row.name, row.value, half.get(row.name), row.unit, row.status, row.how) for row in fit.table]
    halves = [None] * len(fit.names) if fit.biased else (np.diff(fit.interval(), axis=1)[:, 0] / 2).tolist()
    estimates = zip(fit.names, fit.estimate.tolist(), halves, strict=True)
    return [_row(name, value, half, "", fit.status, fit.status) for name, value, half in estimates]


def _row(name: str, value: float, half: float | None, unit: str, status: str, how: str) -> ParameterRow:
    shown = readable_unit(unit) if unit else ""
    if half is None or status in (Status.KEPT, Status.FIXED, Status.AT_BOUND, Status.UNDETERMINED):
        return ParameterRow(name, number(value), how, shown)
    if not isfinite(half):
        return ParameterRow(name, number(value), "not determined by these data", shown)
    ends = f"{estimate(value - half, half)} … {estimate(value + half, half)}"
    text = (unit and less_than(value, half)) or estimate(value, half)
    return ParameterRow(name, text, ends + f" ({how})" * (how != Status.ESTIMATED), shown)


def how_it_ended(fit: Fit[Any]) -> str:
    """Ending and size of a fit, in a line."""
    steps = f" after {fit.iterations} steps" if fit.iterations else ""
    ended = {
        Ending.SOLVED: "solved",
        Ending.CONVERGED: f"converged{steps}",
        Ending.RANK_DEFICIENT: f"ended{steps}; the data do not determine every parameter",
        Ending.STALLED: f"stalled{steps} before a minimum",
        Ending.OUT_OF_BUDGET: f"stopped{steps}, before a minimum: the limit of steps or time was reached",
        Ending.INTERRUPTED: f"interrupted{steps}; the best so far is kept",
    }[fit.ending]
    return f"{ended}, {fit.samples:,.0f} samples"


# --- figures ---------------------------------------------------------------------------------------------------------


@singledispatch
def figure(thing: Any) -> Figure | None:
    """The figure that shows a result; None where there is nothing to draw."""
    return None


@figure.register
def _(record: Record) -> Figure:
    return first_look.over_time(record, "record", f"{record.name}: inputs and outputs.", channel_axis, 0.6)


@figure.register
def _(look: FirstLook) -> Figure | None:
    return first_look.figure(look)


@figure.register
def _(comparison: Comparison) -> Figure:
    drawn = comparison.assessments[:MOST_DRAWN]
    whole = responses(drawn, [slice(0, len(comparison.best.record))], name="comparison")
    return replace(whole, caption=f"Free runs on {comparison.best.record.name}.")


@figure.register
def _(result: Identification) -> Figure | None:
    return figure(result.on_unseen)


@figure.register
def _(assessment: Assessment) -> Figure:
    return measured_and_simulated(assessment)


@figure.register
def _(curve: Curve) -> Figure:
    return characteristic(curve)


@figure.register
def _(analysed: Analysed) -> Figure | None:
    return figure(Several((analysed,)))


@figure.register
def _(several: Several) -> Figure | None:  # type: ignore[type-arg]
    """Results of several models in one picture."""
    drawn: list[Any] = list(several)
    if all(isinstance(each, Residuals) for each in drawn):
        return residuals([each.assessment for each in drawn]) if drawn else None
    for kind, draw_all in (
        (TimeResponse, analysis.over_time),
        (BodeCurve, analysis.over_frequency),
        (PoleMap, analysis.poles_and_zeros),
    ):
        if all(isinstance(each, kind) for each in drawn):
            return draw_all(drawn, several.labels)
    return None


@figure.register
def _(response: FrequencyResponse) -> Figure | None:
    outputs, inputs = response.response.shape[1:]
    paths = [response.path(i, j) for i in range(outputs) for j in range(inputs)]
    several = [replace(each, name=f"{each.output_names[0]} from {each.input_names[0]}") for each in paths]
    return figure(Several(measured_curve(each) for each in (several if len(several) > 1 else paths)))


@figure.register
def _(fit: GreyBoxFit) -> Figure | None:
    """The free run, and the friction and the dead zone that the fit found."""
    parts = (
        [each for each in (sticking(fit), friction(fit), dead_zone(fit), cogging(fit)) if each] if fit.segments else []
    )
    if not parts:
        return _interval_widths(fit)
    plots = tuple(plot for part in parts for plot in part.plots)
    return replace(parts[0], caption=" ".join(part.caption for part in parts), plots=plots, shared_x=False)


@figure.register
def _(fit: Fit) -> Figure | None:  # type: ignore[type-arg]
    return _interval_widths(fit)


def _interval_widths(fit: Fit[Any]) -> Figure | None:
    """Half the 95 % interval of every parameter, in percent of its estimate; without intervals, the estimates."""
    half = np.full(len(fit.estimate), np.nan) if fit.biased else np.diff(fit.interval(), axis=1)[:, 0] / 2
    share = 100 * half / np.maximum(np.abs(fit.estimate), np.finfo(float).tiny)
    if np.any(np.isfinite(share) & (share > 0)):
        return _bars(
            fit, share, "Half the 95 % interval, share of the estimate", "%", "how well each parameter is known"
        )
    return _bars(fit, np.abs(fit.estimate), "Size of the estimate", "", "the parameters, which have no intervals")


def _bars(fit: Fit[Any], sizes: NDArray[np.float64], title: str, unit: str, caption: str) -> Figure | None:
    """A bar for every parameter, the largest first, with its estimate beside it."""
    order = [int(k) for k in np.argsort(-sizes) if np.isfinite(sizes[k]) and sizes[k] > 0][:MOST_BARS]
    if not order:
        return None
    names = tuple(fit.names[k] for k in order)
    low, high = float(sizes[order].min()), float(sizes[order].max())
    log = high > 20 * low
    x = Axis(title, unit, log, (0.5 * low, 2 * high) if log else (0, 1.05 * high))
    bars = Bars(sizes[order], tuple(number(float(fit.estimate[k])) for k in order))
    plots = (Plot((bars,), x, Axis("Parameter", names=names), height=0.17 + 0.19 * len(order)),)
    return Figure("estimates", f"{fit.model.name}: {caption}.", plots)


def plot(thing: Any) -> Sheet:
    """A result as a Matplotlib figure.

    Raises:
        DataError: where there is nothing to draw.
    """
    drawn = figure(thing)
    if drawn is None:
        raise DataError(f"there is nothing to draw of {thing!r}: all parameters are zero")
    return sheet(drawn)


# --- text and HTML ---------------------------------------------------------------------------------------------------


@singledispatch
def tables(thing: Any) -> tuple[list[str], Table | None, list[str]]:
    """The lines before the table of a result, the table, and the lines after it."""
    return [repr(thing)], None, []


@tables.register
def _(record: Record) -> tuple[list[str], Table | None, list[str]]:
    names, units = record.input_names + record.output_names, record.input_units + record.output_units
    values = np.hstack([record.input, record.output])
    sides = ("input",) * len(record.input_names) + ("output",) * len(record.output_names)
    rows = tuple(
        (name, side, readable_unit(unit), number(float(x.min())), number(float(x.mean())), number(float(x.max())))
        for name, side, unit, x in zip(names, sides, units, values.T, strict=True)
    )
    return [repr(record)], Table(("Channel", "Side", "Unit", "Smallest", "Mean", "Largest"), rows, text_columns=3), []


@tables.register
def _(fit: Fit) -> tuple[list[str], Table | None, list[str]]:  # type: ignore[type-arg]
    rows = parameter_rows(fit)
    units = any(row.unit for row in rows)
    header = ("Parameter", *("Unit",) * units, "Estimate", "95 % interval")
    cells = tuple((row.name, *(row.unit,) * units, row.value, row.interval) for row in rows)
    table = Table(header, cells, text_columns=1 + units, ends_in_text=True)
    return (
        [f"{fit.model.name}, {fit.fitted}: {how_it_ended(fit)}"],
        table if rows else None,
        [worded(each) for each in fit.findings],
    )


@tables.register
def _(look: FirstLook) -> tuple[list[str], Table | None, list[str]]:
    table = first_look.column_table(look)
    arguments = ", ".join(f"{name}={value!r}" for name, value in look.reading.items())
    return [table.caption], table, [*first_look.lines(look), f"emsid.read({look.path!r}, {arguments})"]


@tables.register
def _(comparison: Comparison) -> tuple[list[str], Table | None, list[str]]:
    unit = comparison.best.record.output_units[0]
    table = results_table(comparison.rows, unit=unit)
    return [table.caption], table, [table.note] * bool(table.note)


@tables.register
def _(assessment: Assessment) -> tuple[list[str], Table | None, list[str]]:
    return tables(Comparison((assessment,)))


@tables.register
def _(result: Identification) -> tuple[list[str], Table | None, list[str]]:
    _, table, notes = tables(result.on_unseen.by_error)
    problems = [worded(finding) for finding in result.findings if severity(finding) is Severity.PROBLEM]
    return [f"Free run on {result.ranked_on}: {worded(result.recommendation[0])}"], table, [*notes, *problems]


def text(thing: Any) -> str:
    """A result as lines of text."""
    before, table, after = tables(thing)
    return "\n".join([*before, *([] if table is None else _aligned(table)), *after])


def _aligned(table: Table) -> list[str]:
    """Lines of a table; text is aligned at the left, numbers at the right."""
    lines = (table.header, *table.rows)
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if table.is_text(k) else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]


def html(thing: Any) -> str:
    """A result as HTML for a notebook."""
    before, table, after = tables(thing)
    parts = [f"<p>{escape(line)}</p>" for line in before]
    if table is not None:
        parts.append(_html_table(table))
    parts += [f"<p>{escape(line)}</p>" for line in after]
    drawn = figure(thing)
    if drawn is not None:
        image = b64encode(draw(drawn)["svg"]).decode()
        parts.append(
            f'<img alt="{escape(drawn.caption)}" style="max-width: 40em" src="data:image/svg+xml;base64,{image}">'
        )
    return f"<div>{''.join(parts)}</div>"


def _html_table(table: Table) -> str:
    def line(cells: Sequence[str], tag: str) -> str:
        sides = ("left" if table.is_text(k) else "right" for k in range(len(cells)))
        inner = (f'<{tag} style="text-align: {side}">{escape(c)}</{tag}>' for c, side in zip(cells, sides, strict=True))
        return f"<tr>{''.join(inner)}</tr>"

    body = "".join(line(row, "td") for row in table.rows)
    return f"<table><thead>{line(table.header, 'th')}</thead><tbody>{body}</tbody></table>"
