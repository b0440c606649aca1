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
from emsid.first_look.columns import stretches_without_change
from emsid.first_look.levels import FEWEST_SAMPLES
from emsid.first_look.outliers import about_outliers, impossible_commands, outliers_of_answer
from emsid.first_look.stuck_output import is_stuck
from emsid.record import Record


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
