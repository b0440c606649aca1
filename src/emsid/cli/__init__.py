"""The command line."""

from emsid.cli.commands import main

__all__ = ["main"]
