r"""The choice among models that a short record does not tell apart: the one that agrees with the others beyond it.

Several structures fit a short record equally well and differ where it has no data: a limit and a bent line look the
same until the signal goes further. What they say there cannot be compared with measurements, but with one another.
Model j is the right one with a probability that Schwarz's criterion approximates,

    w_j ∝ exp(−(n log MSE_j + p_j log n) / 2τ),

from its mean square error and number of parameters, for n independent errors. With τ = 1 these weights hold if one of
the models is right; all of them are approximations, so they are weighted less differently. The choice k is expected to
differ least from the right one on larger inputs:

    min_k Σ_j w_j mean |ŷ_k − ŷ_j|.

A model that is alone in what it says there is not chosen, even if it fits the record a little better. Models with so
many parameters that the record alone does not show how good they are take no part, but for the best one.

References:
    Kass, Raftery, *Bayes factors*, Journal of the American Statistical Association 90 (1995), on the weights.
    Grünwald, van Ommen, *Inconsistency of Bayesian inference for misspecified linear models, and a proposal for
    repairing it*, Bayesian Analysis 12 (2017), on τ > 1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.feedback.search.trials import Bench, Trial, larger_runs
from emsid.selection.improvement import schwarz_gain

Array = NDArray[np.float64]

# τ: a gain of Schwarz's criterion by 2τ makes a model e times as probable.
TEMPER = 10.0
# Models of a smaller weight, relative to the largest, are left out.
LEAST_WEIGHT = 1e-3


def agreeing(bench: Bench, trials: Sequence[Trial], best: Trial) -> Trial:
    """The model that agrees most with the others on larger inputs; the best one so far if there is no other.

    Models that are of no use from the initial states that a user knows take no part.

    Args:
        bench: the data of a short record.
        trials: models that do not run away, among them the best one.
        best: so far.
    """
    gains = _gains(trials, best)
    weights = np.exp((gains - gains.max()) / (2 * TEMPER))
    probable = [(each, float(w)) for each, w in zip(trials, weights, strict=True) if w > LEAST_WEIGHT]
    probable = [pair for pair in probable if bench.is_of_use(pair[0])] or probable
    least = max(each.found.model.memory for each, _ in probable)
    runs = [_beyond(bench, each, least) for each, _ in probable]

    def expected(one: Array) -> float:
        return sum(w * float(np.abs(one - other).mean()) for (_, w), other in zip(probable, runs, strict=True))

    return probable[int(np.argmin([expected(one) for one in runs]))][0]


def leading(trials: Sequence[Trial], best: Trial, number: int) -> list[Trial]:
    """The most probable ones of the models of a short record, the best first; see `agreeing`."""
    return [trials[k] for k in np.argsort(-_gains(trials, best), kind="stable")[:number]]


def _gains(trials: Sequence[Trial], best: Trial) -> Array:
    """How much better each is than the best one so far, by Schwarz's criterion."""
    independent = effective_samples(best.found.minimum.residuals)
    than, count = _mean_square(best), best.parameters
    return np.array([schwarz_gain(_mean_square(each), than, independent, each.parameters - count) for each in trials])


def _mean_square(trial: Trial) -> float:
    """The mean square error; not zero, so that weights of exact models can be compared."""
    return float(max(trial.found.error**2, np.finfo(float).tiny))


def _beyond(bench: Bench, trial: Trial, least: int) -> Array:
    """(K,) the output of a model on larger inputs than those of the record, of segments with more samples than these.

    Models of different orders are fitted to different segments, as each needs samples for its initial state.
    """
    model = trial.found.model
    begun = zip(bench.segments(model), trial.found.states, strict=True)
    segments, states = zip(*((s, x) for s, x in begun if len(s[0]) > least), strict=True)
    runs = larger_runs(model, segments, states)
    return np.concatenate([run.y[:: model.oversampling] for run in runs])
