"""Ctrl-C and termination: what is answered, what is written, and what is left out."""

import importlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from functools import partial

import numba
import pytest

import emsid
from command_line import FIRST_ORDER, IDENTIFY, MOTOR
from emsid.cli.interruption import ERASED, Interruption, print_notice
from emsid.cli.live_view import Screen
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Stopped

pytestmark = pytest.mark.usefixtures("ctrl_c_heard", "figures_undrawn")


def test_interrupting_a_profile_keeps_the_fit(run, motor_log, tmp_path, no_refinements, monkeypatch):
    def interrupted(*_, **__):
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setattr("emsid.identification.fitting.likelihood_profile", interrupted)
    words = ("identify", motor_log, *MOTOR, "--models", "rigid-motor", "--profile", "motor_constant")
    status, out, err = run(*words, "--out", tmp_path / "out")
    assert status == 130
    assert "interrupted" in err
    assert "rigid-motor, the only model (a fit of 97" in out
    assert json.loads((tmp_path / "out" / "result.json").read_text())["profiles"] == []


def test_interrupting_keeps_what_was_found(run, log, tmp_path, monkeypatch):
    from emsid.identification import fitting as identification

    def interrupted(*_):
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setitem(identification.CANDIDATES, "friction-narx", interrupted)
    status, out, err = run("identify", log, *IDENTIFY, "--models", "arx,friction-narx", "--out", tmp_path / "out")
    assert status == 130
    assert "interrupted" in err
    assert "Recommended: arx" in out
    rows = json.loads((tmp_path / "out" / "result.json").read_text())["rows"]
    assert {row["model"] for row in rows} == {"arx"}
    assert (tmp_path / "out" / "report.html").exists()


def test_every_finished_model_is_saved_at_once(run, log, tmp_path, monkeypatch):
    from emsid.identification import fitting as identification

    def killed(*_):
        assert emsid.load(tmp_path / "out" / "arx.json").name == "arx"
        assert not (tmp_path / "out" / "result.json").exists()
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setitem(identification.CANDIDATES, "friction-narx", killed)
    status, _, _ = run("identify", log, *IDENTIFY, "--models", "arx,friction-narx", "--out", tmp_path / "out")
    assert status == 130


def test_interrupting_before_anything_is_found_writes_nothing(run, log, tmp_path, monkeypatch):
    from emsid.identification import fitting as identification

    def interrupted(*_):
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setitem(identification.CANDIDATES, "arx", interrupted)
    status, _, _ = run("identify", log, *IDENTIFY, "--models", "arx", "--out", tmp_path / "out")
    assert status != 0
    assert not (tmp_path / "out").exists()


def test_an_answer_on_a_terminal_takes_the_place_of_the_progress_bar(monkeypatch, answers):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    print_notice("stopping")
    assert answers == [f"{ERASED}emsid: stopping\n"]


def test_a_live_view_shows_the_answer_to_ctrl_c_itself(capsys, answers):
    pressed = Interruption()
    with Screen(str) as view, pressed.asked("ending; writing record and report", view.notify):
        pressed()
    assert "ending; writing record and report" in capsys.readouterr().out
    assert answers == []
    with pressed.asked("stopping"):
        pressed.pressed = False
        pressed._when = -math.inf
        pressed()
    assert len(answers) == 1


def test_interrupting_the_drawing_keeps_all_numbers(run, log, tmp_path, monkeypatch):
    def interrupted(*_):
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setattr("emsid.report.figures.draw", interrupted)
    out = tmp_path / "out"
    status, printed, err = run("identify", log, "-u", "u", "-y", "y", "--dt", 0.01, "--models", "arx", "--out", out)
    assert status == 130
    assert "interrupted" in err
    assert "Recommended: arx" in printed
    assert "report.html" not in printed
    assert sorted(path.name for path in out.iterdir()) == ["arx.json", "best.json", "result.json"]


def test_what_follows_from_an_interrupt_is_one(run, log, tmp_path, monkeypatch):
    """An import that was cut short fails later, as anything at all."""

    def half_imported(*_, **__):
        os.kill(os.getpid(), signal.SIGINT)

    def broken(*_, **__):
        try:
            half_imported()
        except KeyboardInterrupt:
            raise NameError("name '_half' is not defined") from None

    monkeypatch.setattr("emsid.identification.workflow.identify", broken)
    status, _, err = run("identify", log, "-u", "u", "-y", "y", "--dt", 0.01, "--out", tmp_path / "out")
    assert status == 130
    assert err == "emsid: interrupted; there is no result\n"
    assert not (tmp_path / "out").exists()


STOPPING = "emsid: stopping after this step; any results so far follow (Ctrl-C again: end without them)\n"
LEFT_OUT = "emsid: the report is left out\n"
FOUND = "emsid: identification was interrupted; the results so far are printed above and written\n"
REGRESSIONS = ("--models", "arx, wiener-hammerstein-regression", *FIRST_ORDER, "--degree", 2, "--taps", 1)


def press():
    """Ctrl-C, heard at once."""
    os.kill(os.getpid(), signal.SIGINT)


class Lost:
    """Ctrl-C in a callback, where exceptions are lost."""

    def __del__(self):
        press()


@pytest.fixture
def pressed_at(monkeypatch):
    """Ctrl-C the next time each of these functions is called, so that no test depends on speed."""

    def arrange(*places, press=press):
        for place in places:
            module, name = place.rsplit(".", 1)
            home = importlib.import_module(module)
            real = getattr(home, name)

            def called(*given, home=home, name=name, real=real, **named):
                monkeypatch.setattr(home, name, real)
                press()
                return real(*given, **named)

            monkeypatch.setattr(home, name, called)

    return arrange


def test_ctrl_c_in_demo_leaves_nothing(run, tmp_path, pressed_at):
    pressed_at("emsid.io.write_record")
    status, out, err = run("demo", tmp_path / "new")
    assert (status, out, err) == (130, "", "emsid: interrupted; nothing is written\n")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("place", ["emsid.io.read", "emsid.estimation.linear.least_squares.least_squares"])
def test_ctrl_c_before_anything_is_found(place, run, log, tmp_path, pressed_at):
    pressed_at(place)
    words = ("identify", log, *IDENTIFY, "--models", "arx", "--out", tmp_path / "out")
    assert run(*words) == (130, "", "emsid: interrupted; there is no result\n")
    assert not (tmp_path / "out").exists()


def assert_whole(folder, drawn):
    """A model file for every model of the result, and the page with its figures, or neither."""
    rows = json.loads((folder / "result.json").read_text())["rows"]
    models = {f"{row['model']}.json" for row in rows}
    assert {path.name for path in folder.glob("*.json")} == models | {"best.json", "result.json"}
    assert {path.name for path in folder.iterdir() if path.suffix != ".json"} == (
        {"report.html", "figures"} if drawn else set()
    )


@pytest.mark.parametrize(
    ("place", "press", "drawn"),
    [
        ("emsid.identification.regressions.wiener_hammerstein_regression", press, True),
        ("emsid.identification.regressions.wiener_hammerstein_regression", Lost, True),
        ("emsid.identification.verdict.compare", press, True),
        ("emsid.io.save", press, True),  # a model is saved as soon as it is fitted
        ("emsid.identification.result.experiment", press, True),  # follows from the models
        ("emsid.cli.first_screen.first_screen", press, True),  # while everything is written
        ("emsid.report.page.page", press, False),
        ("emsid.report.figures.draw", Lost, False),
    ],
)
def test_ctrl_c_keeps_the_results_so_far(place, press, drawn, run, log, tmp_path, pressed_at, monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", lambda _: None)
    pressed_at(place, press=press)
    status, out, err = run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", tmp_path / "out")
    assert (status, err) == (130, FOUND)
    assert "Recommended: " in out
    assert out.splitlines()[-1].startswith(f"written to {tmp_path / 'out'}/: ")
    assert ("report.html" in out.splitlines()[-1]) == drawn
    assert_whole(tmp_path / "out", drawn)


@pytest.mark.parametrize("place", ["emsid.identification.result.experiment", "emsid.identification.result.curves"])
def test_ctrl_c_after_the_searches_leaves_out_what_takes_long(place, run, log, tmp_path, pressed_at, answers):
    """On a record of 65,000 samples that took 10 s, and the page was left out."""
    pressed_at(place)
    status, out, err = run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", tmp_path / "out")
    assert (status, err) == (130, FOUND)
    assert "curves and the next experiment are left out" in answers[0]
    assert "Next experiment" not in out
    content = json.loads((tmp_path / "out" / "result.json").read_text())
    assert content["interrupted"]
    assert content["curves"] == []
    assert_whole(tmp_path / "out", drawn=True)


def test_what_follows_from_the_models_is_computed_in_one_thread(run, log, tmp_path, monkeypatch):
    """Beside another program, small matrices in two threads took seventy times as long."""
    from threadpoolctl import threadpool_info

    from emsid.identification import result

    seen, experiment = [], result.experiment

    def counted(*given, **named):
        seen.extend(each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas")
        return experiment(*given, **named)

    monkeypatch.setattr(result, "experiment", counted)
    assert run("identify", log, *IDENTIFY, "--models", "arx", "--out", tmp_path / "out")[0] == 0
    assert set(seen) == {1}


VALUES, COMPARE = "emsid.identification.workflow.about_excerpt", "emsid.identification.verdict.compare"


@pytest.mark.parametrize("then", [(VALUES,), (COMPARE,), (VALUES, COMPARE)])
def test_ctrl_c_twice_within_a_moment_is_ctrl_c_once(then, run, log, tmp_path, pressed_at):
    pressed_at("emsid.identification.regressions.wiener_hammerstein_regression", *then)
    status, out, err = run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", tmp_path / "out")
    assert (status, err) == (130, FOUND)
    assert "Recommended: arx" in out
    assert json.loads((tmp_path / "out" / "result.json").read_text())["chosen"] == "arx"
    assert_whole(tmp_path / "out", drawn=True)


def test_a_grey_box_interrupted_twice_keeps_its_search(run, motor_log, tmp_path, pressed_at):
    words = ("identify", motor_log, *MOTOR, "--models", "rigid-motor", "--free", "motor_constant,rotor_inertia")
    pressed_at(*(f"emsid.models.plants.search.continuation.{name}" for name in ("gauss_newton", "with_colour")))
    status, _, err = run(*words, "--out", tmp_path / "out")
    assert (status, err) == (130, FOUND)
    assert json.loads((tmp_path / "out" / "result.json").read_text())["chosen"] == "rigid-motor"


# A fresh process that is sent Ctrl-C where a module is imported, and again when it ends. It has one core, so that it
# draws the figures itself.
SIGNALLED = """
import os, signal, sys

class Finder:
    def find_spec(self, name, *_):
        if name == wanted:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
wanted, *sys.argv = sys.argv[1:]
sys.meta_path.insert(0, Finder())
from emsid import __main__
end = __main__._end
__main__._end = lambda status: (os.kill(os.getpid(), signal.SIGINT), str(signal), end(status))
__main__.main()
"""


def signalled(folder, module, *words):
    """Run the program with Ctrl-C at an import and at its end: (status, standard output, standard error)."""
    command = [sys.executable, "-c", SIGNALLED, module, "emsid", *map(str, words)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def answers(monkeypatch):
    """What Ctrl-C is answered at once, on the standard error of the process."""
    lines = []
    monkeypatch.setattr("emsid.cli.interruption.os.write", lambda _, words: lines.append(words.decode()))
    return lines


def test_ctrl_c_is_answered_the_results_written_and_then_the_report_drawn(run, log, tmp_path, pressed_at, answers):
    out, seen = tmp_path / "out", []
    pressed_at("emsid.identification.regressions.wiener_hammerstein_regression")
    pressed_at("emsid.report.page.page", press=lambda: seen.extend([*answers, *out.iterdir()]))
    assert run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", out)[0] == 130
    count = len(list((out / "figures").iterdir()))
    assert seen[:2] == answers == [STOPPING, f"emsid: drawing the report with {count} figures (Ctrl-C: leave it out)\n"]
    assert {path.name for path in seen[2:]} >= {"result.json", "arx.json"}


def test_a_second_ctrl_c_leaves_the_report_out(run, log, tmp_path, pressed_at, answers, monkeypatch):
    clock = iter(range(0, 100, 10))
    monkeypatch.setattr("emsid.cli.interruption.monotonic", lambda: next(clock))
    pressed_at("emsid.identification.regressions.wiener_hammerstein_regression", "emsid.report.page.page")
    status, out, err = run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", tmp_path / "out")
    assert (status, err) == (130, FOUND)
    assert "Recommended: arx" in out
    assert answers[0] == STOPPING
    assert answers[-1] == LEFT_OUT
    assert_whole(tmp_path / "out", drawn=False)


@pytest.mark.parametrize("at", range(2))
def test_a_report_is_written_as_a_whole(at, run, log, tmp_path, pressed_at, monkeypatch):
    """Ctrl-C while its files are written waits until they are."""
    clock = iter(range(0, 1000, 10))
    monkeypatch.setattr("emsid.cli.interruption.monotonic", lambda: next(clock))
    pressed_at("emsid.report.page.write_files" if at else "emsid.report.page.atomic_write")
    assert run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", tmp_path / "out")[0] == 130
    assert_whole(tmp_path / "out", drawn=True)


def test_ctrl_c_at_exit_prints_no_second_message(tmp_path):
    status, out, err = signalled(tmp_path, "", "list")
    assert (status, err) == (130, "")
    assert out.splitlines()[-1].startswith("files written: ")


def test_ctrl_c_while_the_drawing_library_is_imported(log, tmp_path):
    words = ("identify", log, *IDENTIFY, "--models", "arx", *FIRST_ORDER, "--pdf", "--out", "out")
    status, out, err = signalled(tmp_path, "matplotlib.figure", *words)
    assert (status, err) == (130, LEFT_OUT + FOUND)
    assert "Recommended: " in out
    assert_whole(tmp_path / "out", drawn=False)


def test_ctrl_c_after_a_moment_is_another_one(monkeypatch):
    clock = iter([0.0, 0.4, 1.3, 2.5, 3.0])
    monkeypatch.setattr("emsid.cli.interruption.monotonic", lambda: next(clock))
    pressed = Interruption()
    for counts in (True, False, False, True):  # the third comes 0.9 s after the second
        with pytest.raises(KeyboardInterrupt) if counts else nullcontext():
            pressed()
    pressed.begin()
    with pytest.raises(KeyboardInterrupt):
        pressed()


@pytest.mark.parametrize(
    "module", ["emsid.cli", "typer", "polars", "numpy.linalg", "emsid.models.blocks.search.estimation"]
)
def test_ctrl_c_amid_the_first_imports_is_one_line(module, log, tmp_path):
    words = ("describe", log) if "models" not in module else ("identify", log, "--models", "arx", "--out", "out")
    status, out, err = signalled(tmp_path, module, *words, *IDENTIFY)
    assert (status, out, err) == (130, "", "emsid: interrupted; there is no result\n")
    assert not (tmp_path / "out").exists()


def test_ctrl_c_in_a_callback_is_not_spoken_of_twice():
    program = """
import sys
from emsid import __main__, cli
class Lost:
    def __init__(self, problem): self.problem = problem
    def __del__(self): raise self.problem
def work():
    Lost(KeyboardInterrupt())
    Lost(ValueError("a slip of the program"))
cli.main = work
__main__.main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "KeyboardInterrupt" not in done.stderr
    assert "a slip of the program" in done.stderr


def test_a_study_interrupted_while_it_is_drawn_is_printed_and_written(run, tmp_path, monkeypatch):
    monkeypatch.setattr("emsid.report.page.page", lambda *_: os.kill(os.getpid(), signal.SIGINT))
    monkeypatch.setattr("emsid.study.workflow.searches", lambda *_, **__: {})  # regressions are enough to be drawn
    status, out, err = run("study", "--duration", "2", "--out", tmp_path / "out")
    assert status == 130
    assert err == FOUND.replace("identification", "the study")
    assert "simulation study" in out
    assert "--details prints" in out
    assert "study-paper-ratios" in (tmp_path / "out" / "study.json").read_text()
    assert "The paper does not say" not in out  # that is in the report
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["study.json"]


def test_being_terminated_is_quiet(run, log, tmp_path, pressed_at):
    pressed_at("emsid.report.page.page", press=partial(os.kill, os.getpid(), signal.SIGTERM))
    status, _, err = run("identify", log, *IDENTIFY, "--models", "arx", "--out", tmp_path / "out")
    assert (status, err) == (143, "")


COMPILED = """
import hashlib, signal, sys
from emsid.cli.interruption import INTERRUPTION
signal.signal(signal.SIGINT, INTERRUPTION)
INTERRUPTION.watch()
with INTERRUPTION.asked(sys.argv[1]):
    print("begun", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000_000)
"""


@pytest.mark.parametrize(("answer", "presses"), [("stopping", 2), ("", 1)], ids=["of a search", "of other work"])
def test_ctrl_c_ends_a_step_that_python_does_not_leave(answer, presses):
    process = subprocess.Popen(
        [sys.executable, "-c", COMPILED, answer], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    time.sleep(0.1)
    for _ in range(presses):
        process.send_signal(signal.SIGINT)
        time.sleep(0.3)
    _, err = process.communicate(timeout=5)
    assert (process.returncode, err) == (130, "emsid: ended within a step that cannot be interrupted\n")


def test_a_terminated_program_ends_soon_but_not_while_it_writes(monkeypatch):
    left = []
    monkeypatch.setattr("emsid.cli.interruption.CLEANING", 0.01)
    monkeypatch.setattr("emsid.cli.interruption.os._exit", left.append)
    interruption = Interruption()
    interruption.own_process = True
    with interruption.put_off():
        with pytest.raises(SystemExit, match="143"):
            interruption.terminate()
        assert interruption.pressed  # threads of a search end as well
        time.sleep(0.05)
        assert left == []
    end = time.monotonic() + 5
    while not left and time.monotonic() < end:
        time.sleep(0.01)
    assert left == [143]


def test_the_program_ends_without_waiting_for_threads_and_writes_all_its_output():
    program = """
import atexit, time
from threading import Thread
from emsid.__main__ import main
Thread(target=time.sleep, args=(60,)).start()
atexit.register(print, "taken apart")
main()
"""
    done = subprocess.run([sys.executable, "-c", program, "list"], capture_output=True, text=True, timeout=30)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1].startswith("files written: ")


def test_ctrl_c_ends_the_compilation_of_a_kernel(run, log, monkeypatch):
    kernel = numba.njit(lambda x: x + 1.0)

    def pressed(*_, **__):
        os.kill(os.getpid(), signal.SIGINT)
        kernel(1.0)

    monkeypatch.setattr("emsid.models.regression.search.orders.order_grid", pressed)
    assert run("orders", log, *IDENTIFY)[0] == 130
    assert not kernel.signatures
