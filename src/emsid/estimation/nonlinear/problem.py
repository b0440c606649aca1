"""A nonlinear least-squares problem: its residuals, their derivative, its cost and its linearisation.

Its loss is that of squares, or of Huber or Cauchy, which are robust against outliers. A loss ℓ is an object with three
methods: ℓ itself, the weight ℓ′(r)/r and the curvature ℓ″(r). `gauss_newton` accepts any object that has them.
A problem may lack the residuals of some samples (`WithoutSamples`); its runs go on through them.

References:
    Huber, *Robust Statistics* (1981). Holland, Welsch, *Robust regression using iteratively reweighted least-squares*,
    Communications in Statistics A6 (1977), for the scales that keep 95 % efficiency under Gaussian noise.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.information import Information


class Loss(Protocol):
    """The cost of a residual."""

    def cost(self, residual: Array) -> Array:
        """ℓ(r) ≥ 0, sample by sample."""
        ...

    def weight(self, residual: Array) -> Array:
        """ℓ′(r)/r ≥ 0, sample by sample."""
        ...

    def curvature(self, residual: Array) -> Array:
        """ℓ″(r), sample by sample."""
        ...


@dataclass(frozen=True)
class Squares:
    """ℓ(r) = ½r², maximum likelihood for Gaussian noise."""

    def cost(self, residual: Array) -> Array:
        """½r²."""
        return 0.5 * residual**2

    def weight(self, residual: Array) -> Array:
        """1."""
        return np.ones_like(residual)

    def curvature(self, residual: Array) -> Array:
        """1."""
        return np.ones_like(residual)


SQUARES = Squares()


@dataclass(frozen=True)
class Huber:
    """ℓ(r) = ½r² up to |r| = scale and scale·(|r| − ½scale) beyond: the influence of an outlier is limited.

    Args:
        scale: in the unit of the residual; 1.345 standard deviations of Gaussian noise keep 95 % efficiency.
    """

    scale: float

    def __post_init__(self) -> None:
        _check_positive(self, self.scale)

    def cost(self, residual: Array) -> Array:
        """½r² or scale·(|r| − ½scale)."""
        size = np.abs(residual)
        return np.where(size <= self.scale, 0.5 * residual**2, self.scale * (size - 0.5 * self.scale))

    def weight(self, residual: Array) -> Array:
        """min(1, scale/|r|)."""
        weight: Array = self.scale / np.maximum(np.abs(residual), self.scale)
        return weight

    def curvature(self, residual: Array) -> Array:
        """1 up to scale, 0 beyond."""
        return (np.abs(residual) <= self.scale).astype(float)


@dataclass(frozen=True)
class Cauchy:
    """ℓ(r) = ½scale²·ln(1 + (r/scale)²): the influence of a far outlier vanishes.

    Args:
        scale: in the unit of the residual; 2.385 standard deviations of Gaussian noise keep 95 % efficiency.
    """

    scale: float

    def __post_init__(self) -> None:
        _check_positive(self, self.scale)

    def cost(self, residual: Array) -> Array:
        """½scale²·ln(1 + (r/scale)²)."""
        cost: Array = 0.5 * self.scale**2 * np.log1p((residual / self.scale) ** 2)
        return cost

    def weight(self, residual: Array) -> Array:
        """1/(1 + (r/scale)²)."""
        return 1 / (1 + (residual / self.scale) ** 2)

    def curvature(self, residual: Array) -> Array:
        """(1 − (r/scale)²)/(1 + (r/scale)²)², negative in the tails."""
        square = (residual / self.scale) ** 2
        return (1 - square) / (1 + square) ** 2


def _check_positive(loss: object, scale: float) -> None:
    if not (np.isfinite(scale) and scale > 0):
        raise ModelError(f"{type(loss).__name__} loss with scale {scale}; give a positive number in the output's unit")


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


class Columns(NamedTuple):
    """A residual and the columns of its derivative that are not zero.

    Attributes:
        residual: (N,) r.
        rows: (k, N) derivatives; those that are no columns are not used.
        which: (m,) the rows that are columns.
        of: (m,) the parameters of these columns.
    """

    residual: Array
    rows: Array
    which: Indices
    of: Indices

    def block(self, parameters: int) -> Block:
        """The residual with the whole derivative (N, p)."""
        whole = np.zeros((parameters, len(self.residual)))
        whole[self.of] = self.rows[self.which]
        return self.residual, whole.T


class SparseProblem(ABC):
    """A `Problem` over several experiments that each have parameters of their own, such as initial states."""

    @abstractmethod
    def residuals(self, theta: Array) -> Sequence[Array]:
        """As in `Problem`."""

    @abstractmethod
    def columns(self, theta: Array) -> Iterable[Columns]:
        """The residual and its derivative for every experiment, computed when it is asked for."""

    def linearised(self, theta: Array) -> list[Block]:
        """As in `Problem`."""
        return [column.block(len(theta)) for column in self.columns(theta)]


class Linearised(NamedTuple):
    """A problem at one θ.

    Attributes:
        cost: V(θ).
        residuals: (Nᵢ,) of every experiment.
        information: of the parameters that are not fixed.
        blocks: gives the residuals with their whole derivatives; those of a sparse problem are computed again.
    """

    cost: float
    residuals: tuple[Array, ...]
    information: Information
    blocks: Callable[[], Sequence[Block]]


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


def linearised(problem: Problem, theta: Array, varied: Indices, loss: Loss) -> Linearised:
    """A problem at a θ where the residual exists.

    Args:
        problem: residuals and their derivative.
        theta: (p,) θ.
        varied: which parameters are not fixed.
        loss: whose weights scale the rows [√w·J, −√w·r] of the information.

    Raises:
        Infeasible: for a derivative that is too large.
        ModelError: for a derivative that is not finite or of another shape.
    """
    blocks: Callable[[], Sequence[Block]]
    if isinstance(problem, SparseProblem):
        every, blocks = problem.columns(theta), partial(problem.linearised, theta)
    else:
        known = problem.linearised(theta)
        every, blocks = (_columns(each, len(theta)) for each in known), lambda: known
    place = np.full(len(theta), -1)
    place[varied] = np.arange(len(varied))
    information, total, residuals = Information.empty(len(varied)), 0.0, []
    for residual, rows, which, of in every:
        own = place[of]
        which, own = which[own >= 0], own[own >= 0]
        columns = np.empty((len(own) + 1, len(residual)))
        np.take(rows, which, axis=0, out=columns[:-1], mode="clip")  # the default mode copies once more
        columns[-1] = -residual
        if loss is not SQUARES:
            columns *= np.sqrt(loss.weight(residual))
        with np.errstate(over="ignore", invalid="ignore"):
            finite = np.isfinite(columns.sum())
        if not finite:
            bad = varied[own][~np.isfinite(columns[:-1]).all(axis=1)]
            raise ModelError(f"the derivative with respect to parameters {bad.tolist()} is not finite")
        information = (
            information.add_columns(columns) if len(own) == len(varied) else information.add_part(own, columns)
        )
        total += float(np.sum(loss.cost(residual)))
        residuals.append(residual)
    if not np.abs(information.factor).max(initial=0.0) < LARGEST:  # also where it is not a number
        raise Infeasible("the derivative is too large; scale the channels or choose a smaller order")
    return Linearised(total, tuple(residuals), information, blocks)


def columns_of(problem: Problem, theta: Array) -> Iterable[Columns]:
    """The residual of every experiment and the columns of its derivative, at a θ where the residual exists."""
    if isinstance(problem, SparseProblem):
        return problem.columns(theta)
    return (_columns(each, len(theta)) for each in problem.linearised(theta))


def _columns(block: Block, parameters: int) -> Columns:
    """The residual and the columns of a derivative.

    Raises:
        ModelError: for a derivative of another shape.
    """
    residual, jacobian = block
    if residual.ndim != 1 or jacobian.shape != (len(residual), parameters):
        raise ModelError(
            f"a residual of shape {residual.shape} with a derivative of shape {jacobian.shape}; for "
            f"{parameters} parameters give (N,) and (N, {parameters})"
        )
    which = np.flatnonzero((jacobian.T != 0).any(axis=1))
    return Columns(residual, jacobian.T, which, which)


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
