"""Coordinate search: choosing orders, delays and terms by the error on unseen data.

A full grid over five choices takes thousands of fits. Optimising one choice at a time, in a few rounds, takes dozens
and rarely gives another result. Values are listed from simple to complex; the simplest one that is as good as the best
is chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain, repeat

from emsid.selection.improvement import StretchErrors, better

ROUNDS = 2
"""Passes over all names."""


def coordinate_search(
    error: Callable[[Mapping[str, int]], StretchErrors],
    choices: Mapping[str, Sequence[int]],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, int]:
    """Choose a value for every name, one name at a time, so that the free-run error is small.

    Args:
        error: of the free run of a model with these choices on unseen data; may be infinite.
        choices: the allowed values of every name, from simple to complex; the search starts in the middle.
        progress: called with the number of errors that are known, and their number in all.

    Returns:
        The chosen value of every name.
    """
    known: dict[tuple[int, ...], StretchErrors] = {}

    def error_of(choice: Mapping[str, int]) -> StretchErrors:
        key = tuple(choice.values())
        if key not in known:
            known[key] = error(choice)
        return known[key]

    chosen = {name: values[len(values) // 2] for name, values in choices.items()}
    total, done = ROUNDS * sum(map(len, choices.values())), 0
    for name in chain.from_iterable(repeat(choices, ROUNDS)):
        errors = []
        for value in choices[name]:
            errors.append(error_of({**chosen, name: value}))
            done += 1
            progress(done, total)
        best = min(errors, key=lambda each: each.mean)
        chosen[name] = next(v for v, e in zip(choices[name], errors, strict=True) if e is best or not better(best, e))
    return chosen
