"""``emsid design``."""

from math import inf
from pathlib import Path
from typing import Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.options import Force, Json, names, option, quantity, sample_time
from emsid.cli.terminal import say, say_json, show, text_table
from emsid.cli.writing import as_json, check_file
from emsid.errors import DataError


@app.command()
def design(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL", help="A model file that emsid wrote; or brushless, with --datasheet.")
    ],
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
    limit_current: Annotated[
        float, typer.Option(metavar="X", parser=quantity("A"), help="The largest current, in A.")
    ] = inf,
    wanted: Annotated[
        list[str], typer.Option("--for", metavar="NAMES", help="Parameters to determine.  [default: open ones, or all]")
    ] = [],  # noqa: B006
    criterion: Annotated[str, typer.Option(metavar="NAME", help="a: mean variance; d: volume of the region.")] = "a",
    dt: Annotated[
        float | None, typer.Option(metavar="S", parser=sample_time, help="Sample time.  [default: of the record]")
    ] = None,
    noise: Annotated[
        str | None, typer.Option(metavar="X,...", help="Deviation of every output's error.  [default: of the fit]")
    ] = None,
    datasheet: Annotated[
        Path | None, typer.Option(metavar="TOML", help="Values and tolerances of what no record has determined.")
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

    Of a brushless motor the file has the voltages of both axes. What its records left open, such as flux and inertia
    after a test with the rotor held, is determined first; its likely values come from a datasheet.

    \b
    Examples:
      emsid design emsid-result/rigid-motor.json --limit 12V --duration 20
      emsid design emsid-result/rigid-motor.json --limit 12V --limit-speed 300 --duration 20 \\
          --for friction.coulomb,dead_zone.half_width --out next.csv
      emsid bench run --source socket://localhost:7000 --limit 12V --signal next.csv
      emsid design held/brushless.json --datasheet motor.toml --limit 4V --limit-current 25A --limit-speed 100 \\
          --duration 0.5
    """
    from emsid.experiment_design import design as run
    from emsid.experiment_design.known import named
    from emsid.exports.verb import check_stable
    from emsid.io import atomic_write, load, origin, read_datasheet, write_record
    from emsid.io.files import together
    from emsid.models.plants.registry import PLANTS
    from emsid.models.verbs import as_model
    from emsid.report.design_page import design_report, gain, widths_table
    from emsid.report.page import PAGE, report_files
    from emsid.wording import sentence

    page = out.with_suffix(".html")
    for path in (out, page):
        check_file(path, force)
    sheet = None if datasheet is None else read_datasheet(datasheet)
    loaded: Any
    if str(model) in PLANTS and not model.exists():
        if sheet is None:
            raise DataError(f"{model} has no estimates; give a file of a fit, or a datasheet", arguments=("datasheet",))
        loaded, source = named(str(model), sheet), None
    else:
        loaded, source = load(model), origin(model)
    if dt is None and as_model(loaded).dt is None and source is not None:
        dt = source.dt
    check_stable(as_model(loaded), dt)
    found = run(
        loaded, limit=limit, duration=duration, dt=dt, limit_slew=limit_slew, limit_speed=limit_speed,
        limit_travel=limit_travel, limit_current=limit_current, wanted=names(wanted, "--for"), criterion=criterion,
        noise=_deviations(noise), datasheet=sheet, seed=seed,
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


def _deviations(text: str | None) -> list[float] | None:
    """``X,…``"""
    try:
        return None if text is None else [float(each) for each in text.split(",")]
    except ValueError:
        raise DataError(f"--noise {text!r}: write it as numbers with commas between") from None
