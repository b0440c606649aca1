"""The plant in motion: against SciPy, against closed forms, and by its balances and symmetries."""

import signal
from dataclasses import asdict, fields, replace
from math import inf, log

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from emsid.errors import DataError, ModelError
from emsid.plant import DeadZoneLaw, Friction, Motor, State, Taylor, simulate
from emsid.plant.polynomials import first_zero
from emsid.plant.reference import simulate_reference
from independent.two_masses import load_speed
from simulated_plants import two_sines

CHANNELS = tuple(field.name for field in fields(State))
LOADED = replace(Motor(), load_friction=Friction((2e-3, 3e-3), 1e-3, 0.5))
KINKED = replace(LOADED, torque_dead_zone=DeadZoneLaw(-0.01, 0.02, 0.9, 1.1))
SOFT = replace(LOADED, shaft_stiffness=0.05, shaft_damping=1e-5)
IDEAL = Motor(rotor_friction=Friction(), load_friction=Friction(), voltage_dead_zone=None)


@pytest.mark.parametrize(
    ("motor", "volts"),
    [(Motor(), 1.5), (KINKED, 2.0), (SOFT, 1.5)],
    ids=["default", "kinked", "soft"],
)
def test_agrees_with_scipy_restarted_at_every_event(motor, volts):
    dt = 2e-3
    voltage = two_sines(500, dt, volts)
    expected, transitions = simulate_reference(motor, voltage, dt, tolerance=1e-11)
    result = simulate(motor, voltage, dt)
    assert result.events.transitions == transitions >= 20
    for k, name in enumerate(CHANNELS):
        size = np.abs(expected[:, k]).max()
        np.testing.assert_allclose(getattr(result, name), expected[:-1, k], rtol=0, atol=1e-8 * size, err_msg=name)


def test_backlash_agrees_with_a_simulator_of_its_own():
    motor, volts = replace(Motor(), shaft_backlash=0.1), np.repeat([4.0, -6.0, 9.0, -3.0, 7.0, -9.0], 12)
    expected = load_speed(asdict(motor), volts, 2e-3)
    result = simulate(motor, volts, 2e-3)
    assert np.abs(result.twist).max() > 0.05  # in contact
    assert np.sqrt(np.mean((result.load_speed - expected) ** 2)) < 1e-4 * np.std(expected)
    without = simulate(Motor(), volts, 2e-3).load_speed
    assert np.sqrt(np.mean((without - expected) ** 2)) > 0.02 * np.std(expected)


@pytest.mark.parametrize("order", [2, 3, 4, 6])
def test_order_of_convergence_is_the_order_of_the_series(order):
    dt, voltage = 2e-3, two_sines(400, 2e-3)
    exact = simulate(KINKED, voltage, dt, method=Taylor(30, 1e-17))
    assert exact.events.transitions >= 20
    steps = dt / np.array([4, 8, 16]) if order > 3 else dt / np.array([16, 32, 64])
    errors = []
    for step in steps:
        result = simulate(KINKED, voltage, dt, method=Taylor(order, inf, step))
        errors.append(np.sqrt(np.mean((result.load_speed - exact.load_speed) ** 2)))
    measured = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(measured, order, atol=0.05)


@pytest.mark.parametrize("inductance", [0.0, 2e-3])
@pytest.mark.parametrize("rigid", [False, True])
def test_without_friction_it_is_the_linear_system(inductance, rigid):
    motor = replace(IDEAL, inductance=inductance)
    motor = motor.rigid() if rigid else motor
    rng, dt = np.random.default_rng(1), 2e-3
    inputs = rng.normal(size=(200, 2)) * [5.0, 0.02]
    a, b, c, *_ = cont2discrete(tuple(motor.linear()), dt)
    x, expected = np.zeros(len(a)), []
    for u in inputs:
        expected.append(c @ x)
        x = a @ x + b @ u
    result = simulate(motor, inputs[:, 0], dt, disturbance=inputs[:, 1])
    np.testing.assert_allclose(np.column_stack([result.rotor_speed, result.load_speed]), expected, atol=1e-9)
    assert result.events.transitions == 0


@pytest.mark.parametrize(
    ("limit", "nearby", "factor"),
    [  # where the motor stops, a shaft still swings by as much as the root of its compliance
        (LOADED.rigid(), [replace(LOADED, shaft_stiffness=k, shaft_damping=0.02) for k in (1e2, 1e4)], 8.0),
        (replace(LOADED, inductance=0.0), [replace(LOADED, inductance=k) for k in (1e-4, 1e-6)], 50.0),
    ],
    ids=["stiff shaft", "small inductance"],
)
def test_limits_are_approached(limit, nearby, factor):
    voltage, dt = two_sines(200, 2e-3), 2e-3
    end = simulate(limit, voltage, dt).load_speed
    far, near = (np.sqrt(np.mean((simulate(motor, voltage, dt).load_speed - end) ** 2)) for motor in nearby)
    assert far > factor * near
    assert near < 1e-3 * np.abs(end).max()


# Any motor, from any corner of what is plausible, on any voltage.
def scaled(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(log(low), log(high)).map(lambda x: float(np.exp(x)))


frictions = st.builds(
    Friction,
    st.tuples(st.floats(0, 0.02), st.floats(0, 0.02)),
    st.tuples(st.floats(0, 0.01), st.floats(0, 0.01)),
    st.tuples(st.floats(0, 5), st.floats(0, 5)),
)
motors = st.builds(
    Motor,
    resistance=scaled(0.5, 10),
    inductance=st.just(0.0) | scaled(2e-4, 2e-2),
    motor_constant=scaled(0.01, 0.2),
    rotor_inertia=scaled(1e-5, 1e-3),
    shaft_stiffness=st.just(inf) | scaled(0.1, 100),
    shaft_damping=scaled(1e-6, 1e-2),
    shaft_backlash=st.just(0.0) | scaled(1e-4, 0.3),
    load_inertia=scaled(1e-5, 1e-3),
    rotor_friction=frictions,
    load_friction=frictions,
    voltage_dead_zone=st.none() | st.builds(DeadZoneLaw, st.floats(-1, 0), st.floats(0, 1)),
    torque_dead_zone=st.none() | st.builds(DeadZoneLaw, st.floats(-0.02, 0), st.floats(0, 0.02), scaled(0.5, 2)),
)
drives = st.lists(st.tuples(st.floats(-12, 12), st.floats(-0.05, 0.05)), min_size=2, max_size=30)


@settings(max_examples=150, deadline=None)
@given(motors, drives, st.sampled_from([1e-3, 5e-3, 5e-2]))
def test_energy_is_conserved_and_friction_only_dissipates(motor, drive, dt):
    voltage, torque = np.array(drive).T
    energy = simulate(motor, voltage, dt, disturbance=torque, energy=True).energy
    turnover = sum(abs(getattr(energy, field.name)) for field in fields(energy))
    assert abs(energy.imbalance) <= 1e-9 * turnover + 1e-15  # J; tolerances are relative to what one volt causes
    for name in ("resistance", "rotor_viscous", "load_viscous", "rotor_friction", "load_friction", "shaft"):
        assert getattr(energy, name) >= -1e-15


@settings(max_examples=60, deadline=None)
@given(motors, drives, st.integers(1, 29))
def test_simulation_in_pieces_equals_the_whole(motor, drive, at):
    voltage, torque = np.array(drive).T
    whole = simulate(motor, voltage, 5e-3, disturbance=torque)
    first = simulate(motor, voltage[:at], 5e-3, disturbance=torque[:at])
    second = simulate(motor, voltage[at:], 5e-3, disturbance=torque[at:], initial=first.final)
    for name in CHANNELS:
        pieces = np.concatenate([getattr(first, name), getattr(second, name)])
        np.testing.assert_array_equal(pieces, getattr(whole, name))
    assert second.final == whole.final


@settings(max_examples=60, deadline=None)
@given(motors, drives)
def test_a_longer_sample_equals_two_equal_samples(motor, drive):
    voltage, torque = np.array(drive).T
    once = simulate(motor, voltage, 8e-3, disturbance=torque)
    often = simulate(motor, np.repeat(voltage, 8), 1e-3, disturbance=np.repeat(torque, 8))
    for name in CHANNELS:
        expected = getattr(often, name)
        np.testing.assert_allclose(getattr(once, name), expected[::8], rtol=1e-6, atol=1e-7)


def test_a_symmetric_motor_has_no_preferred_direction():
    voltage = two_sines(500, 2e-3)
    there, back = simulate(Motor(), voltage, 2e-3), simulate(Motor(), -voltage, 2e-3)
    np.testing.assert_allclose(there.load_speed, -back.load_speed, atol=1e-12)


def test_rest_below_breakaway_is_exactly_rest():
    motor = replace(Motor(), load_friction=Friction())
    forward, _ = motor.rotor_friction.breakaway
    threshold = motor.voltage_dead_zone.b_r + forward * motor.resistance / motor.motor_constant
    for factor in (0.0, 0.5, 0.999999, 1.0):
        held = simulate(motor, np.full(2000, factor * threshold), 1e-3)
        assert not held.rotor_speed.any()
        assert not held.load_speed.any()
        assert not held.twist.any()
        assert len(held.events.time) == 0
    assert simulate(motor, np.full(2000, 1.001 * threshold), 1e-3).rotor_speed[-1] > 0


def test_breakaway_happens_at_the_current_of_the_closed_form():
    motor = replace(Motor(), voltage_dead_zone=None)
    volt, (forward, _) = 3.0, motor.rotor_friction.breakaway
    share = forward / motor.motor_constant * motor.resistance / volt
    expected = -motor.inductance / motor.resistance * log(1 - share)
    events = simulate(motor, [volt] * 5, 1e-3).events
    assert events.time[0] == pytest.approx(expected, rel=1e-10)
    assert (events.body[0], events.before[0], events.after[0]) == (0, 0, 1)


def test_a_coasting_motor_stops_at_the_time_of_the_closed_form():
    level, start = 5e-3, 40.0
    motor = replace(IDEAL, inductance=0.0, rotor_friction=Friction(level)).rigid()
    drag = motor.rotor_viscous + motor.load_viscous + motor.motor_constant**2 / motor.resistance
    expected = (motor.rotor_inertia + motor.load_inertia) / drag * log(1 + start * drag / level)
    result = simulate(motor, np.zeros(100), 1e-3, initial=State(rotor_speed=start, load_speed=start))
    assert result.events.time == pytest.approx([expected], rel=1e-10)
    np.testing.assert_array_equal(result.rotor_held, result.time > expected)


def test_each_side_sticks_on_its_own():
    result = simulate(SOFT, two_sines(2000, 1e-3, 1.5), 1e-3)
    states = set(zip(result.rotor_held.tolist(), result.load_held.tolist(), strict=True))
    assert states == {(False, False), (False, True), (True, False), (True, True)}


def test_a_reversal_is_one_event_without_a_transition():
    motor = replace(Motor(), load_friction=Friction())
    result = simulate(motor, np.repeat([12.0, -12.0], 100), 1e-3)
    assert list(zip(result.events.before, result.events.after, strict=True)) == [(0, 1), (1, -1)]
    assert result.events.transitions == 1


def test_a_disturbance_moves_the_load_only_beyond_breakaway():
    motor = LOADED.rigid()
    held = sum(friction.breakaway[1] for friction in (motor.rotor_friction, motor.load_friction))
    assert simulate(motor, np.zeros(50), 1e-3, disturbance=0.999 * held).final.load_speed == 0
    assert simulate(motor, np.zeros(50), 1e-3, disturbance=1.001 * held).final.load_speed < 0


def test_friction_on_the_load_is_as_negligible_as_in_the_paper():
    dt = 1e-3
    t = dt * np.arange(20_000)
    voltage = 3 * np.sin(2 * np.pi * 0.7 * t) + 1.5 * np.sin(2 * np.pi * 2.3 * t)
    bare = replace(Motor(), load_friction=Friction())
    difference = simulate(Motor(), voltage, dt).load_speed - simulate(bare, voltage, dt).load_speed
    assert 1e-6 < np.mean(difference**2) < 1e-5  # 3.341e-6 in section V


def test_an_excess_with_a_high_rate_is_accurate_when_the_motor_slows_down():
    """The Stribeck term is nothing at the start of a long step and all of the friction at its end."""
    motor = replace(LOADED, rotor_friction=Friction(1e-3, 2e-2, 20.0), inductance=0.0).rigid()
    start = State(rotor_speed=30.0, load_speed=30.0)
    long = simulate(motor, np.zeros(2), 0.1, initial=start)
    short = simulate(motor, np.zeros(2000), 1e-4, initial=start, method=Taylor(30, 1e-16))
    assert long.events.time == pytest.approx(short.events.time, rel=1e-9)


@settings(deadline=None)
@given(st.lists(st.floats(-1, 2), min_size=1, max_size=8), st.floats(0.05, 1.5))
def test_first_zero_of_a_polynomial(roots, end):
    inside = sorted(root for root in roots if 0 < root <= end)
    assume(np.diff(sorted([0.0, *roots, end])).min() > 1e-3)  # else rounding the coefficients moves the roots
    p = np.polynomial.polynomial.polyfromroots(roots)
    found = first_zero(p * np.sign(p[0]), end, np.empty(len(p)))
    assert found == (pytest.approx(inside[0], rel=1e-6) if inside else inf)


@pytest.mark.parametrize("capacity", [1, 5, 30])
def test_more_events_than_the_arrays_hold(capacity, monkeypatch):
    voltage = two_sines(500, 2e-3)
    expected = simulate(KINKED, voltage, 2e-3, energy=True)
    assert len(expected.events.time) > 30
    monkeypatch.setattr("emsid.plant.simulation.SPARE_EVENTS", capacity - len(voltage))
    result = simulate(KINKED, voltage, 2e-3, energy=True)
    for mine, theirs in zip(result.events, expected.events, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(result.load_speed, expected.load_speed)
    assert result.energy == expected.energy


def test_ctrl_c_while_it_runs_is_an_exception_afterwards():
    def run():
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        simulate(Motor(), [2.0, -2.0] * 50_000, 5e-3)

    simulate(Motor(), [0.0], 1e-3)  # loads what is compiled
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            run()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def test_no_samples_give_no_motion():
    result = simulate(Motor(), [], 1e-3, initial=State(load_angle=2.0))
    assert len(result.time) == 0
    assert result.final == State(load_angle=2.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"voltage": np.zeros((3, 1))}, r"voltage has shape \(3, 1\)"),
        ({"voltage": [0.0, np.nan]}, "voltage is nan at sample 1"),
        ({"dt": 0.0}, "dt is 0 s; it must be positive"),
        ({"dt": -1e-3}, "dt is -0.001 s"),
        ({"dt": np.inf}, "dt is inf at sample 0"),
        ({"dt": [1e-3]}, r"dt has shape \(1,\) for a voltage of shape \(2,\)"),
        ({"disturbance": [0.0, 0.0, 0.0]}, r"disturbance has shape \(3,\)"),
        ({"disturbance": [0.0, -np.inf]}, "disturbance is -inf at sample 1"),
    ],
)
def test_bad_input_is_refused_in_one_line(arguments, message):
    with pytest.raises(DataError, match=message):
        simulate(**{"motor": Motor(), "voltage": [0.0, 1.0], "dt": 1e-3} | arguments)


def test_impossible_states_and_methods_are_refused():
    with pytest.raises(ModelError, match="not finite"):
        simulate(Motor(), [0.0], 1e-3, initial=State(current=np.nan))
    with pytest.raises(ModelError, match="one speed"):
        simulate(Motor().rigid(), [0.0], 1e-3, initial=State(rotor_speed=1.0))
    with pytest.raises(ModelError, match="order 1"):
        Taylor(order=1)
    with pytest.raises(ModelError, match="tolerance 0"):
        Taylor(tolerance=0.0)
    with pytest.raises(ModelError, match="beyond 0 s: its time constants"):
        simulate(replace(Motor(), inductance=1e-12), [1.0], 1.0)
