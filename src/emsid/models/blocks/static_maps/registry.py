"""The registry of static maps: for model files, for ``static``, and for the searches that choose one."""

from __future__ import annotations

from typing import TypeVar

from emsid.errors import ModelError
from emsid.models.blocks.static_maps.static_map import StaticMap

S = TypeVar("S", bound=type[StaticMap])

STATIC_MAPS: dict[str, type[StaticMap]] = {}
"""Every static map with a name, by its kind."""


def register(map_: S) -> S:
    """Register a static map under its kind, for files and searches; can be used as a decorator of the class.

    >>> @register
    ... class SquareRoot(StaticMap): ...  # doctest: +SKIP

    Args:
        map_: the class.

    Raises:
        ModelError: for a kind that is missing or used by another class.
    """
    kind = getattr(map_, "kind", "")
    if not kind:
        raise ModelError(f"{map_.__name__} has no kind; give it a name for files and tables, such as 'dead-zone'")
    if STATIC_MAPS.setdefault(kind, map_).__qualname__ != map_.__qualname__:
        raise ModelError(f"there is another static map of the kind {kind!r}; give {map_.__name__} another name")
    STATIC_MAPS[kind] = map_  # a notebook may define the same class again
    return map_
