"""Accuracy against number of parameters, and errors by operating region and by record."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.identification.ranking import FrontRow
from emsid.report.document import Axis, Figure, Ink, Line, Plot, Points, Stroke, Table
from emsid.report.numbers import first_up, number
from emsid.units import in_unit
from emsid.validation.regions import REGIONS, RecordError, RegionError

Array = NDArray[np.float64]
WIDE = 6.0
"""The least ratio of the ends of the axis of errors."""
COVERED = 0.06
"""Points that are closer than this share of the axis of errors have one label."""
COLUMNS = 6
"""At most this many records have a column each in the table of errors by record; more have a row each."""
GREY = Stroke(Ink.GREY, width=1.0)


def front_table(rows: Sequence[FrontRow]) -> Table:
    """Every model with its parameters and its error over all folds, numbered as in the figure."""
    lines = tuple(
        (f"{k} {each.model}", str(each.parameters), percent_of(each.error), error_range(each), place(each))
        for k, each in enumerate(rows, 1)
    )
    folds = rows[0].folds
    where = f"over {folds} parts of the data, by fits without and with each" if folds > 1 else "on unseen data"
    return Table(
        ("Model", "Parameters", "Error %", "± one standard error", "Remark"),
        lines,
        f"Accuracy against number of parameters: RMSE of the free run {where}, in % of the output's deviation.",
        "A model on the front is better by more than noise than every simpler one on it.",
        ends_in_text=True,
        emphasised=frozenset(k for k, each in enumerate(rows) if each.recommended),
    )


def percent_of(share: float) -> str:
    """A share in percent, three digits."""
    return number(100 * share) if np.isfinite(share) else "diverges"


def error_range(row: FrontRow) -> str:
    """One standard error either way, in percent."""
    return f"{number(100 * row.low)} to {number(100 * row.high)}" if np.isfinite(row.low) else "–"


def place(row: FrontRow) -> str:
    """Whether a model is on the front, and recommended."""
    return ", ".join(["on the front"] * row.on_front + ["recommended"] * row.recommended)


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
    groups = (
        ("other models", Ink.BLUE, [each for each in known if not each[1].recommended]),
        ("recommended", Ink.RED, [each for each in known if each[1].recommended]),
    )
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
        "the table.",
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
