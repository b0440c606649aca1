"""The first screen and the table of models of the page of an identification."""

from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid.estimation.estimates import HALF_WIDTH
from emsid.report.document import Fact
from emsid.report.identification_page import _once, report, values, which_model
from emsid.report.numbers import first_up
from emsid.report.views import ranking
from emsid.report.views.cascade import NEAREST, ROOM, around

FREE = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")
DT = 0.005


def motor(seed):
    """The speed of a rigid motor at random steps of voltage, with little noise."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-10, 10, 40), 20)
    plant = emsid.plants.rigid_motor().with_values({"rotor_friction.coulomb": 8e-3})
    y = plant.simulate(u[:, None], DT, np.zeros(plant.states), (emsid.plants.Signal.SPEED,))
    y = y + 1e-3 * np.std(y) * rng.standard_normal(y.shape)
    return emsid.Record(u, y, DT, input_units=("V",), output_units=("rad/s",), name=f"motor {seed}")


@pytest.fixture(scope="module")
def result():
    options = emsid.Options(free=FREE, fixed={"R": 2.0}, na=1, nb=1, nk=1)
    return emsid.identify(motor(5), motor(6), models=("arx", "rigid-motor"), options=options)


def test_physical_parameters_of_a_recommended_plant_are_on_the_first_screen(result):
    assert (result.chosen.model.name, result.is_recommended) == ("rigid-motor", True)
    rows = {row.name: row for row in result.chosen.table if row.name in result.chosen.names}
    facts = {fact.meaning: fact for fact in report(result).facts}
    for name in FREE:
        row = rows[name]
        (fact,) = (fact for meaning, fact in facts.items() if meaning.startswith(first_up(row.description)))
        assert float(fact.value.split()[0]) == pytest.approx(row.value, rel=1e-3)
        assert float(fact.interval.removeprefix("± ")) == pytest.approx(HALF_WIDTH * row.standard_error, rel=0.05)
    first = [fact.meaning for fact in values(result)][: len(FREE)]
    assert {meaning.split(", given")[0] for meaning in first} == {first_up(rows[name].description) for name in FREE}
    # Nothing of a plant that is not recommended.
    verdict = emsid.findings.Finding("model-unusable", "rigid-motor", result.model_verdicts[0].data)
    unusable = replace(result, model_verdicts=(verdict, *result.model_verdicts[1:]))
    assert not set(first) & {fact.meaning for fact in values(unusable)}


def test_equal_values_forward_and_backward_are_shown_once():
    level = Fact("0.32 V", "Coulomb voltage forward, given R", "± 0.01")
    same = replace(level, meaning="Coulomb voltage backward, given R")
    other = Fact("0.9 V", "Break-away voltage forward", "± 0.05")
    apart = Fact("0.8 V", "Break-away voltage backward", "± 0.05")
    assert [fact.meaning for fact in _once([level, same, other, apart])] == [
        "Coulomb voltage, both directions, given R",
        "Break-away voltage forward",
        "Break-away voltage backward",
    ]


def test_one_table_has_all_models_with_fits_errors_and_verdicts(result):
    (table,) = which_model(result).tables
    rows = {row[0]: dict(zip(table.header, row, strict=True)) for row in table.rows}
    assert set(rows) == {"arx", "rigid-motor"}
    for label, comparison in (("unseen", result.on_unseen), ("used in fit", result.on_record)):
        for row in comparison.rows:
            assert rows[row.model][f"Fit % {label}"] == f"{row.fit_percent:.2f}"
            assert rows[row.model]["Parameters"] == str(row.parameters)
    numbers = {each.model: str(k) for k, each in enumerate(result.front, 1)}
    assert {row["Model"]: row["No."] for row in rows.values()} == {"arx": "–", "rigid-motor": "–"} | numbers
    assert all(("recommended" in row["Verdict"]) == (row["Model"] == "rigid-motor") for row in rows.values())


def test_a_caption_of_one_step_errors_holds_for_this_record():
    rng = np.random.default_rng(0)
    u, noise = rng.uniform(-1, 1, 400), 0.3 * rng.standard_normal(400)
    y = np.zeros(400)
    for k in range(1, 400):
        y[k] = 0.5 * y[k - 1] + u[k - 1]
    record = emsid.Record(u, y + noise, DT)
    comparison = emsid.compare([emsid.fit(emsid.arx(na=1, nb=1), record)], record)
    (row,) = comparison.rows
    share = np.sqrt(row.one_step_mse / row.simulation_mse)
    assert f"The error one step ahead is {share:.2g} times that of the free run." in ranking(comparison).caption
    silent = replace(comparison.assessments[0], row=replace(row, one_step_mse=float("nan")))
    assert "one step" not in ranking(type(comparison)((silent,))).caption


@pytest.mark.parametrize("poles", [[0.99, 0.95 + 0.02j, 0.95 - 0.02j], [0.2, -0.9], [0.9999]])
def test_a_map_of_poles_is_scaled_to_them(poles):
    found = np.array(poles, dtype=complex)
    real, imaginary = (axis.range for axis in around(found))
    assert real[0] < found.real.min()
    assert found.real.max() < real[1]
    assert abs(found.imag).max() < imaginary[1] == -imaginary[0]
    assert real[1] - real[0] == pytest.approx(imaginary[1] - imaginary[0], rel=1e-3)
    extent = max(np.ptp(found.real) / 2, abs(found.imag).max(), NEAREST)
    assert real[1] - real[0] == pytest.approx(2 * ROOM * extent, rel=1e-3)
