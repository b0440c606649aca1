"""Ctrl-C, remembered.

An interrupt within an import or in the middle of a library's work may come out as any other exception, or be lost in a
callback. What is here knows that it was pressed, and what has been found by then.
"""

from collections.abc import Iterator
from contextlib import contextmanager


class Interruption:
    """Whether Ctrl-C was pressed since the work at hand began; the handler of the signal.

    Attributes:
        pressed: whether it was.
        words: what to say if the work ends by it.
    """

    def __init__(self) -> None:
        self.begin()

    def __call__(self, *_: object) -> None:
        self.pressed = True
        if not self._deferred:
            raise KeyboardInterrupt

    def begin(self) -> None:
        """Nothing has been pressed yet, and nothing found."""
        self.pressed = self._deferred = False
        self.words = "interrupted before anything was found"

    def raise_again(self) -> None:
        """Whatever swallowed Ctrl-C, it ends the work at hand."""
        if self.pressed:
            raise KeyboardInterrupt

    @contextmanager
    def put_off(self) -> Iterator[None]:
        """What is short and belongs together is done to its end."""
        self._deferred = True
        try:
            yield
        finally:
            self._deferred = False


INTERRUPTION = Interruption()
