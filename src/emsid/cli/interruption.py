"""What Ctrl-C does: the only place, with `emsid.__main__`, that knows of it.

While models are searched for, Ctrl-C sets a flag, and nothing else: the search looks at it between its steps (see
`emsid.estimation.nonlinear.control`) and ends with what it has. Pressed once more it ends the program. Where nothing
has been found yet (files are read, modules imported) it ends the program at once; where results are being written it
waits. An exception within an import may come out as another one or be lost in a callback, so the flag is kept.
"""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from time import monotonic

INTERRUPTED = 130
"""The exit status of what was interrupted."""

MOMENT = 1.0
"""Seconds in which Ctrl-C pressed again counts as the same press."""


class Interruption:
    """Whether Ctrl-C was pressed since the work at hand began; the handler of the signal.

    Attributes:
        pressed: whether it was.
        words: what to say if the work ends by it.
    """

    def __init__(self) -> None:
        self.pressed = self._deferred = self._asked = False
        self._when = -inf
        self.begin()

    def __call__(self, *_: object) -> None:
        now = monotonic()
        again = now - self._when < MOMENT
        self._when = now
        if again:
            return
        first, self.pressed = not self.pressed, True
        if self._asked and first:
            if sys.stderr.isatty():
                os.write(2, b"\nstopping after this step; press Ctrl-C again to leave at once\n")
            return
        if not self._deferred:
            raise KeyboardInterrupt

    def begin(self) -> None:
        """Nothing has been pressed yet, and nothing found."""
        self.pressed = self._deferred = self._asked = False
        self._when = -inf
        self.words = "interrupted before anything was found"

    def raise_again(self) -> None:
        """End the work at hand where Ctrl-C was pressed and the exception got lost."""
        if self.pressed:
            raise KeyboardInterrupt

    def end(self, interrupted: bool) -> None:
        """The command is done; `emsid.cli.program` says whether it was interrupted."""
        self.pressed = self.pressed or interrupted

    @contextmanager
    def asked(self) -> Iterator[None]:
        """The work at hand looks at `pressed` and ends by itself; pressed once more, Ctrl-C ends it."""
        self._asked = True
        try:
            yield
        finally:
            self._asked = False

    @contextmanager
    def put_off(self) -> Iterator[None]:
        """Writing is short and is finished before Ctrl-C counts."""
        self._deferred = True
        try:
            yield
        finally:
            self._deferred = False


def leave_quietly() -> None:
    """From now on Ctrl-C ends the program without a word: everything is written and printed."""
    if signal.getsignal(signal.SIGINT) is INTERRUPTION:
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))


INTERRUPTION = Interruption()
