"""One file for every command; importing it registers the command. ``emsid --help`` lists them in this order."""

from emsid.cli.commands import demo, study, identify, validate, simulate, describe, parameters, names  # noqa: I001

__all__ = ["demo", "describe", "identify", "names", "parameters", "simulate", "study", "validate"]
