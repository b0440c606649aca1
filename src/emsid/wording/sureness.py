"""How sure a finding is, in words."""

from __future__ import annotations


def how_sure(confidence: float) -> str:
    """A confidence from 0 to 1 as an adverb.

    >>> how_sure(0.95), how_sure(0.75), how_sure(0.5), how_sure(0.2)
    ('almost certainly', 'likely', 'possibly', 'perhaps')
    """
    for least, word in ((0.9, "almost certainly"), (0.65, "likely"), (0.4, "possibly")):
        if confidence >= least:
            return word
    return "perhaps"
