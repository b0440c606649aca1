"""Refinements that delay the output: judged while the speed grows and while it falls."""

from __future__ import annotations

import numpy as np

from emsid import Record
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.choice import choose
from independent.cases import levels
from independent.one_mass import FINE, OneMass

RIGID = PLANTS["rigid-motor"].start
DELAYS = ("delay", "lag", "average")
SAMPLES = 800


def slewed(command, rise, fall):
    """(N, FINE) a command that grows and falls by no more than this in a sample."""
    steps, now = np.empty(len(command) * FINE), 0.0
    for k, wanted in enumerate(np.repeat(command, FINE)):
        grows = abs(wanted) > abs(now) and wanted * now >= 0
        now += np.clip(wanted - now, -(rise if grows else fall) / FINE, (rise if grows else fall) / FINE)
        steps[k] = now
    return steps.reshape(-1, FINE)


def test_a_command_that_is_late_both_ways_has_a_delay_or_a_lag():
    rng = np.random.default_rng(0)
    u = 12 * levels(SAMPLES, rng, 30)
    truth = OneMass(gain=25.0, damping=12.0, coulomb=(20.0, 20.0), smooth=1e-2)
    speed = truth.run(slewed(u, 12.0, 12.0), 1e-2)[0][:SAMPLES] + 0.2 * rng.standard_normal(SAMPLES)
    plant = choose(RIGID, Record(u, speed, 1e-2, output_units="rad/s"), effects=DELAYS).model.plant
    assert any(plant.value(name) for name in ("drive.delay", "sensor.lag", "sensor.average"))
