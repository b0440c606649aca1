"""A fitted grey box: its table of parameters, the combinations that its records identify, and its findings."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from math import isfinite
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.estimates import HALF_WIDTH, assumed_in
from emsid.estimation.estimates import Estimate as Estimate
from emsid.estimation.estimates import Status as Status
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.uncertainty.identifiability import Identifiability
from emsid.findings import Finding, plain
from emsid.models.plants.drive import Hold
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import Weighting, all_alike
from emsid.models.plants.gravity import STRENGTH
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.initial_state import InitialState
from emsid.models.plants.parameters import CURRENTS, Signal
from emsid.models.plants.plant import Plant, Quantity
from emsid.models.plants.search.between_samples import holds_in
from emsid.models.plants.search.conditions import TOLERABLE, Conditions, is_built_in, unasked
from emsid.models.plants.search.missing_tests import shown_by_tests
from emsid.models.plants.search.task import Task
from emsid.models.visited import RestsOn, Visited
from emsid.plant import GaussianStribeck
from emsid.record import Record

Array = NDArray[np.float64]
ZONE_ENDS = ("dead_zone.half_width", "dead_zone.b_l", "dead_zone.b_r")
"""Ends of the names of parameters that are the ends of a dead zone."""


@dataclass(frozen=True)
class Combination:
    """A combination of parameters that the data identify independently of the kept values.

    Attributes:
        quantity: its name, formula, unit and value.
        standard_error: of it.
        parameters: of those asked for, the ones in it.
        given: the fixed and kept values that it still depends on, by name.
    """

    quantity: Quantity
    standard_error: float
    parameters: tuple[str, ...]
    given: tuple[str, ...] = ()

    @property
    def how(self) -> str:
        """The source of the value, in a few words for a table."""
        return f"combination, given {', '.join(self.given)}" if self.given else "identifiable combination"

    @property
    def interval(self) -> tuple[float, float]:
        """Its 95 % interval."""
        half = HALF_WIDTH * self.standard_error
        return float(self.quantity.value - half), float(self.quantity.value + half)


@dataclass(frozen=True, eq=False, repr=False)
class GreyBoxFit(Fit[GreyBox]):
    """A `Fit` with physical parameters; its table has a row for every one that was asked for or fixed.

    Attributes:
        combinations: all identifiable quantities of the plant, if some parameters had to be kept.
        identifiability: of the parameters that were asked for, at the estimate.
        segments: the records it was fitted to, without gaps.
        states: their initial states.
        begins: how these were found.
        weighting: of errors by their age, or by the drift of the load.
        limits: bounds of the free parameters, including those of the datasheet and physical ones.
        cost: V at the minimum, half the weighted sum of squares.
        colour: (p,) how many times larger the variance of every parameter is than with a white residual.
        of_held: (p,) the part of the variance of every parameter that tolerances and weak priors of others add.
    """

    combinations: tuple[Combination, ...] = ()
    identifiability: Identifiability | None = None
    segments: tuple[Record, ...] = ()
    states: tuple[Array, ...] = ()
    begins: InitialState = InitialState.FREE
    weighting: Weighting = all_alike
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    cost: float = float("nan")
    colour: Array = field(default_factory=lambda: np.ones(0))
    of_held: Array = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def _visited(self) -> Visited:
        """The commands and the speeds of the plant in the records that it was fitted to."""
        plant, segments = self.model.plant, self.segments
        commands: list[Array] = [np.empty(0)]
        speeds: list[Array] = [np.empty(0)]
        for segment, state in zip(segments, self.states, strict=True):
            own = plant.for_segment(segment)
            if isinstance(own, DrivenPlant):
                commands.append(own.drive.applied(segment.input)[0])
            motion = own.motion(segment.input, segment.dt, state)
            speeds.append(np.empty(0) if motion is None else motion)
        return Visited(np.concatenate(commands), np.concatenate(speeds))

    def shows(self, quantity: Quantity) -> bool:
        """Whether the records visit what a quantity rests on; else its value is an extrapolation."""
        return quantity.rests_on == RestsOn() or self._visited.shows(quantity.rests_on, quantity.value)

    def to_data(self) -> dict[str, Any]:
        """Every parameter with unit, interval and source of its value, the combinations, and every finding."""
        parameters = [asdict(row) | {"status": row.status.value} for row in self.table]
        combinations = [
            {
                "name": each.quantity.name,
                "formula": each.quantity.formula,
                "unit": each.quantity.unit,
                "value": float(each.quantity.value) if shown else None,
                "standard_error": float(each.standard_error) if shown else None,
                "parameters": list(each.parameters),
                "given": list(each.given),
                "interval": each.interval if shown else (None, None),
                "shown": shown,
            }
            for each in self.combinations
            for shown in [self.shows(each.quantity)]
        ]
        data: dict[str, Any] = super().to_data() | plain({"parameters": parameters, "combinations": combinations})
        return data

    @property
    def assumed(self) -> tuple[Estimate, ...]:
        """See `Fit.assumed`; here combinations may depend on them, too."""
        return assumed_in(self.table, [name for each in self.combinations for name in each.given])

    @property
    def known_combinations(self) -> tuple[Combination, ...]:
        """The combinations that depend on no value which nobody gave."""
        by_nobody = {row.name for row in self.assumed}
        return tuple(each for each in self.combinations if by_nobody.isdisjoint(each.given))

    @property
    def shared(self) -> tuple[Estimate, ...]:
        """The rows of the table that hold in every record."""
        return tuple(row for row in self.table if not row.record)

    @property
    def by_record(self) -> dict[str, dict[str, Estimate]]:
        """For every record the rows of its own parameters, by their common names; empty if there are none."""
        found: dict[str, dict[str, Estimate]] = {}
        for row in self.table:
            if row.record:
                found.setdefault(row.record, {})[row.name.removesuffix(f"[{row.record}]")] = row
        return found

    def interval(self, level: float = 0.95) -> Array:
        """(p, 2) confidence interval of every parameter; at a bound, the 95 % interval of the likelihood profile."""
        ends = super().interval(level)
        profiles = {row.name: row.interval for row in self.table if row.status is Status.AT_BOUND and row.interval}
        for k, name in enumerate(self.names):
            if level == 0.95 and name in profiles:
                ends[k] = profiles[name]
        return ends

    def simulated(self) -> tuple[Array, ...]:
        """The free run (Nᵢ, ny) of every segment from its estimated initial state."""
        model = self.model
        return tuple(
            model.plant.for_segment(segment).simulate(segment.input, segment.dt, state, model.signals)
            for segment, state in zip(self.segments, self.states, strict=True)
        )


def findings_of(
    task: Task,
    plant: Plant,
    names: Sequence[str],
    minimum: Minimum,
    identifiability: Identifiability,
    rows: Sequence[Estimate],
    together: Sequence[Combination],
) -> tuple[Finding, ...]:
    """The findings of a fit: how it ended, which parameters a bound holds, and which are not identifiable."""
    groups = identifiability.groups
    unseen = plant.of_record(0).unseen(rows, groups, _range(task))
    bounds = {finding.subject: finding for finding in _at_bounds(task, plant, names, minimum, groups)}
    ended = [bounds.pop(f.subject, f) if f.code == "parameter-at-bound" else f for f in minimum.findings]
    including_zero = [
        row.name
        for row in rows
        if row.estimated
        if row.standard_error is not None and isfinite(row.standard_error)
        if plant.handles[row.name].lower >= 0 and abs(row.value) < HALF_WIDTH * row.standard_error
        if row.name not in {each.subject for each in unseen}
    ]
    built_in = [
        {"name": row.name, "value": row.value, "unit": row.unit} for row in rows if row.status is Status.BUILT_IN
    ]
    kept = [Finding("built-in-values-kept", plant.name, {"parameters": built_in})] if built_in else []
    left = [name for name in task.asked if name not in names]
    open_ = list(dict.fromkeys([*(name for group in groups for name in group), *left, *including_zero]))
    tests = shown_by_tests(task, plant, names, identifiability, open_)
    zero = []
    if including_zero:
        shown = _of_group(tests, including_zero)
        data = {"parameters": including_zero, "without": [], **({"tests": shown} if shown else {})}
        zero = [Finding("intervals-include-zero", plant.name, data)]
    return (
        *ended,
        *kept,
        *_as_simulated(task, plant),
        *_not_identifiable(task, plant, names, identifiability, together, tests),
        *unseen,
        *plant.of_record(0).remarks(task.segments, task.signals),
        *zero,
    )


def _range(task: Task) -> float:
    """The range of the position in the records, in the unit of the output; of a speed that of its integral."""
    if Signal.POSITION in task.signals:
        k = task.signals.index(Signal.POSITION)
        return float(np.ptp(np.concatenate([each.output[:, k] for each in task.segments])))
    return max(float(np.ptp(np.cumsum(each.output[:, 0]))) * each.dt for each in task.segments)


def _as_simulated(task: Task, plant: Plant) -> list[Finding]:
    """The choices about the input between its samples, the sensor and the friction, which are no parameters."""
    found = []
    if plant.hold is not task.plant.hold and not task.hold_given:
        held = holds_in(plant, task.segments).count(Hold.ZERO)
        data = {"straight": len(task.segments) - held, "held": held}
        found.append(Finding("input-between-samples", task.segments[0].input_names[0], data))
    driven = plant.of_record(0)
    if not isinstance(driven, DrivenPlant):
        return found
    if plant.value("sensor.average") == 1 and "sensor.average" not in task.fixed:
        found.append(Finding("speed-is-a-mean", task.segments[0].output_names[0]))
    if any(isinstance(law, GaussianStribeck) and law.varies.any() for law in driven.frictions.values()):
        found.append(Finding("friction-fades-as-gaussian", plant.name))
    return found


def _not_identifiable(
    task: Task,
    plant: Plant,
    names: Sequence[str],
    identifiability: Identifiability,
    together: Sequence[Combination],
    tests: Mapping[str, Sequence[str]],
) -> list[Finding]:
    """Every group of parameters that the records do not identify, and how it was treated."""
    source = "" if plant.channels is None else plant.channels.source
    channels = [source or "the input", *(signal.value for signal in task.signals)]
    if not names:
        return [Finding("nothing-identifiable", plant.name, {"channels": channels})]
    found = []
    groups = list(identifiability.groups)
    alone = [name for name in task.asked if name not in names and not any(name in group for group in groups)]
    groups += [tuple(alone)] if alone and plant.tests else []  # kept by the search, and of little effect at its end
    for group in groups:
        kept = [[n, plant.value(n), plant.handles[n].parameter.unit] for n in group if n not in names]
        formulas = [each.quantity.formula for each in together if len(set(each.parameters) & set(group)) > 1]
        data = {
            "parameters": list(group),
            "kept": kept,
            "combinations": list(dict.fromkeys(formulas))[:4],
            "channels": channels,
            "current_missing": source == "voltage" and not {*CURRENTS} & {*task.signals},
            "one_way": _is_one_way(task),
            "zone_unseen": _is_zone_unseen(group),
            "tests": _of_group(tests, group),
            "one_load": not STRENGTH.isdisjoint(group) and _has_one_load(task, plant),
        }
        found.append(Finding("not-identifiable" if kept else "weakly-identified", plant.name, data))
    return found


def _of_group(tests: Mapping[str, Sequence[str]], group: Sequence[str]) -> dict[str, list[str]]:
    """What tests show of a group of parameters, without those that show nothing of it."""
    return {code: some for code, shown in tests.items() if (some := [name for name in group if name in shown])}


def _is_zone_unseen(group: Sequence[str]) -> bool:
    """Whether inseparable parameters include a dead zone and a Coulomb level.

    While the command is beyond the zone, both have the same effect. They differ only for a motion while the command is
        inside the zone: Coulomb friction continues to brake it, a dead zone does not.
    """
    return any(name.endswith(ZONE_ENDS) for name in group) and any(".coulomb" in name for name in group)


def _has_one_load(task: Task, plant: Plant) -> bool:
    """Whether an arm lifted the same weight in all records, so that nothing shows the size of its torques."""
    driven = [plant.of_record(plant.record_of(segment)) for segment in task.segments]
    weights = {each.value("gravity.mass") for each in driven if isinstance(each, DrivenPlant) and each.turn}
    return len(weights) == 1


def _is_one_way(task: Task) -> bool:
    """Whether the inputs never change their sign."""
    inputs = [segment.input[:, 0] for segment in task.segments]
    return min(float(u.min()) for u in inputs) >= 0 or max(float(u.max()) for u in inputs) <= 0


def _at_bounds(
    task: Task, plant: Plant, names: Sequence[str], minimum: Minimum, groups: Sequence[Sequence[str]]
) -> list[Finding]:
    """Every parameter at a bound, with the source of the bound, and parameters not separated from it."""
    found = []
    for name, value, free in zip(names, minimum.estimate.tolist(), minimum.free, strict=False):
        low, high = task.limits[name]
        if free or low == high:
            continue
        given, handle = task.sheet.get(name), plant.handles[name]
        if given is not None and given.limits is not None and value in given.limits:
            because = "datasheet"
        elif value in task.resolution_limits.get(name, ()):
            because = "sample-time"
        else:
            because = "physical" if value in (handle.lower, handle.upper) else "bounds"
        data = {"side": "lower" if value <= low else "upper", "bound": value, "because": because}
        others = [other for group in groups if name in group for other in group if other != name]
        if others:
            data |= {"because": "inseparable", "others": others, "one_way": _is_one_way(task)}
            data |= {"zone_unseen": _is_zone_unseen((name, *others))}
        found.append(Finding("parameter-at-bound", name, data))
    return found


def table(
    task: Task,
    plant: Plant,
    start: Plant,
    names: Sequence[str],
    minimum: Minimum,
    conditions: Conditions,
    unknown: Collection[str] = (),
) -> tuple[Estimate, ...]:
    """A row for every parameter that was asked for or fixed, and for every other one with an effect.

    Args:
        task: what was asked.
        plant, start: at the end and at the start of the search.
        names: the parameters that were estimated.
        minimum: where the search ended.
        conditions: on which the estimates depend.
        unknown: those of them that the data do not determine, see `unlogged_input`.
    """
    rows, asked, fixed, sheet = [], task.asked, task.fixed, task.sheet
    errors = np.sqrt(np.diag(minimum.covariance)).tolist()
    rest = unasked(task, plant)
    for name in (*asked, *(n for n in fixed if n not in asked), *rest):
        value = plant.value(name)
        error: float | None = None
        given: tuple[str, ...] = ()
        interval: tuple[float, float] | None = None
        if name in fixed or (name in rest and name in task.known):
            status = Status.FIXED
        elif name in rest:
            status = Status.BUILT_IN if is_built_in(plant, name) else Status.OF_PLANT
        elif name not in names:
            status = Status.KEPT
        elif name in unknown:
            status = Status.UNDETERMINED
        elif not minimum.free[names.index(name)]:
            status = Status.AT_BOUND
        else:
            error = errors[names.index(name)]
            given = conditions.given(conditions.shifts[names.index(name)], error, value)
            status = Status.CONDITIONAL if given else Status.ESTIMATED
            if isfinite(error):
                interval = value - HALF_WIDTH * error, value + HALF_WIDTH * error
        datasheet = sheet[name].value if name in sheet else None
        described = _described(plant.handles[name].parameter)
        own = plant.own_parameter(name)
        record = "" if own is None else name[len(own[0]) + 1 : -1]
        rows.append(Estimate(*described, value, error, status, start.value(name), datasheet, given, interval, record))
    by_nobody = {row.name for row in assumed_in(rows)}
    return tuple(row if by_nobody.isdisjoint(row.given) else replace(row, status=Status.ASSUMING) for row in rows)


def with_choices(fit: GreyBoxFit, start: Plant) -> tuple[Estimate, ...]:
    """The rows of a fit, where the values that a search has changed without estimating them are said to be chosen."""
    known = start.handles
    return tuple(
        replace(row, status=Status.CHOSEN)
        if row.status in (Status.BUILT_IN, Status.OF_PLANT)
        and (row.name not in known or start.value(row.name) != row.value)
        else row
        for row in fit.table
    )


def _described(parameter: Any) -> tuple[str, str, str, str]:
    return parameter.name, parameter.symbol, parameter.unit, parameter.description


def combinations(
    plant: Plant,
    names: Sequence[str],
    identifiability: Identifiability,
    minimum: Minimum,
    conditions: Conditions,
) -> tuple[Combination, ...]:
    """The quantities of the plant that the data identify, with standard errors to first order.

    A tolerated value moves a quantity by ∂q/∂h + ∂q/∂θ·dθ̂/dh, which is zero for those that do not depend on it. A
    quantity is also given if undetermined parameters change it by less than `TOLERABLE` of its standard error, as the
    viscous friction of a motor with an inductance changes the mechanical time constant.
    """
    quantities, asked = plant.quantities(), identifiability.names
    sizes = dict(zip(conditions.names, conditions.sizes.tolist(), strict=True))
    sizes |= dict(zip(identifiability.names, identifiability.sizes.tolist(), strict=True))

    def gradients(which: Sequence[str]) -> Array:
        columns = []
        for name in which:
            value = plant.value(name)
            step = 1e-6 * max(abs(value), 1e-12, sizes[name]) * (1 if value < plant.handles[name].upper else -1)
            moved = plant.with_values({name: value + step}).quantities()  # an inductance has one more
            beside = {each.name: each.value for each in moved}
            columns.append([(beside[each.name] - each.value) / step for each in quantities])
        return np.array(columns).T.reshape(len(quantities), len(which))

    if not quantities:
        return ()
    relative = gradients(asked) * identifiability.sizes
    direct, held = gradients(names), gradients(conditions.names)
    covariance = minimum.covariance[: len(names), : len(names)] - conditions.covariance
    found = []
    for quantity, whole, part, beside in zip(quantities, relative, direct, held, strict=True):
        if not (np.any(whole) and isfinite(quantity.value)):
            continue
        moving = tuple(name for name, slope in zip(asked, whole, strict=True) if slope != 0)
        shift = beside + part @ conditions.shifts
        with np.errstate(invalid="ignore"):
            variance = part @ covariance @ part + np.sum((shift * conditions.tolerated) ** 2)
            error = float(np.sqrt(max(variance, 0.0)))
        barely = error < abs(quantity.value) and identifiability.hidden(whole) <= TOLERABLE * error
        if barely or identifiability.determines(whole):
            given = conditions.given(shift, error, quantity.value)
            found.append(Combination(quantity, error, moving, given))
    return tuple(found)


def has_physical_parameters(fit: Fit[Any]) -> TypeGuard[GreyBoxFit]:
    """Whether a fit has a table of physical parameters, with units and what is known of each."""
    return isinstance(fit, GreyBoxFit)
