"""What the signals show of themselves: positions, directions, codes, references and stuck sensors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

import emsid
from emsid.first_look import describe
from emsid.first_look.baseline import _simulated
from emsid.first_look.columns import Stretch
from emsid.first_look.faults import is_stuck
from first_look_records import N, T, U, Write, Y, codes, data, proposals

# --- positions -------------------------------------------------------------------------------------------------------


def test_a_position_is_differentiated_and_a_difference_is_recognised(write: Write) -> None:
    counts = np.cumsum(np.rint(Y))
    look = describe(write({"PWM": U, "mStep": counts, "mVel": np.diff(counts, prepend=0)}))
    assert data(look, "difference-of-position") == {"position": "mStep"}
    assert "position-differentiated" not in codes(look)
    look = describe(write({"PWM": U, "enc": counts}))
    assert look.reading["output"] == "d(enc)"
    assert data(look, "position-differentiated") == {"input": ""}
    for output in ("enc", "d(enc)"):  # nothing is proposed where it is given
        assert "position-differentiated" not in codes(describe(write({"PWM": U, "enc": counts}), output=output))


def test_an_output_whose_change_answers_is_a_position(write: Write) -> None:
    rng = np.random.default_rng(2)
    look = describe(write({"t": T, "u": U, "y": 0.01 * np.cumsum(Y)}))
    assert data(look, "position-differentiated") == {"input": "u"}
    assert (look.reading["output"], look.response.delay) == ("d(y)", 0)  # the difference of the rows beside
    named = describe(write({"t": T, "u": U, "y": 0.01 * np.cumsum(Y)}), output="y")
    assert (named.reading["output"], "position-differentiated" in codes(named)) == ("y", False)
    unrelated = describe(write({"t": T, "u": U, "y": rng.standard_normal(N)}))
    assert {"no-response", "position-differentiated"} & codes(unrelated) == {"no-response"}


@pytest.mark.parametrize("names", [("left_pwm", "left_ticks"), ("cmd_deg", "act_deg")])
def test_a_column_that_is_no_integral_is_taken_as_it_is(write: Write, names: tuple[str, str]) -> None:
    """Counts since the row before, and an angle that a servo sets, are named as positions."""
    u = np.repeat(np.random.default_rng(3).uniform(-20, 20, 50), 16)
    y = signal.lfilter([0.0, 0.2], [1.0, -0.8], u)
    for values, output in ((y, names[1]), (np.cumsum(y), f"d({names[1]})")):
        assert describe(write({"t": T, names[0]: u, names[1]: values})).reading["output"] == output


@pytest.mark.parametrize("seed", [0, 5, 6, 15])
def test_a_magnitude_is_no_position(seed: int) -> None:
    """The change of a pulley's absolute speed answers a binary input by chance, and the speed itself does not."""
    rng, own = np.random.default_rng(seed), np.exp(0.42 * (1j - 0.18))
    u = np.repeat(rng.choice([-1.0, 1.0], 60), 5)
    speed = signal.lfilter([0.0, 0.1], np.poly([own, own.conjugate(), 0.987]).real, u) + 0.004 * rng.standard_normal(
        300
    )
    look = describe({"t": 0.02 * np.arange(300), "u": u, "z": np.abs(speed)})
    assert (look.reading["output"], "scale" in look.reading) == ("z", False)
    assert "output-without-sign" in codes(look)


@pytest.mark.parametrize("seed", range(3))
def test_a_speed_without_its_sign_answers_a_servo_pulse(write: Write, seed: int) -> None:
    """The motor stands at a pulse of 1500 µs, and its speed is counted without a direction."""
    rng = np.random.default_rng(seed)
    pulse = np.repeat(rng.integers(1080, 1921, 25), 20).astype(float)
    speed = signal.lfilter([0.0, 0.3], [1.0, -0.7], 0.1 * (pulse - 1500))
    rows = {"t": 0.1 * np.arange(500), "servo [µs]": pulse, "speed [rpm]": np.round(np.abs(speed))}
    look = describe(write(rows))
    assert (look.roles.input, look.roles.output) == ("servo [µs]", "speed [rpm]")
    assert (look.response.delay, look.response.sign, look.response.without_sign) == (1, 0, True)
    assert {"no-response", "output-without-sign", "response-negative"} & codes(look) == {"output-without-sign"}


def test_a_column_that_stays_is_no_difference_of_a_held_one(write: Write) -> None:
    """Nearly all changes of the input are zero, as all or nearly all values of the output are."""
    held = np.repeat(U[::40], 40)
    for y in (0 * Y, np.where(np.arange(N) % 40 == 5, 1.0, 0.0)):
        assert "difference-of-position" not in codes(describe(write({"t": T, "u": held, "y": y})))


@pytest.mark.parametrize(("name", "period", "low"), [("enc", 65536, -32768), ("angle", 360, 0), ("enc", 4096, 0)])
def test_a_position_that_starts_again_is_made_continuous(write: Write, name: str, period: int, low: int) -> None:
    position = np.rint(0.1 * period * np.cumsum(Y) / np.max(np.abs(Y)))
    look = describe(write({"t": T, "PWM": U, name: (position - low) % period + low}))
    plain = describe(write({"t": T, "PWM": U, name: position}))
    assert data(look, "position-wraps") == {"period": period}
    assert look.reading == plain.reading | {"wrap": {name: period}}
    assert f"--wrap {name}={period}" in " ".join(proposals([look])[0])
    assert "position-wraps" not in codes(plain)
    assert look.record is not None
    assert plain.record is not None
    np.testing.assert_allclose(look.record.output, plain.record.output, atol=1e-6 * period)


def test_a_counter_of_any_period_starts_again(write: Write) -> None:
    position = np.rint(100 * np.cumsum(Y) / np.max(np.abs(Y)))
    look = describe(write({"t": T, "u": U, "ticks": position % 4000}))
    assert look.reading["wrap"] == {"ticks": pytest.approx(4000, rel=0.01)}


def test_an_angle_in_radians_starts_again_between_its_samples(write: Write) -> None:
    angle = np.cumsum(Y) / np.max(np.abs(Y))
    look = describe(write({"t": T, "u": U, "theta [rad]": np.angle(np.exp(1j * angle))}))
    assert look.reading["wrap"] == {"theta [rad]": pytest.approx(2 * np.pi)}


def test_a_position_that_only_jumps_does_not_start_again(write: Write) -> None:
    rng = np.random.default_rng(2)
    position = np.cumsum(Y)
    reset = np.where(np.arange(N) < N // 2, position, position - position[N // 2])  # set to zero once
    steps = np.where(U > 0, 300.0, 0.0)
    for values in (reset, steps, rng.uniform(0, 360, N)):
        assert "position-wraps" not in codes(describe(write({"t": T, "u": U, "angle": values})))


# --- signs -----------------------------------------------------------------------------------------------------------


def test_a_reversed_position_is_seen_by_its_change(write: Write) -> None:
    for sign in (1, -1):
        look = describe(write({"t": T, "u": sign * U, "position": 0.01 * np.cumsum(Y)}), output="position")
        assert (look.response.delay, look.response.sign) == (1, sign)


def test_an_input_without_sign_takes_that_of_its_direction(write: Write) -> None:
    columns = {"t": T, "pwm": np.abs(U), "dir": np.where(U > 0, 1, 0), "lamp": np.arange(N) // 50 % 2}
    for name, output in (("speed", Y), ("enc", np.cumsum(np.rint(Y)))):
        look = describe(write(columns | {name: output}))
        assert data(look, "direction-column") == {"column": "dir", "output": name}
        assert look.reading["direction"] == {"pwm": "dir"}
        assert look.record is not None
        np.testing.assert_array_equal(look.record.input[:, 0], np.where(U > 0, np.abs(U), -np.abs(U)))
        assert "--direction pwm=dir" in " ".join(proposals([look])[0])
    signed = describe(write(columns | {"pwm": U, "speed": Y}))
    assert "direction-column" not in codes(signed)
    one_way = describe(write({"t": T, "pwm": np.abs(U), "lamp": columns["lamp"], "speed": np.abs(Y)}))
    assert "direction-column" not in codes(one_way)


def test_a_direction_in_words_is_found(write: Write) -> None:
    words = np.where(U > 0, "CW", "CCW")
    log = write("t,dir,duty,speed\n" + "".join(f"{T[k]:.2f},{words[k]},{abs(U[k])},{Y[k]}\n" for k in range(N)))
    assert describe(log).reading["direction"] == {"duty": "dir"}
    record = emsid.read(log, input="duty", output="speed", time="t", direction={"duty": "dir"})
    np.testing.assert_array_equal(record.input[:, 0], U)


def test_a_reference_that_the_output_follows_shows_a_controller(write: Write) -> None:
    rng = np.random.default_rng(2)
    columns = {"t": T, "u": U, "y": Y}
    look = describe(write(columns | {"setpoint": Y + 0.1 * rng.standard_normal(N)}))
    assert data(look, "reference-column") == {"input": "u", "follows": "y"}
    assert "reference-column" not in codes(describe(write(columns | {"setpoint": rng.standard_normal(N)})))


def test_a_reference_of_a_position_shows_a_controller_of_its_speed_too(write: Write) -> None:
    position = np.cumsum(Y)
    look = describe(write({"t": T, "current": U, "velocity": Y, "angle": position, "angle_ref": np.roll(position, -1)}))
    assert (look.roles.input, look.roles.output) == ("current", "velocity")
    assert data(look, "reference-column") == {"input": "current", "follows": "angle"}


def test_a_tachometer_measures_a_speed_in_volts(write: Write) -> None:
    look = describe(write({"t [s]": T, "Ankerspannung [V]": U, "Tacho [V]": Y, "Ankerstrom [A]": U - 0.1 * Y}))
    assert look.roles.output == "Tacho [V]"


# --- codes -----------------------------------------------------------------------------------------------------------


def test_codes_are_masked_and_what_the_output_does_there_is_said(write: Write) -> None:
    u, y = U.copy(), Y.copy()
    for start in (100, 300, 500):
        u[start : start + 20] = 1000
        y[start : start + 20] = 40 * 0.7 ** np.arange(20)
    look = describe(write({"t": T, "Commanded PWM": u, "speed": y}))
    assert look.reading["mask"] == 'abs("Commanded PWM") > 10'
    (code,) = data(look, "isolated-values")["codes"]
    assert code == {"value": 1000, "count": 60, "share": 0.075, "response": "falls"}
    assert "isolated-values" not in codes(describe(write({"t": T, "Commanded PWM": U, "speed": Y})))


def test_the_effect_of_a_code_on_a_position_is_that_on_its_speed(write: Write) -> None:
    pwm, speed = 20 * U, np.zeros(N)
    for k in range(60, N, 120):
        pwm[k : k + 20] = 1000
    for k in range(1, N):
        speed[k] = 0.5 * speed[k - 1] if pwm[k - 1] == 1000 else 0.9 * speed[k - 1] + 0.025 * pwm[k - 1]
    look = describe(write({"t": T, "PWM": pwm, "ticks": np.cumsum(speed)}))
    assert [code["response"] for code in data(look, "isolated-values")["codes"]] in (["falls"], ["rests"])


# --- stuck sensors ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [500.0, -500.0])
def test_outliers_are_masked_and_turn_no_sign(write: Write, size: float) -> None:
    y = Y.copy()
    y[[200, 400]] += size
    look = describe(write({"t": T, "u": U, "speed (rpm)": y}))
    assert data(look, "outliers")["count"] == 2
    assert look.record is not None
    assert len(look.record) == N - 2
    assert codes(look) >= {"outliers", "response-delay"}
    given = describe(write({"t": T, "u": U, "y": y}), mask="y > 1000")  # what is given stays
    assert look.reading["mask"].startswith('abs("speed (rpm)") > ')
    assert (given.reading["mask"], "outliers" in codes(given)) == ("y > 1000", True)
    inside = describe(write({"t": T, "u": U, "y": np.where(np.arange(N) == 350, -45.0, 0.1 * Y + 40 * (T > 4))}))
    assert "mask" not in inside.reading


def test_a_stuck_sensor(write: Write) -> None:
    y = Y.copy()
    y[400:520] = y[400]
    assert data(describe(write({"t": T, "u": U, "y": y})), "value-stuck")["row"] == 400
    assert "value-stuck" not in codes(describe(write({"t": T, "u": U, "y": Y})))


def test_a_sensor_that_is_stuck_at_zero_and_a_drive_at_rest(write: Write) -> None:
    rest, frozen = U.copy(), Y.copy()
    rest[300:420] = np.repeat([0.5, -0.5, 0.4], 40)  # inside the dead zone
    y = signal.lfilter([0, 0.5], [1, -0.9], np.where(np.abs(rest) < 0.6, 0.0, rest))
    y[np.abs(y) < 0.05] = 0.0
    frozen[500:620] = 0.0
    assert data(describe(write({"t": T, "u": U, "y": frozen})), "value-stuck")["row"] == 500
    assert np.ptp(y[380:420]) == 0
    assert "value-stuck" not in codes(describe(write({"t": T, "u": rest, "y": y})))


def test_an_output_is_stuck_where_a_single_step_of_the_input_should_move_it() -> None:
    rng = np.random.default_rng(2)
    u = np.repeat(rng.integers(-10, 11, 40).astype(float), 60)
    y = 0.01 * rng.standard_normal(len(u)) + signal.lfilter([0, 0.5], [1, -0.9], u)
    rows = Stretch(1200, 90, 0.0)
    u[1200:1260], u[1260:1320] = 4.0, 8.0
    held, dead = y.copy(), signal.lfilter([0, 0.5], [1, -0.9], np.sign(u) * np.maximum(np.abs(u) - 8.5, 0.0))
    held[1200:1290] = held[1200]
    assert is_stuck(u, held, rows)
    assert not is_stuck(u, held, Stretch(1200, 55, 0.0))  # the input is steady
    assert np.ptp(dead[1210:1290]) < 0.5
    assert not is_stuck(u, dead, Stretch(1210, 80, 0.0))  # at rest in a wide dead zone
    assert not is_stuck(np.full(len(u), np.nan), held, rows)


# --- the row of a command --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("output", ["speed", "encoder"])
def test_a_command_that_is_written_after_it_acts_is_moved(write: Write, output: str, measured: bool) -> None:
    """A sketch that writes its row and then sets the next command; a measured one has noise."""
    rng = np.random.default_rng(4)
    u = U + 0.01 * rng.standard_normal(N) * measured
    y = Y if output == "speed" else np.rint(100 * np.cumsum(Y))
    assert "command-before-its-row" not in codes(describe(write({"t": T, "pwm": u, output: y})))
    look = describe(write({"t": T, "pwm": np.append(u[0], u[:-1]), output: y}))
    assert data(look, "command-before-its-row") == {"output": output}
    assert look.reading["shift"] == {"pwm": -1}
    assert "--shift pwm=-1" in " ".join(proposals([look])[0])
    assert "command-before-its-row" not in codes(describe(look.path, shift={"pwm": 0}))


def test_a_controller_and_a_sampled_sine_act_in_no_row_before_theirs(write: Write) -> None:
    rng = np.random.default_rng(5)
    u, y = np.zeros(N), np.zeros(N)
    for k in range(1, N):
        y[k] = 0.9 * y[k - 1] + 0.1 * u[k - 1] + 0.05 * rng.standard_normal()
        u[k] = 3 * (U[k] - y[k])
    sine = np.sin(T) + np.sin(2.2 * T)
    answer = 0.5 * sine + 0.01 * rng.standard_normal(N)
    for columns in ({"u": u, "y": y}, {"u": sine, "y": answer}):
        assert "command-before-its-row" not in codes(describe(write({"t": T, **columns})))


def test_a_mask_leaves_out_the_stuck_samples_only(write: Write) -> None:
    stuck = np.round(Y, 3)
    stuck[400:520] = stuck[400]
    look = describe(write({"t": T, "u": U, "y (rpm)": stuck}))
    record = emsid.read(look.path, **{**look.reading, **look.mends})
    assert look.record is not None
    assert len(look.record) - len(record) == 120


def test_samples_at_a_limit_stay_in_and_their_mask_is_named(write: Write) -> None:
    """A tank that overflows stands at its limit, too; without these samples its model would not."""
    cut = np.clip(Y, -30, 50)
    look = describe(write({"t": T, "u": U, "y (rpm)": cut}), scale={"y (rpm)": -1.0})
    assert look.record is not None
    assert not look.mends
    (mask,) = (each.data["mask"] for each in look.findings if each.code == "values-cut-off")
    record = emsid.read(look.path, **{**look.reading, "mask": mask})
    assert (mask, len(look.record) - len(record)) == ('"y (rpm)" <= -30', np.sum(cut == -30))


@pytest.mark.parametrize("poles", [(0.62, 0.62 / 3), (0.66, 0.22), (0.06, 0.02)])
def test_an_integrator_with_rounded_poles_is_no_stable_baseline(poles: tuple[float, float]) -> None:
    a = np.convolve([1.0, -1.0], np.convolve([1.0, -poles[0]], [1.0, -poles[1]]))
    assert np.max(np.abs(np.roots(a))) < 1  # by rounding only
    u = np.random.default_rng(0).choice([-1.0, 1.0, 2.0], 200)
    record = emsid.Record(u, np.cumsum(u) - u, 0.01)
    assert _simulated(record, a, np.array([0.0, 1.0]), 0.0, 1) is None
