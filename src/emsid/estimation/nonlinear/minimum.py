"""What a search for the minimum of a nonlinear least-squares problem returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Ending, Fit
from emsid.estimation.linear.information import Information, Solution, inverse_triangle
from emsid.estimation.nonlinear.problem import Block, Indices, Loss
from emsid.estimation.nonlinear.smoothing import Penalty
from emsid.estimation.uncertainty.robust_covariance import long_run_variance
from emsid.findings import Finding

Array = NDArray[np.float64]
M = TypeVar("M")

AS_GOOD_AS_CONVERGED = 0.3
"""A search that stalls this many standard errors from its minimum keeps its intervals: 95 % of them become 94 %."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """The result of a search, with its covariance.

    Attributes:
        estimate: (p,) θ.
        cost: V(θ), half the sum of squares for squares.
        residuals: r(θ) of every experiment.
        information: of the free parameters, rows [√w·J, −√w·r] at θ.
        free: (p,) true where a parameter is neither fixed nor at a bound; covariances treat the others as known.
        covariance: (p, p), valid for coloured residuals too (see `robust_covariance`); zero outside the free
            parameters, infinite on the diagonal of parameters that the data do not determine.
        white_covariance: (p, p), valid if the residual is white.
        noise_variance: of the residual, Σr²/(N − rank).
        samples: N.
        rank, condition: of the derivative with columns of unit length, in the free parameters.
        ending: how the search ended.
        findings: how it ended, which bounds were reached, and what the data do not determine.
        iterations: steps taken.
        costs: V at the start and after every step.
        penalty: the penalties with their weights, in all parameters; the information includes them, V does not.
    """

    estimate: Array
    cost: float
    residuals: tuple[Array, ...]
    information: Information
    free: NDArray[np.bool_]
    covariance: Array
    white_covariance: Array
    noise_variance: float
    samples: int
    rank: int
    condition: float
    ending: Ending
    findings: tuple[Finding, ...]
    iterations: int
    costs: tuple[float, ...]
    penalty: Penalty

    def judged(self) -> Minimum:
        """The same; of a search that stalled before a minimum without intervals, at one as converged.

        Rounding and corners may stop a search within a small part of a standard error of its minimum, where the
        estimate is as good as one that converged. Further away the covariance says nothing about the error.
        """
        if self.ending is not Ending.STALLED:
            return self
        stalled = next((finding for finding in self.findings if finding.code == "search-stalled"), None)
        offset = None if stalled is None else stalled.data["offset"]
        if offset is not None and offset <= AS_GOOD_AS_CONVERGED:
            rest = tuple(finding for finding in self.findings if finding is not stalled)
            return replace(self, ending=Ending.CONVERGED, findings=rest)
        return replace(self, covariance=np.diag(np.where(self.free, np.inf, 0.0)))

    def fit(self, model: M, names: Sequence[str], method: str = "gn") -> Fit[M]:
        """The `Fit` of a model with the first ``len(names)`` parameters.

        The parameters after them (initial states) are left out.
        """
        kept = len(names)
        return Fit(
            model=model,
            names=tuple(names),
            estimate=self.estimate[:kept],
            covariance=self.covariance[:kept, :kept],
            noise_variance=self.noise_variance,
            samples=self.samples,
            condition=self.condition,
            rank=self.rank,
            ending=self.ending,
            method=method,
            iterations=self.iterations,
            findings=self.findings,
        )


def undetermined(solution: Solution, labels: Sequence[str]) -> Finding:
    """A finding that lists the parameters that a derivative without full rank does not determine.

    Args:
        solution: of the information of the parameters.
        labels: a name for each parameter; a shared name is listed once.
    """
    groups = [list(dict.fromkeys(labels[k] for k in group)) for group in solution.aliases]
    without_effect = [labels[group[0]] for group in solution.aliases if len(group) == 1]
    inseparable = [group for group, members in zip(groups, solution.aliases, strict=True) if len(members) > 1]
    return Finding(
        "parameters-undetermined",
        data={
            "without_effect": list(dict.fromkeys(without_effect)),
            "inseparable": [list(group) for group in dict.fromkeys(map(tuple, inseparable))],
        },
    )


def covariance_matrices(
    blocks: Sequence[Block],
    columns: Indices,
    solution: Solution,
    loss: Loss,
    penalty: Array,
    independent: float,
    check: Callable[[], None] = lambda: None,
) -> tuple[Array, Array]:
    """The covariances for white and for coloured noise, for the parameters in ``columns``.

    The rows of a penalty have the scores that they are expected to have, of variance σ² times the number of samples
    for each independent one. With a loss other than squares the Hessian of the robust covariance is mean(ℓ″)·JᵀJ and
    the score is Jₜℓ′(rₜ) (Huber 1981, ch. 7).

    Args:
        blocks: the residual and its derivative for every experiment.
        columns: the parameters that are neither fixed nor at a bound.
        solution: of their information.
        loss: that was minimised.
        penalty: (k, p) rows of the penalties, in all parameters.
        independent: the number of independent samples in the residual.
        check: called between steps; what it raises ends the computation.
    """
    determined = np.isfinite(np.diag(solution.covariance))
    residual = np.concatenate([r for r, _ in blocks])
    samples = len(residual)
    mean_curvature = float(np.mean(loss.curvature(residual)))
    spread = np.full((len(columns),) * 2, 0.0)
    spread[~determined, ~determined] = np.inf
    white, robust = spread.copy(), spread
    kept = columns[determined]
    if samples + len(penalty) <= len(kept) or not mean_curvature > 0:
        white[determined, determined] = robust[determined, determined] = np.inf
        return white, robust
    bread = Information.empty(len(kept))
    for r, jacobian in blocks:
        bread = bread.add_columns(np.vstack([jacobian.T[kept], r]))
        check()
    bread = bread.add(penalty[:, kept], np.zeros(len(penalty)))
    triangle = bread.factor[:-1, :-1]
    inverse = inverse_triangle(triangle)
    pull = loss.weight(residual) * residual
    rough = penalty[:, kept] @ inverse
    slowness = samples / independent if len(penalty) else 1.0
    correction = samples / (samples - len(kept) + np.sum(rough**2)) / mean_curvature**2
    within = np.ix_(np.flatnonzero(determined), np.flatnonzero(determined))
    white[within] = correction * np.mean(pull**2) * (inverse @ inverse.T)
    scores = [(jacobian[:, kept] @ inverse) * (loss.weight(r) * r)[:, None] for r, jacobian in blocks]
    check()
    spread_of_scores = long_run_variance(scores, check) + slowness * np.mean(pull**2) * rough.T @ rough
    robust[within] = correction * (inverse @ spread_of_scores @ inverse.T)
    return white, robust
