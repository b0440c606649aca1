"""Records of a periodic input in steady state, as a search for a cascade uses them.

The search works on one period of every segment, averaged over all. For the last fit, samples of the end of the period
are put ahead of it: after them the free run is in steady state too, so no initial state is estimated.

The same steady state follows without samples ahead from a product of spectra for each filter, between which the map
acts in time. A prototype of that form for filters of third order and periods of 4,096 and 16,384 samples gives the same
output within 2e-6 of its standard deviation, and its derivatives take 0.6 to 1.1 times as long: 127 samples are put
ahead, and the map is evaluated in time in both. That is no reason for a second form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from emsid.errors import ModelError
from emsid.excitation.periods import averaged, period_of
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.record import Record

SHORTEST = 1_000
"""Samples of the shortest period that is averaged; the average over a shorter one is a very short record."""
SETTLED = 1e-4
"""A free run is in steady state when what was before has decayed to this part."""


@dataclass(frozen=True, eq=False)
class Steady:
    """Records of one period each.

    Attributes:
        records: one for every segment.
        period: in samples.
        averages: the number of periods in all segments together.
        noise: standard deviation of the noise on the output over periods; None if no segment has two.
    """

    records: list[Record]
    period: int
    averages: int
    noise: float | None

    @property
    def each(self) -> float:
        """The mean number of periods that a record is the mean of."""
        return self.averages / len(self.records)

    def with_end_ahead(self, model: Cascade) -> tuple[list[Record], int]:
        """The records with the end of each put ahead of it, for a model to settle, and how many samples that are."""
        slowest = max((abs(pole) for b in model.blocks if isinstance(b, Rational) for pole in b.poles), default=0.0)
        decay = np.log(SETTLED) / np.log(min(max(slowest, 1e-6), 1 - 1e-9))
        ahead = int(min(model.memory + decay, self.period))
        return [_turned(record, ahead) for record in self.records], ahead

    def finding(self, name: str) -> Finding:
        """What was averaged."""
        data = {"period": self.period, "periods": self.averages, "records": len(self.records), "noise": self.noise}
        return Finding("periods-averaged", name, data)


def steady_state(records: Sequence[Record], period: int | None) -> Steady | None:
    """The records as periods in steady state; None if their inputs do not repeat.

    Args:
        records: one input, one output each.
        period: in samples, of inputs that are known to be periodic and in steady state; None detects it, 0 takes no
            input for periodic.

    Raises:
        ModelError: for a segment that is shorter than a given period.
    """
    segments = [segment for record in records for segment in record.segments]
    if period is None:
        found = {period_of(segment.input[:, 0], SHORTEST) for segment in segments}
        period = found.pop() if len(found) == 1 else None
    if not period:
        return None
    short = min(len(segment) for segment in segments)
    if short < period:
        raise ModelError(
            f"a period of {period} in a segment of {short} samples; give a smaller one, or unseen records of their own",
            arguments=("period",),
        )
    made = [averaged(segment.input[:, 0], segment.output[:, 0], period) for segment in segments]
    several = [each for each in made if each.averages > 1]
    freedom = sum(each.averages - 1 for each in several)
    noise = sum(each.variance * (each.averages - 1) for each in several) / freedom if freedom else None
    return Steady(
        [
            replace(segment[-period:], output=each.output[:, None], before=())
            for segment, each in zip(segments, made, strict=True)
        ],
        period,
        sum(each.averages for each in made),
        None if noise is None else float(np.sqrt(noise)),
    )


def _turned(record: Record, ahead: int) -> Record:
    """A period with its last samples put ahead of it."""
    around = [np.concatenate([each[len(each) - ahead :], each]) for each in (record.input, record.output)]
    return replace(record, input=around[0], output=around[1], before=())
