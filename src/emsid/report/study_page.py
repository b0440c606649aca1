"""The page of the study: what was found, the paper's tables beside ours, and other motors, inputs and records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite

import numpy as np

from emsid.estimation.borders import collected, joined, tried
from emsid.findings import Finding
from emsid.report import views
from emsid.report.document import (
    Axis,
    Bars,
    Dash,
    Figure,
    Ink,
    Level,
    Line,
    Notice,
    Plot,
    Points,
    Report,
    Section,
    Stroke,
    Table,
)
from emsid.report.numbers import number, percent
from emsid.report.views import conventions as terms
from emsid.report.views.diagrams import block_diagram, experimental_setup, identification_loop, motor_schematic
from emsid.study.models import (
    BLOCKS,
    EXPERIMENT,
    FRICTION,
    FULL,
    LINEAR,
    ONE_MASS,
    PAPER,
    PAPER_MSE,
    SIMULATION,
    TWO_MASSES,
    UNSEEN,
    paper_ratio,
)
from emsid.study.summary import SummaryRow, findings, headline, paper_ratios, speaks_of, summary
from emsid.study.survey import (
    EXAMPLE,
    FREE_RUN,
    HIGHEST_ORDER,
    MODELS,
    Excitation,
    InputRow,
    Largest,
    LoadFriction,
    MotorRow,
    PriorRow,
    Richer,
    TwoMassRow,
)
from emsid.study.workflow import Part, Study
from emsid.validation.comparison import Assessment
from emsid.wording import Severity, Spelling, as_python, sentence, severity
from emsid.wording.claims import Claim, claim
from emsid.wording.study import ratio as in_words
from emsid.wording.study import where

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
    bench = [each for each in found if each.code == "study-virtual-bench"]
    notes = [each for each in notes if each not in (*headline(found), *bench)]
    works: dict[str, Callable[[], Iterable[Section]]] = {
        **{f"the {part.name} study": partial(lambda part: [part_section(part, result)], part) for part in result.parts},
        "the simulated motor": lambda: [motor_section(result)],
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
        **{model: partial(model_sections, result, model) for model in (BLOCKS, ONE_MASS, TWO_MASSES)},
    }
    with collected() as noted:
        opening = tried(
            "the first figure", lambda: Section("", figures=(overview(first, rows[first.called]),)), Section("")
        )
        sections = joined({f"section of the page: {part}": work for part, work in works.items()})
    title = f"Models of {first.identification.name}" if first.own else "Models of an electromechanical system"
    return Report(
        title=title,
        summary=tuple(sentence(each, argument) for each in [*headline(found), *bench]),
        sections=tuple(sections),
        imprint=f"emsid study, seed {result.settings.seed}, after Kara and Abokoos",
        opening=opening,
        notices=tuple(
            Notice(sentence(each, argument), severity(each).value)
            for each in sorted((*found, *noted), key=lambda each: "study" not in each.data)
            if severity(each) is not Severity.INFO
        ),
    )


def study_rows(result: Study) -> dict[str, list[SummaryRow]]:
    """A row for every model, by the name of the study."""
    return {part.called: summary(part, own_records=result.own_records) for part in result.parts}


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
        f"The {part.called}",
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


CHECK = "noise-free, by the program's own simulator: a check of the estimator, not a result"
THROUGH_ZERO = 0.06
"""Share of the record in the picture of the study: about a second of the paper's inputs, a reversal with both sides."""
BAR = 0.19
"""Height of a bar, in rows of ordinary height."""

HEADINGS = {
    PAPER: "Paper's model (5.10)",
    FULL: "Degree 3, cross terms (3.5)",
    FRICTION: "Hinges and friction terms",
    BLOCKS: "Three blocks",
    ONE_MASS: "Physical motor",
}


EQUATIONS = {LINEAR: "(5.12)", PAPER: "(5.10)", FULL: "(3.5), degree 3"}


def times(ratio: float | None) -> str:
    """A ratio with three digits.

    >>> times(557.2), times(46871.3), times(0.982), times(None)
    ('×557', '×46,900', '×0.982', '')
    """
    return "" if ratio is None else in_words(ratio)


def beside(ratio: float | None) -> str:
    """A ratio to the linear model, and whether it is worse.

    >>> beside(557.2), beside(0.9906), beside(1.0001)
    ('×557', '×0.991, worse', '×1')
    """
    return f"{times(ratio)}{', worse' * (ratio is not None and float(f'{ratio:.3g}') < 1)}"


def overview(part: Part, rows: Sequence[SummaryRow]) -> Figure:
    """The picture of the study: measured speed through zero with free runs, and the ratio of every model."""
    best = max((row for row in rows if row.better_unseen is not None), key=_ratio, default=None)
    names = list(dict.fromkeys(name for name in (LINEAR, PAPER, best.model if best else "") if name in part.models))
    shown = [part.on_unseen(name) for name in names]
    record = shown[0].record
    error = record.output - shown[0].simulation.output
    (interval, *_) = views.critical_intervals(record, THROUGH_ZERO * len(record) * record.dt, error, count=1)
    (near_zero, *_) = views.responses(shown, (interval,)).plots
    through_zero = replace(near_zero, title=f"Through zero, {near_zero.title}", height=0.25 + BAR * len(rows))
    drawn = [row for row in rows if not row.check]
    values = np.array([_ratio(row) for row in drawn])
    paper = np.array([(row.paper_unseen, k) for k, row in enumerate(drawn) if row.paper_unseen is not None], float)
    known = values[np.isfinite(values)]
    ratios = Plot(
        (
            Bars(values, tuple(beside(row.better_unseen) or "diverged" for row in drawn), "this study"),
            *((Points(paper[:, 0], paper[:, 1], "paper", Ink.RED),) if len(paper) else ()),
        ),
        Axis(
            "Ratio to linear", "1", log=True, range=(0.5 * known.min(), 1.5 * known.max()) if len(known) else (0.5, 2.0)
        ),
        Axis("Model", names=tuple(row.model for row in drawn)),
        "Linear MSE divided by that of the model",
        height=0.25 + BAR * len(rows),
    )
    return Figure(
        "overview",
        f"The {part.called} on unseen data: measured and free runs where the linear model is worst, and the free-run "
        "MSE of the linear model divided by that of each model; larger is better.",
        (through_zero, ratios),
        columns=2,
    )


def _ratio(row: SummaryRow) -> float:
    return float("nan") if row.better_unseen is None else row.better_unseen


def paper_table(parts: Sequence[Part]) -> Table:
    """The paper's Tables 1 and 2 beside the same errors of this study, and the ratios of both."""
    rows = []
    for part in parts:
        ratios = {row.data: row for row in paper_ratios(part)}
        for data, on in (("identification", part.on_identification), ("unseen", part.on_unseen)):
            if data not in ratios:
                continue
            published, found = PAPER_MSE[part.name, data], ratios[data]
            here = (number(on(model).row.simulation_mse) for model in (LINEAR, PAPER))
            numbers = (
                *map(number, published),
                times(found.paper),
                *here,
                beside(found.free_run),
                beside(found.one_step),
            )
            rows.append((part.called, data, *numbers))
    return Table(
        (
            "Study",
            "Data",
            "Paper: linear MSE",
            "Paper: nonlinear MSE",
            "Paper: ratio",
            "Here: linear MSE",
            "Here: nonlinear MSE",
            "Here: ratio in free run",
            "Here: ratio one step ahead",
        ),
        tuple(rows),
        "The paper's Tables 1 and 2 beside this study: linear model (5.12), nonlinear model (5.10).",
        "Ratio: linear MSE divided by nonlinear MSE. The paper's motor is another one and its units are not stated, so "
        "only ratios can be compared. It does not say whether its MSE (5.14) is of the free run or one step ahead.",
        text_columns=2,
    )


def models_table(rows: Mapping[str, Sequence[SummaryRow]], inputs: Sequence[InputRow]) -> Table:
    """Every model with its free-run fit, its ratio to linear in each study, and over many inputs.

    Args:
        rows: the rows of each study, by its name; the first is the one for fits and the best model.
        inputs: the survey of many inputs; empty where it does not speak of this motor.
    """
    first, *_ = rows.values()
    models = {row.model: row for study in rows.values() for row in study}
    found = {(name, row.model): row for name, study in rows.items() for row in study}
    many = {row.model: row for row in inputs}
    cells = []
    for model, row in models.items():
        of_first = next((each for each in first if each.model == model), None)
        over = many.get(model)
        cells.append(
            (
                model,
                str(row.parameters),
                "" if of_first is None else percent(of_first.fit_percent),
                *(_times(found.get((name, model))) for name in rows),
                *(("" if over is None else beside(over.median),) if inputs else ()),
                *(("" if over is None else f"{times(over.lowest)} to {times(over.highest)}",) if inputs else ()),
                f"{row.meaning}{f' – {CHECK}' if row.check else ''}",
            )
        )
    best = max((row for row in first if not row.check), key=lambda row: row.better_unseen or 0.0).model
    many_heads = ("Median, many inputs", "Lowest to highest") if inputs else ()
    note = "Ratio: free-run MSE of the linear model divided by that of this model."
    if inputs:
        note += f" Many inputs: {inputs[0].inputs} pairs of two sines (1.5 to 3.5 V, 0.2 to 1.6 Hz) on the noisy bench."
    return Table(
        ("Model", "Parameters", "Free-run fit", *(f"Ratio, {name}" for name in rows), *many_heads, "Description"),
        tuple(cells),
        f"All models, in free run on unseen data; fit {where(next(iter(rows)))}.",
        note,
        ends_in_text=True,
        emphasised=frozenset({list(models).index(best)}),
    )


def _times(row: SummaryRow | None) -> str:
    """A ratio to the linear model; none in a check, whose error is only rounding."""
    return "" if row is None else "check only" if row.check else beside(row.better_unseen)


def claims_table(found: Sequence[Finding], argument: Spelling = as_python) -> Table:
    """What the paper says, what this study finds, and where it holds; findings about one claim share a row."""
    rows: dict[str, list[Claim]] = {}
    for each in (claim(finding, argument) for finding in found):
        if each is not None:
            rows.setdefault(each.paper, []).append(each)
    return Table(
        ("The paper", "This study", "Where it holds"),
        tuple(
            (paper, " ".join(each.found for each in same), "; ".join(each.where for each in same))
            for paper, same in rows.items()
        ),
        "Claims of the paper, and what this study finds.",
        text_columns=3,
    )


def motors_table(rows: Sequence[MotorRow]) -> Table:
    """A family of motors: the ratio of every model to the linear one."""
    return Table(
        ("Motor", "Linear fit", "Even share", *(HEADINGS[model] for model in MODELS), "(5.10), one step ahead"),
        tuple(
            (
                row.meaning,
                f"{row.linear_fit_percent:.1f} %",
                f"{100 * row.even_share:.0f} %",
                *(beside(row.unseen.get(model)) for model in MODELS),
                beside(row.one_step),
            )
            for row in rows
        ),
        "Ratio to linear for a family of motors on the noisy bench. Free run on unseen data.",
        "Every motor is the default one with this difference. Even share: the share of the linear model's squared "
        "error that "
        "is the same for u and −u. The physical motor has friction, dead zone and slope by direction (10 parameters).",
    )


def largest_table(rows: Sequence[Largest]) -> Table:
    """The largest ratio of the paper's own models in every reading of its experiment."""
    free = {row.reading: row for row in rows if row.error == FREE_RUN}
    ahead = {row.reading: row for row in rows if row.error != FREE_RUN}
    published = [paper_ratio(SIMULATION, data) for data in ("identification", UNSEEN)]
    return Table(
        (
            "Reading",
            "Largest, identification data",
            "Largest, unseen data",
            "Median, unseen data",
            "Motor with the largest",
            "One step ahead: largest, unseen data",
        ),
        tuple(
            (
                name,
                times(row.identification),
                times(row.unseen),
                times(row.median),
                f"dead zone {row.motor['dead_zone']}, slope {row.motor['slope']:g}, friction {row.motor['friction']}",
                times(ahead[name].unseen),
            )
            for name, row in free.items()
        ),
        f"Largest ratio of linear to nonlinear MSE of the paper's own models over {rows[0].motors} motors.",
        f"The paper has {times(published[0])} on identification data and {times(published[1])} on unseen data. The "
        "motors combine a dead zone (none, ±0.5 V, 0 to 0.5 V, 0 to 1.5 V), a left slope (1, 0.8, 0.5) and friction of "
        "the rotor (none, alike, 12 and 4 mN·m, forward only).",
        emphasised=frozenset(
            k
            for k, row in enumerate(free.values())
            if row.identification >= published[0] and row.unseen >= published[1]
        ),
    )


def two_masses_table(rows: Sequence[TwoMassRow]) -> Table:
    """The motor with its shaft on records that are not the simulator's own: errors and intervals in percent."""
    names = list(dict.fromkeys(name for row in rows for name in row.errors))
    return Table(
        ("Parameter", *(row.record for row in rows)),
        tuple(
            (name, *(f"{100 * row.errors[name]:+.2g} ± {100 * row.intervals[name]:.2g} %" for row in rows))
            for name in names
        ),
        "The motor with its shaft on other records: error and half width of the 95 % interval, in percent of the "
        "truth.",
        f"Fixed: {', '.join(rows[0].fixed)}. The intervals do not include the uncertainty of these values.",
    )


def excitation_table(excitations: Sequence[Excitation], parameters: int) -> Table:
    """What inputs excite."""
    models = tuple(excitations[0].conditions)
    return Table(
        (
            "Record",
            "Input",
            "Order of excitation",
            "Crest factor",
            *(f"Condition {EQUATIONS[model]}" for model in models),
        ),
        tuple(
            (
                each.record,
                each.input,
                f"≥ {each.order}" if each.order >= HIGHEST_ORDER else str(each.order),
                f"{each.crest_factor:.2f}",
                *(f"{each.conditions[model]:.2g}" for model in models),
            )
            for each in excitations
        ),
        f"What the inputs excite. The linear model has {parameters} parameters.",
        "Order: of persistent excitation; a sum of two sines has order 4. Condition: condition number of the "
        "regression.",
        text_columns=2,
    )


def richer_table(richer: Richer) -> Table:
    """What a richer input changes."""
    return Table(
        ("Model", "Fitted to two sines", "Fitted to a multisine"),
        tuple((name, number(two), number(many)) for name, (two, many) in richer.errors.items()),
        "Free-run MSE on the unseen record of two sines, after a fit to two sines or to a multisine of the same peak.",
    )


def load_friction_figure(found: LoadFriction) -> Figure:
    """Difference of the outputs and free-run error of the blocks against friction on the load."""
    shares, fitted = 100 * np.array(found.shares), 100 * np.array(found.fitted)
    changed = np.array(found.differences) > 0
    curve = (
        Line(
            shares[changed],
            np.array(found.differences)[changed],
            "difference to the output without load friction",
            Stroke(Ink.BLUE),
        ),
        Points(fitted, np.array(found.errors), "free-run error of the blocks, fitted again", Ink.RED),
        Line(fitted, np.array(found.errors), stroke=Stroke(Ink.RED, Dash.DASHED)),
    )
    fair = (
        "The blocks do not become worse by more than noise"
        if found.unfair_from is None
        else f"From {100 * found.unfair_from:.2g} % on, the blocks are worse by more than noise"
    )
    return Figure(
        "load-friction",
        f"Friction on the load: mean squares on unseen data, noise-free. {fair}.",
        (
            Plot(
                curve, Axis("Load friction", "% of the rotor's"), Axis("Mean square", "(rad/s)^2", log=True), height=1.2
            ),
        ),
    )


def priors_figure(rows: Sequence[PriorRow], name: str) -> Figure:
    """Difference of recursive and batch least squares against P(0)."""
    inks = (Ink.RED, Ink.BLUE, Ink.GREEN, Ink.ORANGE)
    lines = [
        Line(
            np.array(row.covariances),
            100 * np.maximum(np.abs(row.recursive), 1e-14),
            f"{row.model} (condition {row.condition:.2g})",
            Stroke(ink),
        )
        for row, ink in zip(rows, inks, strict=False)
    ]
    plot = Plot(
        (*lines, Level(1.0, "1 %")),
        Axis("Initial covariance P(0)", "1", log=True),
        Axis("Difference of free-run MSE", "%", log=True),
        height=1.2,
    )
    return Figure(
        name, "Recursive against batch least squares: P(0) acts as a ridge of 1/P(0), which fades as it grows.", (plot,)
    )
