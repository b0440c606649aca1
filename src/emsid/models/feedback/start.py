"""The initial state of a free run, estimated from the first samples of a segment."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.few_unknowns import few_unknowns
from emsid.models.feedback.kernels import LoopSignals

Array = NDArray[np.float64]

# Weight of the state at rest in the first estimate, relative to the samples of the start.
REST = 1e-2
# Effort: within half a standard error for the first estimate, which gives the variance of the residual, and then within
# a twentieth.
FIRST_LOOK: dict[str, Any] = {"max_iterations": 4, "tolerance": 0.5}
START_BUDGET: dict[str, Any] = {"max_iterations": 8, "tolerance": 0.05}
# At most this many states of a run from rest are tried as starts of the search.
TRIAL_STATES = 64
# The estimation begins at this many states that are not alike.
STARTS = 3
# States are collected over this many samples; the least relative spread of them in any direction.
REACHABLE_SAMPLES, LEAST_SPREAD = 10_000, 1e-12


class Startable(Protocol):
    """What the estimation of a state needs of a model; see `FeedbackModel`."""

    @property
    def oversampling(self) -> int: ...
    @property
    def states(self) -> int: ...
    @property
    def edge(self) -> int: ...
    @property
    def parameters(self) -> Array: ...
    def entering(self, u: Array) -> Array: ...
    def stepped(self, v: Array, x: Array) -> tuple[LoopSignals, Array]: ...
    def trajectory(self, u: Array, x: Array) -> LoopSignals: ...
    def output(self, u: Array, x: Array) -> Array: ...
    def gradient(self, u: Array, passed: LoopSignals) -> Array: ...
    def resting(self, level: float) -> Array: ...


@dataclass(frozen=True, eq=False)
class _Start:
    """The least-squares problem for the state, with a prior ‖firmness·(x − centre)‖."""

    model: Startable
    u: Array
    y: Array
    centre: Array
    firmness: Array

    def residuals(self, theta: Array) -> list[Array]:
        error = self.model.output(self.u, theta) - self.y
        return [error[self.model.edge :], self.firmness @ (theta - self.centre)]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        passed = self.model.trajectory(self.u, theta)
        rows = self.model.gradient(self.u, passed)[:, len(self.model.parameters) :]
        error = passed.y[:: self.model.oversampling] - self.y
        edge = self.model.edge
        return [(error[edge:], rows[edge:]), (self.firmness @ (theta - self.centre), self.firmness)]


def starting(model: Startable, u: Array, y: Array) -> Array:
    """(n,) the state at the first sample of a segment.

    A few samples hardly determine the state of a slow pole, and its error would last long. So the state is estimated
    twice: first hardly with a prior, for the variance of the residual, and then with a prior weighted by that
    variance: mean and covariance of the states that this input produces. The search starts at those of these states,
    and of the state at rest, that fit best.

    Args:
        model: with parameters.
        u: (N,) input of the segment.
        y: (m ≤ N,) measured output of its first samples; without it, the state at rest is returned.
    """
    rest = model.resting(float(u[0])) if len(u) else np.zeros(model.states)
    if not (model.states and len(y)):
        return rest
    u = np.ascontiguousarray(u)
    begin, cloud = u[: len(y)], _reachable(model, u[:REACHABLE_SAMPLES], rest)
    trials = np.vstack([rest, cloud[:: -(-len(cloud) // TRIAL_STATES) or 1]])
    missed = np.array([_missed(model, begin, y, x) for x in trials])
    if not np.isfinite(missed).any():
        return rest
    found = []
    for first in _apart(trials[np.isfinite(missed)], missed[np.isfinite(missed)]):
        rows = model.gradient(begin, model.trajectory(begin, first))[model.edge :, len(model.parameters) :]
        weak = np.diag(REST * np.linalg.norm(rows, axis=0))
        with suppress(ModelError):
            found.append(few_unknowns(_Start(model, begin, y, rest, weak), first, **FIRST_LOOK))
    if not found:
        return rest
    free, (error, _) = min(found, key=lambda each: float(each[1][0] @ each[1][0]))
    freedom = len(y) - model.edge - model.states
    variance = float(error @ error) / freedom if freedom > 0 else 0.0
    if not (variance > 0 and len(cloud) > 1):
        return free
    with np.errstate(over="ignore", invalid="ignore"):
        centre, spread = cloud.mean(axis=0), np.atleast_2d(np.cov(cloud.T))
    if not np.isfinite(spread).all():
        return free
    size, axes = np.linalg.eigh(spread)
    if not size[-1] > 0:
        return free
    firmness = np.sqrt(variance / np.maximum(size, LEAST_SPREAD * size[-1]))[:, None] * axes.T
    return few_unknowns(_Start(model, begin, y, centre, firmness), free, **START_BUDGET)[0]


def _apart(states: Array, missed: Array) -> list[Array]:
    """The best states that differ by the standard deviation of all of them, at most `STARTS`.

    A model that loses the sign of a signal has several states that fit the first samples almost equally well.
    """
    size = np.std(states, axis=0)
    size[size == 0] = 1.0
    chosen: list[Array] = []
    for k in np.argsort(missed):
        if all(np.abs((states[k] - each) / size).max() > 1 for each in chosen):
            chosen.append(states[k])
        if len(chosen) == STARTS:
            break
    return chosen


def _missed(model: Startable, u: Array, y: Array, x: Array) -> float:
    """The squared error from a state; infinite where the run diverges."""
    with np.errstate(over="ignore", invalid="ignore"):
        error = (model.stepped(model.entering(u), x)[0].y[:: model.oversampling] - y)[model.edge :]
        square = float(error @ error)
    return square if np.isfinite(square) else np.inf


def _reachable(model: Startable, u: Array, rest: Array) -> Array:
    """(K, n) the states that an input (N,) produces from rest."""
    out, _ = model.stepped(model.entering(u), rest)
    visited: Array = out.x[np.isfinite(out.y)]
    return visited
