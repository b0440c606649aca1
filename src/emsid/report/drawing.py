"""Figures drawn by two processes: the one that identified, and one made ready beside it in the meantime.

Drawing is bound to one core by the interpreter. The second process is started, and loads what it needs, while the
models are still being fitted. What can be drawn by then, it draws in the meantime; in the end it goes on from the first
of the other figures, and its parent from the last, until they meet.
"""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from threading import Thread

from emsid.report.document import Figure
from emsid.report.figures import Drawing, draw, load

Progress = Callable[[str, float], None]


class Draughtsman:
    """Who draws figures: this process, and if there is one, another beside it.

    Args:
        beside: the other process.
    """

    def __init__(self, beside: Executor | None = None) -> None:
        self.beside = beside
        self._waiting = deque[Figure]()
        self._drawings = dict[str, Drawing]()
        self._begun = set[str]()
        self._other: Thread | None = None

    def begin(self, figures: Iterable[Figure]) -> None:
        """Have these drawn in the meantime, if there is a process for it; figures of one name are the same."""
        self._waiting.extend(figure for figure in figures if figure.name not in self._begun)
        self._begun.update(figure.name for figure in self._waiting)
        if self.beside is not None and (self._other is None or not self._other.is_alive()):
            self._other = Thread(target=self._draw_beside, args=(self.beside,))
            self._other.start()

    def wait(self) -> None:
        """Until the other process has done what it can for now."""
        if self._other is not None:
            self._other.join()

    def finish(self, figures: Iterable[Figure], progress: Progress) -> dict[str, Drawing]:
        """Every figure drawn, by name.

        Args:
            figures: what to draw, of which some may have begun.
            progress: called with what is being done and the fraction done.
        """
        order = tuple(figures)
        self.begin(order)
        try:
            while not all(figure.name in self._drawings for figure in order):
                try:
                    figure = self._waiting.pop()
                except IndexError:  # the last one is being drawn beside, or given back
                    self.wait()
                    continue
                done = sum(figure.name in self._drawings for figure in order)
                progress(f"drawing {figure.name}", done / len(order))
                self._drawings[figure.name] = draw(figure)
        finally:
            self._waiting.clear()
        return {figure.name: self._drawings[figure.name] for figure in order}

    def _draw_beside(self, beside: Executor) -> None:
        """Have figures drawn from the first on while there are any; one that a killed process leaves is given back."""
        while self._waiting:
            try:
                figure = self._waiting.popleft()
            except IndexError:  # taken at this very moment
                return
            try:
                self._drawings[figure.name] = beside.submit(draw, figure).result()
            except Exception:  # whatever it is, the parent meets it too, or draws the figure
                self._waiting.append(figure)
                return


@contextmanager
def draughtsman() -> Iterator[Draughtsman]:
    """One with a process to draw in while the context lasts, if there is a second core to run it.

    For programs: it imports the main module, so a script needs ``if __name__ == "__main__":`` around what it does.
    """
    if (os.cpu_count() or 1) < 2:
        yield Draughtsman()
        return
    others = active_children()
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_make_ready) as pool:
        try:
            with _without_interrupts():
                pool.submit(os.getpid)  # the first thing asked for starts it
            yield Draughtsman(pool)
        finally:
            for child in set(active_children()).difference(others):
                child.terminate()  # it has nothing to lose, and the pool is soon done without it
            pool.shutdown(cancel_futures=True)


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
