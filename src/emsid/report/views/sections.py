"""The section of a report about one model of any kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite
from typing import TYPE_CHECKING, Any

from emsid.errors import EmsidError
from emsid.estimation.borders import border
from emsid.estimation.estimates import HALF_WIDTH
from emsid.report.document import Figure, Section, Table
from emsid.report.numbers import estimate, number, sentence, slug
from emsid.report.views.bands import regression_friction, static_map
from emsid.report.views.front import parameter_table, regressor_column
from emsid.wording import Spelling, as_python
from emsid.wording import sentence as worded

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.plants.search.diagnostics import Profile
    from emsid.models.plants.search.result import GreyBoxFit
    from emsid.record import Record


Drawing = Callable[[], Figure | None]
View = Callable[["Fit[Any]", "Record", str], Figure | None]
VIEWS: list[View] = []
"""Further figures of a model: each takes a fit, a record and the beginning of the figure's name."""


def model_section(
    fit: Fit[Any],
    record: Record,
    *,
    name: str = "",
    profiles: Sequence[Profile] = (),
    argument: Spelling = as_python,
    drawn: bool = True,
) -> Section:
    """The equation and the parameters of one model, and the figures of its kind.

    A cascade has figures of its static maps and filters; a physical model of its friction, its dead zone and sticking.
    Figures that cannot be drawn are left out.

    Args:
        fit: of any model.
        record: in which the signals between the blocks of a cascade are shown.
        name: prefix of the names of its figures, by default the name of the model; needed if a report shows two models
            of one name.
        profiles: likelihood profiles of its parameters, where it is a physical model.
        argument: how names of arguments are written in its findings.
        drawn: whether it has figures.
    """
    from emsid.models.kinds import capabilities_of

    model, prefix = fit.model, slug(name or fit.model.name)
    remarks = tuple(sentence(worded(finding, argument)) for finding in fit.findings)
    parts = SECTIONS[capabilities_of(model).section(fit)](fit, record, prefix, profiles)
    drawings: list[Drawing] = [*parts.drawings, *(partial(view, fit, record, prefix) for view in VIEWS)]
    figures = _drawable(fit.model.name, drawings if drawn else ())
    return Section(name or model.name, parts.paragraphs, parts.equations, parts.tables, figures, remarks)


@dataclass(frozen=True)
class Parts:
    """What a section consists of: equations, tables, paragraphs, and what draws its figures."""

    equations: tuple[str, ...]
    tables: tuple[Table, ...]
    drawings: tuple[Drawing, ...] = ()
    paragraphs: tuple[str, ...] = ()


def _of_equation(fit: Fit[Any], record: Record, prefix: str, profiles: Sequence[Profile]) -> Parts:
    tables = [parameter_table(fit, columns=regressor_column(fit))]
    oscillating = mode_table(fit)
    if oscillating is None:
        return Parts((fit.model.equation(),), tuple(tables))
    return Parts((fit.model.equation(),), (*tables, oscillating), (partial(_poles, fit, prefix),))


def mode_table(fit: Fit[Any]) -> Table | None:
    """Resonances and antiresonances of a linear model with 95 % intervals; None without any."""
    from emsid.validation.analysis import modes

    if not getattr(fit.model, "is_linear", True):
        return None
    try:
        found = modes(fit)
    except EmsidError:  # no linear part
        return None
    if not len(found):
        return None

    def cells(value: float, error: float) -> tuple[str, str]:
        return (
            (estimate(value, HALF_WIDTH * error), number(HALF_WIDTH * error))
            if isfinite(error)
            else (number(value), "–")
        )

    columns = zip(found.kind, found.frequency, found.frequency_error, found.damping, found.damping_error, strict=True)
    rows = tuple(
        (kind, *cells(f, f_error), *cells(100 * ratio, 100 * error)) for kind, f, f_error, ratio, error in columns
    )
    head = ("mode", "frequency, Hz", "±", "damping, %", "±")
    return Table(head, rows, f"Modes of {fit.model.name}.", "± is half of the 95 % interval.")


def _poles(fit: Fit[Any], prefix: str) -> Figure:
    """Its poles with their 95 % intervals."""
    from emsid.report.views.analysis import poles_and_zeros
    from emsid.validation.analysis import pole_map

    return replace(poles_and_zeros([pole_map(fit)], [fit.model.name]), name=f"{prefix}-poles")


def _of_plant(fit: GreyBoxFit, record: Record, prefix: str, profiles: Sequence[Profile]) -> Parts:
    from emsid.report.views.grey_box import (
        cogging,
        dead_zone,
        friction,
        likelihood,
        physical_table,
        plant_equations,
        sticking,
        units_taken,
    )

    drawings: tuple[Drawing, ...] = (
        partial(sticking, fit, name=f"{prefix}-sticking"),
        partial(friction, fit, name=f"{prefix}-friction"),
        partial(dead_zone, fit, name=f"{prefix}-dead-zone"),
        partial(cogging, fit, name=f"{prefix}-cogging"),
        *(partial(likelihood, fit, each, name=f"{prefix}-profile-{slug(each.name)}") for each in profiles),
    )
    units = units_taken(fit)
    return Parts(plant_equations(fit), physical_table(fit), drawings, (units,) if units else ())


def _of_blocks(fit: Fit[Any], record: Record, prefix: str, profiles: Sequence[Profile]) -> Parts:
    from emsid.report.views.cascade import block_column, cascade_equations, frequency_responses, static_maps

    drawings = (
        partial(static_maps, fit, record, name=f"{prefix}-static-maps"),
        partial(frequency_responses, fit, record.dt, name=f"{prefix}-filters"),
    )
    return Parts((cascade_equations(fit.model),), (parameter_table(fit, columns=block_column(fit)),), drawings)


def _of_feedback(fit: Fit[Any], record: Record, prefix: str, profiles: Sequence[Profile]) -> Parts:
    from emsid.models.feedback.curves import rounded_equation
    from emsid.report.views.cascade import maps_in_feedback, poles_by_level

    drawings = (partial(maps_in_feedback, fit, record, prefix), partial(poles_by_level, fit, record, prefix))
    return Parts((rounded_equation(fit, record),), (parameter_table(fit),), drawings)


SECTIONS: dict[str, Callable[..., Parts]] = {
    "equation": _of_equation,
    "plant": _of_plant,
    "blocks": _of_blocks,
    "feedback": _of_feedback,
}
"""The sections that kinds of models name, see `emsid.models.capabilities`: of a fit, the record in which its signals
are shown, the beginning of the names of its figures, and the likelihood profiles of its parameters."""


def banded(fit: Fit[Any], record: Record) -> tuple[Figure, ...]:
    """The static map and the friction of a regression or a linear model, as far as it has them, with bands.

    Args:
        fit: of a model with a covariance.
        record: with its sample time and ranges.
    """
    prefix = slug(fit.model.name)
    views: list[Drawing] = []
    if not hasattr(fit.model, "blocks") and not hasattr(fit.model, "plant"):  # they have views of their own
        views.append(partial(static_map, fit, record, name=f"{prefix}-static-map"))
    if hasattr(fit.model, "structure"):
        views.append(partial(regression_friction, fit, record, name=f"{prefix}-friction"))
    return _drawable(fit.model.name, views)


def _drawable(model: str, drawings: Sequence[Callable[[], Figure | None]]) -> tuple[Figure, ...]:
    """The figures that can be drawn."""
    figures = []
    for drawing in drawings:
        with border(f"a figure of {model}", model, expected=True):
            figures.append(drawing())
    return tuple(figure for figure in figures if figure is not None)
