r"""State-space models estimated by a subspace method, then refined by Gauss–Newton steps with exact derivatives.

The subspace estimate (see `emsid.estimation.linear.subspace`) needs no start and no search. The refinement minimises
the prediction error of the innovations form, or with ``free_run`` the error of the free run, where K = 0.

Another basis of the state, T A T⁻¹, T B, C T⁻¹, gives the same model. The search varies only what is orthogonal to the
directions of a change of basis at its start (data-driven local coordinates, McKelvey, Helmersson & Ribarits 2004), so
that its parameters are determined. Intervals are given of numbers that depend on no basis: the coefficients of the
transfer functions ``A(q) yᵢ = Bᵢⱼ(q) uⱼ``, by linear propagation.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 7.2 and 10.6. McKelvey, Helmersson, Ribarits, *Data driven
    local coordinates for multivariable linear systems and their application to system identification*, Automatica 40
    (2004).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import check_excitation
from emsid.estimation.linear.subspace import (
    LEAST,
    Signals,
    Subspace,
    Weighting,
    cva,
    input_part,
    moesp,
    noise_gain,
    response_rows,
)
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Block, Infeasible
from emsid.estimation.nonlinear.without_samples import Mask, without
from emsid.models.linear.state_space import StateSpaceModel, run_linear
from emsid.record import Record, check_same_channels

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
    start = subspace_models(structure, records)
    order = start.order if structure.order is None else structure.order
    model = start.model(order, structure.direct, noise=not free_run)
    problem = StateSpaceError(model, start, structure.direct, free_run)
    if refine:
        begin, out = np.zeros(problem.size), left_out and [each for each in left_out for _ in model.level]
        found = gauss_newton(
            without(problem, out), begin, max_iterations=max_iterations, noise=ROUNDING, control=control
        )
        return problem.fit(found)
    return problem.fit(None)


@dataclass(frozen=True, eq=False)
class SubspaceModels:
    """The models of all orders from one factor.

    Attributes:
        subspace: of the scaled data.
        segments: outputs and inputs of all segments, less their means and divided by their scale.
        means, scales: of outputs and inputs.
        first: the first record.
    """

    subspace: Subspace
    segments: tuple[Signals, ...]
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
        part = input_part(a, c, self.segments, direct)
        gain = np.zeros((order, len(c)))
        if noise:
            gain = noise_gain(a, c, part, state, self.segments, self.subspace.horizon)
        scaled = StateSpaceModel(a, part.b, c, part.d, gain, part.level, self.first.dt)
        return self.in_units(scaled)

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


def subspace_models(structure: StateSpaceStructure, records: Record | Iterable[Record]) -> SubspaceModels:
    """The models of all orders that a horizon shows, from one triangular factor of the data.

    Raises:
        ModelError: for records that are too short, or an input that never changes.
    """
    several = [records] if isinstance(records, Record) else list(records)
    for record in several:
        check_excitation(record)
        check_same_channels(several[0], record)
        if not record.output.shape[1]:
            raise ModelError(f"{record.name} has no output to fit {structure.name} to")
    outputs = np.concatenate([record.output for record in several])
    inputs = np.concatenate([record.input for record in several])
    means = outputs.mean(axis=0), inputs.mean(axis=0)
    scales = _scale(outputs), _scale(inputs)
    segments = tuple(
        ((s.output - means[0]) / scales[0], (s.input - means[1]) / scales[1]) for r in several for s in r.segments
    )
    horizon = structure.horizon or _horizon(segments, structure.order or 1)
    long = [(y, u) for y, u in segments if len(y) >= 2 * horizon]
    if not long:
        raise ModelError(f"{several[0].name}: no segment has {2 * horizon} samples; choose a smaller order or horizon")
    return SubspaceModels(Subspace.of(long, horizon, structure.weighting), tuple(long), means, scales, several[0])


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


class StateSpaceError:
    """Residuals ŷ − y of a state-space model in coordinates around a start, with their exact derivative; see `Problem`.

    β = 0 is the start. The matrices are θ = θ₀ + Qβ, where Q spans what no change of basis reaches.

    Args:
        model: the start.
        data: the scaled segments.
        direct: whether D is varied.
        free_run: whether the free run is minimised; K is then zero.
    """

    def __init__(self, model: StateSpaceModel, data: SubspaceModels, direct: bool, free_run: bool) -> None:
        self.data, self.direct, self.free_run = data, direct, free_run
        self.start = data.in_scale(replace(model, k=0.0 * model.k) if free_run else model)
        samples = self.start.memory
        self.first = [self.start.first_state(y[:samples], u[:samples]) for y, u in data.segments]
        self.theta = self._vector(self.start, self.first)
        self.basis = self._basis()
        self.weight = self._weight()

    @property
    def size(self) -> int:
        """The number of coordinates β."""
        return int(self.basis.shape[1])

    def _vector(self, model: StateSpaceModel, first: Sequence[Array]) -> Array:
        """θ: the matrices and initial states as one vector."""
        parts = [model.a, model.b, model.c, model.level]
        parts += [model.d] * self.direct + [model.k] * (not self.free_run) + list(first)
        return np.concatenate([np.ravel(part) for part in parts])

    def model(self, beta: Array) -> tuple[StateSpaceModel, list[Array]]:
        """The scaled model and the initial states at β."""
        theta, taken, start = self.theta + self.basis @ beta, 0, self.start

        def take(like: Array) -> Array:
            nonlocal taken
            taken += like.size
            return theta[taken - like.size : taken].reshape(like.shape)

        a, b, c, level = take(start.a), take(start.b), take(start.c), take(start.level)
        d = take(start.d) if self.direct else start.d
        k = start.k if self.free_run else take(start.k)
        first = [take(each) for each in self.first]
        return replace(start, a=a, b=b, c=c, d=d, k=k, level=level), first

    def _basis(self) -> Array:
        """Q (θ, β): orthonormal, and orthogonal to the tangents of all changes of basis."""
        m, n = self.start, self.start.order
        tangents = []
        for k in range(n * n):
            x = np.zeros((n, n))
            x.flat[k] = 1.0
            moved = replace(m, a=x @ m.a - m.a @ x, b=x @ m.b, c=-m.c @ x, d=0.0 * m.d, k=x @ m.k, level=0.0 * m.level)
            tangents.append(self._vector(moved, [x @ each for each in self.first]))
        left, size, _ = np.linalg.svd(np.array(tangents).T)
        return left[:, int(np.sum(size > 1e-10 * size[0])) :]

    def _weight(self) -> Array:
        """(ny, ny) W so that the residuals (ŷ − y) Wᵀ of the start are uncorrelated between outputs; one output: 1."""
        outputs = len(self.start.level)
        if outputs == 1:
            return np.eye(1)
        errors = np.concatenate([e for e, _ in self._runs(np.zeros(self.size))])
        covariance = errors.T @ errors / len(errors)
        if self.free_run:
            covariance = np.diag(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance)
        values = np.maximum(values, LEAST * values[-1])
        return np.asarray((vectors * np.sqrt(values.mean() / values)) @ vectors.T)

    def _runs(self, beta: Array) -> list[tuple[Array, Array]]:
        """ŷ − y (N, ny) and the states x (N, n) of every segment.

        Raises:
            Infeasible: for an unstable run.
        """
        model, first = self.model(beta)
        a, b, d = model.predictor
        if np.abs(np.linalg.eigvals(a)).max() > OUTSIDE:
            raise Infeasible(f"{model.name}: the model becomes unstable")
        found = []
        for (y, u), x in zip(self.data.segments, first, strict=True):
            both = np.hstack([u, y - model.level])
            everything, nothing = np.eye(model.order), np.zeros((model.order, both.shape[1]))
            states = run_linear(a, b, everything, nothing, x, both)[0]
            found.append((states @ model.c.T + both @ d.T + model.level - y, states))
        return found

    def residuals(self, beta: Array) -> list[Array]:
        """(N,) of every output of every segment."""
        return [column for error, _ in self._runs(beta) for column in (error @ self.weight.T).T]

    def linearised(self, beta: Array) -> list[Block]:
        """The residuals and their derivatives (N, β)."""
        model, _ = self.model(beta)
        blocks = []
        for number, (error, states) in enumerate(self._runs(beta)):
            derivatives = np.array(
                [self._derivative(model, i, number, states, error) for i in range(error.shape[1])]
            )  # (ny, θ, N)
            for weights, residual in zip(self.weight, (error @ self.weight.T).T, strict=True):
                blocks.append((residual, np.tensordot(weights, derivatives, 1).T @ self.basis))
        return blocks

    def _derivative(self, model: StateSpaceModel, i: int, segment: int, states: Array, error: Array) -> Array:
        """(θ, N) the derivative of ŷᵢ by the matrices and the initial states."""
        n, samples = model.order, len(states)
        a, row, none = model.a - model.k @ model.c, model.c[i], np.zeros(n)

        def driven(signal: Array) -> Array:
            rows = np.empty((n, samples))
            response_rows(rows, *map(read_only, (a, row, signal, none)))
            return rows

        by_state = np.array([driven(x) for x in states.T])  # (n of signal, n driven, N)
        u = self.data.segments[segment][1]
        by_input = np.array([driven(s) for s in u.T])

        def read_out(responses: Array, signals: Array) -> Array:
            """By the rows of C, D or y₀, (ny, signals, N): direct in output i, and through −K."""
            found: Array = -np.einsum("pr,qpt->rqt", model.k, responses)
            found[i] += signals
            return found

        parts = [by_state.transpose(1, 0, 2), by_input.transpose(1, 0, 2), read_out(by_state, states.T)]
        ones = np.ones(samples)
        parts.append(read_out(driven(ones)[None], ones[None]))
        if self.direct:
            parts.append(read_out(by_input, u.T))
        if not self.free_run:
            parts.append(np.array([driven(-e) for e in error.T]).transpose(1, 0, 2))
        of_start = np.zeros((len(self.first), n, samples))
        response_rows(of_start[segment], *map(read_only, (a, row, np.zeros(samples), row)))
        return np.concatenate([part.reshape(-1, samples) for part in (*parts, of_start)])

    def coefficients(self, beta: Array) -> tuple[tuple[str, ...], Array]:
        """The names and values of the coefficients of the transfer functions, in the units of the record."""
        model = self.data.in_units(self.model(beta)[0])
        return model.coefficients(self.direct, noise=not self.free_run and len(model.level) == 1)

    def fit(self, found: Minimum | None) -> Fit[StateSpaceModel]:
        """The fit, from the result of the search, or of the start alone."""
        beta = np.zeros(self.size) if found is None else found.estimate
        model = self.data.in_units(self.model(beta)[0])
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
        fit = found.judged().fit(model, [str(k) for k in range(self.size)], "gn" if self.free_run else "pem")
        certain = np.isfinite(np.diag(fit.covariance)).all()
        covariance = slope.T @ fit.covariance @ slope if certain else np.diag(np.full(len(names), np.inf))
        return replace(
            fit, names=names, estimate=values, covariance=covariance, noise_variance=scale * fit.noise_variance
        )
