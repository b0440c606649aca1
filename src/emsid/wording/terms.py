"""What the terms of a regression mean, in the names of its channels."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from emsid.units import name_and_unit, with_unit

Channel = tuple[str, str]
"""Name and unit."""


def meanings(structure: Any, record: Any) -> tuple[str, ...]:
    """What every parameter of a structure multiplies, in words.

    Args:
        structure: of a regression.
        record: with its channels.
    """
    names = [name_and_unit(each)[0] for each in (*record.output_names, *record.input_names)]
    channels = list(zip(names, (*record.output_units, *record.input_units), strict=True))
    return tuple(_meaning(each, channels) for each in structure.regressors)


def _meaning(regressor: Any, channels: Sequence[Channel]) -> str:
    """A past signal, what of it is beyond a knot, dry friction, the offset, or the term with the names of its signals.

    Args:
        regressor: the term.
        channels: the output and the inputs.
    """
    if not regressor.factors:
        return "offset"
    first, *others = regressor.factors
    name, unit = channels[first.channel]
    kinds = [factor.transform.name for factor in regressor.factors]
    before = f", {first.lag} sample{'s' * (first.lag != 1)} before"
    size = with_unit(f"{first.parameter:.4g}", unit)
    if first.channel == 0 and kinds[0] in ("SIGN", "TANH") and first.power == 1:
        if not others:
            return f"Coulomb friction, direction of {name}"
        if kinds[1:] == ["DECAY"]:
            return f"Stribeck friction, fades over {with_unit(f'{others[0].parameter:.3g}', unit)}"
    if len(kinds) == 1 and kinds[0] in ("VALUE", "ABOVE", "BELOW") and first.power == 1:
        beyond = {"VALUE": "", "ABOVE": f" above {size}", "BELOW": f" below {size}"}[kinds[0]]
        return f"{name}{beyond}{before}"
    return re.sub(r"\b(y|u\d*)\(t", lambda x: f"{_of(x[1], channels)[0]}(t", str(regressor).lstrip("-"))


def _of(letter: str, channels: Sequence[Channel]) -> Channel:
    """The channel of a letter: y is the output, u the first input, u2 the second."""
    return channels[0 if letter == "y" else int(letter[1:] or 1)]
