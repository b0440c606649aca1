"""What a worker does: read the data of a motor, fit the model, run it on what it has not seen.

Everything that a worker needs is in a `Job` and a `Batch`, and what it returns is a `FleetRow`, so that a process of
this machine and one of another machine do the same. A motor whose data cannot be used gives a row with the reason.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import file_digest, sha256
from math import nan
from typing import Any

import numpy as np

from emsid.arguments import as_names
from emsid.errors import DataError, EmsidError
from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.fit import Fit
from emsid.estimation.threads import one_blas_thread
from emsid.first_look.faults import without_faults
from emsid.fleets.sources import BINARY, Batch, scan, scanned, time_number
from emsid.identification.verdict import model_verdicts
from emsid.io import read
from emsid.models.verbs import fit, is_plant
from emsid.record import Record, concatenate
from emsid.units import column_of, name_and_unit
from emsid.validation.comparison import compare

DIGEST = 16
"""Hexadecimal digits of a hash: 64 bits, by which a few million rows are told apart."""


@dataclass(frozen=True)
class Job:
    """What is done with every batch.

    Attributes:
        what: what `emsid.fit` fits: a structure, a cascade, a plant.
        options: of that fit, by name.
        reading: arguments of `emsid.read`.
        unseen: the last part of the data, from which the error is; 0 fits all and gives the error on the fitted data.
        name: the hash of all this.
    """

    what: Any
    options: Mapping[str, Any]
    reading: Mapping[str, Any]
    unseen: float
    name: str


@dataclass(frozen=True)
class Value:
    """An estimate.

    Attributes:
        value: in its unit.
        half_width: half of its 95 % interval; NaN without one.
        unit: of both.
        assuming: the parameters on which it depends and whose values nobody gave or measured.
    """

    value: float
    half_width: float
    unit: str
    assuming: tuple[str, ...] = ()


@dataclass(frozen=True)
class FleetRow:
    """The result for one motor in one period.

    Attributes:
        motor, period: which.
        reason: why there is no model; empty where there is one.
        estimates: by parameter.
        verdict: the code of the verdict on the model, as in `emsid.identify`.
        findings: codes of the findings of the fit.
        rmse: of the free run on the unseen part, in the unit of the output.
        fit_percent: of that free run.
        noise: standard deviation of the part of its error that is new from sample to sample, of the first output.
        unit: of that output.
        samples: of the fit.
        seconds: processor time.
        job, data: hashes of what was done and of the samples.
        source: hash of the files and of the part of them, by which a row is known to be of these data.
    """

    motor: str
    period: str
    reason: str = ""
    estimates: Mapping[str, Value] = field(default_factory=dict)
    verdict: str = ""
    findings: tuple[str, ...] = ()
    rmse: float = nan
    fit_percent: float = nan
    noise: float = nan
    unit: str = ""
    samples: int = 0
    seconds: float = 0.0
    job: str = ""
    data: str = ""
    source: str = ""


def rows_of(job: Job, batches: Sequence[Batch]) -> list[FleetRow]:
    """The rows of several batches, in order."""
    return [row_of(job, batch) for batch in batches]


@one_blas_thread()
def row_of(job: Job, batch: Batch) -> FleetRow:
    """The row of one batch; whatever its data are, it is a row."""
    begun = time.process_time()
    source = source_of(batch)

    def failed(reason: str) -> FleetRow:
        return FleetRow(
            batch.motor,
            batch.period,
            reason=reason,
            seconds=round(time.process_time() - begun, 3),
            job=job.name,
            source=source,
        )

    try:
        record = without_faults(record_of(job.reading, batch))
        found, row = fitted(job, record)
    except EmsidError as problem:
        return failed(str(problem))
    except Exception as problem:  # of a library that meets a damaged file
        return failed(f"{type(problem).__name__}: {' '.join(str(problem).split())[:200]}")
    codes = tuple(dict.fromkeys(finding.code for finding in (*record.findings, *found.findings)))
    return FleetRow(
        batch.motor,
        batch.period,
        estimates=estimates_of(found),
        findings=codes,
        samples=int(found.samples),
        seconds=round(time.process_time() - begun, 3),
        job=job.name,
        data=digest(record.input.tobytes(), record.output.tobytes(), repr(record.dt).encode()),
        source=source,
        **row,
    )


def record_of(reading: Mapping[str, Any], batch: Batch) -> Record:
    """The data of a batch; of several files, with a gap between them.

    Raises:
        EmsidError: where they cannot be read.
    """
    if batch.time is None and not scanned(batch.files, BINARY):
        records = [read(path, **reading) for path in batch.files]
        return records[0] if len(records) == 1 else concatenate(records, batch.motor)
    import polars as pl

    needed = _columns(reading)
    try:
        table = scan(batch.files)
        if batch.time is not None:
            column, begin, end = batch.time
            at = time_number(batch.files, column)
            table = table.filter((at >= begin) & (at < end))
        if needed:
            table = table.select([name for name in table.collect_schema() if name_and_unit(name)[0] in needed])
        frame = table.collect(engine="streaming")
    except pl.exceptions.PolarsError as problem:
        reason = " ".join(str(problem).split())[:160]
        raise DataError(f"{batch.files[0]}: this table cannot be read ({reason}); copy or write it again") from None
    return read(frame, **reading)


def _columns(reading: Mapping[str, Any]) -> set[str]:
    """The columns that a reading names, without units; empty where it may need any: a mask is an expression of them."""
    if "mask" in reading:
        return set()
    named = [reading["input"], reading["output"], reading.get("time", ()), list(reading.get("direction", {}).values())]
    return {name_and_unit(column_of(name))[0] for names in named for name in as_names(names)}


def fitted(job: Job, record: Record) -> tuple[Fit[Any], dict[str, Any]]:
    """The fit to the first part of a record, and verdict and error on the rest.

    Raises:
        EmsidError: where the data do not suit the model.
    """
    train, rest = record.split(1 - job.unseen) if job.unseen else (record, record)
    exactly = {"search": False} if is_plant(job.what) else {}  # every motor the same plant, so that they compare
    found = fit(job.what, train, **{**exactly, **job.options})
    on_rest = compare([found], rest)
    row = on_rest.best.row
    (verdict,) = model_verdicts(compare([found], train), on_rest, found.findings)
    errors = on_rest.best.errors[:, 0]
    noise = float(np.sqrt(0.5 * np.nanmean(np.diff(errors) ** 2))) if len(errors) > 1 else nan
    values = {"rmse": row.simulation_rmse, "fit_percent": row.fit_percent, "noise": noise}
    return found, {"verdict": verdict.code, **values, "unit": record.output_units[0]}


def estimates_of(found: Fit[Any]) -> dict[str, Value]:
    """The estimated parameters with half the widths of their intervals."""
    result, assumed = {}, {row.name for row in found.assumed}
    for each in found.to_data()["parameters"]:
        ends, error = each.get("interval"), each.get("standard_error")
        if error is None and ends is None:
            continue
        half = 0.5 * (ends[1] - ends[0]) if ends and None not in ends else nan if error is None else HALF_WIDTH * error
        result[each["name"]] = Value(
            float(each["value"]),
            float(half),
            each["unit"],
            tuple(name for name in each.get("given", ()) if name in assumed),
        )
    return result or {
        name: Value(float(value), nan, "")
        for name, value in zip(found.names, np.atleast_1d(found.estimate), strict=True)
    }


def source_of(batch: Batch) -> str:
    """The hash of the files of a batch and of the part of them that it is; empty where one cannot be read."""
    try:
        return digest(repr(batch.time).encode(), *(_file_digest(path, _stamp(path)) for path in batch.files))
    except OSError:
        return ""


def _stamp(path: str) -> tuple[int, ...]:
    status = os.stat(path)
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


@lru_cache(maxsize=1024)
def _file_digest(path: str, stamp: tuple[int, ...]) -> bytes:
    """The hash of a file; a table of many periods is read for it once."""
    with open(path, "rb") as file:
        return file_digest(file, "sha256").digest()


def digest(*contents: bytes) -> str:
    """A hash of contents."""
    found = sha256()
    for content in contents:
        found.update(content)
    return found.hexdigest()[:DIGEST]
