"""A second process fits models meanwhile: the results are the same, in the same order."""

from __future__ import annotations

import gc
import os
from contextlib import suppress
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest

import emsid
from emsid.cli import second_process as module
from emsid.cli.imports import load_page, without_collection
from emsid.cli.second_process import SecondProcess, second_process, taken
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.threads import short_tasks
from emsid.identification import Options
from emsid.identification.candidates import CANDIDATES
from emsid.identification.fitting import Searches
from emsid.report.document import Report, Section
from emsid.report.page import page, templates

OPTIONS = Options(na=1, nb=1, nk=1, degree=2)
MODELS = "polynomial-narx, arx, friction-narx"


def lagging(samples: int = 200) -> emsid.Record:
    rng = np.random.default_rng(5)
    u, y = np.repeat(rng.uniform(-2, 2, samples // 10), 10), np.zeros(samples)
    for t in range(1, samples):
        y[t] = 0.9 * y[t - 1] + 0.3 * u[t - 1]
    return emsid.Record(u, y + 0.01 * rng.standard_normal(samples), 0.01)


class Elsewhere:
    """Answers that are there at once."""

    def __init__(self, *names, answer=None):
        self.names, self.answer, self.stopped = names, answer, False

    def begin(self, names, record, options):
        self.record, self.options = record, options

    def has_begun(self, name):
        return name in self.names

    def fitted(self, name, control):
        return self.answer(name, self, control) if self.answer else None

    def stop(self):
        self.stopped = True


def there(name, elsewhere, control):
    fit = CANDIDATES[name](elsewhere.record, elsewhere.options, FREE)
    return replace(fit, findings=(*fit.findings, emsid.findings.Finding("fitted-there", name)))


def test_models_fitted_elsewhere_are_reported_like_the_others() -> None:
    record, finished = lagging(), []
    here = emsid.identify(record, models=MODELS, options=OPTIONS)
    both = emsid.identify(
        record, models=MODELS, options=OPTIONS, elsewhere=Elsewhere("polynomial-narx", answer=there),
        finished=lambda fit: finished.append(fit.model.name),
    )  # fmt: skip
    assert [fit.model.name for fit in both.fits] == [fit.model.name for fit in here.fits]
    assert finished == ["arx", "friction-narx", "polynomial-narx"]
    assert all((a.estimate == b.estimate).all() for a, b in zip(here.fits, both.fits, strict=True))
    marked = [fit.model.name for fit in both.fits if any(each.code == "fitted-there" for each in fit.findings)]
    assert marked == ["polynomial-narx"]


@pytest.mark.parametrize(("samples", "first"), [(100, "friction-motor"), (3000, "arx")])
def test_the_searches_of_a_short_record_come_first_beside_another_process(samples, first, monkeypatch) -> None:
    taken = []

    def fit(name, record, options, control):
        taken.append(name)
        raise emsid.ModelError("not now")

    names = ("arx", "friction-narx", "friction-motor")
    monkeypatch.setattr("emsid.identification.fitting.CANDIDATES", {name: partial(fit, name) for name in names})
    for elsewhere in (Elsewhere(), None):
        with pytest.raises(emsid.ModelError, match="not now"):
            Searches(names, lagging(samples), OPTIONS, FREE, elsewhere=elsewhere).all()
    assert taken[0] == first
    assert taken[3:] == [*names]


@pytest.mark.parametrize(
    ("samples", "order"),
    [
        (100, ("wiener-hammerstein", "friction-motor", "arx", "output-error", "polynomial-narx", "feedback")),
        (3000, ("arx", "friction-motor", "output-error", "polynomial-narx", "wiener-hammerstein", "feedback")),
    ],
)
def test_the_other_process_begins_with_the_slowest_and_one_of_them_makes_a_shared_search(samples, order) -> None:
    usual = ("arx", "output-error", "polynomial-narx", "wiener-hammerstein", "feedback", "friction-motor")
    record = lagging(samples)
    assert tuple(Searches(usual, record, OPTIONS, FREE, elsewhere=Elsewhere()).order(usual)) == order
    few = tuple(name for name in order if name not in ("wiener-hammerstein", "feedback"))
    with_cascade = (*few, "wiener-hammerstein")
    searches = Searches(with_cascade, record, OPTIONS, FREE, elsewhere=Elsewhere())
    assert tuple(searches.order(with_cascade)) == with_cascade
    assert Searches(usual, record, OPTIONS, FREE).order(usual) == usual


def test_a_model_that_is_not_known_elsewhere_is_fitted_here() -> None:
    found = emsid.identify(lagging(), models=MODELS, options=OPTIONS, elsewhere=Elsewhere("polynomial-narx"))
    assert {fit.model.name for fit in found.fits} == {"polynomial-narx", "arx", "friction-narx"}


def test_a_model_that_fails_elsewhere_is_named() -> None:
    def fails(name, *_):
        raise emsid.ModelError("no such luck")

    found = emsid.identify(lagging(), models=MODELS, options=OPTIONS, elsewhere=Elsewhere("arx", answer=fails))
    assert [each.subject for each in found.findings if each.code == "model-failed"] == ["arx"]
    assert "arx" not in {fit.model.name for fit in found.fits}


def test_an_interrupted_identification_keeps_what_was_found_elsewhere() -> None:
    pressed = []

    def cut_short(name, elsewhere, control):
        assert control.ending is Ending.INTERRUPTED
        assert elsewhere.stopped  # by the first search that is stopped here, not only now
        return there(name, elsewhere, control)

    found = emsid.identify(
        lagging(), models=MODELS, options=OPTIONS, elsewhere=Elsewhere("polynomial-narx", answer=cut_short),
        control=Control(cancelled=lambda: bool(pressed)), finished=pressed.append,
    )  # fmt: skip
    assert found.interrupted
    assert {fit.model.name for fit in found.fits} == {"arx", "polynomial-narx"}


forks = pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="this system has no second process")


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")  # from Python 3.12 on
@forks
def test_the_second_process_finds_the_same() -> None:
    assert list(short_tasks(1)(len, [()])) == [0]  # a pool whose thread the other process does not have
    record, waits = lagging(), []
    second = SecondProcess(lambda: waits.append("for an answer"))
    try:
        second.begin(("arx", "polynomial-narx"), record, OPTIONS)
        assert second.has_begun("arx") is False
        here = CANDIDATES["polynomial-narx"](record, OPTIONS, FREE)
        fit = second.fitted("polynomial-narx", FREE)
        assert fit is not None
        assert (fit.estimate == here.estimate).all()
        assert repr(fit) == repr(here)
    finally:
        second.close()
    second._process.join(5)
    assert second._process.exitcode is not None
    assert second.fitted("polynomial-narx", FREE) is fit
    assert waits == ["for an answer"]


@forks
def test_a_second_process_that_was_not_begun_has_nothing() -> None:
    second = SecondProcess()
    second.begin(("arx",), lagging(), OPTIONS)  # a single model is fitted by the first process
    assert not second.has_begun("arx")
    assert second.fitted("arx", FREE) is None
    second.stop()
    second.close()


def test_each_model_is_taken_by_one_process_only(monkeypatch) -> None:
    flags, asked = get_context("spawn").Array("b", 4), []
    names = ("arx", "friction-narx", "feedback")
    assert taken(flags, 0)

    def fit(name, record, options, control):
        asked.append(name)
        return not taken(flags, 1)  # the other process takes the second one meanwhile

    monkeypatch.setattr("emsid.identification.candidates.CANDIDATES", {name: partial(fit, name) for name in names})
    assert [name for name, _ in module.fitted(names, lagging(), OPTIONS, flags, lambda: False)] == asked == ["feedback"]
    assert list(module.fitted(names[:1], lagging(), OPTIONS, get_context("spawn").Array("b", 4), lambda: True)) == []


def test_a_second_process_is_started_only_where_it_saves_time(monkeypatch) -> None:
    monkeypatch.setattr(module, "SecondProcess", lambda meanwhile: "a process")
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1}, raising=False)
    assert second_process((), alone=True) == "a process"
    assert second_process(("arx", "wiener"), alone=True) == "a process"
    assert second_process(("wiener",), alone=True) is None
    assert second_process((), alone=False) is None
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0}, raising=False)
    assert second_process((), alone=True) is None


def test_what_a_page_needs_is_loaded_once() -> None:
    templates.cache_clear()
    load_page.cache_clear()
    load_page()
    loaded = set(templates().cache)
    load_page()
    page(Report("A motor", ("It turns.",), (Section("Data"),)))
    assert len(loaded) == 2
    assert set(templates().cache) == loaded


def test_garbage_is_collected_again_after_the_imports() -> None:
    before = gc.get_freeze_count()
    for problem in (None, KeyError):
        with suppress(KeyError), without_collection():
            assert not gc.isenabled()
            if problem:
                raise problem
        assert gc.isenabled()
    assert gc.get_freeze_count() > before
    gc.unfreeze()
