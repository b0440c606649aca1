"""How much of one column a simulated response to another one explains: pair, sign, delay and kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid.first_look import describe
from emsid.first_look.examined import response_of
from emsid.first_look.responses import SEEN, answers, same_motion
from emsid.identification.task import unstable_pole

N, DT = 1200, 0.01


def lag(u, tau=8.0, gain=1.0, delay=1):
    pole = np.exp(-1 / tau)
    return gain * lfilter([*np.zeros(delay), 1 - pole], [1, -pole], u)


def steps(seed=0, each=15):
    return np.repeat(np.random.default_rng(seed).uniform(-5, 5, N // each), each)


def noisy(y, seed=1, share=0.02):
    return y + share * np.std(y) * np.random.default_rng(seed).standard_normal(len(y))


@pytest.mark.parametrize("gain", [3.0, -3.0])
@pytest.mark.parametrize("integrates", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_pair_sign_and_kind_are_those_of_the_simulation(gain, integrates, seed):
    u = steps(seed)
    y = lag(u, gain=gain)
    y = noisy(np.cumsum(y) if integrates else y)
    found = answers(np.column_stack([u, y]))
    assert found[0, 1].evidence > 2 * SEEN
    assert (found[0, 1].sign, found[0, 1].integrates, found[0, 1].ambiguous) == (np.sign(gain), integrates, False)
    assert found[0, 1].evidence > found[1, 0].evidence


def test_evidence_does_not_depend_on_units_and_chance_has_none():
    u, y = steps(), noisy(lag(steps()))
    one, other = answers(np.column_stack([u, y])), answers(np.column_stack([1e3 * u + 7, -1e-4 * y - 2]))
    assert other[0, 1].evidence == pytest.approx(one[0, 1].evidence, rel=1e-4)
    assert other[0, 1].sign == -one[0, 1].sign
    of_chance = [answers(np.column_stack([steps(k), noisy(lag(steps(k + 50)))]))[0, 1].evidence for k in range(20)]
    assert np.mean(np.array(of_chance) > SEEN) <= 0.05


@pytest.mark.parametrize("half", [11, 20])
@pytest.mark.parametrize("gain", [0.33, -0.33])
def test_a_square_wave_has_the_sign_of_the_shortest_delay(half, gain):
    """Half a period later the opposite sign fits as well."""
    u = np.where(np.arange(N) // half % 2 == 0, 255.0, 85.0)
    u[:20] = 0
    y = noisy(lag(u, tau=5.0, gain=gain), share=0.01)
    found = response_of(emsid.Record(u, y, 0.05))
    assert found.sign == np.sign(gain)
    assert found.delay <= 2


def test_a_fast_response_to_a_square_wave_is_no_unstable_plant():
    u = np.where(np.arange(N) // 11 % 2 == 0, 255.0, 85.0)
    y = lag(u, tau=0.6, gain=0.33, delay=0) + 0.3 * np.random.default_rng(3).standard_normal(N)
    assert unstable_pole(emsid.Record(u, y, 0.05)) is None


@pytest.mark.parametrize("seed", range(4))
def test_a_position_loop_has_the_sign_of_its_motor(seed):
    """The controller moves the voltage against the position, so that a correlation has the wrong sign."""
    rng = np.random.default_rng(seed)
    reference, angle, speed = np.repeat(rng.uniform(-100, 100, 12), 50), np.zeros(601), 0.0
    u = np.zeros(600)
    for k in range(600):
        u[k] = np.clip(0.12 * (reference[k] - angle[k]) - 0.004 * speed, -8, 8)
        angle[k + 1] = angle[k]
        for _ in range(10):
            moving = np.sign(u[k]) * max(abs(u[k]) - 0.3, 0)
            speed += 0.002 / 0.06 * (340 * moving - speed)
            angle[k + 1] += 0.002 * speed
    record = emsid.Record(u, noisy(angle[:-1], seed, 1e-3), 0.02, output_units=("deg",))
    assert response_of(record).sign == 1


def test_a_speed_and_its_position_are_one_motion_and_a_command_is_none():
    u = steps()
    speed = lag(u)
    position = np.cumsum(speed)
    assert same_motion(speed, position, ())
    assert not same_motion(u, position, ())
    assert not same_motion(u, speed, ())


@pytest.mark.parametrize("delay", [5, 40, 150])
def test_a_delay_is_found_to_a_row_in_noise(delay):
    u = steps(each=10)
    found = response_of(emsid.Record(u, noisy(lag(u, delay=delay), share=0.3), DT))
    assert abs(found.delay - delay) <= 1


def test_chance_is_no_response():
    """Of unrelated columns with 30 to 120 levels."""
    seen = 0
    for seed in range(20):
        u, other = steps(seed, each=10 + 10 * (seed % 4)), steps(seed + 100, each=10 + 10 * (seed % 4))
        seen += response_of(emsid.Record(u, noisy(lag(other)), DT)).delay is not None
    assert seen <= 2


def test_displacements_over_many_rows_show_the_motion_of_a_coarse_encoder():
    rng, n = np.random.default_rng(0), 400
    times = np.cumsum(rng.choice([0.005, 0.007, 0.03], n))
    speed = 30 * (1 - np.exp(-times / 0.3))
    position = np.round(np.cumsum(speed * np.diff(times, prepend=0.0)))
    assert same_motion(speed, position, (), times)
    assert not same_motion(rng.permutation(speed), position, (), times)


# --- files -----------------------------------------------------------------------------------------------------------


def written(path: Path, columns: dict[str, np.ndarray], *, header: bool = True) -> Path:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, "%.6g", delimiter=",", header=",".join(columns) if header else "", comments="")
    return path


@pytest.mark.parametrize("seed", range(3))
def test_without_names_the_duty_is_the_input_of_its_speed_and_not_the_speed_that_of_its_position(tmp_path, seed):
    """A robot's log without header: duty, time, speed and position."""
    rng = np.random.default_rng(seed)
    duty = np.repeat(rng.choice([-80.0, -50, 30, 60, 90], 8), 150)
    t = 0.01 * np.arange(N) + 0.002 * rng.uniform(-1, 1, N)
    speed = noisy(lag(duty, gain=9.0), seed)
    position = np.cumsum(speed * np.diff(t, prepend=-0.01))
    log = written(tmp_path / "log.csv", {"a": duty, "b": t, "c": speed, "d": position}, header=False)
    roles = describe(log).roles
    assert (roles.input, roles.output) == ("c1", "c3")


def test_axes_are_paired_by_the_ends_of_their_names(tmp_path):
    references = {f"ref_{axis}": lag(steps(k, 100), 40.0) for k, axis in enumerate("xyz")}
    positions = {f"pos_{axis}": noisy(lag(references[f"ref_{axis}"], 12.0), k, 0.005) for k, axis in enumerate("xyz")}
    log = written(tmp_path / "axes.csv", {"t": DT * np.arange(N), **references, **positions})
    roles = describe(log).roles
    assert (roles.input[:4], roles.output[:4]) == ("ref_", "pos_")
    assert roles.input[4:] == roles.output[4:]


def test_a_pulse_width_is_the_command_and_a_sagging_voltage_is_no_input(tmp_path):
    pulse = np.minimum(1000 + 10 * np.floor(np.arange(N) / 12), 2000)
    current = noisy(lag((pulse - 1000) / 50, 20.0))
    columns = {"Time (s)": 0.05 * np.arange(N), "ESC signal (µs)": pulse, "Thrust (gf)": noisy(40 * current)}
    columns |= {"Voltage (V)": 16 - 0.16 * current, "Current (A)": current}
    look = describe(written(tmp_path / "stand.csv", columns))
    assert look.roles.input == "ESC signal (µs)"
    assert "scale" not in look.reading
