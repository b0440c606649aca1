"""The example sketch of a board, compiled for this computer and run: it speaks the line protocol."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from emsid.live.protocol import LineParser
from emsid.live.timeline import Timeline

HERE = Path(__file__).parent
SKETCH = HERE.parent / "examples" / "board" / "board.ino"
COMPILER = shutil.which("g++") or shutil.which("clang++")

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no compiler for C++")

Run = Callable[..., bytes]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Runs the sketch from a time of its clock in us, with commands at times in us after that."""
    program = tmp_path_factory.mktemp("board") / "board"
    words = [str(COMPILER), "-std=c++17", "-Wall", "-Wextra", "-Werror", f"-I{HERE / 'arduino'}"]
    done = subprocess.run(
        [*words, f'-DSKETCH="{SKETCH}"', str(HERE / "arduino" / "run.cpp"), "-o", str(program)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr

    def call(start: int, *commands: tuple[int, str]) -> bytes:
        words = [str(word) for time, command in commands for word in (time, command)]
        return subprocess.run([program, str(start), *words], capture_output=True, check=True).stdout

    return call


def test_it_samples_takes_commands_and_stops_by_itself(run: Run) -> None:
    data = run(1000, (200_000, "u 3"), (400_000, "u -6"), (500_000, "?"), (500_100, "bad"), (1_500_000, ""))
    parser = LineParser()
    rows = parser.feed(data)
    assert rows is not None
    assert parser.columns is not None
    assert (parser.malformed, data.count(b"n,t[us],voltage[V],speed[rad/s]\r\n")) == (0, 2)
    assert parser.columns.channels == (("voltage",), "speed", ("V",), "rad/s")
    np.testing.assert_array_equal(rows.number, range(len(rows)))
    np.testing.assert_allclose(np.diff(rows.time), 0.002, atol=1e-12)
    time, volts = rows.time - rows.time[0], rows.input[:, 0]
    np.testing.assert_array_equal(volts[(time > 0.205) & (time < 0.395)], 3.0)
    np.testing.assert_array_equal(volts[(time > 0.405) & (time < 0.995)], -6.0)
    np.testing.assert_array_equal(volts[time > 1.01], 0.0)  # half a second after the last command
    speed = 255 / 12 * 100 * 2 * np.pi / 1024  # of the motor, per volt
    assert rows.output[(time > 0.21) & (time < 0.39)].mean() == pytest.approx(3 * speed, rel=0.01)
    assert rows.output[(time > 0.41) & (time < 0.99)].mean() == pytest.approx(-6 * speed, rel=0.01)


def test_it_goes_on_where_its_clock_begins_again(run: Run) -> None:
    rows = LineParser().feed(run(2**32 - 300_000, (250_000, "u 3"), (600_000, "")))
    assert rows is not None
    assert rows.time.min() < 1.0
    timeline = Timeline()
    (stretch,) = timeline.place(rows)
    assert (len(stretch), timeline.lost, timeline.dt) == (len(rows), 0, pytest.approx(0.002))
    assert len(rows) >= 290
