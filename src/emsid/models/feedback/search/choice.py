"""Choice of order, rate, static maps and their number by the free run on unseen data.

From simple to complex, each choice must be better by more than noise (`emsid.selection.improvement`):

1. for every order, and a delay if linear models gain by it, a linear model and one map in the direction that explains
   most: a polynomial and a dead zone, or else a spline;
   for an output that shows magnitudes only, also models before a sensor that loses the sign (`magnitudes`), with a
   second map, and with more steps per sample; if the error of the best of them is not far larger, the search ends;
2. friction that sticks (`sticking`); if it is far better than one map, steps 3, 4 and 6 are left out;
3. with the best order and lower ones, two steps per sample, and more if these are no worse (`step_rates`);
4. other families of maps with few numbers;
5. further maps, one after the other, beside those of the best model and of those with the least prediction errors;
   where a second one leaves more than noise, also a map that is multiplied by a signal, beside the linear model;
6. where these leave more than noise, maps of free form in place of the first one; if one is the best, maps beside it;
7. signals that are shared (`shared_signals`), in the best model; where no unseen data compare the models, in the best
   few, and then the choice is the one that agrees most with the others beyond the record (`consensus`).

If a linear model is as good as the best one with a map, the search ends after the first step with a map at this linear
model, unless that, a map that is multiplied by a signal, or two maps are better than the linear one. A model whose free
run diverges on an input a little larger than that of the record, forward or backward in time, is not chosen.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.nonlinear.control import Control
from emsid.models.blocks.search.map_families import family_of
from emsid.models.feedback.fitting import Found
from emsid.models.feedback.search.consensus import agreeing, leading
from emsid.models.feedback.search.exchanged_maps import other_families
from emsid.models.feedback.search.first_map import first_map
from emsid.models.feedback.search.further_maps import Maps, maps_more, with_map_more
from emsid.models.feedback.search.magnitudes import with_sensor
from emsid.models.feedback.search.shared_signals import with_shared_signals
from emsid.models.feedback.search.starts import with_product
from emsid.models.feedback.search.step_rates import MOST_IN_THE_END, at_twice_the_rate, faster, finer
from emsid.models.feedback.search.sticking import sticking
from emsid.models.feedback.search.trials import (
    MOST_MAPS,
    Bench,
    FeedbackSearch,
    Steps,
    Trial,
    much_worse,
)
from emsid.record import Record
from emsid.selection.improvement import matters

Array = NDArray[np.float64]

# The number of models with equally many maps that a further one is added to, where they are compared over all data of a
# short record, or over at most this number of samples of unseen data; over more samples it is one model, as many
# independent errors distinguish models and every search takes long.
EXTENDED, SHORT = 4, 2_000
# The number of models of a short record whose maps are made to share signals before one is chosen.
SIMPLIFIED = 6


class Palette(NamedTuple):
    """Families of maps and their sizes.

    Attributes:
        others: tried in place of the first map.
        more: tried beside other maps.
    """

    others: Maps
    more: Maps


# Maps of few numbers, and those that are tried where the first leave more than noise.
PLAIN = Palette(
    (("polynomial", 3), ("polynomial", 5), ("two-slopes", 0), ("dead-zone", 0), ("saturation", 0)),
    (("polynomial", 3), ("two-slopes", 0), ("dead-zone", 0)),
)
# The map that is multiplied by a signal, a line or a magnitude, and those that are tried beside it, for friction.
MULTIPLIED, BESIDE_PRODUCT = family_of("two-slopes"), (family_of("dead-zone"), family_of("saturation"))
# The map beside a sensor that loses the sign, such as friction, and the one that takes its place. In a short record it
# does so where the error on parts that are left out falls below this share: a map of many numbers follows a record more
# closely than it holds on another one.
BESIDE_SENSOR, FREE_FORM_BESIDE_SENSOR = (("tanh", 0),), (("spline", 8),)
CLEARLY = 0.8
FREE_FORM = Palette((("spline", 0), ("monotone-spline", 0)), (("polynomial", 3), ("spline", 0), ("dead-zone", 0)))


def chosen(records: Sequence[Record], settings: FeedbackSearch, control: Control) -> Iterator[Trial]:
    """Trials, each better than the one before; the last one is the choice.

    Raises:
        ModelError: if no feedback model can be fitted.
    """
    bench = Bench.of(records, settings, control)
    straight, tried = first_map(bench, settings)
    best, sensors = _preferred(bench, tried), list(with_sensor(bench, settings))
    if begun := _preferred(bench, sensors):
        for sensor in _before_sensor(Contest(bench, sensors, begun), settings):
            if ends := best is None or (bench.prefers(sensor, straight) and not much_worse(sensor, best)):
                yield sensor
        if ends:
            return
    if best is None or not bench.prefers(best, straight):
        beside = _beside_linear(straight, tried)
        best = _better_than_linear(Contest(bench, tried, straight), beside, best or beside, settings)
        if best is None and (settings.maps or 1) == 1:
            yield beside
            return
        best = best or beside
    yield best
    contest = Contest(bench, tried, best)
    yield from contest.entered(_sooner(bench, contest.best, settings))
    stuck = _with_sticking(contest, settings)
    if any(_settles(contest, each) for each in stuck):
        yield from contest.entered(stuck)
        yield from _more_maps(contest, settings, PLAIN.more, len(contest.best.found.model.maps) + 1)
    else:
        others = () if bench.leaves_noise(contest.best) else _runner_up(tried, contest.best)
        for each in (contest.best, *others):
            yield from contest.entered(faster(bench, each, settings))
        yield from _other_maps(contest, settings, stuck)
    yield from contest.entered(_sooner(bench, contest.best, settings))
    yield from contest.entered(finer(bench, [contest.best], settings))
    eligible = _eligible(contest, settings)
    best = _best_of(contest, eligible)
    yield best
    if bench.compared:
        yield from _completed(bench, best, settings)
    else:
        several = [each for each in eligible if each is best or bench.determines(each)]
        smaller = _smaller(bench, leading(several, best, SIMPLIFIED))
        yield agreeing(bench, [smaller.get(each, each) for each in several], smaller.get(best, best))


def _preferred(bench: Bench, trials: Sequence[Trial]) -> Trial | None:
    """The best of several trials; none of none."""
    best: Trial | None = None
    for trial in trials:
        if best is None or bench.prefers(trial, best):
            best = trial
    return best


def _before_sensor(contest: Contest, settings: FeedbackSearch) -> Iterator[Trial]:
    """From models before a sensor that loses the sign, each better than the one before.

    Other maps may follow a short record better, but hold for its signs only. No signals are shared, as larger runs of
    different signs do not tell which model is right.
    """
    yield contest.best
    alone = Contest(contest.bench, [*contest.tried], contest.best)
    yield from _more_maps(contest, settings, BESIDE_SENSOR, most=2)
    if settings.maps is not None or not contest.bench.leaves_noise(contest.best):
        others = list(_more_maps(alone, settings, FREE_FORM_BESIDE_SENSOR, most=2))
        contest.tried.extend(each for each in alone.tried if each not in contest.tried)
        yield from contest.entered(each for each in others[-1:] if _clearly_better(contest, each))
    yield from contest.entered(finer(contest.bench, [contest.best], settings))
    yield _best_of(contest, _eligible(contest, settings))


def _clearly_better(contest: Contest, trial: Trial) -> bool:
    """Whether a trial may replace the best one, whose maps have fewer numbers where they are as many."""
    bench, best = contest.bench, contest.best
    if bench.compared or len(trial.found.model.maps) > len(best.found.model.maps):
        return True
    return bench.left_out(trial).mean < CLEARLY**2 * bench.left_out(best).mean


def _completed(bench: Bench, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With shared signals, and with more steps per sample if these lower the errors then; as long as both go on."""
    now, before = best, None
    while now is not before:
        for trial in with_shared_signals(bench, now):
            now = trial
            yield trial
        before = now
        for trial in finer(bench, [now], settings, MOST_IN_THE_END):
            now = trial
            yield trial


def _smaller(bench: Bench, trials: Sequence[Trial]) -> dict[Trial, Trial]:
    """For each trial the one in which as many signals as possible are shared, which then stands for it."""
    return {each: [each, *with_shared_signals(bench, each)][-1] for each in trials}


def _eligible(contest: Contest, settings: FeedbackSearch) -> list[Trial]:
    """The trials that do not run away, of the number of maps that is asked for; the best one if there are none."""
    known = contest.continued
    return [each for each in known if settings.maps in (None, len(each.found.model.maps))] or [contest.best]


def _best_of(contest: Contest, eligible: Sequence[Trial]) -> Trial:
    """The best trial of a search if it is eligible, or else the one with the smallest error."""
    return contest.best if contest.best in eligible else min(eligible, key=lambda each: each.errors.mean)


def _beside_linear(straight: Trial, tried: Sequence[Trial]) -> Trial:
    """The first trial of the order and delay of the best linear model; where it diverges with a map, of any.

    Raises:
        ModelError: if there is no trial.
    """
    if not tried:
        raise ModelError(f"{straight.found.model.name}: with a map in its feedback the model diverges")
    model = straight.found.model
    same = [each for each in tried if (each.found.model.states, each.found.model.delay) == (model.states, model.delay)]
    return (same or tried)[0]


def _better_than_linear(contest: Contest, beside: Trial, with_map: Trial, settings: FeedbackSearch) -> Trial | None:
    """A model with a map to go on from, if it or what is added to it is better than the linear one; or none.

    Where a product is missing, one map of one signal may follow the record better and make the free run worse. Where
    several maps are missing, the residual is slow with one of them too, and its few independent errors do not justify
    the parameters of that map; what two maps explain may justify the parameters of both.

    Args:
        contest: with the linear model as the best one so far.
        beside: the model with one map of the same order.
        with_map: the best of the models with one map.
        settings: options.
    """
    straight = contest.best
    for trials in ([beside], _products(contest, straight, settings)):
        for _ in contest.entered(trials):
            pass
        if contest.best is not straight:
            return contest.best
    two = _second_maps(contest, with_map, settings)
    return with_map if any(contest.bench.rejects(straight, each) for each in two) else None


def _second_maps(contest: Contest, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With two maps, where the best model with one map may be better than the linear one."""
    if (settings.maps or MOST_MAPS) > 1 and contest.bench.may_be_better(best, contest.best):
        yield from maps_more(contest.bench, _to_extend(contest, best, 1), settings, PLAIN.more)


@dataclass(eq=False)
class Contest:
    """The trials of a search, and the best one so far.

    Attributes:
        bench: that compares them.
        tried: all of them.
        best: of them.
    """

    bench: Bench
    tried: list[Trial]
    best: Trial

    @property
    def continued(self) -> list[Trial]:
        """The trials that may be continued and chosen, if they do not run away."""
        return [each for each in self.tried if np.isfinite(each.errors.mean)]

    def entered(self, trials: Iterable[Trial]) -> Iterator[Trial]:
        """Those of further trials that replace the best one, one after the other."""
        for trial in trials:
            if trial not in self.tried:
                self.tried.append(trial)
            if self.bench.prefers(trial, self.best):
                self.best = trial
                yield trial


def _other_maps(contest: Contest, settings: FeedbackSearch, stuck: Sequence[Trial]) -> Iterator[Trial]:
    """With other families of maps in place of the first one, and beside it.

    One of another family that leaves noise only may do with a lower order, and that with another map again. Models with
    friction that sticks (``stuck``) take part before maps are added. Maps of free form come last, and beside others
    only where one map of free form is the best model. Several of them follow the record as well as the right maps, but
    with many parameters, and then err in other combinations of states.
    """
    bench = contest.bench
    for each in (contest.best, *_runner_up(contest.tried, contest.best)):
        others = list(at_twice_the_rate(bench, each, settings))
        yield from contest.entered(others)
        yield from contest.entered(finer(bench, others, settings))
    single = contest.best
    yield from contest.entered(other_families(bench, single, settings, PLAIN.others))
    if contest.best.family is not single.family and bench.leaves_noise(contest.best):
        yield from contest.entered(faster(bench, contest.best, settings))
        yield from contest.entered(other_families(bench, contest.best, settings, PLAIN.others))
    yield from contest.entered(stuck)
    yield from _more_maps(contest, settings, PLAIN.more)
    plain = contest.best
    if settings.static is None and not bench.leaves_noise(plain):
        yield from contest.entered(other_families(bench, single, settings, FREE_FORM.others))
    if contest.best is not plain:
        yield from _more_maps(contest, settings, FREE_FORM.more)


def _with_sticking(contest: Contest, settings: FeedbackSearch) -> list[Trial]:
    """With friction that sticks, where more than noise is left, and with all numbers of steps per sample.

    Friction acts between samples, so that few steps are wrong at other inputs although they may do for the record; and
    what they miss is no reason for further maps.
    """
    bench, best = contest.bench, contest.best
    if bench.leaves_noise(best):
        return []
    trials = list(sticking(bench, best.found.model.delay, settings))
    for trial in trials:
        best = trial if bench.prefers(trial, best) else best
    return trials if best is contest.best else [*trials, *finer(bench, [best], settings, MOST_IN_THE_END, True)]


def _settles(contest: Contest, stuck: Trial) -> bool:
    """Whether friction that sticks is far better than the best model so far, so that others in its place are not tried.

    Short records compare many models, as no unseen data show which is right.
    """
    return contest.bench.compared and much_worse(contest.best, stuck) and contest.bench.prefers(stuck, contest.best)


def _more_maps(
    contest: Contest, settings: FeedbackSearch, maps: Maps, least: int = 2, most: int = MOST_MAPS
) -> Iterator[Trial]:
    """With further maps, from this number on, until none explains more or the best model leaves noise only.

    Args:
        contest: the trials so far.
        settings: where they give a number of maps, that is the largest one.
        maps: families and sizes that are tried.
        least: number of maps with those that are added.
        most: number of maps if none is given.
    """
    for number in range(least, (settings.maps or most) + 1):
        before, fewer = contest.best, _that_explain_most(contest, number - 1)
        if settings.maps is None and contest.bench.leaves_noise(before):
            return
        extended = _to_extend(contest, before, number - 1)
        yield from contest.entered(maps_more(contest.bench, extended, settings, maps))
        if number == 2 and maps is PLAIN.more:
            products = _products(contest, before, settings)  # others than the best are not extended
            yield from contest.entered(each for each in products if contest.bench.prefers(each, contest.best))
        more = _that_explain_most(contest, number)
        explain_more = more and matters(more[0].prediction_error, fewer[0].prediction_error)
        if settings.maps is None and contest.best is before and not explain_more:
            return


def _that_explain_most(contest: Contest, maps: int) -> list[Trial]:
    """The models with this number of maps that do not run away and have the least final prediction errors."""
    equal = [each for each in contest.continued if len(each.found.model.maps) == maps]
    short = not contest.bench.compared or (equal and equal[0].errors.samples.sum() <= SHORT)
    several = EXTENDED if short else 1
    return sorted(equal, key=lambda each: each.prediction_error)[:several]


def _to_extend(contest: Contest, best: Trial, maps: int) -> list[Trial]:
    """The models with this number of maps that another one is added to: those that explain most, and the best of all.

    Where a map is missing, the residual is a slow signal with few independent errors. The rule that compares models
    then prefers those with few parameters, but the next map may only find its place beside one that explains more. The
    first maps of a model stand for several of the true ones, and further maps only mend what they lack; which of them
    can become the true ones shows when these are complete.
    """
    most = _that_explain_most(contest, maps)
    if len(best.found.model.maps) != maps:
        return most
    return [best, *(each for each in most if each is not best)]


def _runner_up(tried: Sequence[Trial], best: Trial) -> list[Trial]:
    """The best model with a map of another family than that of the best of all, if its error is not far larger."""
    others = [each for each in tried if each.family is not best.family]
    near = [each for each in others if np.isfinite(each.errors.mean) and not much_worse(each, best)]
    return sorted(near, key=lambda each: each.errors.mean)[:1]


def _sooner(bench: Bench, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """Without the delay: a linear model may need it for what the maps show."""
    if settings.delay is None and best.found.model.delay:
        bench.control.doing("no delay")
        with suppress(EmsidError):
            yield bench.refined(replace(best.found.model, delay=0), best.found.states, best.family, best.size)


def _products(contest: Contest, single: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With a map that is multiplied by a signal, of the order of the model with one map and of lower ones.

    Yields them until one leaves noise only, if the best model so far leaves more.
    """
    bench, model = contest.bench, single.found.model
    steps = Steps(model.oversampling, model.held)
    if settings.static is not None or bench.leaves_noise(contest.best):
        return
    for order in range(model.states, 0, -1) if settings.order is None else (settings.order,):
        bench.control.doing(f"a map times a signal, order {order}")
        with suppress(EmsidError):
            trials = list(_with_product(bench, bench.linear(order, steps, model.delay)))
            yield from trials
            if any(bench.leaves_noise(each) for each in trials):
                return


def _with_product(bench: Bench, linear: Found) -> Iterator[Trial]:
    """A linear model with a map that is multiplied by a signal, alone and with another map.

    Beside the linear model the direction of the product shows, while beside a map that stands for it another one seems
    best. Its signals are held until there is another map: free, they would follow what that is for.
    """
    ways, segments = bench.directions(linear, True), bench.segments(linear.model)
    if not ways or not ways[0].explains(linear.minimum.samples):
        return
    found = with_product(linear, segments, linear.model.edge, MULTIPLIED, ways[0], bench.control)
    with suppress(EmsidError):
        yield bench.refined(found.model, found.states, MULTIPLIED, 0)
    for family in BESIDE_PRODUCT:
        with suppress(EmsidError):
            yield with_map_more(bench, found, family, 0, True)
