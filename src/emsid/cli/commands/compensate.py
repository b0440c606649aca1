"""``emsid compensate``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.commands.control import say_bench
from emsid.cli.options import Encoder, Force, Json, quantity, sample_time
from emsid.cli.terminal import say, say_json
from emsid.cli.writing import as_json, check_folder

if TYPE_CHECKING:
    from emsid.compensation import Compensation, MapInverse, RippleCompensation
    from emsid.controllers import ControlBench


@app.command()
def compensate(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that emsid wrote.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder to write to.")],
    dt: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            parser=sample_time,
            help="Sample time of the controller.  [default: of the record; a plant saved without one needs it]",
        ),
    ] = None,
    encoder: Encoder = None,
    smooth: Annotated[
        float | None,
        typer.Option(
            metavar="V",
            parser=quantity("V"),
            help="Smooth the dead zone's inverse up to this voltage.  [default: from the encoder]",
        ),
    ] = None,
    smooth_speed: Annotated[
        float | None,
        typer.Option(
            metavar="X",
            parser=quantity("rad/s"),
            help="Smooth the friction's direction up to this speed.  [default: from the encoder]",
        ),
    ] = None,
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
    """Write a model's inverse: dead zone, friction, ripple.

    Of a plant of one mass it writes, in C, the inverse of the dead zone, the friction for a reference speed, and the
    command that leads from one reference speed to the next, beside the C of the model. Friction and dead zone are
    those at the lower ends of their intervals. A position loop then runs on a bench with and without it, with friction
    and dead zone as identified and 30 % off: hold, reversal, step and sine.
    Of a cascade it writes the inverse of its static map; of a brushless motor the q-current against cogging and ripple,
    and its table over the angle as CSV and for ODrive. Neither has a bench, or options of encoder and smoothing.
    A page shows the inverse, and the runs.

    \b
    Examples:
      emsid compensate emsid-result/rigid-motor.json --out inverse --dt 1ms --encoder 2000
      emsid compensate emsid-result/rigid-motor.json --out inverse --dt 500Hz --smooth 0.1V --limit 12V
      emsid compensate emsid-result/hammerstein.json --out inverse --name drive --float
      emsid compensate emsid-result/brushless.json --out ripple --float
    """
    from emsid.compensation import compensate as invert
    from emsid.compensation.files import write
    from emsid.compensation.inverse import has_harmonics
    from emsid.controllers.files import bench_lines
    from emsid.controllers.verb import compensated
    from emsid.errors import ModelError
    from emsid.exports.verb import check_stable
    from emsid.io import load, origin
    from emsid.models.verbs import as_model
    from emsid.report.control_page import compensation_report, gain_at_reversal
    from emsid.report.page import report_files

    check_folder(out)
    loaded, source = load(model), origin(model)
    subject = as_model(loaded)
    if dt is None:
        dt = subject.dt if subject.dt is not None or source is None else source.dt
    found: Compensation | MapInverse | RippleCompensation
    bench: ControlBench | None = None
    lines = list[str]()
    if dt is None or hasattr(subject, "blocks") or has_harmonics(subject):
        found = invert(loaded, dt=dt)
        options = {"encoder": encoder, "smooth": smooth, "smooth_speed": smooth_speed, "limit": limit}
        if given := [key for key, value in (options | {"amplitude": amplitude}).items() if value is not None]:
            reason = f"the inverse of {subject.name} has no jumps to smooth and no bench; leave these out"
            raise ModelError(reason, arguments=given)
        check_stable(subject, dt)
    else:
        found, bench = compensated(
            loaded, dt=dt, encoder=encoder, zone_width=smooth, speed_width=smooth_speed, limit=limit, delay=delay,
            amplitude=amplitude,
        )  # fmt: skip
        lines = bench_lines(bench)
    more = report_files(compensation_report(found, bench))
    written = write(loaded, found, out, name=name, dt=dt, single=single, force=force, more=more, bench=lines)
    if json:
        document: dict[str, Any] = {"schema": 1, "files": [str(path) for path in written]}
        say_json(as_json(document | ({} if bench is None else {"bench": bench.to_data()})))
        return
    if bench is not None:
        say(*gain_at_reversal(bench))
        say_bench(bench)
    names = dict.fromkeys(path.relative_to(out).parts[0] for path in written)
    say(f"written to {out}: {', '.join(names)}")
