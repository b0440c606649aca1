"""What can go wrong, as types.

Every message says what is wrong, where (column, sample, parameter, file), and what to do about it. The command
line prints the message as one line and exits with status 2; anything that is not an `EmsidError` is a defect.
"""

from collections.abc import Iterable, Sequence


class EmsidError(Exception):
    """Base of every error that the user can do something about.

    Args:
        message: what is wrong, where, and what to do; put on one line, whatever a file has named its columns. It names
            arguments as Python does, never as options of the command line.
        arguments: the names of the arguments that mend it; the command line appends them as options.
    """

    def __init__(self, message: str, *, arguments: Sequence[str] = ()) -> None:
        super().__init__(" ".join(message.splitlines()))
        self.arguments = tuple(arguments)


class DataError(EmsidError):
    """A record, or a column of one, cannot be used as asked."""


class ModelError(EmsidError):
    """A structure, parameter or model cannot be used as asked."""


class FormatError(EmsidError):
    """A file cannot be read or is not what it claims to be."""


MOST_NAMED = 40
"""How many names a message lists before it counts the rest."""


def some(names: Iterable[str]) -> str:
    """Names with commas between, the first of them where there are very many."""
    every = list(names)
    rest = f", … ({len(every)} in all)" if len(every) > MOST_NAMED else ""
    return ", ".join(every[:MOST_NAMED]) + rest


def listed(words: Sequence[str]) -> str:
    """Words of a message with commas, and an "and" before the last."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
