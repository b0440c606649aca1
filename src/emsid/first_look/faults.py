"""Samples that are no measurements: single ones far from all others, and outputs that stay though the input moves.

A model of a sensor that stood still is a model of something else. These samples are left out of every identification,
as the command that `emsid describe` proposes leaves them out, and a finding says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.findings import Finding
from emsid.first_look.baseline import baseline
from emsid.first_look.columns import Stretch, stretches_without_change
from emsid.first_look.examined import response_of
from emsid.first_look.levels import CLEAR, FEWEST_SAMPLES
from emsid.first_look.outliers import about_outliers, impossible_commands, outliers_of_answer
from emsid.record import Record

Array = NDArray[np.float64]


def without_faults(record: Record) -> Record:
    """The record without samples that are no measurements, and with findings about them.

    It stays as it is where fewer than `FEWEST_SAMPLES` would be left.
    """
    out, findings = np.zeros(len(record), dtype=bool), list[Finding]()
    for where, finding in _faults(record):
        out |= where
        findings.append(finding)
    if not findings or len(record) - np.count_nonzero(out) < FEWEST_SAMPLES:
        return record
    left = record.mask(out)
    return replace(left, findings=(*left.findings, *findings), excerpt_of=())


def _faults(record: Record) -> Iterator[tuple[NDArray[np.bool_], Finding]]:
    """Samples (N,) that are no measurements, and what they are, channel by channel."""
    u, place = record.input[:, 0], np.arange(len(record))
    for name, x in zip(record.input_names, record.input.T, strict=True):
        found, away = impossible_commands(x)
        if len(found):
            yield np.isin(place, found), about_outliers(name, found, away, masked=True)
    for name, y in zip(record.output_names, record.output.T, strict=True):
        found, away = outliers_of_answer(y, u)
        if len(found):
            yield np.isin(place, found), about_outliers(name, found, away, masked=True)
        for each in stretches_without_change(y, np.unique(np.delete(y, found))):
            if is_stuck(u, y, each):
                where = (place >= each.start) & (place < each.start + each.length)
                data = {"row": each.start, "length": each.length, "value": each.value}
                yield where, Finding("value-stuck", name, data | {"masked": True})


AT_REST, IN_MOTION = 95, 25
"""In percent of the samples at rest the input is too small to move the output; in motion after a drive it often is."""


def is_stuck(u: Array, y: Array, stretch: Stretch) -> bool:
    """Whether the output should have changed in a stretch in which it did not, and was not at rest.

    At a steady input an output may stay at one value, more so a quantised one, and friction or a dead zone holds it
    while the input changes a little. A linear model of the other rows answers that change by no more than it is wrong
    elsewhere, since the same friction acts there. An output is stuck where the model's answer is far larger. At zero,
    where a drive rests, the input must also be larger most of the time than where the output rests elsewhere, and than
    a part of where it moves.

    Args:
        u: (N,) the input; NaN where it is not known.
        y: (N,) the output; NaN where it is not known.
        stretch: of equal values of y.
    """
    rows = np.arange(stretch.start, stretch.start + stretch.length)
    known = np.isfinite(u) & np.isfinite(y)
    inside = np.isin(np.flatnonzero(known), rows)
    u, y = u[known], y[known]
    if not inside.any() or not np.ptp(u[inside]) or (stretch.value == 0 and not _is_driven(u, y, inside)):
        return False
    others = Record(input=u, output=y, dt=1.0).mask(inside)
    response = response_of(others)
    linear = baseline(others, response.delay if response else None)
    if linear is None:
        return False
    answer = linear.answer(u, [])[inside]
    return bool(np.ptp(answer) > CLEAR * float(np.std(linear.residual)))


def _is_driven(u: Array, y: Array, inside: NDArray[np.bool_]) -> bool:
    """Whether an input (N,) is mostly large enough in a stretch to move the output (N,)."""
    size, rests = np.abs(u), y == 0
    known = ((size[~inside & rests], AT_REST), (size[~inside & ~rests], IN_MOTION))
    return bool(all(np.median(size[inside]) >= np.percentile(x, share) for x, share in known if len(x)))
