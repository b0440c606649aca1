"""Ctrl-C, remembered.

An interrupt within an import or in the middle of a library's work may come out as any other exception, or be lost in a
callback. What is here knows that it was pressed, and what has been found by then.
"""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from time import monotonic

INTERRUPTED = 130
"""The exit status of what was interrupted."""

MOMENT = 1.0
"""Seconds in which Ctrl-C pressed again is the same wish once more, not another one."""


class Interruption:
    """Whether Ctrl-C was pressed since the work at hand began; the handler of the signal.

    Attributes:
        pressed: whether it was.
        words: what to say if the work ends by it.
    """

    def __init__(self) -> None:
        self._when = -inf
        self.begin()

    def __call__(self, *_: object) -> None:
        now = monotonic()
        again = now - self._when < MOMENT
        self._when = now
        if again:  # what the first one has ended is being brought home
            return
        self.pressed = True
        if not self._deferred:
            raise KeyboardInterrupt

    def begin(self) -> None:
        """Nothing has been pressed yet, and nothing found."""
        self.pressed = self._deferred = False
        self._when = -inf
        self.words = "interrupted before anything was found"

    def raise_again(self) -> None:
        """Whatever swallowed Ctrl-C, it ends the work at hand."""
        if self.pressed:
            raise KeyboardInterrupt

    def end(self, interrupted: bool) -> None:
        """The command is done; `emsid.cli.program` says whether it was interrupted."""
        self.pressed = self.pressed or interrupted

    @contextmanager
    def put_off(self) -> Iterator[None]:
        """What is short and belongs together is done to its end."""
        self._deferred = True
        try:
            yield
        finally:
            self._deferred = False


def leave_quietly() -> None:
    """From now on Ctrl-C only hastens the end: all has been written and said."""
    if signal.getsignal(signal.SIGINT) is INTERRUPTION:
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))


INTERRUPTION = Interruption()
