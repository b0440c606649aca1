"""Signals that maps share: the last step of a search, which makes the chosen model smaller.

The force of a spring adds to the input, and depends on the position that is measured; a friction and a back-EMF are
functions of one speed. A fit gives every map a direction of its own, into it and out of it, and where the data hardly
determine these, they differ by what the noise makes of them. On other data the signals then leave their range, and with
it what is known of the map. So two signals are made one, the most similar ones first, and the model is fitted again:
z of a map with the output, or with z of another map; w of a map with the input, so that both act by the same states, or
with w of another map. It is kept if Schwarz's criterion and the choice of the search prefer it, which count the
parameters that are saved.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.blocks.static_maps import Scaling
from emsid.models.feedback.coordinates import Visited, size_of
from emsid.models.feedback.fitting import visited
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.trials import Bench, Trial
from emsid.models.feedback.sharing import Pair
from emsid.selection.improvement import schwarz_gain

Array = NDArray[np.float64]

# Pairs that are tried with one model.
TRIED = 6


def with_shared_signals(bench: Bench, best: Trial) -> Iterator[Trial]:
    """Trials in which more and more signals are shared, each better than the one before."""
    refused = set[Pair]()
    now: Trial | None = best
    while now is not None:
        now = _with_one_more(bench, now, refused)
        if now is not None:
            yield now


def _with_one_more(bench: Bench, best: Trial, refused: set[Pair]) -> Trial | None:
    """The model with one more shared signal; None if that makes it worse.

    Args:
        bench: the data.
        best: the model.
        refused: pairs that made it worse at a minimum; others are added.
    """
    model, states = best.found.model, best.found.states
    seen = visited(model, bench.segments(model), states)
    pairs = sorted((pair for pair in _pairs(model) if pair not in refused), key=lambda pair: -_alike(model, seen, pair))
    for pair in pairs[:TRIED]:
        bench.control.doing(f"{pair[0]} a multiple of {pair[1]}")
        with suppress(EmsidError):
            start = _sharing(model, pair, seen)
            trial = bench.refined(start, states, best.family, best.size)
            if not _lost(trial, best) and bench.prefers(trial, best):
                return trial
            if trial.found.minimum.ending.before_minimum:  # with more signals shared it may go farther
                continue
        refused.add(pair)
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


def _alike(model: FeedbackModel, seen: Visited, pair: Pair) -> float:
    """How similar two signals are: the correlation of what x and u give, or the cosine of how they act on x and y."""
    of, like = (model.matrix[model.entries(name)] for name in pair)
    if pair[0] in model.numbered("z"):
        entering = np.column_stack([seen.x, seen.u])
        a, b = ((entering - entering.mean(axis=0)) @ each for each in (of, like))
    else:
        size = np.append(size_of(seen.x), size_of(seen.y))
        a, b = of / size, like / size
    with np.errstate(all="ignore"):
        cosine = float(np.abs(a @ b) / (np.linalg.norm(a) * np.linalg.norm(b)))
    return cosine if np.isfinite(cosine) else 0.0


def _sharing(model: FeedbackModel, pair: Pair, seen: Visited) -> FeedbackModel:
    """The model in which the first signal is the closest multiple of the second one, with the same mean of a z."""
    same, offsets = replace(model, shared=(*model.shared, pair)), model.map_offsets.copy()
    if pair[0] in model.numbered("z"):
        i, at = model.numbered("z").index(pair[0]), model.entries(pair[0])
        if not model.maps[i].absorbs_shift:
            offsets[i] += (model.matrix - same.matrix)[at] @ np.append(seen.x.mean(axis=0), seen.u.mean())
    return replace(same, map_offsets=offsets)
