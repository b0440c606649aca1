"""The delay that all models are given, where the data show a long one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from emsid.findings import Finding
from emsid.first_look.dynamics import Response
from emsid.identification.options import Options
from emsid.record import Record

LONGEST_SEARCHED = 5
"""Delays of up to this many samples are left to the searches of the models."""


def with_delay(
    options: Options, responses: Sequence[Response | None], record: Record
) -> tuple[Options, tuple[Finding, ...]]:
    """The options with the delay that the first look finds, if it is long and none is given, and a finding about that.

    Args:
        options: of the models.
        responses: of the records; the shortest delay counts.
        record: the first of them.
    """
    delays = [each.delay for each in responses if each is not None and each.delay is not None]
    delay = min(delays, default=0)
    if options.nk is not None or delay <= LONGEST_SEARCHED:
        return options, ()
    data = {"input": record.input_names[0], "delay": delay, "time": delay * record.dt}
    return replace(options, nk=delay), (Finding("delay-from-data", record.output_names[0], data),)
