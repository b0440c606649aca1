"""Maps of a feedback model that share a signal, and when the search makes two signals one."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from emsid import FeedbackModel, ModelError, Record
from emsid.blocks import DeadZone, Polynomial
from emsid.estimation.nonlinear.control import FREE
from emsid.models.blocks.search.map_families import family_of
from emsid.models.feedback.coordinates import Visited, coordinates, directions, fixed_offsets, shared_rows, whitened
from emsid.models.feedback.fitting import fit_feedback
from emsid.models.feedback.normal_form import normal_form
from emsid.models.feedback.search.shared_signals import with_shared_signals
from emsid.models.feedback.search.trials import Bench, FeedbackSearch
from feedback_models import Array, multiplied
from model_examples import DT

# A cubic spring and a dead zone, both of the first state.
MATRIX = np.array(
    [
        [0.8, 0.5, 0.5, -0.30, 0.2],
        [-0.4, 0.7, 0.3, 0.10, 0.3],
        [1.0, 0.2, 0.0, 0.0, 0.0],
        [-2.0, -0.4, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0, 0.0],
    ]
)
MAPS = (Polynomial(np.array([0.0, 0.0, 0.0, 0.1])), DeadZone(-0.8, 0.5))
APART = FeedbackModel(MATRIX, MAPS, np.array([0.1, -0.2]), dt=DT)
TRUTH = replace(APART, shared=((1, 0),))
U = np.random.default_rng(3).normal(size=1500)
X = np.zeros(2)


def visited(model: FeedbackModel, x: Array = X) -> Visited:
    return Visited.of([model.entering(U)], [model.trajectory(U, x)])


def turned(model: FeedbackModel, angle: float) -> FeedbackModel:
    """With another direction of the second signal."""
    matrix = model.matrix.copy()
    matrix[3, :3] += angle * np.array([0.1, 1.0, 0.3])
    return replace(model, matrix=matrix, shared=())


def noisy(model: FeedbackModel, seed: int, share: float = 0.01) -> Record:
    y, rng = model.output(U, X), np.random.default_rng(seed)
    return Record(U, y + share * y.std() * rng.normal(size=len(y)), DT)


def test_the_row_of_a_shared_signal_is_the_closest_multiple_of_the_other_one() -> None:
    np.testing.assert_array_equal(TRUTH.matrix, MATRIX)
    changed = replace(turned(TRUTH, 0.1), shared=((1, 0),)).matrix
    across = turned(TRUTH, 0.1).matrix[3, :3] - changed[3, :3]
    assert abs(across @ changed[2, :3]) < 1e-14
    assert np.linalg.matrix_rank(changed[2:4, :3]) == 1


@pytest.mark.parametrize("pairs", [((0, 1),), ((2, 0),), ((1, 1),), ((1, -1),)])
def test_pairs_of_other_maps_are_refused(pairs: tuple[tuple[int, int], ...]) -> None:
    with pytest.raises(ModelError, match="share a signal; give two of the 2 maps"):
        replace(APART, shared=pairs)


def test_a_file_keeps_what_is_shared() -> None:
    again = FeedbackModel.from_data(json.loads(json.dumps(TRUTH.to_data())))
    assert again.shared == ((1, 0),)
    np.testing.assert_array_equal(again.output(U, X), TRUTH.output(U, X))
    assert "shared" not in APART.to_data()


def test_coordinates_keep_to_the_shared_signal_and_cover_all_other_changes() -> None:
    """Each pair saves as many coordinates as the row of z has directions besides its own."""
    for pairs, saved in (((), 0), (((1, 0),), 2)):
        model = replace(TRUTH, shared=pairs)
        same = whitened(model, visited(model)).model
        spread = coordinates(same, visited(same))
        redundant = directions(same, visited(same)).shape[1] + fixed_offsets(same).sum()
        assert spread.shape[1] == len(same.parameters) - redundant - saved
        assert np.abs(shared_rows(same) @ spread).max(initial=0.0) < 1e-12
        effect = same.gradient(U, same.trajectory(U, X)) @ np.pad(spread, ((0, same.states), (0, 0)))
        assert np.linalg.cond(effect / np.linalg.norm(effect, axis=0)) < 1e6  # every coordinate changes the output


def test_the_forms_keep_output_and_shared_signal() -> None:
    for form in (whitened(TRUTH, visited(TRUTH)), normal_form(TRUTH, visited(TRUTH))):
        np.testing.assert_allclose(form.model.output(U, form.state(X)), TRUTH.output(U, X), rtol=1e-9, atol=1e-9)
        a, b = form.model.matrix[2:4, :3]
        np.testing.assert_allclose(a * b[0], b * a[0], rtol=1e-9, atol=1e-12)
        assert form.model.shared == ((1, 0),)


def test_a_fit_recovers_the_model_from_another_direction_and_keeps_it_shared() -> None:
    record = noisy(TRUTH, 1, 1e-6)
    start = replace(turned(TRUTH, 0.1), shared=((1, 0),))
    fit = fit_feedback(start, record)
    error = fit.model.output(U, np.zeros(2)) - TRUTH.output(U, X)
    assert np.std(error[200:]) < 3e-6 * np.std(TRUTH.output(U, X))
    a, b = fit.model.matrix[2:4, :3]
    np.testing.assert_allclose(a * b[0], b * a[0], rtol=1e-9, atol=1e-12)
    apart = fit_feedback(APART, record)
    assert fit.size == apart.size - 2


def test_the_intervals_of_shared_rows_are_the_same() -> None:
    fit = fit_feedback(TRUTH, noisy(TRUTH, 2))
    error = dict(zip(fit.names, fit.standard_error / np.abs(fit.estimate), strict=True))
    for column in ("x1", "x2", "u"):
        assert error[f"z2.{column}"] == pytest.approx(error[f"z1.{column}"], rel=1e-6)


def test_signals_that_are_one_save_variance() -> None:
    """The mean square error is about σ²p/N, and 2 of 22 parameters are saved; on 20 records, for a larger input."""
    v = 1.3 * np.random.default_rng(4).normal(size=1500)
    expected, errors = TRUTH.output(v, X), []
    for seed in range(20):
        record = noisy(TRUTH, seed, 0.05)
        runs = [fit_feedback(each, record).model.output(v, X) for each in (TRUTH, APART)]
        errors.append([np.mean((run - expected)[200:] ** 2) for run in runs])
    of_one, of_two = np.mean(errors, axis=0)
    assert of_one < 0.95 * of_two


@pytest.mark.parametrize(("angle", "shared"), [(0.0, ((1, 0),)), (1.0, ())])
def test_the_search_finds_out_whether_maps_share_a_signal(angle: float, shared: tuple[tuple[int, int], ...]) -> None:
    truth = turned(APART, angle)
    bench = Bench.of([noisy(truth, 5)], FeedbackSearch(), FREE)
    begun = bench.refined(turned(truth, 0.02), None, family_of("polynomial"), 3)
    found = [begun, *with_shared_signals(bench, begun)][-1]
    assert found.found.model.shared == shared
    assert found.parameters == begun.parameters - 2 * len(shared)


def test_a_map_that_is_multiplied_may_share_the_signal_of_another() -> None:
    model = replace(multiplied(), shared=((1, 0),))
    assert model.shared == ((1, 0),)
    n = model.states
    a, b = model.matrix[n : n + 2, : n + 1]
    np.testing.assert_allclose(np.outer(a, b), np.outer(b, a), atol=1e-14)
