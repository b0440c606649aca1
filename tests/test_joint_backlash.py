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


def assert_same_in_blocks_and_file(model: GreyBox, u: np.ndarray, expected: np.ndarray, path: Path) -> None:
    state, blocks = model.at_rest(0.0, DT), []
    for block in np.split(u, 3):
        output, state = model.run(state, block[:, None])
        blocks.append(output)
    np.testing.assert_allclose(np.concatenate(blocks), expected, atol=1e-12)
    emsid.save(model, path)
    assert emsid.load(path).plant == model.plant


def test_block_by_block_and_sample_by_sample_it_reads_the_same(tmp_path: Path) -> None:
    model = GreyBox(behind(), POSITION)
    u = torque(300, 2)
    expected, _ = model.run(model.at_rest(0.0, DT), u[:, None])
    running = emsid.start(model, dt=DT)
    np.testing.assert_allclose([running.step(each) for each in u], expected[:, 0], atol=1e-12)
    assert_same_in_blocks_and_file(model, u, expected, tmp_path / "joint.json")
    assert "sensor.backlash" not in GreyBox(behind(gap=0.0), POSITION).to_data()["plant"]["parameters"]


def test_backlash_is_named_where_it_is_missing_and_found_where_it_is_asked_for() -> None:
    record = recorded(behind(), torque(1500, 1))
    fit = emsid.fit(emsid.plants.joint(), record, search=False)
    effects = [{each.data["effect"], *each.data["or"]} for each in fit.findings if each.code == "effect-missing"]
    assert "backlash" in effects[0]
    free = [*emsid.plants.joint().for_command(record).default_free, "sensor.backlash"]
    names = [name for name in free if name != "motor_constant"]
    begun = emsid.plants.joint().with_values({"sensor.backlash": 0.005})
    found = emsid.fit(begun, record, free=names)
    assert found["sensor.backlash"].value == pytest.approx(GAP, rel=0.02)
    assert found["gravity.torque"].value == pytest.approx(1.2, rel=2e-3)
    exact = emsid.fit(emsid.plants.joint(), recorded(behind(gap=0.0), torque(1500, 1)), search=False)
    assert not [each for each in exact.findings if each.code == "effect-missing"]


def test_a_negative_backlash_is_refused() -> None:
    with pytest.raises(ModelError, match="backlash of -1"):
        Sensor(backlash=-1.0)


# --- the encoder on the motor, which crosses the gap alone -----------------------------------------------------------

PARTS = {"rotor_inertia": 0.008, "load_inertia": 0.012}


def crossing(gap: float = 0.05, **values: float):
    return joint(**PARTS, backlash=gap).with_values(values)


def two_bodies(u: np.ndarray, gap: float, fine: int) -> np.ndarray:
    """The angle of the motor, by small steps of motor and load; a contact pushes and never pulls."""
    h, half, side, x, z, v, w, found = DT / fine, gap / 2, 0.0, 0.3, 0.3, 0.0, 0.0, []

    def braked(speed: float, net: float, inertia: float) -> float:
        pushed = speed + h * net / inertia
        return float(np.sign(pushed)) * max(abs(pushed) - h * 0.15 / inertia, 0.0)

    for command in u:
        found.append(x)
        for _ in range(fine):
            weight, net = -1.2 * np.sin(z - 0.3), command - 0.05 * v
            alone, fallen = braked(v, net, 0.008), w + h * weight / 0.012
            if side and side * (x + h * alone - z - h * fallen) >= half - 1e-13:
                v = w = braked(v, net + weight, 0.02)
                z += h * w
                x = z + side * half
                continue
            side, v, w = 0.0, alone, fallen
            x, z = x + h * v, z + h * w
            if abs(x - z) > half:
                side = np.sign(x - z)
                v = w = (0.008 * v + 0.012 * w) / 0.02
                x = z + side * half
    return np.array(found)


def test_a_motor_crosses_the_gap_alone_as_in_small_steps() -> None:
    u, start = torque(300, 1), np.array([0.0, 0.3])
    run = crossing().simulate(u[:, None], DT, start, POSITION)[:, 0]
    errors = [float(np.max(np.abs(two_bodies(u, 0.05, fine) - run))) for fine in (25, 100)]
    effect = float(np.max(np.abs(crossing(0.0).simulate(u[:, None], DT, start, POSITION)[:, 0] - run)))
    assert errors[1] < 0.02 * effect
    assert errors[1] < 0.4 * errors[0]


def test_its_steps_are_of_second_order_through_impacts() -> None:
    u, start = torque(600, 1)[:, None], np.array([0.0, 0.3])
    fine = replace(crossing(), steps=64).simulate(u, DT, start, POSITION)
    wrong = [
        float(np.max(np.abs(replace(crossing(), steps=steps).simulate(u, DT, start, POSITION) - fine)))
        for steps in (2, 4, 8)
    ]
    assert wrong[1] < 0.35 * wrong[0]
    assert wrong[2] < 0.35 * wrong[1]


@pytest.mark.parametrize("ratio", [50.0, -50.0])
def test_behind_a_gear_it_crosses_the_same_gap(ratio: float) -> None:
    u, start = torque(400, 1)[:, None], np.array([0.0, 0.3])
    geared = {"rotor_inertia": 0.008 / ratio**2, "load_inertia": 0.012 / ratio**2, "rotor_viscous": 0.05 / ratio**2}
    plant = replace(crossing(), sensor=Sensor(ratio=ratio)).with_values(
        {**geared, "rotor_friction.coulomb": 0.15 / abs(ratio)}
    )
    run = plant.simulate(u / ratio, DT, start * ratio, POSITION)
    np.testing.assert_allclose(run, crossing().simulate(u, DT, start, POSITION), atol=1e-6)


def test_it_is_the_same_block_by_block_in_files_and_with_a_law_of_the_load(tmp_path: Path) -> None:
    u = torque(300, 2)
    by_load = crossing().with_frictions({"rotor_friction": emsid.plants.LoadFriction(0.1, load=0.1)})
    held = replace(crossing(), feed=emsid.plants.Feed.POSITION).with_values({"servo.proportional": 8.0})
    for plant in (crossing(), by_load, held):
        model = GreyBox(plant, POSITION)
        expected, _ = model.run(model.at_rest(0.0, DT), u[:, None])
        assert_same_in_blocks_and_file(model, u, expected, tmp_path / "joint.json")
        assert np.ptp(expected) > 0.1


def test_the_gap_and_both_inertias_are_found_from_the_angle_of_the_motor() -> None:
    free = [*PARTS, "rotor_viscous", "rotor_friction.coulomb", "gravity.torque", "gravity.angle", "backlash"]
    fit = emsid.fit(emsid.plants.joint(), recorded(crossing(), torque(1000, 1)), free=free, search=False)
    for name, true in {**PARTS, "backlash": 0.05, "gravity.torque": 1.2}.items():
        assert fit[name].value == pytest.approx(true, rel=0.01)


def test_a_gap_that_no_engine_has_is_refused() -> None:
    with pytest.raises(ModelError, match="backlash of -1"):
        crossing(-1.0)
    with pytest.raises(ModelError, match="not both"):
        replace(crossing(), sensor=Sensor(backlash=0.1))
    with pytest.raises(ModelError, match="joint without inductance"):
        replace(crossing(), gravity=None)
