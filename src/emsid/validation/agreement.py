r"""Whether several records agree with one model, and if not, in what.

Where the free run ŷ of one model misses every record in a way of its own, the drive or its logging was often not the
same: another delay where two clocks were at work, another gain under another load, another level of a sensor. To first
order a record with a delay τ, a gain 1 + g and a level c of its own has

    y − ŷ ≈ −τ dŷ/dt,      y − ŷ ≈ g(ŷ − mean),      y − ŷ ≈ c.

Each x on the right explains Σ(e·x)²/(x·x) of the squared error where every record has its own coefficient, and
(Σ e·x)²/Σ x·x where they share one. The difference is what the records disagree in; what they share is the model's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.model import Model, Run
from emsid.record import Record

Array = NDArray[np.float64]

# Less of the squared error than this is no matter of the records.
NOTABLE = 0.25
# A record of fewer samples says too little about itself.
SAMPLES = 50


@dataclass(frozen=True)
class Difference:
    """A way in which records may differ: what it does to the output, and how to say so.

    Attributes:
        name: of what is not the same.
        effect: x, (N,), for a stretch of the free run (N,) and the sample time in seconds.
        words: how much a record differs, for a value and the unit of the output.
        remedy: what to do.
    """

    name: str
    effect: Callable[[Array, float], Array]
    words: Callable[[float, str], str]
    remedy: str


DIFFERENCES = (
    Difference(
        "delay",
        lambda run, dt: -np.gradient(run, dt),
        lambda value, unit: f"is {1e3 * abs(value):.3g} ms {'later' if value > 0 else 'earlier'}",
        "log input and output by one clock, or identify them one by one",
    ),
    Difference(
        "gain",
        lambda run, dt: run - run.mean(),
        lambda value, unit: f"has {100 * abs(value):.3g} % {'more' if value > 0 else 'less'}",
        "load or supply may have been another, or the model lacks a nonlinearity",
    ),
    Difference(
        "level",
        lambda run, dt: np.ones(len(run)),
        lambda value, unit: f"is {abs(value):.3g}{' ' * bool(unit)}{unit} {'above' if value > 0 else 'below'}",
        "the offset of a sensor or a constant load may have changed, or the model lacks a nonlinearity",
    ),
)


@dataclass(frozen=True)
class Disagreement:
    """What records disagree in, as one model sees it.

    Attributes:
        model: its name.
        output, unit: the output concerned.
        difference: of what kind.
        values: by how much each record differs from the model, in seconds, as a part, or in the output's unit.
        records: their names.
        share: the part of the squared error that would be gone if every record had its own.
    """

    model: str
    output: str
    unit: str
    difference: Difference
    values: tuple[float, ...]
    records: tuple[str, ...]
    share: float

    @property
    def in_words(self) -> str:
        """A sentence that names the two records furthest apart."""
        low, high = int(np.argmin(self.values)), int(np.argmax(self.values))
        first, second = (
            f"{self.records[k]} {self.difference.words(self.values[k], self.unit)}" for k in sorted((low, high))
        )
        return (
            f"{self.model}: the records do not agree on one {self.difference.name} of {self.output}: compared with the "
            f"model, {first} and {second}, which makes {100 * self.share:.0f} % of its squared error; "
            f"{self.difference.remedy}."
        )


def disagreement(model: Model, records: Sequence[Record]) -> Disagreement | None:
    """What the records disagree in most, as the free runs of a model show it; None where that is nothing of note.

    Args:
        model: fitted to them, or some of them.
        records: two or more, called by their names; those too short for the model are left out.
    """
    runs = []
    for record in records:
        try:
            run = model.simulate(record)
        except ModelError:
            continue
        if run.diverged_at is None and np.count_nonzero(run.counted) >= SAMPLES:
            runs.append((record, run))
    if len(runs) < 2:
        return None
    found = [
        _in_one_output(model.name, runs, channel, difference)
        for channel in range(runs[0][1].output.shape[1])
        for difference in DIFFERENCES
    ]
    worst = max(found, key=lambda each: each.share)
    return worst if worst.share > NOTABLE else None


def _in_one_output(
    model: str, runs: Sequence[tuple[Record, Run]], channel: int, difference: Difference
) -> Disagreement:
    products, squares, total = [], [], 0.0
    for record, run in runs:
        error = (record.output - run.output)[:, channel]
        product = square = 0.0
        for stretch in _stretches(record, run):
            effect = difference.effect(run.output[stretch, channel], record.dt)
            product += float(error[stretch] @ effect)
            square += float(effect @ effect)
            total += float(error[stretch] @ error[stretch])
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
        values=tuple(own.tolist()),
        records=tuple(record.name for record, _ in runs),
        share=explained / total if total > 0 else 0.0,
    )


def _stretches(record: Record, run: Run) -> list[slice]:
    """What counts of every segment, where that is enough for a derivative."""
    stretches = []
    for first, last in pairwise((0, *record.breaks, len(record))):
        counted = np.flatnonzero(run.counted[first:last])
        if len(counted) > 1:
            stretches.append(slice(first + int(counted[0]), last))
    return stretches
