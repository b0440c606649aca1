"""Plants as Modelica: compiled, and simulated through stops and reversals beside the model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.plant import Friction
from model_examples import plants
from test_export import motor

rumoca = pytest.importorskip("rumoca")
DT, HELD = 2e-3, 40


def simulated(
    model: GreyBox, levels: list[float], folder: Path, dt: float = DT, held: int = HELD
) -> tuple[np.ndarray, np.ndarray]:
    """The outputs in Modelica, and those of the model, for an input of steps of some samples."""
    emsid.export(model, "modelica", folder, name="plant", dt=dt)
    u, count = np.repeat(levels, held), len(levels)
    switched = "".join(f"if time < {(k + 1) * held * dt!r} then {levels[k]!r} else " for k in range(count - 1))
    text = (folder / "plant.mo").read_text("utf-8")
    text += f"model test\n  plant one;\nequation\n  one.u = {switched}{levels[-1]!r};\nend test;\n"
    how = rumoca.SimConfig(solver="rk-like", rtol=1e-9, atol=1e-9, dt=dt)
    result = rumoca.Session().loads(text, model="test").simulate(t=(0.0, dt * (len(u) - 1)), dt=dt, config=how)
    time, names = dt * np.arange(len(u)), ["y"] if len(model.signals) == 1 else ["y1", "y2"]
    found = [np.interp(time, np.asarray(result.time), np.asarray(result[f"one.{name}"])) for name in names]
    return np.column_stack(found), emsid.simulate(model, u, dt=dt).output


@pytest.mark.parametrize("drop", [0.0, 0.5])
def test_a_motor_moves_as_the_model(drop: float, tmp_path: Path) -> None:
    plant = motor(0.4).plant
    stribeck = Friction(0.004, 0.002, 0.5)
    plant = replace(plant, motor=replace(plant.motor, rotor_friction=stribeck), voltage_drop=drop, steps=4)
    levels = np.random.default_rng(1).uniform(-4, 4, 12).tolist()
    found, truth = simulated(GreyBox(plant, (Signal.SPEED, Signal.CURRENT)), levels, tmp_path)
    assert (truth[:, 0] == 0).sum() > 40  # it stands
    assert np.abs(found - truth)[:, 0].max() < 2e-4 * truth[:, 0].std()


def test_an_axis_moves_as_the_model(tmp_path: Path) -> None:
    model = dict(plants())["linear axis"]
    values = {"drive.delay": 0.0, "sensor.lag": 0.0, "friction.coulomb.backward": 0.3, "cogging.sine_1": 0.02}
    model = replace(model, plant=model.plant.with_values(values))
    levels = np.random.default_rng(2).uniform(-2, 2, 10).tolist()
    found, truth = simulated(model, levels, tmp_path)
    assert (np.abs(found - truth).max(axis=0) < 1e-6 * truth.std(axis=0)).all()


def test_what_is_not_carried_is_said(tmp_path: Path) -> None:
    emsid.export(dict(plants())["linear axis"], "modelica", tmp_path, dt=DT)
    text = (tmp_path / "README.md").read_text("utf-8")
    assert "drive.delay = 0.003 s is not carried." in text
    assert "sensor.lag = 0.01 s is not carried." in text


@pytest.mark.parametrize(
    ("name", "called", "words"),
    [("elastic motor", "plant", "one mass"), ("own plant", "plant", "one mass"), ("rigid motor", "model", "word of")],
)
def test_what_cannot_be_modelica_is_refused(name: str, called: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(emsid.ModelError, match=words):
        emsid.export(dict(plants())[name], "modelica", tmp_path, name=called, dt=DT)
