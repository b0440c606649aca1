"""Large text tables whose lines are all alike, parsed at once, with memory in proportion to the numbers.

`emsid.io.table` looks at every line, and keeps it as a text: about 200 bytes a line, whatever it holds. Here only the
first and last lines are read in that way. They give the names, the separator, the first line of data, and which columns
are numbers. The rest is parsed by Polars. The result is used where nothing speaks against it: every line has the same
number of separators, all cells of a column of numbers are numbers, and the first and last rows are those that were read
line by line. Otherwise the table is read line by line.
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from os import SEEK_END
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from emsid.errors import FormatError
from emsid.io.columns import Columns
from emsid.io.cut_off import without_cut_line
from emsid.io.large import MOST, Facts, as_typed

if TYPE_CHECKING:
    import polars as pl

LARGE = 1 << 21
"""Bytes from which on a table is parsed at once; a smaller one takes less than a second line by line."""
SAMPLE = 1 << 17
"""Bytes of the first and of the last lines that are read line by line: about a thousand lines of a wide table."""
MOST_LINES = 12_000_000
"""Lines that are read one by one; they take about 2.5 GB."""
AT_ONCE = 1 << 24
"""Bytes that are parsed at once."""
WIDEST = 1 << 20
"""Bytes that a line of such a table may have."""
MOST_COLUMNS = 20_000
"""Columns of a table: more than any logger has, and a matrix with its samples in columns has more."""
_SEPARATORS = (b"\t", b";", b",", b" ")


def check_size(content: bytes) -> None:
    """Refuse a table with a line of more than `MOST_COLUMNS` values, before it is taken apart.

    Raises:
        FormatError: that gives their number.
    """
    first = content.find(b"\n")
    for line in (content[: first if first >= 0 else None], content[content.rstrip().rfind(b"\n") + 1 :]):
        width = max(line.count(separator) for separator in _SEPARATORS) + 1
        if width > MOST_COLUMNS:
            raise FormatError(
                f"this table has {width:,} columns and at most {MOST_COLUMNS:,} are read; samples go down: transpose "
                "it, or take a part"
            )


def check_lines(count: int) -> None:
    """Refuse a table of so many lines that reading them one by one takes more memory than a machine has.

    Raises:
        FormatError: that gives their number.
    """
    if count > MOST_LINES:
        raise FormatError(
            f"this table has {count:,} lines, some of them unlike the others, and at most {MOST_LINES:,} of such a "
            "table are read; remove its comments, messages and damaged lines, or take a part"
        )


@dataclass(frozen=True)
class LargeText:
    """A large text table whose lines are all alike (an `emsid.io.large.LargeTable`).

    Attributes:
        path: the file.
        sample: its first and last rows.
        separator: between its cells.
        stop: the byte after its last row.
        places: the row and the byte with which each block begins.
        rows: their number.
        facts: what a pass over all of them has shown.
    """

    path: Path
    sample: Columns
    separator: bytes
    stop: int
    places: tuple[tuple[int, int], ...] = ()
    rows: int = 0
    facts: Facts = field(default_factory=Facts)

    def block(self, file: BinaryIO, at: int, names: Sequence[str] = ()) -> tuple[pl.DataFrame | None, int]:
        """The rows from a byte on, None where a line is unlike the others, and the byte after them."""
        file.seek(at)
        body = file.read(min(AT_ONCE, self.stop - at))
        if at + len(body) < self.stop:
            body = body[: body.rfind(b"\n") + 1]
        count = body.count(b"\n") + (body[-1:] != b"\n")
        separators = (len(self.sample.series) - 1) * count
        if not body or body.count(self.separator) != separators or b'"' in body:
            return None, at
        frame = _parsed(body, self.separator.decode(), self.sample, names)
        return (frame if frame is not None and frame.height == count else None), at + len(body)

    def part(self, first: int, stop: int, names: Sequence[str]) -> pl.DataFrame:
        """See `emsid.io.large.LargeTable`.

        Raises:
            FormatError: where the file has changed.
        """
        import polars as pl

        k = bisect(self.places, first, key=lambda place: place[0]) - 1
        (row, at), frames = self.places[k], list[pl.DataFrame]()
        with open(self.path, "rb") as file:
            while row + sum(frame.height for frame in frames) < stop:
                frame, at = self.block(file, at, names)
                if frame is None:
                    raise FormatError("this file has changed while it was read; read it when it is complete")
                frames.append(frame.select(names))
        return pl.concat(frames).slice(first - row, stop - first)


def read_regular(
    file: BinaryIO, by_lines: Callable[[bytes], Columns], path: Path | None = None
) -> Columns | LargeText | None:
    """The columns of a large table whose lines are all alike; None for a small or another one.

    Args:
        file: of any size.
        by_lines: reads a table line by line.
        path: of the file, where it need not be held: of more than `emsid.io.large.MOST` numbers, the table is returned.

    Raises:
        FormatError: for a table with too many columns.
    """
    import polars as pl

    size = file.seek(0, SEEK_END)
    if size < LARGE:
        return None
    file.seek(SAMPLE)
    head = SAMPLE + len(file.readline(WIDEST))
    file.seek(0)
    begin = file.read(head)
    at = max(size - SAMPLE - WIDEST, head)
    file.seek(at)
    end, is_cut = without_cut_line(file.read())
    end = end.rstrip(b"\r\n \t")
    stop, tail = at + len(end), end.rfind(b"\n", 0, max(len(end) - SAMPLE, 0)) + 1
    if not begin.endswith(b"\n") or not (tail or at == head):
        return None
    end = end[tail:]
    check_size(begin + end)
    try:
        sample = by_lines(begin + end)
    except FormatError:
        return None
    rows = len(sample.lines or ())
    if not rows or sample.damaged or sample.lines is None:
        return None
    line = sample.lines[0]
    whole = begin.count(b"\n") + end.count(b"\n") + 1
    if list(sample.lines) != list(range(line, whole + 1)) or line > begin.count(b"\n"):
        return None
    start = 0
    for _ in range(line - 1):
        start = begin.index(b"\n", start) + 1
    first, known, separators = begin.count(b"\n", start), begin[start:] + end, (len(sample.series) - 1) * rows
    separator = next((each for each in _SEPARATORS if known.count(each) == separators), None)
    if separator is None or not end:
        return None
    table = LargeText(path or Path(), sample, separator, stop)
    frames, places, count, at = list[pl.DataFrame](), list[tuple[int, int]](), 0, start
    is_held = True
    while at < stop:
        places.append((count, at))
        frame, at = table.block(file, at)
        if frame is None or (count == 0 and not _agree(frame.head(first), sample, 0)):
            return None
        if path is not None:
            table.facts.add(frame, count)
        count += frame.height
        is_held = is_held and (path is None or count * frame.width <= MOST)
        frames = [*frames, frame] if is_held else [frame]
    last = frames[-1].tail(rows - first)
    if not _agree(last, sample, rows - last.height):
        return None
    sample = replace(sample, lines=range(line, line + count), cut={"": (count, 0)} if is_cut else {})
    if not is_held:
        return replace(table, sample=sample, places=tuple(places), rows=count)
    series = {column.name: column for column in as_typed(pl.concat(frames, rechunk=True))}
    alike = all(series[name].dtype == known.dtype for name, known in sample.series.items())
    return replace(sample, series=series) if alike else None


def _agree(frame: pl.DataFrame, sample: Columns, first: int) -> bool:
    """Whether the numbers of rows are those of a sample from its row ``first`` on."""
    rows = slice(first, first + frame.height)
    numbers = (series for series in sample.series.values() if series.dtype.is_numeric())
    return all(frame[x.name].cast(x.dtype, strict=False).equals(x[rows], null_equal=True) for x in numbers)


def _parsed(body: bytes, separator: str, sample: Columns, names: Sequence[str]) -> pl.DataFrame | None:
    """Some columns of rows, numbers where those of a sample are; None where a cell is no number in such a column."""
    import polars as pl

    schema = {name: pl.Float64 if each.dtype == pl.Float64 else pl.String for name, each in sample.series.items()}
    for comma in (False, True)[: 1 + (separator != ",")]:
        try:
            return pl.read_csv(
                body,
                has_header=False,
                separator=separator,
                quote_char=None,
                schema=schema,
                columns=[k for k, name in enumerate(schema) if name in names] if names else None,
                decimal_comma=comma,
                low_memory=True,
            )
        except pl.exceptions.PolarsError:
            continue
    return None
