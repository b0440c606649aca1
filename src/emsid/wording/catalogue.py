"""The codes of findings: the severity of each, and the function that makes its sentence."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from emsid.findings import Finding

Spelling = Callable[[str], str]
"""How the name of an argument is written: ``mask`` in Python, ``--mask`` on a command line."""


class Severity(Enum):
    """How much a finding matters to a user of the model."""

    INFO = "info"  # information
    WARNING = "warning"  # limits what the result can be used for
    PROBLEM = "problem"  # the result should not be used until this is corrected


@dataclass(frozen=True)
class Entry:
    """A code of the catalogue.

    Attributes:
        severity: how much it matters.
        wording: the sentence of a finding, without the full stop and without the model that it is about.
    """

    severity: Severity
    wording: Callable[[Finding, Spelling], str]


CATALOGUE: dict[str, Entry] = {}
"""All codes."""


def words(
    code: str, severity: Severity = Severity.INFO
) -> Callable[[Callable[[Finding, Spelling], str]], Callable[[Finding, Spelling], str]]:
    """Register a function as the wording of a code.

    Args:
        code: the code; each is registered once.
        severity: how much it matters.
    """

    def register(wording: Callable[[Finding, Spelling], str]) -> Callable[[Finding, Spelling], str]:
        if code in CATALOGUE:
            raise ValueError(f"two wordings for {code!r}")
        CATALOGUE[code] = Entry(severity, wording)
        return wording

    return register


class _Spelt(dict[str, str]):
    """The names of arguments as they are spelt."""

    def __init__(self, argument: Spelling) -> None:
        self.argument = argument

    def __missing__(self, name: str) -> str:
        return self.argument(name)


def sentences(table: str) -> None:
    """Register the rows ``code severity: sentence`` of a table; indented lines continue a row.

    Braces in a sentence hold the ``subject`` or ``model`` of a finding, one of its data, or ``argument[mask]`` for the
    name of an argument, with formats as in `str.format`.
    """

    def filled(template: str) -> Callable[[Finding, Spelling], str]:
        return lambda f, argument: template.format_map(
            {"model": f.model, **f.data, "subject": f.subject, "argument": _Spelt(argument)}
        )

    for code, severity, row in re.findall(r"^(\S+) (\w+): (.+(?:\n +.+)*)", table, re.MULTILINE):
        words(code, Severity(severity))(filled(re.sub(r"\n +", " ", row)))


def as_python(name: str) -> str:
    """The name of an argument in Python."""
    return name


def sentence(finding: Finding, argument: Spelling = as_python) -> str:
    """A finding as one sentence with a full stop; it begins with the model that the finding is about.

    Args:
        finding: what was noticed.
        argument: how names of arguments are written.
    """
    text = CATALOGUE[finding.code].wording(finding, argument).rstrip(".")
    about = f"{finding.model}: " if finding.model else ""
    return f"{text}." if text.startswith(about) else f"{about}{text}."


def severity(finding: Finding) -> Severity:
    """The severity of a finding."""
    return CATALOGUE[finding.code].severity
