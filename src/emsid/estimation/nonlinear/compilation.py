"""Compilation of kernels during a search, which ends where the search is cancelled.

Numba compiles a kernel at its first call on a machine and keeps it on disk. Some kernels take several seconds, within a
single step of a search. The compiler reports each of its passes, and there the search is asked whether it is cancelled.
A kernel that is not complete leaves nothing behind; its next call compiles it anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from numba.core.event import Event, Listener, install_listener

from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control, Stopped


class _Passes(Listener):
    """Is called before and after every pass of the compiler, in the thread that compiles."""

    def __init__(self, control: Control) -> None:
        self._control = control

    def on_start(self, event: Event) -> None:
        if self._control.cancelled():
            raise Stopped(Ending.INTERRUPTED)

    def on_end(self, event: Event) -> None:
        """Nothing: another pass follows, or the kernel is complete."""


@contextmanager
def cancelled_with(control: Control) -> Iterator[None]:
    """Within this context, a call of a kernel that has to be compiled raises `Stopped` once a search is cancelled.

    A time limit does not end the compilation: the same kernels would be missing the next time.
    """
    with install_listener("numba:run_pass", _Passes(control)):
        yield
