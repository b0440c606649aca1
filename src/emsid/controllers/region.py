"""The plants of a region: a model, points on the 95 % ellipsoid of its estimates, each with friction ±30 %."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.compensation import Compensation, compensate
from emsid.controllers.cascade import FRICTION
from emsid.controllers.loops import Plants
from emsid.errors import ModelError, listed
from emsid.estimation.fit import Fit
from emsid.models.plants.parameters import Signal
from emsid.models.verbs import as_model
from emsid.plant import Measure

Array = NDArray[np.float64]

DRAWS = 64
"""Points on the ellipsoid; with 512 the worst margins of the tests change by less than 1 %."""
SHAFT = ("load_inertia", "shaft_stiffness", "shaft_damping")
LEAST = 0.01
"""The smallest value of a positive parameter on the ellipsoid, as a part of its estimate."""


def check_identified(model: Any) -> None:
    """Refuse a fit whose parameters are not determined.

    Raises:
        ModelError: for a search that ended before a minimum, or a parameter that the data do not determine.
    """
    if not isinstance(model, Fit):
        return
    if model.ending.before_minimum:
        raise ModelError(
            f"the search of {model.model_name} ended before a minimum ({model.ending.value}), so that its intervals "
            "are not known; identify it again"
        )
    open_ = [name for name, error in zip(model.names, model.standard_error, strict=True) if not np.isfinite(error)]
    if open_:
        raise ModelError(
            f"the data do not determine {listed(open_)} of {model.model_name}, so that no margins are known; fix it, "
            "or record a signal that shows it"
        )


def models_of_region(model: Any, seed: int, draws: int = DRAWS) -> list[Any]:
    """The model, and models on the 95 % ellipsoid of its estimates; of a model without intervals itself alone.

    Args:
        model: a model or a fit.
        seed: of the directions in which the points lie.
        draws: how many points.
    """
    subject: Any = as_model(model)
    if not (isinstance(model, Fit) and model.has_intervals):
        return [subject]
    from scipy.special import chdtri

    size = model.standard_error
    known = np.isfinite(size) & (size > 0)
    names = [name for name, each in zip(model.names, known, strict=True) if each and name in subject.plant.handles]
    known = np.array([name in names for name in model.names])
    estimate, size = model.estimate[known], size[known]
    correlation = model.covariance[np.ix_(known, known)] / np.outer(size, size)
    values, vectors = np.linalg.eigh(correlation)
    factor = size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    directions = np.random.default_rng(seed).standard_normal((draws, len(names)))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    points = estimate + np.sqrt(chdtri(len(names), 0.05)) * directions @ factor.T
    handles = [subject.plant.handles[name] for name in names]
    positive = np.array([handle.lower >= 0 for handle in handles])
    points = np.where(positive, np.maximum(points, LEAST * estimate), points)
    points = np.clip(points, [handle.lower for handle in handles], [handle.upper for handle in handles])
    return [subject, *(subject.with_estimates(names, point) for point in points)]


def scaled(model: Any, what: str, factor: float) -> Any:
    """A model whose dry, viscous and quadratic friction, or whose dead zone, is changed by a factor; None without any.

    Args:
        model: of a plant.
        what: friction or dead zone.
        factor: of its values.
    """
    handles = model.plant.handles
    acts = (Measure.FORCE, Measure.DAMPING, Measure.QUADRATIC)
    if what == "friction":
        names = [
            name
            for name, handle in handles.items()
            if handle.measure in acts
            and ("friction." in name or "viscous" in name)
            and f"{name}.forward" not in handles
        ]
    else:
        names = [name for name in handles if name.endswith(("dead_zone.b_l", "dead_zone.b_r"))]
    values = np.array([factor * model.plant.value(name) for name in names])
    return model.with_estimates(names, values) if values.any() else None


@dataclass(frozen=True, eq=False)
class Electrics:
    """Resistance (P,) in Ω and inductance (P,) in H of the plants of a region."""

    resistance: Array
    inductance: Array


def plants_of(models: list[Any], inverses: list[Compensation], current: bool) -> Plants:
    """The plants of some models and their inverses, each with friction as it is, 30 % lower and 30 % higher, and with
    the stiffness of gravity and cogging of either sign."""
    rows, shafts = [], []
    for each, model in zip(inverses, models, strict=True):
        inside, friction = each.inside, each.friction
        braking, force = (0.0, inside.per_ampere) if current else (inside.braking, inside.after * inside.before)
        viscous = float(np.mean(friction.viscous))
        stiffness = float(sum(k * np.hypot(c, s) for k, c, s in friction.waves.tolist()))
        changes = [
            (factor, way * stiffness)
            for factor in (1.0, 1.0 - FRICTION, 1.0 + FRICTION)
            for way in ((0.0, -1.0, 1.0) if stiffness > 0 else (0.0,))
        ]
        rows += [(inside.mass, braking + factor * viscous, each_way, force) for factor, each_way in changes]
        values = model.parameter_values()
        if "shaft_stiffness" in values:
            shafts += len(changes) * [[values[name] for name in SHAFT]]
    mass, damping, against, force = np.array(rows).T
    shaft = np.array(shafts) if shafts else None
    return Plants(mass, damping, against, force, shaft, at_load=Signal.ROTOR_SPEED not in models[0].signals)


def electrics_of(models: list[Any]) -> Electrics | None:
    """Resistances and inductances; None where no voltage drives the plant or one of them is not known."""
    values = [model.parameter_values() for model in models]
    found = np.array([[each.get("resistance", 0.0), each.get("inductance", 0.0)] for each in values])
    channels = models[0].plant.channels
    if channels is None or not channels.bridge or not (found > 0).all():
        return None
    return Electrics(found[:, 0], found[:, 1])


def inverse_of(model: Any, dt: float) -> Compensation:
    """The inverse of a plant of one mass; of a motor with a shaft, that of rotor and load together.

    Raises:
        ModelError: for a model without one.
    """
    subject: Any = as_model(model)
    if not hasattr(subject, "plant"):
        raise ModelError(
            f"{subject.name} has no inertia and friction to control; identify rigid-motor, motor, joint or linear-axis"
        )
    if "shaft_stiffness" in subject.parameter_values():
        subject = replace(subject, plant=replace(subject.plant, motor=subject.plant.motor.rigid()))
    found = compensate(subject, dt=dt)
    assert isinstance(found, Compensation)
    return found
