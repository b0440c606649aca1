"""Terms selected one step ahead: equal to a slow reference, in little memory, from dictionaries of any size."""

from __future__ import annotations

import threading
import tracemalloc

import numpy as np
import pytest
from numpy.typing import NDArray

import emsid
from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.linear.least_squares import gather
from emsid.estimation.nonlinear.control import Activity, Control, Stopped
from emsid.identification import regressions
from emsid.models.regression import term_selection
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.structures import friction_narx, polynomial_narx
from emsid.models.regression.term_selection import correlate, forward_selection, tree
from emsid.options import Options
from emsid.record import Record, concatenate
from independent.forward_selection import best_columns

Array = NDArray[np.float64]

TRUTH = Structure.parse("y(t-1)", "-y(t-2)", "u(t-1)", "y(t-1)^3", "y(t-1)*u(t-1)^2")


def measured(samples: int, noise: float = 0.01, inputs: int = 1) -> Record:
    """A record of `TRUTH` with white noise."""
    rng = np.random.default_rng(samples)
    u = rng.uniform(-1, 1, (samples, inputs))
    run = Narx(TRUTH, np.array([1.5, 0.7, 0.3, -0.05, 0.04]), 0.1).simulate(u[:, :1], dt=0.1).output
    return Record(u, run + noise * rng.standard_normal(run.shape), 0.1)


@pytest.mark.parametrize("square", [False, True])
def test_products_with_shared_factors_are_those_of_the_matrix(square: bool) -> None:
    terms = Structure.parse(
        "1",
        "-y(t-1)",
        "y(t-1)^3",
        "y(t-2)*y(t-1)",
        "max(u(t)-0.2, 0)*u2(t-3)",
        "sign(y(t-1))",
        "-exp(-abs(u2(t))/0.4)^2",
    )
    terms += polynomial_narx(2, 2, 3, inputs=2)
    record = measured(1300, inputs=2)
    matrix = terms.regression(record)[0]
    weight = np.random.default_rng(0).standard_normal(len(matrix))
    result = np.zeros(len(terms))
    window = terms.window(record, terms.memory, len(record))
    correlate(result, tree(terms.regressors), *window, terms.memory, weight, square)
    np.testing.assert_allclose(result, (matrix**2 if square else matrix).T @ weight, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("noise", [0.01, 0.3])
def test_the_selection_is_that_of_a_fit_of_every_possible_model(noise: float) -> None:
    record = measured(300, noise)
    dictionary = polynomial_narx(2, 2, 3) + friction_narx(2, 2, (-0.3, 0.3), speeds=(0.2,))
    kept = [r for r in dictionary.regressors if not (r.negative and r.is_linear)]  # those are there without the minus
    dictionary = Structure(tuple(kept))
    found = emsid.select_terms(dictionary, [record[:140], record[140:]], 9)
    parts = [dictionary.regression(part) for part in (record[:140], record[140:])]
    order, gains = best_columns(np.vstack([phi for phi, _ in parts]), np.concatenate([y for _, y in parts]), 9)
    assert found.structure.labels == tuple(dictionary.labels[k] for k in order)
    np.testing.assert_allclose(found.error_reduction, gains, rtol=1e-6)


def test_passes_over_the_data_choose_what_the_factor_of_the_dictionary_does(monkeypatch: pytest.MonkeyPatch) -> None:
    record, dictionary = measured(900), polynomial_narx(2, 2, 3)
    monkeypatch.setattr(term_selection, "CHUNK", 100)
    monkeypatch.setattr(term_selection, "SMALL", 0)
    found = emsid.select_terms(dictionary, [record[:500], record[500:]], 8)
    joined = emsid.select_terms(dictionary, concatenate([record[:500], record[500:]]), 8)
    by_factor = forward_selection(gather(dictionary, [record[:500], record[500:]])[0], 8)
    assert found.structure.labels == joined.structure.labels
    assert found.structure.labels == tuple(dictionary.labels[k] for k in by_factor.order)
    np.testing.assert_allclose(found.error_reduction, by_factor.error_reduction, rtol=1e-8)


def test_nearly_dependent_terms_are_told_apart() -> None:
    """Terms that differ by 1e-5 of their size: the passes lose ten digits, the exact parts do not."""
    rng = np.random.default_rng(4)
    u = np.column_stack([x := rng.standard_normal(400), x + 1e-5 * (z := rng.standard_normal(400)), x * 1e3])
    record = Record(u, 2.0 * x + 1e-3 * z + 1e-4 * rng.standard_normal(400), 0.1)
    dictionary = Structure.parse("u(t)", "u2(t)", "u3(t)", "u(t-1)", "u2(t)^2")
    found = emsid.select_terms(dictionary, record, 5)
    phi, y = dictionary.regression(record)
    order, gains = best_columns(phi / np.linalg.norm(phi, axis=0), y, 3)
    same = {"u3(t)": "u(t)"}  # u3 is u times a thousand: rounding decides which of them is taken
    chosen = [[same.get(label, label) for label in labels] for labels in (found.structure.labels, dictionary.labels)]
    assert chosen[0][:2] == [chosen[1][k] for k in order[:2]]
    assert found.error_reduction[1] == pytest.approx(gains[1], rel=1e-4)
    assert len(found.structure) == 4
    assert found.findings[0].code == "dictionary-rank-deficient"


def test_nine_thousand_terms_take_a_hundredth_of_their_matrix() -> None:
    dictionary, record = polynomial_narx(18, 18, 3), measured(8000)
    tree(dictionary.regressors)
    tracemalloc.start()
    found = emsid.select_terms(dictionary, record, 3)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(dictionary) == 9139
    assert set(found.structure.labels) == {"y(t-1)", "y(t-2)", "u(t-1)"}
    assert peak < 8 * len(record) * len(dictionary) / 100


def test_products_of_columns_select_what_passes_do_where_they_keep_their_digits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record, dictionary = measured(2500), polynomial_narx(2, 2, 3)
    calls: list[int] = []
    monkeypatch.setattr(term_selection, "WIDTH", 999)
    monkeypatch.setattr(term_selection, "correlate", lambda *_: calls.append(1))
    by_products = emsid.select_terms(dictionary, [record[:1400], record[1400:]], 12)
    assert not calls
    monkeypatch.undo()
    monkeypatch.setattr(term_selection, "SMALL", 0)
    by_passes = emsid.select_terms(dictionary, [record[:1400], record[1400:]], 12)
    assert by_products.structure == by_passes.structure
    np.testing.assert_allclose(by_products.error_reduction, by_passes.error_reduction, rtol=1e-7)


def test_products_that_lose_digits_do_not_select() -> None:
    slow = np.cumsum(np.random.default_rng(0).standard_normal((400, 1)), axis=0)
    data = term_selection._Signals(polynomial_narx(2, 2, 3), [Record(slow, 1 + 1e-3 * slow, 0.1)], 4)
    assert data.information() is None
    assert term_selection._Signals(polynomial_narx(2, 2, 3), [measured(400)], 4).information() is not None


@pytest.mark.parametrize("small", [0, 64])
def test_a_selection_can_be_watched_and_stopped(small: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(term_selection, "SMALL", small)
    record, dictionary = measured(300), polynomial_narx(2, 2, 2)
    seen: list[Activity] = []
    emsid.select_terms(dictionary, record, 4, control=Control(report=seen.append))
    steps = [0] if small else [1, 2, 3]  # the factor of a small dictionary takes no time
    assert [(activity.done, activity.total) for activity in seen] == [(step, 4) for step in steps]
    cancelled = threading.Event()
    cancelled.set()
    with pytest.raises(Stopped) as stopped:
        emsid.select_terms(dictionary, record, 4, control=Control(cancelled=cancelled.is_set))
    assert stopped.value.ending is Ending.INTERRUPTED


def test_what_no_terms_can_be_selected_from_is_refused() -> None:
    dictionary = polynomial_narx(2, 2, 3)
    with pytest.raises(ModelError, match="at least one"):
        emsid.select_terms(dictionary, measured(300), 0)
    with pytest.raises(DataError, match="7 usable samples for 10 terms"):
        emsid.select_terms(dictionary, measured(9), 10)
    loud = Record(1e58 * measured(50).input, measured(50).output, 0.1)
    with pytest.raises(DataError, match="overflow"):
        emsid.select_terms(dictionary, loud, 2)


def test_the_free_run_selects_from_the_shortlist_of_a_large_dictionary(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regressions, "LARGE", 34)
    monkeypatch.setattr(regressions, "SHORTLIST", 8)
    record = measured(700)
    validation = regressions.CrossValidation.of(record, 0.25, 3)
    terms = regressions._dictionary(record, Options(), validation, (2, 2, 1))
    assert terms.labels == emsid.select_terms(polynomial_narx(2, 2, 3), validation.fitted, 8).structure.labels


def test_knots_add_hinges_and_friction_to_the_dictionary() -> None:
    record = measured(700)
    validation = regressions.CrossValidation.of(record, 0.25, 3)
    terms = regressions._dictionary(record, Options(knots=2), validation, (2, 2, 1)).labels
    assert len(terms) == len(set(terms)) == 35 + 2 * 4 + 3
    assert "sign(y(t-1))" in {label.removeprefix("-") for label in terms}
    assert regressions._dictionary(record, Options(), validation, (2, 2, 1)).labels == polynomial_narx(2, 2, 3).labels
