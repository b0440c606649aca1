"""The polynomial, in a well-conditioned basis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.findings import Finding
from emsid.models.blocks.static_maps.static_map import Pieces, StaticMap, closest, monotone_inverse
from emsid.models.terms import sum_of_terms, vector

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Polynomial(StaticMap):
    """f(x) = Σₖ cₖ Pₖ(t), Legendre polynomials of t = (2x − low − high)/(high − low).

    The paper's Σ λₚxᵖ (3.2) in a basis that is well conditioned at any degree; `powers` gives the λₚ.

    >>> Polynomial.from_powers([0.0, 1.0, 0.5], -2.0, 2.0).expression("x")
    '1*x + 0.5*x^2'

    Args:
        coefficients: (d + 1,) c₀, c₁, …
        low, high: interval on which the basis is orthogonal, the range of the data.
    """

    coefficients: Array
    low: float = -1.0
    high: float = 1.0

    kind: ClassVar[str] = "polynomial"
    owns_level: ClassVar[bool] = True
    sizes: ClassVar[tuple[int, ...]] = (2, 3, 5, 7)
    tried: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", vector(self.coefficients, "polynomial coefficients"))
        if len(self.coefficients) < 2 or not (np.isfinite([self.low, self.high]).all() and self.low < self.high):
            raise ModelError(
                f"polynomial with {len(self.coefficients)} coefficients on [{self.low}, {self.high}]; give at least "
                "two on an interval that is finite and not empty"
            )

    @classmethod
    def from_powers(cls, powers: ArrayLike, low: float, high: float) -> Polynomial:
        """The polynomial Σₚ λₚ xᵖ, given λ₀, λ₁, …"""
        shifted = np.polynomial.Polynomial(vector(powers, "powers"))(
            np.polynomial.Polynomial([(low + high) / 2, (high - low) / 2])
        )
        coefficients = np.polynomial.legendre.poly2leg(shifted.coef)
        return cls(np.pad(coefficients, (0, np.size(powers) - len(coefficients))), low, high)

    @property
    def powers(self) -> Array:
        """(d + 1,) λ₀, λ₁, … of Σ λₚxᵖ."""
        centred = np.polynomial.Polynomial(np.polynomial.legendre.leg2poly(self.coefficients))
        width = self.high - self.low
        plain = centred(np.polynomial.Polynomial([-(self.low + self.high) / width, 2 / width])).coef
        return np.pad(plain, (0, len(self.coefficients) - len(plain)))

    @property
    def names(self) -> tuple[str, ...]:
        """c0, c1, …"""
        return tuple(f"c{k}" for k in range(len(self.coefficients)))

    @property
    def parameters(self) -> Array:
        """(d + 1,) c₀, c₁, …"""
        return self.coefficients

    @property
    def anchors(self) -> tuple[int, ...]:
        """The constant and the largest other coefficient."""
        return 0, 1 + int(np.argmax(np.abs(self.coefficients[1:])))

    @property
    def steepness(self) -> float:
        """λ₁, the slope at zero."""
        return float(self.slope(np.zeros(1))[0])

    def with_parameters(self, theta: Array) -> Polynomial:
        """The polynomial with other coefficients."""
        return replace(self, coefficients=theta)

    def value(self, x: Array) -> Array:
        """Σ cₖPₖ(t)."""
        return np.asarray(np.polynomial.legendre.legval(self._centred(x), self.coefficients), dtype=float)

    def slope(self, x: Array) -> Array:
        """Σ cₖPₖ′(t) · 2/(high − low)."""
        derived = np.polynomial.legendre.legder(self.coefficients) * (2 / (self.high - self.low))
        return np.asarray(np.polynomial.legendre.legval(self._centred(x), derived), dtype=float)

    def parameter_gradient(self, x: Array) -> Array:
        """Pₖ(t)."""
        rows = np.polynomial.legendre.legvander(self._centred(x), len(self.coefficients) - 1).T
        return np.ascontiguousarray(rows)

    def pieces(self) -> Pieces:
        """One piece."""
        powers = np.polynomial.legendre.leg2poly(self.coefficients)
        powers = np.pad(powers, (0, len(self.coefficients) - len(powers)))
        scale = (2 / (self.high - self.low)) ** np.arange(len(powers))
        return Pieces(np.array([-np.inf]), np.array([(self.low + self.high) / 2]), (powers * scale)[None, :])

    def inverse(self, z: ArrayLike) -> Array:
        """x between low and high, if the polynomial is monotone there."""
        return monotone_inverse(self, self.low, self.high, z)

    def scaled(self, input: float, output: float) -> Polynomial:
        """Coefficients times ``output`` on the scaled interval; a mirrored one changes the sign of odd coefficients."""
        ends = sorted((self.low * input, self.high * input))
        signs = np.where(np.arange(len(self.coefficients)) % 2, np.sign(input), 1.0)
        return Polynomial(self.coefficients * signs * output, *ends)

    def on_range(self, low: float, high: float) -> Polynomial:
        """The same polynomial in the basis that is orthogonal on this range."""
        if not low < high:
            return self
        at = np.polynomial.chebyshev.chebpts1(len(self.coefficients))
        values = self.value(low + (at + 1) / 2 * (high - low))
        basis = np.polynomial.legendre.legvander(at, len(at) - 1)
        return Polynomial(np.asarray(np.linalg.solve(basis, values), dtype=float), low, high)

    def expression(self, x: str) -> str:
        """In powers of x."""
        return sum_of_terms(
            [(value, "" if k == 0 else x if k == 1 else f"{x}^{k}") for k, value in enumerate(self.powers)]
        )

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> Polynomial:
        """A polynomial of degree ``size`` on the range of x."""
        return closest(cls(np.zeros(size + 1), float(x.min()), float(x.max())), x, z)

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """That it is a straight line, of degree one."""
        return (Finding("map-is-straight"),) if self.size == 1 else ()

    @property
    def size(self) -> int:
        """Its degree."""
        return len(self.coefficients) - 1

    def meaning(self, name: str) -> str:
        """The Legendre polynomial that it multiplies."""
        return f"× Legendre polynomial {self.names.index(name)}, of {self.low:.4g} … {self.high:.4g}"

    def to_data(self) -> dict[str, Any]:
        """Coefficients and interval."""
        return {
            "kind": self.kind,
            "coefficients": self.coefficients.tolist(),
            "low": self.low,
            "high": self.high,
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Polynomial:
        """The polynomial described by `to_data`."""
        return cls(data["coefficients"], float(data["low"]), float(data["high"]))

    def _centred(self, x: Array) -> Array:
        return (2 * x - self.low - self.high) / (self.high - self.low)
