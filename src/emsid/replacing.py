"""The files that a command has read, so that it does not write over them.

The readers of `emsid.io` and `emsid.live` note every file (`note_source`), known to the system by its device and number
under whatever name; the writers ask (`is_source`). Notes are kept within `sources_kept` only, in which the command line
works: a program that uses the library knows what it replaces.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_noted: list[tuple[set[tuple[int, int]], set[tuple[int, int]]]] = []  # files read, and files written


@contextmanager
def sources_kept() -> Iterator[None]:
    """Within this context, the files that are read are noted."""
    _noted.append((set(), set()))
    try:
        yield
    finally:
        _noted.pop()


def note_source(status: os.stat_result) -> None:
    """Note a file that is read.

    Args:
        status: of the file; a pipe or device is not noted, nor a file that the command itself has written.
    """
    if _noted and stat.S_ISREG(status.st_mode) and _key(status) not in _noted[-1][1]:
        _noted[-1][0].add(_key(status))


def note_result(status: os.stat_result) -> None:
    """Note a file that is written: the command may read it, and write it again."""
    if _noted:
        _noted[-1][1].add(_key(status))


def is_source(path: str | os.PathLike[str]) -> bool:
    """Whether this is the name of a file that was read within `sources_kept`."""
    with suppress(OSError, ValueError):
        return bool(_noted) and _key(os.stat(path)) in _noted[-1][0]
    return False


def _key(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino
