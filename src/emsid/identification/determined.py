"""What the data leave open: models that fit them equally well and differ on other inputs of the same range.

An error on unseen data of the same experiment says how a model does on inputs of that kind. Models with equal errors
there may differ by many times their errors on steps, ramps or sines within the same range: then these data do not tell
which is right, and neither is supported by them. A two-level input, for instance, is described equally well by every
static map through two points.

So all models that were compared run over three *probes*: the beginning of the record, followed by levels that are held
for short and long times, by ramps between levels, and by sines, within `LOWER` of the range of each input. Only samples
count where the output of a model stays in the range of the record. A difference is measured in root mean squares of the
model's own error, e. Where the truth differs from the model by d·e, its error on the probe is √(1 + d²)·e; a supported
model is one that is expected to have at most `WITHIN` times its error there. Two differences stand for that of the
truth:

- that of another plausible model which is as good, within noise or in practice, or better;
- twice the standard error of the model itself, from its fits to parts of the data (the jackknife): a fit that lacks the
  share f of the data differs from that to all by (1/(1 − f) − 1)·v on average, where v is the variance of the latter.

References:
    Efron, Stein, *The jackknife estimate of variance*, Annals of Statistics 9 (1981).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.borders import border
from emsid.identification.conclusions import RELATED
from emsid.identification.ranking import Ranked, compared, deviations, within_noise
from emsid.models.extrapolation import with_other_inputs
from emsid.models.model import Model
from emsid.record import Record
from emsid.selection.improvement import equivalent

Array = NDArray[np.float64]
Reason = dict[str, Any]

WITHIN = 1.3
"""A supported model has at most this many times its error on other inputs of the range: 30 % more is still of the same
size, and the difference of the models is then as large as the error."""
LARGEST = sqrt(WITHIN**2 - 1)
"""The difference from the truth, over the error, at which the error is `WITHIN` times as large."""
LOWER = 0.8
"""The range of the probes over that of the record; near the ends of the range there are few data."""
SAMPLES = 1_500
"""Of a probe: fifteen levels of a hundred samples on average. Chosen, not measured."""
SHORTEST, LONGEST = 3, 8
"""A level is held for at least the first number of samples, and for at most the probe divided by the second."""
SINES = 20
"""Sines of a probe, from one period in it to a tenth of the sampling frequency."""
FEW_LEVELS = 3
"""So many input levels are on a parabola, so they do not tell a straight line from a curve with a turn in between."""
TWO_LEVELS = 2
"""So many are on a straight line and on every curve, so they do not show that a system is linear either."""
LEAST = 1e-3
"""A difference is compared with at least this share of the deviation of the output; smaller ones are of no use."""


@dataclass(frozen=True, eq=False)
class Probes:
    """Other inputs within the range of a record.

    Attributes:
        record: what models were fitted to.
    """

    record: Record

    @cached_property
    def records(self) -> tuple[Record, ...]:
        """The beginning of the longest segment with each of the inputs behind it, see `with_other_inputs`."""
        low, high = (end(self.record.input, axis=0) for end in (np.min, np.max))
        middle, half = 0.5 * (low + high), 0.5 * LOWER * (high - low)
        waves = _waves(np.random.default_rng(1), len(middle))
        return tuple(with_other_inputs(self.record, middle + half * wave) for wave in waves)

    @cached_property
    def scale(self) -> Array:
        """(ny,) the deviation of every output; one where it is constant."""
        return deviations(self.record.output)

    def outputs(self, model: Model) -> Array | None:
        """(3, `SAMPLES`, ny) the outputs of a model over the probes, over their deviations; None where it diverges."""
        found = []
        for each in self.records:
            run = None
            with border(f"run of {model.name} with other inputs", model.name, expected=True):
                run = model.simulate(each)
            if run is None:
                return None
            if run.diverged_at is not None:
                return None
            found.append(run.output[-SAMPLES:] / self.scale)
        return np.stack(found)

    def seen(self, outputs: Array) -> NDArray[np.bool_]:
        """(3, `SAMPLES`) where every output is in the range of the record."""
        low, high = (end(self.record.output, axis=0) / self.scale for end in (np.min, np.max))
        return np.asarray(((outputs >= low) & (outputs <= high)).all(axis=-1))

    def difference(self, own: Array, other: Array) -> float:
        """The largest root mean square difference of two models over a probe, where the first is in the range."""
        seen = self.seen(own)
        squares = np.mean((other - own) ** 2, axis=-1)
        several = [float(np.mean(each[where])) for each, where in zip(squares, seen, strict=True) if where.any()]
        return sqrt(max(several, default=0.0))


def _waves(rng: np.random.Generator, inputs: int) -> tuple[Array, Array, Array]:
    """(`SAMPLES`, nu) levels, ramps and sines between −1 and 1."""
    times = [0.0]
    while times[-1] < SAMPLES:
        times.append(times[-1] + np.exp(rng.uniform(np.log(SHORTEST), np.log(SAMPLES / LONGEST))))
    values, t = rng.uniform(-1, 1, (len(times), inputs)), np.arange(SAMPLES)
    levels = values[np.searchsorted(times, t, "right") - 1]
    ramps = np.stack([np.interp(t, times, each) for each in values.T], axis=1)
    frequencies = np.exp(rng.uniform(np.log(1 / SAMPLES), np.log(0.1), SINES))
    turns = frequencies[:, None] * t + rng.random((inputs, SINES, 1))
    waves = np.sum(np.sin(2 * np.pi * turns) / np.sqrt(frequencies)[:, None], axis=1).T
    return levels, ramps, waves / np.abs(waves).max(axis=0)


def few_levels(record: Record) -> int | None:
    """The number of input levels, if there are so few that they do not show a nonlinearity; else None."""
    counts = [len(np.unique(np.round(u / np.ptp(u), 3))) for u in record.input.T if np.ptp(u) > 0]
    return max(counts) if counts and max(counts) <= FEW_LEVELS else None


@dataclass(frozen=True, eq=False)
class Undetermined:
    """What the data leave open about every model that was compared.

    Attributes:
        reasons: by model, why it cannot be supported; not in the table for a model without such a reason.
        straight: the names of the models that are linear over the probes, as far as their error shows.
        levels: the number of input levels, where there are few; else None.
    """

    reasons: Mapping[str, list[Reason]]
    straight: frozenset[str]
    levels: int | None

    @classmethod
    def of(cls, ranking: Sequence[Ranked], record: Record, excluded: Collection[str] = ()) -> Undetermined:
        """What is open after a ranking.

        Args:
            ranking: the models with their errors.
            record: what they were fitted to.
            excluded: names of models that are no rival of another, as they cannot be used or are implausible.
        """
        probes, levels = Probes(record), few_levels(record)
        own = {each.name: probes.outputs(each.refit or each.fit.model) for each in compared(ranking)}
        known = [each for each in compared(ranking) if own[each.name] is not None]
        rivals = [each for each in known if each.name not in excluded]
        reasons: dict[str, list[Reason]] = {}
        straight = set()
        for each in known:
            y = own[each.name]
            assert y is not None
            error = max(sqrt(each.errors.mean), LEAST) if np.isfinite(each.errors.mean) else np.inf
            found = []
            with border(f"comparison of {each.name} with other inputs", each.name):
                found += _of_rivals(each, [(one, own[one.name]) for one in rivals if one is not each], y, error, probes)
                found += _of_itself(each, y, error, probes)
                linear = _bend(each.refit or each.fit.model, probes) <= LARGEST * error
                straight |= {each.name} if linear else set()
                if levels is not None and not (linear and levels > TWO_LEVELS):
                    found.append({"code": "few-levels", "levels": levels})
            if found:
                reasons[each.name] = found
        return cls(reasons, frozenset(straight), levels)


def _of_rivals(
    model: Ranked, rivals: Sequence[tuple[Ranked, Array | None]], own: Array, error: float, probes: Probes
) -> list[Reason]:
    """That a model which is as good differs on the probes, the most different one."""
    found = {
        one.name: probes.difference(own, y) / error
        for one, y in rivals
        if y is not None and (equivalent(one.errors, model.errors) or within_noise(one, model))
    }
    worst = max(found, key=found.__getitem__, default=None)
    if worst is None or found[worst] <= LARGEST:
        return []
    return [{"code": "another-differs", "other": worst, "times": found[worst]}]


def _of_itself(model: Ranked, own: Array, error: float, probes: Probes) -> list[Reason]:
    """That fits of a model to parts of the data differ on the probes, by much of its error or of its own response."""
    squares = []
    for share, again in model.parts:
        y = probes.outputs(again)
        if y is None:
            return [{"code": "parts-differ", "times": None}]
        squares.append(probes.difference(own, y) ** 2 * (1 - share) / share)
    if not squares:
        return [{"code": "response-uncertain"}] if error > 1 - RELATED / 100 else []
    doubled = 2 * sqrt(float(np.mean(squares)))
    found: list[Reason] = [{"code": "parts-differ", "times": doubled / error}] if doubled > LARGEST * error else []
    return [*found, {"code": "response-uncertain"}] if doubled >= float(own.std(axis=1).max()) else found


def _bend(model: Model, probes: Probes) -> float:
    """The largest deviation of a model from a linear one: of the mean of two runs from the run of the mean input."""
    first, *_, last = probes.records
    mean = replace(first, input=0.5 * (first.input + last.input))
    runs = [model.simulate(each).output[-SAMPLES:] / probes.scale for each in (first, last, mean)]
    return float(np.sqrt(np.mean((0.5 * (runs[0] + runs[1]) - runs[2]) ** 2)))
