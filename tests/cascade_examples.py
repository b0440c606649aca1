"""Cascades of every kind, and records of them under white input."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.static_maps import (
    Abs,
    CoulombLinear,
    CubicSpline,
    DeadZone,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    TwoSlopes,
    UserMap,
)
from emsid.record import Record

Array = NDArray[np.float64]
FAST = Rational([0.3, 0.15], [-0.75, 0.2])
SLOW = Rational([0.1, 0.05], [-1.3, 0.45])
KNOTS = np.linspace(-3, 3, 7)


CASCADES = {
    "linear": Cascade((SLOW,), output_offset=0.3),
    "two slopes": Cascade((FAST, TwoSlopes(0.2, 0.3, 1.4), SLOW)),
    "hammerstein": Cascade((DeadZone(-0.5, 0.4, 0.8, 1.2), SLOW), output_offset=0.2, delay=2),
    "wiener": Cascade((SLOW, CubicSpline(KNOTS, np.tanh(KNOTS)))),
    "wiener-hammerstein": Cascade((FAST, Polynomial(np.array([0.1, 1.0, 0.2, -0.1]), -3, 3), SLOW)),
    "wiener-hammerstein-spline": Cascade((FAST, CubicSpline(KNOTS, np.tanh(KNOTS)), SLOW)),
    "with a sign lost": Cascade((FAST, Abs(), SLOW), input_offset=0.1, output_offset=-0.3),
    "hammerstein-wiener": Cascade(
        (PiecewiseLinear(KNOTS, KNOTS + 0.1 * KNOTS**2), SLOW, Saturation(1.0, -0.6, 0.5)), output_offset=0.1
    ),
    "with friction": Cascade((FAST, CoulombLinear(0.3, 1.0, width=0.2), SLOW), input_offset=0.2),
    "of five blocks": Cascade((FAST, DeadZone(-0.3, 0.3), SLOW, Saturation(1.0, -1.0, 1.0), fir([0.5, 0.5], delay=1))),
    "oversampled": Cascade((FAST, CubicSpline(KNOTS, np.tanh(KNOTS)), SLOW), oversampling=3, delay=1),
    "user's": Cascade((FAST, UserMap(lambda x, p: x**3, lambda x, p: 3 * x**2), SLOW)),
}


def excitation(samples: int, seed: int = 0, size: float = 1.5) -> Array:
    """(samples,) white noise with this standard deviation."""
    return size * np.random.default_rng(seed).standard_normal(samples)


def record_of(model: Cascade, samples: int, noise: float = 0.0, seed: int = 0, size: float = 1.5) -> Record:
    """A record of the cascade from rest under `excitation`; the noise is a share of the output's spread."""
    u = excitation(samples, seed, size)
    y = model.output(u, model.resting(float(u[0])))
    spread = noise * float(np.std(y))
    return Record(u, y + spread * np.random.default_rng(seed + 1000).standard_normal(samples), 1e-3)
