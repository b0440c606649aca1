"""The delay that all models are given, where the data show a long one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Any

from emsid.errors import EmsidError
from emsid.findings import Finding
from emsid.first_look.baseline import middle
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
HIGHER = 4
"""The order of a linear model without a delay that is compared with one of second order with it."""
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
    delay = _confirmed(middle(record, SAMPLES), int(shown[shortest]))
    if delay <= LONGEST_SEARCHED:
        return options, ()
    data = {"input": record.input_names[0], "delay": delay, "time": delay * record.dt}
    return replace(options, nk=delay, delay_shown=True), (Finding("delay-from-data", record.output_names[0], data),)


def _confirmed(record: Record, delay: int) -> int:
    """The delay that a linear model needs: the one that is shown, half of it and so on; one where it needs none.

    In noise the first effect that is seen is late. Of output-error models of second order, the one with the least error
    has the delay. A slow or a nonlinear response may only look late, and then one of higher order without a delay is
    better. All these models have few parameters: what a nonlinear system leaves has so few independent errors that one
    parameter for every sample before the delay would always explain a part of it.

    Args:
        record: one input and one output.
        delay: in samples, the longest that is tried.
    """
    errors = {each: _error(record, 2, each) for each in (delay >> k for k in range(delay.bit_length()))}
    best = min(errors, key=lambda each: errors[each])
    return 1 if matters(_error(record, HIGHER, 1), errors[best]) else best


def _error(record: Record, order: int, delay: int) -> float:
    """The variance of the residual of an output-error model; infinite where none can be fitted."""
    try:
        return fit_free_run(arx(order, order, delay, 1, True), record, **QUICK).noise_variance
    except EmsidError:
        return inf
