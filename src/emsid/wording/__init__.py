"""Findings as sentences: the only place where the program's words are made.

A file of this package holds the words for one subject: a function for every code, registered under it::

    @words("input-constant", Severity.WARNING)
    def input_constant(f: Finding, argument: Spelling) -> str:
        return f"{f.subject} is constant, so these data test only the steady state"

``argument`` spells the name of something that the user can give: by default as Python has it (``mask``); the command
line passes a spelling of its own (``--mask``).
"""

from emsid.wording import blocks as blocks
from emsid.wording import plants as plants
from emsid.wording import search as search
from emsid.wording import study as study
from emsid.wording.catalogue import CATALOGUE, Severity, Spelling, as_python, sentence, severity, words

__all__ = ["CATALOGUE", "Severity", "Spelling", "as_python", "sentence", "severity", "words"]
