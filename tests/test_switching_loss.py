"""A bridge that loses a part of its on-time wherever it switches, and nothing at full duty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid.errors import ModelError
from emsid.models.plants.drive import Drive
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.kinds import better_at_full_duty_and_below, better_on_both_sides
from emsid.models.plants.search.refinements.switching_loss import switching_loss
from emsid.models.plants.search.trials import Trial, Trials
from emsid.plants import choose, rigid_motor
from emsid.selection.improvement import better
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
        rigid_motor(), record, refinements=(switching_loss,), fixed={"drive.freewheel": 1.0, "drive.supply": FULL}
    )
    found = dict(zip(fit.names, fit.estimate, strict=True))
    assert found["drive.loss"] == pytest.approx(LOSS, abs=0.02)
    assert emsid.compare(fit, unseen).rows[0].simulation_rmse < 0.06


def test_a_loss_is_not_chosen_where_there_is_none():
    known = {"drive.freewheel": 1.0, "drive.supply": FULL}
    fit = choose(rigid_motor(), experiment(0.0), refinements=(switching_loss,), fixed=known)
    assert "drive.loss" not in fit.names


@pytest.mark.parametrize(("below", "at_full", "taken"), [(0.5, 0.5, True), (0.5, 1.0, False), (0.9, 1.1, False)])
def test_a_loss_is_better_at_full_duty_and_below(below, at_full, taken):
    record = experiment(LOSS)
    trials = Trials((record,), (Signal.SPEED,), {})
    plant, noise = rigid_motor().with_drive(supply=FULL), np.random.default_rng(0).standard_normal(len(record))

    def trial(below, at_full):
        error = noise * np.where(np.abs(record.input[:, 0]) < FULL, below, at_full)
        return Trial(plant, ("drive.loss",), [np.zeros(3)], 0.5 * float(error @ error), [error])

    assert better_at_full_duty_and_below(trials, trial(below, at_full), trial(1.0, 1.0)) == taken


def test_a_loss_is_not_tried_without_samples_on_both_sides():
    plant = rigid_motor().with_drive(supply=FULL)
    assert switching_loss(plant, (), experiment(0.0))
    assert not switching_loss(plant, (), experiment(0.0, full=9.5))
    assert not switching_loss(rigid_motor(), (), experiment(0.0))
    always = emsid.Record(np.repeat([FULL, -FULL], 50), np.zeros(100), 0.01)
    assert not switching_loss(plant, (), always)


def test_the_limit_of_a_supply_is_looked_for_behind_the_knee():
    command = np.repeat([2.0, 7.5], 50)
    record = emsid.Record(command, np.ones(100), 0.01)
    plant = rigid_motor().with_drive(knee=5.0, beyond=2.0, supply=8.0)  # 7.5 V becomes 10 V
    names, state = ("motor_constant", "drive.supply"), [np.zeros(3)]
    rich, simple = (Trial(plant, names, state, 50.0 * e**2, [np.full(100, e)]) for e in (0.1, 1.0))
    trials = Trials((record,), (Signal.SPEED,), {})
    assert better_on_both_sides(trials, rich, simple, "drive.supply")
    within = replace(rich, plant=plant.with_drive(supply=11.0))
    assert not better_on_both_sides(trials, within, simple, "drive.supply")


def test_a_break_is_judged_on_the_side_that_few_records_show():
    command = np.repeat(np.arange(1.0, 21.0), 40)  # twenty records of a step, of which one is beyond
    trials = Trials((emsid.Record(command, np.ones(800), 0.01),), (Signal.SPEED,), {})
    plant, noise = rigid_motor().with_drive(supply=19.5), np.random.default_rng(0).standard_normal(800)

    def trial(size, beyond):
        error = np.where(command > 19.5, beyond * np.roll(noise, 1), size * noise)
        return Trial(plant, ("drive.supply",), [np.zeros(3)], 0.5 * float(error @ error), [error])

    with_it, without = trial(1.0, 1.0), trial(1.0, 6.0)
    assert better_on_both_sides(trials, with_it, without, "drive.supply")
    assert not better(with_it.errors, without.errors)  # too few of all stretches show it
    assert not better_on_both_sides(trials, without, with_it, "drive.supply")
    assert not better_on_both_sides(trials, trial(0.8, 1.0), trial(1.0, 1.0), "drive.supply")
    assert not better_on_both_sides(trials, trial(1.2, 1.0), trial(1.0, 6.0), "drive.supply")
