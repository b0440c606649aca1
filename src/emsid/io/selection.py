"""The rows of a file that a record is made of: those selected, without those left out by a mask or as damaged."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, some
from emsid.findings import Finding
from emsid.io.columns import MOST_SHOWN, Columns, DamagedRow, as_numbers, nearest
from emsid.io.mask import left_out

Array = NDArray[np.float64]

ROW = "row"
"""The name by which a mask may call the number of the data row, counted from 0, unless a column has it."""
MOST_SKIPPED = 0.02
"""At most this share of the rows of a file are skipped as bad."""


class NothingLeft(DataError):
    """A mask leaves out every row."""


@dataclass(frozen=True)
class Selection:
    """The selected rows of columns: ``start … start + N − 1`` without the rows left out.

    Attributes:
        columns: of the file, or of an excerpt of it.
        start: their first row, counted from 0.
        kept: (N,) true for the rows to use.
        findings: about rows that were skipped.
    """

    columns: Columns
    start: int
    kept: NDArray[np.bool_]
    findings: tuple[Finding, ...] = ()

    @property
    def rows(self) -> NDArray[np.intp]:
        """The rows of the columns that are used, counted from 0."""
        return self.start + np.flatnonzero(self.kept)

    @property
    def file_rows(self) -> NDArray[np.intp]:
        """The data rows of the file that these are."""
        return self.columns.file_rows(self.rows)

    @property
    def follows(self) -> NDArray[np.bool_]:
        """For every row used but the first, whether the row before it is used as well."""
        follows: NDArray[np.bool_] = np.diff(self.file_rows) == 1
        return follows

    def number(self, row: int | np.intp) -> int:
        """The number under which the user finds a row used, counted from 0."""
        return self.columns.number(int(self.rows[row]))

    def numbers(self, name: str) -> Array:
        """The values of a column in the rows used.

        Raises:
            DataError: at the first text, missing value, NaN or infinity among them.
        """
        series = self.columns.series[name].gather(self.rows)
        values = as_numbers(series)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            found = "no value" if series[int(bad[0])] is None else repr(series[int(bad[0])])
            raise DataError(
                f"column {name!r} has {found} in {self.columns.place(int(self.rows[bad[0]]))}, not a number; repair "
                "it or leave it out with rows, a mask or skip_bad_rows",
                arguments=("skip_bad_rows",),
            )
        return values

    def signs(self, name: str) -> Array:
        """The sign of another column that a direction column gives, see `signs_of`.

        Raises:
            DataError: where the column has more values than a direction.
        """
        values = self.numbers(name)
        levels = np.unique(values)
        if len(levels) > 3:
            raise DataError(
                f"column {name!r} has {len(levels):,} different values, which is no direction; name one with two, "
                "such as 0 and 1 or −1 and 1",
                arguments=("direction",),
            )
        return signs_of(values)

    def scaled(self, name: str, gain: float, offset: float, direction: str | None = None) -> Array:
        """The values of a column as gain·x + offset, where x has the sign that another column gives, if one does."""
        values = self.numbers(name) if direction is None else self.signs(direction) * self.numbers(name)
        values = gain * values + offset
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise DataError(
                f"column {name!r} becomes {values[bad[0]]} in {self.columns.place(int(self.rows[bad[0]]))} by its "
                f"scale {gain:g} and offset {offset:g}; give others"
            )
        return values


def signs_of(direction: Array) -> Array:
    """The sign that the values (N,) of a direction give: negative where they are not above 0.

    Of a direction that is negative somewhere, 0 is neither.
    """
    return np.sign(direction) if np.nanmin(direction) < 0 else np.where(direction > 0, 1.0, -1.0)


def check_column(name: str, columns: Columns) -> None:
    """Refuse a name that is no column, with those that there are."""
    if name in columns.others:
        raise DataError(f"{name!r} is no column: it is {columns.others[name]}; columns are {some(columns.series)}")
    if name not in columns.series:
        raise DataError(
            f"there is no column {name!r}{nearest(name, columns.series)}; there are {some(columns.series)}"
            f"{columns.besides}"
        )


def select(
    columns: Columns, used: Sequence[str], rows: slice, mask: str | None, skip_bad_rows: bool, file: str
) -> Selection:
    """The rows to use of some columns of a file.

    Args:
        columns: the file.
        used: the columns that must have a number in every row used.
        rows: the data rows to take, without a step.
        mask: as in `emsid.read`.
        skip_bad_rows: likewise.
        file: the name of the file, for a finding.

    Raises:
        DataError: where a column does not exist, columns differ in length, nothing is left, or a row is damaged.
    """
    for name in used:
        check_column(name, columns)
    lengths = {name: len(columns.series[name]) for name in used}
    length = lengths[used[0]]
    for name, other in lengths.items():
        if other != length:
            raise DataError(f"column {used[0]!r} has {length} samples and {name!r} {other}; they must agree")
    if rows.step not in (None, 1):
        raise DataError(
            f"rows {rows.start}:{rows.stop}:{rows.step}; rows are taken without a step, decimate the record instead"
        )
    whole = length if columns.excerpt is None else columns.excerpt.rows
    start, stop, _ = rows.indices(whole)
    if stop <= start:
        first, last = ("" if edge is None else edge for edge in (rows.start, rows.stop))
        raise DataError(f"rows {first}:{last} select nothing of {whole} rows; give A:B with 0 ≤ A < B ≤ {whole}")
    if columns.excerpt is not None:
        start, stop = np.searchsorted(columns.file_rows(np.arange(length)), [start, stop]).tolist()
    damaged = [row for row in columns.damaged if start <= row.row < stop + (not row.is_sample and stop == length)]
    if damaged and not skip_bad_rows:
        raise DataError(
            f"{damaged[0]}; the file is cut off or damaged there: repair or delete that row, or leave it out with "
            "rows or skip_bad_rows",
            arguments=("skip_bad_rows",),
        )
    kept = np.ones(stop - start, dtype=bool)
    if mask is not None:
        same = {name: series[start:stop] for name, series in columns.series.items() if len(series) == length}
        if ROW not in map(str.lower, columns.series) and re.search(rf"\b{ROW}\b", mask, re.IGNORECASE):
            import polars as pl

            same[ROW] = pl.Series(ROW, columns.file_rows(np.arange(start, stop)))
        kept = ~left_out(mask, same)
        if not kept.any():
            raise NothingLeft(f"the mask {mask!r} leaves none of {len(kept)} samples; relax it")
    if skip_bad_rows:
        good = np.all([np.isfinite(as_numbers(columns.series[name][start:stop])) for name in used], axis=0)
        findings = _skipped(columns, start, kept & ~good, [row for row in damaged if not row.is_sample], file)
        return Selection(columns, start, kept & good, findings)
    return Selection(columns, start, kept)


def _skipped(
    columns: Columns, start: int, bad: NDArray[np.bool_], messages: Sequence[DamagedRow], file: str
) -> tuple[Finding, ...]:
    """The finding about rows that are skipped: those that are bad, and messages between the rows.

    Raises:
        DataError: where these are too many.
    """
    count = int(np.count_nonzero(bad)) + len(messages)
    rows = len(bad) + len(messages) if columns.excerpt is None else columns.excerpt.rows
    if not count:
        return ()
    if count > max(1, MOST_SKIPPED * rows):
        raise DataError(
            f"{count} of {rows} rows have no number in a column in use ({100 * count / rows:.3g} %); at most "
            f"{100 * MOST_SKIPPED:g} % are skipped: check how the file was exported, or leave them out with rows or a "
            "mask",
            arguments=("rows", "mask"),
        )
    texts = {row.line: row.text[:MOST_SHOWN] for row in columns.damaged}
    first = min([*(columns.number(start + int(k)) for k in np.flatnonzero(bad)[:1]), *(row.line for row in messages)])
    data = {"count": count, "rows": rows, "line": first, "text": texts.get(first, ""), "messages": len(messages)}
    return (Finding("rows-skipped", file, data),)
