"""Feedback models as candidates of a choice: how they are fitted to some data and judged on other data.

Of two models the richer one is chosen if it is better by more than noise (`emsid.selection.improvement`). A model whose
free run leaves the measured range by far on an input a little larger than that of the record, forward or backward in
time, or while the largest or the smallest input is held, is not chosen.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.estimation.uncertainty.coloured_residuals import autoregression, effective_samples
from emsid.models.blocks.search.map_families import Family
from emsid.models.extrapolation import FAR, HELD, LARGER, leaves_range
from emsid.models.feedback.fitting import Found, Refusal, searched
from emsid.models.feedback.kernels import LoopSignals
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.directions import KEPT, Direction, directions_for
from emsid.models.feedback.search.starts import linear_start
from emsid.models.free_run import RUNAWAY, squared_errors
from emsid.models.initial_states import initial_state
from emsid.models.one_channel import Segments, segments_longer_than
from emsid.models.terms import check_whole
from emsid.record import Record
from emsid.record.holding_back import FOLDS, excerpt, stretches_in_turn, validation_splits
from emsid.selection.improvement import STRETCHES, StretchErrors, better, matters, schwarz_gain

Array = NDArray[np.float64]

# Samples that choices are made from, and of the unseen data.
SEARCHED, JUDGED = 6_000, 8_000
# Orders that are tried if none is given, the highest one, and the longest delay in samples.
ORDERS, MOST_ORDERS, LONGEST = (1, 2, 3), 6, 5
# A model whose error on the fitted data is larger than that of another one by this factor is not tried with lower
# orders, more steps or a sensor.
MUCH_WORSE = 2.0
# Limits of what may be given: a search for more takes hours, and no record determines so much.
LARGEST_ORDER, LARGEST_SIZE, LARGEST_STEPS = 12, 100, 64
# The largest number of static maps.
MOST_MAPS = 6
# The number of models that a map is added to, and of those with it that are refined to the end. The first maps of a
# model stand for several of the true ones; which of them can become the true ones shows when these are complete.
BEAM = 3
# Steps of a refinement for a choice.
ITERATIONS = 40
# A short record of fewer samples for every parameter of a model is divided into parts that are left out once; steps of
# each refit, and the relative reduction of the cost over a few of them below which it ends.
PER_PARAMETER, REFITTED, SAVING = 10, 15, 1e-3
# The fewest samples for every parameter of a richer model: with fewer, what the parameters take from noise alone
# makes the mean square error on other data 1.5 times that on the fitted ones, or more.
FEWEST = 5


# A model is of use if its free run from estimated initial states errs by at most this factor more than that of the fit.
OF_USE = 1.5
# The options of the command line whose name is another one.
_OPTIONS = {"order": "orders", "size": "knots", "delay": "nk"}


@dataclass(frozen=True, eq=False)
class FeedbackSearch:
    """Options of the identification of a feedback model; options that are None are chosen on unseen data.

    Attributes:
        order: of the linear part.
        maps: the number of static maps, one to six.
        static: the family of the maps.
        size: their number of knots, or degree; 0 for the usual one of the family.
        delay: from the input to its first effect, in samples.
        oversampling: steps of the model per sample.
        held: whether the input is held between its samples, or continuous.
        held_back: fraction of the record that choices are made on.
        linear_delay: a longer delay than the usual ones, which linear models of the record show; it is tried too.

    Raises:
        ModelError: for numbers outside their limits, a size of maps that have none, or a class of maps that have no
            start from data.
    """

    order: int | None = None
    maps: int | None = None
    static: Family | None = None
    size: int = 0
    delay: int | None = None
    oversampling: int | None = None
    held: bool | None = None
    held_back: float = 0.25
    linear_delay: int = 0

    def __post_init__(self) -> None:
        for what, value, least, most, why in (
            ("order", self.order, 0, LARGEST_ORDER, "orders count states"),
            ("size", self.size, 0, LARGEST_SIZE, "this is a number of knots, or a degree"),
            ("maps", self.maps, 1, MOST_MAPS, "this is the number of static maps"),
            ("delay", self.delay, 0, None, "a model cannot look ahead"),
            ("oversampling", self.oversampling, 1, LARGEST_STEPS, "the model makes at least one step per sample"),
        ):
            if value is not None:
                option = (_OPTIONS[what],) if what in _OPTIONS else ()
                check_whole(f"feedback: {what}", value, least, why, most, option)
        if self.held is not None and not isinstance(self.held, bool):
            raise ModelError(f"feedback: held {self.held!r}; give True, False, or None to try both")
        self._check_maps()

    def _check_maps(self) -> None:
        """Refuse a size of maps that have none, and maps that cannot be begun.

        Raises:
            ModelError: with the map.
        """
        if self.static is None:
            if self.size:
                raise ModelError(f"feedback: size {self.size} without a static map; give its name, such as 'spline'")
            return
        name = self.static.name
        if self.size and not self.static.sizes:
            raise ModelError(
                f"feedback: size {self.size} of a {name} map, which has one size; leave it out", arguments=("knots",)
            )
        x = np.linspace(-1.0, 1.0, 5 * LARGEST_SIZE)
        try:
            self.static.start(x, x**3, self.size or next(iter(self.static.sizes), 0))
        except ModelError as problem:
            options = ("knots",) if self.size else ("static",)
            raise ModelError(f"feedback: {problem}", arguments=options) from None

    @property
    def holds(self) -> tuple[bool, ...]:
        """What is tried: whether the input is held between its samples."""
        return (False, True) if self.held is None else (self.held,)

    @property
    def longest(self) -> int:
        """The longest delay that may be chosen, in samples."""
        return max(LONGEST, self.linear_delay) if self.delay is None else self.delay


class Steps(NamedTuple):
    """The steps of a model per sample, and whether its input is held over them."""

    number: int
    held: bool


@dataclass(frozen=True, eq=False)
class Trial:
    """A model fitted to the data that the search sees, and its errors on unseen data."""

    found: Found
    errors: StretchErrors
    family: Family
    size: int

    @property
    def loses_sign(self) -> bool:
        """Whether the first map is that of a sensor which loses the sign."""
        maps = self.found.model.maps
        return bool(maps) and maps[0].loses_sign

    @property
    def parameters(self) -> int:
        """How many parameters and initial states the data determine, with a delay; a penalty determines the others."""
        minimum = self.found.minimum
        used = minimum.samples - round(sum(float(r @ r) for r in minimum.residuals) / minimum.noise_variance)
        return used + bool(self.found.model.delay)

    @property
    def prediction_error(self) -> float:
        """Akaike's final prediction error, the mean square to be expected on other data of the same kind."""
        samples, count = self.found.minimum.samples, self.parameters
        return self.found.error**2 * (samples + count) / max(samples - count, 1)


def much_worse(trial: Trial, best: Trial) -> bool:
    """Whether the error on the fitted data is far larger."""
    return trial.found.error > MUCH_WORSE * best.found.error


@dataclass(frozen=True, eq=False)
class SearchData:
    """The data that the choices are made from.

    Attributes:
        fitted: the records that models are fitted to.
        unseen: records that compare them; the same as ``fitted`` where they are short.
        transient: samples at the start of every unseen segment without error, the same for all models.
        control: when to stop.
        rng: for directions.
        linear_models: those that were fitted, by order, steps and delay.
        folds: the errors on parts that are left out, by the identity of the trial.
        maps_more: the directions in which a map more explains what a model misses, by its identity, whether the map is
            multiplied by a signal, and how many are kept.
    """

    fitted: Sequence[Record]
    unseen: Sequence[Record]
    transient: int
    control: Control = FREE
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    linear_models: dict[tuple[int, Steps, int], Found] = field(default_factory=dict)
    folds: dict[int, tuple[Trial, StretchErrors]] = field(default_factory=dict)
    maps_more: dict[tuple[int, bool, int], tuple[Found, list[Direction]]] = field(default_factory=dict)

    @classmethod
    def of(cls, records: Sequence[Record], settings: FeedbackSearch, control: Control) -> SearchData:
        """The data of the records; long ones are searched in pieces."""
        fitted, splits = validation_splits(records, settings.held_back)
        unseen: Sequence[Record] = fitted
        if len(splits) == 1:
            unseen = [excerpt(record, JUDGED // len(records)) for record in splits[0][1]]
            fitted = [excerpt(record, max(SEARCHED // len(records), 1)) for record in fitted]
        largest = FeedbackModel(
            np.zeros(((settings.order or MOST_ORDERS) + 1,) * 2),
            delay=settings.longest,
            oversampling=settings.oversampling or 2,
        )
        shortest = max(len(segment) for record in unseen for segment in record.segments)
        return cls(fitted, unseen, min(largest.memory, shortest // 3), control)

    @property
    def compared(self) -> bool:
        """Whether models are compared on unseen data; those of a short record are compared on all of it."""
        return self.unseen is not self.fitted

    def suffices(self, trial: Trial) -> bool:
        """Whether there are samples enough for the parameters of a model."""
        return trial.found.minimum.samples >= FEWEST * trial.parameters

    def determines(self, trial: Trial) -> bool:
        """Whether there are so many samples that the fitted data alone show how good a model is.

        Before a sensor that loses the sign they never do, as states of either sign may fit.
        """
        return trial.found.model.sensor is None and trial.found.minimum.samples >= PER_PARAMETER * trial.parameters

    def segments(self, model: FeedbackModel) -> Segments:
        """(u, y) of the data that models are fitted to."""
        return segments_longer_than(model.memory, model, self.fitted)

    def linear(self, order: int, steps: Steps, delay: int) -> Found:
        """The linear model of this order, fitted once.

        Raises:
            ModelError: where none can be fitted.
        """
        found = self.linear_models.get((order, steps, delay))
        if found is None:
            start = linear_start(self.fitted, order, steps.number, delay, steps.held, self.control)
            found = searched(start, self.segments(start), start.edge, 20, 0.1, self.control)
            self.linear_models[order, steps, delay] = found
        return found

    def directions(self, found: Found, multiplied: bool = False, kept: int = KEPT) -> list[Direction]:
        """The directions of a map more, the best first.

        Raises:
            Stopped: by the control.
        """
        key = id(found), multiplied, kept
        if key not in self.maps_more:
            self.control.check()
            segments, edge = self.segments(found.model), found.model.edge
            self.maps_more[key] = found, directions_for(found, segments, edge, self.rng, multiplied, kept)
        return self.maps_more[key][1]

    def more_than_noise(self, found: Found) -> bool:
        """Whether a map more explains more than noise."""
        directions = self.directions(found)
        return bool(directions) and directions[0].explains(found.minimum.samples)

    def leaves_noise(self, trial: Trial) -> bool:
        """Whether a model leaves white noise, of which a map more explains no more than chance."""
        polynomial, _ = autoregression(trial.found.minimum.residuals)
        return len(polynomial) == 1 and not self.more_than_noise(trial.found)

    def refined(self, model: FeedbackModel, states: Sequence[Array] | None, family: Family, size: int) -> Trial:
        """A model fitted from a start, and from its initial states if they are known.

        Raises:
            ModelError: where its run diverges.
        """
        saving = SAVING if self.compared else 0.0  # short records take little time, and a valley is less visible
        segments, refused = self.segments(model), refusal(model)
        found = searched(model, segments, model.edge, ITERATIONS, 0.1, self.control, saving, states, refused=refused)
        return self.judged(found, family, size)

    def judged(self, found: Found, family: Family, size: int) -> Trial:
        """The errors of a model; infinite where it runs away on a larger input."""
        squares = np.full(STRETCHES, np.inf)
        with suppress(EmsidError):
            if not runs_away(found.model, self.segments(found.model), found.states):
                squares = squared_errors(found.model, self.unseen, self.transient)
        return Trial(found, StretchErrors.of(squares), family, size)

    def prefers(self, trial: Trial, best: Trial) -> bool:
        """Whether a trial replaces the best one.

        Of two models the richer one is chosen if it is better on unseen data by more than noise. It is also chosen by
        Schwarz's criterion on the fitted data, for the number of independent errors, if it is better on unseen data
        too. In a short record no part shows all that the whole does, so that criterion alone decides, on the free run
        from the state that the first samples show; where it counts too few samples for every parameter, the errors on
        parts that are left out decide whether it may, if its error is smaller and there are samples enough for it.

        Args:
            trial: the new one.
            best: the one before.
        """
        if not (np.isfinite(trial.errors.mean) and np.isfinite(best.errors.mean)):
            return bool(np.isfinite(trial.errors.mean))
        richer = trial.parameters > best.parameters
        simple, rich = (best, trial) if richer else (trial, best)
        minimum, extra = rich.found.minimum, rich.parameters - simple.parameters
        compared = self.compared
        error, than = (each.found.error**2 if compared else each.errors.mean for each in (rich, simple))
        gain = schwarz_gain(error, than, effective_samples(minimum.residuals), extra)
        if compared:
            wins = better(rich.errors, simple.errors) or (gain > 0 and rich.errors.mean < simple.errors.mean)
        elif extra and not self.determines(rich):
            wins = (
                self.suffices(rich) and error < than and matters(self.left_out(rich).mean, self.left_out(simple).mean)
            )
        else:
            wins = gain > 0
        return wins if richer else not wins

    def left_out(self, trial: Trial) -> StretchErrors:
        """The errors of a model on the parts of a short record, each of which is left out of a fit once.

        The run goes on through the part: a model that begins anew in it would be judged by how well its first samples
        show its state, and those of a sensor that loses the sign fit states of either sign.
        """
        key = id(trial)
        if key not in self.folds:
            found, edge = trial.found, trial.found.model.edge
            segments, control, parts = self.segments(found.model), self.control.quietly(), list[StretchErrors]()
            for out in stretches_in_turn([len(y) for _, y in segments], FOLDS, STRETCHES, found.model.memory):
                squares = np.full(1, np.inf)
                with suppress(EmsidError):
                    now = searched(
                        found.model, segments, edge, REFITTED, 0.2, control, SAVING, found.states, left_out=out
                    )
                    ended = zip(segments, now.states, out, strict=True)
                    errors = np.concatenate([(now.model.output(u, x) - y)[gone] for (u, y), x, gone in ended])
                    with np.errstate(over="ignore"):
                        squares = errors**2
                parts.append(StretchErrors.of(squares, STRETCHES // FOLDS))
            self.folds[key] = trial, StretchErrors.joined(parts)
        return self.folds[key][1]


def runs_away(model: FeedbackModel, segments: Segments, states: Sequence[Array]) -> bool:
    """Whether the free run leaves the range of the measured output by far on an input that no fit has seen.

    It is that of every segment, larger by the factor `LARGER` about its middle, and then the same backward in time. In
    the end the largest and the smallest input are held. The output of a plant that integrates leaves the range there,
    so a run has to leave it much farther.

    Args:
        model: with its parameters.
        segments: (u, y) of each.
        states: (n,) at the start of each.
    """
    low, high = _range(segments, 1)
    for run in larger_runs(model, segments, states):
        if leaves_range(run.y[:: model.oversampling], low, high, FAR):
            return True
    now = run.x[-1]
    for end in reversed(_range(segments, 0)):
        run, now = model.stepped(model.entering(np.full(HELD, end)), now)
        if leaves_range(run.y[:: model.oversampling], low, high, RUNAWAY):
            return True
    return False


def refusal(model: FeedbackModel) -> Refusal | None:
    """What a search keeps away from: before a sensor, models that run away.

    There few samples determine the edges of a map, as the sensor hides where they lie, and most models that follow the
    record would run away.
    """
    return None if model.sensor is None else runs_away


def error_of_use(model: FeedbackModel, segments: Segments) -> float:
    """The free-run error from the states that the first samples show; infinite for a model that runs away.

    A fit knows the initial states, but a user does not. A model with slow states that hardly show in the output may fit
    all data from the former, and miss them from the latter.
    """
    states = [initial_state(model, u, y[: model.memory]) for u, y in segments]
    try:
        if runs_away(model, segments, states):
            return inf
        errors = [model.output(u, x) - y for (u, y), x in zip(segments, states, strict=True)]
    except Infeasible:
        return inf
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def larger_runs(model: FeedbackModel, segments: Segments, states: Sequence[Array]) -> Iterator[LoopSignals]:
    """The runs over the input of every segment, larger by the factor `LARGER` about its middle, and then backward.

    Args:
        model: with its parameters.
        segments: (u, y) of each.
        states: (n,) at the start of each.
    """
    middle = 0.5 * sum(_range(segments, 0))
    for (u, _), x in zip(segments, states, strict=True):
        larger, now = u + (LARGER - 1) * (u - middle), x
        for v in (larger, larger[::-1]):
            run, now = model.stepped(model.entering(v), now)
            yield run


def _range(segments: Segments, channel: int) -> tuple[float, float]:
    """The least and the largest value of the input (0) or the output (1) of all segments."""
    return min(float(each[channel].min()) for each in segments), max(float(each[channel].max()) for each in segments)
