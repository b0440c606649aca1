"""Tables: the errors of models, their parameters, and those of a motor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from emsid.report.document import Table
from emsid.report.numbers import estimate, number, share_of
from emsid.units import plain_unit, readable_unit

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.plant import Motor
    from emsid.validation.comparison import OutputErrors, Row


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
    words = (*("Experiment",) * several, "Model", *("Method",) * fitted, "Data", *("Output", "Unit") * outputs)
    numbers = ("Free-run fit %", "Free-run RMSE", "Free-run MSE", "One-step MSE", *("Parameters",) * fitted)
    cells: list[tuple[str, ...]] = []
    bold: set[int] = set()
    best = _best_unseen(rows)
    for k, row in enumerate(rows):
        named = (*(row.experiment,) * several, row.model, *(row.method.upper(),) * fitted, row.data_label)
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
        f"The free run of {row.model} ({row.method.upper()}, {row.data_label}) diverged at sample {row.diverged_at}."
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
        f"Parameters of {fit.model.name} ({fit.method.upper()}).",
        text_columns=1 + len(extra),
    )


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
