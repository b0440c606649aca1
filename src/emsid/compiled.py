"""Compilation of kernels by Numba, kept on disk where that is possible.

A kernel is compiled at its first call on a machine and kept in the folder of its module, or in the one of the user for
such files. Where neither can be written to – installation and home are read-only, or the disk is full – every process
compiles it in memory, and says so once.

Numba uses what is kept while the file of the kernel is the same, although a function of another file, which the kernel
calls, may have changed. Here it is used only while all that the kernel reaches is the same, see `digest_of`.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import EnumMeta
from functools import cache
from hashlib import blake2s
from inspect import getmro
from types import CodeType, FunctionType, ModuleType
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
                by_content(made)
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
    for each in functions.values():
        by_content(each)
    import numpy as np  # here, so that the command line starts without it

    made = _with(kernel, tuple(sorted(functions.items())))
    return made if _kernel(made) else np.errstate(all="ignore")(made)


@cache
def _with(kernel: Any, functions: tuple[tuple[str, Any], ...]) -> Any:
    code, replaced = kernel.py_func, dict(functions)
    known = {name: code.__globals__[name] for name in code.__code__.co_names if name in code.__globals__}
    made = {name: replaced.get(name) or _with(each, functions) for name, each in known.items() if _kernel(each)}
    if all(each is known[name] for name, each in made.items()):
        return kernel
    name = "_with_".join([code.__name__, *(f"{each.__name__}_{digest_of(each)}" for _, each in functions)])
    changed = FunctionType(code.__code__, {**code.__globals__, **made}, name)
    changed.__qualname__ = name  # the file on disk is found by this name alone
    if not all(map(_kernel, replaced.values())):
        return changed
    ours = all(each.__module__.startswith("emsid.") for each in replaced.values())
    options = {key: value for key, value in kernel.targetoptions.items() if key not in ("nopython", "boundscheck")}
    return njit(cache=ours, **options)(changed)


def _kernel(function: Any) -> bool:
    return hasattr(function, "py_func")


def digest_of(function: Any) -> str:
    """A digest of all that a function depends on: its code, and the constants and functions that it reaches.

    These are found by the names in the code, also in modules and closures; compiled functions count with their options.
    Functions of libraries are not followed.
    """
    found, (reached, values) = blake2s(digest_size=8), _reached(function)
    found.update(repr((len(reached), values)).encode())
    return found.hexdigest()


def own_code(value: Any) -> Iterator[str]:
    """Digests of all code of a user within a value, such as a model: functions, and methods of classes.

    They are found in fields of dataclasses, tuples, lists and dictionaries; code of this package and of libraries is
    left out.
    """
    if _kernel(value) or isinstance(value, FunctionType):
        yield digest_of(value)
        return
    for each in getmro(type(value)):
        if not (each.__module__.startswith("emsid.") or _of_library(each.__module__)):
            methods = (getattr(method, "__func__", method) for method in vars(each).values())
            yield from (digest_of(method) for method in methods if isinstance(method, FunctionType))
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, tuple | list) else ()
    named = [getattr(value, field.name) for field in fields(value)] if is_dataclass(value) else []
    for part in (*parts, *named):
        yield from own_code(part)


def _reached(function: Any) -> tuple[dict[Any, int], list[object]]:
    """The functions that a function reaches, numbered, and descriptions of them and of the constants, in order."""
    reached: dict[Any, int] = {}
    waiting: list[Any] = []

    import numpy as np

    def described(value: Any, names: list[str]) -> object:
        """What identifies a value, with the numbers of functions; what cannot be a constant has its type only."""
        if isinstance(value, ModuleType):
            parts = {} if _of_library(value.__name__) else vars(value)
            return [(name, described(parts[name], names)) for name in names if name in parts]
        if _kernel(value) or isinstance(value, FunctionType):
            if _of_library(value.__module__):
                return value.__module__, value.__qualname__
            if value not in reached:
                reached[value] = len(reached)
                waiting.append(value)
            return reached[value]
        if isinstance(value, np.ndarray):
            return value.dtype.str, value.shape, value.tobytes()
        if isinstance(value, tuple | frozenset | set):
            parts_of_it = [described(each, names) for each in value]
            return parts_of_it if isinstance(value, tuple) else sorted(map(repr, parts_of_it))
        if isinstance(value, EnumMeta):
            members: Any = value.__members__.items()
            return [(name, repr(member.value)) for name, member in members]
        if isinstance(value, type):
            return value.__qualname__, getattr(value, "_fields", None)
        plain = isinstance(value, int | float | complex | str | bytes | np.generic | None)
        return repr(value) if plain or _of_library(type(value).__module__) else type(value).__qualname__

    values = [described(function, [])]
    for each in waiting:
        code = getattr(each, "py_func", each)
        for part in _codes(code.__code__):
            names = [*part.co_names, *part.co_freevars]
            known = {**code.__globals__, **dict(_closed_over(code))}
            constants = tuple(value for value in part.co_consts if not isinstance(value, CodeType))
            values += [part.co_code, names, described(constants, names)]
            values += [described(known[name], names) for name in names if name in known]
        options = tuple(sorted(getattr(each, "targetoptions", {}).items()))
        values += [described(code.__defaults__, []), described(options, [])]
    return reached, values


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A code, and those of the functions within it."""
    yield code
    for value in code.co_consts:
        if isinstance(value, CodeType):
            yield from _codes(value)


def _closed_over(function: FunctionType) -> Iterator[tuple[str, Any]]:
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        with suppress(ValueError):  # the cell is still empty
            yield name, cell.cell_contents


def _of_library(module: str | None) -> bool:
    """Whether a module is of Python, NumPy or Numba, whose functions Numba compiles by itself."""
    name = (module or "").partition(".")[0]
    return name in ("numpy", "numba") or name in sys.stdlib_module_names


def by_content(function: Any) -> None:
    """Let a compiled function, and those that it reaches, use what is kept on disk only if all they reach is the same.

    It is compiled where what is kept cannot be read, and used where it cannot be kept.

    Args:
        function: of `numba.njit`, also of a user; another one has nothing to keep.
    """
    cache: Any = getattr(function, "_cache", None)
    if not hasattr(cache, "_cache_file") or "load_overload" in vars(cache):
        return
    load, save, file = cache.load_overload, cache.save_overload, cache._cache_file
    stamp = file._source_stamp

    def load_if_possible(signature: Any, context: Any) -> Any:
        file._source_stamp = (stamp, digest_of(function))  # only now, as it may reach functions further below
        for each in _reached(function)[0]:
            by_content(each)
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
