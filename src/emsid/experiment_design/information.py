r"""The Fisher information of an experiment, from the derivative of the free run.

With white errors of standard deviation σ in every output, parameters θ and their free run ŷ(t; θ) from rest,

    M = Σₜ (∂ŷ/∂θ)ᵀ·(∂ŷ/∂θ)/σ²,        covariance of an efficient estimate = M⁻¹        (Cramér–Rao),

which is what `emsid.fit` reports of a record (Ljung, *System Identification*, 2nd ed., sec. 7.4 and 13.3). Everything
is computed with relative parameters, θ/|θ|, so that criteria do not depend on units.

The motion is a continuous function of θ, as events are located, so differences give the derivative. They are taken over
two widths. A narrow one gives the derivative at θ, for the predicted intervals. A wide one, as wide as θ is uncertain,
gives the mean of the derivative over what θ may be, for the search: a signal that is informative at exactly one
break-away level only is not chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]

NARROW = 1e-5
"""The relative step of an exact derivative, as in `emsid.models.plants.free_run_error`."""
LEAST_WIDE = 0.02
"""The least relative step of the search: no motor stays the same within less."""


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """A model whose free run is differentiated.

    Attributes:
        model: the model, from rest.
        names: (p,) its parameters.
        scale: (p,) the size of each.
        wide: (p,) steps of the search.
        dt: sample time in s.
        noise: (ny,) standard deviation of the error of every output.
    """

    model: Any
    names: tuple[str, ...]
    scale: Array
    wide: Array
    dt: float
    noise: Array

    @classmethod
    def of(cls, model: Any, names: Sequence[str], errors: Array, dt: float, noise: Array) -> Sensitivities:
        """Those of some parameters of a model, which are uncertain by ``errors`` (p,)."""
        values = model.parameter_values()
        scale = np.array([abs(values[name]) or 1.0 for name in names])
        wide = np.maximum(np.where(np.isfinite(errors), errors, 0.0), LEAST_WIDE * scale)
        return cls(model, tuple(names), scale, np.minimum(wide, 0.5 * scale), dt, noise)

    def with_names(self, names: Sequence[str]) -> Sensitivities:
        """The same for other parameters."""
        return self.of(self.model, names, np.full(len(names), np.nan), self.dt, self.noise)

    def runs(self, models: Sequence[Any], u: Array) -> list[Array]:
        """The outputs (N, ny) of several models for a command (N,), from rest."""
        inputs = np.ascontiguousarray(u[:, None])
        if hasattr(self.model, "plant"):
            plants = [model.plant.for_inputs(inputs) for model in models]
            begin = [[np.zeros(plant.states)] for plant in plants]
            return list(plants[0].simulate_each(plants, [inputs], self.dt, begin, self.model.signals)[0])
        return [model.run(model.at_rest(0.0, self.dt), inputs)[0] for model in models]

    def jacobian(self, u: Array, *, wide: bool = False) -> Array:
        """(N·ny, p) the derivative of the outputs by the relative parameters, in standard deviations of the error."""
        step = self.wide if wide else NARROW * self.scale
        values = self.model.parameter_values()
        at = np.array([values[name] for name in self.names])
        models, widths = [], []
        for k in range(len(at)):
            sides = []
            for way in (1.0, -1.0):
                moved = at.copy()
                moved[k] += way * step[k]
                try:
                    models.append(self.model.with_estimates(self.names, moved))
                except ModelError:  # a bound: the difference to the model itself
                    moved[k] = at[k]
                    models.append(self.model)
                sides.append(moved[k])
            widths.append((sides[0] - sides[1]) / self.scale[k])
        with np.errstate(all="ignore"):
            found = self.runs(models, u)
        if not widths:
            return np.empty((len(u) * len(self.noise), 0))
        columns = [((found[2 * k] - found[2 * k + 1]) / (widths[k] * self.noise)).ravel() for k in range(len(widths))]
        return np.column_stack(columns)

    def information(self, u: Array, *, wide: bool = False) -> Array:
        """(p, p) the Fisher information of a command (N,), for relative parameters; zero where a run is not finite."""
        j = self.jacobian(u, wide=wide)
        return np.asarray(j.T @ j) if np.isfinite(j).all() else np.zeros((j.shape[1],) * 2)


def relative_errors(information: Array) -> Array:
    """(p,) relative standard errors; infinite for parameters that are not determined."""
    covariance = covariance_of(information)
    return np.asarray(np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0)))


LOST = 1e-12
"""Directions with less than this part of the largest information are not determined, in floating point."""

NOTHING = 1e-100
"""The trace of an information that is zero."""


def covariance_of(information: Array) -> Array:
    """The inverse of (…, p, p) information; a direction without information gets a huge variance, not a failure."""
    size = np.maximum(np.trace(information, axis1=-2, axis2=-1), NOTHING)[..., None, None]
    eye = np.eye(information.shape[-1])
    return np.asarray(np.linalg.inv(information / size + LOST * eye) / size)
