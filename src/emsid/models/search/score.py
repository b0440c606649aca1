r"""What further parameters promise: Rao's score test of a fitted model, without a refit.

A model was fitted by least squares: at its estimate θ̂ it leaves r = ŷ − y with the derivative J = ∂r/∂θ. A larger model
contains it at a neutral value of further parameters α (a dead zone of zero), where A = ∂r/∂α. A part of A has the same
effect as a change of θ, so that only Ã = A − J·J⁺A is new. To first order a change δ of α, with θ at its best for it,
takes

    ‖r‖² − min_δ ‖r + Ã·δ‖²,      δ within the bounds of α,

from the squared error. That is the *promise* of α, as a share of ‖r‖². It costs the derivative of one free run.

Whether chance explains it is tested with z = Qᵀr, Q an orthonormal basis of Ã. Without an effect of α, z has the
covariance QᵀΓQ, so that zᵀ(QᵀΓQ)⁻¹z is χ², or Fisher's F where the residual has few independent samples. Γ is the
covariance of the noise, as `coloured_residuals` estimates it from r + Ã·δ, which does not have the effect itself. An
error of the model that follows the motion is no stationary noise, so that the covariance of the sums Σₜ Qₜrₜ
(`robust_covariance`) is used where it is larger.

The same test says whether data contradict a value that was given or kept (its derivative is A), and whether a parameter
changes during a record (A is its derivative times the time).

References:
    Rao, *Large sample tests of statistical hypotheses concerning several parameters*, Mathematical Proceedings of the
    Cambridge Philosophical Society 44 (1948). Davies, *Hypothesis testing when a nuisance parameter is present only
    under the alternative*, Biometrika 64 (1977), on a rate that has an effect only beside a level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.steps import bounded_step
from emsid.estimation.uncertainty.coloured_residuals import colour, effective_samples
from emsid.estimation.uncertainty.robust_covariance import long_run_variance
from emsid.selection.improvement import schwarz_gain

Array = NDArray[np.float64]

INSEPARABLE = 1e-3
"""Parameters whose own effect Ã is a smaller part of their effect A cannot be told from the present ones: derivatives
are differences of free runs, which have three to five digits near a kink."""


@dataclass(frozen=True, eq=False)
class Promise:
    """What further parameters promise.

    Attributes:
        share: of the squared error that they would take away, to first order.
        step: (k,) their change from the neutral value, to first order.
        chance: the probability that noise alone promises as much; one where nothing is promised, or nobody asked.
        gain: by how much Schwarz's criterion would prefer the larger model if all samples were independent. That is an
            upper limit; what a poor model leaves is slow, and says little about the samples of a better one.
    """

    share: float
    step: Array
    chance: float
    gain: float = -np.inf


class Score:
    """A fitted model, ready to be asked for the promise of further parameters.

    Args:
        residuals: (Nᵢ,) r of every stretch of stationary noise: a segment and a channel.
        jacobians: (Nᵢ, p) J of each; columns of parameters at a bound left out.
        channels: the channel of each; every channel has a colour of its own.

    Attributes:
        residuals: as given.
        power: ‖r‖².
    """

    def __init__(self, residuals: Sequence[Array], jacobians: Sequence[Array], channels: Sequence[int]) -> None:
        self.residuals, self._jacobians, self._channels = list(residuals), list(jacobians), list(channels)
        self._ends = np.cumsum([len(each) for each in residuals])[:-1]
        self._error = np.concatenate(self.residuals)
        self._basis = _orthonormal(np.concatenate(jacobians))
        self.power = float(self._error @ self._error)

    def promise(
        self,
        added: Sequence[Array],
        lower: Array | float = -np.inf,
        upper: Array | float = np.inf,
        least: float = 0.0,
        most: float = 1.0,
    ) -> Promise:
        """What further parameters promise.

        Args:
            added: (Nᵢ, k) A of every stretch.
            lower, upper: (k,) bounds of their change from the neutral value.
            least: the share below which the chance is not computed, but one; one for never.
            most: a chance above this may be given too small, but above this too.
        """
        effect = np.concatenate(added)
        none = Promise(0.0, np.zeros(effect.shape[1]), 1.0)
        sizes = np.linalg.norm(effect, axis=0)
        if not (self.power > 0 and np.isfinite(sizes).all() and np.any(sizes > 0)):
            return none
        own = effect - self._basis @ (self._basis.T @ effect)
        own -= self._basis @ (self._basis.T @ own)  # once more, against cancellation
        own[:, np.linalg.norm(own, axis=0) <= INSEPARABLE * sizes] = 0.0
        basis = _orthonormal(own)
        if not basis.shape[1]:
            return none
        step = _step(basis.T @ own, -(basis.T @ self._error), lower, upper)
        left = self._error + own @ step
        share = max(1.0 - float(left @ left) / self.power, 0.0)
        gain = schwarz_gain(1.0 - share, 1.0, len(left), basis.shape[1])
        return Promise(share, step, self._chance(basis, left, most) if share > least else 1.0, gain)

    def with_columns(self, columns: Array) -> Score:
        """The score where further parameters with A (N, k), of all stretches in turn, have their best values."""
        parts = np.split(columns, self._ends)
        jacobians = [np.column_stack(each) for each in zip(self._jacobians, parts, strict=True)]
        basis = _orthonormal(np.concatenate(jacobians))
        left = self._error - basis @ (basis.T @ self._error)
        return Score(np.split(left, self._ends), jacobians, self._channels)

    def shares(self, effects: Array) -> Array:
        """(m,) the share of the squared error that each of many additions promises, without bounds.

        Args:
            effects: (N, m, k) A of every addition, all stretches one after the other.
        """
        samples, many, k = effects.shape
        own = effects.reshape(samples, many * k)
        sizes = np.linalg.norm(own, axis=0)
        own = own - self._basis @ (self._basis.T @ own)
        own[:, np.linalg.norm(own, axis=0) <= INSEPARABLE * sizes] = 0.0
        columns = own.reshape(samples, many, k)
        squares, towards = np.einsum("nmi,nmj->mij", columns, columns), np.einsum("nmi,n->mi", columns, self._error)
        saved = np.einsum(
            "mi,mij,mj->m", towards, np.linalg.pinv(squares, rcond=INSEPARABLE**2, hermitian=True), towards
        )
        return np.asarray(saved / self.power if self.power > 0 else np.zeros(many))

    def _chance(self, basis: Array, left: Array, most: float) -> float:
        """The probability that noise coloured like what is left promises as much."""
        found = basis.T @ self._error
        parts = np.split(basis, self._ends)
        errors = np.split(left, self._ends)
        freedom = max(effective_samples(errors) - self._basis.shape[1] - len(found), 1.0)

        def chance(covariance: Array) -> float:
            return float(fdtrc(len(found), freedom, _ratio(found, covariance) / len(found)))

        robust = chance(long_run_variance([part * error[:, None] for part, error in zip(parts, errors, strict=True)]))
        if robust > most:
            return robust
        stationary = np.zeros((len(found),) * 2)
        for channel in set(self._channels):
            here = [k for k, each in enumerate(self._channels) if each == channel]
            noise = colour([(errors[k], self._jacobians[k]) for k in here])
            for k in here:
                through = noise.backwards(parts[k])
                stationary += noise.variance * through.T @ through
        return max(robust, chance(stationary))


def _ratio(found: Array, covariance: Array) -> float:
    """zᵀC⁻¹z; infinite where the noise has no part in z at all."""
    try:
        return float(found @ np.linalg.solve(covariance, found))
    except np.linalg.LinAlgError:
        return np.inf


def _step(effect: Array, wanted: Array, lower: Array | float, upper: Array | float) -> Array:
    """(k,) δ within its bounds for which effect·δ is nearest to what is wanted."""
    low, high = (np.broadcast_to(each, effect.shape[1]).astype(float) for each in (lower, upper))
    if np.isinf(low).all() and np.isinf(high).all():
        return np.asarray(np.linalg.lstsq(effect, wanted, rcond=None)[0])
    open_, found = high > low, np.zeros(effect.shape[1])
    if open_.any():
        found[open_] = bounded_step(Information.from_rows(effect[:, open_], wanted), low[open_], high[open_])
    return found


def _orthonormal(columns: Array) -> Array:
    """(N, r) an orthonormal basis of columns (N, p), without those that are combinations of others."""
    sizes = np.linalg.norm(columns, axis=0)
    columns = columns[:, sizes > 0] / sizes[sizes > 0]
    if not columns.shape[1]:
        return np.zeros((len(columns), 0))
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    basis: Array = left[:, singular > INSEPARABLE**2 * singular[0]]
    return basis
