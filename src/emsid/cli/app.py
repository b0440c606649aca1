"""The Typer application that commands register with, and the texts of ``emsid`` and ``emsid --help``."""

import inspect
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer

from emsid.cli.options import Debug

FIRST_STEPS = """\
emsid turns a record of input and output, such as the voltage and speed of a motor, into a model.
  emsid demo                                            write example records, and commands to try on them
  emsid describe log.csv                                look at a record of your own
  emsid identify log.csv -u voltage -y speed --time t   fit models to it and rank them
  emsid study                                           a complete study; needs no data
  emsid --help                                          all commands"""
"""What ``emsid`` alone prints."""


class Commands(typer.Typer):
    """Commands that all have ``--debug``, which its callback answers."""

    def command(self, *args: Any, **options: Any) -> Callable[[Any], Any]:
        """Register a function as a command."""

        def registered(function: Callable[..., Any]) -> Callable[..., Any]:
            def with_debug(*, debug: bool, **values: Any) -> Any:
                return function(**values)

            more = inspect.Parameter("debug", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Debug)
            own = inspect.signature(function).parameters.values()
            parameters = [*(each.replace(kind=more.kind) for each in own), more]
            with_debug.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
            with_debug.__annotations__ = {each.name: each.annotation for each in parameters}
            with_debug.__name__, with_debug.__doc__ = function.__name__, function.__doc__
            typer.Typer.command(self, *args, **options)(with_debug)
            return function

        return registered


app = Commands(
    help="Identify electromechanical systems: from a record of voltage and speed to a model you can trust.",
    epilog="""
    \b
    Examples:
      emsid demo                                                      example records to try commands on
      emsid describe log.csv                                          ends with the command for identify
      emsid identify log.csv --input voltage --output speed --dt 1ms
      emsid show emsid-result/best.json
      emsid validate emsid-result/best.json other.csv
      emsid study                                                     a complete study; needs no data
    """,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)


def _version(asked: bool) -> None:
    if asked:
        print(f"emsid {sys.modules['emsid'].__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_version)
    ] = False,
) -> None:
    pass
