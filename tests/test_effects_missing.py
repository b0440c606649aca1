"""What a fitted motor lacks: named where it is missing, and nothing of a true model, on an independent simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid import Record
from emsid.models.plants.search.choice import STARTS
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.moves import MOVES
from emsid.wording.plants import EFFECTS
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
    return [finding for finding in fit.findings if finding.code in CODES]


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


# --- values that nobody gave -----------------------------------------------------------------------------------------

FREE = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")


def test_what_is_not_estimated_is_neutral_and_what_must_have_a_value_is_shown_as_built_in():
    """R is built in as 2 Ω, and true is 1 Ω: J and the level are given R, and K is right."""
    fit = emsid.fit(emsid.plants.rigid_motor(), recorded(replace(MOTOR, dead_zone=0.0)), free=FREE)
    rows = {row.name: row for row in fit.table}
    assert set(rows) == {*FREE, "resistance"}
    assert (rows["resistance"].value, rows["resistance"].how) == (2.0, "built in")
    low, high = rows["motor_constant"].interval
    assert low < TRUTH["motor_constant"] < high
    assert rows["motor_constant"].given == ()
    for name in FREE[1:]:
        assert rows[name].given == ("resistance",)
        assert rows[name].value == pytest.approx(TRUTH[name] / 2, rel=0.05)
    (said,) = (finding for finding in fit.findings if finding.code == "built-in-values-kept")
    assert said.data["parameters"] == [{"name": "resistance", "value": 2.0, "unit": "ohm"}]
    assert "built in" in str(fit)
    assert {each["name"]: each["status"] for each in fit.to_data()["parameters"]}["resistance"] == "built in"


def test_a_neutral_value_that_is_wrong_is_named():
    """The motor has a dead zone, and nobody asked for one."""
    fit = emsid.fit(emsid.plants.rigid_motor(), recorded(MOTOR), free=FREE)
    first = next(finding for finding in fit.findings if finding.code in CODES)
    assert "dead-zone" in (first.data.get("effect"), *first.data["or"])


def test_values_of_the_plant_that_is_given_are_kept_and_shown():
    plant = emsid.plants.rigid_motor().with_values({WIDTH: 0.4, "resistance": 1.0})
    fit = emsid.fit(plant, recorded(MOTOR), free=FREE)
    rows = {row.name: row for row in fit.table}
    assert (rows[WIDTH].value, rows[WIDTH].how) == (0.4, "of the plant given")
    for name in FREE:
        low, high = rows[name].interval
        assert low < TRUTH[name] < high


def test_a_search_begins_at_usual_sizes_of_what_it_estimates():
    """A dead zone of zero is a kink of the cost, from which no search comes far."""
    neutral, usual = emsid.plants.rigid_motor(), STARTS["rigid-motor"]
    assert neutral.value(WIDTH) == neutral.value("rotor_friction.coulomb") == 0.0
    fits = [
        emsid.fit(plant, recorded(MOTOR), fixed={"resistance": RESISTANCE}, search=False) for plant in (neutral, usual)
    ]
    assert fits[0].names == fits[1].names
    np.testing.assert_array_equal(fits[0].estimate, fits[1].estimate)


def test_what_is_left_out_of_a_model_was_tried():
    """The interval of an excess of friction that is not there includes zero, and without it the fit is as good."""
    excess = "rotor_friction.stribeck"
    plant = START.with_values({"rotor_friction.stribeck_rate": 0.3, excess: 1e-3})
    free = (*TRUTH, excess)
    for record, as_good in ((recorded(MOTOR, 4), [excess]), (recorded(MOTOR, 5), [excess])):
        fit = simulation_error(plant, record, free=free, fixed={"resistance": RESISTANCE}, find_start=False)
        for finding in fit.findings:
            if finding.code == "intervals-include-zero":
                assert finding.data["without"] == as_good


@pytest.mark.parametrize("walks", [False, True])
def test_noise_as_slow_as_the_record_is_said_to_be_so(walks):
    rng = np.random.default_rng(1)
    white = rng.standard_normal(3500)
    slow = np.cumsum(0.05 * white) if walks else lfilter([np.sqrt(1 - 0.99**2)], [1.0, -0.99], white)
    clean = recorded(MOTOR, noise=0.0)
    record = replace(clean, output=clean.output + slow[2000:, None])
    fit = simulation_error(START, record, free=tuple(TRUTH), fixed={"resistance": RESISTANCE})
    (said,) = (finding for finding in fit.findings if finding.code == "residual-slow")
    assert said.data["values"] < 30
    for name in TRUTH:
        low, high = next(row.interval for row in fit.table if row.name == name)
        assert low < TRUTH[name] < high


def test_every_effect_that_may_be_added_has_words() -> None:
    assert set(MOVES) == set(EFFECTS)
