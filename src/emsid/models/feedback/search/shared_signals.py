r"""Signals that maps share: the last step of a search, which makes the chosen model smaller.

The force of a spring adds to the input, and depends on the position that is measured; a friction and a back-EMF are
functions of one speed. A fit gives every map a direction of its own, into it and out of it, and where the data hardly
determine these, they differ by what the noise makes of them. On other data the signals then leave their range, and with
it what is known of the map. So two signals are made one, and the model is fitted again: z of a map with the output, or
with z of another map; w of a map with the input, so that both act by the same states, or with w of another map. It is
kept if Schwarz's criterion and the choice of the search prefer it, which count the parameters that are saved.

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
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.blocks.static_maps import Scaling
from emsid.models.feedback.coordinates import coordinates, rows_of
from emsid.models.feedback.equations import Pair
from emsid.models.feedback.fitting import Found, FreeRun, visited
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.trials import SearchData, Trial
from emsid.selection.improvement import schwarz_gain

Array = NDArray[np.float64]

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
