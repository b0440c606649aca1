"""Models as FMUs: valid, complete, and the same trajectory in an importer."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

import emsid
from emsid.exports import fmu as fmu_format
from emsid.exports.fmi_source import STANDARDS
from emsid.exports.fmu import base_unit
from model_examples import ALL, DT, cascades, feedback, inputs, joints, plants, regressions, state_spaces
from test_export_c import FLAGS

fmpy = pytest.importorskip("fmpy")
for part in ("build", "fmi1", "fmi2", "fmi3", "validation"):
    pytest.importorskip(f"fmpy.{part}")
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
MODELS: dict[str, Any] = {
    name: model for kind in (regressions, state_spaces, cascades, feedback, plants) for name, model in kind()
}
CHOSEN = ("friction", "rigid motor, coasting", next(name for name, _ in feedback()))
ARX = emsid.RegressionModel(emsid.Structure.parse("y(t-1)", "u(t-1)", "u(t)"), np.array([0.5, 2.0, 1.0]), dt=0.1)


def exported(model: Any, folder: Path, version: str = "3.0", **options: Any) -> Path:
    emsid.export(model, "fmu", folder, name="model", dt=None if model.dt else DT, version=version, **options)
    return folder / "model.fmu"


def stepped(
    file: Path, version: str, u: np.ndarray, dt: float, parts: int = 1, parameters: dict[str, float] | None = None
) -> np.ndarray:
    """The outputs (N, ny) when parameters and then each input is set, the output read, and a step made, in parts."""
    about = fmpy.read_model_description(str(file))
    folder = fmpy.extract(str(file))
    kind = fmpy.fmi3.FMU3Slave if version == "3.0" else fmpy.fmi2.FMU2Slave
    instance = kind(
        guid=about.guid, unzipDirectory=folder, modelIdentifier=about.coSimulation.modelIdentifier, instanceName="one"
    )
    instance.instantiate()
    three = version == "3.0"
    put, take = (instance.setFloat64, instance.getFloat64) if three else (instance.setReal, instance.getReal)
    references = {each.name: each.valueReference for each in about.modelVariables}
    for name, value in (parameters or {}).items():
        put([references[name]], [value])
    if three:
        instance.enterInitializationMode(startTime=0.0)
    else:
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
    instance.exitInitializationMode()
    by_kind = {
        kind: [each.valueReference for each in about.modelVariables if each.causality == kind]
        for kind in ("input", "output")
    }
    found = []
    for k, row in enumerate(u):
        put(by_kind["input"], row.tolist())
        found.append(list(take(by_kind["output"])))
        for part in range(parts):
            instance.doStep(currentCommunicationPoint=k * dt + part * dt / parts, communicationStepSize=dt / parts)
    instance.terminate()
    instance.freeInstance()
    shutil.rmtree(folder)
    return np.array(found)


@needs_gcc
@pytest.mark.parametrize("version", ["3.0", "2.0"])
@pytest.mark.parametrize("name", CHOSEN)
def test_an_importer_gets_the_trajectory_of_the_model(name: str, version: str, tmp_path: Path) -> None:
    model = MODELS[name]
    file, dt = exported(model, tmp_path, version), model.dt or DT
    assert fmpy.validation.validate_fmu(str(file)) == []
    u = np.column_stack([inputs(seed) for seed in range(emsid.start(model, dt=dt).inputs)])
    truth = model.run(model.at_rest(0.0, dt), u)[0]
    assert np.abs(stepped(file, version, u, dt) - truth).max() <= 1e-12 * truth.std()


PLANTS = {**{name: ALL[name] for name in ("rigid motor", "elastic motor", "linear axis", "joint")}, **dict(joints())}


@needs_gcc
@pytest.mark.parametrize("version", ["3.0", "2.0"])
@pytest.mark.parametrize("name", PLANTS)
def test_parameters_of_a_plant_can_be_set(name: str, version: str, tmp_path: Path) -> None:
    """The inertia alone, and all that can be set at once: the free run is that of the plant with these values."""
    model, u, rng = PLANTS[name], inputs(0)[:, None], np.random.default_rng(1)
    about = fmpy.read_model_description(str(exported(model, tmp_path, version)))
    start = {each.name: float(each.start) for each in about.modelVariables if each.causality == "parameter"}
    assert start == pytest.approx({each: model.plant.value(each) for each in start}, rel=1e-15)
    inertia = "mass" if "mass" in start else "rotor_inertia"
    usual = model.run(model.at_rest(0.0, DT), u)[0]
    for values in ({inertia: 1.5 * start[inertia]}, {each: rng.uniform(0.7, 1.4) * start[each] for each in start}):
        changed = replace(model, plant=model.plant.with_values(values))
        truth = changed.run(changed.at_rest(0.0, DT), u)[0]
        found = stepped(tmp_path / "model.fmu", version, u, DT, parameters=values)
        assert np.abs(found - truth).max() <= 1e-12 * truth.std()
        if inertia == "mass" or not model.plant.follows:
            assert np.abs(usual - truth).max() > 0.01 * truth.std()


@needs_gcc
def test_a_parameter_is_within_its_bounds_and_is_set_before_the_first_step(tmp_path: Path) -> None:
    file = exported(ALL["rigid motor"], tmp_path)
    with pytest.raises(fmpy.fmi1.FMICallException):
        stepped(file, "3.0", np.zeros((1, 1)), DT, parameters={"resistance": 0.0})
    with pytest.raises(fmpy.fmi1.FMICallException):
        stepped(file, "3.0", np.zeros((1, 1)), DT, parameters={"y": 1.0})


@needs_gcc
def test_a_simulation_of_the_importer_is_the_free_run(tmp_path: Path) -> None:
    model = MODELS["rigid motor"]
    file, u = exported(model, tmp_path), inputs(0)
    time = np.arange(len(u)) * DT
    signal = np.array(list(zip(time, u, strict=True)), dtype=[("time", float), ("u", float)])
    result = fmpy.simulate_fmu(str(file), stop_time=time[-1], step_size=DT, output_interval=DT, input=signal)
    truth = emsid.simulate(model, u, dt=DT).output[:, 0]
    assert np.abs(result["y"] - truth).max() <= 1e-12 * truth.std()


@needs_gcc
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_steps_of_the_importer_may_be_parts_of_a_sample(version: str, tmp_path: Path) -> None:
    u = inputs(1)[:, None]
    file = exported(ARX, tmp_path, version)
    whole = stepped(file, version, u, 0.1)
    assert np.array_equal(stepped(file, version, u, 0.1, parts=3), whole)
    assert np.allclose(whole, ARX.run(ARX.at_rest(0.0, 0.1), u)[0])


@needs_gcc
@pytest.mark.parametrize(("version", "place"), [("3.0", "x86_64-windows"), ("2.0", "win64")])
def test_a_compiler_for_windows_makes_a_second_binary(
    version: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here that of this machine stands for it: the archive has what it makes."""
    cross = "x86_64-w64-mingw32-gcc"
    monkeypatch.setattr(fmu_format, "which", lambda name: shutil.which("gcc" if name == cross else name))
    with ZipFile(exported(ARX, tmp_path, version)) as file:
        assert f"binaries/{place}/model.dll" in file.namelist()
        assert sum(name.endswith(".so") for name in file.namelist()) == (sys.platform == "linux")
    assert f"{place}; other machines compile" in (tmp_path / "README.md").read_text("utf-8")


@needs_gcc
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_every_function_of_the_standard_is_in_the_binary(version: str, tmp_path: Path) -> None:
    number = version[0]
    header = Path(fmpy.__file__).parent / "c-code" / f"fmi{number}Functions.h"
    declared = set(re.findall(rf"#define (fmi{number}\w+)\s+fmi{number}FullName", header.read_text("utf-8")))
    assert len(declared) == len(STANDARDS[version]) == {"3.0": 75, "2.0": 44}[version]
    with ZipFile(exported(ARX, tmp_path, version)) as file:
        file.extractall(tmp_path)
    binary = next((tmp_path / "binaries").glob("*/model.so"))
    symbols = subprocess.run(["nm", "-D", "--defined-only", binary], capture_output=True, text=True, check=True).stdout
    assert {line.split()[-1] for line in symbols.splitlines()} >= declared


@needs_gcc
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_the_sources_compile_without_a_warning(version: str, tmp_path: Path) -> None:
    with ZipFile(exported(ARX, tmp_path, version)) as file:
        file.extractall(tmp_path)
    sources = tmp_path / "sources"
    for source in sorted(sources.glob("*.c")):
        subprocess.run(["gcc", *FLAGS, "-c", source, "-o", source.with_suffix(".o")], check=True)


@pytest.mark.long
@needs_gcc
def test_the_importer_compiles_the_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a compiler there is no binary, and that of the importer gives the same numbers."""
    u = inputs(2)[:, None]
    here = stepped(exported(ARX, tmp_path / "with"), "3.0", u, 0.1)
    monkeypatch.setattr(fmu_format, "which", lambda name: None)
    file = exported(ARX, tmp_path / "without")
    assert "no C compiler" in (file.parent / "README.md").read_text("utf-8")
    folder = Path(fmpy.extract(str(file)))
    assert not (folder / "binaries").exists()
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:/usr/bin:/bin")  # CMake comes with FMPy
    (tmp_path / "build").mkdir()
    fmpy.build.build_platform_binary(folder, tmp_path / "build")
    with ZipFile(file, "a") as archive:
        binary = next((folder / "binaries").glob("*/*.so"))
        archive.write(binary, binary.relative_to(folder))
    assert np.array_equal(stepped(file, "3.0", u, 0.1), here)
    shutil.rmtree(folder)


def test_channels_and_parameters_are_variables_with_units(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    u = rng.standard_normal(300)
    y = np.convolve(u, [0.0, 1.0, 0.5])[:300] + 0.1 * rng.standard_normal(300)
    fit = emsid.fit(emsid.arx(na=1, nb=1), emsid.Record(u, y, 0.01, "voltage", "speed & more", "V", "rad/s"))
    for version in ("3.0", "2.0"):
        emsid.export(fit, "fmu", tmp_path / version, name="model", version=version)
        about = fmpy.read_model_description(str(tmp_path / version / "model.fmu"))
        found = {each.name: each for each in about.modelVariables}
        assert [found["voltage"].unit, found["speed & more"].unit] == ["V", "rad/s"]
        assert found["voltage"].causality == "input"
        assert float(found["b1"].start) == fit["b1"].value
        assert found["b1"].variability == "constant"
        assert float(about.defaultExperiment.stepSize) == 0.01
        units = {each.name: each.baseUnit for each in about.unitDefinitions}
        assert (units["V"].kg, units["V"].m, units["V"].s, units["V"].A) == (1, 2, -3, -1)


@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_names_with_a_tab_or_a_line_feed_and_odd_units_are_read(version: str, tmp_path: Path) -> None:
    u = np.random.default_rng(3).standard_normal(99)
    record = emsid.Record(u, np.cumsum(u), 0.01, "motor\tvoltage", "speed\nof\r\nshaft", "V\n", "m^-")
    emsid.export(emsid.fit(emsid.arx(na=1, nb=1), record), "fmu", tmp_path, name="model", version=version)
    found = fmpy.read_model_description(str(tmp_path / "model.fmu")).modelVariables
    assert {each.name: each.unit for each in found if each.causality != "local" and each.name != "time"} == {
        "motor voltage": "V",
        "speed of shaft": "m^-",
    }


@needs_gcc
def test_the_state_is_kept_and_given_back(tmp_path: Path) -> None:
    about = fmpy.read_model_description(str(exported(ARX, tmp_path)))
    folder = fmpy.extract(str(tmp_path / "model.fmu"))
    instance = fmpy.fmi3.FMU3Slave(guid=about.guid, unzipDirectory=folder, modelIdentifier="model", instanceName="one")
    instance.instantiate()
    instance.enterInitializationMode()
    instance.exitInitializationMode()

    def run(first: int) -> list[float]:
        found = []
        for k in range(first, first + 3):
            instance.setFloat64([1], [1.0])
            instance.doStep(currentCommunicationPoint=0.1 * k, communicationStepSize=0.1)
            found += instance.getFloat64([2])
        return found

    run(0)
    kept = instance.serializeFMUState(instance.getFMUState())
    first = run(3)
    instance.setFMUState(instance.deserializeFMUState(kept))
    assert run(3) == first
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.setFloat64([2], [0.0])  # an output
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.doStep(currentCommunicationPoint=9.0, communicationStepSize=0.1)
    instance.reset()
    instance.enterInitializationMode()
    assert instance.getFloat64([2]) == [0.0]
    instance.freeInstance()
    shutil.rmtree(folder)


@pytest.mark.parametrize(
    ("unit", "found"),
    [
        ("N*m/A", {"kg": "1", "m": "2", "s": "-2", "A": "-1"}),
        ("kg*m^2", {"kg": "1", "m": "2"}),
        ("rad/(s*V)", {"rad": "1", "kg": "-1", "m": "-2", "s": "2", "A": "1"}),
        ("1", {}),
        ("rpm", None),
        *((unit, None) for unit in ("m^-", "m^", "m^--2", "m/s^-", "m^9999999999")),
    ],
)
def test_units_have_exponents_of_base_units(unit: str, found: dict[str, str] | None) -> None:
    assert base_unit(unit) == found


def test_what_cannot_be_an_fmu_is_refused(tmp_path: Path) -> None:
    with pytest.raises(emsid.ModelError, match=r"give 3\.0 or 2\.0"):
        exported(ARX, tmp_path, "1.0")
    fit = emsid.fit(emsid.arx(na=1, nb=1), emsid.Record(np.sin(np.arange(99.0)), np.cos(np.arange(99.0)), 0.1, "a\x01"))
    with pytest.raises(emsid.ModelError, match="XML cannot hold"):
        emsid.export(fit, "fmu", tmp_path)
    assert not list(tmp_path.iterdir())
