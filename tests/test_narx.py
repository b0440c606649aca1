"""A structure with parameters: predictions, free runs, divergence, and the way to a file and back."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import lfilter

from emsid import (
    Model,
    ModelError,
    Record,
    RegressionModel,
    Structure,
    arx,
    concatenate,
    friction_narx,
    wiener_hammerstein_regression,
)
from emsid.models.free_run import RUNAWAY
from emsid.models.regression.transforms import Transform
from independent.regressions import free_run_of

Array = NDArray[np.float64]

STRUCTURES = {
    "arx": arx(3, 2),
    "arx, direct, two inputs": arx(2, 2, nk=0, inputs=2),
    "fir": arx(0, 4),
    "static": Structure.parse("u(t)", "u(t)^3", "1"),
    "output only": Structure.parse("y(t-1)", "-y(t-3)", "y(t-2)"),
    "wiener-hammerstein": wiener_hammerstein_regression(2, 2, 3, taps=2),
    "friction": friction_narx(2, 2, knots=(-0.3, 0.3), speeds=(0.2,)),
    "smooth friction": friction_narx(1, 1, sign=Transform.TANH, width=0.1),
    "bilinear": Structure.parse("y(t-1)*u(t-2)^2", "max(y(t-2)-0.1, 0)^2*u(t)", "-abs(u(t-1))", "min(u(t)+0.2, 0)"),
}


@pytest.fixture(params=list(STRUCTURES))
def structure(request: pytest.FixtureRequest) -> Structure:
    return STRUCTURES[request.param]


def model_of(structure: Structure, seed: int = 0) -> RegressionModel:
    """Stable: what is fed back adds up to less than one."""
    theta = np.random.default_rng(seed).uniform(-1, 1, len(structure))
    fed_back = np.array([any(f.channel == 0 for f in regressor.factors) for regressor in structure.regressors])
    if fed_back.any():
        theta[fed_back] *= 0.7 / np.abs(theta[fed_back]).sum()
    return RegressionModel(structure, theta, 0.01)


def measured(structure: Structure, samples: int = 80, seed: int = 1) -> Record:
    rng = np.random.default_rng(seed)
    return Record(rng.uniform(-1, 1, (samples, max(1, structure.inputs))), rng.uniform(-1, 1, samples), 0.01)


# --- free run --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("transient", [None, 0, 17])
def test_free_run_is_the_definition(structure: Structure, transient: int | None) -> None:
    model, record = model_of(structure), measured(structure)
    start = max(structure.memory, transient or 0)
    run = model.simulate(record, transient)
    np.testing.assert_allclose(run.output[:, 0], free_run_of(model, record, start), rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(run.output[:start], record.output[:start])
    np.testing.assert_array_equal(run.counted, np.arange(80) >= start)
    assert run.diverged_at is None


@pytest.mark.parametrize(("na", "nb", "nk"), [(0, 3, 1), (1, 1, 1), (4, 4, 1), (2, 3, 0), (3, 1, 5)])
def test_linear_free_run_is_a_digital_filter(na: int, nb: int, nk: int) -> None:
    structure = arx(na, nb, nk)
    model = model_of(structure)
    u = np.random.default_rng(2).standard_normal(500)
    u[: structure.memory] = 0.0
    run = model.simulate(Record(u, np.zeros(500), 0.01))
    a, b = model.parameters[:na], model.parameters[na:]
    expected = lfilter(np.concatenate([np.zeros(nk), b]), np.concatenate([[1.0], a]), u)
    np.testing.assert_allclose(run.output[:, 0], expected, rtol=1e-10, atol=1e-13)


def test_free_run_does_not_see_measured_outputs_after_its_start(structure: Structure) -> None:
    model, record = model_of(structure), measured(structure)
    other = record.output.copy()
    other[structure.memory :] *= -0.5
    np.testing.assert_array_equal(
        model.simulate(replace(record, output=other)).output[structure.memory :],
        model.simulate(record).output[structure.memory :],
    )


def test_every_segment_starts_anew_and_short_ones_are_left_out(structure: Structure) -> None:
    model = model_of(structure)
    pieces = [measured(structure, 40 + seed, seed)[:samples] for seed, samples in enumerate((30, 4, 25, 5))]
    record = concatenate(pieces)
    for transient in (4, 20):
        run = model.simulate(record, transient)
        prediction = model.predict(record, 3, transient)
        offset = 0
        for piece in pieces:
            rows = slice(offset, offset + len(piece))
            offset += len(piece)
            if len(piece) > transient:
                np.testing.assert_array_equal(run.output[rows], model.simulate(piece, transient).output)
                np.testing.assert_array_equal(prediction.output[rows], model.predict(piece, 3, transient).output)
                np.testing.assert_array_equal(run.counted[rows], np.arange(len(piece)) >= transient)
            else:
                np.testing.assert_array_equal(run.output[rows], piece.output)
                assert not run.counted[rows].any()
        np.testing.assert_array_equal(prediction.counted, run.counted)


# --- prediction ------------------------------------------------------------------------------------------------------


def test_one_step_prediction_is_the_regression(structure: Structure) -> None:
    model, record = model_of(structure), measured(structure)
    phi, _ = structure.regression(record)
    run = model.predict(record)
    np.testing.assert_allclose(run.output[structure.memory :, 0], phi @ model.parameters, rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(run.output[: structure.memory], record.output[: structure.memory])


@pytest.mark.parametrize("transient", [None, 12])
@pytest.mark.parametrize("horizon", [2, 3, 7, 40])
def test_prediction_is_a_short_free_run_from_measured_outputs(
    structure: Structure, horizon: int, transient: int | None
) -> None:
    model, record = model_of(structure), measured(structure)
    start = max(structure.memory, transient or 0)
    expected = record.output[:, 0].copy()
    for t in range(start, len(record)):
        first = max(t - horizon + 1, structure.memory)
        expected[t] = free_run_of(model, record[: t + 1], first)[t]
    found = model.predict(record, horizon, transient).output[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("horizon", [80, 81, 1000])
def test_prediction_over_the_whole_record_is_the_free_run(structure: Structure, horizon: int) -> None:
    model, record = model_of(structure), measured(structure)
    np.testing.assert_allclose(
        model.predict(record, horizon).output, model.simulate(record).output, rtol=1e-13, atol=1e-15
    )


@pytest.mark.parametrize("horizon", [1, 2, 5])
def test_prediction_uses_no_output_nearer_than_its_horizon(structure: Structure, horizon: int) -> None:
    model, record = model_of(structure), measured(structure)
    other = record.output.copy()
    other[50:] += 0.3
    before = model.predict(record, horizon).output
    after = model.predict(replace(record, output=other), horizon).output
    np.testing.assert_array_equal(after[: 50 + horizon][structure.memory :], before[: 50 + horizon][structure.memory :])
    if structure.memory and any(any(f.channel == 0 for f in regressor.factors) for regressor in structure.regressors):
        assert np.any(after[50 + horizon :] != before[50 + horizon :])


@pytest.mark.parametrize("horizon", [0, -1, 1.5, "2"])
def test_only_whole_horizons_are_predicted(horizon: int) -> None:
    model = model_of(arx(1, 1))
    with pytest.raises(ModelError, match=f"horizon of {horizon}; give a whole number"):
        model.predict(measured(arx(1, 1)), horizon)


@pytest.mark.parametrize("transient", [-1, 2.5])
def test_only_whole_transients_start_a_run(transient: int) -> None:
    model = model_of(arx(1, 1))
    with pytest.raises(ModelError, match=f"transient of {transient}; give a whole number"):
        model.simulate(measured(arx(1, 1)), transient)


# --- divergence ------------------------------------------------------------------------------------------------------


def unstable() -> RegressionModel:
    """y doubles every sample."""
    return RegressionModel(arx(1, 1), np.array([-2.0, 1.0]), 0.01)


def test_a_diverged_run_has_its_sample_and_is_nan_to_the_end_of_its_segment() -> None:
    rng = np.random.default_rng(3)
    y = rng.uniform(-0.5, 0.5, 100)
    y[[0, 40, 45]], y[77] = 0.25, 1.0  # bound: RUNAWAY · 1
    record = Record(np.zeros(100), y, 0.01, breaks=(40, 45))
    run = unstable().simulate(record)
    steps = int(np.floor(np.log2(RUNAWAY / 0.25))) + 1  # the first with 0.25·2ᵏ > RUNAWAY
    assert run.diverged_at == steps
    np.testing.assert_allclose(run.output[:steps, 0], 0.25 * 2.0 ** np.arange(steps), rtol=1e-14)
    assert np.isnan(run.output[steps:40]).all()
    np.testing.assert_allclose(run.output[40:45, 0], 0.25 * 2.0 ** np.arange(5), rtol=1e-14)
    assert np.isfinite(run.output[: 45 + steps][45:]).all()
    assert np.isnan(run.output[45 + steps :]).all()
    np.testing.assert_array_equal(run.counted, ~np.isin(np.arange(100), (0, 40, 45)))


def test_a_run_that_overflows_is_reported_without_a_warning() -> None:
    structure = Structure.parse("y(t-1)^3", "u(t-1)")
    record = Record(np.full(60, 0.1), np.full(60, 1.5), 0.01)
    run = RegressionModel(structure, np.array([1.0, 1.0]), 0.01).simulate(record)
    assert run.diverged_at is not None
    assert 1 < run.diverged_at < 8
    assert np.isnan(run.output[run.diverged_at :]).all()


def test_predictions_of_an_unstable_model_stay() -> None:
    run = unstable().predict(measured(arx(1, 1)), 5)
    assert run.diverged_at is None
    assert np.isfinite(run.output).all()


def test_without_a_known_output_only_an_overflow_is_a_divergence() -> None:
    u = np.ones(3000)
    stable = RegressionModel(arx(1, 1), np.array([-0.5, 1.0]), 0.01).simulate(Record(u, np.zeros(3000), 0.01))
    assert stable.diverged_at is None
    assert stable.output[-1, 0] == pytest.approx(2.0, rel=1e-14)
    run = unstable().simulate(Record(u, np.zeros(3000), 0.01))
    assert run.diverged_at == 1024  # y(k) = 2ᵏ − 1, and 2¹⁰²⁴ is beyond the largest double
    assert np.isnan(run.output[1024:]).all()


# --- value, equation, file -------------------------------------------------------------------------------------------


def test_it_is_a_model(structure: Structure) -> None:
    model = model_of(structure)
    assert isinstance(model, Model)
    assert (model.name, model.memory) == (structure.name, structure.memory)
    assert model.equation() == structure.equation(model.parameters)


def test_parameters_are_its_own_and_frozen() -> None:
    given_values = np.array([0.5, 1.0])
    model = RegressionModel(arx(1, 1), given_values, 0.01)
    given_values[0] = 9.0
    assert model.parameters[0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        model.parameters[0] = 1.0


def through_json(model: RegressionModel) -> RegressionModel:
    return RegressionModel.from_data(json.loads(json.dumps(model.to_data(), allow_nan=False)))


def test_a_model_is_saved_and_loaded(structure: Structure) -> None:
    model = replace(model_of(structure), dt=1 / 3)
    again = through_json(model)
    assert again.structure == model.structure
    np.testing.assert_array_equal(again.parameters, model.parameters)
    assert again.dt == model.dt
    assert again.to_data() == model.to_data()


@settings(max_examples=60, derandomize=True, deadline=None)
@given(
    st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=1, max_size=3, unique=True),
    st.floats(1e-6, 1e6),
    st.floats(1e-9, 1e3),
)
def test_file_keeps_every_bit(knots: list[float], speed: float, dt: float) -> None:
    structure = friction_narx(1, 1, knots=knots, speeds=(speed,), sign=Transform.TANH, width=speed / 3)
    theta = np.random.default_rng(0).standard_normal(len(structure))
    again = through_json(RegressionModel(structure, theta, dt))
    assert again.structure == structure
    assert again.dt == dt
    np.testing.assert_array_equal(again.parameters, theta)


VALID = RegressionModel(arx(1, 1), np.array([0.5, 1.0]), 0.01).to_data()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"regressors": ["y(t-1)", "open('x')"]}, "not a lagged channel"),
        ({"regressors": ["y(t)", "u(t)"]}, "cannot look ahead"),
        ({"regressors": []}, "at least one regressor"),
        ({"regressors": "y(t-1)"}, "not a regression model"),
        ({"regressors": ["y(t-1)"]}, "2 parameter names for 1 regressors"),
        ({"parameters": [1.0]}, r"\(1,\) parameters for 2 regressors"),
        ({"parameters": [1.0, "2"]}, "not a regression model"),
        ({"parameters": [1.0, None]}, "not a regression model"),
        ({"parameters": [1.0, float("inf")]}, "must be finite"),
        ({"parameter_names": ["a1"]}, "1 parameter names"),
        ({"dt": 0.0}, "sample time"),
        ({"dt": -0.01}, "sample time"),
        ({"dt": "fast"}, "not a regression model"),
        ({"inputs": 1.5}, "not a regression model"),
        ({"surprise": 1}, "not a regression model"),
    ],
)
def test_data_that_do_not_describe_a_model_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        RegressionModel.from_data({**VALID, **change})


@pytest.mark.parametrize("missing", list(VALID))
def test_data_with_something_missing_are_refused(missing: str) -> None:
    with pytest.raises(ModelError, match=missing):
        RegressionModel.from_data({name: value for name, value in VALID.items() if name != missing})


# --- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (Record(np.ones((9, 2)), np.ones(9), 0.02), "identified at 0.01 s and record is sampled every 0.02 s"),
        (Record(np.ones(9), np.ones(9), 0.01), "uses input u2"),
        (Record(np.ones((9, 2)), np.ones((9, 2)), 0.01), "one output"),
        (Record(np.ones((2, 2)), np.ones(2), 0.01), "longer than the 2 samples that start arx"),
    ],
)
def test_records_it_cannot_be_run_on_are_refused(record: Record, message: str) -> None:
    model = model_of(arx(2, 1, inputs=2))
    for use in (model.simulate, model.predict):
        with pytest.raises(ModelError, match=message):
            use(record)


def test_a_sample_time_that_differs_by_rounding_is_accepted() -> None:
    structure = arx(1, 1)
    assert model_of(structure).simulate(replace(measured(structure), dt=0.010001, times=())).diverged_at is None


@pytest.mark.parametrize("parameters", [[1.0], [1.0, 2.0, 3.0], [[1.0, 2.0]], [1.0, np.nan], [np.inf, 1.0]])
def test_parameters_that_do_not_fit_are_refused(parameters: list[float]) -> None:
    with pytest.raises(ModelError, match="parameters"):
        RegressionModel(arx(1, 1), np.array(parameters), 0.01)


def test_a_nonlinear_model_is_at_rest_where_its_run_settles() -> None:
    saturating = Structure.parse("y(t-1)", "tanh(y(t-1)/1)", "u(t-1)")
    for slope, level in ((0.5, 2.0), (0.999, 0.001), (0.5, 0.0)):
        model = RegressionModel(saturating, np.array([slope, -0.1, 0.4]), 0.01)
        y = model.at_rest(level)[-1, 0]
        assert slope * y - 0.1 * np.tanh(y) + 0.4 * level == pytest.approx(y, abs=1e-9)
    cycling = RegressionModel(Structure.parse("sign(y(t-1))", "u(t-1)"), np.array([-1.0, 0.1]), 0.01)
    assert cycling.at_rest(1.0)[-1, 0] == 0.0  # it goes on between two values
