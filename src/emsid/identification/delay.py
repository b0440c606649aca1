"""The delay that all models are given, where the data show a long one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Any

from emsid.errors import EmsidError
from emsid.findings import Finding
from emsid.first_look.baseline import baseline, middle
from emsid.first_look.dynamics import Response
from emsid.identification.options import Options
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.structures import arx
from emsid.record import Record
from emsid.selection.improvement import matters

LONGEST_SEARCHED = 5
"""Delays of up to this many samples are left to the searches of the models."""
SAMPLES = 4_000
"""At most this many, from the middle of a record, confirm a delay."""
QUICK: dict[str, Any] = {"max_iterations": 20, "tolerance": 0.1, "covariances": False}
"""Options of a fit that is only compared."""


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
    if delay <= LONGEST_SEARCHED or _acts_before(record, delay):
        return options, ()
    data = {"input": record.input_names[0], "delay": delay, "time": delay * record.dt}
    return replace(options, nk=delay, delay_shown=True), (Finding("delay-from-data", record.output_names[0], data),)


def _acts_before(record: Record, delay: int) -> bool:
    """Whether an input acts before a delay has passed: a slow or a nonlinear response may only look late.

    An output-error model of second order with the delay is compared with one that may use every sample before it too,
    by the variance of the residual for each degree of freedom.
    """
    few = middle(record, SAMPLES)
    try:
        late, early = (fit_free_run(arx(2, nb, nk, 1, True), few, **QUICK) for nk, nb in ((delay, 2), (1, delay + 1)))
    except EmsidError:
        return False
    return matters(early.noise_variance, late.noise_variance)
