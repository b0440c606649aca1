r"""Filters of higher order where one more pole and zero explain a part of the error.

A frequency response in which a static map leaves distortion shows fewer poles than the system has. The error of the
fitted cascade shows those that are missing. A pole p that a zero cancels, (1 − pq⁻¹)/(1 − pq⁻¹), changes nothing; the
derivative with respect to the zero is the output s of the filter through a lag,

    ∂y/∂z = −F · q⁻¹/(1 − pq⁻¹) s,

where F stands for the linearised blocks behind it. One linear problem gives the part of the squared error that this
direction explains in addition to the parameters of the cascade (Rao's score test). The larger filter starts with the
pole that explains most.

References:
    Rao, *Large sample tests of statistical hypotheses concerning several parameters*, Math. Proc. Cambridge Phil. Soc.
    44 (1948).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import FreeRun, search
from emsid.models.blocks.search.orders import LARGEST_ORDER, SAMPLES_PER_PARAMETER
from emsid.models.blocks.search.starts import with_cancelled_pole
from emsid.models.blocks.search.topologies import Orders, Topology
from emsid.record import Record
from emsid.selection.improvement import matters, schwarz_gain

Array = NDArray[np.float64]

# Time constants of the poles that are tried, in steps of the filter.
TIME_CONSTANTS = 2.0 ** np.arange(-1, 10)
# Parts of a derivative that the others explain up to rounding.
ROUNDING = 1e-6


def larger_cascades(
    model: Cascade,
    topology: Topology,
    orders: Orders,
    records: Sequence[Record],
) -> list[Cascade]:
    """The cascade with one pole and zero more in a filter, for every filter whose error shows that one is missing.

    The part of the squared error that is explained has to matter, and more than chance by Schwarz's criterion.

    Args:
        model: fitted to the records.
        topology: of the cascade.
        orders: that are given, of the filters before and after the map; the others may rise.
        records: to which it is fitted.
    """
    filters = [k for k, block in enumerate(model.blocks) if isinstance(block, Rational)]
    there = (topology.first, topology.second)
    most = [LARGEST_ORDER if order is None else 0 for order, used in zip(orders, there, strict=True) if used]
    open_ = [k for k, order in zip(filters, most, strict=True) if len(_filter(model, k).denominator) < order]
    room = sum(len(record) for record in records) / SAMPLES_PER_PARAMETER - len(model.parameters)
    if not open_ or room < 2:
        return []
    minimum, problem = search(model, records, max_iterations=0, covariances=False)
    model = problem.model(minimum.estimate)
    poles = np.exp(-1 / TIME_CONSTANTS)
    larger = []
    for k, parts in zip(open_, explained(problem, minimum.estimate, open_, poles), strict=True):
        best = int(np.argmax(parts))
        left = 1.0 - float(parts[best])
        if matters(left, 1.0) and schwarz_gain(left, 1.0, minimum.samples, 2) > 0:
            block = with_cancelled_pole(_filter(model, k), poles[best])
            blocks = (*model.blocks[:k], block, *model.blocks[k + 1 :])
            larger.append(replace(model, blocks=blocks))
    return larger


def explained(problem: FreeRun, theta: Array, which: Sequence[int], poles: Array) -> Array:
    """(filters, poles) the part of the squared error that a pole and zero more in a filter explain, to first order.

    Args:
        problem: of the cascade.
        theta: its parameters and initial states.
        which: indices of the filters among the blocks.
        poles: (m,) real poles.
    """
    model, linearised = problem.model(theta), problem.linearised(theta)
    error = np.concatenate([residual for residual, _ in linearised])
    rows = np.concatenate([derivative for _, derivative in linearised])
    axes, sizes, _ = np.linalg.svd(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300), full_matrices=False)
    known = axes[:, sizes > ROUNDING * sizes[0]]
    error = error - known @ (known.T @ error)
    found = []
    for k in which:
        pushed = []
        for (u, _), states in zip(problem.segments, problem.states(theta), strict=True):
            signals = model.signals(u, states)
            moved = np.array([_lagged(signals[k + 1], pole) for pole in poles])
            for x, block in zip(signals[k + 1 : -1], model.blocks[k + 1 :], strict=True):
                block.push(x, moved)
            pushed.append(moved[:, :: model.oversampling][:, problem.transient :])
        new = np.concatenate(pushed, axis=1)
        before = np.linalg.norm(new, axis=1)
        new = new - (new @ known) @ known.T
        after = np.linalg.norm(new, axis=1)
        along = np.where(after > ROUNDING * before, new @ error / np.maximum(after, 1e-300), 0.0)
        found.append(along**2 / max(float(error @ error), 1e-300))
    return np.array(found)


def _filter(model: Cascade, k: int) -> Rational:
    block = model.blocks[k]
    assert isinstance(block, Rational)
    return block


def _lagged(signal: Array, pole: float) -> Array:
    """(N,) the signal through q⁻¹/(1 − pq⁻¹), from rest."""
    lag = Rational(np.array([0.0, 1.0]), np.array([-pole]))
    return lag.output(signal, lag.resting(float(signal[0]))[0])
