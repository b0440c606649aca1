"""Findings about the quality of data: for each, a record that has it and one that does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt

import emsid
from emsid.findings import Finding
from emsid.first_look.baseline import baseline
from emsid.first_look.data_advice import advice, questions
from emsid.first_look.dynamics import feedback
from emsid.first_look.examined import Response, response_of
from emsid.first_look.levels import CHANCE, PART
from emsid.first_look.masks import mends
from emsid.first_look.measurement import repeated
from emsid.first_look.nonlinearity import dependence, nonlinearity
from emsid.first_look.standstill import at_rest, breakaway, dead_zone
from emsid.identification.candidates import CANDIDATES
from emsid.identification.task import with_delay
from emsid.options import Options
from emsid.record import Record
from emsid.record.time_axis import about_time, time_axis
from emsid.wording import sentence
from independent.cases import motor as friction_motor
from independent.nonlinear_systems import tanks

N = 2000
Array = np.ndarray


def steps(seed: int = 0, hold: int = 10, samples: int = N) -> Array:
    """Random levels, each held for some samples."""
    return np.repeat(np.random.default_rng(seed).uniform(-10, 10, samples // hold), hold)


def motor(u: Array, pole: float = 0.9, delay: int = 1, noise: float = 0.02) -> Array:
    """A first-order lag of gain 5."""
    y = lfilter([0] * delay + [5 * (1 - pole)], [1, -pole], u)
    return y + noise * np.random.default_rng(5).standard_normal(len(u))


def response(u: Array, y: Array, breaks: tuple[int, ...] = ()) -> Response:
    found = response_of(Record(u, y, 0.01, breaks=breaks))
    assert found is not None
    return found


def findings(u: Array, y: Array, dt: float = 0.01, **more: object) -> dict[str, Finding]:
    record = replace(Record(u, y, dt, "u", "y"), **more)
    return {finding.code: finding for finding in advice(record)}


@cache
def ordinary() -> dict[str, Finding]:
    """The findings about a good record."""
    u = steps()
    return findings(u, motor(u))


def test_a_good_record_has_no_warning() -> None:
    assert set(ordinary()) == {"excitation-sufficient", "response-delay", "motion", "nearly-linear"}
    assert ordinary()["response-delay"].data["delay"] == 1
    assert ordinary()["motion"].data["reversals"] > 50


def sines(count: int) -> Array:
    return sum(np.sin(0.02 * 3**k * np.arange(N) + k) for k in range(count))  # type: ignore[return-value]


def smooth() -> Array:
    return 5 * lfilter([0.05], [1, -1.6, 0.65], np.random.default_rng(2).standard_normal(N))


def dead(u: Array, width: float) -> Array:
    return motor(np.sign(u) * np.maximum(np.abs(u) - width, 0), noise=0)


def spikes(y: Array) -> Array:
    y = y.copy()
    y[[300, 900, 1500]] += 400
    return y


def in_closed_loop() -> tuple[Array, Array]:
    rng = np.random.default_rng(3)
    reference, u, y = steps(4, 40), np.zeros(N), np.zeros(N)
    for k in range(1, N):
        y[k] = 0.95 * y[k - 1] + 0.25 * u[k - 1] + 0.3 * rng.standard_normal()
        u[k] = 1.5 * (reference[k] - y[k - 1]) + 0.1 * rng.standard_normal()
    return u, y


def clipped() -> tuple[Array, Array]:
    u = smooth()
    return u, np.clip(motor(u), -6, 6)


def held_output() -> Array:
    y = motor(steps(1, 60), 0.98)
    return np.repeat(y[::5], 5)


U, SLOW = steps(), steps(hold=100)
Case = tuple[Array, Array]
CASES: dict[str, Callable[[], Case]] = {
    "channel-constant": lambda: (np.ones(N), motor(U)),  # what moves the output is not in the record
    "output-constant": lambda: (U, np.zeros(N)),
    "record-too-short": lambda: (U[:40], motor(U[:40])),
    "excitation-too-low": lambda: ((np.arange(N) > 100) * 1.0, motor((np.arange(N) > 100) * 1.0)),
    "excitation-linear-only": lambda: (sines(3), motor(sines(3))),
    "few-input-levels": lambda: (np.sign(U), motor(np.sign(U))),
    "input-may-be-continuous": lambda: (smooth(), motor(smooth())),
    "output-without-sign": lambda: (U, np.abs(motor(U))),
    "no-response": lambda: (U, motor(steps(7))),
    "output-noise-only": lambda: (U, motor(0 * U)),
    "response-negative": lambda: (U, -motor(U)),
    "feedback-likely": in_closed_loop,
    "all-standstill": lambda: (U, 1e-3 * motor(U) / 50 + (np.arange(N) == 0)),
    "much-standstill": lambda: (SLOW, dead(SLOW, 7)),
    "dead-zone-likely": lambda: (2 * SLOW, dead(2 * SLOW, 4)),
    "amplitude-near-dead-zone": lambda: (SLOW, dead(SLOW, 7)),
    "coarse-values": lambda: (U, 10 * np.rint(motor(U) / 10)),
    "values-cut-off": lambda: (smooth(), np.clip(motor(smooth()), -6, None)),
    "output-clipped": clipped,
    "few-output-levels": lambda: (U, 20 * np.rint(np.clip(motor(U) / 20, -1, 1))),
    "output-is-input": lambda: (U, -2.5 * U),
    "input-logged-slower": lambda: (np.repeat(steps(hold=1)[::2], 2), motor(steps(hold=1))),
    "command-may-be-duty": lambda: (np.clip(np.round(20 * U), -100, 100), motor(U)),
    "command-limited": lambda: (np.clip(2 * smooth(), -4, 4), motor(np.clip(2 * smooth(), -4, 4))),
    "outliers": lambda: (U, spikes(motor(U))),
    "samples-repeated": lambda: (steps(1, 60)[:N], held_output()[:N]),
    "aliasing-possible": lambda: (U, motor(U, noise=15)),
    "output-integrates": lambda: (smooth(), np.cumsum(motor(smooth()))),
    "sampling-too-slow": lambda: (steps(hold=2), motor(steps(hold=2), 0.1)),
    "sampling-too-fast": lambda: (steps(hold=400, samples=40_000), motor(steps(hold=400, samples=40_000), 0.998)),
    "output-drifts": lambda: (U, motor(U) + 30 * np.linspace(0, 1, N)),
    "nonlinear-likely": lambda: (U, dead(U, 4)),
    "unexplained-output": lambda: (U, motor(U) + motor(2 * steps(8))),
}


@pytest.mark.parametrize("code", CASES)
def test_each_finding_has_a_record_with_it(code: str) -> None:
    found = findings(*CASES[code]())
    assert code in found
    assert code not in ordinary()
    assert 0 < found[code].data.get("confidence", 1) <= 1


def test_a_measured_voltage_that_was_held_shows_no_feedback() -> None:
    """The steps of a voltage with noise are new to a prediction from its past for many samples, not for one."""
    rng, u = np.random.default_rng(6), steps(hold=40, samples=6000)
    measured = u + 0.02 * rng.standard_normal(len(u))
    found = findings(measured, np.tanh(lfilter([0.1], [1, -0.9], u) / 3) + 0.003 * rng.standard_normal(len(u)))
    assert not {"feedback-likely", "input-may-be-continuous"} & set(found)


def test_an_input_that_repeats_shows_no_feedback() -> None:
    """Distortion repeats with its input, so that what is new in this seems to follow the errors of a linear model."""
    rng, k = np.random.default_rng(5), np.arange(512)
    tones = zip(range(1, 120, 2), rng.uniform(0, 6.28, 60), strict=True)
    period = sum(np.cos(2 * np.pi * line * k / 512 + phase) for line, phase in tones)
    u = np.tile(np.round(10 * period / np.max(np.abs(period)), 1), 8)
    y = motor(np.sign(u) * np.maximum(np.abs(u) - 2, 0), 0.8, noise=0) + 0.3 * rng.standard_normal(len(u))
    assert feedback(u, y, 1) > PART
    assert "feedback-likely" not in findings(u, y)


def test_a_controller_between_the_steps_of_its_reference_is_seen() -> None:
    rng = np.random.default_rng(3)
    reference, u, y = steps(4, 400, 6000), np.zeros(6000), np.zeros(6000)
    for k in range(1, len(u)):
        y[k] = 0.95 * y[k - 1] + 0.25 * u[k - 1] + 0.3 * rng.standard_normal()
        u[k] = 1.5 * (reference[k] - y[k - 1]) + 0.02 * rng.standard_normal()
    assert "feedback-likely" in findings(u, y)


def oscillator(u: Array, speed: bool = False, sign: int = 1) -> Record:
    """A position that answers at 8 Hz with hardly any damping, or its speed, every millisecond."""
    own = np.exp(2j * np.pi * 8e-3 * (1j * 0.02 + 1))
    y = lfilter([0, 1 - 2 * own.real + abs(own) ** 2], np.poly([own, own.conjugate()]).real, u)
    y = np.gradient(y) if speed else y
    noise = 0.01 * y.std() * np.random.default_rng(7).standard_normal(len(u))
    return Record(u, sign * (y + noise), 1e-3, "u", "speed" if speed else "position")


def tones(low: float, high: float, count: int) -> Array:
    """(6000,) sines between two frequencies in Hz."""
    t, rng = np.arange(6000) * 1e-3, np.random.default_rng(8)
    return sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in np.linspace(low, high, count))  # type: ignore[return-value]


@pytest.mark.parametrize("speed", [False, True])
class TestSignOfOscillations:
    """A correlation with an oscillation has both signs; a step response begins with one."""

    @pytest.mark.parametrize("sign", [1, -1])
    def test_it_is_that_of_a_step_response(self, speed: bool, sign: int) -> None:
        for u in (tones(1, 60, 25), steps(hold=40, samples=6000)):
            found = response_of(oscillator(u, speed, sign))
            assert found is not None
            assert (found.delay is not None, found.sign) == (True, sign)

    @pytest.mark.parametrize("u", [tones(12, 60, 25), tones(20, 30, 5), tones(20, 20, 1)])
    def test_above_a_resonance_it_is_open(self, speed: bool, u: Array) -> None:
        record = oscillator(u, speed)
        found = response_of(record)
        assert found is not None
        assert found.sign == 0
        (said,) = (each for each in advice(record, found) if each.code == "response-delay")
        assert "sign" not in sentence(said)


def test_a_delay_of_a_slow_input_is_not_certain() -> None:
    slow = np.sin(0.005 * np.arange(N)) + np.sin(0.02 * np.arange(N))
    u = slow + 0.02 * smooth()
    sure = {
        name: findings(x, motor(x, delay=4))["response-delay"].data["confidence"]
        for name, x in (("slow", u), ("steps", U))
    }
    assert sure["slow"] <= 0.6 < 0.9 < sure["steps"]


@pytest.mark.parametrize("seed", range(3))
def test_feedback_within_the_sample_is_seen_between_many_steps(seed: int) -> None:
    """A controller of proportional and integral action that uses the sample which it answers."""
    rng = np.random.default_rng(seed)
    reference = np.repeat(rng.uniform(-100, 100, 75), 20)
    for closed in (True, False):
        u, y = np.zeros(1500), np.zeros(1500)
        state = integral = 0.0
        for k in range(1500):
            y[k] = state + 0.5 * rng.standard_normal()
            integral += 0.005 * (reference[k] - y[k])
            u[k] = 0.5 * (reference[k] - y[k]) + integral if closed else 0.1 * reference[k]
            state = 0.95 * state + 0.3 * u[k]
        assert ("feedback-likely" in findings(u, y)) is closed


def test_a_filter_hides_feedback() -> None:
    u, y = in_closed_loop()
    assert "feedback-likely" in findings(u, y)
    assert "feedback-likely" not in findings(u, y, findings=(Finding("data-filtered", "log.csv"),))
    assert "feedback-likely" not in findings(u, y, output_names=("d(q)",))


def test_a_fast_part_is_compared_with_the_whole_output() -> None:
    """A staircase whose steps are much longer than the pieces of the spectrum has little power in any of them."""
    levels = np.repeat(np.arange(10.0), 2000)
    y = np.rint(motor(levels) + 0.5 * np.random.default_rng(1).standard_normal(len(levels)))
    assert "aliasing-possible" not in findings(levels, y)


def test_a_magnitude_needs_no_linear_response() -> None:
    u = np.sign(steps(3, 7, 1400))
    found = findings(u, np.abs(motor(u, 0.8)))
    assert "output-without-sign" in found
    assert "no-response" not in found


@pytest.mark.parametrize("sign", [1, -1])
def test_the_sign_of_an_unnamed_position_is_that_of_its_change(sign: int) -> None:
    """Its own correlation with a square wave is zero, and has any sign after a part of a period."""
    for u in (np.where(np.arange(N) % 200 < 100, 1.0, -1.0), smooth()):
        found = response(u, sign * np.cumsum(motor(u, noise=0)), ())
        assert found.sign == sign


def test_a_position_neither_rests_nor_lacks_an_explanation() -> None:
    u = smooth()
    wandering = np.cumsum(motor(u, noise=3)) * 0.01
    assert "motion" not in findings(u, wandering, output_names=("position",))
    assert "unexplained-output" not in findings(u, wandering, output_names=("position",))


def test_a_position_on_one_side_of_its_zero_is_no_magnitude() -> None:
    u, y = CASES["output-without-sign"]()
    assert "output-without-sign" not in findings(u, y, output_names=("position",))


@pytest.mark.parametrize("factor", [1e-300, 1e300])
def test_values_that_cannot_be_computed_with(factor: float) -> None:
    record = Record(factor * U, factor * motor(U), 0.01)
    assert response_of(record) is None
    assert {each.code for each in advice(record, Response(None, 0, 0.0))} == {"channel-out-of-scale"}
    assert asked([record]) == []


def test_outliers_hide_nothing_else() -> None:
    """Three samples of 2000 would turn the sign of the response, and look like aliasing."""
    for size in (400, 4000, -4000):
        y = motor(U)
        y[[300, 900, 1500]] += size
        record = Record(U, y, 0.01, "u", "y")
        answer = response_of(record)
        assert answer is not None
        assert (answer.delay, answer.sign) == (1, 1)
        found = {finding.code: finding for finding in advice(record, answer)}
        assert set(found) - set(ordinary()) == {"outliers"}
        assert found["nearly-linear"].data["fit_percent"] > 99


def test_both_limits_of_a_sensor_are_seen_behind_a_held_input() -> None:
    """A staircase rarely changes while the sensor is at a limit, so that the output could have settled there."""
    found = advice(record := Record(SLOW, np.clip(motor(SLOW, noise=0.3), -30, 20), 0.01), response_of(record))
    limits = [(each.data["lower"], each.data["upper"]) for each in found if each.code == "output-clipped"]
    assert limits == [(-30, 20)]
    square = np.sign(SLOW) * (np.abs(SLOW) > 5)
    assert not {"values-cut-off", "output-clipped"} & set(
        findings(square, motor(square, 0.5, noise=0))
    )  # it settles, to the last digit
    assert not {"values-cut-off", "output-clipped"} & set(findings(SLOW, np.rint(motor(SLOW))))


def test_times_that_were_resampled_are_not_taken_as_equal() -> None:
    t = np.cumsum(0.01 + 2e-3 * np.random.default_rng(0).uniform(-1, 1, N))
    assert not time_axis(t).regular
    assert about_time(time_axis(t), "log") == []
    assert [each.code for each in about_time(time_axis(t), "log", resample=True)] == ["data-resampled"]


def test_jitter() -> None:
    t = 0.01 * np.arange(N) + 2e-4 * np.random.default_rng(0).uniform(-1, 1, N)
    (found,) = about_time(time_axis(t), "log")
    assert (found.code, found.data["dt"]) == ("clock-jitters", 0.01)
    assert found.data["jitter"] == pytest.approx(0.02, abs=0.001)  # of the stamps; twice as much of the steps
    assert about_time(time_axis(0.01 * np.arange(N)), "log") == []


@pytest.mark.parametrize("late", [0, 1, 2])
def test_a_step_and_an_unnamed_position_do_not_drift(late: int) -> None:
    """A step is a part of a trend; a system that integrates goes on."""
    step = (np.arange(1900) > 300 + 100 * late) * 4.0
    noise = 0.05 * np.random.default_rng(late).standard_normal(1900)
    held = np.repeat(lfilter([0.05], [1, -1.6, 0.65], step)[::5], 5)  # a sensor that is slower than the log
    assert "output-drifts" not in findings(step, np.roll(held, 8) + noise)
    speed = np.where(np.arange(400) % 200 < 100, 1.0, -0.9 - 0.1 * late)
    position = np.cumsum(lfilter([0.1], [1, -0.9], speed)) + noise[:400]
    assert "output-drifts" not in findings(speed, position)


@pytest.mark.parametrize("change", [20, 60, 150])
def test_an_output_that_drifts_does_not_integrate(change: int) -> None:
    """A slow pole follows the drift; without the trends the model settles."""
    assert "output-integrates" not in findings(SLOW, motor(SLOW) + change * np.linspace(0, 1, N))


def test_coherence_is_that_of_the_power_of_the_output() -> None:
    """A smooth input has power at few frequencies; noise at the others does not lower the coherence."""
    u = 10 * np.sin(0.02 * np.arange(N) * (1 + 1e-4 * np.arange(N)))
    assert findings(u, motor(u, noise=0.5))["nearly-linear"].data["coherence"] > 0.95
    assert findings(u, motor(u, noise=10))["nearly-linear"].data["coherence"] < 0.95


def test_why_a_relation_is_nearly_linear() -> None:
    """Friction that leaves less than one part in 10,000 of the variance is named as small, not as absent."""
    bent = U + 0.004 * np.abs(U)
    assert ordinary()["nearly-linear"].data["because"] == "little"
    assert findings(U, motor(bent, noise=0.001))["nearly-linear"].data["because"] == "small-error"


def test_sizes() -> None:
    """What the findings measure is right."""
    assert findings(*CASES["dead-zone-likely"]())["dead-zone-likely"].data["dead_zone"] == pytest.approx(4, rel=0.3)
    assert findings(*CASES["samples-repeated"]())["samples-repeated"].data["factor"] == 5
    assert findings(*CASES["output-drifts"]())["output-drifts"].data["change"] == pytest.approx(30, rel=0.15)
    assert findings(*CASES["outliers"]())["outliers"].data["count"] == 3
    slow = findings(*CASES["sampling-too-fast"]())["sampling-too-fast"].data
    assert slow["samples"] == pytest.approx(500, rel=0.1)
    assert slow["factor"] == pytest.approx(10, abs=1)
    assert findings(*CASES["much-standstill"]())["much-standstill"].data["share"] == pytest.approx(0.6, abs=0.2)


@pytest.mark.parametrize("delay", [1, 25, 300])
def test_a_delay_of_any_length_is_found(delay: int) -> None:
    found = response(U, motor(U, delay=delay), ())
    assert (found.delay, found.sign) == (delay, 1)


def test_the_delay_of_a_single_step() -> None:
    u = (np.arange(600) >= 200) * 3.0
    found = response(u, -motor(u, delay=8, noise=0.01), ())
    assert (found.delay, found.sign) == (8, -1)
    assert found.correlation < -0.9


def test_the_delay_of_a_coarse_fast_log() -> None:
    u = steps(hold=100, samples=20_000)
    y = np.rint(motor(u, 0.99, delay=30) / 5)
    found = response(u, y, (7000, 14_000))
    assert found.delay == pytest.approx(30, abs=8)
    assert found.sign == 1


def test_a_position_answers_by_its_change() -> None:
    assert response(U, np.cumsum(motor(U))).delay == 1


def test_a_position_that_wanders_is_no_question() -> None:
    """The start and every disturbance stay in it, so it looks unrelated to the input and drifts."""
    speed = motor(U, noise=0.5) + 0.3
    position = Record(U, np.cumsum(speed) * 0.01, 0.01, output_names=("position",), output_units=("m",))
    assert {"no-response", "output-drifts"} & {each.code for each in asked([position])} == set()
    unrelated = np.cumsum(np.random.default_rng(1).standard_normal(N))
    assert "no-response" in {each.code for each in asked([Record(U, unrelated, 0.01)])}


class TestDistortion:
    """A periodic multisine separates noise, even and odd distortion."""

    PERIOD = 400

    def finding(self, curve: Callable[[Array], Array], noise: float = 0.0) -> Finding:
        lines = 2 * np.arange(20) + 1
        phases = np.random.default_rng(1).uniform(0, 2 * np.pi, 20)
        one = np.cos(2 * np.pi * np.outer(np.arange(self.PERIOD), lines) / self.PERIOD + phases).sum(axis=1) / 4
        u = np.tile(one, 6)
        y = curve(u)
        y = y + noise * y.std() * np.random.default_rng(2).standard_normal(len(u))
        return findings(u, y)["distortion-levels"]

    def test_a_linear_relation_has_none(self) -> None:
        data = self.finding(lambda u: lfilter([0, 0.5], [1, -0.5], u)).data
        assert data["periods"] == 5
        assert max(data["noise"], data["even"], data["odd"]) < 1e-6
        assert data["period"] == pytest.approx(4.0)

    def test_even_and_odd(self) -> None:
        square = self.finding(lambda u: u + 0.1 * u**2).data
        assert square["even"] > 20 * square["odd"]
        cube = self.finding(lambda u: u + 0.05 * u**3).data
        assert cube["odd"] > 20 * cube["even"]
        assert cube["odd"] > 0.01

    def test_noise_is_no_distortion(self) -> None:
        data = self.finding(lambda u: 2 * u, noise=0.05).data
        assert data["noise"] == pytest.approx(0.05, rel=0.6)
        assert max(data["even"], data["odd"]) < 0.02

    @pytest.mark.parametrize(("noise", "said"), [(0.0, "nonlinear"), (0.05, "nonlinear"), (0.5, "noise hides")])
    def test_noise_hides_distortion_and_makes_nothing_linear(self, noise: float, said: str) -> None:
        assert said in sentence(self.finding(lambda u: u + 0.05 * u**3, noise))

    def test_a_linear_model_is_enough_where_distortion_would_be_seen(self) -> None:
        assert "linear model is enough" in sentence(self.finding(lambda u: 2 * u, noise=0.05))

    def test_only_where_the_input_is_periodic(self) -> None:
        assert "distortion-levels" not in ordinary()


def test_linear_systems_are_seldom_called_nonlinear() -> None:
    """At most 5 % of linear systems with noise; dead zones of a quarter of the amplitude always."""

    def seen(u: Array, y: Array) -> bool:
        record = Record(u, y, 0.01)
        (found,) = nonlinearity(record, Response(1, 1, 0.9), baseline(record, 1))
        return found.code == "nonlinear-likely"

    wrong = right = 0
    for seed in range(40):
        u = steps(seed, 1 + seed % 12, 1200)
        pole, noise = 0.5 + 0.45 * (seed % 7) / 7, 0.2 * (seed % 5)
        wrong += seen(u, motor(u, pole, noise=noise))
        right += seen(u, motor(np.sign(u) * np.maximum(np.abs(u) - 2.5, 0), pole, noise=noise))
    assert wrong <= 2
    assert right >= 38


def test_friction_in_a_slow_drive_is_seen() -> None:
    """Some twenty levels, each held for three time constants: few independent stretches for many functions."""
    record = friction_motor(25).fitted
    seen = response_of(record)
    assert seen is not None
    (found,) = nonlinearity(record, seen, baseline(record, seen.delay))
    assert found.code == "nonlinear-likely"
    assert found.data["of_residual"] > 0.2


@pytest.mark.parametrize("seed", [117, 515])
def test_a_nonlinearity_is_seen_in_few_levels(seed: int) -> None:
    """One tenth of the record says little about the next one, but the residual is ten times the noise."""
    record = friction_motor(seed).fitted
    seen = response_of(record)
    assert seen is not None
    (found,) = nonlinearity(record, seen, baseline(record, seen.delay))
    assert found.code == "nonlinear-likely"


@pytest.mark.parametrize("breaks", [(), (400, 900)])
@pytest.mark.parametrize(("pole", "held", "motor_pole"), [(0.98, 60, 0.97), (1.0, 10, 0.9)])
def test_slow_noise_is_not_called_nonlinear(pole: float, held: int, motor_pole: float, breaks: tuple[int, ...]) -> None:
    """As many functions explain much of a noise that lasts long, in sample, in any record of few levels."""
    wrong = right = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = steps(seed, held, 1500)
        noise = lfilter([1], [1, -pole], rng.standard_normal(len(u)))
        for bend in (0.0, 0.1):
            y = motor(u, motor_pole, noise=0.0)
            y = y + bend * (y**2 / y.std() - y.std())
            y = y + y.std() * (0.1 / noise.std() * noise + 0.01 * rng.standard_normal(len(u)))
            linear = baseline(Record(u, y, 0.01), 1)
            assert linear is not None
            found = dependence(linear, u, breaks).probability < CHANCE
            wrong, right = wrong + (found and not bend), right + (found and bend > 0)
    assert wrong <= 1
    assert right >= 18


def test_the_dead_zone_is_between_rest_and_motion() -> None:
    u = np.linspace(-10, 10, 4000)
    assert dead_zone(u, np.abs(u) < 3) == pytest.approx(3, rel=0.1)
    assert dead_zone(u, np.zeros(4000, bool)) is None
    assert dead_zone(u, np.random.default_rng(0).random(4000) < 0.4) is None


def test_repeated_values_of_a_slow_change_are_no_repeated_samples() -> None:
    assert repeated(np.repeat(np.random.default_rng(0).standard_normal(200), 4)) == 4
    assert repeated(np.rint(3 * np.sin(np.arange(2000) / 50) * 10) / 10) == 1


def test_nothing_is_said_about_an_output_that_is_not_there() -> None:
    record = Record(U, dt=0.01)
    assert advice(record, Response(None, 0, 0.0)) == []


def asked(records: list[Record]) -> list[Finding]:
    return questions(records, list(map(response_of, records)))


class TestQuestions:
    """What calls a model into question is said by an identification too."""

    def test_nothing_about_a_good_record(self) -> None:
        assert asked([Record(U, motor(U), 0.01)]) == []

    def test_reversed_leads(self) -> None:
        record = Record(U, -motor(U), 0.01, "u", "y", name="log")
        assert [finding.code for finding in asked([record])] == ["response-negative"]
        result = emsid.identify(record, models="arx", options=emsid.Options(na=1, nb=1, nk=1))
        assert "response-negative" in {finding.code for finding in result.findings}

    def test_a_position_that_is_called_a_speed(self) -> None:
        u, position = CASES["output-integrates"]()
        codes = {
            unit: [finding.code for finding in asked([Record(u, position, 0.01, output_units=unit)])]
            for unit in ("rad/s", "rad")
        }
        assert "output-integrates" in codes["rad/s"]
        assert "output-integrates" not in codes["rad"]

    def test_one_record_of_opposite_sign(self) -> None:
        records = [Record(U, sign * motor(U), 0.01, name=f"{k}") for k, sign in enumerate((1, 1, -1))]
        assert [(found.code, found.subject) for found in asked(records)] == [("records-of-opposite-sign", "2")]

    def test_a_command_that_is_written_after_it_acted(self) -> None:
        late = np.roll(U, 1)
        codes = {sign: [found.code for found in asked([Record(late, sign * motor(U), 0.01)])] for sign in (1, -1)}
        assert all("command-before-its-row" in each for each in codes.values())
        assert not asked([Record(U, motor(U), 0.01)])

    def test_a_saturated_sensor(self) -> None:
        (found,) = asked([Record(*clipped(), 0.01, output_names="y")])
        assert (found.code, found.subject) == ("output-clipped", "y")

    def test_each_kind_is_given_once(self) -> None:
        records = [Record(U, spikes(motor(U)), 0.01, name=f"{k}") for k in range(3)]
        assert [finding.code for finding in asked(records)] == ["outliers"]

    def test_records_that_say_nothing(self) -> None:
        assert asked([Record(U, dt=0.01), Record(U[:10], U[:10], 0.01), Record(U, np.zeros(N), 0.01)]) == []
        assert asked([Record(np.ones(N), motor(U), 0.01)]) == []


class TestLongDelays:
    """A long delay that the first look finds is given to all models."""

    def test_it_is_taken_from_the_data(self) -> None:
        u = steps()
        record = Record(u, motor(u, delay=36), 0.01, "u", "y")
        result = emsid.identify(record, models="arx", options=emsid.Options(na=1, nb=1))
        (found,) = (each for each in result.findings if each.code == "delay-from-data")
        assert found.data["delay"] == 36
        assert result.chosen.model.structure.labels[1] == "u(t-36)"

    def test_a_feedback_model_may_go_without_it(self) -> None:
        u = steps()
        record = Record(u, motor(u, delay=36), 0.01, "u", "y")
        shown, _ = with_delay(Options(), [record])
        assert (shown.nk, shown.delay_from_data) == (36, True)
        searches = [CANDIDATES["feedback"]._structure(each).search for each in (shown, Options(nk=36))]
        assert [(each.delay, each.linear_delay, each.longest) for each in searches] == [(None, 36, 36), (36, 0, 36)]

    @pytest.mark.parametrize("seed", range(4))
    def test_a_dead_zone_does_not_hide_it(self, seed: int) -> None:
        """What a linear model leaves of it is large, and has few independent errors."""
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.uniform(-8, 8, 60), rng.integers(10, 60, 60))[:1200]
        record = Record(u, motor(np.sign(u) * np.maximum(np.abs(u) - 2, 0), 0.93, 36, 0.15), 0.01)
        shown, _ = with_delay(Options(), [record])
        assert shown.nk == 36

    def test_a_slow_response_that_starts_at_once_is_no_delay(self) -> None:
        """The output of two tanks follows the second of them, whose level rises late."""
        record = tanks(seed=2).fitted
        assert with_delay(Options(), [record]) == (Options(), ())

    @pytest.mark.parametrize("seed", range(3))
    def test_one_that_a_slow_plant_hides_is_found(self, seed: int) -> None:
        """The response of second order is seen late, or early where the input changes seldom."""
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.uniform(-1, 1, 150), 10)
        y = lfilter([0.0] * 12 + [1.0], np.poly(np.exp(-1 / rng.uniform(8, 30, 2))), u)
        shown, _ = with_delay(Options(), [Record(u, y + 0.03 * y.std() * rng.standard_normal(len(u)), 0.01)])
        assert shown.nk in (11, 12, 13)

    def test_a_given_or_a_short_one_is_not(self) -> None:
        u = steps()
        given = emsid.Options(na=1, nb=1, nk=35)
        for delay, options in ((36, given), (3, emsid.Options(na=1, nb=1))):
            record = Record(u, motor(u, delay=delay), 0.01, "u", "y")
            result = emsid.identify(record, models="arx", options=options)
            assert "delay-from-data" not in {each.code for each in result.findings}


class TestBreakaway:
    """A motor that coasts through its dead zone is rarely at rest, and its rests show the dead zone."""

    @staticmethod
    def coasting(zone: float) -> tuple[Array, np.ndarray]:
        ramps = np.concatenate([np.linspace(0, sign * 100, 50)[:, None] for sign in (1, -1) for _ in range(8)])[:, 0]
        u = np.concatenate([np.append(piece, np.zeros(30)) for piece in np.split(ramps, 16)])
        y, moving = np.zeros(len(u)), False
        for k in range(1, len(u)):
            moving = abs(u[k - 1]) > zone or (moving and abs(y[k - 1]) > 0.5)
            y[k] = 0.8 * y[k - 1] + 0.2 * u[k - 1] if moving else 0.0
        return u, y == 0

    @pytest.mark.parametrize("zone", [30.0, 60.0])
    def test_the_level_is_found(self, zone: float) -> None:
        u, resting = self.coasting(zone)
        assert breakaway(u, resting, 1) == pytest.approx(zone, abs=3.0)

    def test_steps_to_random_levels_do_not_exaggerate_it(self) -> None:
        """Between the largest level that holds the drive and the smallest that moves it there may be a wide gap."""
        u = np.repeat(np.random.default_rng(1).uniform(-10, 10, 40), 10)
        resting = np.abs(np.roll(u, 1)) <= 2
        assert 1.5 <= breakaway(u, resting, 1) <= 2

    def test_steps_from_rest_do_not_show_it(self) -> None:
        u = np.tile(np.repeat([0.0, 100.0], 20), 10)
        assert breakaway(u, np.roll(u, 1) == 0, 1) is None
        assert breakaway(u, np.zeros(len(u), dtype=bool), 1) is None

    def test_rests_that_end_without_input_do_not_show_it(self) -> None:
        assert breakaway(np.zeros(400), np.arange(400) % 40 < 20, 1) is None


class TestRest:
    """At rest a speed stays at one value; in a reversal, or between two moves, it passes through zero."""

    t = np.arange(8000) * 1e-3
    moves = np.cos(2 * np.pi * t) ** 3

    @pytest.mark.parametrize("noise", [0.0, 5e-4])
    def test_a_reversal_and_a_turn_are_none(self, noise: float) -> None:
        noisy = noise * np.random.default_rng(0).standard_normal(len(self.t))
        assert at_rest(np.cos(2 * np.pi * self.t) + noisy).mean() < 0.005
        assert at_rest(np.cos(2 * np.pi * self.t) ** 2 + noisy).mean() < 0.005

    @pytest.mark.parametrize("noise", [0.0, 5e-4, 4e-3])
    def test_a_motor_that_sticks_rests(self, noise: float) -> None:
        """Noise of 0.4 % of the largest speed is a fifth of the limit of what is close to zero."""
        sticks = np.abs(self.moves) < 0.3
        y = np.where(sticks, 0.0, self.moves) + noise * np.random.default_rng(0).standard_normal(len(self.t))
        np.testing.assert_array_equal(at_rest(y), sticks)

    def test_an_axis_that_reverses_shows_no_dead_zone(self) -> None:
        """A large force turns the axis around: its speed is close to zero for a moment, but it does not rest."""
        u = np.sign(np.sin(2 * np.pi * self.t)) * 2 + np.sin(6 * np.pi * self.t)
        y = -np.cos(2 * np.pi * self.t)
        record = Record(u, y, 1e-3, "u", "y")
        seen = response_of(record)
        assert seen is not None
        codes = {finding.code for finding in advice(record, seen)}
        assert "motion" in codes
        assert not codes & {"dead-zone-likely", "amplitude-near-dead-zone"}


@pytest.mark.parametrize("held", [40, 15])
def test_feedback_is_seen_between_the_steps_of_a_reference(held: int) -> None:
    """A proportional controller: most of what is new in the input are the steps, and they answer nothing."""
    rng = np.random.default_rng(0)
    samples, pole = 3000, 0.9
    reference = np.repeat(rng.uniform(-8, 8, samples // held), held)
    noise = lfilter([1.0], [1.0, -0.95], 0.3 * rng.standard_normal(samples))
    u, y = np.zeros(samples), np.zeros(samples)
    for k in range(1, samples):
        y[k] = pole * (y[k - 1] - noise[k - 1]) + 0.5 * u[k - 1] + noise[k]
        u[k] = 3 * (reference[k] - y[k] / 5)
    assert "feedback-likely" in findings(u, y)
    assert "feedback-likely" not in findings(u, lfilter([0.0, 0.5], [1.0, -pole], u) + rng.permutation(noise))


def test_feedback_is_seen_where_the_input_answers_before_the_output() -> None:
    """A fast proportional loop: noise reaches the input in its own sample, and not by the response."""
    rng = np.random.default_rng(1)
    reference, u, y = 10 * np.repeat(rng.standard_normal(100), 40), np.zeros(4000), np.zeros(4000)
    for k in range(1, len(u)):
        y[k] = 0.9 * y[k - 1] + 0.5 * u[k - 1] + 0.5 * rng.standard_normal()
        u[k] = 2 * (reference[k] - y[k])
    assert response(u, y).delay == 1
    found = findings(u, y)
    assert "feedback-likely" in found
    assert "nonlinear-likely" not in found
    assert "feedback-likely" not in findings(u, lfilter([0.5, 0.2], [1.0, -0.9], u) + 0.5 * rng.standard_normal(4000))
    assert "feedback-likely" not in findings(u, -lfilter([0.5], [1.0, -0.9], u) + 0.5 * rng.standard_normal(4000))


def test_a_smooth_input_does_not_delay_the_response() -> None:
    rng = np.random.default_rng(1)
    lines = np.arange(1, 80, 2)
    one = np.cos(2 * np.pi * np.outer(np.arange(1000), lines) / 1000 + rng.uniform(0, 6, len(lines))).sum(axis=1)
    u = np.tile(one, 4)
    found = findings(u, lfilter([0.0, 0.1], [1.0, -0.9], u) + 0.1 * rng.standard_normal(len(u)))
    assert found["response-delay"].data["delay"] <= 1
    assert "sampling-too-slow" not in found
    assert "sampling-too-slow" not in findings(u, lfilter([0.2], [1.0, -0.8], u) + 0.01 * rng.standard_normal(len(u)))
    few = 3 * np.sin(0.01 * np.pi * np.arange(3000)) + 2 * np.sin(0.026 * np.pi * np.arange(3000))
    assert "sampling-too-slow" not in findings(few, lfilter([0.0, 0.1], [1.0, -0.9], few) + 0.01 * rng.permutation(few))


@pytest.mark.parametrize("sign", [1, -1])
def test_a_response_within_a_sample_is_no_feedback(sign: int) -> None:
    """A mass on a spring, input linear between samples: the newest input has a quarter of the effect of the last."""
    rng, own = np.random.default_rng(0), np.exp(0.7 * (1j - 0.05))
    u = sosfilt(butter(6, 0.66, output="sos"), rng.standard_normal(6000)) + 3e-4 * rng.standard_normal(6000)
    y = sign * lfilter([1, 4, 1], np.poly([own, own.conjugate()]).real, u)
    y += 0.002 * np.std(y) * rng.standard_normal(6000)
    assert response(u, y, ()).delay == 1
    assert "feedback-likely" not in findings(u, y)


def test_rest_is_judged_in_what_a_drift_leaves() -> None:
    """With a drift, the output at rest is seldom close to zero."""
    u = U
    line = 40 * np.linspace(0, 1, len(u))
    noise = 0.1 * np.random.default_rng(11).standard_normal(len(u))
    without, drifting = findings(u, dead(u, 6) + noise), findings(u, dead(u, 6) + noise + line)
    assert "output-drifts" in drifting
    assert "output-drifts" not in without
    (rest,), (still,) = ([f.data for f in each.values() if "reversals" in f.data] for each in (without, drifting))
    assert still["share"] == pytest.approx(rest["share"], abs=0.02)
    found, read = mends(drifting.values(), [], "u > 9")
    assert (found, read) == ([*drifting.values()], {"detrend": 1})


def test_a_constant_input_shows_no_delay():
    """A step recorded from after it has begun: any shift of its input fits alike."""
    t = 0.02 * np.arange(250)
    rise = Record(np.full(250, 255.0), 9.5 * np.floor((700.0 - 640.0 * np.exp(-t / 0.225)) / 9.5), 0.02)
    assert with_delay(Options(), [rise]) == (Options(), ())
