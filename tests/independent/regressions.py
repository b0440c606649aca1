"""Records of difference equations with noise where least squares does and does not allow for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from emsid.record import Record

POLES, ZEROS, TAPS = (-1.5, 0.56), (0.04, 0.02), (0.5, 0.3, 0.2)
LEFT_OUT = 200
"""Samples before the record, in which transients die away."""


@dataclass(frozen=True)
class Equation:
    """A(q)y = B(q)u with noise.

    Attributes:
        equation: standard deviation of the noise in the equation, over that of the noise-free output.
        output: standard deviation of white noise on the output, over the same.
        pole: of the noise in the equation.
        poles: a₁, a₂, …; none for a filter of past inputs only.
        zeros: b₁, b₂, …
        free_run: whether it is fitted to the free run.
    """

    equation: float = 0.0
    output: float = 0.0
    pole: float = 0.0
    poles: tuple[float, ...] = POLES
    zeros: tuple[float, ...] = ZEROS
    free_run: bool = False

    @property
    def truth(self) -> tuple[float, ...]:
        """Poles, then zeros."""
        return (*self.poles, *self.zeros)

    def record(self, seed: int, samples: int = 500) -> Record:
        """One record, driven by coloured noise."""
        rng = np.random.default_rng([4, seed])
        u = lfilter([1], [1, -0.7], rng.standard_normal(samples + LEFT_OUT))
        white = rng.standard_normal((2, samples + LEFT_OUT))
        clean = lfilter([0, *self.zeros], [1, *self.poles], u)
        noise = lfilter([np.sqrt(1 - self.pole**2)], [1, -self.pole], white[0])
        y = clean + np.std(clean) * (self.equation * lfilter([1], [1, *self.poles], noise) + self.output * white[1])
        return Record(u[LEFT_OUT:], y[LEFT_OUT:], 0.01)


EQUATIONS: Mapping[str, Equation] = {
    "white": Equation(equation=0.02),
    "coloured": Equation(equation=0.02, pole=0.8),
    "output noise": Equation(output=0.05),
    "output noise, free run": Equation(output=0.05, free_run=True),
    "inputs only, coloured": Equation(equation=0.4, pole=0.9, poles=(), zeros=TAPS),
}
"""The settings by name."""
