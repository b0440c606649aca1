"""Angles that hang: what the first look says of gravity, of one load, and of an angle without a unit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid import DataError, Record
from emsid.first_look.data_advice import advice
from emsid.first_look.hanging import hanging
from emsid.first_look.stops import stops, without_stops
from emsid.identification.candidates import CANDIDATES
from emsid.models.plants.drive import Feed
from emsid.options import Options
from test_joint import DT, joint, loaded_records, recorded, servo, targets, torque

TICKS = 4096 / (2 * np.pi)


def arm(size: float = 0.8, **values: float) -> Record:
    """The angle of an arm that a torque swings."""
    return recorded(joint(**values), torque(1500, 1, size))


def without_unit(record: Record, scale: float, name: str = "angle") -> Record:
    return replace(record, output=record.output * scale, output_units=("",), output_names=(name,))


def by_code(record: Record) -> dict[str, emsid.findings.Finding]:
    return {finding.code: finding for finding in advice(record)}


def table(path: Path, record: Record, output: str) -> Path:
    rows = np.column_stack([DT * np.arange(len(record)), record.input[:, 0], record.output[:, 0]])
    np.savetxt(path, rows, delimiter=",", header=f"time [s],torque [N*m],{output}", comments="", fmt="%.9g")
    return path


def test_an_arm_hangs_where_it_rests_and_swings_as_its_inertia_says() -> None:
    found = by_code(arm())["angle-hangs"]
    assert found.data["angle"] == pytest.approx(0.3, abs=0.02)
    assert found.data["period"] == pytest.approx(2 * np.pi * np.sqrt(0.02 / 1.2), rel=0.02)
    assert not {"one-load", "angle-without-unit"} & set(by_code(arm()))  # a torque gives every other one its size


def test_what_gravity_does_not_move_does_not_hang() -> None:
    free = recorded(joint(**{"gravity.torque": 0.0}), torque(1500, 1) - np.mean(torque(1500, 1)))
    assert hanging(free) is None
    noise = Record(torque(1500, 1), np.random.default_rng(0).standard_normal(1500), DT, output_units="rad")
    assert hanging(noise) is None
    assert hanging(replace(arm(), output_units=("m",))) is None  # no angle
    start = np.array([0.0, 0.3, 0.0, 1.0])
    held = servo().simulate(targets(1500, 1)[:, None], DT, start, (emsid.plants.Signal.POSITION,))
    assert hanging(Record(targets(1500, 1), held, DT, input_units="rad", output_units="rad")) is None


@pytest.mark.parametrize(
    ("scale", "turn", "unit"), [(180 / np.pi, 360.0, "deg"), (TICKS, 4096.0, ""), (1.0, 6.283, "rad")]
)
def test_gravity_shows_the_turn_of_an_angle_without_a_unit(scale: float, turn: float, unit: str) -> None:
    found = hanging(without_unit(arm(), scale))
    assert found is not None
    assert found.turn == pytest.approx(turn, rel=0.05)
    assert found.unit == unit
    assert found.angle == pytest.approx(0.3 * turn / (2 * np.pi), rel=0.05)
    assert hanging(without_unit(arm(0.25), scale)) is None  # so small a swing is one of a spring


def test_the_first_look_proposes_the_angle_and_not_its_speed(tmp_path: Path) -> None:
    look = emsid.describe(table(tmp_path / "arm.csv", arm(), "angle [rad]"))
    assert look.reading["output"] == "angle [rad]"
    assert "angle-hangs" in {finding.code for finding in look.findings}
    degrees = emsid.describe(table(tmp_path / "deg.csv", without_unit(arm(), 180 / np.pi), "angle"))
    assert degrees.reading["output"] == "angle"
    assert degrees.reading["units"]["angle"] == "deg"
    assert degrees.record is not None
    assert degrees.record.output_units == ("rad",)
    ticks = emsid.describe(table(tmp_path / "ticks.csv", without_unit(arm(), TICKS), "position"))
    found = {finding.code: finding for finding in ticks.findings}["angle-without-unit"]
    assert found.data["turn"] == pytest.approx(4096, rel=0.05)
    moved = without_unit(recorded(joint(**{"gravity.torque": 0.0}), torque(1500, 1)), 1.0)
    plain = emsid.describe(table(tmp_path / "axis.csv", moved, "angle [rad]"))
    assert plain.reading["output"] == "d(angle [rad])"


@pytest.mark.parametrize(("scale", "said"), [(180 / np.pi, "angle=deg"), (TICKS, "angle=count")])
def test_a_joint_refuses_an_angle_whose_turn_is_not_that_of_radians(scale: float, said: str) -> None:
    record = without_unit(arm(), scale)
    with pytest.raises(DataError, match=said):
        CANDIDATES["joint"](record, Options())
    known = {"gravity.period": 2 * np.pi * scale, "gravity.angle": 0.3 * scale}
    free = ("rotor_viscous", "rotor_inertia", "rotor_friction.coulomb", "gravity.torque")
    fit = CANDIDATES["joint"](record, Options(fixed=known, free=free))  # where the turn is given it is right
    assert fit["gravity.torque"].value == pytest.approx(1.2, rel=1e-3)


def test_one_load_is_said_before_and_after_the_fit() -> None:
    light, heavy = loaded_records()
    assert by_code(light)["one-load"].subject == light.input_names[0]
    plant, known = emsid.plants.joint(), {"gravity.length": 0.3}
    alone = emsid.fit(plant, light, fixed={**known, "gravity.mass": 0.1}, search=False)
    assert [finding.data["one_load"] for finding in alone.findings if finding.code == "not-identifiable"] == [True]
    masses = {"gravity.mass[light]": 0.1, "gravity.mass[heavy]": 0.5}
    both = emsid.fit(plant, [light, heavy], fixed={**known, **masses}, search=False)
    assert not any(finding.data.get("one_load") for finding in both.findings)


def test_the_next_experiment_is_one_with_a_second_load() -> None:
    truth = joint(Feed.VOLTAGE, resistance=2.0, motor_constant=1.0)
    record = replace(recorded(truth, 4.0 * torque(1200, 1)), input_units=("V",))
    result = emsid.identify(record, models="joint", free=list(emsid.plants.joint().default_free))
    assert result.recommendation[-1].data["kind"] == "second-load"


# --- stops -----------------------------------------------------------------------------------------------------------


def stopped(seed: int, low: float = -0.5, high: float = 1.2, fine: int = 20) -> Record:
    """The arm of `arm` between two stops without rebound, by small steps of its own simulation."""
    u, count = torque(1500, seed), 2 * np.pi / 4096
    speed, angle, shown, h = 0.0, 0.3, np.empty(1500), DT / fine
    for k, command in enumerate(u):
        shown[k] = angle
        for _ in range(fine):
            net = command - 1.2 * np.sin(angle - 0.3) - 0.05 * speed
            if speed == 0.0 and abs(net) < 0.15:
                continue
            moved = speed + h / 0.02 * (net - 0.15 * np.sign(speed or net))
            speed = 0.0 if moved * speed < 0 else moved
            angle = min(max(angle + h * speed, low), high)
            speed = 0.0 if angle in (low, high) and speed * (angle - 0.3) > 0 else speed
    return Record(u, count * np.round(shown / count), DT, input_units="N*m", output_units="rad", name="stopped")


def test_samples_at_a_stop_are_found_and_left_out() -> None:
    record = stopped(1)
    found = stops(record)
    y = record.output[:, 0]
    for side, limit in (("lower", -0.5), ("upper", 1.2)):
        assert found[side].sum() > 80
        assert np.all(np.abs(y[found[side]] - limit) < 0.005)
    left = without_stops(record)
    assert len(left) == len(record) - sum(each.sum() for each in found.values())
    assert [finding.data["side"] for finding in left.findings if finding.code == "joint-at-stop"] == ["lower", "upper"]
    assert {"joint-at-stop"} <= {finding.code for finding in advice(record)}
    assert "values-cut-off" not in {finding.code for finding in advice(record)}


def test_friction_that_holds_an_arm_is_no_stop() -> None:
    assert not stops(arm(0.16))  # it rests at both ends of its range
    assert not stops(arm())
    assert without_stops(arm()).findings == ()


def test_a_joint_between_stops_is_identified_without_them() -> None:
    result = emsid.identify(stopped(1), models="joint", free=list(joint().default_free))
    assert [finding.data["masked"] for finding in result.findings if finding.code == "joint-at-stop"] == [True, True]
    fit = result.recommended_fit
    for name, true in (("gravity.torque", 1.2), ("rotor_inertia", 0.02), ("gravity.angle", 0.3)):
        assert fit[name].value == pytest.approx(true, rel=0.02)


def test_the_command_of_the_first_look_leaves_stops_out(tmp_path: Path) -> None:
    path = table(tmp_path / "stopped.csv", stopped(1), "angle")
    look = emsid.describe(path, units={"angle": "rad"})
    assert "angle" in look.mends["mask"]
    again = emsid.read(path, **{**look.reading, **look.mends})
    assert not stops(again)
