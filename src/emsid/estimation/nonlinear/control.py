"""`Control`: cancellation, time limit and progress reports of a search.

A search takes a `Control` and checks it between steps, so that it ends only where its result is complete. Numerical
code handles neither signals nor ``KeyboardInterrupt``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf

from emsid.estimation.fit import Ending


@dataclass(frozen=True)
class Activity:
    """A progress report of a search.

    Attributes:
        doing: the activity in a few words: ``rigid-motor: refining 4 starts``.
        done: the number of steps taken.
        total: the number of steps in all; None if unknown.
        cost: the cost after these steps; None if nothing is minimised.
        offset: distance to the linearised minimum in standard errors of the estimate; None if nothing is minimised.
    """

    doing: str
    done: int = 0
    total: int | None = None
    cost: float | None = None
    offset: float | None = None


class Stopped(Exception):
    """Raised if a `Control` ends the work before there is a result.

    `Control.check` raises it. A search that has a result by then catches it and returns this result with its ending;
    the exception reaches the caller only if nothing was found.

    Args:
        ending: `Ending.INTERRUPTED` or `Ending.OUT_OF_BUDGET`.
    """

    def __init__(self, ending: Ending) -> None:
        why = "interrupted" if ending is Ending.INTERRUPTED else "the time was up"
        super().__init__(f"{why} before anything was found")
        self.ending = ending


@dataclass(frozen=True)
class Control:
    """Cancellation, time limit and progress reports of a search.

    Args:
        deadline: end of the allowed time, on the clock of `time.monotonic`.
        cancelled: whether the search has been cancelled. Once true, it stays true. Several threads may call it.
        report: called with every `Activity`.
    """

    deadline: float = inf
    cancelled: Callable[[], bool] = lambda: False
    report: Callable[[Activity], None] = lambda activity: None

    def within(self, seconds: float) -> Control:
        """The same with at most this much time from now on."""
        return replace(self, deadline=min(self.deadline, time.monotonic() + seconds))

    def sharing(self, parts: int) -> Control:
        """The same for the first of several parts of the work: it may take its share of the time that is left."""
        left = self.deadline - time.monotonic()
        return self if left == inf else self.within(max(left, 0.0) / parts)

    def during(self, what: str) -> Control:
        """The same for a part of the work: ``what`` is put before every activity that it reports."""

        def report(activity: Activity) -> None:
            doing = f"{what}: {activity.doing}" if activity.doing else what
            self.report(replace(activity, doing=doing))

        return replace(self, report=report)

    def quietly(self) -> Control:
        """The same without reports."""
        return Control(self.deadline, self.cancelled)

    @property
    def ending(self) -> Ending | None:
        """How the search has to end now; None if it may go on."""
        if self.cancelled():
            return Ending.INTERRUPTED
        return Ending.OUT_OF_BUDGET if time.monotonic() > self.deadline else None

    def check(self) -> None:
        """Check whether the search may go on.

        Raises:
            Stopped: if it has to end.
        """
        if (ending := self.ending) is not None:
            raise Stopped(ending)

    def doing(self, what: str, done: int = 0, total: int | None = None) -> None:
        """Report an activity, and check whether the search may go on.

        Raises:
            Stopped: if it has to end.
        """
        self.report(Activity(what, done, total))
        self.check()


FREE = Control()
"""No limit, no reports."""
