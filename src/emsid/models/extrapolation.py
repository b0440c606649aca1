"""Whether the free run of a model stays bounded on inputs that its record lacks.

A model can simulate its record well and diverge on an input a little larger than that of the record, or while the
largest or the smallest input is held. The first is reason enough not to choose it. The second may be true of the
system: one with a spring that softens can be stable for every input like that of the record, and diverge on a constant
one that is as large as its peak. Such a model is chosen only if it is much better than all others (`MUCH_BETTER`),
since one that is a little better is more often wrong there than right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from emsid.models.free_run import free_run
from emsid.models.model import Model
from emsid.record import Record

LARGER = 1.2
"""The factor by which an input is made larger, about its middle."""
FAR = 10.0
"""A free run that leaves the middle of the measured output by this many times its half range has diverged."""
HELD, BEGUN = 300, 200
"""The samples for which an extreme input is held, and those of the record before."""
MUCH_BETTER = 2.0
"""A model that diverges while an extreme input is held has an error smaller by this factor than those that do not."""


@dataclass(frozen=True, eq=False)
class Extremes:
    """Inputs that a record lacks: larger ones, and extreme ones that are held.

    Attributes:
        record: with inputs and outputs.
    """

    record: Record

    @cached_property
    def larger(self) -> Record:
        """The record with inputs that are larger by `LARGER`, about the middle of their range."""
        u = self.record.input
        middle = 0.5 * (u.min(axis=0) + u.max(axis=0))
        return replace(self.record, input=middle + LARGER * (u - middle), before=())

    @cached_property
    def backwards(self) -> Record:
        """The longest segment of the larger record backwards in time: another input of the same spectrum and range."""
        segment = max(self.larger.segments, key=len)
        return replace(segment, input=segment.input[::-1], output=segment.output[::-1], before=())

    @cached_property
    def held(self) -> Record:
        """The beginning of the longest segment, then its largest input held, the beginning, and its smallest input.

        Several inputs are at the same end of their ranges at a time.
        """
        u = max(self.record.segments, key=len).input
        largest, smallest = (np.tile(end, (HELD, 1)) for end in (u.max(axis=0), u.min(axis=0)))
        return with_other_inputs(self.record, np.concatenate([largest, u[:BEGUN], smallest]))


def with_other_inputs(record: Record, inputs: NDArray[np.float64]) -> Record:
    """The beginning of the longest segment of a record with inputs (n, nu) behind it.

    Of the outputs there, which a free run does not see, only the range is right.
    """
    segment = max(record.segments, key=len)
    begun, ends = segment[:BEGUN], np.stack([segment.output.min(axis=0), segment.output.max(axis=0)])
    outputs = np.resize(ends, (len(inputs), ends.shape[1]))
    both = {"input": np.concatenate([begun.input, inputs]), "output": np.concatenate([begun.output, outputs])}
    return replace(begun, **both, before=())


def runs_away(model: Model, extremes: Extremes) -> bool:
    """Whether a model diverges on a record with a larger input, or while an extreme input is held."""
    return diverges(model, extremes.larger) or diverges_held(model, extremes)


def diverges_held(model: Model, extremes: Extremes) -> bool:
    """Whether a model diverges while an extreme input is held."""
    return free_run(model, extremes.held).diverged_at is not None


def diverges(model: Model, record: Record) -> bool:
    """Whether the free run leaves the range of the measured output by far."""
    run, y = free_run(model, record), record.output
    return run.diverged_at is not None or leaves_range(run.output[run.counted], float(y.min()), float(y.max()))


def leaves_range(y: NDArray[np.float64], low: float, high: float, times: float = FAR) -> bool:
    """Whether an output leaves the middle of a range by many times half the range, or is not a number.

    Args:
        y: the output.
        low, high: the ends of the range.
        times: how many times.
    """
    return not np.abs(y - 0.5 * (low + high)).max(initial=0.0) <= times * 0.5 * (high - low)
