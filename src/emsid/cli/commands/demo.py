"""``emsid demo``."""

from pathlib import Path
from typing import Annotated

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.reading import command_line, file_word
from emsid.cli.terminal import say, working
from emsid.cli.writing import check_folder

PAGE = "commands.md"

COMMANDS = {
    "motor": (
        ("describe motor.csv -u voltage -y speed --time t", "ranges, time axis, how rich the input is"),
        (
            "identify motor.csv -u voltage -y speed --time t --models arx,rigid-motor --fix resistance=0.8 "
            "--out motor-result",
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
    fleet: Annotated[
        int, typer.Option(metavar="N", help="Write a fleet of N motors in their place.", min=0, show_default=False)
    ] = 0,
    seed: Annotated[int, typer.Option(metavar="K", help="With --fleet: seed of motors and noise.", min=0)] = 1,
) -> None:
    """Write example records, and commands to try on them.

    A motor with a dead zone, a positioning axis with friction, and a Wiener-Hammerstein circuit, made by the program,
    with true values that are stated on the page. With --fleet, many motors, some of which are worn.

    \b
    Examples:
      emsid demo
      emsid demo motors --fleet 40
    """
    from emsid.io import atomic_write, write_record
    from emsid.io.files import together
    from emsid.study.demonstration import EXAMPLES

    check_folder(folder, PAGE, *(f"{example.name}.csv" for example in EXAMPLES), given="")
    if fleet:
        _fleet(folder, fleet, seed)
        return
    INTERRUPTION.words = "interrupted; nothing is written"
    with together():
        records = {example: example.record() for example in EXAMPLES}
        for example, record in records.items():
            write_record(record, folder / f"{example.name}.csv")
        atomic_write(folder / PAGE, commands_page().encode())
    for example, record in records.items():
        say(f"{folder / example.name}.csv: {example.title}, {len(record):,} samples")
    say(f"{folder / PAGE}: commands to try, from within the folder; the first is")
    enter = "" if folder == Path() else f"{command_line(['cd', file_word(str(folder))])} && "
    say(f"  {enter}emsid {COMMANDS[EXAMPLES[0].name][0][0]}")


def _fleet(folder: Path, motors: int, seed: int) -> None:
    """Write a fleet, and what is wrong in it."""
    from emsid.fleets.simulated import LOAD, WEAR, simulated_fleet
    from emsid.io.files import together

    faults = {"worn": max(motors // 50, 1), "loaded": int(motors >= 8), "poisoned": min(3, motors // 10)}
    with working("ending; nothing is written") as control, together():
        made = simulated_fleet(folder, motors, **faults, seed=seed, control=control)
    say(f"{folder}: {motors:,} motors")
    say(f"- worn bearings, Coulomb friction times {WEAR:g}: {', '.join(made.worn)}")
    say(f"- another load, inertia times {LOAD:g}: {', '.join(made.loaded) or 'none'}")
    say(f"- files that cannot be used: {', '.join(made.poisoned) or 'none'}")
    columns = "-u voltage -y speed --time t --unit voltage=V --unit speed=rad/s"
    say(f"  emsid fleet {command_line([file_word(str(folder))])} {columns} --fix resistance=2")


def commands_page() -> str:
    """The examples and their commands as a page in Markdown."""
    from emsid.study.demonstration import EXAMPLES

    lines = ["# Commands to try", "", "Run them in this folder. The first run compiles and takes longer.", ""]
    for example in EXAMPLES:
        lines += [f"## `{example.name}.csv`: {example.title}", "", example.contents, ""]
        lines += ["| simulated | true value | unit | meaning |", "|---|---|---|---|"]
        lines += [f"| {name} | {value:.6g} | {unit} | {meaning} |" for name, value, unit, meaning in example.true]
        lines.append("")
        for command, shows in COMMANDS[example.name]:
            lines += [f"{shows[0].upper()}{shows[1:]}:", "", f"    emsid {command}", ""]
    lines += ["`emsid --help` lists all commands, and `emsid COMMAND --help` their options.", ""]
    return "\n".join(lines)
