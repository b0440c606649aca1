"""``emsid parameters``."""

from typing import Annotated

import typer

from emsid.arguments import did_you_mean
from emsid.cli.app import app
from emsid.cli.options import Json
from emsid.cli.terminal import say, say_json
from emsid.cli.writing import as_json
from emsid.errors import DataError

SAME = {"rigid-motor": "motor"}
"""Models whose datasheet is that of another one, which has all of their parameters."""


@app.command()
def parameters(
    plant: Annotated[
        str | None,
        typer.Argument(metavar="PLANT", help="Kind of datasheet: motor, rigid-motor (the same) or linear-axis."),
    ] = None,
    json: Json = False,
) -> None:
    """Print a parameter file to edit.

    The file describes a motor for simulation, or a datasheet for identification, with unit and meaning of every
    parameter.

    \b
    Examples:
      emsid parameters > motor.toml            # for study --motor and simulate --motor
      emsid parameters motor > datasheet.toml  # for identify --datasheet
    """
    from emsid.io import datasheet_template, motor_template
    from emsid.models.plants.registry import described

    plant = SAME.get(plant or "", plant)
    if plant is not None and plant not in described():
        raise DataError(
            f"no datasheet of {plant!r}{did_you_mean(plant, described())}; there are {', '.join((*described(), *SAME))}"
        )
    if not json:
        say(motor_template() if plant is None else datasheet_template(plant))
        return
    from emsid.plant import Motor

    known = Motor.parameters() if plant is None else _parameters(plant)
    rows = [dict(zip(("name", "symbol", "unit", "meaning"), each, strict=True)) for each in known]
    say_json(as_json({"schema": 1, "plant": plant or "motor", "parameters": rows}))


def _parameters(plant: str) -> list[tuple[str, str, str, str]]:
    """Name, symbol, unit and meaning of everything that a datasheet may say of a plant."""
    from emsid.models.plants.registry import described

    return [
        (name, handle.parameter.symbol, handle.parameter.unit, handle.parameter.description)
        for name, handle in described()[plant].handles.items()
    ]
