"""The page of the study: a table for each of the two studies first, then findings, figures and models."""

from __future__ import annotations

from math import isfinite

from emsid.report import views
from emsid.report.document import Notice, Report, Section, Table
from emsid.report.numbers import number, percent
from emsid.report.views import terms
from emsid.study.models import BLOCKS, LINEAR, ONE_MASS, PAPER, TWO_MASSES
from emsid.study.setup import EXPERIMENT, PAPER_MSE, SIMULATION, Settings
from emsid.study.summary import SummaryRow, findings, summary
from emsid.study.workflow import Part, Study
from emsid.units import plain_unit
from emsid.wording import Severity, sentence, severity

CHECK = "noise-free, by the program's own simulator: a check of the estimator, not a result"
PAPER_NOTE = "another motor, in units that the paper does not state; only the ratios can be compared"


def study_report(result: Study) -> Report:
    """The page of a study."""
    found = findings(result)
    return Report(
        title="Identification of an electromechanical system",
        summary=(
            "Models of a DC motor with dead zone and friction, after Kara and Abokoos. Each model is fitted to one "
            "record. The models are compared by their free runs on a second record with another input.",
        ),
        sections=(
            Section(
                "Findings",
                remarks=tuple(sentence(each) for each in found if severity(each) is not Severity.WARNING),
            ),
            *(part_section(part) for part in result.parts),
            motor_section(result.settings),
            *model_sections(result),
        ),
        imprint=f"emsid study, seed {result.settings.seed}, after Kara and Abokoos",
        opening=Section(
            "",
            terms=(terms.FREE_RUN, terms.FIT),
            tables=tuple(summary_table(part, own_records=result.own_records) for part in result.parts),
        ),
        notices=tuple(
            Notice(sentence(each), severity(each).value) for each in found if severity(each) is not Severity.INFO
        ),
    )


def summary_table(part: Part, *, own_records: bool = False) -> Table:
    """Every model with number of parameters, free-run fit and MSE, and the ratio of the linear model's MSE to it."""
    rows = summary(part)
    unit = plain_unit(part.unseen.output_units[0])
    mse = f"Free-run MSE [({unit})²]" if unit else "Free-run MSE"
    best = min((row for row in rows if not row.check), key=lambda row: _ranked(row.simulation_mse))
    titles = {
        SIMULATION: "Simulation: records of the simulated motor, without noise.",
        EXPERIMENT: "Experiment: two records of your own."
        if own_records
        else "Experiment: records of a virtual bench, with noise and effects that no model contains.",
    }
    checks = [f"{row.model}: {CHECK}." for row in rows if row.check]
    return Table(
        (
            "Model",
            "Description",
            "Parameters",
            "Free-run fit",
            mse,
            "Ratio to linear",
            "Ratio, identification data",
            "Paper",
            "Paper, identification data",
        ),
        tuple(
            (
                row.model,
                f"{row.meaning}{f' – {CHECK}' if row.check else ''}",
                str(row.parameters),
                percent(row.fit_percent),
                number(row.simulation_mse),
                _times(row, row.better_unseen),
                _times(row, row.better_identification),
                _factor(row.paper_unseen),
                _factor(row.paper_identification),
            )
            for row in rows
        ),
        f"{titles[part.name]} Free run on unseen data.",
        " ".join(
            (
                "Ratio to linear: free-run MSE of the linear model divided by that of this model, on unseen data and "
                "on identification data (the data that the models were fitted to).",
                f"Paper: the same ratio of the paper's models ({PAPER_NOTE}).",
                *checks,
            )
        ),
        text_columns=2,
        emphasised=frozenset({rows.index(best)}),
    )


def _ranked(mse: float) -> float:
    return mse if isfinite(mse) else float("inf")


def _times(row: SummaryRow, better: float | None) -> str:
    """A ratio to the linear model; none in a check, whose error is only rounding."""
    return "check only" if row.check else _factor(better)


def _factor(ratio: float | None) -> str:
    """A ratio with three digits.

    >>> _factor(557.2), _factor(46871.3), _factor(0.982), _factor(None)
    ('×557', '×46,900', '×0.982', '')
    """
    return "" if ratio is None else f"×{float(f'{ratio:.3g}'):,.10g}"


def part_section(part: Part) -> Section:
    """All errors of one of the two studies and its figures."""
    name = part.name
    shown = [part.on_unseen(model) for model in part.models]
    error = part.unseen.output - shown[0].simulation.output
    intervals = views.critical_intervals(part.unseen, 0.1 * len(part.unseen) * part.unseen.dt, error)
    published = {
        (model, data): PAPER_MSE[name, data][k]
        for k, model in enumerate((LINEAR, PAPER))
        for data in ("identification", "unseen")
    }
    reference = views.Reference("Paper", PAPER_NOTE, published)
    best = min(shown, key=lambda each: _ranked(each.row.simulation_mse))
    recursion = (
        (views.convergence(part.on_unseen(PAPER, "rls").fit, part.on_unseen(PAPER).fit, name=f"{name}-convergence"),)
        if PAPER in part.models
        else ()
    )
    return Section(
        f"The {name} study",
        terms=(terms.ONE_STEP, terms.MSE, terms.METHOD),
        tables=(views.results_table(part.rows, reference, unit=part.unseen.output_units[0]),),
        figures=(
            views.measured_and_simulated(best, name=f"{name}-free-run"),
            views.responses(shown, intervals, name=f"{name}-responses"),
            views.inputs((part.identification, part.unseen), name=f"{name}-inputs"),
            *recursion,
            views.residuals(shown, name=f"{name}-residuals"),
        ),
    )


def motor_section(settings: Settings) -> Section:
    """The simulated motor."""
    return Section(
        "The motor",
        paragraphs=(
            "A two-mass permanent-magnet DC motor with Coulomb and Stribeck friction (4.7) on both sides and a dead "
            "zone (4.9).",
        ),
        tables=(views.motor_table(settings.motor),),
        figures=(views.nonlinearities(settings.motor),),
    )


def model_sections(result: Study) -> tuple[Section, ...]:
    """The blocks and the physical motor of the first study that has them."""
    sections = []
    for model in (BLOCKS, ONE_MASS, TWO_MASSES):
        part = next((part for part in result.parts if model in part.models), None)
        if part is not None:
            section = views.model_section(part.on_unseen(model).fit, part.identification)
            sections.append(section)
    return tuple(sections)
