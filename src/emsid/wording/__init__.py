"""Findings as sentences: the only place where sentences about results are made.

A file of this package holds the words for one subject, a function for every code, registered under it::

    @words("input-constant", Severity.WARNING)
    def input_constant(f: Finding, argument: Spelling) -> str:
        return f"{f.subject} is constant, so these data test only the steady state"

``argument`` spells the name of an argument: by default as Python has it (``mask``); the command line passes a spelling
of its own (``--mask``). `sentence` puts the model that a finding is about in front of its words.
"""

from emsid.wording import agreement as agreement
from emsid.wording import blocks as blocks
from emsid.wording import conclusions as conclusions
from emsid.wording import identification as identification
from emsid.wording import linear as linear
from emsid.wording import plants as plants
from emsid.wording import search as search
from emsid.wording import study as study
from emsid.wording.catalogue import CATALOGUE, Entry, Severity, Spelling, as_python, sentence, severity, words

__all__ = ["CATALOGUE", "Entry", "Severity", "Spelling", "as_python", "sentence", "severity", "words"]
