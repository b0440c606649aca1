"""Cascades of filters and static maps: what the data leave open in them."""

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, words


@words("choices-cut-short", Severity.WARNING)
def choices_cut_short(f: Finding, argument: Spelling) -> str:
    why = "was interrupted" if f.data["cancelled"] else "ran out of time"
    return f"the search for the orders and the static map {why}; the best {f.subject} model so far is kept"
