"""Tables and figures of the study beyond its two parts: other motors, inputs and records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from emsid.report.document import Axis, Dash, Figure, Ink, Level, Line, Plot, Points, Stroke, Table
from emsid.report.numbers import number
from emsid.study.conclusions import paper_ratios
from emsid.study.inputs import HIGHEST_ORDER, Excitation, InputRow, Richer
from emsid.study.load_friction import LoadFriction
from emsid.study.models import BLOCKS, FRICTION, FULL, LINEAR, ONE_MASS, PAPER
from emsid.study.motors import MODELS, MotorRow
from emsid.study.priors import PriorRow
from emsid.study.readings import FREE_RUN, Largest
from emsid.study.setup import SIMULATION, UNSEEN, paper_ratio
from emsid.study.two_masses import TwoMassRow
from emsid.study.workflow import Part

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
    return "" if ratio is None else f"×{float(f'{ratio:.3g}'):,.10g}"


def inputs_table(rows: Sequence[InputRow]) -> Table:
    """Every model over many inputs: the lead of the page."""
    best = max(range(len(rows)), key=lambda k: rows[k].median)
    return Table(
        ("Model", "Median", "Lowest", "Highest", "Parameters"),
        tuple((row.model, *map(times, (row.median, row.lowest, row.highest)), str(row.parameters)) for row in rows),
        f"Ratio to linear on the noisy bench, over {rows[0].inputs} pairs of inputs. Free run on unseen data.",
        "Ratio to linear: free-run MSE of the paper's linear model (8 parameters) divided by that of this model. Every "
        "input is a sum of two sines with amplitudes of 1.5 to 3.5 V, at 0.2 to 0.6 Hz and at 0.8 to 1.6 Hz.",
        emphasised=frozenset({best}),
    )


def ratios_table(parts: Sequence[Part]) -> Table:
    """The paper's two ratios beside ours."""
    rows = [row for part in parts for row in paper_ratios(part)]
    return Table(
        ("Study", "Data", "Paper", "Free run", "One step ahead"),
        tuple((row.study, row.data, times(row.paper), times(row.free_run), times(row.one_step)) for row in rows),
        "Linear MSE divided by nonlinear MSE, for the paper's two models (5.12) and (5.10).",
        "The paper does not say whether its MSE (5.14) is of the free run or one step ahead.",
        text_columns=2,
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
                *(times(row.unseen.get(model)) for model in MODELS),
                times(row.one_step),
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
