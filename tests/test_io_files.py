"""Files written whole or not at all, and records that come back as they went."""

from __future__ import annotations

import os
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from emsid.errors import DataError, FormatError
from emsid.io import WRITERS, atomic_write, read, write_record
from emsid.io.files import write_several
from emsid.record import Record


class TestAtomicWrite:
    def test_text_and_bytes_and_missing_folders(self, tmp_path: Path) -> None:
        path = tmp_path / "a" / "b" / "c.txt"
        atomic_write(path, "Ω\n")
        assert path.read_bytes() == "Ω\n".encode()
        atomic_write(path, b"\0\1")
        assert path.read_bytes() == b"\0\1"
        assert [entry.name for entry in path.parent.iterdir()] == ["c.txt"]

    def test_the_rights_of_a_new_file_are_the_usual_ones(self, tmp_path: Path) -> None:
        atomic_write(tmp_path / "ours", "x")
        (tmp_path / "usual").write_text("x")
        assert (tmp_path / "ours").stat().st_mode == (tmp_path / "usual").stat().st_mode

    @pytest.mark.parametrize("interruption", [KeyboardInterrupt, MemoryError])
    def test_an_interruption_leaves_the_old_file_alone(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interruption: type[BaseException]
    ) -> None:
        path = tmp_path / "result.json"
        path.write_text("old")

        def interrupt(_: int) -> None:
            raise interruption

        monkeypatch.setattr(os, "fsync", interrupt)
        with pytest.raises(interruption):
            atomic_write(path, "new")
        assert path.read_text() == "old"
        assert [entry.name for entry in tmp_path.iterdir()] == ["result.json"]

    def test_a_full_disk_is_reported_in_one_line(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def full(_: int) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(FormatError, match=r"x\.txt: cannot be written \(no space left on device\)"):
            atomic_write(tmp_path / "x.txt", "new")
        assert not list(tmp_path.iterdir())

    def test_places_that_cannot_be_written_to(self, tmp_path: Path) -> None:
        (tmp_path / "folder").mkdir()
        (tmp_path / "file").write_text("x")
        for path in (tmp_path / "folder", tmp_path / "file" / "below", tmp_path / "nul\0l"):
            with pytest.raises(FormatError, match="cannot be written"):
                atomic_write(path, "x")
        assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "folder"]

    def test_several_files_are_written_at_once_and_the_first_problem_raised(self, tmp_path: Path) -> None:
        both = Barrier(2)

        def write(path: Path, content: str) -> None:
            both.wait(5)  # a second one that is not written meanwhile breaks it
            atomic_write(path, content)

        write_several(write, [tmp_path / "a", tmp_path / "b"], "12")
        assert [(tmp_path / name).read_text() for name in "ab"] == ["1", "2"]
        with pytest.raises(FormatError, match="cannot be written"):
            write_several(atomic_write, [tmp_path / "c", tmp_path], ["3", "4"])
        assert not (tmp_path / "c").exists()


values = arrays(
    np.float64, st.tuples(st.integers(2, 20), st.just(3)), elements=st.floats(allow_nan=False, allow_infinity=False)
)


sample_times = st.sampled_from([1e-3, 1 / 3, 0.010048, 2.5e-5, 7.0])


def check_round_trip(path: Path, samples: np.ndarray, dt: float) -> None:
    record = Record(samples[:, :2], samples[:, 2:], dt, ("v (V)", "file"), ("d(q)",))
    time = write_record(record, path)
    back = read(path, input=record.input_names, output=record.output_names, time=time)
    np.testing.assert_array_equal(back.input, record.input)
    np.testing.assert_array_equal(back.output, record.output)
    assert (back.dt, back.times) == (record.dt, record.times)


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values, sample_times)
def test_a_record_comes_back_bit_by_bit(tmp_path: Path, suffix: str, samples: np.ndarray, dt: float) -> None:
    check_round_trip(tmp_path / f"record{suffix}", samples, dt)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=6)
@given(values, sample_times)
def test_a_record_comes_back_from_parquet(tmp_path: Path, samples: np.ndarray, dt: float) -> None:
    """A few only: each is parsed in a process of its own."""
    check_round_trip(tmp_path / "record.parquet", samples, dt)


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_part_of_a_record_comes_back_at_its_time(tmp_path: Path, suffix: str) -> None:
    record = Record(np.arange(1000.0), np.arange(1000.0), 1e-3, ("t",), ("y",))[345:]
    time = write_record(record, tmp_path / f"part{suffix}")
    assert time == "time"
    back = read(tmp_path / f"part{suffix}", input="t", output="y", time=time)
    assert (back.dt, back.times) == (1e-3, record.times)


@pytest.mark.parametrize("suffix", WRITERS)
def test_the_units_of_a_record_come_back(tmp_path: Path, suffix: str) -> None:
    samples = np.arange(8.0)
    units = {"input_units": ("V",), "output_units": ("rad/s",)}
    path = tmp_path / f"log{suffix}"
    time = write_record(Record(samples, samples, 0.01, ("u",), ("speed",), **units), path)
    back = read(path, input="u", output="speed", time=time)
    assert (back.input_units, back.output_units, back.dt) == (("V",), ("rad/s",), 0.01)
    assert read(path, input="u", output="speed", time=time, units={"speed": "rpm"}).output[1, 0] == pytest.approx(
        0.105, 1e-2
    )
    write_record(Record(samples, samples, 0.01, ("u",), ("speed",)), path)
    assert read(path, input="u", output="speed", time=time).output_units == ("",)


@pytest.mark.parametrize("text", ["", "no JSON", "[1]", '{"u": 3}', "[" * 10_000, '{"u": "no unit"}'])
def test_missing_units_are_left_out(tmp_path: Path, text: str) -> None:
    np.savez(tmp_path / "log.npz", **{"u": np.arange(8.0), "y": np.arange(8.0), "emsid.units": np.array(text)})
    assert read(tmp_path / "log.npz", input="u", output="y", dt=0.1).input_units == ("",)


def test_a_record_that_no_table_can_hold(tmp_path: Path) -> None:
    record = Record(np.arange(4.0), np.arange(4.0), 1.0, breaks=(2,), name="two runs")
    with pytest.raises(DataError, match=r"two runs: a table holds one segment and this record has 2"):
        write_record(record, tmp_path / "x.csv")
    with pytest.raises(FormatError, match=r"no writer for the suffix '.mat'; there are .csv, .parquet, .npz"):
        write_record(record, tmp_path / "x.mat")
    with pytest.raises(DataError, match=r"the names 12, y1 cannot head a CSV file"):
        write_record(Record([1.0], [2.0], 1.0, ("12",)), tmp_path / "x.csv")
    assert not list(tmp_path.iterdir())


def test_a_name_loses_a_unit_that_is_not_that_of_the_channel(tmp_path: Path) -> None:
    samples = np.arange(4.0)
    names = ("Spannung [V]",), ("Drehzahl [U/min]",), "V", "rad/s"
    write_record(Record(samples, samples, 0.01, *names), tmp_path / "x.csv")
    assert (tmp_path / "x.csv").read_text().splitlines()[:2] == ["t [s],Spannung [V],Drehzahl [rad/s]", "0.0,0.0,0.0"]
    write_record(Record(samples, samples, 0.01, ("n (rpm)",), ("n [U/min]",), "rad/s", "rad/s"), tmp_path / "y.csv")
    assert (tmp_path / "y.csv").read_text().splitlines()[0] == "t [s],n (rpm),n [U/min]"
