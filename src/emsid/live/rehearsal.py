"""Tracking of made-up samples, which compiles every kernel before a source is opened.

Kernels are compiled at their first call on a machine, for half a minute in all. If that were the call with the first
samples, a board would send meanwhile, and lines would be lost where nothing keeps them.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.linear.change_detection import ChangeDetector
from emsid.live.tracking import Tracker
from emsid.record import Record

SAMPLES = 100
"""Made-up samples beyond those that start a structure or a model."""


def rehearse(tracker: Tracker, inputs: int, detects: bool) -> None:
    """Track random numbers at once and one sample later, and forget the result.

    Args:
        tracker: to be used afterwards; it is not changed.
        inputs: how many there are.
        detects: whether changes will be looked for.
    """
    structure, model = tracker.recursion.structure, tracker.model
    if detects:
        tracker = replace(tracker, detector=ChangeDetector(run=100.0, settling=10))
    memory = max(structure.memory, 0 if model is None else model.memory)
    rng, samples = np.random.default_rng(0), memory + len(structure.parameter_names) + SAMPLES
    dt = 1e-3 if model is None or model.dt is None else model.dt
    record = Record(rng.standard_normal((samples, inputs)), rng.standard_normal((samples, 1)), dt)
    with suppress(EmsidError):  # these numbers may drive a structure or a model out of its range; real ones need not
        tracking = tracker.start()
        for piece in (record[:-1], record[-1:]):
            tracking, _, _ = tracker.advance(tracking, piece)
        tracker.half_widths(tracking)
        tracker.physical(tracking)
