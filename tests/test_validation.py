"""Errors computed by hand, and comparisons of models by their free runs on the same samples."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from emsid import (
    DataError,
    Fit,
    ModelError,
    Record,
    RegressionModel,
    Structure,
    arx,
    compare,
    concatenate,
    least_squares,
    recursive_least_squares,
    validate,
)
from emsid.models.free_run import mean_squared_error
from emsid.validation.comparison import Row, assess_model, fit_percent

Array = NDArray[np.float64]


def column(*values: float) -> Array:
    return np.array(values)[:, None]


# --- metrics ---------------------------------------------------------------------------------------------------------


def test_metrics_by_hand() -> None:
    measured, modelled = column(1, 2, 3, 6), column(1, 3, 3, 4)
    # Errors 0, −1, 0, 2; the mean is 3 and the deviations from it −2, −1, 0, 3.
    assert mean_squared_error(measured, modelled) == 5 / 4
    assert fit_percent(measured, modelled) == pytest.approx(100 * (1 - np.sqrt(5 / 14)), rel=1e-15)


def test_several_channels_share_the_mean_squared_error_and_the_mean_fit() -> None:
    measured = np.array([[1.0, 10.0], [3.0, 30.0]])
    modelled = np.array([[1.0, 20.0], [3.0, 20.0]])
    assert mean_squared_error(measured, modelled) == 200 / 4
    assert fit_percent(measured, modelled) == 50.0  # 100 % of the first channel, the mean of the second


@pytest.mark.parametrize(
    ("modelled", "fit"),
    [(column(1, 2, 3), 100.0), (column(2, 2, 2), 0.0), (column(3, 2, 1), -100.0), (column(1, np.nan, 3), -np.inf)],
)
def test_scale_of_the_fit(modelled: Array, fit: float) -> None:
    assert fit_percent(column(1, 2, 3), modelled) == pytest.approx(fit)


def test_fit_does_not_depend_on_unit_or_offset() -> None:
    rng = np.random.default_rng(0)
    y, modelled = rng.standard_normal((2, 50, 1))
    assert fit_percent(1e3 * y + 7, 1e3 * modelled + 7) == pytest.approx(fit_percent(y, modelled), rel=1e-12)


@pytest.mark.parametrize("lost", [np.nan, np.inf, -np.inf])
def test_a_run_that_is_lost_has_an_infinite_error(lost: float) -> None:
    measured, modelled = column(1, 2, 3), column(1, lost, 3)
    assert mean_squared_error(measured, modelled) == np.inf
    assert fit_percent(measured, modelled) == -np.inf


def test_an_output_that_rests() -> None:
    assert np.isnan(fit_percent(column(2, 2, 2), column(2, 2, 2)))
    assert np.isnan(fit_percent(column(2, 2, 2), column(2, 2, 2.1)))
    moving = np.hstack([column(2, 2, 2), column(1, 2, 3)])
    assert fit_percent(moving, moving) == 100.0


# --- comparison ------------------------------------------------------------------------------------------------------


def fit_of(structure: Structure, parameters: list[float]) -> Fit[RegressionModel]:
    model = RegressionModel(structure, np.array(parameters), 0.01)
    n = len(structure)
    return Fit(model, structure.parameter_names, model.parameters, np.eye(n), 1.0, 100.0, 1.0, n)


def bench(samples: int = 400, seed: int = 0) -> Record:
    """A second-order system with output noise."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(samples)
    clean = (
        RegressionModel(arx(2, 1), np.array([-1.5, 0.7, 1.0]), 0.01).simulate(Record(u, np.zeros(samples), 0.01)).output
    )
    return Record(u, clean + 0.05 * rng.standard_normal((samples, 1)), 0.01)


def test_row_holds_the_errors_of_the_counted_samples() -> None:
    fit, record = fit_of(arx(2, 1), [-1.4, 0.6, 0.9]), bench()
    assessment = validate(fit, record, 25, experiment="simulation", data="identification")
    simulation, prediction = fit.model.simulate(record, 25), fit.model.predict(record, 1, 25)
    np.testing.assert_array_equal(assessment.simulation.output, simulation.output)
    np.testing.assert_array_equal(assessment.prediction.output, prediction.output)
    free, one_step, measured = (values[25:] for values in (simulation.output, prediction.output, record.output))
    assert assessment.row == Row(
        experiment="simulation",
        model="arx",
        method="ls",
        data="identification",
        one_step_mse=mean_squared_error(measured, one_step),
        simulation_mse=mean_squared_error(measured, free),
        simulation_rmse=np.sqrt(mean_squared_error(measured, free)),
        fit_percent=fit_percent(measured, free),
        parameters=3,
        samples=375,
    )
    assert assessment.row.one_step_mse < assessment.row.simulation_mse
    assert (assessment.fit, assessment.record) == (fit, record)


def test_samples_that_start_a_segment_are_in_no_error() -> None:
    fit, record = fit_of(arx(2, 1), [-1.4, 0.6, 0.9]), bench()
    pieces = concatenate([record[:100], record[100:103], record[103:250]])
    row = validate(fit, pieces, 10).row
    assert row.samples == 90 + 0 + 137
    errors = [(fit.model.simulate(piece, 10).output - piece.output)[10:] for piece in (record[:100], record[103:250])]
    assert row.simulation_mse == pytest.approx(np.mean(np.concatenate(errors) ** 2), rel=1e-13)


def test_models_are_ranked_by_the_free_run_not_by_the_prediction() -> None:
    """A slow drive: the last output predicts the next one well, but says nothing about the free run."""
    record = bench()
    creeping = Record(record.input, np.cumsum(record.input)[:, None], 0.01)
    as_before = fit_of(Structure.parse("y(t-1)"), [1.0])
    rough = fit_of(Structure.parse("y(t-1)", "u(t-1)", "u(t)"), [0.8, 0.9, 0.1])
    comparison = compare([as_before, rough], creeping)
    first, second = comparison.rows
    assert comparison.fits == (rough, as_before)
    assert comparison.best.fit is rough
    assert first.simulation_mse < second.simulation_mse
    assert first.one_step_mse > second.one_step_mse
    assert comparison.rows == tuple(assessment.row for assessment in comparison.assessments)


def test_all_models_have_errors_on_the_same_samples() -> None:
    record = bench()
    fits = [least_squares(structure, record) for structure in (arx(1, 1), arx(2, 1, nk=7), Structure.parse("u(t)"))]
    assert {row.samples for row in compare(fits, record).rows} == {393}
    assert {row.samples for row in compare(fits, record, transient=3).rows} == {393}
    assert {row.samples for row in compare(fits, record, transient=50).rows} == {350}
    first = next(assessment for assessment in compare(fits, record).assessments if assessment.fit is fits[0])
    assert first.row == validate(fits[0], record, 7).row


def test_rows_say_what_was_compared() -> None:
    record = bench()
    fits = [least_squares(arx(2, 1), record), recursive_least_squares(arx(2, 1), record)]
    rows = compare(fits, record, experiment="experiment", data="identification").rows
    assert {(row.experiment, row.data, row.model, row.parameters) for row in rows} == {
        ("experiment", "identification", "arx", 3)
    }
    assert {row.method for row in rows} == {"ls", "rls"}


def test_a_diverged_model_comes_last_and_its_row_can_be_stored() -> None:
    record = bench()
    unstable, good = fit_of(arx(1, 1), [-2.0, 1.0]), fit_of(arx(2, 1), [-1.5, 0.7, 1.0])
    comparison = compare([unstable, good], record)
    assert comparison.fits == (good, unstable)
    row = comparison.rows[1]
    assert (row.simulation_mse, row.simulation_rmse, row.fit_percent) == (np.inf, np.inf, -np.inf)
    assert row.diverged_at == unstable.model.simulate(record, 2).diverged_at
    assert np.isfinite(row.one_step_mse)
    stored = json.loads(json.dumps(row.to_data(), allow_nan=False))
    assert stored["simulation_mse"] is stored["simulation_rmse"] is stored["fit_percent"] is None
    assert stored["one_step_mse"] == row.one_step_mse
    assert stored["diverged_at"] == row.diverged_at
    assert list(stored) == [field.name for field in fields(Row) if field.name != "outputs"]
    assert comparison.rows[0].to_data()["simulation_mse"] == comparison.rows[0].simulation_mse


def test_table_has_a_line_for_every_model_best_first() -> None:
    record = bench()
    comparison = compare([fit_of(arx(1, 1), [-2.0, 1.0]), fit_of(Structure.parse("u(t-1)"), [0.5])], record)
    _, head, best, last, note = str(comparison).splitlines()
    assert head.split()[:3] == ["Model", "Fitted", "Data"]
    assert best.split()[0] == "structure"
    assert best.split()[5] == f"{comparison.best.row.simulation_rmse:.4g}"
    assert last.split()[:7] == ["arx", "one", "step", "unseen", "–", "–", "–"]
    assert "diverged at sample 17" in note


def test_a_model_from_a_file_is_assessed_without_a_fit() -> None:
    model, record = fit_of(arx(2, 1), [-1.4, 0.6, 0.9]).model, bench()
    row = assess_model(model, record, 25).row
    expected = validate(fit_of(arx(2, 1), [-1.4, 0.6, 0.9]), record, 25).row
    assert row == replace(expected, method="file", parameters=row.parameters)


def test_what_cannot_be_compared_is_refused() -> None:
    fit, record = fit_of(arx(2, 1), [-1.4, 0.6, 0.9]), bench(50)
    with pytest.raises(DataError, match="no segment is longer than the 60 samples that start arx"):
        validate(fit, record, 60)
    with pytest.raises(ModelError, match="longer than the 2 samples that start arx"):
        validate(fit, record[:2])
    with pytest.raises(ModelError, match="resample"):
        compare([fit], replace(record, dt=0.1, times=()))
    with pytest.raises(ModelError, match="no model to compare"):
        compare([], record)
