"""``emsid fleet``."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Json, Pdf, declared, option, pairs
from emsid.cli.reading import reads_records
from emsid.cli.terminal import reader_may_leave, say, say_json, working
from emsid.cli.writing import REPORT, as_json, check_folder, draw, say_where

if TYPE_CHECKING:
    from emsid.fleets import Fleet

MOST_SHOWN = 20
"""Findings on single motors that are printed; the page has all."""


Source = Annotated[
    list[str], typer.Argument(metavar="SOURCE", help="Folders, files, or a pattern: 'logs/{motor}/{period}.csv'.")
]
Models = Annotated[
    str, typer.Option(metavar="NAME", help="Model to fit, see `emsid list`; or a model file whose structure is taken.")
]
Motor = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Column, or field of the paths, that names the motor.  [default: motor]"),
]
Period = Annotated[
    str | None, typer.Option(metavar="1d", help="A row for every period: a duration, or a field of the paths.")
]
Reference = Annotated[
    str | None, typer.Option(metavar="MOTOR", help="The motor on which the structure is chosen.  [default: the first]")
]
Fix = Annotated[list[str], declared("fixed")]
Unseen = Annotated[float, typer.Option(metavar="FRACTION", help="Last part of every record, for the errors.")]
Workers = Annotated[
    int | None, typer.Option(metavar="N", help="Processes, or tasks at a time.  [default: cores]", min=1)
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask cluster that fits, such as tcp://host:8786.")
]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder for results and report.")]


@app.command()
@reads_records()
def fleet(
    source: Source,
    reader: Any,
    models: Models = "rigid-motor",
    motor: Motor = None,
    period: Period = None,
    reference: Reference = None,
    fix: Fix = [],  # noqa: B006
    unseen: Unseen = 0.3,
    workers: Workers = None,
    scheduler: Scheduler = None,
    out: Out = Path("emsid-fleet"),
    json: Json = False,
    pdf: Pdf = False,
) -> None:
    """Fit a model to many motors; name those that differ.

    Every motor gets the same structure, which is chosen on one of them. The motor of a file is a folder named
    motor=M7, a field of the pattern, the name of the file, or a column (--motor). Tables with such a column, and those
    that --period divides, are Parquet, Arrow or plain CSV.

    Writes fleet.parquet with a row for every motor and period, fleet.json with the motors that are named, and
    report.html. Ctrl-C keeps the finished rows; the same command goes on from there.

    \b
    Examples:
      emsid fleet motors -u voltage -y speed --time t --fix resistance=2
      emsid fleet 'logs/{motor}/{period}.csv' -u u -y y --dt 1ms --models arx
      emsid fleet all.parquet --motor id --period 1d -u u -y y --time t --out wear
    """
    from emsid.fleets import fleet as run
    from emsid.fleets.engine import connected
    from emsid.fleets.page import fleet_report
    from emsid.fleets.verb import JOURNAL, RESULT, SUMMARY
    from emsid.options import Options

    check_folder(out, JOURNAL, RESULT, SUMMARY, REPORT)
    with ExitStack() as stack:
        executor = stack.enter_context(connected(scheduler)) if scheduler else None
        with working("the finished rows are kept; ending") as control:
            result = run(
                source,
                models,
                executor,
                out=out,
                motor=motor,
                period=period,
                reference=reference,
                options=Options(fixed=pairs(fix, "--fix", "NAME=VALUE")),
                unseen=unseen,
                workers=workers,
                control=control,
                **reader.given,
            )
    INTERRUPTION.pressed = False
    INTERRUPTION.words = "interrupted; the finished rows are kept, and the same command goes on from there"
    with INTERRUPTION.put_off(), reader_may_leave():
        if json:
            say_json(as_json(result.to_data()))
        else:
            _print(result)
    drawn = draw(out, lambda: fleet_report(result, ", ".join(source), option), pdf, interrupted=result.interrupted)
    if not json:
        with reader_may_leave():
            say_where(out, drawn, RESULT, SUMMARY)
    INTERRUPTION.end(result.interrupted or not drawn)


def _print(result: "Fleet") -> None:
    """How many rows there are, the motors that are named, and why others have no model."""
    from emsid.fleets.spread import reasons
    from emsid.wording import sentence
    from emsid.wording.live import EFFECTS

    good = len(result.rows) - len(result.failed)
    say(f"{len({row.motor for row in result.rows}):,} motors, {len(result.rows):,} rows, {good:,} with a model")
    single = [finding for finding in result.findings if finding.subject]
    say(*(f"- {sentence(finding, option)}" for finding in single[:MOST_SHOWN]))
    if len(single) > MOST_SHOWN:
        say(f"- in the report: {len(single) - MOST_SHOWN} more such findings")
    if not single and (tested := [EFFECTS[effect][0] for effect, was in result.tested.items() if was]):
        say(f"- no motor {' or '.join(tested)}")
    say(*(f"- {sentence(finding, option)}" for finding in result.findings if not finding.subject))
    for rows in reasons(result.rows).values():
        names = ", ".join(row.motor for row in rows[:5]) + ", …" * (len(rows) > 5)
        say(f"  {names}: {rows[0].reason}")
