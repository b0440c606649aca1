"""Characteristics of a drive with intervals: gain, time constant, dead zone, friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.estimates import Estimate, Status
from emsid.estimation.fit import Fit
from emsid.estimation.uncertainty.intervals import HALF_WIDTH
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.plants.plant import Quantity
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.plants.visited import Needs, RestsOn, Visited
from emsid.models.poles import oscillation, time_constants
from emsid.models.regression.figures import COULOMB, of_regression
from emsid.models.regression.narx import Narx
from emsid.models.regression.transforms import Transform
from emsid.record import Record
from emsid.units import per_unit
from emsid.validation.comparison import Comparison

Array = NDArray[np.float64]

# Characteristics that a linear model has too.
LINEAR = ("gain", "time constant", "natural frequency", "damping ratio")
# Another model is also used if its free-run RMSE is at most this multiple of the smallest one.
NEARLY = 1.5
# Quantities of plants that repeat others and are left out of a short list.
LEFT_OUT = ("acceleration", "electromechanical", "electrical", "inertia ratio")


@dataclass(frozen=True)
class Characteristic:
    """One characteristic of a drive.

    Attributes:
        name: what it is.
        value: in the unit.
        half_width: half the width of its 95 % interval, to first order; None where it is not known.
        unit: of value and interval.
        model: the model that gives it.
        shown: whether the record approaches the threshold, the direction or the speeds that it rests on; else there is
            no number, only an extrapolation.
        given: the kept values that it depends on, by name; its interval holds only if they are right.
    """

    name: str
    value: float
    half_width: float | None
    unit: str
    model: str
    shown: bool = True
    given: tuple[str, ...] = ()

    @property
    def significant(self) -> bool:
        """Whether it is larger than half of its interval; one without an interval counts as significant."""
        return self.half_width is None or self.half_width <= abs(self.value)

    def unknown(self) -> Characteristic:
        """The same without a number, where the record does not approach what it rests on."""
        return replace(self, value=float("nan"), half_width=None, shown=False)

    def to_data(self) -> dict[str, Any]:
        """By name, in built-in types."""
        return asdict(self) | {"given": list(self.given)}


def determined(fit: Fit[Any]) -> list[Estimate]:
    """The physical parameters of a model that the data determine: their intervals do not include zero.

    None for a model without a table of such parameters.
    """
    rows: Sequence[Estimate] = getattr(fit, "shared", ())
    return [row for row in rows if row.status in (Status.ESTIMATED, Status.CONDITIONAL) and _excludes_zero(row)]


def _excludes_zero(row: Estimate) -> bool:
    """Whether a parameter has an interval, and zero is not in it."""
    if row.standard_error is not None:
        return 0 < HALF_WIDTH * row.standard_error < abs(row.value)
    return row.interval is not None and row.interval[0] * row.interval[1] > 0


def characteristics(comparison: Comparison, record: Record) -> tuple[Characteristic, ...]:
    """The characteristics of the best model, and dead zone and friction of the next model that is nearly as good.

    A model whose free run diverges has neither a steady gain nor a time constant.

    Args:
        comparison: the models on unseen data.
        record: what they were fitted to, for its units.
    """
    least = comparison.best.row.simulation_rmse
    if not isfinite(least):
        return ()
    near = [each.fit for each in comparison.assessments if each.row.simulation_rmse <= NEARLY * least]
    found: list[Characteristic] = []
    for fit in near:
        new = [each for each in of_fit(fit, record) if each.name not in {known.name for known in found}]
        found += new if not found else [each for each in new if each.name not in LINEAR]
        if any(each.name not in LINEAR for each in found):
            break
    return tuple(found)


def of_fit(fit: Fit[Any], record: Record) -> tuple[Characteristic, ...]:
    """The characteristics of one model; none for a model of several inputs or outputs, or without such parameters."""
    if isinstance(fit, GreyBoxFit):
        return _of_plant(fit)
    if record.input.shape[1] > 1 or record.output.shape[1] > 1:
        return ()
    if isinstance(fit.model, Cascade):
        return _of_cascade(fit, record)
    if isinstance(fit.model, (PolynomialModel, StateSpaceModel)):
        return _of_linear_form(fit, record)
    return _of_linear(fit, record) or _of_regression(fit, record) if isinstance(fit.model, Narx) else ()


def _of_plant(fit: GreyBoxFit) -> tuple[Characteristic, ...]:
    """The quantities that the data determine, and the dead zone."""
    model = fit.model.name
    zones = (
        (
            Quantity(row.description, "", row.unit, row.value * way, RestsOn(Needs.THRESHOLD, way)),
            row.standard_error,
            row.given,
        )
        for row in fit.table
        if "dead_zone" in row.name and row.status in ("estimated", "depends on kept values")
        for way in [-1 if row.name.endswith("b_l") else 1]
    )
    combined = (
        (each.quantity, each.standard_error, each.given)
        for each in fit.combinations
        if not each.quantity.name.startswith(LEFT_OUT)
    )
    found = (
        (Characteristic(each.name, float(each.value), _half(error), each.unit, model, given=given), fit.shows(each))
        for each, error, given in combined
    )
    ends = (
        (
            Characteristic(each.name, abs(float(each.value)), _half(error), each.unit, model, given=given),
            fit.shows(each),
        )
        for each, error, given in zones
    )
    return tuple(each if shown else each.unknown() for each, shown in (*found, *ends))


def _of_cascade(fit: Fit[Cascade], record: Record) -> tuple[Characteristic, ...]:
    """Gain and slowest time constant, and the break points of a dead zone."""
    model = fit.model
    inside = record.dt / model.oversampling
    found = [_quantity(fit, "gain", _gain, _gain_unit(record))]
    found += _modes(partial(_quantity, fit), _poles_of_cascade, model, inside)
    found += _edges(fit, record)
    return tuple(each for each in found if isfinite(each.value) or not each.shown)


def _poles_of_cascade(model: Cascade) -> NDArray[Any]:
    return np.concatenate([np.empty(0), *(block.poles for block in model.blocks if isinstance(block, Rational))])


def _modes(
    make: Callable[[str, Callable[[Any], float], str], Characteristic],
    poles: Callable[[Any], NDArray[Any]],
    at: Any,
    dt: float,
) -> list[Characteristic]:
    """The slowest time constant, and natural frequency and damping ratio of the slowest pair, as far as there are any.

    Args:
        make: a characteristic of its name, the function that computes it, and its unit.
        poles: of a model or an estimate.
        at: the model or the estimate.
        dt: time between the samples of the poles, in s.
    """

    def of_pair(which: int) -> Callable[[Any], float]:
        return lambda model: (oscillation(poles(model), dt) or (np.nan, np.nan))[which]

    found = []
    if time_constants(poles(at), dt):
        found.append(make("time constant", lambda model: (time_constants(poles(model), dt) or [np.nan])[0], "s"))
    if oscillation(poles(at), dt):
        found.append(make("natural frequency", of_pair(0), "rad/s"))
        found.append(make("damping ratio", of_pair(1), "1"))
    return found


def _of_linear_form(fit: Fit[Any], record: Record) -> tuple[Characteristic, ...]:
    """Gain and modes of a linear model in polynomials or in state space, without intervals."""
    form: StateSpaceModel = fit.model.form if isinstance(fit.model, PolynomialModel) else fit.model
    a = form.a
    if isinstance(fit.model, PolynomialModel):  # without the poles of the noise
        one = np.ones(1)
        poles = np.roots(np.convolve(np.append(one, fit.model.a), np.append(one, fit.model.f[0])))
    else:
        poles = form.poles

    def make(name: str, quantity: Callable[[Any], float], unit: str) -> Characteristic:
        return Characteristic(name, quantity(poles), None, unit, fit.model.name)

    rest = np.eye(len(a)) - a
    gain = form.d + form.c @ np.linalg.solve(rest, form.b) if np.linalg.cond(rest) < 1e12 else form.d * np.nan
    found = [Characteristic("gain", float(gain[0, 0]), None, _gain_unit(record), fit.model.name)]
    found += _modes(make, lambda poles: poles, poles, record.dt)
    return tuple(each for each in found if isfinite(each.value))


def _of_regression(fit: Fit[Narx], record: Record) -> tuple[Characteristic, ...]:
    """Of a regression that is not linear: gain over the range of the input, time constants, friction."""
    slides = Visited(np.empty(0), record.output[:, 0]).shows(RestsOn(Needs.SLIDING), 0.0)
    found = (
        Characteristic(each.name, each.value, _half(each.standard_error), each.unit, fit.model.name)
        for each in of_regression(fit, record)
        if isfinite(each.value)
    )
    return tuple(each.unknown() if each.name == COULOMB and not slides else each for each in found)


def _edges(fit: Fit[Cascade], record: Record) -> list[Characteristic]:
    """The break points of the first static map, where that is a dead zone, as levels of the input."""
    blocks = fit.model.blocks
    k = next((k for k, block in enumerate(blocks) if isinstance(block, StaticMap)), None)
    if k is None or not {"b_l", "b_r"} <= set(blocks[k].names) or not _gain_before(fit.model, k):
        return []
    sides = ("b_l", "b_r") if _gain_before(fit.model, k) > 0 else ("b_r", "b_l")
    names = zip(("backward", "forward"), sides, strict=True)
    found = (
        (
            way,
            _quantity(fit, f"dead zone {name}", partial(_edge, k, blocks[k].names.index(side)), record.input_units[0]),
        )
        for way, (name, side) in zip((-1, 1), names, strict=True)
    )
    visited = Visited(record.input[:, 0], np.empty(0))
    shown = [(each, visited.shows(RestsOn(Needs.THRESHOLD, way), way * each.value)) for way, each in found]
    return [each if approached else each.unknown() for each, approached in shown]


def _edge(block: int, number: int, model: Cascade) -> float:
    """The constant input at which a static map meets one of its break points."""
    edge = float(model.blocks[block].parameters[number])
    return edge / (_gain_before(model, block) or np.nan) + model.input_offset


def _gain_before(model: Cascade, block: int) -> float:
    """The gain at DC from the input to a static map; zero where a filter between them blocks DC or is unknown."""
    gain = 1.0
    for each in model.blocks[:block]:
        if not isinstance(each, Rational):
            return 0.0
        numerator = float(np.sum(each.numerator))
        rounding = 1e-9 * float(np.sum(np.abs(each.numerator)))
        gain *= numerator / (1 + float(np.sum(each.denominator))) if abs(numerator) > rounding else 0.0
    return gain


def _gain(model: Cascade) -> float:
    """Slope from input to output, in a stretch where the maps are straight."""
    factors = [
        block.gain if isinstance(block, Rational) else block.steepness
        for block in model.blocks
        if isinstance(block, Rational | StaticMap)
    ]
    return float(np.prod(factors))


def _of_linear(fit: Fit[Narx], record: Record) -> tuple[Characteristic, ...]:
    """Gain and slowest time constant of A(q)y = B(q)u; none for a regression that is not linear."""
    regressors = [each for each in fit.model.structure.regressors if each.factors]
    single = [each.factors[0] for each in regressors if len(each.factors) == 1]
    if len(single) < len(regressors) or any(f.power > 1 or f.transform is not Transform.VALUE for f in single):
        return ()
    at = [k for k, each in enumerate(fit.model.structure.regressors) if each.factors]
    signs = np.array([-1.0 if each.negative else 1.0 for each in regressors])
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

    found = [_by_estimate(fit, "gain", gain, _gain_unit(record))]
    found += _modes(partial(_by_estimate, fit), lambda theta: np.roots(past(theta)), fit.estimate, record.dt)
    return tuple(each for each in found if isfinite(each.value))


def _gain_unit(record: Record) -> str:
    return per_unit(record.output_units[0], record.input_units[0])


def _half(error: float | None) -> float | None:
    """Half the width of the interval; None without one, as of a quantity whose parameters are fixed or at a bound."""
    return HALF_WIDTH * error if error and isfinite(error) else None


def _quantity(fit: Fit[Cascade], name: str, quantity: Callable[[Cascade], float], unit: str) -> Characteristic:
    """A quantity of the model, whose free parameters are a part of its parameters."""
    model = fit.model
    at = [model.names.index(each) for each in fit.names]

    def of(theta: Array) -> float:
        whole = np.array(model.parameters, dtype=float)
        whole[at] = theta
        return quantity(model.with_parameters(whole))

    return _by_estimate(fit, name, of, unit)


def _by_estimate(fit: Fit[Any], name: str, quantity: Callable[[Array], float], unit: str) -> Characteristic:
    """A function of the estimate with its interval by the delta method: var q = ∇qᵀ·Σ·∇q; none of a biased one."""
    theta = np.asarray(fit.estimate, dtype=float)
    steps = 1e-6 * np.maximum(np.abs(theta), 1e-9)
    slope = np.array(
        [
            (quantity(theta + step * unit_vector) - quantity(theta - step * unit_vector)) / (2 * step)
            for step, unit_vector in zip(steps, np.eye(len(theta)), strict=True)
        ]
    )
    known = slope != 0
    variance = float(slope[known] @ fit.covariance[np.ix_(known, known)] @ slope[known]) if known.any() else np.nan
    error = float(np.sqrt(variance)) if isfinite(variance) and variance >= 0 and not fit.biased else None
    return Characteristic(name, quantity(theta), _half(error), unit, fit.model.name)
