"""Compilation of kernels by Numba, kept on disk where that is possible.

A kernel is compiled at its first call on a machine and kept in the folder of its module, or in the one of the user for
such files. Where neither can be written to – installation and home are read-only, or the disk is full – every process
compiles it in memory, and says so once.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, TypeVar, cast

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

NOT_KEPT = (
    "compiled code cannot be kept on this machine, so every start compiles it again, which takes up to a minute; name "
    "a folder that can be written to in the environment variable NUMBA_CACHE_DIR"
)
"""What is said, once in a process, where compiled code cannot be kept."""


class Notice:
    """Says once that compiled code cannot be kept.

    Attributes:
        given: whether that was said.
        say: how; a warning by default, a line on standard error in the command line.
    """

    def __init__(self) -> None:
        self.given = False
        self.say: Callable[[str], None] = lambda words: warnings.warn(words, RuntimeWarning, stacklevel=4)

    def give(self) -> None:
        """Say it, unless that was done before."""
        if not self.given:
            self.given = True
            self.say(NOT_KEPT)


NOTICE = Notice()


def njit(*, cache: bool = True, **options: Any) -> Callable[[Kernel], Kernel]:
    """As `numba.njit`, for a function of this package.

    Args:
        cache: whether to keep it on disk, if possible.
        options: of `numba.njit`.
    """

    def compiled(function: Kernel) -> Kernel:
        import numba  # takes a third of a second, and this module is known to the command line

        made: Any
        try:
            made = numba.njit(cache=cache, **options)(function)
        except RuntimeError:  # Numba found no folder
            NOTICE.give()
            made = numba.njit(**options)(function)
        else:
            if cache:
                _do_without(made._cache)
        return cast(Kernel, made)

    return compiled


def _do_without(cache: Any) -> None:
    """Let a kernel be compiled where what is kept cannot be read, and used where it cannot be kept."""
    load, save = cache.load_overload, cache.save_overload

    def load_if_possible(signature: Any, context: Any) -> Any:
        try:
            return load(signature, context)
        except Exception:  # whatever unpickling a damaged file raises
            return None

    def save_if_possible(signature: Any, overload: Any) -> None:
        try:
            try:
                save(signature, overload)
            except Exception as problem:
                if isinstance(problem, OSError):
                    raise
                cache.flush()  # the list of what is kept is damaged: begin it anew
                save(signature, overload)
        except OSError:
            NOTICE.give()

    cache.load_overload, cache.save_overload = load_if_possible, save_if_possible
