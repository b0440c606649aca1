"""Fleets: sources and their batches, the engine, resuming, large least-squares problems, and scikit-learn."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import copytree

import numpy as np
import polars as pl
import pytest

import emsid
from emsid.compiled import own_code
from emsid.errors import DataError
from emsid.estimation.linear.information import Information
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import Control
from emsid.fleets import least_squares_over, merged
from emsid.fleets.engine import Engine, connected
from emsid.fleets.page import fleet_report
from emsid.fleets.simulated import simulated_fleet
from emsid.fleets.sources import batches, divided, found_files, seconds
from emsid.fleets.spread import changes, outliers
from emsid.fleets.work import FleetRow, Job, Value, rows_of
from emsid.models.plants.own_plant import OwnPlant
from emsid.plant.motor import Parameter
from engine_tasks import ending, squares
from fleet_of_motors import records

ARX = emsid.arx(na=1, nb=1)


def first_order(samples: int, pole: float, gain: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Input and output of y(t) = pole·y(t − 1) + gain·u(t − 1) + e."""
    u, y = rng.standard_normal(samples), np.zeros(samples)
    noise = 0.01 * rng.standard_normal(samples)
    for t in range(1, samples):
        y[t] = pole * y[t - 1] + gain * u[t - 1] + noise[t]
    return u, y


def frame(samples: int, pole: float, rng: np.random.Generator, begin: float = 0.0) -> pl.DataFrame:
    u, y = first_order(samples, pole, 1.0, rng)
    return pl.DataFrame({"t": begin + 0.01 * np.arange(samples), "u": u, "y": y})


@pytest.fixture(scope="module")
def hive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve motors of three days each; M05 has another pole, from the second day on M07 too."""
    rng, root = np.random.default_rng(1), tmp_path_factory.mktemp("fleet") / "hive"
    for motor in range(12):
        for day in range(3):
            pole = 0.8 if motor == 5 else 0.85 if motor == 7 and day else 0.9 + 0.002 * (motor % 3)
            folder = root / f"motor=M{motor:02d}" / f"day=2026-01-0{day + 1}"
            folder.mkdir(parents=True)
            frame(400, pole, rng).write_parquet(folder / "part.parquet")
    return root


def untimed(fleet: emsid.Fleet) -> list[FleetRow]:
    """The rows without their times."""
    return [replace(row, seconds=0) for row in fleet.rows]


READING = {"input": "u", "output": "y", "time": "t"}


@pytest.fixture(scope="module")
def threads() -> "Executor":
    with ThreadPoolExecutor(2) as pool:
        yield pool


@pytest.fixture(scope="module")
def by_day(hive: Path, threads: Executor) -> emsid.Fleet:
    return emsid.fleet(hive, ARX, threads, period="day", **READING)


def test_a_fleet_is_fitted_and_the_motor_that_differs_is_named(hive: Path, by_day: emsid.Fleet) -> None:
    result = by_day
    assert len(result.rows) == 36
    assert not result.failed
    assert {row.verdict for row in result.rows} <= {"model-supported", "model-limited"}
    assert "M05" in {outlier.motor for outlier in result.outliers}
    assert ("differs-from-fleet", "M05") in {(finding.code, finding.subject) for finding in result.findings}
    table = result.to_frame()
    m0 = table.filter((pl.col("motor") == "M00") & (pl.col("period") == "2026-01-02"))
    train, test = emsid.read(hive / "motor=M00/day=2026-01-02/part.parquet", **READING).split(0.7)
    alone = emsid.fit(ARX, train)
    for k, name in enumerate(alone.names):
        assert m0[name].item() == pytest.approx(alone.estimate[k], rel=1e-12)
    assert m0["rmse"].item() == pytest.approx(emsid.validate(alone, test).row.simulation_rmse, rel=1e-9)


def test_the_result_does_not_depend_on_the_executor(hive: Path, by_day: emsid.Fleet) -> None:
    assert untimed(emsid.fleet(hive, ARX, workers=2, period="day", **READING)) == untimed(by_day)


def test_patterns_name_motor_and_period(tmp_path: Path) -> None:
    for name in ("a/M1-x.csv", "a/M2-x.csv", "a/M1-y.csv", "a/readme.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("t,u,y\n0,0,0\n")
    files = found_files(f"{tmp_path}/a/{{motor}}-{{shift}}.csv")
    assert [batch.key for batch in batches(files, None, "shift", None)] == [("M1", "x"), ("M1", "y"), ("M2", "x")]
    assert [len(batch.files) for batch in batches(files, None, None, None)] == [2, 1]


def test_without_a_field_every_file_is_a_motor(tmp_path: Path) -> None:
    for name in ("A.csv", "B.csv", ".hidden.csv"):
        (tmp_path / name).write_text("t,u,y\n0,0,0\n")
    assert [batch.motor for batch in batches(found_files(tmp_path), None, None, None)] == ["A", "B"]


def test_a_column_names_the_motor(tmp_path: Path, threads: Executor) -> None:
    rng = np.random.default_rng(2)
    frames = {name: frame(300, 0.9, rng) for name in ("one", "two/2", "drei")}
    rows = [part.with_columns(pl.lit(name).alias("id")) for name, part in frames.items()]
    mixed = pl.concat(rows).sort("t")  # rows of all motors in turn
    mixed[:450].write_parquet(tmp_path / "first.parquet")
    mixed[450:].write_parquet(tmp_path / "second.parquet")
    result = emsid.fleet(tmp_path, ARX, threads, motor="id", unseen=0.0, **READING)
    assert [row.motor for row in result.rows] == sorted(frames)
    for row in result.rows:
        alone = emsid.fit(ARX, emsid.read(frames[row.motor], **READING))
        assert row.estimates["a1"].value == pytest.approx(alone.estimate[0], abs=0.02)  # one sample less at the border


def test_a_frame_of_all_motors_is_a_fleet(threads: Executor) -> None:
    rng = np.random.default_rng(31)
    parts = [frame(300, 0.9, rng).with_columns(pl.lit(name).alias("id")) for name in ("A", "B")]
    table = pl.concat(parts)
    result = emsid.fleet(table, ARX, threads, motor="id", **READING)
    assert [row.motor for row in result.rows] == ["A", "B"]
    pandas = pytest.importorskip("pandas")
    again = emsid.fleet(pandas.DataFrame(table.to_dict(as_series=False)), ARX, threads, motor="id", **READING)
    assert untimed(again) == untimed(result)
    assert isinstance(again.to_frame("pandas"), pandas.DataFrame)
    with pytest.raises(DataError, match="names the motor"):
        emsid.fleet(table, ARX, threads, **READING)


def test_a_duration_divides_the_time_column(tmp_path: Path, threads: Executor) -> None:
    rng = np.random.default_rng(3)
    begin = pl.datetime(2026, 3, 1, 22)
    table = frame(4 * 3600, 0.9, rng).with_columns(
        (begin + pl.duration(milliseconds=(1000 * pl.int_range(4 * 3600)))).alias("t")
    )
    table.write_parquet(tmp_path / "M1.parquet")
    result = emsid.fleet(tmp_path, ARX, threads, period="1d", **READING)
    assert [(row.motor, row.period) for row in result.rows] == [("M1", "2026-03-01"), ("M1", "2026-03-02")]
    numbers = frame(1000, 0.9, rng, begin=95.0)
    numbers.write_parquet(tmp_path / "M1.parquet")
    result = emsid.fleet(tmp_path, ARX, threads, period="100 s", **READING)
    assert [row.period for row in result.rows] == ["0 s", "100 s"]
    assert [row.samples for row in result.rows] == [349, 349]


@pytest.mark.parametrize(("text", "found"), [("1d", 86400.0), ("8 h", 28800.0), ("90min", 5400.0), ("0.5s", 0.5)])
def test_durations(text: str, found: float) -> None:
    assert seconds(text) == pytest.approx(found)


@pytest.mark.parametrize("text", ["day", "-1d", "0 s", "1 V", "", "1"])
def test_what_is_no_duration_is_refused(text: str) -> None:
    with pytest.raises(DataError, match="duration"):
        seconds(text)


def test_a_poisoned_file_fails_alone(hive: Path, threads: Executor, tmp_path: Path) -> None:
    hive = Path(copytree(hive, tmp_path / "hive"))
    good = (hive / "motor=M01/day=2026-01-01/part.parquet").read_bytes()
    (hive / "motor=M01/day=2026-01-01/part.parquet").write_bytes(good[: len(good) // 2])
    (hive / "motor=M02/day=2026-01-01/part.parquet").write_bytes(b"not a table")
    silent = pl.DataFrame({"t": 0.01 * np.arange(400), "u": np.zeros(400), "y": np.zeros(400)})
    silent.write_parquet(hive / "motor=M03/day=2026-01-01/part.parquet")
    result = emsid.fleet(hive, ARX, threads, period="day", **READING)
    assert len(result.rows) == 36
    assert [row.motor for row in result.failed] == ["M01", "M02", "M03"]
    assert "constant" in result.failed[2].reason
    assert [each.code for each in result.findings if not each.subject] == ["fleet-too-short", "motors-failed"]


def test_a_poisoned_table_does_not_stop_the_division(tmp_path: Path) -> None:
    table = frame(30, 0.9, np.random.default_rng(4)).with_columns(pl.lit("M").alias("id"))
    table.write_parquet(tmp_path / "a.parquet")
    (tmp_path / "b.parquet").write_bytes(b"no")
    table.drop("id").write_parquet(tmp_path / "c.parquet")
    parts, failed = divided(found_files(tmp_path), "id", tmp_path / "parts")
    assert [part.keys for part in parts] == [{"motor": "M"}]
    assert sorted(Path(path).name for path in failed) == ["b.parquet", "c.parquet"]


# --- the engine ------------------------------------------------------------------------------------------------------


def test_every_task_has_its_result(threads: Executor) -> None:
    engine = Engine(squares, lost=lambda task: -1, executor=threads)
    assert dict(engine(range(3000))) == {task: task * task for task in range(3000)}


def test_a_lost_worker_is_replaced_and_only_its_cause_fails(tmp_path: Path) -> None:
    engine = Engine(partial(ending, str(tmp_path)), lost=lambda task: -1, workers=2)
    found = dict(engine(range(24)))
    assert found == {task: -1 if task == 7 else task * task for task in range(24)}


def test_an_error_of_a_task_is_raised(threads: Executor) -> None:
    with pytest.raises(TypeError):
        list(Engine(squares, lost=lambda task: -1, executor=threads)(["a"]))  # type: ignore[list-item]


class Broken(Executor):
    """An executor whose workers are gone."""

    def submit(self, *_: object, **__: object) -> Future:  # type: ignore[override]
        future: Future = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future


def test_an_executor_that_ended_is_said(hive: Path) -> None:
    with pytest.raises(DataError, match="finished rows are kept"):
        emsid.fleet(hive, ARX, Broken(), **READING)


def test_an_unreachable_scheduler_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emsid.fleets.engine.ANSWER", 0.5)
    with pytest.raises(DataError, match=r"no scheduler answers|needs Dask"), connected("tcp://127.0.0.1:1"):
        pass


def test_an_interrupted_fleet_goes_on_where_it_stopped(
    hive: Path, threads: Executor, by_day: emsid.Fleet, tmp_path: Path
) -> None:
    out, seen = tmp_path / "out", []
    control = Control(cancelled=lambda: (out / "rows.jsonl").exists() and len((out / "rows.jsonl").read_bytes()) > 3000)
    first = emsid.fleet(hive, ARX, threads, period="day", out=out, control=control, **READING)
    assert first.interrupted
    assert first.findings[-1].code == "fleet-unfinished"
    assert 0 < len(first.rows) < 36
    with open(out / "rows.jsonl", "a") as file:
        file.write('{"motor": "M11", "per')  # cut by a crash
    control = Control(report=lambda activity: seen.append(activity.done))
    second = emsid.fleet(hive, ARX, threads, period="day", out=out, control=control, **READING)
    assert untimed(second) == untimed(by_day)
    assert min(done for done in seen if done) > len(first.rows)
    kept = {(row.motor, row.period): row.seconds for row in first.rows}
    assert all(row.seconds == kept.get((row.motor, row.period), row.seconds) for row in second.rows)
    third = emsid.fleet(hive, ARX, threads, period="day", out=out, unseen=0.5, **READING)
    assert {row.job for row in third.rows}.isdisjoint({row.job for row in second.rows})
    assert not list(out.glob(".*"))


def test_rows_are_written_as_parquet(hive: Path, threads: Executor, tmp_path: Path) -> None:
    result = emsid.fleet(hive, ARX, threads, out=tmp_path / "out", **READING)
    assert pl.read_parquet(tmp_path / "out/fleet.parquet").equals(result.to_frame())
    lines = (tmp_path / "out/rows.jsonl").read_text().splitlines()
    assert {json.loads(line)["motor"] for line in lines} == {row.motor for row in result.rows}


def test_a_structure_is_chosen_on_one_motor(hive: Path, threads: Executor, tmp_path: Path) -> None:
    result = emsid.fleet(hive, "arx", threads, reference="M03", **READING)
    assert len({tuple(row.estimates) for row in result.rows}) == 1
    fit = emsid.identify(emsid.read(hive / "motor=M03/day=2026-01-01/part.parquet", **READING), models="arx").chosen
    of_fit = emsid.fleet(hive, fit, threads, **READING)
    assert tuple(of_fit.rows[0].estimates) == fit.names
    emsid.save(fit, tmp_path / "fit.json")
    assert untimed(emsid.fleet(hive, str(tmp_path / "fit.json"), threads, **READING)) == untimed(of_fit)


def test_a_change_of_a_motor_is_a_finding(tmp_path: Path, threads: Executor) -> None:
    """A motor alone, with another pole from the sixth file on: too few motors to compare, but a change in time."""
    rng = np.random.default_rng(21)
    for day in range(10):
        frame(300, 0.7 if day > 4 else 0.9, rng).write_parquet(tmp_path / f"M-{day}.parquet")
    result = emsid.fleet(f"{tmp_path}/{{motor}}-{{day}}.parquet", ARX, threads, period="day", **READING)
    found = {finding.code: finding for finding in result.findings}
    assert found["changed-over-periods"].data["since"] == "5"
    assert found["fleet-too-small"].data["motors"] == 1
    assert result.tested == {"different": False, "changed": True}
    assert fleet_report(result, "motors").summary[0].startswith("M (")
    for day in range(3, 10):
        (tmp_path / f"M-{day}.parquet").unlink()
    result = emsid.fleet(f"{tmp_path}/{{motor}}-{{day}}.parquet", ARX, threads, period="day", **READING)
    assert [finding.code for finding in result.findings] == ["fleet-too-small", "fleet-too-short"]
    assert fleet_report(result, "motors").summary[0] == "No motors were compared."


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"output": ""}, "output column"),
        ({"unseen": 1.0}, "unseen"),
        ({"motor": "serial"}, "no column 'serial'"),
        ({"period": "week"}, "duration"),
        ({"what": "arx", "reference": "X"}, "no motor 'X'"),
        ({"what": "no-such-model"}, "no-such-model"),
        ({"source": "nowhere"}, "no file"),
    ],
)
def test_bad_arguments_are_refused(hive: Path, threads: Executor, arguments: dict[str, object], words: str) -> None:
    given = {"source": hive, "what": ARX, **READING, **arguments}
    with pytest.raises(emsid.EmsidError, match=words):
        emsid.fleet(given.pop("source"), given.pop("what"), threads, **given)  # type: ignore[arg-type]


def test_the_page_shows_who_differs_who_changed_and_who_failed(hive: Path, threads: Executor, tmp_path: Path) -> None:
    hive = Path(copytree(hive, tmp_path / "hive"))
    (hive / "motor=M02/day=2026-01-01/part.parquet").write_bytes(b"not a table")
    result = emsid.fleet(hive, ARX, threads, period="day", **READING)
    report = fleet_report(result, "a test")
    assert [section.title for section in report.sections] == [
        "Parameters over the motors",
        "Without a model",
        "All rows",
    ]
    assert "M05" in {row[0] for row in report.opening.tables[0].rows}
    assert len(report.sections[-1].tables[0].rows) == 36
    without = [replace(row, estimates={"a1": Value(0.5, float("nan"), "")}) for row in result.rows if not row.reason]
    (table,) = fleet_report(emsid.Fleet(tuple(without)), "a test").sections[-1].tables
    assert {row[-1] for row in table.rows} == {"0.5"}


def test_a_simulated_fleet_has_its_faults_found(tmp_path: Path, threads: Executor) -> None:
    """Worn bearings and the other load by name, nobody else, and the files that cannot be used with their reasons."""
    made = simulated_fleet(tmp_path, 14, 1000, worn=2, loaded=1, poisoned=3, seed=5)
    plant = emsid.plants.rigid_motor()
    free = ["motor_constant", "rotor_inertia", "rotor_friction.coulomb"]
    known = {"resistance": 2.0, "rotor_viscous": 1.5e-5, "voltage_dead_zone.half_width": 0.5}
    job = Job(plant, {"free": free, "fixed": known, "find_start": False}, {**VOLTAGE, "time": "t"}, 0.0, "test")
    rows = rows_of(job, batches(found_files(tmp_path), None, None, None))
    assert tuple(row.motor for row in rows if row.reason) == made.poisoned
    found = {each.motor for each in outliers(emsid.Fleet(tuple(rows)).series)[0]}
    assert set(made.worn + made.loaded) <= found
    assert len(found - set(made.worn + made.loaded)) <= 1
    assert changes(emsid.Fleet(tuple(rows)).series) == []


VOLTAGE = {"input": "voltage", "output": "speed", "units": {"voltage": "V", "speed": "rad/s"}}


# --- one large problem -----------------------------------------------------------------------------------------------


def test_least_squares_over_files_is_that_of_one_record(tmp_path: Path, threads: Executor) -> None:
    rng = np.random.default_rng(11)
    tables = [frame(5_000, 0.9, rng), frame(3_001, 0.9, rng)]
    for k, table in enumerate(tables):
        table.write_parquet(tmp_path / f"{k}.parquet")
    structure = emsid.arx(na=2, nb=3)
    whole = least_squares(structure, [emsid.read(table, input="u", output="y", dt=0.01) for table in tables])
    for rows in (700, 5_000, 100_000):
        parts = least_squares_over(tmp_path, structure, threads, input="u", output="y", dt=0.01, rows=rows)
        assert parts.estimate == pytest.approx(whole.estimate, rel=1e-10)
        assert parts.samples == whole.samples
        assert parts.covariance == pytest.approx(whole.covariance, rel=1e-8)


def test_parts_may_be_short_or_constant(tmp_path: Path, threads: Executor) -> None:
    """What a record cannot show alone, a part of one may leave open: 2 rows of the end, an input at rest."""
    table = frame(4_002, 0.9, np.random.default_rng(15))
    table = table.with_columns(u=pl.when(pl.int_range(pl.len()) < 2_100).then(0.0).otherwise(pl.col("u")))
    table.write_parquet(tmp_path / "one.parquet")
    structure = emsid.arx(na=2, nb=3)
    whole = least_squares(structure, [emsid.read(table, input="u", output="y", dt=0.01)])
    parts = least_squares_over(tmp_path, structure, threads, input="u", output="y", dt=0.01, rows=1_000)
    assert parts.estimate == pytest.approx(whole.estimate, rel=1e-9)
    table[3_000:3_007].write_parquet(tmp_path / "one.parquet")
    with pytest.raises(emsid.DataError, match="4 usable samples for the 5 parameters"):
        least_squares_over(tmp_path, structure, threads, input="u", output="y", dt=0.01, rows=5)


def test_a_gauss_newton_step_is_merged_as_a_tree() -> None:
    rng = np.random.default_rng(12)
    jacobian, residual = rng.standard_normal((999, 6)), rng.standard_normal(999)
    parts = [Information.from_rows(jacobian[k::7], -residual[k::7]) for k in range(7)]
    step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
    assert merged(parts).solve().estimate == pytest.approx(step, rel=1e-11)
    with pytest.raises(emsid.ModelError):
        merged([])


def test_bootstrap_in_other_processes_gives_the_same(threads: Executor) -> None:
    rng = np.random.default_rng(13)
    u, y = first_order(1200, 0.8, 1.0, rng)
    record = emsid.Record(u, y, dt=0.1)
    fit = emsid.fit(ARX, record)
    here = emsid.bootstrap(fit, record, 30, rng=np.random.default_rng(1))
    there = emsid.bootstrap(fit, record, 30, rng=np.random.default_rng(1), executor=threads)
    assert there.covariance == pytest.approx(here.covariance, rel=1e-12)


# --- scikit-learn ----------------------------------------------------------------------------------------------------

DYNAMIC = "the output depends on earlier samples, so their order and number matter"
SHORT = "a model of a dynamic system needs 20 samples"
NOT_APPLICABLE = {
    "check_methods_sample_order_invariance": DYNAMIC,
    "check_methods_subset_invariance": DYNAMIC,
    "check_n_features_in_after_fitting": SHORT,
    "check_estimators_nan_inf": SHORT,
    "check_regressors_no_decision_function": SHORT,
    "check_fit2d_1sample": SHORT,
    "check_fit2d_1feature": SHORT,
    "check_supervised_y_2d": "several outputs are meant",
}


def test_the_estimator_passes_the_checks_of_scikit_learn() -> None:
    checks = pytest.importorskip("sklearn.utils.estimator_checks")
    from emsid.sklearn import Identifier

    estimator = Identifier(options=emsid.Options(na=1, nb=1, nk=0))
    done = checks.check_estimator(
        estimator,
        expected_failed_checks=NOT_APPLICABLE,
        on_fail="raise",
        on_skip=None,
    )
    assert sum(each["status"] == "passed" for each in done) >= 40


def test_the_estimator_predicts_the_free_run() -> None:
    pytest.importorskip("sklearn")
    from emsid.sklearn import Identifier

    rng = np.random.default_rng(14)
    u, y = first_order(600, 0.9, 1.0, rng)
    groups = np.repeat([0, 1, 2], 200)
    found = Identifier("arx", dt=0.1).fit(u[:, None], y, groups)
    unseen, truth = first_order(300, 0.9, 1.0, rng)
    assert found.predict(unseen[:, None]) == pytest.approx(truth, abs=0.2)
    assert found.score(unseen[:, None], truth) > 0.99
    with pytest.raises(ValueError, match="groups"):
        found.fit(u[:, None], y, groups[:5])


def test_a_row_of_a_changed_or_removed_file_is_not_used_again(tmp_path: Path, threads: Executor) -> None:
    rng, logs, out = np.random.default_rng(8), tmp_path / "logs", tmp_path / "out"
    logs.mkdir()
    for name in ("a", "b", "c"):
        frame(300, 0.9, rng).write_csv(logs / f"{name}.csv")
    emsid.fleet(logs, ARX, threads, out=out, **READING)
    frame(300, 0.6, rng).write_csv(logs / "a.csv")
    (logs / "b.csv").unlink()
    (logs / "c.csv").rename(logs / "d.csv")
    again = emsid.fleet(logs, ARX, threads, out=out, **READING)
    fresh = emsid.fleet(logs, ARX, threads, **READING)
    assert untimed(again) == untimed(fresh)
    assert [row.motor for row in again.rows] == ["a", "d"]
    assert {f.code: f.data for f in again.findings}["rows-dropped"] == {"dropped": 3}
    assert "rows-dropped" not in {f.code for f in emsid.fleet(logs, ARX, threads, out=out, **READING).findings}
    journal = out / "rows.jsonl"
    before = journal.read_text().splitlines()
    other = emsid.fleet(logs, ARX, threads, out=out, unseen=0.5, **READING)
    assert not {row.job for row in other.rows} & {row.job for row in again.rows}
    assert journal.read_text().splitlines()[: len(before)] == before  # rows of the first job are kept


def test_another_version_of_the_program_fits_again(
    tmp_path: Path, threads: Executor, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame(300, 0.9, np.random.default_rng(8)).write_csv(tmp_path / "a.csv")
    first = emsid.fleet(tmp_path / "a.csv", ARX, threads, out=tmp_path / "out", **READING)
    monkeypatch.setattr("emsid.__version__", "another")
    assert (
        emsid.fleet(tmp_path / "a.csv", ARX, threads, out=tmp_path / "out", **READING).rows[0].job != first.rows[0].job
    )


def test_rows_of_a_plant_whose_code_has_changed_are_not_used_again(tmp_path: Path, threads: Executor) -> None:
    frame(60, 0.9, np.random.default_rng(8)).write_csv(tmp_path / "a.csv")

    def tank(code: str) -> OwnPlant:
        """Its functions as if a file with this code had been loaded."""
        scope: dict[str, object] = {"__name__": "mine"}
        exec(f"def inflow(u): return {code}\ndef rate(x, u, p): return [-p[0] * x[0] + inflow(u)]", scope)
        exec("def level(x, u, p): return x[:1]", scope)
        row = Parameter("a", "a", "1/s", "rate")
        return OwnPlant(scope["rate"], scope["level"], (row,), (2.0,), 1, name="tank")

    def job(code: str) -> tuple[str, int]:
        found = emsid.fleet(tmp_path / "a.csv", tank(code), threads, out=tmp_path / "out", **READING)
        return found.rows[0].job, len((tmp_path / "out" / "rows.jsonl").read_text().splitlines())

    first, again, changed = job("u[0]"), job("u[0]"), job("2 * u[0]")
    assert first == again
    assert (changed[0] != first[0], changed[1]) == (True, 2)


def test_the_code_of_a_class_of_the_users_own_is_told_apart_from_that_of_another() -> None:
    def law(text: str) -> object:
        scope: dict[str, object] = {"__name__": "mine"}
        exec(f"class Law:\n    level = staticmethod(lambda speed: {text})\n    def rate(self): return 1.0", scope)
        return scope["Law"]()  # type: ignore[operator]

    same, other = (list(own_code({"of": [law(text)]})) for text in ("speed", "speed**2"))
    assert same == list(own_code({"of": [law("speed")]}))
    assert (len(same), same[1:] == other[1:], same == other) == (2, True, False)
    assert list(own_code((ARX, emsid.MotorPlant(emsid.Motor()), {"knots": 3, "weights": np.ones(3)}))) == []


def test_files_of_one_name_are_different_motors(tmp_path: Path) -> None:
    for name in ("M1/log.csv", "M2/log.csv", "x/M1/run.csv", "y/M1/run.csv", "only.csv", "e/f.csv", "e/f.parquet"):
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("t,u,y\n")
    found = {batch.motor for batch in batches(found_files(tmp_path / "in"), None, None, None)}
    assert found == {"M1/log", "M2/log", "x/M1/run", "y/M1/run", "only", "f.csv", "f.parquet"}


def test_tables_are_divided_without_what_an_earlier_run_left(tmp_path: Path) -> None:
    old = tmp_path / "parts" / "000007" / "id=gone"
    old.mkdir(parents=True)
    table = pl.DataFrame({"id": ["a", "b"], "u": [1.0, 2.0]})
    table.write_parquet(old / "0.parquet")
    table.write_parquet(tmp_path / "all.parquet")
    parts, _ = divided(found_files(tmp_path / "all.parquet"), "id", tmp_path / "parts")
    assert {part.keys["motor"] for part in parts} == {"a", "b"}


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_fleet_that_is_ended_leaves_no_worker_and_no_word_of_one(tmp_path: Path, sent: signal.Signals) -> None:
    simulated_fleet(tmp_path / "in", 60, 400, worn=1, loaded=0, poisoned=0)
    words = ("-u", "voltage", "-y", "speed", "--time", "t", "--models", "arx", "--workers", "2", "--out", "out")
    command = [sys.executable, "-m", "emsid", "fleet", "in", *words]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True)
    journal, end = tmp_path / "out" / "rows.jsonl", time.monotonic() + 60
    while time.monotonic() < end and not (journal.exists() and journal.read_text()):
        time.sleep(0.05)
    process.send_signal(sent)
    said = process.communicate(timeout=30)[1]
    assert process.returncode == (130 if sent == signal.SIGINT else 143)
    assert all(line.startswith("emsid: ") for line in said.splitlines()), said
    assert sent == signal.SIGTERM or "the finished rows are kept, and the same command goes on from there" in said
    assert all(line.startswith("{") and line.endswith("}") for line in journal.read_text().splitlines())
    end = time.monotonic() + 10  # the process that counts semaphores ends last
    with suppress(ProcessLookupError):
        while time.monotonic() < end:
            os.killpg(process.pid, 0)
            time.sleep(0.1)
    assert time.monotonic() < end
    assert not list((tmp_path / "out").rglob("*.tmp"))


def test_what_differs_in_a_motor_is_named_by_its_cause() -> None:
    """Motors of an independent simulation; the faults are a resistance, counts of an encoder, a load and a noise."""
    faults = {2: {"R": 1.37}, 4: {"counts": 1.3}, 6: {"noise": 8.0}, 8: {"J": 1.5}}
    plant = emsid.plants.rigid_motor().with_values({"resistance": 2.0, "voltage_dead_zone.half_width": 0.3})
    reading = {"input": "voltage", "output": "speed", "time": "t", "units": {"voltage": "V", "speed": "rad/s"}}
    with ThreadPoolExecutor(2) as pool:
        result = emsid.fleet(records(16, 300, faults, 1, spread=0.01), plant, pool, motor="motor", **reading)
    found = {(finding.code, finding.subject) for finding in result.findings if finding.subject}
    one = "differs-by-one-cause"
    assert found == {(one, "M02"), (one, "M04"), ("noisier-than-fleet", "M06"), ("differs-from-fleet", "M08")}
    assert {each.motor: (each.causes[0], each.factor) for each in result.causes} == {
        "M02": ("torque", pytest.approx(1.37, rel=0.05)),
        "M04": ("angle", pytest.approx(1 / 1.3, rel=0.05)),
    }
    page = fleet_report(result, "motors")
    named = page.summary[0]
    assert "changed" not in named  # there is one record of each
    assert all(each in named for each in ("M02 (ratio of resistance to torque constant)", "M08 (rotor_inertia)"))
    plots = [plot for figure in page.figures for plot in figure.plots]
    (first,) = page.opening.figures
    differs = {mark.names for plot in first.plots for mark in plot.marks if getattr(mark, "label", "") == "differs"}
    assert {name for names in differs for name in names} == {each.motor for each in result.outliers}
    assert all(plot.x.names == tuple(f"M{k:02d}" for k in range(16)) for plot in plots)
    assert "noise of the output" in {plot.y.quantity for plot in first.plots}
