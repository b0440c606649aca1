"""Curves, standstills and likelihood profiles of a fitted grey box, as plain data for tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, ndtri

from emsid.errors import ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.threads import one_blas_thread
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError, threads_for
from emsid.models.plants.initial_state import begun
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant, StaticCharacteristic
from emsid.models.plants.search.result import GreyBoxFit
from emsid.presentation import Presented
from emsid.record.frames import frame

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Curve(Presented):
    """A characteristic with its confidence band.

    Attributes:
        x, y: (n,) the curve.
        low, high: (n,) its band.
        support: (n,) how many samples of the record lie nearest to each point.
        of: the model.
        axes: name and unit of x and of y.
    """

    x: Array
    y: Array
    low: Array
    high: Array
    support: NDArray[np.int64]
    of: str
    axes: tuple[tuple[str, str], tuple[str, str]]

    def __repr__(self) -> str:
        return f"Curve({self.of}: {self.axes[1][0].lower()}, {len(self.x)} points)"

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with ``x``, ``y``, the ends of the band, and the support.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        return frame({name: getattr(self, name) for name in ("x", "y", "low", "high", "support")}, library)


class Stop(NamedTuple):
    """A period in which friction holds the simulated motor.

    Attributes:
        segment: where in the ``segments`` of the fit; its ``name`` is that of the record.
        start, end: first and last sample held, in s, in the time of that segment.
    """

    segment: int
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class Profile:
    """The likelihood of a parameter, all others at their best for each of its values.

    Attributes:
        name, unit: of the parameter.
        estimate, standard_error: of the fit; near the estimate the deviance is ((value − estimate)/standard error)².
            For an estimate at a bound, the standard error is the one without the bound.
        values: (n,) the values tried, the estimate among them, ascending.
        deviance: (n,) 2·(log L_max − log L), corrected for colour of the residual; χ² with one degree of freedom.
        interval: where the deviance stays below the limit, up to a bound of the parameter; infinite where it still does
            at the last value tried.
        level: of that interval.
    """

    name: str
    unit: str
    estimate: float
    standard_error: float
    values: Array
    deviance: Array
    interval: tuple[float, float]
    level: float

    @property
    def limit(self) -> float:
        """The quantile of χ² with one degree of freedom at the level."""
        return float(chdtri(1, 1 - self.level))

    def between(self, x: Array) -> Array:
        """The deviance at (m,) values; its signed root is interpolated linearly between those tried."""
        best = np.argmin(self.deviance)
        root = np.sign(self.values - self.values[best]) * np.sqrt(self.deviance)
        return np.asarray(np.interp(x, self.values, root)) ** 2

    def to_data(self) -> dict[str, Any]:
        """What a file holds."""
        arrays = {"values": self.values.tolist(), "deviance": self.deviance.tolist(), "interval": list(self.interval)}
        named = {name: getattr(self, name) for name in ("name", "unit", "estimate", "standard_error", "level")}
        return named | arrays


def friction_curve(fit: GreyBoxFit, points: int = 201, level: float = 0.95) -> Curve:
    """Friction over speed, including the viscous part: N·m over rad/s, or N over m/s.

    Args:
        fit: of a plant that declares its friction.
        points: an odd number puts one at rest.
        level: of the band, by the covariance to first order.

    Raises:
        ModelError: for a plant whose friction or motion is not known, or a fit from a file, which has no records.
    """
    if fit.model.plant.friction_characteristic() is None:
        raise ModelError(f"{fit.model.name} declares no friction")
    _check_records(fit)
    speeds = np.concatenate([_speeds(fit, k) for k in range(len(fit.segments))])
    reach = float(np.max(np.abs(speeds))) or 1.0
    x = np.linspace(-reach, reach, points)
    return _with_band(fit, x, lambda each: each.friction_characteristic(), speeds[speeds != 0], level)


def _check_records(fit: GreyBoxFit) -> None:
    """Refuse a fit without the records that it was fitted to.

    Raises:
        ModelError: for such a fit.
    """
    if not hasattr(fit, "segments"):
        raise ModelError(f"{fit.model.name} comes from a file, which has no records to show a curve over; fit it again")


def dead_zone_curve(fit: GreyBoxFit, points: int = 201, level: float = 0.95) -> Curve | None:
    """The output of the dead zone over its input, in V (N for an axis); None for a plant without one.

    Args:
        fit: of a plant.
        points: of the curve.
        level: of the band, by the covariance to first order.

    Raises:
        ModelError: for a fit from a file, which has no records.
    """
    plant = fit.model.plant
    if plant.dead_zone_characteristic() is None or not isinstance(plant, DrivenPlant):
        return None
    _check_records(fit)
    applied = np.concatenate([plant.drive.applied(s.input)[0] for s in fit.segments])
    reach = float(np.max(np.abs(applied))) or 1.0
    x = np.linspace(-reach, reach, points)
    return _with_band(fit, x, lambda each: each.dead_zone_characteristic(), applied, level, absent=x)


def cogging_curve(fit: GreyBoxFit, points: int = 721, level: float = 0.95) -> Curve | None:
    """Cogging over a turn, in N·m over rad; None for a plant without it.

    Args:
        fit: of a plant.
        points: of the curve.
        level: of the band, by the covariance to first order.

    Raises:
        ModelError: for a fit from a file, which has no records.
    """
    plant = fit.model.plant
    if plant.cogging_characteristic() is None:
        return None
    _check_records(fit)
    x = np.linspace(0.0, 2 * np.pi, points)
    angles = [
        plant.for_segment(each).simulate(each.input, each.dt, state, (Signal.POSITION,))[:, 0]
        for each, state in zip(fit.segments, fit.states, strict=True)
    ]
    return _with_band(
        fit, x, lambda each: each.cogging_characteristic(), np.mod(np.concatenate(angles), 2 * np.pi), level
    )


def stops(fit: GreyBoxFit) -> tuple[Stop, ...]:
    """The periods in which the simulated motor or axis itself sticks, without the sensor, segment by segment."""
    found = []
    for k, segment in enumerate(fit.segments):
        held = np.concatenate([[False], _speeds(fit, k) == 0.0, [False]])
        starts, ends = np.flatnonzero(~held[:-1] & held[1:]), np.flatnonzero(held[:-1] & ~held[1:])
        times = segment.time
        found += [Stop(k, float(times[a]), float(times[b - 1])) for a, b in zip(starts, ends, strict=True)]
    return tuple(found)


DISTANCES = (0.75, 1.5, 2.25, 3.0, 6.0, 12.0, 24.0)
"""Distances from the estimate at which a profile is computed, in standard errors; beyond `REACH` only until the limit
is passed."""
REACH = 3.0
PATIENT = 0.01
"""A point of a profile is exact enough if several more steps would change its deviance by this part of the limit."""


@one_blas_thread()
def likelihood_profile(fit: GreyBoxFit, name: str, level: float = 0.95, control: Control = FREE) -> Profile:
    """The profile of one estimated parameter, step by step away from its estimate.

    Every point is a fit of all other parameters and the initial states, begun where the one before it ended. The
    deviance 2·(V − V_min)/σ² is divided by the ratio of the robust variance to that for a white residual. At a bound
    there is no such ratio, and the largest one of the other parameters is used. Venzon, Moolgavkar, *A method for
    computing profile-likelihood-based confidence intervals*, Applied Statistics 37 (1988).

    Args:
        fit: of any plant.
        name: of the parameter.
        level: of the interval.
        control: when to stop, and where to report every fit.

    Raises:
        Stopped: where ``control`` stops it.
        ModelError: for a parameter that was not estimated, or without effect at its value.
    """
    if name not in fit.names:
        raise ModelError(f"{name} was not estimated; profiles can be had of {', '.join(fit.names) or 'none'}")
    k = fit.names.index(name)
    best, error, colour = float(fit.estimate[k]), float(fit.standard_error[k]), float(fit.colour[k])
    error = float(np.sqrt(max(error**2 - fit.of_held[k], 0.0)))  # the likelihood knows no tolerance of held values
    if error == 0 and best in fit.limits[name]:
        error, colour = _error_if_free(fit, k), float(np.max(fit.colour))
    if not 0 < error < np.inf:
        raise ModelError(f"{name} has no finite standard error, so there is no range to take a profile over")
    low, high = fit.limits[name]
    limit, unit = float(chdtri(1, 1 - level)), fit.noise_variance * colour / 2
    least_saving = PATIENT * limit * unit / fit.cost if fit.cost > 0 else 0.0
    costs = {best: fit.cost}
    for side, bound in ((-1, low), (1, high)):
        plant, value = fit.model.plant, best
        states: Sequence[Array] = fit.states
        for done, step in enumerate(DISTANCES):
            passed = costs[value] - min(costs.values()) > limit * unit
            if value == bound or (passed and step > REACH):
                break
            control.doing(f"profile of {name}", done + (side > 0) * len(DISTANCES), 2 * len(DISTANCES))
            value = float(np.clip(best + side * step * error, low, high))
            moved = plant.with_values({name: value})
            costs[value], plant, states = _others_at_their_best(fit, moved, name, states, least_saving, control)
    for end in _below(*_profile(costs, unit), limit, (low, high)):  # between points far apart it is only a first value
        if np.isfinite(end) and end not in costs:
            moved = fit.model.plant.with_values({name: end})
            costs[end] = _others_at_their_best(fit, moved, name, fit.states, least_saving, control)[0]
    values, deviance = _profile(costs, unit)
    interval = _below(values, deviance, limit, (low, high))
    return Profile(name, fit.model.plant.handles[name].parameter.unit, best, error, values, deviance, interval, level)


def _error_if_free(fit: GreyBoxFit, k: int) -> float:
    """The standard error of an estimate at a bound, as if it were free: the scale of the steps of its profile."""
    problem = _problem(fit, fit.model.plant, fit.names, fit.states)
    slopes = np.vstack([jacobian for _, jacobian in problem.exactly(problem.start)]) * problem.sizes
    others = np.delete(slopes, k, axis=1)
    alone = slopes[:, k] - others @ np.linalg.lstsq(others, slopes[:, k])[0]
    size = float(np.linalg.norm(alone))
    return float(np.sqrt(fit.noise_variance)) * float(problem.sizes[k]) / size if size > 0 else np.inf


def _problem(fit: GreyBoxFit, plant: Plant, free: Sequence[str], states: Sequence[Array]) -> FreeRunError:
    """The problem of the fit with another start and some of its parameters."""
    signals = fit.model.signals
    first, unknown = begun(plant, signals, fit.segments, fit.begins, states)
    return FreeRunError(plant, signals, fit.segments, free, first, unknown, fit.weighting, threads_for(fit.segments))


def _profile(costs: Mapping[float, float], unit: float) -> tuple[Array, Array]:
    """Values, ascending, and their deviance, from V at each of them."""
    values = np.array(sorted(costs))
    cost = np.array([costs[value] for value in values])
    return values, (cost - cost.min()) / unit


def _others_at_their_best(
    fit: GreyBoxFit, plant: Plant, name: str, states: Sequence[Array], least_saving: float, control: Control
) -> tuple[float, Plant, Sequence[Array]]:
    """V, plant and initial states after all other parameters are estimated again, with one parameter fixed."""
    problem = _problem(fit, plant, [other for other in fit.names if other != name], states)
    lower, upper = problem.within(fit.limits)
    found = gauss_newton(
        problem,
        problem.start,
        lower=lower,
        upper=upper,
        least_saving=least_saving,
        names=problem.names,
        covariances=False,
        control=control,
    )
    if found.ending is Ending.INTERRUPTED:  # a fit cut short is no point of a profile
        raise Stopped(found.ending)
    return found.cost, problem.plant_at(found.estimate), problem.states(found.estimate)


def _below(x: Array, deviance: Array, limit: float, bounds: tuple[float, float]) -> tuple[float, float]:
    """Where the deviance, with its root interpolated linearly, crosses the limit left and right of its minimum."""
    root, best = np.sqrt(deviance / limit), int(np.argmin(deviance))
    ends = []
    for side, bound in ((-1, bounds[0]), (1, bounds[1])):
        outwards = slice(best, None, side)
        xs, roots = x[outwards], root[outwards]
        beyond = np.flatnonzero(roots >= 1)
        if len(beyond):
            a, b = beyond[0] - 1, beyond[0]
            ends.append(float(xs[a] + (xs[b] - xs[a]) * (1 - roots[a]) / (roots[b] - roots[a])))
        else:
            ends.append(bound if xs[-1] == bound else side * np.inf)
    return ends[0], ends[1]


def _speeds(fit: GreyBoxFit, segment: int) -> Array:
    """(N,) the speed of the plant itself in rad/s or m/s: a sensor with lag or offset never shows a standstill."""
    record, plant = fit.segments[segment], fit.model.plant
    speeds = plant.for_segment(record).motion(record.input, record.dt, fit.states[segment])
    if speeds is None:
        raise ModelError(f"{plant.name} has no friction or dead zone that emsid knows")
    return speeds


def _with_band(
    fit: GreyBoxFit,
    x: Array,
    of: Callable[[Plant], StaticCharacteristic | None],
    seen: Array,
    level: float,
    absent: Array | float = 0.0,
) -> Curve:
    """The characteristic that the plant of a fit has, over x; one without it has ``absent`` there."""

    def law(plant: Plant) -> Array:
        found = of(plant)
        return np.full(x.shape, absent) if found is None else found.law(x)

    plant = fit.model.plant
    declared, y = of(plant), law(plant)
    assert declared is not None
    slopes = np.zeros((len(fit.names), len(x)))
    for k, name in enumerate(fit.names):
        value = plant.value(name)
        low, high = fit.limits[name]
        step = 1e-6 * max(abs(value), 1e-9)
        below, above = max(value - step, low), min(value + step, high)
        slopes[k] = (law(plant.with_values({name: above})) - law(plant.with_values({name: below}))) / (above - below)
    variance = np.einsum("in,ij,jn->n", slopes, fit.covariance, slopes)
    half = float(ndtri(0.5 + level / 2)) * np.sqrt(np.maximum(variance, 0.0))
    edges = np.concatenate([[-np.inf], 0.5 * (x[1:] + x[:-1]), [np.inf]])
    support = np.histogram(seen, edges)[0].astype(np.int64)
    return Curve(x, y, y - half, y + half, support, fit.model.name, (declared.x, declared.y))
