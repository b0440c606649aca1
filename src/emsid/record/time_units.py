"""Units of a time column: from what is given, from the end of its name, or from the function that it is named after."""

from __future__ import annotations

import re

from emsid.errors import DataError

SECONDS = {
    "ns": 1e-9,
    "us": 1e-6,
    "µs": 1e-6,  # the micro sign
    "μs": 1e-6,  # the Greek letter
    "ms": 1e-3,
    "msec": 1e-3,
    "s": 1.0,
    "sec": 1.0,
    "seconds": 1.0,
    "min": 60.0,
    "h": 3600.0,
}
CLOCK_NAMES = {"millis": "ms", "micros": "us"}
"""Units of columns that are called like the function of a board that they come from."""
UNIT_IN_NAME = re.compile(r"[\s_]*(?:[(\[{]\s*(?P<bracketed>[^)\]}]+?)\s*[)\]}]|_(?P<suffix>ns|us|ms|s))$")
_RATE = re.compile(r"(\d+(?:\.\d+)?(?:e[+-]?\d+)?)\s*([kM]?)Hz")
"""Of ticks that a time column counts."""


def seconds_in_unit(column: str, given: str | None = None, stated: str = "") -> float:
    """Seconds in one unit of a time column; one in which nothing says a unit is in seconds.

    >>> seconds_in_unit("t"), seconds_in_unit("time_ms"), seconds_in_unit("Timestamp(us)"), seconds_in_unit("t", "min")
    (1.0, 0.001, 1e-06, 60.0)

    Args:
        column: its name.
        given: the unit that the user gives.
        stated: the one that the file states elsewhere.

    Raises:
        DataError: for a unit that is given and not one of time.
    """
    if given is not None:
        if given not in SECONDS and not _RATE.fullmatch(given):
            known = ", ".join(SECONDS)
            raise DataError(f"time unit {given!r} is not understood; give one of {known}, or a rate, 8kHz")
        return seconds_of(given)
    written = UNIT_IN_NAME.search(column)
    in_name = written["bracketed"] or written["suffix"] if written else CLOCK_NAMES.get(column.lower(), "s")
    return SECONDS.get(stated or in_name, 1.0)


def seconds_of(unit: str) -> float:
    """Seconds in a unit, or in a tick of a rate; one in which it is unknown.

    >>> seconds_of("ms"), seconds_of("8kHz"), seconds_of("")
    (0.001, 0.000125, 1.0)
    """
    rate = _RATE.fullmatch(unit)
    if rate is None or not float(rate[1]):
        return SECONDS.get(unit, 1.0)
    return 1 / (float(rate[1]) * {"": 1.0, "k": 1e3, "M": 1e6}[rate[2]])
