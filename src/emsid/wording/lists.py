"""Lists of names in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.errors import listed

MOST = 4
"""More names than this are counted and not listed, unless there is only one more."""


def shortened(texts: Sequence[str], between: str = ", ", last: str = " and ") -> str:
    """The texts one after the other; of many the first few and how many more there are.

    >>> shortened(["a", "b"]), shortened(list("abcdefg"))
    ('a, b', 'a, b, c, d and 3 more')
    """
    if len(texts) <= MOST + 1:  # "and 1 more" would be no shorter
        return between.join(texts)
    return f"{between.join(texts[:MOST])}{last}{len(texts) - MOST} more"


__all__ = ["listed", "shortened"]
