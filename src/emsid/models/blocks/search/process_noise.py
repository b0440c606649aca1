"""The correction of a fitted cascade for noise before its static map; see `emsid.models.blocks.process_noise`.

It takes the expectation of a static map whose input has noise on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import itemgetter
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import FreeRun, Search, conclude, search
from emsid.models.blocks.process_noise import (
    ErrorPiece,
    ProcessNoise,
    Weighting,
    after_map,
    dependence,
    error_pieces,
    estimated_noise,
    map_index,
)
from emsid.models.blocks.search.cross_validation import Orders, as_arrays
from emsid.models.blocks.search.map_families import SPLINE
from emsid.models.blocks.search.orders import LARGEST_ORDER
from emsid.models.blocks.search.starts import grown, started
from emsid.models.blocks.static_maps.static_map import StaticMap
from emsid.models.one_channel import segments_longer_than
from emsid.record import Record
from emsid.selection.improvement import NEGLIGIBLE

Array = NDArray[np.float64]

CHANCE = 1e-3
"""The probability that noise on the output alone is taken for noise before the map."""
LEAST_SAMPLES = 1_000
"""In shorter records the variance of the error shows little."""
SMALL = 0.02
"""Noise of a smaller part of the signal before the map does not change the map visibly."""
ITERATIONS, SAVING = 40, 1e-5
"""Steps of a fit that chooses orders; it ends where four together lower the cost by less than this part."""
TURNS, CLOSE = 6, 0.02
"""The most turns of model and noise; they end where the spread of the noise changes by less than this part."""
UNSURE = 0.3
"""The relative standard error of the spread of the noise that the error shows, for what the second filter stops."""
QUICK = Search(max_iterations=ITERATIONS, least_saving=SAVING, covariances=False)
"""The options of a fit whose estimate alone counts."""
ORDER_SAMPLES = 12_000
"""Samples that the orders are chosen on."""


class Corrected(NamedTuple):
    """What came out of the search for noise before the map.

    Attributes:
        fit: of the system without the noise; None where there is no noise, or no such fit describes the data as well.
        findings: one where there is noise.
    """

    fit: Fit[Cascade] | None = None
    findings: tuple[Finding, ...] = ()


def without_process_noise(
    minimum: Minimum,
    problem: FreeRun,
    records: Sequence[Record],
    orders: Orders,
    how: Search,
    averages: float = 1.0,
    free_map: bool = False,
) -> Corrected:
    """A fit of the system without the noise before its map, if there is any.

    In such noise, the error of an order that is too low, or of another kind of map, is small, but the white residual of
    the corrected fit shows it. So orders that are not given rise here, and a spline takes the place of a map that is
    not given, as long as Schwarz's criterion prefers that.

    A map that does not describe the data also leaves an error that varies with its slope. So the correction is kept
    only if the model without the noise still describes the data as well as the model before.

    Args:
        minimum, problem: of a fit, from `search`; one that did not converge is not corrected.
        records: what it was fitted to.
        orders: that are given, of the filters before and after the map; the others may rise.
        how: of further fits, as in `fit_cascade`.
        averages: the number of periods that the output is the mean of. The map shows the noise of each.
        free_map: whether the kind of the map is not given.
    """
    model = problem.model(minimum.estimate)
    at, segments = map_index(model), problem.segments
    if at is None or minimum.ending is not Ending.CONVERGED or minimum.samples < LEAST_SAMPLES:
        return Corrected()
    if problem.transient > model.edge:  # states from the transient, perhaps because estimated ones described a drift
        how = how | Search(transient=problem.transient)
    pieces = error_pieces(model, segments, problem.states(minimum.estimate), problem.transient)
    score = dependence(pieces, after_map(model), model.oversampling)
    if score < ndtri(1 - CHANCE):
        return Corrected()
    noise = estimated_noise(pieces, after_map(model), model.oversampling)
    signal = float(np.std(np.concatenate([model.signals_from_rest(u)[at] for u, _ in segments])))
    times = float(np.sqrt(averages))
    if noise.spread * times < SMALL * signal:
        return Corrected()
    if min(len(y) for _, y in segments) < 2 * model.memory:  # too short for the start of a larger model
        orders = (0, 0)
    fit: Fit[Cascade] | None = None
    spread = times * noise.spread
    with suppress(EmsidError):
        start, noise = in_turn(model, noise, pieces, _first_segments(records, model, how), times, how)
        larger = _grown(start, noise, records, orders, how, free_map)
        if len(larger.parameters) > len(start.parameters):
            part = _first_segments(records, larger, how)
            start, noise = in_turn(larger, noise, _from_the_start(larger, part, how), part, times, how)
        start = with_spread_of_mean(start, noise, records, how)
        spread = _expected(start).spread
        weightings = _weightings(start, _from_the_start(start, records, how), noise)
        last = Search(weightings=weightings, restarts=True, fixed=[_spread_name(start)])
        again, weighted = search(start, records, **(how | last))
        if again.ending is Ending.CONVERGED and _describes(again, replace(weighted, weightings=()), minimum):
            fit = conclude(again, weighted)
            fit = replace(fit, model=_plain(fit.model), noise_variance=minimum.noise_variance)
    data = {"block": at + 1, "spread": spread, "share": spread / signal, "standard_errors": score}
    found = Finding("process-noise", model.name, {**data, "corrected": fit is not None})
    return Corrected(fit, (found,))


def in_turn(
    model: Cascade,
    noise: ProcessNoise,
    pieces: Sequence[ErrorPiece],
    part: Sequence[Record],
    times: float,
    how: Search,
) -> tuple[Cascade, ProcessNoise]:
    """The model with the expectation of its map, and the noise, each estimated for the other in turn.

    A fit that ignores the noise has poles and zeros beside those of the system, and through them the noise may look
    far larger than it is. Every turn raises the likelihood of both.

    Args:
        model: any fit.
        noise: that it shows.
        pieces: its error over segments that begin with the part.
        part: of the records, each one segment.
        times: the spread of the noise that the map shows, as a multiple of that in the records.
        how: of fits, as in `fit_cascade`.
    """
    for _ in range(TURNS):
        start = _expecting(_plain(model), times * noise.spread)
        weightings = _weightings(start, pieces[: len(part)], noise)
        minimum, problem = search(
            start, part, **(how | QUICK | Search(weightings=weightings, fixed=[_spread_name(start)]))
        )
        model, before = problem.model(minimum.estimate), noise
        pieces = error_pieces(model, problem.segments, problem.states(minimum.estimate), problem.transient)
        noise = estimated_noise(pieces, after_map(model), model.oversampling)
        if abs(noise.spread - before.spread) < CLOSE * before.spread:
            break
    return _expecting(_plain(model), times * noise.spread), noise


def with_spread_of_mean(model: Cascade, noise: ProcessNoise, records: Sequence[Record], how: Search) -> Cascade:
    """The model with the spread of the noise that the mean of its map shows, and the size of the error.

    The error shows the noise that the second filter passes. What the filter stops counts there as if it were as strong
    as the rest, so this spread is the largest that there may be. The mean of a map with edges shows all of the noise,
    as it rounds them; a smooth curve explains any spread. The two are averaged with the inverse of their variances.

    Args:
        model: with the expectation of its map, at the spread that the error shows.
        noise: that it shows.
        records: what the model is fitted to.
        how: of fits, as in `fit_cascade`.
    """
    most = _expected(model).spread
    if _expected(model).smooth:
        return model
    weightings = _weightings(model, _from_the_start(model, records, how), noise)
    minimum, problem = search(model, records, **(how | QUICK | Search(weightings=weightings)))
    found = problem.model(minimum.estimate)
    (which,) = np.flatnonzero(problem.freedom.free == model.names.index(_spread_name(model)))
    trust = (UNSURE * most) ** 2 / minimum.information.solve().covariance[which, which]  # of white residuals
    spread = float((most + trust * abs(_expected(found).spread)) / (1 + trust))
    return _expecting(_plain(found), min(most, spread))


def _from_the_start(model: Cascade, records: Sequence[Record], how: Search) -> list[ErrorPiece]:
    """The error of a model over the segments that a fit uses, from the states that it starts with."""
    transient = how.get("transient")
    needed = model.memory if transient is None else transient
    segments = segments_longer_than(needed, model, records)
    states = [model.initial_state(u, y[: model.memory], quick=True) for u, y in segments]
    return error_pieces(model, segments, states, max(transient or 0, model.edge))


def _grown(
    model: Cascade, noise: ProcessNoise, records: Sequence[Record], orders: Orders, how: Search, free_map: bool
) -> Cascade:
    """The model with filters of larger orders, or a spline, where Schwarz's criterion on some data prefers it."""
    part = _first_segments(records, model, how)
    samples = sum(len(record) for record in part)
    weightings = _weightings(model, _from_the_start(model, part, how), noise)
    limits = QUICK | Search(weightings=weightings, fixed=[_spread_name(model)])

    def larger(than: Cascade) -> list[Cascade]:
        return [*_one_larger(than, orders), *(_with_spline(than, part) if free_map else [])]

    def fitted(start: Cascade) -> tuple[float, Cascade]:
        minimum, problem = search(start, part, **(how | limits))
        found = problem.model(minimum.estimate)  # V is half the sum of squares
        return minimum.cost + 0.5 * len(found.parameters) * np.log(samples), found

    if not larger(model):
        return model
    criterion, best = fitted(model)
    while True:
        least, other = min((fitted(each) for each in larger(best)), key=itemgetter(0), default=(criterion, best))
        if least >= criterion:
            return best
        criterion, best = fitted(other)  # further, so that the next one is compared with its minimum


def _first_segments(records: Sequence[Record], model: Cascade, how: Search) -> list[Record]:
    """The first segments that a fit uses, with about `ORDER_SAMPLES` samples in all, each as a record."""
    transient = how.get("transient")
    needed = model.memory if transient is None else transient
    part: list[Record] = []
    left = ORDER_SAMPLES
    for segment in (piece for record in records for piece in record.segments if len(piece) > needed):
        part.append(segment[: max(left, needed + 1)])
        left -= len(part[-1])
        if left <= needed:
            break
    return part


def _one_larger(model: Cascade, orders: Orders) -> list[Cascade]:
    """The model with one pole and zero more, which cancel, in each filter whose order is not given."""
    now = [len(block.denominator) for block in model.blocks if isinstance(block, Rational)]
    there = [isinstance(block, Rational) for block in (model.blocks[0], model.blocks[-1])]
    given = [order for order, used in zip(orders, there, strict=True) if used]
    larger = []
    for k, order in enumerate(given):
        if order is None and now[k] < LARGEST_ORDER:
            sizes = [size + (j == k) for j, size in enumerate(now)]
            larger.append(grown(model, (sizes[0], sizes[1] if len(sizes) > 1 else None)))
    return larger


def _with_spline(model: Cascade, part: Sequence[Record]) -> list[Cascade]:
    """The model with the expectation of a spline in the place of another kind of map; none where it has a spline."""
    map_ = _expected(model)
    if map_.smooth:
        return []
    smooth = started(_plain(model), lambda x, z: SPLINE.start(x, z, SPLINE.sizes[0]), as_arrays(part))
    return [_expecting(smooth, map_.spread)]


def _weightings(model: Cascade, pieces: Sequence[ErrorPiece], noise: ProcessNoise) -> list[Weighting]:
    return [noise.weighting(piece.slope, after_map(model), model.oversampling) for piece in pieces]


def _describes(again: Minimum, problem: FreeRun, before: Minimum) -> bool:
    """Whether the corrected model, without noise, describes the data as well as the model before.

    The model before has the least error on these data, which is below the noise by its number of parameters.
    """
    start = problem.freedom.start.copy()
    start[problem.cascade.names.index(_spread_name(problem.cascade))] = 0.0
    plain = replace(problem, freedom=replace(problem.freedom, start=start))
    error, least = plain.residuals(again.estimate), before.residuals
    allowed = 1 + NEGLIGIBLE + before.rank / effective_samples(least)
    return _mean_square(error) < allowed * _mean_square(least)


def _expecting(model: Cascade, spread: float) -> Cascade:
    """The cascade with the expectation of its map."""
    blocks = (ExpectedMap(block, spread) if isinstance(block, StaticMap) else block for block in model.blocks)
    return replace(model, blocks=tuple(blocks))


def _expected(model: Cascade) -> ExpectedMap:
    """The one map of a cascade with the expectation of its map."""
    (map_,) = (block for block in model.blocks if isinstance(block, ExpectedMap))
    return map_


def _spread_name(model: Cascade) -> str:
    """The name of the spread of the noise among the parameters of a cascade with the expectation of its map."""
    last = next(span.stop for block, span in zip(model.blocks, model.spans, strict=True) if block is _expected(model))
    name: str = model.names[last - 1]
    return name


def _plain(model: Cascade) -> Cascade:
    """The cascade with the map itself in the place of its expectation."""
    return replace(model, blocks=tuple(block.of if isinstance(block, ExpectedMap) else block for block in model.blocks))


def _mean_square(errors: Sequence[Array]) -> float:
    return float(np.mean(np.concatenate(errors) ** 2))


# --- expectation of a map ---------------------------------------------------------------------------------------------

# Points of the Gauss–Hermite rule, for a smooth map and for one that may have kinks.
SMOOTH_POINTS, POINTS = 5, 15


@dataclass(frozen=True, eq=False)
class ExpectedMap(StaticMap):
    """E f(x + w) for normal w of zero mean: the mean output of a map f whose input x has noise w on it.

    It has the parameters of f and the spread of w, so that a fit of it estimates f. It exists during a fit only, and is
    in no file.

    Args:
        of: f.
        spread: standard deviation of w, in the unit of x.
    """

    of: StaticMap
    spread: float

    kind: ClassVar[str] = "expected"

    def __post_init__(self) -> None:
        for what in ("scaling", "absorbs_shift", "owns_level", "smooth"):
            object.__setattr__(self, what, getattr(self.of, what))

    @property
    def names(self) -> tuple[str, ...]:
        """Those of f, and the spread."""
        return (*self.of.names, "spread")

    @property
    def parameters(self) -> Array:
        """(p + 1,) those of f, and the spread."""
        return np.append(self.of.parameters, self.spread)

    @property
    def anchors(self) -> tuple[int, ...]:
        """Those of f."""
        return self.of.anchors

    @property
    def steepness(self) -> float:
        """That of f."""
        return self.of.steepness

    def with_parameters(self, theta: Array) -> ExpectedMap:
        """The expectation of f with other parameters."""
        return ExpectedMap(self.of.with_parameters(theta[:-1]), float(theta[-1]))

    def value(self, x: Array) -> Array:
        """E f(x + w)."""
        return self._mean(lambda x, point: self.of.value(x), x)

    def slope(self, x: Array) -> Array:
        """E f′(x + w)."""
        return self._mean(lambda x, point: self.of.slope(x), x)

    def parameter_gradient(self, x: Array) -> Array:
        """(p + 1, N) E ∂f/∂θ (x + w), and E f′(x + w)·w/σ, for the spread σ."""

        def rows(x: Array, point: float) -> Array:
            return np.concatenate([self.of.parameter_gradient(x), point * self.of.slope(x)[None]])

        return self._mean(rows, x)

    def scaled(self, input: float, output: float) -> ExpectedMap:
        """The expectation of the scaled map; the noise has the scale of the input."""
        return ExpectedMap(self.of.scaled(input, output), self.spread * abs(input))

    def roughness(self) -> Array | None:
        """That of f, to which the spread adds none."""
        rows = self.of.roughness()
        return None if rows is None else np.pad(rows, ((0, 0), (0, 1)))

    def check(self) -> None:
        """As f does."""
        self.of.check()

    def expression(self, x: str) -> str:
        """The mean of f."""
        return f"mean of {self.of.expression(f'({x} + w)')}"

    def to_data(self) -> dict[str, Any]:
        """Not possible.

        Raises:
            ModelError: always; f can be saved.
        """
        raise ModelError("the expectation of a map is not saved; save the map")

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> ExpectedMap:
        """Not possible, as `to_data`.

        Raises:
            ModelError: always.
        """
        raise ModelError("the expectation of a map is in no file")

    def _mean(self, function: Callable[[Array, float], Array], x: Array) -> Array:
        """The mean of a function of x + w, and of w over its standard deviation."""
        points, weights = _normal_rule(SMOOTH_POINTS if self.of.smooth else POINTS)
        total = weights[0] * function(x + self.spread * points[0], points[0])
        for point, weight in zip(points[1:], weights[1:], strict=True):
            total += weight * function(x + self.spread * point, point)
        return np.asarray(total)


@lru_cache
def _normal_rule(count: int) -> tuple[Array, Array]:
    """Points and weights of the mean over a normal variable of unit variance."""
    points, weights = np.polynomial.hermite_e.hermegauss(count)
    return points, weights / weights.sum()
