"""What can go wrong, as types.

Every message says what is wrong, where (column, sample, parameter, file), and what to do about it. The command
line prints the message as one line and exits with status 2; anything that is not an `EmsidError` is a defect.
"""


class EmsidError(Exception):
    """Base of every error that the user can do something about.

    Args:
        message: what is wrong, where, and what to do; put on one line, whatever a file has named its columns.
    """

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.splitlines()))


class DataError(EmsidError):
    """A record, or a column of one, cannot be used as asked."""


class ModelError(EmsidError):
    """A structure, parameter or model cannot be used as asked."""


class FormatError(EmsidError):
    """A file cannot be read or is not what it claims to be."""
