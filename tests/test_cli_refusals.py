"""The command line refuses what cannot be meant: in one line, before anything is written."""

import numpy as np
import pytest

from command_line import IDENTIFY, table

pytestmark = pytest.mark.usefixtures("ctrl_c_heard", "figures_undrawn")


BAD = {
    "missing column": (("identify", "LOG", "--input", "volts", "--output", "y", "--dt", "1"), ("volts", "u, y")),
    "misspelt column": (("identify", "LOG", "--input", "u", "--output", "yy", "--dt", "1"), ("yy", "y")),
    "no sample time": (("identify", "LOG", "--input", "u", "--output", "y"), ("--dt", "--time")),
    "missing file": (("identify", "nowhere.csv", *IDENTIFY), ("nowhere.csv", "no such file")),
    "unknown model": (("identify", "LOG", *IDENTIFY, "--models", "arxx"), ("arxx", "friction-narx")),
    "bad rows": (("identify", "LOG", *IDENTIFY, "--rows", "5"), ("--rows", "A:B")),
    "empty rows": (("identify", "LOG", *IDENTIFY, "--rows", "900:950"), ("600",)),
    "bad scale": (("identify", "LOG", *IDENTIFY, "--scale", "u"), ("--scale", "COLUMN=VALUE")),
    "no model named": (("identify", "LOG", *IDENTIFY, "--models", ""), ("--models '': write it as names with commas",)),
    "a model left out": (("identify", "LOG", *IDENTIFY, "--models", "arx,,wiener"), ("--models 'arx,,wiener'",)),
    "nothing free": (("identify", "LOG", *IDENTIFY, "--models", "motor", "--free", ""), ("--free ''",)),
    "no order": (("identify", "LOG", *IDENTIFY, "--orders", ""), ("--orders '': write it as whole numbers",)),
    "scale twice": (
        ("identify", "LOG", *IDENTIFY, "--scale", "u=2", "--scale", "u=3"),
        ("--scale gives u twice, as 2 and as 3; leave one of them out",),
    ),
    "unit twice": (("describe", "LOG", *IDENTIFY, "--unit", "u=V", "--unit", "u=mV"), ("u twice, as V and as mV",)),
    "parameter fixed twice": (
        ("identify", "LOG", *IDENTIFY, "--models", "motor", "--fix", "resistance=1", "--fix", "resistance=2"),
        ("--fix gives resistance twice",),
    ),
    "scale that is no number": (("identify", "LOG", *IDENTIFY, "--scale", "u=x"), ("--scale", "not a number")),
    "mask that leaves nothing": (("identify", "LOG", *IDENTIFY, "--mask", "u > -99"), ("mask",)),
    "mask that is no condition": (("identify", "LOG", *IDENTIFY, "--mask", "u >"), ("mask",)),
    "unit without meaning": (("identify", "LOG", *IDENTIFY, "--unit", "y=count/sample"), ("--counts-per-revolution",)),
    "unknown unit": (("identify", "LOG", *IDENTIFY, "--unit", "y=furlong/moon"), ("furlong/moon",)),
    "too few samples": (("identify", "LOG", *IDENTIFY, "--rows", "8:14"), ("6 samples", "--rows")),
    "model file that is none": (("validate", "LOG", "LOG", *IDENTIFY), ("log.csv",)),
    "unknown signal": (("simulate", "--excitation", "noise", "--out", "x.csv"), ("noise", "prbs")),
    "unknown suffix to write": (("simulate", "--out", "x.doc"), (".doc", ".csv")),
    "negative duration": (("simulate", "--duration", "-1", "--out", "x.csv"), ("-1",)),
    "study of one record": (("study", "--record", "LOG"), ("--validate",)),
    "study without duration": (("study", "--duration", "0"), ("duration",)),
    "more coefficients than anybody means": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx", "--na", "99999999999999"),
        ("na", "1000"),
    ),
    "orders in words": (("identify", "LOG", *IDENTIFY, "--orders", "two"), ("--orders",)),
    "orders for another structure": (
        ("identify", "LOG", *IDENTIFY, "--models", "wiener", "--orders", "2,2"),
        ("wiener has 1 filter; 2 orders given", "give one for each (--orders)"),
    ),
    "negative orders": (
        ("identify", "LOG", *IDENTIFY, "--models", "feedback", "--orders", "-1"),
        ("feedback: order -1: orders count states; give a whole number from 0 to 12 (--orders)",),
    ),
    "an order of hours": (
        ("identify", "LOG", *IDENTIFY, "--models", "feedback", "--orders", "40"),
        ("feedback: order 40: orders count states; give a whole number from 0 to 12 (--orders)",),
    ),
    "a delay that leaves nothing": (
        ("identify", "LOG", *IDENTIFY, "--models", "feedback", "--nk", "500"),
        ("feedback: a delay of 500 in a stretch of 420 samples; give at most 42 (--nk)",),
    ),
    "no knots in a feedback": (
        ("identify", "LOG", *IDENTIFY, "--models", "feedback", "--knots", "0"),
        ("feedback: its maps have at least one knot, or degree; 0 given (--knots)",),
    ),
    "one knot of a spline": (
        ("identify", "LOG", *IDENTIFY, "--models", "feedback", "--knots", "1"),
        ("feedback: spline: 1 knots and 1 values; give as many, at least 2 (--knots)",),
    ),
    "too many knots in a feedback": (
        ("identify", "LOG", *IDENTIFY, "--models", "feedback", "--knots", "5000"),
        ("feedback: size 5000: this is a number of knots, or a degree; give a whole number from 0 to 100 (--knots)",),
    ),
    "too many knots": (
        ("identify", "LOG", *IDENTIFY, "--models", "friction-narx", "--knots", "5000"),
        ("knots 5000: these are hinges on each side of zero; give a whole number from 0 to 1000 (--knots)",),
    ),
    "unknown static map": (("identify", "LOG", *IDENTIFY, "--static", "cubic"), ("cubic", "dead-zone")),
    "unknown physical parameter": (
        ("identify", "LOG", *IDENTIFY, "--models", "rigid-motor", "--fix", "resistanse=1"),
        ("resistanse", "resistance"),
    ),
    "profile of an unknown parameter": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx,rigid-motor", "--profile", "resistance,inertia"),
        ("rigid-motor has no parameter 'inertia'", "rotor_inertia"),
    ),
    "profile of a fixed parameter": (
        ("identify", "LOG", *IDENTIFY, "--models", "rigid-motor", "--fix", "resistance=1", "--profile", "resistance"),
        ("resistance is fixed, so it has no profile", "rotor_inertia"),
    ),
    "profile of a parameter that is not free": (
        (
            *("identify", "LOG", *IDENTIFY, "--models", "rigid-motor"),
            *("--free", "rotor_inertia", "--profile", "motor_constant"),
        ),
        ("motor_constant is not estimated, so it has no profile; add it to the free parameters", "rotor_inertia"),
    ),
    "profile without a physical model": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx", "--profile", "resistance"),
        ("resistance cannot be profiled", "rigid-motor, motor, linear-axis"),
    ),
    "fixed without a physical model": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx", "--fix", "resistance=1"),
        ("resistance cannot be fixed", "rigid-motor, motor, linear-axis"),
    ),
    "transient of a whole record": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx", "--transient", "100000"),
        ("a transient of 100000 samples leaves no sample", "--transient"),
    ),
    "misspelt parameter": (
        ("identify", "LOG", *IDENTIFY, "--models", "rigid-motor", "--fix", "resistanc=2"),
        ("rigid-motor has no parameter 'resistanc'; did you mean resistance",),
    ),
    "missing datasheet": (("identify", "LOG", *IDENTIFY, "--datasheet", "sheet.toml"), ("sheet.toml",)),
    "missing motor": (("study", "--motor", "motor.toml"), ("motor.toml",)),
    "forgetting of zero": (("study", "--forgetting", "0", "--duration", "2"), ("forgetting",)),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(case, run, log, tmp_path, monkeypatch):
    words, said = BAD[case]
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*(str(log) if word == "LOG" else word for word in words))
    assert status == 2
    assert err.count("\n") == 1
    assert err.startswith("emsid: ")
    assert all(part in err for part in said), err
    assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [("constant input", {"u": np.ones(600)}, "nothing can be identified"), ("text", {"y": ["x"] * 600}, "row")],
)
def test_columns_that_cannot_be_identified_from(name, values, said, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bad = table(tmp_path / "bad.csv", **values)
    status, _, err = run("identify", bad, *IDENTIFY)
    assert status == 2
    assert said in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["bad.csv"]


@pytest.mark.parametrize("fraction", [0, 1, 2, -0.5, "nan"])
def test_fractions_kept_unseen_lie_between_none_and_all(run, log, tmp_path, fraction):
    words = ("-u", "u", "-y", "y", "--dt", 0.01, "--out", tmp_path / "out", "--unseen", fraction)
    status, _, err = run("identify", log, *words)
    assert (status, err.count("\n")) == (2, 1)
    assert "give a fraction between 0 and 1" in err


@pytest.mark.parametrize("command", ["study", "identify"])
def test_a_folder_that_cannot_be_written_to_is_noticed_before_anything_is_done(run, log, command):
    words = ("identify", log, "-u", "u", "-y", "y", "--dt", 0.01) if command == "identify" else ("study",)
    status, _, err = run(*words, "--out", log / "below")
    assert status == 2
    assert "is not a folder that can be written to" in err


def test_the_unseen_record_of_a_study_has_two_names(run, tmp_path):
    for name in ("--validate", "--verify"):
        status, _, err = run("study", name, tmp_path / "b.csv")
        assert status == 2
        assert "--record and --validate belong together" in err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("identif",), "no such command 'identif'. Did you mean 'identify'?; see emsid --help"),
        (("identify",), "missing argument 'FILE'; give a file, or columns of files"),
        (("identify", "a.csv", "--na", "x"), "invalid value for '--na': "),
        (("study", "--bogus"), "no such option: --bogus"),
        (("study", "--step", "nan"), "sample time of nan s; give a finite number"),
    ],
)
def test_a_slip_of_the_keyboard_is_one_line(words, said, run):
    status, out, err = run(*words)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"emsid: {said}")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("study", "-u", "zzz", "--unit", "y=rpm"), "--input, --unit: only for --record and --validate"),
        (("identify", "LOG", *IDENTIFY, "--ridge", "1", "--forgetting", "0.9"), "choose one of them"),
        (("identify", "LOG", *IDENTIFY, "--fix", "resistance"), "write it as NAME=VALUE"),
    ],
)
def test_options_that_contradict_each_other_are_refused(words, said, run, log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, _, err = run(*(log if word == "LOG" else word for word in words))
    assert (status, err.count("\n")) == (2, 1)
    assert said in err
