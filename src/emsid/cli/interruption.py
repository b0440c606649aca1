"""Handling of Ctrl-C and SIGTERM. Only this module and `emsid.__main__` handle them.

During a search, Ctrl-C is answered with a line and sets a flag. The search reads the flag between its steps (see
`emsid.estimation.nonlinear.control`) and ends with the best result so far. This is printed and written; then the report
is drawn, which another Ctrl-C leaves out. A second Ctrl-C during the search ends the program. While files are read and
modules imported, Ctrl-C ends the program at once. While results are written, it waits. An exception during an import
may be replaced by another one or lost in a callback, so the flag is kept.

Standard output and standard error that are closed, as after ``>&-`` in a shell.

Python has None in their place. Work goes on, files are written, and a command whose output is lost says so on standard
error and ends with an exit status that is not 0.
"""

import io
import mmap
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import inf
from threading import Thread
from time import monotonic, sleep

INTERRUPTED, TERMINATED = 130, 128 + signal.SIGTERM
"""The exit status of a command that Ctrl-C or SIGTERM ended."""

ERASED = "\r\x1b[2K"
"""Takes a terminal to the beginning of its line, and clears that."""

CLEANING = 1.0
"""Seconds for cleaning up after SIGTERM; writing, and stopping a motor, may take longer."""

MOMENT = 1.0
"""A second Ctrl-C within this many seconds counts as the same one."""


class Interruption:
    """Handler of Ctrl-C.

    Attributes:
        words: the message if it ends the work.
        late: whether it was pressed for the first time while results were written; what follows is short.
        own_process: whether the process runs this program only, and may be ended at once.
    """

    def __init__(self) -> None:
        self._shared = mmap.mmap(-1, 1)
        self.own_process = False
        self.pressed = self.late = self._deferred = False
        self._notify: Callable[[str], None] = print_notice
        self._answer, self._when, self._by_sigterm = "", -inf, False
        self.begin()

    @property
    def pressed(self) -> bool:
        """Whether it was pressed since the present work began; a fork of this process sees it, too."""
        return self._shared[0] == 1

    @pressed.setter
    def pressed(self, pressed: bool) -> None:
        self._shared[0] = pressed

    def __call__(self, *_: object) -> None:
        now = monotonic()
        again = now - self._when < MOMENT
        self._when = now
        if again:
            return
        first, self.pressed = not self.pressed, True
        if self._answer and first:
            self._notify(self._answer)
            return
        if not self._deferred:
            raise KeyboardInterrupt

    def terminate(self, *_: object) -> None:
        """Answer SIGTERM: end by an exception, so that cleaning up takes place, and soon without it.

        Work that `asked` for it ends as with Ctrl-C.
        """
        if self._answer and self._by_sigterm and not self.pressed:
            self.pressed = True
            self._notify(self._answer)
            return
        self.pressed = True  # searches in other threads end as well
        if self.own_process:
            Thread(target=self._leave_soon, name="leaving", daemon=True).start()
        sys.exit(TERMINATED)

    def watch(self) -> None:
        """From now on Ctrl-C that ends this process does so soon, also within compiled code, which Python waits for.

        Python calls a handler of a signal between two of its own steps; to compile a function for the first time, to
        factor a large matrix, or to simulate a motor for hours, is one step of several seconds. During a search the
        second Ctrl-C ends it, otherwise the first.
        """
        receiving, sending = os.pipe()
        os.set_blocking(sending, False)
        signal.set_wakeup_fd(sending, warn_on_full_buffer=False)
        Thread(target=self._watch, args=(receiving,), name="watching", daemon=True).start()

    def _watch(self, receiving: int) -> None:
        """Read the number of every signal as soon as it arrives."""
        pressed = 0
        while number := os.read(receiving, 1):
            if number[0] != signal.SIGINT:
                continue
            pressed += 1
            if pressed > 1 or not self._answer:
                Thread(target=self._leave_unanswered, args=(monotonic(),), name="leaving", daemon=True).start()

    def _leave_unanswered(self, pressed: float) -> None:
        """End the process if by then Python has not called the handler of a signal that came at this time."""
        sleep(CLEANING)
        if self._when < pressed - CLEANING / 2 and not self._deferred:
            print_notice("ended within a step that cannot be interrupted")
            os._exit(INTERRUPTED)

    def _leave_soon(self) -> None:
        sleep(CLEANING)
        while self._deferred:
            sleep(0.01)
        os._exit(TERMINATED)

    def begin(self) -> None:
        """Begin: not pressed yet, no result yet."""
        self.pressed = self.late = self._deferred = False
        self._answer, self._notify, self._when = "", print_notice, -inf
        self.words = "interrupted; there is no result"

    def raise_again(self) -> None:
        """End the present work if Ctrl-C was pressed and its exception was lost."""
        if self.pressed:
            raise KeyboardInterrupt

    def end(self, interrupted: bool) -> None:
        """End the command; `emsid.cli.program` reports an interruption."""
        self.pressed = self.pressed or self.late or interrupted

    @contextmanager
    def asked(
        self, answer: str, notify: Callable[[str], None] | None = None, by_sigterm: bool = False
    ) -> Iterator[None]:
        """The present work reads `pressed` and ends by itself; a second Ctrl-C ends it at once.

        Args:
            answer: what the first Ctrl-C is answered at once.
            notify: shows the answer, by default `print_notice`; called by a handler of a signal.
            by_sigterm: whether SIGTERM, too, is answered and ends the work with its results.
        """
        self._answer, self._notify, self._by_sigterm = answer, notify or print_notice, by_sigterm
        try:
            yield
        finally:
            self._answer = ""

    @contextmanager
    def put_off(self) -> Iterator[None]:
        """Delay Ctrl-C until writing, which is short, is finished."""
        self._deferred = True
        try:
            yield
        finally:
            self._deferred = False


def print_notice(words: str) -> None:
    """Print a line on standard error, in place of a progress bar, which goes on below; safe in a signal handler."""
    in_place = ERASED if sys.stderr is not None and sys.stderr.isatty() else ""
    write_error(f"{in_place}emsid: {words}\n")


def leave_quietly() -> None:
    """From now on Ctrl-C ends the program without a message: everything is written and printed."""
    if signal.getsignal(signal.SIGINT) is INTERRUPTION:
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))


INTERRUPTION = Interruption()


class Closed(io.TextIOBase):
    """A stream that takes text and loses it.

    Attributes:
        lost: whether there was any.
    """

    encoding = "utf-8"

    def __init__(self) -> None:
        self.lost = False

    def write(self, text: str) -> int:
        """Lose a text."""
        self.lost = self.lost or bool(text)
        return len(text)


@contextmanager
def open_streams() -> Iterator[None]:
    """Within this context, both streams can be written to."""
    before = sys.stdout, sys.stderr
    if sys.stdout is None:
        sys.stdout = Closed()
    if sys.stderr is None:
        sys.stderr = Closed()
    try:
        yield
    finally:
        if None in before:
            sys.stdout, sys.stderr = before


def output_is_lost() -> bool:
    """Whether something was printed on a closed standard output."""
    return isinstance(sys.stdout, Closed) and sys.stdout.lost


def write_error(text: str) -> None:
    """Write to standard error at once, as a handler of a signal may; nothing happens where it is closed."""
    with suppress(OSError):
        os.write(2, text.encode())
