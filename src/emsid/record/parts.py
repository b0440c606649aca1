"""A part of a record with the samples that lead into it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np


def part_with_lead(record: Any, first: int, stop: int) -> Any:
    """Samples ``first`` to ``stop`` of a record; ``before`` of the part has those from the beginning of its segment."""
    here = record[first:stop]
    number = int(np.searchsorted(record.breaks, first, "right"))
    edge = (0, *record.breaks)[number]
    if first == edge:
        return here
    known = record.before[number] if record.before else None
    lead = replace(record[edge:first], before=())
    if known is not None:
        u, y = np.concatenate([known.input, lead.input]), np.concatenate([known.output, lead.output])
        lead = replace(lead, input=u, output=y, times=known.times)
    rest = record.before[number + 1 : number + 1 + len(here.breaks)] or (None,) * len(here.breaks)
    return replace(here, before=(lead, *rest))
