"""The error of a free run and its derivatives: which sides, which precision, what is reused."""

from dataclasses import replace

import numpy as np
import pytest

from emsid.errors import ModelError
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor
from simulated_plants import RIGID, USUAL, driven


def problem_of(plant, names, record=None):
    record = record or driven(noise=0.0)
    start = [np.zeros(plant.states)]
    return FreeRunError(plant, (Signal.SPEED,), [record], names, start, [()], all_alike, 1)


def test_derivatives_are_one_sided_where_only_one_side_has_a_free_run(monkeypatch):
    both = problem_of(DrivenMotor(RIGID), USUAL).linearised(problem_of(DrivenMotor(RIGID), USUAL).start)[0][1]
    changed = DrivenMotor.with_values

    def only_below(self, values):
        if values.get("motor_constant", 0.0) > RIGID.motor_constant:
            raise ModelError("too much")
        return changed(self, values)

    monkeypatch.setattr(DrivenMotor, "with_values", only_below)
    problem = problem_of(DrivenMotor(RIGID), USUAL)
    one = problem.linearised(problem.start)[0][1]
    assert np.array_equal(one[:, 1:], both[:, 1:])
    assert np.linalg.norm(one[:, 0] - both[:, 0]) < 1e-4 * np.linalg.norm(both[:, 0])


def test_derivatives_are_exact_where_a_search_ends_and_cheap_where_it_passes(monkeypatch):
    runs = []
    simulate = DrivenMotor.simulate
    monkeypatch.setattr(DrivenMotor, "simulate", lambda plant, *rest: (runs.append(plant), simulate(plant, *rest))[1])
    problem = problem_of(DrivenMotor(RIGID), USUAL)
    runs.clear()
    cheap = problem.linearised(problem.start)[0][1]
    assert len(runs) == 1 + len(USUAL)
    exact = problem.exactly(problem.start)[0][1]
    assert len(runs) == 1 + 3 * len(USUAL)
    assert problem.linearised(problem.start)[0][1] is exact
    assert len(runs) == 1 + 3 * len(USUAL)
    near = problem.linearised(problem.start * (1 + 5e-5))[0][1]
    assert len(runs) == 2 + 4 * len(USUAL)
    lengths = np.linalg.norm(exact, axis=0)
    assert np.all(np.linalg.norm(cheap - exact, axis=0) < 1e-3 * lengths)
    assert np.all(np.linalg.norm(near - exact, axis=0) < 1e-2 * lengths)


def test_derivatives_with_respect_to_what_is_nearly_zero_are_not_rounding():
    """A mean speed is a difference of positions, which have more rounding than the speed has."""
    motor = replace(RIGID, rotor_viscous=1e-8)
    problem = problem_of(DrivenMotor(motor, sensor=Sensor(average=1.0)), ("rotor_viscous", *USUAL))
    found = problem.exactly(problem.start)[0][1][:, 0]
    above, below = problem.start.copy(), problem.start.copy()
    above[0], below[0] = 2e-8, 0.0
    expected = (problem.residuals(above)[0] - problem.residuals(below)[0]) / 2e-8
    assert np.linalg.norm(found - expected) < 1e-5 * np.linalg.norm(expected)


def test_a_parameter_that_cannot_be_moved_says_why(monkeypatch):
    changed = DrivenMotor.with_values

    def only_here(self, values):
        if values.get("motor_constant", RIGID.motor_constant) != RIGID.motor_constant:
            raise ModelError("out of all proportion")
        return changed(self, values)

    monkeypatch.setattr(DrivenMotor, "with_values", only_here)
    problem = problem_of(DrivenMotor(RIGID), USUAL)
    with pytest.raises(ModelError, match=r"motor_constant cannot be moved from 0.05: out of all proportion"):
        problem.linearised(problem.start)


def test_a_bound_beside_which_there_is_no_free_run_has_a_zero_derivative(monkeypatch):
    simulate = DrivenMotor.simulate

    def only_rigid(plant, *arguments):
        if plant.motor.inductance > 0:
            raise ModelError("out of all proportion")
        return simulate(plant, *arguments)

    monkeypatch.setattr(DrivenMotor, "simulate", only_rigid)
    problem = problem_of(DrivenMotor(RIGID), ("inductance", *USUAL))
    assert problem.start[0] == 0.0
    slopes = problem.exactly(problem.start)[0][1]
    assert not slopes[:, 0].any()
    assert slopes[:, 1:].any(axis=0).all()


def test_a_problem_with_another_start_reuses_its_free_run(monkeypatch):
    problem = problem_of(DrivenMotor(RIGID), USUAL)
    theta = problem.start * np.array([1.1, 0.9, 1.3])
    expected = problem.linearised(theta)
    monkeypatch.setattr(DrivenMotor, "simulate", lambda *arguments: pytest.fail("simulated again"))
    moved = problem.begun_at(theta)
    assert np.array_equal(moved.start, theta)
    assert moved.linearised(theta) is expected
    assert np.array_equal(moved.residuals(theta)[0], expected[0][0])
    assert moved.sizes[:3] == pytest.approx(theta)
