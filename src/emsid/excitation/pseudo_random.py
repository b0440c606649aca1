r"""Binary and multilevel noise from a shift register.

The bits s(t+n) = ⊕ₑ s(t+e), e the lower exponents of a primitive polynomial of degree n over GF(2), pass through all
2ⁿ − 1 states but zero [Golomb]. Squaring over GF(2) only doubles exponents, p(x)² = p(x²), so that the recursion also
holds with every lag times 2, 4, 8, … A few array operations, each on a block as long as the bits known so far,
therefore replace the bit-by-bit loop.

References:
    Golomb, S. W. (1967). Shift Register Sequences.
    Stahnke, W. (1973). Primitive binary polynomials. Mathematics of Computation 27, 977–980.
    Godfrey, K. (1993). Perturbation Signals for System Identification.
    Nelles, O. (2001). Nonlinear System Identification.
    Ljung, L. (1999). System Identification: Theory for the User, 2nd ed., chapter 13.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.excitation.checks import positive, whole

Array = NDArray[np.float64]

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
    """(length,) bits of the maximal-length register, see the docstring of the module."""
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
