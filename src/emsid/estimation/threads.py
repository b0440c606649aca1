"""Threads of searches: how many, a pool for short tasks, and one for BLAS and LAPACK while searches run in parallel.

Searches run in one thread per core and use small matrices. If a linear-algebra library starts more threads in each of
them, everything becomes several times slower.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any

_lock = Lock()
_inside = 0
_limiter: Any = None
_processes = 1


def cores() -> int:
    """The number of threads for the searches of this process: its share of the cores."""
    return max((os.cpu_count() or 1) // _processes, 1)


@contextmanager
def sharing_cores(processes: int) -> Iterator[None]:
    """Within this context, the cores are shared with other processes of the program. Enter it from the main thread."""
    global _processes
    before, _processes = _processes, processes
    try:
        yield
    finally:
        _processes = before


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within this context, which may be nested, BLAS and LAPACK start no threads. Enter it from the main thread."""
    global _inside, _limiter
    with _lock:
        if _inside == 0:
            _limiter = _controller().limit(limits=1, user_api="blas")
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                _limiter.restore_original_limits()


@contextmanager
def in_threads(threads: int) -> Iterator[Callable[..., Iterable[Any]]]:
    """A function like `map` that divides its calls between threads; of one thread the present one, which costs less."""
    if threads == 1:
        yield map
        return
    with ThreadPoolExecutor(threads) as pool:
        yield pool.map


@cache
def short_tasks(threads: int) -> ThreadPoolExecutor:
    """A pool for tasks of a millisecond or so, which is made once; they must not start other tasks in it."""
    return ThreadPoolExecutor(threads)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=short_tasks.cache_clear)  # a forked process has none of its threads


@cache
def _controller() -> Any:
    """The controller of the libraries of this process; cached, as the search for them takes milliseconds."""
    import scipy.linalg  # noqa: F401  (so that its library is found too)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
