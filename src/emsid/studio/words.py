"""The terms of the page in what the library says: the fields of the page instead of arguments, options and paths.

A message of the library names arguments as in Python, and the program that follows a source names options of the
command line. Whoever uses the page sees neither: the names are replaced by those of the fields, in quotation marks.
"""

from __future__ import annotations

import re
from pathlib import Path

from emsid.errors import EmsidError
from emsid.options import IDENTIFY, READING

CALLED = {
    "dt": "Sample time",
    "resample": "Interpolate irregular times",
    "mask": "Leave out where",
    "fixed": "Known values",
    "unseen": "Part kept unseen",
}
"""Fields whose names are not those of their arguments."""
KINDS = {each.name: each.kind for each in (*IDENTIFY, *READING)}
_CLEAR = frozenset(name for name in KINDS if "_" in name or name == "dt")
"""Names of arguments that are no words of English."""


def label(argument: str) -> str:
    """The name of the field of an argument."""
    return CALLED.get(argument, argument.replace("_", " ").capitalize() if len(argument) > 2 else argument)


def field_name(argument: str) -> str:
    """What the page calls an argument, in quotation marks.

    >>> field_name("derivative_window")
    '“Derivative window”'
    """
    return f"“{label(argument)}”"


def in_page(text: str, folder: Path | None = None) -> str:
    """A message in the terms of the page.

    Args:
        text: of the library or of the command line.
        folder: of the session; the paths of its folders are left out before the names of files.

    >>> in_page("emsid track: the time is not regular; give resample=True, or --time-unit ms")
    'the time is not regular; tick “Interpolate irregular times”, or “Time unit” ms'
    """
    for place in () if folder is None else ("data/", "models/", "incoming/", ""):
        text = text.replace(f"{folder}/{place}", "")
    text = re.sub(r"^emsid( [a-z]+)?: ", "", text.strip())
    text = re.sub(r"(?<!\S)--([a-z][a-z-]+)", lambda found: field_name(found[1].replace("-", "_")), text)

    def assigned(found: re.Match[str]) -> str:
        verb, name, value = found[1] or "", found[2], found[3]
        if name not in KINDS:
            return found[0]
        if KINDS[name] == "switch" and value in ("True", "False"):
            return f"{'tick' if value == 'True' else 'clear'} {field_name(name)}"
        return f"{verb}{field_name(name)}: {value}"

    text = re.sub(r"(give |take |use )?\b([a-z_]+)=([^\s,;)]+)", assigned, text)
    return re.sub(r"\b[a-z_]+\b", lambda found: field_name(found[0]) if found[0] in _CLEAR else found[0], text)


def said(problem: EmsidError, folder: Path | None = None) -> str:
    """An error in the terms of the page, with the fields to change, which its message need not name."""
    text = in_page(str(problem), folder)
    fields = [field_name(name) for name in problem.arguments if name in KINDS and field_name(name) not in text]
    return f"{text} ({', '.join(fields)})" if fields else text
