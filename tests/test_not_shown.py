"""Characteristics that a record does not approach are not shown; complex poles are an oscillation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import emsid
from emsid.identification.result import curves
from emsid.models.characteristics import oscillation, time_constants
from emsid.models.kinds import capabilities_of
from emsid.models.visited import Needs, RestsOn, Visited
from emsid.report.identification_page import _fact

DT, N = 0.02, 1500
FREE = ["motor_constant", "rotor_inertia", "rotor_friction.coulomb"]
ZONE = {"voltage_dead_zone.half_width": 0.0}
FREQUENCY, DAMPING = 8.6, 0.09


def characteristics_of(fit, record):
    return capabilities_of(fit.model).characteristics(fit, record)


def levels(low: float, high: float) -> np.ndarray:
    return np.repeat(np.random.default_rng(1).uniform(low, high, N // 30), 30)


def motor(u: np.ndarray, noise: float = 0.05) -> emsid.Record:
    """A motor with Coulomb friction of 0.3 V, 22 rad/(V·s) and a time constant of 0.12 s, in steps of a tenth."""
    speed, v = np.zeros(len(u)), 0.0
    for k in range(len(u)):
        speed[k] = v
        for _ in range(10):
            drive = u[k] - 0.3 * np.sign(v) if v else np.sign(u[k]) * max(abs(u[k]) - 0.3, 0.0)
            after = v + DT / 10 / 0.12 * (22 * drive - v)
            v = 0.0 if v * after < 0 else after
    y = speed + noise * np.random.default_rng(2).standard_normal(len(u))
    return emsid.Record(u[100:], y[100:], DT, "u", "y", "V", "rad/s")


@pytest.mark.parametrize(
    ("needs", "way", "value", "shown"),
    [
        (Needs.THRESHOLD, 1, 1.4, False),  # the command never goes below it
        (Needs.THRESHOLD, 1, 3.5, True),
        (Needs.THRESHOLD, -1, 1.4, False),
        (Needs.SLIDING, 1, 0.3, False),  # an intercept far from the speeds
        (Needs.SLIDING, -1, 0.3, False),
        (Needs.ANY, 0, 0.3, True),
        (Needs.ANY, 1, 0.3, True),
        (Needs.ANY, -1, 0.3, False),  # it never moves backward
    ],
)
def test_a_record_of_one_direction_shows_what_it_approaches(needs, way, value, shown):
    visited = Visited(np.array([2.9, 4.6]), np.array([54.0, 92.0]))
    assert visited.shows(RestsOn(needs, way), value) is shown
    both = Visited(np.array([-4.6, 4.6]), np.array([-92.0, 92.0]))
    assert both.shows(RestsOn(needs, way), value)


def test_thresholds_that_a_motor_never_approaches_have_no_number_anywhere():
    found = {}
    for name, u in (("one way", levels(2.9, 4.6)), ("both ways", levels(-4.6, 4.6))):
        record = motor(u)
        fit = emsid.fit(emsid.plants.rigid_motor(), record, free=FREE, search=False, fixed=ZONE)
        found[name] = fit, {each.name: each for each in characteristics_of(fit, record)}
        (friction,) = [curve for curve in curves(fit, record) if curve.kind == "friction"]
        assert np.isnan(friction.value[friction.x < -5]).all() == (name == "one way")
        assert np.isfinite(friction.value[friction.x > 60]).all()
    fit, shown = found["both ways"]
    assert shown["voltage lost (kS) backward"].value == pytest.approx(0.3, rel=0.1)
    assert all(each.shown for each in shown.values())
    fit, hidden = found["one way"]
    lost = {name for name, each in hidden.items() if not each.shown}
    assert {"Coulomb voltage forward", "voltage lost (kS) backward"} <= lost
    assert "speed per volt" not in lost
    assert all(np.isnan(hidden[name].value) and hidden[name].half_width is None for name in lost)
    data = {each["name"]: each for each in fit.to_data()["combinations"]}
    assert all((data[name]["value"], data[name]["shown"]) == (None, False) for name in lost & set(data))
    assert _fact(hidden["voltage lost (kS) backward"], "").value == "unknown"


def pendulum() -> emsid.Record:
    system = ([[FREQUENCY**2 * 0.27]], [1, 2 * DAMPING * FREQUENCY, FREQUENCY**2])
    num, den, _ = cont2discrete((system[0][0], system[1]), DT, "zoh")
    u = levels(-1, 1)
    y = lfilter(num.ravel(), den, u) + 1e-4 * np.random.default_rng(3).standard_normal(N)
    return emsid.Record(u, y, DT, "u", "angle", "V", "rad")


@pytest.mark.parametrize("model", ["arx", "output-error", "armax", "state-space"])
def test_complex_poles_are_a_natural_frequency_and_a_damping_ratio(model):
    record = pendulum()
    result = emsid.identify(record, models=[model])
    shown = {each.name: each.value for each in characteristics_of(result.chosen, record)}
    assert shown["natural frequency"] == pytest.approx(FREQUENCY, rel=0.02)
    assert shown["damping ratio"] == pytest.approx(DAMPING, rel=0.1)
    assert shown["gain"] == pytest.approx(0.27, rel=0.02)


def test_real_poles_have_time_constants_and_fast_pairs_beside_them_nothing():
    poles = np.exp(-DT * np.array([1 / 0.5, 1 / 0.1]))
    assert time_constants(poles, DT) == pytest.approx([0.5, 0.1])
    assert oscillation(poles, DT) is None
    assert oscillation(np.array([poles[0], 0.3 + 0.3j, 0.3 - 0.3j]), DT) is None
