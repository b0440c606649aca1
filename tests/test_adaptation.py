"""Rules of adaptation: each is its definition, in pieces of any size, saved and restored, without excitation."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import emsid
from emsid import ModelError, Record, RecursiveLeastSquares, RecursiveState, arx, friction_narx
from emsid.estimation import Directional, Drift, Forgetting, Frozen, Gradient, Rule, Window
from emsid.estimation.linear.adaptation import adaptation_reference
from emsid.estimation.linear.recursive_kernels import update

Array = NDArray[np.float64]

RULES: dict[str, Rule] = {
    "forgetting": Forgetting(0.98),
    "directional": Directional(0.98),
    "drift": Drift(1e-4),
    "window": Window(60),
    "gradient": Gradient(0.5),
    "frozen": Frozen(),
}
every_rule = pytest.mark.parametrize("rule", RULES.values(), ids=list(RULES))
STRUCTURE = arx(2, 1)
TRUE = np.array([-1.2, 0.5, 0.8])


def measured(samples: int = 400, seed: int = 0, noise: float = 0.05, theta: Array = TRUE) -> Record:
    """An input, and the output of a structure with noise in its equation."""
    rng = np.random.default_rng(seed)
    u, e = rng.uniform(-1, 1, samples), noise * rng.standard_normal(samples)
    y = np.zeros(samples)
    for t in range(2, samples):
        y[t] = -theta[0] * y[t - 1] - theta[1] * y[t - 2] + theta[2] * u[t - 1] + e[t]
    return Record(u, y, 0.01)


def assert_same(one: RecursiveState, other: RecursiveState) -> None:
    for name in ("estimate", "factor", "diagonal", "totals", "window"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@every_rule
def test_every_rule_is_its_definition(rule: Rule) -> None:
    record = measured()
    recursion, history = RecursiveLeastSquares(STRUCTURE, rule=rule, initial_covariance=1e6), []
    state = recursion.update(recursion.start(), record, history)
    expected, covariance = adaptation_reference(rule, *STRUCTURE.regression(record), 1e6 * np.eye(3))
    np.testing.assert_allclose(history[0], expected, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(state.normalised_covariance, covariance, rtol=1e-6, atol=1e-8 * covariance.max())


@every_rule
@pytest.mark.parametrize("structure", [arx(2, 2), friction_narx(1, 1, knots=(-0.3, 0.3))], ids=["arx", "friction"])
def test_pieces_of_any_size_give_the_same_numbers(rule: Rule, structure: emsid.Structure) -> None:
    record = measured()
    recursion = RecursiveLeastSquares(structure, rule=rule)
    whole_residuals: list[Array] = []
    whole = recursion.update(recursion.start(), record, residuals=whole_residuals)
    state, first, residuals = recursion.start(), 0, []
    for size in (1, 1, 1, 5, 150, 2, 240):
        state = recursion.update(state, record[first : first + size], residuals=residuals)
        first += size
    assert_same(state, whole)
    np.testing.assert_array_equal(np.concatenate(residuals), whole_residuals[0])


@every_rule
def test_a_state_is_saved_and_restored_bit_for_bit(rule: Rule) -> None:
    record = measured()
    recursion = RecursiveLeastSquares(STRUCTURE, rule=rule)
    state = recursion.update(recursion.start(), record[:201], [])
    restored = RecursiveState.from_data(json.loads(json.dumps(state.to_data())))
    assert_same(restored, state)
    assert_same(recursion.update(restored, record[201:], []), recursion.update(state, record[201:], []))


def test_what_is_no_state_is_refused() -> None:
    data = RecursiveLeastSquares(STRUCTURE).start().to_data()
    for wrong in ({"estimate": [1.0]}, {"diagonal": [1.0, -1.0, 1.0]}, {"factor": [[np.nan] * 3] * 3}, {"place": "x"}):
        with pytest.raises(ModelError, match="not a state"):
            RecursiveState.from_data(data | wrong)
    with pytest.raises(ModelError, match="not a state"):
        RecursiveState.from_data({})


def test_residuals_are_those_before_and_after_the_sample() -> None:
    record = measured()
    phi, y = STRUCTURE.regression(record)
    recursion, history, residuals = RecursiveLeastSquares(STRUCTURE, 0.97), [], []
    recursion.update(recursion.start(), record, history, residuals)
    before = np.vstack([np.zeros(3), history[0][:-1]])
    np.testing.assert_allclose(residuals[0][:, 0], y - np.sum(phi * before, axis=1), atol=1e-12)
    np.testing.assert_allclose(residuals[0][:, 1], y - np.sum(phi * history[0], axis=1), atol=1e-12)


def test_a_frozen_estimate_stays_and_resumes() -> None:
    record = measured()
    recursion = RecursiveLeastSquares(STRUCTURE, 0.98)
    state = recursion.update(recursion.start(), record[:200])
    residuals: list[Array] = []
    frozen = replace(recursion, forgetting=1.0, rule=Frozen()).update(state, record[200:300], residuals=residuals)
    np.testing.assert_array_equal(frozen.estimate, state.estimate)
    np.testing.assert_array_equal(frozen.covariance, state.covariance)
    assert frozen.idle == 100
    phi, y = STRUCTURE.regression(record[198:300])
    np.testing.assert_allclose(residuals[0][:, 0], y - phi @ state.estimate, atol=1e-12)
    resumed = recursion.update(frozen, record[300:])
    assert np.any(resumed.estimate != state.estimate)
    assert resumed.idle == 0


def test_reset_and_forget_keep_the_estimate_and_widen_the_covariance() -> None:
    record = measured()
    recursion = RecursiveLeastSquares(STRUCTURE)
    state = recursion.update(recursion.start(), record)
    less = recursion.forget(state, 0.1)
    np.testing.assert_allclose(less.normalised_covariance, 10 * state.normalised_covariance, rtol=1e-12)
    assert less.samples == pytest.approx(0.1 * state.samples)
    assert less.noise_variance == pytest.approx(state.noise_variance, rel=0.1)
    none = recursion.reset(state)
    np.testing.assert_array_equal(none.estimate, state.estimate)
    np.testing.assert_array_equal(none.normalised_covariance, 1e8 * np.eye(3))
    assert none.tail is state.tail
    for weight in (0.0, 1.0, np.nan):
        with pytest.raises(ModelError, match="weight"):
            recursion.forget(state, weight)


@pytest.mark.parametrize(
    "rule",
    [Forgetting(1.0), Forgetting(0.98), Directional(0.95), Window(100)],
    ids=["none", "forgetting", "directional", "window"],
)
def test_intervals_cover_the_true_values(rule: Rule) -> None:
    """95 % of the intervals of 3 parameters after 150 records; the margin is four standard errors of that share."""
    hits = []
    recursion = RecursiveLeastSquares(STRUCTURE, rule=rule)
    for seed in range(150):
        state = recursion.update(recursion.start(), measured(350, seed), [])
        hits.append(np.abs(state.estimate - TRUE) < 1.96 * np.sqrt(np.diag(recursion.covariance(state))))
    assert np.mean(hits) == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 450))


def test_the_gradient_has_no_covariance() -> None:
    recursion = RecursiveLeastSquares(STRUCTURE, rule=Gradient(0.2))
    state = recursion.update(recursion.start(), measured(3000))
    assert np.isnan(recursion.covariance(state)).all()
    np.testing.assert_allclose(state.estimate, TRUE, atol=0.15)


@pytest.mark.parametrize("silence", ["nothing at all", "constant", "small noise"])
def test_directional_forgetting_without_excitation(silence: str) -> None:
    """The short form of 10⁹ samples in ``bench/run.py``: 90 % of the samples have no excitation."""
    rng = np.random.default_rng(7)
    n, size = 4, 5_000
    theta = np.array([0.5, -0.3, 1.0, 2.0])
    quiet = {
        "nothing at all": np.zeros((n, size)),
        "constant": np.ones((n, size)),
        "small noise": 1e-3 * rng.standard_normal((n, size)),
    }[silence]
    estimate, factor, diagonal, totals = (
        np.zeros(n),
        np.eye(n),
        np.full(n, 1e8),
        np.append(np.zeros(7), np.full(n, np.inf)),
    )
    none, rule = np.empty((0, n)), Directional(0.98).numbers(n)
    largest = 0.0
    for k in range(40):
        phi = quiet if k % 10 else rng.standard_normal((n, size))
        block = np.vstack([phi, theta @ phi + 1e-3 * rng.standard_normal(size)])
        kept = estimate.copy()
        update(estimate, factor, diagonal, totals, none, block, rule, np.full((2, n), 1e12), none, np.empty((0, 3)))
        covariance = factor.T @ (diagonal[:, None] * factor)
        largest = max(largest, float(np.abs(covariance).max())) if k else 0.0
        assert np.linalg.eigvalsh(covariance).min() > 0
        if k % 10:
            np.testing.assert_allclose(estimate, kept, atol=2e-3)
    assert largest < 10.0
    np.testing.assert_allclose(estimate, theta, atol=1e-3)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: Forgetting(0.0), "forgetting factor"),
        (lambda: Directional(1.1), "forgetting factor"),
        (lambda: Directional(0.9, least=1.0), "least excitation"),
        (lambda: Drift(-1.0), "variance of the drift"),
        (lambda: Drift(np.nan), "variance of the drift"),
        (lambda: Window(0), "window of 0"),
        (lambda: Window(10**9), "are the most"),
        (lambda: Gradient(2.0), "step 2.0"),
        (lambda: Gradient(offset=0.0), "offset 0.0"),
        (lambda: RecursiveLeastSquares(STRUCTURE, rule=Window(3)), "give a longer one"),
        (lambda: RecursiveLeastSquares(STRUCTURE, rule=Drift((1.0, 1.0))), "2 variances of the drift for 3"),
        (lambda: RecursiveLeastSquares(STRUCTURE, 0.9, rule=Drift()), "forgetting and a rule"),
    ],
)
def test_rules_out_of_range_are_refused(wrong: object, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        wrong()  # type: ignore[operator]


def test_a_state_of_another_structure_or_rule_is_refused() -> None:
    state = RecursiveLeastSquares(arx(1, 1)).start()
    with pytest.raises(ModelError, match="2 parameters for the 3"):
        RecursiveLeastSquares(STRUCTURE).update(state, measured())
    windowed = RecursiveLeastSquares(arx(1, 1), rule=Window(50))
    with pytest.raises(ModelError, match="no window of 50 samples"):
        windowed.update(state, measured())
    assert windowed.update(windowed.reset(state), measured()).filled == 50


# --- single samples from Python --------------------------------------------------------------------------------------


@every_rule
@pytest.mark.parametrize("structure", [arx(2, 2), arx(1, 1, nk=0, inputs=2)], ids=["arx", "two inputs"])
def test_single_samples_from_python_give_the_same_numbers(rule: Rule, structure: emsid.Structure) -> None:
    record = measured()
    if structure.inputs == 2:
        record = Record(np.column_stack([record.input, record.input[::-1]]), record.output, 0.01)
    recursion, residuals = RecursiveLeastSquares(structure, rule=rule), []
    begun = recursion.update(recursion.start(), record[:50], residuals=[])
    online = emsid.SampleBySample(recursion, 0.01, begun)
    predictions = [online.add(u, float(y)) for u, y in zip(record.input[50:300], record.output[50:300, 0], strict=True)]
    state = recursion.update(begun, record[50:300], residuals=residuals)
    assert_same(online.state, state)
    np.testing.assert_array_equal(online.estimate, state.estimate)
    np.testing.assert_allclose(predictions, record.output[50:300, 0] - residuals[0][:, 0], atol=1e-12)
    assert_same(recursion.update(online.state, record[300:], []), recursion.update(state, record[300:], []))
    online.cut()
    assert np.isnan(online.add(record.input[0], 0.0))
