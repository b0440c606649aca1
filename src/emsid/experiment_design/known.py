"""What is known of the parameters of a plant before an experiment, and what they may be.

Open parameters are those that the records of a fit do not determine and that a test does; of a plant without a fit all
that it usually estimates. Their values are those of a datasheet. A friction or damping that nobody gave may be anything
from zero to its plausible size, a tenth of what the largest command overcomes (`Plant.plausible`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError, listed
from emsid.estimation.estimates import HALF_WIDTH, Estimate
from emsid.estimation.fit import Fit
from emsid.experiment_design.limits import Limits, motion
from emsid.models.plants.datasheet import as_datasheet
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import CURRENTS, DISSIPATED, Signal
from emsid.models.plants.plant import Plant, Sizes
from emsid.models.plants.registry import PLANTS
from emsid.models.verbs import as_model

Array = NDArray[np.float64]

TOLERANCE = 0.3
"""Of a value of a datasheet without one: catalogues of small motors state 10 to 20 % for flux and inertia."""
CORNERS = 4
"""Limits are checked at the ends of the widest ranges of this many parameters together: 16 runs."""
STEP = 1000
"""Samples of the step that shows which torque and speed the limits allow."""
WIDE = 0.05
"""An interval that is narrower than this part of its value moves no limit by more than the margin that is advised."""


@dataclass(frozen=True, eq=False)
class Known:
    """What is known before an experiment.

    Attributes:
        model: with the values.
        names: the parameters that the experiment may determine.
        values: of these.
        errors: (p,) standard errors of these.
        open: those that nothing has determined yet.
        present: half widths of their present intervals; infinite where open.
        rows: of the table of the fit, by name.
        ranges: what open parameters may be.
        possible: models at the ends of all ranges.
    """

    model: Any
    names: tuple[str, ...]
    values: tuple[float, ...]
    errors: Array
    open: tuple[str, ...]
    present: dict[str, float]
    rows: Mapping[str, Estimate]
    ranges: Mapping[str, tuple[float, float]]
    possible: tuple[Any, ...]

    def unit(self, name: str) -> str:
        """The unit of a parameter."""
        if name in self.rows:
            return self.rows[name].unit
        return str(self.model.plant.handles[name].parameter.unit)


def known_before(fit: Any, datasheet: Mapping[str, Any] | None, limits: Limits, dt: float) -> Known:
    """What a fit, or a plant with a datasheet, says.

    Args:
        fit: see `emsid.design`.
        datasheet: values of open parameters.
        limits: of the experiment.
        dt: sample time in s.

    Raises:
        ModelError: for open parameters without values.
    """
    model: Any = as_model(fit)
    plant = getattr(model, "plant", None)
    estimated = tuple(fit.names) if isinstance(fit, Fit) else ()
    sheet = as_datasheet(plant, datasheet) if plant is not None else {}
    rows = fit.parameters if isinstance(fit, Fit) else {}
    errors = dict(zip(estimated, fit.standard_error.tolist(), strict=True)) if estimated else {}
    if plant is None:
        values = tuple(fit.estimate.tolist())
        half = {name: HALF_WIDTH * error for name, error in errors.items()}
        return Known(model, estimated, values, np.array([*errors.values()]), (), half, rows, {}, (model,))
    plant = plant.for_test()
    open_ = _open(fit, plant, model.signals)
    open_ = tuple(name for name in open_ if name in sheet or plant.value(name) or _dissipates(plant, name))
    fitted = {*estimated} - {*open_}
    given = {name: each.value for name, each in sheet.items() if each.value is not None and name not in fitted}
    given = {name: sure for name in open_ if name in rows and (sure := rows[name].datasheet)} | given
    without = [name for name in open_ if name not in given and not _dissipates(plant, name)]
    if without:
        raise ModelError(
            f"{listed(without)} of {plant.name} {'is' if len(without) == 1 else 'are'} not known; give values of a "
            "datasheet, with tolerances",
            arguments=("datasheet",),
        )
    plant = plant.with_values(given)
    model = replace(model, plant=plant.with_values({name: 0.0 for name in open_ if name not in given}))
    sizes = _sizes(model, limits, dt)
    ranges: dict[str, tuple[float, float]] = {}
    for name in open_:
        handle = plant.handles[name]
        if name in given:
            value, tolerance = plant.value(name), sheet[name].tolerance if name in sheet else None
            half = (TOLERANCE if tolerance is None else tolerance) * abs(value)
            ranges[name] = max(value - half, handle.lower), min(value + half, handle.upper)
        else:
            ranges[name] = 0.0, plant.plausible(handle.measure, sizes)
        errors[name] = 0.5 * (ranges[name][1] - ranges[name][0])
    middle = {name: 0.5 * sum(ranges[name]) for name in open_ if name not in given}
    model = replace(model, plant=plant.with_values(middle))
    names = (*(name for name in estimated if name not in open_), *open_)
    present = {name: inf if name in open_ else HALF_WIDTH * errors[name] for name in names}
    spans = dict(ranges)
    for name in names:
        value, half = model.plant.value(name), HALF_WIDTH * errors[name]
        if name not in open_ and isfinite(half) and half > WIDE * abs(value):
            handle = plant.handles[name]
            spans[name] = max(value - half, handle.lower), min(value + half, handle.upper)
    return Known(
        model,
        names,
        tuple(model.plant.value(name) for name in names),
        np.array([errors[name] for name in names]),
        open_,
        present,
        rows,
        ranges,
        _corners(model, spans),
    )


def named(name: str, datasheet: Mapping[str, Any]) -> GreyBox:
    """A plant by its name, all currents and the speed of which are measured.

    Args:
        name: of the registry.
        datasheet: must have what is counted.

    Raises:
        ModelError: where it does not.
    """
    plant = PLANTS[name].plain
    without = [each for each in plant.counted if each not in as_datasheet(plant, datasheet)]
    if without:
        raise ModelError(f"{listed(without)} of {name} is not in the datasheet", arguments=("datasheet",))
    channels = plant.channels
    units = {} if channels is None else channels.units
    signals = tuple(signal for signal in units if signal in (*CURRENTS, Signal.SPEED))
    return GreyBox(plant, signals if plant.tests or channels is None else (channels.default_signal,))


def _open(fit: Any, plant: Plant, signals: Any) -> tuple[str, ...]:
    """The parameters that nothing has determined and a test would, and the frictions that depend on their values."""
    if not isinstance(fit, Fit):
        idle = plant.without_effect(signals)
        return tuple(name for name in plant.default_free if name not in idle)
    shown = {name for each in fit.findings for names in each.data.get("tests", {}).values() for name in names}
    rests = {row.name for row in fit.table if shown & {*row.given} and _dissipates(plant, row.name)}
    return tuple(name for name in fit.parameters if name in shown | rests)


def _dissipates(plant: Plant, name: str) -> bool:
    """Whether a parameter brakes and may be zero."""
    return plant.handles[name].measure in DISSIPATED and plant.handles[name].lower == 0.0


def _sizes(model: Any, limits: Limits, dt: float) -> Sizes:
    """Command and speed of a step that the limits allow, on the last input."""
    step = np.zeros((STEP, len(model.plant.test_names)))
    step[:, -1] = limits.command
    allowed = limits.scaled([model], step, dt)
    if allowed is None:
        return Sizes(limits.command, 1.0, dt)
    return Sizes(float(np.max(np.abs(allowed))), float(np.max(np.abs(motion(model, allowed, dt)[0]))) or 1.0, dt)


def _corners(model: Any, spans: Mapping[str, tuple[float, float]]) -> tuple[Any, ...]:
    """The model, and those at both ends of the widest ranges."""
    size = {name: (high - low) / max(abs(high), abs(low), 1e-300) for name, (low, high) in spans.items()}
    widest = sorted((name for name in spans if size[name] > 0), key=lambda name: -size[name])[:CORNERS]
    ends = product(*(spans[name] for name in widest))
    return (model, *(model.with_estimates(widest, np.array(values)) for values in ends if widest))
