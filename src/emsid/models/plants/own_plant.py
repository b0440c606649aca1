"""A plant that a user defines by functions of state, input and parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.plants.parameters import Handle, Signal
from emsid.models.plants.plant import BasePlant
from emsid.models.plants.state import NO_ROWS, PlantState
from emsid.plant.parameter import Measure, Parameter

Array = NDArray[np.float64]

Derivative = Callable[[Array, Array, Array], Sequence[float] | Array]


@dataclass(frozen=True)
class OwnPlant(BasePlant):
    """A user's plant: dx/dt = derivative(x, u, p), y = output(x, u, p).

    It is integrated by the classical Runge–Kutta method. Functions compiled with ``numba.njit`` run in a compiled loop;
    they must return arrays.

    Args:
        derivative: of the state (n,), a function of state, input (nu,) held over the sample, and parameters (p,).
        output: (ny,), a function of the same arguments.
        table: the parameters, in the order of p.
        values: (p,) their values.
        states: n, the number of states.
        bounds: (name, lower, upper) for every parameter that has bounds.
        steps: Runge–Kutta steps per sample.
        name: its name in tables.
    """

    derivative: Derivative
    output: Derivative
    table: tuple[Parameter, ...]
    values: tuple[float, ...]
    states: int
    bounds: tuple[tuple[str, float, float], ...] = ()
    steps: int = 1
    name: str = "plant"

    def __post_init__(self) -> None:
        if len(self.values) != len(self.table):
            raise ModelError(f"{self.name}: {len(self.values)} values for {len(self.table)} parameters")

    @property
    def handles(self) -> Mapping[str, Handle]:
        """One handle for every row of the table."""
        limits = {name: (lower, upper) for name, lower, upper in self.bounds}
        return {
            p.name: Handle(p, ((("values", k), 1.0),), *limits.get(p.name, (-inf, inf)), _measure(p.unit))
            for k, p in enumerate(self.table)
        }

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state (n,) before the first sample; signals are not used.

        Raises:
            ModelError: for functions that return a wrong shape.
        """
        start, parameters = np.array(state, dtype=float), np.array(self.values)
        for what, function, shape in (
            ("derivative", self.derivative, (self.states,)),
            ("output", self.output, (len(signals),) if signals else None),
        ):
            found = np.shape(function(start.copy(), command, parameters))
            if len(found) != 1 or (shape is not None and found != shape):
                wanted = "(ny,)" if shape is None else shape
                raise ModelError(f"{self.name}: its {what} has shape {found}; it must be {wanted}")
        return PlantState(dt, start, NO_ROWS, NO_ROWS)

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The outputs (N, ny) for inputs (N, nu), and the state after them."""
        compiled = hasattr(self.derivative, "py_func") and hasattr(self.output, "py_func")
        loop = _compiled_runge_kutta if compiled else _runge_kutta
        parameters, x = np.array(self.values), state.motion.copy()
        inputs = np.ascontiguousarray(inputs)
        width = len(signals) or len(np.asarray(self.output(x.copy(), inputs[0], parameters)))
        out = np.empty((len(inputs), width))
        loop(self.derivative, self.output, inputs, parameters, x, state.dt, self.steps, out)
        return out, state._replace(motion=x)


def _measure(unit: str) -> Measure:
    """The most likely measure of a parameter with this unit."""
    return next((each for each in Measure if unit and unit in each.value), Measure.OTHER)


def _runge_kutta(f: Any, g: Any, inputs: Array, p: Array, state: Array, dt: float, steps: int, out: Array) -> None:
    """Fill ``out`` (N, ny), and update ``state`` (n,) to the end of the last sample."""
    x = state.copy()
    h = dt / steps
    for k in range(len(inputs)):
        u = inputs[k]
        out[k] = np.asarray(g(x, u, p))
        for _ in range(steps):
            k1 = np.asarray(f(x, u, p))
            k2 = np.asarray(f(x + 0.5 * h * k1, u, p))
            k3 = np.asarray(f(x + 0.5 * h * k2, u, p))
            k4 = np.asarray(f(x + h * k3, u, p))
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    state[:] = x


_compiled_runge_kutta = njit(nogil=True)(_runge_kutta)
