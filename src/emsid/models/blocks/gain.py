"""Normalisation of a cascade: which block has the gain.

A factor can be moved between a filter and the map next to it, and a level between a map and the offset after it,
without changing the output. `unit_gain` removes this freedom: every filter that can pass its gain to a map has a gain
of one at DC (at its peak, if it blocks DC). The input of the map then has the unit of u and its output that of y.

The paper sets λ₁ = 1 (5.3), the slope of the map, instead. That alone does not suffice: b₁ → cb₁, λ₂ → λ₂/c, d → d/c
does not change (5.8).

References:
    Kara, Abokoos, *A Simulation and Experimental Study on Identification of an Electromechanical System*.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from emsid.errors import ModelError
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import Scaling, StaticMap


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
