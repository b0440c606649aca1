"""A joint at its stop: samples in which something that no model of a joint has holds an angle that hangs.

At a stop an angle comes to the same end of its range several times, each time from full motion, and stays there.
Friction holds an arm too, but the arm slows down before it, and rests elsewhere the next time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.uncertainty.rounding import quantisation
from emsid.findings import Finding
from emsid.first_look.hanging import hanging
from emsid.first_look.levels import FEW, PART
from emsid.record import Record

Array = NDArray[np.float64]


def stops(record: Record) -> dict[str, NDArray[np.bool_]]:
    """(N,) where the first output is at a stop, by the side of its range: ``lower``, ``upper``; only those there are.

    Args:
        record: of any output; only an angle that hangs has stops.
    """
    y = record.output[:, 0] if record.output.shape[1] else np.empty(0)
    if len(y) < 2 * FEW or not np.ptp(y) or hanging(record) is None:
        return {}
    step = quantisation(np.unique(y)) or 0.0
    near = {"lower": y <= y.min() + 1.5 * step, "upper": y >= y.max() - 1.5 * step}
    return {side: there for side, there in near.items() if _is_stop(y, there, record.breaks)}


def _is_stop(y: Array, there: NDArray[np.bool_], breaks: Sequence[int]) -> bool:
    """Whether an angle comes to these samples (N,) abruptly, several times, and stays, within parts between breaks."""
    arrivals: list[float] = []
    pieces = list(zip(np.split(y, list(breaks)), np.split(there, list(breaks)), strict=True))
    for angle, near in pieces:
        changes = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
        begins, ends = changes[::2], changes[1::2]
        visits = begins[(ends - begins >= FEW) & (begins >= 2)]
        arrivals += np.abs(angle[visits - 1] - angle[visits - 2]).tolist()  # before the step that the stop cuts short
    if len(arrivals) < FEW:
        return False
    usual = np.percentile(np.abs(np.concatenate([np.diff(angle) for angle, _ in pieces])), 95)
    return bool(np.median(arrivals) > PART * usual)


def without_stops(record: Record) -> Record:
    """The record without the samples at a stop, and with findings about them."""
    found = stops(record)
    if not found:
        return record
    y, unit = record.output[:, 0], record.output_units[0]
    findings = [
        Finding(
            "joint-at-stop",
            record.output_names[0],
            {
                "side": side,
                "limit": float(y.min() if side == "lower" else y.max()),
                "unit": unit,
                "share": float(there.mean()),
                "masked": True,
            },
        )
        for side, there in found.items()
    ]
    left = record.mask(np.any(list(found.values()), axis=0))
    return replace(left, findings=(*left.findings, *findings), excerpt_of=())
