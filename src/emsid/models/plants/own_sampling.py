"""A user's plant sample by sample: its functions compiled into one call."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.models.plants.state import NO_ROWS, PlantState

Array = NDArray[np.float64]


class OwnSampler:
    """A user's plant between two samples."""

    __slots__ = ("_dt", "_f", "_filled", "_g", "_numbers", "_steps", "_taps", "_window", "_x")

    def __init__(
        self, f: Any, g: Any, numbers: Array, taps: Array | None, steps: int, state: PlantState, inputs: int
    ) -> None:
        """
        Args:
            f, g: derivative and output, compiled.
            numbers: (p,) the parameters.
            taps: (2·steps + 1, w) the input at every half step as sums over the last w samples; None where it is held.
            steps: Runge–Kutta steps per sample.
            state: where it begins.
            inputs: nu.
        """
        self._f, self._g, self._numbers, self._taps, self._steps = f, g, numbers, taps, steps
        self._window = np.zeros((1 if taps is None else taps.shape[1], inputs))
        self._filled = 0 if taps is None else len(state.commands)
        if self._filled:
            self._window[-self._filled :] = state.commands
        self._x, self._dt = np.array(state.motion, dtype=float), state.dt

    def advance(self, u: Array, y: Array) -> None:
        """Write the outputs (ny,) for inputs (nu,), and change the state."""
        self._window[:-1] = self._window[1:]
        self._window[-1] = u
        if self._filled < len(self._window) - 1:
            self._filled += 1
            y[:] = self._g(self._x, u, self._numbers)
            return
        held = self._taps is None
        fine = self._window if self._taps is None else self._taps @ self._window
        how = self._numbers, self._x, self._dt, self._steps, y[None, :]
        compiled_runge_kutta(self._f, self._g, fine, int(not held), *how)

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


def runge_kutta(
    f: Any, g: Any, inputs: Array, apart: int, p: Array, state: Array, dt: float, steps: int, out: Array
) -> None:
    """Fill ``out`` (N, ny) by the classical Runge–Kutta method, and move ``state`` (n,) to the end of the last sample.

    Numbers are copied one by one: Numba takes seconds to compile the assignment of an array to a slice.

    Args:
        f, g: derivative and output.
        inputs, apart: (2·steps·N + 1, nu) at every half step, and 1; or (N, nu) where they are held, and 0.
        p, state, dt, steps: parameters, where it begins, the sample time in s and steps per sample.
        out: the outputs.
    """
    x = state.copy()
    h = dt / steps
    for k in range(len(out)):
        at = 2 * steps * k if apart else k
        y = np.asarray(g(x, inputs[at], p))
        for i in range(out.shape[1]):
            out[k, i] = y[i]
        for _ in range(steps):
            k1 = np.asarray(f(x, inputs[at], p))
            k2 = np.asarray(f(x + 0.5 * h * k1, inputs[at + apart], p))
            k3 = np.asarray(f(x + 0.5 * h * k2, inputs[at + apart], p))
            k4 = np.asarray(f(x + h * k3, inputs[at + 2 * apart], p))
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            at += 2 * apart
    for i in range(len(x)):
        state[i] = x[i]


compiled_runge_kutta = njit(cache=False, nogil=True)(runge_kutta)
