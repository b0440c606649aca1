"""Recursive least squares: the paper's update as printed, and the factored form that the program uses.

The paper updates (section III.B), with forgetting factor λ and prediction error ε(t) = y(t) − φᵀ(t)θ(t−1)::

    P(t) = (1/λ) P(t−1) [I − φφᵀP(t−1) / (λ + φᵀP(t−1)φ)]        θ(t) = θ(t−1) + P(t)φ(t)ε(t)

In this form rounding makes P lose symmetry and finally positiveness. The factored form applies the same update to
P = U D Uᵀ, with U unit upper triangular and D diagonal (Bierman, *Factorization Methods for Discrete Sequential
Estimation*, 1977, ch. V; with forgetting, Ljung, *System Identification*, 2nd ed., sec. 11.7). D stays positive by
construction, at n²·3/2 multiplications per sample. In a direction without excitation, forgetting would let D grow
without bound. So D_j is limited to `WINDUP` divided by the square of the largest value of regressor j so far, or to
`GROWTH` times its initial value where that is larger. At this limit one such value outweighs all earlier samples, in
any unit of the channels. The samples at which the limit was active are counted and reported, because not all directions
are forgotten there.

If only the last estimate is needed, samples can be processed in tiles: P⁻¹ = RᵀR with ``R = D^(−1/2) U⁻¹`` is a
triangular factor like that of `information`. A tile of samples, each with its weight at the end of the tile, is
reflected into it at a fraction of the cost, and U, D and θ follow from the new factor.

Forgetting is one of several rules of adaptation; see `emsid.estimation.linear.adaptation`. The loop over samples,
`update`, takes any of them.

The state is an argument and a result, so samples one by one, in blocks, or all at once give the same numbers,
and a recursion can be kept, saved and continued.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Generic

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError, EmsidError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.adaptation import Code, Forgetting, Gradient, Rule
from emsid.estimation.linear.least_squares import LinearStructure, M_co, check_excitation
from emsid.estimation.linear.recursive_kernels import (
    FILLED,
    GROWTH,
    HIGHEST,
    IDLE,
    LIMITED,
    PEAKS,
    PLACE,
    SAMPLES,
    SQUARES,
    WEIGHTS,
    WINDUP,
    update,
    update_by_tiles,
)
from emsid.findings import Finding
from emsid.record import Record, check_same_channels, continuing

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


Array = NDArray[np.float64]


@dataclass(frozen=True)
class RecursiveLeastSquares(Generic[M_co]):
    """Recursive least squares for one structure.

    >>> import emsid
    >>> rls = emsid.RecursiveLeastSquares(emsid.arx(na=1, nb=1), forgetting=0.99)
    >>> state = rls.start()
    >>> state = rls.update(state, emsid.Record([1.0, 0.0, 2.0, 1.0], [0.0, 0.5, 0.4, 1.32], dt=0.1))
    >>> state.estimate.round(3)
    array([-0.8,  0.5])

    To freeze the estimate, continue with the same state and ``replace(rls, rule=Frozen())``; to resume, with ``rls``.

    Args:
        structure: whose parameters are tracked.
        forgetting: λ, 0 < λ ≤ 1; a sample k steps back has weight λᵏ.
        initial_covariance: P(0), a number for a multiple of the identity or (n,) for a diagonal; a large one gives the
            initial estimate no weight.
        initial_estimate: θ(0), zero by default.
        rule: another rule of `emsid.estimation` in place of ``forgetting``.
    """

    structure: LinearStructure[M_co]
    forgetting: float = 1.0
    initial_covariance: float | tuple[float, ...] = 1e8
    initial_estimate: tuple[float, ...] = ()
    rule: Rule | None = None

    def __post_init__(self) -> None:
        if self.rule is not None and self.forgetting != 1.0:
            raise ModelError("forgetting and a rule; give the factor to the rule", arguments=("forgetting", "rule"))
        shape, n = np.shape(self.initial_covariance), len(self.structure.parameter_names)
        self.adaptation.numbers(n)
        if shape not in ((), (n,)):
            raise ModelError(f"initial covariance of shape {shape}; give a number or one for each of {n} parameters")
        if not np.all((self.prior > 0) & np.isfinite(self.prior)):
            raise ModelError(f"initial covariance {self.initial_covariance}; it must be positive and finite")

    @property
    def adaptation(self) -> Rule:
        """The rule, also where it is constant forgetting."""
        return Forgetting(self.forgetting) if self.rule is None else self.rule

    @property
    def prior(self) -> Array:
        """(n,) the diagonal of P(0)."""
        return np.broadcast_to(
            np.asarray(self.initial_covariance, dtype=float), len(self.structure.parameter_names)
        ).copy()

    def start(self) -> RecursiveState:
        """The state before the first sample.

        Raises:
            ModelError: if the number of initial values is not the number of parameters.
        """
        n = len(self.structure.parameter_names)
        estimate = np.asarray(self.initial_estimate or np.zeros(n), dtype=float)
        if estimate.shape != (n,):
            raise ModelError(f"{len(estimate)} initial values for the {n} parameters of {self.structure.name}")
        return self.reset(RecursiveState(estimate, np.eye(n), self.prior, peak=np.zeros(n)))

    def reset(self, state: RecursiveState) -> RecursiveState:
        """The state with its estimate and past samples, and without any knowledge: P is P(0) again."""
        n, rows = len(state.estimate), self.adaptation.rows
        window = np.zeros((rows, n + 1 if rows else 0))
        return RecursiveState(state.estimate, np.eye(n), self.prior, peak=state.peak, window=window, tail=state.tail)

    def forget(self, state: RecursiveState, weight: float) -> RecursiveState:
        """The state in which all samples so far have another weight, as after a change of the system.

        Args:
            state: any state.
            weight: 0 < weight < 1, multiplies the weight of every sample. A sliding window is emptied.

        Raises:
            ModelError: for another weight.
        """
        if not 0 < weight < 1:
            raise ModelError(f"weight {weight} of past samples; it lies between 0 and 1")
        if self.adaptation.rows:
            return self.reset(state)
        return replace(
            state,
            diagonal=np.minimum(state.diagonal / weight, self.limits(state)[1]),
            samples=weight * state.samples,
            residual_sum_of_squares=weight * state.residual_sum_of_squares,
            squared_weights=weight**2 * state.squared_weights,
        )

    def update(
        self,
        state: RecursiveState,
        record: Record,
        history: list[Array] | None = None,
        residuals: list[Array] | None = None,
    ) -> RecursiveState:
        """The state after the samples of ``record``, which follow the earlier samples.

        Args:
            state: from `start` or an earlier update.
            record: further samples, one or many; its later segments start without past samples.
            history: a list to which the estimates after every sample, (m, n), are appended.
            residuals: a list to which (m, 3) is appended: the residual of every sample by the estimate before it
                (a priori), by the estimate after it (a posteriori), and ζ = φᵀPφ before it, which makes the variance
                of the first σ²(1 + ζ); zero for a rule without P.

        Raises:
            DataError: for other channels than before, or where the recursion overflows.
            ModelError: for a state of another structure or rule.
        """
        self._check(state)
        n = len(state.estimate)
        rule = self.adaptation.numbers(n)
        by_tiles = history is None and residuals is None and rule[0] == Code.FORGETTING
        for k, piece in enumerate(record.segments):
            if k:
                state = state.cut()
            joined = continuing(state.tail, piece)
            estimate, factor, diagonal, window = (
                np.array(values) for values in (state.estimate, state.factor, state.diagonal, state.window)
            )
            totals, limits = state.totals, self.limits(state)
            for _, start, stop in self.structure.chunks(joined, len(joined)):
                trace = np.empty((0 if history is None else stop - start, n))
                errors = np.empty((0 if residuals is None else stop - start, 3))
                for kept, new in ((history, trace), (residuals, errors)):
                    if kept is not None:
                        kept.append(new)
                for block in self.structure.blocks(joined, start, stop):
                    if by_tiles:
                        update_by_tiles(estimate, factor, diagonal, totals, block, float(rule[1]), limits)
                        continue
                    now, trace = np.split(trace, [block.shape[1]])
                    seen, errors = np.split(errors, [block.shape[1]])
                    update(estimate, factor, diagonal, totals, window, block, rule, limits, now, seen)
            if not np.isfinite(estimate).all():
                raise DataError(f"{record.name}: the recursion overflowed; scale the channels or raise the forgetting")
            memory = self.structure.memory
            tail = joined[max(0, len(joined) - memory) :] if memory else None
            state = replace(state.after(estimate, factor, diagonal, totals, window), tail=tail)
        return state

    def limits(self, state: RecursiveState) -> Array:
        """(2, n) the floor of the limit of D, and the limit: `WINDUP` over the squared peak, at least the floor."""
        floor = GROWTH * self.prior
        with np.errstate(divide="ignore", over="ignore"):
            allowed = np.where(state.peak > 0, WINDUP / state.peak**2, 0.0)
        return np.stack([floor, np.maximum(np.minimum(allowed, HIGHEST), floor)])

    def covariance(self, state: RecursiveState) -> Array:
        """(n, n) covariance of the estimate, at any moment; NaN for a rule that has none."""
        if isinstance(self.rule, Gradient):
            return np.full((len(state.estimate),) * 2, np.nan)
        return state.covariance

    def _check(self, state: RecursiveState) -> None:
        """Refuse a state of another structure, or without the window of the rule."""
        n, rows = len(self.structure.parameter_names), self.adaptation.rows
        if len(state.estimate) != n:
            raise ModelError(f"a state of {len(state.estimate)} parameters for the {n} of {self.structure.name}")
        if rows and state.window.shape != (rows, n + 1):
            raise ModelError(f"the state has no window of {rows} samples; begin with reset(state)")

    def fit(self, state: RecursiveState, like: Record, history: Array | None = None) -> Fit[M_co]:
        """The state as a fit, with a model for records like ``like``."""
        scaled = np.sqrt(state.diagonal)[:, None] * state.factor
        length = np.linalg.norm(scaled, axis=0)
        singular = np.linalg.svd(scaled / length, compute_uv=False)
        return Fit(
            model=self.structure.model(state.estimate, like),
            names=self.structure.parameter_names,
            estimate=state.estimate,
            covariance=self.covariance(state),
            noise_variance=state.noise_variance,
            samples=state.samples,
            condition=float(singular[0] / singular[-1]),
            rank=len(state.estimate),
            method="rls",
            history=history,
            findings=self._findings(state),
        )

    def _findings(self, state: RecursiveState) -> tuple[Finding, ...]:
        """Whether the limit of D kept directions from being forgotten."""
        if not state.limited:
            return ()
        highest, names = self.limits(state)[1], self.structure.parameter_names
        at_limit = [name for name, d, most in zip(names, state.diagonal, highest, strict=True) if d >= most]
        data = {"model": self.structure.name, "samples": state.limited, "parameters": at_limit}
        return (Finding("forgetting-limited", self.structure.name, data),)


def recursive_least_squares(
    structure: LinearStructure[M_co],
    records: Record | Iterable[Record],
    *,
    forgetting: float = 1.0,
    initial_covariance: float | tuple[float, ...] = 1e8,
    initial_estimate: tuple[float, ...] = (),
    history: bool = False,
) -> Fit[M_co]:
    """Recursive least squares over one or several records, from the first sample to the last.

    Args:
        structure: what to fit.
        records: a record, or several experiments in the order of their use.
        forgetting, initial_covariance, initial_estimate: see `RecursiveLeastSquares`.
        history: keep the estimate after every sample in the fit's ``history``; memory grows with the record.

    Raises:
        ModelError, DataError: for records that the structure cannot be fitted to.
    """
    recursion = RecursiveLeastSquares(structure, forgetting, initial_covariance, initial_estimate)
    state, first = recursion.start(), None
    trace: list[Array] | None = [] if history else None
    for record in (records,) if isinstance(records, Record) else records:
        structure.check(record)
        check_excitation(record)
        first = first or record
        check_same_channels(first, record)
        state = recursion.update(state.cut(), record, trace)
    if first is None:
        raise DataError("no record to identify from")
    kept = None if not trace else trace[0] if len(trace) == 1 else np.concatenate(trace)
    return recursion.fit(state, first, kept)


def paper_recursion(regression: ArrayLike, target: ArrayLike, forgetting: float, covariance: Array) -> Array:
    """The recursion exactly as in the paper: a slow and simple reference for `update`.

    Args:
        regression: Φ (N, n).
        target: y (N,).
        forgetting: λ.
        covariance: P(0), (n, n).

    Returns:
        (N, n) the estimate after every sample, from θ(0) = 0.
    """
    lam, p = forgetting, np.array(covariance, dtype=float)
    theta = np.zeros(len(p))
    identity = np.eye(len(p))
    history = []
    for phi, y in zip(np.asarray(regression), np.asarray(target), strict=True):
        error = y - phi @ theta
        p = (1 / lam) * p @ (identity - np.outer(phi, phi) @ p / (lam + phi @ p @ phi))
        theta = theta + p @ phi * error
        history.append(theta)
    return np.array(history)
