"""Masks: the samples to leave out of a record, said by an SQL condition on the columns of the file.

``abs(PWM) > 255``, ``state = 'IDLE' OR "Speed (rpm)" IS NULL``. The condition is evaluated by polars, but its SQL could
also open files (``… IN (SELECT … FROM read_csv('…'))``). So the text is first taken apart here, completely, and only
plain words, numbers, quoted names and texts, operators and the functions listed below are let through.

polars plans an expression in a time that grows with the square of its depth, and ``a OR b OR c OR …`` is as deep as it
is long. So conditions are divided here at their ORs and ANDs, and put together as a balanced tree.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.io.columns import nearest

if TYPE_CHECKING:
    import polars as pl

FUNCTIONS = (
    *("abs", "ceil", "exp", "floor", "isfinite", "isnan", "ln", "log10", "mod", "pow", "round", "sign", "sqrt"),
    *("avg", "max", "median", "min", "stddev"),
    *("coalesce", "greatest", "least"),
)
"""The functions that a mask may use: of a value, over all rows, of several values.

A missing value counts as NaN for ``isnan`` and ``isfinite``, which know nothing else of it: they are always true or
false.
"""

# Nobody writes more by hand, and a list goes after IN: parts of a mask, operators in a condition between ANDs and ORs
# (these form a chain that is as deep as long), brackets in brackets.
MOST_TOKENS, MOST_OPERATORS, DEEPEST = 20_000, 100, 30

# In polars NaN is greater than infinity, which SQL has no word for.
_INSTEAD = {"isnan": ("coalesce((", ") > exp(1000), true)"), "isfinite": ("coalesce(abs(", ") < exp(1000), false)")}
_WORDS = {"and", "or", "not", "is", "null", "between", "in", "like", "true", "false"}
_TOKEN = re.compile(
    r"""(?P<space>\s+)
    | (?P<number>(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)(?!\w)
    | (?P<name>"[^"\\]+")(?!["'])
    | (?P<text>'[^'\\]*')(?!["'])
    | (?P<word>[^\W\d]\w*)(?!["'])(?P<call>\s*\((?!\s*\)))?
    | (?P<sign><=|>=|<>|!=|==|[=<>+*%(),]|-(?!-)|/(?!\*))""",
    re.VERBOSE,
)


def left_out(mask: str, columns: Mapping[str, pl.Series]) -> NDArray[np.bool_]:
    """(N,) true where the condition ``mask`` holds, or cannot be told because a value is missing.

    Args:
        mask: an SQL condition; names with anything but letters, digits and ``_`` in them go into double quotes.
        columns: every column of the file by name, equally long.

    Raises:
        DataError: where the condition cannot be understood, names no column, or is not true or false.
    """
    import polars as pl

    tokens = _taken_apart(mask, columns)
    frame = pl.DataFrame([_comparable(column).alias(name) for name, column in columns.items()])
    try:
        result = frame.select(_condition(tokens).alias("out"))["out"]
    except DataError as problem:
        raise DataError(f"the mask {_shown(mask)} {problem}") from None
    except (Exception, pl.exceptions.PanicException) as problem:  # a panic of the parser is no Exception
        reason = str(problem).strip().partition("\n")[0]
        raise DataError(f"the mask {_shown(mask)} is not understood ({reason}); write it like abs(PWM) > 255") from None
    if result.dtype != pl.Boolean:
        raise DataError(f"the mask {_shown(mask)} is not true or false; write a condition like abs(PWM) > 255")
    out = result.fill_null(True).to_numpy()
    return np.broadcast_to(out, frame.height) if len(out) == 1 else out


class _Token(NamedTuple):
    text: str
    word: str = ""  # in lower case, of one that is neither name nor number nor text
    opens: int = 0  # 1 for an opening bracket or a function with it, −1 for a closing one


def _taken_apart(mask: str, columns: Mapping[str, pl.Series]) -> list[_Token]:
    """The parts of a plain condition on ``columns``; anything else is refused."""
    tokens: list[_Token] = []
    closings: list[str] = []  # of the brackets that are open
    at = 0
    while at < len(mask):
        token = _TOKEN.match(mask, at)
        if token is None:
            raise DataError(
                f"the mask {_shown(mask)} is not understood from {mask[at : at + 20]!r} on; write it like "
                "abs(PWM) > 255"
            )
        at = token.end()
        word, quoted, text = token["word"], token["name"], token[0]
        if word and token["call"]:
            function = word.lower()
            if function not in {*FUNCTIONS, *_WORDS}:
                raise DataError(
                    f"the mask {_shown(mask)} uses a function {word!r}, which is none of {', '.join(FUNCTIONS)}; a "
                    f'column with brackets in its name goes into double quotes: "{word}(…)"'
                )
            if function in _WORDS:  # AND (…), IN (…)
                tokens.append(_Token(word, function))
                text = "("
            opening, closing = _INSTEAD.get(function, (text, ")"))
            closings.append(closing)
            tokens.append(_Token(opening, opens=1))
        elif quoted or (word and word.lower() not in _WORDS):
            name = word or quoted[1:-1]
            if name not in columns:
                raise DataError(
                    f"the mask {_shown(mask)} uses {name!r}, which is no column{nearest(name, columns)}; there are "
                    f"{', '.join(columns)}"
                )
            tokens.append(_Token(text))
        elif text == "(":
            closings.append(")")
            tokens.append(_Token(text, opens=1))
        elif text == ")" and closings:
            tokens.append(_Token(closings.pop(), opens=-1))
        elif text == ")":
            raise DataError(f"the mask {_shown(mask)} is not understood: it closes a bracket that none has opened")
        elif not token["space"]:
            tokens.append(_Token(text, (word or token["sign"] or "").lower()))
        if len(tokens) > MOST_TOKENS or len(closings) > DEEPEST:
            raise DataError(
                f"the mask {_shown(mask)} is too long: more than {MOST_TOKENS:,} names, numbers and signs, or "
                f"{DEEPEST} brackets in brackets; mark these samples in a column of their own and mask by that"
            )
    if closings:
        raise DataError(f"the mask {_shown(mask)} is not understood: a bracket is not closed; write ')' at its end")
    return tokens


def _condition(tokens: Sequence[_Token]) -> pl.Expr:
    """The condition, no deeper than its brackets and the logarithm of its length."""
    import polars as pl

    for word, joined in (("or", operator.or_), ("and", operator.and_)):
        parts = _divided(tokens, word)
        if len(parts) > 1:
            return _balanced([_condition(part) for part in parts], joined)
    nots = next((k for k, token in enumerate(tokens) if token.word != "not"), len(tokens))
    if nots:
        condition = _condition(tokens[nots:])
        return ~condition if nots % 2 else condition
    if _is_bracketed(tokens):
        return _condition(tokens[1:-1])
    if sum(bool(token.word) and token.word != "," for token in tokens) > MOST_OPERATORS:
        raise DataError(f"has more than {MOST_OPERATORS} operators between two ANDs or ORs; divide it")
    text = " ".join(token.text for token in tokens)
    return pl.sql_expr(f"({text})" if text else "")


def _divided(tokens: Sequence[_Token], word: str) -> list[Sequence[_Token]]:
    """The tokens between those that are this word and in no bracket; the AND of a BETWEEN does not divide."""
    parts, begin, depth, between = [], 0, 0, False
    for k, token in enumerate(tokens):
        depth += token.opens
        if depth or not token.word:
            continue
        if token.word == word and not (between and word == "and"):
            parts.append(tokens[begin:k])
            begin = k + 1
        between = token.word == "between" or (between and token.word != "and")
    return [*parts, tokens[begin:]]


def _is_bracketed(tokens: Sequence[_Token]) -> bool:
    """Whether the first bracket, which is no function's, closes at the very end."""
    if not (tokens and tokens[0].text == "("):
        return False
    depths = list(accumulate(token.opens for token in tokens))
    return 0 not in depths[:-1] and depths[-1] == 0


def _balanced(parts: Sequence[pl.Expr], joined: Callable[[pl.Expr, pl.Expr], pl.Expr]) -> pl.Expr:
    if len(parts) == 1:
        return parts[0]
    half = len(parts) // 2
    return joined(_balanced(parts[:half], joined), _balanced(parts[half:], joined))


def _shown(mask: str) -> str:
    return repr(mask if len(mask) <= 200 else f"{mask[:200]}…")


def _comparable(column: pl.Series) -> pl.Series:
    """The column as real numbers where it holds any kind of them, or mostly; text stays text."""
    import polars as pl

    if column.dtype == pl.String:
        numbers = column.cast(pl.Float64, strict=False)
        return numbers if 2 * numbers.null_count() < len(column) + column.null_count() else column
    return column.cast(pl.Float64) if column.dtype.is_numeric() else column
