"""Limits on numbers and sizes in files, checked before anything is computed from them.

Model files, motors and datasheets are small. A file with a filter of order 3,000 or an integer of 5,000 digits is
damaged or malicious, and is refused here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import isfinite

from emsid.errors import ModelError

LARGEST = 1e100
"""The largest absolute value of a number."""
MOST_ENTRIES, DEEPEST, LONGEST = 50_000, 12, 2_000
"""Limits on the total number of entries, the depth of nested tables, and the characters of a text."""
MOST_DIGITS = 310
"""Limit on consecutive digits in a text: as many as the largest floating-point number has."""
LIMITS: Mapping[str, int] = {
    "blocks": 16,
    "codes": 1_000,
    "delay": 100_000,
    "denominator": 100,
    "inputs": 100,
    "numerator": 100,
    "oversampling": 64,
    "regressors": 5_000,
    "signals": 16,
    "steps": 1_000,
}
"""By name: the largest whole number, or the largest number of entries of a list."""
MOST_CHANNEL, MOST_LAG = 100, 100_000
"""Inputs and lags in the text of a regressor."""

_DIGITS = re.compile(rf"\d{{{MOST_DIGITS + 1},}}")
_CHANNEL = re.compile(r"\bu(\d+)\(|\(t-(\d+)\)")


def check_limits(data: object, what: str = "the file", most: Mapping[str, int] = LIMITS) -> None:
    """Refuse built-in types that are deeper, longer or larger than any model is.

    Args:
        data: the content of the file.
        what: its name in messages.
        most: by name, the largest whole number, or the largest number of entries of a list.

    Raises:
        ModelError: that names the entry.
    """
    waiting: list[tuple[object, str, str, int]] = [(data, "", "", 0)]  # with its path, key and depth
    entries = 0
    while waiting:
        value, where, name, depth = waiting.pop()
        entries += 1
        if entries > MOST_ENTRIES or depth > DEEPEST:
            raise ModelError(
                f"{what} has more than {MOST_ENTRIES:,} entries, or more than {DEEPEST} tables in tables; no model does"
            )
        if name in most and (isinstance(value, (bool, float)) or not isinstance(value, (int, list, tuple))):
            raise ModelError(f"{where} is {value!r:.80}; give a whole number or a list")
        if isinstance(value, Mapping):
            table = name == "parameters"  # of a plant: numbers by name, such as a delay in s
            waiting += [
                (inner, f"{where}.{key}".lstrip("."), "" if table else key, depth + 1) for key, inner in value.items()
            ]
            waiting += [(key, where, "", depth + 1) for key in value]
        elif isinstance(value, str):
            _check_text(value, where or what)
        elif isinstance(value, Sequence):
            if len(value) > most.get(name, MOST_ENTRIES):
                raise ModelError(f"{where} has {len(value)} entries; at most {most.get(name, MOST_ENTRIES)} are read")
            waiting += [(inner, where, "", depth + 1) for inner in value]
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            _check_number(value, where or what, most.get(name))


def _check_number(value: float, where: str, most: int | None) -> None:
    if abs(value) > LARGEST or not isfinite(value):  # a comparison with an integer of any length is exact
        given = f"{value:g}" if isinstance(value, float) else "an integer of very many digits"
        raise ModelError(f"{where} is {given}; give a finite number of at most {LARGEST:g}")
    if most is not None and value > most:
        raise ModelError(f"{where} is {value:g}; it can be at most {most:,}")


def _check_text(text: str, where: str) -> None:
    if len(text) > LONGEST or _DIGITS.search(text):
        raise ModelError(
            f"{where} is a text of {len(text)} characters; at most {LONGEST:,} are read, {MOST_DIGITS} digits"
        )
    for found in _CHANNEL.finditer(text.replace(" ", "")):
        number, most = (found[1], MOST_CHANNEL) if found[1] else (found[2], MOST_LAG)
        if int(number) > most:
            raise ModelError(f"{where}: {text[:80]!r} has {int(number):g}; it can be at most {most:,}")
