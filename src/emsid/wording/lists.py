"""Parts of sentences: names in lists and as arguments, times, chances, and how sure a finding is."""

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


SMALLEST = 1e-16
"""A smaller chance says no more than this one, and a test is not that exact."""


def chance(p: float) -> str:
    """A chance, for the sign after its name.

    >>> chance(0.0312), chance(4e-126)
    ('= 0.031', '< 1e-16')
    """
    return f"= {p:.2g}" if p >= SMALLEST else f"< {SMALLEST:g}"


def short(value: float) -> str:
    """A number of three digits; thousands are written out.

    >>> short(12345.6), short(0.123456)
    ('12300', '0.123')
    """
    rounded = float(f"{value:.3g}")
    return f"{rounded:.0f}" if 1e3 <= abs(rounded) < 1e6 else f"{rounded:.3g}"


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


def how_sure(confidence: float) -> str:
    """A confidence from 0 to 1 as an adverb.

    >>> how_sure(0.95), how_sure(0.75), how_sure(0.5), how_sure(0.2)
    ('almost certainly', 'likely', 'possibly', 'perhaps')
    """
    for least, word in ((0.9, "almost certainly"), (0.65, "likely"), (0.4, "possibly")):
        if confidence >= least:
            return word
    return "perhaps"
