"""The search for the structure of a model: score what may be added, refit the likeliest, take what a criterion prefers.

A family of models gives a state, which is a fitted model, and its moves: larger models that contain it, each with the
gain that its score promises (`emsid.models.search.score`). The likeliest are refitted, and the best is taken where the
criterion of the family prefers it to the present one; then the moves of the new state are scored. When none is left,
what was added is taken out again wherever the criterion does not prefer the larger model, and exchanged where another
addition in its place is better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

S = TypeVar("S")
M = TypeVar("M")

REFITTED, BATCHES = 4, 2
"""Moves that are refitted together, and how often if none of them is better: four of them delay an output and look
alike. With all moves the search of a motor for what is none takes six times as long, and is no better."""
ROUNDS = 12
"""The most additions; no plant, recorded or simulated, took more than six."""
POSITIVE = 2.0
"""Differences of Schwarz's criterion below this are no evidence (Kass, Raftery, *Bayes factors*, JASA 90 (1995))."""
TURNS = 3
"""The most turns of adding, taking out and exchanging; the second seldom changes anything."""


class Family(Protocol[S, M]):
    """A family of models that can be searched."""

    def likely(self, state: S) -> Sequence[M]:
        """The moves from a state that may be worth a refit, the most promising first."""
        ...

    def refitted(self, state: S, moves: Sequence[M]) -> Sequence[S | None]:
        """The states that moves lead to; None where there is no such model."""
        ...

    def smaller(self, state: S) -> Sequence[S]:
        """The state without each of its additions in turn, refitted."""
        ...

    def gain(self, simple: S, rich: S) -> float:
        """By how much the criterion prefers the richer of two states; negative for the simpler."""
        ...


def climb(state: S, family: Family[S, M], taken: Callable[[S, str], bool]) -> S:
    """The best state that moves lead to.

    Args:
        state: to begin with.
        family: gives moves and refits.
        taken: called with every state that is taken and what led to it; returns whether to go on.
    """
    for _ in range(TURNS):
        grown, more = _grown(state, family, taken)
        state, smaller = _shrunk(grown, family, taken)
        exchanged = _exchanged(state, smaller, family) if more else None
        if exchanged is None:
            break
        state = exchanged
        taken(state, "exchanged")
    return state


def _grown(state: S, family: Family[S, M], taken: Callable[[S, str], bool]) -> tuple[S, bool]:
    """The state with additions, and whether to go on."""
    for _ in range(ROUNDS):
        best = _best(state, family)
        if best is None:
            break
        state = best
        if not taken(state, "added"):
            return state, False
    return state, True


def _best(state: S, family: Family[S, M]) -> S | None:
    """The state that the criterion prefers most to the present one, of the likeliest moves, or else of the next ones.

    None without one. Of about equal ones it is the first, so that rounding does not decide.
    """
    likely = family.likely(state)
    for k in range(0, min(len(likely), BATCHES * REFITTED), REFITTED):
        moved = [each for each in family.refitted(state, likely[k : k + REFITTED]) if each is not None]
        found = [(family.gain(state, each), each) for each in moved]
        most = max((gain for gain, _ in found), default=0.0)
        if most > 0:
            return next(each for gain, each in found if gain > max(most - POSITIVE, 0.0))
    return None


def _shrunk(state: S, family: Family[S, M], taken: Callable[[S, str], bool]) -> tuple[S, Sequence[S]]:
    """The state without additions that the criterion does not prefer, and the smaller ones of that state."""
    while smaller := family.smaller(state):
        gains = [family.gain(each, state) for each in smaller]
        if min(gains) > 0:
            break
        state = smaller[gains.index(min(gains))]
        taken(state, "taken out")
    return state, smaller


def _exchanged(state: S, smaller: Sequence[S], family: Family[S, M]) -> S | None:
    """A state with another addition in place of one, if the criterion prefers it; None without one.

    Args:
        state: to compare with.
        smaller: the same without each of its additions in turn.
        family: gives moves and refits.
    """
    for each in smaller:
        best = _best(each, family)
        if best is not None and family.gain(state, best) > POSITIVE:
            return best
    return None
