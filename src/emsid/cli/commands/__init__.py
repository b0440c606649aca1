"""One file for every command; importing it registers the command. ``emsid --help`` lists them in this order."""

from emsid.cli.commands import demo, describe, identify, show, compare, validate, simulate  # noqa: I001
from emsid.cli.commands import (
    orders,
    frequency,
    study,
    studio,
    track,
    bench,
    fleet,
    export,
    compensate,
    control,
    design,
    motors,
)
from emsid.cli.commands import parameters, names

__all__ = [
    "bench",
    "compare",
    "compensate",
    "control",
    "demo",
    "describe",
    "design",
    "export",
    "fleet",
    "frequency",
    "identify",
    "motors",
    "names",
    "orders",
    "parameters",
    "show",
    "simulate",
    "studio",
    "study",
    "track",
    "validate",
]
