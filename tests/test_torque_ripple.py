"""The torque of a brushless motor over its angle: found in a log of an independent drive, written, and cancelled."""

from __future__ import annotations

import csv
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.compensation.files import COGGING_MAP, write
from emsid.errors import ModelError
from emsid.models.plants.search.estimation import searched
from emsid.models.plants.search.parts import extended
from emsid.plants import Brushless, GreyBox, Harmonic, Signal
from independent.switched_drive import Drive, Log, on_flywheel, turned
from test_brushless import plant_of

STEADY = Drive(switched=False)
COGGING = ((42.0, 0.012, -0.016), (1.0, 8e-3, 6e-3), (24.0, 0.0, 0.01))
RIPPLE = ((42.0, 0.06, 0.08),)
UNEVEN = STEADY._replace(cogging=COGGING, ripple=RIPPLE)
SIGNALS = (Signal.D_CURRENT, Signal.Q_CURRENT, Signal.SPEED)
HARMONICS = {
    "cogging": (Harmonic(42, 0.012, -0.016), Harmonic(84, -6e-3, 5e-3)),
    "torque_ripple": (Harmonic(42, 0.06, 0.08),),
}
MODEL = GreyBox(emsid.plants.brushless(inductance_q=1.3e-4, **HARMONICS), SIGNALS)
TURN = np.linspace(0.0, 2 * np.pi, 3600)
FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow"]


def harmonics(plant: Brushless) -> dict[tuple[str, int], complex]:
    """The complex amplitudes of a plant by field and number."""
    fields = ("cogging", "torque_ripple")
    return {(of, each.number): complex(each.cosine, each.sine) for of in fields for each in getattr(plant, of)}


def found_in(drive: Drive, seed: int, seconds: float = 0.5) -> Brushless:
    """The plant that a search ends in which begins with the true constants of a drive, without its harmonics."""
    record = turned(drive, seed, seconds).record()
    begun = replace(plant_of(drive), cogging=(), torque_ripple=(), heating=0.0)
    plant = extended(*searched(begun, record, find_start=False, max_iterations=6))[2].problem.plant
    assert isinstance(plant, Brushless)
    return plant


def torque_over_angle(plant: Brushless) -> np.ndarray:
    characteristic = plant.cogging_characteristic()
    assert characteristic is not None
    return characteristic.law(TURN)


def test_the_effect_of_a_harmonic_is_the_derivative_of_a_run() -> None:
    log = turned(STEADY, 0, 0.1)
    record = log.record()
    plant = plant_of(STEADY).for_command(record)
    state = plant.first_state(SIGNALS, record)
    state[5:] = log.before
    parts = plant.possible_parts([turned(STEADY, 0).record()], SIGNALS)
    some = [each for each in parts if each.number in (1, 24, 42)]
    (effects,) = plant.effects_of_parts([some], record, state, SIGNALS)
    for k, part in enumerate(some):
        for side, name in enumerate(part.names):
            runs = [
                plant.with_parts([part]).with_values({name: way}).simulate(record.input, record.dt, state, SIGNALS)
                for way in (1e-5, -1e-5)
            ]
            slope = (runs[0] - runs[1]) / 2e-5
            for channel in (1, 2):
                error = np.linalg.norm(effects[:, channel, k, side] - slope[:, channel])
                assert error < 0.01 * np.linalg.norm(slope[:, channel]), (part, channel)


def test_probabilities_of_harmonics_prefer_poles_and_slots() -> None:
    record = turned(STEADY, 0, 0.5, noisy=False).record()
    plant = plant_of(STEADY).for_command(record)
    for slots, usual in ((0, (14, 28, 350)), (12, (12, 24, 14))):
        parts = replace(plant, slots=float(slots)).possible_parts([record], SIGNALS)
        prior = {(each.of, each.number): each.prior for each in parts}
        assert sum(prior.values()) == pytest.approx(2.0)  # one for cogging, one for the ripple by current
        assert all(prior["cogging", n] == prior["cogging", 14] for n in usual)
        assert prior["cogging", 14] > 4 * prior["cogging", 13]
        assert prior["torque_ripple", 42] > 10 * prior["torque_ripple", 14]
    assert not plant.possible_parts([record[:500]], SIGNALS)  # less than a turn
    assert not replace(plant, placed=False).possible_parts([record], SIGNALS)  # no angle


@pytest.fixture(scope="module")
def found() -> Brushless:
    """What a record of a second shows; the 95 % interval of its ripple by current is ±3.7 %."""
    return found_in(UNEVEN, 880001, 1.0)


@pytest.mark.long
def test_cogging_and_ripple_by_current_are_found_within_five_percent(found: Brushless) -> None:
    truth = harmonics(plant_of(UNEVEN))
    assert {*truth} == {*harmonics(found)}
    for key, amplitude in harmonics(found).items():
        if abs(truth[key]) > 0.015:
            assert abs(amplitude - truth[key]) < 0.05 * abs(truth[key]), key
    peaks = [float(np.ptp(torque_over_angle(each))) for each in (found, plant_of(UNEVEN))]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.05)


def test_a_motor_without_ripple_gets_none() -> None:
    assert not harmonics(found_in(STEADY, 12))


def test_a_table_cancels_the_ripple_of_the_drive_that_it_was_made_for() -> None:
    assert cancelled(plant_of(UNEVEN)) > 4.0


@pytest.mark.long
def test_the_table_of_an_identified_motor_cancels_the_ripple(found: Brushless) -> None:
    assert cancelled(found) > 4.0


def cancelled(plant: Brushless) -> float:
    """Peak-to-peak ripple without the table of a plant by that with it, at 3 rad/s.

    There the harmonics are within the bandwidth of the current loop, 1000 rad/s.
    """
    logs = on_flywheel(UNEVEN, 3.0), on_flywheel(UNEVEN, 3.0, table_of(plant))
    without, left = (float(np.ptp(waves(log) @ WAVES)) for log in logs)
    return without / left


@pytest.mark.parametrize("speed", [6.0, 12.0, 24.0])
def test_a_table_leaves_what_the_current_loop_does_not_follow(speed: float) -> None:
    """Of harmonic n that is 1/|1 + L(j·n·ω)|, with L of the loop: controller, winding and 1.5 samples of delay."""
    with_table = on_flywheel(UNEVEN, speed, table_of(plant_of(UNEVEN)))
    before, after = ((v[0::2] - 1j * v[1::2]) for v in (waves(on_flywheel(UNEVEN, speed)), waves(with_table)))
    s = 1j * np.array(NUMBERS) * with_table.speed.mean()
    loop = (UNEVEN.proportional + UNEVEN.integral / s) / (UNEVEN.resistance + s * UNEVEN.inductance_q)
    left = 1.0 / np.abs(1.0 + loop * np.exp(-1.5 * UNEVEN.period * s))
    assert np.abs(after / before) == pytest.approx(left, rel=0.15)


def table_of(plant: Brushless) -> np.ndarray:
    """(720, 2) the q-current that is added, and the factor of the controller's."""
    inverse = emsid.compensate(GreyBox(plant, SIGNALS))
    assert isinstance(inverse, emsid.RippleCompensation)
    return inverse.table(720)[:, [3, 2]]


NUMBERS = (1, 24, 42)
WAVES = np.array([f(n * TURN) for n in NUMBERS for f in (np.cos, np.sin)])


def waves(log: Log) -> np.ndarray:
    """(6,) cosines and sines in N·m of the torque over the angle, by a regression over a turn."""
    columns = [np.ones(len(log.angle)), *(f(n * log.angle) for n in NUMBERS for f in (np.cos, np.sin))]
    return np.linalg.lstsq(np.column_stack(columns), log.torque, rcond=None)[0][1:]


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize(("single", "within"), [(False, 1e-12), (True, 1e-4)])
def test_the_c_of_a_compensation_gives_the_numbers_of_python(single: bool, within: float, tmp_path: Path) -> None:
    inverse = emsid.compensate(MODEL)
    write(MODEL, inverse, tmp_path, name="m", dt=1e-4, single=single)
    (tmp_path / "main.c").write_text(
        """#include <stdio.h>
#include "m_compensation.h"
int main(void)
{
    double w, d, a;
    while (scanf("%lf %lf %lf", &w, &d, &a) == 3) {
        const m_compensation_real wanted = (m_compensation_real)w, angle = (m_compensation_real)a;
        printf("%.17g %.17g", (double)m_cogging(angle), (double)m_torque(wanted, angle));
        printf(" %.17g\\n", (double)m_current(wanted, (m_compensation_real)d, angle));
    }
    return 0;
}
"""
    )
    subprocess.run(
        ["gcc", *FLAGS, "-o", tmp_path / "main", tmp_path / "main.c", tmp_path / "m_compensation.c", "-lm"], check=True
    )
    rng = np.random.default_rng(0)
    wanted, d, angle = rng.uniform(-0.5, 0.5, 200), rng.uniform(-5, 5, 200), rng.uniform(-7, 7, 200)
    text = "\n".join(f"{w:.17g} {i:.17g} {a:.17g}" for w, i, a in zip(wanted, d, angle, strict=True))
    ran = subprocess.run([tmp_path / "main"], input=text, capture_output=True, text=True, check=True)
    numbers = np.array([line.split() for line in ran.stdout.splitlines()], dtype=float)
    expected = inverse.cogging_torque(angle), inverse.torque(wanted, angle), inverse.current(wanted, angle, d)
    assert numbers == pytest.approx(np.column_stack(expected), abs=within)


@pytest.mark.skipif(shutil.which("avr-gcc") is None, reason="avr-gcc is not installed")
def test_the_c_of_a_compensation_compiles_for_avr(tmp_path: Path) -> None:
    write(MODEL, emsid.compensate(MODEL), tmp_path, name="m", dt=1e-4, single=True)
    flags = ["-mmcu=atmega2560", "-std=c99", "-Os", "-Wall", "-Wextra", "-Werror"]
    made = [tmp_path / "m.o", tmp_path / "m_compensation.c"]
    subprocess.run(["avr-gcc", *flags, "-c", "-o", *made], check=True)


@pytest.mark.parametrize(
    ("harmonic", "reason"),
    [((), "neither cogging nor ripple"), ((Harmonic(6, 1.0),), "as large as the torque")],
)
def test_the_command_refuses_a_motor_without_an_inverse(
    harmonic: tuple[Harmonic, ...], reason: str, tmp_path: Path, run: Callable[..., tuple[int, str, str]]
) -> None:
    emsid.save(GreyBox(emsid.plants.brushless(torque_ripple=harmonic), SIGNALS), tmp_path / "m.json")
    status, _, said = run("compensate", tmp_path / "m.json", "--out", tmp_path / "out", "--dt", "100us")
    assert status == 2
    assert reason in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_command_refuses_options_of_a_bench_for_a_ripple(
    tmp_path: Path, run: Callable[..., tuple[int, str, str]]
) -> None:
    emsid.save(MODEL, tmp_path / "m.json")
    command = "compensate", tmp_path / "m.json", "--out", tmp_path / "out"
    status, _, said = run(*command, "--dt", "100us", "--encoder", "2000", "--limit", "12V")
    assert status == 2
    assert "leave these out (--encoder, --limit)" in said
    assert "give dt (--dt)" in run(*command)[2]
    assert not (tmp_path / "out").exists()


def test_the_command_writes_tables_over_the_angle(tmp_path: Path, run: Callable[..., tuple[int, str, str]]) -> None:
    emsid.save(MODEL, tmp_path / "m.json")
    assert run("compensate", tmp_path / "m.json", "--out", tmp_path / "out", "--dt", "100us", "--name", "m")[0] == 0
    rows = list(csv.reader((tmp_path / "out" / "m_ripple.csv").open()))
    assert rows[0] == ["angle [rad]", "torque [N*m]", "factor", "q_current [A]"]
    angle, torque, factor, current = np.array(rows[1:], dtype=float).T
    plant = MODEL.plant
    per_ampere = 1.5 * plant.pole_pairs * plant.flux
    part = 0.06 * np.cos(42 * angle) + 0.08 * np.sin(42 * angle)
    assert per_ampere * current * (1 + part) == pytest.approx(torque, abs=1e-9)  # what the load gets is zero
    assert factor * (1 + part) == pytest.approx(1.0)
    values = re.findall(r"(-?\d\.\d+e[+-]\d+)f", (tmp_path / "out" / "m_odrive.h").read_text())
    middle = (np.arange(COGGING_MAP) + 0.5) / COGGING_MAP * 2 * np.pi
    cogging = plant.cogging_characteristic()
    assert cogging is not None
    assert np.array(values, dtype=float) == pytest.approx(cogging.law(middle), abs=1e-8)


def test_a_motor_without_harmonics_has_nothing_to_compensate() -> None:
    with pytest.raises(ModelError, match="neither cogging nor ripple"):
        emsid.compensate(GreyBox(emsid.plants.brushless(), SIGNALS))
    with pytest.raises(ModelError, match="as large as the torque"):
        emsid.compensate(GreyBox(emsid.plants.brushless(torque_ripple=(Harmonic(6, 1.0),)), SIGNALS))


def test_cogging_and_ripple_are_said_and_drawn() -> None:
    fit = emsid.fit(replace(plant_of(UNEVEN)), turned(UNEVEN, 5, 0.1).record(), free=["cogging.42.cosine"])
    said = {each.code: each.data for each in fit.findings}
    assert said["cogging-over-angle"]["number"] == 42
    assert said["torque-ripple-over-angle"]["size"] == pytest.approx(0.2, rel=1e-3)
    curve = emsid.plants.cogging_curve(fit)
    assert np.ptp(curve.y) == pytest.approx(said["cogging-over-angle"]["size"], rel=0.01)
    assert np.all(curve.high - curve.low >= 0)
