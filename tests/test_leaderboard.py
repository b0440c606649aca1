"""Readers of public benchmarks, on files that the tests write in the published layout, and the table of the page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import savemat

import emsid

sys.path.insert(0, str(Path(__file__).parents[1] / "bench"))

import leaderboard

Array = NDArray[np.float64]
RNG = np.random.default_rng(20)
PAGE = Path(__file__).parents[1] / "docs" / "accuracy.md"


def parts(folder: Path, name: str, *files: dict[str, Any]) -> leaderboard.Parts:
    """Write the files of a benchmark below a folder, and read them."""
    (found,) = (each for each in leaderboard.BENCHMARKS if each.name == name)
    (folder / "deeper").mkdir()
    for file, data in zip(found.files, files, strict=True):
        savemat(folder / "deeper" / file, data, appendmat=False)
    paths = leaderboard.found_files(folder, found)
    assert not isinstance(paths, str), paths
    return found.parts(paths)


def same(record: emsid.Record, u: Array, y: Array, dt: float) -> None:
    np.testing.assert_array_equal(record.input, np.reshape(u, (len(u), -1)))
    np.testing.assert_array_equal(record.output, np.reshape(y, (len(y), -1)))
    assert record.dt == pytest.approx(dt)


def test_the_circuit_of_2009(tmp_path: Path) -> None:
    u, y = RNG.standard_normal((2, 188_000, 1))
    data = {"uBenchMark": u, "yBenchMark": y, "fs": 51_200.0}
    (fitted,), (test,) = parts(tmp_path, "Wiener–Hammerstein 2009", data)
    same(fitted, u[5200:105_200], y[5200:105_200], 1 / 51_200)
    same(test, u[105_200:184_000], y[105_200:184_000], 1 / 51_200)


@pytest.mark.parametrize(("name", "test_part"), [("multisine", (105_712, 127_400)), ("arrow", (100, 40_575))])
def test_the_silverbox(tmp_path: Path, name: str, test_part: tuple[int, int]) -> None:
    v1, v2 = RNG.standard_normal((2, 1, 131_072))
    (fitted,), (test,) = parts(tmp_path, f"Silverbox, {name}", {"V1": v1, "V2": v2})
    same(fitted, v1[0, 40_650:105_712], v2[0, 40_650:105_712], 1 / 610.35)
    same(test, v1[0, slice(*test_part)], v2[0, slice(*test_part)], 1 / 610.35)


def test_the_coupled_drives(tmp_path: Path) -> None:
    data = {name: RNG.standard_normal((500, 1)) for name in ("u11", "u12", "z11", "z12")}
    (fitted,), (test,) = parts(tmp_path, "coupled drives, high amplitude", data)
    same(fitted, data["u12"][:400], data["z12"][:400], 0.02)
    same(test, data["u12"][400:], data["z12"][400:], 0.02)


def test_the_cascaded_tanks(tmp_path: Path) -> None:
    data = {name: RNG.standard_normal((1024, 1)) for name in ("uEst", "yEst", "uVal", "yVal")}
    (fitted,), (test,) = parts(tmp_path, "cascaded tanks", data | {"Ts": 4.0})
    same(fitted, data["uEst"], data["yEst"], 4.0)
    same(test, data["uVal"], data["yVal"], 4.0)


def test_the_noise_of_a_process(tmp_path: Path) -> None:
    """Realisations are the columns of a structure; the test file has two."""
    many, two = (
        {"dataMeas": {"r": u, "u": u, "y": 2 * u, "fs": 78_125.0}}
        for u in (RNG.standard_normal((400, 3)), RNG.standard_normal((300, 2)))
    )
    fitted, (test,) = parts(tmp_path, "process noise, second test signal", many, two)
    assert len(fitted) == 3
    same(fitted[1], many["dataMeas"]["u"][:, 1], many["dataMeas"]["y"][:, 1], 1 / 78_125)
    same(test, two["dataMeas"]["u"][:, 1], two["dataMeas"]["y"][:, 1], 1 / 78_125)


def test_the_hysteretic_oscillator(tmp_path: Path) -> None:
    (tmp_path / "fit.csv").write_text("u,y\n" + "".join(f"{k},{k * 1e-5}\n" for k in range(100)))
    u, y = RNG.standard_normal((2, 1, 8192))
    for name, values in (("uval_multisine", u), ("yval_multisine", y)):
        savemat(tmp_path / f"{name}.mat", {name: values})
    paths = [tmp_path / name for name in ("fit.csv", "uval_multisine.mat", "yval_multisine.mat")]
    (fitted,), (test,) = leaderboard.bouc_wen(paths)
    assert fitted.output[3, 0] == pytest.approx(3e-5)
    same(test, u[0], y[0], 1 / 750)


def test_the_ground_vibration(tmp_path: Path) -> None:
    one, other = (
        {"Force": RNG.standard_normal((1, n)), "Voltage": np.zeros((1, n)), "Acceleration": RNG.standard_normal((3, n)),
         "Fs": 400.0}
        for n in (500, 300)
    )  # fmt: skip
    (fitted,), (test,) = parts(tmp_path, "F-16, multisine level 3", one, other)
    same(fitted, one["Force"][0], one["Acceleration"].T, 1 / 400)
    same(test, other["Force"][0], other["Acceleration"].T, 1 / 400)


def test_parallel_branches(tmp_path: Path) -> None:
    """Two periods, realisations and amplitudes are axes of one array; there is one realisation for the test."""
    data = {f"{name}Est": RNG.standard_normal((64, 2, 4, 5)) for name in "uy"}
    data |= {f"{name}Val": RNG.standard_normal((64, 2, 1, 5)) for name in "uy"}
    fitted, (test,) = parts(tmp_path, "parallel Wiener–Hammerstein, largest amplitude", data | {"fs": 78_125.0})
    assert len(fitted) == 4
    u, y = (np.concatenate([data[f"{name}Est"][:, p, 2, 4] for p in range(2)]) for name in "uy")
    same(fitted[2], u, y, 1 / 78_125)
    assert test.output[70, 0] == data["yVal"][6, 1, 0, 4]


def test_the_industrial_robot(tmp_path: Path) -> None:
    data = {
        f"{name}_{part}": RNG.standard_normal((6, n)) for name in "uy" for part, n in (("train", 400), ("test", 90))
    }
    data |= {f"time_{part}": 0.1 * np.arange(float(n))[None] for part, n in (("train", 400), ("test", 90))}
    (fitted,), (test,) = parts(tmp_path, "industrial robot", data)
    same(fitted, data["u_train"].T, data["y_train"].T, 0.1)
    same(test, data["u_test"].T, data["y_test"].T, 0.1)


def test_a_positioning_axis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vir, qm = RNG.standard_normal((2, 200, 1))
    data = {"vir": vir, "qm": qm, "t": 0.001 * np.arange(200.0)[:, None], "gtau": 35.0}
    with pytest.raises(AssertionError, match="SHA-256 differs"):
        parts(tmp_path, "EMPS, first file", data)
    (fitted,), (test,) = leaderboard.emps([tmp_path / "deeper" / "DATA_EMPS.mat"])
    same(fitted, 35 * vir[:140], qm[:140], 0.001)
    same(test, 35 * vir[140:], qm[140:], 0.001)
    assert fitted.output_units == ("m",)


def test_a_row_is_measured_and_written_into_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    u = RNG.standard_normal((2000, 1))
    y = np.array([0.0, 0.0, *np.convolve(u[:, 0], 0.5 ** np.arange(20))[:1998]])[:, None]
    data = {"uEst": u[:1000], "yEst": y[:1000], "uVal": u[1000:], "yVal": y[1000:] + 0.1, "Ts": 4.0}
    parts(tmp_path, "cascaded tanks", data)
    identify = emsid.identify
    monkeypatch.setattr(emsid, "identify", lambda records, budget: identify(records, models="arx", budget=budget))
    (row,) = leaderboard.rows(tmp_path, [], None)
    assert row[:2] == ("cascaded tanks", "arx")
    assert float(row[2].split()[0]) == pytest.approx(0.1, rel=0.05)  # of a model without offset that starts in the test
    page = tmp_path / "page.md"
    page.write_text(f"# Page\n\n{leaderboard.HEAD}| EMPS | a | 1 mm | – | yes | 2 |\n\nmore\n", "utf-8")
    leaderboard.write_rows(page, [row])
    leaderboard.write_rows(page, [(*row[:2], "0.2 V", *row[3:])])
    _, _, after = page.read_text("utf-8").partition(leaderboard.HEAD)
    assert after == leaderboard.line_of((*row[:2], "0.2 V", *row[3:])) + "| EMPS | a | 1 mm | – | yes | 2 |\n\nmore\n"


def test_the_rows_of_the_page_are_of_known_benchmarks_and_published_results() -> None:
    _, head, after = PAGE.read_text("utf-8").partition(leaderboard.HEAD)
    assert head
    known = {each.name: each.published for each in leaderboard.BENCHMARKS}
    rows = [line[2:-2].split(" | ") for line in after.splitlines() if line.startswith("| ")]
    rows = rows[: next((k for k, row in enumerate(rows) if row[0] not in known), len(rows))]
    assert rows
    for row in rows:
        assert len(row) == 6
        assert row[3] == known[row[0]]
