"""``emsid demo``."""

from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.terminal import say
from emsid.cli.writing import check_folder

PAGE = "commands.md"

COMMANDS = {
    "motor": (
        ("describe motor.csv -u voltage -y speed --time t", "ranges, time axis, how rich the input is"),
        (
            "identify motor.csv -u voltage -y speed --time t --models arx,rigid-motor --fix R=2 --out motor-result",
            "a linear model, and the motor with physical parameters; open motor-result/report.html",
        ),
        (
            "simulate motor-result/rigid-motor.json motor.csv --out simulated.csv",
            "the identified motor, driven by the voltages in the file",
        ),
    ),
    "axis": (
        (
            "identify axis.csv -u force -y position --time t --models linear-axis --out axis-result",
            "mass, friction and offset with 95 % intervals",
        ),
    ),
    "circuit": (
        (
            "identify circuit.csv -u source -y output --time t --models arx,wiener-hammerstein --orders 1,2 "
            "--out circuit-result",
            "a linear model, and three blocks whose static map is chosen",
        ),
        (
            "validate circuit-result/wiener-hammerstein.json circuit.csv --rows 4200:6000",
            "the free run of a saved model on the rows that it was not fitted to",
        ),
    ),
}
"""The arguments of ``emsid`` to try on each example, and what they show."""


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where to write.")] = Path("emsid-demo"),
) -> None:
    """Write example records, and commands to try on them.

    A motor with a dead zone, a positioning axis with friction, and a Wiener-Hammerstein circuit, made by the program,
    with true values that are stated on the page.

    \b
    Example:
      emsid demo
    """
    from emsid.io import atomic_write, write_record
    from emsid.study.demonstration import EXAMPLES

    check_folder(folder, given="")
    INTERRUPTION.words = "interrupted; only the files named above are complete"
    for example in EXAMPLES:
        record = example.record()
        write_record(record, folder / f"{example.name}.csv")
        say(f"{folder / example.name}.csv: {example.title}, {len(record):,} samples")
    atomic_write(folder / PAGE, commands_page().encode())
    say(f"{folder / PAGE}: commands to try, from within the folder; the first is")
    enter = "" if folder == Path() else f"cd {quote(str(folder))} && "
    say(f"  {enter}emsid {COMMANDS[EXAMPLES[0].name][0][0]}")


def commands_page() -> str:
    """The examples and their commands as a page in Markdown."""
    from emsid.study.demonstration import EXAMPLES

    lines = ["# Commands to try", "", "Run them in this folder. Each takes a few seconds.", ""]
    for example in EXAMPLES:
        lines += [f"## `{example.name}.csv`: {example.title}", "", example.contents, ""]
        for command, shows in COMMANDS[example.name]:
            lines += [f"{shows[0].upper()}{shows[1:]}:", "", f"    emsid {command}", ""]
    lines += ["`emsid --help` lists all commands, and `emsid COMMAND --help` their options.", ""]
    return "\n".join(lines)
