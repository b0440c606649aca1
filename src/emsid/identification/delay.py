"""The delay that all models are given, where the data show a long one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from math import inf
from typing import Any

import numpy as np

from emsid.errors import EmsidError
from emsid.findings import Finding
from emsid.first_look.baseline import middle
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.structures import arx
from emsid.options import Options
from emsid.record import Record
from emsid.selection.improvement import matters

LONGEST_SEARCHED = 5
"""Delays of up to this many samples are left to the searches of the models."""
SAMPLES = 4_000
"""At most this many, from the middle of the records, show a delay."""
SHARE = 10
"""The longest delay that is looked for is this part of a record: a longer one leaves few responses to see it by."""
HIGHER = 4
"""The order of a linear model without a delay that is compared with one of second order with it."""
CHANCE = 3.84
"""Times the variance of the noise, the cost that one superfluous parameter saves by chance in 5 % (χ²)."""
QUICK: dict[str, Any] = {"max_iterations": 20, "tolerance": 0.1, "covariances": False}
"""Options of a fit that is only compared."""


def with_delay(options: Options, records: Sequence[Record]) -> tuple[Options, tuple[Finding, ...]]:
    """The options with the delay that the data show, if it is long and none is given, and a finding about that.

    Args:
        options: of the models.
        records: the data; those of the first input and output are looked at.
    """
    first = records[0]
    if options.nk is not None or not first.input.shape[1] or not first.output.shape[1]:
        return options, ()
    changing = [each for each in records if np.ptp(each.input[:, 0])]  # a constant input shows no delay
    if not changing:
        return options, ()
    delay = _shown([middle(each, SAMPLES // len(changing)) for each in changing])
    if delay <= LONGEST_SEARCHED:
        return options, ()
    data = {"input": first.input_names[0], "delay": delay, "time": delay * first.dt}
    return replace(options, nk=delay, delay_from_data=True), (Finding("delay-from-data", first.output_names[0], data),)


def _shown(records: Sequence[Record]) -> int:
    """The delay that a linear model needs, in samples; one where it needs none.

    The error of an output-error model of second order falls with its delay as far as that of the data, and rises beyond
    it. So the best power of two is found, and the delay then by halved steps; of delays with the same error the longest
    has the fewest superfluous coefficients. A slow or a nonlinear response may only look late, and then a model
    of higher order without a delay is better. All these models have few parameters: what a nonlinear system leaves has
    so few independent errors that one parameter for every sample before the delay would always explain a part of it.
    """
    error = cache(partial(_error, records, 2))
    longest = max(map(len, records)) // SHARE
    best = min((1 << k for k in range(longest.bit_length())), key=error, default=1)
    step = best // 2
    while step:
        best = min((best, best + step, best - step), key=error)
        step //= 2
    same = 1 + CHANCE / sum(map(len, records))
    if not 0 < error(best) < inf:  # nothing can be fitted, or any delay fits
        return 1
    while best < longest and error(best + 1) <= same * error(best):
        best += 1
    return 1 if best <= LONGEST_SEARCHED or matters(_error(records, HIGHER, 1), error(best)) else best


def _error(records: Sequence[Record], order: int, delay: int) -> float:
    """The variance of the residual of an output-error model; infinite where none can be fitted."""
    try:
        return fit_free_run(arx(order, order, delay, 1, True), records, **QUICK).noise_variance
    except EmsidError:
        return inf
