r"""Linear filters as blocks of a cascade.

``A(q)y(t) = B(q)x(t − nk)``, with A = 1 + a₁q⁻¹ + … and B = b₀ + b₁q⁻¹ + …; without A it is an FIR filter. The state
is that of the transposed direct form, so that with zero signals before t = 0

    A(q)y(t) = B(q)x(t − nk) + Σⱼ sⱼ δ(t − j),

and differentiation gives the sensitivity filters (Ljung 1999, sec. 10.3)

    ∂y/∂bₖ = q⁻ᵏ⁻ⁿᵏ A⁻¹(q) x,      ∂y/∂aₖ = −q⁻ᵏ A⁻¹(q) y,      ∂y/∂sⱼ = q⁻ʲ A⁻¹(q) δ:

so three filter runs give all derivatives, and the rest are shifts. A fit spends most of its time in filtering every row
δx from a zero state; `filter_rows` filters four rows at a time.

References:
    Ljung, *System Identification: Theory for the User*, 2nd ed. (1999).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.filtering import filter_rows, is_stable
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.terms import check_whole, sum_of_terms, vector

Array = NDArray[np.float64]

# A pole closer to the unit circle than this, or outside it, counts as unstable.
STABILITY_MARGIN = 1e-7
# The gain is the largest at this many frequencies, up to half the sampling rate, where a filter blocks DC.
GAIN_POINTS = 512


@dataclass(frozen=True, eq=False)
class Rational:
    """A linear filter A(q)y(t) = B(q)x(t − nk), A = 1 + a₁q⁻¹ + …; an FIR filter without a.

    >>> Rational([0.2, 0.1], [-0.7]).equation("u", "x")
    'x(t) = (0.2 + 0.1*q^-1)/(1 - 0.7*q^-1) u(t)'

    Args:
        numerator: (nb,) b₀, b₁, …
        denominator: (na,) a₁, a₂, …, without the leading one.
        delay: nk in samples.

    Raises:
        ModelError: for an empty numerator, values that are not finite, or a delay that is not a whole number from 0.
    """

    numerator: Array
    denominator: Array = ()  # type: ignore[assignment]  # made an array below
    delay: int = 0

    kind: ClassVar[str] = "filter"

    def __post_init__(self) -> None:
        for field in ("numerator", "denominator"):
            object.__setattr__(self, field, vector(getattr(self, field), f"filter {field}"))
        if not len(self.numerator):
            raise ModelError("a filter needs at least one numerator coefficient")
        check_whole("filter delay", self.delay, 0, "a filter cannot look ahead")

    @property
    def names(self) -> tuple[str, ...]:
        """b0, b1, …, a1, a2, …"""
        return (
            *(f"b{k}" for k in range(len(self.numerator))),
            *(f"a{k + 1}" for k in range(len(self.denominator))),
        )

    @property
    def parameters(self) -> Array:
        """(nb + na,) b₀, b₁, …, a₁, a₂, …"""
        return np.concatenate([self.numerator, self.denominator])

    @property
    def anchors(self) -> tuple[int, ...]:
        """The largest numerator coefficient, which fixes the gain."""
        return (int(np.argmax(np.abs(self.numerator))),)

    @cached_property
    def states(self) -> int:
        """Order of the filter, including its delay."""
        return max(len(self.numerator) + self.delay - 1, len(self.denominator))

    @cached_property
    def transfer(self) -> tuple[Array, Array]:
        """Numerator with its delay, and denominator with its leading one, of equal length in q⁻¹."""
        b, a = np.zeros((2, self.states + 1))
        b[self.delay : self.delay + len(self.numerator)] = self.numerator
        a[0], a[1 : 1 + len(self.denominator)] = 1.0, self.denominator
        return b, a

    def meaning(self, name: str) -> str:
        """What a parameter multiplies, for tables."""
        j, numerator = self.names.index(name), len(self.numerator)
        if j >= numerator:
            return f"× −output(t-{j - numerator + 1})"
        lag = j + self.delay
        return f"× input(t-{lag})" if lag else "× input(t)"

    @property
    def poles(self) -> NDArray[np.complex128]:
        """(na,) roots of A."""
        return np.roots(np.concatenate([[1.0], self.denominator])).astype(complex)

    @property
    def zeros(self) -> NDArray[np.complex128]:
        """(≤ nb − 1,) roots of B."""
        return np.roots(self.numerator).astype(complex)

    def response(self, frequency: ArrayLike, dt: float) -> NDArray[np.complex128]:
        """The frequency response at frequencies in Hz."""
        delay = np.exp(-2j * np.pi * np.asarray(frequency, dtype=float) * dt)
        b, a = self.transfer
        above, below = np.polynomial.polynomial.polyval(delay, b), np.polynomial.polynomial.polyval(delay, a)
        return np.asarray(above / below, dtype=complex)

    @property
    def gain(self) -> float:
        """Its gain at DC, or at its peak if it blocks DC."""
        b, a = (np.fft.rfft(each, 2 * GAIN_POINTS) for each in self.transfer)
        response = b / a
        peak = int(np.argmax(np.abs(response)))
        return float(response[0].real if abs(response[0]) > 1e-3 * abs(response[peak]) else abs(response[peak]))

    def amplified(self, factor: float) -> Rational:
        """The filter with its gain multiplied by a factor."""
        return Rational(self.numerator * factor, self.denominator, self.delay)

    def with_parameters(self, theta: Array) -> Rational:
        """The filter with other coefficients."""
        split = len(self.numerator)
        return Rational(theta[:split], theta[split:], self.delay)

    def check(self) -> None:
        """Refuse an unstable filter.

        Raises:
            Infeasible: with the unstable pole.
        """
        if not is_stable(self.denominator.tolist(), 1 - STABILITY_MARGIN):
            largest = np.max(np.abs(self.poles))
            raise Infeasible(f"unstable filter: a pole of size {largest:.6g}; poles must lie inside the unit circle")

    def output(self, x: Array, state: Array) -> Array:
        """(N,) the filtered signal."""
        return self.run(x, state)[0]

    def run(self, x: Array, state: Array) -> tuple[Array, Array]:
        """(N,) the filtered signal, and the state (s,) after it."""
        rows, after = np.array([x], dtype=float), np.array([state], dtype=float)
        filter_rows(*self.transfer, rows, rows, after)
        return rows[0], after[0]

    def push(self, x: Array, rows: Array) -> None:
        """Filter every row (k, N) from a zero state, in place."""
        filter_rows(*self.transfer, rows, rows, np.zeros((len(rows), self.states)))

    def gradient(self, x: Array, y: Array) -> Array:
        """(nb + na, N) shifted copies of x and y filtered by 1/A."""
        nb, na = len(self.numerator), len(self.denominator)
        rows = np.zeros((nb + na, len(x)))
        sources = self._all_pole(np.stack([x, y]))
        for k in range(nb):
            _shift_into(rows[k], sources[0], k + self.delay)
        for k in range(na):
            _shift_into(rows[nb + k], -sources[1], k + 1)
        return rows

    def state_gradient(self, samples: int) -> Array:
        """(s, N) shifted copies of the impulse response of 1/A."""
        impulse = np.zeros((1, samples))
        impulse[0, 0] = 1.0
        response = self._all_pole(impulse)[0]
        rows = np.zeros((self.states, samples))
        for j in range(self.states):
            _shift_into(rows[j], response, j)
        return rows

    def visited(self, x: Array, y: Array, times: NDArray[np.intp]) -> Array:
        """(s, m) sⱼ(t) = Σ over k > j of bₖx(t + j − k) − aₖy(t + j − k), signals constant before t = 0."""
        b, a = self.transfer
        before = np.maximum(times - np.arange(1, self.states + 1)[:, None], 0)
        inputs, outputs = x[before], y[before]
        flows = np.zeros((self.states, len(times)))
        for j in range(self.states):
            for k in range(j + 1, self.states + 1):
                flows[j] += b[k] * inputs[k - j - 1] - a[k] * outputs[k - j - 1]
        return flows

    def resting(self, level: float) -> tuple[Array, float]:
        """The steady state and output for a constant input."""
        b, a = self.transfer
        output = level * b.sum() / a.sum()
        # sⱼ = Σ over k > j of (bₖ·level − aₖ·output), the transposed direct form in steady state.
        flow = b[1:] * level - a[1:] * output
        state: Array = np.cumsum(flow[::-1])[::-1].copy()
        return state, float(output)

    def equation(self, x: str, y: str, rate: int = 1) -> str:
        """``y(t) = (b0 + b1*q^-1)/(1 + a1*q^-1) x(t)``.

        Args:
            x, y: names of the signals.
            rate: steps of the filter per sample; q⁻¹ is one sample.
        """
        above = _in_delays(self.numerator, self.delay, rate)
        below = _in_delays(np.concatenate([[1.0], self.denominator]), 0, rate)
        if self.states == 0:
            return f"{y}(t) = {above}*{x}(t)"
        tail = f"/({below})" if len(self.denominator) else ""
        return f"{y}(t) = ({above}){tail} {x}(t)"

    def to_data(self) -> dict[str, Any]:
        """Coefficients and delay."""
        return {
            "kind": self.kind,
            "numerator": self.numerator.tolist(),
            "denominator": self.denominator.tolist(),
            "delay": self.delay,
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Rational:
        """The filter described by `to_data`."""
        return cls(data["numerator"], data["denominator"], int(data["delay"]))

    def _all_pole(self, rows: Array) -> Array:
        out = np.empty_like(rows)
        b, a = np.zeros((2, len(self.denominator) + 1))
        b[0] = a[0] = 1.0
        a[1:] = self.denominator
        filter_rows(b, a, rows, out, np.zeros((len(rows), len(self.denominator))))
        return out


def fir(taps: ArrayLike, delay: int = 0) -> Rational:
    """The FIR filter y(t) = Σₖ gₖ x(t − nk − k) (paper, eq. 3.1).

    Args:
        taps: (nb,) g₀, g₁, …
        delay: nk in samples.
    """
    return Rational(np.asarray(taps, dtype=float), delay=delay)


def _shift_into(row: Array, source: Array, by: int) -> None:
    if by < len(row):
        row[by:] = source[: len(row) - by]


def _in_delays(coefficients: Array, first: int, rate: int) -> str:
    """A polynomial in q⁻¹, whose powers are steps of 1/``rate`` samples."""

    def power(steps: int) -> str:
        late = Fraction(steps, rate)
        return "" if not late else f"q^-{late}" if late.denominator == 1 else f"q^-({late})"

    return sum_of_terms([(c, power(k)) for k, c in enumerate(coefficients, start=first)])
