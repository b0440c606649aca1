"""A least-squares problem whose residuals lack some samples; its runs go on through them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.nonlinear.problem import Array, Columns, Problem, SparseProblem, columns_of

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class WithoutSamples(SparseProblem):
    """A problem without the residuals of some samples.

    Attributes:
        problem: with all of them.
        left_out: (N,) for every residual of the problem, or for more samples before its first one.
    """

    problem: Problem
    left_out: Sequence[Mask]

    def residuals(self, theta: Array) -> list[Array]:
        """The residual of the other samples of every experiment."""
        every = zip(self.problem.residuals(theta), self.left_out, strict=True)
        return [residual[_others(out, residual)] for residual, out in every]

    def columns(self, theta: Array) -> Iterator[Columns]:
        """The same with its derivative."""
        for column, out in zip(columns_of(self.problem, theta), self.left_out, strict=True):
            others = _others(out, column.residual)
            yield column._replace(residual=column.residual[others], rows=column.rows[:, others])


def without(problem: Problem, left_out: Sequence[Mask] | None) -> Problem:
    """A problem without some samples; the problem itself if none are given."""
    return problem if left_out is None else WithoutSamples(problem, left_out)


def _others(left_out: Mask, residual: Array) -> Mask:
    """(n,) the samples of a residual that are not left out."""
    return ~left_out[len(left_out) - len(residual) :]
