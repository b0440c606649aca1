"""Conversion of arguments that name parameters and outputs of a plant, by name or by symbol."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import TypeVar

from emsid.arguments import as_names, did_you_mean
from emsid.errors import ModelError
from emsid.models.plants.parameters import Named, Signal, full_name

V = TypeVar("V")


def full_names(plant: Named, names: str | Iterable[str] | None) -> tuple[str, ...] | None:
    """The full names of parameters given by one or several names or symbols; None stays None.

    Raises:
        ModelError: for an unknown name.
    """
    return None if names is None else tuple(full_name(plant, name) for name in as_names(names))


def names_had(plant: Named, names: Iterable[str]) -> tuple[str, ...]:
    """The full names of those parameters, by name or symbol, that a plant has."""
    found = []
    for name in names:
        with suppress(ModelError):
            found.append(full_name(plant, name))
    return tuple(found)


def by_full_name(plant: Named, what: str, values: Mapping[str, V] | None) -> dict[str, V]:
    """A table by the full names of its parameters.

    Args:
        plant: the plant with these parameters.
        what: the name of the argument, for messages.
        values: by name or symbol.

    Raises:
        ModelError: for a value that is not a table, an unknown name, or a parameter given by name and by symbol.
    """
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise ModelError(f"{what} is {values!r}; give a table by name, such as {{'{next(iter(plant.handles))}': …}}")
    found: dict[str, V] = {}
    for name, value in values.items():
        whole = full_name(plant, name)
        if whole in found:
            raise ModelError(f"{what} has {whole} twice, once as {name!r}; give it once")
        found[whole] = value
    return found


def as_bounds(plant: Named, bounds: Mapping[str, tuple[float, float]] | None) -> dict[str, tuple[float, float]]:
    """Bounds by the full names of their parameters, each a pair of numbers.

    Raises:
        ModelError: as `by_full_name`, and for bounds that are not a pair.
    """
    found = by_full_name(plant, "bounds", bounds)
    for name, pair in found.items():
        if not (isinstance(pair, Sequence) and not isinstance(pair, str) and len(pair) == 2):
            raise ModelError(f"bounds of {name} are {pair!r}; give a pair (lower, upper)")
    return found


def as_signals(signals: str | Signal | Iterable[str | Signal]) -> tuple[Signal, ...]:
    """The signals of outputs, given as one or several signals or names.

    >>> as_signals("speed"), as_signals(["position", Signal.CURRENT])
    ((<Signal.SPEED: 'speed'>,), (<Signal.POSITION: 'position'>, <Signal.CURRENT: 'current'>))

    Raises:
        ModelError: for an unknown name.
    """
    several = (signals,) if isinstance(signals, str | Signal) else tuple(signals)
    known = [signal.value for signal in Signal]
    for each in several:
        if not isinstance(each, Signal) and each not in known:
            raise ModelError(f"no signal {each!r}; there are {', '.join(known)}{did_you_mean(str(each), known)}")
    return tuple(Signal(each) for each in several)
