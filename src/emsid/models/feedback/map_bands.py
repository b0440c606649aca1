r"""Bands of the static maps of feedback models, in units of their inputs and outputs that the data determine.

The data determine a map f of z to w up to the units of z and w, and often only up to a line beside it. A fit fixes
the units by elements of its matrices (`emsid.models.feedback.coordinates`). Where the data hardly determine these, as
where a lag of z and a lag of w have about the same effect, the units change from one estimate to another while the map
of the signals remains the same. So a model close to the fitted one is compared with it in the units of signals:

    z    its mean and standard deviation over the record are those of the fitted model
    w    the gain from w to the output is that of the fitted model: its root mean square over the spectrum of w, with
         all maps replaced by the lines that are closest to them over the record (their equivalent gains)
    g    of a map that is multiplied by a signal, the root mean square of the signal

A map that takes one factor on both sides (`Scaling.JOINT`) has the unit of z only, and one that takes none has no free
unit. Of a map that contains lines the shape is shown: what differs from a line over most of the inputs that it has
seen, or from a level, if it is multiplied by a signal. A cascade has the same units by its filters, which have a gain
of one (`emsid.models.blocks.gain`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Fit
from emsid.models.bands import Band, with_error
from emsid.models.blocks.static_maps import Scaling
from emsid.models.feedback.coordinates import Visited, free_lines
from emsid.models.feedback.curves import visited_alongside
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.normal_form import power_of, squared_gains
from emsid.record import Record

Array = NDArray[np.float64]

# At most this many inputs of a map, between these quantiles, show a line in it; beyond them a curve may be unknown.
COMPARED, MIDDLE = 2_000, (0.1, 0.9)
LONGEST = 10_000
"""Samples of a record from whose runs the units are taken."""


def map_band(fit: Fit[Any], record: Record, k: int, x: Array, *, level: float = 0.95) -> Band:
    """A static map of a feedback model with its band; without one where no parameter of the map is estimated.

    Args:
        fit: of the model.
        record: with the inputs of the model.
        k: the map, from 0.
        x: (m,) inputs of the map.
        level: of the band.
    """
    model: FeedbackModel = fit.model
    value = model.maps[k].value(x)
    if not fit.has_bands or not set(model.names[model.spans[k]]) & set(fit.names):
        return Band(x, value, np.full(len(x), np.nan), level)
    return Band(x, value, with_error(fit, map_shape(model, record, k, x))[1], level)


def map_shape(model: FeedbackModel, record: Record, k: int, x: Array) -> Callable[[FeedbackModel], Array]:
    """A function from a feedback model close to this one to its map (m,) at inputs x (m,), in the units of this one.

    Args:
        model: whose units are taken.
        record: with the inputs of the model.
        k: the map, from 0.
        x: (m,) inputs of the map.
    """
    of = visited_alongside(model, record[:LONGEST])
    run = of(model)
    power = power_of(run.w[:, k])
    mean, unit_in, unit_out = _units(model, run, k, power)
    low, high = np.quantile(run.z[:, k], MIDDLE)
    at = run.z[(low <= run.z[:, k]) & (run.z[:, k] <= high), k]
    at = at[:: max(1, len(at) // COMPARED)]
    mix = free_lines(model, k, at)
    lines, compared = (np.vander(each, len(mix), increasing=True) @ mix for each in (x, at))
    without = lines @ np.linalg.pinv(compared)

    def shape(other: FeedbackModel) -> Array:
        centre, into, out = _units(other, of(other), k, power)
        values, seen = (
            other.maps[k].value(centre + (each - mean) * into / unit_in) * out / unit_out for each in (x, at)
        )
        return np.asarray(values - without @ seen)

    return shape


def _units(model: FeedbackModel, run: Visited, k: int, power: Array) -> tuple[float, float, float]:
    """Mean and unit of the input of a map, and the unit in which its output is compared."""
    map_, z = model.maps[k], run.z[:, k]
    unit = float(np.std(z)) or 1.0
    if map_.scaling is Scaling.NONE:
        return 0.0, 1.0, 1.0
    if map_.scaling is Scaling.JOINT:
        return float(z.mean()), unit, 1.0 / unit
    g = float(np.sqrt(np.mean(model.factor(run.x, run.u)[:, k] ** 2)))
    n = model.states
    behind = np.append(model.matrix[:n, n + 1 + k], model.matrix[-1, n + 1 + k])
    return float(z.mean()), unit, g * float(np.sqrt(behind @ squared_gains(model, run, k, power) @ behind))
