"""Times in a sentence."""

from __future__ import annotations


def duration(seconds: float) -> str:
    """A time in s, ms or µs.

    >>> duration(0.0105), duration(33.2), duration(2e-5)
    ('10.5 ms', '33.2 s', '20 µs')
    """
    factor, unit = _unit(seconds)
    return f"{factor * seconds:.3g} {unit}"


def sample_time(seconds: float) -> str:
    """A sample time in s, ms or µs, with all the digits that a user gives.

    >>> sample_time(0.010048), sample_time(2.0), sample_time(2e-5)
    ('10.048 ms', '2 s', '20 µs')
    """
    factor, unit = _unit(seconds)
    return f"{factor * seconds:g} {unit}"


def _unit(seconds: float) -> tuple[float, str]:
    """The unit for a time, and how many of it are in a second."""
    if abs(seconds) >= 1:
        return 1.0, "s"
    return (1e3, "ms") if abs(seconds) >= 1e-3 or not seconds else (1e6, "µs")
