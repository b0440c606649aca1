"""The virtual bench: each effect by itself, and none of them."""

from math import pi

import numpy as np
import pytest

from emsid.errors import DataError, ModelError
from emsid.plant import Bench, Encoder, Motor, Tachometer, VoltageSource, simulate

DT = 2e-3
RNG = np.random.default_rng


def drive(n: int = 1000) -> np.ndarray:
    t = DT * np.arange(n)
    return 6 * np.sin(2 * np.pi * 0.7 * t) + 3 * np.sin(2 * np.pi * 2.3 * t)


def run(bench: Bench, voltage: np.ndarray | None = None, seed: int = 0):
    record = bench.run(Motor(), drive() if voltage is None else voltage, DT, RNG(seed))
    return record.input[:, 0], record.output[:, 0]


def test_the_ideal_bench_is_the_simulation():
    record = Bench().run(Motor(), drive(), DT, RNG(0))
    np.testing.assert_array_equal(record.input[:, 0], drive())
    np.testing.assert_array_equal(record.output[:, 0], simulate(Motor(), drive(), DT).load_speed)
    assert (record.input_names, record.input_units) == (("voltage",), ("V",))
    assert (record.output_names, record.output_units) == (("speed",), ("rad/s",))
    assert record.dt == DT


def test_the_same_seed_is_the_same_record():
    first, again, other = (run(Bench.typical(), seed=seed)[1] for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


def test_the_source_keeps_its_limits_and_the_record_says_so():
    source = VoltageSource(limit=5.0, slew_rate=100.0)
    voltage, speed = run(Bench(source))
    assert np.abs(voltage).max() == 5.0
    assert np.abs(np.diff(voltage, prepend=0.0)).max() <= 100.0 * DT * (1 + 1e-12)
    np.testing.assert_array_equal(speed, simulate(Motor(), voltage, DT).load_speed)


def test_a_slew_limited_step_is_a_ramp():
    voltage, _ = run(Bench(VoltageSource(slew_rate=500.0)), np.full(6, 3.5))
    np.testing.assert_allclose(voltage, [1.0, 2.0, 3.0, 3.5, 3.5, 3.5])


def test_a_slow_source_holds_between_its_updates():
    voltage, speed = run(Bench(VoltageSource(period=3 * DT)))
    held = np.repeat(drive()[::3], 3)[: len(voltage)]
    np.testing.assert_array_equal(voltage, held)
    np.testing.assert_array_equal(speed, simulate(Motor(), held, DT).load_speed)


def test_a_source_that_is_not_synchronous_with_the_samples():
    voltage, speed = run(Bench(VoltageSource(period=1.5 * DT)), drive(300))
    updates = drive(300)[np.floor(1.5 * np.arange(200)).astype(int)]
    fine = simulate(Motor(), np.repeat(updates, 3), DT / 2)
    np.testing.assert_allclose(speed, fine.load_speed[::2], atol=1e-8)
    np.testing.assert_array_equal(voltage, np.repeat(updates, 3)[::2])


def test_a_delay_of_whole_samples_shifts_the_speed():
    _, prompt = run(Bench())
    voltage, late = run(Bench(delay=3 * DT))
    np.testing.assert_array_equal(voltage, drive())
    np.testing.assert_array_equal(late[:3], 0.0)
    np.testing.assert_allclose(late[3:], prompt[:-3], atol=1e-9)


def test_a_delay_need_not_be_a_whole_number_of_samples():
    _, late = run(Bench(delay=1.25 * DT))
    armature = np.concatenate([np.zeros(5), np.repeat(drive(), 4)])[: 4 * len(late)]
    np.testing.assert_allclose(late, simulate(Motor(), armature, DT / 4).load_speed[::4], atol=1e-8)


def test_resolution_rounds_to_its_steps():
    bench = Bench(VoltageSource(resolution=0.25), Tachometer(resolution=0.5))
    voltage, speed = run(bench)
    np.testing.assert_array_equal(voltage, np.rint(drive() / 0.25) * 0.25)
    exact = simulate(Motor(), voltage, DT).load_speed
    assert np.abs(speed - exact).max() <= 0.25
    np.testing.assert_array_equal(np.rint(speed / 0.5) * 0.5, speed)


def test_noise_has_the_stated_deviation_and_offset():
    _, clean = run(Bench())
    _, speed = run(Bench(sensor=Tachometer(noise=0.3, offset=1.5)))
    error = speed - clean
    assert error.mean() == pytest.approx(1.5, abs=4 * 0.3 / np.sqrt(len(error)))
    assert error.std() == pytest.approx(0.3, rel=4 / np.sqrt(2 * len(error)))


def test_gain_noise_grows_with_speed_and_is_zero_at_standstill():
    _, clean = run(Bench())
    _, speed = run(Bench(sensor=Tachometer(gain_noise=0.01)))
    np.testing.assert_array_equal(speed[clean == 0], 0.0)
    moving = np.abs(clean) > 1
    gain = speed[moving] / clean[moving]
    assert gain.std() == pytest.approx(0.01, rel=4 / np.sqrt(2 * len(gain)))


def test_ripple_repeats_with_the_angle():
    motion = simulate(Motor(), drive(), DT)
    _, speed = run(Bench(sensor=Tachometer(ripple=0.02, ripples_per_turn=7, ripple_phase=0.4)))
    np.testing.assert_allclose(speed, motion.load_speed * (1 + 0.02 * np.cos(7 * motion.load_angle + 0.4)))


def test_encoder_adds_up_to_the_angle():
    motion = simulate(Motor(), drive(), DT)
    _, speed = run(Bench(sensor=Encoder(500)))
    count = 2 * pi / 500
    assert np.abs(np.cumsum(speed) * DT - motion.load_angle).max() <= count
    np.testing.assert_allclose(speed * DT / count, np.rint(speed * DT / count), atol=1e-9)


def test_any_reader_is_a_sensor():
    class Bearing:
        def read(self, speed, angle, dt, rng):
            return 10.0 * np.sin(angle)

    _, reading = run(Bench(sensor=Bearing()))
    np.testing.assert_array_equal(reading, 10 * np.sin(simulate(Motor(), drive(), DT).load_angle))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: VoltageSource(limit=0.0), "limit is 0.0; it must be positive"),
        (lambda: VoltageSource(slew_rate=-1.0), "slew_rate is -1.0"),
        (lambda: VoltageSource(period=np.nan), "period is nan"),
        (lambda: VoltageSource(resolution=-0.1), "resolution is -0.1"),
        (lambda: Tachometer(noise=-1.0), "tachometer noise is -1.0"),
        (lambda: Encoder(0), "0 counts per turn"),
        (lambda: Bench(delay=-1e-3), "bench delay is -0.001"),
    ],
)
def test_an_invalid_bench_is_refused(make, message):
    with pytest.raises(ModelError, match=message):
        make()


@pytest.mark.parametrize(
    ("voltage", "dt", "message"),
    [
        (np.zeros((4, 2)), 1e-3, r"voltage has shape \(4, 2\)"),
        ([1.0, np.nan], 1e-3, "voltage is nan at sample 1"),
        ([1.0, 1.0], 0.0, "dt is 0 s"),
        ([], 1e-3, "voltage has no sample"),
    ],
)
def test_bad_commands_are_refused(voltage, dt, message):
    with pytest.raises(DataError, match=message):
        Bench().run(Motor(), voltage, dt, RNG(0))
