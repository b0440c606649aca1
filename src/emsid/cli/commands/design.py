"""``emsid design``."""

from math import inf
from pathlib import Path
from typing import Annotated

import typer

from emsid.cli.app import app
from emsid.cli.options import Force, Json, names, option, quantity, sample_time
from emsid.cli.terminal import say, say_json, show, text_table
from emsid.cli.writing import as_json, check_file


@app.command()
def design(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that emsid wrote.")],
    limit: Annotated[float, typer.Option(metavar="V", parser=quantity("V"), help="The largest voltage (command).")],
    duration: Annotated[float, typer.Option(metavar="S", parser=quantity("s"), help="Length of the signal.")],
    limit_slew: Annotated[
        float, typer.Option(metavar="X", parser=quantity("V/s"), help="Its fastest change, in V/s.")
    ] = inf,
    limit_speed: Annotated[
        float, typer.Option(metavar="X", parser=quantity("rad/s"), help="The largest speed, in rad/s (m/s: a number).")
    ] = inf,
    limit_travel: Annotated[
        float, typer.Option(metavar="X", parser=quantity("rad"), help="The largest travel, in rad (m: a number).")
    ] = inf,
    wanted: Annotated[
        list[str], typer.Option("--for", metavar="NAMES", help="Parameters to determine.  [default: all estimated]")
    ] = [],  # noqa: B006
    criterion: Annotated[str, typer.Option(metavar="NAME", help="a: mean variance; d: volume of the region.")] = "a",
    dt: Annotated[
        float | None, typer.Option(metavar="S", parser=sample_time, help="Sample time.  [default: of the record]")
    ] = None,
    noise: Annotated[
        float | None, typer.Option(metavar="X", help="Deviation of the output's error.  [default: of the fit]")
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the search.", min=0)] = 1,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Where to write: .csv, .parquet, .npz.")] = Path(
        "design.csv"
    ),
    force: Force = False,
    json: Json = False,
) -> None:
    """Design the next experiment: a test signal for small intervals.

    The signal stays within the limits on the model, and makes the 95 % intervals of the wanted parameters small: its
    Fisher information is that of the model's own free run. They are printed beside those of standard signals within the
    same limits, with what no signal separates; a page beside the file shows signal and intervals. `emsid bench run
    --signal` sends the file to a board.

    \b
    Examples:
      emsid design emsid-result/rigid-motor.json --limit 12V --duration 20
      emsid design emsid-result/rigid-motor.json --limit 12V --limit-speed 300 --duration 20 \\
          --for friction.coulomb,dead_zone.half_width --out next.csv
      emsid bench run --source socket://localhost:7000 --limit 12V --signal next.csv
    """
    from emsid.experiment_design import design as run
    from emsid.exports.verb import check_stable
    from emsid.io import atomic_write, load, origin, write_record
    from emsid.io.files import together
    from emsid.models.verbs import as_model
    from emsid.report.design_page import design_report, gain, widths_table
    from emsid.report.page import PAGE, report_files
    from emsid.wording import sentence

    page = out.with_suffix(".html")
    for path in (out, page):
        check_file(path, force)
    loaded, source = load(model), origin(model)
    if dt is None and as_model(loaded).dt is None and source is not None:
        dt = source.dt
    check_stable(as_model(loaded), dt)
    found = run(
        loaded, limit=limit, duration=duration, dt=dt, limit_slew=limit_slew, limit_speed=limit_speed,
        limit_travel=limit_travel, wanted=names(wanted, "--for"), criterion=criterion, noise=noise, seed=seed,
    )  # fmt: skip
    with together():
        write_record(found.record, out)
        atomic_write(page, report_files(design_report(found, option), formats=())[PAGE])
    if json:
        say_json(as_json({"schema": 1, "file": str(out), "samples": len(found.record), **found.to_data()}))
        return
    show(text_table(widths_table(found)))
    say(gain(found), *(f"- {sentence(finding, option)}" for finding in found.findings))
    say(f"written to {out}: {len(found.record):,} samples; {page.name} shows them")
