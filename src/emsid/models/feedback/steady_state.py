"""The steady states of a feedback model: where a run under a constant input comes to rest."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from emsid.models.feedback.kernels import LoopSignals

Array = NDArray[np.float64]

# Steps in which a state comes close to rest, and Newton steps that complete it.
SETTLING, NEWTON = 2_000, 50
# Newton steps below this share of the state end when they no longer shrink, and at rest a step changes less of it.
ROUNDING = 1e-9


class Stepping(Protocol):
    """What a steady state needs of a model."""

    @property
    def states(self) -> int:
        """How many there are, n."""
        ...

    @property
    def centre(self) -> Array:
        """(n,) where the run begins."""
        ...

    def stepped(self, v: Array, x: Array) -> tuple[LoopSignals, Array]:
        """The signals of a run over an input (N,) from a state (n,), and the last state."""
        ...

    def linearised_at(self, x: Array, u: float) -> tuple[Array, Array]:
        """(n,) the state one step after a state (n,), and (n + 1, n + 1) its derivative by state and input."""
        ...


def resting(model: Stepping, level: float) -> Array:
    """(n,) the steady state for a constant input: where a run from the centre ends, completed by Newton steps.

    Where these find no rest, or one that a run leaves, it is the end of the run, as of an oscillation in friction.
    """
    out, end = model.stepped(np.full(SETTLING, level), model.centre)
    if not np.isfinite(out.y).all():
        return _completed(model, model.centre, level)
    rest = _completed(model, end, level)
    after, whole = model.linearised_at(rest, level)
    found = np.abs(after - rest).max(initial=0.0) <= ROUNDING * np.abs(rest).max(initial=0.0)
    poles = np.linalg.eigvals(whole[: model.states, : model.states]) if found else np.array([np.inf])
    return rest if np.abs(poles).max(initial=0.0) <= 1 else end


def _completed(model: Stepping, x: Array, level: float) -> Array:
    """(n,) the steady state that Newton steps from a state x (n,) lead to."""
    n, before = model.states, np.inf
    for _ in range(NEWTON):
        after, whole = model.linearised_at(x, level)
        with np.errstate(all="ignore"):
            try:
                move = np.linalg.solve(np.eye(n) - whole[:n, :n], after - x)
            except np.linalg.LinAlgError:  # an integrator rests anywhere
                break
        if not np.isfinite(move).all():
            break
        x, size = x + move, float(np.abs(move).max(initial=0.0))
        if size <= ROUNDING * np.abs(x).max(initial=0.0) and size >= before / 2:  # moves are rounding errors now
            break
        before = size
    return x
