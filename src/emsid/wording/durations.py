"""Times in a sentence."""

from __future__ import annotations


def duration(seconds: float) -> str:
    """A time in s or ms.

    >>> duration(0.0105), duration(33.2)
    ('10.5 ms', '33.2 s')
    """
    return f"{1e3 * seconds:.3g} ms" if abs(seconds) < 1 else f"{seconds:.3g} s"
