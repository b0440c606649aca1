"""The entry ``fit`` of a model file: estimates, covariance, units and findings.

Numbers that JSON cannot hold, as the infinite variance of a parameter that the data do not determine, are texts. Of the
covariance, which is symmetric, the rows of the lower triangle are written; of more than `MOST_SHARED` parameters the
variances only, and what is read back has NaN beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.estimates import Estimate, Status, assumed_in
from emsid.estimation.fit import Ending, Fit
from emsid.findings import Finding
from emsid.io.limits import LARGEST, check_limits
from emsid.record.channels import ChannelNames

if TYPE_CHECKING:
    from emsid.models.model import Model

Array = NDArray[np.float64]
Number = float | str

MOST_SHARED = 250
"""With the triangle of more parameters, a file comes near `emsid.io.limits.MOST_ENTRIES`."""


class Row(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """A row of the table of parameters."""

    name: str
    value: Number
    status: Status
    symbol: str = ""
    unit: str = ""
    description: str = ""
    standard_error: Number | None = None
    start: Number | None = None
    datasheet: Number | None = None
    given: tuple[str, ...] = ()
    interval: tuple[Number, Number] | None = None
    record: str = ""


class Found(msgspec.Struct, forbid_unknown_fields=True):
    """A finding."""

    code: str
    subject: str
    data: dict[str, Any]


class FitData(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """What a fit is besides its model."""

    names: tuple[str, ...]
    estimate: list[Number]
    covariance: list[list[Number]]
    noise_variance: Number
    samples: Number
    condition: Number
    rank: int
    ending: Ending
    method: str
    iterations: int = 0
    dependent: int = 0
    table: tuple[Row, ...] = ()
    findings: tuple[Found, ...] = ()


def fit_data(fit: Fit[Any]) -> FitData:
    """A fit without its model, its history and its channels."""
    size = len(fit.names)
    lower = [row[: k + 1] if size <= MOST_SHARED else row[k : k + 1] for k, row in enumerate(fit.covariance.tolist())]
    return FitData(
        names=tuple(fit.names),
        estimate=_written(fit.estimate.tolist()),
        covariance=[_written(row) for row in lower],
        noise_variance=_number(fit.noise_variance),
        samples=_number(fit.samples),
        condition=_number(fit.condition),
        rank=int(fit.rank),
        ending=fit.ending,
        method=fit.method,
        iterations=int(fit.iterations),
        dependent=int(fit.dependent),
        table=tuple(_row(row) for row in fit.table),
        findings=tuple(_finding(finding) for finding in fit.findings if _fits(finding)),
    )


def fit_of(model: Model, data: FitData, channels: ChannelNames | None) -> Fit[Any]:
    """The fit that was written with its model.

    Raises:
        ModelError: for data of another form.
    """
    size = len(data.names)
    sizes = [len(row) for row in data.covariance]
    if len(data.estimate) != size or sizes not in ([k + 1 for k in range(size)], [1] * size):
        raise ModelError(f"a fit of {size} parameters with {len(data.estimate)} estimates and another covariance")
    covariance = np.full((size, size), np.nan)
    for k, row in enumerate(data.covariance):
        covariance[k, k + 1 - len(row) : k + 1] = covariance[k + 1 - len(row) : k + 1, k] = _read(row)
    if (np.diag(covariance) < 0).any():
        raise ModelError("the variance of an estimate is negative")
    findings = tuple(Finding(finding.code, finding.subject, finding.data) for finding in data.findings)
    return Fit(
        model,
        data.names,
        _read(data.estimate),
        covariance,
        float(data.noise_variance),
        float(data.samples),
        float(data.condition),
        data.rank,
        data.ending,
        data.method,
        data.iterations,
        findings=findings,
        dependent=data.dependent,
        table=_with_assumptions([_estimate(row) for row in data.table]),
        channels=channels,
    )


def _number(value: float) -> Number:
    return float(value) if isfinite(value) and abs(value) <= LARGEST else repr(float(value))


def _written(values: Sequence[float]) -> list[Number]:
    return [_number(value) for value in values]


def _read(values: Sequence[Number]) -> Array:
    return np.array([float(value) for value in values])


def _row(row: Estimate) -> Row:
    numbers = {name: getattr(row, name) for name in ("standard_error", "start", "datasheet")}
    return Row(
        row.name,
        _number(row.value),
        Status(row.status),
        row.symbol,
        row.unit,
        row.description,
        given=tuple(row.given),
        interval=None if row.interval is None else (_number(row.interval[0]), _number(row.interval[1])),
        record=row.record,
        **{name: None if value is None else _number(value) for name, value in numbers.items()},
    )


def _estimate(row: Row) -> Estimate:
    numbers = {name: getattr(row, name) for name in ("standard_error", "start", "datasheet")}
    return Estimate(
        row.name,
        row.symbol,
        row.unit,
        row.description,
        float(row.value),
        status=row.status,
        given=row.given,
        interval=None if row.interval is None else (float(row.interval[0]), float(row.interval[1])),
        record=row.record,
        **{name: None if value is None else float(value) for name, value in numbers.items()},
    )


def _with_assumptions(table: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """The rows, of which older files call every one that depends on a value that was held conditional."""
    nobodys = {row.name for row in assumed_in(table)}
    return tuple(
        replace(row, status=Status.ASSUMING)
        if row.status is Status.CONDITIONAL and nobodys.intersection(row.given)
        else row
        for row in table
    )


def _finding(finding: Finding) -> Found:
    return Found(finding.code, finding.subject, msgspec.to_builtins(dict(finding.data)))


def _fits(finding: Finding) -> bool:
    """Whether a finding has numbers and texts that a file can hold; others are left out."""
    try:
        check_limits([finding.subject, msgspec.to_builtins(dict(finding.data))])
    except (ModelError, TypeError):
        return False
    return True
