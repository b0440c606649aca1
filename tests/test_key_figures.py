"""The first numbers of an identification: right within their intervals, on data whose answer is known."""

import numpy as np
import pytest

import emsid
from emsid.identification.key_figures import key_figures
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import DeadZone

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
    return {each.name: each for each in figures}


def test_a_linear_regression_gives_gain_and_time_constant():
    record = first_order(2000, 0, noise=0.02)
    found = by_name(key_figures(emsid.least_squares(emsid.arx(1, 1), record), record))
    gain, time = found["static gain over the range of the input"], found["time constant"]
    assert gain.value == pytest.approx(2.0, abs=4 * gain.standard_error)
    assert time.value == pytest.approx(-DT / np.log(0.9), abs=4 * time.standard_error)
    assert (gain.unit, time.unit) == ("rad/s/(V)", "s")


def test_the_intervals_of_a_linear_regression_cover_the_truth():
    """95 % nominal; of 2·60 intervals, fewer than 103 would happen by chance once in 10 000 such tests."""
    inside = 0
    for seed in range(60):
        record = first_order(400, seed, noise=0.05)
        found = by_name(key_figures(emsid.least_squares(emsid.arx(1, 1), record), record))
        for name, truth in (("static gain over the range of the input", 2.0), ("time constant", -DT / np.log(0.9))):
            low, high = found[name].interval
            inside += low < truth < high
    assert inside >= 103


def test_friction_of_a_regression_is_in_units_of_the_input():
    record = first_order(4000, 1, noise=0.01, friction=0.4)
    structure = emsid.Structure.parse("y(t-1)", "u(t-1)", "sign(y(t-1))")
    found = by_name(key_figures(emsid.least_squares(structure, record), record))
    friction = found["Coulomb friction in units of the input"]
    assert friction.unit == "V"
    assert friction.value == pytest.approx(0.4, abs=4 * friction.standard_error)
    assert friction.standard_error < 0.02


def test_the_dead_zone_of_a_cascade_is_in_units_of_its_input():
    """The filter in front has the gain 2, so an edge at 1 of its output is at 0.5 of the input."""
    model = Cascade((Rational([0.4], [-0.8]), DeadZone(-0.8, 1.0, 1.0, 1.0), Rational([0.1], [-0.9])), name="blocks")
    u = np.repeat(np.random.default_rng(2).uniform(-3, 3, 200), 5)
    record = emsid.Record(u, np.zeros(len(u)), DT, input_units=("V",))
    estimate = np.asarray(model.parameters)
    fit = emsid.Fit(model, model.names, estimate, 1e-6 * np.eye(len(estimate)), 1.0, 1000.0, 1.0, len(estimate))
    found = by_name(key_figures(fit, record))
    assert found["dead zone, lower edge"].value == pytest.approx(-0.4)
    assert found["dead zone, upper edge"].value == pytest.approx(0.5)
    assert found["dead zone, upper edge"].unit == "V"
    assert found["time constant of block 1"].value == pytest.approx(-DT / np.log(0.8))
    assert found["time constant of block 3"].value == pytest.approx(-DT / np.log(0.9))
    # u0 + b_r·(1 + a1)/b0: its error from those of b0, a1, b_r and u0 by hand.
    b0, rest, edge = 0.4, 0.2, 1.0
    by_hand = 1e-3 * np.linalg.norm([edge * rest / b0**2, edge / b0, rest / b0, 1.0])
    assert found["dead zone, upper edge"].standard_error == pytest.approx(by_hand, rel=1e-3)
