"""Whether a model is better by more than noise. Every choice between models uses this rule.

Models are compared, from simple to complex, by the mean square error of their free run on unseen data. A more complex
model is chosen only if it lowers that error by more than chance explains. The threshold depends on the number of
independent errors in the unseen data, and so on the correlation time of the free-run errors of this kind of model. The
three thresholds are defined here only.

Refinements of a plant are compared on the record that they were fitted to, by Schwarz's criterion, since the end of a
record shows little of what a refinement changes; the number of samples in it is that of independent errors.

References:
    Schwarz, *Estimating the dimension of a model*, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

from enum import Enum
from math import inf, log


class Gain(Enum):
    """The relative reduction of the mean square error that a more complex model must reach, by kind of model."""

    REGRESSION = 1 / 101  # errors of a difference equation last a few samples: up to 1.01 times the smallest is as good
    CASCADE = 1 - 0.98**2  # errors last as long as the impulse responses: 2 % of the root mean square
    PLANT = 0.1  # a free run drifts, and its errors last for seconds: a gain of a few percent is chance


def limit(error: float, gain: Gain) -> float:
    """The mean square error below which a more complex model replaces one with this error."""
    return (1.0 - gain.value) * error


def better(error: float, than: float, gain: Gain) -> bool:
    """Whether a mean square error is smaller than another one by more than noise.

    Args:
        error: of the more complex model.
        than: of the simpler one.
        gain: the threshold for this kind of model.
    """
    return error < limit(than, gain)


def as_good(error: float, smallest: float, gain: Gain) -> bool:
    """Whether a simpler model is as good as the best: the best is not better by more than noise."""
    return error <= smallest or not better(smallest, error, gain)


def schwarz_gain(error: float, than: float, samples: float, parameters: int) -> float:
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
