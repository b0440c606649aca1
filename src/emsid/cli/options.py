"""Options of several commands, parsers of their values, and option names of the library's arguments."""

import re
from collections.abc import Callable, Iterable, Sequence
from logging import StreamHandler
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

from emsid.errors import DataError, EmsidError

SPELLINGS = {
    "units": "unit",
    "signals": "signal",
    "fixed": "fix",
    "profiles": "profile",
    "plant.codes": "brake",
    "unseen": "validate",
}
"""Arguments of the library whose option has another name."""


def option(argument: str) -> str:
    """The option for an argument of the library.

    >>> option("counts_per_revolution"), option("units")
    ('--counts-per-revolution', '--unit')
    """
    return f"--{SPELLINGS.get(argument, argument).replace('_', '-')}"


def with_options(problem: EmsidError) -> str:
    """The message of an error, followed by the options to change: ``… (--dt, --time)``."""
    options = [spelled for spelled in map(option, problem.arguments) if spelled not in str(problem)]
    return f"{problem} ({', '.join(options)})" if options else str(problem)


# --- values on the command line --------------------------------------------------------------------------------------


def fraction(text: str | float) -> float:
    """The share of the data to keep unseen, for the parser of options."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value < 1:
        raise typer.BadParameter(f"{text}: give a fraction between 0 and 1; name files of unseen data with --validate")
    return value


def quantity(unit: str) -> Callable[[str | float], float]:
    """A parser of numbers in this unit or with their own unit: ``0.01``, ``10ms``, ``10 ms``."""

    def read(text: str | float) -> float:
        if isinstance(text, float):  # a default
            return text
        number = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf))\s*(.*?)\s*", text)
        if number is None:
            raise typer.BadParameter(f"{text!r} is not a number; write it like 0.01, or with a unit")
        if not number[2]:
            return float(number[1])
        from emsid.units import conversion

        try:
            gain, zero, _ = conversion(number[2], unit)
        except DataError as problem:
            raise typer.BadParameter(str(problem)) from None
        return gain * float(number[1]) + zero

    read.__name__ = f"number or quantity in {unit}"
    return read


def sample_time(text: str | float) -> float:
    """A sample time in s, ``0.01`` or ``10ms``, or the sampling frequency, ``100 Hz``, for the parser of options."""
    if not isinstance(text, str) or not text.rstrip().lower().endswith("hz"):
        return quantity("s")(text)
    frequency = quantity("Hz")(re.sub("hz$", "Hz", text.rstrip(), flags=re.IGNORECASE))
    if not frequency > 0:
        raise typer.BadParameter(f"{text!r}: give a positive frequency")
    return 1 / frequency


def pairs(texts: Iterable[str], name: str, form: str = "COLUMN=VALUE") -> dict[str, str]:
    """Parse ``NAME=VALUE`` texts."""
    found: dict[str, str] = {}
    for text in texts:
        key, equals, value = text.rpartition("=")
        if not equals or not key or not value:
            raise DataError(f"{name} {text!r}: write it as {form}")
        if found.setdefault(key, value) != value:
            raise DataError(f"{name} gives {key} twice, as {found[key]} and as {value}; leave one of them out")
    return found


def numbers(texts: Iterable[str], name: str) -> dict[str, float]:
    """Parse ``COLUMN=NUMBER`` texts."""
    found = {}
    for key, value in pairs(texts, name).items():
        try:
            found[key] = float(value)
        except ValueError:
            raise DataError(f"{name} {key}={value}: {value!r} is not a number") from None
    return found


def names(texts: Sequence[str], name: str) -> tuple[str, ...]:
    """Parse ``NAME,NAME,…`` of an option that may be repeated; each name is kept once."""
    found = tuple(dict.fromkeys(each.strip() for text in texts for each in text.split(",")))
    if not all(found):
        raise DataError(f"{name} {','.join(texts)!r}: write it as names with commas between")
    return found


def counts(text: str | None, name: str) -> tuple[int, ...]:
    """``N,N,…``."""
    try:
        return () if text is None else tuple(int(count) for count in text.split(","))
    except ValueError:
        raise DataError(f"{name} {text!r}: write it as whole numbers with commas between") from None


def physical_values(texts: Iterable[str], plants: Sequence[Any]) -> dict[str, float | str]:
    """Parse ``PARAMETER=VALUE`` texts of ``--fix`` into SI units; the value may have a unit: ``resistance=2 ohm``.

    A value with a tolerance (``resistance=2 ohm ± 5 %``) remains a text in SI units with its tolerance.

    Args:
        texts: the texts of the option.
        plants: those that may have the parameter; the first one that has it defines its unit.
    """
    from emsid.models.plants.datasheet import without_tolerances
    from emsid.plant.motor import read_number

    found: dict[str, float | str] = {}
    typed, tolerances = without_tolerances(pairs(texts, "--fix", "NAME=VALUE"))
    for key, value in typed.items():
        name, bracket, record = key.partition("[")
        parameter, handle = _known(name, plants)
        parameter += bracket + record
        number = read_number(f"--fix {parameter}", value, handle.parameter.unit)
        if not isfinite(number):
            raise DataError(f"--fix {key}={value}: give a finite number")
        if parameter in found:
            raise DataError(f"--fix gives {parameter} twice; leave one of them out")
        found[parameter] = f"{number!r} ± {100 * tolerances[key]!r} %" if key in tolerances else number
    return found


def physical_names(texts: Sequence[str], name: str, plants: Sequence[Any]) -> tuple[str, ...]:
    """Parse ``PARAMETER,PARAMETER,…`` of an option that may be repeated; a symbol may replace the name."""
    return tuple(_known(each, plants)[0] for each in names(texts, name))


def _known(key: str, plants: Sequence[Any]) -> tuple[str, Any]:
    """The name and the handle of a parameter in the first plant that has it.

    Raises:
        ModelError: where no plant has it; the message lists the parameters of the first plant.
    """
    from emsid.models.plants.parameters import find_handle

    problems: list[EmsidError] = []
    for plant in plants:
        try:
            handle = find_handle(plant, key)
        except EmsidError as problem:
            problems.append(problem)
        else:
            return next(name for name, each in plant.handles.items() if each is handle), handle
    raise problems[0]


def print_tracebacks(asked: bool) -> None:
    """Print what `emsid.estimation.borders` logs on standard error, if that is asked for."""
    if asked:
        from emsid.estimation.borders import LOG

        LOG.setLevel("DEBUG")
        LOG.addHandler(StreamHandler())


Transient = Annotated[
    int | None,
    typer.Option(metavar="N", help="Samples that start a free run in motion and are left out of errors.", min=0),
]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder for the report, the figures and the results.")]
Pdf = Annotated[bool, typer.Option("--pdf", help="Write every figure as PDF too.")]
Debug = Annotated[
    bool,
    typer.Option(
        "--debug", help="Print the traceback of whatever fails inside.", is_eager=True, callback=print_tracebacks
    ),
]
Details = Annotated[bool, typer.Option("--details", help="Print all models, values and findings, too.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, and nothing else there.")]
Encoder = Annotated[float | None, typer.Option(metavar="N", help="Counts of the encoder per revolution (per m).")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
