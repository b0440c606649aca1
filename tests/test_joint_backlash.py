"""Backlash of a joint: an encoder on the load side reads a load that follows the motor behind a gap."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid import ModelError
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.sensor import Sensor
from test_joint import DT, POSITION, joint, recorded, torque

GAP = 0.02


def behind(ratio: float = 1.0, gap: float = GAP):
    plant = replace(joint(), sensor=Sensor(ratio=ratio, backlash=gap))
    values = {
        "rotor_inertia": 0.02 / ratio**2,
        "rotor_viscous": 0.05 / ratio**2,
        "rotor_friction.coulomb": 0.15 / abs(ratio),
    }
    return plant.with_values(values)


def followed(positions: np.ndarray, half: float) -> np.ndarray:
    """The load behind the gap, step by step."""
    load, found = positions[0], []
    for motor in positions:
        if load < motor - half:
            load = motor - half
        if load > motor + half:
            load = motor + half
        found.append(load)
    return np.array(found)


@pytest.mark.parametrize("ratio", [1.0, 50.0, -50.0])
def test_an_encoder_behind_a_gap_reads_a_load_that_stays_while_the_motor_crosses_it(ratio: float) -> None:
    u = torque(600, 1)[:, None] / ratio
    start = np.array([0.0, 0.3 * ratio])
    load = behind(ratio).simulate(u, DT, start, POSITION)[:, 0]
    motor = behind(ratio, 0.0).simulate(u, DT, start, POSITION)[:, 0]
    np.testing.assert_allclose(load, followed(motor, GAP / 2), atol=1e-12)
    assert np.ptp(motor - load) == pytest.approx(GAP)


def test_block_by_block_and_sample_by_sample_it_reads_the_same(tmp_path: Path) -> None:
    model = GreyBox(behind(), POSITION)
    u = torque(300, 2)
    expected, _ = model.run(model.at_rest(0.0, DT), u[:, None])
    running = emsid.start(model, dt=DT)
    np.testing.assert_allclose([running.step(each) for each in u], expected[:, 0], atol=1e-12)
    state, blocks = model.at_rest(0.0, DT), []
    for block in np.split(u, 3):
        output, state = model.run(state, block[:, None])
        blocks.append(output)
    np.testing.assert_allclose(np.concatenate(blocks), expected, atol=1e-12)
    emsid.save(model, tmp_path / "joint.json")
    assert emsid.load(tmp_path / "joint.json").plant == model.plant
    assert "sensor.backlash" not in GreyBox(behind(gap=0.0), POSITION).to_data()["plant"]["parameters"]


def test_several_plants_at_once_read_what_each_reads_alone() -> None:
    plants = [behind(gap=gap) for gap in (0.0, 0.01, GAP)]
    u, start = torque(200, 3)[:, None], np.array([0.0, 0.3, 0.0, 1.0])
    (together,) = plants[0].simulate_each(plants, [u], DT, [[start]] * 3, POSITION)
    for plant, found in zip(plants, together, strict=True):
        np.testing.assert_allclose(found, plant.simulate(u, DT, start, POSITION), atol=1e-12)


def test_backlash_is_named_where_it_is_missing_and_found_where_it_is_asked_for() -> None:
    record = recorded(behind(), torque(1500, 1))
    fit = emsid.fit(emsid.plants.joint(), record, search=False)
    effects = [{each.data["effect"], *each.data["or"]} for each in fit.findings if each.code == "effect-missing"]
    assert "backlash" in effects[0]
    free = [*emsid.plants.joint().default_free, "rotor_friction.coulomb", "sensor.backlash"]
    names = [name for name in dict.fromkeys(free) if name not in ("resistance", "motor_constant")]
    begun = emsid.plants.joint().with_values({"sensor.backlash": 0.005})
    found = emsid.fit(begun, record, free=names)
    assert found["sensor.backlash"].value == pytest.approx(GAP, rel=0.02)
    assert found["gravity.torque"].value == pytest.approx(1.2, rel=2e-3)
    exact = emsid.fit(emsid.plants.joint(), recorded(behind(gap=0.0), torque(1500, 1)), search=False)
    assert not [each for each in exact.findings if each.code == "effect-missing"]


def test_a_negative_backlash_is_refused_and_so_is_c_code_with_one(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="backlash of -1"):
        Sensor(backlash=-1.0)
    with pytest.raises(emsid.EmsidError):
        emsid.export(GreyBox(behind(), POSITION), "c99", tmp_path, dt=DT)
