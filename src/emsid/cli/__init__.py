"""The command line: parse options, call one function, print.

No large library is imported before a command runs, so that ``emsid --help`` is fast. Only this package uses the
terminal, signals and the names of options.
"""

from emsid.cli.program import main

__all__ = ["main"]
