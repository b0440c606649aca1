r"""Differences between records in delay, gain or level, seen in the errors of one model.

If the free run ŷ of one model has a different error on every record, the drive or its logging has often changed: the
delay with a second clock, the gain with the load, the level with the offset of a sensor. To first order, a record with
its own delay τ, gain 1 + g and level c has

    y − ŷ ≈ −τ dŷ/dt,      y − ŷ ≈ g(ŷ − mean),      y − ŷ ≈ c.

Each x on the right explains Σ(e·x)²/(x·x) of the squared error where every record has its own coefficient, and
(Σ e·x)²/Σ x·x where they share one. The difference between the two is due to the records; the rest is due to the
model.

Whether a record is later or earlier than the free run of a model: another delay, or other time stamps.

The error y(t) − ŷ(t − τ) is minimised over τ by Gauss–Newton: to first order, a change δ of τ changes it by
δ dŷ(t − τ)/dt, so that δ = −Σ e·x/Σ x·x with x = dŷ(t − τ)/dt. The free run is interpolated between its samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.findings import Finding
from emsid.models.model import Model, Run
from emsid.record import Record
from emsid.validation.comparison import FEWEST, SMALL

Array = NDArray[np.float64]

NOTABLE = 0.25
"""A difference between records is reported if it explains at least this share of the squared error."""
PIECES = 4
"""Pieces of the data that a model was fitted to, and of those that it was not, which are compared."""


@dataclass(frozen=True)
class Difference:
    """A way in which records may differ.

    Attributes:
        name: of what is not the same.
        effect: on the output: x (N,), from a stretch of the free run (N,) and the sample time in seconds.
    """

    name: str
    effect: Callable[[Array, float], Array]


DIFFERENCES = (
    Difference("delay", lambda run, dt: -np.gradient(run, dt)),
    Difference("gain", lambda run, dt: run - run.mean()),
    Difference("level", lambda run, dt: np.ones(len(run))),
)


@dataclass(frozen=True)
class Disagreement:
    """A difference between records in the free runs of one model.

    Attributes:
        model: its name.
        output, unit: the output concerned.
        difference: of what kind.
        values: the difference of each record from the model, in seconds, as a fraction, or in the unit of the output.
        records: their names.
        share: the share of the squared error that disappears if every record has its own value.
    """

    model: str
    output: str
    unit: str
    difference: Difference
    values: tuple[float, ...]
    records: tuple[str, ...]
    share: float

    @property
    def finding(self) -> Finding:
        """The same as a finding about the model."""
        records = [{"name": name, "value": value} for name, value in zip(self.records, self.values, strict=True)]
        data = {"model": self.model, "kind": self.difference.name, "unit": self.unit, "share": self.share}
        return Finding("records-differ", self.output, data | {"records": records})


def disagreement(model: Model, records: Sequence[Record]) -> Disagreement | None:
    """The largest difference between the records in the free runs of a model; None where they hardly differ.

    Args:
        model: fitted to them, or some of them.
        records: two or more; records that are too short for the model are left out.
    """
    runs = []
    for record in records:
        try:
            run = model.simulate(record)
        except ModelError:
            continue
        if run.diverged_at is None and np.count_nonzero(run.counted) >= FEWEST:
            runs.append((record, run))
    if len(runs) < 2:
        return None
    worst = max(_in_every_output(model.name, runs), key=lambda each: each.share)
    return worst if worst.share > NOTABLE else None


def difference_of_pieces(runs: Sequence[tuple[Record, Run]], name: str) -> Disagreement | None:
    """The largest difference between pieces of the data in the free runs of one model; None where they hardly differ.

    Args:
        runs: of the model, with their records, each of which is cut into `PIECES`.
        name: of the model.
    """
    pieces = [piece for record, run in runs for piece in _cut(record, run)]
    pieces = [(record, run) for record, run in pieces if np.count_nonzero(run.counted) >= FEWEST]
    if len(pieces) < 2 or any(run.diverged_at is not None for _, run in runs):
        return None
    found = _in_every_output(name, pieces)
    error = np.concatenate([(record.output - run.output)[run.counted] for record, run in pieces])
    spread = np.concatenate([record.output[run.counted] for record, run in pieces]).std(axis=0)
    if not np.all(spread > 0):
        return None
    sizes = np.sqrt(np.mean(error**2, axis=0)) / spread
    size = dict(zip(pieces[0][0].output_names, sizes.tolist(), strict=True))
    clear = [each for each in found if each.share > NOTABLE and np.sqrt(each.share) * size[each.output] > SMALL]
    return max(clear, key=lambda each: each.share, default=None)


def _cut(record: Record, run: Run) -> list[tuple[Record, Run]]:
    """A run and its record in pieces of equal length."""
    edges = [len(record) * k // PIECES for k in range(PIECES + 1)]
    return [(record[a:b], Run(run.output[a:b], run.counted[a:b], None)) for a, b in pairwise(edges) if b > a]


def _in_every_output(model: str, runs: Sequence[tuple[Record, Run]]) -> list[Disagreement]:
    """Every difference in every output."""
    channels = range(runs[0][1].output.shape[1])
    return [_in_one_output(model, runs, channel, each) for channel in channels for each in DIFFERENCES]


def _in_one_output(
    model: str, runs: Sequence[tuple[Record, Run]], channel: int, difference: Difference
) -> Disagreement:
    """The share of the squared error that coefficients of the records' own explain beyond a common one."""
    products, squares, total = [], [], 0.0
    pieces = [[(run.output[some, channel], record.dt, (record.output - run.output)[some, channel])
               for some in _stretches(record, run)] for record, run in runs]  # fmt: skip
    effects = [[difference.effect(output, dt) for output, dt, _ in each] for each in pieces]
    unit = max((float(np.abs(effect).max(initial=0.0)) for each in effects for effect in each), default=0.0) or 1.0
    for each, of_each in zip(pieces, effects, strict=True):
        product = square = 0.0
        for (_, _, error), effect in zip(each, of_each, strict=True):
            scaled = effect / unit  # the derivative of very short sample times is large
            product += float(error @ scaled)
            square += float(scaled @ scaled)
            total += float(error @ error)
        products.append(product)
        squares.append(square)
    p, s = np.array(products), np.array(squares)
    own = np.divide(p, s, out=np.zeros_like(p), where=s > 0)
    explained = float(own @ p - (p.sum() ** 2 / s.sum() if s.sum() > 0 else 0.0))
    record = runs[0][0]
    return Disagreement(
        model=model,
        output=record.output_names[channel],
        unit=record.output_units[channel],
        difference=difference,
        values=tuple((own / unit).tolist()),
        records=tuple(record.name for record, _ in runs),
        share=explained / total if total > 0 else 0.0,
    )


def _stretches(record: Record, run: Run) -> list[slice]:
    """The samples of every segment after the transient, where they are enough for a derivative."""
    stretches = []
    for first, last in pairwise((0, *record.breaks, len(record))):
        counted = np.flatnonzero(run.counted[first:last])
        if len(counted) > 1:
            stretches.append(slice(first + int(counted[0]), last))
    return stretches


ITERATIONS = 8
"""Of Gauss–Newton."""
LEAST_SHIFT = 0.1
"""A smaller shift, in samples, does not matter."""
MOST_SHIFT = 10.0
"""A larger one, in samples, is not found reliably by first-order steps."""


def lateness(record: Record, run: Run) -> Iterable[Finding]:
    """The shift in time of the outputs against a free run, where it makes a notable share of the squared error.

    Args:
        record: the data.
        run: the free run of a model over them.
    """
    resampled = any(each.code == "data-resampled" for each in record.findings)  # by up to a sample
    if run.diverged_at is not None or np.count_nonzero(run.counted) < FEWEST:
        return
    edges = list(pairwise((0, *record.breaks, len(record))))
    for channel, (name, unit) in enumerate(zip(record.output_names, record.output_units, strict=True)):
        y, free = record.output[:, channel], run.output[:, channel]
        shift = _best_shift(y, free, run.counted, edges)
        before, after = (_mean_square(y - _shifted(free, by, edges), run.counted) for by in (0.0, shift))
        if (1.0 if resampled else LEAST_SHIFT) <= abs(shift) <= MOST_SHIFT and after < (1 - NOTABLE) * before:
            errors = {"rmse": float(np.sqrt(before)), "shifted": float(np.sqrt(after)), "unit": unit}
            data = {"output": name, "delay": shift * record.dt, "samples": shift, **errors}
            yield Finding("record-shifted", record.name, data)


def _best_shift(y: Array, free: Array, counted: NDArray[np.bool_], edges: list[tuple[int, int]]) -> float:
    """The shift of the free run (N,) that is closest to y (N,), in samples; later is positive."""
    shift = 0.0
    for _ in range(ITERATIONS):
        moved = _shifted(free, shift, edges)
        slope = np.concatenate([np.gradient(moved[a:b]) if b > a + 1 else np.zeros(b - a) for a, b in edges])[counted]
        square = float(slope @ slope)
        if not square > 0:
            return 0.0
        shift = float(np.clip(shift - (y - moved)[counted] @ slope / square, -2 * MOST_SHIFT, 2 * MOST_SHIFT))
    return shift


def _shifted(free: Array, shift: float, edges: list[tuple[int, int]]) -> Array:
    """The free run (N,) later by ``shift`` samples, segment by segment; before its first sample it is constant."""
    pieces = [np.interp(np.arange(b - a) - shift, np.arange(b - a), free[a:b]) for a, b in edges if b > a]
    return np.concatenate(pieces)


def _mean_square(error: Array, counted: NDArray[np.bool_]) -> float:
    return float(np.mean(error[counted] ** 2))
