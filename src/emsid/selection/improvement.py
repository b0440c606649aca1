"""Whether a model is better by more than noise: the one rule by which every choice between models is made.

Models are compared by the mean square error of their free run on data held back from the fit, from simple to complex. A
more complex one is chosen only where it lowers that error by a part that chance does not explain. How large that part
is depends on how many independent errors the held-back data hold, so on how long an error lasts in the free run of this
kind of model; the three sizes stand here, and nowhere else.
"""

from __future__ import annotations

from enum import Enum


class Gain(Enum):
    """By which part a more complex model has to lower the mean square error, for each kind of model."""

    REGRESSION = 1 / 101  # errors of a difference equation last a few samples: e ≤ 1.01 of the smallest is as good
    CASCADE = 1 - 0.98**2  # errors last as long as the filters: 2 % of the root mean square
    PLANT = 0.1  # a free run drifts, and its errors last for seconds: a gain of a few percent is chance


def limit(error: float, gain: Gain) -> float:
    """The mean square error that a more complex model must be below, to replace one with this error."""
    return (1.0 - gain.value) * error


def better(error: float, than: float, gain: Gain) -> bool:
    """Whether a mean square error is smaller than another one by more than noise.

    Args:
        error: of the more complex model.
        than: of the simpler one.
        gain: how much it has to be, for this kind of model.
    """
    return error < limit(than, gain)


def as_good(error: float, smallest: float, gain: Gain) -> bool:
    """Whether a simpler model is as good as the best one: the best is not better by more than noise."""
    return error <= smallest or not better(smallest, error, gain)
