"""A second process that fits some of the models of `emsid identify` at the same time.

Most searches spend their time in Python, where threads wait for each other. The process is a fork of this one, made
when the searches begin. It computes what this process would; what it does not answer is computed here. Each of the two
takes the next model as soon as it is done with one, this process from the first on and the other one from the last on,
so both end at about the same time. It ends with this process.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Any

from emsid.cli.fork import forked, has_free_core
from emsid.cli.imports import load_page

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkProcess
    from multiprocessing.sharedctypes import SynchronizedArray

    from emsid.estimation import Fit
    from emsid.estimation.nonlinear.control import Control
    from emsid.identification import Options
    from emsid.record import Record

MOST = 64
"""With more models than this, it fits none."""
LAST = 0.5
"""Seconds that an interrupted search may take to end with its best result."""


class SecondProcess:
    """The process, seen from the one that started it.

    Args:
        meanwhile: what this process does before it waits for an answer, each time.
    """

    def __init__(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        from multiprocessing import get_context

        self._context = get_context("fork")
        self._taken, self._ending = self._context.Array("b", MOST), self._context.RawValue("b")
        self._process: ForkProcess | None = None
        self._connection: Connection | None = None
        self._meanwhile = meanwhile
        self._names: tuple[str, ...] = ()
        self._answers: dict[str, Any] = {}
        self._stopped_at = inf

    def begin(self, names: Sequence[str], record: "Record", options: "Options") -> None:
        """Start to fit some of the models there; those of an earlier beginning are done."""
        self.close()
        self._names = ()
        if not 1 < len(names) <= MOST:
            return
        self._names, self._taken = tuple(names), self._context.Array("b", MOST)
        answers = fitted(self._names, record, options, self._taken, lambda: bool(self._ending.value))
        self._process, self._connection = forked(serve, answers)

    def has_begun(self, name: str) -> bool:
        """Whether a model is fitted there; if not, it is left to this process."""
        return name in self._names and not taken(self._taken, self._names.index(name))

    def fitted(self, name: str, control: "Control") -> "Fit[Any] | None":
        """The fit of a model, once it is there; None if there is none.

        Raises:
            EmsidError: where the model cannot be fitted.
            Stopped: by ``control``, where it is stopped before there is a result.
        """

        def wait() -> None:
            if control.ending is None:
                return
            self.stop()
            if monotonic() > self._stopped_at + LAST:
                self.close()
                control.check()

        if name not in self._answers:
            self._meanwhile()
        answer: Fit[Any] | Exception | None = self._answer(name, wait)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def stop(self) -> None:
        """End its search with the best result so far."""
        if not self._ending.value:
            self._stopped_at, self._ending.value = monotonic(), 1

    def close(self) -> None:
        """End the process."""
        if self._process is not None and self._connection is not None:
            self._connection.close()
            self._process.terminate()

    def _answer(self, name: str, wait: Callable[[], None]) -> Any:
        """What the process found for a name; ``wait`` is called again and again meanwhile."""
        with suppress(EOFError, OSError):
            while self._connection is not None and name not in self._answers:
                wait()
                if self._connection.poll(0.02):
                    known, answer = self._connection.recv()
                    self._answers[known] = answer
        return self._answers.get(name)


def second_process(models: Sequence[str], *, alone: bool) -> SecondProcess | None:
    """A second process where there are two cores and several models; the page is prepared while this one waits for it.

    Args:
        models: their names; none for the usual ones.
        alone: whether this process runs nothing else; otherwise the second one might repeat that.
    """
    if len(models) == 1 or not (alone and has_free_core()):
        return None
    return SecondProcess(load_page)


def taken(flags: "SynchronizedArray[int]", k: int) -> bool:
    """Whether the caller may fit the k-th model, as the other process has not begun it; it will not from now on."""
    with flags.get_lock():
        free, flags[k] = not flags[k], 1
    return free


def serve(send: Callable[[Any], None], answers: Iterable[Any]) -> None:
    """The work of the second process: find the answers and send each."""
    from emsid.estimation.threads import sharing_cores

    with sharing_cores(2):
        for answer in answers:
            send(answer)


def fitted(
    names: Sequence[str],
    record: "Record",
    options: "Options",
    flags: "SynchronizedArray[int]",
    cancelled: Callable[[], bool],
) -> Iterable[Any]:
    """The name of every model that is taken here with its fit, the problem, or None."""
    from emsid.errors import EmsidError
    from emsid.estimation.fit import fit_or_problem
    from emsid.estimation.nonlinear.control import Control, Stopped
    from emsid.identification.candidates import CANDIDATES

    for name in reversed(names):
        if cancelled() or not taken(flags, names.index(name)):
            continue
        try:
            yield name, fit_or_problem(partial(CANDIDATES[name], record, options, Control(cancelled=cancelled)))
        except EmsidError as problem:
            yield name, problem
        except (Stopped, Exception):  # the first process meets it too
            yield name, None
