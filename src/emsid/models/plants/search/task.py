"""The task of a search: the plant, its parameters, their known values, and the records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.plants.by_name import as_bounds, as_signals, by_full_name, full_names
from emsid.models.plants.datasheet import Given, as_datasheet, without_tolerances
from emsid.models.plants.free_run_error import FreeRunError, Weighting, all_alike, threads_for
from emsid.models.plants.grey_box import check_channels, signals_of
from emsid.models.plants.initial_state import InitialState, begun
from emsid.models.plants.parameters import Handle, Signal, find_handle, refuse_overlap, without_overlap
from emsid.models.plants.plant import Plant
from emsid.models.plants.search.motion_check import check_motion
from emsid.models.plants.search.speeds import resolved_rate
from emsid.plant.motor import read_number
from emsid.record import Record, check_same_channels
from emsid.units import with_unit

Array = NDArray[np.float64]
Limits = dict[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Task:
    """The task of a search, checked and complete.

    Attributes:
        given: the plant with its known values.
        plant: the same with start values for parameters to estimate that have no effect at their given values.
        segments: the records without gaps.
        signals: the quantities of their outputs.
        asked: the parameters to estimate.
        fixed: values that are known.
        sheet: the entries of the datasheet.
        resolution_limits: bounds beyond which the sample time does not resolve a parameter.
        limits: the narrowest bounds of every parameter asked for.
        weighting: of errors by their age, or by the drift of the load.
        threads: the number of threads.
        control: when to stop.
        hold_given: whether the user gave the hold of the input.
        begins: how the initial states are found; see `initial_state`.
    """

    given: Plant
    plant: Plant
    segments: tuple[Record, ...]
    signals: tuple[Signal, ...]
    asked: tuple[str, ...]
    fixed: Mapping[str, float]
    sheet: Mapping[str, Given]
    resolution_limits: Limits
    limits: Limits
    weighting: Weighting
    threads: int
    control: Control
    hold_given: bool = False
    begins: InitialState = InitialState.FREE

    @property
    def known(self) -> dict[str, float]:
        """The values of the datasheet."""
        return {name: given.value for name, given in self.sheet.items() if given.value is not None}

    @property
    def preference(self) -> tuple[str, ...]:
        """The order in which parameters are kept at their start: those first that are most likely known."""
        return preference_of(self.plant, self.asked, self.sheet)

    def problem(self, plant: Plant, names: Sequence[str], states: Sequence[Array] | None = None) -> FreeRunError:
        """The least-squares problem of some parameters, from a plant and initial states."""
        first, free = begun(plant, self.signals, self.segments, self.begins, states)
        return FreeRunError(plant, self.signals, self.segments, names, first, free, self.weighting, self.threads)


def prepare(
    plant: Plant,
    records: Record | Iterable[Record],
    *,
    free: str | Sequence[str] | None = None,
    fixed: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    datasheet: Mapping[str, Any] | None = None,
    signals: str | Signal | Sequence[str | Signal] | None = None,
    weighting: Weighting = all_alike,
    from_datasheet: bool = True,
    threads: int | None = None,
    control: Control = FREE,
) -> Task:
    """The task that the arguments of `simulation_error` describe.

    Raises:
        ModelError: for names that the plant does not have, bounds that exclude a start, a datasheet that contradicts
            itself.
        DataError: for records without motion, with other channels or in other units.
    """
    segments = _segments(records)
    plant = plant.for_command(segments[0])
    values, sheet = known_values(plant, fixed, as_datasheet(plant, datasheet))
    plant = plant.measured_by(all_known(values, sheet), full_names(plant, free) or ())
    shown = as_signals(signals) if signals is not None else signals_of(plant, segments[0])
    for segment in segments:
        check_channels(plant, shown, segment)
    check_motion(segments)
    bounds = as_bounds(plant, bounds)
    asked = asked_for(plant, full_names(plant, free), values, sheet)
    sheet |= {name: sheet[both] for name in asked if (both := _both_ways(name)) != name and both in sheet}
    known = all_known({}, sheet)
    given = plant.with_values((known if from_datasheet else {}) | values)
    unknown = [n for n in asked if n not in (*sheet, *bounds)]
    unresolved = given.resolution_limits(unknown, segments[0].dt) | _resolved_rates(unknown, segments, shown)
    limits = limits_of(given, asked, {**unresolved, **bounds}, sheet)
    start = given.with_starts(asked, segments, limits)
    start = start.with_values(
        {name: min(max(start.value(name), low), high) for name, (low, high) in unresolved.items()}
    )
    _check_start(start, asked, limits)
    return Task(
        given, start, segments, shown, asked, values, sheet, unresolved, limits, weighting,
        threads or threads_for(segments), control,
    )  # fmt: skip


def cost_of(problem: FreeRunError, channel: int | None = None) -> float:
    """The sum of squares of a problem at its start, or that of one output."""
    try:
        residuals = problem.residuals(problem.start)
    except Infeasible:
        return inf
    if channel is not None:
        residuals = [np.split(residual, len(problem.signals))[channel] for residual in residuals]
    cost = float(sum(np.sum(residual**2) for residual in residuals))
    return cost if isfinite(cost) else inf


def _segments(records: Record | Iterable[Record]) -> tuple[Record, ...]:
    whole = (records,) if isinstance(records, Record) else tuple(records)
    if not whole:
        raise DataError("no record to identify from")
    for other in whole[1:]:
        check_same_channels(whole[0], other)
    return tuple(segment for record in whole for segment in record.segments)


def known_values(
    plant: Plant, fixed: Mapping[str, float | str] | None, sheet: Mapping[str, Given]
) -> tuple[dict[str, float], dict[str, Given]]:
    """The fixed values, and the datasheet with their tolerances; by full name and in SI units.

    Args:
        plant: that has the parameters.
        fixed: numbers, or texts with a unit and a tolerance: ``"2 ohm ± 5 %"``.
        sheet: the datasheet.
    """
    texts, tolerances = without_tolerances(by_full_name(plant, "fixed", fixed))
    values = {
        name: read_number(f"{plant.name} {name}", value, find_handle(plant, name).parameter.unit)
        for name, value in texts.items()
    }
    return values, {**sheet, **{name: Given(values[name], part) for name, part in tolerances.items()}}


def all_known(values: Mapping[str, float], sheet: Mapping[str, Given]) -> dict[str, float]:
    """The values of a datasheet, and the fixed ones."""
    return {**{name: given.value for name, given in sheet.items() if given.value is not None}, **values}


def asked_for(
    plant: Plant, free: Sequence[str] | None, fixed: Mapping[str, float], sheet: Mapping[str, Given]
) -> tuple[str, ...]:
    """The parameters to estimate.

    Args:
        plant: that has them.
        free: by full name; by default those that are usually unknown.
        fixed: known values.
        sheet: the datasheet.

    Raises:
        ModelError: for names that the plant does not have, or that are both free and fixed.
    """
    for name in (*(free or ()), *fixed, *sheet):
        find_handle(plant, name)
    both = [name for name in free or () if name in fixed]
    if both:
        raise ModelError(f"{both[0]} is both free and fixed at {fixed[both[0]]:g}; choose one")
    for name, value in fixed.items():
        given = sheet.get(name)
        if given is not None and given.limits is not None and not given.limits[0] <= value <= given.limits[1]:
            raise ModelError(
                f"{name} is fixed at {value:g} and the datasheet has it within [{given.limits[0]:g}, "
                f"{given.limits[1]:g}]; correct one of them"
            )
    unknown = [name for name, given in sheet.items() if given.value is None]
    names = tuple(free) if free is not None else without_overlap(plant, (*plant.default_free, *unknown), fixed)
    refuse_overlap(plant, (*names, *fixed))
    if not names:
        raise ModelError(f"no parameter of {plant.name} is free; it has {', '.join(plant.handles)}")
    return names


def _both_ways(name: str) -> str:
    """The parameter for both directions that one for a single direction is a part of."""
    return name.removesuffix(".forward").removesuffix(".backward")


def limits_of(
    plant: Plant, asked: Sequence[str], bounds: Mapping[str, tuple[float, float]], sheet: Mapping[str, Given]
) -> Limits:
    """The narrowest bounds that hold for every parameter that was asked for.

    Args:
        plant: that has them.
        asked: the parameters.
        bounds: given ones.
        sheet: the datasheet.

    Raises:
        ModelError: for bounds that contradict each other.
    """
    limits: Limits = {}
    for name in bounds:
        find_handle(plant, name)
        if name not in asked:
            raise ModelError(f"bounds for {name}, which is not free; free are {', '.join(asked)}")
    for name in asked:
        handle: Handle = plant.handles[name]
        low, high, unit = handle.lower, handle.upper, handle.parameter.unit
        if name in bounds:
            given_low, given_high = bounds[name]
            if not given_low <= given_high or given_high < low or given_low > high:
                raise ModelError(
                    f"bounds of {name} are {with_unit(f'[{given_low:g}, {given_high:g}]', unit)}; they must ascend "
                    f"within [{low:g}, {high:g}]"
                )
            low, high = max(low, given_low), min(high, given_high)
        given = sheet.get(name)
        if given is not None and given.limits is not None:
            sheet_low, sheet_high = given.limits
            if sheet_low > high or sheet_high < low:
                raise ModelError(
                    f"the datasheet has {name} within [{sheet_low:g}, {sheet_high:g}] and its bounds are "
                    f"{with_unit(f'[{low:g}, {high:g}]', unit)}; they contradict each other"
                )
            low, high = max(low, sheet_low), min(high, sheet_high)
        limits[name] = (low, high)
    return limits


def _resolved_rates(names: Sequence[str], segments: Sequence[Record], signals: Sequence[Signal]) -> Limits:
    """Bounds of those of the names that are rates of Stribeck friction."""
    rates = [name for name in names if ".stribeck_rate" in name]
    most = resolved_rate(segments, signals) if rates else inf
    return {name: (0.0, most) for name in rates if most < inf}


def _check_start(plant: Plant, asked: Sequence[str], limits: Limits) -> None:
    for name in asked:
        value, (low, high) = plant.value(name), limits[name]
        if not low <= value <= high:
            bounds = with_unit(f"[{low:g}, {high:g}]", plant.handles[name].parameter.unit)
            raise ModelError(f"bounds {bounds} of {name} exclude its start {value:g}; widen them or move the start")


def preference_of(plant: Plant, asked: Sequence[str], sheet: Mapping[str, Given]) -> tuple[str, ...]:
    """The order in which parameters are kept at their start: those of a datasheet, then usually known ones.

    Args:
        plant: that has them.
        asked: the parameters.
        sheet: the datasheet.
    """
    known = sorted(
        (n for n in asked if n in sheet and sheet[n].value is not None), key=lambda n: sheet[n].tolerance or inf
    )
    default = [name for name in plant.default_free if name in asked]
    return tuple(dict.fromkeys((*known, *default, *reversed(asked))))
