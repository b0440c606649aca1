r"""Errors of a free run under a load that drifts.

The effect of a slow disturbance of the force on the free run of a position never decays, and that on a speed lasts as
long as the disturbance. A fit to the plain error biases its parameters to compensate for it, and takes an effect that
follows it by chance, such as a friction by direction. So the load is the parameter of the plant plus a drift d(t),
constant over each of K pieces of a segment. The drift either returns to zero within a time τ that is short against the
record, or it begins at zero at the start of every segment and walks,

    E d(t)·d(s) = q·τ/2·e^{−|t − s|/τ}      or      E d(t)·d(s) = q·min(t, s).

The parameter is thus the mean of a load that returns, and otherwise the load at the start of the record. This is the
value that records have in common where the load drifts because a machine warms up. If the drift returns only after a
longer time, one record cannot distinguish it from a walk, and the load at the start predicts another record no better
and no worse than the mean.

Near a drift d₀ the free run ŷ is linear in d with derivative M, so the error at the parameters θ is

    e(θ) = y − ŷ(θ, d₀) + M·d₀,      e ~ N(0, σ²·I + M·P·Mᵀ),

with P from q and τ. Least squares of the error times the inverse root of this covariance over σ², which is the
identity but for K directions, is the maximum likelihood of θ with the drift integrated out. For small q it is the
plain error; for large q it ignores whatever a drift can explain, but nothing else. The drift is a part of the largest
force of the plant at θ, so that d₀ does not determine the scale of the force, which a position alone does not show.

References:
    Rasmussen, Williams, *Gaussian Processes for Machine Learning* (2006), sec. 2.7, on explicit basis functions.
    Harvey, *Forecasting, Structural Time Series Models and the Kalman Filter* (1989), sec. 2.3, on a level that walks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.parameters import Signal
from emsid.record import Record

Array = NDArray[np.float64]

PIECES = 40
"""Pieces of a segment in which the load is constant."""
SMALL = 1e-4
"""Change of the load for derivatives, as a part of the largest force."""


class LoadDrift(NamedTuple):
    """How a load drifts.

    Attributes:
        rate: √q, as a part of the largest force of the drive, per √s.
        time: τ in s; infinite for a walk.
        noise: σ of the other errors, in the unit of the output.
    """

    rate: float
    time: float
    noise: float

    def prior(self, seconds: float) -> Array:
        """(K, K) P of a segment of this length, as a part of the largest force squared."""
        middle = seconds * (np.arange(PIECES) + 0.5) / PIECES
        if isfinite(self.time):
            steps = np.abs(np.subtract.outer(middle, middle))
            return np.asarray(0.5 * self.rate**2 * self.time * np.exp(-steps / self.time))
        within = seconds / (6 * PIECES)  # the mean of a piece varies less than its middle
        return np.asarray(self.rate**2 * (np.minimum.outer(middle, middle) - within * np.eye(PIECES)))


@dataclass(frozen=True, eq=False)
class DriftingLoad:
    """The error of a segment under a load that drifts, linearised at a plant.

    Args:
        drifted: (K,) d₀ as a part of the largest force.
        effects: (N, K) M, by a drift as a part of the largest force.
        missed: (N,) M·d₀.
        basis, shares: (N, K) orthonormal directions, and (K,) which share of the error in each is left out.
        drift: how the load drifts.
    """

    drifted: Array
    effects: Array
    missed: Array
    basis: Array
    shares: Array
    drift: LoadDrift

    @classmethod
    def around(
        cls,
        plant: DrivenPlant,
        segment: Record,
        state: Array,
        signals: Sequence[Signal],
        drift: LoadDrift,
        drifted: Array,
    ) -> DriftingLoad:
        """Linearised at a plant in a segment.

        Args:
            plant: with its parameters.
            segment: of a speed or a position.
            state: at its start.
            signals: of the output.
            drift: how the load drifts.
            drifted: (K,) d₀ as a part of the largest force.
        """
        effects = load_effects(plant, segment, state, signals, drifted)
        values, vectors = np.linalg.eigh(drift.prior(len(segment) * segment.dt))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        basis, sizes, _ = np.linalg.svd(effects @ root / drift.noise, full_matrices=False)
        return cls(drifted, effects, effects @ drifted, basis, 1.0 - 1.0 / np.sqrt(1.0 + sizes**2), drift)

    def __call__(self, error: Array, dt: float) -> Array:
        """(…, N) e(θ) of the segment for ŷ(θ, d₀) − y, times the inverse root of its covariance, in its unit."""
        error = error - self.missed
        return np.asarray(error - ((error @ self.basis) * self.shares) @ self.basis.T)

    def trusted(self, seconds: float) -> float:
        """The time from the start of a segment of this length until the drift moves the free run by more than noise.

        Up to this length the plain error of the free run counts; later errors count only as far as the drift does not
        explain them. Both times are in s.
        """
        variances = np.sum((self.effects @ self.drift.prior(seconds)) * self.effects, axis=1)
        seen = np.append(variances > self.drift.noise**2, True)
        return seconds * int(np.argmax(seen)) / len(self.effects)


def by_sample(drifted: Array, samples: int) -> Array:
    """(N,) the drift at every sample of a segment, from (K,) that of its pieces."""
    return np.asarray(drifted[np.arange(samples) * len(drifted) // samples])


def load_effects(plant: DrivenPlant, segment: Record, state: Array, signals: Sequence[Signal], drifted: Array) -> Array:
    """(N, K) the derivative of the free run by the drift in every piece; a slow load does not see an inductance."""
    if "inductance" in plant.handles:
        plant = plant.with_values({"inductance": 0.0})
    drifts = [drifted, *(drifted + SMALL * each for each in np.eye(PIECES))]
    plain, *runs = (_free_run(plant, segment, state, signals, each) for each in drifts)
    return np.column_stack([(run - plain) / SMALL for run in runs])


def _free_run(plant: DrivenPlant, segment: Record, state: Array, signals: Sequence[Signal], drifted: Array) -> Array:
    """(N,) the free run of a segment under the drift in every piece."""
    held = by_sample(drifted, len(segment))
    return plant.simulate(segment.input, segment.dt, state, signals, held)[:, 0]
