"""Model files and motor files."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import emsid.models.kinds
from emsid.errors import FormatError, ModelError
from emsid.estimation.linear.least_squares import least_squares
from emsid.findings import Finding
from emsid.io import datasheet_template, load, motor_template, origin, read_datasheet, read_motor, save
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.structures import arx
from emsid.plant import Motor
from emsid.record import Record


@dataclass(frozen=True)
class Gain:
    """A model of as little as a model file has to know of one."""

    values: list[float]
    name: str = "gain"

    def to_data(self) -> dict[str, Any]:
        return {"values": self.values, "name": self.name}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Gain:
        if set(data) != {"values", "name"}:
            raise ModelError("a gain has values and a name")
        return cls(**data)


@pytest.fixture
def gain_is_a_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emsid.models.kinds, "MODELS", {"Gain": Gain}, raising=False)


@pytest.fixture
def path(tmp_path: Path, gain_is_a_model: None) -> Path:
    path = tmp_path / "model.json"
    save(Gain([0.1, -2.0]), path)  # type: ignore[arg-type]
    return path


def failure(path: Path) -> str:
    with pytest.raises(FormatError) as caught:
        load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(-1e100, 1e100)), st.text(st.characters(exclude_categories=("Cs", "Cc"))))
@pytest.mark.usefixtures("gain_is_a_model")
def test_a_model_comes_back_bit_by_bit(tmp_path: Path, values: list[float], name: str) -> None:
    save(Gain(values, name), tmp_path / "model.json")  # type: ignore[arg-type]
    back = load(tmp_path / "model.json")
    assert isinstance(back, Gain)
    assert back == Gain(values, name)
    assert list(map(str, back.values)) == list(map(str, values))  # 0.0 is not −0.0


def test_a_regression_model_comes_back_and_runs_as_before(tmp_path: Path) -> None:
    model = Narx(arx(na=2, nb=2), np.array([-1.5, 0.7, 1 / 3, 0.2]), 1e-3)
    save(model, tmp_path / "arx.json")
    back = load(tmp_path / "arx.json")
    assert isinstance(back, Narx)
    record = Record(np.sin(np.arange(50.0)), np.zeros(50), 1e-3)
    np.testing.assert_array_equal(back.simulate(record).output, model.simulate(record).output)


def test_the_file_says_what_it_is(path: Path) -> None:
    content = json.loads(path.read_text())
    assert list(content) == ["format", "schema", "type", "model", "sha256"]
    assert (content["format"], content["schema"], content["type"]) == ("emsid model", 4, "Gain")
    assert content["model"] == {"values": [0.1, -2.0], "name": "gain"}


def test_another_layout_is_the_same_model(path: Path) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()), sort_keys=True))
    assert load(path) == Gain([0.1, -2.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": {"values": [0.1, -2.0001], "name": "gain"}}, "altered since it was saved (its checksum differs)"),
        ({"type": "Loss"}, "altered since it was saved"),
        ({"sha256": ""}, "altered since it was saved"),
        ({"schema": 5}, "is written in schema 5 and this version of emsid reads 1, 2, 3 and 4"),
        ({"schema": 5, "extra": 1}, "is written in schema 5"),
        ({"schema": "1"}, "not a model file, or is cut off"),
        ({"format": "emsid result"}, "this is a 'emsid result' file, not an 'emsid model'"),
        ({"extra": 1}, "not complete (Object contains unknown field `extra`)"),
        ({"model": [1]}, "not complete (Expected `object`"),
    ],
)
def test_a_changed_file_is_refused(path: Path, change: dict[str, Any], message: str) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    assert message in failure(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [("0.1", "NaN", "not a model file"), ("0.1", "1e999", "not complete"), ('"sha256"', '"sha512"', "not complete")],
)
def test_what_json_has_no_spelling_for(path: Path, old: str, new: str, message: str) -> None:
    path.write_text(path.read_text().replace(old, new, 1))
    assert message in failure(path)


def test_files_that_are_no_model(path: Path) -> None:
    whole = path.read_bytes()
    for content in (
        whole[:-3],
        whole[:40],
        b"t,u\n1,2\n",
        b"[]",
        b"\xff\xfe",
        b"[" * 100_000,
        b'{"format": "emsid model"}',
    ):
        path.write_bytes(content)
        assert "not a model file, or is cut off" in failure(path)
    path.write_bytes(b"")
    assert failure(path) == "the file is empty; save the model again or name another"
    assert "did you mean model.json" in failure(path.with_name("modle.json"))
    assert "did you mean" not in failure(path.with_name("missing.json"))  # suffixes are all alike
    assert "did you mean model.json" in failure(path.with_name("model"))


@pytest.mark.parametrize("name", ["\x1b[2J", "\x9b2J", "a\x07", "\x7f"])
def test_texts_that_would_command_a_terminal(path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ModelError, match="has control characters in it; give it another name") as caught:
        save(Gain([1.0], name), path)  # type: ignore[arg-type]
    assert str(caught.value).isprintable()
    with monkeypatch.context() as careless:
        careless.setattr("emsid.io.model_file._check_texts", lambda _: None)
        save(Gain([1.0], name), path)  # type: ignore[arg-type]
    assert "has control characters in it" in failure(path)


def test_a_number_of_inputs_that_is_none(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emsid.models.kinds, "MODELS", {"narx": Narx})
    model = Narx(Structure.parse("y(t-1)", "u2(t-1)"), np.array([0.5, 1.0]), 0.01)
    for inputs in (-1, 1):
        data = model.to_data() | {"inputs": inputs}
        monkeypatch.setattr(Narx, "to_data", lambda _, data=data: data)
        save(model, path)
        assert failure(path) == f"structure: {inputs} inputs, and its regressors use 2; give that many or more, or none"
    data = model.to_data() | {"inputs": 0}  # which to a structure means as many as it uses
    monkeypatch.setattr(Narx, "to_data", lambda _: data)
    save(model, path)
    assert failure(path) == "structure: 0 inputs, and its regressors use 2; identify it again"


def test_a_type_or_content_that_is_no_model(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emsid.models.kinds, "MODELS", {"Loss": Gain})
    assert failure(path) == "unknown type of model 'Gain'; there are Loss"
    monkeypatch.setattr(Gain, "to_data", lambda _: {"value": 1.0})
    save(Gain([]), path)  # type: ignore[arg-type]
    assert failure(path) == "a gain has values and a name"


def test_what_cannot_be_saved(path: Path) -> None:
    before = path.read_bytes()
    with pytest.raises(ModelError, match=r"model.values\[1\] is nan; only a model with finite numbers can be saved"):
        save(Gain([1.0, float("nan")]), path)  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="a Motor cannot be saved; models are Gain"):
        save(Motor(), path)  # type: ignore[arg-type]
    assert path.read_bytes() == before


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_damage_is_noticed(path: Path, data: st.DataObject) -> None:
    save(Gain([0.1, -2.0]), path)  # type: ignore[arg-type]
    content = bytearray(path.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with suppress(FormatError):
        assert load(path) == Gain([0.1, -2.0])  # a blank for a line end


class TestMotor:
    def test_what_is_left_out_keeps_its_default(self, tmp_path: Path) -> None:
        path = tmp_path / "motor.toml"
        path.write_text('[motor]\nresistance = "2.1 ohm"\n[motor.rotor_friction]\ncoulomb = "4 mN*m"\n')
        motor = read_motor(path)
        assert motor.resistance == 2.1
        assert motor.rotor_friction.forward.coulomb == pytest.approx(4e-3)
        assert motor.load_inertia == Motor().load_inertia
        path.write_text("[motor]\n")
        assert asdict(read_motor(path)) == asdict(Motor())

    @pytest.mark.parametrize(
        ("content", "kind", "message"),
        [
            (b"", FormatError, "the file is empty"),
            (b"resistance = 2\n", FormatError, "there is no table [motor]"),
            (b"motor = 2\n", FormatError, "there is no table [motor]"),
            (b"title = 'x'\n[motor]\n", FormatError, "title outside of [motor]"),
            (b"[motor\n", FormatError, "this is not TOML"),
            (b"\xff\xfe\x00", FormatError, "this is not TOML"),
            (b"x = " + b"[" * 100_000, FormatError, "this is not TOML"),
            (b"[motor]\nresistanse = 2\n", ModelError, "resistanse"),
            (b"[motor]\nresistance = -2\n", ModelError, "resistance"),
            (b"[motor]\nresistance = '2 V'\n", ModelError, "resistance"),
        ],
    )
    def test_what_is_no_motor(self, tmp_path: Path, content: bytes, kind: type[Exception], message: str) -> None:
        path = tmp_path / "motor.toml"
        path.write_bytes(content)
        with pytest.raises(kind) as caught:
            read_motor(path)
        assert message in str(caught.value)
        assert str(caught.value).startswith(f"{path}: ")
        assert "\n" not in str(caught.value)


def test_the_motor_that_is_printed_is_the_built_in_one_and_names_every_parameter(tmp_path):
    path = tmp_path / "motor.toml"
    path.write_text(motor_template())
    assert asdict(read_motor(path)) == asdict(Motor())
    assert all(name in motor_template() for name, *_ in Motor.parameters())
    path.write_text(
        motor_template()
        .replace("# torque", "torque")
        .replace('torque_dead_zone.b_r = "0', 'torque_dead_zone.b_r = "0.1')
    )
    zone = read_motor(path).torque_dead_zone
    assert (zone.b_l, zone.b_r, zone.m_l, zone.m_r) == (0, 0.1, 1, 1)


@pytest.mark.parametrize("kind", ["motor", "linear-axis"])
def test_every_line_of_a_datasheet_that_is_printed_can_be_used(kind, tmp_path):
    path = tmp_path / "datasheet.toml"
    template = datasheet_template(kind)
    path.write_text(template)
    assert read_datasheet(path) == {}
    lines = template.split(f"[{kind}]\n")[1].splitlines()
    assert len(lines) > 15
    for line in lines:
        path.write_text(f"[{kind}]\n{line.removeprefix('# ')}\n")
        name = line.split()[1]
        assert all(given.value is None for given in read_datasheet(path).values())
        assert set(read_datasheet(path)) == {name}


def test_a_model_file_tells_what_the_model_was_identified_from(tmp_path):
    rng = np.random.default_rng(5)
    u = rng.normal(size=300)
    record = Record(u, np.cumsum(u) * 0.1, 0.01, input_names=("voltage",), output_names=("speed",), input_units=("V",))
    model = least_squares(arx(1, 1), record).model
    save(model, tmp_path / "plain.json")
    assert origin(tmp_path / "plain.json") is None
    path = tmp_path / "model.json"
    save(model, path, record)
    assert load(path).equation() == model.equation()
    assert origin(path).differences(record) == []
    assert origin(path).differences(replace(record, dt=0.010005)) == []  # 10.005 ms, told as 10
    other = Record(
        record.output, record.input, 0.02, input_names=("speed",), output_names=("voltage",), output_units=("V",),
        name="b.csv",
    )  # fmt: skip
    voltage, speed = [{"name": "voltage", "unit": "V"}], [{"name": "speed", "unit": ""}]
    assert origin(path).differences(other) == [
        Finding("channels-differ", "b.csv", {"what": "inputs", "identified_with": voltage, "channels": speed}),
        Finding(
            "channels-differ",
            "b.csv",
            {"what": "outputs", "identified_with": speed, "channels": [{"name": "voltage", "unit": "V"}]},
        ),
        Finding("sample-time-differs", "b.csv", {"identified_with": 0.01, "dt": 0.02}),
    ]
    assert origin(path).differences(replace(record, input_names=("voltage [V]",), input_units="")) == []
    assert origin(path).differences(replace(record, output=np.empty((300, 0)), output_names=(), output_units=())) == []
    milli = replace(record, input_names=("voltage [mV]",), input_units="")
    assert [difference.data["channels"] for difference in origin(path).differences(milli)] == [
        [{"name": "voltage [mV]", "unit": ""}]
    ]
    path.write_text(path.read_text().replace('"voltage"', '"current"'))
    with pytest.raises(FormatError, match="altered since it was saved"):
        load(path)
