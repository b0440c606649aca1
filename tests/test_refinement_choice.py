"""The choice of refinements: what is kept, and what an interruption leaves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from coverage_grey_box import (
    MOTOR,
)
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.models.plants.drive import Drive
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.choice import STARTS, choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.refinements.catalogue import REFINEMENTS, without_effect
from emsid.models.plants.search.refinements.usual import coasting_bridge, late_command, stribeck
from emsid.models.plants.search.trials import Trial, begun_with, not_needed, rank
from emsid.record import Record
from simulated_plants import DT, LEVELS, RIGID, driven, record_of


def test_refinements_are_kept_only_where_they_help():
    plain = choose(MOTOR, record_of(MOTOR, noise=0.1)[:1200], refinements=(coasting_bridge, stribeck))
    assert not any("freewheel" in name for name in plain.names)
    coasting = replace(MOTOR, drive=Drive(supply=6.0, freewheel=1.0))
    fit = choose(MOTOR, record_of(coasting, noise=0.1)[:1200], refinements=(coasting_bridge, stribeck))
    assert fit.model.plant.value("drive.freewheel") == pytest.approx(1.0, abs=0.1)


def test_without_refinements_a_choice_is_a_plain_fit():
    plain = simulation_error(STARTS["rigid-motor"], driven(noise=0.01))
    chosen = choose(STARTS["rigid-motor"], driven(noise=0.01), refinements=())
    assert np.array_equal(chosen.estimate, plain.estimate)
    assert chosen.table == plain.table


def test_a_noisy_first_sample_chooses_no_lag():
    plant, rng = DrivenMotor(RIGID), np.random.default_rng(0)
    exact = plant.simulate(LEVELS[:, None], DT, np.zeros(2), (Signal.SPEED,))
    noisy = exact + 0.1 * rng.standard_normal(exact.shape)
    cut = int(0.75 * len(LEVELS))
    noisy[cut] += 60.0  # the first sample of the unseen part
    fit = choose(STARTS["rigid-motor"], Record(LEVELS, noisy, DT, output_units=("rad/s",)), fixed={"resistance": 2.0})
    assert {"sensor.lag", "drive.delay"} & {row.name for row in fit.table} == set()


@pytest.mark.parametrize("stage", ["trying 1 refinements", "adding refinements"])
def test_interrupting_the_choice_of_refinements_keeps_the_plain_motor(stage):
    seen = []
    control = Control(report=lambda activity: seen.append(activity.doing), cancelled=lambda: stage in " ".join(seen))
    record = record_of(MOTOR, noise=0.1)[:1200]
    fit = choose(MOTOR, record, refinements=(late_command,), control=control)
    assert fit.ending is Ending.INTERRUPTED
    assert fit.findings[0].code == "choice-interrupted"
    assert fit.model.plant.value("motor_constant") == pytest.approx(MOTOR.value("motor_constant"), rel=0.05)


def test_an_interrupted_choice_begins_no_search_for_its_intervals(monkeypatch):
    seen, steps = [], []

    def watched(*args, max_iterations, **more):
        found = gauss_newton(*args, max_iterations=max_iterations, **more)
        steps.append(max_iterations)
        return found

    monkeypatch.setattr("emsid.models.plants.search.continuation.gauss_newton", watched)
    control = Control(
        report=lambda activity: seen.append(activity.doing), cancelled=lambda: "adding refinements" in " ".join(seen)
    )
    record = record_of(MOTOR.with_values({"drive.delay": 0.5 * DT}), noise=0.1)[:1200]
    fit = choose(MOTOR, record, refinements=(late_command,), control=control)
    assert fit.ending is Ending.INTERRUPTED
    last = len(steps) - steps[::-1].index(0) - 1
    assert steps[last:] == [0]  # it is evaluated; structures that do as well are not looked for
    assert fit.model.plant.value("motor_constant") == pytest.approx(MOTOR.value("motor_constant"), rel=0.05)


def test_a_choice_of_refinements_without_time_is_not_interrupted(monkeypatch):
    seen = []
    clock = SimpleNamespace(monotonic=lambda: 2.0 * any("adding refinements" in each for each in seen))
    monkeypatch.setattr("emsid.estimation.nonlinear.control.time", clock)
    control = Control(deadline=1.0, report=lambda activity: seen.append(activity.doing))
    fit = choose(MOTOR, record_of(MOTOR, noise=0.1)[:600], refinements=(late_command,), control=control)
    assert fit.ending is Ending.OUT_OF_BUDGET
    assert fit.findings[0].code == "choice-interrupted"


def test_a_refinement_without_effect_simulates_as_the_plant_without_it():
    record, shown = record_of(MOTOR, noise=0.1)[:600], (Signal.SPEED,)
    names = MOTOR.default_free
    plain = MOTOR.simulate(record.input, DT, np.zeros(2), shown)
    compared = []
    for refine in REFINEMENTS:
        for plant, _ in (
            begun for start in refine(MOTOR, names, record) for begun in without_effect(start, MOTOR, names)
        ):
            state = np.zeros(len(plant.first_state(shown, record)))
            assert np.allclose(plant.simulate(record.input, DT, state, shown), plain, atol=1e-7)
            compared.append(refine.__name__)
    assert {"late_command", "slow_sensor", "stribeck", "knee", "quadratic_viscous"} <= set(compared)


def test_no_trial_of_a_refinement_ends_above_the_plant_without_it():
    """The start of this refinement is far from where a search finds back."""
    record, compared = record_of(MOTOR, noise=0.1)[:600], []

    def stuck(plant, free, record):
        return [] if "sensor.lag" in free else [(plant.with_values({"sensor.lag": 1e6 * DT}), (*free, "sensor.lag"))]

    def rule(simple, rich):
        compared.append(rich.cost / simple.cost)
        return -1.0

    choose(MOTOR, record, refinements=(stuck,), rule=rule)
    assert compared
    assert max(compared) <= 1.0


def test_no_trial_ranks_above_a_better_one_with_no_more_parameters():
    """Gains count the independent samples of each residual, so that of the worse trial may be larger."""
    better, worse, richer = (
        Trial(MOTOR, names, [], cost, []) for names, cost in (("ab", 1.0), ("cd", 1.1), ("abc", 0.9))
    )
    trials, gains = [better, worse, richer], {id(better): 5.0, id(worse): 7.0, id(richer): 3.0}
    assert max(trials, key=lambda each: rank(each, trials, gains)) is better


def test_no_trial_is_taken_that_is_worse_than_one_without_a_needed_refinement():
    """The plant without Stribeck friction has a lower cost than the trial with one for both directions."""
    without, merged, shorter = (
        Trial(MOTOR, names, [], cost, []) for names, cost in (("ab", 1.0), ("abc", 1.1), ("abd", 0.9))
    )
    tried = [without, merged, shorter]
    assert not_needed(tried, lambda each: each is without) == [shorter]
    assert not_needed(tried, lambda each: each is merged) == [without, shorter]


def test_a_refinement_that_the_best_plant_cannot_have_begins_from_no_other_plant():
    record, other = record_of(MOTOR, noise=0.1)[:600], replace(MOTOR, load_torque=0.1)

    def of_the_other(plant, free, record):
        return [(plant, (*free, "load_torque"))] if plant is other else []

    best = Trial(MOTOR, MOTOR.default_free, [], 1.0, [])
    assert begun_with(of_the_other, best, [other], record) == []
    (begun,) = begun_with(of_the_other, replace(best, plant=other), [MOTOR], record)
    assert begun[0] is other
