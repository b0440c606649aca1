"""Recovery of the signs that a sensor lost, and cascades with such a sensor."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import emsid
from cascade_searches import ABS, AT_RATE, held_levels, record_of, unexplained, wiener, wiener_hammerstein
from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.cross_validation import CascadeSearch
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.search.sign_recovery import best_signs, lobe_of_sample, recovered_signals
from emsid.models.blocks.search.starts import sign_recovery_candidates
from emsid.models.blocks.static_maps import Abs, CubicSpline, EvenSpline
from emsid.models.free_run import free_run_error
from emsid.record import Record
from independent.nonlinear_systems import coupled_drives


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


# --- cascades --------------------------------------------------------------------------------------------------------


def test_a_lost_sign_is_recovered() -> None:
    truth = Cascade((Rational([0.0, 0.1], [-0.9]), Abs(), Rational([0.6], [-0.4])))
    fit = wiener_hammerstein(record_of(truth, 1500), (1, 1), replace(AT_RATE, static=ABS))
    assert unexplained(fit, record_of(truth, 1500, noise=0.0, seed=1)) < 0.03


def test_a_sensor_with_offsets_loses_the_sign_of_a_resonance() -> None:
    """The kink is not at u = 0: a start that leaves u₀ there ends in another minimum."""
    drive = Rational([0.0, 0.03, 0.02], np.real(np.poly([0.93 + 0.2j, 0.93 - 0.2j]))[1:])
    truth = Cascade((drive, Abs(), Rational([0.5], [-0.5])), input_offset=0.3, output_offset=0.05)
    record, other = (held_levels(truth, 600, seed) for seed in (0, 1))
    fit = wiener_hammerstein(record, (2, 1), replace(AT_RATE, static=ABS))
    assert isinstance(fit.model.blocks[1], Abs)
    assert fit.model.input_offset == pytest.approx(0.3, abs=0.02)
    assert unexplained(fit, other) < 0.02


@pytest.mark.parametrize("static", [ABS, None])
def test_only_a_sensor_with_a_curve_gets_knots(static: Family | None) -> None:
    curve = np.linspace(-4, 4, 41)
    bent = CubicSpline(curve, np.sqrt(curve**2 + 0.1) + 0.1 * curve**2)
    drive = Rational([0.0, 0.1], [-0.9])
    for sensor, kind in ((bent, EvenSpline), (Abs(), Abs)):
        truth = Cascade((drive, sensor), input_offset=0.3)  # type: ignore[arg-type]
        fit = wiener(held_levels(truth, 800, 0), 1, replace(AT_RATE, static=static, rectified=True))
        assert isinstance(fit.model.blocks[1], kind)
        assert unexplained(fit, held_levels(truth, 800, 1)) < 0.03


def test_a_map_that_loses_the_sign_is_tried_where_the_output_is_rectified() -> None:
    """Splines, which have to find the kink, leave 46 times the noise."""
    drives = coupled_drives(300, seed=22, spread=0.2)
    fit = wiener(drives.fitted, None, CascadeSearch(static=None))
    (other,) = drives.unseen.values()
    assert unexplained(fit, other) * np.std(other.output) < 1.5 * drives.noise
    assert isinstance(fit.model.blocks[-1], Abs)


@pytest.mark.long
def test_a_map_that_loses_the_sign_is_found_in_a_short_record_although_nobody_names_it() -> None:
    rng = np.random.default_rng(2)
    truth = Cascade((Rational([0.0, 0.2, 0.1], [-1.4, 0.7]), Abs(), Rational([0.0, 0.5], [-0.5])))
    u = np.repeat(rng.uniform(-1, 1, 80), 5) + 0.2
    y = emsid.simulate(truth, u, dt=0.02).output[:, 0]
    noise = 0.02 * float(np.std(y))
    record = Record(u, y + noise * rng.standard_normal(len(y)), 0.02)
    fit = wiener_hammerstein(record[:300])
    assert np.sqrt(free_run_error(fit.model, [record[300:]])) < 2 * noise


def test_recovering_signs_can_be_cancelled() -> None:
    u = np.repeat(np.random.default_rng(0).uniform(-1, 1, 60), 10)
    y = np.abs(Rational([0.0, 0.1], [-0.9]).output(u, np.zeros(1)))
    with pytest.raises(Stopped):
        list(sign_recovery_candidates([(u, y)], (1, None), np.random.default_rng(0), Control(cancelled=lambda: True)))
