"""Test signals by name, with defaults for everything but their size.

The defaults excite one band: from one cycle in the record to a twentieth of the sampling frequency, where a drive that
is sampled fast enough still responds.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from emsid.excitation.checks import positive, whole
from emsid.excitation.pseudo_random import PRIMITIVE_POLYNOMIALS, amplitude_modulated_prbs, prbs
from emsid.excitation.sines import full_harmonics, multisine, odd_harmonics, sines
from emsid.excitation.sweeps import chirp, logarithmic_sweep, ramp, staircase

Array = NDArray[np.float64]

Signal = Callable[[int, float, float, np.random.Generator], Array]
"""(samples, dt in s, amplitude, rng) → (samples,) with |u| ≤ amplitude: an entry of `SIGNALS`."""

# The highest frequency, as a fraction of the sampling frequency.
_TOP = 1 / 20
# The longest period of a multisine in samples; longer records repeat it, which separates noise from response.
_LONGEST_PERIOD = 10_000


def _band(samples: int, dt: float) -> tuple[float, float]:
    lowest = 1 / (whole(samples, "number of samples") * positive(dt, "sample time"))
    return lowest, max(lowest, _TOP / dt)


def _sines(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """five sines, the slowest the largest, random phases"""
    lowest, highest = _band(samples, dt)
    frequencies = lowest * (highest / lowest) ** (np.arange(1, 6) / 5)
    weights = np.arange(5, 0, -1) / 15
    return sines(samples, dt, positive(amplitude, "amplitude") * weights, frequencies, rng.uniform(-np.pi, np.pi, 5))


def _multisine(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """flat multisine of low crest factor"""
    period = min(samples, _LONGEST_PERIOD)
    harmonics = full_harmonics(period, dt, *_band(period, dt))
    return multisine(samples, harmonics, rng, amplitude, period=period)


def _odd_multisine(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """the same on odd harmonics only"""
    period = min(samples, _LONGEST_PERIOD)
    harmonics = odd_harmonics(period, dt, *_band(period, dt))
    return multisine(samples, harmonics, rng, amplitude, period=period)


def _prbs(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """binary noise, the longest period that fits"""
    count = whole(samples, "number of samples")
    hold = max(1, min(round(0.44 / _TOP), count // 3))  # 0.44/(hold·dt): the half-power frequency
    order = min(max(2, (count // hold + 1).bit_length() - 1), max(PRIMITIVE_POLYNOMIALS))
    return prbs(count, order, amplitude, hold=hold, start=int(rng.integers(1, 2**order)))


def _aprbs(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """steps between some sixty random levels"""
    hold = max(1, whole(samples, "number of samples") // 127)
    return amplitude_modulated_prbs(samples, 7, rng, amplitude, hold=hold, start=int(rng.integers(1, 128)))


def _chirp(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """sine swept linearly in frequency"""
    return chirp(samples, dt, *_band(samples, dt), amplitude)


def _log_chirp(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """sine swept an octave at a time"""
    return chirp(samples, dt, *_band(samples, dt), amplitude, logarithmic_sweep)


def _staircase(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """five steps up, down, negative and back"""
    return staircase(samples, max(1, min(5, (whole(samples, "number of samples") - 1) // 4)), amplitude)


def _ramp(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """slow ramp up, down through zero and back"""
    a = positive(amplitude, "amplitude")
    return ramp(samples, (0.0, a, -a, 0.0))


SIGNALS: dict[str, Signal] = {
    "sines": _sines,
    "multisine": _multisine,
    "odd-multisine": _odd_multisine,
    "prbs": _prbs,
    "aprbs": _aprbs,
    "chirp": _chirp,
    "log-chirp": _log_chirp,
    "staircase": _staircase,
    "ramp": _ramp,
}
"""Every signal by its name on the command line; the docstring of the entry says in a few words what it is."""
