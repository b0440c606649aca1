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
from emsid.models.blocks.static_maps import Scaling
from emsid.models.feedback.coordinates import CONTAINED, Visited
from emsid.models.feedback.model import FeedbackModel
from emsid.record import Record
from emsid.validation.bands import Band, with_error
from emsid.validation.feedback_curves import visited

Array = NDArray[np.float64]

# At most this many inputs of a map, between these quantiles, show a line in it; beyond them a curve may be unknown.
COMPARED, MIDDLE = 2_000, (0.1, 0.9)
LONGEST = 10_000
"""Samples of a record from whose runs the units are taken."""
SPECTRUM = 1_024
"""Steps of w from which its spectrum is taken."""


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
    begin = record[:LONGEST]
    run = visited(model, begin)
    power = _power(run.w[:, k])
    mean, unit_in, unit_out = _units(model, run, k, power)
    low, high = np.quantile(run.z[:, k], MIDDLE)
    at = run.z[(low <= run.z[:, k]) & (run.z[:, k] <= high), k]
    at = at[:: max(1, len(at) // COMPARED)]
    mix = free_lines(model, k, at)
    lines, compared = (np.vander(each, len(mix), increasing=True) @ mix for each in (x, at))
    without = lines @ np.linalg.pinv(compared)

    def shape(other: FeedbackModel) -> Array:
        centre, into, out = _units(other, visited(other, begin), k, power)
        values, seen = (
            other.maps[k].value(centre + (each - mean) * into / unit_in) * out / unit_out for each in (x, at)
        )
        return np.asarray(values - without @ seen)

    return shape


def free_lines(model: FeedbackModel, k: int, z: Array) -> Array:
    """(c, q) the lines that the family of a map contains and the linear part can take: factors of 1 and z in each.

    Args:
        model: with the map.
        k: the map, from 0; of one that is multiplied by a signal, the linear part takes a level only (c = 1).
        z: (K,) inputs of the map.
    """
    rows = model.maps[k].parameter_gradient(z).T
    generators = np.vander(z, 1 if k in model.multiplied else 2, increasing=True)
    length = np.linalg.norm(generators, axis=0)
    units = generators / np.where(length > 0, length, 1.0)
    rest = units - rows @ np.linalg.lstsq(rows, units, rcond=None)[0]
    _, sizes, axes = np.linalg.svd(rest, full_matrices=False)
    return np.asarray((axes / np.where(length > 0, length, 1.0))[sizes < CONTAINED].T)


def _units(model: FeedbackModel, run: Visited, k: int, power: Array) -> tuple[float, float, float]:
    """Mean and unit of the input of a map, and the unit in which its output is compared."""
    map_, z = model.maps[k], run.z[:, k]
    unit = float(np.std(z)) or 1.0
    if map_.scaling is Scaling.NONE:
        return 0.0, 1.0, 1.0
    if map_.scaling is Scaling.JOINT:
        return float(z.mean()), unit, 1.0 / unit
    g = float(np.sqrt(np.mean(model.factor(run.x, run.u)[:, k] ** 2)))
    return float(z.mean()), unit, g * _gain(model, run, k, power)


def _power(w: Array) -> Array:
    """(m,) the power of what a map gives at the frequencies of its first steps, without its mean."""
    return np.asarray(np.abs(np.fft.rfft(w[:SPECTRUM])[1:]) ** 2)


def _gain(model: FeedbackModel, run: Visited, k: int, power: Array) -> float:
    """The root mean square gain from w to y over the power (m,) of w, with equivalent gains in place of the maps."""
    n, m = model.states, len(model.maps)
    z, g = run.z - run.z.mean(axis=0), model.factor(run.x, run.u).mean(axis=0)
    given = np.stack([each.value(run.z[:, i]) for i, each in enumerate(model.maps)], axis=1)
    values, slopes = given.mean(axis=0), g * np.sum(given * z, axis=0) / np.maximum(np.sum(z**2, axis=0), 1e-300)
    back = slopes[:, None] * model.matrix[n : n + m, :n] + values[:, None] * model.factors[:, :n]
    closed = model.matrix[:, :n] + model.matrix[:, n + 1 :] @ back
    turns = np.exp(1j * np.pi * np.arange(1, len(power) + 1) / len(power))
    into, out = model.matrix[:n, n + 1 + k], model.matrix[-1, n + 1 + k]
    states = np.linalg.solve(turns[:, None, None] * np.eye(n) - closed[:n], np.tile(into[:, None], (len(turns), 1, 1)))
    response = states[..., 0] @ closed[-1] + out
    return float(np.sqrt(power @ np.abs(response) ** 2 / power.sum()))
