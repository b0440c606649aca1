"""The steps of `emsid identify`, from records to a ranked list of models.

Each requested model of `candidates` is fitted to a part of the data. The models are ranked by their free run on unseen
data, which no step of a fit uses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from typing import Any

import numpy as np

from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.compilation import cancelled_with
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding
from emsid.first_look.advice import questions, response_of
from emsid.identification.all_data import from_all_data
from emsid.identification.candidates import QUICK, usual_for
from emsid.identification.compared import Compared
from emsid.identification.delay import with_delay
from emsid.identification.fitting import Elsewhere, Searches, with_bootstrap
from emsid.identification.long_records import about_excerpt, on_all_samples, to_compare
from emsid.identification.observations import built_in_values, fitted_to_all_data, observations
from emsid.identification.options import Options
from emsid.identification.profiles import profiles_of
from emsid.identification.records import Records, given_records
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
from emsid.models.plants.grey_box import assumptions
from emsid.record import Record, concatenate
from emsid.record.holding_back import hold_back_records
from emsid.validation.agreement import disagreement
from emsid.validation.comparison import Comparison
from emsid.validation.regions import by_record

NAMED = 4
"""Name at most this many records in a title; of more give the number."""
FEWEST, FEWEST_FITTED = 20, 10
"""With fewer samples nothing is left to test a model on after it is fitted, and too little to fit it to."""


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
    names, control = _asked_for(models, quick), _limited(control, budget)  # refused before files are read
    several = given_records(records, reading)
    others = () if isinstance(unseen, (int, float)) else given_records(unseen, reading)
    record = _long_enough(as_one(several))
    names = names or usual_for(record)
    given = options = understood(options or Options(), names)
    with cancelled_with(control):
        responses = list(map(response_of, several))
        options, about_delay = with_delay(codes_of_channel(options, record), responses, several)
        plants = plants_of(names, options)
        check_physics(plants, names, options)
        train, test = (record, as_one(others)) if others else hold_back_records(several, _fraction(unseen), as_one)
        _check_records(train, test, [name for name in names if name not in plants], transient)
        whole, (train, outside) = train, to_compare(train, names)
        later = int(whole is not train and not bootstrap)
        searches = Searches(names, train, options, control, finished, None if budget else elsewhere, later)
        searches.begin()  # while questions are asked
        findings = [*record.findings, *questions(several, responses), *about_delay]
        findings += unused_requests(plants, names, given, record, quick=quick)
        findings += [each.about(name) for name, plant in plants.items() for each in assumptions(plant, record)]
        found = with_bootstrap(searches.all(), train, bootstrap, seed, control)
    findings += [finding for fit in found.fits for finding in built_in_values(fit, options)]
    judged = Compared.of(found.fits, train, test, options, control, outside, transient=transient, divide=not others)
    if later and not found.stopped:
        judged = on_all_samples(judged, whole, options, control)
    taken = profiles_of(judged.fits, () if found.stopped else options.profile, control)
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


def _difference_of_records(comparison: Comparison, records: Sequence[Record]) -> list[Finding]:
    """The difference between the records, by the best model that shows one."""
    found = (disagreement(fit.model, records) for fit in comparison.fits)
    return [each.finding for each in islice(filter(None, found), 1)]


def _check_records(train: Record, test: Record, discrete: Sequence[str], transient: int | None) -> None:
    """Refuse too few samples to fit, data of another sample time, and a transient that leaves no sample.

    Raises:
        DataError: naming the models, or the record.
    """
    if discrete and not np.isclose(train.dt, test.dt, rtol=1e-3, atol=0.0):
        raise DataError(
            f"{test.name} is sampled every {test.dt:g} s and {train.name} every {train.dt:g} s, so "
            f"{', '.join(discrete)} cannot be simulated on it; resample one of them, or check the unit of its times"
        )
    if len(train) < FEWEST_FITTED:
        left = f"{len(train)} sample{'s' * (len(train) != 1)} to fit; keep a smaller part unseen, or record longer"
        raise DataError(f"{test.name}, of {len(test)} samples, leaves {left}", arguments=("unseen",))
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
