r"""Which motor differs from its fleet, and which has changed, with a stated rate of false alarms.

The estimates xᵢ of healthy motors lie about a centre μ, the median, with a deviation D, the normalised median absolute
deviation, which worn motors do not decide as long as they are fewer than half (Rousseeuw and Croux, *Alternatives to
the median absolute deviation*, 1993). D includes the error of a typical estimate, of variance s²; what is left of it,
τ², is the spread of the motors. An estimate that is less certain than others is judged by its own variance sᵢ²::

    zᵢ = (xᵢ − μ) / √max(D², τ² + κ²·sᵢ²)        τ² = max(D² − median(s²), 0),   κ² = min(D²/median(s²), 1)

Errors larger than the deviation have a part that is the same in all motors, such as a friction that no record shows;
κ leaves it out.

A motor is named where |z| exceeds the limit that all motors and parameters of a healthy fleet together exceed with
probability α (Bonferroni). The t distribution allows for D being estimated: its degrees of freedom are the share
`EFFICIENCY` of the motors, as the median absolute deviation uses so much of the data.

The noise of a motor's sensor is compared likewise, by its logarithm and upwards only: it is the part of the error of
the free run that is new from sample to sample.

A motor that differs in several parameters may differ in one thing that scales them all: with dᵢ = ln(xᵢ/μᵢ) and the
powers eᵢ with which a cause scales every parameter, which follow from its unit, ::

    a = Σ eᵢ·dᵢ/vᵢ / Σ eᵢ²/vᵢ,      F = Σ (dᵢ − a·eᵢ)²/vᵢ / (n − 1)

and a cause is named where F is ordinary and that of every parameter alone is not. See `CAUSES`.

A change in time is a step after period k of a motor's series, whose mean levels before and after are compared::

    Zₖ = (x̄_after − x̄_before) / √(v_after + v_before)

with the variance of every period found in the same way, D now being the ordinary movement from period to period, from
the differences of neighbouring periods of all motors. What moves the whole fleet, as the temperature of a season does,
is taken away first: the median of all motors in every period. The largest |Zₖ| names motor and time, and the limit is
divided by the number of possible steps too. The detector of `emsid.estimation.linear.change_detection` is for streams
of samples whose variance it must learn; here every period has an uncertainty that is known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.estimates import HALF_WIDTH
from emsid.fleets.work import FleetRow, Value

Array = NDArray[np.float64]

ALPHA = 0.05
"""The probability that a healthy fleet has any motor named, for differences and for changes each."""
FEWEST_MOTORS = 8
"""With fewer motors their spread is not known well enough: half of them say what is ordinary."""
FEWEST_PERIODS, EITHER_SIDE = 5, 2
"""The shortest series that is looked at for a change, and the periods before and after one."""
EFFICIENCY = 0.37
"""The efficiency of the median absolute deviation for normal data (Rousseeuw and Croux 1993)."""
CAUSES: dict[str, dict[str, int]] = {
    "torque": dict.fromkeys(("kg*m^2", "N*m*s/rad", "N*m", "N*m/rad", "kg", "N*s/m", "N", "N/m"), 1),
    "angle": {"kg*m^2": 2, "N*m*s/rad": 2, "N*m": 1, "N*m/rad": 2, "N*m/A": 1, "s/rad": 1},
    "voltage": {"kg*m^2": 2, "N*m*s/rad": 2, "N*m": 2, "N*m/rad": 2, "N*m/A": 1, "V": 1},
}
"""With which power a cause scales a parameter, by its unit; no other parameter changes.

Let a model keep a resistance R₀ where a motor has R. Its equation J·dω/dt = K/R·(u − K·ω) − B·ω − τ then holds with all
torques, J, B and τ, times R/R₀ (``torque``; of an axis, by a drive of other gain). Where the angle is measured with
another gear or count, ω' = ω/g, it holds with g·K, g²·J, g²·B and g·τ (``angle``), and where the voltage is g·u, with
g·K, g²·J, g²·B, g²·τ and g times the dead zone (``voltage``).
"""
NORMAL_MEDIAN = 0.6744897501960817
"""The median of |z| of the normal distribution."""
NOISE = "noise of the output"
"""The name of the noise among the parameters."""


@dataclass(frozen=True)
class Spread:
    """What is ordinary in a fleet for a parameter.

    Attributes:
        centre: μ.
        deviation: D, the standard deviation of the estimates of healthy motors.
        of_motors: τ, the part of it that the errors of the estimates do not explain.
        limit: of |z|.
        of_errors: κ, the part of the errors of the estimates that differs from motor to motor.
    """

    centre: float
    deviation: float
    of_motors: float
    limit: float
    of_errors: float = 1.0

    @classmethod
    def of(cls, values: Array, errors: Array, limit: float) -> Spread:
        """The spread of values (m,) with standard errors (m,)."""
        centre = float(np.median(values))
        deviation = float(np.median(np.abs(values - centre))) / NORMAL_MEDIAN
        typical = float(np.median(errors**2))
        part = min(deviation / np.sqrt(typical), 1.0) if typical else 1.0
        return cls(centre, deviation, float(np.sqrt(max(deviation**2 - typical, 0.0))), limit, float(part))

    def variances(self, errors: Array) -> Array:
        """The variance of estimates with these standard errors, about the centre."""
        least = max(self.deviation**2, float(np.finfo(float).tiny))
        variances: Array = np.maximum(self.of_motors**2 + (self.of_errors * errors) ** 2, least)
        return variances

    def scores(self, values: Array, errors: Array) -> Array:
        """(m,) z of every motor."""
        scores: Array = (values - self.centre) / np.sqrt(self.variances(errors))
        return scores


@dataclass(frozen=True)
class Outlier:
    """A motor that differs from its fleet in a parameter.

    Attributes:
        motor, parameter, unit: which.
        value, half_width: of the motor, with half the width of its 95 % interval.
        centre, deviation: of the fleet.
        score: z.
    """

    motor: str
    parameter: str
    unit: str
    value: float
    half_width: float
    centre: float
    deviation: float
    score: float


@dataclass(frozen=True)
class Cause:
    """One thing in which a motor differs, that explains all that differs in its parameters.

    Attributes:
        motor: which.
        causes: of `CAUSES`, the likeliest first; several where the estimates do not tell them apart.
        factor: by which the likeliest scales.
        parameters: the parameters that differ.
        ratios: of all parameters that the likeliest scales, to the centre of the fleet.
    """

    motor: str
    causes: tuple[str, ...]
    factor: float
    parameters: tuple[str, ...]
    ratios: Mapping[str, float]


@dataclass(frozen=True)
class Change:
    """A motor that has changed.

    Attributes:
        motor, parameter, unit: which.
        since: the first period after the change.
        before, after: the mean levels.
        half_width: of their difference, half its 95 % interval.
        score: Z.
    """

    motor: str
    parameter: str
    unit: str
    since: str
    before: float
    after: float
    half_width: float
    score: float


@dataclass(frozen=True, eq=False)
class Series:
    """The estimates of a parameter of all motors over all periods.

    Attributes:
        parameter, unit: which.
        motors, periods: the names of rows and columns.
        values, errors: (m, T) estimates and standard errors; NaN where there is none.
        noise: whether it is a size of noise, which is compared by its logarithm, and of which less is no fault.
    """

    parameter: str
    unit: str
    motors: tuple[str, ...]
    periods: tuple[str, ...]
    values: Array
    errors: Array
    noise: bool = False

    @property
    def of_motors(self) -> tuple[Array, Array]:
        """(m,) the weighted mean of every motor over its periods, and its standard error; NaN without an estimate."""
        exact = not np.any(self.errors > 0)
        variance = np.ones_like(self.errors) if exact else np.maximum(self.errors, 1e-150) ** 2
        weights = np.where(np.isfinite(self.values), 1 / variance, 0.0)
        total = weights.sum(axis=1)
        known = total > 0
        safe = np.where(known, total, 1.0)
        means = (weights * np.nan_to_num(self.values)).sum(axis=1) / safe
        errors = np.zeros(len(safe)) if exact else 1 / np.sqrt(safe)
        return np.where(known, means, np.nan), np.where(known, errors, np.nan)


def series_of(rows: Sequence[FleetRow]) -> list[Series]:
    """The estimates of every parameter as tables of motors and periods; estimates without intervals have no error."""
    good = [row for row in rows if not row.reason]
    motors, periods = (tuple(sorted({key(row) for row in good})) for key in (_motor, _period))
    at = {name: k for k, name in enumerate(motors)}, {name: k for k, name in enumerate(periods)}
    found: dict[str, Series] = {}
    for row in good:
        for name, estimate in row.estimates.items():
            if name not in found:
                empty = np.full((2, len(motors), len(periods)), np.nan)
                found[name] = Series(name, estimate.unit, motors, periods, empty[0], empty[1])
            place = at[0][row.motor], at[1][row.period]
            found[name].values[place] = estimate.value
            found[name].errors[place] = estimate.half_width / HALF_WIDTH
    return [_with_errors(each) for each in found.values()]


def noise_of(rows: Sequence[FleetRow]) -> Series:
    """The noise of every motor over the periods, as the estimate of n independent samples."""
    parameters = [
        replace(
            row,
            estimates={NOISE: Value(row.noise, HALF_WIDTH * row.noise / (2 * max(row.samples, 1)) ** 0.5, row.unit)},
        )
        for row in rows
    ]
    return replace(*series_of(parameters), noise=True)


def _motor(row: FleetRow) -> str:
    return row.motor


def _period(row: FleetRow) -> str:
    return row.period


def _with_errors(series: Series) -> Series:
    """Estimates of unknown error are left out beside others that have one, and count as exact where none has."""
    known = np.isfinite(series.errors)
    values = np.where(known, series.values, np.nan) if known.any() else series.values
    return Series(
        series.parameter, series.unit, series.motors, series.periods, values, np.where(known, series.errors, 0.0)
    )


def limit_of_motors(motors: int, tests: int, alpha: float) -> float:
    """The limit of |z| that any of the tests of a healthy fleet exceeds with probability α."""
    from scipy.special import stdtrit

    return float(stdtrit(max(EFFICIENCY * (motors - 1), 1.0), 1 - alpha / (2 * tests)))


def outliers(series: Sequence[Series], alpha: float = ALPHA) -> tuple[list[Outlier], dict[str, Spread]]:
    """The motors that differ from their fleet, and what is ordinary, by parameter; the most different first.

    The deviation of a noise is that of its logarithm, times the centre.
    """
    found, ordinary = list[Outlier](), dict[str, Spread]()
    tests = max(sum(len(each.motors) for each in series), 1)
    for each in series:
        means, errors = each.of_motors
        known = np.isfinite(means) & ((means > 0) | (not each.noise))
        if known.sum() < FEWEST_MOTORS:
            continue
        shown = means
        if each.noise:
            means, errors = (np.where(known, part, 1.0) for part in (means, errors))
            means, errors = np.log(means), errors / means
        limit = limit_of_motors(int(known.sum()), tests, alpha)
        usual = ordinary[each.parameter] = Spread.of(means[known], errors[known], limit)
        scores = usual.scores(means, errors)
        if each.noise:
            centre = float(np.exp(usual.centre))
            sizes = centre, centre * usual.deviation, centre * usual.of_motors
            usual = ordinary[each.parameter] = Spread(*sizes, usual.limit, usual.of_errors)
        for k in np.flatnonzero(known & ((scores if each.noise else np.abs(scores)) > usual.limit)):
            half = HALF_WIDTH * float(errors[k]) * (float(shown[k]) if each.noise else 1.0)
            of = each.motors[k], each.parameter, each.unit, float(shown[k]), half
            found.append(Outlier(*of, usual.centre, usual.deviation, float(scores[k])))
    return sorted(found, key=lambda one: -abs(one.score)), ordinary


def causes(series: Sequence[Series], found: Sequence[Outlier], ordinary: Mapping[str, Spread]) -> list[Cause]:
    """The causes of motors that differ in several parameters, where one explains all; in the order of the outliers."""
    from scipy.special import fdtri

    compared = [each for each in series if not each.noise and each.parameter in ordinary]
    result = []
    for motor in dict.fromkeys(each.motor for each in found):
        named = tuple(each.parameter for each in found if each.motor == motor)
        rows = []
        for each in compared:
            (value,), (error,) = (part[[each.motors.index(motor)]] for part in each.of_motors)
            usual = ordinary[each.parameter]
            if usual.centre * value > 0:
                variance = float(usual.variances(np.array([error]))[0]) / usual.centre**2
                rows.append((each.parameter, each.unit, float(value / usual.centre), variance))
        if not set(named) <= {name for name, *_ in rows} or len(rows) < 2:
            continue
        names, units, ratios, variances = zip(*rows, strict=True)
        d, weights = np.log(ratios), 1 / np.array(variances)
        motors = int(np.isfinite(compared[0].of_motors[0]).sum())
        most = float(fdtri(len(d) - 1, max(EFFICIENCY * (motors - 1), 1.0), 1 - ALPHA)) * (len(d) - 1)
        alone = [np.array([name == other for other in names], dtype=float) for name in names]
        by_unit = {cause: np.array([powers.get(unit, 0) for unit in units]) for cause, powers in CAUSES.items()}
        able = {cause: powers for cause, powers in by_unit.items() if np.count_nonzero(powers) > 1}
        left = {cause: _unexplained(d, powers, weights) for cause, powers in able.items()}
        likely = sorted((cause for cause in left if left[cause][0] <= most), key=lambda cause: left[cause][0])
        if not likely or min(_unexplained(d, powers, weights)[0] for powers in alone) <= most:
            continue
        same = tuple(cause for cause in likely if left[cause][0] <= left[likely[0]][0] + HALF_WIDTH**2)
        scaled = {name: ratio for name, ratio, power in zip(names, ratios, able[same[0]], strict=True) if power}
        result.append(Cause(motor, same, float(np.exp(left[same[0]][1])), named, scaled))
    return result


def _unexplained(d: Array, powers: Array, weights: Array) -> tuple[float, float]:
    """What a cause of these powers leaves of differences, in their variances, and its logarithm."""
    size = float(np.sum(weights * powers * d) / np.sum(weights * powers**2))
    return float(np.sum(weights * (d - size * powers) ** 2)), size


def long_enough(series: Sequence[Series]) -> list[Series]:
    """The series in which a motor has enough periods to tell whether it has changed."""
    return [each for each in series if (np.isfinite(each.values).sum(axis=1) >= FEWEST_PERIODS).any()]


def changes(series: Sequence[Series], alpha: float = ALPHA) -> list[Change]:
    """The motors that have changed, the clearest change first; at most one for each motor and parameter."""
    from scipy.special import ndtri

    long = long_enough(series)
    steps = sum(int(np.maximum(np.isfinite(each.values).sum(1) - 2 * EITHER_SIDE + 1, 0).sum()) for each in long)
    if not steps:
        return []
    limit = float(ndtri(1 - alpha / (2 * steps)))
    found = [change for each in long for change in _changes_of(each, limit)]
    return sorted(found, key=lambda one: -abs(one.score))


def _changes_of(series: Series, limit: float) -> list[Change]:
    values = series.values
    if np.isfinite(values).any(axis=1).sum() >= FEWEST_MOTORS:
        own = values - _nanmedian(values, axis=1)[:, None]
        values = values - np.nan_to_num(_nanmedian(own, axis=0))
    steps = np.diff(values, axis=1) / np.sqrt(2)
    errors = np.sqrt(0.5 * (series.errors[:, 1:] ** 2 + series.errors[:, :-1] ** 2))
    both = np.isfinite(steps)
    if not both.any():
        return []
    movement = Spread.of(steps[both], errors[both], limit)
    found = []
    for k, motor in enumerate(series.motors):
        there = np.flatnonzero(np.isfinite(values[k]))
        best = largest_step(values[k, there], movement.variances(series.errors[k, there]))
        if len(there) >= FEWEST_PERIODS and best is not None and abs(best[0]) > limit:
            score, at, before, after, error = best
            of = motor, series.parameter, series.unit, series.periods[there[at]]
            found.append(Change(*of, before, after, HALF_WIDTH * error, score))
    return found


def _nanmedian(values: Array, axis: int) -> Array:
    """The median without NaN; NaN where there is nothing."""
    empty = ~np.isfinite(values).any(axis=axis)
    result: Array = np.nanmedian(np.where(np.expand_dims(empty, axis), 0.0, values), axis=axis)
    return np.where(empty, np.nan, result)


def largest_step(x: Array, variance: Array) -> tuple[float, int, float, float, float] | None:
    """The clearest step of a series: Z, the index of the first value after it, both levels, their difference's error.

    Args:
        x: (T,) values.
        variance: (T,) of them.
    """
    weight = 1 / variance
    total, moment = np.cumsum(weight), np.cumsum(weight * x)
    at = np.arange(EITHER_SIDE, len(x) - EITHER_SIDE + 1)
    if not len(at):
        return None
    before, after = moment[at - 1] / total[at - 1], (moment[-1] - moment[at - 1]) / (total[-1] - total[at - 1])
    error = np.sqrt(1 / total[at - 1] + 1 / (total[-1] - total[at - 1]))
    scores = (after - before) / error
    best = int(np.argmax(np.abs(scores)))
    return float(scores[best]), int(at[best]), float(before[best]), float(after[best]), float(error[best])


def reasons(rows: Sequence[FleetRow]) -> Mapping[str, list[FleetRow]]:
    """The rows without a model by reason, the most frequent first; names of files and numbers do not tell apart."""
    import re

    found: dict[str, list[FleetRow]] = {}
    for row in rows:
        if row.reason:
            found.setdefault(re.sub(r"\S*[/\\]\S*|\d[\d.,e+-]*", "…", row.reason), []).append(row)
    return dict(sorted(found.items(), key=lambda item: -len(item[1])))
