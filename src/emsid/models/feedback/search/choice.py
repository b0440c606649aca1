r"""Choice of order, rate, static maps and their number by the free run on unseen data.

The search begins with linear models and those with one map, or before a sensor that loses the sign. Then it makes the
moves of a table, in turn, from the best model, as long as one of them leads to a better one (`SearchData.prefers`, by
`emsid.selection.improvement`). Maps are added to several models: where a map is missing, the residual is a slow signal
with few independent errors, so the rule that compares models prefers those with few parameters, but the next map may
only find its place beside one that explains more. A model that leaves white noise, of which a further map explains no
more than chance, gets no other maps. In the end the signals of the chosen model are shared where the data allow it.

A model whose free run diverges on an input a little larger than that of the record, forward or backward in time, is not
chosen.

**First models.** For every order there are a linear one, and those with one map. The map is in the direction that
explains most. Every order is tried with a polynomial, a dead zone and a speed that sticks (`sticking`), alone and
behind a dead zone; a spline is tried where a direction explains more, but none of these is better than no map.

**Shared signals.** The last step of a search makes the chosen model smaller. The force of a spring adds to the input,
and depends on the position that is measured; a friction and a back-EMF are functions of one speed. A fit gives every
map a direction of its own, into it and out of it, and where the data hardly determine these, they differ by what the
noise makes of them. On other data the signals then leave their range, and with it what is known of the map. So two
signals are made one, and the model is fitted again: z of a map with the output, or with z of another map; w of a map
with the input, so that both act by the same states, or with w of another map. It is kept if Schwarz's criterion and the
choice of the search prefer it, which count the parameters that are saved.

The pairs are tried in the order of what they cost. Where signals are one, n conditions Gθ = 0 hold; with the derivative
J of the residual, the minimum under them is, to first order,

    θ − (JᵀJ)⁻¹Gᵀ(G(JᵀJ)⁻¹Gᵀ)⁻¹Gθ,      and the sum of squares grows by      (Gθ)ᵀ(G(JᵀJ)⁻¹Gᵀ)⁻¹Gθ

(Wald). The fit begins there.

References:
    Wald, *Tests of statistical hypotheses concerning several parameters when the number of observations is large*,
    Transactions of the American Mathematical Society 54 (1943).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import inf
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.blocks.search.map_families import Family, family_of
from emsid.models.blocks.static_maps import Scaling
from emsid.models.feedback.coordinates import coordinates, rows_of
from emsid.models.feedback.equations import Pair
from emsid.models.feedback.fitting import Found, FreeRun, visited
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.moves import (
    CLEARLY,
    FREE_FORM,
    FREE_FRICTION,
    FRICTION,
    MORE,
    OTHERS,
    STICKING,
    Maps,
    maps_more,
    more_steps,
    with_map_more,
    with_other_maps,
    with_products,
    with_speed_that_sticks,
    without_delay,
)
from emsid.models.feedback.search.rectified_output import with_sensor
from emsid.models.feedback.search.trials import (
    BEAM,
    LONGEST,
    MOST_MAPS,
    MOST_ORDERS,
    ORDERS,
    FeedbackSearch,
    SearchData,
    Steps,
    Trial,
    much_worse,
)
from emsid.record import Record
from emsid.selection.improvement import matters, schwarz_gain


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


# --- first models -----------------------------------------------------------------------------------------------------

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


Array = NDArray[np.float64]

# --- shared signals ---------------------------------------------------------------------------------------------------

# Pairs that are tried with one model, and the share of a direction that is added to what the data say of it.
TRIED, RIDGE = 6, 1e-8
# How often a pair is tried, where its search does not end at a minimum.
AGAIN = 2


def with_shared_signals(data: SearchData, best: Trial) -> Iterator[Trial]:
    """Trials in which more and more signals are shared, each better than the one before."""
    refused = Counter[Pair]()
    now: Trial | None = best
    while now is not None:
        now = _with_one_more(data, now, refused)
        if now is not None:
            yield now


def _with_one_more(data: SearchData, best: Trial, refused: Counter[Pair]) -> Trial | None:
    """The model with one more shared signal; None if that makes it worse.

    Args:
        data: of the search.
        best: the model.
        refused: how often each pair made it worse, which is counted here. A search that ended at a minimum counts
            twice; another one may go farther when more signals are shared.
    """
    pairs = [pair for pair in _pairs(best.found.model) if refused[pair] < AGAIN]
    starts = sorted(_starts(best.found, data, pairs), key=attrgetter("cost"))
    for pair, _, model, states in starts[:TRIED]:
        data.control.doing(f"{pair[0]} a multiple of {pair[1]}")
        refused[pair] += 1
        with suppress(EmsidError):
            trial = data.refined(model, states, best.family, best.size)
            unfinished = trial.found.minimum.ending is Ending.OUT_OF_BUDGET and not data.compared
            if unfinished:  # the next pair would begin far from the minimum
                trial = data.refined(trial.found.model, trial.found.states, best.family, best.size)
            if not _lost(trial, best) and data.prefers(trial, best):
                return trial
            refused[pair] += not trial.found.minimum.ending.before_minimum
    return None


def _lost(trial: Trial, best: Trial) -> bool:
    """Whether the data are followed worse than the saved parameters justify, by Schwarz's criterion.

    Where samples are few for the parameters of both, the choice of the search asks more of the larger model.
    """
    independent, saved = effective_samples(best.found.minimum.residuals), best.parameters - trial.parameters
    return schwarz_gain(best.found.error**2, trial.found.error**2, independent, saved) > 0


def _pairs(model: FeedbackModel) -> Iterator[Pair]:
    """Pairs of signals of which one may be made a multiple of the other, whose unit the map in between can take."""
    z, w, shared = model.numbered("z"), model.numbered("w"), {first for first, _ in model.shared}
    units = [each.scaling is not Scaling.NONE for each in model.maps]
    for i, free in enumerate(units):
        if z[i] not in shared:
            yield from ((z[i], z[k]) for k in range(i) if z[k] not in shared and (free or units[k]))
            yield from [(z[i], "y")] * free
        if w[i] not in shared:
            yield from ((w[i], w[k]) for k in range(i) if w[k] not in shared and (free or units[k]))
            yield from [(w[i], "u")] * free


class Start(NamedTuple):
    """A model with one more shared signal.

    Attributes:
        pair: of the signals.
        cost: what the sum of squares grows by, to first order.
        model, states: where a fit begins.
    """

    pair: Pair
    cost: float
    model: FeedbackModel
    states: list[Array]


def _starts(found: Found, data: SearchData, pairs: Sequence[Pair]) -> Iterator[Start]:
    """The minima under the conditions of each pair, to first order."""
    model, segments = found.model, data.segments(found.model)
    if not pairs:
        return
    spread = coordinates(model, visited(model, segments, found.states))
    problem = FreeRun(model, spread, segments, model.edge)
    rows = [rows for _, rows in problem.linearised(np.concatenate([np.zeros(spread.shape[1]), *found.states]))]
    size = np.linalg.norm(np.concatenate(rows), axis=0)
    size[size == 0] = 1.0
    ridge = RIDGE * np.eye(len(size))
    triangle = np.linalg.qr(np.concatenate([*(each / size for each in rows), ridge]), mode="r")
    for pair in pairs:
        conditions = rows_of(model, pair, True)
        moved = np.pad(conditions @ spread, ((0, 0), (0, len(size) - spread.shape[1]))) / size
        apart = conditions @ model.parameters
        across = solve_triangular(triangle, moved.T, trans="T")
        weights = np.linalg.lstsq(across.T @ across, apart, rcond=None)[0]
        step = -solve_triangular(triangle, across @ weights) / size
        free, ends = np.split(step, [spread.shape[1]])
        there = replace(model.with_parameters(model.parameters + spread @ free), shared=(*model.shared, pair))
        states = [x + dx for x, dx in zip(found.states, ends.reshape(-1, model.states), strict=True)]
        yield Start(pair, float(apart @ weights), there, states)
