"""What a fitted motor lacks: named where it is missing, and nothing of a true model, on an independent simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from emsid import Record
from emsid.models.plants.search.estimation import simulation_error
from independent.fitting import START
from independent.one_mass import OneMass
from independent.settings import DT, RESISTANCE, TRUTH, Setting, levels, mass_of

INERTIA = TRUTH["rotor_inertia"]
MOTOR = mass_of(TRUTH)
WIDTH = "voltage_dead_zone.half_width"
CODES = {"effect-missing", "value-contradicted", "parameter-changes"}


def recorded(mass: OneMass, seed: int = 0, samples: int = 1500, noise: float = 0.5, shown=None) -> Record:
    rng = np.random.default_rng([3, seed])
    volts, within = levels(rng, samples)
    speed, position = (each[:samples] for each in mass.run(within, DT))
    seen = speed + noise * rng.standard_normal(samples) if shown is None else shown(speed, position)
    return Record(volts, seen, DT, input_units="V", output_units="rad/s")


def missing_of(record: Record, **fixed: float):
    fixed = {"resistance": RESISTANCE, **fixed}
    fit = simulation_error(START, record, free=tuple(name for name in TRUTH if name not in fixed), fixed=fixed)
    return [each for each in fit.findings if each.code in CODES]


def counted(per_radian: float):
    def shown(speed, position):
        counts = np.round(position * per_radian)
        return np.diff(counts, prepend=counts[0]) / per_radian / DT

    return shown


@pytest.mark.parametrize(
    ("record", "fixed"),
    [
        (recorded(MOTOR), {}),
        (recorded(MOTOR, 1, shown=counted(500.0)), {"sensor.average": 1.0}),
        (recorded(MOTOR, 2, shown=counted(20.0)), {"sensor.average": 1.0}),
        (Setting(pole=0.9).record(0), {}),
        (Setting(noise=0.2, quantum=2.0).record(0), {}),
    ],
    ids=["white noise", "encoder", "coarse encoder", "coloured noise", "coarse speed"],
)
def test_a_true_model_lacks_nothing(record, fixed):
    assert missing_of(record, **fixed) == []


@pytest.mark.parametrize(
    ("mass", "effect"),
    [
        (replace(MOTOR, stribeck=(8e-3 / INERTIA,) * 2, stribeck_speed=4.0), "stribeck"),
        (replace(MOTOR, quadratic=4e-3), "quadratic"),
        (replace(MOTOR, offset=1e-3 / INERTIA), "load"),
        (replace(MOTOR, delay=DT), "delay"),
    ],
    ids=["stribeck", "quadratic", "load", "delay"],
)
def test_an_effect_that_is_not_modelled_is_named_with_what_it_would_gain(mass, effect):
    record = recorded(mass)
    first = missing_of(record)[0]
    assert (first.code, first.subject) == ("effect-missing", "rigid-motor")
    assert effect in (first.data["effect"], *first.data["or"])
    assert 0.02 < first.data["share"] < 1.0


def test_a_value_that_the_data_contradict_is_named_with_a_better_one():
    (first, *_) = missing_of(recorded(replace(MOTOR, dead_zone=0.0)), **{WIDTH: 0.4})
    assert (first.code, first.subject) == ("value-contradicted", WIDTH)
    assert first.data["value"] == 0.4
    assert first.data["better"] == pytest.approx(0.0, abs=0.05)
    assert first.data["share"] > 0.8


def test_a_wrong_value_that_no_data_can_contradict_is_not_accused():
    """Voltage and speed alone determine K_m/(R·J) only."""
    assert missing_of(recorded(MOTOR), resistance=1.2 * RESISTANCE) == []


def test_a_resistance_that_drifts_is_named_though_it_is_given():
    """It grows by 20 % during the record, as of a motor that becomes warm."""
    samples, parts = 3000, 30
    rng = np.random.default_rng(0)
    volts, within = levels(rng, samples)
    speeds, state = [], (0.0, 0.0)
    for k, part in enumerate(np.split(np.arange(samples), parts)):
        warm = 1.0 + 0.2 * (k + 0.5) / parts
        mass = replace(MOTOR, gain=MOTOR.gain / warm, damping=MOTOR.damping / warm)
        speed, position = mass.run(within[part], DT, state=state)
        state = speed[-1], position[-1]
        speeds.append(speed[:-1])
    seen = np.concatenate(speeds) + 0.5 * rng.standard_normal(samples)
    first = missing_of(Record(volts, seen, DT, input_units="V", output_units="rad/s"))[0]
    assert first.code == "parameter-changes"
    assert first.subject == "resistance"
    early, late = first.data["halves"]
    assert late / early == pytest.approx(1.1, abs=0.03)


def test_slow_noise_is_no_effect_that_is_missing():
    rng = np.random.default_rng(5)
    slow = lfilter([np.sqrt(1 - 0.99**2)], [1.0, -0.99], rng.standard_normal(3500))[2000:]
    clean = recorded(MOTOR, noise=0.0)
    assert missing_of(replace(clean, output=clean.output + slow[:, None])) == []
