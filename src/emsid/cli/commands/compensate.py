"""``emsid compensate``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.options import Force, Json, quantity, sample_time
from emsid.cli.terminal import say, say_json
from emsid.cli.writing import as_json, check_folder

if TYPE_CHECKING:
    from emsid.compensation.bench import Trial
    from emsid.io import Origin


@app.command()
def compensate(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that emsid wrote.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder to write to.")],
    dt: Annotated[
        float | None,
        typer.Option(metavar="S", parser=sample_time, help="Sample time of the controller.  [default: of the record]"),
    ] = None,
    smooth: Annotated[
        float,
        typer.Option(metavar="V", parser=quantity("V"), help="Smooth the dead zone's inverse up to this voltage."),
    ] = 0.0,
    smooth_speed: Annotated[
        float,
        typer.Option(metavar="X", parser=quantity("rad/s"), help="Smooth the friction's direction up to this speed."),
    ] = 0.0,
    limit: Annotated[
        float | None, typer.Option(metavar="V", parser=quantity("V"), help="The largest command on the bench.")
    ] = None,
    delay: Annotated[int, typer.Option(metavar="N", help="Delay of the bench in samples.", min=0, max=1000)] = 1,
    amplitude: Annotated[
        float | None,
        typer.Option(metavar="X", parser=quantity("rad/s"), help="Largest reference speed on the bench."),
    ] = None,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of files and functions.  [default: that of the model]")
    ] = None,
    single: Annotated[bool, typer.Option("--float", help="C in single precision.")] = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write the inverse of a model in C: dead zone, friction.

    Of a plant of one mass it writes the inverse of the dead zone, the friction for a reference speed, and the command
    that leads from one reference speed to the next, beside the C of the model; of a cascade, the inverse of its static
    map. On a virtual bench (encoder, delay, limit) a PI loop then runs with and without it, and with friction, dead
    zone and inertia 20 % off: the errors are printed, and drawn in compensation.svg.

    \b
    Examples:
      emsid compensate emsid-result/rigid-motor.json --out inverse --dt 1ms
      emsid compensate emsid-result/rigid-motor.json --out inverse --dt 500Hz --smooth 0.1V --limit 12V
      emsid compensate emsid-result/hammerstein.json --out inverse --name drive --float
    """
    from emsid.compensation import Compensation
    from emsid.compensation import compensate as invert
    from emsid.compensation.bench import setting, try_out
    from emsid.compensation.files import write
    from emsid.exports.verb import check_stable
    from emsid.io import load, origin
    from emsid.models.verbs import as_model
    from emsid.report.compensation_views import compensation_figure
    from emsid.report.svg import svg

    check_folder(out)
    loaded, source = load(model), origin(model)
    if dt is None and as_model(loaded).dt is None and source is not None:
        dt = source.dt
    found = invert(loaded, dt=dt, zone_width=smooth, speed_width=smooth_speed)
    check_stable(as_model(loaded), dt)
    trial, more = None, {}
    if isinstance(found, Compensation):
        trial = try_out(loaded, found, setting(found, limit=limit, delay=delay, amplitude=amplitude))
        more["compensation.svg"] = svg(compensation_figure(trial, *_units(source)))
    written = write(loaded, found, out, name=name, dt=dt, single=single, force=force, more=more)
    if json:
        document: dict[str, Any] = {"schema": 1, "files": [str(path) for path in written]}
        say_json(as_json(document | ({} if trial is None else {"trial": trial.to_data()})))
        return
    if trial is not None:
        _say(trial, _units(source)[0])
    say(f"written to {out}: {', '.join(path.name for path in written)}")


def _units(source: "Origin | None") -> tuple[str, str]:
    """The units of a speed and of the command of the record that a model is from."""
    outputs, inputs = ("", "") if source is None else (source.outputs[0][1], source.inputs[0][1])
    return "m/s" if outputs.startswith("m") else "rad/s", inputs or "V"


def _say(trial: "Trial", unit: str) -> None:
    """Print the table of the bench."""
    say(f"PI loop on the virtual bench: RMSE of the true speed in {unit}, and time stuck")
    for name, what in (("sine", "slow sine, in its reversals"), ("steps", "small steps")):
        before, after, wrong = trial.before[name], trial.after[name], trial.worst(name)
        say(
            f"  {what}: {before.rmse:.4g} ({before.stuck:.3g} s) alone, {after.rmse:.4g} ({after.stuck:.3g} s) "
            f"compensated, {trial.gain(name):.1f} times lower"
        )
        say(f"    parameters 20 % off, the worst of {len(trial.wrong)}: {wrong.rmse:.4g} ({wrong.stuck:.3g} s)")
