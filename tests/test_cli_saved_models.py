"""Models that `emsid identify` saved, validated and simulated on other records."""

import json
from io import StringIO

import numpy as np
import polars as pl
import pytest

import emsid
from command_line import FIRST_ORDER, IDENTIFY, table
from conftest import try_few_refinements

pytestmark = pytest.mark.usefixtures("ctrl_c_heard", "figures_undrawn")


@pytest.fixture(scope="module")
def result(tmp_path_factory, command):
    """A folder in which a record has been identified with the default models, their orders and map given.

    Figures are empty files here; the tests of the report draw them.
    """
    folder = tmp_path_factory.mktemp("identified")
    log = table(folder / "log.csv", samples=300)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("emsid.report.figures.draw", lambda _, formats: dict.fromkeys(formats, b""))
        try_few_refinements(patch)
        blocks = ("--orders", "1", "--static", "dead-zone")
        assert command("identify", log, *IDENTIFY, *blocks, "--out", folder / "result") == 0
    return folder / "result"


def test_identify_writes_everything_it_promises(result):
    data = json.loads((result / "result.json").read_text())
    assert {row["model"] for row in data["rows"]} >= {"arx", "wiener-hammerstein-regression", "friction-narx"}
    assert {row["experiment"] for row in data["rows"]} == {"record"}
    assert {row["data"] for row in data["rows"]} == {"identification", "unseen"}
    unseen = [row for row in data["rows"] if row["data"] == "unseen"]
    errors = {row["model"]: row["simulation_mse"] for row in unseen}
    assert errors["arx"] < 1e-20
    assert errors[data["chosen"]] == pytest.approx(min(errors.values()), abs=1e-20)
    assert "<html" in (result / "report.html").read_text()
    for row in unseen:
        assert (result / f"{row['model']}.json").exists()
    assert len(list((result / "figures").glob("*.svg"))) > 3


class Closed(StringIO):
    """A pipe whose reader is gone, as ``head`` is after some lines."""

    def write(self, text: str) -> int:
        raise BrokenPipeError


def test_everything_is_written_though_nobody_reads_the_output(command, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.stdout", Closed())
    log = table(tmp_path / "log.csv", samples=300)
    assert command("identify", log, *IDENTIFY, "--models", "arx", "--out", tmp_path / "result") == 0
    assert {"report.html", "result.json", "arx.json"} <= {path.name for path in (tmp_path / "result").iterdir()}


def test_validate_reproduces_the_errors_of_identify(result, run, tmp_path):
    rows = json.loads((result / "result.json").read_text())["rows"]
    unseen = ("validate", "MODEL", result.parent / "log.csv", *IDENTIFY, "--rows", "210:300", "--json")
    for name in ("arx", "friction-narx", "wiener-hammerstein-regression"):
        (before,) = (row for row in rows if (row["model"], row["data"]) == (name, "unseen"))
        words = (result / f"{name}.json" if word == "MODEL" else word for word in unseen)
        status, out, _ = run(*words, "--horizon", "5")
        assert status == 0
        (after,) = json.loads(out)["records"]
        for error in ("simulation_mse", "one_step_mse", "fit_percent"):
            assert after[error] == pytest.approx(before[error], rel=1e-9, abs=1e-25)
        assert after["horizon"] == 5
        model, record = emsid.load(result / f"{name}.json"), emsid.read(unseen[2], input="u", output="y", dt=0.01)[210:]
        ahead = model.predict(record, 5)
        expected = np.mean((ahead.output - record.output)[ahead.counted] ** 2)
        assert after["horizon_mse"] == pytest.approx(expected, rel=1e-9, abs=1e-25)


def test_the_page_of_a_validation_counts_records_and_explains_its_numbers(result, run, tmp_path):
    """A model from a file has no method and no count of parameters, and one record is not the worst of all."""
    other = table(tmp_path / "other.csv", seed=1)
    _, said, _ = run("validate", result / "arx.json", other, "--out", tmp_path / "one")
    page = (tmp_path / "one" / "report.html").read_text()
    assert "<dt>record</dt><dd>1</dd>" in page
    assert "<dt>fit of its free run</dt>" in page
    assert "<dt>Free run</dt>" in page
    for text in (said, page):
        assert "FILE" not in text
        assert "Fitted" not in text
    run("validate", result / "arx.json", other, result.parent / "log.csv", "--out", tmp_path / "two")
    page = (tmp_path / "two" / "report.html").read_text()
    assert "<dt>records</dt><dd>2</dd>" in page
    assert "the lowest of all records" in page


def test_validate_says_that_the_model_was_fitted_to_these_data(result, run, tmp_path):
    """The model was fitted to the first 210 samples; a part of them, or a copy of the file, is no unseen record."""
    log, other = result.parent / "log.csv", table(tmp_path / "other.csv", seed=1)
    copy = tmp_path / "copy.csv"
    copy.write_text(log.read_text())

    def seen(*words: object) -> tuple[str, bool]:
        (document,) = json.loads(run("validate", result / "arx.json", *words, "--json")[1])["records"]
        return document["data"], "data-not-unseen" in {finding["code"] for finding in document["findings"]}

    assert seen(copy) == seen(log, "--rows", "20:150") == ("identification", True)
    assert seen(log, "--rows", "210:300") == seen(other) == ("unseen", False)


def test_validate_says_what_makes_an_error_large(result, run, tmp_path):
    """A file with another sample time, and an output that is not that of the model."""
    log, out = (result.parent / "log.csv").read_text(), tmp_path / "out"
    other = tmp_path / "log_dt2.csv"
    header, *rows = log.splitlines()
    at = header.split(",").index("y")
    cells = [row.split(",") for row in rows]
    turned = [",".join(str(-float(cell)) if k == at else cell for k, cell in enumerate(row)) for row in cells]
    other.write_text("\n".join([header, *turned]))
    status, said, _ = run("validate", result / "arx.json", other, "--out", out)
    assert status == 0
    for code in ("name of the file says 2 ms between rows", "free run is no better than the mean of the output"):
        assert code in said
        assert code in (out / "report.html").read_text()
    (found,) = json.loads((out / "validation.json").read_text())["records"]
    codes = {"worse-than-mean", "sample-time-contradicted"}
    assert codes <= {each["code"] for each in found["findings"]}
    (found,) = json.loads(run("validate", result / "arx.json", result.parent / "log.csv", "--json")[1])["records"]
    assert not codes & {each["code"] for each in found["findings"]}


def test_validate_says_that_a_record_is_late(result, run, tmp_path):
    header, *rows = (result.parent / "log.csv").read_text().splitlines()
    cells, at = [row.split(",") for row in rows], header.split(",").index("y")
    for row, before in zip(reversed(cells[1:]), reversed(cells[:-1]), strict=True):
        row[at] = before[at]
    late = tmp_path / "late.csv"
    late.write_text("\n".join([header, *(",".join(row) for row in cells)]))
    (found,) = json.loads(run("validate", result / "arx.json", late, "--json")[1])["records"]
    (shifted,) = [each["data"] for each in found["findings"] if each["code"] == "record-shifted"]
    assert shifted["samples"] == pytest.approx(1, abs=0.2)
    (found,) = json.loads(run("validate", result / "arx.json", result.parent / "log.csv", "--json")[1])["records"]
    assert "record-shifted" not in {each["code"] for each in found["findings"]}


def test_a_model_run_on_other_channels_is_reported(result, run):
    rows = ("--rows", "210:300")  # without those that it was fitted to
    words = ("validate", result / "arx.json", result.parent / "log.csv", *rows, "--dt", "0.01", "--input")
    (same,) = json.loads(run(*words, "u", "--output", "y", "--json")[1])["records"]
    assert same["findings"] == []
    status, out, _ = run(*words, "y", "--output", "u", "--json")
    assert status == 0
    (other,) = json.loads(out)["records"]
    assert [(each["code"], each["data"].get("what")) for each in other["findings"]] == [
        ("no-response", None),  # of an input to its output
        ("channels-differ", "inputs"),
        ("channels-differ", "outputs"),
        ("worse-than-mean", None),
    ]
    named = [
        [channel["name"] for channel in other["findings"][1]["data"][side]] for side in ("identified_with", "channels")
    ]
    assert named == [["u"], ["y"]]
    assert "the model was identified with the inputs u; log.csv has y.\n" in run(*words, "y", "--output", "u")[1]


def test_validate_remembers_how_the_record_was_read(run, tmp_path):
    path = table(tmp_path / "log.csv")
    words = ("identify", path, "-u", "u", "-y", "y", "--dt", "10ms", "--mask", "u > 1.9", "--models", "arx")
    assert run(*words, "--out", tmp_path / "out")[0] == 0
    status, out, err = run("validate", tmp_path / "out" / "arx.json", path, "--json")
    assert (status, err) == (0, "")
    (row,) = json.loads(out)["records"]
    assert (row["model"], [finding["code"] for finding in row["findings"]]) == ("arx", ["data-not-unseen"])
    status, out, _ = run("validate", tmp_path / "out" / "arx.json", path, "--mask", "", "--json")
    (whole,) = json.loads(out)["records"]
    assert whole["samples"] > row["samples"]
    status, out, err = run("validate", tmp_path / "out" / "arx.json", path, "--out", tmp_path / "check")
    assert (status, err) == (0, "")
    assert {"report.html", "validation.json"} <= {file.name for file in (tmp_path / "check").iterdir()}


def test_a_saved_model_is_simulated_on_the_inputs_of_a_file(result, run, tmp_path):
    inputs, out = table(tmp_path / "inputs.csv", seed=3), tmp_path / "simulated.csv"
    words = ("simulate", result / "arx.json", inputs, "--out", out, "--force", "--json")
    status, printed, _ = run(*words)
    assert status == 0
    assert json.loads(printed)["columns"] == ["t", "u", "y"]
    simulated = emsid.read(out, input="u", output="y", time="t")
    voltage = emsid.read(inputs, input="u", output=(), dt=0.01).input
    expected = emsid.simulate(emsid.load(result / "arx.json"), voltage)
    np.testing.assert_array_equal(simulated.input, voltage)
    np.testing.assert_array_equal(simulated.output, expected.output)
    assert "name the file with the inputs" in run("simulate", result / "arx.json", "--out", out, "--force")[2]
    assert "identified at 0.01 s" in run(*words[:3], "--out", out, "--force", "--dt", "20ms")[2]
    emsid.save(emsid.load(result / "arx.json"), tmp_path / "bare.json")
    assert (
        "does not say how its record was read"
        in run("simulate", tmp_path / "bare.json", inputs, "--out", out, "--force")[2]
    )


def test_a_simulation_begins_at_rest_or_in_the_state_that_the_outputs_show(result, run, tmp_path):
    out, model = tmp_path / "simulated.csv", result / "arx.json"
    moving = tmp_path / "moving.csv"
    header, *rows = table(tmp_path / "inputs.csv", seed=3).read_text().splitlines()
    moving.write_text("\n".join([header, *rows[200:]]) + "\n")
    measured = emsid.read(moving, input="u", output="y", dt=0.01)

    def error(*words: str) -> tuple[float, str]:
        status, printed, _ = run("simulate", model, moving, "--out", out, "--force", *words)
        simulated = emsid.read(out, input="u", output="y", time="t")
        assert (status, len(simulated)) == (0, len(measured))
        return float(abs(simulated.output - measured.output).max()), printed

    at_rest, said = error()
    assert "arx begins at rest; if moving.csv has outputs, --start estimated" in said
    assert error("--start", "rest")[0] == at_rest > 0.1
    estimated, said = error("--start", "estimated")
    assert "arx begins in the state that the first outputs in moving.csv show" in said
    assert estimated < 1e-9  # the arx model is exact there
    for start in ("rest", "estimated"):
        assert json.loads(error("--start", start, "--json")[1])["start"] == start
    assert (
        "no column 'y'"
        in run("simulate", model, without(moving, "y"), "--start", "estimated", "--out", out, "--force")[2]
    )
    assert (
        "--start: only for the file with the inputs"
        in run("simulate", "--start", "estimated", "--out", out, "--force")[2]
    )
    assert "--start" not in run("simulate", "--out", out, "--force")[1]


def test_a_model_of_columns_with_units_in_their_names(run, tmp_path):
    """Names on the command line are without units; the other file has its voltage in millivolts."""
    rows = table(tmp_path / "log.csv", samples=300).read_text().splitlines()[1:]
    log, milli, out = tmp_path / "volts.csv", tmp_path / "milli.csv", tmp_path / "out"
    log.write_text("\n".join(["voltage [V],speed (rad/s)", *rows]))
    cells = [row.split(",") for row in rows]
    milli.write_text("\n".join(["voltage [mV],speed (rad/s)", *(f"{1000 * float(u)!r},{y}" for u, y in cells)]))
    words = ("identify", log, "-u", "voltage", "-y", "speed", "--dt", "10ms", "--offset", "voltage [V]=1")
    assert run(*words, "--models", "arx", "--out", out)[0] == 0
    data = json.loads((out / "result.json").read_text())
    assert {each["unit"] for each in data["regions"]} == {"rad/s"}
    assert [each["unit"] for each in data["characteristics"] if each["name"] == "gain"] == ["rad/(s*V)"]
    page = (out / "report.html").read_text()
    assert "Speed [rad/s]" in page
    assert "[rad/s] [rad/s]" not in page
    assert "(rad/s) [rad/s]" not in page

    def simulated(*words):
        status, printed, _ = run("simulate", out / "arx.json", *words, "--out", tmp_path / "y.csv", "--force", "--json")
        record = emsid.read(tmp_path / "y.csv", input="voltage", output="speed", time="t")
        assert (status, record.output_units) == (0, ("rad/s",))
        return record, [each["code"] for each in json.loads(printed)["findings"]]

    volts, found = simulated(log)
    assert (volts.input_units, found) == (("V",), [])
    np.testing.assert_allclose(volts.input[:, 0], [float(u) + 1 for u, _ in cells])  # the offset is remembered
    words = ("simulate", out / "arx.json", milli, "--out", tmp_path / "y.csv", "--force")
    assert "offset is given for 'voltage [V]', which is neither input nor output" in run(*words)[2]
    converted, found = simulated(milli, "--offset", "voltage=1000")  # the header says the unit
    assert found == []
    np.testing.assert_allclose(converted.output, volts.output, atol=1e-9)
    converted, found = simulated(milli, "--unit", "voltage=mV", "--offset", "voltage=1000")
    assert found == []
    np.testing.assert_allclose(converted.output, volts.output, atol=1e-9)


def without(path, name):
    """A copy of a table without a column."""
    frame = pl.read_csv(path).drop(name)
    other = path.with_stem(f"without-{name}")
    frame.write_csv(other)
    return other


def test_a_saved_model_is_simulated_on_columns_of_other_names(result, run, tmp_path):
    out, times = tmp_path / "simulated.csv", 0.01 * np.arange(600)
    inputs = table(tmp_path / "inputs.csv", seed=3, seconds=times)
    other = tmp_path / "other.csv"
    other.write_text(inputs.read_text().replace("u,y,seconds", "volts,y,seconds"))
    assert "no column 'u'" in run("simulate", result / "arx.json", other, "--out", out, "--force")[2]
    words = ("simulate", result / "arx.json", other, "--input", "volts", "--time", "seconds", "--out", out, "--force")
    assert run(*words)[0] == 0
    voltage = emsid.read(inputs, input="u", output=(), dt=0.01).input
    simulated = emsid.read(out, input="volts", output="y", time="t")
    np.testing.assert_array_equal(simulated.output, emsid.simulate(emsid.load(result / "arx.json"), voltage).output)
    status, _, err = run("simulate", "--time", "t", "--out", out, "--force")
    assert (status, "--time: only for the file with the inputs" in err) == (2, True)


def test_an_export_knows_the_error_of_this_fit_and_not_that_of_another_one(run, tmp_path):
    log, other = table(tmp_path / "log.csv"), table(tmp_path / "other.csv", seed=5)
    words = (*IDENTIFY, *FIRST_ORDER, "--models", "arx", "--out")
    for file, folder in ((log, "a"), (other, "b")):
        assert run("identify", file, *words, tmp_path / folder)[0] == 0

    def said(model):
        assert run("export", tmp_path / "a" / model, "--to", "c99", "--out", tmp_path / "c", "--force")[0] == 0
        return (tmp_path / "c" / "README.md").read_text()

    assert "Fit of the free run on unseen data" in said("arx.json")
    assert "Fit of the free run on unseen data" in said("best.json")
    (tmp_path / "a" / "arx.json").write_bytes((tmp_path / "b" / "arx.json").read_bytes())
    assert "Fit on unseen data: not known" in said("arx.json")
