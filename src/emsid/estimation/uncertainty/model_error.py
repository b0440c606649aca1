r"""The covariance of an estimate whose model is not the system: its distance from what infinitely many data would give.

With little noise the residual is model error. It is not random: it depends on the input, and repeats when the input
does. The estimate still settles, at the θ* that is best for that kind of input, and

    cov θ̂ = H⁻¹ Ω H⁻¹,      H = JᵀJ + Σₜ rₜ ∂²rₜ/∂θ²,      Ω = var Σₜ Jₜrₜ

(Ljung 1978; White 1982). Both parts differ from those for noise:

- Ω is estimated in two ways: from the colour of the residual alone, for which all samples serve
(`coloured_residuals`), and from the products Jₜrₜ with Bartlett's weights, which allows for their correlation but needs
more data (`robust_covariance`). The bound that is used is no smaller than either in any direction.
- H keeps its second part, as r does not average out: a dead zone fitted to a rounded corner has its largest error at
its edge. ∂²r/∂θ² of an edge is a pulse, so it is found from how J changes over a step, of the size of the
uncertainty, in each of the directions in which J has orthonormal columns. The residual is that of the minimum: one that
changed too would add (∂²r/∂θ²)², which would make badly known directions look steep. Where the residual is noise after
all, the sum is noise too: every element is shrunk by 1 − (its variance)/(its square), to zero where that is negative
(James & Stein 1961).

In such coordinates all directions count alike, JᵀJ is one, and starting states are out of the way once they come first
in the triangular factor.

References:
    James, Stein, *Estimation with quadratic loss*, 4th Berkeley Symposium (1961). Ljung, *Convergence analysis of
    parametric identification methods*, IEEE TAC 23 (1978). White, *Maximum likelihood estimation of misspecified
    models*, Econometrica 50 (1982).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.nonlinear.gauss_newton import Infeasible, Problem
from emsid.estimation.uncertainty.coloured_residuals import coloured_covariance
from emsid.estimation.uncertainty.robust_covariance import automatic_window, weighted_variance

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Steps over which the derivative's change is looked at, in standard errors.
STEP = 1.5
# The second part of H is an estimate, so it changes the curvature in any direction by no more than these factors.
FLATTEST, STEEPEST = 0.2, 5.0


def model_error_covariance(problem: Problem, theta: Array, own: Indices, others: Indices, part: Problem) -> Array:
    """(p, p) covariance of the parameters ``own`` at a minimum of squares.

    Args:
        problem: residuals and derivatives.
        theta: where its minimum is.
        own: p positions in θ; the derivatives by these and ``others`` together of full rank.
        others: positions of what is estimated too but has no covariance to be returned, such as starting states.
        part: the problem on those samples that the second part of H is found from; ``problem`` itself for all.
    """
    order = np.concatenate([others, own])
    blocks = problem.linearised(theta)
    inverse = np.linalg.inv(np.linalg.qr(np.concatenate([jacobian[:, order] for _, jacobian in blocks]), mode="r"))
    directions = np.zeros((len(theta), len(own)))
    directions[order] = inverse[:, len(others) :]
    pieces = [(residual, jacobian @ directions) for residual, jacobian in blocks]
    samples = sum(len(residual) for residual, _ in pieces)
    scores = [residual[:, None] * orthonormal for residual, orthonormal in pieces]
    correction = samples / max(samples - len(order), 1)
    spread = upper_bound(coloured_covariance(pieces), correction * weighted_variance(scores, automatic_window(scores)))
    bend = _bend(part, theta, directions, STEP * np.sqrt(np.diag(spread)))
    bent, axes = np.linalg.eigh(np.eye(len(own)) + bend * samples / sum(map(len, part.residuals(theta))))
    flat = inverse[len(others) :, len(others) :] @ (axes / np.clip(bent, FLATTEST, STEEPEST)) @ axes.T
    covariance: Array = flat @ spread @ flat.T
    return covariance


def upper_bound(one: Array, other: Array) -> Array:
    """A covariance (p, p) that is no smaller than either of two in any direction, and equal to one of them in most."""
    size, axes = np.linalg.eigh(one)
    if not size[-1] > 0:
        return other
    root = axes * np.sqrt(np.maximum(size, 1e-12 * size[-1]))
    back = np.linalg.inv(root)
    ratio, sides = np.linalg.eigh(back @ other @ back.T)
    mixed = root @ sides
    bound: Array = (mixed * np.maximum(ratio, 1.0)) @ mixed.T
    return bound


def _bend(problem: Problem, theta: Array, directions: Array, steps: Array) -> Array:
    """(p, p) Σₜ rₜ ∂²rₜ/∂θ² along the directions (q, p), less what is noise; zero for steps out of bounds."""
    residuals = problem.residuals(theta)
    bend, error = np.zeros((2, len(steps), len(steps)))
    for k, step in enumerate(steps):
        if not step > 0:
            continue
        try:
            ahead, behind = (_jacobians(problem, theta + move * directions[:, k]) for move in (step, -step))
        except Infeasible:
            continue
        shares = [
            residual[:, None] * ((one - other) @ directions) / (2 * step)
            for residual, one, other in zip(residuals, ahead, behind, strict=True)
        ]
        bend[:, k] = np.sum([share.sum(axis=0) for share in shares], axis=0)
        error[:, k] = np.diag(weighted_variance(shares, automatic_window(shares)))
    bend, error = (bend + bend.T) / 2, (error + error.T) / 2
    noise = np.divide(error, bend**2, out=np.ones_like(bend), where=bend != 0)
    shrunk: Array = bend * np.maximum(1 - noise, 0)
    return shrunk


def _jacobians(problem: Problem, theta: Array) -> list[Array]:
    with np.errstate(over="ignore", invalid="ignore"):
        problem.residuals(theta)  # says whether there are any
        jacobians = [jacobian for _, jacobian in problem.linearised(theta)]
    if not all(np.isfinite(jacobian).all() for jacobian in jacobians):
        raise Infeasible("a derivative that is not finite")
    return jacobians
