"""``emsid compare``."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Json, PageFolder, Transient
from emsid.cli.reading import reads_records
from emsid.cli.terminal import EXPLAINED, say, say_json, show, text_table
from emsid.cli.writing import REPORT, as_json, check_folder, draw, say_where, write
from emsid.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from emsid.estimation.fit import Fit
    from emsid.record import Record
    from emsid.report.document import Report
    from emsid.validation.comparison import Comparison

ModelsAndFiles = Annotated[
    list[Path], typer.Argument(metavar="MODEL... FILE...", help="Model files (.json), and records to run them on.")
]


@app.command()
@reads_records(input=[], output=[])
def compare(
    given: ModelsAndFiles, reader: Any, transient: Transient = None, out: PageFolder = None, json: Json = False
) -> None:
    """Compare saved models on the same records.

    Prints the errors of all models on the same samples of every record, the smallest error of the free run first. The
    first model file says how records are read; options given here replace that. With --out, a page has the free runs,
    the residuals, and the responses of all models in the same axes.

    \b
    Examples:
      emsid compare emsid-result/arx.json emsid-result/rigid-motor.json other.csv
      emsid compare first/best.json second/best.json a.csv b.csv --out compared
    """
    from emsid.first_look.faults import without_faults
    from emsid.io import load, origin
    from emsid.report.views.front import results_table
    from emsid.validation.comparison import as_fit
    from emsid.validation.comparison import compare as compared

    paths = [path for path in given if path.suffix == ".json"]
    files = [path for path in given if path.suffix != ".json"]
    if not paths or not files:
        raise DataError("compare takes model files (.json) and at least one record: compare a.json b.json other.csv")
    fits, sources = [as_fit(load(path)) for path in paths], [origin(path) for path in paths]
    reader = reader.of_model(paths[0])
    if out is not None:
        check_folder(out, "comparison.json", REPORT)
    names = [fit.model_name for fit in fits]
    labels = dict(zip(map(id, fits), names if len(set(names)) == len(names) else map(str, paths), strict=True))

    def on(record: "Record") -> "Comparison":
        """The models on a record, called by their files where their names are the same."""
        found = compared(fits, record, transient=transient, experiment=record.name)
        seen = {
            id(fit) for fit, source in zip(fits, sources, strict=True) if source is not None and source.seen(record)
        }
        return type(found)(
            tuple(
                replace(
                    each,
                    row=replace(
                        each.row,
                        model=labels[id(each.fit)],
                        data="identification" if id(each.fit) in seen else "unseen",
                    ),
                )
                for each in found.assessments
            )
        )

    comparisons = [on(without_faults(record)) for record in reader.together(files)]
    result = {"schema": 1, "records": [_data(each) for each in comparisons]}
    if json:
        say_json(as_json(result))
    else:
        for each in comparisons:
            record = each.best.record
            show(text_table(results_table(each.rows, unit=record.output_units[0], caption=f"{record.name}.")))
        say(EXPLAINED)
    if out is not None:
        with INTERRUPTION.put_off():
            write(out, {"comparison.json": result})
        INTERRUPTION.words = "interrupted; the errors are above and written"
        drawn = draw(out, lambda: _report(comparisons, fits))
        if not json:
            say_where(out, drawn, "comparison.json")
        INTERRUPTION.end(not drawn)


def _data(comparison: "Comparison") -> dict[str, Any]:
    """The errors of all models on a record."""
    return {"record": comparison.best.record.name, "models": [row.to_data() for row in comparison.rows]}


def _report(comparisons: "Sequence[Comparison]", fits: "Sequence[Fit[Any]]") -> "Report":
    """A page with the free runs and residuals on every record, and the responses of all models."""
    from emsid.estimation.borders import joined
    from emsid.report import views
    from emsid.report.document import Fact, Report, Section
    from emsid.report.numbers import percent
    from emsid.report.views import conventions as terms
    from emsid.report.views.analysis import model_figures
    from emsid.validation.bands import usual_step

    def section(k: int, comparison: "Comparison") -> Section:
        record, drawn = comparison.best.record, comparison.assessments
        whole = [slice(0, len(record))]
        figures = {
            "figure of the free runs": lambda: [views.responses(drawn, whole, name=f"free-runs-{k}")],
            "figure of the residuals": lambda: [views.residuals(drawn, name=f"residuals-{k}")],
        }
        table = views.results_table(comparison.rows, unit=record.output_units[0])
        return Section(record.name, tables=(table,), figures=tuple(joined(figures)))

    first = comparisons[0]
    steps = [usual_step(u) for u in first.best.record.input.T]
    works: dict[str, Callable[[], Iterable[Section]]] = {
        f"section of the page: {each.best.record.name}": partial(lambda *of: [section(*of)], k, each)
        for k, each in enumerate(comparisons, 1)
    }
    works["figures of the responses"] = lambda: [
        Section("Responses", figures=model_figures(fits, steps, first.best.record))
    ]
    best = first.best.row
    return Report(
        title=f"Comparison of {len(fits)} models",
        summary=(
            f"{first.best.record.name}: {best.model} has the smallest error of the free run, {best.fit_in_words}.",
        ),
        facts=(Fact(percent(best.fit_percent), f"fit of {best.model}, the best on {first.best.record.name}"),),
        opening=Section("", terms=(terms.FREE_RUN, terms.FIT, terms.ONE_STEP, terms.MSE)),
        sections=tuple(joined(works)),
        imprint=f"emsid compare: {', '.join(row.model for row in first.rows)}",
    )
