"""Square waves: the shortest delay is taken and the ambiguity is said, and no stable plant is called unstable."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

import emsid
from emsid.identification.task import unstable_pole

DT = 0.05


def square(seed: int, samples: int = 240, delay: int | None = None, pole: float | None = None):
    """A square wave, and the response of first order with a gain of 1/3, some rows later, with the noise of counts."""
    rng = np.random.default_rng(seed)
    period, later = int(rng.integers(8, 40)), int(rng.integers(0, 4)) if delay is None else delay
    pole = float(rng.uniform(0.1, 0.85)) if pole is None else pole
    u = np.where(np.arange(samples + later) // (period / 2) % 2 < 1, 0.0, 255.0)
    y = np.zeros(samples + later)
    for k in range(1, len(y)):
        y[k] = pole * y[k - 1] + (1 - pole) * u[k] / 3
    y = np.rint(y[: len(y) - later] + 0.5 * rng.standard_normal(samples))
    return u[later:], y, period, later


@pytest.mark.parametrize("seed", range(10))
def test_a_square_wave_shows_no_unstable_plant_and_no_negative_gain(seed: int) -> None:
    """Rows of the response after, in and before those of the input, as loggers write them."""
    u, y, _, later = square(seed)
    for shift in (0, later):
        record = emsid.Record(u[: len(u) - shift], y[shift:] if shift else y, DT)
        assert unstable_pole(record) is None


def described(tmp_path: Path, t, u, y, **reading):
    path = tmp_path / "log.csv"
    pl.DataFrame({"t": t, "PWM": u, "SPEED": y}).write_csv(path)
    return emsid.describe(path, **reading)


def test_the_ambiguity_of_the_delay_of_a_periodic_input_is_said(tmp_path: Path) -> None:
    u, y, period, _ = square(1, delay=0, pole=0.6)
    t = DT * np.arange(len(u))
    found = {each.code: each for each in described(tmp_path, t, u, np.r_[0.0, y[:-1]]).findings}
    assert found["delay-ambiguous"].data["period"] == period
    assert found["response-delay"].data["delay"] <= 1
    rng = np.random.default_rng(0)
    u = np.repeat(255.0 * rng.integers(0, 2, 40), 6)
    y = np.convolve(u / 3, 0.4 * 0.6 ** np.arange(30))[: len(u)] + rng.standard_normal(len(u))
    assert "delay-ambiguous" not in {each.code for each in described(tmp_path, DT * np.arange(240), u, y).findings}


@pytest.mark.parametrize("late", [0, 1])
def test_a_shift_by_a_row_is_proposed_for_repeated_times_too_where_it_is_needed(tmp_path: Path, late: int) -> None:
    u, y, _, _ = square(2, delay=0, pole=0.2)
    y = np.roll(y, late)
    t = DT * np.arange(len(u))
    t[1:9] -= DT * np.arange(1, 9) // DT % 2 * DT  # every second of the first times is repeated
    look = described(tmp_path, t, u, y, time="t")
    assert look.reading["resample"]
    assert look.reading.get("shift") == (None if late else {"PWM": -1})


@pytest.mark.parametrize("seed", range(3))
def test_identify_takes_the_shortest_of_the_delays_of_a_sine_that_explain_as_much(seed: int) -> None:
    """A sine of 63 samples fits a model of second order with any delay; a long one is still found with other inputs."""
    rng = np.random.default_rng(seed)
    wave, levels = 3 * np.sin(2 * np.pi * np.arange(1500) / 63), np.repeat(rng.uniform(-3, 3, 60), 25)
    for u, late in ((wave, 0), (levels, 12)):
        y = np.zeros(1500)
        for k in range(1 + late, 1500):
            y[k] = 0.9 * y[k - 1] + 0.1 * u[k - 1 - late]
        record = emsid.Record(u, y + 0.02 * rng.standard_normal(1500), DT)
        result = emsid.identify(record, models="output-error", options=emsid.Options(na=1, nb=1))
        model = result.chosen.model
        delays = [finding.data["delay"] for finding in result.findings if finding.code == "delay-from-data"]
        assert delays == ([1 + late] if late else [])
        assert np.sum(model.parameter_values()["b1"]) > 0
