"""Random filters around a random static map, simulated by SciPy: cascades to count the endings of fits on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter, zpk2tf

from emsid import Record

Array = NDArray[np.float64]

MAPS: dict[str, Callable[[Array], Array]] = {
    "saturation": lambda x: np.clip(x, -1.0, 1.0),
    "dead zone": lambda x: x - np.clip(x, -0.5, 0.5),
    "arctangent": lambda x: np.arctan(2.0 * x),
    "cubic": lambda x: x + 0.3 * x**3,
    "rectifier": lambda x: np.where(x > 0, x, 0.2 * x),
}
"""Of an input with a standard deviation of one."""


def cascade(seed: int, samples: int = 4_000, noise: float = 0.01) -> tuple[str, Record, Record, float]:
    """A random cascade: the kind of its map, a record to fit, one to judge on, and the noise of both.

    Args:
        seed: of the system and its records.
        samples: of each record.
        noise: standard deviation of white noise over that of the output.
    """
    rng = np.random.default_rng(seed)
    first, second = (_filter(rng, int(rng.integers(1, 4))) for _ in range(2))
    kind = str(rng.choice(list(MAPS)))
    u = lfilter([1.0], [1.0, -0.7], rng.standard_normal((2, samples + 500)))
    x = lfilter(*first, u)
    y = lfilter(*second, MAPS[kind](x / np.std(x)))[:, 500:]
    size = noise * float(np.std(y))
    y += size * rng.standard_normal(y.shape)
    fitted, judge = (Record(a[500:], b, 0.001, name=f"cascade {seed}") for a, b in zip(u, y, strict=True))
    return kind, fitted, judge, size


def _filter(rng: np.random.Generator, order: int) -> tuple[Array, Array]:
    """(n + 1,) numerator and denominator of unit gain, without a pole or zero near the unit circle."""
    pairs = rng.uniform(0.6, 0.9, order // 2) * np.exp(1j * rng.uniform(0.1, 1.0, order // 2))
    poles = [*pairs, *np.conj(pairs), *rng.uniform(0.4, 0.9, order % 2)]
    b, a = zpk2tf(rng.uniform(-0.8, 0.6, order), poles, 1.0)
    return b * np.sum(a) / np.sum(b), a
