r"""Penalties on roughness, each with a weight that the data choose.

A penalty keeps a curve with many knots smooth, so that their number need not be chosen. A search minimises

    V(θ) + ½ Σⱼ μⱼ‖Rⱼθ + cⱼ‖²,

where ‖Rθ + c‖² is, for example, ∫f″(x)² dx of a spline f (P-splines, Eilers & Marx 1996; O'Sullivan 1986). Read as a
probability, the penalty says that Rθ + c is normal with variance σ²/μ, and μ is the value for which the residual is
most likely with θ integrated out (restricted maximum likelihood; Wahba 1985, Wood 2011). Around a point the residual
is nearly linear, r(θ + p) ≈ Jp − z, and only the triangular factor of [J z] is needed. With A the factor of the data
and of all other penalties, and U·d·Wᵀ the singular values of RA⁻¹, the restricted likelihood of μ is a sum over d,

    −2 log L = M log (ρ² + Σᵢ μ(dᵢzᵢ + aᵢ)²/(1 + μdᵢ²)) + Σᵢ log (1 + μdᵢ²) − k log μ,

for M degrees of freedom, z and a in the coordinates W and U, and k the rank of R. It is computed on a grid of μ, so its
highest maximum is found. Several penalties are weighted in turn.

Correlated residuals, as those of a wrong model are, contain less information than as many independent ones. If each
counted as one, the curve would follow them, the more closely the more knots it has. M is therefore that of the number
of independent samples, see `effective_samples` (Opsomer, Wang & Yang 2001 on what correlated errors do to the weight).

References:
    Eilers, Marx, *Flexible smoothing with B-splines and penalties*, Statistical Science 11 (1996). O'Sullivan, *A
    statistical perspective on ill-posed inverse problems*, Statistical Science 1 (1986). Wahba, *A comparison of GCV
    and GML for choosing the smoothing parameter in the generalized spline smoothing problem*, Annals of Statistics 13
    (1985). Wood, *Fast stable restricted maximum likelihood and marginal likelihood estimation of semiparametric
    generalized linear models*, J. R. Statist. Soc. B 73 (2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.information import Information, inverse_triangle
from emsid.estimation.uncertainty.coloured_residuals import effective_samples

Array = NDArray[np.float64]

# Weights are tried from the first to the second number, relative to the information of the data, in steps of a factor.
WEAKEST, STRONGEST, STEP = 1e-12, 1e8, 10**0.25
# A direction counts as penalised if its singular value is above this part of the largest.
PENALISED = 1e-9
# Directions that nothing determines are kept by this part of the length of their columns.
RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class Penalty:
    """½‖Rθ + c‖².

    Attributes:
        rows: (k, p) R.
        constant: (k,) c.
    """

    rows: Array
    constant: Array

    @classmethod
    def none(cls, parameters: int) -> Penalty:
        """No penalty on this many parameters."""
        return cls(np.zeros((0, parameters)), np.zeros(0))

    @classmethod
    def weighted(cls, penalties: Sequence[Penalty], weights: Array, parameters: int) -> Penalty:
        """½ Σⱼ μⱼ‖Rⱼθ + cⱼ‖² for weights μ."""
        if not penalties:
            return cls.none(parameters)
        roots = np.sqrt(weights)
        return cls(
            np.concatenate([root * penalty.rows for root, penalty in zip(roots, penalties, strict=True)]),
            np.concatenate([root * penalty.constant for root, penalty in zip(roots, penalties, strict=True)]),
        )

    def value(self, theta: Array) -> Array:
        """(k,) Rθ + c."""
        return np.asarray(self.rows @ theta + self.constant)

    def cost(self, theta: Array) -> float:
        """½‖Rθ + c‖²."""
        value = self.value(theta)
        return 0.5 * float(value @ value)

    def held(self, information: Information, varied: NDArray[np.intp]) -> float:
        """How many parameters the penalty determines instead of the data: tr(H⁻¹RᵀR), with H of both.

        Args:
            information: of the data and the penalty about these parameters, of full rank.
            varied: the parameters.
        """
        if not len(self.rows):
            return 0.0
        return float(np.sum((self.rows[:, varied] @ inverse_triangle(information.factor[:-1, :-1])) ** 2))

    def added(self, information: Information, theta: Array, varied: NDArray[np.intp]) -> Information:
        """The information about a step of the varied parameters, with the penalty; samples are not counted."""
        if not len(self.rows):
            return information
        with_it = information.add(self.rows[:, varied], -self.value(theta))
        return Information(with_it.factor, information.samples)


@dataclass(frozen=True, eq=False)
class Smoothing:
    """The penalties of a search, and what its residual says about their weights.

    Attributes:
        penalties: in all parameters; the weight of each is chosen from the data.
        correlated: whether a slow residual counts as fewer samples. Searches that begin far from their minimum, where
            every residual is slow, may keep too stiff a curve then.
    """

    penalties: Sequence[Penalty] = ()
    correlated: bool = False

    def samples(self, residuals: Sequence[Array]) -> float:
        """The number of independent samples in the residuals (Nᵢ,) of all experiments."""
        return effective_samples(residuals) if self.correlated else float(sum(len(residual) for residual in residuals))


NONE = Smoothing()
"""No penalty."""


def chosen_weights(
    penalties: Sequence[Penalty],
    information: Information,
    theta: Array,
    varied: NDArray[np.intp],
    before: Array,
    samples: float,
) -> Array:
    """(m,) the most likely weight of every penalty, for a residual that is linear around θ.

    Args:
        penalties: m of them.
        information: of the data about a step of the varied parameters, without penalties.
        theta: (p,) θ.
        varied: the parameters that are estimated.
        before: (m,) weights to begin with; the weight of one penalty is chosen for those of the others.
        samples: the number of independent samples in the residual.
    """
    weights = before.copy()
    for j, penalty in enumerate(penalties):
        others = [each for k, each in enumerate(penalties) if k != j]
        rest = Penalty.weighted(others, np.delete(weights, j), len(theta)).added(information, theta, varied)
        weights[j] = _most_likely(penalty.rows[:, varied], penalty.value(theta), rest, samples)
    return weights


def _most_likely(rows: Array, value: Array, information: Information, samples: float) -> float:
    """The weight of one penalty with the largest restricted likelihood."""
    size = information.parameters
    factor = information.factor
    length = np.linalg.norm(factor[:size, :size], axis=0)
    length[length == 0] = np.max(length, initial=0.0) or 1.0
    # The weight is relative to the information of the data about the penalised parameters.
    touched = np.abs(rows).max(axis=0) > 0
    unit = float(np.sum(length[touched] ** 2) / max(np.sum(rows**2), 1e-300))
    floor = WEAKEST * unit
    stacked = np.concatenate([factor[:size], np.sqrt(floor) * np.column_stack([rows, -value])])
    stacked = np.concatenate([stacked, RIDGE * np.column_stack([np.diag(length), np.zeros(size)])])
    triangle = np.asarray(np.linalg.qr(stacked, mode="r"))
    sides, singular, turned = np.linalg.svd(np.linalg.solve(triangle[:size, :size].T, rows.T).T, full_matrices=False)
    ahead = turned @ triangle[:size, size]
    rough = (singular * ahead + sides.T @ value) ** 2
    squares = singular**2
    rank = int(np.count_nonzero(singular > PENALISED * singular[0]))
    freedom = max(samples - size + rank, 1.0)
    weights = unit * WEAKEST * STEP ** np.arange(1, np.log(STRONGEST / WEAKEST) / np.log(STEP))
    shrunk = 1 + np.outer(weights, squares)
    fixed = triangle[size, size] ** 2 + factor[size, size] ** 2
    misfit = fixed + np.sum(weights[:, None] * rough / shrunk, axis=1)
    likelihood = freedom * np.log(misfit) + np.sum(np.log(shrunk), axis=1) - rank * np.log(weights)
    return float(weights[np.argmin(likelihood)])
