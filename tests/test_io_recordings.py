"""Real recordings, read as their authors published them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emsid.errors import DataError
from emsid.io import read

pytestmark = pytest.mark.recordings

BRIDGE: dict[str, Any] = {
    "input": "PWM",
    "output": "mVel",
    "mask": "abs(PWM) > 255",
    "units": {"PWM": "pwm", "mVel": "count/sample"},
    "counts_per_revolution": 621,
    "supply_voltage": 12.0,
}


@pytest.mark.parametrize(
    ("name", "dt", "samples", "segments"),
    [
        ("testBench_testAll_10ms", 0.010048, 6240, 5),
        ("testBench_test_0BulFree_10ms", 0.010048, 247, 1),
        ("testBench_test_8Bul_10ms", 0.010048, 247, 1),
        ("OldMot_19_12_29_speedDatasStepping_testStepping_dt10", 0.01, 6080, 3),
        ("OldMot_19_12_29_speedDatasStepping_testStepping_dt2", 0.002, 34881, 2),
    ],
)
def test_a_bridge_that_brakes(recordings: Path, name: str, dt: float, samples: int, segments: int) -> None:
    record = read(recordings / "dc_motor_bidirectional" / f"{name}.dat", dt=dt, **BRIDGE)
    assert (len(record), len(record.segments)) == (samples, segments)
    assert np.abs(record.input).max() <= 12
    assert (record.input_units, record.output_units) == (("V",), ("rad/s",))


def test_the_preamble_hints_at_the_sample_time(recordings: Path) -> None:
    folder = recordings / "dc_motor_bidirectional"
    with pytest.raises(DataError, match=r"the file says 'dt OCR2A Prescaler / 10 156 1024' above its header"):
        read(folder / "testBench_testAll_10ms.dat", input="PWM", output="mVel")
    with pytest.raises(DataError, match=r"the file says '\(dt=2\)' above its header"):
        read(folder / "OldMot_19_12_29_speedDatasStepping_testStepping_dt2.dat", input="PWM", output="mVel")


def test_a_position_is_differentiated(recordings: Path) -> None:
    path = recordings / "emps" / "DATA_EMPS.mat"
    record = read(
        path, input="vir", output=["d(qm)", "qm"], time="t", scale={"vir": 35.15065}, units={"qm": "m", "vir": "N"}
    )
    assert (len(record), record.dt, record.output_units) == (24841, 0.001, ("m/s", "m"))
    speed, position = record.channel("d(qm)"), record.channel("qm")
    travelled = np.cumsum(speed) * record.dt
    np.testing.assert_allclose(travelled - travelled[0], position - position[0], atol=1e-4)
    with pytest.raises(DataError, match="'gtau' is no column: it is a single number"):
        read(path, input="gtau", output="qm", time="t")


def test_every_other_file(recordings: Path) -> None:
    u_y: dict[str, Any] = {"input": "u", "output": "y"}
    files: list[tuple[str, dict[str, Any], int, float]] = [
        (
            "wiener_hammerstein_2009/estimation.csv",
            {**u_y, "dt": 1 / 51200, "rows": slice(5200, 105200)},
            100000,
            1 / 51200,
        ),
        ("coupled_drives/prbs.csv", {"input": "u1", "output": "z1", "dt": 0.02}, 500, 0.02),
        (
            "coupled_drives/uniform_first400.csv",
            {"input": ["u11", "u12"], "output": ["z11", "z12"], "dt": 0.02},
            400,
            0.02,
        ),
        ("dc_motor_prbs/prbs_1.csv", {**u_y, "time": "t"}, 4093, 0.02),
        ("dc_motor_prbs/prbs_2.csv", {**u_y, "time": "t"}, 4093, 0.02),
        ("dc_motor_prbs/prbs_3.csv", {**u_y, "time": "t"}, 4093, 0.02),
        ("dc_motor_prbs/closed_loop_profile.csv", {**u_y, "time": "t"}, 201, 0.02),
        ("dc_motor_prbs/static_gain.csv", {**u_y, "dt": 1.0}, 14, 1.0),
    ]
    for name, options, samples, dt in files:
        record = read(recordings / name, **options)
        assert (name, len(record), record.dt) == (name, samples, dt)
    steps = sorted((recordings / "dc_motor_jga25_steps").glob("*.csv"))
    assert len(steps) == 26
    for path in steps:
        record = read(path, input="Commanded_PWM", output="Motor_Speed(RPM)", time="Timestamp(ms)")
        assert record.dt == 0.001
        assert len(record) > 1900
