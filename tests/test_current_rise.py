"""A bridge that coasts, in every pulse of which the armature current rises anew, against a simulated chopper."""

from __future__ import annotations

import numpy as np
import pytest

import emsid
from emsid.errors import ModelError
from emsid.models.plants.drive import GAUSS, Drive
from emsid.plants import choose, rigid_motor
from independent.chopper import speed
from independent.one_mass import OneMass

EFFECTS = ("dead-zone", "coasting", "current-rise")
SIDES = np.repeat([1.0, -1.0], 6)


def levels(seed):
    """Twelve levels in one direction, then in the other, every fourth of them at full duty."""
    duty = np.random.default_rng(seed).uniform(0.03, 0.8, 12) * SIDES
    duty[::4] = SIDES[::4]
    return np.repeat(duty, 40), np.random.default_rng(seed + 100).standard_normal(480)


def chopped(rise, seed=0):
    """A motor behind a chopper with ten periods in every sample; L/R is ``rise`` of one of them."""
    duty, noise = levels(seed)
    shown = speed(duty, 10, 1e-3, 12.0, 1.0, rise * 1e-3, 0.1, 1e-3, 0.03)
    return emsid.Record(255 * duty, shown + 0.5 * noise, 0.01, output_units="rad/s")


def test_a_pulse_has_the_current_that_rises_in_it_and_falls_after_it():
    pulses, full = np.array([0.5, 1.0, -5.0]), np.array([10.0, 12.0])
    drive = Drive(supply=10.0, rise=0.1, freewheel=1.0)
    voltage, conducts = drive.applied(np.concatenate([pulses, full])[:, None])
    t = (np.arange(200000) + 0.5) / 200000

    def mean(on: float, back: float) -> float:
        """Of the current over a period: it rises to 1 - back while the bridge is on, then falls to zero."""
        rising = (1 - back) * (1 - np.exp(-np.minimum(t, on) / 0.1))
        falling = -(1 + back) + (rising[-1] + 1 + back) * np.exp(-(t - on) / 0.1)
        return float(np.mean(np.where(t < on, rising, np.maximum(falling, 0.0))))

    for back in GAUSS:
        exact = [np.sign(u) * mean(abs(u) / 10, back) for u in pulses]
        assert voltage[:3] / 10 - conducts[:3] * np.sign(pulses) * back == pytest.approx(exact, rel=1e-4)
    assert voltage[3:] == pytest.approx([10.0, 10.0])
    assert conducts[3:] == pytest.approx([1.0, 1.0])
    with pytest.raises(ModelError, match="rise of 2"):
        Drive(supply=10.0, rise=2.0)
    with pytest.raises(ModelError, match="needs its supply"):
        Drive(rise=0.1)


def test_the_rise_of_a_chopped_current_is_found():
    fit = choose(rigid_motor(), chopped(0.15), effects=EFFECTS)
    assert "voltage_dead_zone.half_width" not in fit.names
    assert fit.model.plant.value("drive.rise") == pytest.approx(0.15, rel=0.2)
    without = choose(rigid_motor(), chopped(0.15), effects=("coasting",))
    errors = [emsid.compare(each, chopped(0.15, 4)).rows[0].simulation_rmse for each in (fit, without)]
    assert errors[0] < 0.8 * errors[1]


def test_no_rise_is_found_behind_a_dead_zone():
    motor = OneMass(gain=8.0, damping=4.0, coulomb=(3.0, 3.0), dead_zone=1.0, coasting=1.0, full=10.0, smooth=5e-3)
    duty, noise = levels(1)
    shown = motor.run(10 * duty, 0.01)[0][:480]
    fit = choose(rigid_motor(), emsid.Record(10 * duty, shown + 0.03 * noise, 0.01), effects=EFFECTS)
    assert "drive.freewheel" in fit.names
    assert "drive.rise" not in fit.names
