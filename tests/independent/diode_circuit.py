"""A filter, a resistor with a diode to ground, and a filter of an electronic circuit, simulated in small steps.

The diode clips one side, so its output has frequencies above half the sampling rate. The second filter removes most of
them before they are sampled.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cheby1, cheby2, lfilter

from emsid import Record

Array = NDArray[np.float64]

RATE, STEPS = 51_200.0, 8
"""Samples per second, and steps of the simulation per sample."""
HIGHEST = 10_000.0
"""The largest frequency of the input in Hz."""
SETTLING = 3_000
"""Samples before a record, in which the filters settle."""


def clipped(volts: Array, thermal: float = 0.044, saturation: float = 2e-8, ohms: float = 1e4) -> Array:
    """(N,) the voltage of a diode behind a resistor: volts = v + ohms·saturation·(exp(v/thermal) − 1)."""
    diode = np.concatenate([np.linspace(-8, 0.2, 4_000), np.linspace(0.2, 1.2, 40_000)[1:]])
    return np.asarray(np.interp(volts, diode + ohms * saturation * np.expm1(diode / thermal), diode))


def diode_circuit(seed: int, samples: int, noise: float) -> tuple[Record, Record, float]:
    """A record to fit, one without noise to judge on, and the standard deviation of the noise.

    Args:
        seed: of the corners and ripples of the filters, the level, the inputs and the noise.
        samples: to fit.
        noise: standard deviation over that of the output.
    """
    rng = np.random.default_rng(seed)
    first, second, ripple, stopped = rng.uniform(0.8, 1.25, 4)
    level = rng.uniform(0.6, 1.0)
    corner = 2 / (RATE * STEPS)
    before = cheby1(3, 0.5 * ripple, 4_400 * first * corner)
    behind = cheby2(3, 40 * stopped**0.3, 9_000 * second * corner)

    def run(samples: int) -> tuple[Array, Array]:
        total = samples + SETTLING
        spectrum = np.zeros(total * STEPS // 2 + 1, dtype=complex)
        lines = int(HIGHEST / RATE * total)
        spectrum[1:lines] = rng.standard_normal(lines - 1) + 1j * rng.standard_normal(lines - 1)
        u = np.fft.irfft(spectrum, total * STEPS)
        u *= level / np.std(u)
        y = lfilter(*behind, clipped(lfilter(*before, u)))
        return u[::STEPS][SETTLING:], y[::STEPS][SETTLING:]

    (u, y), judge = run(samples), Record(*run(10_000), 1 / RATE)
    size = noise * float(np.std(y))
    return Record(u, y + size * rng.standard_normal(samples), 1 / RATE), judge, size
