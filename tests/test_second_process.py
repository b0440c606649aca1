"""A second process fits models meanwhile: the results are the same, in the same order."""

from __future__ import annotations

import gc
import os
import pickle
import subprocess
import sys
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import sleep

import numpy as np
import pytest

import emsid
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.second_process import fits, is_possible, meanwhile, without_collection
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.threads import short_tasks
from emsid.identification import Options
from emsid.identification.candidates import CANDIDATES
from emsid.identification.fitting import Queue, Searches

OPTIONS = Options(na=1, nb=1, nk=1, degree=2)
MODELS = "arx, friction-narx, polynomial-narx"
HERE = os.getpid()


def lagging(samples: int = 200) -> emsid.Record:
    rng = np.random.default_rng(5)
    u, y = np.repeat(rng.uniform(-2, 2, samples // 10), 10), np.zeros(samples)
    for t in range(1, samples):
        y[t] = 0.9 * y[t - 1] + 0.3 * u[t - 1]
    return emsid.Record(u, y + 0.01 * rng.standard_normal(samples), 0.01)


def elsewhere(*names, answer=None):
    """A place that has begun to fit some models before this process takes one; it answers as a model kind does."""

    def begin(record, options):
        def submit(name):
            if name not in names:
                raise RuntimeError("this place has ended")
            future = Future()
            try:
                future.set_result(answer(name, record, options) if answer else None)
            except emsid.EmsidError as problem:
                future.set_exception(problem)
            return future

        return submit

    return begin


def there(name, record, options):
    fit = CANDIDATES[name](record, options, FREE)
    return replace(fit, findings=(*fit.findings, emsid.findings.Finding("fitted-there", name)))


def test_models_fitted_elsewhere_are_reported_like_the_others() -> None:
    record, finished = lagging(), []
    here = emsid.identify(record, models=MODELS, options=OPTIONS)
    both = emsid.identify(
        record, models=MODELS, options=OPTIONS, elsewhere=elsewhere("polynomial-narx", answer=there),
        finished=lambda fit: finished.append(fit.model.name),
    )  # fmt: skip
    assert [fit.model.name for fit in both.fits] == [fit.model.name for fit in here.fits]
    assert finished == ["arx", "friction-narx", "polynomial-narx"]
    assert all((a.estimate == b.estimate).all() for a, b in zip(here.fits, both.fits, strict=True))
    marked = [fit.model.name for fit in both.fits if any(finding.code == "fitted-there" for finding in fit.findings)]
    assert marked == ["polynomial-narx"]


def test_the_other_place_begins_with_the_slowest() -> None:
    usual = ("arx", "wiener-hammerstein", "feedback", "friction-narx")
    order = ["arx", "friction-narx", "wiener-hammerstein", "feedback"]
    assert Searches(usual, lagging(), OPTIONS, FREE, elsewhere=elsewhere()).order(usual) == order
    assert Searches(usual, lagging(), OPTIONS, FREE).order(usual) == usual


def test_a_model_that_is_not_known_elsewhere_is_fitted_here() -> None:
    found = emsid.identify(lagging(), models=MODELS, options=OPTIONS, elsewhere=elsewhere("polynomial-narx"))
    assert {fit.model.name for fit in found.fits} == {"polynomial-narx", "arx", "friction-narx"}


def test_a_model_that_fails_elsewhere_is_named() -> None:
    def fails(*_):
        raise emsid.ModelError("no such luck")

    place = elsewhere("polynomial-narx", answer=fails)
    found = emsid.identify(lagging(), models=MODELS, options=OPTIONS, elsewhere=place)
    assert [finding.subject for finding in found.findings if finding.code == "model-failed"] == ["polynomial-narx"]
    assert "polynomial-narx" not in {fit.model.name for fit in found.fits}


def test_an_interrupted_identification_keeps_what_was_found_elsewhere() -> None:
    pressed = []
    found = emsid.identify(
        lagging(), models=MODELS, options=OPTIONS, elsewhere=elsewhere("polynomial-narx", answer=there),
        control=Control(cancelled=lambda: bool(pressed)), finished=pressed.append,
    )  # fmt: skip
    assert found.interrupted
    assert {fit.model.name for fit in found.fits} == {"arx", "polynomial-narx"}


def test_an_interrupted_identification_does_not_wait_for_a_search_elsewhere_without_end(monkeypatch) -> None:
    monkeypatch.setattr("emsid.identification.fitting.LAST", 0.05)
    pressed = []
    found = emsid.identify(
        lagging(), models=MODELS, options=OPTIONS, elsewhere=lambda *_: lambda name: Future(),
        control=Control(cancelled=lambda: bool(pressed)), finished=pressed.append,
    )  # fmt: skip
    assert {fit.model.name for fit in found.fits} == {"arx"}


def test_each_model_is_taken_by_one_place_only() -> None:
    given = {}

    def submit(name):
        given[name] = Future()
        return given[name]

    line = iter(Queue("abcde", submit))
    assert next(line) == ("a", None)
    given["e"].set_result("a fit")
    assert next(line) == ("b", None)
    assert next(line) == ("c", None)
    assert [name for name, _ in line] == [*given] == ["e", "d"]


@pytest.fixture
def alone(monkeypatch) -> None:
    """As if this process ran the command line only, on two cores."""
    monkeypatch.setattr(INTERRUPTION, "own_process", True)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1}, raising=False)


forks = [
    pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="this system has no second process"),
    pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning"),  # from Python 3.12 on
]


class TestFork:
    pytestmark = forks

    def test_it_finds_the_same(self) -> None:
        assert list(short_tasks(1)(len, [()])) == [0]  # a pool whose thread the other process does not have
        record = lagging()
        there, here = (
            submit("polynomial-narx")
            for submit in (fits(record, OPTIONS), lambda name: CANDIDATES[name](record, OPTIONS, FREE))
        )
        assert (there.result(60).estimate == here.estimate).all()
        assert repr(there.result()) == repr(here)

    def test_ctrl_c_of_this_process_stops_it(self, monkeypatch) -> None:
        monkeypatch.setitem(CANDIDATES, "endless", lambda record, options, control: _until(control))
        found = fits(lagging(), OPTIONS)("endless")
        try:
            INTERRUPTION.pressed = True
            assert found.result(60) is Ending.INTERRUPTED
        finally:
            INTERRUPTION.begin()

    def test_it_answers(self, alone) -> None:
        assert meanwhile(os.getpid)() != HERE

    def test_an_error_of_the_user_comes_with_its_arguments(self, alone) -> None:
        def refused():
            raise emsid.DataError(f"no column in {os.getpid()}", arguments=("input",))

        with pytest.raises(emsid.DataError, match="no column") as raised:
            meanwhile(refused)()
        assert raised.value.arguments == ("input",)
        assert str(HERE) not in str(raised.value)

    @pytest.mark.parametrize("ends", [partial(os._exit, 0), partial(int, "no number"), lambda: lambda: 1])
    def test_what_it_does_not_answer_is_found_here(self, ends, alone) -> None:
        assert meanwhile(lambda: HERE if os.getpid() == HERE else ends())() == HERE

    def test_it_ends_with_this_process(self, tmp_path) -> None:
        code = (
            "import os, sys\nfrom emsid.cli.second_process import forked\n"
            "print(forked(os.getpid)().result(60), flush=True); os._exit(9)"
        )
        ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert ran.returncode == 9
        for _again in range(100):
            if not Path("/proc", ran.stdout.strip()).exists():
                return
            sleep(0.05)
        pytest.fail("the fork has not ended")


def _until(control: Control) -> Ending | None:
    while control.ending is None:
        sleep(0.01)
    return control.ending


def test_a_fork_is_made_only_where_it_saves_time(alone, monkeypatch) -> None:
    assert is_possible()
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0}, raising=False)
    assert not is_possible()
    assert meanwhile(os.getpid)() == HERE
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1}, raising=False)
    monkeypatch.setattr(INTERRUPTION, "own_process", False)
    assert not is_possible()


def test_a_record_from_another_process_is_read_only() -> None:
    record = pickle.loads(pickle.dumps(emsid.Record(np.arange(5.0), np.ones(5), 0.1)))
    for array in (record.input, record.output):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_reading_imports_no_compiler() -> None:
    """The fork that reads does so within the time of the imports of the first process."""
    code = "import sys, emsid.io, emsid.first_look.clock; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


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
