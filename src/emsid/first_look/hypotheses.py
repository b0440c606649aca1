"""Which columns of files are the input and the output, with the evidence for each pair: for an identification without
named columns, which takes what is almost certain and asks for the rest."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from emsid.first_look.levels import MOST
from emsid.first_look.look import FirstLook
from emsid.first_look.together import Group, describe_files, groups
from emsid.io.reading import parsed_file

LISTED = 3
"""At most this many pairs are listed."""


@dataclass(frozen=True)
class Hypothesis:
    """Files with an input and an output.

    Attributes:
        looks: at the files.
        reading: the arguments of `emsid.read` for them.
        left: the share of the variance of the output that the best simple response to the input leaves; 1 where none
            was fitted.
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
        What `describe_files` proposes for every group of files, and where that is one, other likely pairs of its
        columns; nothing where there is nothing to identify.

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
    others = [*own.others, *((u, y) for u, y, _ in own.tried[1:])]
    return [_hypothesis(group), *of_pairs(paths, given, list(dict.fromkeys(others))[: LISTED - 1])], False


def _is_almost_certain(look: FirstLook) -> bool:
    roles = look.roles
    return not roles.others and min(roles.input_confidence, roles.output_confidence, look.clock.confidence) >= MOST


def _hypothesis(group: Group) -> Hypothesis:
    return Hypothesis(
        group.looks, group.reading, max(look.roles.tried[0][2] if look.roles.tried else 1.0 for look in group.looks)
    )


def of_pairs(
    paths: Sequence[str | os.PathLike[str]], given: Mapping[str, Any], pairs: Sequence[tuple[str, str]]
) -> list[Hypothesis]:
    """The hypotheses for named pairs of columns.

    Args:
        paths: the files.
        given: the other arguments of `emsid.read` that are known.
        pairs: names of an input and an output each.
    """
    found, files = [], [parsed_file(path, in_part=True, dbc=given.get("dbc")) for path in paths] if pairs else []
    for u, y in pairs:
        divided = groups(describe_files(files, **given, input=u, output=y)[0])
        found += [_hypothesis(group) for group in divided[:1]]
    return found
