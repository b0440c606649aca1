"""Recovery of the signs that a sensor lost."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from emsid.errors import ModelError
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.sign_recovery import best_signs, lobe_of_sample, recovered_signals


def test_the_sequence_of_least_cost_is_found() -> None:
    costs = np.random.default_rng(0).random((7, 2, 2))

    def cost(path: tuple[int, ...]) -> float:
        first = costs[0, path[0], path[0]]
        return float(first + sum(costs[k, path[k - 1], path[k]] for k in range(1, len(path))))

    best = min(product((0, 1), repeat=7), key=cost)
    np.testing.assert_array_equal(best_signs(costs), [1 - 2 * side for side in best])


def test_lobes_begin_at_low_minima() -> None:
    y = np.abs(np.sin(np.linspace(0.5, 3 * np.pi - 0.5, 60)))
    lobes = lobe_of_sample(y)
    assert lobes[0] == 0
    assert lobes[-1] == 2
    np.testing.assert_array_less(y[np.flatnonzero(np.diff(lobes)) + 1], 0.2)


@pytest.mark.parametrize("order", [2, 3])
def test_signs_and_system_are_recovered(order: int) -> None:
    rng = np.random.default_rng(1)
    system = Rational([0.0, 0.05, 0.03], np.poly([0.9 + 0.2j, 0.9 - 0.2j, 0.5][:order])[1:].real)
    u = np.repeat(rng.uniform(-1, 1, 60), 10)
    w = system.output(u, np.zeros(system.states))
    found = recovered_signals(u, np.abs(w) + 1e-4 * rng.standard_normal(len(w)), order, rng)[0]
    sure = np.abs(w) > 0.05 * np.std(w)
    agreement = np.mean(np.sign(found.signal[sure]) == np.sign(w[sure]))
    assert max(agreement, 1 - agreement) > 0.98
    np.testing.assert_allclose(found.denominator, system.denominator, atol=0.05)


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ModelError, match="too few to recover the signs"):
        recovered_signals(np.ones(10), np.ones(10), 3, np.random.default_rng(0))


def test_the_constant_gives_the_zero_and_other_sign_sequences_are_different() -> None:
    rng = np.random.default_rng(2)
    system = Rational([0.0, 0.05, 0.03], np.poly([0.9 + 0.2j, 0.9 - 0.2j])[1:].real)
    u = np.repeat(rng.uniform(-1, 1, 60), 10)
    w = system.output(u - 0.2, system.resting(float(u[0] - 0.2))[0])
    found = recovered_signals(u, np.abs(w), 2, rng)
    assert -found[0].constant / found[0].numerator.sum() == pytest.approx(0.2, abs=0.02)
    assert [each.cost for each in found] == sorted(each.cost for each in found)
    for k, one in enumerate(found):
        for other in found[:k]:
            turned = np.mean(np.sign(one.signal) != np.sign(other.signal))
            assert 0.1 < turned < 0.9
