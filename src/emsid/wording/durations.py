"""Times in a sentence."""

from __future__ import annotations


def duration(seconds: float) -> str:
    """A time in s or ms.

    >>> duration(0.0105), duration(33.2)
    ('10.5 ms', '33.2 s')
    """
    return f"{1e3 * seconds:.3g} ms" if abs(seconds) < 1 else f"{seconds:.3g} s"


def sample_time(seconds: float) -> str:
    """A sample time in s or ms, with all the digits that a user gives.

    >>> sample_time(0.010048), sample_time(2.0)
    ('10.048 ms', '2 s')
    """
    return f"{1e3 * seconds:g} ms" if abs(seconds) < 1 else f"{seconds:g} s"
