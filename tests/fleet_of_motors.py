"""A fleet of motors in small fixed steps, by equations written here anew, for the tests of what differs in a motor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import polars as pl

DT, PARTS = 5e-3, 40
"""Sample time in s, and steps in a sample."""
USUAL = {"R": 2.0, "K": 0.05, "J": 5e-5, "B": 2e-5, "friction": 0.01, "zone": 0.3, "noise": 0.2}


def records(
    motors: int, samples: int, faults: Mapping[int, Mapping[str, float]], seed: int, spread: float = 0.03
) -> pl.DataFrame:
    """Voltage and speed of motors whose constants differ by 3 %, except R and noise; faults multiply them.

    Beside the constants, ``counts`` multiplies the speed that is read, and ``supply`` the voltage that acts.
    """
    rng = np.random.default_rng(seed)
    level = rng.uniform(-8.0, 8.0, (samples // 12 + 1, motors)).repeat(12, axis=0)[:samples]
    of = {name: np.full(motors, value) for name, value in {**USUAL, "counts": 1.0, "supply": 1.0}.items()}
    for name in ("K", "J", "B", "friction", "zone"):
        of[name] *= 1 + spread * rng.standard_normal(motors)
    for motor, changed in faults.items():
        for name, factor in changed.items():
            of[name][motor] *= factor
    speed, read, h = np.zeros(motors), np.empty((samples, motors)), DT / PARTS
    for k in range(samples):
        read[k] = speed
        voltage = of["supply"] * level[k]
        voltage = np.sign(voltage) * np.maximum(np.abs(voltage) - of["zone"], 0.0)
        for _ in range(PARTS):
            free = speed + h / of["J"] * (of["K"] * (voltage - of["K"] * speed) / of["R"] - of["B"] * speed)
            speed = np.sign(free) * np.maximum(np.abs(free) - h * of["friction"] / of["J"], 0.0)
    read = of["counts"] * read + of["noise"] * rng.standard_normal(read.shape)
    names = np.array([f"M{k:02d}" for k in range(motors)])
    columns = {"t": np.tile(DT * np.arange(samples), motors), "motor": names.repeat(samples)}
    return pl.DataFrame({**columns, "voltage": level.T.ravel(), "speed": read.T.ravel()})
