"""The section of a report about one model of any kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from emsid.errors import EmsidError
from emsid.report.document import Figure, Section
from emsid.report.numbers import sentence, slug
from emsid.report.views.tables import parameter_table, regressor_column
from emsid.wording import Spelling, as_python
from emsid.wording import sentence as worded

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.plants.search.diagnostics import Profile
    from emsid.record import Record


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
    from emsid.models.blocks.cascade import Cascade
    from emsid.models.feedback.model import FeedbackModel
    from emsid.models.plants.search.result import GreyBoxFit
    from emsid.report.views.cascade import block_column, cascade_equations, frequency_responses, static_maps
    from emsid.report.views.feedback import maps_in_feedback, poles_by_level
    from emsid.report.views.grey_box import dead_zone, friction, likelihood, sticking
    from emsid.report.views.physical_parameters import physical_table, plant_equations, units_taken
    from emsid.validation.feedback_curves import rounded_equation

    model, prefix = fit.model, slug(name or fit.model.name)
    paragraphs: tuple[str, ...] = ()
    remarks = tuple(sentence(worded(finding, argument)) for finding in fit.findings)
    if isinstance(fit, GreyBoxFit):
        equations, tables = plant_equations(fit), physical_table(fit)
        paragraphs = tuple(filter(None, (units_taken(fit),)))
        drawings: list[Callable[[], Figure | None]] = [
            lambda: sticking(fit, name=f"{prefix}-sticking"),
            lambda: friction(fit, name=f"{prefix}-friction"),
            lambda: dead_zone(fit, name=f"{prefix}-dead-zone"),
            *(partial(likelihood, fit, each, name=f"{prefix}-profile-{slug(each.name)}") for each in profiles),
        ]
    elif isinstance(model, Cascade):
        equations = (cascade_equations(model),)
        tables = (parameter_table(fit, columns=block_column(fit)),)
        drawings = [
            lambda: static_maps(fit, record, name=f"{prefix}-static-maps"),
            lambda: frequency_responses(fit, record.dt, name=f"{prefix}-filters"),
        ]
    elif isinstance(model, FeedbackModel):
        equations, tables = (rounded_equation(fit, record),), (parameter_table(fit),)
        drawings = [
            lambda: maps_in_feedback(fit, record, prefix),
            lambda: poles_by_level(fit, record, prefix),
        ]
    else:
        equations, drawings = (model.equation(),), []
        tables = (parameter_table(fit, columns=regressor_column(fit)),)
    drawings = [*drawings, *(partial(view, fit, record, prefix) for view in VIEWS)]
    return Section(name or model.name, paragraphs, equations, tables, _drawable(drawings if drawn else ()), remarks)


def _drawable(drawings: Sequence[Callable[[], Figure | None]]) -> tuple[Figure, ...]:
    """The figures that can be drawn."""
    figures = []
    for drawing in drawings:
        with suppress(EmsidError):
            figures.append(drawing())
    return tuple(figure for figure in figures if figure is not None)
