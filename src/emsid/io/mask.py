"""Masks: the samples to leave out of a record, said by an SQL condition on the columns of the file.

``abs(PWM) > 255``, ``state = 'IDLE' OR "Speed (rpm)" IS NULL``. The condition is evaluated by polars, but its
SQL could also open files (``… IN (SELECT … FROM read_csv('…'))``). So the text is first taken apart here,
completely, and only plain words, numbers, quoted names and texts, operators and the functions listed below
are let through.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.io.columns import nearest

if TYPE_CHECKING:
    import polars as pl

FUNCTIONS = (
    *("abs", "ceil", "exp", "floor", "ln", "log10", "mod", "pow", "round", "sign", "sqrt"),
    *("avg", "max", "median", "min", "stddev"),
    *("coalesce", "greatest", "least"),
)
"""The functions that a mask may use: of a value, over all rows, of several values."""

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
        mask: an SQL condition; names with anything but letters, digits and ``_`` in them go into double
            quotes.
        columns: every column of the file by name, equally long.

    Raises:
        DataError: where the condition cannot be understood, names no column, or is not true or false.
    """
    import polars as pl

    _check(mask, columns)
    frame = pl.DataFrame([_comparable(column).alias(name) for name, column in columns.items()])
    try:
        result = frame.select(pl.sql_expr(mask).alias("out"))["out"]
    except (Exception, pl.exceptions.PanicException) as problem:  # a panic of the parser is no Exception
        reason = str(problem).strip().partition("\n")[0]
        raise DataError(f"the mask {mask!r} is not understood ({reason}); write it like abs(PWM) > 255") from None
    if result.dtype != pl.Boolean:
        raise DataError(f"the mask {mask!r} is not true or false; write a condition like abs(PWM) > 255")
    out = result.fill_null(True).to_numpy()
    return np.broadcast_to(out, frame.height) if len(out) == 1 else out


def _check(mask: str, columns: Mapping[str, pl.Series]) -> None:
    """Refuse what is not a plain condition on ``columns``."""
    at = 0
    while at < len(mask):
        token = _TOKEN.match(mask, at)
        if token is None:
            raise DataError(
                f"the mask {mask!r} is not understood from {mask[at : at + 20]!r} on; write it like abs(PWM) > 255"
            )
        at = token.end()
        word, quoted = token["word"], token["name"]
        if word and token["call"]:
            if word.lower() not in {*FUNCTIONS, *_WORDS}:
                raise DataError(
                    f"the mask {mask!r} uses a function {word!r}, which is none of {', '.join(FUNCTIONS)}; a column "
                    f'with brackets in its name goes into double quotes: "{word}(…)"'
                )
        elif quoted or (word and word.lower() not in _WORDS):
            name = word or quoted[1:-1]
            if name not in columns:
                raise DataError(
                    f"the mask {mask!r} uses {name!r}, which is no column{nearest(name, columns)}; there are "
                    f"{', '.join(columns)}"
                )


def _comparable(column: pl.Series) -> pl.Series:
    """The column as real numbers where it holds any kind of them, or mostly; text stays text."""
    import polars as pl

    if column.dtype == pl.String:
        numbers = column.cast(pl.Float64, strict=False)
        return numbers if 2 * numbers.null_count() < len(column) + column.null_count() else column
    return column.cast(pl.Float64) if column.dtype.is_numeric() else column
