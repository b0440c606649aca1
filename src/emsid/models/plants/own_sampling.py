"""A user's plant sample by sample: its functions compiled into one call."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.models.plants.state import NO_ROWS, PlantState

Array = NDArray[np.float64]


class OwnSampler:
    """A user's plant between two samples."""

    __slots__ = ("_dt", "_filled", "_fine", "_kernel", "_numbers", "_steps", "_taps", "_window", "_x")

    def __init__(
        self,
        kernel: Callable[..., None],
        numbers: Array,
        taps: Array | None,
        steps: int,
        state: PlantState,
        inputs: int,
    ) -> None:
        """
        Args:
            kernel: of `kernel_for`.
            numbers: (p,) the parameters.
            taps: (2·steps + 1, w) the input at every half step as sums over the last w samples; None where it is held.
            steps: Runge–Kutta steps per sample.
            state: where it begins.
            inputs: nu.
        """
        width = 1 if taps is None else taps.shape[1]
        self._kernel, self._numbers, self._steps = kernel, numbers, steps
        self._taps = np.ones((2 * steps + 1, 1)) if taps is None else taps
        self._window, self._fine = np.zeros((width, inputs)), np.empty((2 * steps + 1, inputs))
        self._filled = 0 if taps is None else len(state.commands)
        if self._filled:
            self._window[-self._filled :] = state.commands
        self._x, self._dt = np.array(state.motion, dtype=float), state.dt

    def advance(self, u: Array, y: Array) -> None:
        """Write the outputs (ny,) for inputs (nu,), and change the state."""
        ready = self._filled == len(self._window) - 1
        self._kernel(self._taps, self._window, self._fine, ready, self._numbers, self._x, self._dt, self._steps, u, y)
        if not ready:
            self._filled += 1

    @property
    def state(self) -> PlantState:
        """The present state."""
        kept = self._window[len(self._window) - self._filled :].copy() if len(self._window) > 1 else NO_ROWS
        return PlantState(self._dt, self._x.copy(), kept, NO_ROWS)


def compiled(function: Any, *arguments: Any) -> Any:
    """The function compiled, or None where it cannot be compiled or then gives something else than an array."""
    found = function if hasattr(function, "py_func") else njit(cache=False, nogil=True)(function)
    try:
        result = found(*arguments)
    except Exception:  # whatever the compiler finds in a user's code
        return None
    return found if isinstance(result, np.ndarray) and result.dtype == np.float64 else None


@lru_cache(maxsize=16)
def kernel_for(f: Any, g: Any) -> Callable[..., None]:
    """One sample of the plant with compiled derivative f and output g, by the classical Runge–Kutta method."""

    @njit(cache=False, nogil=True)
    def sample(
        taps: Array,
        window: Array,
        fine: Array,
        ready: bool,
        p: Array,
        state: Array,
        dt: float,
        steps: int,
        u: Array,
        y: Array,
    ) -> None:
        for i in range(len(window) - 1):
            for k in range(len(u)):
                window[i, k] = window[i + 1, k]
        for k in range(len(u)):
            window[-1, k] = u[k]
        for i in range(len(taps)):
            for k in range(len(u)):
                total = 0.0
                for j in range(taps.shape[1]):
                    total += taps[i, j] * window[j, k]
                fine[i, k] = total
        x = state.copy()
        seen = g(x, fine[0] if ready else u, p)
        for i in range(len(y)):
            y[i] = seen[i]
        if not ready:
            return
        h = dt / steps
        for s in range(steps):
            k1 = f(x, fine[2 * s], p)
            k2 = f(x + 0.5 * h * k1, fine[2 * s + 1], p)
            k3 = f(x + 0.5 * h * k2, fine[2 * s + 1], p)
            k4 = f(x + h * k3, fine[2 * s + 2], p)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        for i in range(len(x)):
            state[i] = x[i]

    return sample
