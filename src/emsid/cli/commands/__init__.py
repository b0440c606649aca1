"""One file for every command; importing it registers the command. ``emsid --help`` lists them in this order."""

from emsid.cli.commands import demo, study, identify, validate, simulate  # noqa: I001
from emsid.cli.commands import track, bench, describe, orders, parameters, names

__all__ = [
    "bench",
    "demo",
    "describe",
    "identify",
    "names",
    "orders",
    "parameters",
    "simulate",
    "study",
    "track",
    "validate",
]
