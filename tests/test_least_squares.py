"""Batch least squares: exact recovery, invariances, uncertainty, and findings on data that do not suffice."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from emsid import (
    DataError,
    Ending,
    Information,
    ModelError,
    Record,
    RegressionModel,
    Structure,
    arx,
    concatenate,
    friction_narx,
    least_squares,
    wiener_hammerstein_regression,
)
from emsid.estimation.linear import least_squares as module
from emsid.estimation.linear.least_squares import gather
from emsid.findings import Finding
from emsid.models.regression import narx
from emsid.models.regression.regressors import Factor, Regressor
from emsid.models.regression.transforms import Transform

Array = NDArray[np.float64]


def white(samples: int, channels: int = 1, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (samples, channels))


def response(structure: Structure, theta: Array, samples: int = 600, seed: int = 0, noise: float = 0.0) -> Record:
    """A record that the structure made itself, with equation noise if asked for."""
    rng = np.random.default_rng(seed + 1000)
    u = white(samples, structure.inputs, seed)
    y = np.zeros((samples, 1))
    y[: structure.memory, 0] = rng.uniform(-0.5, 0.5, structure.memory)
    if not noise:
        return replace(
            Record(u, y, 0.01), output=RegressionModel(structure, theta, 0.01).simulate(Record(u, y, 0.01)).output
        )
    disturbed = Structure(
        (*structure.regressors, Regressor((Factor(structure.inputs + 1, 0),))),
        inputs=structure.inputs + 1,
    )
    extended = Record(np.column_stack([u, noise * rng.standard_normal(samples)]), y, 0.01)
    return Record(u, RegressionModel(disturbed, np.append(theta, 1.0), 0.01).simulate(extended).output, 0.01)


def some_parameters(structure: Structure, seed: int = 0) -> Array:
    """Parameters of a stable model: of the lagged outputs together below one."""
    theta = np.random.default_rng(seed).uniform(0.3, 1.0, len(structure)) * (-1.0) ** np.arange(len(structure))
    fed_back = np.array([any(f.channel == 0 for f in regressor.factors) for regressor in structure.regressors])
    theta[fed_back] *= 0.6 / max(1.0, np.abs(theta[fed_back]).sum())
    return theta


STRUCTURES = {
    **{f"arx {na} {nb} {nk}": arx(na, nb, nk) for na in (0, 1, 2, 4) for nb in (1, 4) for nk in (0, 1, 3)},
    "arx without input terms": arx(2, 0) + Structure.parse("u(t-1)"),
    "arx, two inputs": arx(2, 2, inputs=2),
    "paper (5.10)": wiener_hammerstein_regression(4, 3, 2),
    "wiener-hammerstein, three taps": wiener_hammerstein_regression(2, 2, 2, taps=3),
    "wiener-hammerstein, cubic": wiener_hammerstein_regression(1, 2, 3, taps=2),
    "wiener-hammerstein, powers only": wiener_hammerstein_regression(2, 3, 3, taps=3, cross_terms=False),
    "friction, hard sign": friction_narx(2, 2, knots=(-0.5, 0.5)),
    "friction, smooth sign": friction_narx(1, 1, knots=(0.2, 0.6), sign=Transform.TANH, width=0.1),
    "friction, Stribeck": friction_narx(2, 1, knots=(-0.3,), speeds=(0.2, 1.0)),
    "parsed": Structure.parse("y(t-1)*u(t-2)^2", "sign(y(t-1))", "max(u(t-1)-0.3, 0)", "-abs(u(t-3))*y(t-2)", "1"),
}


@pytest.fixture(params=list(STRUCTURES))
def structure(request: pytest.FixtureRequest) -> Structure:
    return STRUCTURES[request.param]


# --- exact recovery and invariances ----------------------------------------------------------------------------------


def test_true_parameters_come_back_from_noise_free_data(structure: Structure) -> None:
    theta = some_parameters(structure)
    fit = least_squares(structure, response(structure, theta))
    assert (fit.ending, fit.findings, fit.rank) == (Ending.SOLVED, (), len(structure))
    np.testing.assert_allclose(fit.estimate, theta, rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(fit.model.parameters, fit.estimate)
    assert fit.names == structure.parameter_names
    assert fit.samples == 600 - structure.memory


def test_estimate_is_that_of_numpy_on_the_whole_regression(structure: Structure) -> None:
    record = response(structure, some_parameters(structure), noise=0.1)
    phi, y = structure.regression(record)
    expected, squares, _, _ = np.linalg.lstsq(phi, y, rcond=None)
    fit = least_squares(structure, record)
    np.testing.assert_allclose(fit.estimate, expected, rtol=1e-9, atol=1e-11)
    assert fit.noise_variance == pytest.approx(float(squares[0]) / (len(y) - len(expected)), rel=1e-10)


def test_segments_and_records_are_experiments_of_one_problem(structure: Structure) -> None:
    theta = some_parameters(structure)
    pieces = [response(structure, theta, samples, seed=samples, noise=0.2) for samples in (150, 400, 90)]
    rows = [structure.regression(piece) for piece in pieces]
    expected = np.linalg.lstsq(np.vstack([phi for phi, _ in rows]), np.concatenate([y for _, y in rows]), rcond=None)[0]
    merged = Information.empty(len(structure))
    for phi, y in rows:
        merged = merged.merge(Information.from_rows(phi, y))
    for records in (pieces, (piece for piece in pieces), concatenate(pieces)):
        fit = least_squares(structure, records)
        np.testing.assert_allclose(fit.estimate, expected, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(fit.estimate, merged.solve().estimate, rtol=1e-10, atol=1e-12)
        assert fit.samples == merged.samples


def test_a_cut_loses_only_the_rows_across_it() -> None:
    structure = arx(3, 2)
    record = response(structure, some_parameters(structure), noise=0.2)
    cut = replace(record, breaks=(300,), times=())
    phi, y = structure.regression(record)
    across = np.arange(300 - 3, 300)  # the rows whose samples 300, 301, 302 look back over the cut
    expected = np.linalg.lstsq(np.delete(phi, across, axis=0), np.delete(y, across), rcond=None)[0]
    np.testing.assert_allclose(least_squares(structure, cut).estimate, expected, rtol=1e-10)


def test_result_does_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    structure = arx(3, 3)
    record = response(structure, some_parameters(structure), samples=5000, noise=0.3)
    monkeypatch.setattr(module, "CHUNK", 700)
    results = [least_squares(structure, record, threads=threads) for threads in (1, 2, 3, None)]
    for fit in results[1:]:
        np.testing.assert_array_equal(fit.estimate, results[0].estimate)
        np.testing.assert_array_equal(fit.covariance, results[0].covariance)


@pytest.mark.parametrize(("chunk", "block"), [(1, 1), (7, 3), (1000, 64), (10**6, 10**6)])
def test_result_depends_on_sizes_of_chunks_and_blocks_by_rounding_only(
    monkeypatch: pytest.MonkeyPatch, chunk: int, block: int
) -> None:
    structure = friction_narx(2, 2, knots=(0.4,))
    record = response(structure, some_parameters(structure), samples=900, noise=0.1)
    expected = least_squares(structure, record)
    monkeypatch.setattr(module, "CHUNK", chunk)
    monkeypatch.setattr(narx, "BLOCK", block)
    fit = least_squares(structure, record)
    np.testing.assert_allclose(fit.estimate, expected.estimate, rtol=1e-11)
    assert fit.noise_variance == pytest.approx(expected.noise_variance, rel=1e-11)


# --- options ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("refinements", [0, 2])
def test_ridge_is_the_closed_form(refinements: int) -> None:
    structure = arx(2, 2)
    record = response(structure, some_parameters(structure), noise=0.1)
    phi, y = structure.regression(record)
    closed = np.linalg.solve(phi.T @ phi + 20.0 * np.eye(4), phi.T @ y)
    fit = least_squares(structure, record, ridge=20.0, refinements=refinements)
    np.testing.assert_allclose(fit.estimate, closed, rtol=1e-11)
    assert np.linalg.norm(fit.estimate) < np.linalg.norm(least_squares(structure, record).estimate)


def nearly_dependent() -> tuple[Structure, Array, Record]:
    """Noise-free data in which u2 is u but for a millionth, so that every input is seen twice."""
    structure, theta = arx(2, 2, inputs=2), np.array([-0.5, 0.25, 1.0, -0.75, 0.5, 2.0])
    u = white(800)
    inputs = np.column_stack([u, u + 1e-6 * white(800, seed=1)])
    record = Record(inputs, np.zeros(800), 0.01)
    return structure, theta, replace(record, output=RegressionModel(structure, theta, 0.01).simulate(record).output)


def test_refinement_recovers_digits_of_an_ill_conditioned_problem() -> None:
    structure, theta, record = nearly_dependent()
    plain, refined = least_squares(structure, record), least_squares(structure, record, refinements=3)
    assert plain.condition > 1e6
    lost, left = np.abs(plain.estimate - theta).max(), np.abs(refined.estimate - theta).max()
    assert lost < 1e-8
    assert left < 0.2 * lost
    # What is left is the rounding of the record itself, not of the solution.
    phi, y = structure.regression(record)
    residual = (y.astype(np.longdouble) - phi.astype(np.longdouble) @ refined.estimate).astype(float)
    further = np.linalg.lstsq(phi, residual, rcond=None)[0]
    assert np.abs(further).max() < 0.01 * lost


def test_refinement_goes_through_a_generator_by_keeping_its_records() -> None:
    structure, _, record = nearly_dependent()
    again = least_squares(structure, (piece for piece in [record]), refinements=3)
    np.testing.assert_array_equal(again.estimate, least_squares(structure, record, refinements=3).estimate)


def test_rank_tolerance_is_passed_on() -> None:
    structure, _, record = nearly_dependent()
    assert least_squares(structure, record).rank == 6
    fit = least_squares(structure, record, rank_tolerance=1e-4)
    assert (fit.rank, fit.ending) == (4, Ending.RANK_DEFICIENT)


# --- uncertainty -----------------------------------------------------------------------------------------------------


def test_intervals_cover_the_truth_at_their_nominal_level() -> None:
    structure, theta = arx(1, 2), np.array([-0.7, 0.5, 0.2])
    trials, inside, errors, claimed = 250, np.zeros(3), [], []
    record = response(structure, theta, 200 * trials, noise=0.3)
    for trial in range(trials):
        fit = least_squares(structure, record[200 * trial : 200 * (trial + 1)], threads=1)
        low, high = fit.interval(0.95).T
        inside += (low < theta) & (theta < high)
        errors.append(fit.estimate - theta)
        claimed.append(fit.covariance)
    spread = np.sqrt(trials * 0.95 * 0.05)
    assert np.all(np.abs(inside - 0.95 * trials) < 3.5 * spread)
    # The scatter of 250 estimates has itself a relative standard deviation of 1/√500.
    ratio = np.std(errors, axis=0) / np.sqrt(np.diag(np.mean(claimed, axis=0)))
    np.testing.assert_allclose(ratio, 1.0, atol=4 / np.sqrt(2 * trials))


def test_noise_variance_is_that_of_the_equation_error() -> None:
    structure = arx(2, 2)
    fit = least_squares(structure, response(structure, some_parameters(structure), 20_000, noise=0.3))
    assert fit.noise_variance == pytest.approx(0.09, rel=5 * np.sqrt(2 / 20_000))


# --- what the data cannot tell ---------------------------------------------------------------------------------------


def test_linearly_dependent_regressors_are_named() -> None:
    structure = Structure.parse("y(t-1)", "u(t-1)", "abs(u(t-1))", "u(t-2)")
    record = response(structure, np.array([0.5, 1.0, 0.3, 0.2]))
    positive = replace(record, input=np.abs(record.input))
    fit = least_squares(structure, positive)
    assert fit.ending is Ending.RANK_DEFICIENT
    assert fit.rank == 3
    (found,) = fit.findings
    assert found.code == "rank-deficient"
    assert (found.data["rank"], found.data["parameters"], found.data["zero"]) == (3, 4, [])
    (pair,) = found.data["alike"]
    assert {pair["regressor"], *pair["like"]} == {"u(t-1)", "abs(u(t-1))"}
    assert np.count_nonzero(fit.estimate == 0.0) == 1


def test_a_regressor_that_never_acts_is_named_alone() -> None:
    structure = Structure.parse("y(t-1)", "u(t-1)", "max(u(t-1)-5, 0)")
    fit = least_squares(structure, response(structure, np.array([0.5, 1.0, 1.0])))
    data = {"rank": 2, "parameters": 3, "zero": ["max(u(t-1)-5, 0)"], "alike": []}
    assert fit.findings == (Finding("rank-deficient", data=data),)
    np.testing.assert_allclose(fit.estimate, [0.5, 1.0, 0.0], atol=1e-10)
    assert fit.model.equation() == "y(t) = 0.5*y(t-1) + 1*u(t-1) + e(t)"


def test_zero_regressors_and_combinations_are_named_apart() -> None:
    more = ("max(u(t-1)-9, 0)", "u(t-2)", *(f"max(u(t-{k})+{level}, 0)" for k in (1, 2) for level in (6, 7, 8, 9)))
    structure = Structure.parse("y(t-1)", "u(t-1)", *more)
    (found,) = least_squares(structure, response(structure, np.array([0.5, 1.0, *np.zeros(len(more))]))).findings
    assert found.data["zero"] == ["max(u(t-1)-9, 0)"]
    assert len(found.data["alike"]) == 7
    assert all(pair["regressor"] not in pair["like"] for pair in found.data["alike"])


@pytest.mark.parametrize(("samples", "few"), [(20, True), (40, False)])
def test_few_samples_for_many_parameters_are_found(samples: int, few: bool) -> None:
    rng = np.random.default_rng(3)
    record = Record(rng.standard_normal(samples), rng.standard_normal(samples), 0.01)
    fit = least_squares(arx(4, 4), record)
    data = {"samples": fit.samples, "parameters": 8}
    assert fit.findings == ((Finding("few-samples", data=data),) if few else ())


def test_a_sine_excites_two_parameters_of_an_input_filter() -> None:
    t = np.arange(500)
    u = np.sin(0.3 * t)
    fit = least_squares(arx(0, 5), Record(u, np.convolve(u, [0, 1, 0.5, 0.2])[:500], 0.01)[5:])
    assert fit.rank == 2


@pytest.mark.parametrize(
    ("record", "error", "message"),
    [
        (Record(np.full(50, 2.5), np.arange(50.0), 0.1), DataError, r"input 'u1' is constant at 2\.5"),
        (Record(np.arange(50.0), np.zeros(50), 0.1), DataError, "output 'y1' is constant at 0"),
        (Record(np.arange(3.0), np.arange(3.0), 0.1), ModelError, "3 samples; arx looks back 4"),
        (Record(np.arange(8.0), np.arange(8.0), 0.1), DataError, "4 usable samples for the 8 parameters of arx"),
        (Record(np.arange(50.0), np.ones((50, 2)), 0.1), ModelError, "one output"),
        (Record(np.ones((50, 0)), np.arange(50.0), 0.1), ModelError, "uses input u1"),
    ],
)
def test_records_that_do_not_suffice_are_refused(record: Record, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        least_squares(arx(4, 4), record)


def test_no_record_is_refused() -> None:
    with pytest.raises(DataError, match="no record"):
        least_squares(arx(1, 1), [])


def test_experiments_with_different_channels_are_refused() -> None:
    structure = arx(1, 1)
    record = response(structure, np.array([-0.5, 1.0]))
    with pytest.raises(DataError, match="sampled every"):
        least_squares(structure, [record, replace(record, dt=0.02, times=())])
    with pytest.raises(DataError, match="input units"):
        least_squares(structure, [record, replace(record, input_units=("V",))])


def test_regressors_that_overflow_are_refused() -> None:
    record = Record(1e5 * white(60), white(60, seed=1), 0.1)
    with pytest.raises(DataError, match="overflow"):
        least_squares(Structure.parse("u(t-1)^80", "y(t-1)"), record)


# --- memory ----------------------------------------------------------------------------------------------------------


def test_memory_use_is_that_of_one_record_at_a_time() -> None:
    structure = arx(4, 4)

    def experiments(count: int) -> Iterator[Record]:
        for seed in range(count):
            yield Record(white(20_000, seed=seed), white(20_000, seed=seed + 50), 0.01)

    def peak(count: int) -> int:
        tracemalloc.start()
        gather(structure, experiments(count), threads=2)
        _, highest = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return highest

    peak(1)  # compiles
    few, many = peak(4), peak(40)
    assert many < 1.2 * few


def test_memory_use_beyond_the_data_does_not_grow_with_the_samples() -> None:
    structure = arx(4, 4)

    def peak(samples: int) -> int:
        record = Record(white(samples), white(samples, seed=1), 0.01)
        tracemalloc.start()
        gather(structure, record, threads=2)
        _, highest = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return highest

    peak(1000)
    short, long = peak(400_000), peak(1_600_000)
    assert long - short < 0.005 * 1_200_000 * 16  # of what the data themselves have grown: a list of chunks
    assert long < 0.02 * 1_600_000 * 8  # of one column of the regression


@pytest.mark.parametrize("ridge", [-1.0, np.nan, np.inf])
def test_an_invalid_ridge_is_refused(ridge: float) -> None:
    record = Record(np.sin(np.arange(50.0)), np.cos(np.arange(50.0)), 0.1)
    with pytest.raises(ModelError, match="ridge"):
        least_squares(arx(1, 1), record, ridge=ridge)


@pytest.mark.parametrize("size", [1e300, 1e-300])
def test_channels_that_would_overflow_are_refused(size: float) -> None:
    record = Record(size * np.sin(np.arange(50.0)), np.cos(np.arange(50.0)), 0.1)
    with pytest.raises(DataError, match="ordinary size"):
        least_squares(arx(1, 1), record)
