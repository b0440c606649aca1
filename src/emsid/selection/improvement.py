"""Whether a model is better by more than noise. Every choice between models uses this rule.

Models are compared, from simple to complex, by their free runs over the same samples. The samples are divided into
stretches of equal length, and the mean square errors of two models are paired, stretch by stretch, since both models
meet the same noise in each. A more complex model is chosen if it saves at least `NEGLIGIBLE` of the mean square error,
and if the mean of the paired differences is larger than chance explains: Student's t, one-sided, at the level `CHANCE`,
which is one standard error. Free-run errors last for many samples, and so stretches are long; a correlation ρ that
remains between neighbouring differences multiplies their variance by (1 + ρ)/(1 - ρ).

Ratios of mean squares are compared by their logarithms. A model can be exact in a stretch at standstill, where the
logarithm of its error is -∞, or far below that of others by rounding alone. Mean squares below `EXACT` of the error
over all samples, of the better model, are therefore raised to this limit.

Refinements of a plant are compared on the record that they were fitted to, by Schwarz's criterion, since the end of a
record shows little of what a refinement changes; the number of samples in it is that of independent errors. They save
something in more than one stretch (`steady`).

References:
    Diebold, Mariano, *Comparing predictive accuracy*, Journal of Business & Economic Statistics 13 (1995), on paired
    differences of squared errors.
    Breiman, Friedman, Olshen, Stone, *Classification and Regression Trees* (1984), on one standard error.
    Schwarz, *Estimating the dimension of a model*, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, log
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Array = NDArray[np.float64]

STRETCHES = 16
"""The number of stretches that the samples are divided into."""
NEGLIGIBLE = 0.02
"""A smaller relative reduction of the mean square error (1 % of its root) does not justify another parameter."""
EQUIVALENT = 0.05
"""Root mean square errors that differ by at most this share are the same in practice."""
DIFFERENT = 2.0
"""A mean square error that is larger by this factor differs by more than noise: what another model leaves of it is
less than half, however few stretches it is in."""
UNEVEN = 2.0
"""The ratios of the stretches vary more; they may differ by this multiple of that share."""
EXACT = 1e-4
"""In ratios, the mean square error of a stretch is at least this share of that over all (1 % of its root)."""
CHANCE = 0.16
"""The probability that a model without a real advantage passes the test of paired differences."""


@dataclass(frozen=True, eq=False)
class StretchErrors:
    """The free-run error of a model, stretch by stretch.

    Attributes:
        means: (s,) mean square error of every stretch; infinite where the run diverged, zero where no sample counts.
        samples: (s,) how many samples of each stretch count.
    """

    means: Array
    samples: Array

    @classmethod
    def of(cls, squares: Array, stretches: int = STRETCHES) -> StretchErrors:
        """From squared errors.

        Args:
            squares: (N,) of every sample in order; NaN for samples that do not count, such as a transient.
            stretches: the number of stretches to divide them into.
        """
        counted = [part[~np.isnan(part)] for part in np.array_split(squares, stretches)]
        means = [float(np.mean(part)) if len(part) else 0.0 for part in counted]
        return cls(np.array(means), np.array([float(len(part)) for part in counted]))

    @classmethod
    def joined(cls, several: Sequence[StretchErrors]) -> StretchErrors:
        """The stretches of several parts of the data."""
        return cls(np.concatenate([each.means for each in several]), np.concatenate([each.samples for each in several]))

    def mixed(self, other: StretchErrors, weight: float) -> StretchErrors:
        """The weighted geometric mean with other errors on the same samples; infinite where either is.

        Args:
            other: these errors.
            weight: of their logarithm, between 0 and 1.
        """
        finite = np.isfinite(self.means) & np.isfinite(other.means)
        own, others = (np.where(finite, each.means, 0.0) for each in (self, other))
        return StretchErrors(np.where(finite, own ** (1 - weight) * others**weight, np.inf), self.samples)

    @property
    def mean(self) -> float:
        """The mean square error over all samples; infinite without any."""
        return float(np.average(self.means, weights=self.samples)) if self.samples.any() else inf


def better(model: StretchErrors, than: StretchErrors) -> bool:
    """Whether a more complex model is better than a simpler one by more than noise.

    Args:
        model: the errors of the more complex model.
        than: those of the simpler one on the same samples.
    """
    return _more_than_noise(model, than, lambda model, than: than.means - model.means)


def steady(model: StretchErrors, than: StretchErrors) -> bool:
    """Whether a model saves something, however little, in more than one stretch of the data.

    What is saved in a single stretch has a mean of one standard deviation of that mean, which is no more than chance.

    Args:
        model: the errors of the more complex model.
        than: those of the simpler one on the same samples.
    """
    return not np.isfinite(than.mean) or _more_than_chance(_of_both(than.means - model.means, model, than))


def better_by_ratio(model: StretchErrors, than: StretchErrors) -> bool:
    """Whether a model is better than another by a factor, by more than noise.

    The same test for the logarithms of the mean squares. Where the errors of some stretches are far larger than those
    of the others, the noise of their mean is as large as the mean, and `better` sees nothing; every stretch weighs the
    same here. A single bad stretch, as of a fold that a few steps do not suit, decides nothing.

    Args:
        model: the errors of the model.
        than: those of the other one on the same samples.
    """
    return _more_than_noise(model, than, _log_ratios)


def equivalent(model: StretchErrors, best: StretchErrors) -> bool:
    """Whether a model is as good as the best one in practice, over all samples and by the ratios of the stretches.

    In a long record a difference is more than noise however small it is.

    Args:
        model: the errors of the model.
        best: those of the best one on the same samples.
    """
    if not np.isfinite(model.mean):
        return False
    ratio = float(np.mean(_of_both(-_log_ratios(model, best), model, best)))
    return model.mean <= (1 + EQUIVALENT) ** 2 * best.mean and ratio <= 2 * log(1 + UNEVEN * EQUIVALENT)


def _log_ratios(model: StretchErrors, than: StretchErrors) -> Array:
    """The logarithm of the error of ``than`` over that of a model, by stretch."""
    least = max(EXACT * min(model.mean, than.mean), np.finfo(float).tiny)
    return np.asarray(np.log(np.maximum(than.means, least)) - np.log(np.maximum(model.means, least)))


def _of_both(values: Array, model: StretchErrors, than: StretchErrors) -> Array:
    """Values by stretch, where samples of both models count."""
    return values[(model.samples > 0) & (than.samples > 0)]


def _more_than_noise(
    model: StretchErrors, than: StretchErrors, savings: Callable[[StretchErrors, StretchErrors], Array]
) -> bool:
    """Whether a model saves something that matters, and more, by stretch, than chance explains."""
    if not np.isfinite(than.mean):
        return bool(np.isfinite(model.mean))
    if not matters(model.mean, than.mean):
        return False
    return _more_than_chance(_of_both(savings(model, than), model, than))


def _more_than_chance(saved: Array) -> bool:
    """Whether the mean of what is saved by stretch is larger than chance explains."""
    return len(saved) < 2 or float(np.mean(saved)) > stdtrit(len(saved) - 1, 1 - CHANCE) * _deviation_of_mean(saved)


def matters(error: float, than: float) -> bool:
    """Whether one mean square error is smaller than another by more than a negligible part of it."""
    return error < (1.0 - NEGLIGIBLE) * than


def _deviation_of_mean(values: Array) -> float:
    """The standard deviation of the mean of a series whose neighbours may be correlated."""
    rest = values - values.mean()
    power = float(rest @ rest)
    correlation = max(float(rest[1:] @ rest[:-1]) / power, 0.0) if power > 0 else 0.0
    return float(np.sqrt(power / (len(values) - 1) / len(values) * (1 + correlation) / (1 - correlation)))


def schwarz_gain(error: float, than: float, samples: float, parameters: float) -> float:
    """By how much Schwarz's criterion, n·log MSE + k·log n, prefers a more complex model; negative for the simpler one.

    Args:
        error: mean square error of the more complex model on the data that both were fitted to.
        than: that of the simpler one.
        samples: n, the number of independent errors of the more complex model.
        parameters: how many more parameters it has.
    """
    if not than > 0:
        return -inf
    return (samples * log(than / error) if error > 0 else inf) - parameters * log(samples)


T = TypeVar("T", bound="Compared")


class Compared(Protocol):
    """A model among others, with its free-run errors on unseen data."""

    @property
    def errors(self) -> StretchErrors:
        """On the same samples for all that are compared."""
        ...


def simplest(
    models: Sequence[T], size: Callable[[T], int], *, as_good: Callable[[T, T], bool] = lambda model, best: True
) -> T:
    """The simplest model that is as good as the best, within noise; a smaller one with a smaller error replaces it.

    Noise of paired differences is not the same for every pair: against the best model, a small difference may be
    certain and a larger one may be chance.

    Args:
        models: at least one.
        size: how complex one is: its number of parameters.
        as_good: a further condition on a model and the best one.
    """
    best = min(models, key=lambda model: model.errors.mean)
    good = [
        model for model in models if model is best or (as_good(model, best) and not better(best.errors, model.errors))
    ]
    most = min(map(size, good))
    small = [model for model in models if size(model) <= most and (model is best or as_good(model, best))]
    return min(small, key=lambda each: (each.errors.mean, size(each)))


def front(
    models: Sequence[T], size: Callable[[T], int], *, as_good: Callable[[T, T], bool] = lambda model, best: True
) -> list[T]:
    """The front of accuracy against number of parameters, from simple to complex.

    Each is better than the one before by more than noise. The others have a simpler or equally simple model that is as
    good.

    Args:
        models: compared on the same samples.
        size: how complex one is: its number of parameters.
        as_good: a further condition on a simpler model that is as good as another.
    """
    found: list[T] = []
    for each in sorted(models, key=lambda model: (size(model), model.errors.mean)):
        if not np.isfinite(each.errors.mean):
            continue
        if not found or not as_good(found[-1], each) or better(each.errors, than=found[-1].errors):
            found.append(each)
    return found
