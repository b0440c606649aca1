"""Words for designed experiments."""

from __future__ import annotations

from emsid.errors import listed
from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words

REMEDIES = {"current": "the current", "inertia": "a second inertia that is known"}


@words("not-separable", Severity.WARNING)
def not_separable(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: names, directions, remedies (of ``current`` and ``inertia``)."""
    count = f.data["directions"]
    remedies = " or ".join(REMEDIES[each] for each in f.data["remedies"])
    advice = f"record {remedies}" if remedies else f"fix {count} of them ({argument('fixed')})"
    return f"{listed(f.data['names'])} cannot be separated by any input at one load; {advice}"


sentences("""
design-gains-nothing info: nothing is gained by a design of its own: {signal} is as good within these limits
""")
