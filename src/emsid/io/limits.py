"""What a file may ask for, checked before anything is computed from it.

Model files, motors and datasheets are small. One that asks for a filter of order 3,000, or that holds an integer of
5,000 digits, was damaged or made to harm; it is refused here, at the door, whatever the classes behind it would do.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import isfinite

from emsid.errors import ModelError

LARGEST = 1e100
"""No number is larger."""
MOST_ENTRIES, DEEPEST, LONGEST = 50_000, 12, 2_000
"""Entries in all, tables in tables, signs in a text."""
MOST_DIGITS = 310
"""Digits in a row within a text: those of the largest floating-point number written out."""
MOST: Mapping[str, int] = {
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
"""By name: the most that a whole number may be, or the most entries that a list may have."""
MOST_CHANNEL, MOST_LAG = 100, 100_000
"""In the text of a regressor: inputs, and samples back."""

_DIGITS = re.compile(rf"\d{{{MOST_DIGITS + 1},}}")
_CHANNEL = re.compile(r"\bu(\d+)\(|\(t-(\d+)\)")


def check_limits(data: object, what: str = "the file", most: Mapping[str, int] = MOST) -> None:
    """Refuse built-in types that are deeper, longer or larger than any model is.

    Args:
        data: what the file holds.
        what: it is, for the message.
        most: by name, what a whole number may be, or how many entries a list may have.

    Raises:
        ModelError: that names the entry.
    """
    waiting: list[tuple[object, str, str, int]] = [(data, "", "", 0)]  # with where it stands, its key and depth
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
            waiting += [(inner, f"{where}.{key}".lstrip("."), key, depth + 1) for key, inner in value.items()]
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
        shown = f"{value:g}" if isinstance(value, float) else "an integer of very many digits"
        raise ModelError(f"{where} is {shown}; give a finite number of at most {LARGEST:g}")
    if most is not None and value > most:
        raise ModelError(f"{where} is {value:g}; it can be at most {most:,}")


def _check_text(text: str, where: str) -> None:
    if len(text) > LONGEST or _DIGITS.search(text):
        raise ModelError(
            f"{where} holds a text of {len(text)} signs; at most {LONGEST:,} are read, {MOST_DIGITS} digits"
        )
    for found in _CHANNEL.finditer(text.replace(" ", "")):
        number, most = (found[1], MOST_CHANNEL) if found[1] else (found[2], MOST_LAG)
        if int(number) > most:
            raise ModelError(f"{where}: {text[:80]!r} has {int(number):g}; it can be at most {most:,}")
