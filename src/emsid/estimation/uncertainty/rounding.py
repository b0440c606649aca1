r"""What a model can be where the only noise of a reading is its rounding to steps q, and how the step is found.

The error of rounding is no white noise: it is the same function of the signal for all samples with one reading, and
follows the motion. With S_g = Σ Jₜrₜ over a run g of samples with one reading, and runs that are independent,

    cov θ̂ = (JᵀJ)⁻¹ (Σ_g S_g S_gᵀ) (JᵀJ)⁻¹.

It also has a bound. An exact model with the right parameters is within half a step of every reading, so these are in

    {θ̂ + d :  −q/2 ≤ rₜ + Jₜd ≤ q/2  for all t},

a polytope, whose extent along every parameter is the optimum of two linear programmes. With N samples it shrinks as
1/N, and the covariance of least squares as 1/√N. Only few of the samples bound it, so each programme begins with those
near their bound and takes in the ones that its solution violates. Where the polytope is empty, there is other noise, or
the model lacks an effect.

References:
    Milanese, Vicino, *Optimal estimation theory for dynamic systems with set membership uncertainty: an overview*,
    Automatica 27 (1991). Liang, Zeger, *Longitudinal data analysis using generalized linear models*, Biometrika 73
    (1986) (clusters).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FAR = 100.0
"""Parameters are sought within this many 95 % half widths for white noise."""
AT_ONCE = 50
"""Violated samples that a linear programme takes in at once."""
EXACT = 1e-6
"""A bound of half a step holds if it is violated by no more than this part of a step."""


class Extent(NamedTuple):
    """The parameters with which a model is within half a step of every reading.

    Attributes:
        least: the largest error of the best of them, in steps; above a half there are none, and the rest is about that.
        centre: (p,) d in the middle between the smallest and the largest of every parameter.
        half_width: (p,) half of that range.
        covariance: (p, p) with the correlations of the outermost points, for which a 95 % interval has that range.
    """

    least: float
    centre: Array
    half_width: Array
    covariance: Array


def clustered_covariance(pieces: Sequence[tuple[Array, Array, Array]]) -> Array:
    """(p, p) covariance of the estimate from the sums of scores over runs of one reading.

    Args:
        pieces: residual (Nᵢ,), derivative (Nᵢ, p) and reading (Nᵢ,) of every segment and channel; the derivatives
            together have full rank.
    """
    inverse = np.linalg.inv(np.linalg.qr(np.concatenate([jacobian for _, jacobian, _ in pieces]), mode="r"))
    scores = [
        np.add.reduceat((jacobian @ inverse) * residual[:, None], runs(reading)[0])
        for residual, jacobian, reading in pieces
    ]
    sums = np.concatenate(scores)
    freedom = len(sums) / max(len(sums) - len(inverse), 1)
    covariance: Array = freedom * inverse @ (sums.T @ sums) @ inverse.T
    return covariance


def extent(residual: Array, jacobian: Array, half: Array, lower: Array, upper: Array) -> Extent:
    """The polytope about an estimate.

    Args:
        residual: (N,) r.
        jacobian: (N, p) of full rank.
        half: (N,) the largest error of every reading, half a step or a little more.
        lower, upper: (p,) bounds of d.
    """
    inverse = np.linalg.inv(np.linalg.qr(jacobian, mode="r"))
    sizes = 1.96 * np.std(residual) * np.linalg.norm(inverse, axis=1)
    rows, errors, p = jacobian * (sizes / half[:, None]), residual / half, len(sizes)
    bounds = np.column_stack([np.maximum(lower / sizes, -FAR), np.minimum(upper / sizes, FAR)])
    active = set(np.argsort(-np.abs(errors))[: AT_ONCE * p].tolist())

    def optimum(objective: Array, slack: bool) -> Array:
        """The (d, t) of least objective with all errors within 1 + t, t zero without slack."""
        from scipy.optimize import linprog

        while True:
            some = np.array(sorted(active))
            ones = np.full((2 * len(some), 1), -1.0)
            sides = np.hstack([np.concatenate([rows[some], -rows[some]]), ones])
            limits = np.concatenate([1.0 - errors[some], 1.0 + errors[some]])
            found = linprog(objective, sides, limits, bounds=[*bounds, (-1.0, None) if slack else (0.0, EXACT)]).x
            if found is None:
                raise np.linalg.LinAlgError("no solution")
            over = np.abs(errors + rows @ found[:p]) - 1.0 - found[p]
            worst = np.argsort(-over)[:AT_ONCE]
            new = set(worst[over[worst] > EXACT].tolist()) - active
            if not new:
                return np.asarray(found)
            active.update(new)

    best = optimum(np.append(np.zeros(p), 1.0), True)
    least = 0.5 * (1.0 + float(best[p]))
    if best[p] > EXACT:
        return Extent(least, best[:p] * sizes, np.zeros(p), np.zeros((p, p)))
    axes = np.hstack([np.eye(p), np.zeros((p, 1))])
    outermost = np.array([optimum(side * axis, False)[:p] for axis in axes for side in (1.0, -1.0)])
    low, high = outermost.min(axis=0), outermost.max(axis=0)
    centre, half_width = 0.5 * (low + high), 0.5 * (high - low)
    spread = (outermost - centre).T @ (outermost - centre)
    lengths = np.sqrt(np.diag(spread))
    scale = np.divide(half_width, 1.96 * lengths, out=np.zeros(p), where=lengths > 0) * sizes
    return Extent(least, centre * sizes, half_width * sizes, spread * np.outer(scale, scale))


# --- the step of readings ---------------------------------------------------------------------------------------------


def quantisation(levels: Array) -> float | None:
    """The step of which all differences between ascending values (M,) are multiples; None where there is none.

    >>> quantisation(np.array([0.0, 0.25, 1.0, 1.75])), quantisation(np.array([0.0, 0.3, 1.0, 1.75, 1.99]))
    (0.25, None)
    """
    steps = np.diff(levels)
    if not len(steps):
        return None
    span = float(levels[-1] - levels[0])
    for candidate in (float(steps.min()), float(np.percentile(steps, 5))):
        multiples = np.rint((levels - levels[0]) / candidate)
        if not 0 < multiples[-1] < 1e6:
            continue
        step = float(multiples @ (levels - levels[0]) / (multiples @ multiples))
        rest = np.abs((levels - levels[0]) / step - multiples)
        if rest.max() < 0.05 and (len(levels) > 2 or span):
            few = multiples[-1] > 50 * len(levels)  # too few values to tell multiples from chance
            return None if few else float(f"{step:.6g}")
    return None


def runs(values: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The first place and the length of every run of equal values (N,)."""
    starts = np.concatenate([[0], 1 + np.flatnonzero(values[1:] != values[:-1])]).astype(np.intp)
    return starts, np.diff(starts, append=len(values)).astype(np.intp)
