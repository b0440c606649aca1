"""More steps per sample, for a plant that moves between the samples.

A model with one step per sample makes up for what happens between samples by a higher order, which holds for inputs
like those of its record only: of a hardening spring it is wrong on a sweep through the resonance. With more steps, a
lower order suffices. Two steps are tried with the order of the best model and lower ones, and then, from the best model
and those of the lowest order which comes near, twice as many again, as long as that does not raise the errors by more
than chance does: more steps cost no parameters. Whether the input is held between its samples may only show with many
steps, so every doubling tries both, but of friction that sticks only the first one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress

from emsid.errors import EmsidError
from emsid.models.feedback.search.further_maps import with_map_more
from emsid.models.feedback.search.starts import with_steps_doubled
from emsid.models.feedback.search.sticking import sticking_map, with_sticking_steps_doubled
from emsid.models.feedback.search.trials import ORDERS, Bench, FeedbackSearch, Steps, Trial, much_worse
from emsid.selection.improvement import matters

# Steps per sample that are tried: twice the rate, more as long as that is no worse, and twice as many in the chosen
# model. The error of friction that sticks falls with the steps, so all of its numbers are tried.
TWICE, MOST_STEPS, MOST_IN_THE_END = 2, 8, 16
# Twice the loss of log likelihood up to which more steps are no worse: the 95 % point of χ² with one degree of freedom.
UNPROVEN = 3.84


def faster(bench: Bench, best: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With two steps per sample, for this order and lower ones; and with more, for the lowest that comes near."""
    if settings.oversampling is not None:
        return
    top, now, ways = best.found.model.states, None, settings.ways
    lowest = list[Trial]()
    for order in (top, *(each for each in reversed(ORDERS) if each < top and settings.order is None)):
        tried = [each for held in ways if (each := _of_steps(bench, best, order, Steps(TWICE, held)))]
        if not tried:
            continue
        if now is not None and all(much_worse(each, now) for each in tried):
            break
        yield from tried
        for each in tried:  # a lower order may do, where the higher one made up for the steps
            if now is None or bench.prefers(each, now):
                now = each
        # A way to take the input that diverges on unseen data, or is a little worse with few steps, may still be right.
        near = [each for each in tried if not any(much_worse(each, other) for other in tried)]
        if len(tried) == len(ways):
            ways = tuple(each.found.model.held for each in near)
        if order < top:
            lowest = near
    yield from finer(bench, lowest, settings)


def finer(
    bench: Bench, trials: Iterable[Trial], settings: FeedbackSearch, most: int = MOST_STEPS, sticks: bool = False
) -> Iterator[Trial]:
    """With twice the steps per sample, and twice again, as long as that does not raise the errors; all if it sticks."""
    if settings.oversampling is not None:
        return
    for trial in trials:
        now: Trial | None = trial
        while now is not None and now.found.model.oversampling < most:
            now = _doubled(bench, now, settings, sticks)
            if now is not None:
                yield now


def _doubled(bench: Bench, trial: Trial, settings: FeedbackSearch, in_any_case: bool) -> Trial | None:
    """With twice the steps per sample; None if that raises the errors, unless it is wanted in any case."""
    model, key = trial.found.model, (id(trial), in_any_case)
    if key in bench.doubled:
        return bench.doubled[key][1]
    finer, at = list[Trial](), sticking_map(model)
    ways = settings.ways if at is None or model.oversampling == 1 else (model.held,)
    for held in ways:
        bench.control.doing(f"{2 * model.oversampling} steps per sample, order {model.states}")
        with suppress(EmsidError):
            start = with_steps_doubled(model, held) if at is None else with_sticking_steps_doubled(model, at, held)
            finer.append(bench.refined(start, trial.found.states, trial.family, trial.size))
    kept = finer if in_any_case else [each for each in finer if _is_no_worse(each, trial)]
    best = min(kept, key=lambda each: each.errors.mean, default=None)
    bench.doubled[key] = trial, best
    return best


def _is_no_worse(finer: Trial, trial: Trial) -> bool:
    """Whether more steps do not raise the errors; a model with one step per sample must become better by them.

    A plant may well be sampled, as a digital controller is, but one that moves between samples does so continuously.
    """
    error, than, one = finer.found.error**2, trial.found.error**2, 1 / trial.found.minimum.samples  # in n log MSE
    if trial.found.model.oversampling == 1:
        return error < (1 - one) * than and finer.errors.mean < trial.errors.mean
    return error < (1 + UNPROVEN * one) * than and not matters(trial.errors.mean, finer.errors.mean)


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
