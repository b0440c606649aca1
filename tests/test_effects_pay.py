"""Every effect of a plant begins at its neutral value, and enters where it pays on records of another simulator."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import emsid
from emsid import Record
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.result import GreyBoxFit
from independent import armature
from independent.cases import levels, sines
from independent.one_mass import OneMass
from independent.supported import two_levels

RIGID, DT, NOISE = PLANTS["rigid-motor"].start, 5e-3, 1.0
CORE = {
    "resistance", "motor_constant", "rotor_inertia", "load_inertia", "shaft_stiffness", "shaft_damping", "mass",
    "drive.gain", "drive.supply", "drive.knee", "drive.beyond", "sensor.ratio", "sensor.radius",
}  # fmt: skip
"""What a plant must have, or what is neutral at a value that is not zero."""
MOTOR = OneMass(gain=1875.0, damping=56.25, coulomb=(200.0, 200.0), smooth=1e-3)
"""A motor with a time constant of 18 ms, 33 rad/s per volt, and a friction of 0.107 V."""


def recorded(volts: np.ndarray, seed: int, motor: OneMass = MOTOR, drift: float = 0.0) -> Record:
    """The speed with noise; a drift of the force ends at this part of that of a volt."""
    rng = np.random.default_rng([59, seed])
    force = drift * motor.gain * np.linspace(0.0, 1.0, len(volts))
    speed = motor.run(volts, DT, force)[0][: len(volts)] if drift else motor.run(volts, DT)[0][: len(volts)]
    return Record(volts, speed + NOISE * rng.standard_normal(len(volts)), DT, input_units="V", output_units="rad/s")


def ratio(fit: GreyBoxFit, record: Record) -> float:
    """The error of the free run over the noise."""
    return float(emsid.compare(fit.model, record).rows[0].simulation_rmse) / NOISE


def prbs(low: float, high: float, seed: int) -> np.ndarray:
    """(1000,) two voltages at random."""
    return np.where(two_levels(1000, np.random.default_rng(seed), 40) > 0, high, low)


def other(seed: int = 0) -> Record:
    """A record of many levels in both directions."""
    return recorded(6.0 * levels(1000, np.random.default_rng([7, seed]), 60), 100 + seed)


@pytest.mark.parametrize("name", ["rigid-motor", "motor", "joint", "linear-axis"])
def test_a_registered_start_has_no_effect_but_what_any_plant_has(name):
    start = PLANTS[name].start
    given = {each for each in start.handles if start.value(each)} - CORE
    assert not {each for each in given if not each.startswith(("gravity.", "servo.", "cogging.period"))} - {
        "voltage_dead_zone.m_l", "voltage_dead_zone.m_r", "torque_dead_zone.m_l", "torque_dead_zone.m_r",
        "dead_zone.m_l", "dead_zone.m_r", "drive.period", "temperature_coefficient", "drift_end",
    }  # fmt: skip
    assert not any("dead_zone" in each for each in start.default_free)


@cache
def of_two_levels(low: float, high: float, seed: int) -> GreyBoxFit:
    return choose(RIGID, recorded(prbs(low, high, seed), seed))


@pytest.mark.parametrize(("low", "high"), [(2.0, 4.0), (0.0, 5.0), (-5.0, 5.0)])
@pytest.mark.parametrize("seed", [1, 2])
def test_two_levels_show_no_dead_zone_and_the_model_holds_on_others(low, high, seed):
    fit = of_two_levels(low, high, seed)
    assert fit.names == ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")
    assert ratio(fit, other(seed)) < 1.2


def test_what_two_levels_do_not_tell_apart_is_said_with_what_they_determine():
    fit = of_two_levels(2.0, 4.0, 1)
    (finding,) = (each for each in fit.findings if each.code == "effects-alike")
    assert finding.subject == "rotor_friction.coulomb"
    assert {"dead-zone", "load"} <= {*finding.data["effects"]}
    ((formula, value, half, unit),) = finding.data["combinations"]
    assert (formula, unit) == ("b + R·(T_c + T_d)/K", "V")
    assert abs(value - 200.0 / 1875.0) < 1.5 * half < 0.02
    assert [fit.shows(each.quantity) for each in fit.combinations if each.quantity.name.startswith("voltage lost")] == [
        True, False,
    ]  # fmt: skip
    several = choose(RIGID, other())
    assert "effects-alike" not in {each.code for each in several.findings}


def test_a_dead_zone_enters_where_many_levels_show_it():
    zone = OneMass(gain=1875.0, damping=56.25, coulomb=(200.0, 200.0), dead_zone=0.6, smooth=1e-3)
    fit = choose(RIGID, recorded(6.0 * levels(1000, np.random.default_rng(5), 40), 3, zone))
    assert fit.model.plant.value("voltage_dead_zone.half_width") == pytest.approx(0.6, rel=0.05)


def test_more_friction_in_either_direction_is_expressed():
    volts = 6.0 * levels(1000, np.random.default_rng(6), 40)
    for viscous, sign in (((30.0, 0.0), -1.0), ((0.0, 30.0), 1.0)):
        fit = choose(RIGID, recorded(volts, 4, OneMass(1875.0, 56.25, (200.0, 200.0), viscous=viscous, smooth=1e-3)))
        found = fit.model.plant.value("viscous_backward") / fit.model.plant.inertia_of_all
        assert found == pytest.approx(sign * 30.0, rel=0.05)


def test_an_inductance_is_taken_before_what_looks_like_it():
    """L/R of two samples: a lag, a bridge that coasts and a supply together leave about as much."""
    rng = np.random.default_rng(8)
    volts = np.concatenate([np.zeros(10), 12.0 * levels(1500, rng, 40)])
    speed = armature.speed(volts, 2e-3, 2.0, 8e-3, 0.05, 6e-5, 8e-3, 0.0)
    noisy = speed + 0.01 * np.std(speed) * rng.standard_normal(len(volts))
    fit = choose(RIGID, Record(volts, noisy, 2e-3, input_units="V", output_units="rad/s"))
    assert {*fit.names} == {"motor_constant", "rotor_inertia", "rotor_friction.coulomb", "inductance"}
    assert fit["rotor_inertia"].value == pytest.approx(6e-5, rel=0.02)
    assert fit["inductance"].value == pytest.approx(8e-3, rel=0.05)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_load_that_drifts_is_no_effect_by_direction(seed):
    rng = np.random.default_rng(seed)
    fit = choose(RIGID, recorded(6.0 * sines(1600, rng, 100), seed, drift=0.12))
    assert fit.names == ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")
    assert "load-drifts" in {each.code for each in fit.findings}
    assert ratio(fit, other(seed)) < 1.05
