"""What other models leave of an output, to tell that a record is of another kind of system than a plant."""

from __future__ import annotations

from collections.abc import Callable

UNEXPLAINED, WORSE = 0.1, 4.0
"""A plant is refined no further if its error after the first round is more than this share of the output's variance,
and this many times that of another model. Simulated motors without refinements have up to half of that error."""


class Reference:
    """What other models leave of the output's variance in free run.

    Attributes:
        linear: a linear model.
        by_regression: a nonlinear regression; None where it was not asked for.
    """

    def __init__(self, linear: float, regression: Callable[[], float] | None) -> None:
        self.linear, self._regression = linear, regression
        self.by_regression: float | None = None

    def is_much_less(self, left: float) -> bool:
        """Whether one of them leaves much less than this share, which is large."""
        if left <= UNEXPLAINED:
            return False
        if left > WORSE * self.linear:
            return True
        if self._regression is not None:
            self.by_regression = self._regression()
        return self.by_regression is not None and left > WORSE * self.by_regression
