"""A bridge that loses a part of its on-time wherever it switches, and nothing at full duty."""

from __future__ import annotations

import numpy as np
import pytest

import emsid
from emsid.errors import ModelError
from emsid.models.plants.drive import Drive
from emsid.plants import choose, rigid_motor
from independent.one_mass import OneMass

FULL, LOSS = 10.0, 0.2
MOTOR = OneMass(gain=8.0, damping=4.0, coulomb=(6.0, 6.0), coasting=1.0, full=FULL, smooth=5e-3)


def experiment(loss, seed=0, full=FULL, samples=480):
    """Levels below full duty and at it, each held for a while; `OneMass` sees the duty that is left."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(2.0, 9.0, samples // 40) * rng.choice([-1.0, 1.0], samples // 40)
    levels[::3] = np.sign(levels[::3]) * full
    command = np.repeat(levels, 40)
    left = np.where(np.abs(command) < FULL, (1.0 - loss) * command, command)
    speed, _ = MOTOR.run(left, 0.01)
    shown = speed[:samples] + 0.03 * rng.standard_normal(samples)
    return emsid.Record(command, shown, 0.01, input_units="V", output_units="rad/s")


def test_a_loss_acts_below_full_duty_and_takes_conduction_with_it():
    voltage, conducts = Drive(supply=10.0, loss=0.2, freewheel=1.0).applied(np.array([[5.0], [-9.9], [10.0], [12.0]]))
    assert voltage == pytest.approx([4.0, -7.92, 10.0, 10.0])
    assert conducts == pytest.approx([0.4, 0.792, 1.0, 1.0])
    with pytest.raises(ModelError, match="loss of 1"):
        Drive(supply=10.0, loss=1.0)


def test_a_loss_is_chosen_where_there_is_one_and_predicts_another_record():
    record, unseen = experiment(LOSS), experiment(LOSS, seed=1)
    fit = choose(
        rigid_motor(), record, effects=("switching-loss",), fixed={"drive.freewheel": 1.0, "drive.supply": FULL}
    )
    found = dict(zip(fit.names, fit.estimate, strict=True))
    assert found["drive.loss"] == pytest.approx(LOSS, abs=0.02)
    assert emsid.compare(fit, unseen).rows[0].simulation_rmse < 0.06


def test_a_loss_is_not_chosen_where_there_is_none():
    known = {"drive.freewheel": 1.0, "drive.supply": FULL}
    fit = choose(rigid_motor(), experiment(0.0), effects=("switching-loss",), fixed=known)
    assert "drive.loss" not in fit.names
