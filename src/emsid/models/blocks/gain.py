"""Normalisation of a cascade: which block has the gain.

A factor can be moved between a filter and the map next to it, and a level between a map and the offset after it,
without changing the output. Two normalisations remove this freedom:

- `unit_gain`, used in fits and results: every filter that can pass its gain to a map has a gain of one at DC (at its
  peak, if it blocks DC). The input of the map then has the unit of u and its output that of y.
- `unit_slope`, the paper's λ₁ = 1 (5.3): in addition the map has a slope of one, and the last filter has all the gain.
  (λ₁ = 1 alone does not suffice: b₁ → cb₁, λ₂ → λ₂/c, d → d/c does not change (5.8).)

References:
    Kara, Abokoos, *A Simulation and Experimental Study on Identification of an Electromechanical System*.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import Scaling, StaticMap

Array = NDArray[np.float64]


def unit_gain(cascade: Cascade) -> Cascade:
    """The same model with a gain of one in every filter that can pass its gain to a neighbouring map.

    Raises:
        ModelError: for a filter with only zero coefficients.
    """
    for k in fixed_gains(cascade):
        block = cascade.blocks[k]
        assert isinstance(block, Rational)
        if not block.gain:
            raise ModelError(f"{cascade.name}, block {k + 1}: all its numerator coefficients are zero; give others")
        cascade = _without_gain(cascade, k, block.gain)
    return cascade


def unit_slope(cascade: Cascade) -> Cascade:
    """The same model in the paper's normalisation λ₁ = 1: every map has unit slope, and the last filter the gain.

    Raises:
        ModelError: if a map has a slope of zero, or no filter can take its gain.
    """
    cascade = unit_gain(cascade)
    for k, block in enumerate(cascade.blocks):
        if not (isinstance(block, StaticMap) and block.scaling is Scaling.FREE):
            continue
        if block.steepness == 0:
            raise ModelError(f"{cascade.name}: block {k + 1} has a slope of zero; it cannot be scaled to one")
        blocks = list(cascade.blocks)
        behind = next((j for j in range(k + 1, len(blocks)) if isinstance(blocks[j], Rational)), None)
        before = next((j for j in range(k - 1, -1, -1) if isinstance(blocks[j], Rational)), None)
        if behind == k + 1:
            blocks[k] = block.scaled(1.0, 1 / block.steepness)
            blocks[behind] = blocks[behind].amplified(block.steepness)  # type: ignore[attr-defined]
        elif before == k - 1 and before is not None:
            blocks[k] = block.scaled(block.steepness, 1.0)
            blocks[before] = blocks[before].amplified(block.steepness)  # type: ignore[attr-defined]
        else:
            raise ModelError(f"{cascade.name}: no filter stands beside block {k + 1} to take up its slope")
        cascade = replace(cascade, blocks=tuple(blocks))
    return cascade


def normalised(fit: Fit[Cascade], normalisation: Callable[[Cascade], Cascade]) -> Fit[Cascade]:
    """The fit with its model, estimate and covariance in another normalisation, by the delta method.

    Args:
        fit: of a cascade, from an estimator.
        normalisation: `unit_gain`, `unit_slope` or another function that does not change the input–output behaviour.
    """
    theta = fit.model.parameters
    at = [fit.model.names.index(name) for name in fit.names]
    model = normalisation(fit.model)

    def moved(estimate: Array) -> Array:
        full = theta.copy()
        full[at] = estimate
        return normalisation(fit.model.with_parameters(full)).parameters

    step = np.cbrt(np.finfo(float).eps) * np.maximum(np.abs(fit.estimate), fit.standard_error)
    step[~(np.isfinite(step) & (step > 0))] = 1e-6
    slopes = np.array(
        [(moved(fit.estimate + d) - moved(fit.estimate - d)) / (2 * d.max()) for d in np.diag(step)]
    ).reshape(len(at), len(theta))
    covariance = slopes.T @ fit.covariance @ slopes
    kept = np.flatnonzero(np.diag(covariance) > 0)
    return replace(
        fit,
        model=model,
        names=tuple(model.names[k] for k in kept),
        estimate=model.parameters[kept],
        covariance=covariance[np.ix_(kept, kept)],
    )


def fixed_gains(cascade: Cascade) -> tuple[int, ...]:
    """The filters whose gain is redundant because a neighbouring map can take it."""
    return tuple(k for k in redundant(cascade) if isinstance(cascade.blocks[k], Rational))


def redundant(cascade: Cascade) -> tuple[int, ...]:
    """Blocks with a scale that must be fixed, filters first, so that no factor can be moved.

    Factors eᶜ at the inner interfaces are redundant if every block admits them: a filter always, a map according to its
    `scaling`. The redundant factors form a vector space; a block is chosen if its gain is linearly independent of
    those of the blocks chosen before.
    """
    from scipy.linalg import null_space

    count = len(cascade.blocks)
    inside = np.eye(count + 1)[:, 1:count]  # interface j of count + 1; the outer two are fixed
    refused = []
    for k, block in enumerate(cascade.blocks):
        scaling = block.scaling if isinstance(block, StaticMap) else Scaling.FREE
        if scaling is Scaling.JOINT:
            refused.append(inside[k + 1] - inside[k])
        elif scaling is Scaling.NONE:
            refused += [inside[k], inside[k + 1]]
    space = null_space(np.array(refused)) if refused else np.eye(count - 1)
    chosen: list[int] = []
    seen = np.zeros((0, space.shape[1]))
    filters_first = sorted(range(count), key=lambda k: not isinstance(cascade.blocks[k], Rational))
    for k in filters_first:
        gain = (inside[k + 1] - inside[k]) @ space
        if space.shape[1] and np.linalg.matrix_rank(np.vstack([seen, gain])) > len(seen):
            seen = np.vstack([seen, gain])
            chosen.append(k)
    return tuple(chosen)


def _without_gain(cascade: Cascade, k: int, gain: float) -> Cascade:
    """The cascade with filter k divided by its gain, which the blocks after it, or the map before it, take."""
    blocks = list(cascade.blocks)
    filter_ = blocks[k]
    assert isinstance(filter_, Rational)
    blocks[k] = filter_.amplified(1 / gain)
    for j in range(k + 1, len(blocks)):
        block = blocks[j]
        if isinstance(block, Rational):
            blocks[j] = block.amplified(gain)
            return replace(cascade, blocks=tuple(blocks))
        if isinstance(block, StaticMap) and block.scaling is Scaling.FREE:
            blocks[j] = block.scaled(1 / gain, 1.0)
            return replace(cascade, blocks=tuple(blocks))
        gain = abs(gain)
    before = blocks[k - 1] if k else None
    if isinstance(before, StaticMap) and before.scaling is Scaling.FREE:
        blocks[k - 1] = before.scaled(1.0, gain)
        return replace(cascade, blocks=tuple(blocks))
    return cascade
