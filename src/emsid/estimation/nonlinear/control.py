"""`Control`: when a search has to stop, and who gets reports of what it is doing.

A search takes a `Control` and looks at it between steps. So it can be cancelled, or run out of time, only where its
result is complete. The mathematics knows neither signals nor ``KeyboardInterrupt``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf

from emsid.estimation.fit import Ending


@dataclass(frozen=True)
class Activity:
    """What a search is doing.

    Attributes:
        doing: in a few words: ``rigid-motor: refining 4 starts``.
        done: how many steps of it have been taken.
        total: how many there are, None where nobody knows.
        cost: what the search minimises, after these steps; None where nothing is minimised.
        offset: how far the linearised minimum is, in standard errors of the estimate; None where nothing is minimised.
    """

    doing: str
    done: int = 0
    total: int | None = None
    cost: float | None = None
    offset: float | None = None


class Stopped(Exception):
    """Raised where a `Control` ends the work before there is a result.

    `Control.check` raises it. A search that has found something by then catches it and returns what it has, with how it
    ended; it reaches the caller only where nothing was found.

    Args:
        ending: `Ending.INTERRUPTED` or `Ending.OUT_OF_BUDGET`.
    """

    def __init__(self, ending: Ending) -> None:
        why = "interrupted" if ending is Ending.INTERRUPTED else "the time was up"
        super().__init__(f"{why} before anything was found")
        self.ending = ending


@dataclass(frozen=True)
class Control:
    """When a search has to stop, and who gets reports of what it is doing.

    Args:
        deadline: when the time is up, on the clock of `time.monotonic`.
        cancelled: whether somebody has asked for an end. Once true, it stays true. Several threads may ask.
        report: called with every `Activity`.
    """

    deadline: float = inf
    cancelled: Callable[[], bool] = lambda: False
    report: Callable[[Activity], None] = lambda activity: None

    def within(self, seconds: float) -> Control:
        """The same with at most this much time from now on."""
        return replace(self, deadline=min(self.deadline, time.monotonic() + seconds))

    def during(self, what: str) -> Control:
        """The same for a part of the work: every activity reported through it begins with ``what``."""

        def report(activity: Activity) -> None:
            doing = f"{what}: {activity.doing}" if activity.doing else what
            self.report(replace(activity, doing=doing))

        return replace(self, report=report)

    def quietly(self) -> Control:
        """The same without reports."""
        return Control(self.deadline, self.cancelled)

    @property
    def ending(self) -> Ending | None:
        """How the search has to end now; None where it may go on."""
        if self.cancelled():
            return Ending.INTERRUPTED
        return Ending.OUT_OF_BUDGET if time.monotonic() > self.deadline else None

    def check(self) -> None:
        """Go on, or not.

        Raises:
            Stopped: where the search has to end.
        """
        if (ending := self.ending) is not None:
            raise Stopped(ending)

    def doing(self, what: str, done: int = 0, total: int | None = None) -> None:
        """Report an activity, and go on or not.

        Raises:
            Stopped: where the search has to end.
        """
        self.report(Activity(what, done, total))
        self.check()


FREE = Control()
"""No limit, no reports."""
