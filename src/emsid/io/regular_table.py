"""Large text tables whose lines are all alike, parsed at once, with memory in proportion to the numbers.

`emsid.io.table` looks at every line, and keeps it as a text: about 200 bytes a line, whatever it holds. Here only the
first and last lines are read in that way. They give the names, the separator, the first line of data, and which columns
are numbers. The rest is parsed by Polars. The result is used where nothing speaks against it: every line has the same
number of separators, all cells of a column of numbers are numbers, and the first and last rows are those that were read
line by line. Otherwise the table is read line by line.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from emsid.errors import FormatError
from emsid.io.cells import numbers_or_text
from emsid.io.columns import Columns

if TYPE_CHECKING:
    import polars as pl

LARGE = 1 << 21
"""Bytes from which on a table is parsed at once; a smaller one takes less than a second line by line."""
SAMPLE = 1 << 17
"""Bytes of the first and of the last lines that are read line by line: about a thousand lines of a wide table."""
MOST_LINES = 12_000_000
"""Lines that are read one by one; they take about 2.5 GB."""
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


def check_lines(content: bytes) -> None:
    """Refuse a table of so many lines that reading them one by one takes more memory than a machine has.

    Raises:
        FormatError: that gives their number.
    """
    count = content.count(b"\n")
    if count > MOST_LINES:
        raise FormatError(
            f"this table has {count:,} lines, some of them unlike the others, and at most {MOST_LINES:,} of such a "
            "table are read; remove its comments, messages and damaged lines, or take a part"
        )


def read_regular(content: bytes, by_lines: Callable[[bytes], Columns]) -> Columns | None:
    """The columns of a large table whose lines are all alike; None for a small or another one.

    Args:
        content: of the file.
        by_lines: reads a table line by line.
    """
    if len(content) < LARGE:
        return None
    stop = len(content)
    while stop and content[stop - 1] in b"\r\n \t":
        stop -= 1
    head, tail = content.find(b"\n", SAMPLE) + 1, content.rfind(b"\n", 0, stop - SAMPLE) + 1
    if not 0 < head < tail:
        return None
    begin, end = content[:head], content[tail:stop]
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
    count = content.count(b"\n", start, stop) + 1
    separators = (len(sample.series) - 1) * count
    separator = next((each for each in _SEPARATORS if content.count(each, start, stop) == separators), None)
    if separator is None or content.find(b'"', start, stop) >= 0:
        return None
    frame = _parsed(content[start:stop], separator.decode(), sample)
    if frame is None or frame.height != count:
        return None
    first = begin.count(b"\n", start)
    series = {column.name: column for column in frame}
    for name, known in sample.series.items():
        found = series[name]
        if found.dtype != known.dtype or not (found[:first].equals(known[:first], null_equal=True)):
            return None
        if not found[count - (rows - first) :].equals(known[first:], null_equal=True):
            return None
    return replace(sample, series=series, lines=range(line, line + count))


def _parsed(body: bytes, separator: str, sample: Columns) -> pl.DataFrame | None:
    """The data with the types of a sample; None where a cell is no number in a column of numbers."""
    import polars as pl

    numbers = {name for name, series in sample.series.items() if series.dtype == pl.Float64}
    schema = {name: pl.Float64 if name in numbers else pl.String for name in sample.series}
    for comma in (False, True)[: 1 + (separator != ",")]:
        try:
            frame = pl.read_csv(
                body,
                has_header=False,
                separator=separator,
                quote_char=None,
                schema=schema,
                decimal_comma=comma,
                low_memory=True,
            )
        except pl.exceptions.PolarsError:
            continue
        texts = [numbers_or_text(frame[name].str.strip_chars().replace("", None)) for name in schema.keys() - numbers]
        return frame.with_columns(texts)
    return None
