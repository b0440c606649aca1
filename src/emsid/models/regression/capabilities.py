"""What regressions can do; see `emsid.models.capabilities`.

A structure is fitted by the method that its options ask for. A regression with one input and one output has gain, time
constants and friction, with intervals; one of one input has curves at rest, its static map and its friction.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.linear.recursive import recursive_least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.bands import POINTS, Band, banded
from emsid.models.c_form import CForm
from emsid.models.capabilities import Capabilities, Modes
from emsid.models.characteristics import Characteristic, by_estimate, check_channel, gain_unit, half_of, modes, settled
from emsid.models.linear.state_space import observer_form
from emsid.models.linear.system import LinearSystem
from emsid.models.refit_data import Budget, Data
from emsid.models.regression.c_form import RegressionStepper, c_form
from emsid.models.regression.figures import COULOMB, of_regression
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.instruments import fit_instruments
from emsid.models.regression.intervals import with_robust_intervals
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.regressors import Regressor
from emsid.models.regression.transforms import Transform, slope
from emsid.models.stepping import Stepper
from emsid.models.visited import Needs, RestsOn, Visited
from emsid.record import Record

Array = NDArray[np.float64]


def static_map(fit: Fit[Narx], record: Record, level: float) -> Band:
    """The output at rest over the input, from all terms but those that are nonlinear in past outputs (friction).

    Raises:
        ModelError: for products of input and output.
    """
    terms = _of_one_side(fit.model)
    x = np.linspace(float(record.input.min()), float(record.input.max()), POINTS)

    def at_rest(moved: Narx) -> Array:
        inputs = _sum(moved, terms[1], x) + _sum(moved, terms[None], x)
        return np.asarray(inputs / (1.0 - _sum(moved, _linear(terms[0]), np.ones(1))))

    return banded(fit, at_rest, x, level)


def friction(fit: Fit[Narx], record: Record, level: float) -> Band:
    """What the terms that are nonlinear in past outputs do at a constant output, over the slope of the input.

    Raises:
        ModelError: for a model without such terms, or with products of input and output.
    """
    terms = _of_one_side(fit.model)
    bent = [k for k in terms[0] if k not in _linear(terms[0])]
    if not bent:
        raise ModelError(f"{fit.model.name} has no term that is nonlinear in past outputs")
    low, high = np.quantile(record.input, (0.01, 0.99))
    x = np.linspace(float(record.output.min()), float(record.output.max()), POINTS)

    def taken_up(moved: Narx) -> Array:
        slope = np.diff(_sum(moved, terms[1], np.array([low, high])))[0] / (high - low)
        return np.asarray(-_sum(moved, {k: terms[0][k] for k in bent}, x) / slope)

    return banded(fit, taken_up, x, level)


def _of_one_side(model: Narx) -> dict[int | None, dict[int, Regressor]]:
    """The regressors of past outputs (0), of past inputs (1) and constants (None), by their places.

    Raises:
        ModelError: for several inputs, or products of input and output.
    """
    if model.structure.inputs != 1:
        raise ModelError(f"{model.name} is no regression of one input")
    sides: dict[int | None, dict[int, Regressor]] = {0: {}, 1: {}, None: {}}
    if has_products(model):
        raise ModelError(f"{model.name} has products of input and output, so its friction is not one curve")
    for k, regressor in enumerate(model.structure.regressors):
        sides[next((factor.channel for factor in regressor.factors), None)][k] = regressor
    return sides


def has_products(model: Narx) -> bool:
    """Whether a term of a regression is a product of input and output."""
    return any(len({factor.channel for factor in regressor.factors}) > 1 for regressor in model.structure.regressors)


def _linear(regressors: dict[int, Regressor]) -> dict[int, Regressor]:
    """Those that are a past signal itself."""
    return {k: regressor for k, regressor in regressors.items() if regressor.is_linear}


def _sum(model: Narx, regressors: dict[int, Regressor], x: Array) -> Array:
    """(m,) what regressors add to the output where their signal has been constant at x (m,)."""
    total = np.zeros(len(x))
    for k, regressor in regressors.items():
        value = np.full(len(x), -model.parameters[k] if regressor.negative else model.parameters[k])
        for factor in regressor.factors:
            value = value * factor.transform.definition(x, factor.parameter) ** factor.power
        total += value
    return total


def linearised(model: Narx, around: float) -> tuple[Array, Array, float]:
    """A (memory + 1,) and B (nu, memory + 1) of a regression in powers of q⁻¹ at its rest, and its output there.

    A regression y(t) = Σ θⱼ φⱼ is linearised by the slopes of its regressors at rest, ∂φⱼ/∂y(t−k) and ∂φⱼ/∂u(t−k),
    so that

        A(q) = 1 − Σⱼₖ θⱼ ∂φⱼ/∂y(t−k) q⁻ᵏ        B(q) = Σⱼₖ θⱼ ∂φⱼ/∂u(t−k) q⁻ᵏ

    Raises:
        ModelError: where it does not come to rest at this input.
    """
    rest = settled(model, around, model.structure.inputs)
    rows = np.zeros((1 + model.structure.inputs, model.structure.memory + 1))
    for regressor, value in zip(model.structure.regressors, model.parameters, strict=True):
        weight = -value if regressor.negative else value
        levels = [around if factor.channel else rest for factor in regressor.factors]
        factors = list(zip(regressor.factors, levels, strict=True))
        through = np.array([float(each.transform.definition(x, each.parameter)) for each, x in factors])
        powers = np.array([factor.power for factor in regressor.factors])
        for k, (each, x) in enumerate(factors):
            others = float(np.prod(np.delete(through**powers, k)))
            own = powers[k] * through[k] ** (powers[k] - 1) * slope(int(each.transform), x, each.parameter)
            rows[each.channel, each.lag] += weight * own * others
    below = -rows[0]
    below[0] = 1.0
    if np.abs(np.roots(below)).max(initial=0.0) >= 1.0:
        raise ModelError(f"{model.name} does not come to rest at an input of {around:g}: it is unstable there")
    return below, rows[1:], rest


def about(model: Narx, level: float) -> tuple[Array, Array]:
    """A (memory + 1,) and B (nu, memory + 1) of a regression, near its rest at a constant input unless it is linear.

    Raises:
        ModelError: where it does not come to rest at this input.
    """
    return model.linear_part() if model.is_linear else linearised(model, level)[:2]


def of_linear(fit: Fit[Narx], record: Record) -> tuple[Characteristic, ...]:
    """Gain and slowest time constant of A(q)y = B(q)u; none for a regression that is not linear."""
    regressors = [regressor for regressor in fit.model.structure.regressors if regressor.factors]
    single = [regressor.factors[0] for regressor in regressors if len(regressor.factors) == 1]
    if len(single) < len(regressors) or any(f.power > 1 or f.transform is not Transform.VALUE for f in single):
        return ()
    at = [k for k, regressor in enumerate(fit.model.structure.regressors) if regressor.factors]
    signs = np.array([-1.0 if regressor.negative else 1.0 for regressor in regressors])
    most = max((f.lag for f in single if f.channel == 0), default=0)

    def past(theta: Array) -> Array:
        """The coefficients of A."""
        a: Array = np.eye(1, most + 1)[0]
        for value, factor in zip(signs * theta[at], single, strict=True):
            if factor.channel == 0:
                a[factor.lag] -= value
        return a

    def gain(theta: Array) -> float:
        b = sum(value for value, factor in zip(signs * theta[at], single, strict=True) if factor.channel)
        return float(b / np.sum(past(theta)))

    found = [by_estimate(fit, "gain", gain, gain_unit(record))]
    found += modes(partial(by_estimate, fit), lambda theta: np.roots(past(theta)), fit.estimate, record.dt)
    return tuple(each for each in found if isfinite(each.value))


def of_nonlinear(fit: Fit[Narx], record: Record) -> tuple[Characteristic, ...]:
    """Of a regression that is not linear: gain over the range of the input, time constants, friction."""
    slides = Visited(np.empty(0), record.output[:, 0]).shows(RestsOn(Needs.SLIDING), 0.0)
    found = (
        Characteristic(each.name, each.value, half_of(each.standard_error), each.unit, fit.model.name)
        for each in of_regression(fit, record)
        if isfinite(each.value)
    )
    return tuple(each.unknown() if each.name == COULOMB and not slides else each for each in found)


def fit_structure(
    structure: Structure,
    records: Record | Iterable[Record],
    *,
    ridge: float = 0.0,
    forgetting: float | None = None,
    history: bool = False,
    threads: int | None = None,
    free_run: bool = False,
    instruments: bool = False,
    start: ArrayLike | None = None,
    transient: int | None = None,
    control: Control = FREE,
) -> Fit[Narx]:
    """Least squares; recursive with a forgetting factor or a history; Gauss–Newton steps for the free run."""
    recursive = forgetting is not None or history
    if sum((bool(ridge), recursive, free_run, instruments)) > 1 and (free_run or instruments):
        raise ModelError("ridge, forgetting (or history), free_run and instruments exclude each other; choose one")
    if instruments:
        begin = None if start is None else np.asarray(start, dtype=float)
        return fit_instruments(structure, records, start=begin, control=control)
    if free_run:
        return fit_free_run(structure, records, start=start, transient=transient, control=control, restarts=True)
    if start is not None or transient is not None:
        raise ModelError("start and transient are for a fit to the free run; give free_run=True, or leave them out")
    if not recursive:
        several = (records,) if isinstance(records, Record) else tuple(records)
        fit = least_squares(structure, several, ridge=ridge, threads=threads, each_block=control.check)
        return fit if ridge else with_robust_intervals(fit, several)
    if ridge:
        raise ModelError("ridge is for a batch estimate and forgetting for a recursive one; choose one of them")
    return recursive_least_squares(structure, records, forgetting=forgetting or 1.0, history=history)


Complex = NDArray[np.complex128]

CLOSE, EXACT = 0.05, 1e-3
"""Standard errors from the minimum at which a search of all samples ends, and one that only compares."""


class OfRegressions(Capabilities[Narx]):
    """Regressions: linear in their parameters."""

    kind = "narx"
    model = Narx
    estimators: ClassVar = {Structure: fit_structure}
    fitted_by = "its structure: model.structure"
    linear_in_parameters = True
    same_in_every_fit = True

    def inputs(self, model: Narx) -> int:
        return model.structure.inputs

    def stepper(self, model: Narx, state: Any, inputs: int) -> Stepper:
        return RegressionStepper(model, state)

    def c_form(self, stepper: Any, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
        return c_form(stepper)

    def linear_part(self, model: Narx, at: float) -> LinearSystem:
        below, above = about(model, at)
        a, columns = observer_form(below, list(above))
        return LinearSystem(a, columns, np.eye(1, len(a)), above[:, :1].T.copy(), model.dt, name=model.name)

    def frequency_response(self, model: Narx, f: Array, dt: float, output: int, input: int, around: float) -> Complex:
        check_channel(model, "output", output, 1)
        check_channel(model, "input", input, model.structure.inputs)
        below, above = about(model, around)
        z = np.exp(-2j * np.pi * f * dt)
        polynomial = np.polynomial.polynomial.polyval
        return np.asarray(polynomial(z, above[input]) / polynomial(z, below), dtype=complex)

    def modes(self, model: Narx) -> Modes:
        lags = [f.lag for regressor in model.structure.regressors for f in regressor.factors if f.channel]
        delay = min(lags, default=0)
        if not model.is_linear:
            return Modes(delay=delay)
        below, above = model.linear_part()
        poles = list(np.roots(below)) if len(below) > 1 else []
        return Modes(poles if model.start else (), {0: (poles, list(np.roots(above[0])))}, delay)

    def output_at_rest(self, model: Narx, level: float) -> float:
        return linearised(model, level)[2]

    def static_map(self, fit: Fit[Narx], record: Record, map: int = 0, level: float = 0.95) -> Band:
        if has_products(fit.model) or record.input.shape[1] * record.output.shape[1] > 1:
            return super().static_map(fit, record, map, level)
        return static_map(fit, record, level)

    def friction(self, fit: Fit[Narx], record: Record, level: float = 0.95) -> Band:
        return friction(fit, record, level)

    def characteristics(self, fit: Fit[Narx], record: Record) -> tuple[Characteristic, ...]:
        if record.input.shape[1] > 1 or record.output.shape[1] > 1:
            return ()
        return of_linear(fit, record) or of_nonlinear(fit, record)

    def refitted(self, fit: Fit[Narx], data: Data, budget: Budget) -> Fit[Narx]:
        structure = fit.model.structure
        if fit.method != "gn":
            last = budget is Budget.LAST
            each_block = partial(data.control.doing, "fitting to all rows") if last else None
            found: Fit[Narx] = data.linear(structure, data.in_pieces, each_block=each_block)
            plain = last and found.method == "ls" and not data.given.get("ridge")
            return with_robust_intervals(found, data.records) if plain else found
        last = budget is Budget.LAST
        found = fit_free_run(
            structure,
            data.records,
            start=fit.model.parameters,
            max_iterations=budget.steps,
            tolerance=CLOSE if last else EXACT,
            least_saving=budget.saving,
            control=data.control,
            covariances=last,
            left_out=data.by_segment,
        )
        about_terms = (each for each in fit.findings if last and each.code == "dictionary-rank-deficient")
        return replace(found, findings=(*found.findings, *about_terms))

    def specification(self, fit: Fit[Narx]) -> tuple[Any, dict[str, Any]]:
        return fit.model.structure, {"free_run": True} if fit.method == "gn" else {}
