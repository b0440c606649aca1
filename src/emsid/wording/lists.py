"""Lists of names in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.errors import listed

MOST = 4
"""List at most this many names, and one more where only one is left."""


def shortened(texts: Sequence[str], between: str = ", ", last: str = " and ") -> str:
    """Join texts; of a long list, give the first few and the number of the others.

    >>> shortened(["a", "b"]), shortened(list("abcdefg"))
    ('a, b', 'a, b, c, d and 3 more')
    """
    if len(texts) <= MOST + 1:  # "and 1 more" would be no shorter
        return between.join(texts)
    return f"{between.join(texts[:MOST])}{last}{len(texts) - MOST} more"


__all__ = ["listed", "shortened"]
