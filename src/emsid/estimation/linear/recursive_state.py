"""The state of a recursion: an argument and a result, so that it can be kept, saved and continued."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.linear.recursive_kernels import FILLED, IDLE, LIMITED, PEAKS, PLACE, SAMPLES, SQUARES, WEIGHTS
from emsid.record import Record

Array = NDArray[np.float64]

MOST_COUNTED = 2**53
"""Counts are floats in the kernels, which are exact up to this number."""


def _no_rows() -> Array:
    return np.empty((0, 0))


@dataclass(frozen=True, eq=False)
class RecursiveState:
    """The state of the recursion.

    Attributes:
        estimate: (n,) θ.
        factor: (n, n) Uᵀ, unit lower triangular.
        diagonal: (n,) of D; P = U D Uᵀ.
        samples: effective number of samples, Σ w, with weights w = λᵏ.
        residual_sum_of_squares: Σ w·ε² of the residuals of the present estimate.
        squared_weights: Σ w².
        peak: (n,) the largest absolute value of every regressor so far.
        limited: the number of samples after which D was at its limit, so that not all directions were forgotten.
        idle: the number of samples since one that changed the estimate; some rules leave out what has no excitation.
        window: (m, n + 1) past rows [φ y] of a sliding window, in a ring; without rows for other rules.
        place, filled: where the next row goes in the ring, and how many rows it has.
        tail: the last samples, as many as the largest lag of the structure.
    """

    estimate: Array
    factor: Array
    diagonal: Array
    samples: float = 0.0
    residual_sum_of_squares: float = 0.0
    squared_weights: float = 0.0
    peak: Array = field(default_factory=lambda: np.zeros(0))
    limited: int = 0
    idle: int = 0
    window: Array = field(default_factory=_no_rows)
    place: int = 0
    filled: int = 0
    tail: Record | None = None

    @property
    def normalised_covariance(self) -> Array:
        """(n, n) P, the covariance of the estimate for noise of variance one and samples of equal weight."""
        p: Array = self.factor.T @ (self.diagonal[:, None] * self.factor)
        return p

    @property
    def noise_variance(self) -> float:
        """The noise variance, from the weighted sum of squared residuals."""
        freedom = self.samples - len(self.estimate)
        return self.residual_sum_of_squares / freedom if freedom > 0 else float("nan")

    @property
    def covariance(self) -> Array:
        """(n, n) covariance of the estimate: σ²·P·Σw²/Σw.

        With weights w, the covariance is σ²·P(Σw²φφᵀ)P; regressors of a constant spectrum make it the expression above.
        It is σ²·P without forgetting, and about half of that with it.
        """
        share = self.squared_weights / self.samples if self.samples > 0 else 1.0
        spread: Array = self.noise_variance * share * self.normalised_covariance
        return spread

    @property
    def totals(self) -> Array:
        """The sums and counts, in the form that the kernels use."""
        sums = (self.samples, self.residual_sum_of_squares, self.squared_weights)
        return np.array([*sums, self.idle, self.place, self.filled, self.limited, *self.peak], dtype=float)

    def after(self, estimate: Array, factor: Array, diagonal: Array, totals: Array, window: Array) -> RecursiveState:
        """The same with what the kernels have made of it."""
        idle, place, filled, limited = (int(totals[k]) for k in (IDLE, PLACE, FILLED, LIMITED))
        samples, squares, weights = (float(totals[k]) for k in (SAMPLES, SQUARES, WEIGHTS))
        peak = np.array(totals[PEAKS:])
        return RecursiveState(
            estimate, factor, diagonal, samples, squares, weights, peak, limited, idle, window, place, filled, self.tail
        )

    def cut(self) -> RecursiveState:
        """The state with its estimate but without past samples: the next samples come after a gap."""
        return replace(self, tail=None)

    def to_data(self) -> dict[str, Any]:
        """Everything that `from_data` needs to restore the state bit for bit, in built-in types."""
        arrays = {name: getattr(self, name).tolist() for name in (*_ARRAYS, "window")}
        numbers = {name: getattr(self, name) for name in _NUMBERS}
        tail = None
        if self.tail is not None:
            tail = {name: getattr(self.tail, name).tolist() for name in ("input", "output")}
            tail |= {name: list(getattr(self.tail, name)) for name in _NAMES}
            tail |= {"dt": self.tail.dt, "time": self.tail.times[0], "name": self.tail.name}
        return {**arrays, **numbers, "tail": tail}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> RecursiveState:
        """The state described by `to_data`.

        Raises:
            ModelError: for data that do not describe a state.
        """
        try:
            estimate, factor, diagonal, peak = (np.array(data[name], dtype=float) for name in _ARRAYS)
            window = np.array(data["window"], dtype=float)
            tail: Any = data["tail"]
            past = None
            if tail is not None:
                u, y = np.array(tail["input"], dtype=float), np.array(tail["output"], dtype=float)
                past = Record(u, y, tail["dt"], times=(tail["time"],), name=tail["name"])
                names: dict[str, Any] = {name: tuple(tail[name]) for name in _NAMES}
                past = replace(past, **names)
            numbers: dict[str, Any] = {name: _number(data[name], kind) for name, kind in _NUMBERS.items()}
        except (KeyError, TypeError, ValueError, OverflowError, EmsidError) as problem:
            raise ModelError(f"not a state of a recursion ({problem}); save it again") from None
        window = window if window.size else _no_rows()
        state = cls(estimate, factor, diagonal, peak=peak, window=window, tail=past, **numbers)
        reason = state._impossible()
        if reason:
            raise ModelError(f"not a state of a recursion: {reason}; save it again")
        return state

    def _impossible(self) -> str:
        """Why no recursion can have this state; empty where one can."""
        n = len(self.estimate) if self.estimate.ndim == 1 else 0
        if not n or self.factor.shape != (n, n) or self.diagonal.shape != (n,) or self.peak.shape != (n,):
            return "its arrays do not fit together"
        rows = len(self.window) if self.window.ndim else 0
        if self.window.ndim != 2 or (rows and self.window.shape != (rows, n + 1)):
            return f"its window has no rows of {n + 1} numbers"
        arrays = (self.estimate, self.factor, self.diagonal, self.peak, self.window)
        sums = (self.samples, self.residual_sum_of_squares, self.squared_weights)
        if not (all(np.isfinite(array).all() for array in arrays) and np.isfinite(sums).all()):
            return "it has numbers that are not finite"
        if np.any(self.diagonal <= 0) or np.any(self.peak < 0):
            return "a variance or a peak is negative"
        if np.any(np.triu(self.factor) != np.eye(n)):
            return "its factor is not unit lower triangular"
        counts = (self.limited, self.idle, self.place, self.filled)
        if min(*sums, *counts) < 0 or max(counts) > MOST_COUNTED or self.squared_weights > self.samples + 1:
            return "a sum or a count is out of its range"
        if self.filled > rows or self.place >= max(rows, 1):
            return "it counts more rows than its window has"
        return ""


def _number(value: object, kind: type) -> Any:
    """A number of a state: a whole number for a count, never a truth value or a text.

    Raises:
        TypeError: for another value.
    """
    if isinstance(value, bool) or not isinstance(value, (int, kind)):
        raise TypeError(f"{value!r:.40} is no number")
    return kind(value)


_ARRAYS = ("estimate", "factor", "diagonal", "peak")
_NAMES = ("input_names", "output_names", "input_units", "output_units")
_NUMBERS: dict[str, type] = {
    "samples": float,
    "residual_sum_of_squares": float,
    "squared_weights": float,
    "limited": int,
    "idle": int,
    "place": int,
    "filled": int,
}
