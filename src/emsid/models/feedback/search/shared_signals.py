"""Maps that share a signal: the last step of a search, which makes the chosen model smaller.

A friction and a spring, or an outflow and an overflow, are several maps of one signal. The search adds its maps one
after the other, each in a direction of its own, and where the data hardly determine these, the signals differ by what
the noise makes of them. On other data they then leave their range, and with it what is known of the map. So the
signals of two maps, the most similar ones first, are made one, and the model is fitted again. It is kept if Schwarz's
criterion and the choice of the search prefer it, which count the parameters that are saved.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.blocks.static_maps import Scaling
from emsid.models.feedback.fitting import visited
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.trials import Bench, Trial
from emsid.selection.improvement import schwarz_gain

Array = NDArray[np.float64]

# Pairs that are tried with one model.
TRIED = 6


def with_shared_signals(bench: Bench, best: Trial) -> Iterator[Trial]:
    """Trials in which more and more maps share a signal, each better than the one before."""
    refused = set[tuple[int, int]]()
    now: Trial | None = best
    while now is not None:
        now = _with_one_more(bench, now, refused)
        if now is not None:
            yield now


def _with_one_more(bench: Bench, best: Trial, refused: set[tuple[int, int]]) -> Trial | None:
    """The model with one more pair of maps that share a signal; None if that makes it worse.

    Args:
        bench: the data.
        best: the model.
        refused: pairs that made it worse; others are added.
    """
    model, states = best.found.model, best.found.states
    seen = visited(model, bench.segments(model), states)
    with np.errstate(invalid="ignore", divide="ignore"):
        alike = np.nan_to_num(np.abs(np.corrcoef(seen.z.T)))
    pairs = [(i, k) for k, i in combinations(range(len(model.maps)), 2) if _may_share(model, i, k)]
    for i, k in sorted(set(pairs) - refused, key=lambda pair: -alike[pair])[:TRIED]:
        bench.control.doing(f"one signal for maps {k + 1} and {i + 1}")
        refused.add((i, k))
        with suppress(EmsidError):
            start = _sharing(model, i, k, seen.x.mean(axis=0), float(seen.u.mean()))
            trial = bench.refined(start, states, best.family, best.size)
            if not _lost(trial, best) and bench.prefers(trial, best):
                return trial
    return None


def _lost(trial: Trial, best: Trial) -> bool:
    """Whether the data are followed worse than the saved parameters justify, by Schwarz's criterion.

    Where samples are few for the parameters of both, the choice of the search asks more of the larger model.
    """
    independent, saved = effective_samples(best.found.minimum.residuals), best.parameters - trial.parameters
    return schwarz_gain(best.found.error**2, trial.found.error**2, independent, saved) > 0


def _may_share(model: FeedbackModel, i: int, k: int) -> bool:
    """Whether two maps have signals of their own, of which one may be a multiple of the other."""
    free = any(model.maps[each].scaling is not Scaling.NONE for each in (i, k))
    return free and not {i, k} & {each for each, _ in model.shared}


def _sharing(model: FeedbackModel, i: int, k: int, x: Array, u: float) -> FeedbackModel:
    """The model in which z of map i is the closest multiple of that of map k, with the same mean at x and u."""
    same, n, offsets = replace(model, shared=(*model.shared, (i, k))), model.states, model.map_offsets.copy()
    if not model.maps[i].absorbs_shift:
        moved = (model.matrix - same.matrix)[n + i, : n + 1]
        offsets[i] += moved[:n] @ x + moved[n] * u
    return replace(same, map_offsets=offsets)
