"""Tracking: a recursive estimate, a detector of changes, and perhaps a fixed model beside them, as values.

`Tracker` says what to do, `Tracking` is the state, and `Tracker.advance` takes a record of further samples and returns
the state after them. One sample at a time, in pieces or at once give the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.borders import border, tried
from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.fit import Fit
from emsid.estimation.linear.change_detection import ChangeDetector
from emsid.estimation.linear.recursive import RecursiveLeastSquares, RecursiveState
from emsid.models.model import Model
from emsid.models.regression.figures import of_regression
from emsid.models.regression.narx import Narx
from emsid.record import Record, continuing

Array = NDArray[np.float64]

KEPT = 2.0
"""After a change, the past has the weight of this many samples for each parameter."""


@dataclass(frozen=True)
class Change:
    """A change of the system that was detected.

    Attributes:
        time: of the alarm in s.
        since: the estimated time of the change in s.
        kind: ``level`` or ``spread`` of the prediction error.
    """

    time: float
    since: float
    kind: str


@dataclass(frozen=True)
class Physical:
    """A physical value of the present estimate.

    Attributes:
        name, value, unit: what it is.
        half_width: of its 95 % interval; None where it is not known.
    """

    name: str
    value: float
    unit: str
    half_width: float | None


@dataclass(frozen=True, eq=False)
class Tracking:
    """The state of a tracker.

    Attributes:
        state: of the recursion.
        detection: of the detector of changes.
        samples: the number of samples so far.
        lowest, highest: (nu,) the range of the inputs.
        last: the last sample, as a record; None before the first.
        prediction: ŷ of it by the estimate before it; NaN where there are too few samples before it.
        squares, products: sums of ε(t)² and ε(t)ε(t − 1), whose ratio is the correlation of neighbouring errors.
        before: the last ε; NaN after a gap.
        model: the state of the fixed model, or the samples from which it will begin.
        model_output: its output at the last sample; NaN while it has not begun.
    """

    state: RecursiveState
    detection: Array
    samples: int = 0
    lowest: Array = field(default_factory=lambda: np.array([np.inf]))
    highest: Array = field(default_factory=lambda: np.array([-np.inf]))
    last: Record | None = None
    prediction: float = float("nan")
    squares: float = 0.0
    products: float = 0.0
    before: float = float("nan")
    model: Any = None
    model_output: float = float("nan")

    @property
    def correlation(self) -> float:
        """The correlation of neighbouring prediction errors; they are white where it is zero."""
        return self.products / self.squares if self.squares > 0 else 0.0


@dataclass(frozen=True)
class Tracker:
    """What is tracked, and how.

    Args:
        recursion: the structure with its rule of adaptation.
        detector: of changes; None to look for none.
        adapts: whether the past loses its weight after a change.
        model: a fixed model whose free run is shown beside the measurement.
    """

    recursion: RecursiveLeastSquares[Narx]
    detector: ChangeDetector | None = None
    adapts: bool = True
    model: Model | None = None

    def start(self, state: RecursiveState | None = None) -> Tracking:
        """The state before the first sample, perhaps with an earlier state of the recursion."""
        begun = self.recursion.start() if state is None else state.cut()
        return Tracking(begun, np.zeros(0) if self.detector is None else self.detector.start())

    def cut(self, tracking: Tracking) -> Tracking:
        """The state for samples that come after a gap."""
        return replace(tracking, state=tracking.state.cut(), before=float("nan"), model=None, model_output=float("nan"))

    def advance(self, tracking: Tracking, record: Record) -> tuple[Tracking, list[Change], Array]:
        """The state after further samples without a gap, the changes in them, and (N,) the predictions.

        Args:
            tracking: the state before them.
            record: the samples, of one segment.

        Raises:
            DataError: where the recursion overflows, or for channels other than before.
        """
        changes: list[Change] = []
        predictions = np.full(len(record), np.nan)
        first = 0
        while first < len(record):
            piece = record[first:]
            residuals: list[Array] = []
            state = self.recursion.update(tracking.state, piece, residuals=residuals)
            errors = np.concatenate([np.empty((0, 3)), *residuals])
            alarm, detection = None, tracking.detection
            if self.detector is not None and len(errors) and state.idle < len(errors):
                measured = piece.output[len(piece) - len(errors) :, 0].copy()
                with border("detection of changes"):
                    errors_of, spread = errors[:, 0].copy(), 1.0 + errors[:, 2]
                    detection, alarm = self.detector.update(detection, errors_of, spread, measured)
            if alarm is not None:  # again up to the alarm, and on from there with less weight of the past
                begin = len(piece) - len(errors)
                piece, errors = piece[: begin + alarm.index + 1], errors[: alarm.index + 1]
                state = self._reacted(self.recursion.update(tracking.state, piece, residuals=[]))
                now = float(piece.time[-1])
                changes.append(Change(now, now - alarm.since * piece.dt, alarm.kind))
            stop = first + len(piece)
            predictions[stop - len(errors) : stop] = record.output[stop - len(errors) : stop, 0] - errors[:, 0]
            tracking = self._counted(replace(tracking, state=state, detection=detection), piece, errors[:, 0])
            first = stop
        with border("free run of the fixed model"):
            tracking = self._modelled(tracking, record)
        return replace(tracking, prediction=float(predictions[-1])), changes, predictions

    def fit(self, tracking: Tracking) -> Fit[Narx] | None:
        """The present estimate as a fit; None before the first sample."""
        return None if tracking.last is None else self.recursion.fit(tracking.state, tracking.last)

    def half_widths(self, tracking: Tracking) -> Array:
        """(n,) half the width of the 95 % interval of every parameter; NaN where it is not known."""
        with np.errstate(invalid="ignore"):
            spread: Array = HALF_WIDTH * np.sqrt(np.diag(self.recursion.covariance(tracking.state)))
        return spread

    def physical(self, tracking: Tracking) -> tuple[Physical, ...]:
        """Gain, time constants and level of friction of the present estimate, for structures with one input."""
        return tried("physical values", lambda: self._physical(tracking), ())

    def _physical(self, tracking: Tracking) -> tuple[Physical, ...]:
        fit, last = self.fit(tracking), tracking.last
        if fit is None or last is None or last.input.shape[1] != 1 or not np.isfinite(fit.estimate).all():
            return ()
        span = np.array([tracking.lowest, tracking.highest])
        like = replace(last, input=span, output=np.zeros((2, 1)), times=())
        with np.errstate(all="ignore"):
            figures = of_regression(fit, like)
        return tuple(
            Physical(
                figure.name,
                figure.value,
                figure.unit,
                None
                if figure.standard_error is None or not isfinite(figure.standard_error)
                else HALF_WIDTH * figure.standard_error,
            )
            for figure in figures
            if isfinite(figure.value)
        )

    def _reacted(self, state: RecursiveState) -> RecursiveState:
        """The state after a change: the past keeps the weight of a few samples."""
        kept = KEPT * len(state.estimate)
        if not self.adapts or state.samples <= kept:
            return state
        return self.recursion.forget(state, kept / state.samples)

    def _counted(self, tracking: Tracking, piece: Record, errors: Array) -> Tracking:
        """The state with the counts and sums of a piece."""
        pairs = np.concatenate([[tracking.before], errors])
        products = float(np.nansum(pairs[1:] * pairs[:-1]))
        return replace(
            tracking,
            samples=tracking.samples + len(piece),
            lowest=np.minimum(tracking.lowest, piece.input.min(axis=0)),
            highest=np.maximum(tracking.highest, piece.input.max(axis=0)),
            last=piece[len(piece) - 1 :],
            squares=tracking.squares + float(errors @ errors),
            products=tracking.products + products,
            before=float(pairs[-1]),
        )

    def _modelled(self, tracking: Tracking, record: Record) -> Tracking:
        """The fixed model after the same samples: its free run from its first samples on."""
        model, state = self.model, tracking.model
        if model is None:
            return tracking
        if state is None or isinstance(state, Record):
            seen = continuing(state, record)
            need = max(model.memory, 1)
            if len(seen) <= need:
                return replace(tracking, model=seen)
            state, record = model.initial(seen, need), seen[need:]
        outputs, state = model.run(state, record.input)
        return replace(tracking, model=state, model_output=float(outputs[-1, 0]))
