"""Forks of this process that work beside it and end with it."""

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeVar

from emsid.errors import EmsidError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkProcess

Result = TypeVar("Result")

LOOK = 0.05
"""Seconds after which a process that waits for its fork looks whether it is to stop."""


def has_free_core() -> bool:
    """Whether this system makes forks, and another core than that of this process may be used."""
    return hasattr(os, "sched_getaffinity") and len(os.sched_getaffinity(0)) > 1


def forked(work: Callable[..., None], *arguments: Any) -> "tuple[ForkProcess, Connection]":
    """A fork of this process, which ignores Ctrl-C, and a connection to it.

    Args:
        work: called there with a function that sends to the connection, and the arguments.
    """
    from multiprocessing import get_context

    context = get_context("fork")
    here, there = context.Pipe()
    process = context.Process(target=_run, args=(work, here, there, *arguments), daemon=True)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    there.close()
    return process, here


def meanwhile(function: Callable[[], Result], *, alone: bool) -> Callable[..., Result]:
    """A function that returns what another one returns, or raises its error; a fork calls that one from now on.

    The function that is returned may be given one that it calls again and again while it waits.

    Args:
        function: what to call; it changes nothing. This process calls it where the fork does not answer.
        alone: whether this process runs nothing else; otherwise the fork might repeat that.
    """
    if not (alone and has_free_core()):
        return lambda waiting=None: function()
    _, connection = forked(_answer, function)

    def answered(waiting: Callable[[], None] = lambda: None) -> Result:
        found: tuple[EmsidError | None, Result] | None = None
        with suppress(EOFError, OSError), connection:
            while not connection.poll(LOOK):
                waiting()
            found = connection.recv()
        if found is None:
            return function()
        problem, result = found
        if problem is not None:
            raise problem
        return result

    return answered


def _answer(send: Callable[[Any], None], function: Callable[[], Any]) -> None:
    """The work of a fork that calls a function: answer with the error of the user and the result.

    After another problem, which the first process meets too and shows, there is no answer.
    """
    answer: tuple[EmsidError | None, Any]
    try:
        answer = None, function()
    except EmsidError as problem:
        answer = problem, None
    except Exception:
        return
    send(answer)


def _run(work: Callable[..., None], other_end: "Connection", connection: "Connection", *arguments: Any) -> None:
    """Run the work in a fork, and end with the first process.

    Args:
        work: what it does.
        other_end: the end of the first process, closed here; otherwise it would not be closed where that process ends.
        connection: the other end.
        arguments: of the work.
    """
    other_end.close()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    Thread(target=_end_with, args=(connection,), daemon=True).start()
    with suppress(BrokenPipeError, ConnectionResetError):
        work(connection.send, *arguments)


def _end_with(connection: "Connection") -> None:
    """End this process with the other one, which sends nothing."""
    with suppress(EOFError, OSError):
        connection.recv()
    os._exit(0)
