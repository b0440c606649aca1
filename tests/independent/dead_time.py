"""Records of a cascade with a dead time between its filters, by difference equations."""

from __future__ import annotations

import numpy as np

from emsid.record import Record


def record(late: int, seed: int = 0, samples: int = 1200) -> Record:
    """x = 0.4/(1 − 0.6q⁻¹) u, z a cubic of x, y = (0.3 + 0.2q⁻¹)/(1 − 0.5q⁻¹) z(t − late), with 1 % noise."""
    rng = np.random.default_rng([7, seed])
    u, x, y = rng.uniform(-2, 2, samples), np.zeros(samples), np.zeros(samples)
    for t in range(1, samples):
        x[t] = 0.6 * x[t - 1] + 0.4 * u[t]
    z = x - 0.15 * x**3
    z = np.concatenate([np.zeros(late), z])[:samples]
    for t in range(1, samples):
        y[t] = 0.5 * y[t - 1] + 0.3 * z[t] + 0.2 * z[t - 1]
    return Record(u, y + 0.01 * np.std(y) * rng.standard_normal(samples), 0.01)
