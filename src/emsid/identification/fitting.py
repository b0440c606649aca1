"""The fits of all requested models to a record: one after the other here, and some of them elsewhere meanwhile.

Where nobody asked for models by name, those with blocks come last, as they take longest, and only if the inputs still
explain something of what the best of the others leaves (`remainder`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from threading import RLock
from time import monotonic
from typing import Any, Protocol

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.borders import border
from emsid.estimation.fit import Ending, Fit, fit_or_problem
from emsid.estimation.nonlinear.control import Activity, Control, Stopped
from emsid.estimation.threads import sharing_cores
from emsid.findings import Finding
from emsid.identification.candidates import CANDIDATES, QUICK
from emsid.identification.observations import failure
from emsid.identification.remainder import leaves_nothing
from emsid.models.bootstrap import bootstrap as drawn_again
from emsid.options import Options
from emsid.record import Record

Submit = Callable[[str], Future[Fit[Any]]]


class Elsewhere(Protocol):
    """A place that fits models beside this process."""

    def __call__(self, record: Record, options: Options) -> Submit:
        """Begin it; what is returned takes the name of a model, and gives the future of its fit."""
        ...


LAST, WAIT = 0.5, 0.02
"""Seconds that an interrupted search elsewhere may take to end, and between looks at the control meanwhile."""


class Queue:
    """Models in line for two places: this process takes the first of them, the other place the last one, when free.

    Args:
        names: of the models.
        submit: gives one to the other place.
    """

    def __init__(self, names: Sequence[str], submit: Submit | None) -> None:
        self._names, self._submit, self._lock = deque(names), submit, RLock()
        self._begun: dict[str, Future[Fit[Any]]] = {}
        if submit is not None and len(names) > 1:
            self._begin_next()

    def _begin_next(self, _: Future[Fit[Any]] | None = None) -> None:
        with self._lock:
            if not self._names or self._submit is None:
                return
            with suppress(RuntimeError):  # the other place has ended
                self._begun[self._names[-1]] = future = self._submit(self._names[-1])
                self._names.pop()
                future.add_done_callback(self._begin_next)

    def __iter__(self) -> Iterator[tuple[str, Future[Fit[Any]] | None]]:
        """Every model, with its future where it is fitted at the other place; these last."""
        while self._names or self._begun:
            with self._lock:
                name = self._names.popleft() if self._names else next(iter(self._begun))
                future = self._begun.pop(name, None)
            yield name, future


def _answer(future: Future[Fit[Any]] | None, control: Control) -> Fit[Any] | None:
    """The fit from the other place; None where there is none, or where it meets a problem that is not of the data.

    Raises:
        EmsidError: where the model cannot be fitted.
    """
    ended = inf
    while future is not None and monotonic() < ended + LAST:
        try:
            return future.result(timeout=WAIT)
        except TimeoutError:
            ended = inf if control.ending is None else min(ended, monotonic())
        except EmsidError:
            raise
        except (Stopped, Exception):
            return None
    return None


@dataclass(frozen=True)
class Fits:
    """The models that were fitted, those that could not be, whether this was stopped early, and what was not begun.

    What was asked for by one name may be a model of another name, as a motor whose shaft the data do not show.
    """

    fits: tuple[Fit[Any], ...]
    failed: tuple[Finding, ...]
    stopped: bool
    missing: tuple[str, ...]
    not_needed: tuple[Finding, ...] = ()


@dataclass
class _UnderWay:
    """What was found so far, by the names that were asked for.

    Attributes:
        fits, problems: of each model.
        late: the models for which no time was left.
        end: what ended the searches early.
        not_needed: the models that were left out, and which one leaves nothing for them.
    """

    fits: dict[str, Fit[Any]] = field(default_factory=dict)
    problems: dict[str, EmsidError] = field(default_factory=dict)
    late: list[str] = field(default_factory=list)
    end: Stopped | None = None
    not_needed: Finding | None = None

    def of(self, names: Sequence[str]) -> Fits:
        """The result, in the order of the names.

        Raises:
            EmsidError: of the first model, where none can be fitted.
            Stopped: where it was stopped before any was found.
        """
        problems = {name: self.problems[name] for name in names if name in self.problems}
        if not self.fits:
            raise self.end or next(iter(problems.values()), Stopped(Ending.OUT_OF_BUDGET))
        failed = [failure(name, problem) for name, problem in problems.items()]
        failed += [Finding("models-out-of-time", data={"models": list(self.late)})] if self.late else []
        by_model = {self.fits[name].model.name: self.fits[name] for name in names if name in self.fits}
        spared = () if self.not_needed is None else (self.not_needed,)
        left_out = [name for each in spared for name in each.data["models"]]
        missing = [name for name in names if name not in (*self.fits, *problems, *self.late, *left_out)]
        return Fits(tuple(by_model.values()), tuple(failed), self.end is not None, tuple(missing), spared)


@dataclass(frozen=True, eq=False)
class Searches:
    """The searches for all models.

    Args:
        names: of the models.
        record: what they are fitted to.
        options: how.
        control: when to stop; of a time limit every fit gets an equal share.
        finished: called with every fit.
        elsewhere: where some of them are fitted at the same time.
        later: the number of fits that follow; where there are any, these here only compare.
        by_need: whether models with ``for_what_is_left`` are fitted only where the others leave something.
    """

    names: Sequence[str]
    record: Record
    options: Options
    control: Control
    finished: Callable[[Fit[Any]], None] | None = None
    elsewhere: Elsewhere | None = None
    later: int = 0
    by_need: bool = False

    @property
    def _how(self) -> Options:
        return replace(self.options, comparing=self.later > 0)

    @property
    def _first(self) -> Sequence[str]:
        """The models that are fitted before it is asked whether others are needed."""
        return [name for name in self.names if not (self.by_need and _for_what_is_left(name))]

    def order(self, names: Sequence[str]) -> Sequence[str]:
        """Some of the models in the order in which they are taken here; the other place takes the last one first.

        The slow ones come last: they often take as long as all others together, so one place begins with them.
        """
        return sorted(names, key=_for_what_is_left) if self.elsewhere else names

    def all(self) -> Fits:
        """The fits of all models.

        Raises:
            EmsidError: of the first model, where none can be fitted.
            Stopped: where it is stopped before any is found.
        """
        found, first = _UnderWay(), self._first
        rest = [name for name in self.names if name not in first]
        self._round(first, found, 0)
        if rest and found.end is None:
            found.not_needed = self._not_needed(rest, found)
            if found.not_needed is None:
                self._round(rest, found, len(first))
        if not found.fits:
            self._search_without_limit(found)
        return found.of(self.names)

    def with_rest(self, found: Fits) -> Fits:
        """The same with the models that were left out; unchanged where none of them can be fitted."""
        names = [name for each in found.not_needed for name in each.data["models"]]
        more = None
        with suppress(Stopped), border("models that were left out at first", expected=True):
            more = replace(self, names=names, by_need=False).all()
        if more is None:
            return found
        return Fits((*found.fits, *more.fits), (*found.failed, *more.failed), more.stopped, more.missing)

    def _round(self, names: Sequence[str], found: _UnderWay, done: int) -> None:
        """Fit some of the models, of which others are done."""
        submit = self.elsewhere(self.record, self._how) if self.elsewhere and len(names) > 1 else None
        for k, (name, there) in enumerate(Queue(self.order(names), submit), done):
            if found.end is not None and there is None:  # what has begun elsewhere may have a result
                continue
            own = self.control.sharing(len(self.names) - k + self.later)
            self._search(name, there, of_one_model(own, f"{name} ({k + 1} of {len(self.names)})"), found)

    def _not_needed(self, names: Sequence[str], found: _UnderWay) -> Finding | None:
        """That models are left out, as the inputs explain nothing of what the best of the others leaves."""
        self.control.report(Activity("what the models leave"))
        best = None
        with border("what the models leave"):
            best = leaves_nothing(list(found.fits.values()), self.record)
        if best is None:
            return None
        return Finding("models-not-needed", best.model.name, {"model": best.model.name, "models": list(names)})

    def _search_without_limit(self, found: _UnderWay) -> None:
        """Fit one of the models that take about a second and that a very short time left no share to, if there is one.

        A short limit then costs models, and not the result.
        """
        name = next((name for name in found.late if name in QUICK), None)
        if name is not None:
            found.late.remove(name)
            self._search(name, None, of_one_model(replace(self.control, deadline=inf), name), found)

    def _search(self, name: str, there: Future[Fit[Any]] | None, control: Control, found: _UnderWay) -> None:
        """Add the fit of a model to what was found, or why there is none."""
        try:
            with border(name, report=lambda problem: found.problems.update({name: problem})):
                control.report(Activity("fitting"))
                fit = _answer(there, control)
                with sharing_cores(2 if self.elsewhere else 1):
                    found.fits[name] = fit = fit or self._fitted_here(name, control)
                if fit.ending is Ending.INTERRUPTED:
                    found.end = Stopped(Ending.INTERRUPTED)
            if name in found.fits and self.finished is not None:
                with border(f"use of {name} while others are fitted", name):
                    self.finished(found.fits[name])
        except Stopped as stop:
            if stop.ending is Ending.INTERRUPTED:
                found.end = stop
            else:
                found.late.append(name)

    def _fitted_here(self, name: str, control: Control) -> Fit[Any]:
        control.check()
        return fit_or_problem(partial(CANDIDATES[name], self.record, self._how, control))


def _for_what_is_left(name: str) -> bool:
    """Whether a kind of model is only fitted where others leave something, unless somebody asks for it."""
    return getattr(CANDIDATES[name], "for_what_is_left", False)


def of_one_model(control: Control, name: str) -> Control:
    """The same control, with the name of a model in front of every activity."""
    return replace(control, report=lambda a: control.report(Activity(f"{name}: {a.doing}", a.done, a.total)))


def with_bootstrap(found: Fits, record: Record, count: int, seed: int, control: Control) -> Fits:
    """The models with intervals from drawn pieces of the record, as far as they can be fitted again."""
    if not count or found.stopped:
        return found
    fits, failed = list(found.fits), list(found.failed)
    for k, fit in enumerate(fits):
        own = of_one_model(control, f"{fit.model.name} (bootstrap {k + 1} of {len(fits)})")
        name = fit.model.name

        def left_out(problem: EmsidError, name: str = name) -> None:
            failed.append(failure(name, problem, "no-bootstrap"))

        try:
            with border(name, report=left_out):
                fits[k] = drawn_again(fit, record, count, rng=np.random.default_rng(seed), control=own)
        except Stopped as stop:
            return replace(found, fits=tuple(fits), failed=tuple(failed), stopped=stop.ending is Ending.INTERRUPTED)
    return replace(found, fits=tuple(fits), failed=tuple(failed), missing=())
