"""What a record shows of its sensors: what is left out, and after what no estimate is known.

The drive has a gain of 40 rad/s per V, a time constant of 50 ms and Coulomb friction of 0.3 V, simulated in ten steps a
sample apart from the program.
"""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import copysign

import numpy as np
import pytest

import emsid
from emsid.first_look.data_advice import advice
from emsid.first_look.faults import without_faults
from emsid.identification.verdict import OF_SENSORS
from emsid.record.holding_back import unseen_part
from emsid.studio.data import Data
from emsid.studio.session import Session

N, DT = 1600, 0.01
QUICK = "arx,output-error"


def speed(u, noise=0.3, seed=1):
    """(N,) the speed under a voltage (N,) that is held."""
    found, x = [], 0.0
    for volts in u.tolist():  # numbers of Python, as those of NumPy take three times as long
        found.append(x)
        for _ in range(10):
            net = 40 * volts - x
            net = net - copysign(12, x) if abs(x) > 1e-3 else copysign(max(abs(net) - 12, 0.0), net)
            x += 0.1 * DT * net / 0.05
    return np.array(found) + noise * np.random.default_rng(seed).standard_normal(len(u))


def staircase(seed=0, each=20, samples=N):
    return np.repeat(np.random.default_rng(seed).uniform(-8, 8, samples // each), each)


def record(u, y):
    return emsid.Record(u, y, DT, input_units="V", output_units="rad/s", input_names="voltage", output_names="speed")


def codes(findings):
    return {each.code for each in findings}


HEALTHY = record(staircase(), speed(staircase()))


# --- what is left out ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rows", [(600, 1100), (1100, N)])
def test_an_output_that_stood_still_is_left_out_and_said(rows):
    output = HEALTHY.output.copy()
    output[slice(*rows)] = output[rows[0]]
    left = without_faults(replace(HEALTHY, output=output))
    (found,) = left.findings
    assert (found.code, found.data["row"], found.data["length"]) == ("value-stuck", rows[0], rows[1] - rows[0])
    assert len(left) == N - (rows[1] - rows[0])
    result = emsid.identify(replace(HEALTHY, output=output), models=QUICK)
    assert "value-stuck" in codes(result.findings)
    assert result.rows[0].fit_percent > 95


def test_an_outlier_is_left_out_and_said():
    output = HEALTHY.output.copy()
    output[777] = 1e12
    left = without_faults(replace(HEALTHY, output=output))
    assert np.array_equal(left.output, np.delete(output, 777, axis=0))
    result = emsid.identify(replace(HEALTHY, output=output), models=QUICK)
    assert "outliers" in codes(result.findings)
    assert result.rows[0].fit_percent > 95


def test_an_impossible_command_is_left_out_and_an_impulse_is_not():
    u = HEALTHY.input.copy()
    u[500] = -1e12
    left = without_faults(replace(HEALTHY, input=u))
    assert np.array_equal(left.input, np.delete(HEALTHY.input, 500, axis=0))
    assert [each.subject for each in left.findings] == ["voltage"]
    u[500] = 60.0
    assert not without_faults(replace(HEALTHY, input=u)).findings


@pytest.mark.parametrize("seed", range(3))
def test_counts_behind_a_saturating_supply_are_not_clipped(seed):
    """The speed settles at the same counts whenever the supply is at its limit."""
    u = 3 * np.sin(0.02 * np.arange(N) * (1 + 0.1 * seed)) * 8
    held = record(u, np.round(speed(np.clip(u, -6, 6), 0.0) / 2) * 2)
    assert "output-clipped" not in codes(advice(held))


def counted():
    u = 0.4 * staircase(3)
    return record(u, np.round(speed(u, 0.0) / 2) * 2)


def at_rest():
    """A drive that rests in its friction for most of the time and answers impulses, without noise."""
    u = 0.05 * staircase(4)
    u[200::400] += 5
    return record(u, np.round(speed(u, 0.0), 1))


@pytest.mark.parametrize("healthy", [lambda: HEALTHY, counted, at_rest], ids=["noise", "counts", "rest"])
def test_nothing_is_left_out_of_a_healthy_record(healthy):
    assert without_faults(healthy()) is healthy() or not without_faults(healthy()).findings
    assert not codes(advice(healthy())) & OF_SENSORS


# --- after what no estimate is known ---------------------------------------------------------------------------------


def clipped():
    return replace(HEALTHY, output=np.clip(HEALTHY.output, -150, 150))


def three_levels():
    return replace(HEALTHY, output=100.0 * np.sign(np.where(np.abs(HEALTHY.output) < 80, 0, HEALTHY.output)))


def slow_sensor():
    return replace(HEALTHY, output=np.repeat(HEALTHY.output[::2], 2, axis=0))


def slow_log(seed=5):
    u = np.random.default_rng(seed).uniform(-8, 8, N)
    return record(np.repeat(u[::2], 2), speed(u))


FAULTS = {
    "output-clipped": clipped,
    "few-output-levels": three_levels,
    "samples-repeated": slow_sensor,
    "input-logged-slower": slow_log,
}


@pytest.mark.parametrize("code", FAULTS)
def test_no_estimate_is_known_after_a_finding_about_the_sensor(code):
    known = FAULTS[code]()
    assert code in codes(advice(known))
    result = emsid.identify(known, models=f"{QUICK},rigid-motor", quick=False, free=("motor_constant", "rotor_inertia"))
    assert code in codes(result.findings)
    assert result.known == []
    assert result.characteristics == ()
    assert not result.is_recommended
    assert "model-supported" not in codes(result.model_verdicts)


def test_a_healthy_record_has_characteristics():
    assert emsid.identify(HEALTHY, models=QUICK).characteristics


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("each", [2, 5])
def test_a_command_that_is_held_is_no_slow_log_however_nonlinear_the_drive_is(seed, each):
    u = staircase(seed, each)
    for bent in (u, np.clip(u, -2, 2), u * np.abs(u) / 8):
        assert "input-logged-slower" not in codes(advice(record(u, speed(bent))))
    stale = record(np.repeat(staircase(seed, 1)[::each], each), speed(staircase(seed, 1)))
    assert "input-logged-slower" in codes(advice(stale))


def test_one_signal_twice_is_no_system():
    twice = record(staircase(), 3.0 * staircase())
    assert codes(advice(twice)) == {"output-is-input"}
    result = emsid.identify(twice, models=QUICK)
    assert codes(result.model_verdicts) == {"model-unusable"}
    assert not result.is_usable


# --- an input that moves at the end only -----------------------------------------------------------------------------


def test_an_input_that_moves_at_the_end_only_is_divided_where_it_moves():
    u = np.where(np.arange(N) < 1500, 0.0, staircase())
    late = record(u, speed(u))
    first, stop = unseen_part(late, 0.3)
    assert 1500 < first < 1600
    assert stop == N
    result = emsid.identify(late, models=QUICK)
    assert result.rows[0].fit_percent > 90


# --- one set of observations at every door ----------------------------------------------------------------------------


def frozen():
    output = HEALTHY.output.copy()
    output[600:1100] = output[600]
    return replace(HEALTHY, output=output)


def spiked():
    output = HEALTHY.output.copy()
    output[777] = 1e12
    return replace(HEALTHY, output=output)


def impossible():
    volts = HEALTHY.input.copy()
    volts[500] = 1e9
    return replace(HEALTHY, input=volts)


def with_an_impulse():
    """An answered impulse of the input, which is far from all other samples of both, and an outlier."""
    volts = staircase()
    volts[400] = 3000.0
    output = speed(volts)[:, None]
    output[900] = -1e6
    return record(volts, output)


DOORS = {
    "frozen output": ("value-stuck", frozen),
    "outlier": ("outliers", spiked),
    "impossible command": ("outliers", impossible),
    "outlier and an impulse": ("outliers", with_an_impulse),
    "one signal twice": ("output-is-input", lambda: record(staircase(), 3.0 * staircase())),
    "clipped output": ("output-clipped", clipped),
}
CODES = {code for code, _ in DOORS.values()}


@pytest.mark.parametrize("case", DOORS)
def test_description_identification_validation_fleet_and_studio_say_the_same(case, run, tmp_path):
    path, model = tmp_path / "log.csv", tmp_path / "model.json"
    code, make = DOORS[case]
    emsid.io.write_record(make(), path)
    how = {"input": ["voltage"], "output": ["speed"], "time": "t"}
    look = emsid.describe(path, **how)
    result = emsid.identify(emsid.read(path, **how), models=QUICK)
    emsid.save(emsid.fit(emsid.arx(1, 1), HEALTHY), model, HEALTHY, how)
    status, out, _ = run("validate", model, path, "--json")
    (validated,) = json.loads(out)["records"]
    session = Session.at_folder(tmp_path / "session")
    session.change(0, files=[session.add(path)], given={"log.csv": how})
    shown = Data(session, lambda: None).described(session.step, "log.csv")
    said = {each["code"] for each in validated["findings"]}
    assert status == 0
    for door in (codes(look.findings), codes(result.findings), said, {each["code"] for each in shown["findings"]}):
        assert CODES & door == {code}
    used = without_faults(emsid.read(path, **how))
    proposed = emsid.read(path, **{**look.reading, **look.mends})
    assert len(used) == len(proposed)
    assert len(used) < N or code not in {"value-stuck", "outliers"}
    with ThreadPoolExecutor(1) as threads:
        (row,) = emsid.fleet([path], emsid.arx(1, 1), threads, unseen=0, **how).rows
    assert abs(row.estimates["a1"].value) == pytest.approx(abs(emsid.fit(emsid.arx(1, 1), used)["a1"].value))
    if code in {"value-stuck", "outliers"}:
        assert validated["samples"] < N
        assert validated["fit_percent"] > 90
