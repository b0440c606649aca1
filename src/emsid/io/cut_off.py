r"""Text files that are cut off in their last line, as the log of a program that was ended, or of a full disk, is.

Such a line has no end, and is the beginning of a line like those above it. With every number replaced by one sign, that
is a proper beginning of the form of one of them, and the form of none: ``12:00:05.9 -> u:3, y:`` under
``12:00:05.8 -> u:2, y:29.0``. Where all lines above have as many decimals, one with fewer decimals is cut off as well.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emsid.io.columns import Columns

MOST_LINES, MOST_BYTES = 100, 1 << 20
"""The lines above the last one that it is compared with, and how many bytes they may have."""
_WIDE = (b"\xff\xfe", b"\xfe\xff")
_DECIMALS, _COMMA = re.compile(rb"(?<=\d)\.\d*"), re.compile(rb"(?<=\d),\d*")
"""Decimals behind a point, or behind a comma where semicolons are between the cells."""
_NUMBER = re.compile(rb"[-+]?\d+")


def without_cut_line(content: bytes) -> tuple[bytes, bool]:
    r"""The content of a text file without a last line that is cut off, and whether there was one.

    >>> without_cut_line(b"t,u\n0,1.5\n1,2.5\n2,"), without_cut_line(b"t,u\n0,1.5\n1,2.5")
    ((b't,u\n0,1.5\n1,2.5\n', True), (b't,u\n0,1.5\n1,2.5', False))
    """
    begin = max(content.rfind(b"\n"), content.rfind(b"\r")) + 1
    last = content[begin:]
    if not last.strip() or len(last) > MOST_BYTES or content.startswith(_WIDE):
        return content, False
    above = content[max(begin - MOST_BYTES, 0) : begin].splitlines()[-MOST_LINES:]
    above = [line for line in above if re.search(rb"\d", line)]
    forms, decimals = ({form(line) for line in above} for form in (_form, _form_with_decimals))
    is_cut = _is_begun(_form(last), forms) or (len(decimals) == 1 and _is_begun(_form_with_decimals(last), decimals))
    return (content[:begin], True) if is_cut else (content, False)


def marked(columns: Columns, is_cut: bool) -> Columns:
    """Columns that say that their file is cut off in the middle of a sample, after all that they have."""
    rows = max(map(len, columns.series.values()), default=0)
    return replace(columns, cut={"": (rows, 0)}) if is_cut else columns


def _form(line: bytes) -> bytes:
    return _NUMBER.sub(b"0", line.strip())


def _form_with_decimals(line: bytes) -> bytes:
    decimals = _COMMA if b";" in line else _DECIMALS
    return _form(decimals.sub(lambda found: b"." + b"d" * (len(found[0]) - 1), line))


def _is_begun(form: bytes, others: set[bytes]) -> bool:
    return form not in others and any(other.startswith(form.rstrip(b"+-")) for other in others)
