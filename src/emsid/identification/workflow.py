"""The steps of `emsid identify`, from records to a ranked list of models.

Each requested model of `candidates` is fitted to a part of the data. The models are ranked by their free run on unseen
data, which no step of a fit uses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

from emsid.errors import EmsidError, ModelError
from emsid.estimation.borders import border, collected
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.compilation import cancelled_with
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.threads import one_blas_thread
from emsid.findings import Finding
from emsid.identification.evidence import length_trusted, observations
from emsid.identification.fitting import Elsewhere, Fits, Profiles, Searches, profiles_of, with_bootstrap
from emsid.identification.result import Identification
from emsid.identification.task import Records, Task, model_names
from emsid.identification.verdict import (
    NO_INPUT,
    Compared,
    about_excerpt,
    fails_on_unseen,
    from_all_data,
    model_verdicts,
    on_all_samples,
    shows_the_input,
)
from emsid.models.model import Model
from emsid.options import KEYWORDS, Options, takes_options
from emsid.validation.agreement import disagreement
from emsid.validation.comparison import RecordError, by_record


@takes_options
@one_blas_thread()
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
    **given: Any,
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
        options: the keywords of `Options` as one value, in place of these.
        transient: samples that start a free run where a segment begins in motion; they enter no error.
        bootstrap, seed: number and seed of the fits to drawn pieces of the data that give intervals, see
            `emsid.bootstrap`; zero takes the robust covariance.
        control: when to stop, and where to report progress.
        finished: called with every fit as soon as it is found, for instance to save it.
        elsewhere: fits some of the models at the same time, for instance in another process; not with a budget. It is
            called with the data and the options, and returns a function that takes the name of a model and returns a
            `concurrent.futures.Future` of its fit.
        given: where paths are given, how to read them: ``input``, ``output``, ``time`` and the other arguments of
            `emsid.read`, collected as ``reading``.

    Returns:
        The models with their errors, and all findings. If it is stopped before its end, the models found by then,
        without what takes time and is not needed to use them: residual tests, the next experiment and bands of curves.

    Raises:
        ModelError: for an unknown name, for options that no model can meet, or where no model can be fitted.
        DataError: for records that differ in channels or sample time, too few samples, or something that is not a
            record.
        Stopped: if ``control`` stops it before any model was found (`emsid.estimation.Stopped`).
    """
    options = Options.of(options, {name: given.pop(name) for name in KEYWORDS & given.keys()})
    if quick and models is not None:
        raise ModelError("models are given, and quick chooses them; leave one out", arguments=("quick", "models"))
    names = None if models is None else model_names(models)
    if budget is not None:
        if not budget > 0:
            raise ModelError(f"a budget of {budget:g} s; give a positive time", arguments=("budget",))
        control = control.within(budget)
    with cancelled_with(control), collected() as noted:
        task = Task.of(records, unseen, names, options, transient, given, control, quick=quick)
        one_more = task.is_excerpt and not bootstrap  # fit, of the recommended model to all samples
        there = None if budget or quick else elsewhere
        by_need = names is None and not quick and task.pole is None  # around an unstable plant, free runs show little
        what = task.names, task.train, task.options
        searches = Searches(*what, control, finished, there, later=int(one_more), by_need=by_need)
        asked = task.findings(quick=quick)
        found = with_bootstrap(searches.all(), task.train, bootstrap, seed, control)
        judged = _compared(task, found.fits, control)
        if found.not_needed and fails_on_unseen(judged.on_unseen.best, judged.on_record):
            found = with_bootstrap(searches.with_rest(found), task.train, bootstrap, seed, control)
            judged = _compared(task, found.fits, control)
        result = _judged(task, asked, found, judged, control, excerpt=one_more)
    return replace(result, findings=(*result.findings, *noted))


def _judged(
    task: Task, asked: Sequence[Finding], found: Fits, judged: Compared, control: Control, *, excerpt: bool
) -> Identification:
    """The result of the searches, ranked: the models judged, and the recommended one fitted to all data."""
    name = judged.best.model.name
    if shows_the_input(judged.on_unseen.best, judged.on_record.best):  # the first look missed a response of many modes
        asked = [each for each in asked if each.code != "no-response"]
    if excerpt and not found.stopped:
        with border(f"fit of {name} to all samples", name):
            judged = on_all_samples(judged, task.to_fit, task.options, control)
    taken = profiles_of(judged.fits, () if found.stopped else task.options.profile, control)
    no_final = found.stopped or bool(task.others) or task.pole is not None
    final, by_records = None, tuple[RecordError, ...]()
    with border(f"fit of {name} to all data", name):
        final = None if no_final else from_all_data(judged, task.unseen, task.record, task.options, control)
    with border("errors by record"):
        by_records = by_record(judged.fits, (*task.records, *task.others), task.transient)
    stopped = found.stopped or taken.stopped or control.cancelled()
    of = judged.on_record, judged.on_unseen, (*judged.findings, *asked), judged.undetermined.reasons
    verdicts = None
    with border("residual tests of the models"):
        verdicts = model_verdicts(*of, tests=not stopped, pole=judged.pole)
    verdicts = verdicts or model_verdicts(*of, tests=False, pole=judged.pole)
    outputs = " and ".join(judged.on_unseen.best.record.output_names)
    without = [each for each in verdicts[0].data["reasons"][:1] if each["code"] == NO_INPUT]
    return Identification(
        record=task.train,
        unseen=judged.on_unseen.best.record,
        on_record=judged.on_record,
        on_unseen=judged.on_unseen,
        findings=(
            *(Finding(NO_INPUT, outputs, {**each, "by": verdicts[0].model}) for each in without),
            *_findings(task, asked, found, judged, taken, final, stopped=stopped),
        ),
        profiles=taken.profiles,
        interrupted=stopped,
        on_choice=judged.on_choice,
        model_verdicts=verdicts,
        ranking=judged.ranking,
        on_all_data=final and final[0],
        by_record=by_records,
        whole=judged.whole,
    )


def _compared(task: Task, fits: Sequence[Fit[Any]], control: Control) -> Compared:
    """The models compared; where that fails, without those that cannot be compared even alone.

    Raises:
        EmsidError: where none can be compared.
    """

    def together(some: Sequence[Fit[Any]]) -> Compared:
        whole = None if task.others else task.record
        how: dict[str, Any] = {"transient": task.transient, "whole": whole, "pole": task.pole}
        return Compared.of(some, task.train, task.unseen, task.options, control, task.outside, **how)

    problems: list[EmsidError] = []
    with border("comparison of the models", report=problems.append):
        return together(fits)
    alone: list[Compared] = []
    for fit in fits if len(fits) > 1 else ():
        with border(f"comparison of {fit.model.name} with the others", fit.model.name):
            alone.append(together([fit]))
    if not alone:
        raise problems[0]
    with border("comparison of the other models"):
        return together([each.best for each in alone])
    return min(alone, key=lambda each: each.on_unseen.best.row.simulation_mse)


def _findings(
    task: Task,
    asked: Sequence[Finding],
    found: Fits,
    judged: Compared,
    taken: Profiles,
    final: tuple[Model, Finding] | None,
    *,
    stopped: bool,
) -> Iterator[Finding]:
    """All findings of an identification: on the models, the data and the requests."""
    on_unseen, profiles = judged.on_unseen, taken.profiles
    yield from observations(
        on_unseen,
        task.train,
        on_unseen.best.record,
        profiles,
        judged.on_choice,
        ranked_on=int(judged.ranking[0].left_out.samples.sum()),
        tests=not stopped,
    )
    yield from judged.findings
    yield from found.failed
    yield from found.not_needed
    yield from asked
    if stopped:
        yield Finding("interrupted", data={"missing": list(found.missing)})
    yield from about_excerpt(judged, task.to_fit)
    if final is not None:
        yield final[1]
    if not stopped:
        model = final[0] if final else judged.best.model
        with border(f"check of {model.name}: for how long it is trusted", model.name):
            yield from length_trusted(judged.best, model, task.record)
        with border("differences between records"):
            differs = (disagreement(fit.model, (*task.records, *task.others)) for fit in on_unseen.fits)
            yield from (each.finding for each in islice(filter(None, differs), 1))
    yield from taken.failed
