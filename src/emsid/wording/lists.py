"""Names in a sentence: lists of them, and names in an argument."""

from __future__ import annotations

from collections.abc import Sequence
from shlex import quote

from emsid.errors import listed

LISTED = 4
"""List at most this many names, and one more where only one is left."""


NOT_SHOWN = "not shown by these data"
"""Of a quantity whose threshold, direction or speed the record never approaches."""


def shortened(texts: Sequence[str], between: str = ", ") -> str:
    """Join texts; of a long list, give the first few and the number of the others.

    >>> shortened(["a", "b"]), shortened(list("abcdefg"))
    ('a, b', 'a, b, c, d and 3 more')
    """
    if len(texts) <= LISTED + 1:  # "and 1 more" would be no shorter
        return between.join(texts)
    return f"{between.join(texts[:LISTED])} and {len(texts) - LISTED} more"


__all__ = ["listed", "shortened"]


def assigned(name: str, value: str) -> str:
    """The value of an argument for a column, as it is typed on a command line.

    >>> assigned("u", "-1"), assigned("Voltage (V)", "-1")
    ('u=-1', "'Voltage (V)=-1'")
    """
    text = f"{name}={value}"
    return text if quote(name) == name else quote(text)


def ordinal(number: int) -> str:
    """A whole number as an ordinal.

    >>> [ordinal(k) for k in (1, 2, 3, 4, 11, 12, 22)]
    ['1st', '2nd', '3rd', '4th', '11th', '12th', '22nd']
    """
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
