"""What CONTRIBUTING.md says about adding things, done: its snippets are run, and what they add is used."""

from __future__ import annotations

import ast
import re
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
        "file format", "test signal", "static map", "regressor transform", "friction law", "plant", "kind of model",
        "finding", "view of the report",
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


def test_a_regressor_transform():
    source = Path(transforms.__file__).read_text("utf-8")
    lines = snippet("regressor transform", "diff").splitlines()
    for k, line in enumerate(lines):
        if line.startswith("+"):
            before = lines[k - 1][1:]
            assert source.count(f"{before}\n") == 1, before
            source = source.replace(f"{before}\n", f"{before}\n{line[1:]}\n")
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
