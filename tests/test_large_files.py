"""Files larger than memory: block reading is whole reading, excerpts, and least squares on all rows."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.signal import lfilter

import emsid
from emsid.errors import DataError, FormatError
from emsid.io import large, read_columns, reading, regular_table
from emsid.io.large import columns_in
from emsid.io.reading import ParsedFile
from emsid.record import Record

N = 30_000
DT = 0.01
SUFFIXES = (".csv", ".parquet", ".feather")


def signals(count: int = N, seed: int = 1) -> dict[str, Any]:
    """A linear motor with noise in its equation, a text, missing temperatures, and one voltage that stands out."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-10, 10, count // 50 + 1), 50)[:count].round(3)
    u[12_345 % count] = 14.0
    y = lfilter([0, 0.4, 0.2], [1, -1.2, 0.35], u) + lfilter([1], [1, -1.2, 0.35], 0.05 * rng.standard_normal(count))
    temperature = np.where(np.arange(count) % 97 == 0, np.nan, 25 + np.arange(count) / count)
    state = np.where(np.arange(count) % 2000 < 1000, "run", "idle")
    t = (DT * np.arange(count)).round(6)
    return {"t": t, "voltage": u, "speed": y.round(6), "temperature": temperature.round(4), "state": state}


def write(path: Path, columns: dict[str, Any], units: bool = False) -> Path:
    frame = pl.DataFrame(columns).with_columns(pl.col(pl.Float64).fill_nan(None))
    if path.suffix == ".csv":
        text = frame.write_csv()
        path.write_text(text.replace("\n", "\ns,V,rad/s,K,\n", 1) if units else text)
    elif path.suffix == ".parquet":
        frame.write_parquet(path, row_group_size=4_000)
    else:
        frame.write_ipc(path)
    return path


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of more than 40,000 numbers are larger than memory, and blocks are small and end anywhere."""
    for module, name, value in (
        (large, "MOST", 40_000),
        (regular_table, "MOST", 40_000),
        (large, "BLOCK", 7_003),
        (reading, "BLOCK", 7_003),
        (reading, "LARGE", 0),
        (regular_table, "LARGE", 0),
        (regular_table, "SAMPLE", 4_000),
        (regular_table, "AT_ONCE", 50_021),
    ):
        monkeypatch.setattr(module, name, value)


def both(path: Path, **arguments: Any) -> tuple[Record, Record]:
    """The record of the excerpt and that of the whole file."""
    named = {"input": "voltage", "output": "speed", "time": "t", **arguments}
    return emsid.read(ParsedFile(path, read_columns(path, in_part=True)), **named), emsid.read(path, **named)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_any_rows_read_in_blocks_are_those_of_the_whole_file(tmp_path: Path, small: None, suffix: str) -> None:
    path = write(tmp_path / f"log{suffix}", signals(), units=suffix == ".csv")
    whole, part = read_columns(path), read_columns(path, in_part=True)
    assert part.excerpt is not None
    table = part.excerpt.table
    assert (table.rows, part.units) == (N, whole.units)
    for first, stop in ((0, N), (1, 2), (3_999, 12_001), (N - 5, N)):
        found = columns_in(table, [range(first, stop)])
        for name, series in whole.series.items():
            assert found.series[name].dtype == series.dtype
            assert found.series[name].equals(series[first:stop], null_equal=True)
    assert [part.place(k) for k in (0, 7_000)] == [whole.place(int(part.file_rows(np.array(k)))) for k in (0, 7_000)]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_facts_of_a_pass_are_those_of_all_rows(tmp_path: Path, small: None, suffix: str) -> None:
    columns = signals()
    columns["speed"][777] = np.inf
    path = write(tmp_path / f"log{suffix}", columns)
    facts = read_columns(path, in_part=True).excerpt.table.facts  # type: ignore[union-attr]
    assert facts.missing == {"t": 0, "voltage": 0, "speed": 1, "temperature": -(-N // 97), "state": 0}
    for name, ((low, at_low), (high, at_high)) in facts.ranges.items():
        x = np.where(np.isfinite(columns[name]), columns[name], np.nan)
        assert (low, high) == (np.nanmin(x), np.nanmax(x)) == (x[at_low], x[at_high])


def test_an_excerpt_keeps_the_ends_the_extremes_and_consecutive_rows(tmp_path: Path, small: None) -> None:
    columns = signals()
    held = read_columns(write(tmp_path / "log.parquet", columns), in_part=True)
    assert held.excerpt is not None
    stretches = held.excerpt.stretches
    assert stretches[0].start == 0
    assert stretches[-1].stop == N
    assert 16 <= len(stretches) <= 20
    rows = held.file_rows(np.arange(sum(map(len, stretches))))
    assert np.array_equal(held.series["voltage"].to_numpy(), columns["voltage"][rows])
    assert held.series["voltage"].max() == 14.0  # in none of the stretches at equal distances


def test_a_record_of_an_excerpt_has_a_segment_for_each_stretch(tmp_path: Path, small: None) -> None:
    part, whole = both(write(tmp_path / "log.csv", signals()))
    (found,) = [each for each in part.findings if each.code == "read-in-part"]
    assert found.data == {"rows": len(part), "of": N, "whole": []}
    at = np.round(part.time / DT).astype(int)
    assert part.dt == pytest.approx(whole.dt, rel=1e-9)
    assert np.array_equal(part.input, whole.input[at])
    assert np.array_equal(part.output, whole.output[at])
    assert len(part.segments) == 1 + np.count_nonzero(np.diff(at) != 1)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"time": None, "dt": DT},
        {"rows": slice(1_234, 28_765)},
        {"mask": "state = 'idle' or abs(voltage) > 12"},
        {"mask": "t > 50 AND t < 170"},
        {"shift": {"voltage": -1}, "scale": {"voltage": 2.0}, "offset": {"speed": 1.0}},
        {"output": "d(speed)", "derivative_window": 7},
    ],
    ids=str,
)
@pytest.mark.parametrize("block", [7_003, 40_000])
def test_arx_from_blocks_is_arx_from_the_whole_record(
    tmp_path: Path, small: None, monkeypatch: pytest.MonkeyPatch, suffix: str, arguments: dict[str, Any], block: int
) -> None:
    """Also with the fit of a part of the record only."""
    monkeypatch.setattr(reading, "BLOCK", block)
    part, whole = both(write(tmp_path / f"log{suffix}", signals()), **arguments)
    fits = [emsid.fit(emsid.arx(2, 2), each) for each in (part, whole)]
    assert fits[0].samples == fits[1].samples > len(part)
    assert fits[0].estimate == pytest.approx(fits[1].estimate, rel=1e-9, abs=1e-10)
    if not fits[0].findings:  # else that of a coloured residual, which the excerpt shows
        assert fits[0].covariance == pytest.approx(fits[1].covariance, rel=1e-6)


def test_a_part_of_an_excerpt_stands_for_its_rows_of_the_file(tmp_path: Path, small: None) -> None:
    part, whole = both(write(tmp_path / "log.parquet", signals()))
    for first, last in part.split(0.7), part.split(0.31):
        row = round(last.time[0] / DT)
        for found, wanted in ((first, whole[:row]), (last, whole[row:])):
            one, other = (emsid.fit(emsid.arx(2, 2), each) for each in (found, wanted))
            assert one.samples == other.samples
            assert one.estimate == pytest.approx(other.estimate, rel=1e-9)
    middle = (np.arange(len(part)) > 3_000) & (np.arange(len(part)) < 5_000)
    left = part.mask(middle)
    out = (whole.time > part.time[3_000] + DT / 2) & (whole.time < part.time[5_000] - DT / 2)
    assert emsid.fit(emsid.arx(2, 2), left).samples == emsid.fit(emsid.arx(2, 2), whole.mask(out)).samples


@pytest.mark.parametrize("changed", ["scale", "detrend", "lowpass", "decimate"])
def test_a_record_that_is_changed_stands_for_itself(tmp_path: Path, small: None, changed: str) -> None:
    part, _ = both(write(tmp_path / "log.parquet", signals()))
    record = {
        "scale": lambda: part.scale("voltage", 2.0),
        "detrend": lambda: part.detrend(),
        "lowpass": lambda: part.lowpass(20.0),
        "decimate": lambda: part.decimate(2),
    }[changed]()
    assert part.excerpt_of
    assert not record.excerpt_of
    assert emsid.fit(emsid.arx(1, 1), record).samples < len(record)


def test_options_that_need_neighbours_say_that_no_model_gets_all_rows(tmp_path: Path, small: None) -> None:
    part, _ = both(write(tmp_path / "log.parquet", signals()), decimate=2)
    (found,) = [each for each in part.findings if each.code == "read-in-part"]
    assert found.data["whole"] == ["decimate"]
    assert not part.excerpt_of


def test_a_bad_row_outside_the_excerpt_is_named(tmp_path: Path, small: None) -> None:
    columns = signals()
    part, _ = both(write(tmp_path / "whole.parquet", columns))
    row = round(part.time[part.breaks[3]] / DT) - 1  # before a stretch
    columns["speed"][row] = np.nan
    part = emsid.read(
        ParsedFile(path := write(tmp_path / "log.csv", columns), read_columns(path, in_part=True)),
        input="voltage",
        output="speed",
        time="t",
    )
    with pytest.raises(DataError, match=f"'speed' has no value in row {row + 2} of the file"):
        emsid.fit(emsid.arx(2, 2), part)
    one, other = both(path, skip_bad_rows=True)
    fits = [emsid.fit(emsid.arx(2, 2), each) for each in (one, other)]
    assert fits[0].samples == fits[1].samples
    assert fits[0].estimate == pytest.approx(fits[1].estimate, rel=1e-9)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_look_at_an_excerpt_finds_what_one_at_the_file_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest, suffix: str
) -> None:
    columns = signals()
    if suffix == ".csv":
        columns["t"][0] = 5_000.0  # a stale first row
    path = write(tmp_path / f"log{suffix}", columns)
    whole = emsid.describe(path)
    request.getfixturevalue("small")
    part = emsid.describe(path)
    assert (whole.looked_at, part.rows) == (0, N)
    assert 0 < part.looked_at < N / 2
    assert (part.roles.input, part.roles.output) == (whole.roles.input, whole.roles.output) == ("voltage", "speed")
    assert part.reading == whole.reading
    assert part.clock.dt == pytest.approx(whole.clock.dt)
    assert part.response == whole.response or part.response.delay == whole.response.delay
    for mine, theirs in zip(part.columns, whole.columns, strict=True):
        assert (mine.rows, mine.missing) == (theirs.rows, theirs.missing)
        assert np.array_equal((mine.low, mine.high), (theirs.low, theirs.high), equal_nan=True)
    assert f"{N:,} rows, of which {part.looked_at:,} were looked at" in str(part)


def test_identify_fits_arx_to_all_rows_that_are_not_unseen(tmp_path: Path, small: None) -> None:
    path = write(tmp_path / "log.parquet", signals())
    named = {"input": "voltage", "output": "speed", "time": "t", "na": 2, "nb": 2, "nk": 1, "models": "arx"}
    result = emsid.identify(path, **named)
    held = round(result.unseen.time[0] / DT)
    assert result.recommended_fit.samples >= held - 10
    assert result.recommended_fit.samples > 2 * len(result.record)
    found = emsid.fit(emsid.arx(2, 2, 1), emsid.read(path, input="voltage", output="speed", time="t")[:held])
    assert result.recommended_fit.estimate[:4] == pytest.approx(found.estimate, abs=2e-3)
    assert "read-in-part" in [each.code for each in result.findings]


def test_a_row_for_every_value_is_refused(tmp_path: Path, small: None) -> None:
    t = np.arange(20_000) / 100
    columns = {"time": t, "signal": np.where(np.arange(20_000) % 2, "u", "y"), "value": np.sin(t)}
    path = write(tmp_path / "long.parquet", columns)
    with pytest.raises(FormatError, match="20,000 rows has a row for every value of a signal"):
        read_columns(path, in_part=True)


def test_an_irregular_table_that_is_too_long_is_refused_before_it_is_read(
    tmp_path: Path, small: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "log.csv", signals())
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:9_000], "# restart", *lines[9_000:]]) + "\n")
    monkeypatch.setattr(regular_table, "MOST_LINES", 20_000)
    with pytest.raises(FormatError, match="30,002 lines, some of them unlike the others"):
        read_columns(path, in_part=True)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_memory_does_not_grow_with_the_file(tmp_path: Path, suffix: str) -> None:
    """Of 12 million numbers (96 MB) an excerpt is read and all rows are fitted."""
    count = 2_000_000
    block = pl.DataFrame({name: signals(100_000)[name] for name in ("voltage", "speed")})
    frame = pl.concat([block] * 20).with_columns((DT * pl.int_range(count)).alias("t"))
    frame = frame.with_columns(*(pl.col("speed").round(2).alias(f"x{k}") for k in range(3)))
    path = tmp_path / f"log{suffix}"
    frame.write_csv(path) if suffix == ".csv" else frame.write_parquet(path)
    program = (
        "import resource, sys, emsid, polars, json; from pathlib import Path\n"
        "from emsid.io import read_columns, ParsedFile\n"
        "emsid.fit(emsid.arx(2, 2), emsid.Record([0.0, 1, 2, 1] * 9, [0.0, 1, 2, 0] * 9, dt=1))\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "columns = read_columns(sys.argv[1], in_part=True)\n"
        "record = emsid.read(ParsedFile(Path(sys.argv[1]), columns), input='voltage', output='speed', dt=0.01)\n"
        "fit = emsid.fit(emsid.arx(2, 2), record)\n"
        "peak = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024\n"
        "print(json.dumps([peak, fit.samples, len(record)]))"
    )
    done = subprocess.run([sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    peak, samples, held = json.loads(done.stdout)
    assert samples == count - 2
    assert held < 1_100_000
    assert peak < 300  # MB
