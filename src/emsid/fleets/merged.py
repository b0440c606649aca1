r"""One least-squares problem over many files and machines: factors of parts, merged as a tree.

Every part of the data has its triangular factor R of [Φ y], `emsid.Information`, of a few numbers however many rows it
has. Factors merge in pairs, so workers return numbers and no data, and the result is that of one machine to rounding.
The same holds for a Gauss–Newton step: with the residual r and its Jacobian J of every record, the step δ solves
``min ‖r + Jδ‖``, whose factor is that of [J −r].

Parts of a Parquet file are groups of its rows. A part is read with as many rows before it as the largest lag needs, so
no row of the regression is lost at a border.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from emsid.arguments import as_names
from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.information import Information
from emsid.estimation.linear.least_squares import check_information, solved, with_record
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.fleets.engine import Engine
from emsid.fleets.sources import BINARY, found_files, scan, scanned
from emsid.models.regression.narx import Narx, Structure
from emsid.record import Record

ROWS = 4_000_000
"""Rows of a part: 64 MB of two channels, so that a worker stays far below 1 GB with its copies."""


@dataclass(frozen=True)
class Part:
    """Rows of a table.

    Attributes:
        number: of the part, in order.
        file: the path.
        first, rows: where the rows of the part begin, and how many there are.
        before: rows before them that give lagged values.
    """

    number: int
    file: str
    first: int
    rows: int
    before: int


def least_squares_over(
    source: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    structure: Structure,
    executor: Executor | None = None,
    *,
    input: str | Sequence[str],
    output: str | Sequence[str],
    dt: float,
    rows: int = ROWS,
    workers: int | None = None,
    control: Control = FREE,
) -> Fit[Narx]:
    """Least squares over tables of any length, in constant memory; every file is one experiment without gaps.

    Args:
        source: Parquet or Arrow files, as for `emsid.fleet`.
        structure: what to fit, such as ``emsid.arx(na=2, nb=2)``.
        executor: where the parts are read and reduced; by default processes of this machine.
        input, output: the columns.
        dt: the sample time in s.
        rows: of a part.
        workers: how many parts at a time.
        control: when to stop, and where to report progress.

    Raises:
        DataError: for files that are no such tables, cannot be read, or are too short.
        ModelError: for a structure of other channels.
        Stopped: if ``control`` stops it.
    """
    files = [str(file.path) for file in found_files(source)]
    if not scanned(files, BINARY):
        raise DataError(f"{files[0]}: parts are taken of {', '.join(BINARY)} only; write the tables in such a format")
    inputs, outputs = as_names(input), as_names(output)
    parts = _parts(files, rows, structure.memory)
    engine = Engine(partial(_informations, structure, inputs, outputs, dt), _lost, executor, workers, control)
    found: dict[int, Information] = {}
    for part, information in engine(parts):
        found[part.number] = information
        control.doing("reducing parts", len(found), len(parts))
    control.check()
    whole = merged([found[k] for k in sorted(found)])
    check_information(whole, structure, files[0])
    solution = whole.solve()
    head = _record(Part(0, files[0], 0, structure.memory + 1, 0), inputs, outputs, dt)
    return solved(structure, whole, solution, head, solution.estimate)


def _parts(files: Sequence[str], rows: int, memory: int) -> list[Part]:
    """Parts of all files, in order."""
    import polars as pl

    found: list[Part] = []
    for file in files:
        length = int(scan([file]).select(pl.len()).collect().item())
        for first in range(0, length, rows):
            before = min(memory, first)
            found.append(Part(len(found), file, first, min(rows, length - first), before))
    return found


def _record(part: Part, inputs: Sequence[str], outputs: Sequence[str], dt: float) -> Record:
    """The rows of a part, with those before them."""
    import polars as pl

    table = scan([part.file]).slice(part.first - part.before, part.before + part.rows)
    try:
        frame = table.select([*inputs, *outputs]).collect(engine="streaming")
    except pl.exceptions.PolarsError as problem:
        raise DataError(f"{part.file}: cannot be read ({' '.join(str(problem).split())[:160]})") from None
    u, y = (np.column_stack([frame[name].to_numpy() for name in names]) for names in (inputs, outputs))
    return Record(u, y, dt, tuple(inputs), tuple(outputs), name=part.file)


def _informations(
    structure: Structure, inputs: Sequence[str], outputs: Sequence[str], dt: float, parts: Sequence[Part]
) -> list[Information]:
    found = []
    for part in parts:
        record = _record(part, inputs, outputs, dt)
        structure.check(record)
        found.append(with_record(Information.empty(len(structure.parameter_names)), structure, record))
    return found


def _lost(part: Part) -> Information:
    raise DataError(
        f"{part.file}: the worker of its rows from {part.first:,} on ended twice; take fewer rows at a time",
        arguments=("rows",),
    )


def merged(informations: Sequence[Information]) -> Information:
    """The information of all parts, merged as a tree, so that rounding grows with the logarithm of their number.

    Args:
        informations: of the parts, in order.

    Raises:
        ModelError: for no part at all.
    """
    level = list(informations)
    if not level:
        raise ModelError("there is no information to merge")
    while len(level) > 1:
        pairs = [level[k : k + 2] for k in range(0, len(level), 2)]
        level = [pair[0].merge(pair[1]) if len(pair) == 2 else pair[0] for pair in pairs]
    return level[0]
