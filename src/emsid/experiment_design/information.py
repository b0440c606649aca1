r"""The Fisher information of an experiment, from the derivative of the free run.

With white errors of standard deviation σ in every output, parameters θ and their free run ŷ(t; θ) from rest,

    M = Σₜ (∂ŷ/∂θ)ᵀ·(∂ŷ/∂θ)/σ²,        covariance of an efficient estimate = M⁻¹        (Cramér–Rao),

which is what `emsid.fit` reports of a record (Ljung, *System Identification*, 2nd ed., sec. 7.4 and 13.3). Everything
is computed with relative parameters, θ/|θ|, so that criteria do not depend on units.

The motion is a continuous function of θ, as events are located, so differences give the derivative. Predicted intervals
use that at θ. The search uses the mean information of θ + z and θ − z, with a random z as large as θ is uncertain: a
signal that is informative at exactly one break-away level only is not chosen. A derivative by a difference as wide as
that, with half of the free runs, was tried in its place: it counts what moves at one end only as information, and for
one motor of five the signal that it found was no better than a multisine, where this one is 3.6 times better.

**What no test signal separates** are parameters that the output depends on in combinations only. The derivatives by all
parameters of interest, those kept or given included, over all signals that were tried, are decomposed by singular
values. A direction in which the relative standard error is above 100 % even with all these signals together is one that
voltage alone does not show. Two remedies are tried on the model: a current as a second output, and a second run with a
known additional inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.models.plants.parameters import Signal

Array = NDArray[np.float64]

STEP = 1e-5
"""The relative step of a derivative, as in `emsid.models.plants.free_run_error`."""
LEAST = 0.02
"""The least relative uncertainty in the search: no motor stays the same within less."""
FARTHEST = 1.5
"""Standard errors by which a parameter differs at most in the search."""


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """A model whose free run is differentiated.

    Attributes:
        model: the model, from rest.
        names: (p,) its parameters.
        scale: (p,) the size of each.
        errors: (p,) how uncertain each is, for the search.
        dt: sample time in s.
        noise: (ny,) standard deviation of the error of every output.
    """

    model: Any
    names: tuple[str, ...]
    scale: Array
    errors: Array
    dt: float
    noise: Array

    @classmethod
    def of(cls, model: Any, names: Sequence[str], errors: Array, dt: float, noise: Array) -> Sensitivities:
        """Those of some parameters of a model, which are uncertain by ``errors`` (p,)."""
        values = model.parameter_values()
        scale = np.array([abs(values[name]) or 1.0 for name in names])
        wide = np.maximum(np.where(np.isfinite(errors), errors, 0.0), LEAST * scale)
        return cls(model, tuple(names), scale, np.minimum(wide, 0.5 * scale), dt, noise)

    def with_names(self, names: Sequence[str]) -> Sensitivities:
        """The same for other parameters."""
        return self.of(self.model, names, np.full(len(names), np.nan), self.dt, self.noise)

    @cached_property
    def around(self) -> tuple[Sensitivities, ...]:
        """The same at two places that are as far as the parameters are uncertain, where the model allows it."""
        z = np.clip(np.random.default_rng(1).standard_normal(len(self.names)), -FARTHEST, FARTHEST) * self.errors
        found = []
        for each in (z, -z):
            with suppress(ModelError):  # beyond a bound
                found.append(replace(self, model=self.model.with_estimates(self.names, self._values + each)))
        return tuple(found) or (self,)

    @property
    def inputs(self) -> int:
        """How many commands a test chooses."""
        return len(self.model.plant.test_names) if hasattr(self.model, "plant") else 1

    @property
    def _values(self) -> Array:
        values = self.model.parameter_values()
        return np.array([values[name] for name in self.names])

    def runs(self, models: Sequence[Any], u: Array) -> list[Array]:
        """The outputs (N, ny) of several models for commands (N, nc), from rest."""
        inputs = np.ascontiguousarray(u)
        if hasattr(self.model, "plant"):
            plants = [model.plant for model in models]
            return [plant.simulate(inputs, self.dt, np.zeros(plant.states), self.model.signals) for plant in plants]
        return [model.run(model.at_rest(0.0, self.dt), inputs)[0] for model in models]

    def jacobian(self, u: Array) -> Array:
        """(N·ny, p) the derivative of the outputs by the relative parameters, in standard deviations of the error.

        Args:
            u: (N, nc) the commands.
        """
        models, at = [self.model], self._values
        steps = np.full(len(at), STEP)
        for k, scale in enumerate(self.scale.tolist()):
            for way in (1.0, -1.0):  # backwards at a bound
                moved = at.copy()
                moved[k] += way * STEP * scale
                try:
                    models.append(self.model.with_estimates(self.names, moved))
                except ModelError:
                    if way < 0:
                        raise
                    continue
                steps[k] *= way
                break
        with np.errstate(all="ignore"):
            here, *found = self.runs(models, u)
        columns = [((each - here) / (step * self.noise)).ravel() for each, step in zip(found, steps, strict=True)]
        return np.column_stack(columns) if columns else np.empty((len(u) * len(self.noise), 0))

    def information(self, u: Array, *, wide: bool = False) -> Array:
        """(p, p) the Fisher information of commands (N, nc), for relative parameters; zero where a run is not finite.

        Args:
            u: the commands.
            wide: whether it is the mean of `around`.
        """
        if wide:
            return np.asarray(np.mean([each.information(u) for each in self.around], axis=0))
        j = self.jacobian(u)
        return np.asarray(j.T @ j) if np.isfinite(j).all() else np.zeros((j.shape[1],) * 2)

    def covariance_of_fit(self, u: Array) -> Array:
        """(p, p) the covariance of relative parameters that `emsid.fit` has from commands (N, nc), by the noise alone.

        It divides every output by its standard deviation s, not by that of its error σ. With the weights w = (σ/s)² of
        the outputs, A = Σ w·JᵀJ and B = Σ w²·JᵀJ, the covariance is A⁻¹·B·A⁻¹; for one output A⁻¹ with w = 1.
        """
        j = self.jacobian(u)
        spread = np.std(self.runs([self.model], u)[0], axis=0)
        if len(spread) == 1:
            return covariance_of(j.T @ j)
        weights = np.tile(self.noise**2 / (spread**2 + self.noise**2), len(u))[:, None]
        inverse = covariance_of((weights * j).T @ j)
        return np.asarray(inverse @ ((weights**2 * j).T @ j) @ inverse)


def relative_errors(information: Array) -> Array:
    """(p,) relative standard errors; infinite for parameters that are not determined."""
    return errors_of(covariance_of(information))


def errors_of(covariance: Array) -> Array:
    """(…, p) standard errors."""
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


INVOLVED = 0.02
"""The least component of a parameter in a direction, of the largest, to be named: below, it is rounding."""
CURRENT_NOISE = 0.01
"""Standard deviation of a current that would be recorded, of its largest value."""
SECOND = 2.0
"""The second load has the inertia times this."""


@dataclass(frozen=True)
class Inseparable:
    """Parameters that cannot be separated.

    Attributes:
        names: the parameters.
        directions: how many combinations of them are open.
        remedies: of ``current`` and ``inertia``, those that determine them.
    """

    names: tuple[str, ...]
    directions: int
    remedies: tuple[str, ...]


def inseparable(sensitivities: Sensitivities, signals: Sequence[Array]) -> Inseparable | None:
    """What the signals together do not separate; None where they separate everything of interest.

    Args:
        sensitivities: of the model; parameters that were kept or given and are usually estimated are of interest too.
        signals: (N,) commands.
    """
    names = list(sensitivities.names)
    model = sensitivities.model
    if hasattr(model, "plant"):
        usual = [name for name in model.plant.default_free if name not in model.plant.without_effect(model.signals)]
        values = model.parameter_values()
        names += [each for each in usual if each not in names and values[each] > 0]
    every = sensitivities.with_names(names)
    rows = np.vstack([every.jacobian(u) for u in signals])
    open_ = _open(rows)
    if not len(open_):
        return None
    size = np.max(np.abs(open_), axis=0)
    named = tuple(name for name, part in zip(names, size.tolist(), strict=True) if part > INVOLVED * size.max())
    remedies = []
    for remedy, more in (("current", _with_current), ("inertia", _with_inertia)):
        try:
            found = more(every, signals)
        except (EmsidError, KeyError):
            continue
        if found is not None and not len(_open(np.vstack([rows, found]))):
            remedies.append(remedy)
    return Inseparable(named, len(open_), tuple(remedies))


def _open(rows: Array) -> Array:
    """The directions (k, p) with a relative standard error above 1."""
    rows = rows[np.isfinite(rows).all(axis=1)]
    _, sizes, directions = np.linalg.svd(np.linalg.qr(rows, mode="r"))
    sizes = np.concatenate([sizes, np.zeros(len(directions) - len(sizes))])
    return np.asarray(directions[sizes < 1.0])


def _with_current(every: Sensitivities, signals: Sequence[Array]) -> Array | None:
    model = every.model
    if not hasattr(model, "plant") or Signal.CURRENT in model.signals:
        return None
    channels = model.plant.channels
    if channels is None or Signal.CURRENT not in channels.units:
        return None
    other = replace(model, signals=(Signal.CURRENT,))
    noise = np.array([CURRENT_NOISE * max(float(np.max(np.abs(every.runs([other], u)[0]))) for u in signals)])
    seen = replace(every, model=other, noise=noise)
    return np.vstack([seen.jacobian(u) for u in signals])


def _with_inertia(every: Sensitivities, signals: Sequence[Array]) -> Array | None:
    model = every.model
    values = model.parameter_values()
    if "load_inertia" not in values or "rotor_inertia" not in values:
        return None
    added = (SECOND - 1.0) * values["rotor_inertia"] + values["load_inertia"]
    heavier = replace(every, model=model.with_estimates(["load_inertia"], np.array([added])))
    return np.vstack([heavier.jacobian(u) for u in signals])
