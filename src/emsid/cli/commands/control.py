"""``emsid control``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.options import Encoder, Force, Json, names, quantity, sample_time
from emsid.cli.terminal import Align, plain_table, say, say_json, show
from emsid.cli.writing import as_json, check_folder

if TYPE_CHECKING:
    from emsid.controllers import ControlBench, Controller


@app.command()
def control(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that emsid wrote.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder to write to.")],
    bandwidth: Annotated[
        float | None,
        typer.Option(metavar="HZ", parser=quantity("Hz"), help="Bandwidth of the closed loop.  [default: the fastest]"),
    ] = None,
    overshoot: Annotated[
        float, typer.Option(metavar="X", parser=quantity("1"), help="Largest overshoot of a step, 5% or 0.05.")
    ] = 0.05,
    dt: Annotated[
        float | None,
        typer.Option(
            "--sample",
            "--dt",
            metavar="S",
            parser=sample_time,
            help="Sample time of the controller.  [default: of the record]",
        ),
    ] = None,
    encoder: Encoder = None,
    delay: Annotated[
        float | None,
        typer.Option(metavar="S", parser=quantity("s"), help="From measurement to command.  [default: one sample]"),
    ] = None,
    loop: Annotated[
        str, typer.Option(metavar="NAME", help="position, speed for no position loop, or current of a brushless motor.")
    ] = "position",
    current: Annotated[
        bool | None,
        typer.Option("--current/--no-current", help="Current loop.  [default: where R and L are known]"),
    ] = None,
    current_dt: Annotated[
        float | None,
        typer.Option(metavar="S", parser=sample_time, help="Its sample time.  [default: a tenth of --sample]"),
    ] = None,
    limit: Annotated[
        float | None,
        typer.Option(metavar="V", parser=quantity("V"), help="The largest command.  [default: of the drive]"),
    ] = None,
    backlash: Annotated[
        float | None,
        typer.Option(metavar="X", parser=quantity("rad"), help="Backlash on the bench.  [default: three counts]"),
    ] = None,
    pole_pairs: Annotated[int | None, typer.Option(metavar="N", help="Pole pairs, for gains of a VESC.")] = None,
    current_max: Annotated[
        float | None, typer.Option(metavar="A", parser=quantity("A"), help="Largest current of the VESC.")
    ] = None,
    assume: Annotated[
        list[str], typer.Option(metavar="NAMES", help="Parameters that nobody measured and that may be used.")
    ] = [],  # noqa: B006
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the points of the region.", min=0)] = 1,
    modes: Annotated[
        Path | None,
        typer.Option(metavar="MODEL", help="Model of the response at the motor, whose mode the notch takes."),
    ] = None,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of the gains in C.  [default: that of the model]")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Design a cascade of loops: current, speed, position.

    The fastest cascade, or that of the bandwidth, whose margins hold over the 95 % region of the estimates and with
    friction 30 % off; where they do not hold, the bandwidth is reduced. Feed-forward, compensation of friction and dead
    zone, and anti-windup are in it. It runs on a bench with encoder, delay, limit, backlash and wrong friction, beside
    usual rules. Written are C, an Arduino sketch, gains for SimpleFOC, ODrive, VESC and WPILib, and a page.

    \b
    Examples:
      emsid control emsid-result/rigid-motor.json --out drive --sample 1ms --encoder 2000
      emsid control emsid-result/rigid-motor.json --out drive --bandwidth 20Hz --overshoot 5% --delay 1ms
      emsid control emsid-result/rigid-motor.json --out drive --loop speed --limit 12V --json
      emsid control emsid-result/rigid-motor.json --out drive --modes response/transfer-function.json
      emsid control emsid-result/brushless.json --out loop --loop current --sample 10kHz --bandwidth 200Hz
    """
    from emsid.controllers import control as run
    from emsid.controllers.files import write
    from emsid.io import load, origin
    from emsid.models.verbs import as_model
    from emsid.report.control_page import control_report
    from emsid.report.page import report_files

    check_folder(out)
    loaded, source = load(model), origin(model)
    if loop == "current":
        _current(loaded, out, dt, bandwidth, names(assume, "--assume"), seed, name, force, json)
        return
    if dt is None and as_model(loaded).dt is None and source is not None:
        dt = source.dt
    found = run(
        loaded, dt=dt, bandwidth=bandwidth, overshoot=overshoot, encoder=encoder, delay=delay, loop=loop,
        current=current, current_dt=current_dt, limit=limit, backlash=backlash, pole_pairs=pole_pairs,
        current_max=current_max, assume=names(assume, "--assume"), seed=seed,
        modes=None if modes is None else load(modes),
    )  # fmt: skip
    page = report_files(control_report(found), formats=())
    written = write(found, out, name=name, force=force, more=page)
    if json:
        say_json(as_json({"schema": 1, "files": [str(path) for path in written], **found.to_data()}))
        return
    _say(found)
    say(f"written to {out}: {', '.join(path.name for path in written)}")


def _current(
    model: Any, out: Path, dt: float | None, bandwidth: float | None, assume: Any, seed: int, name: str | None,
    force: bool, json: bool,
) -> None:  # fmt: skip
    """Design, write and print the current loop of a brushless motor."""
    from emsid.controllers.current import current_control, summary, write_current

    found = current_control(model, dt=dt, bandwidth=bandwidth, assume=assume, seed=seed)
    written = write_current(found, out, name=name, force=force)
    if json:
        say_json(as_json({"schema": 1, "files": [str(path) for path in written], **found.to_data()}))
        return
    say(*summary(found), f"written to {out}: {', '.join(path.name for path in written)}")


def _say(found: "Controller") -> None:
    """Print margins, gains and the table of the bench."""
    from emsid.controllers.files import summary
    from emsid.units import plain_unit

    s, way = found.settings, "m" if found.linear else "rad"
    say(*summary(found))
    unit = plain_unit(found.unit)
    position = f"position {s.position:.4g} 1/s, " if s.position > 0 else ""
    say(
        f"gains: {position}speed {s.proportional:.4g} {unit} per {way}/s and {s.integral:.4g} {unit} per {way}; "
        f"feed-forward {s.per_speed:.4g} {unit} per {way}/s, {s.per_acceleration:.4g} {unit} per {way}/s^2"
    )
    say_bench(found.bench)


def say_bench(bench: "ControlBench") -> None:
    """Print the table of a bench."""
    from emsid.controllers.bench import rows_of

    header, rows = rows_of(bench)
    headings: dict[str, Align] = {name: "left" if k < 2 else "right" for k, name in enumerate(header)}
    quantity, unit = bench.motion
    show(plain_table(f"RMS error of the true {quantity} on the bench in {unit}", headings, rows))
