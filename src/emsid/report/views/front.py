"""The table of models, accuracy against number of parameters, and errors by operating region and by record.

Tables: the errors of models, their parameters, and those of a motor.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from emsid.identification.ranking import FrontRow
from emsid.report.document import Axis, Figure, Ink, Line, Plot, Points, Stroke, Table
from emsid.report.numbers import estimate, first_up, number, share_of
from emsid.report.views.conventions import channel_axis
from emsid.units import in_unit, plain_unit, readable_unit
from emsid.validation.comparison import REGIONS, RecordError, RegionError
from emsid.wording.verdict import IN_SHORT

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.identification.result import Identification
    from emsid.plant import Motor
    from emsid.validation.comparison import OutputErrors, Row


Array = NDArray[np.float64]
WIDE = 6.0
"""The least ratio of the ends of the axis of errors."""
COVERED = 0.06
"""Points that are closer than this share of the axis of errors have one label."""
COLUMNS = 6
"""At most this many records have a column each in the table of errors by record; more have a row each."""
CORRELATED = 10
"""At most this many parameters have a column each in the table of correlations, which fits into a printed page."""
GREY = Stroke(Ink.GREY, width=1.0)


CV = (
    "CV error: RMSE of the free run over {} parts of the data, each left out of a fit in turn, in % of the deviation "
    "of the output, with one standard error either way."
)


def models_table(result: Identification) -> Table:
    """Every model with its errors, its number of parameters and the verdict on it, the best first.

    With several outputs, each has a line. The numbers are those of `front_figure`.
    """
    several = any(row.outputs for row in result.rows)
    axis = channel_axis(result.unseen.output_names[0], result.unseen.output_units[0])
    unit = f" [{plain_unit(axis.unit)}]" if plain_unit(axis.unit) and not several else ""
    others = {"choice": result.on_choice, "used in fit": None if result.seen else result.on_record}
    on = {name: {row.model: row for row in each.rows} for name, each in others.items() if each is not None}
    folds = result.front[0].folds if result.front else 0
    lines: list[tuple[str, ...]] = []
    bold: set[int] = set()
    for row in result.rows:
        start, shared = _about(result, row.model, with_folds=folds > 1)
        outputs: Sequence[Row | OutputErrors] = row.outputs or (row,)
        for k, errors in enumerate(outputs):
            bold |= {len(lines)} if row.model == result.chosen.model.name else set()
            output = (in_unit(row.outputs[k].output, row.outputs[k].unit),) if several else ()
            fits = (_fit(errors), *(_fit(_of(rows.get(row.model), k)) for rows in on.values()))
            rmse = (number(errors.simulation_rmse), number(float(np.sqrt(errors.one_step_mse))))
            lines.append((row.model, *output, start, str(row.parameters), *fits, *shared[:-1], *rmse, shared[-1]))
    fitted = (f"Fit % {'data of the fit' if result.seen else 'unseen'}", *(f"Fit % {name}" for name in on))
    errors_heads = (*("CV error %",) * (folds > 1), f"RMSE{unit}", f"One-step RMSE{unit}")
    diverged = [
        f"The free run of {row.model} diverged at sample {row.diverged_at}."
        for row in result.rows
        if row.diverged_at is not None
    ]
    bold_is = "recommended" if result.is_recommended else "best"
    return Table(
        ("Model", *("Output",) * several, "No.", "Parameters", *fitted, *errors_heads, "Verdict"),
        tuple(lines),
        f"On {result.ranked_on}, {result.unseen.name}, by their errors, implausible ones last; the {bold_is} model is "
        "in bold. A click on a heading sorts the rows.",
        " ".join(["No.: in the figure of error over parameters.", *[CV.format(folds)] * (folds > 1), *diverged]),
        text_columns=1 + several,
        ends_in_text=True,
        emphasised=frozenset(bold),
    )


def _about(result: Identification, model: str, *, with_folds: bool) -> tuple[str, tuple[str, ...]]:
    """The number of a model in the figure; its error over the folds, if there are several, and the verdict on it."""
    numbered = {each.model: (str(k), cv_error(each)) for k, each in enumerate(result.front, 1)}
    place, error = numbered.get(model, ("–", "–"))
    (verdict,) = [IN_SHORT[each.code] for each in result.model_verdicts if each.model == model] or ["–"]
    preferred = result.is_recommended and model == result.chosen.model.name
    return place, (*((error,) if with_folds else ()), f"{'recommended; ' * preferred}{verdict}")


def _of(row: Row | None, output: int) -> Row | OutputErrors | None:
    """The errors of an output, or of the only one."""
    return row.outputs[output] if row is not None and row.outputs else row


def _fit(errors: Row | OutputErrors | None) -> str:
    return f"{errors.fit_percent:.2f}" if errors is not None and np.isfinite(errors.fit_percent) else "–"


def cv_error(row: FrontRow) -> str:
    """The error over all parts left out with one standard error either way, in percent."""
    if not np.isfinite(row.error):
        return "diverges"
    spread = f" ({number(100 * row.low)} to {number(100 * row.high)})" if np.isfinite(row.low) else ""
    return f"{number(100 * row.error)}{spread}"


def front_figure(rows: Sequence[FrontRow]) -> Figure | None:
    """The errors over the numbers of parameters, with one standard error; None without two models that can be drawn."""
    known = [(str(k), each) for k, each in enumerate(rows, 1) if np.isfinite(each.error) and each.error > 0]
    if len(known) < 2:
        return None
    bars = [
        Line(np.full(2, float(each.parameters)), 100 * np.array([max(each.low, 0.1 * each.error), each.high]), "", GREY)
        for _, each in known
        if np.isfinite(each.low)
    ]
    front = [each for _, each in known if each.on_front]
    steps = Line(_sizes(front), 100 * _errors(front), "front", Stroke(Ink.NAVY, width=1.0), stairs=True)
    recommended = [each for each in known if each[1].recommended]
    others = [each for each in known if not each[1].recommended]
    groups = ("other models" if recommended else "models", Ink.BLUE, others), ("recommended", Ink.RED, recommended)
    shown = _labels(known)
    points = [
        Points(_sizes(_rows(some)), 100 * _errors(_rows(some)), label, ink, tuple(shown[name] for name, _ in some))
        for label, ink, some in groups
        if some
    ]
    largest = max(each.parameters for _, each in known)
    return Figure(
        "front",
        "Error of the free run over the number of parameters, one standard error either way; the numbers are those of "
        "the table of models.",
        (
            Plot(
                (*bars, *([steps] if len(front) > 1 else []), *points),
                Axis("Parameters", "1", range=(0.0, 1.08 * largest + 1)),
                Axis("RMSE over the output's deviation", "%", log=True, range=_range(100 * _errors(_rows(known)))),
            ),
        ),
    )


def _labels(known: Sequence[tuple[str, FrontRow]]) -> dict[str, str]:
    """The label of every point; points that cover each other have one label, at the first of them."""
    low, high = _range(_errors(_rows(known)))
    shown: dict[str, str] = {}
    first: dict[str, FrontRow] = {}
    for name, row in known:
        covers = (
            each
            for each, other in first.items()
            if other.parameters == row.parameters
            and abs(np.log(other.error / row.error)) < COVERED * np.log(high / low)
        )
        at = next(covers, "")
        shown[name] = "" if at else name
        if at:
            shown[at] += f", {name}"
        else:
            first[name] = row
    return shown


def _rows(some: Iterable[tuple[str, FrontRow]]) -> list[FrontRow]:
    """The rows without their names."""
    return [each for _, each in some]


def _range(values: Array) -> tuple[float, float]:
    """Of a logarithmic axis: a part of a decade at least, so that it has several ticks."""
    low, high = float(values.min()), float(values.max())
    room = max(np.log10(WIDE) - np.log10(high / low), 0.3) / 2
    return low / 10**room, high * 10**room


def _sizes(rows: Sequence[FrontRow]) -> Array:
    return np.array([float(each.parameters) for each in rows])


def _errors(rows: Sequence[FrontRow]) -> Array:
    return np.array([each.error for each in rows])


def region_tables(errors: Sequence[RegionError], where: str) -> tuple[Table, ...]:
    """The RMSE of every model in every operating region, a table for every output."""
    return tuple(_region_table([e for e in errors if e.output == output], where) for output in _named(errors))


def _named(errors: Sequence[RegionError]) -> list[str]:
    return list(dict.fromkeys(each.output for each in errors))


def _region_table(errors: Sequence[RegionError], where: str) -> Table:
    regions = [region for region in REGIONS if any(each.region == region for each in errors)]
    found = {(each.model, each.region): each for each in errors}
    models = list(dict.fromkeys(each.model for each in errors))
    counts = {each.region: each.samples for each in errors}
    return Table(
        ("Model", *(first_up(region) for region in regions)),
        (
            *((model, *(number(found[model, region].rmse) for region in regions)) for model in models),
            ("samples", *(f"{counts[region]:,}" for region in regions)),
        ),
        f"RMSE of the free run by operating region of {in_unit(errors[0].output, errors[0].unit)}, {where}.",
        "With v the 99 % quantile of |y|: standstill up to 5 % of v, low speed up to 30 %, high speed above. A "
        "reversal is what lies between high speed in one direction and in the other.",
    )


def record_table(errors: Sequence[RecordError]) -> Table:
    """The RMSE of every model on every record and output."""
    models = list(dict.fromkeys(each.model for each in errors))
    several = len({each.output for each in errors}) > 1
    names = {(e.record, e.output): f"{e.record}, {e.output}" if several else e.record for e in errors}
    cells = {(names[e.record, e.output], e.model): number(e.rmse) for e in errors}
    records, caption = list(dict.fromkeys(names.values())), "RMSE of the free run by record, over the whole of each."
    if len(records) <= COLUMNS:
        rows = tuple((model, *(cells[record, model] for record in records)) for model in models)
        return Table(("Model", *records), rows, caption)
    return Table(("Record", *models), tuple((r, *(cells[r, model] for model in models)) for r in records), caption)


FROM_FILE = "file"
"""The method of a model that was read from a file."""


def results_table(
    rows: Sequence[Row],
    *,
    unit: str = "",
    caption: str = "",
) -> Table:
    """Free-run and one-step errors of models (Tables 1 and 2).

    Each output has a line, in its own unit. Where all models were read from files, which have neither a method nor
    estimated parameters, the table has no columns for these.

    Args:
        rows: in the order of the table.
        unit: of the output, where it is the only one.
        caption: of the table; the units are added to it.
    """
    several, outputs = len({row.experiment for row in rows}) > 1, any(row.outputs for row in rows)
    fitted = any(row.method != FROM_FILE for row in rows)
    words = (*("Experiment",) * several, "Model", *("Fitted",) * fitted, "Data", *("Output", "Unit") * outputs)
    numbers = ("Free-run fit %", "Free-run RMSE", "Free-run MSE", "One-step MSE", *("Parameters",) * fitted)
    cells: list[tuple[str, ...]] = []
    bold: set[int] = set()
    best = _best_unseen(rows)
    for k, row in enumerate(rows):
        named = (*(row.experiment,) * several, row.model, *(row.fitted,) * fitted, row.data_label)
        lines: list[tuple[Row | OutputErrors, tuple[str, ...]]] = [
            (each, (each.output, readable_unit(each.unit))) for each in row.outputs
        ]
        for errors, of in lines or [(row, ("", "") * outputs)]:
            bold |= {len(cells)} if k in best else set()
            cells.append(
                (
                    *named,
                    *of,
                    f"{errors.fit_percent:.2f}" if isfinite(errors.fit_percent) else "–",
                    number(errors.simulation_rmse),
                    number(errors.simulation_mse),
                    number(errors.one_step_mse),
                    *(str(row.parameters) if row.parameters else "–",) * fitted,
                )
            )
    notes = [
        f"The free run of {row.model} ({row.fitted}, {row.data_label}) diverged at sample {row.diverged_at}."
        for row in rows
        if row.diverged_at is not None
    ]
    return Table(
        (*words, *numbers),
        tuple(cells),
        f"{caption or 'Errors of the models, free run and one step ahead.'}"
        f"{' MSE in the unit of the output squared, RMSE in that unit.' if outputs else _in_units(unit)}",
        " ".join(notes),
        text_columns=len(words),
        emphasised=frozenset(bold),
    )


def _in_units(unit: str) -> str:
    printed = plain_unit(unit)
    squared = f"{printed}²" if printed.isalpha() else f"({printed})²"
    return f" MSE in {squared}, RMSE in {printed}." if printed else ""


def _best_unseen(rows: Sequence[Row]) -> frozenset[int]:
    """The row with the smallest free-run error on unseen data, in every experiment."""
    unseen = [k for k, row in enumerate(rows) if row.data != "identification" and isfinite(row.simulation_mse)]
    groups = groupby(sorted(unseen, key=lambda k: rows[k].experiment), key=lambda k: rows[k].experiment)
    return frozenset(min(group, key=lambda k: rows[k].ranked_by) for _, group in groups)


def parameter_table(
    fit: Fit[Any],
    *,
    columns: Mapping[str, Sequence[str]] | None = None,
) -> Table:
    """Every parameter with its estimate and confidence interval; without one where the estimate is biased.

    Args:
        fit: what was found.
        columns: further columns between name and estimate, a text for every parameter: its regressor, its unit, its
            datasheet value.
    """
    extra = dict(columns or {})
    rows = []
    for k, (name, (low, high)) in enumerate(zip(fit.names, fit.interval(), strict=True)):
        half = (high - low) / 2
        value = float(fit.estimate[k])
        known = isfinite(half) and not fit.biased
        missing = f"none: {fit.status}" if fit.biased else "not determined by these data"
        rows.append(
            (
                name,
                *(texts[k] for texts in extra.values()),
                estimate(value, half) if known else number(value) if fit.biased else "–",
                f"{estimate(low, half)} … {estimate(high, half)}" if known else missing,
                share_of(half, value) if known else "–",
            )
        )
    return Table(
        ("Parameter", *extra, "Estimate", "95 % interval", "±\u00a0[%]"),
        tuple(rows),
        f"Parameters of {fit.model.name} ({fit.fitted}).",
        text_columns=1 + len(extra),
    )


def correlation_table(fit: Fit[Any]) -> Table | None:
    """The correlations of the estimates, of the parameters with the largest ones; None for a single one, or without.

    Two parameters whose correlation is near ±1 are known only together: one changes with the other at the same error.
    """
    spread = fit.standard_error
    known = np.flatnonzero(np.isfinite(spread) & (spread > 0))
    if len(known) < 2 or not fit.has_intervals:
        return None
    found = np.round(fit.covariance[np.ix_(known, known)] / np.outer(spread[known], spread[known]), 2) + 0.0
    strongest = np.max(np.abs(found - np.eye(len(known))), axis=1)
    shown = np.sort(np.argsort(-strongest, kind="stable")[:CORRELATED])
    rows = tuple(
        (f"[{k}]", fit.names[known[i]], *(f"{found[i, j]:.2f}" if j < i else "" for j in shown[:-1]))
        for k, i in enumerate(shown, 1)
    )
    most = f", of the {CORRELATED} parameters with the largest" if len(known) > CORRELATED else ""
    header = ("No.", "Parameter", *(f"[{k}]" for k in range(1, len(shown))))
    caption = f"Correlations of the estimates of {fit.model.name}{most}; those near ±1 are known only together."
    return Table(header, rows, caption, text_columns=2)


def regressor_column(fit: Fit[Any]) -> dict[str, tuple[str, ...]]:
    """A column of `parameter_table`: the regressor of every parameter, where it has another name."""
    structure = getattr(fit.model, "structure", None)
    return {} if structure is None or structure.labels == tuple(fit.names) else {"Regressor": structure.labels}


def motor_table(motor: Motor) -> Table:
    """Every physical parameter of a motor with its symbol, value and unit, as far as the motor has it."""
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
        "Parameters of the motor; a pair is forward / backward.",
        text_columns=3,
    )
