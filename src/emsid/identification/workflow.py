"""The steps of `emsid identify`, from records to a ranked list of models.

Each requested model of `candidates` is fitted to a part of the data. The models are ranked by their free run on unseen
data, which no step of a fit uses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any, Protocol

import numpy as np

from emsid.errors import DataError, EmsidError, ModelError
from emsid.estimation.fit import Ending, Fit, fit_or_problem
from emsid.estimation.nonlinear.control import FREE, Activity, Control, Stopped
from emsid.estimation.threads import sharing_cores
from emsid.findings import Finding
from emsid.first_look.advice import questions, responses_of
from emsid.identification.all_data import from_all_data
from emsid.identification.candidates import CANDIDATES, QUICK, usual_for
from emsid.identification.compared import Compared
from emsid.identification.delay import with_delay
from emsid.identification.long_records import about_excerpt, on_all_samples, to_compare
from emsid.identification.observations import (
    built_in_values,
    failure,
    fitted_to_all_data,
    observations,
    out_of_time,
    profile_failure,
)
from emsid.identification.options import Options
from emsid.identification.records import Records, given_records
from emsid.identification.regressions import OF_OUTPUT_ERROR, REGRESSIONS
from emsid.identification.requests import (
    check_physics,
    codes_of_channel,
    model_names,
    plants_of,
    understood,
    unused_requests,
)
from emsid.identification.result import Identification
from emsid.identification.verdict import model_verdicts
from emsid.models.bootstrap import bootstrap as drawn_again
from emsid.models.plants.grey_box import assumptions
from emsid.models.plants.parameters import parts
from emsid.models.plants.search.diagnostics import Profile, likelihood_profile
from emsid.models.plants.search.result import GreyBoxFit
from emsid.record import Record, concatenate
from emsid.record.holding_back import hold_back_records
from emsid.validation.agreement import disagreement
from emsid.validation.comparison import Comparison
from emsid.validation.regions import by_record


class Elsewhere(Protocol):
    """A place where some of the models are fitted at the same time."""

    def begin(self, names: Sequence[str], record: Record, options: Options) -> None:
        """Start to fit some of the models there."""
        ...

    def has_begun(self, name: str) -> bool:
        """Whether a model is fitted there; if not, it is left to the caller."""
        ...

    def fitted(self, name: str, control: Control) -> Fit[Any] | None:
        """The fit of one of these models, once it is there; None if it is not known there.

        Raises:
            EmsidError: where the model cannot be fitted.
            Stopped: by ``control``.
        """
        ...

    def stop(self) -> None:
        """End the search there with its best result so far."""
        ...


NAMED = 4
"""Name at most this many records in a title; of more give the number."""
SHORT = 2000
"""The largest number of samples to which every model is fitted in seconds."""
SLOWEST = ("wiener-hammerstein", "feedback")
"""The last often takes as long as all others together, the other one in short records."""
FEWEST = 20
"""With fewer samples nothing is left to test a model on after it is fitted."""


def identify(
    records: Records,
    unseen: Records | float = 0.3,
    *,
    models: str | Iterable[str] | None = None,
    quick: bool = False,
    budget: float | None = None,
    options: Options | None = None,
    transient: int | None = None,
    bootstrap: int = 0,
    seed: int = 1,
    control: Control = FREE,
    finished: Callable[[Fit[Any]], None] | None = None,
    elsewhere: Elsewhere | None = None,
    **reading: Any,
) -> Identification:
    """Fit several kinds of model and rank them by their free run on unseen data.

    Several models are fitted to an excerpt of a long record, and the recommended one then to all of it, see
    `long_records`; a single one to all of it at once.

    Args:
        records: what to identify from: a record, the path of a file, or several of either.
        unseen: data that no model is fitted to, given in the same way; or the fraction of ``records`` to keep unseen:
            the last part, or every k-th of many records. Of a fraction that is long enough one half chooses among the
            models and the other gives the error of the chosen one; data given by name do both.
        models: names of the models to fit: one name, several with commas, or a list; ``emsid list`` prints all. By
            default the usual ones, with a motor or an axis where the channels can be those of one.
        quick: fit linear models and the regressions that need no search only, in seconds.
        budget: time in s for all searches. Each model may take its share of the time that is left; a search that runs
            out of time keeps its best result.
        options: given orders, delay, knots and others; by default all are chosen.
        transient: samples that start a free run where a segment begins in motion; they enter no error.
        bootstrap, seed: number and seed of the fits to drawn pieces of the data that give intervals, see
            `emsid.bootstrap`; zero takes the robust covariance.
        control: when to stop, and where to report progress.
        finished: called with every fit as soon as it is found, for instance to save it.
        elsewhere: where some of the models are fitted at the same time, without a budget.
        reading: where paths are given, how to read them: ``input``, ``output``, ``time`` and the other arguments of
            `emsid.read`.

    Returns:
        The models with their errors, and all findings. If it is stopped before its end, the models found by then,
        without what takes time and is not needed to use them: residual tests, the next experiment and bands of curves.

    Raises:
        ModelError: for an unknown name, for options that no model can meet, or where no model can be fitted.
        DataError: for records that differ in channels or sample time, too few samples, or something that is not a
            record.
        Stopped: if ``control`` stops it before any model was found (`emsid.estimation.Stopped`).
    """
    options = options or Options()
    names, control = _asked_for(models, quick), _limited(control, budget)  # refused before files are read
    several = given_records(records, reading)
    others = () if isinstance(unseen, (int, float)) else given_records(unseen, reading)
    record = _long_enough(as_one(several))
    names = names or usual_for(record)
    given = options = understood(options, names)
    responses = responses_of(several)
    options, about_delay = with_delay(codes_of_channel(options, record), responses, several)
    plants = plants_of(names, options)
    check_physics(plants, names, options)
    findings = [*record.findings, *questions(several, responses), *about_delay]
    findings += unused_requests(plants, names, given, record, quick=quick)
    findings += [each.about(name) for name, plant in plants.items() for each in assumptions(plant, record)]

    train, test = (record, as_one(others)) if others else hold_back_records(several, _fraction(unseen), as_one)
    _check_records(train, test, [name for name in names if name not in plants], transient)
    whole, (train, outside) = train, to_compare(train, names)
    later = int(whole is not train and not bootstrap)
    found = _fit_all(names, train, options, control, finished, None if budget else elsewhere, later)
    found = _with_bootstrap(found, train, bootstrap, seed, control)
    findings += [finding for fit in found.fits for finding in built_in_values(fit, options)]
    judged = Compared.of(found.fits, train, test, options, control, outside, transient=transient, divide=not others)
    if later and not found.stopped:
        judged = on_all_samples(judged, whole, options, control)
    taken = _profiles(judged.fits, () if found.stopped else options.profile, control)
    final = None if others or found.stopped else from_all_data(judged, test, record, options, control)
    stopped = found.stopped or taken.stopped or control.cancelled()
    on_unseen = judged.on_unseen
    findings = [
        *observations(on_unseen, train, on_unseen.best.record, taken.profiles, judged.on_choice, tests=not stopped),
        *judged.findings,
        *found.failed,
        *findings,
        *([Finding("interrupted", data={"missing": list(found.missing)})] if stopped else []),
        *about_excerpt(judged, whole),
        *([] if final is None else [fitted_to_all_data(final.model.name, train, record, searched=final.searched)]),
        *([] if stopped else _difference_of_records(on_unseen, (*several, *others))),
        *taken.failed,
    ]
    verdicts = model_verdicts(judged.on_record, on_unseen, judged.findings, tests=not stopped)
    about = tuple(findings), taken.profiles, stopped, judged.on_choice, verdicts, judged.ranking, final and final.model
    each_record = by_record(on_unseen.fits, (*several, *others), transient)
    return Identification(train, on_unseen.best.record, judged.on_record, on_unseen, *about, each_record, judged.whole)


def _asked_for(models: str | Iterable[str] | None, quick: bool) -> tuple[str, ...] | None:
    """The names of the requested models; None for those that suit the record.

    Raises:
        ModelError: for an unknown name, or for models together with a quick look.
    """
    if quick and models is not None:
        raise ModelError("models are given, and quick chooses them; leave one out", arguments=("quick", "models"))
    return QUICK if quick else None if models is None else model_names(models)


def _limited(control: Control, budget: float | None) -> Control:
    """The control with a time in s for all searches, if there is one.

    Raises:
        ModelError: for a time that is not positive.
    """
    if budget is None:
        return control
    if not budget > 0:
        raise ModelError(f"a budget of {budget:g} s; give a positive time", arguments=("budget",))
    return control.within(budget)


def _long_enough(record: Record) -> Record:
    """The record.

    Raises:
        DataError: where it has too few samples to fit a model and to test it.
    """
    if len(record) >= FEWEST:
        return record
    raise DataError(
        f"{record.name}: {len(record)} samples are too few to fit a model and to test it; record at least {FEWEST}",
        arguments=("rows",),
    )


@dataclass(frozen=True)
class _Fits:
    """The models that were fitted, those that could not be, whether this was stopped early, and what was not begun.

    What was asked for by one name may be a model of another name, as a motor whose shaft the data do not show.
    """

    fits: tuple[Fit[Any], ...]
    failed: tuple[Finding, ...]
    stopped: bool
    missing: tuple[str, ...]


def _fit_all(
    names: Sequence[str],
    record: Record,
    options: Options,
    control: Control,
    finished: Callable[[Fit[Any]], None] | None = None,
    elsewhere: Elsewhere | None = None,
    later: int = 0,
) -> _Fits:
    """Every model fitted to the record: one after the other here, and some of them elsewhere meanwhile.

    Args:
        names: of the models.
        record: what they are fitted to.
        options: how.
        control: when to stop; of a time limit every fit gets an equal share.
        finished: called with every fit.
        elsewhere: where some of them are fitted at the same time.
        later: the number of fits that follow; where there are any, these here only compare.

    Raises:
        EmsidError: of the first model, where none can be fitted.
        Stopped: where it is stopped before any is found.
    """
    fits: dict[str, Fit[Any]] = {}
    problems: dict[str, EmsidError] = {}
    late: list[str] = []
    end: BaseException | None = None
    order, options = _order(names, record, elsewhere), replace(options, comparing=later > 0)
    if elsewhere:
        elsewhere.begin(order, record, options)
        control = _stopping(elsewhere, control)
    for number, (name, there) in enumerate(_in_turn(order, elsewhere), 1):
        if end is not None and there is None:  # what has begun elsewhere may have a result
            continue
        try:
            own = _of_one_model(control.sharing(len(names) - number + 1 + later), f"{name} ({number} of {len(names)})")
            own.report(Activity("fitting"))
            fit = there.fitted(name, own) if there else None
            with sharing_cores(2 if elsewhere else 1):
                fits[name] = fit or _fitted_here(name, record, options, own)
            if finished is not None:
                finished(fits[name])
        except Stopped as stop:
            if stop.ending is not Ending.INTERRUPTED:
                late.append(name)
                continue
            end = stop
        except EmsidError as problem:
            problems[name] = problem
        if name in fits and fits[name].ending is Ending.INTERRUPTED:
            end = Stopped(Ending.INTERRUPTED)
    if not fits:
        raise end or next((problems[name] for name in names if name in problems), Stopped(Ending.OUT_OF_BUDGET))
    failed = [*(failure(name, problems[name]) for name in names if name in problems), *map(out_of_time, late)]
    by_model = {fits[name].model.name: fits[name] for name in names if name in fits}
    missing = [name for name in names if name not in (*fits, *problems, *late)]
    return _Fits(tuple(by_model.values()), tuple(failed), end is not None, tuple(missing))


def _stopping(elsewhere: Elsewhere, control: Control) -> Control:
    """The same control; a search that it cancels here, stops at once elsewhere too."""

    def cancelled() -> bool:
        stopped = control.cancelled()
        if stopped:
            elsewhere.stop()
        return stopped

    return replace(control, cancelled=cancelled)


def _order(names: Sequence[str], record: Record, elsewhere: Elsewhere | None) -> Sequence[str]:
    """The models in the order in which they are taken here; the other place takes them from the last one on.

    The slowest come last. Of a short record the other searches come first, so that both places end at about the same
    time, and models that share a search late, so that one place fits both; of a long one the regressions come first, so
    that an interruption leaves them.
    """
    if elsewhere is None:
        return names
    short = len(record) <= SHORT
    late = (*OF_OUTPUT_ERROR, *SLOWEST) if short else SLOWEST
    return sorted(names, key=lambda name: (name in late and 1 + late.index(name), (name in REGRESSIONS) == short))


def _in_turn(names: Sequence[str], elsewhere: Elsewhere | None) -> Iterator[tuple[str, Elsewhere | None]]:
    """Every model with where it is fitted, None for here; those that are fitted elsewhere last."""
    others = []
    for name in names:
        if elsewhere and elsewhere.has_begun(name):
            others.append((name, elsewhere))
        else:
            yield name, None
    yield from others


def _fitted_here(name: str, record: Record, options: Options, control: Control) -> Fit[Any]:
    """The fit of a model in this process.

    Raises:
        EmsidError: where it cannot be fitted.
        Stopped: by ``control``.
    """
    control.check()
    return fit_or_problem(partial(CANDIDATES[name], record, options, control))


def _with_bootstrap(found: _Fits, record: Record, count: int, seed: int, control: Control) -> _Fits:
    """The models with intervals from drawn pieces of the record, as far as they can be fitted again."""
    if not count or found.stopped:
        return found
    fits, failed = list(found.fits), list(found.failed)
    for k, fit in enumerate(fits):
        own = _of_one_model(control, f"{fit.model.name} (bootstrap {k + 1} of {len(fits)})")
        try:
            fits[k] = drawn_again(fit, record, count, rng=np.random.default_rng(seed), control=own)
        except Stopped as stop:
            return _Fits(tuple(fits), tuple(failed), stop.ending is Ending.INTERRUPTED, found.missing)
        except EmsidError as problem:
            failed.append(Finding("no-bootstrap", fit.model.name, {"model": fit.model.name, "problem": str(problem)}))
    return _Fits(tuple(fits), tuple(failed), stopped=False, missing=())


def _of_one_model(control: Control, name: str) -> Control:
    """The same control, with the name of a model in front of every activity."""
    return replace(control, report=lambda a: control.report(Activity(f"{name}: {a.doing}", a.done, a.total)))


@dataclass(frozen=True)
class _Profiles:
    """The profiles by model, findings about failed profiles, and whether this was stopped."""

    profiles: dict[str, tuple[Profile, ...]]
    failed: tuple[Finding, ...]
    stopped: bool = False


def _profiles(fits: Sequence[Fit[Any]], names: Sequence[str], control: Control) -> _Profiles:
    """The requested profiles; a parameter that was split by direction has one for each direction."""
    profiles: dict[str, tuple[Profile, ...]] = {}
    failed: list[Finding] = []
    for fit in fits:
        if not isinstance(fit, GreyBoxFit):
            continue
        model = fit.model.name
        asked = _parts_asked_for(fit, names)
        for number, name in enumerate(asked, 1):
            try:
                own = _of_one_model(control, f"{model} (profile {number} of {len(asked)})")
                own.doing(name)
                profile = likelihood_profile(fit, name, control=own)
                profiles[model] = (*profiles.get(model, ()), profile)
            except Stopped:
                return _Profiles(profiles, tuple(failed), stopped=True)
            except EmsidError as problem:
                failed.append(profile_failure(model, name, problem))
    return _Profiles(profiles, tuple(failed))


def _parts_asked_for(fit: GreyBoxFit, names: Sequence[str]) -> list[str]:
    """The parameters of a model among the names; one split by direction or by record is replaced by its parts."""
    plant = fit.model.plant
    by_record = {name: [row.name for rows in fit.by_record.values() if (row := rows.get(name))] for name in names}
    names = [part for name in names for part in by_record[name] or [name]]
    asked = [name for name in names if name in plant.handles]
    split = {name: [part for part in parts(plant, name) if part in fit.names] for name in asked}
    return list(dict.fromkeys(one for whole in asked for one in split[whole] or [whole]))


def _difference_of_records(comparison: Comparison, records: Sequence[Record]) -> list[Finding]:
    """The difference between the records, by the best model that shows one."""
    found = (disagreement(fit.model, records) for fit in comparison.fits)
    return [each.finding for each in islice(filter(None, found), 1)]


def _check_records(train: Record, test: Record, discrete: Sequence[str], transient: int | None) -> None:
    """Refuse to rank discrete-time models on data of another sample time, and a transient that leaves no sample.

    Raises:
        DataError: naming the models, or the record.
    """
    if discrete and not np.isclose(train.dt, test.dt, rtol=1e-3, atol=0.0):
        raise DataError(
            f"{test.name} is sampled every {test.dt:g} s and {train.name} every {train.dt:g} s, so "
            f"{', '.join(discrete)} cannot be simulated on it; resample one of them, or check the unit of its times"
        )
    for record in (train, test):
        longest = max(map(len, record.segments))
        if longest <= (transient or 0):
            left = f"leaves no sample for an error; the longest segment has {longest}"
            raise DataError(f"{record.name}: a transient of {transient} samples {left}", arguments=("transient",))


def _fraction(unseen: Any) -> float:
    """The fraction to keep unseen.

    Raises:
        DataError: where it is none.
    """
    if isinstance(unseen, (int, float)) and 0 < unseen < 1:
        return float(unseen)
    raise DataError(f"unseen: {unseen!r} is not a fraction between 0 and 1, nor a record", arguments=("unseen",))


def as_one(records: Sequence[Record]) -> Record:
    """The records joined to one, with all of their names; a single record unchanged."""
    if len(records) == 1:
        return records[0]
    names = dict.fromkeys(record.name for record in records)
    return concatenate(records, ", ".join(names) if len(names) <= NAMED else f"{len(names)} records")
