r"""Which motor differs from its fleet, and which has changed, with a stated rate of false alarms.

The estimates xᵢ of healthy motors lie about a centre μ, the median, with a deviation D, the normalised median absolute
deviation, which worn motors do not decide as long as they are fewer than half (Rousseeuw and Croux, *Alternatives to
the median absolute deviation*, 1993). D includes the error of a typical estimate, of variance s²; what is left of it,
τ², is the spread of the motors. An estimate that is less certain than others is judged by its own variance sᵢ²::

    zᵢ = (xᵢ − μ) / √max(D², τ² + sᵢ²)        τ² = max(D² − median(s²), 0)

A motor is named where |z| exceeds the limit that all motors and parameters of a healthy fleet together exceed with
probability α (Bonferroni). The t distribution allows for D being estimated: its degrees of freedom are the share
`EFFICIENCY` of the motors, as the median absolute deviation uses so much of the data.

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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.uncertainty.intervals import HALF_WIDTH
from emsid.fleets.work import FleetRow

Array = NDArray[np.float64]

ALPHA = 0.05
"""The probability that a healthy fleet has any motor named, for differences and for changes each."""
FEWEST_MOTORS = 8
"""With fewer motors their spread is not known well enough: half of them say what is ordinary."""
FEWEST_PERIODS, EITHER_SIDE = 5, 2
"""The shortest series that is looked at for a change, and the periods before and after one."""
EFFICIENCY = 0.37
"""The efficiency of the median absolute deviation for normal data (Rousseeuw and Croux 1993)."""
NORMAL_MEDIAN = 0.6744897501960817
"""The median of |z| of the normal distribution."""


@dataclass(frozen=True)
class Spread:
    """What is ordinary in a fleet for a parameter.

    Attributes:
        centre: μ.
        deviation: D, the standard deviation of the estimates of healthy motors.
        of_motors: τ, the part of it that the errors of the estimates do not explain.
        limit: of |z|.
    """

    centre: float
    deviation: float
    of_motors: float
    limit: float

    @classmethod
    def of(cls, values: Array, errors: Array, limit: float) -> Spread:
        """The spread of values (m,) with standard errors (m,)."""
        centre = float(np.median(values))
        deviation = float(np.median(np.abs(values - centre))) / NORMAL_MEDIAN
        rest = max(deviation**2 - float(np.median(errors**2)), 0.0)
        return cls(centre, deviation, float(np.sqrt(rest)), limit)

    def variances(self, errors: Array) -> Array:
        """The variance of estimates with these standard errors, about the centre."""
        least = max(self.deviation**2, float(np.finfo(float).tiny))
        variances: Array = np.maximum(self.of_motors**2 + errors**2, least)
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
    """

    parameter: str
    unit: str
    motors: tuple[str, ...]
    periods: tuple[str, ...]
    values: Array
    errors: Array

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
    """The motors that differ from their fleet, and what is ordinary, by parameter; the most different first."""
    found, ordinary = list[Outlier](), dict[str, Spread]()
    tests = max(sum(len(each.motors) for each in series), 1)
    for each in series:
        means, errors = each.of_motors
        known = np.isfinite(means)
        if known.sum() < FEWEST_MOTORS:
            continue
        limit = limit_of_motors(int(known.sum()), tests, alpha)
        usual = ordinary[each.parameter] = Spread.of(means[known], errors[known], limit)
        scores = usual.scores(means, errors)
        for k in np.flatnonzero(known & (np.abs(scores) > usual.limit)):
            half = HALF_WIDTH * float(errors[k])
            of = each.motors[k], each.parameter, each.unit, float(means[k]), half
            found.append(Outlier(*of, usual.centre, usual.deviation, float(scores[k])))
    return sorted(found, key=lambda one: -abs(one.score)), ordinary


def changes(series: Sequence[Series], alpha: float = ALPHA) -> list[Change]:
    """The motors that have changed, the clearest change first; at most one for each motor and parameter."""
    from scipy.special import ndtri

    long = [each for each in series if len(each.periods) >= FEWEST_PERIODS]
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
