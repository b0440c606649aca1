"""A second process: a fork of this one that works beside it, reads files or fits models, and ends with it.

Most searches spend their time in Python, where threads wait for each other. The fork shares what this process has
loaded, and looks at the same flag of Ctrl-C (`Interruption.pressed`).

Fast imports of large libraries.
"""

import gc
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeVar

from emsid.cli.interruption import INTERRUPTION
from emsid.errors import EmsidError

if TYPE_CHECKING:
    from concurrent.futures import Future

    from emsid.estimation import Fit
    from emsid.identification import Options
    from emsid.record import Record


Result = TypeVar("Result")


def is_possible() -> bool:
    """Whether this process runs nothing else, which a fork might repeat, and another core is free."""
    several = hasattr(os, "sched_getaffinity") and len(os.sched_getaffinity(0)) > 1
    return several and INTERRUPTION.own_process


def forked(function: Callable[..., Result]) -> "Callable[..., Future[Result]]":
    """Fork this process; what is returned calls a function there, with other arguments each time.

    Args:
        function: of which the fork has a copy, with all its data; it changes nothing.
    """
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    pool = ProcessPoolExecutor(1, get_context("fork"), _begin, (function,))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the fork keeps Ctrl-C blocked
    try:
        pool.submit(int)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return partial(pool.submit, _call)


def meanwhile(function: Callable[[], Result]) -> Callable[[], Result]:
    """A function that returns what another one returns, or raises its error; a fork, if possible, calls it from now on.

    Where the fork does not answer, or meets a problem that is not of the user, this process calls the function.
    """
    if not is_possible():
        return function
    found = forked(function)()

    def answered() -> Result:
        try:
            return found.result()
        except EmsidError:
            raise
        except Exception:
            return function()

    return answered


def fits(record: "Record", options: "Options") -> "Callable[[str], Future[Fit[Any]]]":
    """Fork this process to fit models to a record there, by name; see `emsid.identify`."""
    return forked(partial(_fit, record, options))


def _fit(record: "Record", options: "Options", name: str) -> "Fit[Any]":
    from emsid.estimation.fit import fit_or_problem
    from emsid.estimation.nonlinear.control import Control
    from emsid.estimation.threads import sharing_cores
    from emsid.identification.candidates import CANDIDATES

    with sharing_cores(2):
        control = Control(cancelled=lambda: INTERRUPTION.pressed)
        return fit_or_problem(partial(CANDIDATES[name], record, options, control))


_OF_FORK: list[Callable[..., Any]] = []
"""In a fork, the function that it calls."""


def _begin(function: Callable[..., Any]) -> None:
    """In a fork: keep the function, and end with the first process."""
    _OF_FORK[:] = [function]
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    Thread(target=_end_with_parent, daemon=True).start()


def _call(*arguments: Sequence[Any]) -> Any:
    return _OF_FORK[0](*arguments)


def _end_with_parent() -> None:
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is not None:
        parent.join()
    os._exit(0)


@contextmanager
def without_collection() -> Iterator[None]:
    """Within this context no garbage is collected; objects that exist at its end are left out of later collections.

    Imports make many objects that stay. To visit them again and again takes a quarter of the time of a short command.
    """
    collected = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if collected:
            gc.enable()


def load_reading() -> None:
    """Import what the reading of a file and an identification both need."""
    import emsid.first_look.clock
    import emsid.io  # noqa: F401


def load_identification() -> None:
    """Import what an identification needs, with what the first call of a compiled function loads for all of them."""
    import emsid.identification  # noqa: F401
    from emsid.estimation.linear.filtering import filtered

    filtered([1.0], [1.0], [1.0])
