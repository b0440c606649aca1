"""Refinements that delay the output: judged while the speed grows and while it falls."""

from __future__ import annotations

import numpy as np
import pytest

from emsid import Record
from emsid.models.plants.parameters import Signal
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.kinds import better_in_both_changes
from emsid.models.plants.search.refinements.usual import averaging_sensor, late_command, slow_sensor
from emsid.models.plants.search.trials import Trial, Trials
from independent.cases import levels
from independent.one_mass import FINE, OneMass

RIGID = PLANTS["rigid-motor"].start
DELAYS = (late_command, slow_sensor, averaging_sensor)
SAMPLES = 800


def slewed(command, rise, fall):
    """(N, FINE) a command that grows and falls by no more than this in a sample."""
    steps, now = np.empty(len(command) * FINE), 0.0
    for k, wanted in enumerate(np.repeat(command, FINE)):
        grows = abs(wanted) > abs(now) and wanted * now >= 0
        now += np.clip(wanted - now, -(rise if grows else fall) / FINE, (rise if grows else fall) / FINE)
        steps[k] = now
    return steps.reshape(-1, FINE)


@pytest.mark.parametrize(("rise", "late"), [(np.inf, False), (12.0, True)], ids=["falling only", "both"])
def test_a_command_that_is_late_only_while_it_falls_is_neither_delay_nor_lag(rise, late):
    rng = np.random.default_rng(0)
    u = 12 * levels(SAMPLES, rng, 30)
    truth = OneMass(gain=25.0, damping=12.0, coulomb=(20.0, 20.0), smooth=1e-2)
    speed = truth.run(slewed(u, rise, 12.0), 1e-2)[0][:SAMPLES] + 0.2 * rng.standard_normal(SAMPLES)
    plant = choose(RIGID, Record(u, speed, 1e-2, output_units="rad/s"), refinements=DELAYS).model.plant
    assert any(plant.value(name) for name in ("drive.delay", "sensor.lag", "sensor.average")) is late


def test_evidence_for_a_lag_comes_from_both_changes():
    command = np.tile(np.repeat([0.0, 8.0], 50), 8)
    rng = np.random.default_rng(0)
    plant, states = RIGID, [np.zeros(3)]
    run = plant.simulate(command[:, None], 1e-2, states[0], (Signal.SPEED,))[:, 0]
    change, noise = np.diff(run, prepend=run[:1]), rng.standard_normal(SAMPLES)

    def trial(growing, falling):
        error = noise * np.where(change > 0, growing, np.where(change < 0, falling, 1.0))
        return Trial(plant, (), states, 0.5 * float(error @ error), [error])

    trials = Trials((Record(command, run, 1e-2),), (Signal.SPEED,), {})
    without = trial(2.0, 2.0)
    assert better_in_both_changes(trials, trial(1.0, 1.0), without)
    assert not better_in_both_changes(trials, trial(1.0, 2.2), without)
    assert not better_in_both_changes(trials, trial(2.2, 1.0), without)
    once = Trials((Record(command[:100], run[:100], 1e-2),), (Signal.SPEED,), {})  # it never falls
    assert better_in_both_changes(once, trial(2.2, 1.0), without)
