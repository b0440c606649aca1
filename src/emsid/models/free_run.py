"""The free run of a model over a record: segments, initial state, transient and divergence.

Every segment is run on its own. With measured outputs, its first samples give the initial state (`Model.initial`);
after them the model sees only the input, and they enter no error. A segment whose preceding samples are known
(`Record.part`) is run with these: their first samples give the state, the run goes on through the segment, and all of
its samples count. A segment that begins at rest (`begins_at_rest`) or
in a steady state (`begins_steady`) was in that state before. There the first sample, repeated, gives the initial state,
and all samples count. Without outputs, a segment starts at rest with zero input; `Model.at_rest` and `Model.run` allow
another constant input before the start.

A run has diverged if it is `RUNAWAY` times larger than the measured output. If that is constant, as for a motor at
standstill, or missing, only a run that is not finite has diverged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.arguments import did_you_mean
from emsid.errors import DataError, ModelError, some
from emsid.models.model import Model, Run, check_samples
from emsid.record import Record

Array = NDArray[np.float64]

# A free run has diverged if it is this many times larger than the measured output.
RUNAWAY = 1e3
# Sample times that differ by a smaller fraction count as equal.
SAME_DT = 1e-3
# The fewest equal samples that show rest.
RESTING = 3


def free_run(model: Model, record: Record, transient: int | None = None) -> Run:
    """The output of a model over a record, from its inputs alone after the start of every segment.

    Args:
        model: any model.
        record: with the channels of the model; without outputs, every segment starts at rest.
        transient: samples at the start of every segment in motion that give its initial state and are left out of
            errors; at least `Model.memory`, which is the default.

    Raises:
        ModelError: for a record with other channels or another sample time, or without a segment longer than the
            transient.
    """

    def run(segment: Record, samples: int) -> Array:
        if segment.output.shape[1]:
            return continued(model, model.initial(segment, samples), segment, samples)
        return continued(model, model.at_rest(0.0, segment.dt), segment, 0)

    return _over_segments(model, record, transient, run)


def predict(model: Model, record: Record, horizon: int = 1, transient: int | None = None) -> Run:
    """ŷ(t | t − horizon) of a model over a record with measured outputs.

    Args:
        model: any model.
        record: with the channels of the model.
        horizon: the number of samples ahead, at least one.
        transient: as in `free_run`.

    Raises:
        ModelError: as `free_run` does.
        DataError: for a record without outputs.
    """
    check_samples(model.name, "a horizon", horizon, 1)
    if not record.output.shape[1]:
        raise DataError(f"{record.name} has no output to predict ahead from; simulate it")
    return _over_segments(model, record, transient, lambda segment, samples: model.ahead(segment, samples, horizon))


class Named(Protocol):
    """A model whose parameters have names."""

    @property
    def name(self) -> str:
        """Its name in messages."""
        ...

    def parameter_values(self) -> dict[str, float]:
        """The value of every parameter by name."""
        ...

    def with_estimates(self, names: Sequence[str], values: Array) -> Any:
        """The same model with other values of some parameters, by name."""
        ...


class RunMethods:
    """`simulate`, `predict` and `ahead` of a model, for a class that has the rest of `emsid.models.model.Model`.

    A model prints as its equations.
    """

    def __str__(self: Model) -> str:
        return self.equation()

    def __repr__(self: Named) -> str:
        count = len(self.parameter_values())
        return f"{type(self).__name__}({self.name}: {count} parameter{'s' * (count != 1)})"

    def with_parameters(self: Named, **values: float) -> Any:
        """The same model with other values of some parameters, by name: ``model.with_parameters(resistance=1.2)``.

        Args:
            values: by name, in the unit of each parameter. A name with a point in it is given as
                ``**{"dead_zone.half_width": 0.3}``.

        Raises:
            ModelError: for an unknown name, with the known ones, or values of a model that cannot be run.
        """
        known = self.parameter_values()
        for name in values:
            if name not in known:
                near = did_you_mean(name, known)
                raise ModelError(f"{self.name} has no parameter {name!r}; it has {some(known)}{near}")
        return self.with_estimates(tuple(values), np.array(list(values.values()), dtype=float))

    def simulate(
        self: Model, record: Record | ArrayLike, transient: int | None = None, *, dt: float | None = None
    ) -> Run:
        """Free run over every segment; measured outputs are used only to estimate the initial state.

        Args:
            record: a record, or inputs (N,) or (N, nu) alone, which start at rest.
            transient: samples that start a segment in motion, at least `memory`, which is the default.
            dt: sample time in s of inputs alone, for models that have none of their own.

        Raises:
            ModelError: for a record of other channels, or without a segment longer than the transient.
        """
        return free_run(self, as_record(self, record, dt), transient)

    def predict(self: Model, record: Record, horizon: int = 1, transient: int | None = None) -> Run:
        """ŷ(t | t − horizon), the output ``horizon`` samples ahead of the last measured one that is used; see `ahead`.

        Raises:
            ModelError: as `simulate` does.
            DataError: for a record without outputs.
        """
        return predict(self, record, horizon, transient)

    def ahead(self: Model, segment: Record, samples: int, horizon: int) -> Array:
        """The free run: with noise on the output only, past outputs do not help to predict the next."""
        return continued(self, self.initial(segment, samples), segment, samples)


def mean_squared_error(measured: Array, modelled: Array) -> float:
    """MSE = (1/N) Σ (y − ŷ)², eq. (5.14), over all channels; infinite for a run that diverged.

    Args:
        measured: (N, ny) y.
        modelled: (N, ny) ŷ.
    """
    error = measured - modelled
    return float(np.mean(error**2)) if np.isfinite(error).all() else float("inf")


def squared_errors(model: Model, records: Iterable[Record], transient: int | None = None) -> Array:
    """(N,) the squared free-run error of every sample of all records, the mean over their outputs.

    Args:
        model: any model.
        records: with the channels of the model.
        transient: as in `free_run`.

    Returns:
        NaN for samples of a transient, and infinity from where a run diverges.

    Raises:
        ModelError: as `free_run` does.
    """
    found = []
    for record in records:
        run = free_run(model, record, transient)
        squares = np.mean((record.output - run.output) ** 2, axis=1)
        squares[~np.isfinite(squares)] = np.inf
        found.append(np.where(run.counted, squares, np.nan))
    return np.concatenate(found)


def free_run_error(model: Model, records: Iterable[Record], transient: int | None = None) -> float:
    """The mean squared error of the free run over all records after their transients; infinite without samples.

    Args:
        model: any model.
        records: with the channels of the model.
        transient: as in `free_run`.

    Raises:
        ModelError: as `free_run` does.
    """
    squares = squared_errors(model, records, transient)
    counted = squares[~np.isnan(squares)]
    return float(np.mean(counted)) if counted.size else float("inf")


def as_record(model: Model, data: Record | ArrayLike, dt: float | None = None) -> Record:
    """A record unchanged, or inputs (N,) or (N, nu) as a record without outputs.

    Args:
        model: its sample time is the default.
        data: a record or inputs.
        dt: sample time in s.

    Raises:
        ModelError: for inputs without a sample time.
    """
    if isinstance(data, Record):
        return data
    step = model.dt if dt is None else dt
    if step is None:
        raise ModelError(f"{model.name} runs at any sample time; give that of the inputs, dt=… in s", arguments=("dt",))
    inputs = np.asarray(data)
    return Record(inputs, np.empty((len(inputs) if inputs.ndim else 0, 0)), step, name="input")


def check_sample_time(model: Model, record: Record) -> None:
    """Refuse a record with another sample time than the model, if the model has one.

    Raises:
        ModelError: with both sample times.
    """
    if model.dt is not None and not np.isclose(model.dt, record.dt, rtol=SAME_DT, atol=0.0):
        raise ModelError(
            f"{model.name} was identified at {model.dt:g} s and {record.name} is sampled every {record.dt:g} s; "
            f"resample the record to {model.dt:g} s",
            arguments=("resample", "dt"),
        )


def continued(model: Model, state: object, segment: Record, samples: int) -> Array:
    """(N − samples, ny) the outputs of a segment from sample ``samples`` on, where the model is in this state.

    For a model that interpolates its input, the input is continued point-symmetrically beyond its end.
    """
    inputs, late = segment.input, model.latency
    rest = inputs[samples:]
    if late:
        tail = 2 * inputs[-1] - inputs[-1 - late : -1][::-1] if len(inputs) > late else np.repeat(inputs[-1:], late, 0)
        rest = np.concatenate([rest, tail])
    return model.run(state, rest)[0][late:]


def begins_at_rest(segment: Record) -> bool:
    """Whether a segment begins at rest, without an input.

    Its first inputs, at least `RESTING` of them, are exactly zero, and its outputs are exactly equal meanwhile.
    """
    driven, moved = _until_change(segment.input), _until_change(segment.output)
    return RESTING <= driven <= moved and not segment.input[0].any()


def begins_steady(segment: Record, samples: int) -> bool:
    """Whether a segment begins in a steady state, for this many samples and at least `RESTING`.

    Its first inputs and outputs are exactly equal, and the input changes before the output does. The input need not be
    zero: some drives have another neutral command. Further samples of this kind would give the same initial state.
    """
    driven, moved = _until_change(segment.input), _until_change(segment.output)
    return max(samples, RESTING) <= driven <= moved and driven < len(segment)


def _until_change(values: Array) -> int:
    """How many of the first values (N, n) are all exactly equal."""
    changed = (values != values[:1]).any(axis=1)
    return int(changed.argmax()) if changed.any() else len(values)


def from_rest(segment: Record, samples: int) -> Record:
    """A segment with what is known before it, whose first ``samples`` samples start a model and enter no error.

    A segment in motion is that itself, behind the samples right before it. Before one that begins at rest or in a
    steady state, its first sample is repeated ``samples`` times.
    """
    lead = segment.before[0] if segment.before else None
    if lead is not None:
        segment = replace(
            segment,
            input=np.concatenate([lead.input, segment.input]),
            output=np.concatenate([lead.output, segment.output]),
            times=lead.times,
            before=(),
        )
    if not (samples and (begins_at_rest(segment) or begins_steady(segment, samples))):
        return segment
    both = ((samples, 0), (0, 0))
    return replace(
        segment,
        input=np.pad(segment.input, both, mode="edge"),
        output=np.pad(segment.output, both, mode="edge"),
        times=(segment.times[0] - samples * segment.dt,),
    )


def _over_segments(
    model: Model, record: Record, transient: int | None, values_of: Callable[[Record, int], Array]
) -> Run:
    """A run of ``values_of(segment, samples)`` over every segment, `from_rest`, that is longer than its transient."""
    model.check_record(record)
    check_sample_time(model, record)
    check_samples(model.name, "a transient", transient, 0)
    measured = bool(record.output.shape[1])
    least = model.memory if measured else 0
    start, segments = max(least, transient or 0), record.segments
    begun = [from_rest(segment, start) if measured else segment for segment in segments]
    if all(len(segment) <= least for segment in begun):
        raise ModelError(
            f"{record.name}: no segment is longer than the {least} samples that start {model.name}; record longer, "
            "leave out less, or choose a model of smaller order"
        )
    bound, diverged_at, first = _bound(record.output), None, 0
    output = record.output.copy() if measured else None
    counted = np.zeros(len(record), dtype=bool)
    for segment, whole in zip(segments, begun, strict=True):
        stop = first + len(segment)
        if not measured or len(whole) > start:
            with np.errstate(all="ignore"):  # of a run that diverges, which is found below
                values = values_of(whole, start)
            lost = _first_beyond(values, bound)
            if lost is not None:
                values[lost:] = np.nan
                diverged_at = max(stop - len(values) + lost, first) if diverged_at is None else diverged_at
            values = values[-len(segment) :]
            if output is None:
                output = np.zeros((len(record), values.shape[1]))
            output[stop - len(values) : stop] = values
            counted[stop - len(values) if measured else first + start : stop] = True
        first = stop
    return Run(np.zeros((len(record), 0)) if output is None else output, counted, diverged_at)


def _bound(output: Array) -> float:
    """The limit of a free run, given the measured output (N, ny)."""
    if not output.size:
        return float(np.finfo(float).max)
    low, high = output.min(axis=0), output.max(axis=0)
    moves = bool((high > low).any())
    return RUNAWAY * float(np.maximum(-low, high).max()) if moves else float(np.finfo(float).max)


def _first_beyond(values: Array, bound: float) -> int | None:
    """The first row outside ±bound, if any."""
    if values.max(initial=0.0) <= bound and values.min(initial=0.0) >= -bound:  # false for NaN
        return None
    return int(np.flatnonzero(~(np.abs(values) <= bound).all(axis=1))[0])
