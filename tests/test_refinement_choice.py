"""The choice of refinements: what is kept, and what an interruption leaves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from coverage_grey_box import (
    MOTOR,
)
from emsid.errors import ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.models.plants.drive import Drive
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.choice import STARTS, choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.record import Record
from simulated_plants import DT, LEVELS, RIGID, driven, record_of


def test_refinements_are_kept_only_where_they_help():
    plain = choose(MOTOR, record_of(MOTOR, noise=0.1)[:1200], effects=("coasting", "stribeck"))
    assert not any("freewheel" in name for name in plain.names)
    coasting = replace(MOTOR, drive=Drive(supply=6.0, freewheel=1.0))
    fit = choose(MOTOR, record_of(coasting, noise=0.1)[:1200], effects=("coasting", "stribeck"))
    assert fit.model.plant.value("drive.freewheel") == pytest.approx(1.0, abs=0.1)


def test_without_refinements_a_choice_is_a_plain_fit():
    plain = simulation_error(STARTS["rigid-motor"], driven(noise=0.01))
    chosen = choose(STARTS["rigid-motor"], driven(noise=0.01), effects=())
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


@pytest.mark.parametrize("stage", ["scoring additions", "taking additions out"])
def test_interrupting_the_choice_of_refinements_keeps_the_plain_motor(stage):
    seen = []
    control = Control(report=lambda activity: seen.append(activity.doing), cancelled=lambda: stage in " ".join(seen))
    record = record_of(MOTOR, noise=0.1)[:1200]
    fit = choose(MOTOR, record, effects=("delay",), control=control)
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
        report=lambda activity: seen.append(activity.doing), cancelled=lambda: "trying 1 additions" in " ".join(seen)
    )
    record = record_of(MOTOR.with_values({"drive.delay": 0.5 * DT}), noise=0.1)[:1200]
    fit = choose(MOTOR, record, effects=("delay",), control=control)
    assert fit.ending is Ending.INTERRUPTED
    last = len(steps) - steps[::-1].index(0) - 1
    assert steps[last:] == [0]  # it is evaluated; structures that do as well are not looked for
    assert fit.model.plant.value("motor_constant") == pytest.approx(MOTOR.value("motor_constant"), rel=0.05)


def test_a_choice_of_refinements_without_time_is_not_interrupted(monkeypatch):
    seen = []
    clock = SimpleNamespace(monotonic=lambda: 2.0 * any("trying 1 additions" in each for each in seen))
    monkeypatch.setattr("emsid.estimation.nonlinear.control.time", clock)
    control = Control(deadline=1.0, report=lambda activity: seen.append(activity.doing))
    fit = choose(MOTOR, record_of(MOTOR, noise=0.1)[:600], effects=("delay",), control=control)
    assert fit.ending is Ending.OUT_OF_BUDGET
    assert fit.findings[0].code == "choice-interrupted"


def test_an_effect_that_is_not_known_is_refused_by_name():
    record = record_of(MOTOR, noise=0.1)[:300]
    with pytest.raises(ModelError, match=r"no effect 'dealy'.*did you mean delay"):
        choose(MOTOR, record, effects="dealy")
