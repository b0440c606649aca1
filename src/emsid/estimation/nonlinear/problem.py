"""A nonlinear least-squares problem: its residuals, their derivative, its cost and its linearisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.losses import SQUARES, Loss

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Block = tuple[Array, Array]
Run = TypeVar("Run")

# A derivative is not larger than this, as squares of it must be finite too.
LARGEST = 1e120


class Infeasible(ModelError):
    """Raised by a `Problem` where it has no residual: an unstable filter, a simulation that overflowed.

    A trial step that raises it is shortened. If the start raises it, the user sees its message.
    """


class Problem(Protocol):
    """A nonlinear least-squares problem over one or several experiments."""

    def residuals(self, theta: Array) -> Sequence[Array]:
        """The residual (Nᵢ,) of every experiment at θ (p,).

        Raises:
            Infeasible: where there is none. Values that are not finite count as infeasible too.
        """
        ...

    def linearised(self, theta: Array) -> Sequence[Block]:
        """The residual (Nᵢ,) and its derivative ∂r/∂θ (Nᵢ, p) for every experiment, at a θ where r exists.

        Columns of fixed parameters are not used. Fortran order saves a copy.
        """
        ...


class LastRun(Generic[Run]):
    """The run of a model at the last θ, kept for the derivative that follows its residual."""

    def __init__(self) -> None:
        self._kept: tuple[Array, Run] | None = None

    def at(self, theta: Array, run: Callable[[], Run]) -> Run:
        """The run at θ (p,); computed where the last one was at another θ."""
        kept = self._kept
        if kept is None or not np.array_equal(kept[0], theta):
            kept = self._kept = theta.copy(), run()
        return kept[1]


def linearised(
    problem: Problem, theta: Array, varied: Indices, loss: Loss
) -> tuple[float, tuple[Block, ...], Information]:
    """V(θ), the residuals with their derivatives and the information at θ, where the residual exists.

    Args:
        problem: residuals and their derivative.
        theta: (p,) θ.
        varied: which parameters are not fixed.
        loss: whose weights scale the rows [√w·J, −√w·r] of the information.

    Raises:
        Infeasible: for a derivative that is too large.
        ModelError: for a derivative that is not finite or of another shape.
    """
    blocks = tuple(problem.linearised(theta))
    information = Information.empty(len(varied))
    total = 0.0
    for residual, jacobian in blocks:
        if residual.ndim != 1 or jacobian.shape != (len(residual), len(theta)):
            raise ModelError(
                f"a residual of shape {residual.shape} with a derivative of shape {jacobian.shape}; for "
                f"{len(theta)} parameters give (N,) and (N, {len(theta)})"
            )
        # Initial states of other segments have derivatives of zero, which need not be reduced.
        own = np.flatnonzero((jacobian.T != 0).any(axis=1)[varied]) if len(blocks) > 1 else np.arange(len(varied))
        columns = np.empty((len(own) + 1, len(residual)))
        np.take(jacobian.T, varied[own], axis=0, out=columns[:-1], mode="clip")  # the default mode copies once more
        columns[-1] = -residual
        if loss is not SQUARES:
            columns *= np.sqrt(loss.weight(residual))
        if not np.isfinite(columns.sum()):
            bad = varied[own][~np.isfinite(columns[:-1]).all(axis=1)]
            raise ModelError(f"the derivative with respect to parameters {bad.tolist()} is not finite")
        information = (
            information.add_columns(columns) if len(own) == len(varied) else information.add_part(own, columns)
        )
        total += float(np.sum(loss.cost(residual)))
    if not np.abs(information.factor).max(initial=0.0) < LARGEST:  # also where it is not a number
        raise Infeasible("the derivative is too large; scale the channels or choose a smaller order")
    return total, blocks, information


def cost(problem: Problem, theta: Array, loss: Loss) -> float:
    """V(θ) = Σₜ ℓ(rₜ(θ)), where the residual exists."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(sum(np.sum(loss.cost(residual)) for residual in problem.residuals(theta)))


def trial_cost(problem: Problem, theta: Array, loss: Loss) -> float:
    """V(θ), infinite where there is no residual."""
    try:
        found = cost(problem, theta, loss)
    except Infeasible:
        return np.inf
    return found if np.isfinite(found) else np.inf
