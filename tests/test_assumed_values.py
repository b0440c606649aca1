"""Where a model goes, it goes with what it assumes: exports, model files, the library of motors, studio and fleets."""

import json
import zipfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.compensation.files import README as COMPENSATION
from emsid.compensation.files import write
from emsid.estimation.estimates import Status
from emsid.exports import FORMATS
from emsid.exports.assumptions import assumed, sentences
from emsid.exports.verb import README
from emsid.fleets.page import MARK, fleet_report
from emsid.fleets.verb import Fleet, findings_of
from emsid.fleets.work import FleetRow, estimates_of
from emsid.io.model_file import _checksum, _Document, _read
from emsid.plant import Bench, Friction, Motor
from emsid.record import Record
from emsid.studio.use import exported
from emsid.studio.views import parameter

TRUE = Motor(
    resistance=0.7,
    inductance=0.0,
    motor_constant=0.03,
    rotor_inertia=1.5e-5,
    rotor_viscous=0.0,
    shaft_stiffness=np.inf,
    load_inertia=1e-15,
    load_viscous=0.0,
    rotor_friction=Friction(4e-3),
    load_friction=Friction(),
    voltage_dead_zone=None,
)
WINDING = {"winding": "line", "pole_pairs": 7}
PHYSICAL = [name for name, kind in FORMATS.items() if kind.physical]
SAID = "resistance 2 Ω is assumed, not measured"


@pytest.fixture(scope="module")
def record() -> Record:
    rng = np.random.default_rng(4)
    found = Bench().run(TRUE, np.repeat(rng.uniform(-5, 5, 40), 15), 0.004, rng)
    return replace(found, output=found.output + 0.05 * rng.standard_normal(found.output.shape))


@pytest.fixture(scope="module")
def guessed(record: Record) -> emsid.plants.GreyBoxFit:
    """Voltage and speed alone: the resistance is kept at 2 Ω, where 0.7 Ω is true."""
    free = ["resistance", "motor_constant", "rotor_inertia", "rotor_friction.coulomb"]
    return emsid.fit(emsid.plants.rigid_motor(), record, free=free, fixed={"rotor_viscous": 0.0})


@pytest.fixture(scope="module")
def measured(record: Record) -> emsid.plants.GreyBoxFit:
    free = ["motor_constant", "rotor_inertia", "rotor_friction.coulomb"]
    return emsid.fit(emsid.plants.rigid_motor(), record, free=free, fixed={"resistance": 0.7, "rotor_viscous": 0.0})


@pytest.fixture
def guessed_file(guessed: emsid.plants.GreyBoxFit, record: Record, tmp_path: Path) -> Path:
    emsid.save(guessed, tmp_path / "guessed.json", record)
    return tmp_path / "guessed.json"


def options(name: str) -> dict[str, object]:
    return WINDING if "winding" in FORMATS[name].options else {}


def contents(paths: list[Path]) -> dict[str, str]:
    """The files as text, those of an archive too."""
    found = {}
    for path in paths:
        if path.suffix == ".fmu":
            with zipfile.ZipFile(path) as archive:
                found[path.name] = archive.read("modelDescription.xml").decode()
        else:
            found[path.name] = path.read_text("utf-8")
    return found


def test_what_is_physical_is_a_property_of_the_format() -> None:
    firmware = {"odrive", "vesc", "moteus", "simplefoc"}
    assert set(PHYSICAL) == {"fmu", "modelica", "mujoco", "isaac-lab", "mjlab", "csv", *firmware}


@pytest.mark.parametrize("name", PHYSICAL)
def test_a_physical_format_refuses_an_assumed_value_until_it_is_named(
    name: str, guessed: emsid.plants.GreyBoxFit, guessed_file: Path, tmp_path: Path
) -> None:
    for fit in (guessed, emsid.load(guessed_file)):
        with pytest.raises(emsid.ModelError, match=r"resistance 2 Ω is assumed, not measured; .*: resistance$"):
            emsid.export(fit, name, tmp_path / "out", dt=0.004, **options(name))
    assert not (tmp_path / "out").exists()
    for k, assume in enumerate((("resistance",), "R_a", "resistance, motor_constant")):
        written = contents(emsid.export(guessed, name, tmp_path / str(k), dt=0.004, assume=assume, **options(name)))
        assert SAID in written[README]
        own = [text for file, text in written.items() if file != README and not file.endswith(".csv")]
        assert all("assumed, not measured" in text for text in own)


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in (*PHYSICAL, "fixed-point")])
def test_a_format_of_behaviour_only_says_what_is_assumed(
    name: str, guessed: emsid.plants.GreyBoxFit, tmp_path: Path
) -> None:
    if name == "matlab":  # which carries no plant
        pytest.skip("a plant has no form in MATLAB")
    text = contents(emsid.export(guessed, name, tmp_path, dt=0.004))[README]
    assert SAID in text
    assert "which does not depend on what is assumed" in text


def test_the_constants_of_wpilib_do_not_depend_on_the_resistance(
    guessed: emsid.plants.GreyBoxFit, measured: emsid.plants.GreyBoxFit, tmp_path: Path
) -> None:
    """They are volts, and the true ones, although 2 Ω was kept."""
    found = []
    for k, fit in enumerate((guessed, measured)):
        text = contents(emsid.export(fit, "wpilib", tmp_path / str(k)))["rigid_motor.yaml"]
        lines = [line.split("#")[0].split(":") for line in text.splitlines() if not line.startswith("#")]
        found.append({name: float(value) for name, value in lines})
    ratio = TRUE.resistance / TRUE.motor_constant
    for each in found:
        assert each["kV_radians"] == pytest.approx(TRUE.motor_constant, rel=0.02)
        assert each["kA_radians"] == pytest.approx(ratio * TRUE.rotor_inertia, rel=0.05)
        assert each["kS"] == pytest.approx(ratio * 4e-3, rel=0.05)


@pytest.mark.parametrize("name", PHYSICAL)
def test_nothing_is_refused_where_the_resistance_was_given(
    name: str, measured: emsid.plants.GreyBoxFit, tmp_path: Path
) -> None:
    assert assumed(measured) == ()
    text = "".join(contents(emsid.export(measured, name, tmp_path, dt=0.004, **options(name))).values())
    assert "assumed, not measured" not in text


def test_a_built_in_value_is_assumed_like_one_that_was_kept(record: Record) -> None:
    """Whatever parameter it is: here a dead zone that nobody gave or estimated."""
    plant = emsid.plants.rigid_motor().with_values({"voltage_dead_zone.half_width": 0.5})
    fit = emsid.fit(plant, record, free=["motor_constant", "rotor_inertia"], fixed={"rotor_viscous": 0.0})
    assert {row.name for row in assumed(fit)} == {"resistance"}  # the dead zone is of the plant that the user gave
    with pytest.raises(emsid.ModelError, match="has no parameter 'resistence' to assume"):
        emsid.export(fit, "mujoco", "nowhere", assume="resistence")


def test_an_unknown_inductance_is_left_out_of_firmware_and_named(
    measured: emsid.plants.GreyBoxFit, tmp_path: Path
) -> None:
    for name, file in (("odrive", "rigid_motor_odrive.py"), ("vesc", "rigid_motor_vesc.yaml")):
        written = contents(emsid.export(measured, name, tmp_path / name, **WINDING))
        assert not any(word in written[file] for word in ("inductance", "motor_l", "current_kp"))
        assert "does not show the inductance" in written[README]
    text = contents(emsid.export(measured, "simplefoc", tmp_path / "simplefoc", **WINDING))["rigid_motor_simplefoc.h"]
    assert ", NOT_SET)" in text
    known = replace(measured, model=measured.model.with_estimates(["inductance"], np.array([2e-3])))
    text = contents(emsid.export(known, "odrive", tmp_path / "known", **WINDING))["rigid_motor_odrive.py"]
    assert "phase_inductance = 0.001  # H" in text


def test_the_sources_of_a_model_without_its_fit_are_not_known(guessed: emsid.plants.GreyBoxFit, tmp_path: Path) -> None:
    emsid.save(guessed.model, tmp_path / "model.json")
    text = contents(emsid.export(emsid.load(tmp_path / "model.json"), "mujoco", tmp_path / "out"))[README]
    assert "The sources of the values are not known" in text


def test_a_file_keeps_what_is_assumed(guessed: emsid.plants.GreyBoxFit, guessed_file: Path) -> None:
    loaded = emsid.load(guessed_file)
    assert [row.how for row in loaded.table] == [row.how for row in guessed.table]
    assert sentences(loaded) == sentences(guessed)
    assert "(assuming rotor_viscous, resistance)" in str(loaded)


def test_a_file_of_before_says_what_its_rows_tell(guessed_file: Path) -> None:
    """Schema 3 called every estimate conditional that depends on what was held."""
    document = json.loads(guessed_file.read_text())
    for row in document["fit"]["table"]:
        if row["status"] == Status.ASSUMING:
            row["status"] = Status.CONDITIONAL
    document["schema"] = 3
    import msgspec

    old = msgspec.convert(document, _Document)
    old.sha256 = _checksum(old)
    guessed_file.write_bytes(msgspec.json.encode(old))
    assert _read(guessed_file).schema == 3
    loaded = emsid.load(guessed_file)
    assert {row.name for row in loaded.table if row.status is Status.ASSUMING} == {
        "rotor_inertia",
        "rotor_friction.coulomb",
    }
    with pytest.raises(emsid.ModelError, match="assumed, not measured"):
        emsid.export(loaded, "mujoco", guessed_file.parent / "out")


def test_the_command_line_refuses_in_one_line(guessed_file, command, capsys, tmp_path) -> None:
    asked = ("export", guessed_file, "--to", "mujoco", "--out", tmp_path / "out")
    assert command(*asked) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert SAID in line
    assert "--assume" in line
    assert not list(tmp_path.glob("out/*"))
    assert command(*asked, "--assume", "resistance") == 0
    assert SAID in (tmp_path / "out" / "rigid_motor.xml").read_text("utf-8")


def test_the_library_of_motors_says_what_is_assumed(guessed_file, command, capsys, tmp_path) -> None:
    (tmp_path / "log.csv").write_text("t,u,y\n0,0,0\n")
    log, folder = ("--record", tmp_path / "log.csv"), tmp_path / "library"
    assert command("motors", folder, "--add", f"one={guessed_file}", *log, "--command", "none") == 0
    for more in ((), ("--compare", "one"), ("--check", f"one={guessed_file}", *log)):
        capsys.readouterr()
        assert command("motors", folder, *more) == 0
        assert SAID in capsys.readouterr().out
    assert command("motors", folder, "--json") == 0
    assert json.loads(capsys.readouterr().out)["motors"]["one"]["assumed"] == ["resistance"]


def test_a_compensation_says_what_is_assumed(guessed: emsid.plants.GreyBoxFit, tmp_path: Path) -> None:
    write(guessed, emsid.compensate(guessed, dt=0.004), tmp_path, dt=0.004)
    assert SAID in (tmp_path / COMPENSATION).read_text("utf-8")


def test_studio_exports_and_lists_it_alike(guessed: emsid.plants.GreyBoxFit, guessed_file: Path) -> None:
    with pytest.raises(emsid.ModelError, match="assumed, not measured"):
        exported(guessed_file, "mujoco")
    archive = zipfile.ZipFile(BytesIO(exported(guessed_file, "mujoco", ["resistance"])))
    assert SAID in archive.read(README).decode()
    status = {row.name: parameter(row)["status"] for row in guessed.table}
    assert status["rotor_inertia"] == "assuming rotor_viscous, resistance"


def test_a_fleet_marks_what_depends_on_an_assumed_value(
    guessed: emsid.plants.GreyBoxFit, measured: emsid.plants.GreyBoxFit
) -> None:
    fleet = Fleet((FleetRow("M1", "", estimates=estimates_of(guessed)),))
    assert fleet.assuming == {"rotor_inertia": ("resistance",), "rotor_friction.coulomb": ("resistance",)}
    fleet = replace(fleet, findings=tuple(findings_of(fleet, 1)))
    assert "fleet-assumes" in {finding.code for finding in fleet.findings}
    (table,) = fleet_report(fleet, "one motor").sections[-1].tables
    marked = {head.split(f" {MARK} ")[0] for head in table.header if MARK in head}
    assert marked == set(fleet.assuming)
    assert Fleet((FleetRow("M1", "", estimates=estimates_of(measured)),)).assuming == {}
