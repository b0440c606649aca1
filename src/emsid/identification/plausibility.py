"""What makes a fitted model implausible, whatever its error is on the data at hand.

A static map that turns or leaves the range of the output where there are hardly any data, poles faster than the
sampling, and a delay longer than the response of the drive are signs that the structure is too rich, or that it
imitates something else. So is a gain whose sign is not that of the response in the record. A pole that a zero nearly
cancels is a remark: the model is larger than it need be, and does what a smaller one does. A free run that diverges
on a larger input, on one that steps within its range, or while the largest or the smallest input is held, is another.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Fit
from emsid.findings import Finding
from emsid.first_look.baseline import baseline
from emsid.first_look.examined import Response, response_of
from emsid.identification.delay import LONGEST_SEARCHED
from emsid.identification.determined import Probes
from emsid.models.capabilities import MapInUse, Modes
from emsid.models.extrapolation import HELD, LARGER, Extremes, diverges, diverges_held, with_other_inputs
from emsid.models.free_run import free_run
from emsid.models.kinds import capabilities_of
from emsid.record import Record

Array = NDArray[np.float64]

SPARSE = 0.002
"""A window of a map's input with a smaller share of the samples has hardly any data."""
WINDOW = 0.02
"""Half the width of that window, as a share of the range of the input."""
GRID = 200
"""Points at which a map is looked at, besides its knots."""
TURNS = 0.05
"""A map turns if it goes back by more than this share of its range over the data."""
FASTEST, IMMEDIATE = float(np.exp(-1.0)), 1e-3
"""A real pole below the first has a time constant shorter than the sample time; below the second it is a delay."""
CANCELS = 0.02
"""A zero this close to a pole, as a share of the distance of the pole to the unit circle, cancels it."""
RISE = 2.2
"""Rise time (10 to 90 %) over time constant of a first-order response."""

DIVERGES, DIVERGES_HELD = "diverges-beyond-range", "diverges-on-constant-input"
EXCLUDING = frozenset({DIVERGES, DIVERGES_HELD})
"""The findings that keep a model from being chosen; see `excluded_models` for the exception."""

IMPLAUSIBLE = frozenset(
    {
        DIVERGES,
        DIVERGES_HELD,
        "delay-longer-than-rise",
        "diverges-on-steps",
        "faster-than-sampling",
        "gain-of-other-sign",
        "knots-without-data",
        "map-leaves-range",
        "map-turns-without-data",
    }
)
"""The findings that make a model implausible."""


class Plausibility:
    """The checks of models that were fitted to one record.

    Args:
        record: what they were fitted to.
    """

    def __init__(self, record: Record) -> None:
        self.record = record

    @cached_property
    def extremes(self) -> Extremes:
        """Records with a larger input, and with the largest and the smallest input held for long."""
        return Extremes(self.record)

    @cached_property
    def steps(self) -> Record:
        """The beginning of the longest segment, whose input then steps between levels within its range."""
        return Probes(self.record).records[0]

    def findings(self, fit: Fit[Any]) -> list[Finding]:
        """Why a model is implausible, without what the fit itself has found."""
        model = fit.model
        if self.record.input.shape[1] != 1 or self.record.output.shape[1] != 1:
            return []
        found: list[Finding] = []
        kind = capabilities_of(model)
        if kind.may_run_away:
            found += self._running_away(model)
        found += [each for used in kind.judged_maps(model, self.record) for each in self._of_map(model.name, used)]
        modes = kind.modes(model)
        found += [*_cancelled(modes), *_too_fast(modes.poles), *self._too_late(modes.delay)]
        found += self._of_other_sign(model)
        return [each.about(model.name) for each in found]

    def _running_away(self, model: Any) -> Iterator[Finding]:
        """A free run that diverges where the record does not."""
        if diverges(model, self.extremes.larger):
            yield Finding(DIVERGES, model.name, {"factor": LARGER})
        if diverges_held(model, self.extremes):
            yield Finding(DIVERGES_HELD, model.name)
        if free_run(model, self.steps).diverged_at is not None:
            yield Finding("diverges-on-steps", model.name)

    def _of_map(self, name: str, used: MapInUse) -> Iterator[Finding]:
        """A map that turns, or leaves the range of the output, where its input has hardly any data."""
        x = used.input[np.isfinite(used.input)]
        if not len(x) or np.ptp(x) == 0 or used.output_at_rest is None:
            return
        grid = np.unique(np.concatenate([np.linspace(x.min(), x.max(), GRID), used.marks]))
        values, sparse = used.value(grid), _sparse(grid, x)
        if not sparse.any() or sparse.all() or not np.isfinite(values).all():
            return
        turn = _turn(values, sparse)
        if turn is not None:
            yield Finding("map-turns-without-data", name, {"block": used.number, "at": float(grid[turn])})
        y = self.record.output[:, 0]
        outputs = np.array([used.output_at_rest(float(value)) for value in values])
        beyond = np.where(sparse, np.maximum(outputs - y.max(), y.min() - outputs), -np.inf)
        worst = int(np.argmax(beyond))
        if beyond[worst] > np.ptp(y):
            data = {"block": used.number, "at": float(grid[worst]), "value": float(outputs[worst])}
            yield Finding("map-leaves-range", name, data | {"low": float(y.min()), "high": float(y.max())})

    def _too_late(self, delay: int) -> Iterator[Finding]:
        """A delay longer than the rise time of the record, and longer than the delay that the record shows."""
        if delay <= LONGEST_SEARCHED or self.rise is None:
            return
        if delay > self.rise:
            dt = self.record.dt
            yield Finding("delay-longer-than-rise", "", {"delay": delay * dt, "rise": self.rise * dt, "samples": delay})

    def _of_other_sign(self, model: Any) -> Iterator[Finding]:
        """A gain whose sign is not that of the response in the record.

        Its sign is that of the difference of two runs that begin alike, one with the largest input of the record held,
        and one with the smallest; a map that turns in between, as a magnitude, has none.
        """
        if self.response is None or not self.response.sign:
            return
        u = self.record.input
        levels = (u.min(), 0.5 * (u.min() + u.max()), u.max())
        inputs = (np.full((model.memory + HELD, 1), level) for level in levels)
        runs = [free_run(model, with_other_inputs(self.record, each)).output[-HELD // 2 :, 0] for each in inputs]
        halves = np.mean(np.diff(runs, axis=0), axis=1) / np.diff(levels)
        if np.all(self.response.sign * halves < 0):
            channels = {"input": self.record.input_names[0], "output": self.record.output_names[0]}
            yield Finding("gain-of-other-sign", "", channels | {"sign": -self.response.sign})

    @cached_property
    def response(self) -> Response | None:
        """How the output of the record answers its input."""
        return response_of(self.record)

    @cached_property
    def rise(self) -> float | None:
        """Delay and rise time of the record in samples, by the small linear model of the first look."""
        linear = baseline(self.record, self.response.delay if self.response else None)
        if linear is None or not linear.fit > 0 or not np.isfinite(linear.time_constant):
            return None
        return RISE * linear.time_constant + linear.delay


def _sparse(grid: Array, x: Array) -> NDArray[np.bool_]:
    """(m,) where on a grid (m,) a signal x has hardly any values."""
    ordered, reach = np.sort(x), WINDOW * float(np.ptp(x))
    counts = np.searchsorted(ordered, grid + reach, "right") - np.searchsorted(ordered, grid - reach)
    return np.asarray(counts < SPARSE * len(x))


def _turn(values: Array, sparse: NDArray[np.bool_]) -> int | None:
    """The largest turn of a curve among its sparse points; None where it does not turn there."""
    enough = TURNS * float(np.ptp(values[~sparse]))
    rising = np.sign(np.diff(values))
    extremes = np.flatnonzero(rising[1:] * rising[:-1] < 0) + 1
    ends = np.concatenate([[0], extremes, [len(values) - 1]])
    sizes = {
        int(here): min(abs(values[here] - values[before]), abs(values[after] - values[here]))
        for before, here, after in zip(ends[:-2], ends[1:-1], ends[2:], strict=True)
        if sparse[here]
    }
    worst = max(sizes, key=lambda k: sizes[k], default=None)
    return worst if worst is not None and sizes[worst] > enough else None


def _too_fast(poles: Sequence[complex]) -> Iterator[Finding]:
    """A real pole whose time constant is shorter than the sample time."""
    fast = [float(pole.real) for pole in poles if abs(pole.imag) < 1e-9 and IMMEDIATE < pole.real < FASTEST]
    if fast:
        yield Finding("faster-than-sampling", "", {"pole": min(fast), "samples": float(-1 / np.log(min(fast)))})


def _cancelled(modes: Modes) -> Iterator[Finding]:
    """Poles that a zero of the same block nearly cancels."""
    for block, (poles, zeros) in modes.pairs.items():
        for pole in poles:
            near = any(abs(zero - pole) < CANCELS * max(1 - abs(pole), 1e-3) for zero in zeros)
            if near and pole.imag >= 0 and abs(pole) > IMMEDIATE:
                of = {"block": block} if block else {}
                yield Finding("zero-cancels-pole", "", of | {"pole": [float(pole.real), float(pole.imag)]})
