"""``emsid study``."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Details, Json, Out, Pdf, Transient, option, quantity
from emsid.cli.reading import reads_records
from emsid.cli.terminal import EXPLAINED, reader_may_leave, say, say_json, show, text_table, width_of_terminal, working
from emsid.cli.writing import REPORT, as_json, attempted, check_folder, draw, kept, say_where, write
from emsid.errors import DataError

if TYPE_CHECKING:
    from emsid.study import Study

LEFT_OUT = ("Lowest to highest", "Description")
"""Columns of the table of models that are only on the page."""
NARROW = 100
"""A terminal of fewer letters has no room for the fits and for the columns of many inputs."""

Record = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Identify from this record instead of the virtual bench.")
]
Validate = Annotated[
    Path | None, typer.Option("--validate", "--verify", metavar="FILE", help="Unseen record to compare the models on.")
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
    details: Details = False,
    json: Json = False,
    pdf: Pdf = False,
) -> None:
    """Run a complete study; no data needed.

    This is the study of Kara and Abokoos, from simulation to validation, on a built-in motor. It takes some twenty
    seconds, and on a new machine up to a minute more for compiling. What it says about other motors and inputs is
    recorded. On records of your own, orders, knots and refinements are chosen as by emsid
    identify; the paper's models keep their orders.

    It prints at most 30 lines: what was found, the ratio of every model, and warnings; --details prints all errors and
    the claims of the paper, too. Writes report.html, study.json and the figures as SVG. The options for columns and
    times apply to --record and --validate.

    \b
    Examples:
      emsid study
      emsid study --motor motor.toml --seed 7 --out my-study
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
    check_folder(out, "study.json", REPORT)
    settings = Settings(dt=step, duration=duration, seed=seed, forgetting=forgetting, knots=knots, transient=transient)
    if motor is not None:
        settings = replace(settings, motor=read_motor(motor))
    records = None if record is None or validate is None else (reader(record), reader(validate))
    with working() as control:
        result = run(settings, records, control)
    with kept(result, "the study") as result:
        data, unshown = study_data(result), None
        unwritten = attempted(lambda: write(out, {"study.json": data}))
        with reader_may_leave():
            if json:
                say_json(as_json(data))
            else:
                unshown = attempted(lambda: _print(result, details))
    drawn = draw(out, lambda: study_report(result, option), pdf, interrupted=result.interrupted)
    if not json and unwritten is None:
        with reader_may_leave():
            say_where(out, drawn, "study.json")
    for problem in filter(None, (unwritten, unshown)):
        raise problem
    INTERRUPTION.end(result.interrupted or not drawn)


def _print(result: "Study", details: bool) -> None:
    """What was found, the ratios of all models beside those of the paper, and warnings; then all errors and claims."""
    from emsid.report.study_page import claims_table, lead_inputs, models_table, paper_table, study_rows
    from emsid.report.views.front import results_table
    from emsid.study.summary import findings, headline
    from emsid.wording import Severity, sentence, severity
    from emsid.wording.first_screen import more

    found = findings(result)
    say(*(sentence(finding, option) for finding in headline(found)), "")
    narrow = width_of_terminal() < NARROW
    models = models_table(study_rows(result), () if narrow else lead_inputs(result))
    show(text_table(models, (*LEFT_OUT, "Free-run fit") if narrow else LEFT_OUT))
    say(*(f"- {sentence(finding, option)}" for finding in found if severity(finding) is not Severity.INFO))
    if not details:
        say(more(option))
        return
    say("")
    for part in result.parts:
        caption = f"The {part.called}."
        show(text_table(results_table(part.rows, unit=part.unseen.output_units[0], caption=caption)))
    say(EXPLAINED, "")
    show(text_table(paper_table(result.parts)))
    show(text_table(claims_table(found, option)))
