"""Fit of a cascade to the free-run error on one or several records, from start values.

A unit DC gain is the linear constraint Σb = 1 + Σa. The fit therefore uses the coordinates φ of `Freedom`, θ = θ₀ + Cφ,
in which one numerator coefficient follows from the others, and redundant scales and levels stay fixed. Covariances are
propagated through C exactly.

The state of a filter at the start of a segment is unknown. It is estimated together with the parameters, or, as an
option, the first samples are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypedDict, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum, undetermined
from emsid.estimation.nonlinear.problem import SQUARES, Columns, LastRun, Loss, Mask, SparseProblem, Squares, without
from emsid.estimation.nonlinear.restarts import begun_again
from emsid.estimation.nonlinear.smoothing import Penalty, Smoothing
from emsid.estimation.threads import short_tasks
from emsid.estimation.uncertainty.model_error import model_error_covariance
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.gain import redundant, unit_gain
from emsid.models.blocks.process_noise import Weighting
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.one_channel import Segments, segments_longer_than
from emsid.models.terms import check_whole
from emsid.record import Record

Array = NDArray[np.float64]
T = TypeVar("T")

# Samples that the curvature of the cost due to model error is estimated from.
CURVATURE_SAMPLES = 5_000
# Fewer samples in all segments are computed in one thread.
SHARED_SAMPLES = 20_000


@dataclass(frozen=True, eq=False)
class Freedom:
    """The coordinates φ in which a cascade is fitted, θ = θ₀ + C(φ − φ₀), where φ is a part of θ.

    Attributes:
        start: (p,) θ₀, a cascade of unit gain.
        free: (f,) the indices of φ in θ.
        tied: for every filter of unit DC gain, the coefficient that follows from the others: (anchor, others, signs),
            with θ[anchor] = 1 + signs·θ[others], from Σb = 1 + Σa.
    """

    start: Array
    free: NDArray[np.intp]
    tied: tuple[tuple[int, NDArray[np.intp], Array], ...]

    def parameters(self, phi: Array) -> Array:
        """(p,) θ for φ (f,)."""
        theta = self.start.copy()
        theta[self.free] = phi
        for anchor, others, signs in self.tied:
            theta[anchor] = 1 + signs @ theta[others]
        return theta

    def tie(self, rows: Array) -> None:
        """Turn rows of derivatives with respect to θ into those with respect to φ, in place."""
        for anchor, others, signs in self.tied:
            rows[others] += signs[:, None] * rows[anchor]

    @cached_property
    def spread(self) -> Array:
        """(p, f) C."""
        matrix = np.zeros((len(self.start), len(self.free)))
        matrix[self.free, np.arange(len(self.free))] = 1.0
        for anchor, others, signs in self.tied:
            matrix[anchor] = signs @ matrix[others]
        return matrix


def freedom(cascade: Cascade, fixed: Sequence[str] = ()) -> Freedom:
    """The free coordinates of a cascade of unit gain, without redundant scales and levels and without ``fixed``.

    Args:
        cascade: from `unit_gain`.
        fixed: names of parameters that keep their values.

    Raises:
        ModelError: for a name that is not a parameter.
    """
    names = cascade.names
    unknown = [name for name in fixed if name not in names]
    if unknown:
        raise ModelError(f"{cascade.name} has no parameter {unknown[0]!r}; there are {', '.join(names)}")
    held = {names.index(name) for name in fixed}
    tied = []
    for k in redundant(cascade):
        block, span = cascade.blocks[k], cascade.spans[k]
        anchor = span.start + block.anchors[-1]
        if isinstance(block, Rational) and np.isclose(block.resting(1.0)[1], 1.0) and anchor not in held:
            others = np.array([j for j in range(span.start, span.stop) if j != anchor], dtype=np.intp)
            signs = np.where(others < span.start + len(block.numerator), -1.0, 1.0)
            tied.append((anchor, others, signs))
        held.add(anchor)
    maps = [(k, block) for k, block in enumerate(cascade.blocks) if isinstance(block, StaticMap)]
    for (k, block), (_, behind) in pairwise(maps):
        if block.owns_level and behind.absorbs_shift:
            held.add(cascade.spans[k].start + block.anchors[0])
    if not maps or maps[0][1].absorbs_shift:
        held.add(len(names) - 2)
    if maps and maps[-1][1].owns_level:
        held.add(len(names) - 1)
    free = np.array([k for k in range(len(names)) if k not in held], dtype=np.intp)
    return Freedom(cascade.parameters, free, tuple(tied))


def fixed_in(fit: Fit[Cascade]) -> tuple[str, ...]:
    """The names of the parameters that a fit has not estimated: those given as ``fixed``, and redundant ones."""
    return tuple(name for name in fit.model.names if name not in fit.names)


@dataclass(frozen=True, eq=False)
class FreeRun(SparseProblem):
    """The free-run residuals of a cascade over several segments, as a `Problem` for `gauss_newton`.

    The parameters are φ (f,) and then the initial states (s,) of every segment, unless these are given.

    Attributes:
        cascade: of unit gain.
        freedom: its coordinates.
        segments: (u, y) of each.
        transient: samples at the start of every segment that are left out of the residual.
        weightings: of every segment after the transient, for a residual that noise before the map makes coloured.
        given: the initial states (s,) of every segment; None estimates them.
        threads: that share the segments, where these are long.
    """

    cascade: Cascade
    freedom: Freedom
    segments: Segments
    transient: int
    weightings: tuple[Weighting, ...] = ()
    given: tuple[Array, ...] | None = None
    threads: int = 1
    _last: LastRun[tuple[Cascade, list[list[Array]]]] = field(default_factory=LastRun, init=False, repr=False)

    @cached_property
    def start(self) -> Array:
        """φ₀, and the initial states of a free run if they are estimated."""
        return self.at_start(() if self.given else self.starting_states())

    def at_start(self, states: Sequence[Array]) -> Array:
        """φ₀, and initial states (s,) of every segment if they are estimated."""
        return np.concatenate([self.freedom.start[self.freedom.free], *(() if self.given else states)])

    def starting_states(self) -> tuple[Array, ...]:
        """(s,) the initial states of a free run of the cascade, for every segment."""
        return tuple(self.cascade.initial_state(u, y[: self.cascade.memory], quick=True) for u, y in self.segments)

    @cached_property
    def penalties(self) -> tuple[Penalty, ...]:
        """On the roughness of every map that has one, in (φ, states)."""
        count, free = len(self.start) - len(self.freedom.free), self.freedom.free
        found = []
        for block, span in zip(self.cascade.blocks, self.cascade.spans, strict=True):
            rows = block.roughness() if isinstance(block, StaticMap) else None
            if rows is not None and len(rows):
                moved = rows @ self.freedom.spread[span]
                constant = rows @ self.freedom.start[span] - moved @ self.freedom.start[free]
                found.append(Penalty(np.pad(moved, ((0, 0), (0, count))), constant))
        return tuple(found)

    def check_values(self) -> None:
        """Refuse a start at which the output of a block is not finite.

        Raises:
            ModelError: with the block and its input.
        """
        for u, _ in self.segments:
            signals = self.cascade.signals(u, np.zeros(self.cascade.states))
            for k, (x, y) in enumerate(pairwise(signals), start=1):
                bad = np.flatnonzero(~np.isfinite(y))
                if len(bad):
                    raise ModelError(
                        f"{self.cascade.name}, block {k}: at an input of {x[bad[0]]:.4g} its output is {y[bad[0]]}; "
                        "start with parameters for which all signals are finite"
                    )

    def model(self, theta: Array) -> Cascade:
        """The cascade with these parameters."""
        return self.cascade.with_parameters(self.freedom.parameters(theta[: len(self.freedom.free)]))

    def shortened(self, samples: int) -> FreeRun:
        """The same on the first part of every segment, about this many samples in all."""
        share = max(samples // len(self.segments), self.transient + 1)
        return replace(self, segments=tuple((u[:share], y[:share]) for u, y in self.segments))

    def residuals(self, theta: Array) -> list[Array]:
        """Model minus measurement, per segment."""
        model, runs = self._run(theta)

        def residual(k: int) -> Array:
            error = (model.sampled(runs[k]) - self.segments[k][1])[self.transient :]
            return self.weightings[k].whitened(error[None])[0] if self.weightings else error

        return list(self._of_each(residual))

    def columns(self, theta: Array) -> Iterator[Columns]:
        """Residual and derivative, per segment."""
        model, runs = self._run(theta)
        free, parameters = self.freedom.free, len(self.freedom.start)

        def of_segment(k: int) -> Columns:
            rows = model.gradient(runs[k], states=not self.given)
            self.freedom.tie(rows)
            error, rows = (model.sampled(runs[k]) - self.segments[k][1])[self.transient :], rows[:, self.transient :]
            if self.weightings:
                error, rows = self.weightings[k].whitened(error[None])[0], self.weightings[k].whitened(rows)
            states = np.arange(len(rows) - parameters)
            which = np.append(free, parameters + states)
            return Columns(error, rows, which, np.append(np.arange(len(free)), len(free) + k * len(states) + states))

        yield from self._of_each(of_segment)

    def states(self, theta: Array) -> list[Array]:
        """(s,) the initial states of every segment."""
        return [self._states(theta, k) for k in range(len(self.segments))]

    def _run(self, theta: Array) -> tuple[Cascade, list[list[Array]]]:
        """The cascade and its signals in every segment.

        Raises:
            Infeasible: for an unstable filter.
        """

        def run() -> tuple[Cascade, list[list[Array]]]:
            model = self.model(theta)
            model.check()
            runs = self._of_each(lambda k: model.signals(self.segments[k][0], self._states(theta, k)))
            return model, list(runs)

        return self._last.at(theta, run)

    def _of_each(self, function: Callable[[int], T]) -> Iterable[T]:
        """The results of a function of the index of a segment, for all of them."""
        shared = self.threads > 1 and sum(len(u) for u, _ in self.segments) > SHARED_SAMPLES
        in_turn = short_tasks(self.threads) if shared else map
        return in_turn(function, range(len(self.segments)))

    def _states(self, theta: Array, k: int) -> Array:
        if self.given:
            return self.given[k]
        first = len(self.freedom.free) + k * self.cascade.states
        return theta[first : first + self.cascade.states]


class Search(TypedDict, total=False):
    """The options of `search`."""

    transient: int | None
    fixed: Sequence[str]
    loss: Loss
    max_iterations: int
    tolerance: float
    least_saving: float
    restarts: bool
    covariances: bool
    weightings: Sequence[Weighting]
    correlated: bool
    threads: int
    control: Control


def fit_cascade(start: Cascade, records: Record | Sequence[Record], **how: Unpack[Search]) -> Fit[Cascade]:
    """Fit a cascade to the free-run error on one or several records, from start values.

    Args:
        start, records, how: as in `search`.

    Returns:
        The fit, in the normalisation `unit_gain`; its covariance includes coloured residuals and model error.

    Raises:
        ModelError: for records with other channels or too few samples, or an unstable start.
    """
    how.setdefault("restarts", "max_iterations" not in how)
    return conclude(*search(start, records, **how), how.get("loss", SQUARES))


def search(
    start: Cascade,
    records: Record | Sequence[Record],
    *,
    transient: int | None = None,
    fixed: Sequence[str] = (),
    loss: Loss = SQUARES,
    max_iterations: int = 50,
    tolerance: float = 0.05,
    least_saving: float = 0.0,
    restarts: bool = False,
    covariances: bool = True,
    weightings: Sequence[Weighting] = (),
    correlated: bool = True,
    threads: int = 1,
    control: Control = FREE,
    left_out: Sequence[Mask] | None = None,
) -> tuple[Minimum, FreeRun]:
    """The minimum of `fit_cascade` without its covariance, for comparisons of models.

    Args:
        start: blocks with start values; normalised by `unit_gain` first.
        records: one input and one output each; every segment is an experiment.
        transient: samples at the start of every segment that are left out of the errors and give the initial states;
            None estimates the states together with the parameters.
        fixed: names of parameters that keep their (normalised) start values.
        loss: `Squares`, `Huber` or `Cauchy`.
        max_iterations, tolerance, least_saving, control: as in `gauss_newton`.
        restarts: whether a search that does not converge is begun again, see `begun_again`, except where
            ``least_saving`` ends it; `fit_cascade` does that unless ``max_iterations`` is given.
        covariances: as in `gauss_newton`; a comparison of models needs none.
        weightings: of every segment after its transient, see `process_noise`.
        correlated: see `Smoothing`; for curves with a penalty.
        threads: that share long segments; one for a search beside others.
        left_out: (N,) the samples of every segment that are not fitted; the run goes on through them.

    Raises:
        ModelError: for records with other channels or too few samples, or an unstable start.
    """
    if transient is not None:
        check_whole(f"{start.name}: transient", transient, 0, "these are samples to be left out")
    start.check()
    cascade = replace(unit_gain(start), dt=_sample_time(start, records))
    cascade.check()
    several = [records] if isinstance(records, Record) else records
    segments = segments_longer_than(cascade.memory if transient is None else transient, cascade, several)
    settled = max(transient or 0, cascade.edge)
    problem = FreeRun(cascade, freedom(cascade, fixed), segments, settled, tuple(weightings), threads=threads)
    problem.check_values()
    if transient is not None:
        problem = replace(problem, given=problem.starting_states())
    names = [cascade.names[k] for k in problem.freedom.free]
    count = len(names)
    if not problem.given:
        segments_of = range(len(problem.segments))
        names += [f"state {j + 1} of segment {k + 1}" for k in segments_of for j in range(cascade.states)]

    options: dict[str, Any] = {"max_iterations": max_iterations, "least_saving": least_saving}
    options["covariances"] = covariances
    same: dict[str, Any] = {"loss": loss, "tolerance": tolerance, "names": names}
    same |= {"control": control, "smoothing": Smoothing(problem.penalties, correlated)}

    def searched(theta: Array, **others: Any) -> Minimum:
        return gauss_newton(without(problem, left_out), theta, **same, **(options | others))

    minimum = searched(problem.start)
    if restarts and not (least_saving and minimum.ending is Ending.OUT_OF_BUDGET):
        minimum = begun_again(minimum, searched, count, control)
    return minimum, problem


def conclude(minimum: Minimum, problem: FreeRun, loss: Loss = SQUARES) -> Fit[Cascade]:
    """The fit at a minimum, with every estimated parameter and the tied ones."""
    minimum = minimum.judged()
    cascade = problem.model(minimum.estimate)
    count = len(problem.freedom.free)
    white = bool(problem.weightings)  # its robust covariance is that of the fit
    own = minimum.covariance if white or not isinstance(loss, Squares) else _with_model_error(minimum, problem)
    covariance = _propagated(problem.freedom.spread, own[:count, :count])
    kept = np.flatnonzero(np.diag(covariance) > 0)
    names = [cascade.names[k] for k in problem.freedom.free]
    fit = minimum.fit(cascade, names)
    return replace(
        fit,
        findings=_with_states_as_one(minimum, names),
        names=tuple(cascade.names[k] for k in kept),
        estimate=cascade.parameters[kept],
        covariance=covariance[np.ix_(kept, kept)],
    )


def _with_states_as_one(minimum: Minimum, names: Sequence[str]) -> tuple[Finding, ...]:
    """The findings of a minimum; parameters that are not in ``names`` are called initial states."""
    labels = [names[k] if k < len(names) else "initial states" for k in np.flatnonzero(minimum.free)]
    open_ = undetermined(minimum.information.solve(), labels)
    return tuple(open_ if finding.code == open_.code else finding for finding in minimum.findings)


def _with_model_error(minimum: Minimum, problem: FreeRun) -> Array:
    """The covariance of the minimum for a coloured residual or model error.

    Parameters that the data do not determine keep their infinite variance.
    """
    covariance = minimum.covariance.copy()
    determined = np.flatnonzero(minimum.free & np.isfinite(np.diag(covariance)))
    count = len(problem.freedom.free)
    own, states = determined[determined < count], determined[determined >= count]
    if len(own) and minimum.samples > len(determined):
        part = problem.shortened(CURVATURE_SAMPLES)
        found = model_error_covariance(problem, minimum.estimate, own, states, part, minimum.penalty)
        covariance[np.ix_(own, own)] = found
    return covariance


def _sample_time(start: Cascade, records: Record | Sequence[Record]) -> float | None:
    """The sample time of the cascade, or else of the first record."""
    first = records if isinstance(records, Record) else next(iter(records), None)
    return start.dt if first is None or start.dt is not None else first.dt


def _propagated(spread: Array, covariance: Array) -> Array:
    """C·Σ·Cᵀ; infinite where it depends on a parameter of infinite variance."""
    lost = np.isinf(np.diag(covariance))
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    result: Array = spread @ finite @ spread.T
    touched = np.flatnonzero(np.abs(spread[:, lost]).sum(axis=1) > 0)
    result[touched, touched] = np.inf
    return result


def static_band(fit: Fit[Cascade], block: int, x: ArrayLike) -> Array:
    """(m, 2) the value of a static map and its standard error at inputs x (m,).

    Args:
        fit: of a cascade, in the normalisation it was fitted in.
        block: index of the block, from 0.
        x: (m,) inputs of that map.

    Raises:
        ModelError: if that block is not a static map.
    """
    model = fit.model
    if not 0 <= block < len(model.blocks):
        raise ModelError(f"{model.name}: no block {block}; they are counted from 0 to {len(model.blocks) - 1}")
    chosen = model.blocks[block]
    if not isinstance(chosen, StaticMap):
        raise ModelError(f"{model.name}: block {block + 1} is a filter; a band is drawn for static maps")
    at = np.asarray(x, dtype=float)
    rows = chosen.parameter_gradient(at)
    span = model.spans[block]
    inside = [(j, model.names.index(name) - span.start) for j, name in enumerate(fit.names)]
    pairs = [(j, k) for j, k in inside if 0 <= k < span.stop - span.start]
    columns, owned = [j for j, _ in pairs], [k for _, k in pairs]
    part = fit.covariance[np.ix_(columns, columns)]
    variance = np.einsum("im,ij,jm->m", rows[owned], np.where(np.isfinite(part), part, 0.0), rows[owned])
    return np.column_stack([chosen.value(at), np.sqrt(np.maximum(variance, 0))])
