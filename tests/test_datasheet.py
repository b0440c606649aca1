"""Datasheets: how they are read, what they start and bound, and which are refused."""

import pytest

from coverage_grey_box import FREE, MOTOR
from emsid.errors import FormatError, ModelError
from emsid.io import read_datasheet
from emsid.models.plants.datasheet import Given, applicable, datasheet
from emsid.models.plants.drive import Drive
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.parameters import Signal, parts, without_overlap
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import Status
from emsid.plant import Friction
from simulated_plants import VOLTAGE, record_of

SHEET = """
[motor]
resistance = { value = "2 ohm", tolerance = "10 %" }
motor_constant = "50 mV*s"
rotor_inertia = "unknown"
load_inertia = { value = 1e-4, tolerance = 0.2 }
inductance = "1 mH"
shaft_stiffness = "20 N*m"
drive.supply = "24 V"

[motor.rotor_friction]
coulomb = ["4 mN*m", "5 mN*m"]
"""


def test_a_datasheet_is_read_with_its_units_tolerances_and_unknowns(tmp_path):
    path = tmp_path / "motor.toml"
    path.write_text(SHEET)
    sheet = read_datasheet(path)
    assert {name: (given.value, given.tolerance) for name, given in sheet.items()} == {
        "resistance": (2.0, 0.1),
        "motor_constant": (pytest.approx(0.05), None),
        "rotor_inertia": (None, None),
        "load_inertia": (1e-4, 0.2),
        "inductance": (pytest.approx(1e-3), None),
        "shaft_stiffness": (20.0, None),
        "drive.supply": (24.0, None),
        "rotor_friction.coulomb.forward": (pytest.approx(4e-3), None),
        "rotor_friction.coulomb.backward": (pytest.approx(5e-3), None),
    }
    assert set(sheet) - set(applicable(sheet, MOTOR)) == {"inductance", "shaft_stiffness"}
    assert applicable(sheet, LinearAxis()) == {}
    axis = datasheet("linear-axis", {"mass": "95 kg", "drive": {"gain": "35 N"}, "viscous_friction": "unknown"})
    assert axis == {"mass": Given(95.0), "drive.gain": Given(35.0), "viscous_friction": Given(None)}


def test_a_datasheet_gives_the_start_and_the_bounds_of_a_search():
    sheet = datasheet(
        "motor",
        {
            "resistance": {"value": MOTOR.value("resistance"), "tolerance": 0},
            "motor_constant": {"value": 1.04 * MOTOR.value("motor_constant"), "tolerance": "10 %"},
            "rotor_inertia": "unknown",
        },
    )
    fit = simulation_error(
        MOTOR.with_values({"rotor_inertia": 1e-3}), record_of(MOTOR, noise=0.05), datasheet=sheet, free=FREE
    )
    rows = {row.name: row for row in fit.table}
    assert rows["motor_constant"].datasheet == pytest.approx(0.052)
    assert rows["motor_constant"].value == pytest.approx(MOTOR.value("motor_constant"), rel=0.02)
    assert rows["rotor_inertia"].datasheet is None
    assert rows["rotor_inertia"].value == pytest.approx(MOTOR.value("rotor_inertia"), rel=0.05)


def test_refinements_keep_to_a_datasheet():
    truth = LinearAxis(80.0, (140.0, 230.0), Friction(25.0), drive=Drive(delay=0.02))
    record = record_of(truth, 30 * VOLTAGE[:1200], noise=1e-4, unit="m", signals=(Signal.POSITION,))
    sheet = datasheet(
        "linear-axis",
        {
            "viscous_friction": {"value": 210.0, "tolerance": "25 %"},
            "mass": {"value": 80.0, "tolerance": 0.0},
            "drive.delay": "unknown",
        },
    )
    fit = choose(
        LinearAxis(),
        record,
        datasheet=sheet,
        effects=("coulomb-by-direction", "viscous-by-direction"),
    )
    plant = fit.model.plant
    assert fit.limits["viscous_friction.forward"] == pytest.approx((157.5, 262.5))
    assert plant.value("viscous_friction.forward") == pytest.approx(157.5)  # as far as the datasheet lets it
    assert plant.value("viscous_friction.backward") > 200.0
    assert plant.value("drive.delay") > 0.01
    assert plant.value("mass") == 80.0


@pytest.mark.parametrize(
    ("fixed", "offset", "left"),
    [
        ({"friction.coulomb": 25.0}, -8.0, {"offset": -8.0}),
        ({"friction.coulomb.forward": 25.0}, -8.0, {"offset": -8.0, "friction.coulomb.backward": 25.0}),
        ({"offset": -8.0}, -8.0, {"friction.coulomb": 25.0}),
        ({"viscous_friction.backward": 220.0}, 0.0, {"friction.coulomb": 25.0}),
        ({}, -8.0, {"friction.coulomb": 25.0, "offset": -8.0}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, dict) else None,
)
def test_fixed_values_stay_fixed_where_a_parameter_is_split_by_direction(fixed, offset, left):
    truth = LinearAxis(80.0, (150.0, 220.0), Friction(25.0), offset)
    record = record_of(truth, 30 * VOLTAGE[:1200], noise=1e-5, unit="m", signals=(Signal.POSITION,))
    fit = choose(
        LinearAxis(),
        record,
        fixed=fixed,
        effects=("coulomb-by-direction", "viscous-by-direction"),
    )
    plant = fit.model.plant
    assert {row.name: row.value for row in fit.table if row.status is Status.FIXED} == fixed
    assert all(plant.value(name) == value for name, value in fixed.items())
    assert set(left) <= set(fit.names)
    assert not set(fixed) & set(fit.names)
    found = left | {"mass": 80.0, "viscous_friction.forward": 150.0, "viscous_friction.backward": 220.0}
    assert {name: plant.value(name) for name in found} == pytest.approx(found, rel=1e-3)


def test_a_parameter_that_is_known_in_one_direction_is_estimated_in_the_other():
    motor = MOTOR.with_values({"rotor_friction.coulomb.backward": 9e-3})
    sheet = {"voltage_dead_zone.b_l": Given(-0.4), "rotor_friction.coulomb.backward": Given(None)}
    known = {"resistance": MOTOR.value("resistance"), "rotor_viscous": MOTOR.value("rotor_viscous")}
    fit = simulation_error(
        motor, record_of(motor, noise=0.05), fixed=known | {"rotor_friction.coulomb.forward": 6e-3}, datasheet=sheet
    )
    assert "rotor_friction.coulomb.backward" in fit.names
    assert "rotor_friction.coulomb" not in fit.names
    assert fit.model.plant.value("rotor_friction.coulomb.forward") == 6e-3
    assert fit.model.plant.value("rotor_friction.coulomb.backward") == pytest.approx(9e-3, rel=0.02)


def test_of_names_that_share_a_value_one_replaces_the_other():
    level, forward, backward = (f"rotor_friction.coulomb{side}" for side in ("", ".forward", ".backward"))
    zone = "voltage_dead_zone"
    assert parts(MOTOR, level) == (forward, backward)
    assert set(parts(MOTOR, f"{zone}.half_width")) == {f"{zone}.b_l", f"{zone}.b_r"}
    assert parts(MOTOR, "resistance") == ()
    assert without_overlap(MOTOR, (level, "resistance"), ()) == (level, "resistance")
    assert without_overlap(MOTOR, (level, "resistance"), ("resistance", forward)) == (backward,)
    assert without_overlap(MOTOR, (level, forward), ()) == (backward, forward)
    assert without_overlap(MOTOR, (level, forward), (level,)) == ()
    with pytest.raises(ModelError, match="has no parameter 'mass'"):
        without_overlap(MOTOR, (level,), ("mass",))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"resistence": 2.0}, r"motor has no parameter 'resistence'; did you mean resistance\?"),
        ({"rotor_friction": {"columb": 2.0}}, r"motor has no parameter 'rotor_friction\.columb'"),
        ({"resistance": -2.0}, "motor resistance is -2 Ω; it must be positive and finite"),
        ({"resistance": "inf"}, "motor resistance is 'inf'; give a number in ohm"),
        ({"resistance": float("inf")}, "motor resistance is inf Ω; it must be positive and finite"),
        ({"rotor_viscous": -2.0}, "it cannot be negative and must be finite"),
        ({"drive": {"freewheel": 2.0}}, "it must be from 0 to 1 and finite"),
        ({"resistance": "2 V"}, "motor resistance is '2 V', which is not in ohm"),
        ({"resistance": True}, "motor resistance is True; give a number in ohm"),
        ({"resistance": {"tolerance": "10 %"}}, "motor resistance has tolerance; write { value"),
        ({"resistance": {"value": 2.0, "plusminus": 0.1}}, "motor resistance has value, plusminus; write { value"),
        ({"resistance": {"value": "unknown", "tolerance": 0.1}}, "motor resistance is unknown and has a tolerance"),
        ({"resistance": {"value": 2.0, "tolerance": "10"}}, "has a tolerance of '10'; write it as '10 %' or 0.1"),
        ({"resistance": {"value": 2.0, "tolerance": 10}}, "has a tolerance of 10; write it as '10 %' or 0.1"),
        ({"resistance": [1.0, 2.0]}, "only frictions take a pair"),
        ({"rotor_friction": {"coulomb": [1.0, 2.0, 3.0]}}, "only frictions take a pair"),
        (
            {"rotor_friction": {"coulomb": 1e-3, "coulomb.forward": 2e-3}},
            "rotor_friction.coulomb and rotor_friction.coulomb.forward overlap: both set one value",
        ),
    ],
)
def test_a_datasheet_that_cannot_be_is_refused_in_one_line(table, message):
    with pytest.raises(ModelError, match=message) as refused:
        datasheet("motor", table)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("resistance = 2", FormatError, r"there is no table \[motor\] or \[linear-axis\]"),
        ("[motor]\n[driver]", FormatError, r"driver outside of \[motor\]"),
        ("[motor", FormatError, "this is not TOML"),
        ("[motor]\nresistance = '2 V'", ModelError, "sheet.toml: motor resistance is '2 V'"),
    ],
)
def test_a_file_that_is_no_datasheet_is_refused_with_its_path(tmp_path, text, error, message):
    path = tmp_path / "sheet.toml"
    path.write_text(text)
    with pytest.raises(error, match=message):
        read_datasheet(path)


def test_a_datasheet_of_no_plant_is_refused():
    with pytest.raises(ModelError, match="no datasheet of a spring; there are motor, linear-axis"):
        datasheet("spring", {})


def test_what_only_one_mass_has_is_in_the_datasheet_of_a_motor_and_not_applied_to_one_with_a_shaft():
    sheet = datasheet("motor", {"voltage_drop": "0.8 V", "viscous_backward": 1e-4})
    rigid, shaft = (PLANTS[name].start for name in ("rigid-motor", "motor"))
    assert set(applicable(sheet, rigid)) == {"voltage_drop", "viscous_backward"}
    assert not applicable(sheet, shaft)
