"""The linear part of a cascade: its filters with the slopes of its maps at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from emsid.errors import ModelError
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.linear.state_space import observer_form
from emsid.models.linear.system import LinearSystem


def linear_part(model: Cascade, at: float) -> LinearSystem:
    """The filters with the slopes of the maps at rest; in steps of the blocks, with the delay aside."""
    if model.dt is None:
        raise ModelError(f"{model.name} has no sample time; make it with dt=… in s")
    dt = model.dt / model.oversampling
    system = LinearSystem(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)), dt, model.delay * model.dt, model.name
    )
    x = at - model.input_offset
    for block in model.blocks:
        if isinstance(block, Rational):
            b, a = block.transfer
            own, columns = observer_form(a, [b])
            n, m = len(system.a), len(own)
            joined = np.zeros((n + m, n + m))
            joined[:n, :n], joined[n:, :n], joined[n:, n:] = system.a, columns @ system.c, own
            entering = np.vstack([system.b, columns @ system.d])
            output = np.hstack([b[0] * system.c, np.eye(1, m)])
            system = replace(system, a=joined, b=entering, c=output, d=b[0] * system.d)
        else:
            slope = float(block.slope(np.array([x]))[0])  # type: ignore[attr-defined]
            system = replace(system, c=slope * system.c, d=slope * system.d)
        x = block.resting(x)[1]
    return system
