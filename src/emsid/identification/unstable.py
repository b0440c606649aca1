"""Plants that are unstable without their controller: a free run cannot rank models of them.

A magnet that levitates, or a pendulum that is held upright, is recorded in a loop. A right model of it predicts the
next samples well and its free run grows without bound, as the inputs of the record hold the real plant and not the
model. A stable model does not, and may even have another sign of the gain: the controller moves the input against the
output.

The sign of such a plant is a pole outside the unit circle in a regression one step ahead, from every quarter of the
record. Noise may move a pole out a little, as that of a position at 1; so it counts only if an error would grow by
`RUNAWAY` over a quarter. Where the input repeats itself, or moves the output within its row, such a regression has
other solutions; so a plant that the simulated response of a simple stable system explains is not one of these. Models
are then ranked by their predictions over the samples in which an error grows by the factor e.
"""

from __future__ import annotations

from math import ceil, log

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.linear.least_squares import least_squares
from emsid.findings import Finding
from emsid.first_look.levels import PART
from emsid.first_look.responses import answers
from emsid.models.free_run import RUNAWAY
from emsid.models.regression.structures import arx
from emsid.record import Record

ORDER = 4
"""Past inputs and outputs of the regression: a mechanical plant with an actuator and a sensor has as many."""
QUARTERS = 4
"""The parts of the record that have to show the pole."""


def unstable_pole(record: Record) -> float | None:
    """The size of the pole outside the unit circle, the smallest of all quarters; None for a plant without one.

    Args:
        record: one input and one output.
    """
    if record.input.shape[1] != 1 or record.output.shape[1] != 1:
        return None
    segment = max(record.segments, key=len)
    size, found = len(segment) // QUARTERS, []
    for k in range(QUARTERS):
        try:
            fit = least_squares(arx(ORDER, ORDER, constant=True), segment[k * size : (k + 1) * size])
        except EmsidError:  # too short, or not excited
            return None
        poles = np.roots(fit.model.linear_part()[0])
        found.append(float(np.abs(poles).max(initial=0.0)))
    smallest = min(found)
    if smallest <= 1 or size * log(smallest) <= log(RUNAWAY):
        return None
    answer = answers(np.hstack([record.input, record.output]), [0, *record.breaks], [0]).get((0, 1))
    explained = answer is not None and answer.left < PART and not answer.integrates
    return None if explained else smallest


def horizon_of(pole: float) -> int:
    """The samples in which an error grows by the factor e, at least two."""
    return max(2, ceil(1 / log(pole)))


def about_the_loop(record: Record, pole: float | None) -> list[Finding]:
    """The finding about a plant that is unstable without its controller, if it is one."""
    if pole is None:
        return []
    data = {"pole": pole, "time": record.dt / log(pole), "horizon": horizon_of(pole)}
    return [Finding("unstable-in-loop", record.output_names[0], data)]
