"""What no test signal separates: parameters that the output of a plant depends on in combinations only.

The derivatives by all parameters of interest, those kept or given included, over all signals that were tried, are
decomposed by singular values. A direction in which the relative standard error is above 100 % even with all these
signals together is one that voltage alone does not show. Two remedies are tried on the model: a current as a second
output, and a second run with a known additional inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.experiment_design.information import Sensitivities
from emsid.models.plants.parameters import Signal

Array = NDArray[np.float64]

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
