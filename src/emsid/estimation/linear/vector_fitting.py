r"""The poles of a linear system with many modes from records in time: vector fitting.

Poles p are given. With σ = 1 + Σ kₙ/(z − pₙ), the same for all outputs, the linear equations

    σ(q) yᵢ(t) = Σₙⱼ rᵢₙⱼ/(q − pₙ) uⱼ(t) + dᵢⱼ uⱼ(t) + cᵢ + Σₙ tᵢₙ pₙᵗ

are solved for k, r, d, c and the response t to the initial state. The zeros of σ are better poles, and so on: where
they stay, σ is one. In time this is the iteration of Steiglitz and McBride, whose fixed point is right for white noise
of the output, in a basis that stays well conditioned for dozens of lightly damped modes, from poles that are spread
over all frequencies. Of every output and segment a triangular factor eliminates r, d, c and t.

There are more poles than modes. With poles known, the outputs are linear in r, and one factor holds the models without
some of the blocks: those that explain least are left out one after the other, judged on samples that chose none.

References:
    Gustavsen, Semlyen, *Rational approximation of frequency domain responses by vector fitting*, IEEE Trans. Power
    Delivery 14 (1999). Grivet-Talocia, *Package macromodeling via time-domain vector fitting*, IEEE MWCL 13 (2003).
    Steiglitz, McBride, *A technique for the identification of linear systems*, IEEE TAC 10 (1965).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.information import Information
from emsid.estimation.linear.modal_form import Modal
from emsid.estimation.linear.subspace import LEAST, Signals, stabilised

Array = NDArray[np.float64]

STEPS = 8
"""Changes of the poles; of simulated gantries and aircraft they settle in three or four."""
SAMPLES = 24_000
"""At most this many samples show the poles, from the beginning of every segment."""
PER_COLUMN = 10
"""The fewest samples for each unknown of an output."""
PERIODS = 8
"""Of the slowest mode at the start, in the longest segment."""
DAMPING = 0.01
"""Of all modes at the start."""
CHECKED = 0.25
"""The part of every segment, the last, that judges which poles are left out."""


def spread(pairs: int, longest: float) -> Array:
    """A (2m, 2m) with lightly damped poles, half of them at equal ratios of frequencies and half at equal distances."""
    half = (pairs + 1) // 2
    ratios, equal = np.geomspace(1 / longest, 0.45, half, endpoint=False), np.linspace(0.0, 0.48, pairs - half + 1)[1:]
    a = np.zeros((pairs, 2, pairs, 2))
    for k, f in enumerate([*ratios, *equal]):
        pole = np.exp(2 * np.pi * f * (1j - DAMPING))
        a[k, :, k] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    return a.reshape(2 * pairs, 2 * pairs)


def most_pairs(segments: Sequence[Signals]) -> int:
    """The number of pairs of poles for which there are `PER_COLUMN` samples for each unknown."""
    unknowns = 2 * (segments[0][1].shape[1] + 2)
    return int(min(sum(len(y) for y, _ in segments), SAMPLES) // (PER_COLUMN * unknowns))


def _form(a: Array, apart: bool = False) -> Modal:
    """The blocks of A, without inputs and outputs."""
    none = np.zeros((len(a), 0))
    return Modal.of(a, none, none.T, np.zeros((0, 0)), np.zeros(0), apart=apart)


def _factors(form: Modal, segments: Sequence[Signals], direct: bool, with_output: bool) -> list[Information]:
    """For every output the factor of [r, d, c, (k,) y], without the initial states."""
    found: list[Information] = []
    for y, u in segments:
        samples = len(y)
        both = form.signals(np.ascontiguousarray(np.hstack([u, y] if with_output else [u]).T))
        both = both.transpose(1, 0, 2, 3).reshape(both.shape[1], -1, samples)
        inputs, states = u.shape[1], both.shape[1]
        shared = [both[-1], both[:inputs].reshape(-1, samples), u.T[: inputs * direct], np.ones((1, samples))]
        factors = []
        for i, output in enumerate(y.T):
            rows = np.concatenate([*shared, *([-both[inputs + i]] if with_output else []), output[None]])
            factor = Information.empty(len(rows) - 1).add_columns(rows).factor[states:, states:]
            factors.append(Information(np.ascontiguousarray(factor), samples))
        found = [a.merge(b) for a, b in zip(found, factors, strict=True)] if found else factors
    return found


def fitted_poles(segments: Sequence[Signals], pairs: int, direct: bool) -> Array:
    """A (n, n), n = 2·pairs, with the poles on which vector fitting settles.

    Args:
        segments: outputs and inputs, scaled.
        pairs: m, the pairs of poles at the start.
        direct: whether there is a D.
    """
    share = min(1.0, SAMPLES / sum(len(y) for y, _ in segments))
    part = [(y[: int(share * len(y))], u[: int(share * len(y))]) for y, u in segments]
    a = spread(pairs, max(len(y) for y, _ in part) / PERIODS)
    for _ in range(STEPS):
        form = _form(a)
        states = 2 * len(form.centre)
        of_poles = Information.empty(states)
        for each in _factors(form, part, direct, True):
            own = np.ascontiguousarray(each.factor[-states - 1 :, -states - 1 :])
            of_poles = of_poles.merge(Information(own, each.samples))
        entry = np.tile([0.0, 1.0], len(form.centre))
        kept = ~np.stack([form.single, np.zeros_like(form.single)], axis=1).ravel()
        a = stabilised(form.matrices()[0] - np.outer(entry, of_poles.solve().estimate)[np.ix_(kept, kept)])
    return a


def without_poles(a: Array, segments: Sequence[Signals], direct: bool) -> Iterator[tuple[float, Array, Array]]:
    """The error on the last part of every segment, A and C, with all blocks of A, without one of them, and so on.

    The error is that of the free run, a mean of the ratios of all outputs to that with all blocks.
    """
    form = _form(a, apart=True)
    m, inputs, outputs = len(form.centre), segments[0][1].shape[1], segments[0][0].shape[1]
    cuts = [round((1 - CHECKED) * len(y)) for y, _ in segments]
    fit = _factors(form, [(y[:k], u[:k]) for k, (y, u) in zip(cuts, segments, strict=True)], direct, False)
    check = _factors(form, [(y[k:], u[k:]) for k, (y, u) in zip(cuts, segments, strict=True)], direct, False)
    width, rest = 2 * m * inputs, fit[0].parameters - 2 * m * inputs
    block = np.append(np.tile(np.repeat(np.arange(m), 2), inputs), np.full(rest, -1))
    lacking = np.append(
        np.tile(np.stack([form.single, np.zeros(m, dtype=bool)], axis=1).ravel(), inputs), [False] * rest
    )
    kept, scale = list(range(m)), np.ones(outputs)
    while kept:
        columns = np.flatnonzero(np.isin(block, [*kept, -1]) & ~lacking)
        theta, losses = np.zeros((outputs, len(block))), np.zeros(len(kept))
        errors = np.zeros(outputs)
        for i, (own, other) in enumerate(zip(fit, check, strict=True)):
            size = np.linalg.norm(own.factor[:, columns], axis=0)
            chosen = own.select(columns).with_prior(LEAST * size**2)
            solution = chosen.solve(0.0)
            theta[i, columns] = solution.estimate
            errors[i] = np.sum((other.factor @ np.append(theta[i], -1.0)) ** 2)
            for place, b in enumerate(kept):
                own_columns = np.flatnonzero(block[columns] == b)
                part = solution.estimate[own_columns]
                spread_of = solution.covariance[np.ix_(own_columns, own_columns)] / max(solution.noise_variance, 1e-300)
                losses[place] += part @ np.linalg.solve(spread_of, part) / scale[i]
        if len(kept) == m:
            scale = np.maximum(errors, 1e-300)
        rows = theta[:, :width].reshape(outputs, inputs, m, 2)
        some = _some(form, kept)
        yield float(np.mean(errors / scale)), some.matrices()[0], _seen(form, kept, rows)
        kept.pop(int(np.argmin(losses)))


def _some(form: Modal, kept: Sequence[int]) -> Modal:
    """Some blocks of a form without inputs and outputs."""
    empty, places = np.zeros((len(kept), 2, 0)), list(kept)
    return replace(
        form,
        centre=form.centre[places],
        lower=form.lower[places],
        upper=form.upper[places],
        single=form.single[places],
        b=empty,
        c=empty.transpose(2, 0, 1),
    )


def _seen(form: Modal, kept: Sequence[int], rows: Array) -> Array:
    """C (ny, n) whose rank one of every block is nearest to its responses (ny, nu, m, 2) through e₂.

    A row (α, βg) is that of α + βN, and N is the imaginary number √(gh).
    """
    found = []
    for k in kept:
        if form.single[k]:
            found.append(np.linalg.svd(rows[:, :, k, 1])[0][:, :1])
            continue
        size = np.sqrt(-form.lower[k] / form.upper[k])
        nearest = np.linalg.svd(rows[:, :, k, 0] + 1j * size * rows[:, :, k, 1])[0][:, 0]
        found.append(np.stack([nearest.real, nearest.imag / size], axis=1))
    return np.concatenate(found, axis=1)
