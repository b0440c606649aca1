"""Text tables: CSV, TSV, ``.dat``, as data loggers, spreadsheets and MATLAB write them.

Nothing has to be said about the dialect. Lines that are blank or begin with ``#`` or ``%`` are left out wherever they
stand. The last lines of what remains, which are data in any file, tell the separator (semicolon, tab, comma, blanks)
and the number of columns. The first line of this width that holds a number, and is followed by more, begins the data;
the line above is the header if it has a name for every column (a row of units may stand between), and what is above
that is preamble. Without a header the columns are called ``c1``, ``c2``, …. Decimal commas are recognised column by
column.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from emsid.errors import FormatError
from emsid.io.columns import Columns
from emsid.io.files import looks_like

if TYPE_CHECKING:
    import polars as pl

_NUMBER = re.compile(r"[+-]?(\d+\.?|\d*[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_MISSING = frozenset({"", "na", "n/a", "null", "none", "-", "--", "?"})
_BRACKETED = re.compile(r"\(.*\)|\[.*\]|\{.*\}")
_UNITS = {
    *(
        "s",
        "ms",
        "us",
        "µs",
        "ns",
        "min",
        "h",
        "hz",
        "khz",
        "v",
        "mv",
        "a",
        "ma",
        "w",
        "%",
        "pwm",
        "count",
        "counts",
    ),
    *("rad", "deg", "°", "rev", "rpm", "rad/s", "deg/s", "°/s", "rev/s", "rad/s^2", "m", "mm", "m/s", "mm/s"),
    *("n", "nm", "n*m", "n·m", "kg", "°c"),
}
_CELL = "\x1f"  # stands between the cells of a split line; in a file it would be binary, and refused
_TAIL = 100  # lines at the end of the file that tell its structure
_DIGIT = re.compile(r"\d")
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f]")


class _Line(NamedTuple):
    number: int  # 1-based line of the file
    text: str

    @property
    def cells(self) -> list[str]:
        """The cells of a line that has been split by marks."""
        return [cell.strip() for cell in self.text.split(_CELL)]


class _Header(NamedTuple):
    number: int  # 1-based line of the file with the names
    names: list[str]
    units: list[str]


def read_table(content: bytes) -> Columns:
    """The columns of a text table.

    Raises:
        FormatError: for binary content, no data, or a line with another number of values than the rest.
    """
    comments: list[_Line] = []
    lines: list[_Line] = []
    for number, text in enumerate(_decode(content).replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1):
        stripped = text.strip()
        if stripped:
            (comments if stripped[0] in "#%" else lines).append(_Line(number, text))
    if not lines:
        raise FormatError("there is no table in this file, only comments or blank lines; check how it was exported")

    tail = [line.text for line in lines[-_TAIL:] if _DIGIT.search(line.text)]
    separator = _separator(tail[len(tail) // 2 :])
    lines = [_Line(number, _with_marks(number, text, separator)) for number, text in lines]
    width = _width(lines[-_TAIL:])
    start = _first_data_line(lines, width)
    header = _header(lines, start, width) or _commented_header(comments, lines[start], separator, width)
    data = lines[start:]
    for number, text in data:
        if text.count(_CELL) != width - 1:
            found = text.count(_CELL) + 1
            raise FormatError(
                f"row {number} of the file has {found} value{'s' * (found != 1)} where the others have "
                f"{width}; the file is cut off or damaged there: repair or delete that row"
            )
    names = _distinct(header.names if header else [""] * width)
    above = (line for line in lines[:start] if not header or line.number < header.number)
    preamble = sorted([*above, *(comment for comment in comments if comment.number < data[0].number)])
    return Columns(
        series=_parse(data, names),
        units={name: unit for name, unit in zip(names, header.units, strict=True) if unit} if header else {},
        preamble=tuple(line.text.replace(_CELL, " ").strip().lstrip("#% ") for line in preamble),
        lines=[line.number for line in data],
    )


def _decode(content: bytes) -> str:
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))  # UTF-16, as spreadsheets write "Unicode text"
    text = None
    with suppress(UnicodeDecodeError):
        text = content.decode("utf-16" if wide else "utf-8-sig")
    if text is None and not wide:
        text = content.decode("latin-1")  # a µ or ° of an older program; every byte is a letter
    damage = None if text is None else _CONTROL.search(text)
    what = looks_like(content)
    if text is None or damage or not (wide or what == "text"):
        if damage and what == "text":
            what = f"text with binary data in row {text.count(chr(10), 0, damage.start()) + 1}" if text else what
        raise FormatError(
            f"this is not a text table; it looks like {what}: give the file its right suffix or repair it"
        )
    return text


def _with_marks(number: int, text: str, separator: str) -> str:
    """The line with a mark between its cells in place of the separator, and without quotes."""
    if '"' not in text:
        return _CELL.join(text.split()) if separator == " " else text.replace(separator, _CELL)
    if separator == " ":
        return _CELL.join(cell.strip('"') for cell in re.findall(r'"[^"]*"|[^\s"]+', text))
    try:
        return _CELL.join(next(csv.reader([text], delimiter=separator, skipinitialspace=True)))
    except (csv.Error, StopIteration) as problem:
        raise FormatError(f"row {number} of the file cannot be split into values ({problem}); repair it") from None


def _numeric_share(sample: Sequence[str], separator: str) -> float:
    """The part of the filled cells that are numbers, were ``separator`` the right one."""
    filled = [cell for text in sample for cell in text.replace('"', "").split(None if separator == " " else separator)]
    cells = [cell.strip() for cell in filled if cell.strip()]
    return sum(bool(_NUMBER.fullmatch(cell)) for cell in cells) / len(cells) if cells else 0.0


def _separator(sample: Sequence[str]) -> str:
    """Semicolon or tab where most lines have one, else comma or blanks, whichever leaves more numbers."""

    def common(character: str) -> bool:
        return 2 * sum(character in text for text in sample) > len(sample)

    if common(";"):
        return ";"
    preferred = "\t" if common("\t") else ","
    return preferred if _numeric_share(sample, preferred) >= _numeric_share(sample, " ") else " "


def _width(lines: Sequence[_Line]) -> int:
    """The most frequent number of cells of a line with a number; of equally frequent ones the last."""
    counts = Counter(len(line.cells) for line in reversed(lines) if any(map(_is_number, line.cells)))
    return counts.most_common(1)[0][0] if counts else 1


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None


def _first_data_line(lines: Sequence[_Line], width: int) -> int:
    """The index of the first line that has ``width`` cells and a number among them, and that others like it follow."""

    def has_number(k: int) -> bool:
        return any(map(_is_number, lines[k].cells))

    def is_missing(k: int) -> bool:
        return len(lines[k].cells) == width and all(map(_is_missing, lines[k].cells))

    def begins(k: int) -> bool:
        follows = k + 1 == len(lines) or has_number(k + 1) or is_missing(k + 1)
        return follows and len(lines[k].cells) == width and has_number(k)

    start = next(filter(begins, range(len(lines))), None)
    if start is None:
        raise FormatError("there are no numbers in this file; check how it was exported")
    while start and is_missing(start - 1):
        start -= 1
    return start


def _header(lines: Sequence[_Line], start: int, width: int) -> _Header | None:
    """The names, and perhaps units, in the one or two lines above the first data line, if that is what they
    are."""

    def names(k: int) -> list[str]:
        """Line ``k`` as ``width`` names; one separator too many, there or in the data, is forgiven."""
        cells = lines[k].cells if k >= 0 else []
        while len(cells) > width and not cells[-1]:
            cells.pop()
        if len(cells) == width - 1 and not lines[start].cells[-1]:
            cells.append("")
        return cells if _are_names(cells, width) else []

    nearest, above = names(start - 1), names(start - 2)
    if above and all(map(_is_unit, nearest)) and nearest:
        return _Header(lines[start - 2].number, above, [unit.strip("()[]{} ") for unit in nearest])
    return _Header(lines[start - 1].number, nearest, [""] * width) if nearest else None


def _commented_header(comments: Sequence[_Line], first: _Line, separator: str, width: int) -> _Header | None:
    """The names in the comment right above the first data line (``# t u y``), if that is what it is."""
    above = next((comment for comment in comments if comment.number == first.number - 1), None)
    if above is None:
        return None
    text = above.text.strip().lstrip("#%").strip()
    cells = _Line(above.number, _with_marks(above.number, text, separator)).cells
    return _Header(above.number, cells, [""] * width) if _are_names(cells, width) else None


def _are_names(cells: Sequence[str], width: int) -> bool:
    return len(cells) == width and any(cells) and not any(map(_is_number, cells))


def _is_missing(cell: str) -> bool:
    return cell.lower() in _MISSING


def _is_unit(cell: str) -> bool:
    return not cell or cell == "-" or cell.lower() in _UNITS or _BRACKETED.fullmatch(cell) is not None


def _distinct(names: Sequence[str]) -> list[str]:
    """Names with blanks filled by the column number and repetitions by a counter: ``u``, ``u_2``."""
    result: list[str] = []
    for k, name in enumerate(names):
        base = name or f"c{k + 1}"
        unique, count = base, 1
        while unique in result:
            count += 1
            unique = f"{base}_{count}"
        result.append(unique)
    return result


def _parse(data: Sequence[_Line], names: Sequence[str]) -> dict[str, pl.Series]:
    import polars as pl

    frame = pl.read_csv(
        "\n".join(line.text for line in data).encode() + b"\n",
        has_header=False,
        separator=_CELL,
        quote_char=None,
        schema=dict.fromkeys(names, pl.String),
    )
    return {name: _numbers_or_text(frame[name].str.strip_chars()) for name in names}


def _numbers_or_text(column: pl.Series) -> pl.Series:
    """The column as numbers where every filled cell is one, else as text with decimal points."""
    import polars as pl

    column = column.replace("", None)
    numbers = column.cast(pl.Float64, strict=False)
    if numbers.null_count() > column.null_count() and not column.str.contains(r"^[+-]?\d*\.\d").any():
        column = column.str.replace(r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$", "${1}.${2}")
        numbers = column.cast(pl.Float64, strict=False)
    return numbers if numbers.null_count() == column.null_count() else column
