"""What in a fitted cascade the records cannot tell, said in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Ending, Fit
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.cross_validation import as_arrays
from emsid.models.blocks.search.orders import SAMPLES_PER_PARAMETER
from emsid.models.blocks.static_maps import CubicSpline, DeadZone, PiecewiseLinear, Saturation, StaticMap
from emsid.record import Record

Array = NDArray[np.float64]

# What is called seldom (part of the samples), cancelled (part of the distance to the unit circle) and straight.
SELDOM, CANCELS, STRAIGHT = 0.002, 0.05, 0.01


def advice(fit: Fit[Cascade], records: Record | Sequence[Record]) -> list[str]:
    """What in a fitted cascade the records cannot tell, in sentences; empty where all is well.

    Args:
        fit: the cascade as fitted.
        records: what it was fitted to.
    """
    several = [records] if isinstance(records, Record) else list(records)
    model = fit.model
    pairs = as_arrays(several)
    sentences = []
    for k, block in enumerate(model.blocks):
        if isinstance(block, Rational):
            sentences += _about_filter(block, k)
        elif isinstance(block, StaticMap):
            x = np.concatenate([model.signals(u, model.resting(float(u[0])))[k] for u, _ in pairs])
            sentences += _about_map(block, x, k)
    lost = [
        name for name, variance in zip(fit.names, np.diag(fit.covariance), strict=True) if not np.isfinite(variance)
    ]
    if lost and fit.ending is not Ending.RANK_DEFICIENT:  # which says it itself
        sentences.append(f"The records cannot tell {', '.join(lost)} from other parameters.")
    return sentences


def _about_filter(block: Rational, k: int) -> list[str]:
    sentences = []
    for pole in block.poles:
        if pole.imag < 0 or abs(pole) < 1e-6:
            continue
        near = [zero for zero in block.zeros if abs(zero - pole) < CANCELS * max(1 - abs(pole), 1e-3)]
        if near:
            where = f"{pole.real:.4g}" + (f" ± {pole.imag:.4g}i" if pole.imag else "")
            sentences.append(
                f"Block {k + 1}: a zero all but cancels the pole at {where}; an order lower would do as well."
            )
    return sentences


def _about_map(block: StaticMap, x: Array, k: int) -> list[str]:
    if isinstance(block, DeadZone):
        sides = [
            ("left", "b_l, m_l", np.mean(x < block.b_l)),
            ("right", "b_r, m_r", np.mean(x > block.b_r)),
        ]
        sentences = [
            f"Block {k + 1}: the signal hardly leaves the dead zone on the {side} ({100 * part:.2g} % of samples); "
            f"{names} are not known. Drive it harder."
            for side, names, part in sides
            if part < SELDOM
        ]
        inside = np.mean((x > block.b_l) & (x < block.b_r))
        if not sentences and inside < SELDOM:
            sentences.append(f"Block {k + 1}: the signal is hardly ever inside the dead zone; there may be none.")
        return sentences
    if isinstance(block, Saturation):
        linear = block.slope_between * x
        limits = [("low", np.mean(linear <= block.low)), ("high", np.mean(linear >= block.high))]
        return [
            f"Block {k + 1}: the signal hardly reaches the {side} limit; it is not known. Drive it harder."
            for side, part in limits
            if part < SELDOM
        ]
    if isinstance(block, CubicSpline | PiecewiseLinear):
        nearest = np.searchsorted(0.5 * (block.knots[1:] + block.knots[:-1]), x)
        empty = np.flatnonzero(np.bincount(nearest, minlength=len(block.knots)) < SAMPLES_PER_PARAMETER)
        if len(empty):
            where = ", ".join(f"{block.knots[j]:.4g}" for j in empty)
            return [f"Block {k + 1}: hardly any data around the knots at {where}; use fewer knots or a larger input."]
        slopes = block.slope(np.asarray(np.quantile(x, np.linspace(0.01, 0.99, 99)), dtype=float))
        if np.ptp(slopes) < STRAIGHT * np.max(np.abs(slopes)):
            return [f"Block {k + 1}: the map is a straight line where the data are; a linear model would do as well."]
    return []
