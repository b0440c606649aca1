"""Friction laws (4.7), (4.8) and the dead zone (4.9)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emsid.errors import ModelError
from emsid.plant import DeadZoneLaw, Friction
from emsid.plant.friction import coulomb, sign, stribeck, viscous

finite = st.floats(-1e3, 1e3)
sizes = st.floats(0, 10)


def test_sign_is_zero_at_rest_only():
    np.testing.assert_array_equal(sign([-2.0, -1e-300, 0.0, 1e-300, 3.0]), [-1, -1, 0, 1, 1])


def test_laws_follow_their_equations():
    w = np.array([[-2.0, 0.0], [0.5, 4.0]])
    np.testing.assert_allclose(coulomb(w, 0.3), [[-0.3, 0.0], [0.3, 0.3]])
    np.testing.assert_allclose(
        stribeck(w, 0.2, 1.5), [[-0.2 * np.exp(-3), 0.0], [0.2 * np.exp(-0.75), 0.2 * np.exp(-6)]]
    )
    np.testing.assert_allclose(viscous(w, 0.1), 0.1 * w)


def test_directions_have_their_own_levels():
    friction = Friction((1.0, 2.0), (0.5, 0.25), (1.0, 3.0))
    np.testing.assert_allclose(
        friction.torque([-1.0, 0.0, 1.0]), [-(2.0 + 0.25 * np.exp(-3.0)), 0.0, 1.0 + 0.5 * np.exp(-1.0)]
    )
    assert friction.breakaway == (1.5, 2.25)


@given(sizes, sizes, sizes, finite)
def test_friction_opposes_motion_and_lies_between_coulomb_and_breakaway(level, excess, rate, speed):
    friction = Friction(level, excess, rate)
    torque = float(friction.torque(speed))
    assert torque == -float(friction.torque(-speed))
    assert torque * speed >= 0
    if speed != 0:
        assert level <= abs(torque) <= friction.breakaway[0]


def test_breakaway_is_the_limit_at_standstill():
    friction = Friction((0.1, 0.3), (0.2, 0.1), 5.0)
    forward, backward = friction.breakaway
    assert float(friction.torque(1e-12)) == pytest.approx(forward, rel=1e-10)
    assert float(friction.torque(-1e-12)) == pytest.approx(-backward, rel=1e-10)


@pytest.mark.parametrize("bad", [-0.1, np.nan, np.inf, (0.1, -0.1), (0.1,), "much"])
def test_a_friction_that_is_not_physical_is_refused(bad):
    with pytest.raises(ModelError, match="friction stribeck is"):
        Friction(1.0, stribeck=bad)


zones = st.builds(DeadZoneLaw, st.floats(-5, 0), st.floats(0, 5), st.floats(0.1, 10), st.floats(0.1, 10))


@given(zones, finite)
def test_the_inverse_compensates_the_dead_zone(zone, value):
    assert float(zone(zone.inverse(value))) == pytest.approx(value, rel=1e-9, abs=1e-9)
    assert zone.b_l <= float(zone.inverse(0.0)) <= zone.b_r


@given(zones, finite)
def test_dead_zone_follows_its_three_branches(zone, v):
    if v >= zone.b_r:
        expected, slope = zone.m_r * (v - zone.b_r), zone.m_r
    elif v <= zone.b_l:
        expected, slope = zone.m_l * (v - zone.b_l), zone.m_l
    else:
        expected, slope = 0.0, 0.0
    assert float(zone(v)) == pytest.approx(expected)
    assert float(zone.derivative(v)) == slope


def test_dead_zone_keeps_the_shape_of_its_input():
    assert DeadZoneLaw(-1, 1)(np.zeros((3, 2))).shape == (3, 2)


@pytest.mark.parametrize(
    ("zone", "message"),
    [
        ({"b_l": 0.1, "b_r": 1.0}, "must enclose 0"),
        ({"b_l": -1.0, "b_r": -0.5}, "must enclose 0"),
        ({"b_l": -1.0, "b_r": 1.0, "m_l": 0.0}, "slopes"),
        ({"b_l": -1.0, "b_r": np.nan}, "b_r is nan"),
    ],
)
def test_an_invalid_dead_zone_is_refused(zone, message):
    with pytest.raises(ModelError, match=message):
        DeadZoneLaw(**zone)
