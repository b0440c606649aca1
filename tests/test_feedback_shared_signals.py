"""Maps of a feedback model that share a signal, and when the search makes two signals one."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from emsid import FeedbackModel, ModelError, Record
from emsid.blocks import DeadZone, Polynomial
from emsid.estimation.nonlinear.control import FREE
from emsid.models.blocks.search.map_families import family_of
from emsid.models.feedback.coordinates import Same, Visited, always_fixed, coordinates, directions, whitened
from emsid.models.feedback.fitting import fit_feedback
from emsid.models.feedback.normal_form import normal_form
from emsid.models.feedback.search.choice import with_shared_signals
from emsid.models.feedback.search.trials import FeedbackSearch, SearchData
from feedback_models import Array, multiplied
from model_examples import DT

# A cubic spring and a dead zone of a system of second order.
MATRIX = np.array(
    [
        [0.8, 0.5, 0.5, -0.30, 0.2],
        [-0.4, 0.7, 0.3, 0.10, 0.3],
        [1.0, 0.2, 0.1, 0.0, 0.0],
        [-0.5, -1.4, -0.4, 0.0, 0.0],
        [1.0, 0.1, 0.1, 0.1, 0.0],
    ]
)
MAPS = (Polynomial(np.array([0.0, 0.0, 0.0, 0.1])), DeadZone(-0.8, 0.5))
APART = FeedbackModel(MATRIX, MAPS, np.array([0.1, -0.2]), dt=DT)
PAIRS = (("z2", "z1"), ("z1", "y"), ("w1", "u"), ("w2", "w1"))
U = np.random.default_rng(3).normal(size=1500)
X = np.zeros(2)


def visited(model: FeedbackModel, x: Array = X) -> Visited:
    return Visited.of(model, [U], [x])


def sharing(*pairs: tuple[str, str]) -> FeedbackModel:
    return replace(APART, shared=pairs)


def turned(model: FeedbackModel, share: float) -> FeedbackModel:
    """With other directions of all signals."""
    rng = np.random.default_rng(8)
    changed = model.matrix + share * model.free_entries * rng.normal(size=model.matrix.shape) * np.abs(model.matrix)
    return replace(model, matrix=changed, shared=())


def factor(model: FeedbackModel, pair: tuple[str, str]) -> float:
    """That of the second signal in the first one, which are multiples."""
    of, like = (model.matrix[model.entries(name)] for name in pair)
    assert np.linalg.matrix_rank(np.array([of, like]), tol=1e-9 * np.abs(of).max()) == 1
    return float(of @ like / (like @ like))


def noisy(model: FeedbackModel, seed: int, share: float = 0.01) -> Record:
    y, rng = model.output(U, X), np.random.default_rng(seed)
    return Record(U, y + share * y.std() * rng.normal(size=len(y)), DT)


@pytest.mark.parametrize("pair", PAIRS)
def test_the_elements_of_a_shared_signal_are_the_closest_multiple(pair: tuple[str, str]) -> None:
    model = sharing(pair)
    factor(model, pair)
    of, like = (model.matrix[model.entries(name)] for name in pair)
    assert abs((APART.matrix[model.entries(pair[0])] - of) @ like) < 1e-14
    same = np.ones(MATRIX.shape, dtype=bool)
    same[model.entries(pair[0])] = False
    np.testing.assert_array_equal(model.matrix[same], MATRIX[same])


@pytest.mark.parametrize("pair", [("z1", "z2"), ("z3", "y"), ("z1", "z1"), ("z1", "w2"), ("w1", "y"), ("y", "u")])
def test_other_pairs_are_refused(pair: tuple[str, str]) -> None:
    with pytest.raises(ModelError, match=f"{pair[0]} of {pair[1]} is no shared signal; give one pair for a z or w of"):
        sharing(pair)
    with pytest.raises(ModelError, match="z2 of z1 is no shared signal; give one pair"):
        sharing(("z2", "z1"), ("z2", "y"))


def test_a_file_keeps_what_is_shared() -> None:
    model = sharing(*PAIRS)
    again = FeedbackModel.from_data(json.loads(json.dumps(model.to_data())))
    assert set(again.shared) == set(PAIRS)
    np.testing.assert_allclose(again.output(U, X), model.output(U, X), atol=1e-12)
    assert "shared" not in APART.to_data()


@pytest.mark.parametrize("count", range(5))
def test_coordinates_keep_to_shared_signals_and_cover_all_other_changes(count: int) -> None:
    """Each pair saves as many coordinates as a signal has directions besides its own."""
    model = sharing(*PAIRS[:count])
    same = whitened(model, visited(model)).model
    spread = coordinates(same, visited(same))
    redundant = directions(same, visited(same)).shape[1] + always_fixed(same).sum()
    assert spread.shape[1] == len(same.parameters) - redundant - 2 * count
    moved = same.with_parameters(
        same.parameters + 0.01 * spread @ np.random.default_rng(1).normal(size=spread.shape[1])
    )
    for pair in same.shared:
        assert factor(moved, pair) == pytest.approx(factor(same, pair), rel=1e-9)
    effect = same.gradient(U, same.trajectory(U, X)) @ np.pad(spread, ((0, same.states), (0, 0)))
    assert np.linalg.cond(effect / np.linalg.norm(effect, axis=0)) < 1e6  # every coordinate changes the output


@pytest.mark.parametrize("pairs", [*((pair,) for pair in PAIRS), PAIRS])
@pytest.mark.parametrize("form", [whitened, normal_form])
def test_the_forms_keep_output_and_shared_signals(
    form: Callable[[FeedbackModel, Visited], Same], pairs: tuple[tuple[str, str], ...]
) -> None:
    """A line that is taken from the second map changes the output's row, and the column of the input."""
    model = replace(sharing(*pairs), maps=(MAPS[0], Polynomial(np.array([0.1, 0.2, 0.0, 0.1]))))
    same = form(model, visited(model))
    np.testing.assert_allclose(same.model.output(U, same.state(X)), model.output(U, X), rtol=1e-9, atol=1e-9)
    for pair in same.model.shared:
        factor(same.model, pair)


@pytest.mark.parametrize("pairs", [(pair,) for pair in PAIRS] + [PAIRS])
def test_a_fit_recovers_the_model_from_other_directions(pairs: tuple[tuple[str, str], ...]) -> None:
    truth = sharing(*pairs)
    record = noisy(truth, 1, 1e-6)
    fit = fit_feedback(replace(turned(truth, 0.02), shared=pairs), record)
    error = fit.model.output(U, fit.model.initial(record, 40).x * 0) - truth.output(U, X)
    assert np.std(error[200:]) < 3e-6 * np.std(truth.output(U, X))
    for pair in pairs:
        factor(fit.model, pair)
    assert fit.size == fit_feedback(truth, noisy(truth, 1), max_iterations=0).size
    assert fit.size == fit_feedback(replace(truth, shared=()), record).size - 2 * len(pairs)


def test_intervals_contain_the_true_values_where_signals_are_shared() -> None:
    """Of parameters that no unit moves: the factors of the state, on 30 records."""
    truth, inside = sharing(("z1", "y"), ("w1", "u")), []
    for seed in range(30):
        fit = fit_feedback(truth, noisy(truth, seed))
        goal = normal_form(truth, visited(truth)).model
        at = [k for k, name in enumerate(fit.names) if name in ("x1.x1", "x2.x1")]
        low, high = fit.interval().T[:, at]
        true = [goal.parameters[goal.names.index(fit.names[k])] for k in at]
        inside.append((low <= true) & (true <= high))
    assert binom.cdf(np.mean(inside, axis=0).min() * 30, 30, 0.95) > 0.001


@pytest.mark.long
def test_signals_that_are_one_save_variance() -> None:
    """The mean square error is about σ²p/N, and 8 of 22 parameters are saved; on 20 records, for a larger input."""
    truth = sharing(*PAIRS)
    v = 1.3 * np.random.default_rng(4).normal(size=1500)
    expected, errors = truth.output(v, X), []
    for seed in range(20):
        record = noisy(truth, seed, 0.05)
        models = [fit_feedback(each, record).model for each in (truth, replace(truth, shared=()))]
        errors.append([np.mean((model.output(v, X) - expected)[200:] ** 2) for model in models])
    of_one, of_two = np.mean(errors, axis=0)
    assert of_one < 0.8 * of_two


@pytest.mark.parametrize("pairs", [(), PAIRS[:1], PAIRS])
def test_the_search_finds_out_which_signals_are_shared(pairs: tuple[tuple[str, str], ...]) -> None:
    truth = sharing(*pairs)
    data = SearchData.of([noisy(truth, 5)], FeedbackSearch(), FREE)
    begun = data.refined(turned(truth, 0.01), None, family_of("polynomial"), 3)
    found = [begun, *with_shared_signals(data, begun)][-1]
    assert len(found.found.model.shared) == len(pairs)
    assert found.parameters == begun.parameters - 2 * len(pairs)
    if len(pairs) == 1:
        assert found.found.model.shared == pairs


def test_a_map_that_is_multiplied_may_share_the_signal_of_another() -> None:
    model = replace(multiplied(), shared=(("z2", "z1"),))
    factor(model, ("z2", "z1"))
