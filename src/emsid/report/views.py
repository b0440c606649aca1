"""From results to content: each figure and table of a report as a pure function of what it shows.

What these return is plain data (`emsid.report.content`), to be put into the sections of a report. The numbers of the
paper's figures and tables that they correspond to stand in their docstrings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle, groupby
from math import ceil, floor, inf, isfinite, log10, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError, EmsidError, listed
from emsid.report.content import (
    Axis,
    Bars,
    Dash,
    Figure,
    Histogram,
    Ink,
    Level,
    Line,
    Mark,
    Plot,
    Points,
    Section,
    Stroke,
    Table,
    readable_unit,
)
from emsid.report.timeline import TIME, timeline, with_gaps
from emsid.report.wording import (
    capital,
    estimate,
    number,
    percent,
    plain_unit,
    prefixed,
    sentence,
    share_of,
    slug,
)

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.grey_box_findings import Profile
    from emsid.plant import DeadZone, Friction, Motor
    from emsid.record import Record
    from emsid.validation.comparison import Assessment, Comparison, OutputErrors, Row

Array = NDArray[np.float64]

MEASURED = Stroke(Ink.BLUE, Dash.SOLID, 1.6)

# How models are told apart, in the order in which they are given. The first two are the paper's: the linear model solid
# red, the nonlinear one dotted blue (dark, on the lighter solid blue of the measurement).
MODELS = (
    Stroke(Ink.RED, Dash.SOLID, 1.0),
    Stroke(Ink.NAVY, Dash.DOTTED, 1.4),
    Stroke(Ink.ORANGE, Dash.DASH_DOTTED, 1.2),
    Stroke(Ink.GREEN, Dash.DASHED, 1.2),
    Stroke(Ink.PURPLE, Dash.SOLID, 1.0),
    Stroke(Ink.GREY, Dash.DASHED, 1.2),
    Stroke(Ink.BLACK, Dash.DASH_DOTTED, 0.9),
    Stroke(Ink.GREEN, Dash.SOLID, 0.9),
)


# 99 of 100 normal deviates are smaller.
WHITE = 2.5758


# --- tables ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Reference:
    """What others have published, to stand beside results.

    Attributes:
        source: head of its column.
        note: what has to be known before comparing: another motor, another unit.
        mse: the MSE (5.14) they print, by the name of the model and ``identification`` or ``verification``.
    """

    source: str
    note: str
    mse: Mapping[tuple[str, str], float] = field(default_factory=dict)


def results_table(
    rows: Sequence[Row], reference: Reference | None = None, *, unit: str = "", caption: str = ""
) -> Table:
    """Errors of models, free run and one step ahead (Tables 1 and 2); the best free run on unseen data stands out.

    Several outputs have a line each, in their own units.

    Args:
        rows: in the order in which they are to stand.
        reference: published figures, to stand in a column of their own.
        unit: of the output, where it is the only one.
        caption: of the table; the units are added to it.
    """
    several, outputs = len({row.experiment for row in rows}) > 1, any(row.outputs for row in rows)
    words = ("Experiment",) * several + ("Model", "Method", "Data") + ("Output", "Unit") * outputs
    numbers = ("One-step MSE", "Free-run MSE", "Free-run RMSE", "Free-run fit %", "Parameters")
    cells: list[tuple[str, ...]] = []
    emphasised: set[int] = set()
    best = _best_unseen(rows)
    for k, row in enumerate(rows):
        named = (row.experiment,) * several + (row.model, row.method.upper(), row.data)
        lines: list[tuple[Row | OutputErrors, tuple[str, ...]]] = [
            (each, (each.output, readable_unit(each.unit))) for each in row.outputs
        ]
        for errors, of in lines or [(row, ("", "") * outputs)]:
            emphasised |= {len(cells)} if k in best else set()
            cells.append(
                (
                    *named,
                    *of,
                    number(errors.one_step_mse),
                    number(errors.simulation_mse),
                    number(errors.simulation_rmse),
                    f"{errors.fit_percent:.2f}" if isfinite(errors.fit_percent) else "–",
                    str(row.parameters),
                    *((_published(reference, row),) if reference else ()),
                )
            )
    notes = [
        f"The free run of {row.model} ({row.method.upper()}, {row.data}) left all bounds at sample {row.diverged_at}."
        for row in rows
        if row.diverged_at is not None
    ]
    return Table(
        (*words, *numbers, *((f"{reference.source}: MSE",) if reference else ())),
        tuple(cells),
        f"{caption or 'Errors of the models, free run and one step ahead.'}"
        f"{' MSE in the unit of the output squared, RMSE in that unit.' if outputs else _in_units(unit)}",
        " ".join([*((f"{reference.source}: {reference.note.rstrip('.')}.",) if reference else ()), *notes]),
        text_columns=len(words),
        emphasised=frozenset(emphasised),
    )


def _in_units(unit: str) -> str:
    printed = plain_unit(unit)
    return f" MSE in ({printed})², RMSE in {printed}." if printed else ""


def _published(reference: Reference, row: Row) -> str:
    value = reference.mse.get((row.model, row.data))
    return "" if value is None else number(value)


def _best_unseen(rows: Sequence[Row]) -> frozenset[int]:
    """In every experiment the row with the smallest free-run error on data not used to identify."""
    unseen = [k for k, row in enumerate(rows) if row.data != "identification" and isfinite(row.simulation_mse)]
    groups = groupby(sorted(unseen, key=lambda k: rows[k].experiment), key=lambda k: rows[k].experiment)
    return frozenset(min(group, key=lambda k: rows[k].ranked_by) for _, group in groups)


def parameter_table(
    fit: Fit[Any],
    *,
    level: float = 0.95,
    columns: Mapping[str, Sequence[str]] | None = None,
    caption: str = "",
    note: str = "",
) -> Table:
    """Every parameter with its estimate and confidence interval.

    Args:
        fit: what was found.
        level: of the interval.
        columns: further columns to stand between name and estimate, a text for every parameter: its regressor, its
            unit, what the datasheet says.
        caption, note: of the table; the note is followed by what the fit itself has to say.
    """
    extra = dict(columns or {})
    rows = []
    for k, (name, (low, high)) in enumerate(zip(fit.names, fit.interval(level), strict=True)):
        half = (high - low) / 2
        value = float(fit.estimate[k])
        known = isfinite(half)
        rows.append(
            (
                name,
                *(texts[k] for texts in extra.values()),
                estimate(value, half) if known else "–",
                f"{estimate(low, half)} … {estimate(high, half)}" if known else "not told apart by these data",
                share_of(half, value) if known else "–",
            )
        )
    return Table(
        ("Parameter", *extra, "Estimate", f"{100 * level:g} % interval", "±\u00a0[%]"),
        tuple(rows),
        caption or f"Parameters of {fit.model.name} ({fit.method.upper()}).",
        " ".join(filter(None, (note, sentence(fit.message)))),
        text_columns=1 + len(extra),
    )


def regressor_column(fit: Fit[Any]) -> dict[str, tuple[str, ...]]:
    """For `parameter_table`: the regressor that belongs to every parameter, for a model that has them."""
    structure = getattr(fit.model, "structure", None)
    return {} if structure is None else {"Regressor": structure.labels}


def motor_table(motor: Motor) -> Table:
    """Every physical parameter of a motor with its symbol, value and unit; what the motor has not is left out."""
    rows = []
    for parameter in motor.parameters():
        value: Any = motor
        for part in parameter.name.split("."):
            value = getattr(value, part, None)
        if value is not None:
            pair = value if isinstance(value, tuple) else (value,)
            printed = " / ".join(dict.fromkeys("∞" if each == inf else number(each) for each in pair))
            rows.append((parameter.description, parameter.symbol, readable_unit(parameter.unit), printed))
    return Table(
        ("Parameter", "Symbol", "Unit", "Value"),
        tuple(rows),
        "Parameters of the motor; of a pair the first holds forward, the second backward.",
        text_columns=3,
    )


# --- the plant ------------------------------------------------------------------------------------------------------


def nonlinearities(motor: Motor, *, name: str = "nonlinearities") -> Figure:
    """Dead zones (4.9) and friction torques (4.7) of a motor, as in Figure 4.2; what it has not is left out.

    A motor without any shows that its rotor turns without friction.
    """
    frictions = ((motor.rotor_friction, "rotor"), (motor.load_friction, "load"))
    acting = [(friction, where) for friction, where in frictions if max(friction.breakaway) > 0]
    plots = [
        *(
            _dead_zone(zone, quantity, unit)
            for zone, quantity, unit in (
                (motor.voltage_dead_zone, "voltage", "V"),
                (motor.torque_dead_zone, "torque", "N*m"),
            )
            if zone is not None
        ),
        *(_friction(friction, where) for friction, where in acting),
    ] or [_friction(*frictions[0])]
    return Figure(
        name,
        "Hard nonlinearities of the motor: the dead zone passes nothing between its break points, and friction at rest "
        "takes any value up to break-away.",
        tuple(plots),
        columns=len(plots) if len(plots) < 4 else 2,
    )


def _dead_zone(zone: DeadZone, quantity: str, unit: str) -> Plot:
    reach = 3 * max(-zone.b_l, zone.b_r) or 1.0
    x = np.array([-reach, zone.b_l, zone.b_r, reach])
    return Plot(
        (
            Line(x[[0, -1]], x[[0, -1]], "D(v) = v", Stroke(Ink.GREY, Dash.DASHED, 0.8)),
            Line(x, zone(x), "dead zone (4.9)", MEASURED),
        ),
        Axis(f"Applied {quantity} v", unit),
        Axis(f"Effective {quantity} D(v)", unit),
        f"Dead zone on the {quantity}",
    )


def _friction(friction: Friction, where: str) -> Plot:
    slowest = min((s.stribeck_rate for s in (friction.forward, friction.backward) if s.stribeck > 0), default=0.0)
    reach = 5 / slowest if slowest > 0 else 10.0
    forwards = reach * np.concatenate([[1e-12], np.linspace(0, 1, 200)[1:]])
    w = np.concatenate([-forwards[::-1], forwards])
    factor, unit = prefixed(max(friction.breakaway), "N*m")
    forward, backward = friction.breakaway
    return Plot(
        (
            Line(w, factor * friction.torque(w), "friction (4.7)", MEASURED),
            Points(np.zeros(2), factor * np.array([-backward, forward]), "break-away", Ink.RED),
        ),
        Axis("Speed ω", "rad/s"),
        Axis("Friction torque", unit),
        f"Friction on the {where}",
    )


# --- records --------------------------------------------------------------------------------------------------------


def _output_axis(record: Record, channel: int) -> Axis:
    return Axis(capital(record.output_names[channel]), record.output_units[channel])


def _channels(record: Record) -> range:
    """The outputs, each of which has its own plots."""
    return range(record.output.shape[1])


def inputs(records: Sequence[Record], *, name: str = "inputs") -> Figure:
    """The inputs of several records over time, as in Figures 5.1 and 5.5."""
    plots = []
    names = [record.name for record in records]
    for record in records:
        t, samples = timeline(record)
        title = capital(record.name)
        if names.count(record.name) > 1:
            title += f", {t[0]:.4g} s to {t[-1]:.4g} s"
        for k, channel in enumerate(record.input_names):
            line = Line(t, with_gaps(record.input[:, k], samples), stroke=Stroke(Ink.BLUE, width=0.9), held=True)
            plots.append(Plot((line,), TIME, Axis(capital(channel), record.input_units[k]), title, height=0.8))
    return Figure(name, f"Input of {listed(list(dict.fromkeys(names)))}.", tuple(plots))


def critical_intervals(
    record: Record, width: float, error: ArrayLike | None = None, *, count: int = 2
) -> tuple[slice, ...]:
    """Where a linear model has its hardest time: stretches in which an output turns or rests.

    Candidates are stretches around the samples at which an output crosses zero or leaves rest (2 % of its
    largest value). Those with the largest mean square ``error`` are taken, or, without one, those with most rest; of
    several outputs every error counts relative to how much that output varies.

    Args:
        record: what is looked at.
        width: length of an interval in seconds; shorter only where a whole segment is.
        error: (N,) or (N, ny) a model's error, such as the linear model's free-run residual; NaN counts as none.
        count: how many intervals at most; they do not overlap.

    Returns:
        Slices of the record, in the order of time: ``record[critical_intervals(record, 2.0)[0]]``.
    """
    y = record.output
    scale = np.max(np.abs(y), axis=0)
    scale[scale == 0] = 1.0
    if error is None:
        badness = 1 / (1 + (y / (0.02 * scale)) ** 2)
    else:
        badness = np.asarray(error, float).reshape(len(y), -1) ** 2
        if badness.shape[1] > 1:
            badness = badness / np.where(np.ptp(y, axis=0) > 0, np.var(y, axis=0), 1.0)
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(badness).sum(axis=1))])
    side = np.where(np.abs(y) <= 0.02 * scale, 0, np.sign(y))
    samples = max(2, round(width / record.dt))

    candidates = []
    for start, stop in zip((0, *record.breaks), (*record.breaks, len(record)), strict=True):
        length = min(samples, stop - start)
        turns = start + 1 + np.flatnonzero(np.diff(side[start:stop], axis=0).any(axis=1))
        centres = turns if len(turns) else np.arange(start, stop)
        first = np.unique(np.clip(centres - length // 2, start, stop - length))
        mean = (total[first + length] - total[first]) / length
        candidates += [(float(m), int(a), int(a) + length) for m, a in zip(mean, first, strict=True)]
    chosen: list[slice] = []
    for _, a, b in sorted(candidates, key=lambda each: (-each[0], each[1])):
        if all(b <= other.start or a >= other.stop for other in chosen):
            chosen.append(slice(a, b))
            if len(chosen) == count:
                break
    return tuple(sorted(chosen, key=lambda rows: rows.start))


# --- models ---------------------------------------------------------------------------------------------------------


def labels(assessments: Sequence[Assessment]) -> tuple[str, ...]:
    """What to call them in legends: the model, with the method where one model stands there twice."""
    rows = [each.row for each in assessments]
    models = [row.model for row in rows]
    names = [row.model if models.count(row.model) == 1 else f"{row.model} ({row.method.upper()})" for row in rows]
    return tuple(
        name if names.count(name) == 1 else f"{name}, no. {names[: k + 1].count(name)}" for k, name in enumerate(names)
    )


def responses(assessments: Sequence[Assessment], intervals: Sequence[slice], *, name: str = "responses") -> Figure:
    """Measured outputs and free runs of several models on chosen intervals, as in Figures 5.2, 5.3, 5.6 and 5.7.

    Args:
        assessments: models run over one record, the linear one first: it is drawn in solid red, the next dotted.
        intervals: as `critical_intervals` gives them.
        name: of the figure.
    """
    record = assessments[0].record
    t, samples = timeline(record)
    place = np.flatnonzero(samples >= 0)  # where in the timeline a sample stands
    plots = []
    for rows in intervals:
        x = t[place[rows]]
        for channel in _channels(record):
            runs = [
                Line(x, values[rows, channel], label, stroke) for values, label, stroke in _measured_and(assessments)
            ]
            axis = _within_reach(_output_axis(record, channel), record.output[rows, channel], runs)
            plots.append(Plot(tuple(runs), TIME, axis, f"{x[0]:.4g} s to {x[-1]:.4g} s{_of_output(record, channel)}"))
    fits = [f"{label} {_fits(a)}" for label, a in zip(labels(assessments), assessments, strict=True)]
    return Figure(
        name,
        f"Free runs on {record.name} around critical intervals. Fit over the whole record: {listed(fits)}.",
        tuple(plots),
    )


def _of_output(record: Record, channel: int, before: str = ": ") -> str:
    """What a title says of an output where there are several."""
    return f"{before}{record.output_names[channel]}" if len(_channels(record)) > 1 else ""


def _fits(assessment: Assessment) -> str:
    """The fit of a free run, or of each of its outputs."""
    row = assessment.row
    several = [f"{percent(each.fit_percent)} of {each.output}" for each in row.outputs]
    return listed(several) if several else percent(row.fit_percent)


def _measured_and(assessments: Sequence[Assessment]) -> list[tuple[Array, str, Stroke]]:
    """What was measured and the free run of every model, with label and stroke."""
    runs = zip(assessments, labels(assessments), cycle(MODELS), strict=False)
    return [
        (assessments[0].record.output, "measured", MEASURED),
        *((each.simulation.output, label, stroke) for each, label, stroke in runs),
    ]


def _within_reach(axis: Axis, measured: Array, marks: Sequence[Line]) -> Axis:
    """The axis, limited where a run that has gone astray would press what was measured into a flat line."""
    low, high = float(np.min(measured)), float(np.max(measured))
    room = 1.5 * (high - low or 1.0)
    astray = any(np.nanmax(m.y, initial=low) > high + room or np.nanmin(m.y, initial=high) < low - room for m in marks)
    return Axis(axis.quantity, axis.unit, range=(low - room, high + room)) if astray else axis


def measured_and_simulated(assessment: Assessment, *, name: str = "free-run") -> Figure:
    """A whole record with the free run of one model, and what is left between them below, output by output."""
    record, row = assessment.record, assessment.row
    t, samples = timeline(record)
    plots, errors = [], []
    for channel in _channels(record):
        axis = _output_axis(record, channel)
        measured = with_gaps(record.output[:, channel], samples)
        simulated = with_gaps(assessment.simulation.output[:, channel], samples)
        lines = (
            Line(t, measured, "measured", MEASURED),
            Line(t, simulated, f"{row.model}, free run", Stroke(Ink.RED, width=0.9)),
        )
        residual = Line(t, measured - simulated, stroke=Stroke(Ink.BLACK, width=0.7))
        plots += [
            Plot(lines, TIME, _within_reach(axis, record.output[:, channel], lines), height=1.2),
            Plot((residual,), TIME, Axis("Residual", axis.unit), height=0.7),
        ]
        of: Row | OutputErrors = row.outputs[channel] if row.outputs else row
        rmse = f"RMSE {number(of.simulation_rmse)} {plain_unit(axis.unit)}".rstrip()
        errors.append(f"{_of_output(record, channel, '')} fit {percent(of.fit_percent)}, {rmse}".lstrip())
    return Figure(
        name,
        f"{capital(record.name)}: measured and simulated by {row.model} ({row.method.upper()}), {'; '.join(errors)}.",
        tuple(plots),
        shared_x=True,
    )


def residuals(assessments: Sequence[Assessment], *, name: str = "residuals", lags: int | None = None) -> Figure:
    """Free-run residuals of several models, output by output: over time, as a histogram, and what they correlate with.

    Of white noise, 99 of 100 autocorrelations lie between the dashed lines, ±2.58/√N. A free run of a good model need
    not be white, since noise in a measured output is not white after the model either; structure shows what is missing.
    It should have nothing to do with the input, though: the cross-correlation with every input is shown in standard
    deviations of that of signals which are as coloured and know nothing of each other, see `_cross_correlation`.

    Args:
        assessments: models run over one record.
        name: of the figure.
        lags: largest lag of the correlations in samples; by default a second, but 20 to 400 samples.
    """
    record = assessments[0].record
    most = int(np.clip(round(1 / record.dt), 20, 400)) if lags is None else lags
    plots = [plot for channel in _channels(record) for plot in _residual_plots(assessments, channel, most)]
    note = (
        " Correlation with inputs later than the residual (negative lags) shows feedback, with earlier ones what the "
    )
    crossed = any("correlation with" in plot.title for plot in plots)
    return Figure(
        name,
        f"Residuals of the free run on {record.name}.{f'{note}model has missed.' if crossed else ''}",
        tuple(plots),
        columns=2,
    )


def _residual_plots(assessments: Sequence[Assessment], channel: int, most: int) -> list[Plot]:
    record = assessments[0].record
    unit, whose = record.output_units[channel], _of_output(record, channel)
    t, samples = timeline(record)
    over_time: list[Mark] = []
    shares: list[Mark] = []
    correlations: list[Mark] = []
    crossed: list[list[Mark]] = [[] for _ in record.input_names]
    counted = [each.simulation.counted for each in assessments]
    errors = [
        np.where(c, (record.output - each.simulation.output)[:, channel], np.nan)
        for each, c in zip(assessments, counted, strict=True)
    ]
    edges = _histogram_edges(errors)
    for label, stroke, error in zip(labels(assessments), cycle(MODELS), errors, strict=False):
        thinner = Stroke(stroke.ink, Dash.SOLID, 0.8)
        over_time.append(Line(t, with_gaps(error, samples), label, thinner))
        known = error[np.isfinite(error)]
        if not len(known):
            continue
        share = 100 * np.histogram(np.clip(known, edges[0], edges[-1]), edges)[0] / len(known)
        shares.append(Histogram(edges, share, stroke=thinner))
        broken = Stroke(stroke.ink, stroke.dash)
        correlation = _autocorrelation(error, record.breaks, most)
        correlations.append(Line(record.dt * np.arange(len(correlation), dtype=np.float64), correlation, stroke=broken))
        for marks, u in zip(crossed, record.input.T, strict=True):
            with_input = _cross_correlation(error, u, record.breaks, most)
            lag = record.dt * np.arange(-(len(with_input) // 2), len(with_input) // 2 + 1, dtype=np.float64)
            if with_input.any():
                marks.append(Line(lag, with_input, stroke=broken))
    band = WHITE / sqrt(max(int(np.count_nonzero(counted[0])), 1))
    correlations += [Level(band, "99 % of white noise"), Level(-band)]
    title = f"Residual{whose}" if whose else ""
    plots = [Plot(tuple(over_time), TIME, Axis("Residual", unit), title, span=2)]
    if shares:
        rarest = 100 / max(int(np.count_nonzero(each)) for each in counted)
        share_axis = Axis("Share of samples", "%", log=True, range=(0.7 * rarest, 130.0))
        plots += [
            Plot(tuple(shares), Axis("Residual", unit), share_axis, f"Distribution{whose}"),
            Plot(tuple(correlations), Axis("Lag", "s"), Axis("Autocorrelation", "1"), f"Autocorrelation{whose}"),
        ]
    drawn = [(name, marks) for name, marks in zip(record.input_names, crossed, strict=True) if marks]
    for k, (name, marks) in enumerate(drawn):
        plots.append(
            Plot(
                (*marks, Level(WHITE, "99 % if independent"), Level(-WHITE)),
                Axis("Lag", "s"),
                Axis("In standard deviations", "1"),
                f"Cross-correlation with {name}{whose}",
                height=0.8,
                span=2 if k % 2 == 0 and k == len(drawn) - 1 else 1,  # the last one, alone in its row
            )
        )
    return plots


def _histogram_edges(errors: Sequence[Array], bins: int = 61) -> Array:
    """Common edges, symmetric about zero, that hold all but the most extreme of all residuals."""
    known = np.abs(np.concatenate(errors))
    known = known[np.isfinite(known)]
    reach = float(np.quantile(known, 0.999)) if len(known) else 1.0
    return np.linspace(-reach or -1.0, reach or 1.0, bins + 1)


def _autocorrelation(error: Array, breaks: Sequence[int], lags: int) -> Array:
    """(≤ lags + 1,) autocorrelation about zero mean, of pairs that lie in one segment and are both known."""
    mean = float(np.nanmean(error))
    products, longest = np.zeros(lags + 1), 0
    for piece in np.split(error, list(breaks)):
        centred = np.nan_to_num(piece - mean)
        most = min(lags, len(centred) - 1)
        size = 1 << ceil(log10(2 * len(centred)) / log10(2))
        power = np.abs(np.fft.rfft(centred, size)) ** 2
        products[: most + 1] += np.fft.irfft(power, size)[: most + 1]
        longest = max(longest, most)
    return products[: longest + 1] / (products[0] or 1.0)


def _cross_correlation(error: Array, u: Array, breaks: Sequence[int], lags: int) -> Array:
    """(≤ 2·lags + 1,) correlation of the error with the input τ samples earlier, τ = −lags … lags, by its spread.

    Of independent signals the sum of N products has the variance N·Σ R_e(k)·R_u(k), in autocovariances (Ljung, *System
    Identification*, eq. 16.68), taken here under a triangular window. Zero throughout where either signal is.
    """
    known = np.isfinite(error)
    e = np.where(known, error - float(np.mean(error[known])), 0.0) if known.any() else np.zeros(len(error))
    v = u - float(np.mean(u[known])) if known.any() else np.zeros(len(u))
    longest = min(lags, max(map(len, np.split(e, list(breaks)))) - 1)
    crossed, own_e, own_v = np.zeros(2 * longest + 1), np.zeros(longest + 1), np.zeros(longest + 1)
    for piece, driven in zip(np.split(e, list(breaks)), np.split(v, list(breaks)), strict=True):
        size = 1 << ceil(log10(2 * len(piece)) / log10(2))
        fe, fv = np.fft.rfft(piece, size), np.fft.rfft(driven, size)
        most = min(longest, len(piece) - 1)
        for total, power in ((own_e, np.abs(fe) ** 2), (own_v, np.abs(fv) ** 2)):
            total[: most + 1] += np.fft.irfft(power, size)[: most + 1]
        products = np.fft.irfft(fe * np.conj(fv), size)
        crossed[longest : longest + most + 1] += products[: most + 1]
        crossed[longest - most : longest] += products[size - most :]
    weights = (2.0 - (np.arange(longest + 1) == 0)) * (1 - np.arange(longest + 1) / (longest + 1))
    spread = sqrt(max(float(np.sum(weights * own_e * own_v)) / max(int(np.count_nonzero(known)), 1), 0.0))
    return crossed / spread if spread > 0 and np.isfinite(crossed / spread).all() else np.zeros(2 * longest + 1)


def convergence(fit: Fit[Any], batch: Fit[Any] | None = None, *, name: str = "convergence", at_most: int = 8) -> Figure:
    """Recursive estimates from the first sample to the last, and the batch estimates they should end at, dashed.

    Parameters whose names begin alike share a plot, which shows the range of their later values.

    Args:
        fit: with its ``history``.
        batch: the same structure by batch least squares.
        name: of the figure.
        at_most: how many parameters a plot shows; further ones of the same group are left out and counted.
    """
    if fit.history is None or not len(fit.history):
        raise DataError(f"{fit.model.name}: the estimates on the way were not kept; ask for the history when fitting")
    steps = len(fit.history)
    shown = np.unique(np.geomspace(1, steps, min(steps, 1500)).round().astype(int)) - 1
    groups: dict[str, list[int]] = {}
    for k, parameter in enumerate(fit.names):
        groups.setdefault(parameter.rstrip("0123456789_"), []).append(k)
    plots = []
    for row, members in enumerate(groups.values()):
        drawn = members[:at_most]
        marks: list[Mark] = []
        for k, ink in zip(drawn, cycle(_INKS), strict=False):
            label = fit.names[k] if len(members) > 1 else ""
            marks.append(Line(shown + 1.0, fit.history[shown, k], label, Stroke(ink)))
            if batch is not None:
                marks.append(Level(float(batch.estimate[k]), stroke=Stroke(ink, Dash.DASHED, 0.8)))
        left_out = f" (and {len(members) - len(drawn)} more)" if len(members) > len(drawn) else ""
        first, last = fit.names[members[0]], fit.names[members[-1]]
        plots.append(
            Plot(
                tuple(marks),
                Axis("Sample", "1", log=True),
                Axis("Estimate", "SI", range=_settled_range(fit.history[:, drawn], batch, drawn)),
                first if len(members) == 1 else f"{first} … {last}{left_out}",
                span=2 if row % 2 == 0 and row == len(groups) - 1 > 0 else 1,  # the last one, alone in its row
            )
        )
    dashed = "; dashed: batch least squares" if batch is not None else ""
    return Figure(
        name,
        f"Recursive estimates of {fit.model.name} over the samples seen{dashed}. Each is in the unit of the output by "
        "that of its regressor.",
        tuple(plots),
        columns=min(len(plots), 2),
        shared_x=True,
    )


_INKS = (Ink.BLUE, Ink.RED, Ink.GREEN, Ink.ORANGE, Ink.PURPLE, Ink.NAVY, Ink.GREY, Ink.BLACK)


def _settled_range(history: Array, batch: Fit[Any] | None, members: Sequence[int]) -> tuple[float, float]:
    """The range of the last nine tenths of the estimates, outliers aside, with the batch values and some room."""
    late = history[len(history) // 10 :]
    values = np.concatenate([np.quantile(late, (0.005, 0.995), axis=0).ravel(), history[-1]])
    if batch is not None:
        values = np.concatenate([values, batch.estimate[list(members)]])
    low, high = float(values.min()), float(values.max())
    room = 0.25 * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room


def ranking(comparison: Comparison, *, name: str = "ranking") -> Figure:
    """Models by their free-run error, the best at the top, with the error one step ahead as a point, for every output.

    An axis is logarithmic where the errors differ by more than a factor of twenty.
    """
    rows = comparison.rows
    record = comparison.best.record
    several = len(_channels(record)) > 1
    relative = ", several outputs by the mean of their errors relative to how much each varies" * several
    return Figure(
        name,
        f"Errors on {record.name}, {rows[0].data} data. Models are ranked by the free run{relative}; one step ahead "
        "almost any model looks good.",
        tuple(_ranking_plot(comparison, channel) for channel in _channels(record)),
    )


def _ranking_plot(comparison: Comparison, channel: int) -> Plot:
    record = comparison.best.record
    rows = [row.outputs[channel] if row.outputs else row for row in comparison.rows]
    values = np.array([row.simulation_rmse for row in rows])
    one_step = np.sqrt([row.one_step_mse for row in rows])
    drawable = np.concatenate([values, one_step])
    drawable = drawable[np.isfinite(drawable) & (drawable > 0)]
    log = len(drawable) > 0 and bool(drawable.max() > 20 * drawable.min())
    remarks = tuple(
        f"{number(row.simulation_rmse)}  (fit {percent(row.fit_percent)})"
        if whole.diverged_at is None
        else f"diverged at sample {whole.diverged_at}"
        for row, whole in zip(rows, comparison.rows, strict=True)
    )
    return Plot(
        (
            Bars(values, remarks, "free run", Ink.BLUE),
            Points(one_step, np.arange(len(rows), dtype=float), "one step ahead", Ink.RED),
        ),
        Axis(
            f"RMSE{_of_output(record, channel, ' of ')}",
            record.output_units[channel],
            log=log,
            range=_bar_range(drawable, log),
        ),
        Axis("Model", names=labels(comparison.assessments)),
        capital(_of_output(record, channel, "")),
        height=0.17 + 0.19 * len(rows),
    )


def _bar_range(values: Array, log: bool) -> tuple[float, float]:
    """From the root of the bars to a little beyond their ends."""
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    return (10.0 ** floor(log10(low) - 0.05), 1.5 * high) if log else (0.0, 1.05 * high)


def model_section(fit: Fit[Any], record: Record, *, name: str = "", profiles: Sequence[Profile] = ()) -> Section:
    """All there is to show of one model: its equation, its parameters, and what only a model of its kind has.

    A cascade shows its static maps and filters, a physical model its friction, its dead zone and where it sticks. What
    cannot be drawn is left out.

    Args:
        fit: of any model.
        record: in which the signals between the blocks of a cascade are shown.
        name: what its figures' names begin with, by default the model's name; to be given where a report shows two
            models of one name.
        profiles: likelihood profiles of its parameters, where it is a physical model.
    """
    from emsid.models.cascade import Cascade
    from emsid.models.grey_box_fit import GreyBoxFit
    from emsid.report.cascade_views import block_column, cascade_equations, frequency_responses, static_maps
    from emsid.report.grey_box_views import (
        dead_zone,
        friction,
        likelihood,
        physical_table,
        plant_equations,
        sticking,
        units_taken,
    )

    model, prefix = fit.model, slug(name or fit.model.name)
    paragraphs: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    if isinstance(fit, GreyBoxFit):
        equations, tables = plant_equations(fit), physical_table(fit)
        paragraphs = tuple(filter(None, (sentence(fit.ended), units_taken(fit))))
        remarks = tuple(map(sentence, fit.words))
        drawings: list[Callable[[], Figure | None]] = [
            lambda: sticking(fit, name=f"{prefix}-sticking"),
            lambda: friction(fit, name=f"{prefix}-friction"),
            lambda: dead_zone(fit, name=f"{prefix}-dead-zone"),
            *(partial(likelihood, fit, each, name=f"{prefix}-profile-{slug(each.name)}") for each in profiles),
        ]
    elif isinstance(model, Cascade):
        equations = (cascade_equations(model),)
        tables = (parameter_table(fit, columns=block_column(fit)),)
        drawings = [
            lambda: static_maps(fit, record, name=f"{prefix}-static-maps"),
            lambda: frequency_responses(fit, record.dt, name=f"{prefix}-filters"),
        ]
    else:
        equations, drawings = (model.equation(),), []
        tables = (parameter_table(fit, columns=regressor_column(fit)),)
    return Section(name or model.name, paragraphs, equations, tables, _drawable(drawings), remarks)


def _drawable(drawings: Sequence[Callable[[], Figure | None]]) -> tuple[Figure, ...]:
    """The figures that can be had."""
    figures = []
    for drawing in drawings:
        with suppress(EmsidError):
            figures.append(drawing())
    return tuple(figure for figure in figures if figure is not None)
