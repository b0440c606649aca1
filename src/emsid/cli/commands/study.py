"""``emsid study``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Json, Out, Pdf, Transient, option, quantity
from emsid.cli.reading import reads_records
from emsid.cli.terminal import EXPLAINED, reader_may_leave, say, say_json, show, text_table, working
from emsid.cli.writing import as_json, attempted, check_folder, draw, kept, say_where, write
from emsid.errors import DataError

if TYPE_CHECKING:
    from emsid.findings import Finding
    from emsid.study import Study

MAIN = ("study-many-inputs", "study-even-terms")
"""Findings that are printed beside warnings; the report has all."""

Record = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Identify from this record instead of the virtual bench.")
]
Validate = Annotated[
    Path | None, typer.Option("--validate", "--verify", metavar="FILE", help="Unseen record to compare the models on.")
]
Survey = Annotated[
    bool, typer.Option("--survey", help="Repeat the survey of other motors and inputs; takes about two minutes.")
]
Motor = Annotated[Path | None, typer.Option(metavar="TOML", help="Parameters of the motor to simulate.")]
Step = Annotated[float, typer.Option(metavar="S", parser=quantity("s"), help="Sample time of the simulated records.")]
Duration = Annotated[float, typer.Option(metavar="S", parser=quantity("s"), help="Length of the simulated records.")]
Seed = Annotated[int, typer.Option(metavar="N", help="Seed of the noise on the bench.", min=0)]
Forgetting = Annotated[float, typer.Option(metavar="FACTOR", help="Forgetting factor of recursive estimates.")]
Knots = Annotated[int, typer.Option(metavar="N", help="Hinges on each side of zero.", min=0)]


@app.command()
@reads_records(input=["voltage"], output=["speed"])
def study(
    reader: Any,
    out: Out = Path("emsid-study"),
    record: Record = None,
    validate: Validate = None,
    motor: Motor = None,
    step: Step = 0.005,
    duration: Duration = 20.0,
    seed: Seed = 1,
    forgetting: Forgetting = 1.0,
    knots: Knots = 12,
    transient: Transient = None,
    survey: Survey = False,
    json: Json = False,
    pdf: Pdf = False,
) -> None:
    """Run a complete study; no data needed.

    This is the study of Kara and Abokoos, from simulation to validation, on a built-in motor. It takes some twenty
    seconds, and on a new machine up to a minute more for compiling. What it says about other motors and inputs is
    recorded; --survey repeats it. On records of your own, orders, knots and refinements are chosen as by emsid
    identify; the paper's models keep their orders.

    Writes report.html, study.json and the figures as SVG. The options for columns and times apply to --record and
    --validate.

    \b
    Examples:
      emsid study
      emsid study --motor motor.toml --seed 7 --out my-study
      emsid study --survey
      emsid study --record a.csv --validate b.csv --input u --output y --dt 0.01
    """
    from emsid.io import read_motor
    from emsid.report.study_page import study_report
    from emsid.study import Settings
    from emsid.study import study as run
    from emsid.study.summary import study_data

    if (record is None) != (validate is None):
        raise DataError(
            "--record and --validate belong together: one record to fit models to, one unseen record; give both"
        )
    if record is None and reader.typed:
        raise DataError(f"{', '.join(reader.typed)}: only for --record and --validate, which are not given")
    check_folder(out)
    settings = Settings(dt=step, duration=duration, seed=seed, forgetting=forgetting, knots=knots, transient=transient)
    if motor is not None:
        settings = replace(settings, motor=read_motor(motor))
    records = None if record is None or validate is None else (reader(record), reader(validate))
    with working() as control:
        result = run(settings, records, control, survey=survey)
    with kept(result, "the study") as result:
        unwritten = attempted(lambda: write(out, {"study.json": study_data(result)}))
        with reader_may_leave():
            if json:
                say_json(as_json(study_data(result)))
            else:
                _print(result)
    if unwritten is not None:
        raise unwritten
    drawn = draw(out, lambda: study_report(result, option), pdf, interrupted=result.interrupted)
    if not json:
        with reader_may_leave():
            say_where(out, drawn, "study.json")
    INTERRUPTION.end(result.interrupted or not drawn)


def _print(result: "Study") -> None:
    """The tables of all parts, and what to know first."""
    from emsid.report.study_page import summary_table
    from emsid.report.views.tables import results_table
    from emsid.study.summary import findings

    for part in result.parts:
        caption = f"The {part.name} study."
        show(text_table(results_table(part.rows, unit=part.unseen.output_units[0], caption=caption)))
        show(text_table(summary_table(part, own_records=result.own_records)))
    say(EXPLAINED, "", *_noticed(findings(result)))


def _noticed(found: "Sequence[Finding]") -> list[str]:
    """The main findings and the warnings as lines, and how many there are besides."""
    from emsid.wording import Severity, sentence, severity

    shown = [each for each in found if each.code in MAIN or severity(each) is not Severity.INFO]
    more = [f"- in the report: {len(found) - len(shown)} more findings"] if len(shown) < len(found) else []
    return [*(f"- {sentence(each, option)}" for each in shown), *more]
