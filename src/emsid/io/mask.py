"""Masks: conditions on the columns of a file that select the samples to leave out of a record.

A mask has the syntax of SQL: ``abs(PWM) > 255``, ``state = 'IDLE' OR "Speed (rpm)" IS NULL``. It is never run as a
program. Its tokens are translated to the syntax of Python (``=`` becomes ``==``, every name a placeholder). Python's
parser makes a syntax tree of it. The node types that are listed here become a Polars expression; others are refused.

The time in which Polars plans an expression grows with the square of its depth. The operands of OR and AND are
therefore joined as a balanced tree.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, listed, some
from emsid.io.columns import nearest
from emsid.units import called

if TYPE_CHECKING:
    import polars as pl

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
