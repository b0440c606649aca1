"""What logs of brushless drives can determine, which test shows the rest, and that a designed one does it.

The names of columns are those of the logs of each firmware: ODrive 0.5 and 0.6 (odrive-interface.yaml), moteus
(`Register` and the servo_stats channel), VESC Tool, SimpleFOC (FOCMotor::monitor) and Recoil; the data are of the
independent drive, at 10 kHz.
"""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.first_look import FirstLook, describe
from emsid.models.plants.search.missing_tests import determined_by
from emsid.report.views.first_look import role
from independent.switched_drive import Drive, Log, driven, logged

DRIVE = Drive(switched=False)
WINDING = {"resistance", "inductance_d", "inductance_q", "dead_time_voltage"}
MOTION = {"inertia", "viscous_friction", "friction.coulomb"}
ROTOR = 2 * np.pi


def steps(n: int, seed: int = 5) -> np.ndarray:
    """(n, 2) random levels of both currents, 10 ms long."""
    return np.repeat(np.random.default_rng(seed).uniform(-6, 6, (n // 100, 2)), 100, axis=0)


def held(n: int = 4000) -> Log:
    """The rotor is held, and both currents go in steps."""
    wanted = steps(n)
    return logged(DRIVE, wanted[:, 0], wanted[:, 1], np.full(n, np.nan), 3, locked=True)


def on_d(n: int = 4000) -> Log:
    """The rotor is free, and a current flows on the d-axis only."""
    added = np.column_stack([0.5 * np.random.default_rng(1).choice([-1.0, 1.0], n), np.zeros(n)])
    return logged(DRIVE, steps(n)[:, 0], np.zeros(n), np.full(n, np.nan), 3, added=added)


def coasting(n: int = 4000) -> Log:
    """The rotor comes to rest with open phases, whose voltages are measured."""
    speed = np.where(np.arange(n + 2000) < 1500, 120.0, np.nan)
    log = logged(DRIVE, np.zeros(n + 2000), np.zeros(n + 2000), speed, 1, added=0.0, noisy=False)
    rng = np.random.default_rng(2)
    noisy = {"i_d": 0.05, "i_q": 0.05, "speed": 0.5}
    found = {name: getattr(log, name)[2000:] for name in ("v_d", "v_q", "i_a", "i_b", "angle", "warmer")}
    found |= {name: getattr(log, name)[2000:] + size * rng.standard_normal(n) for name, size in noisy.items()}
    return log._replace(**found)


def written(path: Path, columns: dict[str, np.ndarray], between: str = ",") -> Path:
    rows = np.column_stack([*columns.values()])
    np.savetxt(path, rows, delimiter=between, header=between.join(columns), comments="", fmt="%.9g")
    return path


def look(path: Path, log: Log) -> FirstLook:
    time = log.period * np.arange(len(log.speed))
    named = {name: getattr(log, name) for name in ("v_d", "v_q", "i_d", "i_q", "speed")}
    return describe(written(path / "log.csv", {"time": time, **named}), pole_pairs=7)


def shown(found: FirstLook) -> dict[str, object]:
    (finding,) = [each for each in found.findings if each.code == "record-determines"]
    return dict(finding.data)


def test_a_held_rotor_shows_the_winding_and_a_rotor_that_turns_would_show_the_rest(tmp_path: Path) -> None:
    found = look(tmp_path, held())
    said = shown(found)
    assert (said["turns"], said["currents"]) == (False, ["d", "q"])
    assert {*said["known"]} == WINDING
    assert {name: {*names} for name, names in said["tests"].items()} == {"q-axis": {"flux", *MOTION}}
    assert found.reading["output"] == ["i_d", "i_q"]  # its speed is noise


def test_currents_on_the_d_axis_leave_the_rest_open(tmp_path: Path) -> None:
    said = shown(look(tmp_path, on_d()))
    assert (said["turns"], said["currents"]) == (False, ["d"])
    assert {"resistance", "inductance_d"} <= {*said["known"]}
    assert {"flux", *MOTION} <= {*said["tests"]["q-axis"]}


def test_a_rotor_that_coasts_without_current_shows_its_flux_and_ratios_of_its_motion(tmp_path: Path) -> None:
    said = shown(look(tmp_path, coasting()))
    assert (said["turns"], said["currents"]) == (True, [])
    assert said["known"] == ["flux"]
    assert {*said["ratios"]} == MOTION
    assert {*said["unknown"]} == WINDING | MOTION
    assert {"resistance", "inductance_d"} <= {*said["tests"]["d-axis"]}
    assert {"inductance_q", *MOTION} <= {*said["tests"]["q-axis"]}


def test_a_rotor_that_turns_shows_everything(tmp_path: Path) -> None:
    said = shown(look(tmp_path, driven(DRIVE, 1, 0.4)))
    assert (said["turns"], said["currents"], said["unknown"]) == (True, ["d", "q"], [])


def test_columns_without_a_relation_determine_nothing(tmp_path: Path) -> None:
    log, rng = driven(DRIVE, 2, 0.2), np.random.default_rng(4)
    names = ("v_d", "v_q", "i_d", "i_q", "speed")
    noise = log._replace(**{name: rng.standard_normal(len(log.speed)) for name in names})
    mixed = log._replace(
        i_d=rng.permutation(log.i_d), i_q=np.roll(log.i_q, len(log.i_q) // 2), speed=np.roll(log.speed, 700)
    )
    for other in (noise, mixed):
        findings = look(tmp_path, other).findings
        assert not [name for each in findings for name in each.data.get("known", ())]


def test_rows_without_a_current_are_skipped(tmp_path: Path) -> None:
    log, rng = driven(DRIVE, 4, 0.2), np.random.default_rng(6)
    found = look(tmp_path, log._replace(i_q=np.where(rng.random(len(log.i_q)) < 0.01, np.nan, log.i_q)))
    assert found.reading["skip_bad_rows"] is True
    assert {"resistance", "inductance_q", "flux"} <= {*shown(found)["known"]}


def test_currents_that_do_not_respond_to_their_voltages_determine_no_inductance(tmp_path: Path) -> None:
    log = driven(DRIVE, 3, 0.2)
    said = shown(look(tmp_path, log._replace(i_d=log.i_q, i_q=log.i_d)))
    assert not {"resistance", "inductance_d", "inductance_q"} & {*said["known"]}


def test_noise_of_a_rotor_at_rest_is_no_motion(tmp_path: Path) -> None:
    log = logged(DRIVE, np.zeros(4000), np.zeros(4000), np.full(4000, np.nan), 9102, locked=True, added=0.0)
    said = shown(look(tmp_path, log))
    assert (said["turns"], said["currents"], said["known"]) == (False, [], [])


def test_voltages_that_change_with_every_sample_are_no_noise_of_the_currents(tmp_path: Path) -> None:
    small = DRIVE._replace(
        resistance=1.8, inductance_d=1.5e-4, inductance_q=1.5e-4, flux=1.6e-3, proportional=0.15, integral=1800.0
    )
    wanted = 0.25 * steps(4000)
    log = logged(small, wanted[:, 0], wanted[:, 1], np.full(4000, np.nan), 3, locked=True, added=1.8)
    said = shown(look(tmp_path, log))
    assert (said["currents"], {*said["known"]}) == (["d", "q"], WINDING)


def test_what_a_controller_makes_of_the_noise_of_its_readings_is_no_excitation() -> None:
    n = 4000
    log = logged(DRIVE, np.zeros(n), np.zeros(n), np.full(n, np.nan), 3, locked=True, added=0.0)
    with pytest.raises(emsid.DataError, match="noise that has nothing to do with the input"):
        determined_by(emsid.plants.brushless(), log.record("i_d i_q", inputs="v_d v_q"), {"pole_pairs": 7})


def test_phases_of_a_log_are_named_and_their_axes_looked_at(tmp_path: Path, run) -> None:
    log = driven(DRIVE, 2, 0.2)
    at = DRIVE.pairs * log.angle[:, None] - 2 * np.pi / 3 * np.arange(3)
    voltages = log.v_d[:, None] * np.cos(at) - log.v_q[:, None] * np.sin(at)
    currents = log.i_d[:, None] * np.cos(at) - log.i_q[:, None] * np.sin(at)
    phases = {f"u{each} [V]": column for each, column in zip("abc", voltages.T, strict=True)}
    phases |= {f"i{each} [A]": column for each, column in zip("abc", currents.T, strict=True)}
    rest = {"theta_e [rad]": np.mod(DRIVE.pairs * log.angle, 2 * np.pi), "n [rad/s]": log.speed}
    path = written(tmp_path / "lab.csv", {"t [s]": log.period * np.arange(len(log.v_q)), **phases, **rest})
    (found,) = (each for each in emsid.describe(path).findings if each.code == "phases-of-motor")
    assert found.data == {"phases": ["v=ua,ub,uc", "i=ia,ib,ic"], "angle": "theta_e", "electrical": True}
    given = {"phases": {"v": "ua,ub,uc", "i": "ia,ib,ic"}, "rotor_angle": "theta_e", "electrical_angle": True}
    looked = emsid.describe(path, **given, pole_pairs=7)
    assert looked.fit == {"models": "brushless", "fixed": {"pole_pairs": "7"}}
    assert looked.record.input_names == ("v_d", "v_q", "rotor")
    assert looked.record.input[:, :2] == pytest.approx(np.column_stack([log.v_d, log.v_q]), abs=1e-6)
    assert looked.record.output_names == ("i_d", "i_q", "n [rad/s]")
    roles = {column.name: role(column, looked).split()[0] for column in looked.columns if role(column, looked)}
    sides = dict.fromkeys(("v_d", "v_q", "rotor"), "input") | dict.fromkeys(("i_d", "i_q", "n [rad/s]"), "output")
    assert roles == {"t [s]": "time", **sides}
    two_motors = {**phases, "ic [A]": np.roll(currents[:, 2], 300)}  # three currents that do not add up to nothing
    other = emsid.describe(
        written(tmp_path / "other.csv", {"t [s]": 1e-4 * np.arange(len(log.v_q)), **two_motors, **rest})
    )
    assert "phases-of-motor" not in {each.code for each in other.findings}
    status, out, _ = run("describe", path)
    assert status == 0
    assert "--phases v=ua,ub,uc and i=ia,ib,ic, --rotor-angle theta_e with --electrical-angle and --pole-pairs" in out


@pytest.fixture(scope="module")
def fit() -> emsid.Fit:
    """A motor fitted to a log with the rotor held."""
    return emsid.fit(emsid.plants.brushless(), held(1500).record("i_d i_q", inputs="v_d v_q"), fixed={"pole_pairs": 7})


def test_after_a_fit_the_test_is_named_that_shows_what_it_kept(fit: emsid.Fit) -> None:
    tests = [each.data["tests"] for each in fit.findings if "tests" in each.data]
    named = {code for some in tests for code in some}
    assert named == {"q-axis"}
    assert {"flux", "inertia"} <= {name for some in tests for names in some.values() for name in names}
    assert not any(each.data.get("current_missing") for each in fit.findings)


SHEET = {"flux": {"value": 5.6e-3, "tolerance": "20 %"}, "inertia": {"value": 7e-5, "tolerance": "30 %"}}
LIMITS = {"limit": 4.0, "limit_current": 25.0, "limit_speed": 100.0}


def test_a_designed_test_stays_within_its_limits_and_gives_what_was_open(fit: emsid.Fit) -> None:
    found = emsid.design(fit, duration=0.25, dt=1e-4, datasheet=SHEET, **LIMITS)
    assert {"flux", "inertia"} <= {*found.wanted}
    assert {"design-determines", "design-assumes"} <= {each.code for each in found.findings}
    assert found.record.input_names == ("v_d", "v_q")
    assert found.record.input_units == ("V", "V")
    voltages, n = found.record.input, len(found.record)
    assert np.abs(voltages).max() <= 4.0
    for drive in (DRIVE, Drive()):  # the mean of an inverter, and one that switches
        free = drive._replace(proportional=0.0, integral=0.0)
        log = logged(free, np.zeros(n), np.zeros(n), np.full(n, np.nan), 7, added=voltages)
        assert 40.0 < np.abs(log.speed).max() <= 100.0
        assert np.hypot(log.i_d, log.i_q).max() <= 25.0
    again = emsid.fit(fit.model.plant, log.record(inputs="v_d v_q"), fixed={"pole_pairs": 7})
    for name in ("flux", "inertia"):
        assert found.present[name] == np.inf
        assert found.best.half_widths[name] < 0.1 * found.values[name]
        assert abs(again[name].value - getattr(DRIVE, name)) < found.best.half_widths[name]


def test_a_plant_by_its_name_needs_a_datasheet(run) -> None:
    status, _, err = run("design", "brushless", "--limit", "4V", "--duration", "0.25")
    assert status == 2
    assert err == "emsid: brushless has no estimates; give a file of a fit, or a datasheet (--datasheet)\n"


def test_a_design_from_a_datasheet_needs_the_pole_pairs(run, tmp_path: Path) -> None:
    sheet = tmp_path / "motor.toml"
    values = "resistance = 0.12\ninductance_d = 1e-4\ninductance_q = 1.3e-4\nflux = 0.005\ninertia = 1e-5\n"
    sheet.write_text(f"[brushless]\n{values}dead_time_voltage = 0.1\n")
    status, _, err = run("design", "brushless", "--datasheet", sheet, "--limit", "4V", "--duration", "0.25")
    assert status == 2
    assert err == "emsid: pole_pairs of brushless is not in the datasheet (--datasheet)\n"


def test_open_parameters_without_values_are_refused(fit: emsid.Fit) -> None:
    with pytest.raises(emsid.ModelError, match="flux and inertia of brushless are not known"):
        emsid.design(fit, duration=0.25, dt=1e-4, **LIMITS)


def columns(firmware: str, log: Log) -> dict[str, np.ndarray]:
    """A log as a firmware names and scales it."""
    n = len(log.speed)
    time, bus, turns = log.period * np.arange(n), 24 + 0.1 * np.sin(np.arange(n)), log.speed / ROTOR
    axis = "axis0.motor.current_control"
    return {
        "odrive 0.5": {
            "timestamp": time,
            "vbus_voltage": bus,
            f"{axis}.Iq_setpoint": np.round(log.i_q),
            f"{axis}.Id_measured": log.i_d,
            f"{axis}.Iq_measured": log.i_q,
            f"{axis}.v_current_control_integral_d": log.v_d,
            f"{axis}.v_current_control_integral_q": log.v_q,
            f"{axis}.phase_vel": 7 * log.speed,
            "axis0.encoder.vel_estimate": turns,
            "axis0.encoder.pos_estimate": log.angle / ROTOR,
        },
        "odrive 0.6": {
            "time": time,
            "axis0.motor.foc.Id_measured": log.i_d,
            "axis0.motor.foc.Iq_measured": log.i_q,
            "axis0.motor.foc.Vd_setpoint": log.v_d,
            "axis0.motor.foc.Vq_setpoint": log.v_q,
            "axis0.vel_estimate": turns,
            "ibus": 0.1 * np.abs(log.i_q),
        },
        "moteus": {
            "time": time,
            "MODE": np.full(n, 10.0),
            "POSITION": log.angle / ROTOR,
            "VELOCITY": turns,
            "Q_CURRENT": log.i_q,
            "D_CURRENT": log.i_d,
            "VOLTAGEDQ_D": log.v_d,
            "VOLTAGEDQ_Q": log.v_q,
            "TEMPERATURE": 30 + 0.01 * np.arange(n),
        },
        "moteus diagnostic": {
            "time": time,
            "servo_stats.velocity": turns,
            "servo_stats.d_A": log.i_d,
            "servo_stats.q_A": log.i_q,
            "servo_control.d_V": log.v_d,
            "servo_control.q_V": log.v_q,
        },
        "vesc": {
            "ms_today": np.rint(45_000_000 + 1e3 * time),
            "input_voltage": bus,
            "temp_mos_max": 30 + 0.01 * np.arange(n),
            "current_motor": np.hypot(log.i_d, log.i_q),
            "current_in": 0.1 * np.abs(log.i_q),
            "d_axis_current": log.i_d,
            "q_axis_current": log.i_q,
            "erpm": 7 * 60 * turns,
            "duty_cycle": log.v_q * np.sqrt(3) / 24,
            "fault_code": np.zeros(n),
            "vesc_id": np.full(n, 33.0),
            "d_axis_voltage": log.v_d,
            "q_axis_voltage": log.v_q,
        },
        "simplefoc": {
            "time": time,
            "target": np.round(log.speed, -1),
            "voltage.q": log.v_q,
            "voltage.d": log.v_d,
            "current.q [mA]": 1e3 * log.i_q,
            "current.d [mA]": 1e3 * log.i_d,
            "shaft_velocity": log.speed,
            "shaft_angle": log.angle,
        },
        "recoil": {
            "time": time,
            "v_q_setpoint": log.v_q,
            "v_d_setpoint": log.v_d,
            "i_q_target": np.round(log.i_q),
            "i_q_measured": log.i_q,
            "i_d_measured": log.i_d,
            "velocity_measured": log.speed,
        },
    }[firmware]


FIRMWARE = ("odrive 0.5", "odrive 0.6", "moteus", "moteus diagnostic", "vesc", "simplefoc", "recoil")


@pytest.fixture(scope="module")
def spinning() -> Log:
    return driven(DRIVE, 1, 0.2)


@pytest.mark.parametrize("firmware", FIRMWARE)
def test_the_log_of_a_firmware_becomes_voltages_currents_and_speed_in_si_units(
    firmware: str, spinning: Log, tmp_path: Path
) -> None:
    if firmware == "vesc":  # its times are whole milliseconds
        every = {name: getattr(spinning, name)[::10] for name in spinning._fields if name not in ("period", "before")}
        spinning = spinning._replace(period=1e-3, **every)
    path = written(tmp_path / "log.csv", columns(firmware, spinning), ";" if firmware == "vesc" else ",")
    found = describe(path)
    record = found.record
    assert record is not None
    assert record.dt == pytest.approx(spinning.period)
    assert record.input == pytest.approx(np.column_stack([spinning.v_d, spinning.v_q]), rel=1e-6, abs=1e-6)
    pairs = 7 if firmware == "vesc" else 1  # without the pole pairs it is electrical
    speed = pairs * spinning.speed
    assert record.output == pytest.approx(np.column_stack([spinning.i_d, spinning.i_q, speed]), rel=1e-6, abs=1e-4)
    assert record.output_units == ("A", "A", "rad/s")
    assert found.fit["models"] == "brushless"
    codes = {each.code: each.data for each in found.findings}
    assert "brushless-columns" in codes
    assert ("speed-electrical" in codes) == (firmware == "vesc")
    assert ("pole-pairs-open" in codes) == (firmware != "vesc")
    if firmware == "vesc":
        known = describe(path, pole_pairs=7)
        assert known.record is not None
        assert known.record.output[:, 2] == pytest.approx(spinning.speed, rel=1e-6, abs=1e-4)
        assert known.fit["fixed"] == {"pole_pairs": "7"}


@pytest.mark.parametrize(("unit", "factor"), [("mrad/s", 1e3), ("krpm", 60e-3 / (2 * np.pi)), ("turn/s", 0.5 / np.pi)])
def test_a_speed_in_a_scaled_unit_is_converted(unit: str, factor: float, spinning: Log, tmp_path: Path) -> None:
    table = columns("simplefoc", spinning)
    table[f"shaft_velocity [{unit}]"] = factor * table.pop("shaft_velocity")
    found = describe(written(tmp_path / "log.csv", table))
    assert found.record is not None
    assert found.record.output_units[2] == "rad/s"
    assert found.record.output[:, 2] == pytest.approx(spinning.speed, rel=1e-6, abs=1e-4)


def test_a_unit_that_is_not_known_is_said_and_no_other_one_taken(spinning: Log, tmp_path: Path) -> None:
    table = columns("simplefoc", spinning)
    name = "shaft_velocity [furlong/s]"
    table[name] = table.pop("shaft_velocity")
    found = describe(written(tmp_path / "log.csv", table))
    assert name not in found.reading["units"]
    assert [each.subject for each in found.findings if each.code == "unit-unknown"] == [name]


def test_the_command_that_is_proposed_finds_the_motor(spinning: Log, tmp_path: Path, run) -> None:
    path = written(tmp_path / "log.csv", columns("odrive 0.5", spinning))
    status, text, err = run("describe", path, "--json")
    assert status == 0, err
    (command,) = json.loads(text)["commands"]
    status, _, err = run(*shlex.split(command)[1:], "--fix", "pole_pairs=7", "--out", tmp_path / "result")
    assert status == 0, err
    said = json.loads((tmp_path / "result" / "result.json").read_text())["recommendation"]
    assert "next-test" not in [each["code"] for each in said]  # everything is known
    fit = emsid.load(tmp_path / "result" / "brushless.json")
    for name in ("resistance", "inductance_d", "inductance_q", "flux", "inertia"):
        assert fit[name].value == pytest.approx(getattr(DRIVE, name), rel=0.05)


def test_with_one_pole_pair_electrical_speed_gives_the_inertia_over_the_square_of_the_pole_pairs(spinning: Log) -> None:
    record = spinning.record(inputs="v_d v_q")
    electrical = replace(record, output=record.output * [1, 1, 7])
    fit = emsid.fit(emsid.plants.brushless(), electrical, fixed={"pole_pairs": 1})
    assert fit["flux"].value == pytest.approx(DRIVE.flux, rel=0.02)
    assert fit["inertia"].value == pytest.approx(DRIVE.inertia / 49, rel=0.05)
