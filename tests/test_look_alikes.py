"""A delay, a lag and a mean over the sample, which look alike: each is tried in the place of the other."""

from __future__ import annotations

import numpy as np
import pytest

from emsid import Record
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.look_alikes import in_place
from emsid.models.plants.search.refinements.catalogue import REFINEMENTS
from emsid.models.plants.search.refinements.switching_loss import switching_loss
from emsid.models.plants.search.refinements.usual import averaging_sensor, coasting_bridge, late_command, slow_sensor
from independent.cases import levels
from independent.one_mass import FINE, OneMass

RIGID = PLANTS["rigid-motor"].start
DELAYS = (late_command, slow_sensor, averaging_sensor)


def test_a_mean_beside_a_lag_is_taken_out_and_each_is_tried_in_the_place_of_the_other():
    record = Record(np.ones(50), np.ones(50), 1e-2, output_units="rad/s")
    free = ("motor_constant", "sensor.lag")
    both = RIGID.with_values({"sensor.average": 1.0, "sensor.lag": 5e-3})

    def kinds(plant, names, start=RIGID):
        return {
            (bool(each.value("sensor.average")), *(name for name in kept if name not in free[:1]))
            for group in in_place(plant, names, start, REFINEMENTS, record)
            for each, kept in group
        }

    assert (False, "sensor.lag") in kinds(both, free)
    assert (False, "sensor.lag", "drive.delay") in kinds(both, free)
    mean = RIGID.with_values({"sensor.average": 1.0})
    assert kinds(mean, free[:1]) == {(False, "drive.delay"), (False, "sensor.lag")}
    assert kinds(mean, free[:1], start=mean) == set()  # it was given
    lag = RIGID.with_values({"sensor.lag": 5e-3})
    assert (True,) in kinds(lag, free)


def test_a_lag_behind_a_bridge_with_a_loss_is_no_mean_with_a_shorter_lag():
    """The mean is added first, while the loss is missing."""
    rng, late, loss = np.random.default_rng(0), 9e-3, 0.06
    u = np.round(np.clip(1.5 * levels(3000, rng, 42), -1, 1) * 255)
    truth = OneMass(gain=0.028, damping=7.1, coulomb=(0.5, 0.5), coasting=0.9, full=255.0, dead_zone=8.0, smooth=2e-4)
    acting = np.where(np.abs(u) < 255, (1 - loss) * u, u)
    fine = truth.run(np.repeat(acting, FINE), 1e-2 / FINE)[0]
    decay = np.exp(-1e-2 / FINE / late)
    shown = np.zeros(len(fine))
    for k in range(1, len(fine)):
        shown[k] = decay * shown[k - 1] + (1 - decay) * fine[k]
    speed = shown[: FINE * len(u) : FINE] + 4e-3 * rng.standard_normal(len(u))
    plant = RIGID.with_values({"drive.gain": 12 / 255, "drive.supply": 12.0})
    found = choose(
        plant, Record(u, speed, 1e-2, output_units="rad/s"), refinements=(coasting_bridge, switching_loss, *DELAYS)
    ).model.plant
    assert found.value("sensor.average") == 0
    assert found.value("sensor.lag") == pytest.approx(late, rel=0.1)
