"""Feedback models with one map more: many starts, of which few are refined to the end.

A map is added to several models, of several families. Each start is refined in a few steps, in the directions that
explain most, and the best direction remains. A start that the steps make no better than the model without the map is
left out: where the models are complete, no start remains. Of the others, the better half is refined to the end, but all
of them with the second map, where a few steps do not show yet which start is the best.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from emsid.errors import EmsidError, ModelError
from emsid.estimation.threads import in_threads
from emsid.models.blocks.search.map_families import Family, family_of
from emsid.models.feedback.fitting import Found
from emsid.models.feedback.search.directions import KEPT
from emsid.models.feedback.search.starts import share_of, with_one_map_more
from emsid.models.feedback.search.trials import Bench, FeedbackSearch, Trial, refusal
from emsid.selection.improvement import matters

Maps = tuple[tuple[str, int], ...]
"""Names of families and their sizes."""

# A further map takes at least this many samples for every knot, or degree.
PER_KNOT = 20
# The degree of a polynomial if none is given.
CUBIC = 3
# Steps of a start in every direction.
STEPS = 10
# The number of directions beside a sensor that loses the sign, which hides where what acts in the loop has its effect.
MANY = 8
ORDINALS = {2: "second", 3: "third", 4: "fourth", 5: "fifth", 6: "sixth"}


class Start(NamedTuple):
    """A model with one map more after a few steps on some of the segments.

    Attributes:
        without: the model without the map.
        found: with the map.
        family, size: of the map.
        before: the root mean square error of the model without the map on these segments.
    """

    without: Found
    found: Found
    family: Family
    size: int
    before: float

    @property
    def gains(self) -> bool:
        """Whether the map lowers the error by more than a negligible part of it."""
        return matters(self.found.error**2, self.before**2)


def with_map_more(bench: Bench, found: Found, family: Family, size: int, hold_signals: bool = False) -> Trial:
    """The trial with one map more, in the directions that explain most.

    Args:
        bench: the data.
        found: the model without it.
        family, size: of the map.
        hold_signals: whether those of products are held while directions are compared.

    Raises:
        ModelError: if all directions diverge.
    """
    size = usual_size(family, size)
    known = bench.extended.get((id(found), family.name, size, hold_signals))
    return known or _refined(bench, _begun(bench, found, family, size, hold_signals), hold_signals)


def usual_size(family: Family, size: int) -> int:
    """The given number of knots or degree, or the first that the family tries; of a polynomial that of a spring."""
    if size or not family.sizes:
        return size
    return CUBIC if family.name == "polynomial" and CUBIC in family.sizes else family.sizes[0]


def maps_more(bench: Bench, models: Sequence[Trial], settings: FeedbackSearch, maps: Maps) -> Iterator[Trial]:
    """The best of several models with a map more.

    Args:
        bench: the data.
        models: without the map.
        settings: where they give a number of maps, those that gain nothing are refined too.
        maps: families and sizes that are tried.
    """
    if bench.threads > 1:  # in one order: random ones are among the directions
        for each in models:
            bench.directions(each.found)
    later = any(len(each.found.model.maps) > 1 for each in models)
    with in_threads(bench.threads) as in_turn:
        several = in_turn(lambda each: [*_starts(bench, each, settings, maps)], models)
        starts = [each for listed in several for each in listed if settings.maps is not None or each.gains]
        for trial in in_turn(lambda each: _tried(bench, each), better_half(starts) if later else starts):
            if trial is not None:
                yield trial


def better_half(starts: Sequence[Start]) -> list[Start]:
    """Those with the smaller errors, in their order."""
    best = sorted(starts, key=lambda each: each.found.error)[: (len(starts) + 1) // 2]
    return [each for each in starts if each in best]


def _starts(bench: Bench, trial: Trial, settings: FeedbackSearch, maps: Maps) -> Iterator[Start]:
    """With a map more of each family, where samples suffice for it and more than noise is left."""
    samples, found = sum(map(len, bench.shown)), trial.found
    if settings.maps is None and not bench.more_than_noise(found):
        return
    names = [(family_of(name), size) for name, size in maps]
    if settings.static is not None:
        names = [(trial.family, trial.size)]
    for family, size in ((family, usual_size(family, size)) for family, size in names):
        if settings.maps is None and samples < PER_KNOT * size:
            continue
        bench.control.doing(f"{ORDINALS[len(found.model.maps) + 1]} map: {family.name}")
        with suppress(EmsidError):
            yield _begun(bench, found, family, size, kept=MANY if trial.loses_sign else KEPT)


def _begun(
    bench: Bench, found: Found, family: Family, size: int, hold_signals: bool = False, kept: int = KEPT
) -> Start:
    """The start in the best direction.

    Raises:
        ModelError: if all directions diverge.
    """
    model = found.model
    segments, ways = bench.segments(model), bench.directions(found, kept=kept)
    start = with_one_map_more(
        found, segments, model.edge, family, size, ways, STEPS, bench.control, hold_signals, refusal(model)
    )
    if start is None:
        raise ModelError(f"{model.name}: with a map in its feedback the model diverges; choose another order")
    before = float(np.sqrt(np.mean(np.concatenate(found.minimum.residuals[share_of(segments)]) ** 2)))
    return Start(found, start, family, size, before)


def _tried(bench: Bench, start: Start) -> Trial | None:
    with suppress(EmsidError):
        return _refined(bench, start)
    return None


def _refined(bench: Bench, start: Start, hold_signals: bool = False) -> Trial:
    """The trial that begins at a start, which is refined to the end once.

    Raises:
        ModelError: where its run diverges.
    """
    key = id(start.without), start.family.name, start.size, hold_signals
    if key not in bench.extended:  # its directions keep the model without the map
        bench.extended[key] = bench.refined(start.found.model, start.found.states, start.family, start.size)
    return bench.extended[key]
