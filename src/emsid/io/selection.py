"""The rows of a file that a record is made of: those selected, without those left out by a mask or as damaged.

**Masks** are conditions on the columns of a file that select the samples to leave out of a record. A mask has the
syntax of SQL: ``abs(PWM) > 255``, ``state = 'IDLE' OR "Speed (rpm)" IS NULL``. It is never run as a program. Its tokens
are translated to the syntax of Python (``=`` becomes ``==``, every name a placeholder). Python's parser makes a syntax
tree of it. The node types that are listed here become a Polars expression; others are refused.

The time in which Polars plans an expression grows with the square of its depth. The operands of OR and AND are
therefore joined as a balanced tree.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, listed, some
from emsid.findings import Finding
from emsid.io.columns import MOST_SHOWN, Columns, DamagedRow, as_numbers, nearest
from emsid.units import called

if TYPE_CHECKING:
    import polars as pl

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


# --- masks ------------------------------------------------------------------------------------------------------------

_OF_A_VALUE = ("abs", "ceil", "exp", "floor", "isfinite", "isnan", "ln", "log10", "round", "sign", "sqrt")
_OF_ALL_ROWS = ("avg", "max", "median", "min", "stddev")
_OF_SEVERAL = ("mod", "pow", "coalesce", "greatest", "least")
OVER_ALL_ROWS = re.compile(rf"\b({'|'.join(_OF_ALL_ROWS)})\s*\(", re.IGNORECASE)
"""In a mask, a function over all rows."""
FUNCTIONS = (*_OF_A_VALUE, *_OF_ALL_ROWS, *_OF_SEVERAL)
"""The functions that a mask may use: of a value, over all rows, of several values.

A missing value counts as NaN for ``isnan`` and ``isfinite``.
"""

MOST_TOKENS, MOST_OPERATORS, DEEPEST = 20_000, 100, 30
"""Limits on the length of a mask, on its operators between two ANDs or ORs, and on brackets in brackets."""

_PYTHON = {
    **{word: word for word in ("and", "or", "not", "is", "in")},
    "null": "None",
    "true": "True",
    "false": "False",
    "between": "is",
    "like": "in like",
    "=": "==",
    "<>": "!=",
}
"""The tokens that Python spells differently. ``x between a and b`` becomes ``x is a is b``."""

_TOKEN = re.compile(
    r"""(?P<space>\s+)
    | (?P<number>(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)(?!\w)
    | (?P<name>"[^"\\]+")(?!["'])
    | (?P<text>'[^'\\]*')(?!["'])
    | (?P<word>[^\W\d]\w*)(?!["'])(?P<call>\s*\((?!\s*\)))?
    | (?P<sign><=|>=|<>|!=|==|[=<>+*%(),]|-(?!-)|/(?!\*))""",
    re.VERBOSE,
)
_BINARY: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


class _NotUnderstood(Exception):
    """A part of the condition that masks do not allow."""


def left_out(mask: str, columns: Mapping[str, pl.Series]) -> NDArray[np.bool_]:
    """(N,) true where the condition ``mask`` is true, or cannot be evaluated because a value is missing.

    Args:
        mask: a condition; a name with other characters than letters, digits and ``_`` needs double quotes. A unit in
            brackets may be left out of a name.
        columns: every column of the file by name, equally long.

    Raises:
        DataError: where the condition has a wrong syntax, an unknown column, or a value that is not true or false.
    """
    import polars as pl

    text, values = _in_python(mask, columns)
    used = {f"v{k}": columns[name[1:]] for k, name in enumerate(values) if name.startswith('"')}
    frame = pl.DataFrame([_comparable(column).alias(name) for name, column in (used or columns).items()])
    try:
        tree = ast.parse(text, mode="eval")
        result = frame.select(_Expression(values).of(tree.body).alias("out"))["out"]
    except (Exception, pl.exceptions.PanicException) as problem:  # a panic of Polars is no Exception
        reason = "" if isinstance(problem, (SyntaxError, MemoryError, RecursionError)) else str(problem).strip()
        because = f" ({reason.partition(chr(10))[0]})" if reason else ""
        raise DataError(f"the mask {_shown(mask)} is not understood{because}; write it like abs(PWM) > 255") from None
    if result.dtype != pl.Boolean:
        raise DataError(f"the mask {_shown(mask)} is not true or false; write a condition like abs(PWM) > 255")
    out = result.fill_null(True).to_numpy()
    return np.broadcast_to(out, len(next(iter(columns.values())))) if len(out) == 1 else out


def _in_python(mask: str, columns: Mapping[str, pl.Series]) -> tuple[str, list[str]]:
    """The condition in Python's syntax, and the values of its placeholders ``v0``, ``v1``, ….

    The value of a text includes its quotes; that of a column begins with a double quote.

    Raises:
        DataError: for a wrong character, an unknown function or column, or a very long condition.
    """
    parts: list[str] = []
    values: dict[str, int] = {}
    depth = at = operators = 0
    between: list[int] = []  # depth in brackets of every BETWEEN without its AND so far
    while at < len(mask):
        token = _TOKEN.match(mask, at)
        if token is None:
            raise DataError(
                f"the mask {_shown(mask)} is not understood from {mask[at : at + 20]!r} on; write it like "
                "abs(PWM) > 255"
            )
        at = token.end()
        if token["space"]:
            continue
        word, text = token["word"], token[0]
        key = (word or text).lower()
        if token["call"] and key not in _PYTHON:
            if key not in FUNCTIONS:
                raise DataError(
                    f"the mask {_shown(mask)} uses a function {word!r}, which is none of {', '.join(FUNCTIONS)}; a "
                    f'column with brackets in its name goes into double quotes: "{word}(…)"'
                )
            parts.append(key)
        elif token["text"]:
            parts.append(f"(v{values.setdefault(text, len(values))})")
        elif token["name"] or (word and key not in _PYTHON):
            name = _column(mask, word or text[1:-1], columns)
            parts.append(f"v{values.setdefault(chr(34) + name, len(values))}")
        elif token["number"]:
            parts.append(text.lstrip("0") or "0" if text.isdigit() else text)
        elif key == "and" and between and between[-1] == depth:
            between.pop()
            parts.append("is")
        else:
            if key == "between":
                between.append(depth)
                if parts[-1:] == ["not"]:  # not is, is not
                    parts[-1:], key = ["is"], "not"
            operators = 0 if key in ("and", "or") else operators + (key not in ("(", ")", ",", "not"))
            parts.append(_PYTHON.get(key, key))
        opened = bool(token["call"]) or text == "("
        if token["call"]:
            parts.append("(")
        depth += opened - (text == ")")
        _check_size(mask, depth, len(parts), operators)
    if depth:
        raise DataError(f"the mask {_shown(mask)} is not understood: a bracket is not closed; write ')' at its end")
    return " ".join(parts), list(values)


def _column(mask: str, name: str, columns: Mapping[str, pl.Series]) -> str:
    """The column that a mask names, with or without its unit in brackets."""
    found = called(name, dict.fromkeys(columns, ""))
    if not found:
        raise DataError(
            f"the mask {_shown(mask)} uses {name!r}, which is no column{nearest(name, columns)}; there are "
            f"{some(columns)}"
        )
    if len(found) > 1:
        raise DataError(
            f"the mask {_shown(mask)} uses {name!r}, which is the name of several columns: {listed(found)}; give it "
            "with its unit, in double quotes"
        )
    return found[0]


def _check_size(mask: str, depth: int, tokens: int, operators: int) -> None:
    if depth < 0:
        raise DataError(f"the mask {_shown(mask)} is not understood: it closes a bracket that none has opened")
    if tokens > MOST_TOKENS or depth > DEEPEST:
        raise DataError(
            f"the mask {_shown(mask)} is too long: more than {MOST_TOKENS:,} names, numbers and operators, or "
            f"{DEEPEST} brackets in brackets; mark these samples in a column of their own and mask by that"
        )
    if operators > MOST_OPERATORS:
        raise DataError(
            f"the mask {_shown(mask)} has more than {MOST_OPERATORS} operators between two ANDs or ORs; divide it"
        )


class _Expression:
    """Translates nodes of a syntax tree to Polars expressions.

    Args:
        values: the values of the placeholders.
    """

    def __init__(self, values: Sequence[str]) -> None:
        self.values = values

    def of(self, node: ast.expr) -> Any:
        """The expression of a node.

        Raises:
            _NotUnderstood: for a node that masks do not allow.
        """
        import polars as pl

        match node:
            case ast.BoolOp():
                return _balanced([self.of(each) for each in node.values], isinstance(node.op, ast.And))
            case ast.UnaryOp(op=ast.Not()):
                return ~self.of(node.operand)
            case ast.UnaryOp(op=ast.USub()):
                return -self.of(node.operand)
            case ast.UnaryOp(op=ast.UAdd()):
                return self.of(node.operand)
            case ast.BinOp() if type(node.op) in _BINARY:
                return _BINARY[type(node.op)](self.of(node.left), self.of(node.right))
            case ast.Compare():
                return self._compared(node)
            case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS:
                return _function(name, [self.of(each) for each in node.args])
            case ast.Name(id=name) if re.fullmatch(r"v\d+", name):
                value = self.values[int(name[1:])]
                return pl.lit(value[1:-1]) if value.startswith("'") else pl.col(name)
            case ast.Constant(value=value):
                return pl.lit(value)
        raise _NotUnderstood

    def _compared(self, node: ast.Compare) -> Any:
        left = self.of(node.left)
        match node.ops, node.comparators:
            case [ast.Is() | ast.IsNot() as sign], [ast.Constant(value=None)]:
                return left.is_null() if isinstance(sign, ast.Is) else left.is_not_null()
            case [ast.Is() | ast.IsNot() as sign, ast.Is()], [low, high]:
                inside = left.is_between(self.of(low), self.of(high))
                return inside if isinstance(sign, ast.Is) else ~inside
            case [ast.In() | ast.NotIn() as sign], [choices]:
                among = self._among(left, choices)
                return among if isinstance(sign, ast.In) else ~among
        right = [self.of(comparator) for comparator in node.comparators]
        if not all(type(sign) in _BINARY for sign in node.ops):
            raise _NotUnderstood
        pairs = zip(node.ops, [left, *right[:-1]], right, strict=True)
        return _balanced([_BINARY[type(sign)](a, b) for sign, a, b in pairs], True)

    def _among(self, left: Any, choices: ast.expr) -> Any:
        """``left in (a, b, …)``, and ``left like 'pattern'``, which stands in the tree as ``left in like(…)``."""
        if isinstance(choices, ast.Call) and isinstance(choices.func, ast.Name) and choices.func.id == "like":
            (pattern,) = choices.args
            if not (isinstance(pattern, ast.Name) and self.values[int(pattern.id[1:])].startswith("'")):
                raise _NotUnderstood
            text = self.values[int(pattern.id[1:])][1:-1]
            signs = {"%": ".*", "_": "."}
            return left.str.contains("(?s)^" + "".join(signs.get(sign, re.escape(sign)) for sign in text) + "$")
        several = choices.elts if isinstance(choices, ast.Tuple) else [choices]
        return _balanced([left == self.of(each) for each in several], False)


def _function(name: str, given: list[Any]) -> Any:
    import polars as pl

    x = given[0]
    if name == "coalesce":
        return pl.coalesce(given)
    if name in ("greatest", "least"):
        return pl.max_horizontal(given) if name == "greatest" else pl.min_horizontal(given)
    if len(given) == 2 and name in ("mod", "pow"):
        return x % given[1] if name == "mod" else x.pow(given[1])
    if len(given) != 1 or name in _OF_SEVERAL:
        raise _NotUnderstood(f"{name} of {len(given)} values")
    match name:
        case "isnan":
            return x.is_nan().fill_null(True)
        case "isfinite":
            return x.is_finite().fill_null(False)
        case "round":
            return x.round(0)
    return getattr(x, {"ln": "log", "avg": "mean", "stddev": "std"}.get(name, name))()


def _balanced(parts: Sequence[Any], every: bool) -> Any:
    """All operands joined by AND or OR as a balanced tree."""
    joined = list(parts)
    while len(joined) > 1:
        pairs = [joined[k : k + 2] for k in range(0, len(joined), 2)]
        joined = [reduce(operator.and_ if every else operator.or_, pair) for pair in pairs]
    return joined[0]


def _shown(mask: str) -> str:
    return repr(mask if len(mask) <= 200 else f"{mask[:200]}…")


def _comparable(column: pl.Series) -> pl.Series:
    """The column as real numbers if it contains numbers of any type; text stays text."""
    import polars as pl

    if column.dtype == pl.String:
        numbers = column.cast(pl.Float64, strict=False)
        return numbers if 2 * numbers.null_count() < len(column) + column.null_count() else column
    return column.cast(pl.Float64) if column.dtype.is_numeric() else column
