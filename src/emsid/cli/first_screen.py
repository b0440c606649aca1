"""The first screen of ``emsid identify``, and the details below it.

The screen has at most `LINES` lines in this order: which model, how good it is on what, what is known with which
uncertainty, what is not known, what to do next. The details are all models, all values and all findings about the
recommended model, and those of physical models among few. The report has everything.
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

from emsid.cli.options import option
from emsid.cli.terminal import (
    FREE_RUN_EXPLAINED,
    characteristics_table,
    half_width,
    physical_table,
    plain_table,
    say,
    show,
    text_table,
)
from emsid.estimation.estimates import HALF_WIDTH, Status
from emsid.models.kinds import capabilities_of
from emsid.report.document import Table
from emsid.report.numbers import both_directions, less_than
from emsid.units import in_unit, plain_unit, with_unit
from emsid.wording import Severity, sentence, severity
from emsid.wording.first_screen import (
    NOTHING_KNOWN,
    NOTHING_UNKNOWN,
    assumed,
    further,
    more,
    not_determined,
    other_reasons,
)
from emsid.wording.lists import listed
from emsid.wording.verdict import IN_SHORT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from emsid.estimation.fit import Fit
    from emsid.findings import Finding
    from emsid.identification import Identification
    from emsid.validation.comparison import OutputErrors, Row

LINES = 25
"""A terminal without scrolling, with the line that says where the files are."""
ROWS, VALUES, UNKNOWN = 3, 5, 3
"""Lines for models, for known values and for what is not known, which together fill the screen."""
LONGEST = 400
"""A longer line of an equation, such as one with all knots of a spline, is cut."""
IN_FULL = 3
"""Of more models than this, the screen has details of the recommended one only."""
FIRST = "free-run-error"
"""The finding that follows the recommendation."""
BEFORE = ("unstable-in-loop", "input-explains-nothing", "models-of-one-output")
"""The findings before the recommendation: what models and errors mean depends on them."""
AS_NAMES = frozenset({"not-identifiable", "weakly-identified", "intervals-include-zero"})
"""Findings whose parameters are on the screen by name."""
DROPPED = frozenset({"model-failed", "models-out-of-time", "interrupted"})
"""Findings that name models without a result, and why."""
OF_THE_LOOP = frozenset(
    {"free-run-diverged", "diverges-beyond-range", "diverges-on-constant-input", "diverges-on-steps"}
)
"""What every right model of a plant does that is unstable without its controller."""


def first_screen(result: Identification, details: bool = False) -> None:
    """Print the first screen.

    Args:
        result: the identification.
        details: whether all models, values and findings follow.
    """
    why, *then = result.recommendation
    said = [finding for finding in result.findings if finding.code in BEFORE]
    say(*(sentence(finding, option) for finding in (*said, why, *_first(result))))
    show(text_table(models_table(result, ROWS)))
    _known(result)
    fit = result.chosen
    values = [f"{row.name.replace('_', ' ')} {with_unit(f'{row.value:.4g}', row.unit)}" for row in fit.assumed]
    if line := assumed(values, [row.name for row in fit.table if row.status is Status.ASSUMING]):
        say(line)
    _not_known(result)
    steps = [*then, *result.next_steps] if result.is_usable else [*result.next_steps, *then]
    most = 2 - len(said)
    say(*(sentence(step, option) for step in steps[:most]))
    if details:
        _everything(result, steps[most:])
    else:
        say(more(option))


def _everything(result: Identification, steps: Sequence[Finding]) -> None:
    """All models, values, equations and findings, and the steps that are not on the screen."""
    say("")
    show(text_table(models_table(result)))
    say(FREE_RUN_EXPLAINED, "")
    if result.characteristics:
        show(characteristics_table(result.characteristics))
    _details(result)
    findings = _warnings(result)
    say(*(f"- {sentence(finding, option)}" for finding in (*findings, *steps)))
    say(f"- in the report: {_left_out(result, findings)}")


def _known(result: Identification) -> None:
    """Print values with their intervals, those of the plant first."""
    rows = _values(result)
    if not rows:
        fault = result.of_sensor
        say(NOTHING_KNOWN if fault is None else f"known: nothing, since {sentence(fault, option)}")
        return
    left = further(len(rows) - VALUES, option)
    headings: dict[str, Any] = {"quantity": "left", "value": "right", "±": "right", "unit": "left", "model": "left"}
    show(plain_table(f"known, with 95 % intervals{left}", headings, rows[:VALUES]))


def _values(result: Identification) -> list[tuple[str, ...]]:
    """Name, value, half of the interval, unit and source of every value that the data determine.

    Where some parameters depend on values that nobody gave, quantities that do not come first.
    A model that cannot be used says nothing about the drive.
    """
    if not result.is_usable:
        return []
    name = result.chosen.model.name
    of_sensor = ("sensor.", "drive.")
    plant = [
        (row.name, f"{row.value:.4g}", half_width(row), plain_unit(row.unit), _source(name, row.given))
        for row in sorted(result.known, key=lambda row: row.name.startswith(of_sensor))
    ]
    inside = [each for each in plant if not each[0].startswith(of_sensor)]
    of_drive: list[tuple[str, ...]] = [
        (
            each.name,
            f"{each.value:.4g}",
            f"{each.half_width:.2g}",
            plain_unit(each.unit),
            _source(each.model, each.given),
        )
        for each in result.characteristics
        if each.shown and each.significant and each.half_width is not None and isfinite(each.half_width)
    ]
    of_drive = both_directions(of_drive)
    first = (*of_drive, *inside) if result.chosen.assumed else (*inside, *of_drive)
    return [*first, *plant[len(inside) :]]


def _source(model: str, given: Sequence[str]) -> str:
    return f"{model}, given {listed(given)}" if given else model


def _not_known(result: Identification) -> None:
    """Print what these data do not show: models without a result, values by name, and what limits the result."""
    names = not_determined(_open(result))
    warned = [finding for finding in _warnings(result) if severity(finding) is not Severity.INFO]
    looped = any(finding.code == BEFORE[0] for finding in result.findings)
    said = (
        *DROPPED,
        *AS_NAMES,
        *BEFORE,
        *(OF_THE_LOOP if looped else ()),
        *(each["code"] for each in result.model_verdicts[0].data["reasons"]),
    )
    found = [
        sentence(finding, option)
        for finding in warned
        if finding.code not in said and finding not in result.model_verdicts
    ]
    dropped = "; ".join(sentence(finding, option) for finding in warned if finding.code in DROPPED)
    lines = [*filter(None, (dropped, names)), *other_reasons(result.model_verdicts[0]), *found]
    if lines:
        say(f"not known{further(len(lines) - UNKNOWN, option)}", *(f"- {line}" for line in lines[:UNKNOWN]))
    else:
        say(NOTHING_UNKNOWN)


def _open(result: Identification) -> list[str]:
    """The values that the chosen model has and the data do not determine, by name, with a bound of those near zero."""
    known = {row.name for row in result.known}
    table = capabilities_of(result.chosen.model).physical_rows(result.chosen)
    of_search = (Status.FIXED, Status.OF_PLANT, Status.CHOSEN, *((Status.ASSUMING,) if result.chosen.assumed else ()))
    found: list[tuple[str, float, float | None, str]] = [
        (row.name, row.value, HALF_WIDTH * (row.standard_error or 0.0) * row.may_be_zero, row.unit)
        for row in table
        if row.name not in known and row.status not in of_search
    ]
    found += [
        (each.name, each.value, each.half_width, each.unit)
        for each in result.characteristics
        if not (each.shown and each.significant)
    ]
    bounds = [(name, less_than(value, half), unit) for name, value, half, unit in found]
    return [f"{name} ({with_unit(bound, unit)})" if bound else name for name, bound, unit in bounds]


def models_table(result: Identification, most: int | None = None) -> Table:
    """Models with their number of parameters, their error on unseen data and the verdict on them.

    Args:
        result: the identification.
        most: of more lines than this, those of the first models and of the chosen one; by default all.
    """
    several = any(row.outputs for row in result.rows)
    rmse = in_unit("free-run RMSE", "" if several else result.unseen.output_units[0])
    verdicts = {each.model: IN_SHORT[each.code] for each in result.model_verdicts}
    rows = _few(result, most) if most else result.rows
    lines = []
    for row in rows:
        preferred = result.is_recommended and row.model == result.chosen.model.name
        verdict = f"{'recommended; ' * preferred}{verdicts[row.model]}"
        names = [in_unit(output.output, output.unit) for output in row.outputs]
        of_outputs: Sequence[Row | OutputErrors] = row.outputs or (row,)
        for k, errors in enumerate(of_outputs):
            fit = f"{errors.fit_percent:.2f}" if isfinite(errors.fit_percent) else "–"
            error = f"{errors.simulation_rmse:.4g}" if isfinite(errors.simulation_rmse) else "diverges"
            lines.append((row.model, *names[k : k + 1], str(row.parameters), error, fit, verdict))
    left = further(len(result.rows) - len(rows), option)
    return Table(
        ("model", *("output",) * several, "parameters", rmse, "fit %", "verdict"),
        tuple(lines),
        f"on {result.ranked_on} ({result.unseen.name}), the best first{left}",
        text_columns=1 + several,
        ends_in_text=True,
    )


def _few(result: Identification, most: int) -> tuple[Row, ...]:
    """The rows of the models with the smallest errors, with the chosen one among them, as far as they fit in lines."""
    outputs = max(len(result.rows[0].outputs), 1)
    count = max(most // outputs, 1)
    (chosen,) = [row for row in result.rows if row.model == result.chosen.model.name]
    first = result.rows[:count]
    return first if chosen in first else (*first[: count - 1], chosen)


def _details(result: Identification) -> None:
    """Parameters of physical models with their intervals, and the equation of the best model if it is another one."""
    from emsid.models.kinds import capabilities_of
    from emsid.models.plants.search.result import has_physical_parameters
    from emsid.report.views.grey_box import own_parameters

    for fit in _in_detail(result):
        if has_physical_parameters(fit):
            show(physical_table(fit))
            if fit.by_record:
                show(text_table(own_parameters(fit)))
        else:
            text = capabilities_of(fit.model).equation(fit, result.data_of(fit))
            lines = text.splitlines()
            say(f"{fit.model.name}:")
            say(*(x if len(x) <= LONGEST else f"{x[:LONGEST]}… (in full in the report)" for x in lines), "")


def _in_detail(result: Identification) -> list[Fit[Any]]:
    """The models with details on the screen, the best one first."""
    from emsid.models.plants.search.result import has_physical_parameters

    few = len(result.fits) <= IN_FULL
    return [fit for fit in result.fits if fit is result.chosen or (few and has_physical_parameters(fit))]


def _first(result: Identification) -> list[Finding]:
    """The findings that follow the recommendation."""
    return [finding for finding in result.findings if finding.code == FIRST]


def _warnings(result: Identification) -> list[Finding]:
    """Findings about the data and the models in detail, warnings first."""
    less = {fit.model.name for fit in result.fits} - {fit.model.name for fit in _in_detail(result)}
    noticed = [finding for finding in result.findings if finding.code != FIRST and finding.model not in less]
    verdict = [each for each in result.model_verdicts[:1] if len(each.data["reasons"]) > 1]
    found = (*noticed, *verdict, *result.verdicts)
    return sorted(found, key=lambda each: severity(each) is Severity.INFO)


def _left_out(result: Identification, said: Sequence[Finding]) -> str:
    """What the report has besides."""
    count = sum(finding not in said for finding in result.findings) - len(_first(result))
    more = [f"{count} {'finding' if count == 1 else 'findings'} about other models"] if count else []
    return listed((*more, "residual tests", "errors by operating region", "accuracy against number of parameters"))
