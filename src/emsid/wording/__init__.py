"""Findings as sentences: the only place where sentences about results are made.

Each file holds the sentences of one subject, as a table with one code a row, see `emsid.wording.catalogue.filled`::

    input-constant warning: on {data}, {inputs:list {name} is constant at {level:g}}, which tests only the steady state

A code whose sentence needs a computation has a function, registered under it::

    @words("nonlinear-likely")
    def nonlinear_likely(f: Finding, argument: Spelling) -> str:
        return f"a nonlinear model should leave {100 * (1 - f.data['of_residual']):.2g} % of the squared error"

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
