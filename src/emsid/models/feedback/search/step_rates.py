"""More steps per sample, for a plant that moves between the samples.

A model with one step per sample makes up for what happens between samples by a higher order, which holds for inputs
like those of its record only: of a hardening spring it is wrong on a sweep through the resonance. With more steps, a
lower order suffices. Two steps are tried with the order of the best model and lower ones, and then, from the fitted
model, twice as many again, as long as that lowers the errors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress

from emsid.errors import EmsidError
from emsid.models.feedback.search.further_maps import with_map_more
from emsid.models.feedback.search.starts import with_steps_doubled
from emsid.models.feedback.search.trials import ORDERS, Bench, FeedbackSearch, Steps, Trial, much_worse

# Steps per sample that are tried: twice the rate, and more as long as that is better.
TWICE, MOST_STEPS = 2, 8


def faster(bench: Bench, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With two steps per sample, for this order and lower ones."""
    if settings.oversampling is not None:
        return
    top, now, ways = best.found.model.states, None, settings.ways
    for order in (top, *(each for each in reversed(ORDERS) if each < top and settings.order is None)):
        tried = [each for held in ways if (each := _of_steps(bench, best, order, Steps(TWICE, held)))]
        if now is not None and tried and much_worse(tried[0], now):
            return
        yield from tried
        for each in tried:  # a lower order may do, where the higher one made up for the steps
            if now is None or bench.prefers(each, now):
                now, ways = each, (each.found.model.held,)


def finer(bench: Bench, trials: Iterable[Trial], settings: FeedbackSearch) -> Iterator[Trial]:
    """With twice the steps per sample, and twice again, as long as that lowers the errors."""
    if settings.oversampling is not None:
        return
    for trial in trials:
        now: Trial | None = trial
        while now is not None and now.found.model.oversampling < MOST_STEPS:
            now = _doubled(bench, now, settings)
            if now is not None:
                yield now


def _doubled(bench: Bench, trial: Trial, settings: FeedbackSearch) -> Trial | None:
    """With twice the steps per sample; None if that does not lower the errors."""
    model = trial.found.model
    ways = settings.ways if model.oversampling == 1 else (model.held,)
    finer = list[Trial]()
    for held in ways:
        bench.control.doing(f"{2 * model.oversampling} steps per sample, order {model.states}")
        with suppress(EmsidError):
            start = with_steps_doubled(model, held)
            finer.append(bench.refined(start, trial.found.states, trial.family, trial.size))
    most = (1 - 1 / trial.found.minimum.samples) ** 0.5 * trial.found.error  # n log MSE falls by one or more
    lower = [each for each in finer if each.found.error < most and each.errors.mean < trial.errors.mean]
    return min(lower, key=lambda each: each.errors.mean, default=None)


def at_twice_the_rate(bench: Bench, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """Other models with one map and two steps per sample that may be better with more of them.

    They are those of one order less, which may do where the order makes up for the steps, and with the input taken in
    the other way.
    """
    model = best.found.model
    if settings.oversampling is not None or model.oversampling != TWICE:
        return
    for order in {model.states, model.states if settings.order else max(model.states - 1, 1)}:
        for held in settings.ways:
            trial = _of_steps(bench, best, order, Steps(TWICE, held))
            if trial is not None and not much_worse(trial, best):
                yield trial


def _of_steps(bench: Bench, like: Trial, order: int, steps: Steps) -> Trial | None:
    """A model with one map as another one has, with these steps per sample; None where it diverges."""
    bench.control.doing(f"{steps.number} steps per sample, order {order}")
    with suppress(EmsidError):
        return with_map_more(bench, bench.linear(order, steps, like.found.model.delay), like.family, like.size)
    return None
