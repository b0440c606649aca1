"""What plants with physical parameters can do; see `emsid.models.capabilities`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.estimates import Estimate
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.findings import Finding
from emsid.models.bands import Band, BandedCurve, Quantity
from emsid.models.c_form import CForm
from emsid.models.capabilities import Capabilities
from emsid.models.characteristics import Characteristic, check_channel
from emsid.models.linear.system import LinearSystem
from emsid.models.plants.c_form import c_form
from emsid.models.plants.datasheet import applicable
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError, elsewhere, threads_for
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.initial_state import free_states
from emsid.models.plants.search.characteristics import of_plant
from emsid.models.plants.search.diagnostics import Curve, dead_zone_curve, friction_curve
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.plants.search.trusted_length import trusted_length_over
from emsid.models.plants.stepping import PlantStepper
from emsid.models.refit_data import Budget, Data
from emsid.models.stepping import Stepper
from emsid.plant import Motor
from emsid.record import Record, continuing

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LEVEL = 0.95
"""Of the bands of its curves."""


class OfPlants(Capabilities[GreyBox]):
    """Plants: motors, axes, joints, and those of users."""

    kind = "grey-box"
    model = GreyBox
    estimators: ClassVar = {Motor: simulation_error}
    fitted_by = "its plant: model.plant"
    may_run_away = False
    says_what_it_lacks = True
    physical = True
    takes_all_inputs = False

    def stepper(self, model: GreyBox, state: Any, inputs: int) -> Stepper:
        return PlantStepper.of(model, state, inputs)

    def inputs(self, model: GreyBox) -> int:
        channels, driven = model.plant.channels, model.plant.driven
        return (1 if channels is None else channels.inputs) + (driven is not None and driven.drive.loaded)

    def c_form(self, stepper: Any, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
        return c_form(stepper, single=single, parameters=parameters)

    def linear_part(self, model: GreyBox, at: float) -> LinearSystem:
        """In motion, without friction that is constant and states that no output depends on."""
        part = model.plant.linearised(model.signals)
        if part is None:
            raise ModelError(f"{model.name} has no linear part that is known; linearise its functions yourself")
        late = model.plant.drive.delay if isinstance(model.plant, DrivenPlant) else 0.0
        return LinearSystem(*part.observed()[:4], None, late, model.name)

    def frequency_response(
        self, model: GreyBox, f: Array, dt: float, output: int, input: int, around: float
    ) -> Complex:
        """That of the first output, in motion; without the delay of the drive."""
        check_channel(model, "output", output, 1)
        check_channel(model, "input", input, 1)
        if model.plant.linearised(model.signals) is None:
            return super().frequency_response(model, f, dt, output, input, around)
        return replace(self.linear_part(model, around), delay=0.0).response(f)[:, 0, 0]

    def static_map(self, fit: Fit[GreyBox], record: Record, map: int = 0, level: float = 0.95) -> Band:
        raise ModelError(f"{fit.model.name} is a plant; it has curves of its drive and of its friction")

    def curves(self, fit: Fit[GreyBox], record: Record) -> Iterator[Callable[[], list[BandedCurve]]]:
        if isinstance(fit, GreyBoxFit):
            yield partial(_friction_and_zone, fit, record)

    def physical_rows(self, fit: Fit[GreyBox]) -> list[Estimate]:
        """The rows without a record of the table."""
        return [row for row in fit.table if not row.record]

    def characteristics(self, fit: Fit[GreyBox], record: Record) -> tuple[Characteristic, ...]:
        return of_plant(fit) if isinstance(fit, GreyBoxFit) else ()

    def as_left(self, model: GreyBox, record: Record) -> GreyBox:
        """With the resistance of a winding at the end of the last segment, which is that at the start of a next run."""
        last = continuing(record.before[-1] if record.before else None, record.segments[-1])
        if not model.plant.changes_resistance or len(last) <= model.memory:
            return model
        begun = model.initial(last, model.memory)
        return replace(model, plant=model.plant.as_left(model.run(begun, last.input[model.memory :])[1]))

    def trusted_length(self, model: GreyBox, record: Record) -> list[Finding]:
        return trusted_length_over(model, record)

    def section(self, fit: Fit[GreyBox]) -> str:
        return "plant" if isinstance(fit, GreyBoxFit) else super().section(fit)

    def refitted(self, fit: Fit[GreyBox], data: Data, budget: Budget) -> Fit[GreyBox]:
        if not isinstance(fit, GreyBoxFit):
            raise ModelError(f"{fit.model.name}: it has not been fitted, so there is nothing to fit again")
        if budget is Budget.LAST:
            return _finished(fit, data, budget)
        plant, signals = fit.model.plant, fit.model.signals
        segments = [each for record in data.records for each in record.segments if len(each) > fit.model.memory]
        states = [plant.first_state(signals, segment) for segment in segments]
        unknown = free_states(plant, signals, segments)
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
            max_iterations=budget.steps,
            least_saving=budget.saving,
            names=problem.names,
            covariances=False,
            control=data.control.quietly(),
        )
        return fit.at(replace(fit.model, plant=problem.plant_at(found.estimate)))

    def specification(self, fit: Fit[GreyBox]) -> tuple[Any, dict[str, Any]]:
        plant = fit.model.plant
        return plant, {"free": fit.names, "signals": fit.model.signals, "hold": plant.hold, "find_start": False}


def _finished(fit: GreyBoxFit, data: Data, budget: Budget) -> GreyBoxFit:
    """The same plant fitted to all data, with its table, from the estimates of a part.

    Raises:
        ModelError: where records have parameters of their own.
    """
    if fit.by_record:
        raise ModelError(f"{fit.model.name}: a fit with parameters by record cannot be continued")
    plant, signals = fit.model.plant, fit.model.signals
    segments = [each for record in data.records for each in record.segments]
    return simulation_error(
        plant,
        data.records,
        free=[row.name for row in fit.table if row.asked],
        fixed=data.given.get("fixed"),
        datasheet=applicable(data.given.get("datasheet") or {}, plant),
        signals=signals,
        weighting=elsewhere(fit.weighting, plant, segments, signals),
        hold=plant.hold,
        find_start=False,
        max_iterations=budget.steps,
        control=data.control,
    )


def _friction_and_zone(fit: GreyBoxFit, record: Record) -> list[BandedCurve]:
    plant, found = fit.model.plant, []
    friction, zone = plant.friction_characteristic(), plant.dead_zone_characteristic()
    through = dead_zone_curve(fit)
    if friction is not None:
        found.append(_of_curve(fit, record, "friction", friction_curve(fit), friction.x, friction.y))
    if zone is not None and through is not None:
        found.append(_of_curve(fit, record, "dead zone", through, zone.x, zone.y))
    return found


def _of_curve(fit: GreyBoxFit, record: Record, kind: str, curve: Curve, x: Quantity, y: Quantity) -> BandedCurve:
    """A curve where the record supports it."""
    visited = np.flatnonzero(curve.support)
    inside = np.zeros(len(curve.x), dtype=bool)
    if len(visited):
        inside[visited[0] : visited[-1] + 1] = True
    values, low, high = (np.where(inside, each, np.nan) for each in (curve.y, curve.low, curve.high))
    channels = record.input_names[0], record.output_names[0]
    return BandedCurve(fit.model.name, kind, *x, *y, *channels, curve.x, values, low, high, LEVEL)
