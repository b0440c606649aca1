"""``emsid export``."""

from pathlib import Path
from typing import Annotated

import typer

from emsid.cli.app import app
from emsid.cli.options import Force, Json, names, pairs, sample_time
from emsid.cli.terminal import say, say_json
from emsid.cli.writing import as_json, check_folder

Options = Annotated[
    list[str], typer.Option("--option", metavar="NAME=VALUE", help="An option of the format; may be repeated.")
]
Assume = Annotated[
    list[str],
    typer.Option(metavar="NAME,NAME,...", help="Physical values that nobody gave or measured and that may be written."),
]


@app.command()
def export(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that emsid wrote.")],
    to: Annotated[str, typer.Option(metavar="FORMAT", help="The format; `emsid list` names them.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder to write to.")],
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of files and functions.  [default: that of the model]")
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option(metavar="S", parser=sample_time, help="Sample time, for a model that has none: 1ms, 100Hz."),
    ] = None,
    single: Annotated[bool, typer.Option("--float", help="C in single precision.")] = False,
    option: Options = [],  # noqa: B006
    assume: Assume = [],  # noqa: B006
    force: Force = False,
    json: Json = False,
) -> None:
    """Write a model as C, an FMU, for a simulator or a firmware.

    Beside the files a README has the equation, the parameters with their intervals, and what could not be carried.
    A format of physical values is refused where one of them is assumed, not measured, unless --assume names it.

    \b
    Examples:
      emsid export emsid-result/rigid-motor.json --to c99 --out motor-c --dt 1ms
      emsid export emsid-result/arx.json --to c99 --out plant --name plant --float
      emsid export emsid-result/rigid-motor.json --to fmu --out fmu --option version=2.0
      emsid export emsid-result/rigid-motor.json --to mujoco --out joint --assume resistance
      emsid export emsid-result/rigid-motor.json --to wpilib --out gains
    """
    from emsid.exports import export as run
    from emsid.exports.quality import unseen_beside
    from emsid.io import load, origin
    from emsid.models.verbs import as_model

    check_folder(out)
    loaded, source = load(model), origin(model)
    if dt is None and as_model(loaded).dt is None and source is not None:
        dt = source.dt
    options = {**pairs(option, "--option", "NAME=VALUE"), **({"single": True} if single else {})}
    permitted = names(assume, "--assume") if assume else ()
    known = unseen_beside(model, loaded)
    written = run(loaded, to, out, name=name, dt=dt, force=force, unseen=known, assume=permitted, **options)
    if json:
        say_json(as_json({"schema": 1, "format": to, "files": [str(path) for path in written]}))
        return
    say(f"written to {out}: {', '.join(path.relative_to(out).as_posix() for path in written)}")
