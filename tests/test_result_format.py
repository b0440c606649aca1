"""``result.json``: what it holds comes back, keeps to its written schema, and has no number that JSON has not."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

import emsid
from emsid.findings import plain
from emsid.identification.result import curves
from emsid.identification.result_format import FORMAT, VERSION, ResultFile, checked, schema
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.estimation import simulation_error
from emsid.options import Options
from emsid.validation import step_response_band

DOCS = Path(__file__).resolve().parents[1] / "docs"


def record_of_an_axis():
    force = np.repeat(np.random.default_rng(0).uniform(-10, 10, 60), 20)[:, None]
    plant = emsid.LinearAxis()
    position = plant.simulate(force, 0.005, np.zeros(2), (Signal.POSITION,))
    position += 1e-4 * np.random.default_rng(1).standard_normal(position.shape)
    return emsid.Record(force, position, 0.005, input_units=("N",), output_units=("m",))


@pytest.fixture(scope="module")
def result():
    options = Options(na=1, nb=1, nk=1, free=("mass", "friction.coulomb"), profile=("mass",), orders=(1, 1))
    return emsid.identify(record_of_an_axis(), models="linear-axis, arx, wiener", options=options)


@pytest.fixture(scope="module")
def written(result):
    return json.loads(json.dumps(result.to_data(), allow_nan=False))


def test_a_real_result_keeps_to_the_schema_and_comes_back(written):
    content = checked(written)
    assert (content.format, content.version) == (FORMAT, VERSION)
    assert msgspec.json.decode(msgspec.json.encode(content), type=ResultFile) == content


def test_every_estimate_is_there_with_interval_and_unit(result, written):
    axis = next(each for each in written["fits"] if each["model"] == "linear-axis")
    fit = next(each for each in result.fits if each.model.name == "linear-axis")
    rows = {each["name"]: each for each in axis["parameters"]}
    assert set(fit.names) <= set(rows)
    assert rows["mass"]["unit"] == "kg"
    for name, value, (low, high) in zip(fit.names, fit.estimate, fit.interval(), strict=True):
        assert rows[name]["value"] == value
        assert rows[name]["interval"] == pytest.approx([low, high], rel=1e-4)
    arx = next(each for each in written["fits"] if each["model"] == "arx")
    assert len(arx["parameters"]) == 2


def test_every_finding_and_profile_is_there(result, written):
    assert [each["code"] for each in written["findings"]] == [finding.code for finding in result.findings]
    assert any(each["code"] == "model-failed" for each in written["findings"])  # wiener has one filter, not two
    (profile,) = written["profiles"]
    assert (profile["model"], profile["name"]) == ("linear-axis", "mass")


def test_the_curves_of_the_chosen_model_are_there_with_their_bands(result, written):
    assert result.chosen.model.name == "linear-axis"
    found = {each["kind"]: each for each in written["curves"]}
    assert list(found) == ["step response", "magnitude", "phase", "friction"]
    force = found["friction"]
    assert (force["x_name"], force["x_unit"], force["unit"]) == ("Speed v", "m/s", "N")
    band = emsid.plants.friction_curve(result.chosen)
    np.testing.assert_allclose(force["x"], band.x, rtol=1e-5, atol=1e-9)
    shown = np.array([value is not None for value in force["value"]])  # the others are at speeds that never came
    assert shown.mean() > 0.5
    for name, values in {"value": band.y, "low": band.low, "high": band.high}.items():
        assert [value is not None for value in force[name]] == shown.tolist()
        found_values = [value for value in force[name] if value is not None]
        np.testing.assert_allclose(found_values, values[shown], rtol=1e-5, atol=1e-9)
    step = step_response_band(result.chosen, result.record)
    np.testing.assert_allclose(found["step response"]["high"], step.high[:, 0], rtol=1e-5, atol=1e-9)
    assert (found["step response"]["x_unit"], found["step response"]["unit"]) == ("s", "m")


def test_every_kind_of_model_has_its_curves_and_a_fit_without_intervals_no_band():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, (100, 2)), 6, axis=0)
    y = np.zeros((600, 2))
    for k in range(599):
        y[k + 1] = 0.9 * y[k] + 0.1 * u[k] @ [[1.0, 0.5], [0.2, 2.0]]
    y += 0.01 * rng.standard_normal(y.shape)
    both = emsid.Record(u, y, 0.01, input_units=("V", "V"), output_units=("rad/s", "A"))
    several = curves(emsid.fit(emsid.state_space(order=2), both), both)
    paths = [(each.kind, each.input, each.output, each.unit) for each in several]
    assert paths[:4] == [("step response", f"u{k}", f"y{i}", ("rad/s", "A")[i - 1]) for k in (1, 2) for i in (1, 2)]
    assert paths[4:6] == [("magnitude", "u1", "y1", "dB"), ("phase", "u1", "y1", "deg")]
    assert len(paths) == 12
    assert all(np.all(each.low <= each.high) for each in several)

    one = emsid.Record(u[:, 0], y[:, 0], 0.01, input_units=("V",), output_units=("rad/s",))
    terms = emsid.Structure.parse("y(t-1)", "u(t-1)", "sign(y(t-1))")
    fit = emsid.fit(terms, one, free_run=True)
    kinds = ["step response", "magnitude", "phase", "static map", "friction"]
    assert [curve.kind for curve in curves(fit, one)] == kinds
    assert curves(fit, one)[-1].unit == "V"
    assert all(np.isfinite(curve.low).any() for curve in curves(fit, one))
    without = curves(emsid.fit(terms, one), one)  # one step ahead, with noise in the output
    assert [each.kind for each in without] == kinds
    assert all(np.isnan(each.low).all() and np.isfinite(each.value).all() for each in without)


def test_what_is_not_finite_is_null():
    u = np.tile([1.0, -1.0], 50)
    fit = emsid.least_squares(emsid.arx(0, 3), emsid.Record(u, u, 0.1))
    data = json.loads(json.dumps(fit.to_data(), allow_nan=False))
    assert fit.ending is emsid.Ending.RANK_DEFICIENT
    assert [each["standard_error"] is None for each in data["parameters"]].count(True) == 2
    assert all(each["interval"] == [None, None] for each in data["parameters"] if each["standard_error"] is None)
    assert plain({"a": [float("nan"), (1.0, float("inf"))]}) == {"a": [None, [1.0, None]]}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"version": 1}, "version 1"),
        ({"format": "a letter"}, "'a letter'"),
        ({"chosen": 3}, "chosen"),
        ({"more": 1}, "more"),
        ({"rows": [{}]}, "rows"),
    ],
)
def test_another_content_is_refused_by_name(written, change, said):
    with pytest.raises(emsid.FormatError, match=said):
        checked(written | change)


def test_the_schema_in_the_documents_is_that_of_the_program():
    assert json.loads((DOCS / "result.schema.json").read_text("utf-8")) == schema()


def test_a_fit_of_a_plant_holds_what_was_not_estimated_too():
    fit = simulation_error(emsid.LinearAxis(), record_of_an_axis(), free=("mass",), fixed={"viscous_friction": 0.1})
    rows = {each["name"]: each for each in fit.to_data()["parameters"]}
    assert (rows["viscous_friction"]["status"], rows["viscous_friction"]["interval"]) == ("fixed", None)


if __name__ == "__main__":
    text = msgspec.json.format(msgspec.json.encode(schema()), indent=2)
    (DOCS / "result.schema.json").write_bytes(text + b"\n")
