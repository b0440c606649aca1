"""Whether numbers mean what they say, on records of a simulator of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

import coverage_settings
import emsid
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.uncertainty.whiteness import absorbed, whiteness
from emsid.findings import Finding
from emsid.identification.evidence import (
    about_nonlinear_terms,
    chosen_and_judged_apart,
    observations,
)
from emsid.identification.result import characteristics
from emsid.identification.task import understood
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import GreyBoxFit, Status
from emsid.record import Record, concatenate
from emsid.record.holding_back import fingerprint, has_common_samples, has_fingerprint
from emsid.report.identification_page import which_model
from emsid.report.notebook import parameter_rows
from emsid.report.views import parameter_table
from emsid.validation.comparison import assess_model
from emsid.validation.correlation import cross_correlation, nonlinear_terms, nonlinear_tests
from independent.fitting import START, fitted
from independent.misfits import FREE, MISFITS
from independent.regressions import EQUATIONS, Equation
from independent.settings import DT, RESISTANCE, SETTINGS, TRUTH, mass_of

ABSENT, WRONG, WHITE = (SETTINGS[name] for name in ("absent dead zone", "wrong fixed value", "white"))
WIDTH = "voltage_dead_zone.half_width"


def row_of(fit: GreyBoxFit, name: str):
    return next(row for row in fit.table if row.name == name)


def codes(fit: Fit) -> set[str]:
    return {finding.code for finding in fit.findings}


# --- a parameter that is zero ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def without_dead_zone() -> list[GreyBoxFit]:
    return [fitted(ABSENT, seed) for seed in range(3)]


def test_a_parameter_that_is_zero_is_identifiable(without_dead_zone):
    for fit in without_dead_zone:
        assert not codes(fit) & {"not-identifiable", "weakly-identified"}
        assert fit.names == tuple(TRUTH)
        low, high = row_of(fit, WIDTH).interval
        assert low <= 0 < high < 0.2
        assert fit.interval()[-1] == pytest.approx([low, high], rel=1e-3)


def test_a_parameter_at_its_bound_has_the_interval_of_its_profile(without_dead_zone):
    fit = next(fit for fit in without_dead_zone if row_of(fit, WIDTH).status is Status.AT_BOUND)
    row = row_of(fit, WIDTH)
    assert (row.value, row.interval[0], row.standard_error) == (0.0, 0.0, None)
    written = next(each for each in fit.to_data()["parameters"] if each["name"] == WIDTH)
    assert written["interval"] == list(row.interval)


def test_a_drive_in_one_direction_gives_no_advice_about_a_bound_that_it_does_not_show():
    fit = driven_one_way(coasting=False)
    (finding,) = (each for each in fit.findings if each.code == "parameter-at-bound")
    assert finding.subject == WIDTH
    assert (finding.data["because"], finding.data["one_way"]) == ("inseparable", True)
    assert finding.data["others"] == ["rotor_friction.coulomb"]
    assert finding.data["zone_unseen"]
    assert row_of(fit, WIDTH).interval is None
    assert WIDTH in row_of(fit, "rotor_friction.coulomb").given


def test_a_drive_that_never_coasts_does_not_tell_a_dead_zone_from_friction():
    (finding,) = (each for each in driven_one_way(coasting=False, seed=0).findings if each.code == "not-identifiable")
    assert finding.data["parameters"] == ["rotor_friction.coulomb", WIDTH]
    assert finding.data["zone_unseen"]


def test_a_drive_that_coasts_at_zero_tells_a_dead_zone_from_friction():
    fit = driven_one_way(coasting=True)
    assert not any(finding.data.get("zone_unseen") for finding in fit.findings)
    width, level = row_of(fit, WIDTH), row_of(fit, "rotor_friction.coulomb")
    assert width.value == pytest.approx(TRUTH[WIDTH], abs=0.05)
    assert level.value == pytest.approx(TRUTH["rotor_friction.coulomb"], rel=0.1)


def driven_one_way(coasting: bool, seed: int = 3) -> GreyBoxFit:
    """A fit to a drive that is always above its dead zone, but for a second at zero if it is to coast."""
    rng = np.random.default_rng(seed)
    volts = np.repeat(rng.uniform(1.0, 6.0, 40), 40)
    if coasting:
        volts[800:1000] = 0.0
    speed = mass_of(TRUTH).run(volts, DT)[0][:1600] + 0.3 * rng.standard_normal(1600)
    record = Record(volts, speed, DT, input_units=("V",), output_units=("rad/s",))
    return simulation_error(START, record, free=tuple(TRUTH), fixed={"resistance": RESISTANCE})


# --- values that are held --------------------------------------------------------------------------------------------


def test_estimates_name_the_held_values_that_they_depend_on():
    fit = fitted(WRONG, 0)
    assert [row_of(fit, name).given for name in TRUTH] == [(), ("resistance",), ("resistance",), ()]
    assert row_of(fit, "rotor_inertia").status is Status.CONDITIONAL
    assert row_of(fit, "motor_constant").status is Status.ESTIMATED
    written = {each["name"]: each["given"] for each in fit.to_data()["parameters"]}
    assert written["rotor_inertia"] == ["resistance"]
    assert written["motor_constant"] == []


def test_combinations_said_to_be_independent_of_held_values_are():
    truth = RESISTANCE * TRUTH["rotor_inertia"] / TRUTH["motor_constant"] ** 2
    fit = fitted(WRONG, 0)
    (time,) = (each for each in fit.combinations if each.quantity.formula == "R·J/K²")
    assert time.given == ()
    assert time.interval[0] < truth < time.interval[1]
    none = fitted(WRONG, 0, fixed={"rotor_viscous": 0.0})
    (settling,) = (each for each in none.combinations if each.quantity.formula == "J/(B + K²/R)")
    assert settling.given == ()
    held = fitted(WRONG, 0, fixed={"rotor_viscous": 1e-4})  # 4 % of the damping, which is not there
    (time,) = (each for each in held.combinations if each.quantity.formula == "R·J/K²")
    assert "rotor_viscous" in time.given
    assert not time.interval[0] < truth < time.interval[1]
    (pull,) = (each for each in held.combinations if each.quantity.formula == "K/(R·J)")
    assert pull.given == ()
    assert pull.interval[0] < TRUTH["motor_constant"] / RESISTANCE / TRUTH["rotor_inertia"] < pull.interval[1]


def test_the_tolerance_of_a_datasheet_widens_what_depends_on_it():
    sheet = {"resistance": {"value": 1.1, "tolerance": "20 %"}}
    names = ("resistance", *TRUTH)
    fit = simulation_error(START, WHITE.record(0), free=names, fixed={"rotor_viscous": 0.0}, datasheet=sheet)
    assert row_of(fit, "resistance").status is Status.KEPT
    inertia = row_of(fit, "rotor_inertia")
    assert "resistance" not in inertia.given
    assert inertia.interval[0] < TRUTH["rotor_inertia"] < inertia.interval[1]
    assert 0.05 < inertia.standard_error / inertia.value < 0.2


def test_the_tolerance_of_a_fixed_value_widens_what_depends_on_it():
    given = fitted(WRONG, 0)
    told = fitted(WRONG, 0, fixed={"resistance": "1.1 ohm ± 20 %"})
    assert told.estimate == pytest.approx(given.estimate)
    for row in told.table:
        assert row.given == ()
        if row.interval is not None:
            assert row.interval[0] < WRONG.truth[row.name] < row.interval[1]
    shift = 0.2 / np.sqrt(3)  # J and T_c of a motor with voltage and speed are proportional to 1/R
    for name in ("rotor_inertia", "rotor_friction.coulomb"):
        wide, narrow = (row_of(fit, name).standard_error / row_of(fit, name).value for fit in (told, given))
        assert np.sqrt(wide**2 - narrow**2) == pytest.approx(shift, rel=0.1)
    (before,), (time,) = ([q for q in fit.combinations if q.quantity.formula == "R·J/K²"] for fit in (given, told))
    assert time.standard_error == pytest.approx(before.standard_error, rel=0.05)  # it does not depend on R
    constant = row_of(told, "motor_constant")
    assert constant.standard_error == pytest.approx(row_of(given, "motor_constant").standard_error, rel=0.05)
    with pytest.raises(emsid.EmsidError, match="tolerance"):
        fitted(WRONG, 0, fixed={"resistance": "1.1 ohm ± some"})


def test_a_fixed_value_may_have_a_tolerance():
    options = understood(emsid.Options(fixed={"R": "2 ohm +- 5 %", "rotor_viscous": "0"}), ["rigid-motor"])
    assert options.fixed == {"resistance": 2.0, "rotor_viscous": 0.0}
    assert options.datasheet["resistance"].tolerance == pytest.approx(0.05)


# --- a search that stalled -------------------------------------------------------------------------------------------


class Parabola:
    """r = x − 1 in each of ten samples."""

    def residuals(self, theta):
        return [np.full(10, theta[0] - 1.0) + np.linspace(-1, 1, 10)]

    def linearised(self, theta):
        return [(self.residuals(theta)[0], np.ones((10, 1)))]


def stalled(offset: float | None) -> Minimum:
    """The minimum of a search that stalled this many standard errors away."""
    found = gauss_newton(Parabola(), np.zeros(1))
    finding = Finding("search-stalled", data={"steps": 3, "offset": offset})
    return replace(found, ending=Ending.STALLED, findings=(finding,))


@pytest.mark.parametrize("offset", [None, 4.0])
def test_a_search_that_stalled_away_from_a_minimum_gives_no_intervals(offset: float | None):
    fit = stalled(offset).judged().fit(object(), ["x"])
    assert fit.ending is Ending.STALLED
    assert fit.to_data()["parameters"][0]["interval"] == [None, None]
    assert "search-stalled" in codes(fit)


def test_a_search_that_stalled_at_a_minimum_gives_its_intervals():
    fit = stalled(0.05).judged().fit(object(), ["x"])
    assert fit.ending is Ending.CONVERGED
    assert np.isfinite(fit.standard_error).all()
    assert "search-stalled" not in codes(fit)


def test_a_motor_whose_search_stalled_has_no_interval_anywhere(monkeypatch):
    def in_steps(error, dt):  # its derivative leads astray
        return np.round(error, 3)

    monkeypatch.setattr("emsid.estimation.nonlinear.restarts.RESTARTS", 0)
    record = WHITE.record(0, 300)
    fit = simulation_error(START, record, free=tuple(TRUTH), fixed={"resistance": RESISTANCE}, weighting=in_steps)
    assert fit.ending is Ending.STALLED
    assert "search-stalled" in codes(fit)
    written = fit.to_data()
    assert {row.interval for row in fit.table} == {None}
    assert {tuple(each["interval"] or (None, None)) for each in written["parameters"]} == {(None, None)}
    assert {tuple(each["interval"]) for each in written["combinations"]} <= {(None, None)}
    assert not any("…" in row.interval for row in parameter_rows(fit))


# --- regressions -----------------------------------------------------------------------------------------------------

EQUATION, OUTPUT, COLOURED = (EQUATIONS[name] for name in ("white", "output noise", "inputs only, coloured"))


def share_covered(equation: Equation, records: int) -> float:
    """The smallest share of intervals that hold a coefficient."""
    structure = emsid.arx(len(equation.poles), len(equation.zeros))
    intervals = [emsid.fit(structure, equation.record(seed)).interval().T for seed in range(records)]
    return float(
        np.min(np.mean([(low <= equation.truth) & (equation.truth <= high) for low, high in intervals], axis=0))
    )


def test_noise_on_the_output_of_a_regression_is_said_to_bias_it():
    fits = [emsid.fit(emsid.arx(2, 2), OUTPUT.record(seed)) for seed in range(10)]
    assert all("regression-biased" in codes(fit) for fit in fits)
    rows = fits[0].to_data()["parameters"]
    assert {(row["status"], row["interval"]) for row in rows} == {("of the one-step predictor", None)}
    assert {row[-2] for row in parameter_table(fits[0]).rows} == {"none: of the one-step predictor"}
    assert {row.interval for row in parameter_rows(fits[0])} == {"of the one-step predictor"}
    gains = characteristics(emsid.compare(fits[:1], OUTPUT.record(11)), OUTPUT.record(0))
    assert gains
    assert {gain.half_width for gain in gains} == {None}
    clean = [emsid.fit(emsid.arx(2, 2), EQUATION.record(seed)) for seed in range(40)]
    assert sum("regression-biased" in codes(fit) for fit in clean) <= binom.ppf(0.999, 40, 0.03)
    assert clean[0].to_data()["parameters"][0]["status"] == "estimated"
    assert parameter_table(clean[0]).rows[0][-2] != "none: estimated"


def test_intervals_of_a_regression_allow_for_a_coloured_residual():
    fit = emsid.fit(emsid.arx(0, 3), COLOURED.record(0))
    assert "intervals-allow-for-colour" in codes(fit)
    least = binom.ppf(1e-3, 150, 0.92) / 150
    assert share_covered(COLOURED, 150) >= least
    assert share_covered(EQUATION, 150) >= least
    assert "intervals-allow-for-colour" not in codes(emsid.fit(emsid.arx(2, 2), EQUATION.record(0)))


def test_the_test_of_a_residual_counts_what_was_estimated():
    rng = np.random.default_rng(0)
    rejected = []
    for _ in range(300):
        y = lfilter([1], [1, -0.5, 0.3], rng.standard_normal(500))
        past = np.column_stack([y[1:-1], y[:-2]])
        left = y[2:] - past @ np.linalg.lstsq(past, y[2:])[0]
        rejected.append([whiteness([left], coefficients, 8).p_value < 0.05 for coefficients in (2, 0)])
    right, wrong = np.mean(rejected, axis=0)
    assert binom.ppf(1e-3, 300, 0.05) / 300 <= right <= binom.ppf(0.999, 300, 0.06) / 300
    assert wrong < right
    assert whiteness([np.zeros(100)], 0) is None
    assert whiteness([np.ones(5)], 0) is None


def test_an_estimate_takes_from_the_test_of_its_residual_what_its_regressors_share_with_it():
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(4000)
    y = lfilter([1], [1, -0.5, 0.3], noise)
    assert absorbed([(noise[2:], np.column_stack([y[1:-1], y[:-2]]))]) == pytest.approx(2.0, abs=0.2)
    assert absorbed([(noise, rng.standard_normal((4000, 3)))]) == pytest.approx(0.0, abs=0.1)
    quiet, loud = replace(EQUATION, equation=0.002), replace(EQUATION, equation=1.0)  # poles from input, from noise
    for equation, few, many in ((quiet, 0.0, 0.2), (loud, 1.2, 2.0)):
        record = equation.record(0, 4000)
        y, u = record.output[:, 0], record.input[:, 0]
        phi = np.column_stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2]])
        assert few <= absorbed([(y[2:] - phi @ equation.truth, phi)]) <= many


def test_the_coverage_program_counts_what_claims_to_be_unconditional():
    shares = coverage_settings.shares(OUTPUT, 20)
    assert all(share.given and not share.wrong for share in shares.values())
    assert min(share.covered for share in shares.values()) < 0.5
    shares = coverage_settings.shares(EQUATION, 20)
    assert all(not share.given and not share.wrong for share in shares.values())
    assert coverage_settings.Share(0.5, 100, False).wrong
    found = coverage_settings.shares(WRONG, 3)
    assert [found[name].given for name in TRUTH] == [False, True, True, False]
    assert not any(share.wrong for share in found.values())


@pytest.mark.parametrize(
    ("name", "conditional"),
    [("no dead zone", False), ("jittered stamps", False), ("Stribeck, not modelled", True), ("random walk", True)],
)
def test_intervals_of_a_small_structure_hold_the_truth_or_a_finding_limits_them(name, conditional):
    found = coverage_settings.shares(MISFITS[name], 3)
    assert set(found) == set(FREE)
    assert all(share.given == conditional and not share.wrong for share in found.values())
    if name == "Stribeck, not modelled":
        assert min(share.covered for share in found.values()) < 0.5


# --- one-step errors, unseen data, correlation with powers -----------------------------------------------------------


@pytest.mark.parametrize(
    "model", [Cascade((Rational([0.1], [-0.9]),)), GreyBox(START, (Signal.SPEED,))], ids=["cascade", "plant"]
)
def test_a_model_without_noise_has_no_one_step_error(model):
    row = assess_model(model, WHITE.record(0, 300)).row
    assert np.isnan(row.one_step_mse)
    assert row.to_data()["one_step_mse"] is None
    arx = emsid.fit(emsid.arx(1, 1), WHITE.record(0, 300)).model
    assert assess_model(arx, WHITE.record(0, 300)).row.one_step_mse > 0


def noise_and_models(seed: int, samples: int = 500) -> emsid.Comparison:
    """Ten gains that have nothing to do with a record of noise."""
    rng = np.random.default_rng([6, seed])
    record = Record(rng.standard_normal(samples), rng.standard_normal(samples), 0.1)
    return emsid.compare([Cascade((Rational([gain]),)) for gain in 0.15 * rng.standard_normal(10)], record)


def test_the_error_of_the_best_of_several_models_is_judged_where_it_was_not_chosen():
    comparisons = [noise_and_models(seed) for seed in range(60)]
    best = np.mean([comparison.best.row.simulation_mse for comparison in comparisons])
    typical = np.mean([np.mean([row.simulation_mse for row in comparison.rows]) for comparison in comparisons])
    apart = np.mean([chosen_and_judged_apart(comparison)[0] ** 2 for comparison in comparisons])
    assert best < apart < typical
    found = observations(comparisons[0], WHITE.record(0, 50), comparisons[0].best.record, {})
    (finding,) = (each for each in found if each.code == "free-run-error")
    assert finding.data["chosen_among"] == 10
    assert len(finding.data["apart"]) == 1
    assert chosen_and_judged_apart(noise_and_models(0, 300)) is None


@pytest.mark.parametrize("given", [False, True], ids=["a fraction", "a record of its own"])
def test_the_error_of_the_chosen_model_is_from_data_that_did_not_choose_it(given):
    record = WHITE.record(0, 5000)
    data = (record[:3000], record[3000:]) if given else (record, 0.4)
    result = emsid.identify(*data, models="arx,friction-narx", options=emsid.Options(na=1, nb=1))
    (finding,) = (each for each in result.findings if each.code == "free-run-error")
    if given:
        assert result.on_choice is None
        assert len(finding.data["apart"]) == 1
        return
    choice, unseen = result.on_choice, result.unseen
    assert (len(choice.best.record), len(unseen)) == (1000, 1000)
    assert not has_common_samples(choice.best.record, unseen)
    errors = [row.simulation_mse for row in choice.rows]
    assert errors == sorted(errors)
    assert [fit.model.name for fit in result.fits] == [row.model for row in choice.rows]
    assert finding.data["chosen_on"] == choice.best.row.samples
    assert finding.data["outputs"][0]["rmse"] == pytest.approx(result.on_unseen.best.row.simulation_rmse)
    assert {row["data"] for row in result.to_data()["rows"]} == {"identification", "choice", "unseen"}
    other = replace(result, on_unseen=result.on_unseen.in_order_of(result.fits[::-1]))
    for each in (result, other):
        (table,) = which_model(each).tables
        (rmse,) = [k for k, head in enumerate(table.header) if head.startswith("RMSE")]
        errors = [float(row[rmse]) for row in table.rows]
        assert errors == sorted(errors)
        assert {table.rows[k][0] for k in table.emphasised} == {each.chosen.model.name}
        assert [row.model for row in each.on_unseen.by_error.rows] == [row[0] for row in table.rows]
        for name, on in (("unseen", each.on_unseen), ("choice", each.on_choice), ("used in fit", each.on_record)):
            fits = {row.model: f"{row.fit_percent:.2f}" for row in on.rows}
            assert {row[0]: row[table.header.index(f"Fit % {name}")] for row in table.rows} == fits
        verdicts = {row[0]: row[-1] for row in table.rows}
        assert verdicts[each.chosen.model.name].startswith("recommended; ") == each.is_recommended


def test_overlapping_records_are_seen():
    whole = WHITE.record(0, 600)
    assert has_common_samples(whole[300:500], whole)
    assert has_common_samples(whole[1:], whole[:-1])
    assert has_common_samples(whole[:200], whole[168:])
    assert not has_common_samples(whole[:300], whole[300:])
    assert not has_common_samples(WHITE.record(1, 600), whole)


def test_a_fingerprint_is_that_of_the_samples():
    whole, other = WHITE.record(0, 600), WHITE.record(1, 600)
    known = fingerprint(whole[:400])
    assert has_fingerprint(whole, known)
    assert has_fingerprint(whole[350:], known) is False  # 50 samples are fewer than a stretch
    assert has_fingerprint(concatenate([other, whole[150:300]]), known)
    assert not has_fingerprint(whole[400:], known)
    assert not has_fingerprint(other, known)


def test_a_fingerprint_shows_a_small_part_of_a_long_record():
    whole = WHITE.record(0, 100_000)
    known = fingerprint(whole)
    assert len(known) < 1_000
    assert has_fingerprint(whole[61_200:62_500], known)


def test_constant_speed_and_short_records_have_no_fingerprint():
    """At 3.5 counts a sample, the counts 3 and 4 take turns in every experiment."""
    turns, rng = np.tile([3.0, 4.0], 60), np.random.default_rng(0)
    one, other = (Record(np.ones(320), np.concatenate([rng.integers(0, 9, 200), turns]), 0.1) for _ in range(2))
    assert has_fingerprint(one, fingerprint(one))
    assert not has_fingerprint(other, fingerprint(one))
    assert fingerprint(WHITE.record(0, 40)) == fingerprint(one[200:]) == b""


def test_coarse_readings_that_repeat_by_chance_are_not_an_overlap():
    """At a constant input, two counts that take turns are equal for 40 samples."""
    turns, rng = np.tile([3.0, 4.0], 20), np.random.default_rng(0)
    one, other = (Record(np.ones(240), np.concatenate([rng.integers(0, 9, 200), turns]), 0.1) for _ in range(2))
    assert not has_common_samples(one, other)


def test_the_end_of_a_record_at_constant_speed_is_unseen():
    """The last stretch of the fitted part is like the first of the rest: 55.4 counts a sample in whole counts."""
    y = np.diff(np.floor(55.4 * np.arange(301)))
    y[:20] = np.arange(20)
    record = Record(np.where(np.arange(300) < 5, 0.0, 255.0), y, 0.01)
    assert not has_common_samples(record[200:], record[:200])
    assert has_common_samples(record[:200], record)


def test_a_short_end_that_is_like_the_beginning_of_the_rest_is_no_overlap():
    counts = 55.0 + np.random.default_rng(0).integers(0, 2, 200)
    counts[100:116] = counts[84:100]
    record = Record(np.full(200, 255.0), counts, 0.01)
    assert not has_common_samples(record[100:], record[:100])
    assert has_common_samples(record[68:], record[:100])


def test_standstills_of_two_records_are_not_an_overlap():
    rest = np.zeros(100)
    one, other = (np.concatenate([rest, np.random.default_rng(k).standard_normal(100)]) for k in (0, 1))
    assert not has_common_samples(Record(one, one, 0.1), Record(other, other, 0.1))


def dead_zone_record(edge: float) -> Record:
    rng = np.random.default_rng(5)
    u = lfilter([np.sqrt(1 - 0.81)], [1, -0.9], rng.standard_normal(3000))
    through = np.sign(u) * np.maximum(np.abs(u) - edge, 0.0)
    y = lfilter([0, 0.2], [1, -0.8], through)
    return Record(u, y + 0.02 * rng.standard_normal(3000), 0.01)


def test_a_cube_shows_the_odd_nonlinearity_that_the_input_does_not():
    record = dead_zone_record(1.0)
    fit = emsid.fit(emsid.arx(0, 60), record)
    best = assess_model(fit.model, record)
    error = np.where(best.simulation.counted, (record.output - best.simulation.output)[:, 0], np.nan)
    u = record.input[:, 0]
    assert np.max(np.abs(cross_correlation(error, u, (), 50)[50:])) < 3.5
    square, cube, absolute, product = best.nonlinear_tests[0]
    assert (square.term, cube.term, absolute.term) == ("u1²", "u1³", "|u1|")
    assert cube.depends
    assert abs(cube.largest) > 2 * cube.limit
    assert not square.depends
    assert not absolute.depends
    assert not product.depends
    (finding,) = about_nonlinear_terms(best)
    assert (finding.code, finding.data["term"], finding.data["kind"]) == ("residual-depends-on-term", "u1³", "odd")
    linear = dead_zone_record(0.0)
    assert not about_nonlinear_terms(assess_model(emsid.fit(emsid.arx(0, 60), linear).model, linear))


@pytest.mark.parametrize(
    ("missing", "term"),
    [(lambda u: np.maximum(u, 0.0), "a²"), (lambda u: u**3, "a³"), (lambda u: 1.0 * (np.abs(u) < 0.2), "|a|")],
    ids=["one side", "cube", "around zero"],
)
def test_every_kind_of_nonlinearity_is_seen_by_its_own_term(missing, term):
    rng = np.random.default_rng(9)
    a = lfilter([0.6], [1, -0.8], rng.standard_normal(3000))
    error = lfilter([0, 1], [1, -0.5], missing(a)) + 0.2 * rng.standard_normal(3000)
    powers = np.vander(a, 2)
    tests = nonlinear_tests(error - powers @ np.linalg.lstsq(powers, error)[0], nonlinear_terms(a[:, None], "a"), ())
    assert max(tests, key=lambda test: abs(test.largest)).term == term
    assert max(abs(test.largest) / test.limit for test in tests) > 2


def test_the_product_of_two_inputs_is_seen_and_noise_is_not():
    rng = np.random.default_rng(8)
    alarms = 0
    for _ in range(40):
        inputs = rng.standard_normal((600, 2))
        noise = lfilter([1], [1, -0.7], rng.standard_normal(600))
        tests = nonlinear_tests(noise, nonlinear_terms(inputs, "ab"), (300,))
        alarms += any(test.depends for test in tests)
    assert [test.term for test in tests] == ["a²", "a³", "|a|", "b²", "b³", "|b|", "a·b"]
    assert alarms <= binom.ppf(0.999, 40, 0.02)
    error = np.roll(inputs[:, 0] * inputs[:, 1], 2) + rng.standard_normal(600)
    (found,) = (test for test in nonlinear_tests(error, nonlinear_terms(inputs, "ab"), ()) if test.depends)
    assert (found.term, found.kind, found.at_lag) == ("a·b", "product", 2)


def test_an_input_of_two_values_has_no_powers():
    u = np.sign(np.random.default_rng(0).standard_normal(500))
    assert nonlinear_terms(u[:, None], "u") == []
