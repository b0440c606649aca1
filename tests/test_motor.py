"""The motor: its parameters, how they are read, and its linear part (4.1)–(4.6)."""

from dataclasses import asdict, fields, replace
from operator import attrgetter

import numpy as np
import pytest

from emsid.errors import ModelError
from emsid.plant import DeadZoneLaw, Friction, Motor


def test_every_parameter_is_in_the_table():
    names = {parameter.name.split(".")[0] for parameter in Motor.parameters()}
    assert names == {field.name for field in fields(Motor)}
    assert all(parameter.description and parameter.unit for parameter in Motor.parameters())


def test_a_datasheet_in_its_own_units_is_the_motor_in_si():
    motor = Motor.from_dict(
        {
            "resistance": "1200 mohm",
            "inductance": 0.56e-3,
            "motor_constant": "48.5 mV*s/rad",
            "rotor_inertia": "99.5 g*cm^2",
            "rotor_viscous": "1e-3 mN*m*s/rad",
            "shaft_stiffness": "25",
            "rotor_friction": {"coulomb": ["5 mN*m", 6e-3], "stribeck_rate": 0.2},
            "voltage_dead_zone": {},
            "torque_dead_zone": {"b_l": "-2 mN*m", "b_r": "3 mN*m", "m_l": 0.9},
        }
    )
    expected = replace(
        Motor(),
        resistance=1.2,
        inductance=0.56e-3,
        motor_constant=0.0485,
        rotor_inertia=9.95e-6,
        rotor_viscous=1e-6,
        shaft_stiffness=25.0,
        rotor_friction=Friction((5e-3, 6e-3), 0.0, 0.2),
        voltage_dead_zone=None,
        torque_dead_zone=DeadZoneLaw(-2e-3, 3e-3, m_l=0.9),
    )
    assert motor.voltage_dead_zone is None
    for parameter in Motor.parameters():
        if not parameter.name.startswith("voltage_dead_zone"):
            value = attrgetter(parameter.name)
            assert value(motor) == pytest.approx(value(expected), rel=1e-12), parameter.name


@pytest.mark.parametrize("motor", [Motor(), Motor().rigid(), Motor(torque_dead_zone=DeadZoneLaw(-0.1, 0.2))])
def test_a_motor_is_restored_from_its_table(motor):
    assert Motor.from_dict(asdict(motor)) == motor


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"resistence": 1.0}, "no parameter 'resistence'; there are resistance, inductance, "),
        ({"load_friction": {"columb": 1.0}}, "load_friction has no parameter 'columb'; there are coulomb, stribeck"),
        ({"rotor_inertia": "3 ohm"}, "rotor_inertia is '3 ohm', which is not in kg"),
        ({"rotor_inertia": "3 furlongs"}, "rotor_inertia is '3 furlongs', which is not in kg"),
        ({"rotor_inertia": "heavy"}, "rotor_inertia is 'heavy'; give a number in kg"),
        ({"rotor_inertia": -1e-5}, "motor rotor_inertia is -1e-05 kg·m²; it must be positive"),
        ({"rotor_inertia": True}, "rotor_inertia is True"),
        ({"resistance": float("nan")}, "resistance is nan"),
        ({"motor_constant": 0}, "motor_constant is 0"),
        ({"load_inertia": float("inf")}, "only shaft_stiffness may be infinite"),
        ({"inductance": -1}, "must be zero or positive"),
        ({"load_friction": 3.0}, "give a table"),
        ({"load_friction": {"coulomb": -1.0}}, "friction coulomb is -1.0"),
        ({"load_friction": {"coulomb": [1.0, 2.0, 3.0]}}, "give a number or a pair"),
        ({"voltage_dead_zone": {"b_l": -1.0}}, "needs both b_l and b_r, in V"),
        ({"voltage_dead_zone": {"b_l": "-1 V", "b_r": "1 A"}}, "voltage_dead_zone.b_r is '1 A', which is not in V"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(table, message):
    with pytest.raises(ModelError, match=message) as caught:
        Motor.from_dict(table)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("wrong", [{"rotor_friction": 0.1}, {"voltage_dead_zone": 0.5}, {"rotor_friction": None}])
def test_a_part_of_another_kind_is_refused(wrong):
    with pytest.raises(ModelError, match="give a"):
        Motor(**wrong)


@pytest.mark.parametrize("inductance", [0.0, 2e-3])
@pytest.mark.parametrize("rigid", [False, True])
def test_linear_part_has_the_steady_state_of_the_equations(inductance, rigid):
    motor = replace(Motor(), inductance=inductance)
    a, b, c, d = (motor.rigid() if rigid else motor).linear()
    gain = d - c @ np.linalg.solve(a, b)
    r, k = motor.resistance, motor.motor_constant
    drag = motor.rotor_viscous + motor.load_viscous + k**2 / r
    np.testing.assert_allclose(gain[1], [k / r / drag, -1 / drag], rtol=1e-9)
    assert gain[0, 0] == pytest.approx(gain[1, 0])
    assert len(a) == 1 + 2 * (not rigid) + (inductance > 0)
    assert np.linalg.eigvals(a).real.max() < 0


def test_rigid_motor_is_the_limit_of_a_stiff_shaft():
    slow = [
        np.sort(np.linalg.eigvals(replace(Motor(), shaft_stiffness=k_s).linear().A).real)[-1] for k_s in (1e3, 1e4, 1e5)
    ]
    limit = np.sort(np.linalg.eigvals(Motor().rigid().linear().A).real)[-1]
    errors = np.abs(np.array(slow) - limit)
    np.testing.assert_allclose(errors[:-1] / errors[1:], 10.0, rtol=0.05)
