"""Choice of order, rate, static maps and their number by the free run on unseen data.

From simple to complex, each choice must be better by more than noise (`emsid.selection.improvement`):

1. for every order, and a delay if linear models gain by it, a linear model and one map in the direction that explains
   most: a polynomial, or else a spline or a dead zone;
   for an output that shows magnitudes only, also a model before a sensor that loses the sign (`magnitudes`);
2. with the best order, twice the rate, for an input that goes on between its samples;
3. other families of maps;
4. a second map, and then a third one.

If no direction of a map explains more than noise, only linear models are fitted; if a linear model is as good as the
best one with a map, the search ends after the first step with a map at this linear model. A model whose free run
diverges on an input a little larger than that of the record, forward or backward in time, is not chosen.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.blocks.search.map_families import Family, family_of
from emsid.models.feedback.fitting import Found, searched, visited
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.magnitudes import BEHIND, KNOTS, MAGNITUDE, may_be_magnitudes, of_magnitudes
from emsid.models.feedback.search.starts import Direction, directions_for, linear_start, with_one_map_more
from emsid.models.free_run import squared_errors
from emsid.models.one_channel import Segments, segments_longer_than
from emsid.models.regression.search.judge import BEYOND, diverges, enlarged
from emsid.record import Record
from emsid.record.excerpt import excerpt
from emsid.record.holding_back import validation_splits
from emsid.selection.improvement import STRETCHES, StretchErrors, better, matters, schwarz_gain

Array = NDArray[np.float64]

# Orders that are tried, if none is given.
ORDERS = (1, 2, 3)
# Samples that choices are made from, and of the unseen data.
SEARCHED, JUDGED = 6_000, 8_000
# The highest order, and the longest delay in samples, that are tried if none is given; the order of the linear models
# that show a delay.
MOST_ORDERS, LONGEST, OF_DELAY = 6, 5, 2
# A second or third map takes at least this many samples for every knot, or degree.
PER_KNOT = 20
# Steps of a refinement for a choice.
STEPS = 40
# The maps that every order is tried with, until one is better than none, and families and sizes that are tried then;
# those of a third map.
FIRST = (("polynomial", 3), ("spline", 0), ("dead-zone", 0))
OTHERS = (("polynomial", 5), ("spline", 0), ("monotone-spline", 0), ("dead-zone", 0), ("saturation", 0))
THIRD = (("polynomial", 3), ("dead-zone", 0), ("saturation", 0))
ORDINALS = {2: "second", 3: "third"}


@dataclass(frozen=True, eq=False)
class FeedbackSearch:
    """Options of the identification of a feedback model; options that are None are chosen on unseen data.

    Attributes:
        order: of the linear part.
        maps: the number of static maps, one to three.
        static: the family of the maps.
        size: their number of knots, or degree; 0 for the usual one of the family.
        delay: from the input to its first effect, in samples.
        oversampling: steps of the model per sample.
        held: whether the input is held between its samples, or goes on.
        held_back: fraction of the record that choices are made on.
    """

    order: int | None = None
    maps: int | None = None
    static: Family | None = None
    size: int = 0
    delay: int | None = None
    oversampling: int | None = None
    held: bool | None = None
    held_back: float = 0.25


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
    def parameters(self) -> int:
        """How many parameters and initial states the data determine; a penalty determines the others."""
        minimum = self.found.minimum
        return minimum.samples - round(sum(float(r @ r) for r in minimum.residuals) / minimum.noise_variance)


@dataclass(frozen=True, eq=False)
class Bench:
    """The data that the choices are made from.

    Attributes:
        shown: the records that models are fitted to.
        unseen: records that compare them; the same as ``shown`` where they are short.
        transient: samples at the start of every unseen segment without error, the same for all models.
        control: when to stop.
        rng: for directions.
        linear: the linear models that were fitted, by order, steps and delay.
    """

    shown: Sequence[Record]
    unseen: Sequence[Record]
    transient: int
    control: Control = FREE
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    linear: dict[tuple[int, Steps, int], Found] = field(default_factory=dict)

    @classmethod
    def of(cls, records: Sequence[Record], settings: FeedbackSearch, control: Control) -> Bench:
        """The data of the records; long ones are searched in pieces."""
        shown, splits = validation_splits(records, settings.held_back)
        unseen: Sequence[Record] = shown
        if len(splits) == 1:
            unseen = [excerpt(record, JUDGED // len(records)) for record in splits[0][1]]
            shown = [excerpt(record, max(SEARCHED // len(records), 1)) for record in shown]
        largest = FeedbackModel(
            np.zeros(((settings.order or MOST_ORDERS) + 1,) * 2),
            delay=LONGEST if settings.delay is None else settings.delay,
            oversampling=settings.oversampling or 2,
        )
        shortest = max(len(segment) for record in unseen for segment in record.segments)
        return cls(shown, unseen, min(largest.memory, shortest // 3), control)

    @property
    def compared(self) -> bool:
        """Whether there are unseen data."""
        return self.unseen is not self.shown

    @cached_property
    def beyond(self) -> list[Record]:
        """Records that no model may diverge on."""
        return harder(self.shown)

    def segments(self, model: FeedbackModel) -> Segments:
        """(u, y) of the data that models are fitted to."""
        return segments_longer_than(model.memory, model, self.shown)

    def judged(self, found: Found, family: Family, size: int) -> Trial:
        """The errors of a model; infinite where it diverges on a larger input."""
        model = found.model
        try:
            far = any(diverges(model, record) for record in self.beyond)
            squares = np.full(STRETCHES, np.inf) if far else squared_errors(model, self.unseen, self.transient)
        except EmsidError:
            squares = np.full(STRETCHES, np.inf)
        return Trial(found, StretchErrors.of(squares), family, size)


def harder(records: Sequence[Record]) -> list[Record]:
    """The records with a larger input, forward and backward in time: an input of the same kind that no fit has seen."""
    backward = [replace(each, input=each.input[::-1], output=each.output[::-1]) for each in records]
    return [enlarged(record, BEYOND) for record in (*records, *backward)]


def chosen(records: Sequence[Record], settings: FeedbackSearch, control: Control) -> Iterator[Trial]:
    """Trials, each better than the one before; the last one is the choice.

    Raises:
        ModelError: if no feedback model can be fitted.
    """
    bench = Bench.of(records, settings, control)
    straight, best = _first_map(bench, settings)
    for trial in _of_magnitudes(bench, settings):
        if best is None or _preferred(trial, best, bench.compared):
            best = trial
    if best is None or not _preferred(best, straight, bench.compared):  # a linear model is as good
        family, size = _families(settings)[0]
        try:
            yield _with_map(bench, straight.found, family, size)
        except EmsidError:
            if best is None:
                raise
            yield best
        return
    yield best
    steps = (_second_map,) if best.family is MAGNITUDE else (_faster, _other_families, _second_map, _third_map)
    for step in steps:
        for trial in step(bench, best, settings):
            if _preferred(trial, best, bench.compared):
                best = trial
                yield best


def _first_map(bench: Bench, settings: FeedbackSearch) -> tuple[Trial, Trial | None]:
    """The best linear model over the orders, and the best one with a map; None where no map explains more than noise.

    Orders above those of `ORDERS` are tried as long as the highest one was the best.

    Raises:
        ModelError: if no linear model can be fitted.
    """
    given, families = settings.order, _families(settings)
    steps = Steps(settings.oversampling or 1, bool(settings.held))
    straight: Trial | None = None
    best: Trial | None = None
    problem: EmsidError = ModelError("feedback: no model of this record; check channels, units and delay")
    for delay in _delays(bench, settings, steps):
        for order in range(1, MOST_ORDERS + 1) if given is None else (given,):
            bench.control.doing(f"order {order}", order, max(ORDERS))
            try:
                linear = bench.judged(_linear(bench, order, steps, delay), *families[0])
                trial = _bent(bench, linear, families)
            except EmsidError as error:
                problem = error
                continue
            higher = False
            if straight is None or _preferred(linear, straight, bench.compared):
                straight, higher = linear, True
            against = straight if best is None else best
            if trial is not None and _preferred(trial, against, bench.compared):
                best, higher = trial, True
            if order >= max(ORDERS) and not higher:
                break
    if straight is None:
        raise problem
    return straight, best


def _of_magnitudes(bench: Bench, settings: FeedbackSearch) -> Iterator[Trial]:
    """Models of one step per sample whose output loses the sign, where that of the records may have."""
    if settings.static or settings.delay or (settings.oversampling or 1) > 1 or not may_be_magnitudes(bench.shown):
        return
    for order in ORDERS if settings.order is None else (settings.order - BEHIND,):
        bench.control.doing(f"magnitudes of order {order}")
        with suppress(EmsidError):
            found = of_magnitudes(bench.shown, order, bench.control)
            yield bench.judged(found, MAGNITUDE, KNOTS)


def _delays(bench: Bench, settings: FeedbackSearch, steps: Steps) -> tuple[int, ...]:
    """The delays that are tried: the given one, or none and the longest one that a linear model gains by."""
    if settings.delay is not None:
        return (settings.delay,)
    errors, order = [], OF_DELAY if settings.order is None else settings.order
    for delay in range(LONGEST + 1):
        try:
            errors.append(_linear(bench, order, steps, delay).error ** 2)
        except EmsidError:
            errors.append(inf)
    longest = max(delay for delay, error in enumerate(errors) if not matters(min(errors), error))
    return (0, longest) if longest and matters(errors[longest], errors[0]) else (0,)


def _bent(bench: Bench, linear: Trial, families: Sequence[tuple[Family, int]]) -> Trial | None:
    """A linear model with one map, of the first family that makes it better; the best of all where none does.

    None where no direction explains more than noise, or the model diverges with each map.
    """
    found, best = linear.found, None
    ways = directions_for(found, bench.segments(found.model), found.model.edge, bench.rng)
    if not ways or not ways[0].explains(found.minimum.samples):
        return None
    for family, size in families:
        try:
            trial = _with_map(bench, found, family, size, ways)
        except EmsidError:
            continue
        if best is None or _preferred(trial, best, bench.compared):
            best = trial
        if _preferred(trial, linear, bench.compared):
            break
    return best


def _families(settings: FeedbackSearch) -> list[tuple[Family, int]]:
    """The maps that every order is tried with, and their sizes."""
    if settings.static:
        return [(settings.static, settings.size)]
    return [(family_of(name), size) for name, size in FIRST]


def _preferred(trial: Trial, best: Trial, compared: bool) -> bool:
    """Whether a trial replaces the best one.

    Of two models the richer one is chosen if it is better on unseen data by more than noise. It is also chosen by
    Schwarz's criterion on the fitted data, for the number of independent errors, if it is better on unseen data too.
    In a short record no part shows all that the whole does, so that criterion alone decides, on the free run from the
    state that the first samples show.

    Args:
        trial: the new one.
        best: the one before.
        compared: whether there are unseen data.
    """
    if not (np.isfinite(trial.errors.mean) and np.isfinite(best.errors.mean)):
        return bool(np.isfinite(trial.errors.mean))
    richer = trial.parameters > best.parameters
    simple, rich = (best, trial) if richer else (trial, best)
    residual = rich.found.minimum.residuals
    extra = rich.parameters - simple.parameters
    error, than = (each.found.error**2 if compared else each.errors.mean for each in (rich, simple))
    gain = schwarz_gain(error, than, effective_samples(residual), extra)
    if compared:
        wins = better(rich.errors, simple.errors) or (gain > 0 and rich.errors.mean < simple.errors.mean)
    else:
        wins = gain > 0
    return wins if richer else not wins


def _linear(bench: Bench, order: int, steps: Steps, delay: int) -> Found:
    """The linear model of this order, fitted once."""
    found = bench.linear.get((order, steps, delay))
    if found is None:
        start = linear_start(bench.shown, order, steps.number, delay, steps.held, bench.control)
        found = searched(start, bench.segments(start), start.edge, 20, 0.1, bench.control)
        bench.linear[order, steps, delay] = found
    return found


def _with_map(bench: Bench, found: Found, family: Family, size: int, ways: Sequence[Direction] | None = None) -> Trial:
    """The trial with one map more, in the directions that explain most; these are looked for if they are not given.

    Raises:
        ModelError: if all directions diverge.
    """
    model = found.model
    segments, size = bench.segments(model), _size(family, size)
    ways = directions_for(found, segments, model.edge, bench.rng) if ways is None else ways
    start = with_one_map_more(found, segments, model.edge, family, size, ways, control=bench.control)
    if start is None:
        raise ModelError(f"{model.name}: with a map in its feedback the model diverges; choose another order")
    return _refined(bench, start.model, start.states, family, size)


def _refined(bench: Bench, model: FeedbackModel, states: Sequence[Array], family: Family, size: int) -> Trial:
    refined = searched(model, bench.segments(model), model.edge, STEPS, 0.1, bench.control, states=states)
    return bench.judged(refined, family, size)


def _size(family: Family, size: int) -> int:
    """The given number of knots or degree, or the first that the family tries."""
    return size or (family.sizes[0] if family.sizes else 0)


def _faster(bench: Bench, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With more steps per sample."""
    order = best.found.model.states
    fewer = [order - 1] if settings.order is None and order > 1 else []  # what made up for the steps may go
    if settings.oversampling is not None:
        return
    for held in (False, True) if settings.held is None else (settings.held,):
        for each in (order, *fewer):
            bench.control.doing(f"two steps per sample, order {each}")
            try:
                linear = _linear(bench, each, Steps(2, held), best.found.model.delay)
                yield _with_map(bench, linear, best.family, best.size)
            except EmsidError:
                continue


def _other_families(bench: Bench, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With maps of other families, begun at the present map."""
    if settings.static is not None:
        return
    for name, size in OTHERS:
        family = family_of(name)
        bench.control.doing(f"map: {name}")
        try:
            start = with_family(best, bench.shown, family, _size(family, size))
            yield _refined(bench, start, best.found.states, family, size)
        except EmsidError:
            continue


def _second_map(bench: Bench, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With a second map of the same family, or a spline."""
    if settings.maps == 1:
        return
    names = [(best.family, best.size)]
    if best.family is MAGNITUDE:  # what acts in the loop is no sensor, and one that is limited cannot make it diverge
        names = [(family_of("saturation"), 0)]
    elif settings.static is None and best.family.name != "spline":
        names.append((family_of("spline"), 0))
    yield from _one_map_more(bench, best, settings, names)


def _third_map(bench: Bench, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With a third map, beside two."""
    if settings.maps not in (None, 3) or len(best.found.model.maps) < 2:
        return
    names = [(family_of(name), size) for name, size in THIRD]
    yield from _one_map_more(bench, best, settings, names if settings.static is None else [(best.family, best.size)])


def _one_map_more(
    bench: Bench, best: Trial, settings: FeedbackSearch, names: Sequence[tuple[Family, int]]
) -> Iterator[Trial]:
    """With a map more of each of these families, if there are enough samples for it."""
    samples, number = sum(map(len, bench.shown)), len(best.found.model.maps) + 1
    for family, size in names:
        if settings.maps is None and samples < PER_KNOT * _size(family, size):
            continue
        bench.control.doing(f"{ORDINALS[number]} map: {family.name}")
        try:
            yield _with_map(bench, best.found, family, size)
        except EmsidError:
            continue


def with_family(trial: Trial, records: Sequence[Record], family: Family, size: int) -> FeedbackModel:
    """The model of a trial with maps of another family or size, each the closest to the present one."""
    model = trial.found.model
    seen = visited(model, segments_longer_than(model.memory, model, records), trial.found.states)
    maps = [family.start(seen.z[:, i], seen.w[:, i], size) for i in range(len(model.maps))]
    return replace(model, maps=tuple(maps))
