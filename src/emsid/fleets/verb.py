"""`emsid.fleet`: one structure fitted to many motors, over many periods.

All motors get the same structure, so that their parameters can be compared. It is given, or chosen on one motor.
Every finished row is appended to a journal at once, so an interrupted run goes on where it stopped. A row is used again
only for the same job, files and version of this program; rows of other jobs stay in the journal, and are not reported.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, replace
from errno import ENOSPC
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np

from emsid.compiled import own_code
from emsid.errors import DataError, EmsidError, FormatError, some
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.findings import Finding
from emsid.fleets.engine import Engine
from emsid.fleets.sources import Batch, Found, batches, divided, found_files
from emsid.fleets.spread import (
    FEWEST_MOTORS,
    FEWEST_PERIODS,
    NOISE,
    Cause,
    Change,
    Outlier,
    Series,
    Spread,
    causes,
    changes,
    long_enough,
    noise_of,
    outliers,
    series_of,
)
from emsid.fleets.work import FleetRow, Job, digest, record_of, rows_of, source_of
from emsid.identification.workflow import identify
from emsid.io import atomic_write, load
from emsid.io.files import indented_json, not_written, together
from emsid.models.refitting import specification
from emsid.options import Options
from emsid.record.frames import frame as made_frame

JOURNAL, RESULT, SUMMARY, PARTS = "rows.jsonl", "fleet.parquet", "fleet.json", ".parts"
FRAME = ".frame.parquet"
"""The files in the folder of results, and the folder of the divided tables, which is removed at the end."""


@dataclass(frozen=True, eq=False)
class Fleet:
    """The result for a fleet.

    Attributes:
        rows: a row for every motor and period, in this order.
        findings: on the whole, and a finding for every motor that differs or has changed.
        interrupted: whether it was stopped before its end; running the same again goes on from there.
    """

    rows: tuple[FleetRow, ...]
    findings: tuple[Finding, ...] = ()
    interrupted: bool = False

    @cached_property
    def series(self) -> list[Series]:
        """The estimates of every parameter over motors and periods."""
        return series_of(self.rows)

    @cached_property
    def noise(self) -> Series | None:
        """The noise of the output over motors and periods; None where it is not known of any."""
        found = noise_of(self.rows) if self.series else None
        return found if found is not None and np.isfinite(found.values).any() else None

    @cached_property
    def _compared(self) -> tuple[list[Outlier], dict[str, Spread]]:
        return outliers([*self.series, *([] if self.noise is None else [self.noise])])

    @cached_property
    def causes(self) -> list[Cause]:
        """What one thing explains of motors that differ in several parameters."""
        return causes(self.series, self.outliers, self.ordinary)

    @property
    def outliers(self) -> list[Outlier]:
        """The motors that differ from the fleet, the most different first; see `emsid.fleets.spread`."""
        return self._compared[0]

    @property
    def ordinary(self) -> dict[str, Spread]:
        """Centre and spread of every parameter over the motors."""
        return self._compared[1]

    @cached_property
    def changes(self) -> list[Change]:
        """The motors that have changed over the periods, the clearest first."""
        return changes(self.series)

    @cached_property
    def tested(self) -> dict[str, bool]:
        """Whether enough motors say which is ``different``, and enough periods which has ``changed``."""
        return {"different": bool(self.ordinary), "changed": bool(long_enough(self.series))}

    @property
    def failed(self) -> list[FleetRow]:
        """The rows without a model."""
        return [row for row in self.rows if row.reason]

    @cached_property
    def assuming(self) -> dict[str, tuple[str, ...]]:
        """The parameters of any motor that depend on values which nobody gave or measured, with the names of these."""
        found: dict[str, tuple[str, ...]] = {}
        for row in self.rows:
            for name, value in row.estimates.items():
                if value.assuming:
                    found[name] = tuple(dict.fromkeys((*found.get(name, ()), *value.assuming)))
        return found

    def to_data(self) -> dict[str, Any]:
        """The motors that are named, what is ordinary, and the rows without a model, in built-in types."""
        return {
            "schema": 1,
            "rows": len(self.rows),
            "interrupted": self.interrupted,
            "findings": [finding.to_data() for finding in self.findings],
            "ordinary": {name: asdict(each) for name, each in self.ordinary.items()},
            "assuming": {name: list(each) for name, each in self.assuming.items()},
            "failed": [{"motor": row.motor, "period": row.period, "reason": row.reason} for row in self.failed],
        }

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with a row for every motor and period.

        Every parameter has two columns, its value and ``<name>_half_width``, half its 95 % interval.

        Args:
            library: ``"polars"`` or ``"pandas"``.

        Raises:
            DataError: for a library that is unknown or not installed.
        """
        import polars as pl

        names = list(dict.fromkeys(name for row in self.rows for name in row.estimates))
        plain: dict[str, Any] = {
            "motor": pl.String,
            "period": pl.String,
            "reason": pl.String,
            "verdict": pl.String,
            "findings": pl.List(pl.String),
            "rmse": pl.Float64,
            "fit_percent": pl.Float64,
            "noise": pl.Float64,
            "samples": pl.Int64,
            "seconds": pl.Float64,
            "job": pl.String,
            "data": pl.String,
        }
        columns = {name: [getattr(row, name) for row in self.rows] for name in plain}
        columns["findings"] = [list(each) for each in columns["findings"]]
        for name in names:
            for ending, part in (("", "value"), ("_half_width", "half_width")):
                plain[name + ending] = pl.Float64
                columns[name + ending] = [
                    getattr(row.estimates[name], part) if name in row.estimates else None for row in self.rows
                ]
        table = pl.DataFrame(columns, schema=plain)
        return table if library == "polars" else made_frame(dict(table.to_dict(as_series=False)), library)  # type: ignore[arg-type]


def fleet(
    source: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    what: Any = "rigid-motor",
    executor: Executor | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    motor: str | None = None,
    period: str | None = None,
    reference: str | None = None,
    options: Options | None = None,
    unseen: float = 0.3,
    workers: int | None = None,
    control: Control = FREE,
    **reading: Any,
) -> Fleet:
    """Fit one structure to every motor of a fleet, and name the motors that differ or have changed.

    Args:
        source: a folder, a pattern such as ``logs/{motor}/{period}.csv``, or several; folders named ``motor=M7`` name
            their motor. Or a pandas or Polars frame with a column that names it.
        what: a name of ``emsid list``, whose structure is then chosen on one motor; a fit, or the file of one, whose
            structure is taken; or anything that `emsid.fit` takes.
        executor: where the fits run; by default processes of this machine, which in a script needs the usual
            ``if __name__ == "__main__":``. Of a Dask cluster, whose workers must reach the files, give
            ``client.get_executor()``.
        out: a folder for the rows; the same call goes on where an earlier one stopped.
        motor: the field of paths, or else the column of tables, that names the motor; by default the field ``motor``,
            or the names of the files.
        period: a field of paths, or a duration such as ``"1d"`` that divides the time column of tables.
        reference: the motor on which a structure is chosen; by default the first whose data can be used.
        options: of that choice, such as ``Options(fixed={"resistance": 2.0})``.
        unseen: the last part of every batch, on which the free run is judged.
        workers: how many tasks run at a time.
        control: when to stop, and where to report progress.
        reading: ``input``, ``output``, ``time`` and the other arguments of `emsid.read`.

    Raises:
        DataError: without files, for a field or column that is missing, or where no motor can be used.
        ModelError: for something that cannot be fitted.
        FormatError: where the folder cannot be written to, or holds rows of another kind of file.
    """
    for name in ("input", "output"):
        if not reading.get(name):
            raise DataError(f"name the {name} column", arguments=(name,))
    if not 0 <= unseen < 1:
        raise DataError(f"an unseen part of {unseen:g}; give a fraction from 0 to below 1", arguments=("unseen",))
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()) if out is None else out)
        control.doing("looking for files")
        todo, failed = _found(source, motor, period, reading.get("time"), folder)
        subject, how = _structure(what, todo, reference, options or Options(), reading, control)
        version = sys.modules["emsid"].__version__
        code = list(own_code((subject, how)))
        key = repr((version, subject, sorted(how.items()), sorted(reading.items()), unseen, code))
        name = digest(re.sub(" at 0x[0-9a-f]+", "", key).encode())  # functions count by their code, not their place
        job = Job(subject, how, reading, unseen, name)
        journal = Journal(folder / JOURNAL, name, {batch.key: batch for batch in todo})
        rows = {(row.motor, row.period): row for row in journal.rows}
        engine = Engine(partial(rows_of, job), partial(_lost, job), executor, workers, control)
        with journal, suppress(Stopped):
            for batch, row in engine([each for each in todo if each.key not in rows]):
                rows[batch.key] = row
                journal.add(row)
                control.doing("fitting motors", len(rows), len(todo))
        stopped = len(rows) < len(todo)
        every = [*(rows[key] for key in sorted(rows)), *failed]
        result = Fleet(tuple(every), interrupted=stopped)
        dropped = [Finding("rows-dropped", data={"dropped": journal.dropped})] if journal.dropped else []
        result = replace(result, findings=(*findings_of(result, len(todo)), *dropped))
        if out is not None:
            _write(result, folder)
            if not stopped:
                _remove(folder / PARTS)
                (folder / FRAME).unlink(missing_ok=True)
        return result


def _found(
    source: Any, motor: str | None, period: str | None, time: str | None, folder: Path
) -> tuple[list[Batch], list[FleetRow]]:
    """The batches of a source, and rows for tables that cannot be divided."""
    if hasattr(source, "columns"):
        source = framed(source, motor, folder / FRAME)
        files = [Found(source, {})]
    else:
        files = found_files(source)
    if motor is None or any(motor in file.keys for file in files):
        return batches(files, motor, period, time), []
    parts, failed = divided(files, motor, folder / PARTS)
    rows = [FleetRow(Path(path).name, "", reason=f"{path}: {reason}") for path, reason in failed.items()]
    return batches(parts, "motor", period, time), rows


def framed(frame: Any, motor: str | None, path: Path) -> Path:
    """A data frame of all motors as a file, which is then divided like any other.

    Raises:
        DataError: without the column that names the motor.
    """
    from io import BytesIO

    import narwhals
    import polars as pl

    table = narwhals.from_native(frame)
    if motor not in table.columns:
        raise DataError(
            f"name the column of the frame that names the motor; it has {some(table.columns)}", arguments=("motor",)
        )
    content = BytesIO()
    numeric = {name: table[name].dtype.is_numeric() for name in table.columns}
    columns = {name: table[name].to_numpy() if numeric[name] else table[name].to_list() for name in table.columns}
    pl.DataFrame(columns).write_parquet(content)
    atomic_write(path, content.getvalue())
    return path


def _remove(folder: Path) -> None:
    from shutil import rmtree

    rmtree(folder, ignore_errors=True)


def _structure(
    what: Any, todo: list[Batch], reference: str | None, options: Options, reading: Mapping[str, Any], control: Control
) -> tuple[Any, dict[str, Any]]:
    """What is fitted to every motor, with the options of `emsid.fit`."""
    if isinstance(what, str | os.PathLike) and Path(what).suffix == ".json":
        what = load(what)
    if isinstance(what, Fit):
        return specification(what)
    if not isinstance(what, str):
        return what, {}
    asked = [batch for batch in todo if reference in (None, batch.motor)][:MOST_TRIED]
    if not asked:
        raise DataError(f"no motor {reference!r} in the fleet", arguments=("reference",))
    problem: EmsidError | None = None
    for batch in asked:
        try:
            record = record_of(reading, batch)
            found = identify(record, models=what, options=options, control=control.during(f"motor {batch.motor}"))
            return specification(found.recommended_fit)
        except EmsidError as failed:
            problem = failed
    raise DataError(f"no structure can be chosen on motor {asked[0].motor}: {problem}", arguments=("reference",))


MOST_TRIED = 5
"""Motors on which a structure is tried before the data are taken to be unsuitable."""


def _lost(job: Job, batch: Batch) -> FleetRow:
    return FleetRow(
        batch.motor,
        batch.period,
        reason="its worker process ended twice while it was fitted; look at the file, or give more memory",
        job=job.name,
        source=source_of(batch),
    )


def findings_of(result: Fleet, asked: int) -> list[Finding]:
    """What to know about a fleet, the most important first."""
    explained = {(each.motor, name) for each in result.causes for name in each.parameters}
    alone = [each for each in result.outliers if (each.motor, each.parameter) not in explained]
    noisy, differing = ([each for each in alone if (each.parameter == NOISE) is is_it] for is_it in (True, False))
    named: tuple[tuple[str, Sequence[Any]], ...] = (
        ("differs-by-one-cause", result.causes),
        ("differs-from-fleet", differing),
        ("noisier-than-fleet", noisy),
        ("changed-over-periods", result.changes),
    )
    found = [
        Finding(code, each.motor, {name: value for name, value in asdict(each).items() if name != "motor"})
        for code, several in named
        for each in several
    ]
    motors = len({row.motor for row in result.rows if not row.reason})
    if motors < FEWEST_MOTORS:
        found.append(Finding("fleet-too-small", data={"motors": motors, "least": FEWEST_MOTORS}))
    periods = len({row.period for row in result.rows if not row.reason})
    if periods > 1 and not result.tested["changed"]:
        found.append(Finding("fleet-too-short", data={"periods": periods, "least": FEWEST_PERIODS}))
    if result.assuming:
        names = list(dict.fromkeys(name for each in result.assuming.values() for name in each))
        found.append(Finding("fleet-assumes", data={"parameters": list(result.assuming), "assumed": names}))
    if result.failed:
        found.append(Finding("motors-failed", data={"failed": len(result.failed), "rows": len(result.rows)}))
    if result.interrupted:
        found.append(Finding("fleet-unfinished", data={"rows": len(result.rows), "asked": asked}))
    return found


class Journal:
    """The finished rows of a job, one line each; a line that was cut by a crash is left out.

    Args:
        path: the file; lines of other jobs in it are kept as they are.
        job: the hash of the job.
        todo: the batches by their keys; rows of others, or of files that have changed, are dropped.

    Attributes:
        rows: those of the job that are still valid.
        dropped: how many were dropped.

    Raises:
        FormatError: where the file cannot be read, or is no journal.
    """

    def __init__(self, path: Path, job: str, todo: Mapping[tuple[str, str], Batch]) -> None:
        self.path, self.rows, self.dropped, self._lines = path, list[FleetRow](), 0, list[str]()
        try:
            lines = path.read_text("utf-8").splitlines() if path.is_file() else []
        except (OSError, ValueError) as problem:
            raise FormatError(f"{path}: cannot be read ({problem}); remove it, or name another folder") from None
        for k, line in enumerate(lines):
            try:
                row = msgspec.convert(json.loads(line), FleetRow)
            except (ValueError, msgspec.ValidationError):
                if k == 0 and len(lines) > 1:
                    raise FormatError(f"{path}: this is no journal of a fleet; name another folder") from None
                continue
            if row.job == job:
                batch = todo.get((row.motor, row.period))
                if batch is None or not row.source or row.source != source_of(batch):
                    self.dropped += 1
                    continue
                self.rows.append(row)
            self._lines.append(line + "\n")

    def __enter__(self) -> Journal:
        atomic_write(self.path, "".join(self._lines))
        self._file = open(self.path, "ab", buffering=0)
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, row: FleetRow) -> None:
        """Append a row; it is on disk when this returns.

        Raises:
            NotWritten: where it cannot be written, such as on a full disk; the rows before it stay.
        """
        line, end = _line(row), os.fstat(self._file.fileno()).st_size
        try:
            if self._file.write(line) < len(line):
                raise OSError(ENOSPC, os.strerror(ENOSPC))
            os.fsync(self._file.fileno())
        except BaseException as problem:
            self._file.truncate(end)
            if isinstance(problem, OSError):
                raise not_written(self.path, problem) from None
            raise


def _line(row: FleetRow) -> bytes:
    return (json.dumps(asdict(row), ensure_ascii=False) + "\n").encode()


def _write(result: Fleet, folder: Path) -> None:
    """Write the rows as Parquet, and the summary, both or neither."""
    from io import BytesIO

    content = BytesIO()
    result.to_frame().write_parquet(content)
    with together():
        atomic_write(folder / RESULT, content.getvalue())
        atomic_write(folder / SUMMARY, indented_json(result.to_data()))
