"""The command line: parse, call one function, print.

Nothing heavy is imported before a command runs, so that ``emsid --help`` answers at once. Only this package knows the
terminal, signals and the names of options.
"""

from emsid.cli.program import main

__all__ = ["main"]
