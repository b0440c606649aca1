"""Choice of order, rate, static maps and their number by the free run on unseen data.

The search begins with linear models and those with one map (`first_map`), or before a sensor that loses the sign
(`rectified_output`). Then it makes the moves of a table, in turn, from the best model, as long as one of them leads to
a better one (`SearchData.prefers`, by `emsid.selection.improvement`). Maps are added to several models: where a map is
missing, the residual is a slow signal with few independent errors, so the rule that compares models prefers those with
few parameters, but the next map may only find its place beside one that explains more. A model that leaves white noise,
of which a further map explains no more than chance, gets no other maps. In the end the signals of the chosen model are
shared where the data allow it (`shared_signals`).

A model whose free run diverges on an input a little larger than that of the record, forward or backward in time, is not
chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import Control
from emsid.models.feedback.search.first_map import first_map
from emsid.models.feedback.search.moves import (
    CLEARLY,
    FREE_FORM,
    FREE_FRICTION,
    FRICTION,
    MORE,
    OTHERS,
    Maps,
    maps_more,
    more_steps,
    with_other_maps,
    with_products,
    without_delay,
)
from emsid.models.feedback.search.rectified_output import with_sensor
from emsid.models.feedback.search.shared_signals import with_shared_signals
from emsid.models.feedback.search.trials import BEAM, MOST_MAPS, FeedbackSearch, SearchData, Trial, much_worse
from emsid.record import Record
from emsid.selection.improvement import matters


@dataclass(eq=False)
class Contest:
    """The trials of a search, and the best one so far.

    Attributes:
        data: that compares them.
        settings: options.
        tried: all of them that have a map.
        best: of them; a linear model if none is better.
        made: the moves that were made, by the identity of the trial.
    """

    data: SearchData
    settings: FeedbackSearch
    tried: list[Trial]
    best: Trial
    made: set[tuple[str, int]] = field(default_factory=set)

    def entered(self, trials: Iterable[Trial]) -> Iterator[Trial]:
        """Those of further trials that replace the best one, one after the other."""
        for trial in trials:
            self.tried.append(trial)
            if self.data.prefers(trial, self.best):
                self.best = trial
                yield trial

    def new(self, move: str, trials: Sequence[Trial]) -> list[Trial]:
        """The trials that a move was not made from yet; it is now."""
        found = [each for each in trials if (move, id(each)) not in self.made]
        self.made.update((move, id(each)) for each in found)
        return found

    def leading(self, maps: int) -> list[Trial]:
        """The models with this number of maps that are extended: the best of all, and those that explain most."""
        equal = [each for each in self.tried if len(each.found.model.maps) == maps and np.isfinite(each.errors.mean)]
        best = [self.best] if self.best in equal else []
        most = sorted(equal, key=lambda each: each.prediction_error)[:BEAM]
        return [*best, *(each for each in most if each is not self.best)]

    @property
    def single(self) -> list[Trial]:
        """The best model with one map; none where all diverge."""
        return self.leading(1)[:1]

    @property
    def complete(self) -> bool:
        """Whether the best model leaves noise only."""
        return self.data.leaves_noise(self.best)

    @property
    def choice(self) -> Trial:
        """The best trial with a map, of the number of maps that is asked for; of other numbers if there are none.

        Raises:
            ModelError: if there is no trial.
        """
        if not self.tried:
            name = self.best.found.model.name
            raise ModelError(f"{name}: with a map in its feedback the model diverges")
        asked, model = self.settings.maps, self.best.found.model
        known = [each for each in self.tried if np.isfinite(each.errors.mean)] or self.tried
        known = [each for each in known if asked in (None, len(each.found.model.maps))] or known
        if self.best in known:
            return self.best
        alike = [each for each in known if each.found.model.states == model.states and not model.maps]
        return min(alike or known, key=lambda each: each.errors.mean)


def chosen(records: Sequence[Record], settings: FeedbackSearch, control: Control) -> Iterator[Trial]:
    """Trials, each better than the one before; the last one is the choice.

    Raises:
        ModelError: if no feedback model can be fitted.
    """
    data = SearchData.of(records, settings, control)
    straight, tried = first_map(data, settings)
    contest, moves = _begun(data, settings, straight, tried), MOVES
    sensors = list(with_sensor(data, settings))
    if sensors:
        before = _begun(data, settings, sensors[0], sensors)
        if data.prefers(before.best, straight) and not much_worse(before.best, contest.best):
            contest, moves = before, BEFORE_SENSOR
    yield (begun := contest.choice)
    before_moves = None
    while contest.best is not before_moves:
        before_moves = contest.best
        for move in moves:
            yield from contest.entered(move(contest))
    now = contest.choice
    if now is not begun:
        yield now
    # Larger runs of different signs do not tell which model is right.
    if contest.best.found.model.maps and now.found.model.sensor is None:
        yield from with_shared_signals(data, now)


def _begun(data: SearchData, settings: FeedbackSearch, best: Trial, tried: Sequence[Trial]) -> Contest:
    """The contest of these trials, from one that they have to replace."""
    contest = Contest(data, settings, [], best)
    for _ in contest.entered(tried):
        pass
    return contest


# --- the table of moves ----------------------------------------------------------------------------------------------


def _without_delay(contest: Contest) -> Iterator[Trial]:
    for trial in contest.new("delay", [contest.best]):
        yield from without_delay(contest.data, trial, contest.settings)


def _more_steps(contest: Contest) -> Iterator[Trial]:
    if contest.best.found.model.maps:
        for trial in contest.new("steps", [contest.best]):
            yield from more_steps(contest.data, trial, contest.settings)


def _other_maps(contest: Contest, maps: Maps = OTHERS) -> Iterator[Trial]:
    if contest.best.found.model.maps and (contest.settings.static is not None or not contest.complete):
        for trial in contest.new(maps[0][0], contest.single):
            yield from with_other_maps(contest.data, trial, contest.settings, maps)


def _free_form(contest: Contest) -> Iterator[Trial]:
    if contest.settings.static is None:
        yield from _other_maps(contest, FREE_FORM)


def _more_maps(contest: Contest, maps: Maps = MORE, most: int = MOST_MAPS) -> Iterator[Trial]:
    """With further maps, until none explains more or the best model leaves noise only."""
    data, settings = contest.data, contest.settings
    for number in range(2, (settings.maps or most) + 1):
        before, fewer = contest.best, contest.leading(number - 1)
        if not fewer or (settings.maps is None and contest.complete):
            return
        yield from maps_more(data, contest.new("map", fewer), settings, maps)
        more = contest.leading(number)
        explain_more = more and matters(more[0].prediction_error, fewer[0].prediction_error)
        if settings.maps is None and contest.best is before and not explain_more:
            return


def _second_map(contest: Contest) -> Iterator[Trial]:
    yield from _more_maps(contest, most=2)


def _products(contest: Contest) -> Iterator[Trial]:
    """Those that are better: the others would take the place of the map that the next one needs."""
    if contest.settings.static is None and not contest.complete:
        for trial in contest.new("product", contest.single):
            made = with_products(contest.data, trial, contest.settings)
            yield from (each for each in made if contest.data.prefers(each, contest.best))


def _friction(contest: Contest) -> Iterator[Trial]:
    yield from _more_maps(contest, FRICTION, 2)


def _free_friction(contest: Contest) -> Iterator[Trial]:
    data, best = contest.data, contest.best
    if contest.complete or contest.settings.maps == 1:
        return
    for trial in maps_more(data, contest.new("spline", contest.leading(1)), contest.settings, FREE_FRICTION):
        few = data.compared or len(best.found.model.maps) < 2
        if few or data.left_out(trial).mean < CLEARLY**2 * data.left_out(best).mean:
            yield trial


Move = Callable[[Contest], Iterator[Trial]]
MOVES: tuple[Move, ...] = (
    _without_delay,
    _more_steps,
    _other_maps,
    _second_map,
    _products,
    _more_maps,
    _free_form,
)
"""From models whose sensor shows the sign."""
BEFORE_SENSOR: tuple[Move, ...] = (_friction, _free_friction, _more_steps)
"""Before a sensor that loses the sign: other maps may follow a short record better, but hold for its signs only."""
