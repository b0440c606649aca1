"""Tables of the parameters of a physical model, its equations, and what is missing in its record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from emsid.errors import listed
from emsid.estimation.estimates import INCLUDES_ZERO
from emsid.estimation.uncertainty.intervals import HALF_WIDTH
from emsid.models.plants.search.result import Status
from emsid.report.document import Table
from emsid.report.numbers import both_directions, capital, first_up, number, sentence, share_of, within
from emsid.units import in_unit, readable_unit
from emsid.wording.lists import NOT_SHOWN

if TYPE_CHECKING:
    from emsid.models.plants.search.result import Estimate, GreyBoxFit

_MEANINGS = {
    Status.CONDITIONAL: "given …: correct only if these values are correct, because the data determine only "
    "combinations with them; the interval does not include their uncertainty",
    Status.ASSUMING: "assuming …: nobody gave or measured these values, and the estimate scales with them",
    Status.KEPT: "not identifiable: the data do not determine this parameter, so it was kept at its start value",
    Status.FIXED: "fixed: given by the user and not estimated",
    Status.BUILT_IN: "built in: neither estimated nor given",
    Status.OF_PLANT: "of the plant given: not estimated",
    Status.CHOSEN: "chosen by the search among a few values",
    Status.AT_BOUND: "at a bound: the search ended at a limit of the parameter; its interval, if any, is that of the "
    "likelihood profile",
}
_TOO_WIDE_MEANS = f"{INCLUDES_ZERO}: the parameter may be zero"


def physical_table(fit: GreyBoxFit) -> tuple[Table, ...]:
    """Every physical parameter with its unit, interval and datasheet value; then the identifiable combinations.

    Args:
        fit: of a physical model.

    Returns:
        The table of parameters, one of those that differ by record and one of combinations, where there are any.
    """
    sheet = any(row.datasheet is not None for row in fit.table)
    cells = [_parameter_row(row, sheet) for row in fit.shared]
    statuses = dict.fromkeys(row.status for row in fit.table)
    meanings = [_MEANINGS[status] for status in statuses if status in _MEANINGS]
    meanings += [_TOO_WIDE_MEANS] * any(row.may_be_zero for row in fit.shared)
    parameters = Table(
        (
            "Parameter",
            "Meaning",
            "Symbol",
            "Unit",
            "Status",
            "Estimate",
            "±\u00a0[%]",
            *(("Datasheet",) if sheet else ()),
        ),
        tuple(cells),
        f"Physical parameters of {fit.model.name} with 95 % intervals.",
        sentence("; ".join(meanings)),
        text_columns=5,
    )
    tables = (parameters, *([own_parameters(fit)] if fit.by_record else []))
    if not fit.combinations:
        return tables
    combinations = Table(
        ("Quantity", "Formula", "Unit", "Estimate", "±\u00a0[%]"),
        tuple(
            both_directions(
                (
                    capital(each.quantity.name) if " " not in each.quantity.name else first_up(each.quantity.name),
                    each.quantity.formula,
                    readable_unit(each.quantity.unit),
                    *(
                        _with_interval(each.quantity.value, HALF_WIDTH * each.standard_error)
                        if fit.shows(each.quantity)
                        else (NOT_SHOWN, "")
                    ),
                )
                for each in fit.combinations
            )
        ),
        f"Combinations of parameters of {fit.model.name} that the data determine without the kept values, with "
        f"95 % intervals.",
        text_columns=3,
    )
    return (*tables, combinations)


def own_parameters(fit: GreyBoxFit) -> Table:
    """The parameters that differ by record, a row for every record.

    Args:
        fit: of a physical model with such parameters.
    """
    first = next(iter(fit.by_record.values()))
    heads = [cell for name, row in first.items() for cell in (in_unit(name, row.unit), "±\u00a0[%]", "Status")]
    return Table(
        ("Record", *heads),
        tuple(
            (record, *(cell for row in rows.values() for cell in (*_value(row), row.how)))
            for record, rows in fit.by_record.items()
        ),
        f"Parameters of {fit.model.name} that differ by record, with 95 % intervals.",
        text_columns=1,
    )


def plant_equations(fit: GreyBoxFit) -> tuple[str, ...]:
    """The equations of a plant in symbols, if it has any, and the values of all its parameters."""
    symbols, numbers = fit.model.plant.equations(), fit.model.equation()
    return (symbols, numbers) if symbols else (numbers,)


def units_taken(fit: GreyBoxFit) -> str:
    """A warning if a record has no units; empty if it has."""
    commands = None if fit.model.plant.channels is None else 1  # codes have no unit
    unsaid = [
        name
        for segment in fit.segments[:1]
        for name, unit in zip(
            (*segment.input_names[:commands], *segment.output_names),
            (*segment.input_units[:commands], *segment.output_units),
            strict=True,
        )
        if not unit
    ]
    if not unsaid:
        return ""
    they = "they are" if len(unsaid) > 1 else "it is"
    return (
        f"The record has no unit for {listed(unsaid)}; {they} read as SI. If this is wrong, the estimates have wrong "
        "units and scales."
    )


def _parameter_row(row: Estimate, sheet: bool) -> tuple[str, ...]:
    given = "" if row.datasheet is None else plain(row.datasheet)
    words = (row.name, first_up(row.description), row.symbol, readable_unit(row.unit), row.how)
    return (*words, *_value(row), *((given,) if sheet else ()))


def _value(row: Estimate) -> tuple[str, str]:
    """The value of a parameter and half its interval in percent."""
    if row.estimated and row.standard_error is not None:
        return _with_interval(row.value, HALF_WIDTH * row.standard_error)
    if row.status is Status.AT_BOUND and row.interval is not None:
        return f"{plain(row.interval[0])} to {plain(row.interval[1])}", "–"
    return plain(row.value), "–"


def _with_interval(value: float, half: float) -> tuple[str, str]:
    if not np.isfinite(half):
        return plain(value), "unknown"
    return within(value, half), share_of(half, value)


def plain(value: float) -> str:
    """A value without an interval."""
    return "∞" if value == np.inf else number(value)
