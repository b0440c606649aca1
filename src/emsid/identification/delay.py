"""The delay that all models are given, where the data show a long one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

from emsid.findings import Finding
from emsid.first_look.baseline import baseline
from emsid.first_look.dynamics import Response
from emsid.identification.options import Options
from emsid.record import Record

LONGEST_SEARCHED = 5
"""Delays of up to this many samples are left to the searches of the models."""


def with_delay(
    options: Options, responses: Sequence[Response | None], records: Sequence[Record]
) -> tuple[Options, tuple[Finding, ...]]:
    """The options with the delay that the first look finds, if it is long and none is given, and a finding about that.

    Args:
        options: of the models.
        responses: of the records; the shortest delay counts, where a small linear model needs it too.
        records: these.
    """
    shown = [each.delay if each is not None and each.delay is not None else inf for each in responses]
    shortest = min(range(len(shown)), key=lambda k: shown[k])
    if options.nk is not None or not LONGEST_SEARCHED < shown[shortest] < inf:
        return options, ()
    record = records[shortest]
    linear = baseline(record, int(shown[shortest]))
    delay = 0 if linear is None else linear.delay
    if delay <= LONGEST_SEARCHED:
        return options, ()
    data = {"input": record.input_names[0], "delay": delay, "time": delay * record.dt}
    return replace(options, nk=delay), (Finding("delay-from-data", record.output_names[0], data),)
