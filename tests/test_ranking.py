"""The ranking over folds: splits that cover the record, structures fitted again to the rest, the choice by noise."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

import emsid
from emsid.blocks import PiecewiseLinear, Rational
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.identification import ranking as ranking_module
from emsid.identification import verdict as verdicts
from emsid.identification.ranking import FOLDS, Ranked, front_rows, ranked, within_noise
from emsid.identification.verdict import recommended
from emsid.models.capabilities import Capabilities
from emsid.models.free_run import free_run_error
from emsid.models.kinds import KINDS, capabilities_of
from emsid.models.refit_data import Budget, Data
from emsid.models.refitting import refitted, usable_refit
from emsid.options import Options
from emsid.record.holding_back import left_out_once, stretches_in_turn
from emsid.report.figures import draw
from emsid.report.page import page_figure
from emsid.report.views.front import front_figure
from emsid.selection.improvement import StretchErrors, better, better_by_ratio, equivalent, front
from emsid.validation.comparison import as_fit, compare
from feedback_models import before_sensor, loop
from independent.cases import motor

DT, POLE = 0.01, 0.9


def drive(seed=0, samples=1200, pole=POLE, gain=1.0, low=-1.0, high=1.0, noise=0.02):
    """A first-order drive with a dead zone of 0.2, with noise."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(low, high, samples // 8 + 1), 8)[:samples]
    x = gain * np.sign(u) * np.maximum(np.abs(u) - 0.2, 0)
    y = lfilter([0.0, 1 - pole], [1.0, -pole], x) + noise * rng.standard_normal(samples)
    return emsid.Record(u, y, DT, input_units=("V",), output_units=("rad/s",), name=f"drive {seed}")


# --- folds -----------------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(
    st.integers(2, 5), st.integers(0, 6), st.lists(st.integers(1, 199), max_size=12, unique=True), st.integers(0, 1000)
)
def test_every_sample_is_left_out_once_and_none_is_in_both_parts(folds, purged, breaks, seed):
    whole = emsid.Record(np.arange(200.0), np.zeros(200), 0.1, breaks=tuple(sorted(breaks)))
    splits = left_out_once(whole, folds, purged)
    out = np.concatenate([part.input[:, 0] for _, part in splits])
    assert sorted(out) == list(range(200))
    for rest, part in splits:
        inside = set(part.input[:, 0])
        kept = rest.input[:, 0]
        assert not inside & set(kept)
        lost = 200 - len(kept) - len(inside)
        assert 0 <= lost <= 2 * purged * max(len(part.segments), 1)


def test_stretches_end_at_the_gaps_between_records():
    whole = emsid.concatenate([drive(k, samples) for k, samples in enumerate((300, 340, 290))])
    assert [len(part) for _, part in left_out_once(whole, 3, 5)] == [300, 340, 290]
    assert all(len(rest) + len(part) == len(whole) for rest, part in left_out_once(whole, 3, 5))


@pytest.mark.parametrize("lengths", [[300], [120, 90, 60], [41]])
def test_every_sample_after_the_first_ones_of_a_segment_is_left_out_once(lengths):
    known = 40
    folds = list(stretches_in_turn(lengths, FOLDS, 16, known))
    assert len(folds) == FOLDS
    for k, length in enumerate(lengths):
        times = np.sum([fold[k] for fold in folds], axis=0)
        np.testing.assert_array_equal(times, np.arange(length) >= known)
    sizes = [sum(np.count_nonzero(each) for each in fold) for fold in folds]
    assert max(sizes) - min(sizes) <= FOLDS


# --- fitted again ----------------------------------------------------------------------------------------------------


def refit(fit, record, budget=Budget.FEW, **how):
    """The model of a fit to a record."""
    return refitted(fit, Data((record,), **how), budget).model


def structures():
    """Something of every kind."""
    yield emsid.arx(na=1, nb=1), {}
    yield emsid.arx(na=1, nb=1), {"free_run": True}
    yield emsid.Cascade((PiecewiseLinear((-1, -0.2, 0.2, 1), (-0.7, 0, 0, 0.7)), Rational([0.1], [-0.9], 1))), {}
    yield emsid.box_jenkins(nb=1, nc=0, nd=0, nf=1), {}
    yield emsid.state_space(order=1), {"free_run": True}
    yield emsid.feedback(order=1, maps=1, static=emsid.blocks.DeadZone()), {}
    yield emsid.plants.rigid_motor(), {}
    yield emsid.process_model(), {}
    yield emsid.transfer_function(poles=1), {}


@pytest.fixture(scope="module")
def fits():
    return [emsid.fit(what, drive(0, 400), **options) for what, options in structures()]


def test_every_kind_of_model_can_be_fitted_again(fits):
    assert {type(fit.model) for fit in fits} == {each.model for each in KINDS}


@pytest.fixture(scope="module")
def halves():
    """A fit of every kind to the first half of a record, and the error of one to the whole."""
    record = drive(0, 600)
    return [
        (emsid.fit(what, record[:300], **how), free_run_error(emsid.fit(what, record, **how).model, [record]))
        for what, how in structures()
    ]


@pytest.mark.parametrize("budget", [Budget.MINIMUM, Budget.LAST])
def test_further_budgets_reach_the_minimum_of_other_data(halves, budget):
    """Of the whole record, from the estimate of its first half."""
    record = drive(0, 600)
    for part, least in halves:
        found = refitted(part, Data((record,)), budget)
        assert free_run_error(found.model, [record]) < 1.02 * least, part.model.name
        assert type(found.model) is type(part.model)
        assert budget is Budget.MINIMUM or found.samples > 560, part.model.name


def test_a_search_anew_is_that_of_the_data(fits):
    record, other = drive(0, 400), emsid.fit(emsid.arx(2, 2), drive(0, 400))
    assert refitted(fits[0], Data((record,), search=lambda *_: other), Budget.SEARCH) is other
    with pytest.raises(emsid.ModelError, match="no search"):
        refit(fits[0], record, Budget.SEARCH)


def test_a_model_fitted_again_to_its_own_data_is_the_same(fits):
    record = drive(0, 400)
    for fit in fits:
        again = refit(fit, record)
        errors = [free_run_error(model, [record]) for model in (fit.model, again)]
        assert errors[1] == pytest.approx(errors[0], rel=0.02), fit.model.name
        assert again.name == fit.model.name


def test_a_model_fitted_again_to_another_drive_follows_it(fits):
    other = drive(1, 400, pole=0.85, gain=1.5)
    for fit in fits:
        before, after = (free_run_error(model, [other]) for model in (fit.model, refit(fit, other)))
        assert after < 0.3 * before, fit.model.name
        assert (
            after < 1.05 * free_run_error(emsid.fit(fit.model, other).model, [other])
            if isinstance(fit.model, emsid.Cascade)
            else True
        )


def test_samples_that_are_left_out_have_no_effect_on_a_model_fitted_again(fits):
    record, out = drive(1, 400), np.zeros(400, dtype=bool)
    out[100:150] = out[250:300] = True
    spoilt = replace(record, output=record.output + 5.0 * out[:, None])
    for fit in fits:
        one, other = (refit(fit, each, left_out=[out]).simulate(record).output for each in (record, spoilt))
        np.testing.assert_allclose(one, other, atol=2e-5, err_msg=fit.model.name)
        whole = refit(fit, record).simulate(record).output
        assert np.abs(one - whole).max() > 1e-3, fit.model.name
        with_all = refit(fit, spoilt).simulate(record).output
        assert np.abs(with_all - whole).max() > 0.1, fit.model.name


def test_a_feedback_model_that_runs_away_is_no_refit(fits, monkeypatch):
    """Every other model runs away here, so the known one is kept."""
    (fit,) = (each for each in fits if each.model.name == "feedback")
    first = []

    def runs_away(model, segments, states):
        first.append(np.ptp(model.output(segments[0][0], states[0])))
        return abs(first[-1] - first[0]) > 1e-3 * first[0]

    monkeypatch.setattr("emsid.models.feedback.search.trials.runs_away", runs_away)
    other = drive(1, 400, pole=0.85, gain=1.5)
    before, after = (free_run_error(model, [other]) for model in (fit.model, refit(fit, other)))
    assert after == pytest.approx(before, rel=0.02)
    assert len(first) > 2


def test_a_regression_is_fitted_again_as_the_options_say(fits):
    seen = []

    def linear(structure, records, each_block=None):
        seen.append(structure.name)
        return least_squares(structure, records, ridge=10.0)

    again = refit(fits[0], drive(0), linear=linear)
    assert seen == ["arx"]
    assert free_run_error(again, [drive(0)]) != free_run_error(fits[0].model, [drive(0)])


def test_a_parameter_that_the_user_fixes_stays_fixed(fits):
    start = fits[2].model
    fit = emsid.fit(start, drive(0, 400), fixed=["f.f1", "f.f2"])
    again = refit(fit, drive(1, 400, pole=0.85, gain=1.5))
    known = dict(zip(start.names, start.parameters, strict=True))
    found = dict(zip(again.names, again.parameters, strict=True))
    assert {name for name in known if found[name] == known[name]} == {"f.f1", "f.f2", "u0", "y0"}
    assert "G.a1" in fit.names


def test_numbers_out_of_range_are_a_problem_of_the_model(fits, monkeypatch):
    def fails(*_):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(type(capabilities_of(fits[2].model)), "refitted", fails)
    with pytest.raises(emsid.ModelError, match="out of range"):
        refit(fits[2], drive(0, 400))


def test_a_cancelled_refit_is_stopped(fits):
    with pytest.raises(Stopped):
        refit(fits[0], drive(0), control=Control(cancelled=lambda: True))
    with pytest.raises(emsid.ModelError, match="no way to be fitted again"):
        refit(replace(fits[0], model=object()), drive(0))


@pytest.mark.parametrize(("cubed", "taken"), [(-0.4, True), (0.4, False)])
def test_a_refit_is_taken_where_it_is_better_and_does_not_run_away(cubed, taken):
    """The output of short pulses stays small; while the largest input is held, a positive cube makes it diverge."""
    u, y, slow = np.repeat(np.random.default_rng(3).uniform(-1, 1, 500), 4), np.zeros(2000), 0.99
    for t in range(1, len(u)):
        y[t] = slow * y[t - 1] + (1 - slow) * (u[t - 1] + cubed * y[t - 1] ** 3)
    cubic = emsid.Structure.parse("y(t-1)", "u(t-1)", "y(t-1)^3", name="cubic")
    whole, known = emsid.Record(u, y, DT), as_fit(emsid.RegressionModel(cubic, np.array([slow, 1 - slow, 0.0]), DT))
    assert free_run_error(refit(known, whole), [whole]) < 0.1 * free_run_error(known.model, [whole])
    found = usable_refit(known, Data((whole,)))
    assert (found is not None) is taken
    assert found is None or usable_refit(found, Data((whole,))) is None  # no better than itself


# --- the choice ------------------------------------------------------------------------------------------------------


def model(size, errors, name):
    """A model of some parameters with these mean square errors of its stretches."""
    fit = replace(as_fit(emsid.Cascade((Rational([0.1], [-0.9], 1),), name=name)), estimate=np.zeros(size))
    errors = np.asarray(errors, dtype=float)
    return Ranked(fit, tuple(StretchErrors(each, np.full(len(each), 100.0)) for each in np.split(errors, FOLDS)))


def noisy(mean, spread, seed=0):
    """(16,) mean square errors."""
    return mean + spread * np.random.default_rng(seed).standard_normal(16)


def test_a_large_model_needs_to_be_better_than_a_small_one_by_more_than_noise():
    small = model(10, noisy(1.0, 0.1), "small")
    within, beyond = model(57, noisy(0.97, 0.1, 2), "large"), model(57, noisy(0.6, 0.1, 1), "large")
    assert within.errors.mean < small.errors.mean
    assert recommended([within, small], ()).name == "small"
    assert recommended([beyond, small], ()).name == "large"


def test_a_much_smaller_model_is_preferred_where_errors_are_the_same_in_practice():
    large = model(53, noisy(1.0, 0.01), "large")
    for size, factor, name in ((5, 1.04, "small"), (5, 1.06, "large"), (30, 1.04, "large")):
        small = model(size, factor**2 * large.errors.means, "small")
        assert better(large.errors, than=small.errors)
        assert recommended([large, small], ()).name == name
        assert recommended([large, small], {"small"}).name == "large"
        assert recommended([large, small], {"large"}).name == ("small" if factor == 1.04 else "large")


def test_errors_are_the_same_in_practice_only_if_their_ratios_are():
    means = noisy(1e-3, 1e-4)
    means[7] = 10.0
    best, worse = (StretchErrors(each, np.full(16, 100.0)) for each in (means, np.where(means < 1, 1.3, 1.0) * means))
    assert worse.mean < 1.01 * best.mean
    assert not equivalent(worse, best)
    slightly = StretchErrors(np.where(means < 1, 1.15, 1.0) * means, best.samples)  # by 7 %, and 1 % over all samples
    assert equivalent(slightly, best)
    assert equivalent(best, worse)
    assert not equivalent(StretchErrors.of(np.full(32, np.inf)), best)


def test_few_data_do_not_excuse_a_much_larger_error():
    """Where one stretch makes most of the error, the noise of the mean is as large as the mean."""
    means = noisy(1e-3, 1e-4)
    means[7] = 10.0
    large = model(5, means, "large")
    for factor, name in ((1.05, "small"), (2.3, "large")):
        small = model(3, factor * means * noisy(1.0, 0.2, 3), "small")
        assert not better(large.errors, than=small.errors)
        assert recommended([small, large], ()).name == name
        assert recommended([small, large], {"large"}).name == name


def test_a_single_bad_stretch_decides_nothing_unless_it_doubles_the_error():
    even, once = model(9, noisy(1.0, 0.1), "even"), model(3, [*noisy(0.9, 0.1, 1)[:15], 12.0], "once")
    assert recommended([even, once], ()).name == "once"
    assert recommended([even, model(3, [*noisy(1.5, 0.1, 1)[:15], 12.0], "once")], ()).name == "even"
    much = model(3, [*noisy(0.9, 0.1, 1)[:15], 400.0], "once")
    assert not within_noise(much, even)
    assert recommended([even, much], ()).name == "even"


def test_among_equals_a_supported_model_comes_before_fewer_parameters():
    """A linear one comes first where it is as good and the input has few levels."""
    few = model(9, noisy(1.0, 0.1), "few")
    more = model(10, few.errors.means * np.exp(np.resize([0.1, -0.1], 16)), "more")
    worse = model(3, noisy(2.5, 0.1, 2), "worse")
    several = [few, more, worse]
    assert recommended(several, ()).name == "few"
    assert recommended(several, (), supported=lambda: ["more", "worse"]).name == "more"
    assert recommended(several, (), supported=lambda: ["worse"]).name == "few"
    assert recommended(several, (), supported=lambda: ["few", "more"]).name == "few"
    assert recommended(several, (), straight=["more", "worse"]).name == "more"
    assert recommended(several, (), straight=["worse"]).name == "few"


ONE_REPLACES_ANOTHER = [(1, 1.0, True, True), (1, 1.0, False, True), (1, 1.0, True, True)]
"""The third is tied with the best; the first has its size and a smaller error, and is certainly worse than the best."""


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.integers(1, 60), st.floats(0.5, 2.0), st.booleans(), st.booleans()), min_size=1, max_size=6),
    st.integers(0, 100),
)
@example([*ONE_REPLACES_ANOTHER, (1, 2.0, False, True), (1, 2.0, False, True), (2, 1.0, True, True)], 24)
def test_what_is_recommended_is_as_good_as_the_best_or_replaces_what_is(kinds, seed):
    ranking = [model(size, noisy(mean, 0.2, seed + k), str(k)) for k, (size, mean, _, _) in enumerate(kinds)]
    implausible = {str(k) for k, each in enumerate(kinds) if each[2]}
    unusable = {str(k) for k, each in enumerate(kinds) if each[3]}
    chosen = recommended(ranking, implausible, unusable)
    usable = [each for each in ranking if each.name not in unusable] or ranking
    assert chosen in usable
    same = [each for each in usable if (each.name in implausible) <= (chosen.name in implausible)]
    best = min(same, key=lambda each: each.errors.mean)
    tied = [
        each
        for each in same
        if not better(best.errors, than=each.errors) and not better_by_ratio(best.errors, than=each.errors)
    ]
    assert best in tied
    practically = equivalent(chosen.errors, min(usable, key=lambda each: each.errors.mean).errors)
    replaced = [e for e in tied if chosen.size <= e.size <= best.size and chosen.errors.mean <= e.errors.mean]
    assert replaced or practically


def test_an_implausible_model_has_to_be_better_by_more_than_noise():
    doubtful = model(5, noisy(1.0, 0.1), "doubtful")
    for factor, name in ((0.95, "plausible"), (3.0, "doubtful")):
        other = model(15, factor * np.exp(np.resize([0.5, -0.5], 16)), "plausible")
        assert other.errors.mean > doubtful.errors.mean
        assert recommended([doubtful, other], {"doubtful"}).name == name


def test_what_is_within_noise_of_a_plausible_model_is_not_so_of_the_best():
    """The simpler model is certainly worse than the best, which is implausible; against the other one it may not be."""
    doubtful = model(9, noisy(1.0, 0.1), "doubtful")
    uneven = model(15, doubtful.errors.means * np.exp(np.resize([0.5, -0.48], 16)), "uneven")
    simple = model(3, 1.15 * doubtful.errors.means, "simple")
    assert not better_by_ratio(uneven.errors, than=simple.errors)
    assert recommended([doubtful, uneven, simple], {"doubtful"}).name == "uneven"


def test_a_model_that_needs_all_data_is_ranked_by_its_fit_to_them_as_well():
    """The one fold favours the poor model by a little; fitted to all data, the rich one has a third of its error."""

    def errors(root, seed):
        return (StretchErrors(root**2 * noisy(1.0, 0.1, seed), np.full(16, 100.0)),)

    rich, poor = (replace(model(size, np.ones(16), name), folds=()) for size, name in ((20, "rich"), (9, "poor")))
    rich, poor = replace(rich, folds=errors(0.11, 1)), replace(poor, folds=errors(0.1, 2))
    assert recommended([rich, poor], ()).name == "poor"
    seen = [replace(rich, included=errors(0.03, 1)), replace(poor, included=errors(0.09, 2))]
    assert recommended(seen, ()).name == "rich"
    assert seen[0].errors.mean == pytest.approx(rich.errors.mean**0.632 * seen[0].included[0].mean ** 0.368)
    assert recommended([replace(seen[0], folds=errors(0.2, 1)), seen[1]], ()).name == "poor"
    decided = {each.name: pytest.approx(np.sqrt(each.errors.mean)) for each in seen}
    assert {row.model: row.error for row in front_rows(seen, "rich")} == decided  # the number that decided is shown


def test_a_run_that_diverges_on_a_part_left_out_stays_without_bound():
    left = StretchErrors(np.array([np.inf, 4.0, 0.0]), np.array([9.0, 9.0, 0.0]))
    assert left.mixed(StretchErrors(np.array([0.0, 1.0, 0.0]), left.samples), 0.5).means.tolist() == [np.inf, 2.0, 0.0]


def test_models_are_fitted_to_all_data_for_their_ranking_where_these_are_few(monkeypatch):
    fitted, choice = misleading()
    whole = emsid.concatenate([fitted, choice.best.record])
    for each in ranked(choice, fitted, Options()):
        again = free_run_error(refit(each.fit, whole), [whole])
        assert again < free_run_error(each.fit.model, [whole])
        included = StretchErrors.joined(each.included)
        assert included.samples.tolist() == each.left_out.samples.tolist()
        assert included.mean == pytest.approx(again / np.var(whole.output), rel=0.05)
    assert [each.included for each in ranked(choice, fitted, Options(), outside=drive(6, 900))] == [(), ()]
    monkeypatch.setattr(ranking_module, "LEAST", 1_000)
    assert [(len(each.folds), len(each.included)) for each in ranked(choice, fitted, Options())] == [(1, 1)] * 2
    monkeypatch.setattr(ranking_module, "MANY", 600)
    assert [each.included for each in ranked(choice, fitted, Options())] == [(), ()]


def misleading():
    """A record whose last part does not show the dead zone, and the models of all of it."""
    first = emsid.concatenate([drive(3, 1200, low=0.3, noise=0.05), drive(5, 300, low=-1.0, high=-0.3, noise=0.05)])
    last = drive(4, 600, low=0.4, noise=0.05)
    fits = [
        emsid.fit(emsid.arx(na=1, nb=1, constant=True), first, free_run=True),
        emsid.fit(emsid.Cascade((emsid.blocks.DeadZone(-0.1, 0.1, 1, 1), Rational([0.1], [-0.9], 1))), first),
    ]
    return first, compare(fits, last, data="choice")


def test_folds_over_the_whole_record_see_what_its_last_part_does_not_show():
    fitted, choice = misleading()
    found = ranked(choice, fitted, Options())
    assert [len(each.folds) for each in found] == [FOLDS, FOLDS]
    assert found[0].fit.model.name != "arx"
    assert recommended(found, ()).name == found[0].name
    ratios = [np.sqrt(arx.mean / cascade.mean) for cascade, arx in zip(found[0].folds, found[1].folds, strict=True)]
    assert ratios[0] < 1.3
    assert ratios[-1] > 5


def ranked_parts(whole, start):
    """How many samples each fold has, for two models of the first two thirds of a record."""
    several = emsid.arx(na=1, nb=1), emsid.Structure.parse("y(t-1)", "u(t-1)", "y(t-2)", name="two")
    first = 2 * len(whole) // 3
    choice = compare([emsid.fit(each, whole[:first]) for each in several], whole[first:], transient=start)
    found = ranked(choice, whole[:first], Options())
    assert all(fold_sizes(each.folds) == fold_sizes(each.included) for each in found)
    return [fold_sizes(each.folds) for each in found]


def fold_sizes(folds):
    return [fold.samples.sum() for fold in folds]


def test_runs_begin_anew_in_parts_that_are_long_and_go_on_through_short_ones():
    """A part that is no beginning of a segment is run on from that; a series keeps its experiments as parts."""
    assert ranked_parts(drive(8, 180), 8) == [[52, 32, 40, 40]] * 2
    assert ranked_parts(drive(8, 180), 9) == [[42, 40, 40, 40]] * 2
    assert list(map(sum, ranked_parts(drive(8, 180), 31))) == [120 - 31] * 2
    position = replace(drive(8, 180), output=np.cumsum(drive(8, 180).output + 0.5)[:, None])
    assert ranked_parts(position, 9) == [[51, 31, 40, 40]] * 2
    assert ranked_parts(replace(drive(8, 180), output_units=("m",)), 9) == [[51, 31, 40, 40]] * 2
    series = emsid.concatenate([drive(k, 20) for k in range(9)])
    assert ranked_parts(series, 9) == [[33, 22, 22, 22]] * 2


def test_a_short_record_with_its_large_values_in_one_part_ranks_by_stretches_of_all():
    """A model of the dead zone has the error of the noise where each fold lacks some of the large values only."""
    most = np.where(np.arange(51) < 34, 0.25, 1.0)
    first, last = drive(3, 400, low=-most, high=most), drive(5, 100, low=-0.25, high=0.25)
    fits = [
        emsid.fit(emsid.arx(na=1, nb=1, constant=True), first, free_run=True),
        emsid.fit(emsid.Cascade((emsid.blocks.DeadZone(-0.1, 0.1, 1, 1), Rational([0.1], [-0.9], 1))), first),
    ]
    dead_zone, arx = ranked(compare(fits, last, transient=32), first, Options())
    assert (dead_zone.name, arx.name) == ("cascade", "arx")
    spread = np.concatenate([first.output, last.output]).std()
    assert dead_zone.rmse[0] * spread == pytest.approx(0.02, rel=0.1)
    assert arx.rmse[0] > 2 * dead_zone.rmse[0]


def test_the_held_back_part_decides_alone_where_it_is_long_or_there_is_no_time(monkeypatch):
    fitted, choice = misleading()
    late = Control(cancelled=lambda: True)
    assert [len(each.folds) for each in ranked(choice, fitted, Options(), control=late)] == [1, 1]
    assert [len(each.folds) for each in ranked(choice, None, Options())] == [1, 1]
    assert [len(each.folds) for each in ranked(choice, fitted, Options(), {choice.rows[0].model})] == [1, 1]
    monkeypatch.setattr(ranking_module, "MANY", 600)
    assert [len(each.folds) for each in ranked(choice, fitted, Options())] == [1, 1]


def test_data_outside_an_excerpt_rank_models_without_another_fit(monkeypatch):
    fitted, choice = misleading()
    monkeypatch.setattr(ranking_module, "MANY", 600)
    monkeypatch.delattr(ranking_module, "refitted")
    found = ranked(choice, fitted, Options(), outside=drive(6, 900, noise=0.05))
    assert [len(each.folds) for each in found] == [FOLDS, FOLDS]
    assert [sum(fold.samples.sum() for fold in each.folds) > 1_400 for each in found] == [True, True]
    assert found[0].name != "arx"
    assert recommended(found, ()).name == found[0].name
    assert all(fold.mean < 0.5 * other.mean for fold, other in zip(found[0].folds[1:], found[1].folds[1:], strict=True))
    slivers = emsid.concatenate([drive(7, 9)] * 4)
    assert [len(each.folds) for each in ranked(choice, fitted, Options(), outside=slivers)] == [1, 1]


def test_the_fit_of_a_recommendation_is_that_over_the_folds():
    """The end hardly leaves the dead zone, where noise is a third of the motion, so another part is held back."""
    most = np.where(np.arange(151) < 105, 1.0, 0.3)
    result = emsid.identify(drive(1, low=-most, high=most), models="arx, friction-narx")
    (row,) = (each for each in result.front if each.model == result.chosen.model.name)
    assert row.folds == FOLDS
    said = result.recommendation[0].data["fit_percent"]
    assert said == pytest.approx(100 * (1 - row.error))
    assert said != result.on_unseen.best.row.fit_percent
    assert min(said, result.on_unseen.best.row.fit_percent) > 80
    assert "next-check-data" not in {each.code for each in result.next_steps}


def test_a_model_that_some_folds_do_not_suit_is_last():
    fitted, choice = misleading()
    never = ranking_module.refitted

    def refuses(fit, *arguments, **options):
        if fit.model.name == "arx":
            raise emsid.ModelError("these data do not suit it")
        return never(fit, *arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ranking_module, "refitted", refuses)
        found = ranked(choice, fitted, Options())
    assert found[-1].name == "arx"
    assert np.isinf(found[-1].errors.mean)


# --- the recommended model on all data -------------------------------------------------------------------------------


def test_the_recommended_model_is_fitted_again_to_all_data(monkeypatch):
    whole, other = drive(1), drive(2)
    result = emsid.identify(whole, models="friction-narx")
    structure = result.chosen.model.structure
    np.testing.assert_allclose(result.recommended.parameters, least_squares(structure, whole).estimate, rtol=1e-9)
    (finding,) = (each for each in result.findings if each.code == "fitted-to-all-data")
    numbers = {"samples": 1200, "of": len(result.record)}
    assert finding.data == {"model": "friction-narx", **numbers, "searched": False, "larger": False}
    errors = [free_run_error(model, [other]) for model in (result.chosen.model, result.recommended)]
    assert errors[1] < 1.05 * errors[0]

    given_by_name = emsid.identify(whole, other, models="friction-narx")
    assert given_by_name.on_all_data is None
    assert given_by_name.recommended is given_by_name.chosen.model
    monkeypatch.setattr(verdicts, "MANY", 300)
    long = emsid.identify(whole, models="friction-narx")
    assert "fitted-to-all-data" not in {each.code for each in long.findings}


def test_a_model_from_all_data_was_fitted_to_those_that_chose_it_too():
    whole = drive(1, samples=7000)
    result = emsid.identify(whole, models=("arx", "wiener-hammerstein-regression"), options=Options(na=1, nb=2, nk=1))
    assert result.on_all_data is not None
    assert result.on_choice is not None
    np.testing.assert_array_equal(result.fitted_by_recommended.output, whole.output)


def test_a_model_that_the_ranking_fitted_to_all_data_is_not_fitted_to_them_again(monkeypatch):
    monkeypatch.delattr(verdicts, "usable_refit")
    whole = drive(1)
    result = emsid.identify(whole, models=("arx", "friction-narx"))
    assert result.on_all_data is next(each.refit for each in result.ranking if each.fit is result.chosen)
    structure = result.chosen.model.structure
    np.testing.assert_allclose(result.recommended.parameters, least_squares(structure, whole).estimate, rtol=1e-9)


def test_another_fit_is_assessed_on_the_same_samples():
    """Of a segment that begins at rest all samples count, so they do not show how many start the others."""
    moving = drive(2)
    rest = replace(
        moving[:20], input=np.repeat([[0.0], [1.0]], 10, axis=0), output=np.repeat([[0.0], [0.7]], 10, axis=0)
    )
    record = emsid.concatenate([rest, moving])
    one, other = emsid.fit(emsid.arx(1, 1), record), emsid.fit(emsid.arx(3, 3), record)
    both = compare([one, other], record)
    assert {each.row.samples for each in both.with_fit(one).assessments} == {both.rows[0].samples}


def limited(seed: int, large: int) -> emsid.Record:
    """A limit at 1 in a loop; the input reaches it in so many samples at the end only."""
    rng = np.random.default_rng(seed)
    u, y = np.repeat(rng.uniform(-0.8, 0.8, 200), 5), np.zeros(1000)
    u[len(u) - large :] *= 4
    for t in range(1, len(u)):
        y[t] = 0.5 * y[t - 1] + np.clip(0.5 * u[t - 1] - 0.3 * y[t - 1], -0.4, 0.4)
    return emsid.Record(u, y + 0.005 * rng.standard_normal(len(y)), 0.01)


@pytest.mark.parametrize("many", [verdicts.MANY, pytest.param(100, marks=pytest.mark.long)])
def test_the_structure_is_chosen_again_where_the_held_back_part_shows_what_it_lacks(monkeypatch, many):
    monkeypatch.setattr(verdicts, "MANY", many)
    result = emsid.identify(limited(3, 300), models="feedback")  # of record 1, both structures are equal to rounding
    (finding,) = (each for each in result.findings if each.code == "fitted-to-all-data")
    assert finding.data["searched"]
    other = limited(2, 1000)
    errors = [np.sqrt(free_run_error(model, [other])) for model in (result.chosen.model, result.recommended)]
    assert errors[0] > 0.03
    assert errors[1] < 0.0055


def test_no_structure_is_chosen_again_from_very_many_samples(monkeypatch):
    monkeypatch.setattr(verdicts, "SEARCHED_AGAIN", 1200)
    monkeypatch.setattr(verdicts, "_structure_is_doubtful", lambda judged: True)
    monkeypatch.setattr(verdicts, "CANDIDATES", {"arx": lambda *_: pytest.fail("searched")})
    result = emsid.identify(drive(1), models="arx", options=Options(na=2, nb=2, nk=1))
    assert [each.data["searched"] for each in result.findings if each.code == "fitted-to-all-data"] == [False]


def test_refinements_of_a_motor_are_chosen_again_where_the_held_back_part_shows_what_it_lacks():
    case = motor(4405, 400)
    result = emsid.identify(replace(case.fitted, output_units=("rad/s",)), models="rigid-motor")
    (finding,) = (each for each in result.findings if each.code == "fitted-to-all-data")
    assert finding.data["searched"]
    errors = [np.sqrt(free_run_error(model, [case.unseen])) for model in (result.chosen.model, result.recommended)]
    truth = case.error_of_truth(case.unseen)
    assert errors[0] > 1.5 * truth
    assert errors[1] < 1.1 * truth


def test_a_structure_that_simulates_all_data_worse_is_not_taken(monkeypatch):
    monkeypatch.setattr(verdicts, "_structure_is_doubtful", lambda judged: True)
    searches = [emsid.arx(1, 1, nk=40), emsid.arx(2, 2)]
    fits = {"arx": lambda record, options, control: emsid.fit(searches.pop(0), record)}
    monkeypatch.setattr(verdicts, "CANDIDATES", fits)
    for taken in (False, True):
        result = emsid.identify(drive(1), models="arx", options=Options(na=2, nb=2, nk=1))
        (finding,) = (each for each in result.findings if each.code == "fitted-to-all-data")
        assert finding.data["searched"] is taken


def test_a_structure_of_a_rectified_output_is_chosen_by_its_search_in_short_records(monkeypatch):
    """The search compares models on data left out; a smaller one is chosen though it follows all data less closely."""
    for model, hides in ((before_sensor(), True), (loop(), False)):
        assert capabilities_of(model).hides_the_sign(model) is hides
    monkeypatch.setattr(Capabilities, "hides_the_sign", lambda self, model: True)
    worse = {"arx": lambda record, options, control: emsid.fit(emsid.arx(1, 1, nk=40), record)}
    monkeypatch.setattr(verdicts, "CANDIDATES", worse)
    for shortest, taken in ((1201, True), (1200, False)):
        monkeypatch.setattr(verdicts, "SHORT", shortest)
        result = emsid.identify(drive(1), models="arx", options=Options(na=2, nb=2, nk=1))
        assert [each.data["searched"] for each in result.findings if each.code == "fitted-to-all-data"] == [taken]


# --- the front -------------------------------------------------------------------------------------------------------


def test_a_model_is_on_the_front_where_more_parameters_pay():
    ranking = [
        model(40, noisy(0.2, 0.02, 2) * 0.995, "much larger"),
        model(12, noisy(0.2, 0.02, 2), "large"),
        model(12, noisy(0.9, 0.02, 2), "as large and worse"),
        model(3, noisy(0.8, 0.02, 1), "small"),
        model(1, [np.inf] * 16, "diverges"),
    ]
    rows = front_rows(ranking, "large")
    assert [row.model for row in rows] == ["diverges", "small", "large", "as large and worse", "much larger"]
    assert [row.model for row in rows if row.on_front] == ["small", "large"]
    assert [row.model for row in rows if row.recommended] == ["large"]
    assert all(row.low < row.error < row.high for row in rows[1:])
    assert np.isnan(rows[0].low)


def test_a_much_smaller_error_is_on_the_front_however_uneven_it_is():
    """Where one stretch makes most of the error, the noise of the mean is as large as the mean."""
    large, small = model(3, [0.02] * 15 + [9.0], "large"), model(6, noisy(0.01, 0.001, 2), "small")
    assert not better(small.errors, than=large.errors)
    assert [row.model for row in front_rows([small, large], "small") if row.on_front] == ["large", "small"]


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 60), st.floats(0.5, 2.0)), min_size=1, max_size=8), st.integers(0, 100))
def test_nothing_simpler_is_as_good_as_a_model_on_the_front(kinds, seed):
    ranking = [model(size, noisy(mean, 0.1, seed + k), str(k)) for k, (size, mean) in enumerate(kinds)]
    kept = front(ranking, lambda each: each.size)
    assert kept
    for simple, rich in pairwise(kept):
        assert simple.size < rich.size or simple.errors.mean == rich.errors.mean
        assert better(rich.errors, than=simple.errors)
    for each in ranking:
        simpler = [one for one in kept if one.size <= each.size]
        assert any(one is each or not better(each.errors, than=one.errors) for one in simpler)


def test_the_front_is_drawn_with_its_numbers_and_standard_errors():
    rows = front_rows([model(3, noisy(0.8, 0.1), "small"), model(9, noisy(0.2, 0.1, 1), "large")], "large")
    figure = front_figure(rows)
    (plot,) = page_figure(figure).plots
    assert {text for _, _, text in plot.notes} == {"1", "2"}
    assert all(0 <= left <= 100 and 0 <= bottom <= 100 for left, bottom, _ in plot.notes)
    assert plot.y.log
    assert len(plot.y.ticks) > 1
    assert [entry.label for entry in page_figure(figure).legend] == ["front", "other models", "recommended"]
    without = front_figure(front_rows([model(3, noisy(0.8, 0.1), "small"), model(9, noisy(0.2, 0.1, 1), "large")], ""))
    assert [entry.label for entry in page_figure(without).legend] == ["front", "models"]
    assert b"<svg" in draw(figure)["svg"]
    assert front_figure(rows[:1]) is None


def test_points_that_cover_each_other_have_one_label():
    errors = noisy(0.8, 0.1)
    ranking = [model(3, errors, "one"), model(3, 1.001 * errors, "same"), model(3, 3 * errors, "worse")]
    (plot,) = page_figure(front_figure(front_rows([*ranking, model(9, errors, "large")], "one"))).plots
    assert {text for _, _, text in plot.notes} - {""} == {"1, 2", "3", "4"}
