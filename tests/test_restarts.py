"""Searches that are begun again around the end of one that did not converge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.restarts import RESTARTS, begun_again, begun_around, confirmed
from emsid.estimation.uncertainty.coloured_residuals import FEWEST, effective_samples

Array = NDArray[np.float64]


class Decay:
    """y = exp(−θ₁t) + θ₂ with a residual in steps, whose derivative leads astray near the minimum."""

    def __init__(self, step: float) -> None:
        self.t, self.step, self.searches = np.linspace(0, 3, 200), step, 0
        self.y = np.exp(-0.7 * self.t) + 0.2 + 0.01 * np.random.default_rng(0).standard_normal(200)

    def residuals(self, theta: Array) -> Sequence[Array]:
        error = np.exp(-theta[0] * self.t) + theta[1] - self.y
        return [np.round(error / self.step) * self.step if self.step else error]

    def linearised(self, theta: Array) -> Sequence[tuple[Array, Array]]:
        slope = np.stack([-self.t * np.exp(-theta[0] * self.t), np.ones(200)], axis=1)
        return [(self.residuals(theta)[0], slope)]

    def search(self, theta: Array, **options: Any) -> Minimum:
        self.searches += 1
        return gauss_newton(self, theta, **({"tolerance": 1e-6} | options))


def test_a_search_that_stalls_is_confirmed_by_others_that_end_there_too() -> None:
    problem = Decay(step=0.003)
    first = problem.search(np.array([1.5, 0.0]))
    assert first.ending is Ending.STALLED
    again = begun_again(first, problem.search, 2)
    assert again.ending is Ending.CONVERGED
    assert [finding.code for finding in again.findings] == ["minimum-not-smooth"]
    assert again.cost <= first.cost
    assert again.estimate == pytest.approx([0.7, 0.2], abs=0.02)
    assert np.all(np.diag(again.covariance) > 0)


@pytest.mark.parametrize(("higher", "ending"), [(0.02, Ending.CONVERGED), (0.03, Ending.STALLED)])
def test_costs_that_data_cannot_tell_apart_are_the_same(higher: float, ending: Ending) -> None:
    """A slow residual is worth 10 samples: half a standard error from the minimum, V is higher by 0.5²/10."""
    problem = Decay(step=0.003)
    white = problem.search(np.array([1.5, 0.0]))
    slow = replace(white, residuals=(0.01 * np.sin(problem.t),))
    assert effective_samples(slow.residuals) == FEWEST
    ends = [((1 + higher) * white.cost, white.estimate + apart) for apart in (-0.02, 0.01, 0.02)]
    few = confirmed(white, ends)
    assert few.ending is Ending.STALLED
    (said,) = few.findings
    assert (said.code, said.data["starts"], said.data["agreeing"]) == ("search-stalled", 4, 1)
    judged = confirmed(slow, ends)
    assert judged.ending is ending
    if ending is Ending.CONVERGED:
        assert judged.covariance - white.covariance == pytest.approx(np.full((2, 2), 3e-4))


def test_a_search_out_of_steps_goes_on_and_one_that_converged_does_not() -> None:
    problem = Decay(step=0.0)
    short = problem.search(np.array([1.5, 0.0]), max_iterations=1)
    assert short.ending is Ending.OUT_OF_BUDGET
    whole = begun_again(short, problem.search, 2)
    assert whole.ending is Ending.CONVERGED
    assert problem.searches <= 2 + RESTARTS
    problem.searches = 0
    assert begun_again(whole, problem.search, 2) is whole
    assert problem.searches == 0


def test_a_stopped_search_is_not_begun_again() -> None:
    problem = Decay(step=0.003)
    first = problem.search(np.array([1.5, 0.0]))
    problem.searches = 0
    assert begun_again(first, problem.search, 2, Control(cancelled=lambda: True)) is first
    assert problem.searches == 0


def test_rounds_end_when_enough_searches_agree_and_searches_around_may_be_others() -> None:
    problem, elsewhere = Decay(step=0.003), Decay(step=0.003)
    first = problem.search(np.array([1.5, 0.0]))

    def lost(theta: Array, **options: Any) -> Minimum:
        return elsewhere.search(np.array([-1.0, 3.0]), **{**options, "max_iterations": 0})

    alone = confirmed(*begun_around(first, problem.search, 2, around=lost, turns=3))
    assert elsewhere.searches == 3 * RESTARTS
    assert alone.ending is Ending.STALLED
    assert alone.findings[0].data["starts"] == 3 * RESTARTS + 1
    elsewhere.searches = 0
    found = confirmed(*begun_around(first, problem.search, 2, around=elsewhere.search, turns=3))
    assert found.ending is Ending.CONVERGED
    assert elsewhere.searches <= RESTARTS
