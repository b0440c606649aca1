"""Findings as sentences: the only place where sentences about results are made.

Each file holds the sentences of one subject. A table has those that are templates, one code a row::

    free-run-diverged problem: on {data}, the free run diverges

Every other code has a function, registered under it::

    @words("input-constant", Severity.WARNING)
    def input_constant(f: Finding, argument: Spelling) -> str:
        return f"{f.subject} is constant, so these data test only the steady state"

``argument`` spells the name of an argument: as in Python by default (``mask``), as an option on the command line
(``--mask``). `sentence` puts the name of the model in front of a finding about a model.
"""

from emsid.wording import agreement as agreement
from emsid.wording import blocks as blocks
from emsid.wording import data as data
from emsid.wording import files as files
from emsid.wording import identification as identification
from emsid.wording import linear as linear
from emsid.wording import live as live
from emsid.wording import plants as plants
from emsid.wording import study as study
from emsid.wording import verdict as verdict
from emsid.wording.catalogue import CATALOGUE, Entry, Severity, Spelling, as_python, sentence, severity, words

__all__ = ["CATALOGUE", "Entry", "Severity", "Spelling", "as_python", "sentence", "severity", "words"]
