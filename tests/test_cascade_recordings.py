"""Cascades on real recordings: a drive with friction, coupled drives, and the circuit of 2009."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import emsid
from cascade_searches import ABS, SPLINE, hammerstein, hammerstein_wiener, unexplained, wiener, wiener_hammerstein
from emsid.estimation.fit import Ending, Fit
from emsid.io import read
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.cross_validation import CascadeSearch
from emsid.models.blocks.static_maps import EvenSpline
from emsid.record import Record


@pytest.mark.long
@pytest.mark.recordings
@pytest.mark.parametrize(("estimator", "most"), [(hammerstein, 0.12), (wiener, 0.06), (hammerstein_wiener, 0.08)])
def test_a_drive_with_friction_gets_no_slow_pole_for_its_drift(
    recordings: Path, estimator: Callable[..., Fit[Cascade]], most: float
) -> None:
    """A slow pole runs through what it was fitted to and past what it was not; one quarter alone does not tell.

    The best linear model leaves 0.18.
    """
    record = read(
        recordings / "dc_motor_bidirectional" / "testBench_testAll_10ms.dat",
        input="PWM",
        output="mVel",
        dt=0.010048,
        mask="abs(PWM) > 255",
    )
    first, second = record.split(0.5)
    fit = estimator(first)
    assert fit.ending is Ending.CONVERGED, fit.findings
    assert unexplained(fit, second) < most


@pytest.mark.long
@pytest.mark.recordings
@pytest.mark.parametrize(("channel", "most"), [(0, 0.4), (1, 0.35)])
def test_drives_whose_sensor_loses_the_sign(recordings: Path, channel: int, most: float) -> None:
    values = np.loadtxt(recordings / "coupled_drives" / "uniform_first400.csv", delimiter=",", skiprows=1)
    first, second = Record(values[:, channel], values[:, channel + 2], 0.02).split(0.7)
    fit = wiener_hammerstein(first, None, CascadeSearch(static=ABS))
    assert unexplained(fit, second) < most


@pytest.mark.long
@pytest.mark.recordings
def test_a_short_record_gets_no_knots_for_its_noise(recordings: Path) -> None:
    """Twice the knots lower the squared error here, but not the variance of the noise."""
    values = np.loadtxt(recordings / "coupled_drives" / "uniform_first400.csv", delimiter=",", skiprows=1)
    fit = emsid.fit(emsid.wiener_hammerstein(), Record(values[:300, 1], values[:300, 3], 0.02))
    assert [block.size for block in fit.model.blocks if isinstance(block, EvenSpline)] == [20]


@pytest.mark.long
@pytest.mark.recordings
def test_orders_of_the_benchmark_circuit_are_found(recordings: Path) -> None:
    """Two filters of third order; the response alone asks for eight poles."""
    values = np.loadtxt(recordings / "wiener_hammerstein_2009" / "estimation.csv", delimiter=",", skiprows=1)
    record = Record(values[:, 0], values[:, 1], 1 / 51_200)
    fit = wiener_hammerstein(record[5200:35_000], None, CascadeSearch(size=25))
    assert [len(block.denominator) for block in fit.model.blocks if isinstance(block, Rational)] == [3, 3]
    assert unexplained(fit, record[85_000:]) < 0.0015


@pytest.mark.long
@pytest.mark.recordings
def test_benchmark_circuit(recordings: Path) -> None:
    """The circuit of 2009 from orders and a number of knots, on a part of the data short enough for a test."""
    values = np.loadtxt(recordings / "wiener_hammerstein_2009" / "estimation.csv", delimiter=",", skiprows=1)
    record = Record(values[:, 0], values[:, 1], 1 / 51_200)
    fit = wiener_hammerstein(record[5200:25_000], (3, 3), CascadeSearch(size=25, static=SPLINE))
    held = record[85_000:]
    run = fit.model.simulate(held)
    error = float(np.sqrt(np.mean((run.output - held.output)[run.counted] ** 2)))
    assert fit.model.oversampling == 2
    assert error < 0.26e-3
