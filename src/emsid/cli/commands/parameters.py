"""``emsid parameters``."""

from typing import Annotated

import typer

from emsid.cli.app import app
from emsid.cli.terminal import say
from emsid.errors import DataError


@app.command()
def parameters(
    plant: Annotated[
        str | None, typer.Argument(metavar="[PLANT]", help="A datasheet of this kind: motor or linear-axis.")
    ] = None,
) -> None:
    """Print a parameter file to edit.

    A motor for simulations or a datasheet for identification, with every parameter, its unit and its meaning.

    \b
    Examples:
      emsid parameters > motor.toml            # for study --motor and simulate --motor
      emsid parameters motor > datasheet.toml  # for identify --datasheet
    """
    from emsid.io import datasheet_template, motor_template

    if plant is None:
        say(motor_template())
        return
    from emsid.models.plants.registry import described

    if plant not in described():
        raise DataError(f"no datasheet of {plant!r}; there are {', '.join(described())}")
    say(datasheet_template(plant))
