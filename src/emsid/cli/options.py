"""Options of several commands, made from the declarations in `emsid.options`; parsers of their values."""

import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from logging import StreamHandler
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from emsid.errors import DataError, EmsidError
from emsid.options import DECLARED, Declared

Command = TypeVar("Command", bound=Callable[..., None])
SPELLINGS = {name: each.spelled[0] for name, each in DECLARED.items() if each.spelled}
SPELLINGS |= {"profiles": "profile", "plant.codes": "brake", "unseen": "validate"}
"""Arguments of the library whose option has another name."""
OUTPUT = "Output"
"""The heading of options about what is printed and written."""


class Rare(str):
    """The heading of an option that only ``--help-all`` shows."""


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


def rows(text: str, name: str) -> slice:
    """``A:B``."""
    first, colon, last = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return slice(int(first) if first else None, int(last) if last else None)
    except ValueError:
        raise DataError(f"{name} {text!r}: write it as A:B, the data rows from A up to but not B") from None


TYPES: dict[str, Any] = {
    "switch": bool, "whole": int | None, "number": float | None, "fraction": float | None, "sample time": float | None,
    "text": str | None, "wholes": str | None, "rows": str | None, "file": Path | None,
}  # fmt: skip
"""The types of options whose value is not a list of texts, by the kind of value."""
PARSED: dict[str, Callable[[Any, str], Any]] = {
    "wholes": counts, "rows": rows, "names": names, "numbers by column": numbers, "texts by column": pairs,
    "values by name": lambda texts, name: pairs(texts, name, "NAME=VALUE"),
}  # fmt: skip
"""How the texts of an option become its value, where its parser does not do that."""


def declared(name: str) -> Any:
    """The option of the command line for an argument of the library."""
    each = DECLARED[name]
    flags = [f"-{flag}" if len(flag) == 1 else f"--{flag.replace('_', '-')}" for flag in each.spelled or (name,)]
    shown = f"{each.meaning}.{f'  [default: {each.default}]' if each.default is not None else ''}"
    parser: Any = {"fraction": fraction, "sample time": sample_time}.get(each.kind)
    parser = quantity(each.unit) if each.unit else parser
    return typer.Option(
        *flags, help=shown, min=each.least, parser=parser, show_default=False,
        metavar=None if each.kind == "switch" else each.metavar,
        rich_help_panel=(Rare if each.rare else str)(each.group),
    )  # fmt: skip


def takes(
    group: Sequence[Declared], argument: str, made: Callable[[dict[str, Any]], Any] = dict, **usual: Any
) -> Callable[[Command], Command]:
    """Add declared options to a command, which takes what is made from those that are given as one argument.

    Args:
        group: the declarations.
        argument: the name of that argument.
        made: makes it from the values by name; by default they are it.
        usual: values of options that are not given.
    """

    def decorate(command: Command) -> Command:
        own = {name: p for name, p in inspect.signature(command).parameters.items() if name != argument}
        shared = [
            inspect.Parameter(
                each.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=usual.get(each.name, {"switch": False}.get(each.kind) if each.kind in TYPES else []),
                annotation=Annotated[TYPES.get(each.kind, list[str]), declared(each.name)],
            )
            for each in group
            if each.name not in own and each.kind != "codes"
        ]

        def with_declared(**values: Any) -> None:
            typed = {each.name: values.pop(each.name) for each in shared}
            given = {
                name: PARSED[kind](value, option(name)) if kind in PARSED else value
                for name, value in typed.items()
                if value is not None and value is not False and value != []
                for kind in [DECLARED[name].kind]
            }
            command(**{argument: made(given)}, **values)

        parameters = [p.replace(kind=p.KEYWORD_ONLY) for p in (*own.values(), *shared)]
        with_declared.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        with_declared.__annotations__ = {p.name: p.annotation for p in parameters}
        with_declared.__name__, with_declared.__doc__ = command.__name__, command.__doc__
        return with_declared  # type: ignore[return-value]

    return decorate


def print_tracebacks(asked: bool) -> None:
    """Print what `emsid.estimation.borders` logs on standard error, if that is asked for."""
    if asked:
        from emsid.estimation.borders import LOG

        LOG.setLevel("DEBUG")
        LOG.addHandler(StreamHandler())


def _output(*flags: str, **how: Any) -> Any:
    return typer.Option(*flags, rich_help_panel=OUTPUT, **how)


Transient = Annotated[int | None, declared("transient")]
Out = Annotated[Path, _output(metavar="DIR", help="Folder for the report, the figures and the results.")]
PageFolder = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder for a report with figures; by default none is written.")
]
Pdf = Annotated[bool, _output("--pdf", help="Write every figure as PDF too.")]
Debug = Annotated[
    bool,
    _output("--debug", help="Print the traceback of whatever fails inside.", is_eager=True, callback=print_tracebacks),
]
Details = Annotated[bool, _output("--details", help="Print all models, values and findings, too.")]
Json = Annotated[bool, _output("--json", help="Print JSON on standard output, and nothing else there.")]
Encoder = Annotated[float | None, typer.Option(metavar="N", help="Counts of the encoder per revolution (per m).")]
Force = Annotated[bool, _output("--force", help="Replace files that exist.")]
