r"""A plant fitted to measured frequency responses, alone or together with records.

The response of a plant is that in motion, without dry friction, dead zone and limits, sampled like the measured one.
Parameters without effect on it keep their values. A search begins with the error of the logarithm, ln(G/Ĝ), which falls
towards a resonance from far away; its end is the start of the weighted search of `mixed_problem`. Parameters that the
response does not determine are kept at their start, those first that are usually known.

Together with records, the free-run error of these, divided by the standard deviation of their noise, is added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.problem import Block
from emsid.estimation.uncertainty.identifiability import ROUNDED
from emsid.findings import Finding
from emsid.models.linear.mixed_problem import LinearProblem
from emsid.models.linear.system import LinearSystem
from emsid.models.plants.by_name import as_bounds, as_signals, full_names
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError, threads_for
from emsid.models.plants.grey_box import GreyBox, signals_of
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.task import asked_for, known_values, limits_of, preference_of
from emsid.record import FrequencyResponse, Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

STEP = 1e-6
"""Relative step of the differences that give derivatives; of a value of zero, the step itself."""


def fit_to_responses(
    plant: Plant,
    data: Sequence[Record | FrequencyResponse],
    *,
    free: str | Sequence[str] | None = None,
    fixed: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    signals: str | Signal | Sequence[str | Signal] | None = None,
    max_iterations: int = 100,
    control: Control = FREE,
) -> Fit[GreyBox]:
    """The parameters of a plant from frequency responses, and records if there are any.

    Args:
        plant: what to fit, with its parameters as the start.
        data: the responses and the records.
        free, fixed, bounds, signals: see `simulation_error`.
        max_iterations: the largest number of steps.
        control: when to stop, and where to report every step.

    Raises:
        ModelError: for names that the plant does not have, a plant without a linear part.
        DataError: for responses of several inputs, or other outputs than the records.
    """
    responses = [each for each in data if isinstance(each, FrequencyResponse)]
    records = [each for each in data if isinstance(each, Record)]
    if any(each.response.shape[2] != 1 for each in responses):
        raise DataError(f"{plant.name} has one command; take the paths from one input of the response")
    values, sheet = known_values(plant, fixed, {})
    whole, first = plant.with_values(values), responses[0]
    nothing = Record(
        np.zeros((1, 1)), np.zeros((1, first.response.shape[1])), 1.0, first.input_names, first.output_names,
        first.input_units, first.output_units,
    )  # fmt: skip
    shown = as_signals(signals) if signals is not None else signals_of(whole, nothing)
    asked = asked_for(whole, full_names(whole, free), values, sheet)
    limits = limits_of(whole, asked, as_bounds(whole, bounds), sheet)
    part: _Together | None = None
    if records:
        how: dict[str, Any] = {"free": asked, "fixed": fixed, "bounds": bounds, "signals": signals, "control": control}
        alone = simulation_error(whole, records, **how)
        whole, shown = alone.model.plant, alone.model.signals
        segments, names = alone.segments, alone.names
        states = list(alone.states)
        unknown = [whole.free_states(shown, segment) for segment in segments]
        free_run = FreeRunError(whole, shown, segments, names, states, unknown, alone.weighting, threads_for(segments))
        part = _Together(
            _problem(GreyBox(whole, shown), names, responses), free_run, float(np.sqrt(alone.noise_variance))
        )
    else:
        names = _with_effect(GreyBox(whole, shown), asked, responses)
    model, kept = GreyBox(whole, shown), []
    search: dict[str, Any] = {"max_iterations": max_iterations, "control": control}
    while True:
        problem = _problem(model, names, responses)
        start = np.array([model.plant.value(name) for name in names])
        lower, upper = np.array([limits[name] for name in names]).T
        if part is not None:
            more = len(part.free_run.start) - len(names)
            lower, upper = np.append(lower, np.full(more, -np.inf)), np.append(upper, np.full(more, np.inf))
            minimum = gauss_newton(
                part, np.clip(part.free_run.start, lower, upper), lower=lower, upper=upper, names=part.free_run.names,
                **search,
            )  # fmt: skip
            return minimum.fit(problem.model(minimum.estimate[: len(names)]), names)
        within: dict[str, Any] = {"lower": lower, "upper": upper, "names": names}
        nearer = gauss_newton(
            _problem(model, names, responses, logarithm=True), start, covariances=False, **within, **search
        )
        minimum = gauss_newton(problem, nearer.estimate, **within, **search)
        if minimum.rank == len(names) and minimum.condition < 1 / ROUNDED:
            break
        undone = next(name for name in preference_of(whole, asked, sheet) if name in names)
        names = tuple(name for name in names if name != undone)
        kept.append(undone)
        if not names:
            raise ModelError(f"{plant.name}: the frequency response determines none of {', '.join(asked)}")
    found = problem.fit(minimum)
    if kept:
        units = [[name, whole.value(name), whole.handles[name].parameter.unit] for name in kept]
        note = Finding("kept-by-response", plant.name, {"parameters": kept, "kept": units})
        found = replace(found, findings=(*found.findings, note))
    return found


def _problem(
    model: GreyBox, names: Sequence[str], responses: Sequence[FrequencyResponse], logarithm: bool = False
) -> LinearProblem:
    steps = np.array([STEP * abs(model.plant.value(name)) or STEP for name in names])
    if not logarithm:
        return LinearProblem(model, names, steps, (), responses, _respond)

    def in_logarithms(moved: GreyBox, measured: FrequencyResponse) -> Complex:
        return np.asarray(np.log(_respond(moved, measured) / measured.response))

    relative = [replace(each, response=np.zeros_like(each.response), total=_relative(each)) for each in responses]
    originals = dict(zip(map(id, relative), responses, strict=True))
    return LinearProblem(
        model, names, steps, (), relative, lambda moved, each: in_logarithms(moved, originals[id(each)])
    )


def _relative(measured: FrequencyResponse) -> Array:
    """The variance of its logarithm, one at least: so far away the error of the model counts, not that of the data."""
    return np.asarray(np.maximum(measured.total_or_relative / np.abs(measured.response) ** 2, 1.0))


def _respond(model: GreyBox, measured: FrequencyResponse) -> Complex:
    part = model.plant.linearised(model.signals)
    if part is None:
        raise ModelError(f"{model.name} has no linear part that is known, so it has no frequency response")
    late = model.plant.drive.delay if isinstance(model.plant, DrivenPlant) else 0.0
    system = LinearSystem(*part.observed()[:4], None, late, model.name)
    system = replace(system, b=system.b[:, :1], d=system.d[:, :1])  # the command, without a load
    if measured.dt is not None:
        system = system.to_discrete(measured.dt)
    return system.response(measured.frequency)


def _with_effect(model: GreyBox, names: Sequence[str], responses: Sequence[FrequencyResponse]) -> tuple[str, ...]:
    """Those parameters that change the response."""
    problem = _problem(model, names, responses)
    theta = np.array([model.plant.value(name) for name in names])
    slope = np.concatenate([jacobian for _, jacobian in problem.linearised(theta)])
    found = tuple(name for name, column in zip(names, slope.T, strict=True) if np.any(np.abs(column) > 0))
    if not found:
        raise ModelError(f"{model.name}: none of {', '.join(names)} changes the frequency response")
    return found


class _Together:
    """The free-run error of records over the standard deviation of their noise, and the error of responses."""

    def __init__(self, of_responses: LinearProblem, free_run: FreeRunError, noise: float) -> None:
        self.of_responses, self.free_run, self.noise = of_responses, free_run, noise

    def residuals(self, theta: Array) -> list[Array]:
        own = self.of_responses.residuals(theta[: len(self.of_responses.names)])
        return [*(each / self.noise for each in self.free_run.residuals(theta)), *own]

    def linearised(self, theta: Array) -> list[Block]:
        count = len(self.of_responses.names)
        rest = len(theta) - count
        own = self.of_responses.linearised(theta[:count])
        return [
            *((r / self.noise, j / self.noise) for r, j in self.free_run.linearised(theta)),
            *((r, np.hstack([j, np.zeros((len(r), rest))])) for r, j in own),
        ]
