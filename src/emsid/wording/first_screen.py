"""Words between the tables of the first screen of an identification."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.findings import Finding
from emsid.wording.catalogue import Spelling
from emsid.wording.lists import listed, shortened
from emsid.wording.verdict import reason_in_words

NOTHING_KNOWN = "known: no value of the drive has an interval in this model."
NOTHING_UNKNOWN = "not known: nothing; these data determine every value of this model."


def more(argument: Spelling) -> str:
    """What is not on the screen."""
    return f"{argument('details')} prints all models, values and findings; the report has them, too."


def further(count: int, argument: Spelling) -> str:
    """How many lines are left out, in brackets; nothing for none.

    >>> further(2, str), further(0, str)
    (' (2 more with details)', '')
    """
    return f" ({count} more with {argument('details')})" if count > 0 else ""


def not_determined(names: Sequence[str]) -> str:
    """The values that the data do not determine, in one line; empty for none."""
    return f"these data do not determine {shortened(list(dict.fromkeys(names)))}." if names else ""


def assumed(values: Sequence[str], names: Sequence[str]) -> str:
    """One line about values that nobody gave or measured; empty for none.

    Args:
        values: each with its name and unit.
        names: of the estimates that depend on them.
    """
    if not values:
        return ""
    scale = f": {listed(names)} scale{'s' * (len(names) == 1)} with {'it' if len(values) == 1 else 'them'}"
    return f"assumed, not measured: {listed(values)}{scale * bool(names)}"


def other_reasons(verdict: Finding) -> list[str]:
    """The reasons of a verdict after the first, which is in the recommendation."""
    return [f"{reason_in_words(each)}." for each in verdict.data["reasons"][1:]]
