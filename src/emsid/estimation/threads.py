"""One thread for every core, and not one for every core and library.

Searches run side by side in threads of their own, and the matrices in them are small. A linear-algebra library that
then starts threads too, for each of them, makes everything several times slower; it is held to one while they run.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any

_lock = Lock()
_inside = 0
_limiter: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """While it lasts, however nested, BLAS and LAPACK use the thread that calls them; for the main thread to enter."""
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


@cache
def _controller() -> Any:
    """What knows the libraries of this process; looking for them takes milliseconds."""
    import scipy.linalg  # noqa: F401  (so that its library is found too)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
