r"""The covariance of an estimate under model error, about its limit for infinitely many data.

With little noise the residual is mostly model error, which is a function of the input. The estimate still converges,
to the θ* that is best for this kind of input, and

    cov θ̂ = H⁻¹ Ω H⁻¹,      H = JᵀJ + Σₜ rₜ ∂²rₜ/∂θ²,      Ω = var Σₜ Jₜrₜ

(Ljung 1978; White 1982). Both Ω and H differ from those for noise:

- Ω is estimated in two ways: from the colour of the residual alone, which uses all samples (`coloured_residuals`),
and from the products Jₜrₜ with Bartlett's weights, which includes their correlation but needs more data
(`robust_covariance`). The upper bound that is used is no smaller than either in any direction.
- H keeps its second term, because r does not average out: a dead zone fitted to a rounded corner has its largest error
at its edge. ∂²r/∂θ² of an edge is a pulse, so it is computed from the change of J over a step of the size of the
uncertainty, in each of the directions in which J has orthonormal columns. The residual is kept at that of the minimum;
a residual that changed too would add (∂²r/∂θ²)² and make poorly known directions look steep. If the residual is noise,
the sum is noise too: every element is shrunk by 1 − (its variance)/(its square), or to zero where that is negative
(James & Stein 1961).

In these coordinates JᵀJ is the identity. Initial states are eliminated by putting them first in the triangular factor.

References:
    James, Stein, *Estimation with quadratic loss*, 4th Berkeley Symposium (1961). Ljung, *Convergence analysis of
    parametric identification methods*, IEEE TAC 23 (1978). White, *Maximum likelihood estimation of misspecified
    models*, Econometrica 50 (1982).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.nonlinear.problem import Infeasible, Problem
from emsid.estimation.nonlinear.smoothing import Penalty
from emsid.estimation.uncertainty.coloured_residuals import coloured_covariance, effective_samples
from emsid.estimation.uncertainty.robust_covariance import automatic_window, weighted_variance

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# The step over which the change of the derivative is computed, in standard errors.
STEP = 1.5
# The second term of H is an estimate, so its effect on the curvature in any direction is limited to these factors.
FLATTEST, STEEPEST = 0.2, 5.0
# A derivative from this size on, where a run nearly diverges, is no number once it is squared twice.
LARGEST = 1e75


def model_error_covariance(
    problem: Problem, theta: Array, own: Indices, others: Indices, part: Problem, penalty: Penalty | None = None
) -> Array:
    """(p, p) covariance of the parameters ``own`` at a minimum of squares.

    Args:
        problem: residuals and derivatives.
        theta: its minimum.
        own: p positions in θ; the derivatives with respect to these and ``others`` have full rank.
        others: positions of parameters that are estimated too but not returned, such as initial states.
        part: the problem on the samples that give the second term of H; ``problem`` itself for all samples.
        penalty: on roughness, with a weight for a residual that counts as its independent samples. It belongs to H;
            its rows are errors of the variance of the residual times the samples for each independent one, so that the
            covariance includes the bias of a smooth curve.
    """
    order, penalty = np.concatenate([others, own]), penalty or Penalty.none(len(theta))
    blocks = problem.linearised(theta)
    rows = [*(jacobian[:, order] for _, jacobian in blocks), penalty.rows[:, order]]
    inverse = np.linalg.inv(np.linalg.qr(np.concatenate(rows), mode="r"))
    directions = np.zeros((len(theta), len(own)))
    directions[order] = inverse[:, len(others) :]
    pieces = [(residual, jacobian @ directions) for residual, jacobian in blocks]
    samples = sum(len(residual) for residual, _ in pieces)
    scores = [residual[:, None] * orthonormal for residual, orthonormal in pieces]
    correction = samples / max(samples - len(order), 1)
    rough = penalty.rows @ directions
    coloured = coloured_covariance(pieces, rough)
    spread = upper_bound(coloured, correction * weighted_variance(scores, automatic_window(scores)))
    residuals = [residual for residual, _ in pieces]
    variance = np.mean(np.concatenate(residuals) ** 2) * samples / effective_samples(residuals)
    spread += correction * variance * rough.T @ rough
    bend = _residual_curvature(part, theta, directions, STEP * np.sqrt(np.diag(spread)))
    bent, axes = np.linalg.eigh(np.eye(len(own)) + bend * samples / sum(map(len, part.residuals(theta))))
    flat = inverse[len(others) :, len(others) :] @ (axes / np.clip(bent, FLATTEST, STEEPEST)) @ axes.T
    covariance: Array = flat @ spread @ flat.T
    return covariance


def upper_bound(one: Array, other: Array) -> Array:
    """A covariance (p, p) that is no smaller than either of two in any direction."""
    size, axes = np.linalg.eigh(one)
    if not size[-1] > 0:
        return other
    root = axes * np.sqrt(np.maximum(size, 1e-12 * size[-1]))
    back = np.linalg.inv(root)
    ratio, sides = np.linalg.eigh(back @ other @ back.T)
    mixed = root @ sides
    bound: Array = (mixed * np.maximum(ratio, 1.0)) @ mixed.T
    return bound


def _residual_curvature(problem: Problem, theta: Array, directions: Array, steps: Array) -> Array:
    """(p, p) Σₜ rₜ ∂²rₜ/∂θ² along the directions (q, p), minus its noise; zero where a step is infeasible."""
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
        problem.residuals(theta)  # raises Infeasible if there is none
        jacobians = [jacobian for _, jacobian in problem.linearised(theta)]
    if not all(np.abs(jacobian).max(initial=0.0) < LARGEST for jacobian in jacobians):
        raise Infeasible("a derivative that is not finite")
    return jacobians
