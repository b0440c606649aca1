r"""The fits of all requested models to a record: one after the other here, and some of them elsewhere meanwhile.

Where nobody asked for models by name, a state space of many modes comes after the others, and those with blocks last,
as they take longest, both only if the inputs still explain something of what the best one so far leaves.

What the inputs and its own past still explain of the error of a free run.

The error e(t) is regressed on what the model has seen and done: the inputs u, its output ŷ, their powers, magnitudes
and signs and the products u·ŷ, each as it is and through lags of several lengths,

    e(t) ≈ Σᵢₖ cᵢₖ Gₖ sᵢ(t),    G₀ = 1,  Gₖ = (1 − aₖ)/(1 − aₖ q⁻¹).

The lags of 2, 8, 32, 128 samples span responses from those of a sample to those of the slowest drives. The error one
sample ago is a further column: a map between two filters is not among these functions, so larger models are tried where
the error follows from its own past, too. Coefficients are estimated on four fifths of the samples, in stretches, and
judged on the fifth left out, in turn. A true model leaves white noise, of which one stretch explains nothing in another
one, so the share is about zero there, and a little negative. It says whether a larger model can find anything of these
kinds; a significance test would ask for larger models in every long record, however little they gain.

The likelihood profiles that were asked for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from math import inf
from threading import RLock
from time import monotonic
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.borders import border
from emsid.estimation.fit import Ending, Fit, fit_or_problem
from emsid.estimation.linear.filtering import filtered_from
from emsid.estimation.nonlinear.control import Activity, Control, Stopped
from emsid.estimation.threads import sharing_cores
from emsid.findings import Finding
from emsid.identification.candidates import CANDIDATES, QUICK
from emsid.identification.evidence import failure
from emsid.models.bootstrap import bootstrap as drawn_again
from emsid.models.model import Run
from emsid.models.plants.parameters import parts
from emsid.models.plants.search.diagnostics import Profile, likelihood_profile
from emsid.models.plants.search.result import has_physical_parameters
from emsid.options import Options
from emsid.record import Record
from emsid.selection.improvement import NEGLIGIBLE
from emsid.validation.comparison import Assessment, assess

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
    def _rounds(self) -> Iterator[list[str]]:
        """The models in the order in which it is asked whether the next of them are needed."""
        rank = {name: self.by_need * _for_what_is_left(name) for name in self.names}
        for each in sorted(set(rank.values())):
            yield [name for name in self.names if rank[name] == each]

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
        found, done = _UnderWay(), list[str]()
        for names in self._rounds:
            if done and found.end is None:
                found.not_needed = self._not_needed([name for name in self.names if name not in done], found)
            if found.end is None and found.not_needed is None:
                self._round(names, found, len(done))
                done += names
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


def _for_what_is_left(name: str) -> int:
    """After how many rounds a kind of model is fitted, where something is left, unless somebody asks for it."""
    return getattr(CANDIDATES[name], "for_what_is_left", 0)


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


Array = NDArray[np.float64]

LAGS = (2, 8, 32, 128)
"""Samples of the time constants of the lags."""
PARTS, STRETCHES = 5, 4
"""Parts that are left out in turn, each of several stretches of the record."""
SHRUNK = 0.01
"""The weight of a prior of zero on every coefficient of a column of unit power, as a share of the samples: directions
in which the columns hardly differ would follow noise, and explain nothing elsewhere."""
PER_COLUMN = 10
"""The fewest samples for each column of the regression. So noise costs at most a tenth on the parts left out; where
more is lost, the error is no noise: it is of another kind in one part of the record than in another."""
LACKS = frozenset({"effect-missing", "parameter-changes", "value-contradicted", "free-run-drifts"})
"""Findings of a fit that name what it lacks."""


def leaves_nothing(fits: Sequence[Fit[Any]], record: Record) -> Fit[Any] | None:
    """The fit with the smallest free-run error, if a larger model can find nothing in what it leaves; else None.

    Args:
        fits: of any models.
        record: what they were fitted to.
    """
    found: list[Assessment] = []
    for fit in fits:
        with suppress(EmsidError):
            found.append(assess(fit, record))
    if not found:
        return None
    assessed = min(found, key=lambda each: each.row.ranked_by)
    best, run = assessed.fit, assessed.simulation
    lacks = best.ending.before_minimum or any(each.code in LACKS for each in best.findings)
    if lacks:
        return None
    share = explained_share(record, run)
    return best if share is not None and -1 / PER_COLUMN <= share <= NEGLIGIBLE else None


def explained_share(record: Record, run: Run) -> float | None:
    """The share of the mean square error of a free run that can be explained on stretches left out.

    Args:
        record: measured.
        run: the free run over it.

    Returns:
        Of the output of which it is largest; about zero or negative where only noise is left; None for a record that is
        too short to tell, or a run that diverges.
    """
    counted = run.counted & np.isfinite(run.output).all(axis=1)
    if run.diverged_at is not None or not counted.any():
        return None
    errors = np.where(counted[:, None], record.output - run.output, 0.0)
    columns = _columns(record, run.output, errors)[counted]
    if len(columns) < PER_COLUMN * columns.shape[1]:
        return None
    return max(_left_out(columns, error) for error in errors[counted].T)


def _columns(record: Record, output: Array, errors: Array) -> Array:
    """(N, m) all signals of a record, as they are and through every lag, and the last errors; segments begin anew."""
    signals = [*record.input.T, *np.nan_to_num(output).T]
    scaled = [x / (float(np.abs(x).max()) or 1.0) for x in signals]
    shapes = [shape for x in scaled for shape in (x, x**2, x**3, np.abs(x), np.sign(x))]
    known = record.input.shape[1]
    shapes += [u * y for u, y in product(scaled[:known], scaled[known:])]
    rows = np.array(shapes)
    past = np.roll(errors.T, 1, axis=1)
    past[:, [0, *record.breaks]] = 0.0
    segments = np.split(rows, record.breaks, axis=1)
    lagging = [np.concatenate([_lagging(each, samples) for each in segments], axis=1) for samples in LAGS]
    return np.asarray(np.concatenate([np.ones((1, len(record))), rows, past, *lagging]).T)


def _lagging(rows: Array, samples: int) -> Array:
    """Signals (k, N) through a lag of unit gain, from rest at their first values."""
    a = float(np.exp(-1.0 / samples))
    return filtered_from([1.0 - a], [1.0, -a], rows, a * rows[:, :1])[0]


def _left_out(columns: Array, error: Array) -> float:
    """One minus the ratio of the squared error that a regression leaves on the parts left out to that before."""
    part = np.arange(len(error)) * PARTS * STRETCHES // len(error) % PARTS
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scaled = columns / np.where(scale > 0, scale, 1.0)
    left = 0.0
    for k in range(PARTS):
        out = part == k
        prior = np.sqrt(SHRUNK * np.count_nonzero(~out)) * np.eye(columns.shape[1])
        rows, known = np.vstack([scaled[~out], prior]), np.append(error[~out], np.zeros(columns.shape[1]))
        found = np.linalg.lstsq(rows, known, rcond=None)[0]
        left += float(np.sum((error[out] - scaled[out] @ found) ** 2))
    before = float(error @ error)
    return 1.0 - left / before if before > 0 else 0.0


@dataclass(frozen=True)
class Profiles:
    """The profiles by model, findings about failed profiles, and whether this was stopped."""

    profiles: dict[str, tuple[Profile, ...]]
    failed: tuple[Finding, ...]
    stopped: bool = False


def profiles_of(fits: Sequence[Fit[Any]], names: Sequence[str], control: Control) -> Profiles:
    """The requested profiles; a parameter split by direction or by record has one for each of its parts."""
    profiles: dict[str, tuple[Profile, ...]] = {}
    failed: list[Finding] = []
    for fit in filter(has_physical_parameters, fits):
        plant, model, asked = fit.model.plant, fit.model.name, dict[str, None]()
        for name in names:
            by_record = [row.name for rows in fit.by_record.values() if (row := rows.get(name))]
            for whole in (each for each in by_record or [name] if each in plant.handles):
                asked |= dict.fromkeys([part for part in parts(plant, whole) if part in fit.names] or [whole])
        for number, name in enumerate(asked, 1):

            def fails(problem: EmsidError, model: str = model, name: str = name) -> None:
                data = {"model": model, "reason": str(problem).removeprefix(f"{name}: ")}
                failed.append(Finding("profile-failed", name, data))

            try:
                own = of_one_model(control, f"{model} (profile {number} of {len(asked)})")
                own.doing(name)
                with border(name, report=fails):
                    profile = likelihood_profile(fit, name, control=own)
                    profiles[model] = (*profiles.get(model, ()), profile)
            except Stopped:
                return Profiles(profiles, tuple(failed), stopped=True)
    return Profiles(profiles, tuple(failed))
