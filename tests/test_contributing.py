"""What CONTRIBUTING.md says about adding things, done: its snippets are run, and what they add is used."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import types
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.excitation import SIGNALS
from emsid.findings import Finding
from emsid.identification.candidates import CANDIDATES
from emsid.io import READERS
from emsid.models.blocks.static_maps import STATIC_MAPS
from emsid.models.plants.registry import PLANTS
from emsid.models.regression import transforms
from emsid.plant.friction import FRICTION_LAWS
from emsid.report.views.sections import VIEWS, model_section
from emsid.wording import CATALOGUE, Severity, sentence, severity

TEXT = (Path(__file__).parent.parent / "CONTRIBUTING.md").read_text("utf-8")
SECTIONS = dict(re.findall(r"^### An? (.+?)\n(.*?)(?=^### |\Z)", TEXT, re.MULTILINE | re.DOTALL))
LONGEST = 15


@pytest.fixture(autouse=True)
def registries():
    """What the snippets register is gone after each test."""
    tables = (CATALOGUE, READERS, SIGNALS, STATIC_MAPS, FRICTION_LAWS, PLANTS, CANDIDATES.given)
    before = [dict(table) for table in tables]
    yield
    for table, entries in zip(tables, before, strict=True):
        table.clear()
        table.update(entries)
    VIEWS.clear()


def snippet(what: str, language: str = "python") -> str:
    return re.search(rf"```{language}\n(.*?)```", SECTIONS[what], re.DOTALL)[1]


def done(what: str) -> dict[str, object]:
    """The names of a snippet that has been run."""
    module = types.ModuleType("contributed")
    names = module.__dict__
    names.update(emsid=emsid, np=np, dataclass=dataclass)
    sys.modules["contributed"] = module
    exec(compile(snippet(what), f"CONTRIBUTING.md: {what}", "exec"), names)
    return names


def responding(samples: int = 600, curve=lambda u: u) -> emsid.Record:
    """A first-order system behind a static curve."""
    u = np.repeat(np.random.default_rng(0).uniform(-2, 2, samples // 10), 10)
    y = np.zeros(samples)
    for t in range(1, samples):
        y[t] = 0.8 * y[t - 1] + 0.4 * curve(u[t - 1])
    return emsid.Record(u, y, 0.01)


def test_everything_of_the_plan_is_there_and_short():
    assert set(SECTIONS) == {
        "file format", "test signal", "static map", "regressor transform", "friction law", "plant", "effect of a plant",
        "kind of model", "finding", "view of the report",
    }  # fmt: skip
    for what, text in SECTIONS.items():
        (code,) = re.findall(r"```\w+\n(.*?)```", text, re.DOTALL)
        assert sum(1 for line in code.splitlines() if line.strip()) <= LONGEST, what


def test_a_file_format(tmp_path):
    done("file format")
    path = tmp_path / "log.raw"
    path.write_bytes(np.array([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0]], dtype="<f4").tobytes())
    record = emsid.read(path, input="u", output="y", dt=0.1)
    np.testing.assert_array_equal(record.output[:, 0], [10.0, 20.0, 30.0])


def test_a_test_signal(command, tmp_path):
    done("test signal")
    signal = SIGNALS["square"](1000, 0.01, 3.0, np.random.default_rng(0))
    assert np.count_nonzero(np.diff(signal)) == 19
    assert set(signal) == {-3.0, 3.0}
    path = tmp_path / "made.csv"
    assert command("simulate", "--excitation", "square", "--duration", 1, "--out", path) == 0
    assert len(set(emsid.read(path, input="voltage", output="speed", time="t").input[:, 0])) == 2


def test_a_static_map():
    done("static map")
    fit = emsid.fit(emsid.hammerstein(1, static="root", oversampling=1), responding(curve=lambda u: 2 * np.cbrt(u)))
    assert fit.estimate[fit.names.index("f.c")] == pytest.approx(4.0, rel=1e-3)  # the filter has a gain of one


def changed_by(source: str, lines: list[str]) -> str:
    """A source with the lines that a diff adds, each after the line before it."""
    for k, line in enumerate(lines):
        if line.startswith("+"):
            before = lines[k - 1][1:]
            assert source.count(f"{before}\n") == 1, before
            source = source.replace(f"{before}\n", f"{before}\n{line[1:]}\n")
    return source


def test_a_regressor_transform():
    lines = snippet("regressor transform", "diff").splitlines()
    source = changed_by(Path(transforms.__file__).read_text("utf-8"), lines)
    changed = types.ModuleType("changed")
    sys.modules["changed"] = changed
    exec(compile(source.replace("cache=True, ", ""), "transforms.py", "exec"), changed.__dict__)
    root = changed.Transform.ROOT
    node = ast.parse("sqrt(abs(y(t-1)))", mode="eval").body
    assert changed.read_transform(node)[0] is root
    assert changed.written(root, "y(t-1)", 0.0) == "sqrt(abs(y(t-1)))"
    assert not changed.has_parameter(root)
    for transform in changed.Transform:
        for x in (-2.0, 0.0, 0.3, 5.0):
            found = changed.transformed.py_func(int(transform), x, 0.7)
            assert found == pytest.approx(transform.definition(x, 0.7), rel=1e-14), transform


def test_a_friction_law():
    law = done("friction law")["Square"](dry=0.02, drag=1e-4)
    np.testing.assert_allclose(law.torque([-10.0, 0.0, 20.0]), [-0.03, 0.0, 0.06])
    bare = {"inductance": 0.0, "load_friction": emsid.Friction(), "voltage_dead_zone": None}
    motor = emsid.plants.MotorPlant(emsid.Motor(rotor_friction=law, **bare).rigid())
    assert motor.value("rotor_friction.drag") == 1e-4
    speed = motor.simulate(np.full((400, 1), 6.0), 5e-3, np.zeros(2), (emsid.plants.Signal.SPEED,))[-1, 0]
    m = motor.motor
    drive = m.motor_constant * (6.0 - m.motor_constant * speed) / m.resistance
    drag = law.torque(speed) + m.load_friction.torque(speed) + (m.rotor_viscous + m.load_viscous) * speed
    assert drive == pytest.approx(float(drag), rel=1e-3)  # at rest at this speed


def test_a_plant():
    pendulum = done("plant")["pendulum"]
    assert "pendulum" in PLANTS
    u = 3 * np.sin(0.05 * np.arange(400))[:, None]
    truth = pendulum.with_values({"g": 9.0, "d": 0.5})
    record = emsid.Record(u, truth.simulate(u, 0.01, np.zeros(2), ()), 0.01)
    fit = emsid.fit(pendulum, record)
    assert fit.estimate == pytest.approx([9.0, 0.5], rel=1e-5)
    assert emsid.plants.datasheet("pendulum", {"g": "9.81 1/s^2"})["g"].value == 9.81


BOUNCING = """
import sys
import numpy as np
import emsid
from emsid.models.plants.search.choice import choose
from emsid.models.plants.registry import PLANTS


def speeds(u, dt, bounce):
    # K²/(R·J) = 4, K/(R·J) = 80; friction 60 rad/s²; Euler's method in 400 steps per sample
    w, found = 0.0, []
    for volts in u:
        found.append(w)
        for _ in range(400):
            pulled = (80.0 * volts - 4.0 * w) / (1.0 + bounce * abs(w))
            new = w + dt / 400 * (pulled - 60.0 * np.sign(w))
            w = 0.0 if (w == 0.0 and abs(pulled) < 60.0) or new * w < 0.0 else new
    return np.array(found)


rng = np.random.default_rng(3)
u = np.repeat(rng.uniform(-6.0, 6.0, 60), 10)
for bounce in (0.01, 0.0):
    y = speeds(u, 0.01, bounce) + 0.05 * rng.standard_normal(600)
    fit = choose(PLANTS["rigid-motor"].start, emsid.Record(u, y, 0.01, input_units="V", output_units="rad/s"))
    names, path = list(fit.names), sys.argv[1]
    print(names, fit.estimate.tolist(), flush=True)
    assert ("bounce" in names) == (bounce > 0.0), names
    if bounce:
        row = next(each for each in fit.table if each.name == "bounce")
        assert abs(row.value - bounce) < 3e-4, row
        assert row.interval[0] < bounce < row.interval[1], row
        emsid.save(fit, path)
        assert emsid.load(path).plant.value("bounce") == row.value
"""


def test_an_effect_of_a_plant(tmp_path):
    package = Path(emsid.__file__).parent
    shutil.copytree(package, tmp_path / "emsid")
    _, *files = snippet("effect of a plant", "diff").split("+++ src/")
    added = 0
    for text in files:
        name, *lines = text.splitlines()
        path = tmp_path / name
        path.write_text(changed_by(path.read_text("utf-8"), lines), "utf-8")
        added += sum(line.startswith("+") for line in lines)
    assert added == 3  # a row, a term and a move
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "compiled")}
    run = [sys.executable, "-c", BOUNCING, str(tmp_path / "motor.json")]
    done = subprocess.run(run, env=environment, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_kind_of_model():
    done("kind of model")
    result = emsid.identify(responding(), models=["impulse-response"])
    model = result.chosen.model
    assert model.name == "impulse-response"
    assert len(result.chosen.estimate) == 40
    assert result.chosen.estimate[:2] == pytest.approx([0.4, 0.32], rel=0.05)


def test_a_view_of_the_report():
    done("view of the report")
    record = responding()
    section = model_section(emsid.fit(emsid.arx(1, 1), record), record)
    (figure,) = (each for each in section.figures if each.name == "arx-estimates")
    np.testing.assert_allclose(figure.plots[0].marks[0].y, [0.4, 0.8], rtol=1e-6)


def test_a_finding():
    done("finding")
    hot = Finding("motor-hot", "winding", {"most": 404.0, "unit": "K", "share": 0.04})
    assert sentence(hot) == "winding reaches 404 K in 4 % of the samples; let it cool."
    assert severity(hot) is Severity.WARNING
