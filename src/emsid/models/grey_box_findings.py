"""What a fitted grey box says, as plain data for tables and figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import chi2

from emsid.errors import ModelError
from emsid.models.grey_box_estimation import simulation_error
from emsid.models.grey_box_fit import GreyBoxFit
from emsid.models.plants import DrivenMotor, LinearAxis, Plant, Sensor, Signal
from emsid.plant import DeadZone
from emsid.record import concatenate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curve:
    """A characteristic with its confidence band.

    Attributes:
        x, y: (n,) the curve.
        low, high: (n,) its band.
        support: (n,) how many samples of the record lie nearest to each point.
    """

    x: Array
    y: Array
    low: Array
    high: Array
    support: NDArray[np.int64]


class Stop(NamedTuple):
    """A time in which friction holds the simulated motor.

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
        name: the parameter.
        values: (n,) its values.
        deviance: (n,) 2·(log L_max − log L), corrected for colour of the residual; χ² with one degree of freedom.
        interval: where the deviance stays below the quantile of the level, infinite where it does within the grid.
        level: of that interval.
    """

    name: str
    values: Array
    deviance: Array
    interval: tuple[float, float]
    level: float


def friction_curve(fit: GreyBoxFit, points: int = 201, level: float = 0.95) -> Curve:
    """Friction over speed, the viscous part included: N·m over rad/s, or N over m/s.

    Args:
        fit: of a motor or a linear axis.
        points: an odd number puts one at rest.
        level: of the band, by the covariance to first order.
    """
    plant = _mechanical(fit)
    speeds = np.concatenate([_speeds(fit, k) for k in range(len(fit.segments))])
    reach = float(np.max(np.abs(speeds))) or 1.0
    x = np.linspace(-reach, reach, points)
    return _with_band(fit, x, lambda p: _mechanical_plant(p).friction_torque(x), speeds[speeds != 0], level, plant)


def dead_zone_curve(fit: GreyBoxFit, points: int = 201, level: float = 0.95) -> Curve | None:
    """What comes through the dead zone over what is applied, in V (N of an axis); None for a plant without one."""
    plant = _mechanical(fit)
    if _dead_zone(plant) is None:
        return None
    applied = np.concatenate([plant.drive.terminals(s.input[:, 0], s.dt)[0] for s in fit.segments])
    reach = float(np.max(np.abs(applied))) or 1.0
    x = np.linspace(-reach, reach, points)

    def through(p: Plant) -> Array:
        zone = _dead_zone(_mechanical_plant(p))
        return x if zone is None else zone(x)

    return _with_band(fit, x, through, applied, level, plant)


def stops(fit: GreyBoxFit) -> tuple[Stop, ...]:
    """Where the simulated motor or axis sticks, whatever the sensor makes of it, segment by segment."""
    found = []
    for k, segment in enumerate(fit.segments):
        held = np.concatenate([[False], _speeds(fit, k) == 0.0, [False]])
        starts, ends = np.flatnonzero(~held[:-1] & held[1:]), np.flatnonzero(held[:-1] & ~held[1:])
        times = segment.time
        found += [Stop(k, float(times[a]), float(times[b - 1])) for a, b in zip(starts, ends, strict=True)]
    return tuple(found)


def likelihood_profile(fit: GreyBoxFit, name: str, points: int = 9, level: float = 0.95) -> Profile:
    """The profile of one estimated parameter, over three standard errors either way.

    Every point is a fit of all other parameters. The deviance is divided by how much colour inflates the variance, the
    ratio of the sandwich to the white variance.

    Raises:
        ModelError: for a parameter that was not estimated.
    """
    if name not in fit.names:
        raise ModelError(f"{name} was not estimated; profiles can be had of {', '.join(fit.names)}")
    k = fit.names.index(name)
    error = float(fit.standard_error[k])
    if not 0 < error < np.inf:
        raise ModelError(f"{name} has no finite standard error, so there is no range to take a profile over")
    low, high = fit.limits[name]
    values = np.clip(fit.estimate[k] + error * np.linspace(-3, 3, points), low, high)
    values = np.unique(values)
    record = concatenate(fit.segments)

    def cost(value: float) -> float:
        moved = fit.model.plant.put({name: value})
        bounds = {other: fit.limits[other] for other in fit.names} | {name: (value, value)}
        refit = simulation_error(
            moved, record, free=fit.names, bounds=bounds, signals=fit.model.signals, weighting=fit.weighting
        )
        return refit.cost

    costs = np.array([cost(float(v)) for v in values])
    lowest = min(float(costs.min()), fit.cost)
    deviance = 2 * (costs - lowest) / fit.noise_variance / fit.colour[k]
    limit = float(chi2.ppf(level, 1))
    return Profile(name, values, deviance, _below(values, deviance, float(fit.estimate[k]), limit), level)


def _below(x: Array, deviance: Array, best: float, limit: float) -> tuple[float, float]:
    """Where the deviance, straight in its root between points, crosses the limit left and right of the best value."""
    root, ends = np.sqrt(np.maximum(deviance, 0.0)), []
    for side in (-1, 1):
        here = np.flatnonzero(side * (x - best) > 0)[::side]
        before_x, before = best, 0.0
        end = side * np.inf
        for k in here:
            if root[k] >= np.sqrt(limit):
                end = before_x + (x[k] - before_x) * (np.sqrt(limit) - before) / (root[k] - before)
                break
            before_x, before = x[k], root[k]
        ends.append(float(end))
    return ends[0], ends[1]


def _mechanical(fit: GreyBoxFit) -> DrivenMotor | LinearAxis:
    return _mechanical_plant(fit.model.plant)


def _mechanical_plant(plant: Plant) -> DrivenMotor | LinearAxis:
    if not isinstance(plant, (DrivenMotor, LinearAxis)):
        raise ModelError(f"{plant.name} has no friction or dead zone that emsid knows of")
    return plant


def _dead_zone(plant: DrivenMotor | LinearAxis) -> DeadZone | None:
    return plant.motor.voltage_dead_zone if isinstance(plant, DrivenMotor) else plant.dead_zone


def _speeds(fit: GreyBoxFit, segment: int) -> Array:
    """(N,) how fast the plant itself moves, rad/s or m/s: a sensor that lags or is off never shows a standstill."""
    plant, record = replace(_mechanical(fit), sensor=Sensor()), fit.segments[segment]
    return plant.simulate(record.input, record.dt, fit.states[segment], (Signal.SPEED,))[:, 0]


def _with_band(
    fit: GreyBoxFit, x: Array, law: Callable[[Plant], Array], seen: Array, level: float, plant: Plant
) -> Curve:
    y = law(plant)
    slopes = np.zeros((len(fit.names), len(x)))
    for k, name in enumerate(fit.names):
        value = plant.value(name)
        low, high = fit.limits[name]
        step = 1e-6 * max(abs(value), 1e-9)
        below, above = max(value - step, low), min(value + step, high)
        slopes[k] = (law(plant.put({name: above})) - law(plant.put({name: below}))) / (above - below)
    variance = np.einsum("in,ij,jn->n", slopes, fit.covariance, slopes)
    half = float(ndtri(0.5 + level / 2)) * np.sqrt(np.maximum(variance, 0.0))
    edges = np.concatenate([[-np.inf], 0.5 * (x[1:] + x[:-1]), [np.inf]])
    return Curve(x, y, y - half, y + half, np.histogram(seen, edges)[0].astype(np.int64))
