"""The first screen of ``emsid identify``: the recommended model, its error and the next experiment, then details.

The report has everything. The screen has the details of the recommended model, and of physical ones among few models.
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

from emsid.cli.options import option
from emsid.cli.terminal import (
    FREE_RUN_EXPLAINED,
    characteristics_table,
    physical_table,
    say,
    show,
    text_table,
)
from emsid.report.document import Table
from emsid.units import in_unit
from emsid.wording import Severity, sentence, severity
from emsid.wording.lists import listed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from emsid.estimation.fit import Fit
    from emsid.findings import Finding
    from emsid.identification import Identification
    from emsid.validation.comparison import OutputErrors, Row

LONGEST = 400
"""A longer line of an equation, such as one with all knots of a spline, is cut."""
IN_FULL = 3
"""Of more models than this, the screen has details of the recommended one only."""
FIRST = "free-run-error"
"""The finding that follows the recommendation."""
NAMED = 2
"""The recommendation names as many reasons against a model; with more, the screen has its verdict too."""
VERDICTS = {
    "model-supported": "supported by these data",
    "model-limited": "usable with limits",
    "model-implausible": "implausible",
    "model-unusable": "not usable",
}
"""The verdict on a model in the table of models."""


def first_screen(result: Identification) -> None:
    """Print the recommendation and what to do next, the models, what is known about the drive, and the findings."""
    why, *then = result.recommendation
    say(*(sentence(each, option) for each in (why, *_first(result), *then, *result.next_steps)), "")
    show(text_table(models_table(result)))
    say(FREE_RUN_EXPLAINED, "")
    if result.characteristics:
        show(characteristics_table(result.characteristics))
    _details(result)
    shown = _shown(result)
    say(*(f"- {sentence(finding, option)}" for finding in shown))
    say(f"- in the report: {_left_out(result, shown)}")


def models_table(result: Identification) -> Table:
    """Every model with its number of parameters, its error on unseen data and the verdict on it."""
    several = any(row.outputs for row in result.rows)
    rmse = in_unit("free-run RMSE", "" if several else result.unseen.output_units[0])
    verdicts = {each.model: VERDICTS[each.code] for each in result.model_verdicts}
    lines = []
    for row in result.rows:
        preferred = result.is_recommended and row.model == result.chosen.model.name
        verdict = f"{'recommended; ' * preferred}{verdicts[row.model]}"
        names = [in_unit(each.output, each.unit) for each in row.outputs]
        of_outputs: Sequence[Row | OutputErrors] = row.outputs or (row,)
        for k, errors in enumerate(of_outputs):
            fit = f"{errors.fit_percent:.2f}" if isfinite(errors.fit_percent) else "–"
            shown = f"{errors.simulation_rmse:.4g}" if isfinite(errors.simulation_rmse) else "diverges"
            lines.append((row.model, *names[k : k + 1], str(row.parameters), shown, fit, verdict))
    return Table(
        ("model", *("output",) * several, "parameters", rmse, "fit %", "verdict"),
        tuple(lines),
        f"on {result.ranked_on} ({result.unseen.name}), the smallest error first",
        text_columns=1 + several,
        ends_in_text=True,
    )


def _details(result: Identification) -> None:
    """Parameters of physical models with their intervals, and the equation of the best model if it is another one."""
    from emsid.models.feedback.model import FeedbackModel
    from emsid.models.plants.search.result import GreyBoxFit
    from emsid.report.views.physical_parameters import own_parameters
    from emsid.validation.feedback_curves import rounded_equation

    for fit in _in_detail(result):
        if isinstance(fit, GreyBoxFit):
            show(physical_table(fit))
            if fit.by_record:
                show(text_table(own_parameters(fit)))
        else:
            is_loop = isinstance(fit.model, FeedbackModel)
            text = rounded_equation(fit, result.data_of(fit)) if is_loop else fit.model.equation()
            lines = text.splitlines()
            say(f"{fit.model.name}:")
            say(*(x if len(x) <= LONGEST else f"{x[:LONGEST]}… (in full in the report)" for x in lines), "")


def _in_detail(result: Identification) -> list[Fit[Any]]:
    """The models with details on the screen, the best one first."""
    from emsid.models.plants.search.result import GreyBoxFit

    few = len(result.fits) <= IN_FULL
    return [fit for fit in result.fits if fit is result.chosen or (few and isinstance(fit, GreyBoxFit))]


def _first(result: Identification) -> list[Finding]:
    """The findings that follow the recommendation."""
    return [each for each in result.findings if each.code == FIRST]


def _shown(result: Identification) -> list[Finding]:
    """Findings about the data and the models in detail, warnings first."""
    less = {fit.model.name for fit in result.fits} - {fit.model.name for fit in _in_detail(result)}
    noticed = [each for each in result.findings if each.code != FIRST and each.model not in less]
    verdict = [each for each in result.model_verdicts[:1] if len(each.data["reasons"]) > NAMED]
    found = (*noticed, *verdict, *result.verdicts)
    return sorted(found, key=lambda each: severity(each) is Severity.INFO)


def _left_out(result: Identification, shown: Sequence[Finding]) -> str:
    """What the report has besides."""
    count = sum(each not in shown for each in result.findings) - len(_first(result))
    more = [f"{count} {'finding' if count == 1 else 'findings'} about other models"] if count else []
    return listed((*more, "residual tests", "errors by operating region", "accuracy against number of parameters"))
