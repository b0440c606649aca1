"""Adaptation rules: how a recursive estimate weighs a new sample against the past.

A rule is a small value. `emsid.estimation.linear.recursive` has the one loop over samples, and takes a rule as an
argument. With φ the regressors of a sample, ε its prediction error, P the normalised covariance and ζ = φᵀPφ:

=====================  ================================================================================================
`Forgetting`           P⁻¹ ← λP⁻¹ + φφᵀ: a sample k steps back has weight λᵏ (Ljung, *System Identification*, sec. 11.2)
`Directional`          P⁻¹ ← P⁻¹ + (λ − (1 − λ)/ζ)φφᵀ: forgets only where the sample brings information, so that P does
                       not wind up without excitation (Kulhavý, *Int. J. Control* 45, 1987; Bittanti, Bolzern and
                       Campi, *Automatica* 26, 1990)
`Drift`                P ← P + Q before the sample: the Kalman filter of parameters that drift (Ljung, sec. 11.5)
`Window`               P⁻¹ ← P⁻¹ + φφᵀ − φ₀φ₀ᵀ: the sample φ₀ that leaves the window is subtracted again
`Gradient`             θ ← θ + μφε/(δ + φᵀφ): the normalised gradient, with no covariance
`Frozen`               nothing changes; the residuals are still computed
=====================  ================================================================================================

All of them but the last two change P = U D Uᵀ by steps of one kind, P ← P − PφφᵀP/(r + ζ), with another r: λ (then P is
divided by λ), 1/(λ − (1 − λ)/ζ), 1, and −1 for a sample that leaves. `correct` does this step. r and r + ζ have the
same sign in every rule, so D stays positive by construction.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import isfinite
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit
from emsid.errors import ModelError

Array = NDArray[np.float64]

# Weight of the past, sample by sample, in the noise variance of rules that have no weight of their own.
NOISE_MEMORY = 0.999
# The longest sliding window, in samples.
LONGEST_WINDOW = 10_000_000


class Code(IntEnum):
    """The rules in the kernels."""

    FORGETTING = 0
    DIRECTIONAL = 1
    DRIFT = 2
    WINDOW = 3
    GRADIENT = 4
    FROZEN = 5


class Rule(Protocol):
    """What the recursion needs of an adaptation rule."""

    @property
    def rows(self) -> int:
        """The number of past samples that it keeps."""
        ...

    def numbers(self, parameters: int) -> Array:
        """The rule for the kernels: code, two numbers, the weight of the past in the sum of squared residuals, and in
        the sum of squared weights; then one number for each parameter, if it has such.

        Args:
            parameters: their number n.

        Raises:
            ModelError: if the rule has numbers for other than n parameters.
        """
        ...


def _check_factor(factor: float) -> None:
    if not 0 < factor <= 1:
        raise ModelError(f"forgetting factor {factor}; it lies above 0 and is at most 1", arguments=("forgetting",))


@dataclass(frozen=True)
class Forgetting:
    """Constant forgetting: a sample k steps back has weight λᵏ.

    Args:
        factor: λ, 0 < λ ≤ 1.
    """

    factor: float = 1.0

    def __post_init__(self) -> None:
        _check_factor(self.factor)

    rows = 0

    def numbers(self, parameters: int) -> Array:
        """See `Rule.numbers`."""
        return np.array([Code.FORGETTING, self.factor, 0.0, self.factor, self.factor**2])


@dataclass(frozen=True)
class Directional:
    """Directional forgetting: old samples are forgotten only in the direction of the new one.

    Every sample forgets in one direction, so that n parameters remember about n/(1 − λ) samples. A sample whose ζ is
    below ``least`` of that of an ordinary one, as noise at standstill, has too little excitation to replace
    information; it changes nothing.

    Args:
        factor: λ, 0 < λ ≤ 1.
        least: the smallest ζ of a sample that counts, as a fraction of the stationary (1 − λ)/λ; by default regressors
            of a hundredth of the usual size. 0 uses every sample.
    """

    factor: float = 0.99
    least: float = 1e-4

    def __post_init__(self) -> None:
        _check_factor(self.factor)
        if not 0 <= self.least < 1:
            raise ModelError(f"least excitation {self.least}; give a fraction from 0 to below 1")

    rows = 0

    def numbers(self, parameters: int) -> Array:
        """See `Rule.numbers`."""
        least = self.least * (1 - self.factor) / self.factor
        memory = 1 - (1 - self.factor) / parameters
        return np.array([Code.DIRECTIONAL, self.factor, least, memory, memory**2])


@dataclass(frozen=True)
class Drift:
    """Parameters that walk randomly: the Kalman filter.

    Args:
        variance: of the step of a parameter from one sample to the next, divided by the variance of the noise: one
            number, or one for each parameter.
    """

    variance: float | tuple[float, ...] = 1e-6

    def __post_init__(self) -> None:
        values = np.asarray(self.variance, dtype=float)
        if values.ndim > 1 or not np.all((values >= 0) & np.isfinite(values)):
            raise ModelError(f"variance of the drift {self.variance}; give finite numbers that are not negative")

    rows = 0

    def numbers(self, parameters: int) -> Array:
        """See `Rule.numbers`."""
        values = np.asarray(self.variance, dtype=float)
        if values.shape not in ((), (parameters,)):
            raise ModelError(f"{len(values)} variances of the drift for {parameters} parameters; give one for each")
        head = [Code.DRIFT, 0.0, 0.0, NOISE_MEMORY, NOISE_MEMORY]
        return np.concatenate([head, np.broadcast_to(values, parameters)])


@dataclass(frozen=True)
class Window:
    """A sliding window: the last samples have weight 1, all others 0.

    After every full window the estimate is computed anew from its samples, so that rounding does not add up.

    Args:
        samples: its length.
    """

    samples: int

    def __post_init__(self) -> None:
        if isinstance(self.samples, bool) or not isinstance(self.samples, int) or self.samples < 1:
            raise ModelError(f"a window of {self.samples} samples; give a whole number, at least 1")
        if self.samples > LONGEST_WINDOW:
            raise ModelError(f"a window of {self.samples} samples; {LONGEST_WINDOW} are the most")

    @property
    def rows(self) -> int:
        """The length of the window."""
        return self.samples

    def numbers(self, parameters: int) -> Array:
        """See `Rule.numbers`."""
        if self.samples <= parameters:
            raise ModelError(f"a window of {self.samples} samples for {parameters} parameters; give a longer one")
        return np.array([Code.WINDOW, float(self.samples), 0.0, 1.0, 1.0])


@dataclass(frozen=True)
class Gradient:
    """The normalised gradient: a step towards the sample, with no covariance.

    Args:
        step: μ, 0 < μ < 2; small for little noise, near 1 for fast tracking.
        offset: δ > 0, in the unit of φᵀφ: regressors much smaller than its root hardly change the estimate.
    """

    step: float = 0.1
    offset: float = 1e-6

    def __post_init__(self) -> None:
        if not 0 < self.step < 2:
            raise ModelError(f"step {self.step} of the gradient; it lies between 0 and 2")
        if not (self.offset > 0 and isfinite(self.offset)):
            raise ModelError(f"offset {self.offset} of the gradient; give a positive number")

    rows = 0

    def numbers(self, parameters: int) -> Array:
        """See `Rule.numbers`."""
        return np.array([Code.GRADIENT, self.step, self.offset, NOISE_MEMORY, NOISE_MEMORY])


@dataclass(frozen=True)
class Frozen:
    """No adaptation: the estimate and its covariance stay, and the residuals are still computed."""

    rows = 0

    def numbers(self, parameters: int) -> Array:
        """See `Rule.numbers`."""
        return np.array([Code.FROZEN, 0.0, 0.0, 1.0, 1.0])


# --- kernels ---------------------------------------------------------------------------------------------------------


# NumPy's error model: a division that may raise would prevent vectorisation of the inner loops.
@njit(nogil=True, fastmath={"contract"}, error_model="numpy", inline="always")
def correct(
    factor: Array, diagonal: Array, phi: Array, gain: Array, noise: float, forgetting: float, ceiling: Array
) -> float:
    """P ← (P − PφφᵀP/(r + ζ))/λ in place, by Bierman's update of Uᵀ and D; returns r + ζ, with Pφ in ``gain``.

    Args:
        factor, diagonal: Uᵀ (n, n) and D (n,).
        phi: φ (n,).
        gain: (n,) to be filled with Pφ.
        noise: r, of the same sign as r + ζ.
        forgetting: λ.
        ceiling: (n,) the limit of D.
    """
    alpha = noise
    for j in range(len(phi)):
        row = factor[j]
        f = phi[j]
        for i in range(j):
            f += row[i] * phi[i]
        g = diagonal[j] * f
        before = alpha
        alpha += f * g
        diagonal[j] = min(diagonal[j] * before / (alpha * forgetting), ceiling[j])
        # Column j of U moves along the gain of the columns before it, and adds to that gain.
        step = -f / before
        for i in range(j):
            u = row[i]
            row[i] = u + step * gain[i]
            gain[i] += g * u
        gain[j] = g
    return alpha


@njit(nogil=True, fastmath={"contract"}, error_model="numpy")
def excitation(factor: Array, diagonal: Array, phi: Array) -> float:
    """ζ = φᵀPφ: the variance of the prediction by the uncertainty of the parameters, for noise of variance one."""
    total = 0.0
    for j in range(len(phi)):
        f = phi[j]
        for i in range(j):
            f += factor[j, i] * phi[i]
        total += f * f * diagonal[j]
    return total


@njit(nogil=True, fastmath={"contract"}, error_model="numpy")
def diffuse(factor: Array, diagonal: Array, variance: Array, work: Array) -> None:
    """P ← P + Q with a diagonal Q, in place, one parameter after the other (Agee and Turner; Bierman, sec. III.5)."""
    for k in range(len(diagonal)):
        c = variance[k]
        if c == 0.0:
            continue
        for i in range(k):
            work[i] = 0.0
        work[k] = 1.0
        for j in range(k, -1, -1):
            s = work[j]
            d = diagonal[j] + c * s * s
            b = c / d
            c = b * diagonal[j]
            diagonal[j] = d
            row, step = factor[j], s * b
            for i in range(j):
                work[i] -= s * row[i]
                row[i] += step * work[i]


def adaptation_reference(
    rule: Rule, regression: ArrayLike, target: ArrayLike, covariance: Array
) -> tuple[Array, Array]:
    """Every rule by its definition, with P as a full matrix: a slow and simple reference.

    Args:
        rule: any rule.
        regression: Φ (N, n).
        target: y (N,).
        covariance: P(0), (n, n).

    Returns:
        (N, n) the estimate after every sample, from θ(0) = 0, and the last P.
    """
    phi, y = np.asarray(regression, dtype=float), np.asarray(target, dtype=float)
    theta, p, history = np.zeros(phi.shape[1]), np.array(covariance, dtype=float), []
    for t, (row, value) in enumerate(zip(phi, y, strict=True)):
        error, zeta = value - row @ theta, float(row @ p @ row)
        match rule:
            case Forgetting(factor):
                theta = theta + p @ row * error / (factor + zeta)
                p = np.linalg.inv(factor * np.linalg.inv(p) + np.outer(row, row))
            case Directional(factor, least) if zeta > least * (1 - factor) / factor:
                theta = theta + p @ row * error / (1 + zeta)
                p = np.linalg.inv(np.linalg.inv(p) + (factor - (1 - factor) / zeta) * np.outer(row, row))
            case Drift(variance):
                p = p + np.diag(np.broadcast_to(variance, len(theta)))
                theta = theta + p @ row * error / (1 + row @ p @ row)
                p = p - np.outer(p @ row, p @ row) / (1 + row @ p @ row)
            case Window(samples):
                within = slice(max(0, t + 1 - samples), t + 1)
                p = np.linalg.inv(np.linalg.inv(covariance) + phi[within].T @ phi[within])
                theta = p @ (phi[within].T @ y[within])
            case Gradient(step, offset):
                theta = theta + step * row * error / (offset + row @ row)
        history.append(theta)
    return np.array(history), p
