"""The page of the study: what was found with one picture, the paper's tables beside ours, claims, figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite

from emsid.estimation.borders import collected, joined, tried
from emsid.report import views
from emsid.report.document import Figure, Notice, Report, Section, Table
from emsid.report.study_views import (
    claims_table,
    excitation_table,
    largest_table,
    load_friction_figure,
    models_table,
    motors_table,
    overview,
    paper_table,
    priors_figure,
    richer_table,
    two_masses_table,
)
from emsid.report.views import terms
from emsid.report.views.diagrams import block_diagram, experimental_setup, identification_loop, motor_schematic
from emsid.study.conclusions import speaks_of
from emsid.study.models import BLOCKS, LINEAR, ONE_MASS, PAPER, TWO_MASSES
from emsid.study.motors import EXAMPLE
from emsid.study.setup import EXPERIMENT
from emsid.study.summary import SummaryRow, findings, headline, summary
from emsid.study.survey import InputRow
from emsid.study.workflow import Part, Study
from emsid.validation.comparison import Assessment
from emsid.wording import Severity, Spelling, as_python, sentence, severity
from emsid.wording.claims import claim

WORST = "The intervals are those in which the linear model is worst."


def study_report(result: Study, argument: Spelling = as_python) -> Report:
    """The page of a study.

    Args:
        result: the study.
        argument: how names of arguments are written in its findings.
    """
    found = findings(result)
    first, rows = result.parts[0], study_rows(result)
    notes = [each for each in found if claim(each) is None and severity(each) is Severity.INFO]
    notes = [each for each in notes if each not in headline(found)]
    works: dict[str, Callable[[], Iterable[Section]]] = {
        "tables beside the paper's": lambda: [
            Section(
                "The paper's tables beside this study",
                terms=(terms.FREE_RUN, terms.FIT),
                tables=(paper_table(result.parts), models_table(rows, lead_inputs(result))),
            )
        ],
        "claims of the paper": lambda: [
            Section(
                "Claims of the paper",
                tables=(claims_table(found, argument),),
                remarks=tuple(sentence(each, argument) for each in notes),
            )
        ],
        "survey": lambda: claim_sections(result),
        **{f"the {part.name} study": partial(lambda part: [part_section(part, result)], part) for part in result.parts},
        "the simulated motor": lambda: [motor_section(result)],
        **{model: partial(model_sections, result, model) for model in (BLOCKS, ONE_MASS, TWO_MASSES)},
    }
    with collected() as noted:
        opening = tried(
            "the first figure", lambda: Section("", figures=(overview(first, rows[first.name]),)), Section("")
        )
        sections = joined({f"section of the page: {part}": work for part, work in works.items()})
    return Report(
        title="Identification of an electromechanical system, after Kara and Abokoos",
        summary=(" ".join(sentence(each, argument) for each in headline(found)),),
        sections=tuple(sections),
        imprint=f"emsid study, seed {result.settings.seed}, after Kara and Abokoos",
        opening=opening,
        notices=tuple(
            Notice(sentence(each, argument), severity(each).value)
            for each in (*found, *noted)
            if severity(each) is not Severity.INFO
        ),
    )


def study_rows(result: Study) -> dict[str, list[SummaryRow]]:
    """A row for every model, by the name of the study."""
    return {part.name: summary(part, own_records=result.own_records) for part in result.parts}


def lead_inputs(result: Study) -> tuple[InputRow, ...]:
    """The experiment over many inputs, where the survey has the motor of the settings and no record is the user's."""
    survey = result.survey
    return survey.inputs if survey and not result.own_records and speaks_of(result.settings) else ()


def claim_sections(result: Study) -> tuple[Section, ...]:
    """When the paper's model helps, when not, by how much, and what always does."""
    survey = result.survey
    tables: list[Table] = []
    figures: tuple[Figure, ...] = ()
    if survey is not None and survey.motors:
        tables = [motors_table(survey.motors), largest_table(survey.largest)]
    if result.example:
        unseen = [pair[1] for pair in result.example]
        intervals = worst_intervals(unseen)
        drawn = views.responses(unseen, intervals, name="motor-responses")
        caption = f"A motor with {EXAMPLE.meaning}, on the bench. {drawn.caption} {WORST}"
        figures = (replace(drawn, caption=caption),)
    title = "When the paper's model helps"
    return (Section(title, tables=tuple(tables), figures=figures, diagrams=(identification_loop(),)),)


def worst_intervals(shown: Sequence[Assessment]) -> tuple[slice, ...]:
    """The intervals where the first model, the linear one, is worst."""
    record = shown[0].record
    return views.critical_intervals(record, 0.1 * len(record) * record.dt, record.output - shown[0].simulation.output)


def _ranked(mse: float) -> float:
    return mse if isfinite(mse) else float("inf")


def part_section(part: Part, result: Study) -> Section:
    """All errors of one of the two studies and its figures."""
    name = part.name
    shown = [part.on_unseen(model) for model in part.models]
    responses = views.responses(shown, worst_intervals(shown), name=f"{name}-responses")
    best = min(shown, key=lambda each: _ranked(each.row.simulation_mse))
    recursion = (
        (views.convergence(part.on_unseen(PAPER, "rls").fit, part.on_unseen(PAPER).fit, name=f"{name}-convergence"),)
        if PAPER in part.models
        else ()
    )
    return Section(
        f"The {name} study",
        terms=(terms.ONE_STEP, terms.MSE, terms.METHOD),
        tables=(
            views.results_table(part.rows, unit=part.unseen.output_units[0]),
            *input_tables(part, result),
        ),
        figures=(
            views.measured_and_simulated(best, name=f"{name}-free-run"),
            replace(responses, caption=f"{responses.caption} {WORST}"),
            views.inputs((part.identification, part.unseen), name=f"{name}-inputs"),
            *recursion,
            *((priors_figure(part.priors, f"{name}-priors"),) if part.priors else ()),
            views.residuals(shown, name=f"{name}-residuals"),
        ),
    )


def input_tables(part: Part, result: Study) -> tuple[Table, ...]:
    """What the inputs excite, and what a richer one changes."""
    richer = result.richer if part.name == EXPERIMENT and not result.own_records else None
    if not part.excitations:
        return ()
    excitations = (*part.excitations, *((richer.excitation,) if richer else ()))
    table = excitation_table(excitations, len(part.on_unseen(LINEAR).fit.names))
    return (table, richer_table(richer)) if richer else (table,)


def motor_section(result: Study) -> Section:
    """The simulated motor."""
    settings, friction = result.settings, result.load_friction
    return Section(
        "The motor",
        paragraphs=(
            "A two-mass permanent-magnet DC motor with Coulomb and Stribeck friction (4.7) on both sides and a dead "
            "zone (4.9).",
        ),
        diagrams=(motor_schematic(), block_diagram(), experimental_setup()),
        tables=(views.motor_table(settings.motor),),
        figures=(views.nonlinearities(settings.motor), *((load_friction_figure(friction),) if friction else ())),
    )


def model_sections(result: Study, model: str) -> Iterable[Section]:
    """The blocks or a physical motor, of the first study that has it."""
    part = next((part for part in result.parts if model in part.models), None)
    if part is not None:
        section = views.model_section(part.on_unseen(model).fit, part.identification)
        rows = result.survey.two_masses if model == TWO_MASSES and result.survey else ()
        if rows and speaks_of(result.settings):
            section = replace(section, tables=(*section.tables, two_masses_table(rows)))
        yield section
