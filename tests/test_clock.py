"""The clock of a first look: which column is the time, in which unit, and in which rows."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import emsid
from emsid.errors import DataError
from emsid.first_look import describe
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.io.sampling import running_rows
from first_look_records import Write, codes

Array = NDArray[np.float64]


def driven(rng: np.random.Generator, t: Array, tau: float = 0.05, gain: float = 3.0) -> tuple[Array, Array]:
    """(N,) a duty of random steps, and the speed of first order that answers it, at times (N,) in seconds."""
    u = np.repeat(rng.uniform(-50, 50, len(t) // 20 + 1), 20)[: len(t)]
    y = np.zeros(len(t))
    for k in range(1, len(t)):
        kept = np.exp(-(t[k] - t[k - 1]) / tau)
        y[k] = kept * y[k - 1] + (1 - kept) * gain * u[k - 1]
    return u, y + rng.normal(0, 0.5, len(t))


def gain_of(path: str, **reading: object) -> float:
    """The gain at rest of a linear model of what the proposed arguments read."""
    record = emsid.read(path, **reading)  # type: ignore[arg-type]
    past, now = [], []
    for piece in record.segments:
        past.append(np.column_stack([piece.output[:-1, 0], piece.input[:-1, 0], np.ones(len(piece) - 1)]))
        now.append(piece.output[1:, 0])
    (a, b, _), *_ = np.linalg.lstsq(np.concatenate(past), np.concatenate(now), rcond=None)
    return float(b / (1 - a))


def scattered(rng: np.random.Generator, n: int) -> Array:
    """(n,) times in seconds with steps of 5 to 8 ms, and a few of up to 43 ms."""
    return np.cumsum(np.where(rng.random(n) < 0.9, rng.uniform(0.005, 0.008, n), rng.uniform(0.01, 0.043, n)))


@pytest.mark.parametrize("seed", range(4))
def test_scattered_steps_are_a_clock_without_a_name(write: Write, seed: int) -> None:
    """Also at another place than the first, and after it begins again in every run."""
    rng = np.random.default_rng(seed)
    runs = [scattered(rng, 120) for _ in range(1 + seed % 3)]
    parts = [driven(rng, t) for t in runs]
    u, y = (np.concatenate([part[side] for part in parts]) for side in (0, 1))
    path = write({"c1": u, "c2": np.concatenate(runs), "c3": y})
    look = describe(path)
    assert look.clock.column == "c2"
    assert look.reading["resample"] is True
    assert ("clock-reset" in codes(look)) is (len(runs) > 1)
    assert look.record is not None
    assert len(look.record.breaks) >= len(runs) - 1
    assert look.record.dt == pytest.approx(np.mean(np.diff(runs[0])), rel=0.1)
    assert gain_of(str(path), **look.reading) == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_a_position_is_no_clock(write: Write, seed: int) -> None:
    """One that increases throughout follows its speed or itself, and one of a counter repeats."""
    rng = np.random.default_rng(seed)
    n = 300
    torque, speed = driven(rng, 0.01 * np.arange(n), 0.1, 0.01)
    speed = 0.6 + 0.5 * np.tanh(speed) + rng.normal(0, 0.01, n)
    angle = 0.9 + np.cumsum(np.abs(speed)) * 0.01
    assert np.all(np.diff(angle) > 0)
    for place in (angle, np.round(angle * 60)):
        for columns in ({"c1": place, "c2": speed, "c3": torque}, {"c1": torque, "c2": place}):
            assert describe(write(columns)).clock.source == "nothing", columns.keys()


@pytest.mark.parametrize("seed", range(3))
def test_rows_before_and_after_the_clock_are_left_out(write: Write, seed: int) -> None:
    """Zeros are rows that were never written."""
    rng = np.random.default_rng(seed)
    stale, after = seed, int(rng.integers(2, 9)) * (seed != 1)
    t = 0.01 * np.arange(1, 301)
    u, y = driven(rng, t)
    t[:stale] += rng.uniform(3.2, 9)
    padded = {name: np.append(x, np.zeros(after)) for name, x in {"t": t, "u": u, "y": y}.items()}
    path = write(padded)
    look = describe(path)
    expected = slice(stale or None, 300 if after else None)
    assert look.reading.get("rows") == (None if expected == slice(None) else expected)
    assert look.record is not None
    assert len(look.record) == 300 - stale
    assert not look.record.breaks
    if after:
        with pytest.raises(DataError, match=f"it increases in the rows {stale or ''}:300"):
            emsid.read(path, input="u", output="y", time="t")


def test_running_rows_count_missing_ones() -> None:
    """Rows are those of the file."""
    t = np.array([np.nan, 5.0, 0.1, np.nan, 0.2, 0.3, 0.4, 0.5, 0.0, np.nan, 0.0])
    assert running_rows(t) == slice(2, 8)


@pytest.mark.parametrize(("rate", "unit"), [("8kHz", "8kHz"), ("500 Hz", "500Hz"), ("20 kHz", "20kHz")])
def test_a_stated_rate_is_that_of_ticks(write: Write, rate: str, unit: str) -> None:
    """The mean step is the sample time, and the rate is not that of the rows."""
    rng = np.random.default_rng(1)
    hertz = float(unit.removesuffix("kHz").removesuffix("Hz")) * (1e3 if "k" in unit else 1.0)
    ticks = np.cumsum(np.round(rng.uniform(0.9, 1.1, 400) * max(0.006 * hertz, 12)))
    u, y = driven(rng, ticks / hertz)
    rows = "".join(f"{int(k)},{a:.4f},{b:.4f}\n" for k, a, b in zip(ticks, u, y, strict=True))
    path = write(f"Counter at {rate}\ncounter [#],voltage,speed\n{rows}")
    look = describe(path)
    assert (look.clock.column, look.reading["time_unit"]) == ("counter [#]", unit)
    assert look.record is not None
    assert look.record.dt == pytest.approx(np.mean(np.diff(ticks)) / hertz, rel=0.02)
    assert gain_of(str(path), **look.reading) == pytest.approx(3.0, rel=0.1)


def test_a_stated_rate_of_rows_is_not_that_of_ticks(write: Write) -> None:
    """Whole milliseconds agree with it in their unit."""
    rng = np.random.default_rng(2)
    t = 0.005 * np.arange(1, 400)
    u, y = driven(rng, t)
    rows = "".join(f"{1e3 * k:.0f},{a:.4f},{b:.4f}\n" for k, a, b in zip(t, u, y, strict=True))
    look = describe(write(f"Sample rate 200 Hz\nc1,voltage,speed\n{rows}"))
    assert (look.clock.column, look.clock.unit, look.clock.dt) == ("c1", "ms", pytest.approx(0.005))


def test_time_units_of_ticks(write: Write) -> None:
    """A rate is a unit of a time column; other texts are refused."""
    t = 44.0 * np.arange(100)
    path = write({"ticks": t, "u": np.sin(t), "y": np.cos(t)})
    assert emsid.read(path, input="u", output="y", time="ticks", time_unit="8 kHz").dt == pytest.approx(0.0055)
    with pytest.raises(DataError, match="time unit '8kB' is not understood"):
        emsid.read(path, input="u", output="y", time="ticks", time_unit="8kB")


@pytest.mark.parametrize("name", ["joint_t_v_mean", "load t max", "axis.t.raw"])
def test_a_letter_amid_a_name_is_no_time(name: str) -> None:
    """It is one where it begins or ends the name."""
    assert meaning(name).quantity is not ColumnQuantity.TIME
    assert meaning("t_log").quantity is meaning("log_t").quantity is ColumnQuantity.TIME
