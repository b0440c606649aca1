"""Gain, time constant and friction of a regression: right within their intervals, on data whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid.models.regression.figures import of_regression

DT = 0.01


def first_order(samples, seed, noise=0.0, friction=0.0, pole=0.9, gain=2.0):
    """y(t) = p·y(t−1) + (1 − p)·(K·u(t−1) − friction·sign(y(t−1))), white equation error."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-3, 3, samples // 5), 5)
    y = np.zeros(samples)
    for t in range(1, samples):
        push = gain * (u[t - 1] - friction * np.sign(y[t - 1]))
        y[t] = pole * y[t - 1] + (1 - pole) * push + noise * rng.standard_normal()
    return emsid.Record(u, y, DT, input_units=("V",), output_units=("rad/s",))


def by_name(figures):
    return {figure.name: figure for figure in figures}


def test_a_linear_regression_gives_gain_and_time_constant():
    record = first_order(2000, 0, noise=0.02)
    found = by_name(of_regression(emsid.least_squares(emsid.arx(1, 1), record), record))
    gain, time = found["static gain over the range of the input"], found["time constant"]
    assert gain.value == pytest.approx(2.0, abs=4 * gain.standard_error)
    assert time.value == pytest.approx(-DT / np.log(0.9), abs=4 * time.standard_error)
    assert (gain.unit, time.unit) == ("rad/(s*V)", "s")


def test_the_intervals_of_a_linear_regression_cover_the_truth():
    """95 % nominal; of 2·60 intervals, fewer than 103 would happen by chance once in 10 000 such tests."""
    inside = 0
    for seed in range(60):
        record = first_order(400, seed, noise=0.05)
        found = by_name(of_regression(emsid.least_squares(emsid.arx(1, 1), record), record))
        for name, truth in (("static gain over the range of the input", 2.0), ("time constant", -DT / np.log(0.9))):
            inside += abs(found[name].value - truth) < 1.96 * found[name].standard_error
    assert inside >= 103


def test_friction_of_a_regression_is_in_units_of_the_input():
    record = first_order(4000, 1, noise=0.01, friction=0.4)
    structure = emsid.Structure.parse("y(t-1)", "u(t-1)", "sign(y(t-1))")
    found = by_name(of_regression(emsid.least_squares(structure, record), record))
    friction = found["Coulomb friction in units of the input"]
    assert friction.unit == "V"
    assert friction.value == pytest.approx(0.4, abs=4 * friction.standard_error)
    assert friction.standard_error < 0.02
    reversed_leads = replace(record, input=-record.input)
    same = by_name(of_regression(emsid.least_squares(structure, reversed_leads), reversed_leads))
    assert same["Coulomb friction in units of the input"].value == pytest.approx(friction.value)


def test_a_sign_that_pushes_along_is_no_friction_of_a_regression():
    record = first_order(4000, 1, noise=0.01, friction=-0.4)
    structure = emsid.Structure.parse("y(t-1)", "u(t-1)", "sign(y(t-1))")
    found = by_name(of_regression(emsid.least_squares(structure, record), record))
    assert set(found) == {"static gain over the range of the input", "time constant"}
