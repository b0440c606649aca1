"""One step from rest in a record: what the first look and an identification make of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

import emsid
from emsid.first_look.step_response import step_response
from emsid.record.holding_back import FAIR, shares, unseen_part

GAIN, LASTING, DEAD = 6.0, 0.1, 0.024


def response(t, level, lasting=LASTING):
    return np.where(t > DEAD, GAIN * level * (1 - np.exp(-(t - DEAD) / lasting)), 0.0)


def step(level=40.0, lasting=LASTING, noise=0.0, dt=0.006, samples=130):
    t = 0.005 + dt * np.arange(samples)
    y = response(t, level, lasting) + noise * np.random.default_rng(0).standard_normal(samples)
    return emsid.Record(np.full(samples, level), y, dt, times=(0.005,), name="step")


def irregular(path: Path, level: float, seed: int, steps=(0.005, 0.006, 0.007, 0.009)) -> Path:
    t = np.cumsum(np.random.default_rng(seed).choice(steps, 130))
    frame = pl.DataFrame({"time": t, "duty": np.full(130, level), "speed": np.rint(response(t, level))})
    frame.write_csv(path)
    return path


@pytest.mark.parametrize("lasting", [0.03, 0.1, 0.3])
def test_gain_time_constant_and_delay_of_a_step_are_exact_without_noise(lasting: float) -> None:
    found = step_response(step(lasting=lasting, samples=400))
    assert found is not None
    assert (found.gain, found.time_constant) == pytest.approx((GAIN, lasting), rel=1e-6)
    assert found.begins == pytest.approx(DEAD, abs=1e-6)
    assert found.resting == 3  # at 5, 11, 17 and 23 ms, of which the first is the sample of the step


def test_noise_does_not_make_a_step_faster() -> None:
    found = step_response(step(noise=2.0, samples=400))
    assert found is not None
    assert found.time_constant == pytest.approx(LASTING, rel=0.1)


def test_the_unseen_part_of_a_step_has_a_part_of_its_response() -> None:
    for record in (step(), step(lasting=0.05), step(noise=2.0)):
        assert shares(record, *unseen_part(record, 0.3)).min() >= FAIR
        assert unseen_part(record, 0.3)[1] < len(record)


def test_noise_after_a_step_is_no_response() -> None:
    rng = np.random.default_rng(1)
    u = np.repeat([0.0, 1.0], [50, 350])
    y = np.where(np.arange(400) >= 50, 1.0, 0.0) + 0.3 * rng.standard_normal(400)
    assert shares(emsid.Record(u, y, 0.01), 280, 400)[0] < FAIR


def test_an_identification_of_one_step_gives_its_gain_and_time_constant() -> None:
    record = step()
    rounded = emsid.Record(record.input, np.rint(record.output), record.dt)
    result = emsid.identify(rounded)
    assert result.is_usable
    assert result.on_unseen.best.row.fit_percent > 95
    known = {each.name: each.value for each in result.characteristics if each.shown}
    assert known["gain"] == pytest.approx(GAIN, rel=0.02)
    assert known["time constant"] == pytest.approx(LASTING, rel=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_files_that_are_resampled_have_one_step(tmp_path: Path, seed: int) -> None:
    """Three files of one step each, at clocks of different steps: one model of all of them."""
    steps = ((0.005, 0.006, 0.007), (0.007, 0.009), (0.006, 0.008, 0.010))
    levels = (40.0, 60.0, 80.0)
    paths = [irregular(tmp_path / f"{level:g}.csv", level, seed + k, steps[k]) for k, level in enumerate(levels)]
    reading = {"input": "duty", "output": "speed", "time": "time", "resample": True}
    alone = [emsid.read(path, **reading).dt for path in paths]
    result = emsid.identify(paths, models="arx,output-error", **reading)
    assert result.record.dt == max(alone) > min(alone)
    known = {each.name: each.value for each in result.characteristics if each.shown}
    assert known["gain"] == pytest.approx(GAIN, rel=0.02)
    assert result.on_unseen.best.row.fit_percent > 90
