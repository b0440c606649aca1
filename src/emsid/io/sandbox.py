"""Parsing of Parquet and HDF5 files in a separate process.

A damaged file can make the libraries for these formats allocate very much memory or crash. In a separate process this
ends only the parser, and its memory is limited where the system can do so.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable

from emsid.errors import FormatError

LONGEST = 120.0
"""Seconds after which a parser is stopped."""
MEMORY, EXPANSION = 1 << 33, 64
"""Bytes of memory that a parser may have, and how many for each byte of the file, if that is more."""


def in_sandbox(parser: Callable[[bytes], bytes], content: bytes, damaged: str) -> bytes:
    """Run a parser on the content of a file in a separate process.

    Args:
        parser: a function of a module; the process imports it.
        content: of the file.
        damaged: the message where the parser fails, crashes or does not end.

    Raises:
        FormatError: with that message.
    """
    most = max(MEMORY, EXPANSION * len(content))
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({most}, {most})); " if os.name == "posix" else ""
    program = (
        f"{limit}import os, sys; result = os.fdopen(os.dup(1), 'wb'); os.dup2(2, 1); "  # libraries print what they miss
        f"from {parser.__module__} import {parser.__name__} as parser; "
        "result.write(parser(sys.stdin.buffer.read())); result.flush()"
    )
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", program], input=content, capture_output=True, check=True, timeout=LONGEST
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
        raise FormatError(damaged) from None
    return done.stdout
