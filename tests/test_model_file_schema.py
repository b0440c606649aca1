"""Model files of every schema are read, whoever wrote them, and run as they did when they were written."""

import json
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

import emsid
from emsid.errors import FormatError
from emsid.io import load, origin, read_options, save
from emsid.io.model_file import READABLE, SCHEMA, _checksum, _Document
from emsid.io.motor_library import add_actuator
from emsid.record import Record
from model_examples import ALL

GOLDEN = Path(__file__).parent / "golden" / "models"
EXPECTED = json.loads((GOLDEN / "expected.json").read_text())


def record(axis: bool = False) -> Record:
    """The record over which the models were run when their files were written."""
    u = np.repeat(np.random.default_rng(0).uniform(-6, 6, 60), 10)
    y = np.zeros(600)
    for t in range(1, 600):
        y[t] = 0.9 * y[t - 1] + 0.3 * np.sign(u[t - 1]) * max(abs(u[t - 1]) - 1, 0)
    names = ("force", "x", "N", "m") if axis else ("voltage", "speed", "V", "rad/s")
    return Record(u, y, 0.01, *((name,) for name in names), name="log.csv")


def test_there_is_an_old_file_of_every_kind() -> None:
    from emsid.models.kinds import MODELS

    kinds = {json.loads((GOLDEN / f"{name}.json").read_text())["type"] for name in EXPECTED}
    assert kinds == set(MODELS)


@pytest.mark.parametrize("name", EXPECTED)
def test_an_old_file_runs_as_it_did(name: str, tmp_path: Path) -> None:
    path = GOLDEN / f"{name}.json"
    data = record(axis="axis" in name)
    model = load(path)
    run = model.simulate(data)
    np.testing.assert_allclose(run.output[100:600:50, 0], EXPECTED[name], rtol=1e-9, atol=1e-12)
    assert read_options(path) == {}
    save(model, tmp_path / "new.json")
    assert json.loads((tmp_path / "new.json").read_text())["schema"] == SCHEMA
    np.testing.assert_array_equal(load(tmp_path / "new.json").simulate(data).output, run.output)


def test_how_a_record_was_read_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    how = {"input": ["voltage"], "output": ["speed"], "dt": 0.01, "mask": "voltage > 5", "scale": {"speed": 2.0}}
    save(load(GOLDEN / "arx-1.json"), path, record(), how)
    assert read_options(path) == how
    found = origin(path)
    assert found is not None
    assert found.inputs == (("voltage", "V"),)
    path.write_text(path.read_text().replace("voltage > 5", "voltage > 6"))
    with pytest.raises(FormatError, match="altered since it was saved"):
        load(path)


def test_a_schema_of_the_future_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text(json.dumps(json.loads((GOLDEN / "arx-1.json").read_text()) | {"schema": max(READABLE) + 1}))
    with pytest.raises(FormatError, match="is written in schema 5 and this version of emsid reads 1, 2, 3 and 4"):
        load(path)


def test_tampered_files_end_in_a_model_or_in_one_of_our_errors() -> None:
    """Hundreds of mutations, with their checksums corrected, in a process with a limit on its memory."""
    program = [sys.executable, "-W", "ignore", str(GOLDEN.parent.parent / "fuzz_model_files.py"), "400", "7"]
    *failures, tried = subprocess.run(program, capture_output=True, text=True, check=True).stdout.splitlines()
    assert failures == []
    assert int(tried) > 200


def altered(document: dict, path: Path, *keys: str | int, to: object) -> Path:  # type: ignore[type-arg]
    """The file of a document with one entry replaced."""
    inner = document
    for key in keys[:-1]:
        inner = inner[key]  # type: ignore[index]
    inner[keys[-1]] = to  # type: ignore[index]
    whole = msgspec.convert(document, _Document)
    whole.sha256 = _checksum(whole)
    path.write_bytes(msgspec.json.encode(whole))
    return path


@pytest.mark.parametrize(
    ("name", "keys", "to", "message"),
    [
        ("wiener-hammerstein, polynomial", ("blocks", 1, "low"), -1e-120, "a static map polynomial whose curve is"),
        ("wiener-hammerstein, monotone-spline", ("blocks", 1, "logarithms"), [1e3] * 3, "whose curve is not finite"),
        ("rigid motor", ("signals",), [], "a plant of which nothing is measured"),
        ("joint, friction by load", ("plant", "parameters", "sensor.ratio"), 1e-300, "impossible model"),
    ],
)
def test_a_model_that_cannot_be_computed_with_is_refused_as_it_is_read(
    name: str, keys: tuple[str | int, ...], to: object, message: str, tmp_path: Path
) -> None:
    save(ALL[name], tmp_path / "model.json")
    document = json.loads((tmp_path / "model.json").read_text())
    if name == "wiener-hammerstein, polynomial":
        document["model"]["blocks"][1]["high"] = 1e-120
    with pytest.raises(FormatError, match=message):
        load(altered(document, tmp_path / "model.json", "model", *keys, to=to))


@pytest.mark.parametrize(("argument", "value"), [("units", {"u": 1e9}), ("input", 3), ("outputx", ["y"]), ("dt", [])])
def test_arguments_of_another_type_are_refused_as_they_are_read(argument: str, value: object, tmp_path: Path) -> None:
    save(ALL["arx"], tmp_path / "model.json", record(), {"input": ["voltage"], "output": ["speed"], "time": "t"})
    document = json.loads((tmp_path / "model.json").read_text())
    document["reading"][argument] = value
    with pytest.raises(FormatError, match=r"no argument of read|Expected"):
        read_options(altered(document, tmp_path / "model.json", "schema", to=SCHEMA))


def test_a_negative_variance_is_refused_as_it_is_read(tmp_path: Path) -> None:
    data = record()
    save(emsid.fit(emsid.arx(1, 1), data), tmp_path / "model.json", data)
    document = json.loads((tmp_path / "model.json").read_text())
    path = altered(document, tmp_path / "model.json", "fit", "covariance", 0, to=[-1.0])
    with pytest.raises(FormatError, match="the variance of an estimate is negative"):
        load(path)
    with pytest.raises(FormatError, match="the variance of an estimate is negative"):
        add_actuator(tmp_path / "library", "a", path, [path], "emsid identify")
    assert not (tmp_path / "library").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"oversampling": 1', '"oversampling": 1000000000', "oversampling is 1e+09; it can be at most 64"),
        ('"delay": 0', f'"delay": {10**400}', "delay is an integer of very many digits"),
        ("-0.9005449368498915", ", ".join(["0.1"] * 300), "denominator has 300 entries; at most 100 are read"),
        ('"output_offset": -1.3955619574659987e-15', '"output_offset": 1e300', "a finite number of at most 1e+100"),
    ],
)
def test_sizes_are_checked_before_anything_is_computed(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    text = (GOLDEN / "cascade-1.json").read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(FormatError) as caught:
        load(path)
    assert message in str(caught.value)
