"""Which columns of files are the input and the output, with the evidence for each pair: for an identification without
named columns, which takes what is almost certain and asks for the rest."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from emsid.first_look.levels import MOST
from emsid.first_look.look import FirstLook
from emsid.first_look.responses import SEEN, answers
from emsid.first_look.together import Group, describe_files, groups
from emsid.record import Record

LISTED = 3
"""At most this many pairs are listed."""


@dataclass(frozen=True)
class Hypothesis:
    """Files with an input and an output.

    Attributes:
        looks: at the files.
        reading: the arguments of `emsid.read` for them.
        left: the share of the variance of the output that the best simple response to the input leaves; 1 where no
            response is seen.
    """

    looks: tuple[FirstLook, ...]
    reading: Mapping[str, Any]
    left: float


def hypotheses(paths: Sequence[str | os.PathLike[str]], given: Mapping[str, Any]) -> tuple[list[Hypothesis], bool]:
    """The pairs of input and output in files, the best first, and whether that is almost certain.

    Args:
        paths: the files.
        given: the other arguments of `emsid.read` that are known.

    Returns:
        What `describe_files` proposes for every group of files, and where that is one, other pairs of its columns that
        show a response; nothing where there is nothing to identify.

    Raises:
        FormatError: where a file cannot be read at all.
        DataError: where an argument that is given cannot be used.
    """
    looks, _ = describe_files(paths, **given)
    found = groups(looks)
    if len(found) != 1:
        return [_hypothesis(group) for group in found][:LISTED], False
    (group,) = found
    left_out = any(look.useless for look in looks)
    sure = not left_out and all(map(_is_almost_certain, group.looks))
    if sure:
        return [_hypothesis(group)], True
    own = group.looks[0].roles
    others = [pair for pair in (*own.others, *_responding(group.looks[0])) if pair != (own.input, own.output)]
    return [_hypothesis(group), *_of_pairs(paths, given, list(dict.fromkeys(others))[: LISTED - 1])], False


def _is_almost_certain(look: FirstLook) -> bool:
    roles = look.roles
    return not roles.others and min(roles.input_confidence, roles.output_confidence, look.clock.confidence) >= MOST


def _hypothesis(group: Group) -> Hypothesis:
    return Hypothesis(group.looks, group.reading, max(_left(look.record) for look in group.looks))


def _left(record: Record | None) -> float:
    """What the best simple response leaves of the first output; 1 where none is seen."""
    if record is None:
        return 1.0
    table = np.column_stack([record.input[:, 0], record.output[:, 0]])
    answer = answers(table, [0, *record.breaks]).get((0, 1))
    return 1.0 if answer is None or answer.evidence < SEEN else answer.left


def _responding(look: FirstLook) -> list[tuple[str, str]]:
    """The pairs of columns of which the second answers the first, those with most evidence first."""
    numbers = [
        each
        for each in look.columns
        if each.kind == "numbers" and not each.constant and each.name != look.clock.column and each.rows == look.rows
    ]
    if len(numbers) < 2:
        return []
    table = np.column_stack([each.signal for each in numbers])
    found = answers(table[np.isfinite(table).all(axis=1)])
    seen = {pair: each.evidence for pair, each in found.items() if each.evidence >= SEEN}
    first = [pair for pair in seen if seen[pair] >= seen.get(pair[::-1], 0.0)]
    return [(numbers[u].name, numbers[y].name) for u, y in sorted(first, key=lambda pair: -seen[pair])]


def _of_pairs(
    paths: Sequence[str | os.PathLike[str]], given: Mapping[str, Any], pairs: Sequence[tuple[str, str]]
) -> list[Hypothesis]:
    """The hypotheses for named pairs of columns."""
    found = []
    for u, y in pairs:
        divided = groups(describe_files(paths, **given, input=u, output=y)[0])
        found += [_hypothesis(group) for group in divided[:1]]
    return found
