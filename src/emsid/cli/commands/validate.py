"""``emsid validate``."""

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Json, PageFolder, Transient, names, option
from emsid.cli.reading import reads_records
from emsid.cli.terminal import EXPLAINED, WITHOUT_METHOD_EXPLAINED, physical_table, say, say_json, show, text_table
from emsid.cli.writing import REPORT, as_json, attempted, check_folder, draw, say_where, write
from emsid.errors import EmsidError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from emsid.findings import Finding
    from emsid.io import Origin
    from emsid.record import Record
    from emsid.validation.comparison import Assessment, RegionError
    from emsid.validation.reestimation import Reestimation

ModelFile = Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that emsid wrote.")]
Files = Annotated[list[Path], typer.Argument(metavar="FILE", help="Records that the model was not fitted to.")]
Horizon = Annotated[int, typer.Option(metavar="K", help="Also predict this many samples ahead.", min=1)]
Free = Annotated[
    list[str],
    typer.Option(metavar="NAME,...", help="Estimate these physical parameters again from the first part of a record."),
]
Part = Annotated[
    float,
    typer.Option(
        metavar="FRACTION", help="With --free: the part of a record to estimate from; errors are of the rest."
    ),
]


@app.command()
@reads_records(input=[], output=[])
def validate(
    model: ModelFile,
    files: Files,
    reader: Any,
    transient: Transient = None,
    horizon: Horizon = 1,
    free: Free = [],  # noqa: B006
    part: Part = 0.3,
    out: PageFolder = None,
    json: Json = False,
) -> None:
    """Run a saved model on other records.

    Prints the errors of its free run and of its one-step prediction. The model file contains the columns, units, gains,
    masks and sample time of the identification. Options given here replace them.

    \b
    Examples:
      emsid validate emsid-result/friction-narx.json other.csv
      emsid validate emsid-result/arx.json other.csv --dt 10ms --mask "" --out check
      emsid validate emsid-result/rigid-motor.json heavier.csv --free rotor_inertia
    """
    from emsid.estimation.borders import border, collected
    from emsid.first_look.faults import without_faults
    from emsid.io import load_model, origin
    from emsid.validation.comparison import assess_model
    from emsid.validation.reestimation import reestimate
    from emsid.wording import sentence

    loaded, source = load_model(model), origin(model)
    reader = reader.of_model(model)
    if out is not None:
        check_folder(out, "validation.json", REPORT)
    records = [without_faults(reader(file)) for file in files]  # as an identification leaves samples out
    freed = names(free, "--free")

    def assessed(record: "Record") -> _Run:
        fitted, again = source is not None and source.seen(record), None
        if freed:
            again = reestimate(loaded, record, freed, part=part, transient=transient)
        data = "identification" if fitted else "unseen"
        errors = again.assessment if again else assess_model(loaded, record, transient, data=data)
        return _run(errors, source, again, horizon, transient, fitted=fitted)

    with collected() as noted:
        runs = _runs(assessed, records)
        for run in [] if json else runs:
            with border(f"table of {run.assessed.record.name}"):
                _print(run, horizon)
    result = {"schema": 1, "model": loaded.name, "records": [run.document for run in runs]}
    result |= {"findings": [finding.to_data() for finding in noted]}
    if json:
        say_json(as_json(result))
    else:
        say(*(f"- {sentence(finding, option)}" for finding in noted))
        say(EXPLAINED if free else WITHOUT_METHOD_EXPLAINED)
    if out is not None:
        with INTERRUPTION.put_off():
            unwritten = attempted(lambda: write(out, {"validation.json": result}))
        INTERRUPTION.words = "validation was interrupted; the errors are above and written"
        drawn = draw(out, lambda: _report(model, runs, noted))
        if unwritten is not None:
            raise unwritten
        if not json:
            say_where(out, drawn, "validation.json")
        INTERRUPTION.end(not drawn)


@dataclass(frozen=True)
class _Run:
    """The model on a record: its errors, also by region, what was estimated again, what to know, and all for a file."""

    assessed: "Assessment"
    regions: "Sequence[RegionError]"
    again: "Reestimation | None"
    findings: "Sequence[Finding]"
    document: dict[str, Any]


def _runs(assessed: "Callable[[Record], _Run]", records: "Sequence[Record]") -> list[_Run]:
    """The model on the records on which it can be run; a finding tells of the others.

    Raises:
        EmsidError: where it cannot be run on any.
    """
    from emsid.estimation.borders import border, note

    runs, problems = list[_Run](), dict[str, EmsidError]()
    for record in records:
        name = f"validation on {record.name}"
        with border(name, report=partial(problems.__setitem__, name)):
            runs.append(assessed(record))
    for name, problem in problems.items():
        if not runs:
            raise problem
        note(name, problem)
    return runs


def _run(
    assessed: "Assessment",
    source: "Origin | None",
    again: "Reestimation | None",
    horizon: int,
    transient: int | None,
    *,
    fitted: bool,
) -> _Run:
    """What follows from a run of the model on a record; what of it fails is left out, with a finding."""
    from emsid.estimation.borders import collected, tried
    from emsid.validation.comparison import errors_by_region

    name = assessed.record.name
    with collected() as noted:
        regions: Sequence[RegionError] = tried(f"errors by region on {name}", lambda: errors_by_region(assessed), ())
        found = _findings(assessed, source, fitted=fitted)
        document: dict[str, Any] = {"record": name, **assessed.row.to_data(), "findings": []}
        document |= {"regions": [asdict(region) for region in regions]}
        if again is not None:
            document |= {"reestimated": again.to_data()}
        if horizon > 1:
            document |= {"horizon": horizon, "horizon_mse": None}
            document["horizon_mse"] = tried(
                f"prediction {horizon} samples ahead on {name}", lambda: _ahead(assessed, horizon, transient), None
            )
    found += noted
    document["findings"] = [finding.to_data() for finding in found]
    return _Run(assessed, regions, again, found, document)


def _findings(assessed: "Assessment", source: "Origin | None", *, fitted: bool) -> "list[Finding]":
    """What to know about the run of a model on a record.

    Args:
        assessed: the run.
        source: what the model was identified from, as far as its file says.
        fitted: whether the record contains data of the fit.
    """
    from emsid.estimation.borders import joined
    from emsid.findings import Finding
    from emsid.first_look.data_advice import questions
    from emsid.first_look.examined import response_of
    from emsid.validation.agreement import lateness
    from emsid.validation.comparison import worst_region

    record = assessed.record
    return joined(
        {
            "comparison with the data of the fit": lambda: [Finding("data-not-unseen", record.name)] * fitted,
            "findings about the record": lambda: record.findings,
            "check of the data": lambda: questions([record], [response_of(record)]),
            "comparison of the channels": lambda: [] if source is None else source.differences(record),
            "check by region": lambda: filter(None, [worst_region(assessed)]),
            "check whether the record is late": lambda: lateness(record, assessed.simulation),
            "check of the fit": lambda: assessed.findings,
        }
    )


def _ahead(assessed: "Assessment", horizon: int, transient: int | None) -> float:
    """The mean square error of predictions this many samples ahead."""
    from emsid.models.free_run import mean_squared_error

    ahead = assessed.fit.model.predict(assessed.record, horizon, transient)
    return mean_squared_error(assessed.record.output[ahead.counted], ahead.output[ahead.counted])


def _print(run: _Run, horizon: int) -> None:
    """The errors on one record, the parameters that were estimated again, and the findings."""
    from emsid.report.views.front import region_tables, results_table
    from emsid.wording import sentence

    record, again = run.assessed.record, run.again
    errors = results_table([run.assessed.row], unit=record.output_units[0], caption=f"{record.name}.")
    for table in (errors, *region_tables(run.regions, f"on {record.name}")):
        show(text_table(table))
    if again is not None:
        show(physical_table(again.fit))  # type: ignore[arg-type]
        say(sentence(again.finding, option))
    say(*(f"- {sentence(finding, option)}" for finding in run.findings))
    if (ahead := run.document.get("horizon_mse")) is not None:
        say(f"{horizon} samples ahead: MSE {ahead:.5g}")


def _report(model: Path, runs: "Sequence[_Run]", noted: "Sequence[Finding]") -> Any:
    """A page with the free run over every record, and what failed."""
    from emsid.estimation.borders import joined
    from emsid.report import views
    from emsid.report.document import Fact, Notice, Report, Section
    from emsid.report.numbers import percent
    from emsid.report.views import conventions as terms
    from emsid.report.views.front import region_tables
    from emsid.wording import sentence, severity

    def section(k: int, run: _Run) -> Section:
        each = run.assessed
        figures = {
            f"figure free-run-{k}": lambda: [views.measured_and_simulated(each, name=f"free-run-{k}")],
            f"figure residuals-{k}": lambda: [views.residuals([each], name=f"residuals-{k}")],
        }
        return Section(
            each.record.name,
            tables=(
                views.results_table([each.row], unit=each.record.output_units[0]),
                *region_tables(run.regions, f"on {each.record.name}"),
            ),
            figures=tuple(joined(figures)),
            remarks=tuple(sentence(finding, option) for finding in run.findings),
        )

    assessed = [run.assessed for run in runs]
    works: dict[str, Callable[[], Iterable[Section]]] = {
        f"section of the page: {run.assessed.record.name}": partial(lambda *of: [section(*of)], k, run)
        for k, run in enumerate(runs, 1)
    }
    works["figure of the inputs"] = lambda: [
        Section("Input", figures=(views.inputs([each.record for each in assessed]),))
    ]
    worst = min(assessed, key=lambda each: each.row.fit_percent)
    several = len(assessed) > 1
    return Report(
        title=f"Validation of {assessed[0].fit.model.name}",
        summary=(f"{worst.record.name}: the free run has {worst.row.fit_in_words}.",),
        facts=(
            Fact(assessed[0].fit.model.name, f"the model in {model.name}"),
            Fact(percent(worst.row.fit_percent), f"fit of its free run{', the lowest of all records' * several}"),
            Fact(str(len(assessed)), "records" if several else "record"),
        ),
        opening=Section("", terms=(terms.FREE_RUN, terms.FIT, terms.ONE_STEP, terms.MSE)),
        sections=tuple(joined(works)),
        notices=tuple(Notice(sentence(each, option), severity(each).value) for each in noted),
        imprint=f"emsid validate {model.name}",
    )
