"""Free-run errors by operating region, and by record.

The regions of a speed y are defined from its own range, with v the 99 % quantile of |y|:

=============  ========================================================================================
standstill     |y| ≤ 0.05 v
low speed      0.05 v < |y| ≤ 0.3 v
high speed     |y| > 0.3 v
reversal       the samples between high speed in one direction and high speed in the other, unless most
               of them are at standstill; they count as nothing else
=============  ========================================================================================

Friction and dead zones show at standstill and in reversals, saturation at high speed. An output that stays away from
zero has no standstill. A position has no regions: its size says nothing about motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.findings import Finding
from emsid.models.free_run import from_rest
from emsid.record import Record
from emsid.validation.comparison import Assessment, Comparison
from emsid.validation.metrics import FEWEST, SMALL

Array = NDArray[np.float64]

REST, FAST, TOP = 0.05, 0.3, 0.99
"""Limits of standstill and of high speed as shares of v, and the quantile of |y| that v is."""
REGIONS = ("standstill", "low speed", "reversal", "high speed")
WORSE = 2.0
"""The error in a region is much larger from this ratio to the error in all other regions on."""
POSITIONS = frozenset({"m", "cm", "mm", "um", "µm", "rad", "mrad", "deg", "°", "turn", "rev", "count"})
"""Units of outputs without regions."""


@dataclass(frozen=True)
class RegionError:
    """The free-run error of a model in one region of one output.

    Attributes:
        model, output, unit: what it is the error of; the unit is that of the RMSE.
        region: one of `REGIONS`.
        samples: of the output in this region.
        rmse: of the free run there; infinite where it diverged.
        share: of the squared error of the output, from 0 to 1; NaN where the run diverged.
    """

    model: str
    output: str
    unit: str
    region: str
    samples: int
    rmse: float
    share: float


@dataclass(frozen=True)
class RecordError:
    """The free-run error of a model on one of several records.

    Attributes:
        model, record, output, unit: what it is the error of; the unit is that of the RMSE.
        samples: of the record after its transients.
        rmse: of the free run; infinite where it diverged.
    """

    model: str
    record: str
    output: str
    unit: str
    samples: int
    rmse: float


def region_of(y: Array, breaks: Sequence[int] = ()) -> NDArray[np.intp]:
    """(N,) the index in `REGIONS` of every sample of an output y (N,).

    Args:
        y: a speed, or another output with a zero that means rest.
        breaks: the first sample of every segment but the first; a reversal lies in one segment.
    """
    size = np.abs(y)
    top = float(np.quantile(size, TOP)) if len(y) else 0.0
    found = np.where(size > FAST * top, 3, np.where(size > REST * top, 1, 0))
    for first, stop in zip((0, *breaks), (*breaks, len(y)), strict=True):
        fast = first + np.flatnonzero(found[first:stop] == 3)
        turns = np.flatnonzero(np.sign(y[fast[1:]]) != np.sign(y[fast[:-1]]))
        for last, following in zip(fast[turns].tolist(), fast[turns + 1].tolist(), strict=True):
            between = found[last + 1 : following]
            if len(between) and np.mean(between == 0) <= 0.5:
                found[last + 1 : following] = 2
    return found


def errors_by_region(assessment: Assessment) -> tuple[RegionError, ...]:
    """The free-run errors of a model in every region that has samples, output by output; none of a position.

    Args:
        assessment: the model run over a record.
    """
    record, counted = assessment.record, assessment.simulation.counted
    found = []
    for channel, (name, unit) in enumerate(zip(record.output_names, record.output_units, strict=True)):
        if unit in POSITIONS:
            continue
        y = record.output[:, channel]
        squares = (y - assessment.simulation.output[:, channel]) ** 2
        squares = np.where(np.isfinite(squares), squares, np.inf)
        regions, total = region_of(y, record.breaks), float(np.sum(squares[counted]))
        for index, region in enumerate(REGIONS):
            here = counted & (regions == index)
            if not here.any():
                continue
            own = float(np.sum(squares[here]))
            samples = int(np.count_nonzero(here))
            share = own / total if np.isfinite(total) and total > 0 else float("nan")
            rmse = float(np.sqrt(own / samples))
            found.append(RegionError(assessment.row.model, name, unit, region, samples, rmse, share))
    return tuple(found)


def by_region(comparison: Comparison) -> tuple[RegionError, ...]:
    """The errors of every model in every region, in the order of the comparison.

    Args:
        comparison: the models run over a record.
    """
    return tuple(each for assessment in comparison.assessments for each in errors_by_region(assessment))


def by_record(fits: Sequence[Any], records: Sequence[Record], transient: int | None = None) -> tuple[RecordError, ...]:
    """The errors of every model on each of several records; none for a single one.

    Args:
        fits: fitted models.
        records: with their channels; one that is too short for the models is left out.
        transient: samples at the start of a segment in motion without error; at least what the models need.
    """
    if len(records) < 2:
        return ()
    start = max((transient or 0, *(fit.model.memory for fit in fits)))
    found = []
    for fit in fits:
        for record in records:
            if all(len(from_rest(segment, start)) <= start for segment in record.segments):
                continue
            run = fit.model.simulate(record, start)
            squares = (record.output - run.output)[run.counted] ** 2
            means = np.mean(np.where(np.isfinite(squares), squares, np.inf), axis=0)
            for name, unit, mean in zip(record.output_names, record.output_units, means.tolist(), strict=True):
                of = fit.model.name, record.name, name, unit
                found.append(RecordError(*of, int(np.count_nonzero(run.counted)), float(np.sqrt(mean))))
    return tuple(found)


def worst_region(assessment: Assessment) -> Finding | None:
    """The region whose error is much larger than that in all others, if there is one."""
    errors = [each for each in errors_by_region(assessment) if np.isfinite(each.rmse)]
    for channel, output in enumerate(assessment.record.output_names):
        small = SMALL * float(np.std(assessment.record.output[:, channel]))
        own = [each for each in errors if each.output == output]
        large = max((each for each in own if each.samples >= FEWEST), key=lambda each: each.rmse, default=None)
        others = [each for each in own if each is not large]
        if large is None or sum(each.samples for each in others) < FEWEST:
            continue
        rest = float(np.sqrt(np.average([e.rmse**2 for e in others], weights=[e.samples for e in others])))
        if large.rmse > max(WORSE * rest, small):
            data = {"model": large.model, "region": large.region, "rmse": large.rmse, "others": rest}
            return Finding("error-in-region", output, data | {"unit": large.unit, "samples": large.samples})
    return None
