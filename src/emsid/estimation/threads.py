"""Threads of searches: how many, a pool for short tasks, and one for BLAS and LAPACK while searches run in parallel.

Searches run in one thread per core and use small matrices. If a linear-algebra library starts more threads in each of
them, everything becomes several times slower.

The system may deliver a signal such as Ctrl-C to any thread, but Python calls its handler in the main thread only, and
a thread that waits for a lock does not notice a signal that another one received. So the main thread never waits long.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache, partial
from threading import Lock
from typing import Any

LONGEST_WAIT = 0.1
"""Seconds after which a thread that waits for others runs for a moment, so that handlers of signals are called."""

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
        yield partial(_in_turn, pool)


@cache
def short_tasks(threads: int) -> Callable[..., Iterable[Any]]:
    """As `in_threads`, for tasks of a millisecond or so, which must not use it themselves; its pool is made once."""
    return partial(_in_turn, ThreadPoolExecutor(threads))


def _in_turn(pool: ThreadPoolExecutor, function: Callable[..., Any], *arguments: Iterable[Any]) -> Iterator[Any]:
    """The results of a function in the order of its calls, all of which begin at once."""
    calls = [pool.submit(function, *each) for each in zip(*arguments, strict=False)][::-1]
    try:
        while calls:
            while not calls[-1].done():
                wait(calls[-1:], LONGEST_WAIT)
            yield calls.pop().result()
    finally:
        for call in calls:
            call.cancel()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=short_tasks.cache_clear)  # a forked process has none of its threads


@cache
def _controller() -> Any:
    """The controller of the libraries of this process; cached, as the search for them takes milliseconds."""
    import scipy.linalg  # noqa: F401  (so that its library is found too)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
