"""`emsid show` and `emsid compare`: saved models looked at, and run on the same records."""

import json

import numpy as np
import pytest

import emsid
from command_line import table

pytestmark = pytest.mark.usefixtures("ctrl_c_heard", "figures_undrawn")


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Two fits of y(t) = 0.9 y(t−1) + 0.3 u(t−1), one of them with a wrong order, saved with the reading."""
    folder = tmp_path_factory.mktemp("saved")
    record = emsid.read(table(folder / "log.csv"), input="u", output="y", dt=0.01)
    reading = {"input": ["u"], "output": ["y"], "dt": 0.01}
    for name, structure in (("good", emsid.arx(1, 1)), ("poor", emsid.arx(0, 1))):
        emsid.save(emsid.fit(structure, record), folder / f"{name}.json", record, reading)
    table(folder / "other.csv", seed=1)
    return folder


def test_show_prints_equation_parameters_poles_and_gain(command, models, capsys):
    assert command("show", models / "good.json") == 0
    printed = capsys.readouterr().out
    assert "from u to y, identified at a sample time of 10 ms" in printed
    assert "y(t) = 0.9*y(t-1) + 0.3*u(t-1)" in printed
    assert "poles in z, for small changes: 0.9" in printed
    assert "gain, for small changes: 3" in printed


def test_show_as_json_and_as_a_page(command, models, capsys, tmp_path):
    both = [models / "good.json", models / "poor.json"]
    assert command("show", *both, "--json", "--out", tmp_path) == 0
    data = json.loads(capsys.readouterr().out)
    assert data == json.loads((tmp_path / "models.json").read_text())
    good, poor = data["models"]
    assert good["linear"]["poles"] == [[pytest.approx(0.9), 0.0]]
    assert good["linear"]["gain"] == [[pytest.approx(3.0)]]
    assert poor["parameters"][0]["value"] != pytest.approx(0.3, abs=0.01)
    page = (tmp_path / "report.html").read_text()
    assert page.count("Step response of arx and arx, no. 2") >= 1


def test_compare_ranks_models_on_the_same_samples_and_knows_which_data_are_seen(command, models, capsys, tmp_path):
    both = [models / "poor.json", models / "good.json"]
    files = [models / "log.csv", models / "other.csv"]
    assert command("compare", *both, *files, "--json", "--out", tmp_path) == 0
    data = json.loads(capsys.readouterr().out)
    assert data == json.loads((tmp_path / "comparison.json").read_text())
    for known, kind in zip(data["records"], ("identification", "unseen"), strict=True):
        best, worst = known["models"]
        assert (best["model"], worst["model"]) == (str(models / "good.json"), str(models / "poor.json"))
        assert best["simulation_mse"] < 1e-20 < worst["simulation_mse"]
        assert best["samples"] == worst["samples"]
        assert {row["data"] for row in known["models"]} == {kind}
    record = emsid.read(files[1], input="u", output="y", dt=0.01)
    alone = emsid.validate(emsid.load(models / "poor.json"), record, transient=1)
    assert worst["simulation_mse"] == pytest.approx(alone.row.simulation_mse)
    assert "Free runs" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("compare", "good.json"), "at least one record"),
        (("compare", "other.csv"), "takes model files"),
        (("compare", "missing.json", "other.csv"), "missing.json"),
        (("show", "other.csv"), "other.csv"),
        (("show", "missing.json"), "missing.json"),
    ],
)
def test_what_is_no_model_or_record_gets_one_line(command, models, capsys, monkeypatch, words, says):
    monkeypatch.chdir(models)
    assert command(*words) == 2
    shown = capsys.readouterr()
    assert says in shown.err
    assert len(shown.err.strip().splitlines()) == 1
    assert not shown.out


def test_a_record_of_other_units_is_compared_in_those_of_the_fit(command, tmp_path, capsys):
    """Speed in rpm in the second file, in rad/s in the first."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-5, 5, 40), 10)
    y = np.zeros(400)
    for t in range(1, 400):
        y[t] = 0.9 * y[t - 1] + 0.3 * u[t - 1]
    for name, unit, gain in (("a", "rad/s", 1.0), ("b", "rpm", 30 / np.pi)):
        rows = [
            f"u [V],w [{unit}]",
            *(f"{one!r},{gain * other!r}" for one, other in zip(u.tolist(), y.tolist(), strict=True)),
        ]
        (tmp_path / f"{name}.csv").write_text("\n".join(rows))
    record = emsid.read(tmp_path / "a.csv", input="u", output="w", dt=0.01)
    emsid.save(
        emsid.fit(emsid.arx(1, 1), record), tmp_path / "m.json", record, {"input": ["u"], "output": ["w"], "dt": 0.01}
    )
    assert command("compare", tmp_path / "m.json", tmp_path / "b.csv", "--json") == 0
    (row,) = json.loads(capsys.readouterr().out)["records"][0]["models"]
    assert row["simulation_rmse"] < 1e-9


@pytest.mark.parametrize("words", [("show", "good.json"), ("compare", "good.json", "other.csv")])
def test_a_page_of_somebody_else_is_not_replaced(command, models, tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(models)
    (tmp_path / "report.html").write_text("<p>mine</p>")
    assert command(*words, "--out", tmp_path) == 2
    assert "report.html in it is not a result of emsid" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
