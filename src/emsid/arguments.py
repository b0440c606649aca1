"""Arguments as users give them: one name in place of a list, and misspelt names."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def as_names(names: str | Iterable[str]) -> tuple[str, ...]:
    """One name or several, as a tuple: a text is one name, not a list of letters.

    >>> as_names("speed"), as_names(["speed", "current"])
    (('speed',), ('speed', 'current'))
    """
    return (names,) if isinstance(names, str) else tuple(names)


def as_names_with_commas(names: str | Iterable[str]) -> tuple[str, ...]:
    """One name or several, as a tuple; a text may list several names with commas.

    >>> as_names_with_commas("arx, friction-narx")
    ('arx', 'friction-narx')
    """
    if isinstance(names, str):
        return tuple(name.strip() for name in names.split(",") if name.strip())
    return tuple(names)


def did_you_mean(name: str, known: Iterable[str], most: int = 1) -> str:
    """The end of a message that suggests the most similar names, at most ``most``; empty if none is similar.

    >>> did_you_mean("rigde", ["ridge", "forgetting"])
    '; did you mean ridge?'
    """
    near = get_close_matches(name, list(known), n=most)
    return f"; did you mean {' or '.join(near)}?" if near else ""
