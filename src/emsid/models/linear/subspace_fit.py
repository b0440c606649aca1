r"""State-space models estimated by a subspace method, then refined by Gauss–Newton steps with exact derivatives.

The subspace estimate (see `emsid.estimation.linear.subspace`) needs no start and no search. The refinement minimises
the prediction error of the innovations form, or with ``free_run`` the error of the free run, where K = 0.

Another basis of the state, T A T⁻¹, T B, C T⁻¹, gives the same model. The search varies the numbers of the modal
form (`Modal`), so that its parameters are determined. Intervals are given of numbers that depend on no basis: the
coefficients of the transfer functions as sums over modes, by linear propagation.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 7.2 and 10.6.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil, exp, log

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.information import Information
from emsid.estimation.linear.least_squares import check_excitation
from emsid.estimation.linear.modal_form import Modal
from emsid.estimation.linear.subspace import (
    LEAST,
    Signals,
    Subspace,
    Weighting,
    cva,
    input_part,
    moesp,
    noise_gain,
)
from emsid.estimation.linear.vector_fitting import fitted_poles, most_pairs, without_poles
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import SQUARES, Block, Columns, Infeasible, Mask, SparseProblem, trial_cost
from emsid.models.linear.state_space import StateSpaceModel
from emsid.record import Record, check_same_channels
from emsid.selection.improvement import matters

Array = NDArray[np.float64]

__all__ = [
    "StateSpaceError",
    "StateSpaceStructure",
    "SubspaceModels",
    "cva",
    "fit_state_space",
    "moesp",
    "state_space",
    "subspace_models",
]

HORIZON = 20
"""Samples of past and of future by default; fewer in short records."""
ROWS_PER_COLUMN = 4
"""A horizon gives at least this many rows for every column of past and future data."""
MOST_ORDERS = 10
"""The largest order that is tried where none is given."""
MOST_PAIRS = 24
"""The pairs of poles that vector fitting begins with where no order is given."""
SHORT = 8
"""The samples that give the initial state of a free run are at most this part of the shortest segment."""
OUTSIDE = 1.0
"""A predictor or free run with an eigenvalue of this size diverges."""
ROUNDING = 1e-12
"""Residuals of this size, relative to the scale of the output, are rounding."""
DIFFERENCE = 1e-5
"""Step of the differences that propagate intervals to coefficients, in the scaled matrices."""


@dataclass(frozen=True)
class StateSpaceStructure:
    """A state-space model before its estimation; see `state_space`.

    Args:
        order: number of states; None to choose it.
        direct: whether there is a D.
        horizon: samples of past and future data.
        weighting: of the singular value decomposition.
        name: in tables and files.
    """

    order: int | None = None
    direct: bool = False
    horizon: int | None = None
    weighting: Weighting = cva
    name: str = "state-space"

    @classmethod
    def of(cls, model: StateSpaceModel) -> StateSpaceStructure:
        """That of a fitted model; how its start was found is not kept."""
        return cls(model.order, bool(model.d.any()), name=model.name)


def state_space(
    order: int | None = None, *, direct: bool = False, horizon: int | None = None, weighting: Weighting = cva
) -> StateSpaceStructure:
    """A linear model in state space, for any number of inputs and outputs; `emsid.fit` estimates it.

    ``x(t+1) = A x + B u + K e``, ``y = C x + D u + y₀ + e``.

    >>> state_space(order=2).order
    2

    Args:
        order: number of states; by default chosen from the singular values of the data.
        direct: whether the input affects the output in the same sample (D is not zero).
        horizon: samples of past and future data, more than ``order``; by default 20, fewer in short records.
        weighting: of the singular value decomposition, `cva` (canonical variates) or `moesp` of
            `emsid.estimation.linear.subspace`.

    Raises:
        ModelError: for numbers that are not whole or too small.
    """
    for what, value, least in (("order", order, 1), ("horizon", horizon, 2)):
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least):
            raise ModelError(f"state_space: {what} {value!r}; give a whole number of at least {least}")
    if order is not None and horizon is not None and horizon <= order:
        raise ModelError(f"state_space: a horizon of {horizon} for order {order}; give more samples than states")
    return StateSpaceStructure(order, direct, horizon, weighting)


def fit_state_space(
    structure: StateSpaceStructure,
    records: Record | Iterable[Record],
    *,
    free_run: bool = False,
    refine: bool = True,
    max_iterations: int = 50,
    control: Control = FREE,
    left_out: Sequence[Mask] | None = None,
) -> Fit[StateSpaceModel]:
    """A state-space model by a subspace method, refined by Gauss–Newton steps.

    Args:
        structure: its order and more.
        records: a record, or several experiments with the same channels.
        free_run: minimise the error of the free run, with K = 0, instead of the prediction error.
        refine: whether to refine; without it there are no intervals.
        max_iterations: the largest number of Gauss–Newton steps.
        control: when to stop.
        left_out: (N,) the samples of every segment that the refinement does not fit.

    Returns:
        A fit of the coefficients of its transfer functions, which do not depend on the basis of the state.

    Raises:
        ModelError: for records too short for the order, or without any output.
    """
    start = subspace_models(structure, records, left_out)
    asked = structure.order or (None if free_run else start.order)
    vectors = start.resonant(asked, structure.direct) if refine else None
    order = asked or (start.order if vectors is None else vectors.order)
    begun = [] if vectors is None else [vectors]
    if order <= start.subspace.most:
        begun.append(start.model(order, structure.direct, noise=not free_run))
    problems = [StateSpaceError(each, start, structure.direct, free_run) for each in begun]
    problem = min(problems, key=lambda each: trial_cost(each, np.zeros(each.size), SQUARES))
    if not refine:
        return problem.fit(None)
    begin = np.zeros(problem.size)
    return problem.fit(gauss_newton(problem, begin, max_iterations=max_iterations, noise=ROUNDING, control=control))


@dataclass(frozen=True, eq=False)
class SubspaceModels:
    """The models of all orders from one factor.

    Attributes:
        subspace: of the scaled data.
        segments: outputs and inputs of all segments, less their means and divided by their scale.
        kept: (N,) their samples that are fitted.
        pieces: the parts of the segments that are fitted, as far as they are long enough for the horizon.
        means, scales: of outputs and inputs.
        first: the first record.
    """

    subspace: Subspace
    segments: tuple[Signals, ...]
    kept: tuple[Mask, ...]
    pieces: tuple[Signals, ...]
    means: Signals
    scales: Signals
    first: Record

    @property
    def order(self) -> int:
        """The order that the singular values show."""
        return self.subspace.order(MOST_ORDERS)

    def model(self, order: int, direct: bool = False, noise: bool = True) -> StateSpaceModel:
        """The model of an order, in the units of the record; K = 0 unless it has ``noise``.

        Raises:
            ModelError: for an order that the horizon does not show.
        """
        a, c, state = self.subspace.observability(order)
        part = input_part(a, c, self.pieces, direct)
        gain = np.zeros((order, len(c)))
        if noise:
            gain = noise_gain(a, c, part, state, self.pieces, self.subspace.horizon)
        scaled = StateSpaceModel(a, part.b, c, part.d, gain, part.level, self.first.dt)
        return self.in_units(scaled)

    def resonant(self, order: int | None, direct: bool) -> StateSpaceModel | None:
        """The model by `vector_fitting` without noise model, in the units of the record; None for short records.

        Without an order that is given, it is the smallest one that leaves negligibly more than the best.
        """
        pairs = min(MOST_PAIRS if order is None else order, most_pairs(self.pieces))
        if not pairs:
            return None
        found = list(without_poles(fitted_poles(self.pieces, pairs, direct), self.pieces, direct))
        least = min(error for error, _, _ in found)
        good = [(a, c) for error, a, c in found if (not matters(least, error) if order is None else len(a) == order)]
        if not good:
            return None
        a, c = good[-1]
        part = input_part(a, c, self.pieces, direct)
        gain = np.zeros((len(a), len(c)))
        return self.in_units(StateSpaceModel(a, part.b, c, part.d, gain, part.level, self.first.dt))

    def in_units(self, model: StateSpaceModel) -> StateSpaceModel:
        """A model of the scaled signals as one of the signals of the record."""
        (y_scale, u_scale), (y_mean, u_mean) = self.scales, self.means
        found = replace(
            model,
            b=model.b / u_scale,
            c=y_scale[:, None] * model.c,
            d=y_scale[:, None] * model.d / u_scale,
            k=model.k / y_scale,
            level=y_scale * model.level + y_mean,
        )
        state = found.at_rest(u_mean)
        return replace(found, level=found.level - found.c @ state - found.d @ u_mean)

    def in_scale(self, model: StateSpaceModel) -> StateSpaceModel:
        """The inverse of `in_units`."""
        (y_scale, u_scale), (y_mean, u_mean) = self.scales, self.means
        rest = model.c @ model.at_rest(u_mean) + model.d @ u_mean
        return replace(
            model,
            b=model.b * u_scale,
            c=model.c / y_scale[:, None],
            d=model.d * u_scale / y_scale[:, None],
            k=model.k * y_scale,
            level=(model.level + rest - y_mean) / y_scale,
        )


def subspace_models(
    structure: StateSpaceStructure, records: Record | Iterable[Record], left_out: Sequence[Mask] | None = None
) -> SubspaceModels:
    """The models of all orders that a horizon shows, from one triangular factor of the data that are not left out.

    Raises:
        ModelError: for records that are too short, or an input that never changes.
    """
    several = [records] if isinstance(records, Record) else list(records)
    for record in several:
        check_excitation(record)
        check_same_channels(several[0], record)
        if not record.output.shape[1]:
            raise ModelError(f"{record.name} has no output to fit {structure.name} to")
    every = [segment for record in several for segment in record.segments]
    kept = [~out for out in left_out] if left_out else [np.ones(len(segment), dtype=bool) for segment in every]
    outputs, inputs = (
        np.concatenate([signals[own] for signals, own in zip(each, kept, strict=True)])
        for each in ([segment.output for segment in every], [segment.input for segment in every])
    )
    means = outputs.mean(axis=0), inputs.mean(axis=0)
    scales = _scale(outputs), _scale(inputs)
    segments = [((s.output - means[0]) / scales[0], (s.input - means[1]) / scales[1]) for s in every]
    edges = [np.flatnonzero(np.diff(own, prepend=False, append=False)).reshape(-1, 2) for own in kept]
    pieces = [(y[i:k], u[i:k]) for (y, u), some in zip(segments, edges, strict=True) for i, k in some]
    horizon = structure.horizon or _horizon(pieces or segments, structure.order or 1)
    long = [(y, u) for y, u in pieces if len(y) >= 2 * horizon]
    if not long:
        raise ModelError(f"{several[0].name}: no segment has {2 * horizon} samples; choose a smaller order or horizon")
    used = [k for k, (y, _) in enumerate(segments) if len(y) >= 2 * horizon]
    return SubspaceModels(
        Subspace.of(long, horizon, structure.weighting),
        tuple(segments[k] for k in used),
        tuple(kept[k] for k in used),
        tuple(long),
        means,
        scales,
        several[0],
    )


def _scale(signals: Array) -> Array:
    """(c,) the standard deviation of every channel; one where it is constant."""
    spread = signals.std(axis=0)
    return np.where(spread > 0, spread, 1.0)


def _horizon(segments: Sequence[Signals], order: int) -> int:
    """`HORIZON`, or fewer samples in short records, at least one more than the order needs."""
    channels = segments[0][0].shape[1] + segments[0][1].shape[1]
    wanted = max(HORIZON, 2 * order)
    while wanted > order + 1:
        rows = sum(max(len(y) - 2 * wanted + 1, 0) for y, _ in segments)
        if rows >= ROWS_PER_COLUMN * (1 + 2 * wanted * channels):
            break
        wanted -= 1
    return max(wanted, 2)


class StateSpaceError(SparseProblem):
    """Residuals ŷ − y of a state-space model in modal form around a start, with their exact derivative.

    β = 0 is the start, and β the change of the numbers of `Modal` and of the initial states of all segments. What is
    modal is the free run, or else the predictor, which u and y drive. Residuals and derivatives of all outputs combine
    the same few signals. `columns` reduces these to a triangular factor and combines its rows, which have the same sums
    of squares and products.

    Args:
        model: the start.
        data: the scaled segments.
        direct: whether D is varied.
        free_run: whether the free run is minimised; K is then zero.
    """

    def __init__(self, model: StateSpaceModel, data: SubspaceModels, direct: bool, free_run: bool) -> None:
        self.data, self.direct, self.free_run = data, direct, free_run
        self.start = start = data.in_scale(replace(model, k=0.0 * model.k) if free_run else model)
        self.kept = data.kept
        self.driving = [
            np.ascontiguousarray((u if free_run else np.hstack([u, y])).T) for y, u in data.segments
        ]  # (nv, N)
        a, b, d = start.predictor
        inputs, level = len(self.driving[0]), start.level - start.c @ _at_one(a, b[:, start.b.shape[1] :] @ start.level)
        self.modal = Modal.of(a, b[:, :inputs], start.c, d[:, :inputs], level)
        m = len(self.modal.centre)
        self.first = np.zeros((len(data.segments), m, 2))
        for own, v, (y, _), kept in zip(self.first, self.driving, data.segments, self.kept, strict=True):
            own[:] = self._first_state(v, y, kept)
        self.theta = np.concatenate([np.ravel(each) for each in (*self.modal.varied, self.first)])
        fixed = list(self.modal.fixed)
        fixed[-2][:, :] = not direct
        fixed[-2][:, start.b.shape[1] :] = True
        alone = np.broadcast_to(np.stack([self.modal.single, np.zeros(m, dtype=bool)], axis=1), self.first.shape)
        self.free = ~np.concatenate([np.ravel(each) for each in (*fixed, alone)])
        self.weight = np.eye(1) if len(start.level) == 1 else self._weight()

    def _first_state(self, v: Array, y: Array, kept: Mask) -> Array:
        """(m, 2) the initial state of a segment by least squares on all of it, as slow modes need."""
        modal, signals = self.modal, self.modal.signals(v)
        rest = np.zeros((len(modal.centre), 2))
        left = y.T - modal.c.reshape(len(y.T), -1) @ modal.states(signals, rest).reshape(-1, len(y)) - modal.d @ v
        alone = signals[:, -1:]
        responses = np.stack([modal.through_first(alone), alone], axis=1)[:, :, 0]  # (m, 2, 2, N)
        total = Information.empty(rest.size)
        for c, error in zip(modal.c, left - modal.level[:, None], strict=True):
            rows = np.einsum("mp,mspn->msn", c, responses).reshape(rest.size, -1)
            total = total.add_columns(np.vstack([rows, error])[:, kept])
        return total.solve(LEAST).estimate.reshape(rest.shape)

    @property
    def size(self) -> int:
        """The number of coordinates β."""
        return int(self.free.sum())

    @property
    def samples(self) -> int:
        """The number of residuals."""
        return len(self.start.level) * sum(int(kept.sum()) for kept in self.kept)

    def _at(self, beta: Array) -> tuple[Modal, Array]:
        """The modal form, and the initial states (segments, m, 2), at β."""
        theta = self.theta.copy()
        theta[self.free] += beta
        like = *self.modal.varied, self.first
        split = np.split(theta, np.cumsum([each.size for each in like[:-1]]))
        *varied, first = (part.reshape(each.shape) for part, each in zip(split, like, strict=True))
        return self.modal.with_varied(varied), first

    def model(self, beta: Array) -> StateSpaceModel:
        """The scaled model at β."""
        modal, inputs = self._at(beta)[0], self.start.b.shape[1]
        a, b, c = modal.matrices()
        k = np.zeros((len(a), len(c))) if self.free_run else b[:, inputs:]
        d = modal.d[:, :inputs]
        level = np.asarray(np.linalg.lstsq(np.eye(len(c)) - c @ _at_one(a, k), modal.level, rcond=None)[0])
        return replace(self.start, a=a + k @ c, b=b[:, :inputs] + k @ d, c=c, d=d, k=k, level=level)

    def _runs(self, beta: Array) -> Iterator[tuple[Array, Array, Array]]:
        """The signals of `Modal`, the states (m, 2, N) and ŷ − y (ny, N) of every segment.

        Raises:
            Infeasible: for an unstable run.
        """
        modal, first = self._at(beta)
        if modal.radius > OUTSIDE:
            raise Infeasible(f"{self.start.name}: the model becomes unstable")
        for v, x, (y, _) in zip(self.driving, first, self.data.segments, strict=True):
            signals = modal.signals(v)
            states = modal.states(signals, x)
            seen = modal.c.reshape(len(modal.c), -1) @ states.reshape(-1, len(y))
            yield signals, states, seen + modal.d @ v + modal.level[:, None] - y.T

    def _weight(self) -> Array:
        """(ny, ny) W so that the residuals W (ŷ − y) of the start are uncorrelated between outputs."""
        runs = zip(self._runs(np.zeros(self.size)), self.kept, strict=True)
        errors = np.concatenate([error[:, kept] for (_, _, error), kept in runs], axis=1)
        covariance = errors @ errors.T / errors.shape[1]
        if self.free_run:
            covariance = np.diag(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance)
        values = np.maximum(values, LEAST * values[-1])
        return np.asarray((vectors * np.sqrt(values.mean() / values)) @ vectors.T)

    def residuals(self, beta: Array) -> list[Array]:
        """(N,) of every output of every segment."""
        runs = zip(self._runs(beta), self.kept, strict=True)
        return [each for (_, _, error), kept in runs for each in self.weight @ error[:, kept]]

    def columns(self, beta: Array) -> Iterator[Columns]:
        """The rows of the factor for every output of every segment."""
        for residual, rows in self._linearised(beta, reduced=True):
            which = np.flatnonzero(rows.any(axis=1))
            yield Columns(residual, rows, which, which)

    def linearised(self, beta: Array) -> list[Block]:
        """The residuals (N,) and their derivatives (N, β), of every output of every segment."""
        return [(residual, rows.T) for residual, rows in self._linearised(beta, reduced=False)]

    def _linearised(self, beta: Array, reduced: bool) -> Iterator[tuple[Array, Array]]:
        """Residuals and derivatives (β, N), or the rows of the factor in place of the samples if ``reduced``."""
        modal, first = self._at(beta)
        for number, (signals, states, error) in enumerate(self._runs(beta)):
            v = self.driving[number]
            parts = [signals, modal.driven(states), np.vstack([v, np.ones(v.shape[1])]), self.weight @ error]
            rows = np.concatenate([each.reshape(-1, v.shape[1]) for each in parts])[:, self.kept[number]]
            if reduced:
                rows = Information.empty(len(rows) - 1).add_columns(rows).factor.T
            split = np.split(rows, np.cumsum([each.size // v.shape[1] for each in parts[:-1]]))
            signals, driven, v, errors = (
                part.reshape(*each.shape[:-1], rows.shape[1]) for part, each in zip(split, parts, strict=True)
            )
            for weights, residual in zip(self.weight, errors, strict=True):
                found, by_first = modal.derivatives(weights, first[number], signals, driven, v)
                of_start = np.zeros((*self.first.shape, rows.shape[1]))
                of_start[number] = by_first
                every = [each.reshape(-1, rows.shape[1]) for each in (*found, of_start)]
                yield residual, np.concatenate(every)[self.free]

    def coefficients(self, beta: Array) -> tuple[tuple[str, ...], Array]:
        """The names and values of the coefficients of the transfer functions, in the units of the record."""
        model = self.data.in_units(self.model(beta))
        return model.coefficients(self.direct, noise=not self.free_run and len(model.level) == 1)

    def fit(self, found: Minimum | None) -> Fit[StateSpaceModel]:
        """The fit, from the result of the search, or of the start alone."""
        beta = np.zeros(self.size) if found is None else found.estimate
        model = self.data.in_units(self.model(beta)).in_modal_form()
        if self.free_run:  # what is left of a wrong initial state lasts as long as the slowest mode
            size, most = self._at(beta)[0].radius, min(len(y) for y, _ in self.data.segments) // SHORT
            lasting = most if size**most > exp(-1) else ceil(-1 / log(max(size, 1e-3)))
            model = replace(model, start=max(model.start, lasting))
        names, values = self.coefficients(beta)
        scale = float(np.mean(self.data.scales[0] ** 2))
        if found is None:
            errors = np.concatenate(self.residuals(beta))
            unknown = np.diag(np.full(len(names), np.inf))
            return Fit(model, names, values, unknown, scale * float(np.mean(errors**2)), len(errors), np.inf, self.size,
                       method="subspace")  # fmt: skip
        step = DIFFERENCE * np.eye(self.size)
        slope = np.array([self.coefficients(beta + s)[1] - self.coefficients(beta - s)[1] for s in step]) / (
            2 * DIFFERENCE
        )
        freedom = self.samples - found.rank
        found = replace(found, samples=self.samples, noise_variance=2 * found.cost / freedom if freedom > 0 else np.nan)
        fit = found.judged().fit(model, [str(k) for k in range(self.size)], "gn" if self.free_run else "pem")
        certain = np.isfinite(np.diag(fit.covariance)).all()
        covariance = slope.T @ fit.covariance @ slope if certain else np.diag(np.full(len(names), np.inf))
        return replace(
            fit, names=names, estimate=values, covariance=covariance, noise_variance=scale * fit.noise_variance
        )


def _at_one(a: Array, b: Array) -> Array:
    """(I − A)⁻¹ B, the steady state of a stable system; the smallest one where A has an eigenvalue of one."""
    return np.asarray(np.linalg.lstsq(np.eye(len(a)) - a, b, rcond=None)[0])
