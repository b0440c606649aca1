"""`refitted`: the structure of a fit, estimated from other data.

The search begins at the estimate and takes a few steps only, without intervals. Repeated with one part of the data left
out after another, it gives the error of a structure on data that it was not fitted to, at a small part of the cost of
full fits. `better_refit` estimates the parameters from all data, including those held back from the fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Ending, Fit, fit_or_problem
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.without_samples import Mask
from emsid.models.blocks import fitting as cascades
from emsid.models.blocks.cascade import Cascade
from emsid.models.extrapolation import Extremes, diverges, diverges_held
from emsid.models.feedback import fitting as feedback
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search import trials
from emsid.models.free_run import free_run_error
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.prediction_error import PolynomialStructure, fit_polynomials
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.linear.subspace_fit import StateSpaceStructure, fit_state_space
from emsid.models.model import Model
from emsid.models.one_channel import segments_longer_than
from emsid.models.plants.free_run_error import FreeRunError, elsewhere, threads_for
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.narx import Narx, Structure
from emsid.record import Record

STEPS = 8
"""Steps from the estimate of the whole data to that of a part of them."""
SAVING = 1e-3
"""The search ends once a few steps lower the cost by less than this share."""

Linear = Callable[[Structure, Sequence[Record]], Fit[Narx]]
"""How a regression is fitted one step ahead."""


@dataclass(frozen=True, eq=False)
class Data:
    """What a model is fitted to again, and how.

    Attributes:
        records: the data.
        linear: fits a regression one step ahead.
        control: when to stop.
        left_out: (N,) of every record, the samples that are not fitted; None fits all.
    """

    records: Sequence[Record]
    linear: Linear
    control: Control
    left_out: Sequence[Mask] | None

    @property
    def by_segment(self) -> list[Mask] | None:
        """(N,) of every segment, the samples that are not fitted."""
        if self.left_out is None:
            return None
        every = zip(self.left_out, self.records, strict=True)
        return [part for out, record in every for part in np.split(out, record.breaks)]

    @property
    def in_pieces(self) -> list[Record]:
        """The data that are fitted, with a gap where samples are left out."""
        if self.left_out is None:
            return list(self.records)
        return [record.mask(out) for record, out in zip(self.records, self.left_out, strict=True)]


def refitted(
    fit: Fit[Any],
    records: Record | Sequence[Record],
    *,
    linear: Linear = least_squares,
    control: Control = FREE,
    left_out: Sequence[Mask] | None = None,
) -> Model:
    """The model of a fit with its parameters estimated from other data.

    Args:
        fit: its structure and the parameters that it estimated are kept, and its estimate begins the search.
        records: the other data, of the same channels and sample time.
        linear: fits a regression that was fitted one step ahead.
        control: when to stop.
        left_out: (N,) of every record, samples that are not fitted; a free run goes on through them.

    Raises:
        ModelError: for a kind of model that cannot be fitted again, or data that do not suit it.
        Stopped: if ``control`` stops it.
    """
    several = (records,) if isinstance(records, Record) else tuple(records)
    data = Data(several, linear, control, left_out)
    control.check()
    for kind in type(fit.model).__mro__:
        if kind in REFITTED:
            found: Model = fit_or_problem(partial(REFITTED[kind], fit, data))
            if control.ending is Ending.INTERRUPTED:
                raise Stopped(Ending.INTERRUPTED)
            return found
    raise ModelError(f"a model of type {type(fit.model).__name__} cannot be fitted again; add its type to REFITTED")


def better_refit(
    fit: Fit[Any], whole: Record, *, linear: Linear = least_squares, control: Control = FREE
) -> Model | None:
    """The model of a fit with its parameters from all data; None where it cannot be used or simulates them no better.

    Args:
        fit: to a part of the data.
        whole: all data.
        linear: as in `refitted`.
        control: likewise.

    Raises:
        Stopped: if ``control`` stops it.
    """
    try:
        again = refitted(fit, whole, linear=linear, control=control)
        better = free_run_error(again, (whole,)) < free_run_error(fit.model, (whole,))
    except EmsidError:  # the data do not suit it
        return None
    return again if better and is_safe(again, whole, fit.model) else None


def is_safe(model: Model, record: Record, known: Model | None = None) -> bool:
    """Whether a model, stable on a record, does not run away on inputs that the record lacks; a plant never does.

    Args:
        model: the model.
        record: what it is stable on.
        known: a model that it takes the place of; where that diverges while an extreme input is held, it may too.
    """
    if isinstance(model, GreyBox):
        return True
    extremes = Extremes(record)
    if diverges(model, extremes.larger):
        return False
    return not diverges_held(model, extremes) or (known is not None and diverges_held(known, extremes))


def _regression(fit: Fit[Narx], data: Data) -> Model:
    structure = fit.model.structure
    if fit.method != "gn":
        return data.linear(structure, data.in_pieces).model
    return fit_free_run(
        structure,
        data.records,
        start=fit.model.parameters,
        max_iterations=STEPS,
        least_saving=SAVING,
        control=data.control,
        covariances=False,
        left_out=data.by_segment,
    ).model


def _cascade(fit: Fit[Cascade], data: Data) -> Model:
    minimum, problem = cascades.search(
        fit.model,
        data.records,
        fixed=cascades.fixed_in(fit),
        max_iterations=STEPS,
        least_saving=SAVING,
        control=data.control.quietly(),
        left_out=data.by_segment,
    )
    return problem.model(minimum.estimate)


def _feedback(fit: Fit[FeedbackModel], data: Data) -> Model:
    """Among the models that do not run away, as in the search for the structure."""
    segments, control = segments_longer_than(fit.model.memory, fit.model, data.records), data.control.quietly()
    refused, out = trials.runs_away, data.by_segment
    found = feedback.searched(
        fit.model, segments, fit.model.edge, STEPS, 0.1, control, SAVING, refused=refused, left_out=out
    )
    return found.model


def _polynomials(fit: Fit[PolynomialModel], data: Data) -> Model:
    return fit_polynomials(
        PolynomialStructure.of(fit),
        data.records,
        start=fit.estimate,
        max_iterations=STEPS,
        control=data.control,
        left_out=data.by_segment,
    ).model


def _state_space(fit: Fit[StateSpaceModel], data: Data) -> Model:
    """By a subspace method again: its start needs no search."""
    return fit_state_space(
        StateSpaceStructure.of(fit.model),
        data.records,
        free_run=not fit.model.k.any(),
        max_iterations=STEPS,
        control=data.control,
        left_out=data.by_segment,
    ).model


def _plant(fit: Fit[GreyBox], data: Data) -> Model:
    if not isinstance(fit, GreyBoxFit):
        raise ModelError(f"{fit.model.name}: it has not been fitted, so there is nothing to fit again")
    plant, signals = fit.model.plant, fit.model.signals
    segments = [segment for record in data.records for segment in record.segments if len(segment) > fit.model.memory]
    states = [plant.first_state(signals, segment) for segment in segments]
    unknown = [plant.free_states(signals, segment) for segment in segments]
    threads, weighting = threads_for(segments), elsewhere(fit.weighting, plant, segments, signals)
    out = data.by_segment
    counted = None if out is None else [(~each).astype(float) for each in out]
    problem = FreeRunError(plant, signals, segments, fit.names, states, unknown, weighting, threads, counted)
    lower, upper = problem.within(fit.limits)
    found = gauss_newton(
        problem,
        np.clip(problem.start, lower, upper),
        lower=lower,
        upper=upper,
        max_iterations=STEPS,
        least_saving=SAVING,
        names=problem.names,
        covariances=False,
        control=data.control.quietly(),
    )
    return replace(fit.model, plant=problem.plant_at(found.estimate))


REFITTED: dict[type, Callable[[Any, Data], Model]] = {
    Narx: _regression,
    Cascade: _cascade,
    FeedbackModel: _feedback,
    PolynomialModel: _polynomials,
    StateSpaceModel: _state_space,
    GreyBox: _plant,
}
"""How each kind of model is fitted again; the search does not report, as its steps are a part of another activity."""


def specification(fit: Fit[Any]) -> tuple[Any, dict[str, Any]]:
    """What `emsid.fit` takes to estimate the same parameters from other data, with intervals: subject and options.

    Raises:
        ModelError: for a kind of model that cannot be fitted again.
    """
    for kind in type(fit.model).__mro__:
        if kind in SPECIFIED:
            return SPECIFIED[kind](fit)
    raise ModelError(f"a model of type {type(fit.model).__name__} cannot be fitted again; add its type to SPECIFIED")


def _specified_plant(fit: Fit[GreyBox]) -> tuple[Any, dict[str, Any]]:
    plant = fit.model.plant
    return plant, {"free": fit.names, "signals": fit.model.signals, "hold": plant.hold, "find_start": False}


SPECIFIED: dict[type, Callable[[Any], tuple[Any, dict[str, Any]]]] = {
    Narx: lambda fit: (fit.model.structure, {"free_run": True} if fit.method == "gn" else {}),
    Cascade: lambda fit: (fit.model, {}),
    FeedbackModel: lambda fit: (fit.model, {}),
    PolynomialModel: lambda fit: (PolynomialStructure.of(fit), {}),
    StateSpaceModel: lambda fit: (StateSpaceStructure.of(fit.model), {"free_run": not fit.model.k.any()}),
    GreyBox: _specified_plant,
}
"""How each kind of model is described to `emsid.fit`."""
