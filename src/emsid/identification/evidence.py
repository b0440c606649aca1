"""What speaks for and against fitted models: how plausible they are, what the data leave open, and the residual.

What makes a fitted model implausible, whatever its error is on the data at hand.

A static map that turns or leaves the range of the output where there are hardly any data, poles faster than the
sampling, and a delay longer than the response of the drive are signs that the structure is too rich, or that it
imitates something else. So is a gain whose sign is not that of the response in the record. A pole that a zero nearly
cancels is a remark: the model is larger than it need be, and does what a smaller one does. A free run that diverges
on a larger input, on one that steps within its range, or while the largest or the smallest input is held, is another.

What the data leave open: models that fit them equally well and differ on other inputs of the same range.

An error on unseen data of the same experiment says how a model does on inputs of that kind. Models with equal errors
there may differ by many times their errors on steps, ramps or sines within the same range: then these data do not tell
which is right, and neither is supported by them. A two-level input, for instance, is described equally well by every
static map through two points.

So all models that were compared run over three *probes*: the beginning of the record, followed by levels that are held
for short and long times, by ramps between levels, and by sines, within `LOWER` of the range of each input. Only samples
count where the output of a model stays in the range of the record. A difference is measured in root mean squares of the
model's own error, e. Where the truth differs from the model by d·e, its error on the probe is √(1 + d²)·e; a supported
model is one that is expected to have at most `WITHIN` times its error there. Two differences stand for that of the
truth:

- that of another plausible model which is as good, within noise or in practice, or better;
- twice the standard error of the model itself, from its fits to parts of the data (the jackknife): a fit that lacks the
  share f of the data differs from that to all by (1/(1 − f) − 1)·v on average, where v is the variance of the latter.

**Static maps.** On unseen data, the input of a map may leave the range that it has in the data of the fit. A model may
stay within the range of its own input and still leave that of a map inside it, such as the displacement of a spring at
resonance. There the map is only a continuation.

Conclusions are findings: about the fitted models and the data, a verdict on the residual, and what to do next.

References:
    Efron, Stein, *The jackknife estimate of variance*, Annals of Statistics 9 (1981).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.borders import border
from emsid.estimation.fit import Fit
from emsid.findings import Finding, finite
from emsid.first_look.baseline import baseline
from emsid.first_look.examined import Response, response_of
from emsid.identification.ranking import Ranked, compared, deviations, within_noise
from emsid.identification.task import LONGEST_SEARCHED
from emsid.models.capabilities import MapInUse
from emsid.models.extrapolation import HELD, LARGER, Extremes, diverges, diverges_held, with_other_inputs
from emsid.models.free_run import free_run
from emsid.models.kinds import capabilities_of
from emsid.models.model import Model
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.diagnostics import Profile
from emsid.models.plants.search.result import has_physical_parameters
from emsid.record import Record
from emsid.record.holding_back import has_common_samples
from emsid.selection.improvement import NEGLIGIBLE, equivalent
from emsid.validation.comparison import FEWEST, Assessment, Comparison, models_noise, worst_region
from emsid.validation.correlation import autocorrelation, residual_tests

Array = NDArray[np.float64]

SPARSE = 0.002
"""A window of a map's input with a smaller share of the samples has hardly any data."""
WINDOW = 0.02
"""Half the width of that window, as a share of the range of the input."""
GRID = 200
"""Points at which a map is looked at, besides its knots."""
TURNS = 0.05
"""A map turns if it goes back by more than this share of its range over the data."""
FASTEST, IMMEDIATE = float(np.exp(-1.0)), 1e-3
"""A real pole below the first has a time constant shorter than the sample time; below the second it is a delay."""
CANCELS = 0.02
"""A zero this close to a pole, as a share of the distance of the pole to the unit circle, cancels it."""
RISE = 2.2
"""Rise time (10 to 90 %) over time constant of a first-order response."""

DIVERGES, DIVERGES_HELD = "diverges-beyond-range", "diverges-on-constant-input"
EXCLUDING = frozenset({DIVERGES, DIVERGES_HELD})
"""The findings that keep a model from being chosen; see `excluded_models` for the exception."""

IMPLAUSIBLE = frozenset(
    {
        DIVERGES,
        DIVERGES_HELD,
        "delay-longer-than-rise",
        "diverges-on-steps",
        "faster-than-sampling",
        "gain-of-other-sign",
        "knots-without-data",
        "map-leaves-range",
        "map-turns-without-data",
    }
)
"""The findings that make a model implausible."""


class Plausibility:
    """The checks of models that were fitted to one record.

    Args:
        record: what they were fitted to.
        whole: all data, where the record is a part of them.
    """

    def __init__(self, record: Record, whole: Record | None = None) -> None:
        self.record, self.whole = record, record if whole is None else whole

    @cached_property
    def extremes(self) -> Extremes:
        """Records with a larger input, and with the largest and the smallest input held for long."""
        return Extremes(self.record)

    @cached_property
    def steps(self) -> Record:
        """The beginning of the longest segment, whose input then steps between levels within its range."""
        return Probes(self.record).records[0]

    def findings(self, fit: Fit[Any]) -> list[Finding]:
        """Why a model is implausible, without what the fit itself has found."""
        model = fit.model
        if self.record.input.shape[1] != 1 or self.record.output.shape[1] != 1:
            return []
        found: list[Finding] = []
        kind = capabilities_of(model)
        if kind.may_run_away and diverges(model, self.extremes.larger):
            found.append(Finding(DIVERGES, model.name, {"factor": LARGER}))
        if kind.may_run_away and diverges_held(model, self.extremes):
            found.append(Finding(DIVERGES_HELD, model.name))
        if kind.may_run_away and free_run(model, self.steps).diverged_at is not None:
            found.append(Finding("diverges-on-steps", model.name))
        found += [each for used in kind.judged_maps(model, self.record) for each in self._of_map(model.name, used)]
        modes = kind.modes(model)
        for block, (poles, zeros) in modes.pairs.items():  # poles that a zero of the same block nearly cancels
            for pole in poles:
                near = any(abs(zero - pole) < CANCELS * max(1 - abs(pole), 1e-3) for zero in zeros)
                if near and pole.imag >= 0 and abs(pole) > IMMEDIATE:
                    of: dict[str, Any] = {"block": block} if block else {}
                    of |= {"pole": [float(pole.real), float(pole.imag)]}
                    found.append(Finding("zero-cancels-pole", "", of))
        # real poles whose time constant is shorter than the sample time
        fast = [float(pole.real) for pole in modes.poles if abs(pole.imag) < 1e-9 and IMMEDIATE < pole.real < FASTEST]
        if fast:
            data = {"pole": min(fast), "samples": float(-1 / np.log(min(fast)))}
            found.append(Finding("faster-than-sampling", "", data))
        found += [*self._too_late(modes.delay), *self._of_other_sign(model)]
        return [each.about(model.name) for each in found]

    def _of_map(self, name: str, used: MapInUse) -> Iterator[Finding]:
        """A map that turns, or leaves the range of the output, where its input has hardly any data."""
        x = used.input[np.isfinite(used.input)]
        if not len(x) or np.ptp(x) == 0 or used.output_at_rest is None:
            return
        grid = np.unique(np.concatenate([np.linspace(x.min(), x.max(), GRID), used.marks]))
        values, sparse = used.value(grid), _sparse(grid, x)
        if not sparse.any() or sparse.all() or not np.isfinite(values).all():
            return
        turn = _turn(values, sparse)
        if turn is not None:
            yield Finding("map-turns-without-data", name, {"block": used.number, "at": float(grid[turn])})
        y = self.record.output[:, 0]
        outputs = np.array([used.output_at_rest(float(value)) for value in values])
        beyond = np.where(sparse, np.maximum(outputs - y.max(), y.min() - outputs), -np.inf)
        worst = int(np.argmax(beyond))
        if beyond[worst] > np.ptp(y):
            data = {"block": used.number, "at": float(grid[worst]), "value": float(outputs[worst])}
            yield Finding("map-leaves-range", name, data | {"low": float(y.min()), "high": float(y.max())})

    def _too_late(self, delay: int) -> Iterator[Finding]:
        """A delay longer than the rise time of the record, and longer than the delay that the record shows."""
        if delay <= LONGEST_SEARCHED or self.rise is None:
            return
        if delay > self.rise:
            dt = self.record.dt
            yield Finding("delay-longer-than-rise", "", {"delay": delay * dt, "rise": self.rise * dt, "samples": delay})

    def _of_other_sign(self, model: Any) -> Iterator[Finding]:
        """A gain whose sign is not that of the response in the record.

        Its sign is that of the difference of two runs that begin alike, one with the largest input of the record held,
        and one with the smallest; a map that turns in between, as a magnitude, has none.
        """
        if self.response is None or not self.response.sign:
            return
        u = self.record.input
        levels = (u.min(), 0.5 * (u.min() + u.max()), u.max())
        inputs = (np.full((model.memory + HELD, 1), level) for level in levels)
        runs = [free_run(model, with_other_inputs(self.record, each)).output[-HELD // 2 :, 0] for each in inputs]
        halves = np.mean(np.diff(runs, axis=0), axis=1) / np.diff(levels)
        if np.all(self.response.sign * halves < 0):
            channels = {"input": self.record.input_names[0], "output": self.record.output_names[0]}
            yield Finding("gain-of-other-sign", "", channels | {"sign": -self.response.sign})

    @cached_property
    def response(self) -> Response | None:
        """How the output of all data answers their input."""
        return response_of(self.whole)

    @cached_property
    def rise(self) -> float | None:
        """Delay and rise time of the record in samples, by the small linear model of the first look."""
        linear = baseline(self.record, self.response.delay if self.response else None)
        if linear is None or not linear.fit > 0 or not np.isfinite(linear.time_constant):
            return None
        return RISE * linear.time_constant + linear.delay


def _sparse(grid: Array, x: Array) -> NDArray[np.bool_]:
    """(m,) where on a grid (m,) a signal x has hardly any values."""
    ordered, reach = np.sort(x), WINDOW * float(np.ptp(x))
    counts = np.searchsorted(ordered, grid + reach, "right") - np.searchsorted(ordered, grid - reach)
    return np.asarray(counts < SPARSE * len(x))


def _turn(values: Array, sparse: NDArray[np.bool_]) -> int | None:
    """The largest turn of a curve among its sparse points; None where it does not turn there."""
    enough = TURNS * float(np.ptp(values[~sparse]))
    rising = np.sign(np.diff(values))
    extremes = np.flatnonzero(rising[1:] * rising[:-1] < 0) + 1
    ends = np.concatenate([[0], extremes, [len(values) - 1]])
    sizes = {
        int(here): min(abs(values[here] - values[before]), abs(values[after] - values[here]))
        for before, here, after in zip(ends[:-2], ends[1:-1], ends[2:], strict=True)
        if sparse[here]
    }
    worst = max(sizes, key=lambda k: sizes[k], default=None)
    return worst if worst is not None and sizes[worst] > enough else None


Reason = dict[str, Any]

WITHIN = 1.3
"""A supported model has at most this many times its error on other inputs of the range: 30 % more is still of the same
size, and the difference of the models is then as large as the error."""
LARGEST = sqrt(WITHIN**2 - 1)
"""The difference from the truth, over the error, at which the error is `WITHIN` times as large."""
LOWER = 0.8
"""The range of the probes over that of the record; near the ends of the range there are few data."""
SAMPLES = 1_500
"""Of a probe: fifteen levels of a hundred samples on average. Chosen, not measured."""
SHORTEST, LONGEST = 3, 8
"""A level is held for at least the first number of samples, and for at most the probe divided by the second."""
SINES = 20
"""Sines of a probe, from one period in it to a tenth of the sampling frequency."""
FEW_LEVELS = 3
"""So many input levels are on a parabola, so they do not tell a straight line from a curve with a turn in between."""
TWO_LEVELS = 2
"""So many are on a straight line and on every curve, so they do not show that a system is linear either."""
LEAST = 1e-3
"""A difference is compared with at least this share of the deviation of the output; smaller ones are of no use."""


@dataclass(frozen=True, eq=False)
class Probes:
    """Other inputs within the range of a record.

    Attributes:
        record: what models were fitted to.
    """

    record: Record

    @cached_property
    def records(self) -> tuple[Record, ...]:
        """The beginning of the longest segment with each of the inputs behind it, see `with_other_inputs`."""
        low, high = (end(self.record.input, axis=0) for end in (np.min, np.max))
        middle, half = 0.5 * (low + high), 0.5 * LOWER * (high - low)
        waves = _waves(np.random.default_rng(1), len(middle))
        return tuple(with_other_inputs(self.record, middle + half * wave) for wave in waves)

    @cached_property
    def scale(self) -> Array:
        """(ny,) the deviation of every output; one where it is constant."""
        return deviations(self.record.output)

    def outputs(self, model: Model) -> Array | None:
        """(3, `SAMPLES`, ny) the outputs of a model over the probes, over their deviations; None where it diverges."""
        found = []
        for each in self.records:
            run = None
            with border(f"run of {model.name} with other inputs", model.name, expected=True):
                run = model.simulate(each)
            if run is None:
                return None
            if run.diverged_at is not None:
                return None
            found.append(run.output[-SAMPLES:] / self.scale)
        return np.stack(found)

    def seen(self, outputs: Array) -> NDArray[np.bool_]:
        """(3, `SAMPLES`) where every output is in the range of the record."""
        low, high = (end(self.record.output, axis=0) / self.scale for end in (np.min, np.max))
        return np.asarray(((outputs >= low) & (outputs <= high)).all(axis=-1))

    def difference(self, own: Array, other: Array) -> float:
        """The largest root mean square difference of two models over a probe, where the first is in the range."""
        seen = self.seen(own)
        squares = np.mean((other - own) ** 2, axis=-1)
        several = [float(np.mean(each[where])) for each, where in zip(squares, seen, strict=True) if where.any()]
        return sqrt(max(several, default=0.0))


def _waves(rng: np.random.Generator, inputs: int) -> tuple[Array, Array, Array]:
    """(`SAMPLES`, nu) levels, ramps and sines between −1 and 1."""
    times = [0.0]
    while times[-1] < SAMPLES:
        times.append(times[-1] + np.exp(rng.uniform(np.log(SHORTEST), np.log(SAMPLES / LONGEST))))
    values, t = rng.uniform(-1, 1, (len(times), inputs)), np.arange(SAMPLES)
    levels = values[np.searchsorted(times, t, "right") - 1]
    ramps = np.stack([np.interp(t, times, each) for each in values.T], axis=1)
    frequencies = np.exp(rng.uniform(np.log(1 / SAMPLES), np.log(0.1), SINES))
    turns = frequencies[:, None] * t + rng.random((inputs, SINES, 1))
    waves = np.sum(np.sin(2 * np.pi * turns) / np.sqrt(frequencies)[:, None], axis=1).T
    return levels, ramps, waves / np.abs(waves).max(axis=0)


def few_levels(record: Record) -> int | None:
    """The number of input levels, if there are so few that they do not show a nonlinearity; else None."""
    counts = [len(np.unique(np.round(u / np.ptp(u), 3))) for u in record.input.T if np.ptp(u) > 0]
    return max(counts) if counts and max(counts) <= FEW_LEVELS else None


@dataclass(frozen=True, eq=False)
class Undetermined:
    """What the data leave open about every model that was compared.

    Attributes:
        reasons: by model, why it cannot be supported; not in the table for a model without such a reason.
        straight: the names of the models that are linear over the probes, as far as their error shows.
        levels: the number of input levels, where there are few; else None.
    """

    reasons: Mapping[str, list[Reason]]
    straight: frozenset[str]
    levels: int | None

    @classmethod
    def of(cls, ranking: Sequence[Ranked], record: Record, excluded: Collection[str] = ()) -> Undetermined:
        """What is open after a ranking.

        Args:
            ranking: the models with their errors.
            record: what they were fitted to.
            excluded: names of models that are no rival of another, as they cannot be used or are implausible.
        """
        probes, levels = Probes(record), few_levels(record)
        own = {each.name: probes.outputs(each.refit or each.fit.model) for each in compared(ranking)}
        known = [each for each in compared(ranking) if own[each.name] is not None]
        rivals = [each for each in known if each.name not in excluded]
        reasons: dict[str, list[Reason]] = {}
        straight = set()
        for each in known:
            y = own[each.name]
            assert y is not None
            error = max(sqrt(each.errors.mean), LEAST) if np.isfinite(each.errors.mean) else np.inf
            found = []
            with border(f"comparison of {each.name} with other inputs", each.name):
                found += _of_rivals(each, [(one, own[one.name]) for one in rivals if one is not each], y, error, probes)
                found += _of_itself(each, y, error, probes)
                linear = _bend(each.refit or each.fit.model, probes) <= LARGEST * error
                straight |= {each.name} if linear else set()
                if levels is not None and not (linear and levels > TWO_LEVELS):
                    found.append({"code": "few-levels", "levels": levels})
            if found:
                reasons[each.name] = found
        return cls(reasons, frozenset(straight), levels)


def _of_rivals(
    model: Ranked, rivals: Sequence[tuple[Ranked, Array | None]], own: Array, error: float, probes: Probes
) -> list[Reason]:
    """That a model which is as good differs on the probes, the most different one."""
    found = {
        one.name: probes.difference(own, y) / error
        for one, y in rivals
        if y is not None and (equivalent(one.errors, model.errors) or within_noise(one, model))
    }
    worst = max(found, key=found.__getitem__, default=None)
    if worst is None or found[worst] <= LARGEST:
        return []
    return [{"code": "another-differs", "other": worst, "times": found[worst]}]


def _of_itself(model: Ranked, own: Array, error: float, probes: Probes) -> list[Reason]:
    """That fits of a model to parts of the data differ on the probes, by much of its error or of its own response."""
    squares = []
    for share, again in model.parts:
        y = probes.outputs(again)
        if y is None:
            return [{"code": "parts-differ", "times": None}]
        squares.append(probes.difference(own, y) ** 2 * (1 - share) / share)
    if not squares:
        return [{"code": "response-uncertain"}] if error > 1 - RELATED / 100 else []
    doubled = 2 * sqrt(float(np.mean(squares)))
    found: list[Reason] = [{"code": "parts-differ", "times": doubled / error}] if doubled > LARGEST * error else []
    return [*found, {"code": "response-uncertain"}] if doubled >= float(own.std(axis=1).max()) else found


def _bend(model: Model, probes: Probes) -> float:
    """The largest deviation of a model from a linear one: of the mean of two runs from the run of the mean input."""
    first, *_, last = probes.records
    mean = replace(first, input=0.5 * (first.input + last.input))
    runs = [model.simulate(each).output[-SAMPLES:] / probes.scale for each in (first, last, mean)]
    return float(np.sqrt(np.mean((0.5 * (runs[0] + runs[1]) - runs[2]) ** 2)))


BEYOND = 0.1
"""A model extrapolates if an input, of its own or of a map, leaves its range in the fit by more than this fraction."""


def about_the_maps(model: Any, record: Record, unseen: Record, seen: bool) -> list[Finding]:
    """One finding for every static map that the free run over unseen data continues beyond the data of the fit.

    Args:
        model: the chosen one; of one without static maps there is nothing to say.
        record: what it was fitted to.
        unseen: what it is judged on.
        seen: whether that is a part of the record.
    """
    if seen:
        return []
    kind = capabilities_of(model)
    try:
        fitted, new = kind.maps_in_use(model, record), kind.maps_in_use(model, unseen)
    except EmsidError:
        return []
    found = []
    for k, (one, other) in enumerate(zip(fitted, new, strict=True), start=1):
        known, z = one.input, other.input
        low, high = float(known.min()), float(known.max())
        slack = BEYOND * (high - low)
        beyond = (z < low - slack) | (z > high + slack)
        if beyond.any():
            data = {
                "map": k if len(fitted) > 1 else None,
                "low": float(z.min()),
                "high": float(z.max()),
                "fitted_low": low,
                "fitted_high": high,
                "share": float(beyond.mean()),
                "seen": seen,
            }
            found.append(Finding("map-beyond-range", model.name, data))
    return found


# A residual of which the input predicts more than this share of the variance depends on the input.
PREDICTABLE = 0.05
# Of fewer independent values, chance explains half as large a share, and such a share does not stand out from it.
FEWEST_INDEPENDENT = 2 / PREDICTABLE
# Penalties of the regressions that predict a residual.
RIDGES = (0.0, 0.01, 0.1, 1.0)
# A fit in percent below which a model is called poor, and above which it is called good.
POOR, GOOD = 70.0, 95.0
# A fit in percent below which channels may not belong together, which leaves a residual independent of the input too.
RELATED = 20.0


def verdicts(best: Assessment) -> tuple[Finding, ...]:
    """Whether the residual of a free run still depends on the input, for every output."""
    record, found = best.record, []
    for channel, output in enumerate(record.output_names):
        error = best.errors[:, channel]
        data: dict[str, Any] = {"model": best.row.model, "output": output}
        share = float(predictable_shares(error[:, None], record)[0])
        code = "residual-depends-on-input" if share > PREDICTABLE else "residual-independent-of-input"
        if np.isnan(share):
            code = "residual-not-tested"
        elif (
            share <= PREDICTABLE
            and (independent := max(independent_values(error, u, record.breaks) for u in record.input.T))
            < FEWEST_INDEPENDENT
        ):
            code, data = "residual-not-tested", data | {"independent": independent}
        else:
            data |= {"share": share}
        found.append(Finding(code, best.row.model, data))
    return tuple(found)


def independent_values(error: Array, u: Array, breaks: Sequence[int]) -> float:
    r"""How many independent values a correlation of two signals (N,) comes from, ``N/(1 + 2·Σ w(k)·r_e(k)·r_u(k))``.

    Two slow signals are alike by chance (Bartlett, 1946). r are their autocorrelations up to a quarter of the samples,
    w falls from 1 to 0 there.

    Args:
        error: NaN where it does not count.
        u: an input.
        breaks: the first sample of every segment but the first.
    """
    count = int(np.count_nonzero(np.isfinite(error)))
    known = np.where(np.isfinite(error), u, np.nan)
    alike = [np.asarray(autocorrelation(each, breaks, count // 4))[1:] for each in (error, known)]
    lags = min(map(len, alike))
    weights = 1 - np.arange(1, lags + 1) / (lags + 1)
    return count / max(1 + 2 * float(np.sum(weights * alike[0][:lags] * alike[1][:lags])), 1.0)


def predictable_shares(errors: Array, record: Record) -> Array:
    """(m,) the shares of the variances of residuals that the inputs predict, at lags of 0, 1, 2, 4, 8, … samples.

    Of every input it takes u, |u|, u·|u| and its sign, so that it sees a dead zone and friction that a linear model
    misses. Each quarter of the samples is predicted by coefficients from the other quarters, so that chance predicts
    nothing; below zero counts as zero. In a short record a slow input has few independent values, and all these
    functions together predict nothing there. Coefficients with a penalty count too, where they make every quarter
    better: slow noise in a short record follows some function of the input in one quarter or two.

    Args:
        errors: (N, m) residuals on the same samples, NaN where they do not count.
        record: of the inputs.

    Returns:
        NaN where the residual or the inputs are constant, or there are too few samples.
    """
    known = np.asarray(np.isfinite(errors).all(axis=1))
    found = _past_inputs(record, known) if known.any() and errors.size else None
    if found is None:
        return np.full(errors.shape[1], np.nan)
    return np.where(np.ptp(errors[known], axis=0) > 0, _shares(errors, *found), np.nan)


def _shares(errors: Array, phi: Array, usable: NDArray[np.bool_]) -> Array:
    """`predictable_shares` for functions of past inputs (n, p) and the samples (N,) that have them."""
    e = errors[usable]
    quarters = np.array_split(np.arange(len(e)), 4)
    factors = [np.linalg.qr(np.hstack([np.ones((len(k), 1)), phi[k], e[k]]), mode="r") for k in quarters]
    left = np.empty((len(RIDGES), *e.shape))
    for number, part in enumerate(quarters):
        others = np.vstack([each for k, each in enumerate(factors) if k != number])
        centres = others[:, 0] @ others / float(others[:, 0] @ others[:, 0])  # the means of all columns
        others = others - others[:, :1] * centres
        count = 1 + phi.shape[1]
        coefficients = [_ridge_regression(others[:, 1:count], others[:, count:], ridge) for ridge in RIDGES]
        predicted = (phi[part] - centres[1:count]) @ np.hstack(coefficients)
        left[:, part] = e[part] - centres[count:] - np.stack(np.hsplit(predicted, len(RIDGES)))
    variance = np.var(e, axis=0)
    squares, usual = left**2, (e - e.mean(axis=0)) ** 2
    helped = np.all([np.mean(squares[:, k], axis=1) < np.mean(usual[k], axis=0) for k in quarters], axis=0)
    shares = 1 - np.mean(squares, axis=1) / np.where(variance > 0, variance, np.inf)
    sure = helped | (np.array(RIDGES)[:, None] == 0)
    return np.asarray(np.max(np.where((variance > 0) & sure, shares, 0.0), axis=0, initial=0.0))


def _ridge_regression(phi: Array, target: Array, ridge: float) -> Array:
    """The coefficients for the columns of phi, with a penalty in units of the sum of squares of each column."""
    penalty = np.diag(np.sqrt(ridge) * np.linalg.norm(phi, axis=0))
    padded = np.vstack([target, np.zeros((len(penalty), target.shape[1]))])
    return np.asarray(np.linalg.lstsq(np.vstack([phi, penalty]), padded, rcond=1e-6)[0])


def _past_inputs(record: Record, known: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]] | None:
    """Functions of past inputs as columns, on the samples where they and the residuals are known (N,)."""
    lags = [0, *(2**k for k in range(12) if 2**k <= min(len(segment) for segment in record.segments) // 8)]
    usable = known.copy()
    columns = []
    for u in record.input.T:
        for signal in (u, np.abs(u), u * np.abs(u), np.sign(u)):
            if np.ptp(signal) > 0:
                columns += [np.roll(signal, lag)[:, None] / np.max(np.abs(signal)) for lag in lags]
    for start in (0, *record.breaks):
        usable[start : start + lags[-1]] = False
    if not columns or np.count_nonzero(usable) < 4 * (1 + len(columns)):
        return None
    return np.hstack(columns)[usable], usable


def next_steps(
    chosen: Assessment,
    found: Sequence[Finding],
    fits: Iterable[Fit[Any]],
    record: Record,
    over_folds: float = -np.inf,
    *,
    is_best: bool = True,
) -> Iterable[Finding]:
    """What to do next besides another experiment, the most useful first.

    Args:
        chosen: the recommended model on the unseen data.
        found: its `verdicts`, and what was found in fitting the models.
        fits: of all models.
        record: what they were fitted to.
        over_folds: the fit of the recommended model over all folds in %, where there are several.
        is_best: whether no other model has a smaller error.
    """
    fit = np.fmax(chosen.row.fit_percent, over_folds)
    depends = any(each.code == "residual-depends-on-input" for each in found)
    looped = any(each.code == "feedback-likely" for each in found)
    failed = {each.subject for each in found if each.code == "model-failed"}
    physical = any(has_physical_parameters(each) for each in fits) or not failed.isdisjoint(PLANTS)
    unstable = any(each.code == "unstable-in-loop" for each in found)
    if chosen.input_moves and not fit >= POOR and not unstable:
        tested = not any(each.code == "residual-not-tested" for each in found)
        noisy = fit >= RELATED and tested and not depends and is_best and not looped
        yield Finding("next-reduce-noise" if noisy else "next-check-data", record.name, {"fit_percent": finite(fit)})
    if (depends or not fit >= GOOD) and not physical and not unstable:
        yield Finding("next-physical-model", chosen.row.model)


def observations(
    comparison: Comparison,
    record: Record,
    unseen: Record,
    profiles: Mapping[str, tuple[Profile, ...]],
    choice: Comparison | None = None,
    *,
    ranked_on: int = 0,
    tests: bool = True,
) -> list[Finding]:
    """All findings about the free runs of the models on unseen data, and about their profiles.

    Args:
        comparison: the models on the unseen data, the chosen one first.
        record: what they were fitted to.
        unseen: what their errors are from.
        profiles: by model.
        choice: the models on further unseen data that chose among them; None where ``unseen`` did.
        ranked_on: the samples that ranked the models, where these are more than those of the comparison.
        tests: whether the residuals of the best model are tested.
    """
    seen = has_common_samples(unseen, record)
    best = comparison.best
    few = Finding("few-unseen-samples", unseen.name, {"samples": max(best.row.samples, ranked_on), "needed": FEWEST})
    checks: dict[str, Callable[[], Iterable[Finding | None]]] = {
        "error of the free run": lambda: _about_the_best(comparison, unseen, seen, choice),
        "residual test": lambda: about_the_residual(best) if tests else (),
        "test of nonlinear terms": lambda: about_nonlinear_terms(best) if tests else (),
        "errors by region": lambda: [worst_region(best)],
        "number of samples": lambda: [few] if few.data["samples"] < FEWEST else (),
        "unseen input": lambda: about_the_unseen_input(record, unseen, seen),
        "ranges of the maps": lambda: about_the_maps(best.fit.model, record, unseen, seen),
    }
    found: list[Finding] = []
    for name, check in checks.items():
        with border(f"check of {best.row.model}: {name}", best.row.model):
            found += filter(None, check())
    for row in comparison.rows:
        if row.diverged_at is not None:
            data = {"model": row.model, "sample": int(row.diverged_at), "seen": seen}
            found.append(Finding("free-run-diverged", row.model, data))
    for model, profile in ((model, each) for model, some in profiles.items() for each in some):
        low, high = (finite(end) for end in profile.interval)
        interval = {"model": model, "level": float(profile.level), "low": low, "high": high, "unit": profile.unit}
        found.append(Finding("profile-interval", profile.name, interval))
    return [*([Finding("data-not-unseen", unseen.name)] if seen else []), *found]


def _about_the_best(comparison: Comparison, unseen: Record, seen: bool, choice: Comparison | None) -> list[Finding]:
    """The error of the best free run."""
    row = comparison.best.row
    if not np.isfinite(row.simulation_mse):
        return []
    rows: tuple[Any, ...] = row.outputs or (row,)
    outputs = [
        {
            "name": name,
            "unit": unit,
            "rmse": float(each.simulation_rmse),
            "fit_percent": finite(each.fit_percent),
        }
        for each, name, unit in zip(rows, unseen.output_names, unseen.output_units, strict=True)
    ]
    data: dict[str, Any] = {"model": row.model, "seen": seen, "outputs": outputs}
    if len(comparison.rows) > 1 and not seen:
        data |= {"chosen_among": len(comparison.rows)}
        data |= {"chosen_on": choice.best.row.samples} if choice else {"apart": chosen_and_judged_apart(comparison)}
    findings = [Finding("free-run-error", row.model, data)]
    if row.fit_percent <= 0 and comparison.best.input_moves:
        findings += [Finding("no-better-than-mean", " and ".join(unseen.output_names), {"seen": seen})]
    if 0 < 2 * row.one_step_mse < row.simulation_mse:
        ratio = float(row.simulation_mse / row.one_step_mse)
        findings += [Finding("one-step-error-smaller", row.model, {"model": row.model, "ratio": ratio})]
    return findings


ENOUGH = 200
"""Samples of a half on which a model is chosen, or judged."""


def length_trusted(fit: Fit[Any], model: Model, whole: Record) -> list[Finding]:
    """For how long the free run of a plant over all data is trusted, where its fit does not say so already.

    A fit to a part of a record adapts to the drift there, so that its errors add up in the rest only.

    Args:
        fit: of the recommended model.
        model: the same for later use.
        whole: all data.
    """
    if {"free-run-drifts", "load-drifts"} & {each.code for each in fit.findings}:
        return []
    return capabilities_of(model).trusted_length(model, whole)


def chosen_and_judged_apart(comparison: Comparison) -> list[float] | None:
    """RMSE of every output where a model is chosen on one half of the data and judged on the other, both ways round.

    The error of the best of several models is too small on the data that it was chosen on. Here no sample does both.

    Returns:
        None where a half has fewer than `ENOUGH` samples.
    """
    record = comparison.best.record
    counted = np.flatnonzero(np.all([each.simulation.counted for each in comparison.assessments], axis=0))
    halves = np.array_split(counted, 2)
    if len(halves[1]) < ENOUGH:
        return None
    spread = deviations(record.output[counted])
    squares = [  # of every model (2, ny)
        np.stack([np.mean(each.errors[half] ** 2, axis=0) for half in halves]) for each in comparison.assessments
    ]
    judged = []
    for choice in (0, 1):
        costs = [float(np.mean(each[choice] / spread**2)) for each in squares]
        best = int(np.nanargmin(costs)) if np.isfinite(costs).any() else 0
        judged.append(squares[best][1 - choice])
    errors = np.sqrt(np.mean(judged, axis=0))
    return errors.tolist() if np.isfinite(errors).all() else None


def about_the_residual(best: Assessment) -> list[Finding]:
    """Whether the one-step errors of the best model are white, if it models noise."""
    found = []
    for test in residual_tests(best.record, best.prediction) if models_noise(best.fit.model) else ():
        data = {"model": best.row.model, "lags": test.lags, "largest": test.largest_autocorrelation}
        data |= {"lag": test.at_lag, "p_value": test.p_value}
        found.append(Finding("residual-white" if test.white else "residual-coloured", test.output, data))
    return found


def about_nonlinear_terms(best: Assessment) -> list[Finding]:
    """The nonlinear function of inputs that the residual of the best free run depends on most, for every output.

    It must explain a part of the residual that matters: in a long record a test also sees the rounding of an encoder. A
    plant says itself what it lacks, by a score of every known effect (`emsid.models.plants.search.missing`).
    """
    if capabilities_of(best.fit.model).says_what_it_lacks:
        return []
    findings = []
    for channel, output in enumerate(best.record.output_names):
        tests = [test for test in best.nonlinear_tests[channel] if test.depends and test.share > NEGLIGIBLE]
        if tests:
            worst = max(tests, key=lambda test: abs(test.largest))
            data = {"model": best.row.model, "term": worst.term, "kind": worst.kind, "largest": worst.largest}
            data |= {"at_lag": worst.at_lag, "limit": worst.limit}
            findings.append(Finding("residual-depends-on-term", output, data))
    return findings


def about_the_unseen_input(record: Record, unseen: Record, seen: bool = False) -> list[Finding]:
    """Inputs that are constant in the unseen data, or outside their range in the fit."""
    u = unseen.input
    if np.all(np.ptp(u, axis=0) == 0):
        levels = [{"name": name, "level": float(x)} for name, x in zip(unseen.input_names, u[0], strict=True)]
        return [Finding("input-constant", " and ".join(unseen.input_names), {"inputs": levels, "seen": seen})]
    findings = []
    for name, new, known in zip(unseen.input_names, u.T, record.input.T, strict=True):
        slack = BEYOND * np.ptp(known)
        if new.min() < known.min() - slack or new.max() > known.max() + slack:
            data = {
                "low": float(new.min()),
                "high": float(new.max()),
                "fitted_low": float(known.min()),
                "fitted_high": float(known.max()),
                "seen": seen,
            }
            findings.append(Finding("input-beyond-range", name, data))
    return findings


def about_the_fits(fits: Iterable[Fit[Any]], plausibility: Plausibility) -> list[Finding]:
    """Findings of the estimators, and on how plausible the models are on the data they were fitted to."""
    found: list[Finding] = []
    for fit in fits:
        name = fit.model.name
        found += [each.about(name) for each in fit.findings]
        with border(f"check of {name}", name):
            found += [each.about(name) for each in capabilities_of(fit.model).advice(fit, plausibility.record)]
        with border(f"check whether {name} is plausible", name):
            found += plausibility.findings(fit)
    return found


def failure(name: str, problem: EmsidError, code: str = "model-failed") -> Finding:
    """A model that could not be fitted, or not again for its intervals."""
    reason = str(problem).removeprefix(f"{name}: ")
    return Finding(code, name, {"model": name, "reason": reason, "arguments": list(problem.arguments)})
