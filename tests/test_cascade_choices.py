"""What the search for a cascade chooses: orders, knots, steps per sample, and the data that decide."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from math import comb

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from cascade_searches import (
    AT_RATE,
    BEND,
    FAMILIES,
    FAST,
    SLOW,
    SPLINE,
    hammerstein,
    record_of,
    unexplained,
    wiener_hammerstein,
)
from emsid.errors import ModelError
from emsid.estimation.nonlinear.rational import fit_rational, measured
from emsid.excitation import SIGNALS
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search import choice as cascade_choice
from emsid.models.blocks.search.cross_validation import (
    CHOICE_SAMPLES,
    HAMMERSTEIN,
    WIENER,
    WIENER_HAMMERSTEIN,
    CascadeSearch,
    Topology,
    held_back,
    shortened,
)
from emsid.models.blocks.search.orders import map_sizes, measured_response, order_shares, total_orders
from emsid.models.blocks.search.starts import _splits, at_higher_rate, grown
from emsid.models.blocks.search.trials import scanned
from emsid.models.blocks.static_maps import Saturation
from emsid.models.free_run import free_run_error
from emsid.plant import Bench, Motor
from emsid.record import Record, concatenate
from emsid.validation.comparison import fit_percent
from independent.diode_circuit import diode_circuit

# --- orders ----------------------------------------------------------------------------------------------------------


def test_orders_below_that_of_the_response_are_tried() -> None:
    def totals(layout: Topology, orders: tuple[int | None, int | None]) -> list[int]:
        record = record_of(Cascade((FAST, BEND, SLOW)), 8000, noise=0.001)
        return total_orders(layout, measured_response([(record.input[:, 0], record.output[:, 0])]), orders)

    most = totals(WIENER_HAMMERSTEIN, (None, None))[-1]
    assert most >= 3
    assert totals(WIENER_HAMMERSTEIN, (None, None)) == list(range(max(most - 2, 2), most + 1))
    assert totals(WIENER, (None, None)) == list(range(1, most + 1))
    assert totals(WIENER_HAMMERSTEIN, (1, 2)) == [3]
    assert totals(WIENER_HAMMERSTEIN, (None, 2)) == list(range(max(most - 2, 3), most + 1))


def test_an_order_that_is_given_is_kept_where_the_other_is_open() -> None:
    assert order_shares(WIENER_HAMMERSTEIN, (None, None), 3) == [(1, 2), (2, 1)]
    assert order_shares(WIENER_HAMMERSTEIN, (None, 2), 3) == [(1, 2)]
    assert order_shares(WIENER_HAMMERSTEIN, (0, None), 3) == [(0, 3)]
    assert order_shares(WIENER_HAMMERSTEIN, (2, 0), 2) == [(2, 0)]
    record = record_of(Cascade((FAST, BEND, SLOW)))
    for orders in ((None, 2), (1, None)):
        fit = wiener_hammerstein(record, orders, replace(AT_RATE, size=9, delay=0))  # type: ignore[arg-type]
        first, second = (len(block.denominator) for block in fit.model.blocks if isinstance(block, Rational))
        assert orders[0] in (None, first)
        assert orders[1] in (None, second)
        assert unexplained(fit, record_of(Cascade((FAST, BEND, SLOW)), 2000, noise=0.0, seed=1)) < 0.02


def test_a_filter_that_grows_keeps_the_output() -> None:
    model = Cascade((FAST, BEND, SLOW))
    larger = grown(model, (3, 4))
    assert [len(block.denominator) for block in larger.blocks if isinstance(block, Rational)] == [3, 4]
    u = record_of(model, 300).input[:, 0]
    np.testing.assert_allclose(larger.output(u, np.zeros(7)), model.output(u, np.zeros(3)), atol=1e-12)
    assert grown(model, (None, 4)) is model


def test_a_larger_model_fits_no_worse_than_the_smaller_one() -> None:
    record = record_of(Cascade((Saturation(1.0, -1.0, 1.2), SLOW)), 600, seed=3)
    settings = replace(AT_RATE, delay=0, static="saturation")
    small, large = (hammerstein(record, order, settings) for order in (2, 3))
    assert free_run_error(large.model, [record]) <= 1.001 * free_run_error(small.model, [record])


@pytest.mark.parametrize("orders", [(4, 4), (20, 20)])
def test_poles_are_divided_without_trying_every_subset(orders: tuple[int, int]) -> None:
    first, second = orders
    groups = [[complex(0.01 * k)] for k in range(first + second - 2)] + [[0.5 + 0.1j, 0.5 - 0.1j]]
    shares = list(islice(_splits(groups, first), 500))
    assert all((len(left), len(right)) == orders for left, right in shares)
    whole = sorted(map(str, (root for group in groups for root in group)))
    assert all(sorted(map(str, left + right)) == whole for left, right in shares)
    assert len({str(left) for left, _ in shares}) == len(shares)
    if first == 4:  # every way there is
        assert len(list(_splits(groups, first))) == comb(6, 4) + comb(6, 2)


def test_a_pair_of_filters_that_fails_does_not_fail_the_others() -> None:
    """A motor of first order has no two filters to share out; one of the trials passes nothing on."""
    record = record_of(Cascade((FAST, BEND, SLOW)), 800)
    segments = [(record.input[:, 0], record.output[:, 0])]
    runaway, template = Rational([1.0], [-3.0]), Cascade((SLOW,))
    with np.errstate(over="ignore", invalid="ignore"):
        found = scanned([(runaway, SLOW), (FAST, SLOW)], segments, SPLINE.trial, template, 2)
        assert len(found) == 1
        with pytest.raises(ModelError, match="filter before it diverges"):
            scanned([(runaway, SLOW)], segments, SPLINE.trial, template, 2)


def test_frequency_response_and_the_rational_function_fitted_to_it() -> None:
    record = record_of(Cascade((SLOW,)), 20_000, noise=0.001)
    response = measured([(record.input[:, 0], record.output[:, 0])])
    b, a, cost = fit_rational(response, 2, 2)
    np.testing.assert_allclose(a, SLOW.denominator, atol=0.01)
    np.testing.assert_allclose(b, SLOW.numerator, atol=0.002)
    assert cost < 4 * len(response.frequency)
    with pytest.raises(ModelError, match="needs a segment of 32 samples"):
        measured([(np.ones(20), np.ones(20))])
    with pytest.raises(ModelError, match="excites nothing"):
        measured([(np.zeros(200), np.ones(200))])


@pytest.mark.parametrize(("excitation", "order"), [pytest.param("multisine", 6, marks=pytest.mark.long), ("sines", 5)])
def test_a_pole_on_the_unit_circle_does_not_end_the_search(excitation: str, order: int) -> None:
    rng = np.random.default_rng(1)
    record = Bench.typical().run(Motor(), SIGNALS[excitation](1400, 0.005, 6.0, rng), 0.005, rng)
    _, a, _ = fit_rational(measured([(record.input[:, 0], record.output[:, 0])]), order + 1, order)
    assert np.max(np.abs(np.roots(np.append(1.0, a)))) < 1 - 1e-4
    fit = wiener_hammerstein(record, (1, 1), CascadeSearch(threads=1, static=SPLINE, size=7))
    run = fit.model.simulate(record)
    assert fit_percent(record.output[run.counted], run.output[run.counted]) > 90


# --- knots -----------------------------------------------------------------------------------------------------------


def test_the_number_of_knots_is_limited_by_the_samples() -> None:
    few, many = (record_of(Cascade((BEND, SLOW)), samples) for samples in (120, 4000))
    lines = FAMILIES["piecewise-linear"]
    for family, small in ((SPLINE, SPLINE.sizes[:1]), (lines, (6, 10, 16))):
        sizes = [map_sizes(family, HAMMERSTEIN, [each], (None, 2), CascadeSearch()) for each in (few, many)]
        assert sizes == [small, family.sizes]
    assert map_sizes(SPLINE, HAMMERSTEIN, [few], (None, 2), CascadeSearch(size=20)) == (20,)


@pytest.mark.long
def test_few_knots_move_to_where_the_map_bends() -> None:
    """Spread over the data, ten knots leave 3.8 times the noise."""
    record, judge, noise = diode_circuit(seed=4, samples=1_500, noise=8e-4)
    structure = emsid.wiener_hammerstein((3, 3), static="spline", size=10, oversampling=2, delay=0)
    run = emsid.fit(structure, record).model.simulate(judge)
    assert np.sqrt(np.mean((run.output - judge.output)[run.counted] ** 2)) < 0.8 * noise


@pytest.mark.parametrize("kink", [True, False])
def test_a_number_of_knots_that_is_too_small_is_said_where_the_map_bends_more_sharply(kink: bool) -> None:
    """Eight knots round the edges of a saturation and suffice for a flat arctangent."""
    rng = np.random.default_rng(3)
    u = np.asarray(lfilter([1.0], [1.0, -0.8], rng.standard_normal(2000)))
    y = lfilter([0.3], [1.0, -0.7], np.clip(u, -1, 1) if kink else np.arctan(0.3 * u))
    record = Record(u, y + 0.01 * np.std(y) * rng.standard_normal(2000), 0.01)
    fit = emsid.fit(emsid.hammerstein(1, static="spline", size=8, oversampling=1, delay=0), record)
    few = [finding for finding in fit.findings if finding.code == "too-few-knots"]
    assert len(few) == kink
    if kink:  # the noise remains, and so do edges between the new knots
        error, noise = np.sqrt(fit.noise_variance), 0.01 * np.std(y)
        assert 0.3 < few[0].data["saved"] < 1 - noise / error
        assert few[0].data["block"] == 1


# --- steps per sample ------------------------------------------------------------------------------------------------


def test_a_map_with_harmonics_above_half_the_sampling_rate_gets_more_steps_per_sample() -> None:
    """At one step per sample the same structure has 3.7 times the noise."""
    record, judge, noise = diode_circuit(seed=4, samples=2_000, noise=8e-4)
    model = emsid.fit(emsid.wiener_hammerstein(), record).model
    assert model.oversampling == 2
    run = model.simulate(judge)
    assert np.sqrt(np.mean((run.output - judge.output)[run.counted] ** 2)) < 0.6 * noise


def test_more_steps_per_sample_are_not_taken_where_they_do_not_help(monkeypatch: pytest.MonkeyPatch) -> None:
    record = record_of(Cascade((BEND, SLOW)), 800)
    options = replace(AT_RATE, size=6, oversampling=None)
    fit = hammerstein(record, 2, options)
    assert fit.model.oversampling == 1
    assert np.sqrt(fit.noise_variance) == pytest.approx(0.01 * np.std(record.output), rel=0.1)
    monkeypatch.setattr(cascade_choice, "ordered_starts", lambda *arguments: [[]])
    with pytest.raises(ModelError, match="no start value leads to a model"):
        hammerstein(record, 2, options)


@pytest.mark.parametrize(
    "poles", [[0.9], [0.995], [0.8 + 0.3j, 0.8 - 0.3j], [0.7 + 0.4j, 0.7 - 0.4j, 0.5], [-0.2]], ids=str
)
def test_a_filter_at_a_higher_rate_responds_alike_at_low_frequencies(poles: list[complex]) -> None:
    block = Rational(np.real(np.poly([0.5] * len(poles))), np.real(np.poly(poles))[1:], 1)
    (faster,) = at_higher_rate(Cascade((block,)), 2).blocks
    assert isinstance(faster, Rational)
    frequency = np.geomspace(1e-5, 0.2, 50)
    responses = block.response(frequency, 1.0), faster.response(frequency, 0.5)
    assert np.abs(responses[0] - responses[1]).max() < 0.03 * np.abs(responses[0]).max()


# --- sources of starts -----------------------------------------------------------------------------------------------


# --- data that decide ------------------------------------------------------------------------------------------------


def test_every_sample_of_a_short_record_is_selection_data_once() -> None:
    short, long = (record_of(Cascade((SLOW,)), samples) for samples in (403, 6000))
    _, rounds = held_back([short], CascadeSearch())
    judged = np.concatenate([each.unseen[0].output[each.ahead[0] :, 0] for each in rounds])
    np.testing.assert_array_equal(judged, short.output[:, 0])
    for rest, (run,), (ahead,) in rounds:
        unseen = run[ahead:]
        np.testing.assert_array_equal(run.output, short.output[: len(run)])  # what is ahead settles the run
        assert sum(len(piece) for record in rest for piece in record.segments) == 403 - len(unseen)
        assert not np.isin(unseen.output, np.concatenate([p.output for r in rest for p in r.segments])).any()
    shown, [(rest, (unseen,), (ahead,))] = held_back([long], CascadeSearch())
    assert ahead == 0
    assert rest is shown
    assert len(shown[0]) == 4500
    np.testing.assert_array_equal(unseen.output, long[4500:].output)


def test_every_choice_uses_all_heights_of_a_series_of_steps() -> None:
    steps = [Record(np.repeat([0.0, height], [100, 900]), np.ones(1000), 0.01) for height in np.linspace(-6, 6, 26)]
    series = concatenate(steps)
    _, [(known, unseen, _)] = held_back([series], CascadeSearch())
    for records in (shortened([series]), known, unseen):
        heights = np.concatenate([record.input[:, 0] for record in records])
        assert heights.min() < -4
        assert heights.max() > 4
    assert sum(map(len, shortened([series]))) <= CHOICE_SAMPLES
    assert not set(known[0].input[:, 0]) & set(unseen[0].input[:, 0]) - {0.0}
    single = Record(series.input, series.output, 0.01)
    assert len(shortened([single])[0]) == CHOICE_SAMPLES
    assert np.array_equal(shortened([single])[0].input, series.input[:CHOICE_SAMPLES])
