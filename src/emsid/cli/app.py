"""The Typer application that commands register with, and the texts of ``emsid`` and ``emsid --help``."""

import inspect
import sys
from collections.abc import Callable, Collection
from copy import copy
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from emsid.cli.options import OUTPUT, Debug, Rare
from emsid.options import DECLARED

FIRST_STEPS = """\
emsid turns a record of input and output, such as the voltage and speed of a motor, into a model.
  emsid demo                                            write example records, and commands to try on them
  emsid describe log.csv                                look at a record of your own
  emsid identify log.csv -u voltage -y speed --time t   fit models to it and rank them
  emsid study                                           a complete study; needs no data
  emsid --help                                          all commands"""
"""What ``emsid`` alone prints."""
GROUPS = tuple(dict.fromkeys(each.group for each in DECLARED.values()))
"""The headings of declared options, in the order of the work."""
ALL = "emsid.all"
"""The mark of a context whose help has rare options, too."""


def _print_all(context: typer.Context, asked: bool) -> None:
    if asked:
        context.meta[ALL] = True
        typer.echo(context.get_help())
        raise typer.Exit


HelpAll = Annotated[
    bool, typer.Option("--help-all", help="Show rarely used options, too.", is_eager=True, callback=_print_all)
]


class Command(TyperCommand):
    """A command whose help has options in groups, without rare ones where ``--help`` asks for it."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write a section for every group."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for each in self.get_params(ctx):
            group = getattr(each, "rich_help_panel", None) or f"{each.param_type_name.title()}s"
            record = each.get_help_record(ctx)
            if record is not None and (ctx.meta.get(ALL) or not isinstance(group, Rare)):
                sections.setdefault(str(group), []).append(record)
        last = [group for group in (OUTPUT, "Options") if group in sections]
        first = [group for group in dict.fromkeys(("Arguments", *GROUPS, *sections)) if group in {*sections} - {*last}]
        for group in (*first, *last):
            with formatter.section(group):
                formatter.write_dl(sections[group])


class Commands(typer.Typer):
    """Commands that all have ``--debug``, which its callback answers, and ``--help-all`` if some options are rare."""

    def command(self, *args: Any, **options: Any) -> Callable[[Any], Any]:
        """Register a function as a command."""

        def registered(function: Callable[..., Any]) -> Callable[..., Any]:
            def with_debug(*, debug: bool, help_all: bool = False, **values: Any) -> Any:
                return function(**values)

            own = inspect.signature(function).parameters.values()
            more = {"debug": Debug}
            if any(isinstance(option.rich_help_panel, Rare) for each in own for option in _declared(each)):
                more["help_all"] = HelpAll
            keyword = inspect.Parameter.KEYWORD_ONLY
            added = (inspect.Parameter(name, keyword, default=False, annotation=each) for name, each in more.items())
            parameters = [*(each.replace(kind=keyword) for each in own), *added]
            with_debug.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
            with_debug.__annotations__ = {each.name: each.annotation for each in parameters}
            with_debug.__name__, with_debug.__doc__ = function.__name__, function.__doc__
            typer.Typer.command(self, *args, cls=Command, **options)(with_debug)
            return function

        return registered


def _declared(parameter: inspect.Parameter) -> tuple[Any, ...]:
    return getattr(parameter.annotation, "__metadata__", ())


def for_words(commands: typer.Typer, words: Collection[str] | None) -> typer.Typer:
    """The same commands, of which only those that are among the words of a command line have options.

    To make options takes longer than all else that ``emsid --help`` does.
    """

    def short(info: Any) -> Any:
        name = info.name or info.callback.__name__
        if words is None or name in words:
            return info
        found = copy(info)
        found.callback = _without_options(info.callback)
        return found

    found = copy(commands)
    found.registered_commands = [short(info) for info in commands.registered_commands]
    found.registered_groups = [copy(info) for info in commands.registered_groups]
    for info in found.registered_groups:
        assert info.typer_instance is not None
        info.typer_instance = for_words(info.typer_instance, words)
    return found


def _without_options(function: Callable[..., Any]) -> Callable[[], None]:
    def nothing() -> None:
        pass

    nothing.__name__, nothing.__doc__ = function.__name__, function.__doc__
    return nothing


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
