"""Test signals as functions, and by name in `SIGNALS`, with defaults for everything but their size.

`prbs` and `amplitude_modulated_prbs` switch between two or many levels at times from a shift register. `chirp` is a
swept sine; `staircase` and `ramp` change slowly and show static curves and break-away. `limit` gives a signal as a
generator of limited amplitude and slew rate puts it out.

The defaults of `SIGNALS` excite one band: from one cycle in the record to a twentieth of the sampling frequency, where
a drive that is sampled fast enough still responds.

References:
    Godfrey, *Perturbation Signals for System Identification* (1993). Golomb, *Shift Register Sequences* (1967). Ljung,
    *System Identification*, 2nd ed. (1999), ch. 13. Nelles, *Nonlinear System Identification* (2001). Pintelon,
    Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed. (2012). Stahnke, *Primitive binary
    polynomials*, Mathematics of Computation 27 (1973).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.excitation.checks import as_record, check_frequency, positive, vector, whole
from emsid.excitation.sines import full_harmonics, multisine, odd_harmonics, sines
from emsid.record import Record

Array = NDArray[np.float64]


def limit(signal: ArrayLike, dt: float, amplitude: float | None = None, slew: float | None = None) -> Array:
    """The signal as a generator of limited amplitude and slew rate puts it out.

    v = clip(u, ±a), then the follower y(k) = y(k−1) + clip(v(k) − y(k−1), ±slew·dt), y(0) = v(0). In floating
    point |y(k)| ≤ a and |y(k) − y(k−1)| ≤ slew·dt hold exactly, and a signal within the limits is returned
    unchanged.

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
    u = vector(signal, "signal")
    step = positive(dt, "sample time")
    if amplitude is not None:
        a = positive(amplitude, "amplitude limit")
        u = np.clip(u, -a, a)
    if slew is None or not len(u):
        return u.copy()
    return np.fromiter(_follow(u, positive(slew, "slew limit") * step), dtype=np.float64, count=len(u))


def _follow(targets: Array, step: float) -> Iterator[float]:
    """Each target, or the value nearest to it whose computed distance from the previous value is within ``step``."""
    value = float(targets[0])
    for target in targets.tolist():
        before, value = value, target
        if abs(target - before) > step:
            value = before + step if target > before else before - step
            while abs(value - before) > step:
                value = float(np.nextafter(value, before))
        yield value


def crest_factor(signal: Record | ArrayLike) -> float:
    """C = max|u| / rms(u): 1 for a binary signal, √2 for a sine.

    Args:
        signal: (N,) samples, (N, nu) channels, or a record, whose inputs are used. With several channels, the largest
            factor is returned.

    Raises:
        DataError: for a signal without channels or samples, or a channel that is always zero.

    >>> round(crest_factor([3.0, -3.0, 3.0]), 12)
    1.0
    """
    u = as_record(signal).input
    peak = np.max(np.abs(u), axis=0, initial=0.0)
    if not (peak.size and np.all(peak > 0)):
        raise DataError("a missing input, or one that is zero throughout, has no crest factor; check that channel")
    return float(np.max(1.0 / np.sqrt(np.mean((u / peak) ** 2, axis=0))))


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
    other. Held for h samples, its power falls to one half at 0.44/(h·dt) Hz and to zero at 1/(h·dt).

    Args:
        samples: N, the number of samples; the period is repeated, and the last one cut.
        order: n, the length of the register, 2 … 32.
        amplitude: a, the level, in the unit of the signal.
        hold: clock period in samples.
        start: first n bits as a whole number, 1 … 2ⁿ − 1, least significant first; all ones where None.
            Another start gives a shifted version of the same sequence.

    Raises:
        DataError: for an order, start or size out of range.

    Source: Golomb (1967); Godfrey (1993); Ljung, section 13.3.

    >>> prbs(8, order=3, amplitude=5.0)
    array([ 5.,  5.,  5., -5., -5.,  5., -5.,  5.])
    """
    count, clock = whole(samples, "number of samples"), whole(hold, "hold")
    a = positive(amplitude, "amplitude")
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
    """APRBS: the switching times of `prbs`, with another level between any two of them.

    The m levels are equally spaced from −amplitude to amplitude, and each is used once, in random order. So the signal
    covers the whole range of a nonlinearity, not only its two ends. It has no period.

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
    """(length,) bits of the maximal-length register.

    The bits s(t+n) = ⊕ₑ s(t+e), e the lower exponents of a primitive polynomial of degree n over GF(2), pass through
    all 2ⁿ − 1 states but zero [Golomb]. Squaring over GF(2) only doubles exponents, p(x)² = p(x²), so that the
    recursion also holds with every lag times 2, 4, 8, … A few array operations, each on a block as long as the bits
    known so far, therefore replace the bit-by-bit loop.
    """
    if order not in PRIMITIVE_POLYNOMIALS:
        raise DataError(f"no shift register of order {order}; give 2 … {max(PRIMITIVE_POLYNOMIALS)}")
    exponents = PRIMITIVE_POLYNOMIALS[order]
    last = 2**order - 1
    state = last if start is None else whole(start, "start of the shift register")
    if state > last:
        raise DataError(f"start {state} of a shift register of order {order}; give 1 … {last}")
    bits = np.zeros(max(length, order), dtype=np.uint8)
    bits[:order] = [state >> k & 1 for k in range(order)]
    known = order
    while known < length:
        stride = 1 << ((known // order).bit_length() - 1)  # the largest power of two that the known bits allow
        origin = known - stride * order
        block = min(stride * (order - exponents[0]), length - known)
        fresh = bits[origin : origin + block].copy()
        for e in exponents:
            fresh ^= bits[origin + stride * e : origin + stride * e + block]
        bits[known : known + block] = fresh
        known += block
    return bits[:length]


Sweep = Callable[[Array, float, float], Array]
"""(elapsed fraction x of the sweep, first and last frequency in Hz) → ∫₀ˣ f(ξ) dξ in Hz."""


def linear_sweep(x: Array, first: float, last: float) -> Array:
    """∫₀ˣ f with f(ξ) = f₀ + (f₁ − f₀) ξ: equal time for every hertz.

    Args:
        x: (N,) the elapsed fraction of the sweep, 0 to 1.
        first, last: frequencies f₀ and f₁ in Hz.
    """
    return first * x + (last - first) * x**2 / 2


def logarithmic_sweep(x: Array, first: float, last: float) -> Array:
    """∫₀ˣ f with f(ξ) = f₀ (f₁/f₀)^ξ: equal time for every octave.

    Args:
        x: (N,) the elapsed fraction of the sweep, 0 to 1.
        first, last: frequencies f₀ and f₁ in Hz.

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
        sweep: the course of the frequency from one to the other: `linear_sweep`, `logarithmic_sweep` or your own.

    Raises:
        DataError: for a frequency that is negative or not below Nyquist, or a bad size.

    Source: Pintelon & Schoukens, chapter 5; Ljung, section 13.3.
    """
    count, step = whole(samples, "number of samples"), positive(dt, "sample time")
    a = positive(amplitude, "amplitude")
    check_frequency(first, dt)
    check_frequency(last, dt)
    return a * np.sin(2 * np.pi * count * step * sweep(np.arange(count) / count, first, last))


def staircase(samples: int, steps: int, amplitude: float = 1.0) -> Array:
    """Levels 0, a/n, …, a, …, 0, −a/n, …, −a, …, 0: up, down, negative, back, each of equal length.

    Every level but ±a is reached both rising and falling. The steady speeds therefore show the static curve with
    its dead zone, its Coulomb friction and its hysteresis.

    Args:
        samples: N, at least one for each of the 4n + 1 levels; their lengths differ by at most one sample.
        steps: n, the number of steps from 0 to a.
        amplitude: a, in the unit of the signal.

    Raises:
        DataError: for fewer samples than levels, or a bad size.

    >>> staircase(9, 2, 6.0)
    array([ 0.,  3.,  6.,  3.,  0., -3., -6., -3.,  0.])
    """
    count, n = whole(samples, "number of samples"), whole(steps, "number of steps")
    a = positive(amplitude, "amplitude")
    if count < 4 * n + 1:
        raise DataError(f"{count} samples for a staircase of {4 * n + 1} levels; give more samples or fewer steps")
    level = np.arange(count) * (4 * n + 1) // count
    return a * (_triangle(level, n) / n)


def _triangle(k: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """0 … n … 0 … −n … 0 for k = 0 … 4n."""
    return np.where(k <= 2 * n, n - np.abs(k - n), np.abs(k - 3 * n) - n)


def ramp(samples: int, corners: ArrayLike) -> Array:
    """Straight lines through the corner values at one slope |du/dt|, from the first value to the last.

    ``ramp(n, (0, 12, -12, 0))`` rises slowly, falls through zero and returns. The response shows the voltages
    at which the motor breaks away and stops, for both directions.

    Args:
        samples: N, at least 2.
        corners: (m ≥ 2,) values to reach, in the unit of the signal; a corner between two samples
            is missed by less than the change of one sample.

    Raises:
        DataError: for fewer than two corners, or two equal ones in a row.

    >>> ramp(5, (0.0, 2.0, 0.0))
    array([0., 1., 2., 1., 0.])
    """
    count = whole(samples, "number of samples")
    values = vector(corners, "corners")
    travel = np.abs(np.diff(values))
    if count < 2 or len(values) < 2 or np.any(travel == 0):
        raise DataError(
            f"a ramp of {count} samples through {values.tolist()}; give 2 or more of both, no two equal in a row"
        )
    passed = np.concatenate([[0.0], np.cumsum(travel)])
    return np.interp(np.linspace(0.0, passed[-1], count), passed, values)


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
