"""The first models of a feedback search: for every order a linear one, and those with one map.

The map is in the direction that explains most. Every order is tried with a polynomial, a dead zone and a speed that
sticks (`sticking`), alone and behind a dead zone; a spline is tried where a direction explains more, but none of these
is better than no map.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from math import inf

from emsid.errors import EmsidError, ModelError
from emsid.models.blocks.search.map_families import Family, family_of
from emsid.models.feedback.search.moves import with_map_more
from emsid.models.feedback.search.sticking import STICKING, with_speed_that_sticks
from emsid.models.feedback.search.trials import (
    LONGEST,
    MOST_ORDERS,
    ORDERS,
    FeedbackSearch,
    SearchData,
    Steps,
    Trial,
)
from emsid.selection.improvement import matters

# The order of the linear models that show a delay.
OF_DELAY = 2
# Families and sizes that every order is tried with, the last one where these are no better than none.
FIRST, RESERVE = (("polynomial", 3), ("dead-zone", 0), ("spline", 0)), "spline"


def first_map(data: SearchData, settings: FeedbackSearch) -> tuple[Trial, list[Trial]]:
    """The best linear model over the orders, and those with a map.

    Orders above those of `ORDERS` are tried as long as the highest one was the best. Of two delays, the second is tried
    with the order that is the best with the first, and one less.

    Raises:
        ModelError: if no linear model can be fitted.
    """
    given = settings.order
    steps = Steps(settings.oversampling or 1, bool(settings.held))
    straight: Trial | None = None
    best: Trial | None = None
    bent: list[Trial] = []
    orders: Sequence[int] = range(1, MOST_ORDERS + 1) if given is None else (given,)
    problem: EmsidError = ModelError("feedback: no model of this record; check channels, units and delay")
    for delay in _delays(data, settings, steps):
        for order in orders:
            data.control.doing(f"order {order}", order, max(ORDERS))
            try:
                found = data.linear(order, steps, delay)
                linear = data.judged(found, settings.static or STICKING, settings.size)
                trials = _bent(data, linear, settings)
            except EmsidError as error:
                problem = error
                continue
            higher = False
            if straight is None or data.prefers(linear, straight):
                straight, higher = linear, True
            for trial in trials:
                if data.prefers(trial, best or straight):
                    best, higher = trial, True
            bent += trials
            if order >= max(ORDERS) and not higher:
                break
        if given is None and straight is not None:
            top = (best or straight).found.model.states
            orders = range(max(top - 1, 1), top + 1)
    if straight is None:
        raise problem
    return straight, bent


def _delays(data: SearchData, settings: FeedbackSearch, steps: Steps) -> tuple[int, ...]:
    """The delays that are tried: the given one, or none and the longest one that a linear model gains by.

    A long one comes first: without it the order would grow until it makes up for the delay.
    """
    if settings.delay is not None:
        return (settings.delay,)
    errors, order = {}, OF_DELAY if settings.order is None else settings.order
    for delay in {*range(LONGEST + 1), settings.longest}:
        try:
            errors[delay] = data.linear(order, steps, delay).error ** 2
        except EmsidError:
            errors[delay] = inf
    longest = max(delay for delay, error in errors.items() if not matters(min(errors.values()), error))
    if not longest or not matters(errors[longest], errors[0]):
        return (0,)
    return (longest, 0) if longest > LONGEST else (0, longest)


def _bent(data: SearchData, linear: Trial, settings: FeedbackSearch) -> list[Trial]:
    """A linear model with one map of each family; none where the model diverges with each.

    Where much is missing, the residual is a slow signal with so few independent errors that no direction explains
    more than noise to first order, although the map explains far more once it is fitted.
    """
    found, trials = linear.found, list[Trial]()
    if settings.static in (None, STICKING):
        with suppress(EmsidError):
            start, states = with_speed_that_sticks(found, [y for _, y in data.segments(found.model)])
            trials.append(data.refined(start, states, STICKING, 0))
            if settings.maps != 1 and not data.leaves_noise(trials[-1]):  # what the drive loses before it moves
                trials.append(with_map_more(data, trials[-1].found, STICKING, 0))
    for family, size in _families(settings):
        better = any(data.prefers(trial, linear) for trial in trials)
        if family.name == RESERVE and settings.static is None and (better or not data.more_than_noise(found)):
            break
        with suppress(EmsidError):
            trials.append(with_map_more(data, found, family, size))
    return trials


def _families(settings: FeedbackSearch) -> list[tuple[Family, int]]:
    """The maps that every order is tried with, and their sizes."""
    if settings.static:
        return [(settings.static, settings.size)]
    return [(family_of(name), size) for name, size in FIRST]
