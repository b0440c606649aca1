"""Text tables: CSV, TSV, ``.dat``, as data loggers, spreadsheets and MATLAB write them, and lines of a serial monitor.

**The dialect.** It is recognised from the lines. Blank lines and lines that begin with ``#`` or ``%`` are ignored. The
last of the other lines are always data; they give the separator (semicolon, tab, comma, blanks) and the number of
columns. The data begin with the first line of this width that contains a number and is followed by similar lines. The
line above is the header if it has a name for every column (a row of units may stand between); the lines above it are
the preamble. Without a header the columns are called ``c1``, ``c2``, …. A last line that is cut off is left out
(`emsid.io.cut_off`). What a column holds is recognised cell by cell (`emsid.io.cells`).

**A serial monitor.** Its lines and those of a log, such as ``12:00:00.010 -> PWM:120, speed:3.4 rad/s``, first become
rows of a table. Boards print a label before each value, so that a plotter can name its curves, or a JSON object a line.
Monitors print the time of day and an arrow before each line, logs a time, a level and the name of a part. The labels
become the header, and the time becomes the first column. Rows of a list, ``[0.01, 12.0, 3.4]``, and of a matrix lose
their brackets.

**Labelled lines.** Measuring systems write ``Channel name,Force,Speed`` and ``Unit,N,m/s`` above the data, each with
its label in the first cell, or before every channel. The column under the label holds the times.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from emsid.errors import FormatError
from emsid.io.blocks import side_by_side, stacked
from emsid.io.can import without_database
from emsid.io.cells import MARK, cells_of, has_unit, is_missing, is_number, parse, without_units
from emsid.io.columns import Columns, DamagedRow
from emsid.io.cut_off import marked, without_cut_line
from emsid.io.files import looks_like
from emsid.io.regular_table import AT_ONCE, LargeText, check_lines, check_size, read_regular
from emsid.units import known_unit

LAST_LINES = 100
"""This many lines at the end of a file determine its structure."""


_BRACKETED = re.compile(r"\(.*\)|\[.*\]|\{.*\}")
# --- labelled lines ---------------------------------------------------------------------------------------------------

TIME = "time"
"""The name of the column with the times before an arrow, and of the one under labels."""
_MOST_LABELS = 20
"""Header lines above the data that are searched."""
_NAME_LABELS = re.compile(
    r"(channel|signal|column|variable|kanal)?[ _]?names?|channels?|signals?|kan(al|äle)", re.IGNORECASE
)
_UNIT_LABELS = re.compile(r"(y_)?units?([ _](labels?|strings?|symbols?))?|einheit(en)?|dimensions?", re.IGNORECASE)
_BROKEN = re.compile(r'(?:(?<=[,;\t\n])|^)"((?:[^"]|""){0,200})"(?=[ ]*(?:[,;\t\n]|$))')
_BREAK = "\v"
"""Stands for a line break in a quoted cell until the lines are counted."""
_NAME_AND_NUMBER = re.compile(r"(.*?[^\s\d.+-])\s*[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")
_BETWEEN_BLANKS = re.compile(r'"[^"]*"|[^\s"]+')
_DIGIT = re.compile(r"\d")
# the lines around the rows of a matrix in a script: data = [ ... ];
_MATRIX = re.compile(r"\s*(?:[A-Za-z_]\w*\s*=\s*(?:\w+(?:\.\w+)?\()?[\[({]+|[\])}]+[;,]?)\s*(?:\.\.\.)?\s*")
_LABVIEW, _HEADER_ENDS, _COMMENT = "LabVIEW Measurement", "***End_of_Header***", "Comment"
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f]")
# (1700000000.000800) can0 181#FFFF, or can0  201   [4]  F4 D4 00 00, with or without a time in front,
# or 0.01 1 181 Rx d 2 FF D4
_CAN_FRAME = re.compile(
    r"\s*(\(\S+\)\s+)?\w+\s+([0-9A-F]{3,8}#\S*(\s+[RT])?|[0-9A-F]{3,8}\s+\[\d+\](\s+[0-9A-F]{2})*(\s+'.*')?)\s*"
    r"|\s*[\d.]+\s+\d+\s+[0-9A-F]+x?\s+[RT]x\s.*",
    re.IGNORECASE,
)


class _Line(NamedTuple):
    number: int  # 1-based line of the file
    text: str


class _Header(NamedTuple):
    at: int | None  # index of its first line without comment lines; None in a comment
    names: list[str]
    units: list[str]
    constants: Sequence[tuple[int, str]] = ()  # columns with a value under their name and none in the data


def large_text(path: Path) -> LargeText | Columns | None:
    """The table in a large file whose lines are all alike, or its columns if they fit into memory; None for another.

    Raises:
        FormatError: for another one that is too long.
    """
    with open(path, "rb") as file:
        found = read_regular(file, _read_by_lines, path)
        if found is None:
            file.seek(0)
            check_lines(sum(block.count(b"\n") for block in iter(partial(file.read, AT_ONCE), b"")))
        return found


def read_table(content: bytes) -> Columns:
    """The columns of a text table.

    Raises:
        FormatError: for binary content, frames of a CAN bus, no data, or lines of differing numbers of values.
    """
    check_size(content)
    columns = read_regular(BytesIO(content), _read_by_lines)
    if isinstance(columns, Columns):
        return columns
    content, is_cut = without_cut_line(content)
    check_lines(content.count(b"\n"))
    return marked(_read_by_lines(content), is_cut)


def _read_by_lines(content: bytes) -> Columns:
    """The columns of a text table, of which every line is looked at; errors as of `read_table`."""
    comments, numbers, texts = _lines(content)
    if not texts:
        raise FormatError("there is no table in this file, only comments or blank lines; check how it was exported")

    if 2 * sum(_CAN_FRAME.fullmatch(text) is not None for text in texts[-LAST_LINES:]) > len(texts[-LAST_LINES:]):
        without_database(b"")
    texts, times, labels, units = monitor_lines(texts)
    texts = _without_end(texts)
    tail = [text for text in texts[-LAST_LINES:] if _DIGIT.search(text)]
    separator = "\t" if labels else _separator(tail[len(tail) // 2 :])
    texts = _with_marks(numbers, texts, separator)
    signals = None if times or labels else stacked(texts)
    if signals is not None:
        return signals
    if times:
        texts = [f"{time}{MARK}{text}" for time, text in zip(times, texts, strict=True)]
        labels, units = labels and ("", *labels), units and ("", *units)
    texts, behind = without_units(texts, LAST_LINES)
    width = _width(texts[-LAST_LINES:])
    start = _first_data_line(texts, width)
    header = _Header(None, list(labels), list(units)) if len(labels) == width else _header(texts, start, width)
    header = header or _commented_header(comments, numbers[start], separator, width)
    together = None if header or start == 0 else _with_first_row(texts[start - 1], width)
    header = header or _Header(start - 1 if together else None, together or [""] * width, [""] * width)
    above = start if header.at is None else header.at
    preamble = sorted(
        [*map(_Line, numbers[:above], texts[:above]), *(c for c in comments if c.number < numbers[start])]
    )
    line, text = (numbers[start - 1], " ".join(texts[start - 1].split(MARK))) if together else (0, "")
    numbers, texts, damaged = _without_messages(numbers[start:], texts[start:], width)
    if together:
        damaged = (DamagedRow(0, line, text, 2 * width - 1, width, is_sample=False), *damaged)
    names = _distinct([TIME, *header.names[1:]] if times else header.names)
    constants = {names[k]: value for k, value in header.constants}
    found = behind if len(behind) == width else header.units
    known = [given or unit for given, unit in zip(header.units, found, strict=True)]
    columns = Columns(
        series={name: series for name, series in parse(texts, names).items() if name not in constants},
        units={name: unit for name, unit in zip(names, known, strict=True) if unit},
        preamble=(
            *(line.text.replace(MARK, " ").strip().lstrip("#% ") for line in preamble),
            *(f"{name} {value}" for name, value in constants.items()),
        ),
        lines=numbers,
        damaged=damaged,
    )
    return side_by_side(
        columns, [name for name, given in zip(names, header.names, strict=True) if given == header.names[0]]
    )


def _lines(content: bytes) -> tuple[list[_Line], list[int], list[str]]:
    """The comments, and the numbers and texts of all other lines that are not blank."""
    comments: list[_Line] = []
    numbers: list[int] = []
    texts: list[str] = []
    whole = _decode(content).replace("\r\n", "\n").replace("\r", "\n")
    if '"' in whole:
        whole = _BROKEN.sub(lambda cell: re.sub(r"\s*\n\s*", _BREAK, cell[0]), whole)
    broken = 0
    for number, text in enumerate(whole.split("\n"), start=1):
        number, broken = number + broken, broken + text.count(_BREAK)
        text = text.replace(_BREAK, " ")
        first = text.lstrip()[:1]
        if first and first in "#%":
            comments.append(_Line(number, text))
        elif first and not _MATRIX.fullmatch(text):
            numbers.append(number)
            texts.append(text)
    if whole.startswith(_LABVIEW):
        return _after_labview_header(comments, numbers, texts)
    return comments, numbers, texts


def _after_labview_header(
    comments: list[_Line], numbers: list[int], texts: list[str]
) -> tuple[list[_Line], list[int], list[str]]:
    """The same of a LabVIEW measurement (LVM): its two headers are comments, and comments on rows have no name."""
    start = max((k + 1 for k, text in enumerate(texts) if text.startswith(_HEADER_ENDS)), default=0)
    comments += map(_Line, numbers[:start], texts[:start])
    names = texts[start : start + 1]
    return comments, numbers[start:], [*(name.removesuffix(_COMMENT) for name in names), *texts[start + 1 :]]


def _decode(content: bytes) -> str:
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))  # UTF-16, as spreadsheets write "Unicode text"
    try:
        text = content.decode("utf-16", errors="replace") if wide else content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")  # a µ or ° of an older program; every byte is a letter
    what = "text" if wide else looks_like(content)
    damage = _CONTROL.search(text)
    if damage and what == "text":
        what = f"text with binary data in row {text.count(chr(10), 0, damage.start()) + 1}"
    if what != "text":
        raise FormatError(
            f"this is not a text table; it looks like {what}: give the file its right suffix or repair it"
        )
    return text


def _without_end(texts: Sequence[str]) -> list[str]:
    """The lines without the separator at their end, where the last ones all have it and it ends no named column.

    It is the only one of its kind in a line (``0.1,2,3;``), or no line without it at the end has as many.
    """
    filled = [text.rstrip(" ") for text in texts]
    last = [text for text in filled[-LAST_LINES:] if _DIGIT.search(text)]
    last = last[len(last) // 2 :]
    if not last:
        return list(texts)
    for end in (";", ",", "\t"):
        if not all(text.endswith(end) and not text.endswith(2 * end) for text in last):
            continue
        alone = all(text.count(end) == 1 and re.search(r"[,;\t ]", text[:-1].strip()) for text in last)
        if alone or not any(text.count(end) == last[-1].count(end) and text[-1:] != end for text in filled):
            return [text.removesuffix(end) for text in filled]
    return list(texts)


def _with_marks(numbers: Sequence[int], texts: Sequence[str], separator: str) -> list[str]:
    """The lines with a mark between their cells in place of the separator, and without quotes."""
    if separator == " ":
        return [MARK.join(cell.strip('"') for cell in _BETWEEN_BLANKS.findall(text)) for text in texts]
    whole = "\n".join(texts)
    if '"' not in whole:
        return whole.replace(separator, MARK).split("\n")
    marked = []
    for number, text in zip(numbers, texts, strict=True):
        try:
            marked.append(MARK.join(next(csv.reader([text], delimiter=separator, skipinitialspace=True))))
        except (csv.Error, StopIteration) as problem:
            raise FormatError(f"row {number} of the file cannot be split into values ({problem}); repair it") from None
    return marked


def _without_messages(
    numbers: Sequence[int], texts: Sequence[str], width: int
) -> tuple[list[int], list[str], tuple[DamagedRow, ...]]:
    """The data without lines of another number of cells than the rest.

    A line without a number, such as a message, is removed. Another one becomes a row of missing values, because a
    sample is missing there.

    Raises:
        FormatError: where most lines are such lines.
    """
    counts = [text.count(MARK) + 1 for text in texts]
    if counts.count(width) == len(counts):
        return list(numbers), list(texts), ()
    kept_numbers: list[int] = []
    kept: list[str] = []
    damaged: list[DamagedRow] = []
    for number, text, count in zip(numbers, texts, counts, strict=True):
        if count != width:
            is_sample = any(map(is_number, cells_of(text)))
            line = " ".join(text.replace(MARK, " ").split())
            damaged.append(DamagedRow(len(kept), number, line, count, width, is_sample))
            if not is_sample:
                continue
            text = MARK * (width - 1)
        kept_numbers.append(number)
        kept.append(text)
    if 2 * len(damaged) > len(counts):
        raise FormatError(f"{damaged[0]}, and so have most rows; check how the file was exported")
    return kept_numbers, kept, tuple(damaged)


def _numeric_share(sample: Sequence[str], separator: str) -> float:
    """The share of numbers among the filled cells, with this separator."""
    rows = (text.replace('"', "").split(None if separator == " " else separator) for text in sample)
    cells = [cell.strip() for row in rows for cell in row if cell.strip()]
    return sum(is_number(cell) or has_unit(cell) for cell in cells) / len(cells) if cells else 0.0


def _separator(sample: Sequence[str]) -> str:
    """Semicolon or tab where most lines have one, else comma or blanks, whichever leaves more numbers."""

    def common(character: str) -> bool:
        return 2 * sum(character in text for text in sample) > len(sample)

    if common(";"):
        return ";"
    preferred = "\t" if common("\t") else ","
    return preferred if _numeric_share(sample, preferred) >= _numeric_share(sample, " ") else " "


def _width(texts: Sequence[str]) -> int:
    """The most frequent number of cells of a line with a number; of equally frequent ones the last."""
    rows = map(cells_of, reversed(texts))
    counts = Counter(len(cells) for cells in rows if any(map(is_number, cells)))
    return counts.most_common(1)[0][0] if counts else 1


def _first_data_line(texts: Sequence[str], width: int) -> int:
    """The index of the first line with ``width`` cells and a number that is followed by similar lines."""

    def has_number(k: int) -> bool:
        return any(map(is_number, cells_of(texts[k])))

    def is_empty(k: int) -> bool:
        cells = cells_of(texts[k])
        return len(cells) == width and all(map(is_missing, cells))

    def begins(k: int) -> bool:
        follows = k + 1 == len(texts) or has_number(k + 1) or is_empty(k + 1)
        return follows and len(cells_of(texts[k])) == width and has_number(k)

    start = next(filter(begins, range(len(texts))), None)
    if start is None:
        raise FormatError("there are no numbers in this file; check how it was exported")
    start = _after_preamble(texts, start, width)
    if _constants(texts, start, width):
        return start + 1
    while start and is_empty(start - 1):
        start -= 1
    return start


def _after_preamble(texts: Sequence[str], start: int, width: int) -> int:
    """The first data line, where from ``start`` on each line has more texts than any after a line of names.

    An oscilloscope writes such lines above its table: ``Sample Interval,1e-3,s``.
    """

    def words(text: str) -> int:
        return sum(not (is_number(cell) or is_missing(cell)) for cell in cells_of(text))

    for k in range(start, min(start + LAST_LINES, len(texts) - 1)):
        above = cells_of(texts[k])
        if all(above) and _are_names(above, width):
            usual = max(map(words, texts[k + 1 : k + 1 + LAST_LINES]))
            return k + 1 if min(map(words, texts[start:k])) > usual else start
        if not words(texts[k]):
            return start
    return start


def _constants(texts: Sequence[str], k: int, width: int) -> list[tuple[int, str]]:
    """The columns with a number in line ``k``, which has texts too and names above it, and with nothing below it.

    An oscilloscope writes such a line between names and data: ``Sequence,Volt,-2.0,1e-3``, under
    ``X,CH1,Start,Increment``.
    """
    row = cells_of(texts[k]) if k > 0 and _are_names(_shortened(texts[k - 1], width), width) else []
    below = [cells for cells in map(cells_of, texts[k + 1 : k + 1 + LAST_LINES]) if len(cells) == width]
    if len(row) != width or not below or all(is_number(cell) or is_missing(cell) for cell in row):
        return []
    numbers = [(column, cell) for column, cell in enumerate(row) if is_number(cell)]
    return numbers if all(is_missing(cells[column]) for cells in below for column, _ in numbers) else []


def _header(texts: Sequence[str], start: int, width: int) -> _Header | None:
    """The names, and units if there are any, in the one or two lines above the first data line."""

    def names(k: int) -> list[str]:
        """Line ``k`` as ``width`` names; one extra separator there or in the data is accepted."""
        cells = _shortened(texts[k], width) if k >= 0 else []
        if len(cells) == width - 1 and not cells_of(texts[start])[-1]:
            cells.append("")
        return cells if _are_names(cells, width) else []

    found = labelled(texts, start, width)
    if found:
        return _Header(*found)
    constants = _constants(texts, start - 1, width)
    if constants:
        units = [unit if _is_unit(unit) else "" for unit in cells_of(texts[start - 1])]
        return _Header(start - 2, names(start - 2), units, constants)
    nearest, above = names(start - 1), names(start - 2)
    units = nearest if nearest and above and all(map(_is_unit, nearest)) else []
    at = start - 2 if units else start - 1
    lowest = above if units else nearest
    over = names(at - 1)
    if over and len(set(lowest)) < len(lowest) and len(set(zip(over, lowest, strict=True))) > len(set(lowest)):
        at, lowest = at - 1, [f"{group} {name}".strip() for group, name in zip(over, lowest, strict=True)]
    return _Header(at, lowest, [unit.strip("()[]{} ") for unit in units] or [""] * width) if lowest else None


def _with_first_row(text: str, width: int) -> list[str]:
    """The names in a line of names with the first row behind them, where a line break is missing: ``t,u,y0.00,1,2``."""
    cells = cells_of(text)
    last = _NAME_AND_NUMBER.fullmatch(cells[width - 1]) if len(cells) == 2 * width - 1 else None
    if last is None or any(map(is_number, cells[: width - 1])) or not all(map(is_number, cells[width:])):
        return []
    return [*cells[: width - 1], last[1]]


def _commented_header(comments: Sequence[_Line], first: int, separator: str, width: int) -> _Header | None:
    """The names in the comment directly above line ``first`` of the file (``# t u y``), or above one of units."""

    def cells(number: int) -> list[str]:
        text = next((comment.text for comment in comments if comment.number == number), "")
        text = re.sub(r"^\s*[#%]+\s*", "", text).rstrip()
        (text,) = _with_marks([number], [text if separator == ";" else text.removesuffix(";")], separator)
        found = _shortened(text, width)
        return found if _are_names(found, width) else []

    nearest, above = cells(first - 1), cells(first - 2)
    if nearest and above and all(map(_is_unit, nearest)):
        return _Header(None, above, [unit.strip("()[]{} ") for unit in nearest])
    return _Header(None, nearest, [""] * width) if nearest else None


def _shortened(text: str, width: int) -> list[str]:
    """The cells of a line without empty ones beyond ``width``."""
    cells = cells_of(text)
    while len(cells) > width and not cells[-1]:
        cells.pop()
    return cells


def _are_names(cells: Sequence[str], width: int) -> bool:
    return len(cells) == width and any(cells) and not any(map(is_number, cells))


def _is_unit(cell: str) -> bool:
    return not cell or cell == "-" or known_unit(cell) != "" or _BRACKETED.fullmatch(cell) is not None


def _distinct(names: Sequence[str]) -> list[str]:
    """Names with blanks filled by the column number and repetitions by a counter: ``u``, ``u_2``."""
    result: dict[str, None] = {}
    counts = Counter[str]()
    for k, name in enumerate(names):
        base = unique = name or f"c{k + 1}"
        while unique in result:
            counts[base] += 1
            unique = f"{base}_{counts[base] + 1}"
        result[unique] = None
    return list(result)


_TIMED = re.compile(r"\s*(\d{1,2}:\d{2}:\d{2}(?:\.\d+)?)\s*-?>[ \t]*(.*)")
_STAMPED = re.compile(
    r"""[^\d=:]*
        (?P<time>(?:\d{4}-\d{2}-\d{2}[T ])?\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?|\d+\.\d+)(?=[\])\s:,-])
        [^=]*?(?:[\])]:?|:|\s-)\s+
        (?P<rest>[^\W\d][^\s:=]*\s*[:=].*)""",
    re.VERBOSE,
)
_IN_BRACKETS = re.compile(r"\s*[\[({]+([^\[\](){}:=]*)[\])}]+\s*[,;]?\s*")
_LABELLED = re.compile(
    r"""\s*"?(?P<label>[^\W\d][^\s":=,;]*(?:[ ][^\s"\d:=,;][^\s":=,;]*)*)"?\s*[:=]\s*
        (?P<value>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?nan|[+-]?inf)
        (?:[ ]?(?P<unit>[^\s\d":=,;+-][^\s":=,;]*)(?=[ ]*(?:[,;\t]|$)))?
        \s*(?:[,;]|(?=\s)|$)""",
    re.VERBOSE | re.IGNORECASE,
)


class MonitorLines(NamedTuple):
    """The lines of a file, as far as a serial monitor wrote them.

    Attributes:
        texts: every line, with tabs between its values where it had labels, and without its time.
        times: the time of each line; empty where lines have none.
        labels: before the values of a line; empty where there are none.
        units: behind them, empty where there is none.
    """

    texts: list[str]
    times: list[str]
    labels: tuple[str, ...]
    units: tuple[str, ...]


def monitor_lines(texts: Sequence[str]) -> MonitorLines:
    """The lines of a file, without what a serial monitor adds; unchanged where they are from none.

    A line that has no such time, or other labels than most, is left as it is.
    """
    texts = list(texts)
    times: list[str] = []
    last = texts[-LAST_LINES:]
    for form in (_TIMED, _STAMPED):
        if not times and 2 * sum(form.fullmatch(text) is not None for text in last) > len(last):
            timed = [form.fullmatch(text) for text in texts]
            times = [found[1].replace(",", ".") if found else "" for found in timed]
            texts = [found[2] if found else text for found, text in zip(timed, texts, strict=True)]
    if 2 * sum(_IN_BRACKETS.fullmatch(text) is not None for text in last) > len(last):
        texts = [found[1] if (found := _IN_BRACKETS.fullmatch(text)) else text for text in texts]
    labels, count = Counter(_labels(_labelled(text)) for text in texts[-LAST_LINES:]).most_common(1)[0]
    if not labels or 2 * count <= len(last):
        return MonitorLines(texts, times, (), ())
    units = [""] * len(labels)
    for k, text in enumerate(texts):
        row = _labelled(text)
        if _labels(row) == labels:
            texts[k] = "\t".join(found["value"] for found in row)
            units = [known or found["unit"] or "" for known, found in zip(units, row, strict=True)]
    return MonitorLines(texts, times, labels, tuple(units))


def _labelled(text: str) -> list[re.Match[str]]:
    """Every label with its value in a line; nothing where something else is in the line."""
    text = text.strip().removeprefix("{").removesuffix("}")
    found: list[re.Match[str]] = []
    while not found or found[-1].end() < len(text):
        each = _LABELLED.match(text, found[-1].end() if found else 0)
        if each is None:
            return []
        found.append(each)
    return found


def _labels(row: Sequence[re.Match[str]]) -> tuple[str, ...]:
    return tuple(found["label"] for found in row)


def labelled(texts: Sequence[str], start: int, width: int) -> tuple[int, list[str], list[str]] | None:
    """The first of such lines, the names and the units; None where there are none.

    Args:
        texts: the lines, with marks between cells.
        start: the first line with data.
        width: the number of its cells.
    """
    found: dict[re.Pattern[str], tuple[int, list[str]]] = {}
    for k in range(start - 1, max(start - 1 - _MOST_LABELS, -1), -1):
        cells = cells_of(texts[k])[:width]
        label = next((each for each in (_NAME_LABELS, _UNIT_LABELS) if each.fullmatch(cells[0].rstrip(": "))), None)
        if label is not None and label not in found and len(cells) == width and not any(map(is_number, cells)):
            found[label] = k, cells
    first = cells_of(texts[start])[0]
    if _NAME_LABELS not in found or not (is_number(first) or is_missing(first)):
        return None
    at, names = found[_NAME_LABELS]
    _, units = found.get(_UNIT_LABELS, (at, [""] * width))
    times = [k for k, name in enumerate(names) if name == names[0]]
    if len(times) == 1 and _UNIT_LABELS not in found:  # a table with a column that is called so
        return None
    return (
        at,
        [TIME if k in times else name for k, name in enumerate(names)],
        ["" if k in times else unit for k, unit in enumerate(units)],
    )
