"""The inverse of a model: exact where it exists, in Python and in C, and on the virtual bench."""

import json
import shutil
import subprocess

import numpy as np
import pytest

import emsid
from emsid.compensation.files import write
from emsid.controllers.verb import compensated
from emsid.estimation.fit import Fit
from emsid.models.blocks.filters import Rational
from emsid.models.verbs import as_model
from emsid.wording.study import smaller

DT = 2e-3
FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow"]
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
FRICTION = {"rotor_friction.coulomb": 0.02, "voltage_dead_zone.half_width": 0.5}
STRIBECK = {**FRICTION, "rotor_friction.stribeck": 0.01, "rotor_friction.stribeck_rate": 0.5}


def motor(**values):
    return as_model(emsid.plants.rigid_motor().with_values(values or FRICTION))


def tracked(model, reference):
    commands = emsid.compensate(model, dt=DT).feedforward(reference)
    return model.run(model.at_rest(0.0, DT), commands[:, None])[0][:, 0]


@pytest.mark.parametrize(
    "values",
    [
        FRICTION,
        {**FRICTION, "rotor_viscous": 1e-4, "rotor_friction.coulomb.backward": 0.03, "voltage_dead_zone.b_l": -0.9},
        {**FRICTION, "voltage_dead_zone.m_r": 1.3, "load_torque": 0.004},
        {**FRICTION, "drive.gain": 0.1, "drive.offset": 0.3},
        {**FRICTION, "voltage_drop": 0.4, "viscous_backward": 2e-4},
    ],
)
def test_the_feedforward_leads_the_plant_exactly_along_a_reference_in_one_direction(values):
    time = DT * np.arange(1500)
    for way in (1.0, -1.0):
        reference = way * (8.0 + 5.0 * np.sin(3 * time)) * np.minimum(time / 0.2, 1.0)
        assert np.abs(tracked(motor(**values), reference) - reference).max() < 1e-10


def test_through_a_reversal_the_feedforward_misses_by_part_of_one_sample():
    reference = 10.0 * np.sin(2 * DT * np.arange(3000))
    assert np.abs(tracked(motor(), reference) - reference).max() < 0.02  # a sample's change of the reference is 0.04


def test_at_standstill_friction_has_the_direction_of_the_next_speed_at_the_break_away_level():
    inverse = emsid.compensate(motor(**STRIBECK), dt=DT)
    found = inverse.friction_force([0.0, 0.0, 0.0, 5.0, -5.0], [0.0, 1e-6, -1e-6, 5.0, -5.0])
    sliding = 0.02 + 0.01 * np.exp(-0.5 * 5.0)
    assert found == pytest.approx([0.0, 0.03, -0.03, sliding, -sliding], abs=1e-15)


def test_the_inverse_of_the_dead_zone_is_exact_and_smoothed_on_request():
    z = np.array([-2.0, -0.05, 0.0, 0.05, 2.0])
    exact = emsid.compensate(motor(), dt=DT)
    assert exact.zone(exact.dead_zone_inverse(z)) == pytest.approx(z, abs=1e-15)
    smooth = emsid.compensate(motor(), dt=DT, zone_width=0.1)
    near = smooth.dead_zone_inverse(np.linspace(-0.2, 0.2, 2001))
    assert np.abs(np.diff(near)).max() < 0.4 / 2000 * (1 + 0.5 / 0.1) + 1e-12  # no jump
    assert smooth.dead_zone_inverse(z)[[0, 2, 4]] == pytest.approx(exact.dead_zone_inverse(z)[[0, 2, 4]])


def test_knee_and_offset_of_the_drive_are_inverted():
    model = motor(**{**FRICTION, "drive.gain": 0.5, "drive.knee": 2.0, "drive.beyond": 1.2})
    inverse = emsid.compensate(model, dt=DT)
    commands = inverse.command(np.array([-3.0, -0.3, 0.4, 3.0]))
    volts = model.plant.drive.applied(commands[:, None])[0]
    assert inverse.zone(volts) == pytest.approx([-3.0, -0.3, 0.4, 3.0], abs=1e-12)


AXIS = {"mass": 2.0, "friction.coulomb": 5.0, "viscous_friction": 10.0}


@pytest.mark.parametrize(
    ("model", "dt", "encoder"),
    [
        (motor(), DT, 8192),
        (motor(), 1e-3, 2000),
        (motor(**STRIBECK), 1e-3, 2000),
        (motor(**FRICTION, inductance=2e-3), 1e-3, 2000),
        (as_model(emsid.plants.rigid_motor().with_values({"voltage_dead_zone.half_width": 0.5})), 1e-3, 2000),
        (as_model(emsid.plants.linear_axis().with_values(AXIS)), 1e-3, 200_000),
    ],
    ids=["coulomb, 2 ms", "coulomb, 1 ms", "stribeck", "inductance", "dead zone only", "axis"],
)
def test_on_the_bench_it_does_no_harm(model, dt, encoder):
    _, bench = compensated(model, dt=dt, encoder=encoder)
    errors = {key: run.error for key, run in bench.runs.items()}
    plants = {key[2] for key in errors}
    assert {"friction × 0.7", "friction × 1.3"} <= plants or model.plant.value("rotor_friction.coulomb") == 0
    for plant in plants:
        run = bench.runs["cascade", "reversal", plant]
        assert run.error < errors["cascade without compensation", "reversal", plant]
        hold = bench.runs["cascade", "hold", plant]
        assert hold.changes == 0
        assert hold.error < max(1.5 * bench.resolution, errors["cascade without compensation", "hold", plant])
    assert (
        errors["cascade", "reversal", "as identified"]
        < 0.2 * errors["cascade without compensation", "reversal", "as identified"]
    )


def test_widths_are_what_a_count_does_in_a_sample():
    count = 2 * np.pi / 2000
    inverse = emsid.compensate(motor(), dt=DT, encoder=2000)
    assert inverse.count == pytest.approx(count)
    assert inverse.speed_width == pytest.approx(count / (10 * DT))
    values = motor().parameter_values()
    inertia = values["rotor_inertia"] + values["load_inertia"]
    volts = values["resistance"] / values["motor_constant"] * inertia / (10 * DT) * count / DT
    assert inverse.zone_width == pytest.approx(volts)
    given = emsid.compensate(motor(), dt=DT, encoder=2000, zone_width=0.1, speed_width=0.0)
    assert (given.zone_width, given.speed_width) == (0.1, 0.0)
    assert inverse.at_rest([count, 2 * count, count, count], [0, 0, 1, 0], [0, 0, 0, count]) == pytest.approx(
        [0, 2 * count, count, count]
    )


def test_of_a_fit_the_lower_ends_of_the_intervals_are_compensated():
    names = ("rotor_friction.coulomb", "voltage_dead_zone.half_width", "rotor_inertia")
    estimate = np.array([0.02, 0.5, 2e-5])
    fit = Fit(motor(), names, estimate, np.diag((0.05 * estimate) ** 2), 1.0, 100.0, 1.0, 3)
    inverse, exact = emsid.compensate(fit, dt=DT), emsid.compensate(fit.model, dt=DT)
    lower = 1 - 0.05 * 1.959964
    assert inverse.friction_force(5.0) == pytest.approx(0.02 * lower)
    assert inverse.zone.b_r == pytest.approx(0.5 * lower)
    assert inverse.zone.b_l == pytest.approx(-0.5 * lower)
    assert inverse.inside.mass == exact.inside.mass
    assert exact.friction_force(5.0) == pytest.approx(0.02)


def test_an_inductance_is_neglected_by_the_inverse():
    model = motor(**FRICTION, inductance=2e-3)
    inverse = emsid.compensate(model, dt=DT)
    assert inverse.feedforward([1.0, 2.0]) == pytest.approx(emsid.compensate(motor(), dt=DT).feedforward([1.0, 2.0]))


def test_a_map_of_a_cascade_is_inverted():
    zone = emsid.blocks.DeadZone(-0.4, 0.6, 1.0, 2.0)
    cascade = emsid.Cascade((zone, Rational([0.2], [-0.8])))
    inverse = emsid.compensate(cascade)
    wanted = np.array([-3.0, -0.1, 0.1, 2.0])
    assert zone.value(inverse(wanted)) == pytest.approx(wanted, abs=1e-14)
    outputs, inputs, error = inverse.table(513)
    apart = np.abs(outputs) > 1e-6
    assert np.interp(wanted, outputs[apart], inputs[apart]) == pytest.approx(inverse(wanted), abs=0.02)
    assert error < 1e-9  # a dead zone is straight beside its jump


MAIN = """\
#include <stdio.h>
#include "m_compensation.h"

int main(void)
{
    double v, w, x;
    m_compensation_real totals[2] = {0, 0};
    while (scanf("%lf %lf %lf", &v, &w, &x) == 3) {
        m_compensation_real a = (m_compensation_real)v, b = (m_compensation_real)w, c = (m_compensation_real)x;
        printf("%.17g %.17g %.17g %.17g %.17g\\n", (double)m_dead_zone_inverse(a), (double)m_friction(a, b),
               (double)m_feedforward(a, b, c), (double)m_at_rest(b, a, c), (double)m_integral(totals, b - a, a, b));
    }
    return 0;
}
"""


@needs_gcc
@pytest.mark.parametrize(
    ("widths", "single"), [({"encoder": 2000}, False), ({"zone_width": 0.1, "speed_width": 0.5}, True)]
)
def test_c_gives_the_numbers_of_the_compensation(widths, single, tmp_path):
    model = motor(**STRIBECK, **{"rotor_viscous": 1e-5, "load_torque": 0.001, "drive.gain": 0.5, "drive.knee": 2.0})
    inverse = emsid.compensate(model, dt=DT, **widths)
    files = write(model, inverse, tmp_path, name="m", dt=DT, single=single)
    assert {"m.c", "m.h", "m_compensation.c", "m_compensation.h", "README.md"} <= {path.name for path in files}
    (tmp_path / "main.c").write_text(MAIN)
    sources = [tmp_path / "main.c", tmp_path / "m_compensation.c"]
    subprocess.run(["gcc", *FLAGS, "-o", tmp_path / "main", *sources, "-lm"], check=True)
    rng = np.random.default_rng(1)
    v = np.concatenate([[0.0, 0.0, 0.0], rng.normal(0, 3, 200)])
    w = np.concatenate([[0.0, 1e-3, -1e-3], v[3:] + rng.normal(0, 0.1, 200)])
    text = "\n".join(f"{a!r} {b!r} 0.0" for a, b in zip(v.tolist(), w.tolist(), strict=True))
    done = subprocess.run([tmp_path / "main"], input=text, capture_output=True, text=True, check=True)
    found = np.array([[float(each) for each in line.split()] for line in done.stdout.splitlines()])
    expected = [inverse.dead_zone_inverse(v), inverse.friction_force(v, w), inverse.command(inverse.wanted(v, w))]
    expected.append(inverse.at_rest(w, v, 0.0))
    totals = np.zeros(2)
    expected.append(np.array([inverse.integral(totals, b - a, a, b) for a, b in zip(v, w, strict=True)]))
    assert found == pytest.approx(np.column_stack(expected), abs=1e-4 if single else 1e-12)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (emsid.plants.rigid_motor().with_values({"drive.supply": 12.0, "drive.rise": 0.1}), "coasts"),
        (emsid.plants.rigid_motor().with_values({"drive.supply": 12.0, "drive.freewheel": 1.0}), "coasts"),
        (emsid.Cascade((Rational([0.2], [-0.8]),)), "0 static maps"),
        (emsid.Cascade((emsid.blocks.Polynomial([0.0, 0.0, 1.0], -1.0, 1.0),)), "monotone"),
    ],
)
def test_what_has_no_inverse_says_so(model, message):
    with pytest.raises(emsid.ModelError, match=message):
        emsid.compensate(as_model(model), dt=DT)


def test_bad_arguments_are_refused():
    with pytest.raises(emsid.ModelError, match="smoothing width"):
        emsid.compensate(motor(), dt=DT, zone_width=-1.0)
    with pytest.raises(emsid.ModelError, match="sample time"):
        emsid.compensate(motor())
    with pytest.raises(emsid.DataError, match="reference of shape"):
        emsid.compensate(motor(), dt=DT).feedforward([[1.0]])
    with pytest.raises(emsid.ModelError, match="encoder"):
        emsid.compensate(motor(), dt=DT, encoder=0)
    frictionless = as_model(emsid.plants.rigid_motor().with_values(dict.fromkeys(FRICTION, 0.0)))
    with pytest.raises(emsid.ModelError, match="neither dead zone nor friction"):
        compensated(frictionless, dt=DT)


def test_the_command_writes_c_and_a_figure_and_overwrites_nothing(tmp_path, run):
    model, inverse = tmp_path / "motor.json", tmp_path / "inverse"
    emsid.save(motor(), model)
    status, out, err = run("compensate", model, "--out", inverse, "--dt", "2ms", "--json")
    assert status == 0, err
    runs = [each for each in json.loads(out)["bench"]["runs"] if each["reference"] == "reversal"]
    error = {each["controller"]: each["error"] for each in runs if each["plant"] == "as identified"}
    assert error["cascade without compensation"] > 5 * error["cascade"]
    text = (inverse / "COMPENSATION.md").read_text()
    assert "command = rigid_motor_command(" in text
    assert "| reversal | cascade |" in text
    assert (inverse / "figures/compensation.svg").read_text().startswith("<?xml")
    page = (inverse / "report.html").read_text()
    times = error["cascade without compensation"] / error["cascade"]
    assert f"the error at a reversal is {smaller(times)} with the compensation than without it" in page
    assert page.index('id="compensation"') < page.index('id="inverse"') < page.index('id="bench-sine"')
    status, _, err = run("compensate", model, "--out", inverse, "--dt", "2ms")
    assert (status, "exists" in err) == (2, True)
    status, _, err = run("compensate", model, "--out", tmp_path / "other", "--dt", "2ms", "--limit", "0.5V")
    assert (status, err.count("\n"), "limit of 0.5" in err) == (2, 1, True)
    assert not (tmp_path / "other").exists()


def test_the_command_takes_a_plant_with_neither_friction_nor_dead_zone(tmp_path, run):
    """Nothing of it can be off on the bench, so that one sentence says what the compensation is worth."""
    emsid.save(motor(rotor_viscous=0.0), tmp_path / "motor.json")
    files = "compensate", tmp_path / "motor.json", "--out", tmp_path / "inverse", "--dt", "2ms", "--limit", "6V"
    status, out, err = run(*files)
    assert status == 0, err
    assert "error at a reversal is" in out
    assert "as identified. It is" not in out
