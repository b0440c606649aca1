"""The public face: nouns build values, verbs take any of them, and what is typed by reflex works or is answered."""

from __future__ import annotations

import numpy as np
import pytest

import emsid


@pytest.fixture(scope="session")
def linear_record():
    """1200 samples of y(t) = 0.8·y(t−1) + 0.5·u(t−1) with a little noise."""
    rng = np.random.default_rng(1)
    u = rng.standard_normal(1200)
    y = np.zeros(1200)
    for t in range(1, 1200):
        y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1]
    return emsid.Record(u, y + 0.01 * rng.standard_normal(1200), dt=0.01, name="bench")


@pytest.fixture(scope="session")
def linear_fit(linear_record):
    return emsid.fit(emsid.arx(na=1, nb=1), linear_record)


# --- fit -------------------------------------------------------------------------------------------------------------


def test_a_structure_is_fitted_by_least_squares(linear_record):
    fit = emsid.fit(emsid.arx(na=1, nb=1), linear_record)
    assert np.array_equal(fit.estimate, emsid.least_squares(emsid.arx(na=1, nb=1), linear_record).estimate)
    ridge = emsid.fit(emsid.arx(na=1, nb=1), linear_record, ridge=100.0)
    assert np.linalg.norm(ridge.estimate) < np.linalg.norm(fit.estimate)


def test_a_forgetting_factor_asks_for_the_recursion(linear_record):
    structure = emsid.arx(na=1, nb=1)
    fit = emsid.fit(structure, linear_record, forgetting=0.99)
    assert fit.method == "rls"
    assert np.array_equal(
        fit.estimate, emsid.recursive_least_squares(structure, linear_record, forgetting=0.99).estimate
    )
    with pytest.raises(emsid.ModelError, match="ridge"):
        emsid.fit(structure, linear_record, forgetting=0.99, ridge=1.0)


def test_whatever_has_a_fit_method_is_fitted(linear_record):
    class Mean:
        def fit(self, records, *, scale=1.0):
            return scale * records.output.mean()

    assert emsid.fit(Mean(), linear_record, scale=2.0) == 2 * linear_record.output.mean()
    with pytest.raises(emsid.ModelError, match="scale"):
        emsid.fit(Mean(), linear_record, scalle=2.0)


@pytest.mark.parametrize(
    ("wrong", "answer"),
    [
        (lambda r: emsid.fit("arx", r), r"emsid\.arx\("),
        (lambda r: emsid.fit(emsid.arx, r), r"call it: arx\("),
        (lambda r: emsid.fit(emsid.Motor, r), r"class.*Motor\("),
        (lambda r: emsid.fit(r, emsid.arx(na=1, nb=1)), "comes first"),
        (lambda r: emsid.fit(42, r), "structure"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), "log.csv"), r"emsid\.read"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), r.input), r"emsid\.Record"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), [r.input]), r"emsid\.Record"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), []), "no record"),
        (lambda r: emsid.fit(emsid.arx(na=1, nb=1), r, rigde=1.0), "did you mean ridge"),
        (lambda r: emsid.fit(emsid.plants.rigid_motor(), r, fix={"resistance": 2}), "did you mean fixed"),
        (lambda r: emsid.fit(emsid.fit(emsid.arx(na=1, nb=1), r), r), "has been fitted"),
    ],
)
def test_what_cannot_be_fitted_is_answered(linear_record, wrong, answer):
    with pytest.raises(emsid.EmsidError, match=answer):
        wrong(linear_record)


# --- compare ---------------------------------------------------------------------------------------------------------


def test_compare_takes_one_fit_several_or_models(linear_record, linear_fit):
    other = emsid.fit(emsid.arx(na=2, nb=1), linear_record)
    one = emsid.compare(linear_fit, linear_record)
    assert one.best.fit is linear_fit
    several = emsid.compare([linear_fit, other], linear_record)
    assert {row.parameters for row in several.rows} == {2, 3}
    model = emsid.compare(linear_fit.model, linear_record)
    assert model.best.row.simulation_mse == one.best.row.simulation_mse
    both = emsid.compare((fit for fit in (linear_fit, other)), [linear_record, linear_record])
    assert len(both.best.record) == 2 * len(linear_record)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda fit, r: emsid.compare(r, fit),
        lambda fit, r: emsid.compare([fit], r.output),
        lambda fit, r: emsid.compare([fit, r], r),
        lambda fit, r: emsid.compare(["arx"], r),
        lambda fit, r: emsid.compare("arx", r),
        lambda fit, r: emsid.compare([fit], [fit]),
        lambda fit, r: emsid.compare([], r),
    ],
)
def test_what_cannot_be_compared_is_answered(linear_record, linear_fit, wrong):
    with pytest.raises(emsid.EmsidError):
        wrong(linear_fit, linear_record)


# --- simulate --------------------------------------------------------------------------------------------------------


def test_simulating_on_a_record_is_the_free_run(linear_record, linear_fit):
    simulated = emsid.simulate(linear_fit, linear_record)
    assert np.array_equal(simulated.input, linear_record.input)
    assert np.array_equal(simulated.output, linear_fit.model.simulate(linear_record).output)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda fit: emsid.simulate(fit, np.ones(10)),
        lambda fit: emsid.simulate(fit, "log.csv", dt=0.01),
        lambda fit: emsid.simulate("model.json", np.ones(10), dt=0.01),
        lambda fit: emsid.simulate(emsid.Motor, np.ones(10), dt=0.01),
        lambda fit: emsid.simulate(np.ones(10), fit, dt=0.01),
    ],
)
def test_what_cannot_be_simulated_is_answered(linear_fit, wrong):
    with pytest.raises(emsid.EmsidError):
        wrong(linear_fit)
