"""The linear part of a model, and its conversion to python-control."""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]


class StateSpace(NamedTuple):
    """dx/dt = A·x + B·u, y = C·x + D·u, in SI units.

    Attributes:
        a: (n, n).
        b: (n, nu).
        c: (ny, n).
        d: (ny, nu).
        states: a name for every state.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    states: tuple[str, ...]

    def observed(self) -> StateSpace:
        """The same without the states that no output depends on, as the angle where only a speed is read."""
        seen = np.any(self.c != 0, axis=0)
        for _ in seen:
            seen |= np.any(self.a[seen] != 0, axis=0)
        states = tuple(name for name, kept in zip(self.states, seen, strict=True) if kept)
        return StateSpace(self.a[np.ix_(seen, seen)], self.b[seen], self.c[:, seen], self.d, states)

    def with_lag(self, time: float, outputs: tuple[int, ...]) -> StateSpace:
        """The same with these outputs filtered by 1/(1 + time·s)."""
        if not (time > 0 and outputs):
            return self
        rows = list(outputs)
        n, extra = len(self.a), len(rows)
        a, b = np.zeros((n + extra, n + extra)), np.zeros((n + extra, self.b.shape[1]))
        c, d = np.hstack([self.c, np.zeros((len(self.c), extra))]), self.d.copy()
        a[:n, :n], b[:n] = self.a, self.b
        a[n:, :n], b[n:] = self.c[rows] / time, self.d[rows] / time
        a[n:, n:] = -np.eye(extra) / time
        c[rows], d[rows] = 0.0, 0.0
        c[rows, n + np.arange(extra)] = 1.0
        return StateSpace(a, b, c, d, (*self.states, *(f"shown output {row + 1}" for row in rows)))


def python_control() -> Any:
    """The module `control`.

    Raises:
        ModelError: if it is not installed.
    """
    try:
        return import_module("control")
    except ImportError:
        raise ModelError("python-control is not installed; install it with: pip install emsid[control]") from None
