"""The process of one first look at all rows of a file, for which the server would need too long beside its answers.

    python -m emsid.studio.look FILE

Standard input has the arguments of `emsid.read` that are given, as JSON; standard output gets a
`emsid.studio.data.Look`. An error is one line there, and exit status 2.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

import msgspec

from emsid.errors import EmsidError
from emsid.estimation.borders import border
from emsid.io import ParsedFile, read_columns
from emsid.studio.data import Look


def main() -> None:
    """Look at the file that the command line names."""
    with suppress(AttributeError, OSError):
        os.nice(10)  # whoever uses the page does not wait for it
    problems: list[EmsidError] = []
    path, given = Path(sys.argv[1]), msgspec.json.decode(sys.stdin.buffer.read())
    with border("look", report=problems.append):
        found = Look.at(ParsedFile(path, read_columns(path)), given)
        sys.stdout.buffer.write(msgspec.json.encode(found))
    if problems:
        sys.stdout.write(str(problems[0]))
        sys.exit(2)


if __name__ == "__main__":
    main()
