r"""A linear system without noise, offsets and dead time as a value: of a linear model, or of another one at a level.

Discrete time: x(t + 1) = A x + B u, y = C x + D u. Continuous time: dx/dt = A x + B u. A command that is held over a
sample takes one into the other by

    exp([A B; 0 0]·dt) = [A_d B_d; 0 I]                  the matrix logarithm goes back.

A dead time of d samples and a part p of one more takes the last inputs as further states: over a sample, the input of
d + 1 samples ago acts for p of it and that of d samples ago for the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.models.linear_parts import python_control
from emsid.record.channels import ChannelNames

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

INFINITE = 1e8
"""Generalised eigenvalues that are this many times larger than the matrices are zeros at infinity."""
WHOLE = 1e-9
"""A dead time is whole samples to this part of one."""


@dataclass(frozen=True, eq=False, repr=False)
class LinearSystem:
    """A linear system in state space.

    Args:
        a: (n, n).
        b: (n, nu).
        c: (ny, n).
        d: (ny, nu).
        dt: sample time in s; None in continuous time.
        delay: dead time in s that is left out of the matrices.
        name: of the model that it describes.
        channels: names and units of its inputs and outputs; None where not known.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    dt: float | None
    delay: float = 0.0
    name: str = "linear"
    channels: ChannelNames | None = None

    def __repr__(self) -> str:
        (outputs, inputs), time = self.d.shape, "continuous time" if self.dt is None else f"dt {self.dt:g} s"
        sides = f"{inputs} in, {outputs} out"
        if self.channels is not None:
            sides = f"{', '.join(self.channels.inputs_in_units)} → {', '.join(self.channels.outputs_in_units)}"
        return f"LinearSystem({self.name}: {sides}, {len(self.a)} states, {time})"

    def to_control(self) -> Any:
        """The system for python-control, without its dead time, with the names and units of its channels.

        Raises:
            ModelError: if python-control is not installed.
        """
        known = self.channels
        names = {} if known is None else {"inputs": known.inputs_in_units, "outputs": known.outputs_in_units}
        return python_control().ss(self.a, self.b, self.c, self.d, self.dt or 0, name=self.name, **names)

    @property
    def poles(self) -> Complex:
        """(n,) eigenvalues of A, in 1/s in continuous time."""
        return np.linalg.eigvals(self.a).astype(complex) if len(self.a) else np.zeros(0, dtype=complex)

    @property
    def zeros(self) -> Complex:
        """The finite transmission zeros, where [A − zI, B; C, D] loses rank; of as many inputs as outputs.

        Raises:
            ModelError: for other numbers of inputs and outputs.
        """
        from scipy.linalg import eigvals

        n, (outputs, inputs) = len(self.a), self.d.shape
        if inputs != outputs:
            raise ModelError(f"{self.name} has {inputs} inputs and {outputs} outputs; zeros need as many of both")
        whole = np.block([[self.a, self.b], [self.c, self.d]])
        finite = np.zeros_like(whole)
        finite[:n, :n] = np.eye(n)
        found = eigvals(whole, finite)
        scale = INFINITE * max(1.0, float(np.abs(whole).max(initial=0.0)))
        return np.asarray(found[np.isfinite(found) & (np.abs(found) < scale)], dtype=complex)

    @property
    def gain(self) -> Array:
        """(ny, nu) the gain in steady state; infinite for an integrator."""
        n = len(self.a)
        left = -self.a if self.dt is None else np.eye(n) - self.a
        if n and np.linalg.cond(left) > 1.0 / np.finfo(float).eps:
            return np.full(self.d.shape, np.inf)
        return np.asarray(self.c @ np.linalg.solve(left, self.b) + self.d)

    def response(self, frequency: ArrayLike) -> Complex:
        """(F, ny, nu) the frequency response at frequencies (F,) in Hz, with the dead time."""
        w = 2j * np.pi * np.atleast_1d(np.asarray(frequency, dtype=float))
        at = w if self.dt is None else np.exp(w * self.dt)
        resolvent = at[:, None, None] * np.eye(len(self.a)) - self.a
        inside = np.linalg.solve(resolvent, np.broadcast_to(self.b, (len(at), *self.b.shape)))
        return np.asarray((self.c @ inside + self.d) * np.exp(-w * self.delay)[:, None, None])

    def to_discrete(self, dt: float) -> LinearSystem:
        """The system at a sample time in s, for inputs that are held over a sample.

        Whole samples of a dead time remain as one; a part of a sample needs a state for every input.
        """
        if self.dt is not None:
            return self if np.isclose(dt, self.dt, rtol=1e-9, atol=0.0) else self.to_continuous().to_discrete(dt)
        whole = int(self.delay / dt + WHOLE)
        part = max(self.delay / dt - whole, 0.0)
        a, b = self._held(dt)
        if part <= WHOLE:
            return replace(self, a=a, b=b, dt=float(dt), delay=whole * dt)
        rest, later = self._held((1 - part) * dt)
        earlier, n, inputs = rest @ self._held(part * dt)[1], *self.b.shape
        return replace(
            self,
            a=np.block([[a, earlier], [np.zeros((inputs, n + inputs))]]),
            b=np.vstack([later, np.eye(inputs)]),
            c=np.hstack([self.c, self.d]),
            d=np.zeros_like(self.d),
            dt=float(dt),
            delay=whole * dt,
        )

    def _held(self, time: float) -> tuple[Array, Array]:
        from scipy.linalg import expm

        n, inputs = self.b.shape
        both = np.zeros((n + inputs, n + inputs))
        both[:n, :n], both[:n, n:] = self.a * time, self.b * time
        with np.errstate(all="ignore"):  # of numbers that overflow, which no model takes
            moved = expm(both)
        return moved[:n, :n], moved[:n, n:]

    def with_past_inputs(self) -> LinearSystem:
        """A system in discrete time with its dead time as states: the inputs of that many samples."""
        late, (n, inputs) = 0 if self.dt is None else round(self.delay / self.dt), self.b.shape
        if not late:
            return self
        size = n + late * inputs
        a, b = np.zeros((size, size)), np.zeros((size, inputs))
        a[:n, :n], a[:n, size - inputs :], b[n : n + inputs] = self.a, self.b, np.eye(inputs)
        a[n + inputs :, n : size - inputs] = np.eye(size - n - inputs)
        c = np.hstack([self.c, np.zeros((len(self.c), size - n))])
        c[:, size - inputs :] += self.d
        return replace(self, a=a, b=b, c=c, d=np.zeros_like(self.d), delay=0.0)

    def to_continuous(self) -> LinearSystem:
        """The system in continuous time that gives the same samples for inputs that are held.

        Raises:
            ModelError: for a pole at zero or on the negative real axis, which no such system of this order has.
        """
        from scipy.linalg import logm

        if self.dt is None:
            return self
        poles = self.poles
        if np.any((np.abs(poles.imag) <= 1e-12 * np.abs(poles)) & (poles.real <= 0)):
            raise ModelError(
                f"{self.name} has a pole that is zero or negative, so no system of this order in continuous time has "
                "its samples; a model of smaller order or with less delay has one"
            )
        n, inputs = self.b.shape
        both = np.eye(n + inputs)
        both[:n, :n], both[:n, n:] = self.a, self.b
        moved = np.real(logm(both)) / self.dt
        return replace(self, a=moved[:n, :n], b=moved[:n, n:], dt=None)
