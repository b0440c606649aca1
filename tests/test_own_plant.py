"""Plants that users write: compiled or plain functions, the example, and functions that are refused."""

import math
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from emsid.errors import ModelError
from emsid.estimation.fit import Ending
from emsid.findings import Finding
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.estimation import begun_again, simulation_error
from emsid.models.plants.search.task import prepare
from emsid.plant.motor import Parameter
from emsid.record import Record
from simulated_plants import DT, LEVELS, SPEED, VOLTAGE, record_of


def decay(x, u, p):
    return [-p[0] * x[0] + u[0]]


def whole(x, u, p):
    return x[:1]


OWN = OwnPlant(decay, whole, (Parameter("a", "a", "1/s", "rate"),), (2.0,), 1, name="tank")


@pytest.fixture(scope="module")
def tank():
    """A record of a plant that is not compiled."""
    return Record(LEVELS, OWN.simulate(LEVELS[:, None], DT, np.zeros(1), ()), DT)


def test_a_plant_of_the_users_own():
    @njit
    def derivative(x, u, p):
        return np.array([x[1], -p[0] * np.sin(x[0]) - p[1] * x[1] + u[0]])

    @njit
    def output(x, u, p):
        return x[:1]

    table = (Parameter("g", "g/l", "1/s^2", "gravity over length"), Parameter("d", "d", "1/s", "damping"))
    truth = OwnPlant(derivative, output, table, (9.0, 0.5), 2, name="pendulum")
    record = record_of(truth, VOLTAGE, signals=SPEED, unit="rad")
    slow = replace(truth, derivative=derivative.py_func, output=output.py_func)
    assert np.allclose(slow.simulate(VOLTAGE[:50, None], DT, np.zeros(2), SPEED), record.output[:50], atol=1e-12)
    fit = simulation_error(truth.with_values({"g": 7.0, "d": 1.0}), record)
    assert fit.estimate == pytest.approx([9.0, 0.5], rel=1e-5)
    with pytest.raises(ModelError, match="is not registered and cannot be saved"):
        fit.model.to_data()


@pytest.fixture(scope="module")
def coupled_drives():
    """The example of a user's own plant; its file runs from any folder."""
    return runpy.run_path(str(Path(__file__).parents[1] / "examples" / "coupled_drives.py"))


def test_the_example_finds_the_drives_that_it_simulated(coupled_drives, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fit, outside = coupled_drives["main"]([])
    assert fit.names == coupled_drives["PLANT"].default_free
    assert outside == pytest.approx([0.01, 0.01], rel=0.3)  # its noise
    assert (tmp_path / "coupled-drives.svg").exists()


@pytest.mark.long
@pytest.mark.recordings
def test_the_example_has_its_published_error_on_the_recordings(coupled_drives, recordings, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, outside = coupled_drives["main"]([str(recordings / "coupled_drives" / "uniform_first400.csv")])
    assert outside == pytest.approx([0.112, 0.103], rel=0.02)


# --- functions that are not compiled ---------------------------------------------------------------------------------


def test_a_plant_of_plain_functions_is_fitted(tank):
    assert simulation_error(OWN.with_values({"a": 1.5}), tank).estimate == pytest.approx([2.0], rel=1e-8)


def test_a_search_of_an_own_plant_that_stalls_is_begun_again(tank):
    noise = 0.01 * np.random.default_rng(0).standard_normal(tank.output.shape)
    task = prepare(OWN.with_values({"a": 5.0}), replace(tank, output=tank.output + noise))
    stall = Finding("search-stalled", "", {"steps": 1, "offset": 5.0})
    early, found = (continuation.search(task, task.plant, steps) for steps in (1, 30))
    again = [
        begun_again(task, each._replace(minimum=replace(each.minimum, ending=Ending.STALLED, findings=(stall,))), 30)
        for each in (early, found)
    ]
    assert early.minimum.cost > 2 * found.minimum.cost
    assert again[0].minimum.cost == pytest.approx(found.minimum.cost, rel=1e-6)
    assert [each.minimum.ending for each in again] == [Ending.CONVERGED] * 2
    (said,) = again[1].minimum.findings
    assert (said.code, said.data) == ("minimum-not-smooth", {"starts": 4, "agreeing": 4})


def test_an_input_that_is_linear_between_its_samples_has_no_finding():
    straight, levels = replace(OWN, between="linear"), np.random.default_rng(0).standard_normal(400)
    clean = straight.simulate(levels[:, None], DT, np.zeros(1), ())
    noise = 1e-3 * np.random.default_rng(1).standard_normal(clean.shape)
    fit = simulation_error(straight.with_values({"a": 1.5}), Record(levels, clean + noise, DT))
    assert "input-taken-as-linear" not in {finding.code for finding in fit.findings}


def test_a_function_that_fails_at_some_parameters_only_ends_no_search(tank):
    """A step that goes too far is shortened."""

    def root(x, u, p):
        return [-math.sqrt(p[0] - 1.5) * x[0] * 2 * 2**0.5 + u[0]]

    fit = simulation_error(replace(OWN, derivative=root).with_values({"a": 5.0}), tank)
    assert fit.estimate == pytest.approx([2.0], rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bounds": (("b", 0.0, 1.0),)}, "tank: bounds of 'b', which is no parameter; there are a"),
        ({"bounds": (("a", 3.0, 1.0),)}, "tank: bounds of a from 3 to 1; they must ascend"),
        ({"states": 0}, "tank: states 0: .* whole number of at least 1"),
        ({"steps": 0}, "tank: steps 0: .* whole number of at least 1"),
        ({"steps": 2.5}, r"tank: steps 2\.5: .* whole number of at least 1"),
    ],
    ids=["bounds of nothing", "reversed bounds", "states", "no steps", "half steps"],
)
def test_a_plant_with_wrong_numbers_is_refused_when_it_is_made(changes, message):
    with pytest.raises(ModelError, match=message):
        replace(OWN, **changes)


def failing(x, u, p):
    raise ValueError("boom")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"derivative": failing}, "tank: its derivative failed: ValueError: boom"),
        ({"output": failing}, "tank: its output failed: ValueError: boom"),
        ({"derivative": failing, "between": "linear"}, "tank: its derivative failed: ValueError: boom"),
        ({"derivative": lambda x, u, p: [np.nan]}, "the free run of tank is not finite; check the start values"),
        ({"values": (-1e5,)}, "the free run of tank is not finite; check the start values"),
        ({"derivative": lambda x, u, p: [1.0, 2.0]}, r"tank: its derivative has shape \(2,\); it must be \(1,\)"),
        ({"derivative": lambda x, u, p: 1.0}, r"tank: its derivative has shape \(\); it must be \(1,\)"),
        ({"derivative": lambda x, u, p: None}, r"tank: its derivative has shape \(\); it must be \(1,\)"),
        ({"output": lambda x, u, p: [x[0], x[0]]}, r"tank: its output has shape \(2,\); it must be \(1,\)"),
    ],
    ids=["derivative fails", "output fails", "linear fails", "nan", "runaway", "long", "number", "none", "outputs"],
)
def test_a_plant_that_cannot_be_simulated_is_refused(tank, changes, message):
    with pytest.raises(ModelError, match=message):
        simulation_error(replace(OWN, **changes), tank)
