r"""What every estimate of a frequency response has in common: spectra are regressed on others, line by line.

At every frequency Z = H R + V, with signals Z (nz,) and a regressor R (nr,) that does not depend on V. In open loop R
is the input and Z the output. In closed loop the input depends on the noise; R is the reference, and Z holds output and
input: with H = [H_y; H_u], the plant is G = H_y H_u⁻¹ (the indirect method), and with V′ = [I, −G] V

    cov G[i, j] = (cov V′)[i, i] · (Qᵀ S Q*)[j, j],      Q = H_u⁻¹,      cov H = cov V ⊗ S.

References:
    Pintelon, Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed. (2012), ch. 2 and 7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SINGULAR = 1e12
"""Condition of the power of several regressors from which they cannot be told apart."""
MOVED = 0.5
"""The share of frequencies at which a reference must move the input by more than its standard error."""


@dataclass(frozen=True, eq=False)
class Regressed:
    """H at F frequencies, with what its covariance is made of.

    Attributes:
        response: (F, nz, nr) H.
        residual: (F, nz, nz) covariance of V.
        spread: (F, nr, nr) S, so that the covariance of H is that of V times S.
    """

    response: Complex
    residual: Complex
    spread: Complex

    def plant(self, inputs: int, closed: bool) -> tuple[Complex, Array]:
        """(F, ny, nu) the response from the inputs, and its variance.

        Args:
            inputs: nu.
            closed: whether the last nu of Z are the inputs and R is the reference; else R holds the inputs.

        Raises:
            DataError: in closed loop, where the reference does not move the inputs.
        """
        if not closed:
            return self.response, variance(self.residual, self.spread)
        of_y, of_u = self.response[:, :-inputs], self.response[:, -inputs:]
        moves = np.any(np.abs(of_u) ** 2 > variance(self.residual[:, -inputs:, -inputs:], self.spread), axis=2)
        if np.mean(np.all(moves, axis=1)) < MOVED or np.any(np.linalg.cond(of_u) > SINGULAR):
            raise DataError(
                "the reference does not move every input, so the response in closed loop cannot be estimated; "
                "excite through the reference, with one for every input"
            )
        inverse = np.linalg.inv(of_u)
        g = of_y @ inverse
        mixed = np.concatenate([np.broadcast_to(np.eye(g.shape[1]), (len(g), g.shape[1], g.shape[1])), -g], axis=2)
        left = mixed @ self.residual @ mixed.conj().swapaxes(1, 2)
        right = inverse.swapaxes(1, 2) @ self.spread @ inverse.conj()
        return g, variance(left, right)


def variance(residual: Complex, spread: Complex) -> Array:
    """(F, nz, nr) the variance of every element of H."""
    one, other = (np.real(np.einsum("fii->fi", each)) for each in (residual, spread))
    return np.asarray(np.maximum(one[:, :, None] * other[:, None, :], 0.0))


def check_told_apart(power: Complex) -> None:
    """Refuse regressors of which one has no power, or follows another, at some frequency.

    Args:
        power: (F, nr, nr) their spectra.

    Raises:
        DataError: for such regressors.
    """
    size = np.sqrt(np.real(np.einsum("fii->fi", power)))
    if not np.all(size > 0) or np.any(np.linalg.cond(power / (size[:, :, None] * size[:, None])) > SINGULAR):
        raise DataError("an input does not change, or follows another at some frequency; leave it out")
