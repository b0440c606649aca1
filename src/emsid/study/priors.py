"""Recursive against batch least squares: what the initial covariance P(0) does.

Recursive least squares without forgetting minimises Σε² + θᵀP(0)⁻¹θ: P(0) acts as a ridge of 1/P(0). Where the
regression is badly conditioned, the data say so little about some combinations of parameters that even the ridge of
P(0) = 1e8 decides them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.linear.recursive import recursive_least_squares
from emsid.models.free_run import mean_squared_error
from emsid.models.regression.narx import Structure
from emsid.record import Record

COVARIANCES = (1e2, 1e4, 1e6, 1e8, 1e10, 1e12, 1e14)
"""P(0) as a multiple of the identity."""

USUAL = 1e8
"""P(0) of the study."""


@dataclass(frozen=True)
class PriorRow:
    """A structure, estimated recursively from several P(0).

    Attributes:
        model: its name.
        condition: condition number of its regression.
        covariances: P(0).
        recursive: free-run MSE by recursion divided by that by batch least squares, minus 1, at every P(0).
        ridge: the same for batch least squares with a ridge of 1/P(0).
    """

    model: str
    condition: float
    covariances: tuple[float, ...]
    recursive: tuple[float, ...]
    ridge: tuple[float, ...]

    @property
    def usual(self) -> float:
        """The difference at the P(0) of the study."""
        return self.recursive[self.covariances.index(USUAL)]

    @property
    def ridge_usual(self) -> float:
        """The difference of batch least squares with a ridge of 1/P(0), at the P(0) of the study."""
        return self.ridge[self.covariances.index(USUAL)]

    @property
    def vanishes_at(self) -> float | None:
        """The smallest P(0) from which on recursion and batch differ by less than 1 %; None if there is none."""
        small = [abs(difference) < 0.01 for difference in self.recursive]
        last = max((k for k, each in enumerate(small) if not each), default=-1) + 1
        return self.covariances[last] if last < len(small) else None


def priors(structures: Sequence[Structure], record: Record, unseen: Record, start: int) -> tuple[PriorRow, ...]:
    """Every structure, from every P(0).

    Args:
        structures: what is estimated.
        record: identified from.
        unseen: where the free runs are compared.
        start: samples that start the free runs.
    """
    rows = []
    for structure in structures:
        batch = least_squares(structure, record)
        exact = _free_run_mse(batch, unseen, start)
        if not 0 < exact < inf:
            continue
        recursive: list[float] = []
        ridge: list[float] = []
        for covariance in COVARIANCES:
            fits = (
                recursive_least_squares(structure, record, initial_covariance=covariance),
                least_squares(structure, record, ridge=1 / covariance),
            )
            for fit, differences in zip(fits, (recursive, ridge), strict=True):
                differences.append(_free_run_mse(fit, unseen, start) / exact - 1)
        rows.append(PriorRow(structure.name, float(batch.condition), COVARIANCES, tuple(recursive), tuple(ridge)))
    return tuple(rows)


def _free_run_mse(fit: Fit[Any], record: Record, start: int) -> float:
    run = fit.model.simulate(record, start)
    return mean_squared_error(record.output[run.counted], run.output[run.counted])
