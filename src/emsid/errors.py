"""The errors of emsid.

Every message says what is wrong, where (column, sample, parameter, file), and what to do about it. The command line
prints the message as one line and exits with status 2. Any other exception is a defect of the program.
"""

from collections.abc import Iterable, Sequence


class EmsidError(Exception):
    """Base of every error that the user can do something about.

    Args:
        message: what is wrong, where, and what to do. Line breaks in it become spaces. It names arguments as in Python,
            never as options of the command line.
        arguments: names of the arguments to change; the command line appends them as options.
    """

    def __init__(self, message: str, *, arguments: Sequence[str] = ()) -> None:
        super().__init__(" ".join(message.splitlines()))
        self.arguments = tuple(arguments)


class DataError(EmsidError):
    """A record or one of its columns cannot be used for this purpose."""


class ModelError(EmsidError):
    """A structure, parameter or model cannot be used for this purpose."""


class FormatError(EmsidError):
    """A file cannot be read or written, or its content does not have the expected format."""


MOST_NAMED = 40
"""A message lists at most this many names."""


def some(names: Iterable[str]) -> str:
    """Join names with commas; of a very long list, give the first names and the total."""
    every = list(names)
    rest = f", … ({len(every)} in all)" if len(every) > MOST_NAMED else ""
    return ", ".join(every[:MOST_NAMED]) + rest


def listed(words: Sequence[str]) -> str:
    """Join words: "a, b and c"."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
