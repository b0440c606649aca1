r"""Command lines that can be pasted into a shell.

A word is quoted as a POSIX shell reads it. One with control characters or bytes that are no text goes into ``$'…'``,
which bash, zsh and ksh read, so that nothing that a terminal obeys is printed: ``$'a\033b'``.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable


def command_line(words: Iterable[str]) -> str:
    r"""Words of a command as one line, which a shell divides into the same words.

    >>> print(command_line(["emsid", "describe", "my log.csv"]), command_line(["a\nb"]))
    emsid describe 'my log.csv' $'a\nb'
    """
    return " ".join(_quoted(word) for word in words)


def file_word(path: str) -> str:
    """The path of a file as a word of a command line, which is not taken for an option.

    >>> file_word("-x.csv"), file_word("x.csv")
    ('./-x.csv', 'x.csv')
    """
    return f"./{path}" if path.startswith("-") else path


_ESCAPES = {"\n": r"\n", "\r": r"\r", "\t": r"\t", "\\": r"\\", "'": r"\'"}


def _quoted(word: str) -> str:
    if word.isprintable():
        return shlex.quote(word)
    return f"$'{''.join(map(_escaped, word))}'"


def _escaped(sign: str) -> str:
    if sign in _ESCAPES:
        return _ESCAPES[sign]
    if sign.isprintable():
        return sign
    return "".join(f"\\{byte:03o}" for byte in os.fsencode(sign))
