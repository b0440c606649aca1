"""Characteristics of a drive with intervals: gain, time constant, natural frequency, dead zone, friction.

A quantity q(θ) of the estimate has the variance ∇qᵀ·Σ·∇q to first order (the delta method).

A pole z of a sampled model is s = ln(z)/T in continuous time. A real one decays with the time constant −1/s; a pair of
complex ones oscillates with the natural frequency ω₀ = |s| and the damping ratio ζ = −Re(s)/|s|, and has no time
constant of its own.

The output in the steady state at a constant input is found by running a model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.fit import Fit
from emsid.record import Record
from emsid.units import per_unit

MOVES = 1e-6
"""A model is at rest where its output moves by less than this share of itself: rounding, and the ripple of an
interpolated input."""


def settled(model: Any, level: float, inputs: int = 1) -> float:
    """The first output in the steady state that a model reports, if it stays there.

    Args:
        model: of any kind.
        level: the constant input.
        inputs: how many there are, all at this level.

    Raises:
        ModelError: where it does not.
    """
    late = model.latency
    out = model.run(model.at_rest(level), np.full((model.memory + late + 2, inputs), level))[0][late:, 0]
    if not np.isfinite(out).all() or np.ptp(out) > MOVES * np.abs(out).max():
        raise ModelError(f"{model.name} does not come to rest at an input of {level:g}")
    return float(out[-1])


def check_channel(model: Any, what: str, number: int, count: int) -> None:
    """Refuse the number of an input or output that there is not.

    Raises:
        ModelError: with the numbers that there are.
    """
    if not 0 <= number < count:
        raise ModelError(f"{model.name}: {what} {number} of {count}; they count from 0", arguments=(what,))


FASTER = 5.0
"""A pair that decays this many times faster than the slowest pole hardly shows in a response (dominant poles)."""


class Oscillation(NamedTuple):
    """A pair of complex poles.

    Attributes:
        frequency: natural, in rad/s.
        damping: its ratio; below 0 it grows.
    """

    frequency: float
    damping: float


def time_constants(poles: NDArray[Any], dt: float) -> list[float]:
    """Of the real poles between 0 and 1, in s, the slowest first."""
    real = [float(p.real) for p in np.asarray(poles, dtype=complex) if abs(p.imag) < 1e-9 and 0 < p.real < 1]
    return [-dt / float(np.log(pole)) for pole in sorted(real, reverse=True)]


def oscillation(poles: NDArray[Any], dt: float) -> Oscillation | None:
    """The slowest pair of complex poles; None where there is none, or where all decay fast beside the slowest pole.

    >>> pair = oscillation(np.exp(0.01 * np.array([-1 + 10j, -1 - 10j])), 0.01)
    >>> round(pair.frequency, 6), round(pair.damping, 6)
    (10.049876, 0.099504)
    """
    poles = np.asarray(poles, dtype=complex)
    stable = poles[(np.abs(poles) > 0) & (np.abs(poles) < 1)]
    pairs = stable[stable.imag > 1e-9]
    if not len(pairs):
        return None
    slowest = pairs[np.argmax(np.abs(pairs))]
    if np.log(np.abs(slowest)) < FASTER * np.log(np.max(np.abs(stable))):
        return None
    s = np.log(slowest) / dt
    return Oscillation(float(np.abs(s)), float(-s.real / np.abs(s)))


Array = NDArray[np.float64]
Make = Callable[[str, Callable[[Any], float], str], "Characteristic"]
"""Makes a characteristic from its name, the function that computes it, and its unit."""


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


def modes(
    make: Make,
    poles: Callable[[Any], NDArray[Any]],
    at: Any,
    dt: float,
) -> list[Characteristic]:
    """The slowest time constant, and natural frequency and damping ratio of the slowest pair, as far as there are any.

    Args:
        make: makes a characteristic.
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


def gain_unit(record: Record) -> str:
    """The unit of a gain from the first input to the first output."""
    return per_unit(record.output_units[0], record.input_units[0])


def half_of(error: float | None) -> float | None:
    """Half the width of the interval; None without one, as of a quantity whose parameters are fixed or at a bound."""
    return HALF_WIDTH * error if error and isfinite(error) else None


def by_estimate(fit: Fit[Any], name: str, quantity: Callable[[Array], float], unit: str) -> Characteristic:
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
    return Characteristic(name, quantity(theta), half_of(error), unit, fit.model.name)
