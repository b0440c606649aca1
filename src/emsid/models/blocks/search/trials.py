"""Trials of pairs of filters: the best map between two given filters, by one linear problem.

For given filters the map is linear in its parameters: with x = G₁u and splines φⱼ, y ≈ y₀ + Σ cⱼ·G₂φⱼ(x), solved
by `Information` and scored on the rest of the record. A map of another family then starts from this curve, see
`families`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.steps import least_squares_step
from emsid.estimation.threads import in_threads
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import Scaling, StaticMap
from emsid.models.one_channel import Segments

Array = NDArray[np.float64]
Filters = tuple[Rational | None, Rational | None]

# Samples of a trial; enough to rank the candidates.
TRIAL_SAMPLES = 12_000


@dataclass(frozen=True, eq=False)
class Candidate:
    """Two filters and the best spline between them.

    Attributes:
        cascade: the filters of the structure, and the spline.
        error: root mean square of its free-run error on samples that the spline was not fitted to.
    """

    cascade: Cascade
    error: float


def scanned(
    filters: Sequence[Filters],
    segments: Segments,
    trial: Callable[[Array], tuple[StaticMap, ...]],
    template: Cascade,
    threads: int,
) -> list[Candidate]:
    """Every pair of filters with its best map, best first; pairs that fail are left out.

    Args:
        filters: pairs; None if the structure has no such filter.
        segments: (u, y) of each; the longest is used.
        trial: for the input x of the map, maps to try, each linear in its parameters.
        template: offsets, delay, oversampling and name of the candidates.
        threads: threads.

    Raises:
        ModelError: if all pairs fail, with the error of the first.
    """
    u, y = max(segments, key=lambda pair: len(pair[0]))
    u, y = u[:TRIAL_SAMPLES], y[:TRIAL_SAMPLES]

    problems: list[ModelError] = []

    def score(pair: Filters) -> list[Candidate]:
        try:
            return _scored(pair, u, y, trial, template)
        except ModelError as problem:
            problems.append(problem)
            return []

    with in_threads(threads) as in_turn:
        found = [candidate for several in in_turn(score, filters) for candidate in several]
    if problems and not found:
        raise problems[0]
    return sorted(found, key=lambda candidate: candidate.error)


def _scored(
    pair: Filters, u: Array, y: Array, trial: Callable[[Array], tuple[StaticMap, ...]], template: Cascade
) -> list[Candidate]:
    """The candidates of a pair of filters with each trial map, fitted by linear least squares."""
    first, second = pair
    entering = replace(template, blocks=(Rational(np.ones(1)),)).signals(u, np.zeros(0))[-1]
    before, x = _settled(first, entering)
    candidates = []
    samples = len(y)
    train = np.zeros(samples, dtype=bool)
    train[min(samples // 10, 500) : int(0.75 * samples)] = True
    held = np.zeros(samples, dtype=bool)
    held[int(0.75 * samples) :] = True
    for curve in trial(x):
        basis = curve.parameter_gradient(x)
        fixed = curve.value(x)
        wrong = ~(np.isfinite(fixed) & np.isfinite(basis).all(axis=0))
        if wrong.any():
            raise ModelError(
                f"the {curve.kind} map, or its derivative, is not finite at inputs such as {x[wrong][0]:.4g}; give one "
                "that is, wherever the signal goes"
            )
        # If no parameter of the map scales it, or its scale is fixed, the gain of a filter scales it.
        free = not len(curve.parameters) or curve.scaling is Scaling.NONE
        after, moved = _settled_rows(second, fixed[None] if free else basis)
        moved = moved[:, :: template.oversampling]
        level = [] if curve.owns_level and not free else [np.ones((1, samples))]
        regression = np.concatenate([moved, *level])
        rows = np.ascontiguousarray(np.concatenate([regression, y[None]])[:, train])
        theta = least_squares_step(Information.empty(len(regression)).add_columns(rows))
        error = float(np.sqrt(np.mean((theta @ regression - y)[held] ** 2)))
        if not np.isfinite(error):
            continue
        offset = float(theta[-1]) if level else 0.0
        if free:
            gain = float(theta[0])
            after = after.amplified(gain) if after is not None else None
            if after is None and before is not None and curve.scaling is Scaling.JOINT:
                before = before.amplified(abs(gain))
            middle: StaticMap = curve
        else:
            middle = curve.with_parameters(theta[: len(curve.parameters)])
        blocks = tuple(block for block in (before, middle, after) if block is not None)
        candidates.append(Candidate(replace(template, blocks=blocks, output_offset=offset), error))
    return candidates


def _settled(block: Rational | None, x: Array) -> tuple[Rational | None, Array]:
    """A filter of unit gain, and its output from rest at the first sample."""
    if block is None:
        return None, x
    block = of_unit_gain(block)
    return block, block.output(x, block.resting(float(x[0]))[0])


def _settled_rows(block: Rational | None, rows: Array) -> tuple[Rational | None, Array]:
    if block is None:
        return None, rows
    block = of_unit_gain(block)
    level = block.resting(1.0)[1]
    moved = rows - rows[:, :1]
    block.push(rows[0], moved)
    return block, moved + level * rows[:, :1]


def of_unit_gain(block: Rational) -> Rational:
    """The filter with a gain of one, unless its gain is zero."""
    return block.amplified(1 / block.gain) if block.gain else block
