"""Figures drawn by two processes: the one that identified, and one made ready beside it in the meantime.

Drawing is bound to one core by the interpreter. The second process is started, and loads what it needs, while the
models are still being fitted; then it draws from the first figure on and its parent from the last, until they meet.
"""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from threading import Thread

from emsid.report.content import Figure
from emsid.report.figures import Drawing, draw, load

Progress = Callable[[str, float], None]


@contextmanager
def drawing_process() -> Iterator[Executor | None]:
    """A process to draw in while the context lasts, or None where there is no second core to run it.

    For programs: it imports the main module, so a script needs ``if __name__ == "__main__":`` around what it does.
    """
    if (os.cpu_count() or 1) < 2:
        yield None
        return
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_make_ready) as pool:
        try:
            with _without_interrupts():
                pool.submit(os.getpid)  # the first thing asked for starts it
            yield pool
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def draw_all(figures: Iterable[Figure], beside: Executor | None, progress: Progress) -> dict[str, Drawing]:
    """Every figure drawn, by name.

    Args:
        figures: what to draw.
        beside: a `drawing_process`, if there is one.
        progress: called with what is being done and the fraction done.
    """
    order = tuple(figures)
    waiting, drawings = deque(order), dict[str, Drawing]()
    other = Thread(target=_draw_beside, args=(beside, waiting, drawings))
    if beside is not None:
        other.start()
    try:
        while len(drawings) < len(order):
            try:
                figure = waiting.pop()
            except IndexError:  # the last one is being drawn beside, or given back
                other.join()
                continue
            progress(f"drawing {figure.name}", len(drawings) / len(order))
            drawings[figure.name] = draw(figure)
    finally:
        waiting.clear()
    return {figure.name: drawings[figure.name] for figure in order}


def _draw_beside(beside: Executor, waiting: deque[Figure], drawings: dict[str, Drawing]) -> None:
    """Have figures drawn from the first on while there are any; one that a killed process leaves is given back."""
    while waiting:
        try:
            figure = waiting.popleft()
        except IndexError:  # taken at this very moment
            return
        try:
            drawings[figure.name] = beside.submit(draw, figure).result()
        except Exception:  # whatever it is, the parent meets it too, or draws the figure
            waiting.append(figure)
            return


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """A process started meanwhile leaves Ctrl-C to its parent from its first moment on."""
    if not hasattr(signal, "pthread_sigmask"):  # as on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _make_ready() -> None:
    """Load the plotting library, and leave Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    load()
