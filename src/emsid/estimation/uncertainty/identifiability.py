r"""Which parameters a set of data determines, from the derivative of the residual.

Let S = J·diag(s) be the derivative of the residual with respect to relative changes of the parameters, where s are
their sizes. The Fisher information SᵀS/σ² gives the precision of every direction of relative change: along a right
singular vector of S with singular value ς the standard deviation is σ/ς. A direction is *undetermined* where

    ς ≤ ROUNDED · ς_max  with the columns of S at unit length     it has no effect on the output, whatever the noise, or
    σ/ς > 1                                                       its standard deviation is larger than 100 %.

A parameter, or any function of the parameters, is determined if the undetermined directions add less uncertainty to it
than the others do. So R·J/K² can be known to a percent although R, J and K are not determined.

References:
    Walter, Pronzato, *Identification of Parametric Models*, ch. 6. Stoica, Marzetta, *Parameter estimation problems
    with singular information matrices*, IEEE TSP 49 (2001). Gutenkunst et al., *Universally sloppy parameter
    sensitivities in systems biology models*, PLoS Computational Biology 3 (2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.information import Information

Array = NDArray[np.float64]

# Below this fraction of the largest singular value a direction is rounding (mostly of differences of simulations).
ROUNDED = 1e-5
# A function is undetermined if at least this share of its gradient lies along a direction without effect.
LEAST_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Identifiability:
    """The directions of relative change that a set of data does and does not determine.

    Args:
        names: (p,) the parameters.
        triangle: (p, p) a factor of the information on relative changes, SᵀS.
        noise: standard deviation σ of the residual; 0 for noise-free data.
        sizes: (p,) the size of every parameter, to which a relative change refers; ones by default.

    Attributes:
        spread: (p,) relative standard deviation of every direction; infinite if it has no effect on the output.
        directions: (p, p) the directions as columns, orthonormal, in relative changes.
    """

    names: tuple[str, ...]
    triangle: Array
    noise: float
    sizes: Array = field(default_factory=lambda: np.ones(0))
    spread: Array = field(init=False)
    directions: Array = field(init=False)

    def __post_init__(self) -> None:
        p = len(self.names)
        if not len(self.sizes):
            object.__setattr__(self, "sizes", np.ones(p))
        length = np.linalg.norm(self.triangle, axis=0)
        length = np.where(length > 0, length, 1.0)
        _, values, turned = np.linalg.svd(self.triangle / length)
        hidden = turned[values <= ROUNDED * max(float(np.max(values, initial=0.0)), np.finfo(float).tiny)].T
        basis, _ = np.linalg.qr(hidden / length[:, None])
        rest = np.linalg.qr(np.column_stack([basis, np.eye(p)]))[0][:, basis.shape[1] :]
        _, values, turned = np.linalg.svd(self.triangle @ rest)
        with np.errstate(divide="ignore", invalid="ignore"):
            known = np.where(values > 0, self.noise / values, np.inf)
        object.__setattr__(self, "spread", np.concatenate([np.full(basis.shape[1], np.inf), known]))
        object.__setattr__(self, "directions", np.column_stack([basis, rest @ turned.T]))

    def without(self, fixed: Sequence[str]) -> Identifiability:
        """The same data with these parameters known."""
        kept = [k for k, name in enumerate(self.names) if name not in fixed]
        triangle: Array = np.asarray(np.linalg.qr(self.triangle[:, kept], mode="r"))
        return Identifiability(tuple(self.names[k] for k in kept), triangle, self.noise, self.sizes[kept])

    def determines(self, gradient: Array) -> bool:
        """Whether the data determine a function of the parameters with this gradient (p,) for relative changes."""
        return bool(np.all(self._determined(gradient)))

    def hidden(self, gradient: Array) -> float:
        """By how much a function with this gradient (p,) changes where the undetermined directions move by 100 %."""
        unknown = self.spread > 1.0
        return float(np.linalg.norm(self.directions[:, unknown].T @ gradient))

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """The undetermined parameters, in groups that are independent of each other."""
        moved = ~np.array([self._determined(row) for row in np.eye(len(self.names))])  # (p, directions)
        groups: list[set[int]] = []
        for direction in moved.T:
            mine = set(np.flatnonzero(direction).tolist())
            if mine:
                linked = [group for group in groups if group & mine]
                groups = [group for group in groups if not group & mine] + [mine.union(*linked)]
        return tuple(tuple(self.names[k] for k in sorted(group)) for group in groups)

    def _determined(self, gradient: Array) -> NDArray[np.bool_]:
        """(p,) for every direction, whether it leaves the function determined."""
        share = self.directions.T @ gradient
        length = float(np.linalg.norm(gradient))
        blind, unknown = np.isinf(self.spread), self.spread > 1.0
        known = float(np.linalg.norm(share[~unknown] * self.spread[~unknown]))
        with np.errstate(invalid="ignore"):
            added = np.abs(share * self.spread)
        hidden: NDArray[np.bool_] = (blind & (np.abs(share) > LEAST_SHARE * length)) | (
            unknown & ~blind & (added > known)
        )
        return ~hidden


def identifiability(jacobians: Sequence[Array], sizes: Array, names: Sequence[str], noise: float) -> Identifiability:
    """The identifiability of parameters, from the derivatives of the residuals.

    Args:
        jacobians: (Nᵢ, p + m) of every experiment; columns after the first p belong to nuisance parameters, such as
            initial states, which are estimated too.
        sizes: (p,) the size of every parameter, to which a relative change refers; positive.
        names: (p,) the parameters.
        noise: standard deviation σ of the residual; 0 for noise-free data.
    """
    p = len(names)
    width = jacobians[0].shape[1]
    nuisance_first = [*range(p, width), *range(p)]
    information = Information.empty(width)
    for jacobian in jacobians:
        columns = np.vstack([jacobian.T[nuisance_first], np.zeros(len(jacobian))])
        information = information.add_columns(np.ascontiguousarray(columns))
    triangle = (
        information.factor[width - p : width, width - p : width] * sizes
    )  # the part that the nuisance parameters cannot explain
    return Identifiability(tuple(names), triangle, noise, np.asarray(sizes, dtype=float))
