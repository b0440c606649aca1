"""Choosing orders, delays and terms by an error on data held back from the fit.

A full grid over five choices is thousands of fits; one choice at a time, in a few rounds, is dozens and rarely ends
elsewhere. Choices are listed from simple to complex; of those that are as good as the best, the simplest is chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain, repeat

from emsid.selection.improvement import Gain, as_good


def coordinate_search(
    error: Callable[[Mapping[str, int]], float],
    choices: Mapping[str, Sequence[int]],
    rounds: int = 2,
    progress: Callable[[float], None] | None = None,
) -> dict[str, int]:
    """The choices with a small error, found one at a time.

    Args:
        error: of a model with these choices on data that it was not fitted to; may be infinite.
        choices: for every name what may be chosen, from simple to complex; the search starts in the middle.
        rounds: how often all names are gone through.
        progress: called with the fraction done.

    Returns:
        A choice for every name.
    """
    known: dict[tuple[int, ...], float] = {}

    def error_of(choice: Mapping[str, int]) -> float:
        key = tuple(choice.values())
        if key not in known:
            known[key] = error(choice)
        return known[key]

    chosen = {name: values[len(values) // 2] for name, values in choices.items()}
    total, done = rounds * sum(map(len, choices.values())), 0
    for name in chain.from_iterable(repeat(choices, rounds)):
        errors = []
        for value in choices[name]:
            errors.append(error_of({**chosen, name: value}))
            done += 1
            if progress is not None:
                progress(done / total)
        least = min(errors)
        chosen[name] = next(v for v, e in zip(choices[name], errors, strict=True) if as_good(e, least, Gain.REGRESSION))
    return chosen
