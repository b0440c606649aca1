"""Which column is what: content overrules names, and columns beside input and output are named."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy import signal

import emsid
from emsid.first_look import describe
from emsid.first_look.names import ColumnQuantity, meaning_of
from emsid.first_look.roles import find_roles
from first_look_records import codes, data

N = 600
RNG = np.random.default_rng(4)
T = 0.01 * np.arange(N)
U = np.repeat(RNG.uniform(-1, 1, N // 12), 12)


def motor(u: np.ndarray, gain: float = 100.0) -> np.ndarray:
    """A speed that follows its input."""
    return gain * signal.lfilter([0.0, 0.1], [1.0, -0.9], u) + 0.01 * gain * RNG.standard_normal(len(u))


def look(folder: Path, columns: Mapping[str, object]) -> emsid.FirstLook:
    path = folder / "log.csv"
    pl.DataFrame(dict(columns)).write_csv(path)
    return describe(path)


def pair(found: emsid.FirstLook) -> tuple[object, object]:
    return found.reading["input"], found.reading["output"]


def test_a_constant_voltage_is_no_input_and_a_pulse_is_a_command(tmp_path: Path) -> None:
    columns = {"Time (s)": T, "Servo 3 (µs)": np.rint(1500 + 400 * U), "Voltage (V)": 0 * T, "Speed (RPM)": motor(U)}
    found = look(tmp_path, columns)
    assert pair(found) == ("Servo 3 (µs)", "Speed (RPM)")
    assert found.reading["time"] == "Time (s)"
    against = [each for each in found.roles.table if each.column == "Voltage (V)" and each.weight < 0]
    assert {str(each) for each in against} == {
        f"Voltage (V) as {role}: -1.5, it is constant" for role in ("input", "output")
    }


def test_a_number_of_the_run_is_no_input_and_a_reference_is_one(tmp_path: Path) -> None:
    runs = np.repeat(np.arange(N // 60), 60)
    angle = signal.lfilter([0.0, 0.1], [1.0, -0.9], U)
    found = look(tmp_path, {"run": runs, "t": np.tile(T[:60], N // 60), "target": U, "position": angle})
    assert pair(found) == ("target", "position")


def test_a_copy_of_the_times_and_a_count_of_rows_are_no_output(tmp_path: Path) -> None:
    found = look(tmp_path, {"t": T, "a": U, "again": 1000 * T + 5, "n": np.arange(N), "b": motor(U)})
    assert pair(found) == ("a", "b")
    table = {each.column: each.reason for each in found.roles.table if each.weight < 0}
    assert table == {"t": "it repeats the times", "again": "it repeats the times", "n": "it counts the rows"} | {
        name: table[name] for name in table if name not in ("t", "again", "n")
    }


def test_of_many_joints_the_one_that_moves_is_proposed(tmp_path: Path) -> None:
    columns: dict[str, object] = {"time": T}
    for k in range(1, 8):
        moves = k == 5
        columns |= {
            f"q_{k}": np.cumsum(motor(U)) if moves else 0.001 * RNG.integers(0, 2, N),
            f"qd_{k}": motor(U) if moves else 0.02 * RNG.integers(-1, 2, N),
            f"tau_{k}": U if moves else 0.02 * RNG.integers(-1, 2, N),
        }
    found = look(tmp_path, columns)
    assert pair(found) == ("tau_5", "qd_5")
    assert ["tau_1", "qd_1"] in data(found, "several-experiments")["pairs"]  # type: ignore[operator]


def test_a_vesc_log(tmp_path: Path) -> None:
    speed = motor(U, 5000.0)
    count = np.rint(np.cumsum(speed) / 1000)
    columns = {
        "ms_today": 45_000_000 + 10 * np.arange(N),
        "input_voltage": 24 - 0.5 * np.abs(U),
        "current_motor": 20 * U - speed / 500,
        "erpm": np.rint(speed),
        "duty_cycle": U,
        "amp_hours_used": np.cumsum(np.abs(U)) / 1e5,
        "tachometer": count,
        "tachometer_abs": np.cumsum(np.abs(np.diff(count, prepend=0))),
    }
    found = look(tmp_path, columns)
    assert (*pair(found), found.reading["time"]) == ("duty_cycle", "erpm", "ms_today")
    assert found.clock.dt == pytest.approx(0.01)
    assert "time_unit" not in found.reading
    finer = look(tmp_path, {**columns, "ms_today": 0.1 * np.arange(N)})
    assert finer.clock.dt == pytest.approx(1e-4)
    assert found["tachometer"].meaning.quantity == "position"
    assert data(found, "further-channels")["outputs"] == ["current_motor"]


@pytest.mark.parametrize(("values", "quantity"), [(np.rint(10 * U), "position"), (U, "speed")])
def test_a_name_of_the_vocabulary_is_checked_against_the_numbers(
    tmp_path: Path, values: np.ndarray, quantity: str
) -> None:
    assert look(tmp_path, {"t": T, "u": U, "tachometer": values})["tachometer"].meaning.quantity == quantity


@pytest.mark.parametrize(
    "name", ["erpm", "vel_estimate", "shaft_velocity", "present_velocity", "velocity_actual_value", "tachometer"]
)
def test_the_speeds_of_devices_have_one_meaning(name: str) -> None:
    assert meaning_of(name, "", T + 0.5 * U).quantity is ColumnQuantity.SPEED


def test_robot_data_sets_pair_the_action_with_its_state(tmp_path: Path) -> None:
    states = np.column_stack([motor(U), motor(-U)])
    frame = {"action": np.column_stack([U, -U]).tolist(), "observation.state": states.tolist(), "timestamp": T}
    path = tmp_path / "episode.parquet"
    pl.DataFrame(frame | {"frame_index": np.arange(N), "episode_index": np.zeros(N, int)}).write_parquet(path)
    assert pair(describe(path)) == ("action_1", "observation.state_1")


def test_a_lost_sign_is_named_with_the_column_that_may_be_it(tmp_path: Path) -> None:
    columns = {"t": T, "MotorPWM": np.rint(100 * np.abs(U)), "Encoder": np.rint(np.cumsum(motor(U)))}
    assert data(look(tmp_path, columns), "sign-lost") == {"output": "Encoder", "candidates": []}
    relay = (np.arange(N) // 150) % 2
    assert data(look(tmp_path, columns | {"relay": relay}), "sign-lost")["candidates"] == ["relay"]
    signed = look(tmp_path, columns | {"dir": (U > 0).astype(int)})
    assert signed.reading["direction"] == {"MotorPWM": "dir"}
    assert "sign-lost" not in codes(signed)
    one_way = {"t": T, "MotorPWM": np.rint(100 * np.abs(U)), "speed": motor(np.abs(U))}
    assert "sign-lost" not in codes(look(tmp_path, one_way))


def test_a_count_beside_the_speed_that_was_derived_from_it_is_the_better_sensor(tmp_path: Path) -> None:
    count = np.rint(np.cumsum(motor(U)))
    rpm = 60 * np.diff(count, prepend=0) / 2000 / 0.01
    found = look(tmp_path, {"t": T, "voltage": U, "count": count, "speed [rpm]": rpm, "torque": motor(U)})
    assert data(found, "further-channels")["positions"] == ["count"]


def test_a_load_is_offered_as_a_second_input(tmp_path: Path) -> None:
    load = np.repeat(RNG.uniform(-1, 1, N // 20), 20)
    found = look(tmp_path, {"t": T, "voltage": U, "load_torque": load, "speed": motor(U - 0.5 * load)})
    assert data(found, "further-channels")["inputs"] == ["load_torque"]
    assert pair(found) == ("voltage", "speed")


def test_a_step_from_the_first_sample_gives_gain_and_time_constant(tmp_path: Path) -> None:
    """Noise-free of first order: exact."""
    t = 0.02 * np.arange(1, 120)
    found = look(tmp_path, {"time_ms": 1000 * t, "pwm": 255 + 0 * t, "rpm": 255 * 2.75 * (1 - np.exp(-t / 0.225))})
    numbers = data(found, "step-from-first-sample")
    assert (numbers["gain"], numbers["unit"]) == (pytest.approx(2.75 * np.pi / 30), "rad/s")
    assert numbers["time_constant"] == pytest.approx(0.225)
    assert "channel-constant" not in codes(found)
    still = look(tmp_path, {"time_ms": 1000 * t, "pwm": 255 + 0 * t, "rpm": RNG.standard_normal(len(t))})
    assert "channel-constant" in codes(still)


def test_a_unit_of_a_column_that_is_no_channel_is_a_note(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    pl.DataFrame({"t": T, "u": U, "current": U, "y": motor(U)}).write_csv(path)
    record = emsid.read(path, input="u", output="y", time="t", units={"u": "V", "current": "A"})
    (note,) = (finding for finding in record.findings if finding.code == "unit-not-used")
    assert (note.subject, note.data["unit"], record.input_units) == ("current", "A", ("V",))
    with pytest.raises(emsid.DataError, match="did you mean 'u'"):
        emsid.read(path, input="u", output="y", time="t", units={"U": "V"})


def test_the_evidence_of_every_column_is_in_the_table(tmp_path: Path) -> None:
    found = look(tmp_path, {"t": T, "u": U, "y": motor(U)})
    roles = find_roles(found.columns, "t")
    assert roles == found.roles
    assert {each.column for each in roles.table} >= {"u", "y"}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_controller_without_names_sets_the_input(tmp_path: Path, seed: int) -> None:
    """The position follows its reference closely, and what sets the voltage is the error."""
    rng = np.random.default_rng(seed)
    reference, u, y, speed = np.repeat(rng.uniform(-10, 10, N // 60), 60), np.zeros(N), np.zeros(N), 0.0
    for k in range(len(reference) - 1):
        u[k] = np.clip(1.5 * (reference[k] - y[k]) - 0.02 * speed, -12, 12) + 0.05 * rng.standard_normal()
        speed = 0.9 * speed + u[k]
        y[k + 1] = y[k] + 0.01 * speed
    n = len(reference)
    found = look(tmp_path, {"c1": y[:n] + 0.001 * rng.standard_normal(n), "c2": reference, "c3": u[:n], "c4": T[:n]})
    assert (found.roles.input, found.roles.output) == ("c3", "c1")
