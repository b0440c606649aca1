"""What the checks of a record share: its first input and output, and how one answers the other.

A linear model describes the answer; a drift is what its input does not explain (`drift_of`). All of it is found without
outliers of the output, a few of which hide everything else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.least_squares import LARGEST
from emsid.excitation import persistent_excitation_order
from emsid.first_look.baseline import Baseline, baseline, middle
from emsid.first_look.levels import CLEAR, EXPLAINS, FEWEST_SAMPLES, LAGS, PART, SAMPLES
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.first_look.outliers import without_outliers
from emsid.first_look.responses import ANSWERED, FEWER, answers
from emsid.first_look.standstill import at_rest, near_zero
from emsid.record import Record

Array = NDArray[np.float64]

BLOCKS = 12
"""The slope is that of the means of so many parts of the record."""


class Drift(NamedTuple):
    """The line that an output follows besides its input.

    Attributes:
        change: over the record.
        confidence: that it is a drift.
        at_rest: (N,) the output that a linear model with this drift has without an input.
    """

    change: float
    confidence: float
    at_rest: Array


def drift_of(record: Record, linear: Baseline | None, changing: Baseline | None) -> Drift | None:
    """The drift of the first output, a slow change that its input does not explain; None where there is none.

    The dynamics are those of a linear model of the record without its trends, so that no slow pole follows the drift.
    Gain, offset and slope are then fitted together, because a step of the input is a part of a trend, too. There is no
    drift where a linear model without one is as good, as of a system that integrates.

    Args:
        record: with an output.
        linear: a linear model of it.
        changing: a linear model of it without its trends.
    """
    if linear is None or linear.fit < EXPLAINS or changing is None:
        return None
    u, y = record.input[:, 0], record.output[:, 0]
    t = np.linspace(-0.5, 0.5, len(y))
    known = np.column_stack([changing.answer(u, record.breaks), np.ones(len(t))])
    ahead = t - known @ np.linalg.lstsq(known, t, rcond=None)[0]
    gain, offset, trend = np.linalg.lstsq(np.column_stack([known, t]), y, rcond=None)[0]
    drifting = y - known @ np.array([gain, offset])
    if np.linalg.norm(drifting - trend * t) > np.linalg.norm(linear.residual):
        return None
    blocks = [float(part.mean()) for part in np.array_split(drifting, BLOCKS)]
    k = np.arange(BLOCKS) - (BLOCKS - 1) / 2
    slope = float(k @ blocks / (k @ k))
    rest = np.array(blocks) - np.mean(blocks) - slope * k
    error = float(np.sqrt(rest @ rest / (BLOCKS - 2) / (k @ k) * (t @ t) / (ahead @ ahead)))
    change = BLOCKS * slope
    if not (abs(slope) > CLEAR * error and abs(change) > PART * y.std()):
        return None
    sure = round(min(0.95, 0.5 + abs(slope) / error / 20), 2)
    return Drift(change, sure, offset - gain * changing.gain * u.mean() + trend * t)


@dataclass(frozen=True)
class Response:
    """How an output follows an input.

    Attributes:
        delay: samples from the input to the first effect; None where no effect is seen.
        sign: 1 or −1, that of the output for a positive input; 0 where it is not clear.
        correlation: of the output with the simulated response, or the fit of a linear model, whichever is larger; it
            has the sign of the response.
        resolution: samples over which means were taken to see the delay.
        integral: the evidence, in nats, that the change of the output answers, as that of a position does.
        without_sign: whether only the size of the response is seen, as in a speed without its sign.
    """

    delay: int | None
    sign: int
    correlation: float
    resolution: int = 1
    integral: float = 0.0
    without_sign: bool = False


def out_of_scale(x: Array) -> float:
    """The largest value of a channel (N,) that is too large or too small to compute with; 0 for any other."""
    largest = float(np.max(np.abs(x)))
    return largest if largest and not 1 / LARGEST < largest < LARGEST else 0.0


def response_of(record: Record) -> Response | None:
    """How the first output answers the first input; None where too little changes, or is too large to compute with.

    It is the simulated response that explains the output best, of both signs: a correlation has the wrong sign in a
    closed loop, and at a delay of half a period. Of the delays that explain as much the shortest one is taken.

    It is found once for a record, as several parts of an identification ask for it.

    Args:
        record: with an output.
    """
    if record not in _RESPONSES:
        _RESPONSES[record] = _examined(record)
    return _RESPONSES[record]


_RESPONSES: WeakKeyDictionary[Record, Response | None] = WeakKeyDictionary()


def _examined(record: Record) -> Response | None:
    if not record.output.shape[1] or len(record) < FEWEST_SAMPLES or not np.ptp(record.output[:, 0]):
        return None
    table = np.column_stack([record.input[:, 0], without_outliers(record).output[:, 0]])
    if any(map(out_of_scale, table.T)):
        return None
    answer = answers(table, [0, *record.breaks], [0]).get((0, 1))
    found = Response(None, 0, 0.0)
    if answer is not None and answer.clear >= ANSWERED:
        sign, size = 0 if answer.ambiguous else answer.sign, float(np.sqrt(1 - answer.left))
        found = Response(answer.delay, sign, answer.sign * size, answer.scale, answer.integral, answer.size > FEWER)
    return _as_modelled(found, middle(without_outliers(record), SAMPLES))


def _as_modelled(found: Response, record: Record) -> Response:
    """A response as a linear model shows it, where that explains the output.

    Where the two disagree and the model explains little, or the input does not tell one model from another, the sign is
    open. A model that integrates shows a position, which answers by its change.
    """
    latest = None if found.delay is None else found.delay + found.resolution - 1
    linear = baseline(record, latest) if np.ptp(record.input[:, 0]) else None
    if linear is None or linear.fit < EXPLAINS or linear.time_constant > max(map(len, record.segments)):
        return found
    sure = persistent_excitation_order(record) >= 2 * LAGS
    sign = linear.sign if sure or linear.sign == found.sign else 0
    sign = 0 if linear.oscillates_below(record.input[:, 0]) else sign
    delay = linear.delay if latest is None else min(latest, linear.delay) if sure else found.delay
    size = max(abs(found.correlation), linear.fit)
    return replace(found, delay=delay, sign=sign, correlation=size if sign >= 0 else -size)


@dataclass(frozen=True)
class Examined:
    """The first input and output of a record, and a linear model of them.

    Attributes:
        measured: with an output.
        response: of its first output to its first input.
        tolerance: singular values of the lagged input below this share of the largest are no excitation.
    """

    measured: Record
    response: Response
    tolerance: float

    @cached_property
    def record(self) -> Record:
        """What was measured, without outliers of the first output: a few of them hide everything else."""
        return without_outliers(self.measured)

    @property
    def u(self) -> Array:
        """(N,) the first input."""
        return self.record.input[:, 0]

    @property
    def y(self) -> Array:
        """(N,) the first output."""
        return self.record.output[:, 0]

    @property
    def input(self) -> str:
        """The name of the first input."""
        return self.record.input_names[0]

    @property
    def output(self) -> str:
        """The name of the first output."""
        return self.record.output_names[0]

    @cached_property
    def drift(self) -> Drift | None:
        """The drift of the first output, if it has one; a position keeps every disturbance, and drifts anyway."""
        return None if is_position(self.record) else drift_of(self.record, self.linear, self.linear_without_trend)

    @property
    def still(self) -> Array:
        """(N,) the first output less what it drifts to at rest."""
        return self.y if self.drift is None else self.y - self.drift.at_rest

    @cached_property
    def near_zero(self) -> NDArray[np.bool_]:
        """(N,) whether the output is close to zero: at rest, or passing through."""
        return near_zero(self.still)

    @cached_property
    def resting(self) -> NDArray[np.bool_]:
        """(N,) whether the output is at rest."""
        return at_rest(self.still)

    @cached_property
    def linear(self) -> Baseline | None:
        """A linear model of the first output, where there is one."""
        return baseline(self.record, self.response.delay)

    @cached_property
    def linear_without_trend(self) -> Baseline | None:
        """The same of the record without its trends, which a slow pole would follow."""
        return baseline(self.record.detrend(1), self.response.delay)

    @property
    def delay(self) -> int | None:
        """Samples from the input to its first effect: as the response shows it, or fewer in the linear model."""
        shown = self.response.delay
        return shown if shown is None or self.linear is None else min(shown, self.linear.delay)


def units_of(record: Record) -> dict[str, str]:
    """The unit of every channel by its name; a column such as ``speed (RPM)`` may be in another one."""
    return dict(zip(record.input_names + record.output_names, record.input_units + record.output_units, strict=True))


def is_position(record: Record) -> bool:
    """Whether the first output is a position, by its name and unit; of a name such as ``y``, by its unit."""
    unit = next(iter(record.output_units), "")
    said = meaning(record.output_names[0], unit).quantity
    return (meaning("", unit).quantity if said is ColumnQuantity.OUTPUT else said) is ColumnQuantity.POSITION
