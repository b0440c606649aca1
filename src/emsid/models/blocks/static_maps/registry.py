"""Which static maps there are: in model files, for ``static``, and in the searches that choose one."""

from __future__ import annotations

from typing import TypeVar

from emsid.errors import ModelError
from emsid.models.blocks.static_maps.static_map import StaticMap

S = TypeVar("S", bound=type[StaticMap])

STATIC_MAPS: dict[str, type[StaticMap]] = {}
"""Every static map with a name, by its kind."""


def register(map_: S) -> S:
    """Add a static map, so that files and searches find it by its kind; also as a decorator of its class.

    >>> @register
    ... class SquareRoot(StaticMap): ...  # doctest: +SKIP

    Args:
        map_: the class.

    Raises:
        ModelError: for a kind that is missing, or that another class has.
    """
    kind = getattr(map_, "kind", "")
    if not kind:
        raise ModelError(f"{map_.__name__} has no kind; give it a name for files and tables, such as 'dead-zone'")
    if STATIC_MAPS.setdefault(kind, map_).__qualname__ != map_.__qualname__:
        raise ModelError(f"there is another static map of the kind {kind!r}; give {map_.__name__} another name")
    STATIC_MAPS[kind] = map_  # a notebook defines the same class once more
    return map_
