"""Inputs that go on between their samples and speeds that are means, on records of a simulator of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.excitation.between_samples import jumps, may_be_continuous
from emsid.models.plants.drive import Bridge, Drive, Hold
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.models.plants.registry import plant_from_data, plant_to_data
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.record import Record
from emsid.validation.comparison import assess_model
from independent.fitting import START, fitted
from independent.one_mass import FINE
from independent.settings import DT, SETTINGS, TRUTH, mass_of

CONTINUOUS, ENCODER, WHITE = (SETTINGS[name] for name in ("continuous input", "encoder", "white"))


def deviations(fit: Fit[GreyBox]) -> np.ndarray:
    """How many standard errors every estimate is off."""
    truth = np.array([TRUTH[name] for name in fit.names])
    return np.abs(fit.estimate - truth) / fit.standard_error


def codes(fit: Fit[GreyBox]) -> set[str]:
    return {finding.code for finding in fit.findings}


def test_a_smooth_input_goes_on_between_its_samples_where_the_output_shows_it():
    fit = fitted(CONTINUOUS, 1)
    assert fit.model.plant.hold is Hold.RECORD
    assert fit.names == tuple(TRUTH)
    assert np.max(deviations(fit)) < 4
    (finding,) = (each for each in fit.findings if each.code == "input-between-samples")
    assert finding.data == {"straight": 1, "held": 0}
    held = fitted(CONTINUOUS, 1, hold="zero", fixed={"rotor_viscous": 0.0})  # its prior would widen the intervals
    assert held.model.plant.hold is Hold.ZERO
    assert np.max(deviations(held)) > 4
    assert "input-between-samples" not in codes(held)


def test_every_record_shows_how_its_own_input_goes_on():
    records = [CONTINUOUS.record(2, 800), WHITE.record(2, 800)]
    fit = simulation_error(START, records, free=tuple(TRUTH))
    assert fit.model.plant.hold is Hold.RECORD
    (finding,) = (each for each in fit.findings if each.code == "input-between-samples")
    assert finding.data == {"straight": 1, "held": 1}
    assert np.max(deviations(fit)) < 4
    errors = [assess_model(fit.model, record).row.simulation_rmse for record in records]
    assert max(errors) < 0.56  # the noise is 0.5
    straight, held = (GreyBox(fit.model.plant.with_hold(hold), fit.model.signals) for hold in (Hold.FIRST, Hold.ZERO))
    assert assess_model(straight, records[1]).row.simulation_rmse > 0.58
    assert assess_model(held, records[0]).row.simulation_rmse > 0.58


def test_a_held_input_stays_held():
    fit = fitted(WHITE, 1)
    assert fit.model.plant.hold is Hold.ZERO
    assert np.max(deviations(fit)) < 4
    assert "input-between-samples" not in codes(fit)


def test_levels_on_a_smooth_input_are_jumps():
    assert all(jumps(WHITE.record(seed).input[:, 0]) for seed in range(5))
    assert not any(jumps(CONTINUOUS.record(seed).input[:, 0]) for seed in range(5))
    t = np.arange(500)
    assert not jumps(np.abs(t % 100 - 50.0))
    assert not jumps(np.cumsum(np.random.default_rng(0).standard_normal(500)))


def test_a_smooth_input_of_a_digital_output_stays_held():
    t = np.arange(1500) * DT
    volts = 3 * np.sin(2 * np.pi * 0.7 * t) + 2 * np.sin(2 * np.pi * 2.1 * t + 1)
    assert may_be_continuous([volts])
    speed = mass_of(TRUTH).run(volts, DT)[0][:1500] + 0.5 * np.random.default_rng(0).standard_normal(1500)
    fit = simulation_error(START, Record(volts, speed, DT, input_units=("V",)), free=tuple(TRUTH))
    assert fit.model.plant.hold is Hold.ZERO


def test_only_a_smooth_input_without_repeated_values_may_be_continuous():
    rng = np.random.default_rng(0)
    t = np.arange(500)
    assert may_be_continuous([np.sin(0.3 * t)])
    assert not may_be_continuous([np.repeat(np.sin(3 * t[:100]), 5)])
    assert not may_be_continuous([rng.standard_normal(500)])
    assert not may_be_continuous([np.ones(500)])


@pytest.mark.parametrize("delay", [0.0, 0.37 * DT, 2.2 * DT])
def test_a_straight_command_is_simulated_as_a_fine_one(delay: float):
    rng = np.random.default_rng(0)
    t = np.arange(300)
    volts = 4 * np.sin(0.05 * t + 1) * np.sin(0.31 * t) + 0.2 * rng.standard_normal(300)
    volts[0] = 0.0
    plant = START.with_values({**TRUTH, "drive.delay": delay}).with_hold(Hold.FIRST)
    run = plant.simulate(volts[:, None], DT, np.zeros(2), (Signal.SPEED,))[:, 0]
    within = np.interp((np.arange(300 * FINE) + 0.5) / FINE - delay / DT, t, volts).reshape(300, FINE)
    fine = mass_of(TRUTH).run(within, DT)[0][:300]
    assert np.std(run - fine) < 1.5e-3 * np.std(fine)
    held = plant.with_hold(Hold.ZERO).simulate(volts[:, None], DT, np.zeros(2), (Signal.SPEED,))[:, 0]
    assert np.std(held - fine) > 0.02 * np.std(fine)


def test_a_straight_command_that_never_arrives_is_simulated_as_it_was_at_rest():
    volts = np.linspace(1.0, 2.0, 100)[:, None]
    late = START.with_values({**TRUTH, "drive.delay": 1e12 * DT}).with_hold(Hold.FIRST)
    run = late.simulate(volts, DT, np.zeros(2), (Signal.SPEED,))
    assert run == pytest.approx(late.simulate(np.ones((100, 1)), DT, np.zeros(2), (Signal.SPEED,)))


@pytest.mark.parametrize(
    "plant",
    [
        START.with_values({"drive.delay": 2.3 * DT}),
        emsid.plants.MotorPlant(emsid.Motor()).with_values({"drive.delay": 1.4 * DT}),
        emsid.plants.LinearAxis(),
    ],
)
def test_blocks_of_a_straight_command_give_the_same_as_one_run(plant: emsid.plants.Plant):
    volts = np.cumsum(np.random.default_rng(0).standard_normal(120))[:, None]
    assert may_be_continuous([volts[:, 0]])
    signals = (Signal.SPEED, Signal.POSITION)
    straight = plant.with_hold(Hold.FIRST)
    start = np.zeros(straight.states)
    state, parts = straight.start(start, volts[0], DT, signals), []
    for first, last in ((0, 1), (1, 2), (2, 50), (50, 120)):
        output, state = straight.run(state, volts[first:last], signals)
        parts.append(output)
    whole = straight.simulate(volts, DT, start, signals)
    assert np.concatenate(parts) == pytest.approx(whole, rel=1e-9, abs=1e-12)
    assert plant_from_data(plant_to_data(straight)).hold is Hold.FIRST
    by_record = plant.with_hold(Hold.RECORD)
    assert by_record.simulate(volts, DT, start, signals) == pytest.approx(whole, rel=1e-12)
    levels = np.repeat(volts[::10], 10, axis=0)
    held = plant.with_hold(Hold.ZERO).simulate(levels, DT, start, signals)
    assert by_record.simulate(levels, DT, start, signals) == pytest.approx(held, rel=1e-12)
    assert plant_from_data(plant_to_data(by_record)).hold is Hold.RECORD


def test_the_current_of_a_straight_command_is_that_at_the_sample():
    volts = np.linspace(0, 5, 50)[:, None]
    motor = START.with_values({"voltage_dead_zone.half_width": 0.0}).with_hold(Hold.FIRST)
    speed, current = motor.simulate(volts, DT, np.zeros(2), (Signal.SPEED, Signal.CURRENT)).T
    assert current == pytest.approx(volts[:, 0] - motor.value("motor_constant") * speed)


def test_a_hold_is_asked_for_by_its_name():
    assert emsid.Options(hold="first").hold is Hold.FIRST
    with pytest.raises(ModelError, match="zero"):
        emsid.Options(hold="linear")
    with pytest.raises(ModelError, match="codes"):
        Drive(codes=((999.0, Bridge.BRAKE),), hold=Hold.FIRST)


def test_the_speed_of_an_encoder_is_a_mean_over_the_sample_before():
    fit = fitted(ENCODER, 1, fixed={"sensor.average": 1, "rotor_viscous": 0.0})
    assert np.max(deviations(fit)) < 4
    assert fit.standard_error[0] < 2.5e-6  # the deviation of 25 estimates is 1.0e-6
    late = fitted(ENCODER, 1)  # half a sample, and it has the wide intervals of an unknown delay
    assert np.max(np.abs(late.estimate - fit.estimate) / fit.standard_error) > 5
    assert np.max(deviations(late)) < 4


def test_a_datasheet_says_that_the_speed_is_a_mean():
    sheet = emsid.plants.datasheet("motor", {"sensor": {"average": 1}})
    fit = fitted(ENCODER, 1, datasheet=sheet)
    assert fit.model.plant.value("sensor.average") == 1


def test_refinements_find_that_the_speed_is_a_mean():
    record = ENCODER.record(2)
    fit = choose(START, record, fixed={"resistance": 1.0, "rotor_viscous": 0.0}, effects=("average",))
    assert fit.model.plant.value("sensor.average") == 1
    assert "speed-is-a-mean" in codes(fit)
    assert np.max(deviations(fit)) < 4
    plain = choose(START, WHITE.record(2), fixed={"resistance": 1.0, "rotor_viscous": 0.0}, effects=("average",))
    assert plain.model.plant.value("sensor.average") == 0
    assert "speed-is-a-mean" not in codes(plain)


def test_no_refinement_moves_a_value_that_is_fixed():
    record = replace(ENCODER, noise=0.1).record(3)
    known = {"resistance": 1.0, "rotor_viscous": 0.0, "sensor.average": 0.0}
    assert choose(START, record, fixed=known, effects=("average",)).model.plant.value("sensor.average") == 0
