r"""Sums of sines: by amplitudes and frequencies, and multisines, which have power on chosen harmonics only.

The crest factor of a multisine depends on its phases: random phases give 3 or more. Two methods lower it and keep the
amplitude spectrum:

- *Schroeder's phases.* A signal whose frequency sweeps has a flat envelope. At a phase φ(ω) the group delay is −dφ/dω;
  a sweep that stays in each band in proportion to its power p, Σp = 1, needs φₙ = φₙ₋₁ − 2π·(p₁ + … + pₙ₋₁)
  [Schroeder].
- *Swapping between time and frequency.* Clip the signal, transform it, keep only the phases of its harmonics, put the
  wanted amplitudes back, and repeat [Van der Ouderaa]. Clipping low at first and higher later avoids poor local optima.

References:
    Schroeder, *Synthesis of low-peak-factor signals and binary sequences with low autocorrelation*, IEEE Trans.
    Information Theory 16 (1970). Van der Ouderaa, Schoukens, Renneboog, *Peak factor minimization using a
    time-frequency domain swapping algorithm*, IEEE Trans. Instrumentation and Measurement 37 (1988). Pintelon,
    Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed. (2012).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.excitation.checks import check_frequency, positive, vector, whole

Array = NDArray[np.float64]
Harmonics = NDArray[np.int64]

PhaseDesign = Callable[[Harmonics, Array, int, np.random.Generator], Array]
"""(harmonics (H,), their amplitudes (H,), period in samples, rng) → their phases (H,) in rad."""


def sines(
    samples: int, dt: float, amplitudes: ArrayLike, frequencies: ArrayLike, phases: ArrayLike | None = None
) -> Array:
    """The sum of sines u(t) = Σᵢ aᵢ sin(2π fᵢ t + φᵢ), as the sum of m signal generators.

    Args:
        samples: N, the number of samples.
        dt: sample time in seconds.
        amplitudes: (m,) aᵢ, in the unit of the signal.
        frequencies: (m,) fᵢ in Hz, below the Nyquist frequency.
        phases: (m,) φᵢ in rad; all zero where None.

    Raises:
        DataError: for lengths that differ, or a frequency that is negative or not below Nyquist.

    >>> sines(4, 0.25, [2.0], [1.0]).round(12) + 0.0
    array([ 0.,  2.,  0., -2.])
    """
    time = positive(dt, "sample time") * np.arange(whole(samples, "number of samples"))
    a, f = vector(amplitudes, "amplitudes"), vector(frequencies, "frequencies")
    phi = np.zeros_like(f) if phases is None else vector(phases, "phases")
    if not len(a) == len(f) == len(phi):
        raise DataError(f"{len(a)} amplitudes, {len(f)} frequencies and {len(phi)} phases; give one of each per sine")
    for frequency in f:
        check_frequency(float(frequency), dt)
    u = np.zeros_like(time)
    for amplitude, frequency, phase in zip(a, f, phi, strict=True):
        u += amplitude * np.sin(2 * np.pi * frequency * time + phase)
    return u


def full_harmonics(period: int, dt: float, lowest: float, highest: float) -> Harmonics:
    """Every harmonic h of a period of M samples with lowest ≤ h/(M·dt) ≤ highest.

    Args:
        period: M in samples.
        dt: sample time in seconds.
        lowest, highest: the band in Hz; its upper end lies below the Nyquist frequency.

    Raises:
        DataError: where the band holds no harmonic or reaches the Nyquist frequency.

    >>> full_harmonics(1000, 1e-3, 2.0, 6.0)
    array([2, 3, 4, 5, 6])
    """
    duration = whole(period, "period") * positive(dt, "sample time")
    check_frequency(lowest, dt)
    check_frequency(highest, dt)
    slack = 1e-9  # a band edge meant to be a harmonic counts as one in spite of rounding
    first = max(1, int(np.ceil(lowest * duration - slack)))
    chosen = np.arange(first, int(np.floor(highest * duration + slack)) + 1, dtype=np.int64)
    if not len(chosen):
        raise DataError(
            f"no harmonic of {1 / duration:g} Hz lies in {lowest:g} … {highest:g} Hz; "
            "lengthen the period or widen the band"
        )
    return chosen


def odd_harmonics(
    period: int,
    dt: float,
    lowest: float,
    highest: float,
    left_out: int = 0,
    rng: np.random.Generator | None = None,
) -> Harmonics:
    """The odd harmonics among `full_harmonics`, all of them or without detection lines.

    With one in every ``left_out`` of them left out at random, a response shows the level of odd distortion at those,
    and that of even distortion at the even ones: the fast method of `emsid.frequency_response`.

    Args:
        period: samples in a period.
        dt: sample time in s.
        lowest, highest: the band in Hz.
        left_out: of so many successive odd harmonics one is left out, 3 or more; none for 0.
        rng: source of the randomness; required for detection lines.

    Raises:
        DataError: where the band holds none, or reaches the Nyquist frequency; for detection lines without a generator.

    >>> odd_harmonics(1000, 1e-3, 2.0, 7.0)
    array([3, 5, 7])
    >>> len(odd_harmonics(1000, 1e-3, 1.0, 39.0, 4, np.random.default_rng(0)))
    15
    """
    chosen = full_harmonics(period, dt, lowest, highest)
    odd: Harmonics = chosen[chosen % 2 == 1]
    if not len(odd):
        raise DataError(
            f"harmonic {chosen[0]} alone lies in {lowest:g} … {highest:g} Hz, and it is even; widen the band"
        )
    if not left_out:
        return odd
    if left_out < 3 or rng is None:
        raise DataError("detection lines need a generator as rng, and are one in three harmonics or fewer")
    groups = np.arange(0, len(odd) - left_out + 1, left_out)
    return np.asarray(np.delete(odd, groups + rng.integers(0, left_out, len(groups))), dtype=np.int64)


def random_phases(harmonics: Harmonics, weights: Array, period: int, rng: np.random.Generator) -> Array:
    """(H,) independent phases, uniform over the circle: nearly Gaussian samples, crest factor 3 and more.

    Averaging a nonlinear distortion over realisations needs such phases [Pintelon & Schoukens, chapter 3].

    Args:
        harmonics: (H,) of the fundamental, ascending.
        weights: (H,) their relative amplitudes.
        period: samples in a period.
        rng: source of the randomness.
    """
    return rng.uniform(-np.pi, np.pi, len(harmonics))


def schroeder_phases(harmonics: Harmonics, weights: Array, period: int, rng: np.random.Generator) -> Array:
    """(H,) phases φₙ = φₙ₋₁ − 2π·((hₙ − hₙ₋₁)/g)·Σ_{l<n} pₗ, pₗ = wₗ²/Σw²: a sweep, crest factor about 1.7.

    g is the greatest common divisor of the spacings: the envelope repeats g times a period, so the sweep
    takes 1/g of it. φ₁ is drawn at random. Source: Schroeder (1970), here for harmonics of any spacing.

    Args:
        harmonics: (H,) of the fundamental, ascending.
        weights: (H,) their relative amplitudes.
        period: samples in a period.
        rng: source of the randomness.
    """
    spacing = np.diff(harmonics)
    common = np.gcd.reduce(spacing) if len(spacing) else 1
    power_below = np.cumsum(weights**2)[:-1] / np.sum(weights**2)
    advance = np.concatenate([[0.0], np.cumsum(spacing // common * power_below)])
    return rng.uniform(-np.pi, np.pi) - 2 * np.pi * advance


def low_crest_phases(
    harmonics: Harmonics, weights: Array, period: int, rng: np.random.Generator, iterations: int = 300
) -> Array:
    """(H,) phases of low crest factor, 1.4 to 1.5 for a flat band, by swapping between time and frequency.

    The iteration starts from Schroeder's phases, each shifted at random by up to π/4, so that every seed gives
    another signal. It clips at 1.0·rms first and 1.5·rms last, and returns the best phases it has found. Where the
    period is longer, it works on a grid of 16 to 32 samples per cycle of the highest harmonic.

    Args:
        harmonics, weights, period, rng: as for every `PhaseDesign`.
        iterations: number of swaps; fix it with `functools.partial` to pass another one to `multisine`.

    Source: Van der Ouderaa, Schoukens & Renneboog (1988).
    """
    grid = min(period, 2 ** int(np.ceil(np.log2(16 * harmonics[-1]))))
    nudge = rng.uniform(-np.pi / 4, np.pi / 4, len(harmonics))
    phases: Array = schroeder_phases(harmonics, weights, period, rng) + nudge
    best, lowest = phases, np.inf
    for level in np.linspace(1.0, 1.5, iterations):
        u = _synthesise(harmonics, weights * np.exp(1j * phases), grid)
        rms = np.sqrt(np.mean(u**2))
        crest = float(np.max(np.abs(u)) / rms)
        if crest < lowest:
            best, lowest = phases, crest
        spectrum = np.fft.rfft(np.clip(u, -level * rms, level * rms))
        phases = np.arctan2(spectrum.imag, spectrum.real)[harmonics]
    return best


def multisine(
    samples: int,
    harmonics: ArrayLike,
    rng: np.random.Generator,
    amplitude: float = 1.0,
    *,
    period: int | None = None,
    weights: ArrayLike | None = None,
    phases: PhaseDesign = low_crest_phases,
) -> Array:
    """The periodic sum u(k) = c Σₕ wₕ cos(2π h k / M + φₕ) over chosen harmonics h, with max|u| = amplitude.

    Over whole periods it has power on the chosen harmonics only. Power of a measured output at other harmonics
    is noise or comes from a nonlinearity: with odd harmonics only, an even nonlinearity shows on the even ones.

    Args:
        samples: N, the number of samples; the period is repeated, and the last one cut.
        harmonics: (H,) whole numbers 1 ≤ h < M/2, for example from `full_harmonics` or `odd_harmonics`.
        rng: source of the phases.
        amplitude: largest absolute value within a period, in the unit of the signal.
        period: M in samples; all N where None.
        weights: (H,) relative amplitudes wₕ > 0; all equal where None.
        phases: how φₕ are chosen: `low_crest_phases`, `schroeder_phases`, `random_phases` or your own.

    Raises:
        DataError: for no harmonics, repeated ones, or ones outside 1 … M/2; for bad sizes or weights.

    Source: Pintelon & Schoukens, chapter 5.
    """
    count = whole(samples, "number of samples")
    m = count if period is None else whole(period, "period")
    a = positive(amplitude, "amplitude")
    h = _harmonics(harmonics, m)
    w = np.ones(len(h)) if weights is None else vector(weights, "weights")
    if w.shape != h.shape or np.any(w <= 0):
        raise DataError(f"{len(w)} weights for {len(h)} harmonics; give every harmonic one positive weight")
    ascending = np.argsort(h)
    h, w = h[ascending], w[ascending]
    u = _synthesise(h, w * np.exp(1j * phases(h, w, m, rng)), m)
    return np.resize(a * (u / np.max(np.abs(u))), count)


def _synthesise(harmonics: Harmonics, coefficients: NDArray[np.complex128], period: int) -> Array:
    """(M,) one period of Re Σₕ Cₕ exp(2πi h k / M)."""
    spectrum = np.zeros(period // 2 + 1, dtype=np.complex128)
    spectrum[harmonics] = coefficients * (period / 2)
    return np.fft.irfft(spectrum, period)


def _harmonics(values: ArrayLike, period: int) -> Harmonics:
    array = np.asarray(values)
    if array.ndim != 1 or not array.size or array.dtype.kind not in "iu":
        raise DataError("harmonics are a list of one or more whole numbers")
    if len(np.unique(array)) < len(array):
        raise DataError("a harmonic is given twice; name each once")
    if array.min() < 1 or 2 * int(array.max()) >= period:
        raise DataError(
            f"harmonics {array.min()} … {array.max()} of a period of {period} samples; "
            f"give some from 1 to {(period - 1) // 2}, below the Nyquist frequency"
        )
    return array.astype(np.int64)
