"""Characteristics of a drive with intervals: gain, time constant, dead zone, friction."""

from __future__ import annotations

from math import isfinite
from typing import Any

from emsid.estimation.estimates import Estimate, Status
from emsid.estimation.fit import Fit
from emsid.estimation.uncertainty.intervals import HALF_WIDTH
from emsid.models.characteristics import Characteristic
from emsid.models.kinds import capabilities_of
from emsid.record import Record
from emsid.validation.comparison import Comparison

# Characteristics that a linear model has too.
LINEAR = ("gain", "time constant", "natural frequency", "damping ratio")
# Another model is also used if its free-run RMSE is at most this multiple of the smallest one.
NEARLY = 1.5


def determined(fit: Fit[Any]) -> list[Estimate]:
    """The physical parameters of a model that the data determine: their intervals do not include zero.

    None of them depends on a value that nobody gave. A model without a table of such parameters has none.
    """
    rows = capabilities_of(fit.model).physical_rows(fit)
    return [row for row in rows if row.status in (Status.ESTIMATED, Status.CONDITIONAL) and _excludes_zero(row)]


def _excludes_zero(row: Estimate) -> bool:
    """Whether a parameter has an interval, and zero is not in it."""
    if row.standard_error is not None:
        return 0 < HALF_WIDTH * row.standard_error < abs(row.value)
    return row.interval is not None and row.interval[0] * row.interval[1] > 0


def characteristics(comparison: Comparison, record: Record) -> tuple[Characteristic, ...]:
    """The characteristics of the best model, and dead zone and friction of the next model that is nearly as good.

    A model whose free run diverges has neither a steady gain nor a time constant.

    Args:
        comparison: the models on unseen data.
        record: what they were fitted to, for its units.
    """
    least = comparison.best.row.simulation_rmse
    if not isfinite(least):
        return ()
    near = [each.fit for each in comparison.assessments if each.row.simulation_rmse <= NEARLY * least]
    found: list[Characteristic] = []
    for fit in near:
        new = [each for each in of_fit(fit, record) if each.name not in {known.name for known in found}]
        found += new if not found else [each for each in new if each.name not in LINEAR]
        if any(each.name not in LINEAR for each in found):
            break
    return tuple(found)


def of_fit(fit: Fit[Any], record: Record) -> tuple[Characteristic, ...]:
    """The characteristics of one model; none of a model that has no such parameters."""
    return capabilities_of(fit.model).characteristics(fit, record)
