"""The command line to its end: every model on every kind of record, and every verb on every kind of model file.

Each run works, or says in one line why not. Searches get little time, as they are not what is tested. The whole product
takes minutes and is `long`; without it, every model is fitted to one record, and every record by the default models.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import emsid
from command_line import Page
from emsid.exports import FORMATS
from emsid.identification.candidates import CANDIDATES
from emsid.studio.runs import Runs
from emsid.studio.session import Session
from emsid.studio.use import loaded, played, sliders
from model_examples import ALL, DT, measured

pytestmark = pytest.mark.usefixtures("ctrl_c_heard")

NAMES = tuple(CANDIDATES)
DEMO = {
    "motor": ("motor.csv", "-u", "voltage", "-y", "speed", "--time", "t", "--rows", "0:500"),
    "axis": ("axis.csv", "-u", "force", "-y", "position", "--time", "t", "--rows", "0:500"),
    "circuit": ("circuit.csv", "-u", "source", "-y", "output", "--time", "t", "--rows", "0:500"),
}
ODD = ("one output", "two outputs", "gaps", "two levels", "counts", "200 samples")


def odd(folder: Path, kind: str) -> tuple[object, ...]:
    """A file of one of the odd kinds of record, and the options that read it."""
    rng, count = np.random.default_rng(1), 200 if kind == "200 samples" else 420
    u = np.repeat(rng.uniform(-6, 6, count // 20), 20)
    u = 4 * np.sign(u) if kind == "two levels" else u
    y = np.zeros(count)
    for t in range(1, count):
        y[t] = 0.9 * y[t - 1] + 2.0 * np.sign(u[t - 1]) * max(abs(u[t - 1]) - 0.5, 0)
    columns = {"u": u, "y": y + 0.05 * rng.standard_normal(count)}
    if kind == "two outputs":
        columns["z"] = np.cumsum(y) * 0.01
    if kind == "counts":
        columns["y"] = np.round(y / 2)
    path = folder / f"{kind.replace(' ', '-')}.csv"
    rows = [[f"{value:.6g}" for value in row] for row in zip(*columns.values(), strict=True)]
    if kind == "gaps":
        for k in (130, 131, 300):
            rows[k][1] = ""
    path.write_text("\n".join([",".join(columns), *map(",".join, rows)]) + "\n")
    outputs = [word for name in columns if name != "u" for word in ("-y", name)]
    return (path, "-u", "u", *outputs, "--dt", "0.01")


@pytest.fixture(scope="session")
def files(tmp_path_factory, command) -> dict[str, tuple[object, ...]]:
    """Every record, with the options that read it."""
    folder = tmp_path_factory.mktemp("records")
    assert command("demo", folder) == 0
    found = {name: (folder / file, *how) for name, (file, *how) in DEMO.items()}
    return found | {kind: odd(folder, kind) for kind in ODD}


def ended_well(status: int, err: str) -> bool:
    """Whether a command worked; else it said in one line why not."""
    assert "Traceback" not in err
    assert "inside the program" not in err
    if status:
        assert status == 2
        assert err.startswith("emsid: ")
        assert err.count("\n") == 1
    return status == 0


def opened(folder: Path) -> None:
    """Open every page and every model file that an identification wrote, and look for defects."""
    Page((folder / "report.html").read_text())
    written = json.loads((folder / "result.json").read_text())
    assert not [each for each in written["findings"] if "inside the program" in json.dumps(each)]
    for row in {each["model"] for each in written["rows"]}:
        assert emsid.load(folder / f"{row}.json").model.name == row


def identified(run: Callable[..., tuple[int, str, str]], read: tuple[object, ...], out: Path, *words: str) -> bool:
    """Identify, and open what was written; whether there was a result."""
    status, _, err = run("identify", *read, *words, "--out", out)
    if ended_well(status, err):
        opened(out)
    return status == 0


@pytest.mark.parametrize("name", NAMES)
def test_every_model_alone_reaches_its_end(run, files, tmp_path, name) -> None:
    record = "axis" if name == "linear-axis" else "motor"
    identified(run, files[record], tmp_path / "out", "--models", name, "--budget", "1")


@pytest.mark.parametrize("record", [*DEMO, *ODD])
def test_every_record_reaches_the_end_of_the_default_models(run, files, tmp_path, record) -> None:
    words: tuple[str, ...] = () if record != "gaps" else ("--skip-bad-rows",)
    assert identified(run, files[record], tmp_path / "out", *words, "--budget", "2")


@pytest.mark.long
@pytest.mark.parametrize("record", [*DEMO, *ODD])
@pytest.mark.parametrize("name", [*NAMES, ",".join(NAMES)], ids=[*NAMES, "all"])
def test_every_model_reaches_its_end_on_every_record(run, files, tmp_path, record, name) -> None:
    identified(run, files[record], tmp_path / "out", "--models", name, "--budget", "20" if "," in name else "2")


SAVED = {type(model).__name__: model for name, model in ALL.items() if "own" not in name}


def read(log: Path) -> tuple[object, ...]:
    """The options that read a record of a model, with all its outputs."""
    first, *outputs = log.read_text().splitlines()[0].split(",")
    return ("-u", first, *(word for name in outputs for word in ("-y", name)), "--dt", DT)


VERBS = {
    "validate": lambda model, log, out: ("validate", model, log, *read(log), "--out", out),
    "simulate": lambda model, log, out: ("simulate", model, log, "--input", "u", "--dt", DT, "--out", f"{out}.csv"),
    "compensate": lambda model, log, out: ("compensate", model, "--out", out, "--dt", DT),
    "control": lambda model, log, out: ("control", model, "--out", out, "--dt", DT),
    "motors": lambda model, log, out: ("motors", out, "--add", f"one={model}", "--record", log, "--command", "none"),
    **{
        f"export to {name}": lambda model, log, out, to=name: ("export", model, "--to", to, "--out", out, "--dt", DT)
        for name in FORMATS
    },
}


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    """A folder with a model file of every kind, and a record of each."""
    folder = tmp_path_factory.mktemp("saved")
    for kind, model in SAVED.items():
        record = replace(measured(model), input_names=("u",))
        emsid.save(model, folder / f"{kind}.json", record)
        names = [f"y{k}" if k else "y" for k in range(record.output.shape[1])]
        rows = np.hstack([record.input, record.output])[:300]
        text = [",".join(["u", *names]), *(",".join(f"{x:.8g}" for x in row) for row in rows)]
        (folder / f"{kind}.csv").write_text("\n".join(text) + "\n")
    return folder


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("kind", SAVED)
def test_every_verb_takes_every_kind_of_model_file(run, saved, tmp_path, kind, verb) -> None:
    model, log = saved / f"{kind}.json", saved / f"{kind}.csv"
    status, _, err = run(*VERBS[verb](model, log, tmp_path / "out"))
    worked = ended_well(status, err)
    if verb in ("validate", "simulate"):
        assert worked
    if verb == "validate":
        Page((tmp_path / "out" / "report.html").read_text())


def test_the_studio_lists_and_runs_every_kind_of_model_file(saved, tmp_path) -> None:
    session = Session.at_folder(tmp_path)
    run = session.new_folder("runs")
    for kind in SAVED:
        (run / f"{kind}.json").write_bytes((saved / f"{kind}.json").read_bytes())
    assert Runs(session, lambda _: None).state(run.name)["models"] == sorted(SAVED)
    for kind in SAVED:
        found, u = loaded(run / f"{kind}.json"), np.ones((300, 1))
        assert sliders(found)
        signals = played(run / f"{kind}.json", {}, {"kind": "step"}, emsid.Record(u, u, DT))
        assert all(np.isfinite(each.values).all() for each in signals[:2])  # the third is measured
