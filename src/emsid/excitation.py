"""Test signals, one pure function each; crest factor and order of persistent excitation of any signal.

A signal is an array (N,) of samples, in whatever unit its amplitude has (volts for a drive), held by the
generator from one sample to the next. Nothing here keeps state: what is random takes a
`numpy.random.Generator`, and equal arguments give equal samples.

**How much a signal can tell.** A linear model with n input coefficients can be told from every other only if
no FIR filter of length n silences the input: u is *persistently exciting of order n* when the rows [u(t), …, u(t−n+1)]
span n dimensions [Ljung, def. 13.2]. A constant has order 1, a sine 2, a sum of m sines 2m, a maximal-length sequence
of period M order M. `persistent_excitation_order` reads the order off the singular values of these rows.

**How much power fits under a limit.** The crest factor C = max|u| / rms(u) is 1 for a binary signal, √2 for a sine, and
3 or more for sines with random phases. Two things bring it down without touching the amplitude spectrum:

- *Schroeder's phases.* A signal whose frequency sweeps has a flat envelope. At a phase φ(ω) the group delay
  is −dφ/dω; a sweep that stays in each band in proportion to its power p, Σp = 1, needs
  φₙ = φₙ₋₁ − 2π·(p₁ + … + pₙ₋₁) [Schroeder].
- *Swapping between time and frequency.* Clip the signal, transform it, keep only the phases of its harmonics, put the
  wanted amplitudes back, and repeat [Van der Ouderaa]. Clipping low at first and higher later gets past poor optima.

**Binary noise from a shift register.** The bits s(t+n) = ⊕ₑ s(t+e), e the lower exponents of a primitive
polynomial of degree n over GF(2), pass through all 2ⁿ − 1 states but zero [Golomb]. Squaring over GF(2) only
doubles exponents, p(x)² = p(x²), so that the recursion also holds with every lag times 2, 4, 8, …; a few
array operations, each on a block as long as what is known already, thus replace the bit-by-bit loop.

References:
    Schroeder, M. R. (1970). Synthesis of low-peak-factor signals and binary sequences with low
        autocorrelation. IEEE Transactions on Information Theory 16, 85–89.
    Van der Ouderaa, E., Schoukens, J., Renneboog, J. (1988). Peak factor minimization using a time-frequency
        domain swapping algorithm. IEEE Transactions on Instrumentation and Measurement 37, 145–147.
    Pintelon, R., Schoukens, J. (2012). System Identification: A Frequency Domain Approach, 2nd ed.
    Golomb, S. W. (1967). Shift Register Sequences.
    Stahnke, W. (1973). Primitive binary polynomials. Mathematics of Computation 27, 977–980.
    Godfrey, K. (1993). Perturbation Signals for System Identification.
    Nelles, O. (2001). Nonlinear System Identification.
    Ljung, L. (1999). System Identification: Theory for the User, 2nd ed., chapter 13.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.record import Record, segments

Array = NDArray[np.float64]
Harmonics = NDArray[np.int64]

PhaseDesign = Callable[[Harmonics, Array, int, np.random.Generator], Array]
"""(harmonics (H,), their amplitudes (H,), period in samples, rng) → their phases (H,) in rad."""

Sweep = Callable[[Array, float, float], Array]
"""(elapsed fraction x of the sweep, first and last frequency in Hz) → ∫₀ˣ f(ξ) dξ in Hz."""

Signal = Callable[[int, float, float, np.random.Generator], Array]
"""(samples, dt in s, amplitude, rng) → (samples,) with |u| ≤ amplitude; what `SIGNALS` holds."""


# --- sums of sines ------------------------------------------------------------------------------------------


def sines(
    samples: int, dt: float, amplitudes: ArrayLike, frequencies: ArrayLike, phases: ArrayLike | None = None
) -> Array:
    """The sum of sines u(t) = Σᵢ aᵢ sin(2π fᵢ t + φᵢ), as two signal generators added up give it.

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
    time = _positive(dt, "sample time") * np.arange(_whole(samples, "number of samples"))
    a, f = _vector(amplitudes, "amplitudes"), _vector(frequencies, "frequencies")
    phi = np.zeros_like(f) if phases is None else _vector(phases, "phases")
    if not len(a) == len(f) == len(phi):
        raise DataError(f"{len(a)} amplitudes, {len(f)} frequencies and {len(phi)} phases; give one of each a sine")
    for frequency in f:
        _check_frequency(float(frequency), dt)
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
    duration = _whole(period, "period") * _positive(dt, "sample time")
    _check_frequency(lowest, dt)
    _check_frequency(highest, dt)
    slack = 1e-9  # a band edge meant to be a harmonic counts as one in spite of rounding
    first = max(1, int(np.ceil(lowest * duration - slack)))
    chosen = np.arange(first, int(np.floor(highest * duration + slack)) + 1, dtype=np.int64)
    if not len(chosen):
        raise DataError(
            f"no harmonic of {1 / duration:g} Hz lies in {lowest:g} … {highest:g} Hz; "
            "lengthen the period or widen the band"
        )
    return chosen


def odd_harmonics(period: int, dt: float, lowest: float, highest: float) -> Harmonics:
    """The odd ones of `full_harmonics`.

    >>> odd_harmonics(1000, 1e-3, 2.0, 7.0)
    array([3, 5, 7])
    """
    chosen = full_harmonics(period, dt, lowest, highest)
    odd: Harmonics = chosen[chosen % 2 == 1]
    if not len(odd):
        raise DataError(
            f"harmonic {chosen[0]} alone lies in {lowest:g} … {highest:g} Hz, and it is even; widen the band"
        )
    return odd


def random_phases(harmonics: Harmonics, weights: Array, period: int, rng: np.random.Generator) -> Array:
    """(H,) independent phases, uniform over the circle: nearly Gaussian samples, crest factor 3 and more.

    What averaging a nonlinear distortion over realisations asks for [Pintelon & Schoukens, chapter 3].
    """
    return rng.uniform(-np.pi, np.pi, len(harmonics))


def schroeder_phases(harmonics: Harmonics, weights: Array, period: int, rng: np.random.Generator) -> Array:
    """(H,) phases φₙ = φₙ₋₁ − 2π·((hₙ − hₙ₋₁)/g)·Σ_{l<n} pₗ, pₗ = wₗ²/Σw²: a sweep, crest factor about 1.7.

    g is the greatest common divisor of the spacings: the envelope repeats g times a period, so the sweep
    takes 1/g of it. φ₁ is drawn at random. Source: Schroeder (1970), here for harmonics of any spacing.
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

    Starts from Schroeder's phases, each moved at random by up to π/4, so that every seed gives a signal of
    its own, and clips at 1.0·rms first and 1.5·rms last. The best phases met on the way are returned. The
    work is done on a grid of 16 to 32 samples a cycle of the highest harmonic where the period has more.

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

    Over whole periods it has no power off the chosen harmonics, so that whatever a measured output has there
    is noise or a nonlinearity: with odd harmonics only, an even nonlinearity shows on the even ones.

    Args:
        samples: N, the number of samples; the period is repeated, and cut, to fill them.
        harmonics: (H,) whole numbers h 1 ≤ h < M/2, such as `full_harmonics` and `odd_harmonics` give.
        rng: source of the phases.
        amplitude: largest absolute value within a period, in the unit of the signal.
        period: M in samples; all N where None.
        weights: (H,) relative amplitudes wₕ > 0; all equal where None.
        phases: how φₕ are chosen: `low_crest_phases`, `schroeder_phases`, `random_phases` or your own.

    Raises:
        DataError: for harmonics that are none, repeated, or outside 1 … M/2; for bad sizes or weights.

    Source: Pintelon & Schoukens, chapter 5.
    """
    count = _whole(samples, "number of samples")
    m = count if period is None else _whole(period, "period")
    a = _positive(amplitude, "amplitude")
    h = _harmonics(harmonics, m)
    w = np.ones(len(h)) if weights is None else _vector(weights, "weights")
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


# --- binary and multilevel noise ----------------------------------------------------------------------------

PRIMITIVE_POLYNOMIALS: dict[int, tuple[int, ...]] = {
    2: (1,), 3: (1,), 4: (1,), 5: (2,), 6: (1,), 7: (1,), 8: (6, 5, 1), 9: (4,), 10: (3,), 11: (2,),
    12: (7, 4, 3), 13: (4, 3, 1), 14: (12, 11, 1), 15: (1,), 16: (5, 3, 2), 17: (3,), 18: (7,), 19: (6, 5, 1),
    20: (3,), 21: (2,), 22: (1,), 23: (5,), 24: (4, 3, 1), 25: (3,), 26: (8, 7, 1), 27: (8, 7, 1), 28: (3,),
    29: (2,), 30: (16, 15, 1), 31: (3,), 32: (28, 27, 1),
}  # fmt: skip
"""For each degree n the exponents between n and 0 of a primitive polynomial over GF(2) [Stahnke]."""


def prbs(samples: int, order: int, amplitude: float = 1.0, *, hold: int = 1, start: int | None = None) -> Array:
    """Pseudo-random binary sequence: ±a by a maximal-length shift register, period (2ⁿ − 1)·hold samples.

    Over a period of M = 2ⁿ − 1 clock ticks the mean is a/M and the circular autocorrelation a² at lag 0, −a²/M at every
    other. Held for h samples, its power falls to one half at 0.44/(h·dt) Hz and to nothing at 1/(h·dt).

    Args:
        samples: N, the number of samples; the period is repeated, and cut, to fill them.
        order: n, the length of the register, 2 … 32.
        amplitude: a, the level, in the unit of the signal.
        hold: clock period in samples.
        start: first n bits as a whole number, 1 … 2ⁿ − 1, least significant first; all ones where None.
            Another start is another shift of the same sequence.

    Raises:
        DataError: for an order, start or size out of range.

    Source: Golomb (1967); Godfrey (1993); Ljung, section 13.3.

    >>> prbs(8, order=3, amplitude=5.0)
    array([ 5.,  5.,  5., -5., -5.,  5., -5.,  5.])
    """
    count, clock = _whole(samples, "number of samples"), _whole(hold, "hold")
    a = _positive(amplitude, "amplitude")
    bits = _shift_register(order, -(-count // clock), start)
    return np.repeat(np.where(bits, a, -a), clock)[:count]


def amplitude_modulated_prbs(
    samples: int,
    order: int,
    rng: np.random.Generator,
    amplitude: float = 1.0,
    *,
    hold: int = 1,
    start: int | None = None,
) -> Array:
    """APRBS: the switching times of `prbs`, but a level of its own for each stretch between two switches.

    With m stretches in the N samples the levels are the m equally spaced values from −amplitude to amplitude, each used
    once, in random order. So the signal covers the range of a nonlinearity and not only its two ends. It has no period.

    Args:
        samples, order, amplitude, hold, start: as for `prbs`; choose ``hold`` near the dominant time constant.
        rng: source of the order of the levels.

    Raises:
        DataError: as `prbs`.

    Source: Nelles (2001), section 17.7.
    """
    binary = prbs(samples, order, amplitude, hold=hold, start=start)
    stretch = np.cumsum(np.diff(binary, prepend=binary[:1]) != 0)
    levels = np.linspace(-amplitude, amplitude, int(stretch[-1]) + 1)
    modulated: Array = rng.permutation(levels)[stretch]
    return modulated


def _shift_register(order: int, length: int, start: int | None) -> NDArray[np.uint8]:
    """(length,) bits of the maximal-length register, see the module's docstring."""
    if order not in PRIMITIVE_POLYNOMIALS:
        raise DataError(f"no shift register of order {order}; give 2 … {max(PRIMITIVE_POLYNOMIALS)}")
    exponents = PRIMITIVE_POLYNOMIALS[order]
    last = 2**order - 1
    state = last if start is None else _whole(start, "start of the shift register")
    if state > last:
        raise DataError(f"start {state} of a shift register of order {order}; give 1 … {last}")
    bits = np.zeros(max(length, order), dtype=np.uint8)
    bits[:order] = [state >> k & 1 for k in range(order)]
    known = order
    while known < length:
        stride = 1 << ((known // order).bit_length() - 1)  # the largest power of two the known bits allow
        origin = known - stride * order
        block = min(stride * (order - exponents[0]), length - known)
        fresh = bits[origin : origin + block].copy()
        for e in exponents:
            fresh ^= bits[origin + stride * e : origin + stride * e + block]
        bits[known : known + block] = fresh
        known += block
    return bits[:length]


# --- sweeps, steps and ramps --------------------------------------------------------------------------------


def linear_sweep(x: Array, first: float, last: float) -> Array:
    """∫₀ˣ f with f(ξ) = f₀ + (f₁ − f₀) ξ: equal time for every hertz."""
    return first * x + (last - first) * x**2 / 2


def logarithmic_sweep(x: Array, first: float, last: float) -> Array:
    """∫₀ˣ f with f(ξ) = f₀ (f₁/f₀)^ξ: equal time for every octave.

    Raises:
        DataError: for a frequency that is not positive.
    """
    if min(first, last) <= 0:
        raise DataError(f"a logarithmic sweep from {first:g} to {last:g} Hz; give positive frequencies")
    rate = np.log(last / first)
    return first * x if rate == 0 else first * np.expm1(rate * x) / rate


def chirp(
    samples: int, dt: float, first: float, last: float, amplitude: float = 1.0, sweep: Sweep = linear_sweep
) -> Array:
    """The swept sine u(t) = a sin(2π T ∫₀^{t/T} f(ξ) dξ), T = N·dt, starting at 0. Crest factor about √2.

    Args:
        samples: N, the number of samples.
        dt: sample time in seconds.
        first, last: frequencies f₀ and f₁ at both ends in Hz, below Nyquist; either may be the higher.
        amplitude: a, in the unit of the signal.
        sweep: how the frequency gets from one to the other: `linear_sweep`, `logarithmic_sweep` or your own.

    Raises:
        DataError: for a frequency that is negative or not below Nyquist, or a bad size.

    Source: Pintelon & Schoukens, chapter 5; Ljung, section 13.3.
    """
    count, step = _whole(samples, "number of samples"), _positive(dt, "sample time")
    a = _positive(amplitude, "amplitude")
    _check_frequency(first, dt)
    _check_frequency(last, dt)
    return a * np.sin(2 * np.pi * count * step * sweep(np.arange(count) / count, first, last))


def staircase(samples: int, steps: int, amplitude: float = 1.0) -> Array:
    """Levels 0, a/n, …, a, …, 0, −a/n, …, −a, …, 0: up, down, negative, back, each held equally long.

    Every level but ±a is met on the way up and on the way down, for both directions of motion: the steady
    speeds draw the static curve, with its dead zone, its Coulomb steps and its hysteresis.

    Args:
        samples: N, at least one for each of the 4n + 1 levels, which differ in length by at most one sample.
        steps: n, the number of steps from 0 to a.
        amplitude: a, in the unit of the signal.

    Raises:
        DataError: for fewer samples than levels, or a bad size.

    >>> staircase(9, 2, 6.0)
    array([ 0.,  3.,  6.,  3.,  0., -3., -6., -3.,  0.])
    """
    count, n = _whole(samples, "number of samples"), _whole(steps, "number of steps")
    a = _positive(amplitude, "amplitude")
    if count < 4 * n + 1:
        raise DataError(f"{count} samples for a staircase of {4 * n + 1} levels; give more samples or fewer steps")
    level = np.arange(count) * (4 * n + 1) // count
    return a * (_triangle(level, n) / n)


def _triangle(k: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """0 … n … 0 … −n … 0 for k = 0 … 4n."""
    return np.where(k <= 2 * n, n - np.abs(k - n), np.abs(k - 3 * n) - n)


def ramp(samples: int, corners: ArrayLike) -> Array:
    """Straight lines through the corner values at one slope |du/dt|, from the first value to the last.

    ``ramp(n, (0, 12, -12, 0))`` goes slowly up, down through zero and back: where the motor breaks away, and
    where it stops again, is read off it for both directions.

    Args:
        samples: N, at least 2.
        corners: (m ≥ 2,) values to pass, in the unit of the signal; a corner that falls between two
            samples is cut off by less than a sample's rise.

    Raises:
        DataError: for fewer than two corners, or two equal ones in a row.

    >>> ramp(5, (0.0, 2.0, 0.0))
    array([0., 1., 2., 1., 0.])
    """
    count = _whole(samples, "number of samples")
    values = _vector(corners, "corners")
    travel = np.abs(np.diff(values))
    if count < 2 or len(values) < 2 or np.any(travel == 0):
        raise DataError(
            f"a ramp of {count} samples through {values.tolist()}; give 2 or more of both, no two equal in a row"
        )
    passed = np.concatenate([[0.0], np.cumsum(travel)])
    return np.interp(np.linspace(0.0, passed[-1], count), passed, values)


# --- limits -------------------------------------------------------------------------------------------------


def limit(signal: ArrayLike, dt: float, amplitude: float | None = None, slew: float | None = None) -> Array:
    """The signal as a generator of limited amplitude and slew rate puts it out.

    v = clip(u, ±a), then the follower y(k) = y(k−1) + clip(v(k) − y(k−1), ±slew·dt), y(0) = v(0). In floating
    point, too, |y(k)| ≤ a and |y(k) − y(k−1)| ≤ slew·dt hold to the last bit, and a signal that keeps the
    limits comes back unchanged.

    Args:
        signal: (N,) samples.
        dt: sample time in seconds.
        amplitude: a > 0, largest absolute value; no limit where None.
        slew: largest rate of change per second, > 0; no limit where None. The first sample is free.

    Raises:
        DataError: for a signal of another shape or not finite, or a limit that is not positive.

    >>> limit([0.0, 9.0, 9.0, 9.0], dt=0.5, amplitude=5.0, slew=4.0)
    array([0., 2., 4., 5.])
    """
    u = _vector(signal, "signal")
    step = _positive(dt, "sample time")
    if amplitude is not None:
        a = _positive(amplitude, "amplitude limit")
        u = np.clip(u, -a, a)
    if slew is None or not len(u):
        return u.copy()
    return np.fromiter(_follow(u, _positive(slew, "slew limit") * step), dtype=np.float64, count=len(u))


def _follow(targets: Array, step: float) -> Iterator[float]:
    """Each target, or the furthest value towards it whose computed distance from the last is within step."""
    value = float(targets[0])
    for target in targets.tolist():
        before, value = value, target
        if abs(target - before) > step:
            value = before + step if target > before else before - step
            while abs(value - before) > step:
                value = float(np.nextafter(value, before))
        yield value


# --- what a signal is worth ---------------------------------------------------------------------------------


def crest_factor(signal: Record | ArrayLike) -> float:
    """C = max|u| / rms(u): 1 for a binary signal, √2 for a sine.

    Args:
        signal: (N,) samples, (N, nu) channels, or a record, whose inputs count. Of several channels, the worst.

    Raises:
        DataError: for a signal without channels or samples, or one that is zero throughout.

    >>> round(crest_factor([3.0, -3.0, 3.0]), 12)
    1.0
    """
    u = _as_record(signal).input
    peak = np.max(np.abs(u), axis=0, initial=0.0)
    if not (peak.size and np.all(peak > 0)):
        raise DataError("no input, or one that is zero throughout, has no crest factor; look at that channel")
    return float(np.max(1.0 / np.sqrt(np.mean((u / peak) ** 2, axis=0))))


_PARTS, _TRANSIENTS = 8, 2  # of a record, and how many may differ without saying anything of the rest


def persistent_excitation_order(signal: Record | ArrayLike, max_order: int = 50, tolerance: float = 1e-10) -> int:
    """Largest n up to ``max_order`` for which the rows [u(t), u(t−1), …, u(t−n+1)] have full column rank n·nu.

    The rows are brought to one triangular R by orthogonal transformations; what counts as rank are singular values
    σ > tolerance·σ_max. Working on the rows and not on their covariance keeps all digits; where the tolerance does not
    ask for them, the covariance does, in a fraction of the time. Three things are done so that a finite record shows
    the order that theory gives to what goes on for ever:

    - *What happens once is no persistent excitation.* A step is a constant, whose order is 1, but for one moment. So of
      eight equal parts of the record, within each of which and within its segments the rows stay, the two of highest
      rank are left out.
    - *A sum of sines has no more dimensions in longer rows.* Of one channel the rank is taken in rows as long as the
      record can show, which tells slow sines apart much better than rows of just n samples.
    - *Neither has it in every 2nd, 4th, … sample,* where slow sines look faster. So these are tried as well, of one
      channel: of several it would take apart what one does a sample after the other.

    What has come back as `largest_order` may be of a higher order still. A mean adds one.

    Args:
        signal: (N,) samples, (N, nu) channels, or a record, whose inputs count. Each channel is scaled to peak 1.
        max_order: where to stop looking; what is exciting of every order comes back as this.
        tolerance: smallest singular value, as a fraction of the largest, that counts; 1e-10 suits a computed
            signal, the noise-to-signal ratio a measured one, since noise excites everything: 1e-3 is above the rounding
            of a converter of 12 bits.

    Raises:
        DataError: for a signal without channels or samples, or a bad order or tolerance.

    Source: Ljung, section 13.2.

    >>> t = np.arange(200)
    >>> persistent_excitation_order(np.sin(0.3 * t) + 0.1 * np.cos(t))
    4
    >>> persistent_excitation_order(t > 50)
    1
    """
    record = _as_record(signal)
    if not 0 < tolerance < 1:
        raise DataError(f"a tolerance of {tolerance}; give a number between 0 and 1")
    peak = np.max(np.abs(record.input), axis=0, initial=0.0)
    if not peak.size:
        raise DataError(f"{record.name}: no input channel; name the one that excites the system")
    largest = _whole(max_order, "largest order")
    if not np.all(peak > 0):
        return 0
    parts = _parts([segment.input / peak for segment in segments(record)])
    n = _shown(parts, largest)
    if not n:
        return 0
    factors = [_factor(part, n, tolerance) for part in parts]
    steady = sorted(range(_PARTS), key=lambda k: _rank(factors[k], tolerance))[:-_TRANSIENTS]
    factor = _triangularised(np.concatenate([factors[k] for k in steady]))
    if len(peak) > 1:
        full = (k for k in range(n, 0, -1) if _rank(factor[:, : k * len(peak)], tolerance) == k * len(peak))
        return next(full, 0)
    order = _rank(factor, tolerance)
    parts = [parts[k] for k in steady]
    while max(order, 1) < n:
        parts = [[piece[::2] for piece in part] for part in parts]
        n = _shown(parts, n)
        if n > order:
            order = max(order, _rank(_factor([piece for part in parts for piece in part], n, tolerance), tolerance))
    return order


def largest_order(signal: Record | ArrayLike, max_order: int = 50) -> int:
    """The highest order of persistent excitation up to ``max_order`` that so many samples can show.

    That for which every eighth of the record holds n rows, about N/16 for up to three channels.

    Args:
        signal: (N,) samples, (N, nu) channels, or a record, whose inputs count.
        max_order: where to stop looking.
    """
    pieces = [segment.input for segment in segments(_as_record(signal))]
    return _shown(_parts(pieces), _whole(max_order, "largest order"))


def _parts(pieces: Sequence[Array]) -> list[list[Array]]:
    """Pieces without a gap (N, nu), cut into equal parts of the whole."""
    ends = np.cumsum([len(piece) for piece in pieces])
    cuts = [k * int(ends[-1]) // _PARTS for k in range(_PARTS + 1)]
    return [
        [
            piece[max(begin - (end - len(piece)), 0) : stop - (end - len(piece))]
            for piece, end in zip(pieces, ends.tolist(), strict=True)
            if end - len(piece) < stop and begin < end
        ]
        for begin, stop in pairwise(cuts)
    ]


def _shown(parts: Sequence[Sequence[Array]], largest: int) -> int:
    """The largest n for which every part has n rows of n samples; more of more than three channels."""
    width = max((piece.shape[1] for part in parts for piece in part), default=0)

    def suffices(n: int) -> bool:
        return all(sum(max(0, len(piece) - n + 1) for piece in part) >= n * max(1.0, width / 3) for part in parts)

    order, beyond = 0, largest + 1  # where n rows of n samples fit, so do fewer of fewer
    while beyond - order > 1:
        middle = (order + beyond) // 2
        order, beyond = (middle, beyond) if suffices(middle) else (order, middle)
    return order


def _rank(factor: Array, tolerance: float) -> int:
    sigma = np.linalg.svd(factor, compute_uv=False)
    return int(np.count_nonzero(sigma > tolerance * sigma[0])) if sigma.size else 0


_COARSE = 1e-6  # a tolerance whose square is far above the rounding of a covariance


def _factor(pieces: Sequence[Array], n: int, tolerance: float) -> Array:
    """A matrix F with the FᵀF, and so the singular values, of the rows of n samples each of all pieces (N, nu)."""
    if tolerance < _COARSE:
        return _triangular_factor(pieces, n)
    power, directions = np.linalg.eigh(sum(_covariance(piece, n) for piece in pieces if len(piece) >= n))
    return np.asarray(np.sqrt(np.maximum(power, 0.0))[:, None] * directions.T)


def _covariance(piece: Array, n: int) -> Array:
    """The sum of rowᵀ·row over the rows of n samples each of a piece (N, nu).

    Its blocks are C(i, j) = Σₜ u(t+i)ᵀ u(t+j) over all rows t, so that C(i+1, j+1) is C(i, j) with its first term
    exchanged for one after the last.
    """
    rows, width = len(piece) - n + 1, piece.shape[1]
    c = np.empty((n, width, n, width))
    for j in range(n):
        c[0, :, j] = piece[:rows].T @ piece[j : j + rows]
    for i in range(1, n):
        gone, come = np.outer(piece[i - 1], piece[: n - 1]), np.outer(piece[i - 1 + rows], piece[rows : rows + n - 1])
        c[i, :, 1:] = c[i - 1, :, :-1] + (come - gone).reshape(width, n - 1, width)
        c[i, :, 0] = c[0, :, i].T
    return c.reshape(n * width, n * width)


def _triangular_factor(pieces: Sequence[Array], n: int, block: int = 4096) -> Array:
    """R of the rows of n samples each of all pieces (N, nu), taken a block of rows at a time."""
    width = n * pieces[0].shape[1]
    r: Array = np.zeros((0, width))
    for piece in pieces:
        if len(piece) < n:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(piece, n, axis=0).transpose(0, 2, 1)
        for begin in range(0, len(windows), block):
            rows = windows[begin : begin + block].reshape(-1, width)
            r = _triangularised(np.concatenate([r, rows]))
    return r


def _triangularised(rows: Array) -> Array:
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


# --- every signal by name, with nothing to choose but its size ----------------------------------------------
#
# The defaults cover one band: from one cycle a record to a twentieth of the sampling frequency, where a drive
# sampled fast enough still moves.

_TOP = 1 / 20
_LONGEST_PERIOD = 10_000  # samples of a multisine; longer records repeat it, which shows the noise apart


def _band(samples: int, dt: float) -> tuple[float, float]:
    lowest = 1 / (_whole(samples, "number of samples") * _positive(dt, "sample time"))
    return lowest, max(lowest, _TOP / dt)


def _sines(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """five sines, the slowest the largest, random phases"""
    lowest, highest = _band(samples, dt)
    frequencies = lowest * (highest / lowest) ** (np.arange(1, 6) / 5)
    weights = np.arange(5, 0, -1) / 15
    return sines(samples, dt, _positive(amplitude, "amplitude") * weights, frequencies, rng.uniform(-np.pi, np.pi, 5))


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
    count = _whole(samples, "number of samples")
    hold = max(1, min(round(0.44 / _TOP), count // 3))  # 0.44/(hold·dt): the half-power frequency
    order = min(max(2, (count // hold + 1).bit_length() - 1), max(PRIMITIVE_POLYNOMIALS))
    return prbs(count, order, amplitude, hold=hold, start=int(rng.integers(1, 2**order)))


def _aprbs(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """steps between some sixty random levels"""
    hold = max(1, _whole(samples, "number of samples") // 127)
    return amplitude_modulated_prbs(samples, 7, rng, amplitude, hold=hold, start=int(rng.integers(1, 128)))


def _chirp(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """sine swept linearly in frequency"""
    return chirp(samples, dt, *_band(samples, dt), amplitude)


def _log_chirp(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """sine swept an octave at a time"""
    return chirp(samples, dt, *_band(samples, dt), amplitude, logarithmic_sweep)


def _staircase(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """five steps up, down, negative and back"""
    return staircase(samples, max(1, min(5, (_whole(samples, "number of samples") - 1) // 4)), amplitude)


def _ramp(samples: int, dt: float, amplitude: float, rng: np.random.Generator) -> Array:
    """slow ramp up, down through zero and back"""
    a = _positive(amplitude, "amplitude")
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


# --- at the door --------------------------------------------------------------------------------------------


MOST_SAMPLES = 10**8
"""Of a signal: more than a day at a kilohertz, and less than would fill the memory of a laptop."""


def _whole(value: SupportsIndex, what: str) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        number = 0
    if not 1 <= number <= MOST_SAMPLES:
        hint = ", by another duration or sample time" if what == "number of samples" else ""
        raise DataError(f"{what} {value}; give a whole number from 1 to {MOST_SAMPLES:,}{hint}")
    return number


def _positive(value: float, what: str) -> float:
    if not (np.isfinite(value) and value > 0):
        raise DataError(f"{what} {value}; give a positive number")
    return float(value)


def _vector(values: ArrayLike, what: str) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not np.isfinite(array).all():
        raise DataError(f"{what} of shape {array.shape}; give a one-dimensional list of finite numbers")
    return array


def _check_frequency(frequency: float, dt: float) -> None:
    nyquist = 0.5 / dt
    if not 0 <= frequency < nyquist:
        raise DataError(f"frequency {frequency:g} Hz; give one from 0 to below the Nyquist frequency of {nyquist:g} Hz")


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


def _as_record(signal: Record | ArrayLike) -> Record:
    if isinstance(signal, Record):
        return signal
    u = np.asarray(signal, dtype=np.float64)
    return Record(u, np.empty((len(u) if u.ndim else 0, 0)), dt=1.0, name="signal")
