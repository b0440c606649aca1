"""Maps through points: straight lines and the natural cubic spline.

References:
    de Boor, *A Practical Guide to Splines*, rev. ed. (2001).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.findings import Finding
from emsid.models.blocks.static_maps.static_map import Pieces, StaticMap, closest, inverse_with_straight_ends
from emsid.models.terms import vector

Array = NDArray[np.float64]

# Least number of samples around every knot.
SAMPLES_PER_KNOT = 5
# A map whose slope varies by less than this fraction is a straight line.
STRAIGHT = 0.01
# Knots at bends: points of the integral for each knot, and the part of the mean density that is the same everywhere.
FINE, EVEN = 100, 0.5
# The short form lists up to this many knots.
LISTED_KNOTS = 6


@dataclass(frozen=True, eq=False)
class ThroughPoints(StaticMap):
    """A map through points (knotₖ, valueₖ), linear in the values, which are its parameters.

    So the parameters and their intervals can be read from a plot.

    Args:
        knots: (K,) ascending, in the input's unit, at least `fewest`.
        values: (K,) f at the knots.

    Raises:
        ModelError: for knots that do not ascend, or another number of values.
    """

    knots: Array
    values: Array

    owns_level: ClassVar[bool] = True
    tried: ClassVar[bool] = True
    word: ClassVar[str]
    fewest: ClassVar[int] = 2
    of_knots: ClassVar[tuple[str, ...]] = ()  # cached values that depend on the knots alone

    def __post_init__(self) -> None:
        for field in ("knots", "values"):
            object.__setattr__(self, field, vector(getattr(self, field), f"{self.kind} {field}"))
        if len(self.knots) != len(self.values) or len(self.knots) < self.fewest:
            counts = f"{len(self.knots)} knots and {len(self.values)} values"
            raise ModelError(f"{self.kind}: {counts}; give as many, at least {self.fewest}")
        if np.any(np.diff(self.knots) <= 0):
            raise ModelError(f"{self.kind}: the knots must ascend")

    @property
    def names(self) -> tuple[str, ...]:
        """f1, f2, …, values at the knots."""
        return tuple(f"f{k + 1}" for k in range(len(self.knots)))

    @property
    def parameters(self) -> Array:
        """(K,) values."""
        return self.values

    @property
    def anchors(self) -> tuple[int, ...]:
        """The smallest and the largest value."""
        return tuple(sorted((int(np.argmin(self.values)), int(np.argmax(self.values)))))

    @property
    def steepness(self) -> float:
        """The mean slope between the outer knots."""
        return float((self.values[-1] - self.values[0]) / (self.knots[-1] - self.knots[0]))

    def with_parameters(self, theta: Array) -> Self:
        """The map with other values; what depends on the knots alone is kept."""
        new = replace(self, values=theta)
        for kept in self.of_knots:
            new.__dict__[kept] = getattr(self, kept)
        return new

    def scaled(self, input: float, output: float) -> Self:
        """Knots times ``input``, values times ``output``."""
        turned = slice(None) if input > 0 else slice(None, None, -1)
        return replace(self, knots=(self.knots * input)[turned], values=(self.values * output)[turned])

    def expression(self, x: str) -> str:
        """The points."""
        pairs = ", ".join(f"({k:.6g}, {v:.6g})" for k, v in zip(self.knots, self.values, strict=True))
        return f"{self.word}({x}; {pairs})"

    def summary(self, x: str) -> str:
        """The points, or their number."""
        if len(self.knots) <= LISTED_KNOTS:
            return self.expression(x)
        return (
            f"{self.word}({x}; {len(self.knots)} knots from {self.knots[0]:.4g} to {self.knots[-1]:.4g}, see the table)"
        )

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> Self:
        """A map with ``size`` knots, placed by `spread_knots`."""
        return closest(cls(spread_knots(x, size), np.zeros(size)), x, z)

    @property
    def size(self) -> int:
        """The number of knots."""
        return len(self.knots)

    def with_more_knots(self) -> Self:
        """The same curve with another knot in the middle between each two."""
        knots = with_middles(self.knots)
        return replace(self, knots=knots, values=self.value(knots))

    def findings(self, x: Array) -> tuple[Finding, ...]:
        """Findings: knots without data around them, and a map that is straight over the data."""
        empty = np.flatnonzero(samples_around(self.knots, x) < SAMPLES_PER_KNOT)
        if len(empty):
            return (Finding("knots-without-data", data={"knots": self.knots[empty].tolist()}),)
        slopes = self.slope(np.asarray(np.quantile(x, np.linspace(0.01, 0.99, 99)), dtype=float))
        straight = np.ptp(slopes) < STRAIGHT * np.max(np.abs(slopes))
        return (Finding("map-is-straight"),) if straight else ()

    def meaning(self, name: str) -> str:
        """The knot of this value."""
        return f"value at {self.knots[self.names.index(name)]:.4g}"

    def marks(self) -> tuple[Array, str]:
        """The knots."""
        return self.knots, "knots"

    def to_data(self) -> dict[str, Any]:
        """Knots and values."""
        return {"kind": self.kind, "knots": self.knots.tolist(), "values": self.values.tolist()}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The map described by `to_data`."""
        return cls(data["knots"], data["values"])


class PiecewiseLinear(ThroughPoints):
    """Straight lines between points, extended beyond the outer ones.

    Args:
        knots: (p,) ascending, in the unit of the input.
        values: (p,) f at the knots.
    """

    kind: ClassVar[str] = "piecewise-linear"
    sizes: ClassVar[tuple[int, ...]] = (6, 10, 16, 25)
    word: ClassVar[str] = "linear"

    def value(self, x: Array) -> Array:
        """Interpolated."""
        piece, part = self._locate(x)
        return self.values[piece] * (1 - part) + self.values[piece + 1] * part

    def slope(self, x: Array) -> Array:
        """Slope of the piece."""
        piece, _ = self._locate(x)
        return (np.diff(self.values) / np.diff(self.knots))[piece]

    def pieces(self) -> Pieces:
        """A line between each two knots, the outer ones without an end."""
        slopes = np.diff(self.values) / np.diff(self.knots)
        return Pieces.lines(self.knots, [slopes[0], *slopes, slopes[-1]], self.values[0])

    def parameter_gradient(self, x: Array) -> Array:
        """The hat functions."""
        piece, part = self._locate(x)
        rows = np.zeros((len(self.knots), len(x)))
        where = np.arange(len(x))
        rows[piece, where] = 1 - part
        rows[piece + 1, where] = part
        return rows

    def inverse(self, z: ArrayLike) -> Array:
        """The map through the swapped points, if it is monotone."""
        steps = np.diff(self.values)
        if not (np.all(steps > 0) or np.all(steps < 0)):
            raise ModelError("a piecewise linear map has an inverse only where it is monotone")
        turned = slice(None) if steps[0] > 0 else slice(None, None, -1)
        return PiecewiseLinear(self.values[turned], self.knots[turned]).value(np.asarray(z, dtype=float))

    def _locate(self, x: Array) -> tuple[NDArray[np.intp], Array]:
        piece = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.knots) - 2)
        return piece, (x - self.knots[piece]) / np.diff(self.knots)[piece]


class CubicSpline(ThroughPoints):
    """The natural cubic spline through (knotₖ, valueₖ), which continues as a straight line at either end.

    f is cubic between knots, with two continuous derivatives; the second derivative is zero at both ends, where the
    lines begin. The second derivatives at the knots are linear in the values, M = T·values, T from
    a tridiagonal system (de Boor, ch. IV).
    """

    kind: ClassVar[str] = "spline"
    sizes: ClassVar[tuple[int, ...]] = (20, 40)
    smooth: ClassVar[bool] = True
    word: ClassVar[str] = "spline"
    of_knots: ClassVar[tuple[str, ...]] = ("curvatures",)

    def roughness(self) -> Array:
        """(K − 2, K) R: the second derivative is linear between knots, so the integral of its square is exact."""
        h = np.diff(self.knots)
        product = np.diag((h[1:] + h[:-1]) / 3) + np.diag(h[1:-1] / 6, 1) + np.diag(h[1:-1] / 6, -1)
        return np.asarray(np.linalg.cholesky(product).T @ self.curvatures[1:-1]) if len(h) > 1 else np.zeros((0, 2))

    @cached_property
    def curvatures(self) -> Array:
        """(K, K) T: second derivatives at the knots from the values."""
        h = np.diff(self.knots)
        size = len(self.knots)
        left, right = np.zeros((size, size)), np.zeros((size, size))
        left[0, 0] = left[-1, -1] = 1.0
        for k in range(1, size - 1):
            left[k, k - 1 : k + 2] = h[k - 1] / 6, (h[k - 1] + h[k]) / 3, h[k] / 6
            right[k, k - 1 : k + 2] = 1 / h[k - 1], -1 / h[k - 1] - 1 / h[k], 1 / h[k]
        return np.asarray(np.linalg.solve(left, right), dtype=float)

    def value(self, x: Array) -> Array:
        """f(x)."""
        return self._evaluate(x)[0]

    def slope(self, x: Array) -> Array:
        """f′(x)."""
        return self._evaluate(x)[1]

    def pieces(self) -> Pieces:
        """A cubic between each two knots, and a line at either end."""
        second, h = self.curvatures @ self.values, np.diff(self.knots)
        slopes = np.diff(self.values) / h - h * (2 * second[:-1] + second[1:]) / 6
        cubic = np.column_stack([self.values[:-1], slopes, second[:-1] / 2, np.diff(second) / h / 6])
        last = slopes[-1] + h[-1] * (second[-2] + second[-1]) / 2
        lines = np.array([[self.values[0], slopes[0], 0.0, 0.0], [self.values[-1], last, 0.0, 0.0]])
        edges = np.concatenate([[-np.inf], self.knots])
        return Pieces(edges, np.append(self.knots[0], self.knots), np.vstack([lines[:1], cubic, lines[1:]]))

    def parameter_gradient(self, x: Array) -> Array:
        """(K, N) the cardinal splines, one at their own knot and zero at the others."""
        rows = np.empty((len(self.knots), x.size))
        spline_rows(read_only(self.knots), read_only(self.curvatures), read_only(x), rows)
        return rows

    def inverse(self, z: ArrayLike) -> Array:
        """x with f(x) = z, if the spline is monotone."""
        slopes = self.slope(self.knots[[0, -1]])
        if not np.all(slopes * slopes[0] > 0):
            raise ModelError("a spline has an inverse only where it is monotone")
        return inverse_with_straight_ends(self, self.knots, z)

    def at_bends(self, x: Array) -> CubicSpline:
        """About the same curve through as many knots, which are closer together where it bends; the ends stay.

        Between two knots is the same part of ∫(|f″(x)|^½ + c)dx, as for the best broken line (de Boor, ch. XII); the
        constant c, a part `EVEN` of the mean, leaves knots where a curve that is still too smooth does not bend. Knots
        around which there are hardly any data x (m,) are left out.
        """
        fine = np.linspace(self.knots[0], self.knots[-1], FINE * len(self.knots))
        density = np.sqrt(np.abs(np.interp(fine, self.knots, self.curvatures @ self.values)))
        density += EVEN * float(np.mean(density)) or 1.0
        part = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
        knots = with_data(np.interp(np.linspace(0.0, part[-1], len(self.knots)), part, fine), x)
        return CubicSpline(knots, self.value(knots))

    def _evaluate(self, x: Array) -> tuple[Array, Array]:
        at = np.asarray(x, dtype=float)
        out = np.empty((2, at.size))
        knots, values, second = (read_only(each) for each in (self.knots, self.values, self.curvatures @ self.values))
        spline_values(knots, values, second, read_only(at.ravel()), out)
        return out[0].reshape(at.shape), out[1].reshape(at.shape)


def spread_knots(x: Array, count: int) -> Array:
    """(count,) knots, the mean of even spacing and quantiles of x, so that the tails have knots too.

    Raises:
        ModelError: if x has too few different values, or values that are not finite.
    """
    part = np.linspace(0, 1, count)
    low, high = float(np.min(x)), float(np.max(x))
    if not np.isfinite([low, high]).all():
        raise ModelError("the input of the static map is not finite; the filter before it diverges")
    # The even spacing keeps knots apart where values repeat (a PRBS).
    knots = 0.5 * (low + (high - low) * part) + 0.5 * np.quantile(x, part)
    if not np.all(np.diff(knots) > 1e-9 * max(abs(low), abs(high), 1e-300)):
        raise ModelError("the input of the static map hardly changes; it cannot be identified from this record")
    return knots


def with_middles(knots: Array) -> Array:
    """(2K − 1,) the knots (K,), and the middles between them."""
    return np.insert(knots, np.arange(1, len(knots)), 0.5 * (knots[1:] + knots[:-1]))


def samples_around(knots: Array, x: Array) -> NDArray[np.intp]:
    """(K,) how many of the data x (m,) are closest to each of the knots (K,)."""
    return np.bincount(np.searchsorted(0.5 * (knots[1:] + knots[:-1]), x), minlength=len(knots))


def with_data(knots: Array, x: Array) -> Array:
    """The knots, of which some between the ends are left out until each has `SAMPLES_PER_KNOT` of the data x (m,)."""
    while len(knots) > 2:
        counts = samples_around(knots, x)
        least = int(np.argmin(counts))
        if counts[least] >= SAMPLES_PER_KNOT:
            break
        knots = np.delete(knots, min(max(least, 1), len(knots) - 2))
    return knots


@njit(nogil=True)
def spline_values(knots: Array, values: Array, second: Array, x: Array, out: Array) -> None:
    """f and f′ of the natural cubic spline into the two rows of ``out``; see `CubicSpline`."""
    last = len(knots) - 1
    for t in range(len(x)):
        k = min(max(np.searchsorted(knots, x[t], side="right") - 1, 0), last - 1)
        h = knots[k + 1] - knots[k]
        chord = (values[k + 1] - values[k]) / h
        if x[t] < knots[0]:
            slope = chord - h * (2 * second[k] + second[k + 1]) / 6
            out[0, t] = values[0] + slope * (x[t] - knots[0])
            out[1, t] = slope
        elif x[t] > knots[last]:
            slope = chord + h * (second[k] + 2 * second[k + 1]) / 6
            out[0, t] = values[last] + slope * (x[t] - knots[last])
            out[1, t] = slope
        else:
            p, r = (x[t] - knots[k]) / h, (knots[k + 1] - x[t]) / h
            out[0, t] = (
                r * values[k]
                + p * values[k + 1]
                + h * h / 6 * ((r * r * r - r) * second[k] + (p * p * p - p) * second[k + 1])
            )
            out[1, t] = chord + h / 6 * ((3 * p * p - 1) * second[k + 1] - (3 * r * r - 1) * second[k])


@njit(nogil=True)
def spline_rows(knots: Array, curvatures: Array, x: Array, rows: Array) -> None:
    """The cardinal splines at x (N,) into ``rows`` (K, N): f depends on its values through f = Σ valuesⱼ rowsⱼ."""
    last = len(knots) - 1
    size = len(knots)
    tile = np.empty((64, size))
    for first in range(0, len(x), 64):
        height = min(64, len(x) - first)
        for i in range(height):
            v = x[first + i]
            k = min(max(np.searchsorted(knots, v, side="right") - 1, 0), last - 1)
            h = knots[k + 1] - knots[k]
            if v < knots[0]:
                d = v - knots[0]
                r, p = 1 - d / h, d / h
                cr, cp = -d * h / 3, -d * h / 6
            elif v > knots[last]:
                d = v - knots[last]
                r, p = -d / h, 1 + d / h
                cr, cp = d * h / 6, d * h / 3
            else:
                p, r = (v - knots[k]) / h, (knots[k + 1] - v) / h
                cr, cp = h * h / 6 * (r * r * r - r), h * h / 6 * (p * p * p - p)
            line = tile[i]
            for j in range(size):
                line[j] = cr * curvatures[k, j] + cp * curvatures[k + 1, j]
            line[k] += r
            line[k + 1] += p
        for j in range(size):
            for i in range(height):
                rows[j, first + i] = tile[i, j]
