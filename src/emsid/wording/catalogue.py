"""The codes of findings: the severity of each, and the function that makes its sentence."""

from __future__ import annotations

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
