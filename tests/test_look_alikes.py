"""A delay, a lag and a mean over the sample, which look alike: each is tried in the place of the other."""

from __future__ import annotations

import numpy as np
import pytest

from emsid import Record
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.estimation import simulation_error
from independent import armature
from independent.cases import levels
from independent.one_mass import FINE, OneMass

RIGID = PLANTS["rigid-motor"].start
DELAYS = ("delay", "lag", "average")


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
        plant,
        Record(u, speed, 1e-2, output_units="rad/s"),
        effects=("dead-zone", "coasting", "switching-loss", *DELAYS),
    ).model.plant
    assert found.value("sensor.average") == 0
    assert found.value("sensor.lag") == pytest.approx(late, rel=0.1)


# --- how a sample is taken -------------------------------------------------------------------------------------------

WIDTH = "voltage_dead_zone.half_width"
OHM, HENRY, CONSTANT, INERTIA, LEVEL, ZONE = 1.1, 4e-4, 0.045, 3e-5, 6e-3, 0.6


def counted(volts, rng, current=False, henry=HENRY):
    """A record every 10 ms of a motor with a time constant of 16 ms, whose speed is the mean over the sample."""
    motion = armature.motion(volts, 1e-2, OHM, henry, CONSTANT, INERTIA, LEVEL, ZONE)
    speed = motion.mean_speed(1e-2) + 0.4 * rng.standard_normal(len(volts))
    if not current:
        return Record(volts, speed, 1e-2, input_units="V", output_units="rad/s")
    both = np.column_stack([speed, motion.current + 0.05 * rng.standard_normal(len(volts))])
    return Record(volts, both, 1e-2, input_units="V", output_units=("rad/s", "A"))


@pytest.mark.long
def test_the_mean_of_an_encoder_is_found_beside_an_instant_current():
    rng = np.random.default_rng(0)
    record = counted(8 * levels(400, rng, 12), rng, current=True)
    fit = choose(RIGID, record, effects=("delay", "average", "inductance"))
    assert fit.model.plant.value("sensor.average") == 1
    for name, truth in (("resistance", OHM), ("rotor_inertia", INERTIA), ("inductance", HENRY)):
        low, high = next(row.interval for row in fit.table if row.name == name)
        assert low < truth < high
    assert fit.model.plant.value("rotor_inertia") == pytest.approx(INERTIA, rel=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_on_slow_ramps_an_interval_holds_what_a_mean_over_the_sample_would_give(seed):
    rng = np.random.default_rng(seed)
    ramps = 5 * np.interp(np.arange(900), np.arange(0, 1000, 100), [0.15, *rng.uniform(0.4, 1, 9)])
    record = counted(ramps, rng, henry=HENRY / 10)
    free = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")
    fixed = {"resistance": OHM, "rotor_viscous": 0.0, WIDTH: ZONE}
    plain = simulation_error(RIGID, record, free=free, fixed=fixed)
    mean = simulation_error(RIGID, record, free=free, fixed={**fixed, "sensor.average": 1.0})
    assert plain.cost == pytest.approx(mean.cost, rel=0.02)
    low, high = next(row.interval for row in plain.table if row.name == "rotor_inertia")
    assert low < mean.model.plant.value("rotor_inertia") < high
    assert low < INERTIA < high
    (said,) = (finding for finding in plain.findings if finding.code == "alternatives-fit-as-well")
    assert (said.data["of"], "sensor.average" in said.data["instead"]) == (None, True)


def test_where_the_data_show_how_a_sample_is_taken_intervals_do_not_grow():
    rng = np.random.default_rng(0)
    record = counted(8 * levels(600, rng, 12), rng, henry=HENRY / 10)
    free = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb", WIDTH)
    fit = simulation_error(RIGID, record, free=free, fixed={"resistance": OHM, "sensor.average": 1.0})
    assert "alternatives-fit-as-well" not in [finding.code for finding in fit.findings]
