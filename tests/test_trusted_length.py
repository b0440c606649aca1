"""For how long a free run of a position is trusted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid.identification.evidence import length_trusted
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.trusted_length import (
    longest_trusted,
    motion,
    reversals,
    trusted_length_over,
    within,
)
from emsid.plants import Signal, linear_axis
from emsid.record import Record
from independent.one_mass import OneMass

TRUTH = OneMass(viscous=(2.0, 2.0), coulomb=(0.3, 0.3), smooth=1e-4)
DT, NOISE = 5e-3, 3e-4


def there_and_back(rng: np.random.Generator) -> np.ndarray:
    """(6000,) a force that changes its direction every 0.5 s."""
    sizes = rng.uniform(0.6, 1.0, 60) * np.resize([1.0, -1.0], 60)
    return 3.0 * sizes.repeat(100)


@pytest.mark.parametrize("length", [100, 400, 1500])
@pytest.mark.parametrize("seed", range(3))
def test_a_walk_in_white_noise_is_as_large_as_the_noise_in_windows_of_the_length_that_is_found(length, seed):
    """A walk with variance q per sample has the variance q·n/6 in windows of n samples."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(np.sqrt(6 / length) * rng.standard_normal(20_000))
    samples, error = longest_trusted([walk + rng.standard_normal(20_000)], 20)
    assert 0.5 < samples / length < 2
    assert error == pytest.approx(np.sqrt(2), rel=0.1)


def test_an_error_that_does_not_grow_has_no_length():
    rng, t = np.random.default_rng(0), np.arange(20_000)
    white, repeated = rng.standard_normal(20_000), np.sin(np.pi * t / 100)  # with motions of 100 samples
    for residual in (white, repeated, white + 3 * repeated):
        assert longest_trusted([residual], 100) is None
    assert longest_trusted([np.cumsum(white)], None) is None
    assert longest_trusted([np.cumsum(white)], 19_000) is None


def test_windows_do_not_cross_segments():
    levels = [np.full(50, 3.0), np.full(80, -2.0)]
    assert within(levels, 40) == pytest.approx(0.0, abs=1e-12)
    assert within([np.resize([1.0, -1.0], 50), np.full(10, 9.0)], 20) == pytest.approx(1.0)


def test_a_motion_ends_where_the_position_turns_and_not_where_the_speed_trembles():
    t = np.arange(4000)
    path = np.sin(np.pi * t / 200) + 0.02 * np.sin(t) + 0.001 * t
    assert motion([path]) == pytest.approx(200, abs=10)
    assert len(reversals(np.sin(np.pi * t / 200), 0.1)) == 20
    assert motion([np.linspace(0.0, 1.0, 100)]) is None


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("drift", [0.0, 1e-3])
def test_a_free_run_is_trusted_until_the_drift_of_the_force_is_as_large_as_the_noise(seed, drift):
    """The mean of the drift is part of the offset that is estimated."""
    rng = np.random.default_rng(seed)
    u = there_and_back(rng)
    walk = np.cumsum(rng.standard_normal(len(u)))
    walk = (walk - walk.mean()) / np.std(walk)
    without, run = (TRUTH.run(u, DT, each * walk)[1][: len(u)] for each in (0.0, drift))
    record = Record(u, run + NOISE * rng.standard_normal(len(u)), DT, output_units="m")
    known = {"mass": 1.0, "viscous_friction": 2.0, "friction.coulomb": 0.3}
    fit = simulation_error(linear_axis(), record, free=("offset",), fixed=known, hold="zero")
    found = [finding.data for finding in fit.findings if finding.code == "free-run-drifts"]
    assert bool(found) is bool(drift)
    for data in found:
        length = next(n for n in range(10, 6000) if within([run - without], n) > NOISE**2)
        assert 0.5 < data["seconds"] / (length * DT) < 2
        assert NOISE < data["error"] < 1.5 * NOISE
        assert data["whole"] > 2 * NOISE
        assert data["unit"] == "m"


def test_errors_larger_than_noise_in_a_single_motion_are_compared_with_those_of_a_motion():
    t, rng = np.arange(20_000), np.random.default_rng(0)
    repeated = 10 * np.sin(np.pi * t / 50) + rng.standard_normal(20_000)
    walk = np.cumsum(np.sqrt(6 / 2000) * rng.standard_normal(20_000))
    samples, error = longest_trusted([repeated + 7 * walk], 100)
    assert 1000 < samples < 4000
    assert error == pytest.approx(10.0, rel=0.1)


def drifting(rng: np.random.Generator) -> Record:
    """An axis whose force drifts in the last third of the record only."""
    u = there_and_back(rng)
    walk = np.concatenate([np.zeros(4000), np.cumsum(rng.standard_normal(2000))]) / 50
    run = TRUTH.run(u, DT, 0.02 * walk)[1][: len(u)]
    return Record(u, run + NOISE * rng.standard_normal(len(u)), DT, output_units="m")


def test_the_length_is_that_of_all_data_where_the_fitted_part_does_not_show_it():
    record, known = drifting(np.random.default_rng(4)), {"mass": 1.0, "viscous_friction": 2.0, "friction.coulomb": 0.3}
    part, whole = (
        simulation_error(linear_axis(), each, free=("offset",), fixed=known, hold="zero")
        for each in (record[:4000], record)
    )
    assert "free-run-drifts" not in [finding.code for finding in part.findings]
    assert [finding.code for finding in length_trusted(part, part.model, record)] == ["free-run-drifts"]
    assert "free-run-drifts" in [finding.code for finding in whole.findings]
    assert length_trusted(whole, whole.model, record) == []


def test_segments_keep_their_own_starts_and_a_speed_is_not_looked_at():
    record = drifting(np.random.default_rng(4))
    model = emsid.models.plants.grey_box.GreyBox(
        linear_axis().with_values({"mass": 1.0, "viscous_friction": 2.0, "friction.coulomb": 0.3}), (Signal.POSITION,)
    )
    whole, parts = (
        trusted_length_over(model, each) for each in (record, emsid.concatenate([record[:3000], record[3000:]]))
    )
    assert [finding.code for finding in (*whole, *parts)] == ["free-run-drifts"] * 2
    assert parts[0].data["whole"] < whole[0].data["whole"]
    assert trusted_length_over(replace(model, signals=(Signal.SPEED,)), record) == []
