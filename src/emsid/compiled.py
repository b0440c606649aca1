"""Compilation of kernels by Numba, kept on disk where that is possible.

A kernel is compiled at its first call on a machine and kept in the folder of its module, or in the one of the user for
such files. Where neither can be written to – installation and home are read-only, or the disk is full – every process
compiles it in memory, and says so once.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from hashlib import blake2s
from types import CodeType, FunctionType
from typing import Any, TypeVar, cast

import numpy as np

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


@cache
def with_functions(kernel: Any, **functions: Any) -> Any:
    """A kernel that calls other functions by some of the names that it, or a kernel that it calls, uses.

    It is compiled if these functions are, and kept on disk if they are of this package; otherwise it is plain Python.

    Args:
        kernel: made by `njit`.
        functions: by the names that kernels of its package know others by.
    """
    made = _with(kernel, tuple(sorted(functions.items())))
    return made if _kernel(made) else np.errstate(all="ignore")(made)


@cache
def _with(kernel: Any, functions: tuple[tuple[str, Any], ...]) -> Any:
    code, replaced = kernel.py_func, dict(functions)
    known = {name: code.__globals__[name] for name in code.__code__.co_names if name in code.__globals__}
    made = {name: replaced.get(name) or _with(each, functions) for name, each in known.items() if _kernel(each)}
    if all(each is known[name] for name, each in made.items()):
        return kernel
    name = "_with_".join([code.__name__, *(f"{each.__name__}_{_digest(each)}" for _, each in functions)])
    changed = FunctionType(code.__code__, {**code.__globals__, **made}, name)
    changed.__qualname__ = name  # the file on disk is found by this name alone
    if not all(map(_kernel, replaced.values())):
        return changed
    ours = all(each.__module__.startswith("emsid.") for each in replaced.values())
    options = {key: value for key, value in kernel.targetoptions.items() if key not in ("nopython", "boundscheck")}
    return njit(cache=ours, **options)(changed)


def _digest(function: Any) -> str:
    """A digest of the code of a function: what is cached for one version of it is not used for another."""
    code = getattr(function, "py_func", function).__code__
    constants = [value for value in code.co_consts if not isinstance(value, CodeType)]
    return blake2s(code.co_code + repr((constants, code.co_names)).encode(), digest_size=4).hexdigest()


def _kernel(function: Any) -> bool:
    return hasattr(function, "py_func")


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
