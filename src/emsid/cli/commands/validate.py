"""``emsid validate``."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Json, Transient, names, option
from emsid.cli.reading import reads_records
from emsid.cli.terminal import EXPLAINED, WITHOUT_METHOD_EXPLAINED, physical_table, say, say_json, show, text_table
from emsid.cli.writing import REPORT, as_json, check_folder, draw, say_where, write
from emsid.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from emsid.findings import Finding
    from emsid.io import Origin
    from emsid.validation.comparison import Assessment
    from emsid.validation.reestimation import Reestimation
    from emsid.validation.regions import RegionError

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
Folder = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder for a report with figures; by default none is written.")
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
    out: Folder = None,
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
    from emsid.io import load_model, origin, read_options
    from emsid.validation.comparison import assess_model
    from emsid.validation.reestimation import reestimate
    from emsid.validation.regions import errors_by_region

    loaded, source = load_model(model), origin(model)
    reader = reader.after(read_options(model), () if source is None else source.names)
    if "input" not in reader.given or "output" not in reader.given:
        raise DataError(
            f"{model}: the file does not say how its record was read; give the columns of input and output",
            arguments=("input", "output"),
        )
    if out is not None:
        check_folder(out, "validation.json", REPORT)
    records = list(map(reader, files))
    again: list[Reestimation | None] = [None] * len(records)
    if free:
        again = [
            reestimate(loaded, record, names(free, "--free"), part=part, transient=transient) for record in records
        ]
    seen = [source is not None and source.seen(record) for record in records]
    assessed = [
        assess_model(loaded, record, transient, data="identification" if fitted else "unseen")
        if some is None
        else some.assessment
        for record, some, fitted in zip(records, again, seen, strict=True)
    ]
    by_region = list(map(errors_by_region, assessed))
    found = [_findings(each, source, fitted=fitted) for each, fitted in zip(assessed, seen, strict=True)]
    documents = []
    for each, regions, some, findings in zip(assessed, by_region, again, found, strict=True):
        documents.append(_document(each, regions, findings, some, horizon, transient))
        if not json:
            _print(each, regions, findings, some)
            if horizon > 1:
                say(f"{horizon} samples ahead: MSE {documents[-1]['horizon_mse']:.5g}")
    result = {"schema": 1, "model": loaded.name, "records": documents}
    if json:
        say_json(as_json(result))
    else:
        say(EXPLAINED if free else WITHOUT_METHOD_EXPLAINED)
    if out is not None:
        write(out, {"validation.json": result})
        INTERRUPTION.words = "validation was interrupted; the errors are above and written"
        drawn = draw(out, lambda: _report(model, assessed, by_region, found))
        if not json:
            say_where(out, drawn, "validation.json")
        INTERRUPTION.end(not drawn)


def _findings(assessed: "Assessment", source: "Origin | None", *, fitted: bool) -> "list[Finding]":
    """What to know about the run of a model on a record.

    Args:
        assessed: the run.
        source: what the model was identified from, as far as its file says.
        fitted: whether the record contains data of the fit.
    """
    from emsid.findings import Finding
    from emsid.validation.lateness import lateness
    from emsid.validation.regions import worst_region

    record = assessed.record
    found = [Finding("data-not-unseen", record.name)] if fitted else []
    found += [*record.findings, *([] if source is None else source.differences(record))]
    found += [*([finding] if (finding := worst_region(assessed)) else []), *lateness(record, assessed.simulation)]
    return [*found, *assessed.findings]


def _document(
    assessed: "Assessment",
    regions: "Sequence[RegionError]",
    findings: "Sequence[Finding]",
    again: "Reestimation | None",
    horizon: int,
    transient: int | None,
) -> dict[str, Any]:
    """What a file holds of one record."""
    from emsid.models.free_run import mean_squared_error

    record = assessed.record
    document = {
        "record": record.name,
        **assessed.row.to_data(),
        "findings": [finding.to_data() for finding in findings],
    }
    document |= {"regions": [asdict(region) for region in regions]}
    if again is not None:
        document |= {"reestimated": again.to_data()}
    if horizon > 1:
        ahead = assessed.fit.model.predict(record, horizon, transient)
        error = mean_squared_error(record.output[ahead.counted], ahead.output[ahead.counted])
        document |= {"horizon": horizon, "horizon_mse": error}
    return document


def _print(
    assessed: "Assessment",
    regions: "Sequence[RegionError]",
    findings: "Sequence[Finding]",
    again: "Reestimation | None",
) -> None:
    """The errors on one record, the parameters that were estimated again, and the findings."""
    from emsid.report.views.front import region_tables
    from emsid.report.views.tables import results_table
    from emsid.wording import sentence

    errors = results_table([assessed.row], unit=assessed.record.output_units[0], caption=f"{assessed.record.name}.")
    for table in (errors, *region_tables(regions, f"on {assessed.record.name}")):
        show(text_table(table))
    if again is not None:
        show(physical_table(again.fit))  # type: ignore[arg-type]
        say(sentence(again.finding, option))
    say(*(f"- {sentence(finding, option)}" for finding in findings))


def _report(
    model: Path,
    assessed: "list[Assessment]",
    by_region: "list[tuple[RegionError, ...]]",
    found: "list[list[Finding]]",
) -> Any:
    """A page with the free run over every record."""
    from emsid.report import views
    from emsid.report.document import Fact, Report, Section
    from emsid.report.numbers import percent
    from emsid.report.views import terms
    from emsid.report.views.front import region_tables
    from emsid.wording import sentence

    sections = [
        Section(
            each.record.name,
            tables=(
                views.results_table([each.row], unit=each.record.output_units[0]),
                *region_tables(regions, f"on {each.record.name}"),
            ),
            figures=(
                views.measured_and_simulated(each, name=f"free-run-{k}"),
                views.residuals([each], name=f"residuals-{k}"),
            ),
            remarks=tuple(sentence(finding, option) for finding in findings),
        )
        for k, (each, regions, findings) in enumerate(zip(assessed, by_region, found, strict=True), 1)
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
        sections=(*sections, Section("Input", figures=(views.inputs([each.record for each in assessed]),))),
        imprint=f"emsid validate {model.name}",
    )
