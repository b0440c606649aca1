"""A small linear model with an offset for the first look, whose free run shows what a linear model leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.linear.filtering import filtered, filtered_from, past_state
from emsid.first_look.levels import FEW_SAMPLES, LAGS, PART, SAME, SAMPLES
from emsid.models.regression.instruments import fit_instruments
from emsid.models.regression.structures import arx
from emsid.record import Record

Array = NDArray[np.float64]

ORDERS = (LAGS, 12)
"""Past inputs and outputs of a baseline that other models are compared with: a filter may be of a higher order."""
REPETITIONS = 6
"""Of the instruments."""


RESONANT = 2.0
"""A model resonates where its gain is that many times the gain at rest."""


@dataclass(frozen=True)
class Baseline:
    """A linear model and its free run.

    Attributes:
        fit: 1 − ‖y − ŷ‖/‖y − ȳ‖ of the free run; it may be negative.
        residual: (N,) y − ŷ.
        simulated: (N,) ŷ.
        time_constant: in samples, until the step response first reaches 63 % of its change; infinite where it never
            does.
        gain: of the model at rest.
        a, b: its polynomials in q⁻¹; b begins with as many zeros as its delay.
    """

    fit: float
    residual: Array
    simulated: Array
    time_constant: float
    gain: float
    a: Array
    b: Array

    @property
    def delay(self) -> int:
        """Samples from the input to its first effect in the model."""
        return int(np.flatnonzero(self.b)[0]) if self.b.any() else 0

    @property
    def sign(self) -> int:
        """The sign of the first response to a step, 1 or −1; 0 where the response settles at the opposite sign.

        A lightly damped system answers an oscillation above its resonance with the opposite sign, a step never.
        """
        step = filtered(self.b, self.a, np.ones(FEW_SAMPLES))
        least = PART * float(np.max(np.abs(step)))
        if not 0 < least < np.inf:
            return 0
        early = int(np.sign(step[np.abs(step) >= least][0]))
        return early if abs(self.gain) < least or early == np.sign(self.gain) else 0

    def oscillates_below(self, u: Array) -> bool:
        """Whether the resonance of the model is below the frequencies of an input u (N,).

        The sign of the response there is that of its inertia, or of a mass behind a spring, and not that at rest.
        """
        power = np.abs(np.fft.rfft(u - u.mean())) ** 2
        f = np.arange(len(power)) / len(u)
        q = np.exp(-2j * np.pi * f[:, None] * np.arange(max(len(self.a), len(self.b))))
        gain = np.abs(q[:, : len(self.b)] @ self.b / (q[:, : len(self.a)] @ self.a))
        peak = int(np.argmax(gain))
        return bool(gain[peak] > RESONANT * gain[0] and power[:peak].sum() < SAME * power.sum())

    def answer(self, signal: Array, breaks: Sequence[int]) -> Array:
        """(N,) what the model makes of a signal (N,) in place of the input, from rest in every segment."""
        return _through(self.b, self.a, signal, breaks)

    def summed(self, signal: Array, breaks: Sequence[int]) -> Array:
        """(N,) what the past outputs of the model make of a signal (N,): 1/A(q), from rest in every segment."""
        return _through(np.ones(1), self.a, signal, breaks)


def _through(b: Array, a: Array, signal: Array, breaks: Sequence[int]) -> Array:
    """(N,) a signal (N,) less its mean through b/a, from rest in every segment."""
    pieces = np.split(signal - signal.mean(), list(breaks))
    return np.concatenate([filtered(b, a, piece) for piece in pieces])


def baseline(record: Record, delay: int | None, orders: Sequence[int] = (LAGS,)) -> Baseline | None:
    """A linear model of the first output by the first input.

    It is None where there are too few samples, where the output is constant or where the model is unstable.

    Of the models by instruments and by least squares it is the one whose free run is better: noise on the output biases
    least squares.

    Args:
        record: the data.
        delay: samples from the input to its first effect, at most; None for one sample. In noise the first effect that
            is seen is late, so the model also tries half of it, a quarter of it and so on.
        orders: numbers of past inputs and past outputs to try by least squares.
    """
    if not np.ptp(record.output[:, 0]) > 0:
        return None
    few, latest = middle(record, FEW_SAMPLES), max(1, delay or 1)
    halves = {max(1, latest >> k) for k in range(latest.bit_length())} if latest > 1 else set()
    tried = {each: _by_instruments(few, each) for each in halves}
    delay = _best_delay(few, tried)
    of_all = tried[delay] if tried and len(few) == len(record) else _by_instruments(record, delay)
    by_squares = [each for order in orders for each in _by_squares(record, delay, order)]
    found = [_simulated(record, *each, delay) for each in (*of_all, *by_squares)]
    return max((each for each in found if each is not None), key=lambda each: each.fit, default=None)


def _best_delay(record: Record, tried: Mapping[int, list[tuple[Array, Array, float]]]) -> int:
    """The longest delay of those whose free runs are as good as the best; one where none of the models has one."""
    fits = {
        delay: simulated.fit
        for delay, models in tried.items()
        for each in models
        if (simulated := _simulated(record, *each, delay)) is not None
    }
    best = max(fits.values(), default=0.0)
    return max((each for each in fits if fits[each] >= best - SAME), default=1)


def middle(record: Record, most: int) -> Record:
    """At most this many samples from the middle of a record, with its first input and its first output only."""
    start = max((len(record) - most) // 2, 0)
    few = record[start : start + most]
    few = replace(few, input=few.input[:, :1], input_names=few.input_names[:1], input_units=few.input_units[:1])
    return replace(few, output=few.output[:, :1], output_names=few.output_names[:1], output_units=few.output_units[:1])


def _by_instruments(record: Record, delay: int) -> list[tuple[Array, Array, float]]:
    """(a, b, constant) of a model of second order by refined instruments; none where it has no stable free run."""
    few = middle(record, SAMPLES)
    try:
        fit = fit_instruments(arx(2, 2, nk=delay, constant=True), few, max_iterations=REPETITIONS)
    except EmsidError:
        return []
    a1, a2, b1, b2, constant = fit.estimate
    return [(np.array([1.0, a1, a2]), np.concatenate([np.zeros(delay), [b1, b2]]), float(constant))]


def _by_squares(record: Record, delay: int, order: int) -> list[tuple[Array, Array, float]]:
    """(a, b, constant) of a model of this order by least squares; none from too few samples."""
    first, width = order + delay - 1, 2 * order + 1
    pieces = [piece for piece in middle(record, SAMPLES).segments if len(piece) > first]
    table = np.ones((width + 1, sum(len(piece) - first for piece in pieces)))  # its columns are the equations
    if table.shape[1] < 10 * order:
        return []
    end = 0
    for piece in pieces:
        u, y, n = piece.input[:, 0], piece.output[:, 0], len(piece)
        begin, end = end, end + n - first
        for k in range(order):
            table[k, begin:end] = y[first - k - 1 : n - k - 1]
            table[order + k, begin:end] = u[first - delay - k : n - delay - k]
        table[-1, begin:end] = y[first:]
    # a tenth of the time of a singular value decomposition of all equations
    factor = np.asarray(np.linalg.qr(table.T, mode="r"))
    estimate = np.linalg.lstsq(factor[:, :width], factor[:, width], rcond=1e-10)[0]
    a = np.concatenate([[1.0], -estimate[:order]])
    return [(a, np.concatenate([np.zeros(delay), estimate[order : 2 * order]]), float(estimate[-1]))]


def _simulated(record: Record, a: Array, b: Array, constant: float, delay: int) -> Baseline | None:
    """The model with its free run; None where it is unstable."""
    if np.max(np.abs(np.roots(a)), initial=0.0) >= 1 or a.sum() <= 0:  # A(1) = ∏(1 − pᵢ), positive but for rounding
        return None
    simulated = np.concatenate([_free_run(piece, a, b, constant) for piece in record.segments])
    y = record.output[:, 0]
    residual = y - simulated
    fit = 1 - float(np.linalg.norm(residual) / np.linalg.norm(y - y.mean()))
    step = filtered(b, a, np.ones(min(len(record), 20_000)))
    gain = float(b.sum() / a.sum())
    reached = np.flatnonzero(np.abs(step) >= 0.632 * abs(gain))
    settled = float(max(reached[0] - delay + 1, 0.5)) if len(reached) and np.isfinite(gain) else np.inf
    return Baseline(fit, residual, simulated, settled, gain, a, b)


def _free_run(piece: Record, a: Array, b: Array, offset: float) -> Array:
    """The output of the model on a segment, from its first measured outputs on."""
    u, y = piece.input[:, 0], piece.output[:, 0]
    start = len(b)
    if len(y) <= start:
        return y
    rest = offset / a.sum()
    run, _ = filtered_from(b, a, u[start:], past_state(b, a, y[:start] - rest, u[:start]))
    return np.concatenate([y[:start], run + rest])
