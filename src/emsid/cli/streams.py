"""Standard output and standard error that are closed, as after ``>&-`` in a shell.

Python has None in their place. Work goes on, files are written, and a command whose output is lost says so on standard
error and ends with an exit status that is not 0.
"""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress


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
