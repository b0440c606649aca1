"""`emsid control`: margins by another method, the cascade in C against Python and an integrator of the test's own."""

import json
import shutil
import subprocess
from dataclasses import fields, replace

import numpy as np
import pytest

import emsid
from emsid.controllers.c_source import sources
from emsid.controllers.cascade import RunningCascade, Settings
from emsid.controllers.files import write
from emsid.controllers.loops import Sampled, controller_of, controller_response, step_responses
from emsid.controllers.region import models_of_region, scaled
from emsid.controllers.tuning import fastest, notch_of, observer
from emsid.estimation.fit import Ending, Fit
from emsid.models.verbs import as_model

DT = 1e-3
VALUES = {"rotor_friction.coulomb": 0.02, "voltage_dead_zone.half_width": 0.5}
FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow"]
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


def motor(**values):
    return as_model(emsid.plants.rigid_motor().with_values({**VALUES, **values}))


def fit_of(model, spread=0.03, names=("motor_constant", "rotor_inertia", "rotor_friction.coulomb"), **more):
    """A fit whose estimates are those of a model, with independent errors of this relative size."""
    values = np.array([model.plant.value(name) for name in names])
    covariance = np.diag((spread * values) ** 2)
    return Fit(model, names, values, covariance, 1.0, 1000.0, 1.0, len(names), **more)


@pytest.fixture(scope="module")
def found():
    return emsid.control(motor(), dt=DT, encoder=2000)


def test_margins_and_overshoot_hold_for_every_plant_of_the_region():
    fit = fit_of(motor())
    controller = emsid.control(fit, dt=DT, encoder=2000)
    worst, nominal = controller.margins, controller.nominal_margins
    assert worst.gain >= 2
    assert worst.phase >= 45
    assert worst.sensitivity <= 2
    assert controller.overshoot <= 0.05
    assert worst.phase <= nominal.phase
    assert worst.gain <= nominal.gain
    assert controller.draws == 64
    assert len(controller.plants.mass) == 3 * 65


def test_points_of_the_region_lie_on_its_ellipsoid():
    fit = fit_of(motor(), 0.03)
    points = models_of_region(fit, 1)[1:]
    z = np.array([[model.plant.value(name) for name in fit.names] for model in points]) / fit.estimate - 1
    assert np.sum((z / 0.03) ** 2, axis=1) == pytest.approx(
        7.814728, rel=1e-6
    )  # chi-square, 3 degrees of freedom, 95 %
    again = models_of_region(fit, 1)[1:]
    assert points[5].plant == again[5].plant


def test_a_less_certain_model_gets_a_slower_loop_and_says_so():
    sure, unsure = (emsid.control(fit_of(motor(), spread), dt=DT, encoder=2000) for spread in (0.005, 0.1))
    assert unsure.bandwidth < 0.9 * sure.bandwidth


def test_the_gain_margin_is_where_the_loop_becomes_unstable(found):
    """By the step response of the sampled loop, which shares nothing with the margins but the plant."""

    def grows(factor):
        # only the plant's gain is scaled
        plants = replace(found.plants.nominal, force=factor * found.plants.nominal.force)
        response = step_responses(Sampled.of(plants, DT, found.delay), found.settings, 4000)[:, 0]
        return np.abs(response[-200:] - 1).max() > 0.1

    gain = found.nominal_margins.gain
    assert not grows(0.97 * gain)
    assert grows(1.03 * gain)


def test_the_response_of_the_sampled_plant_is_that_of_the_model():
    """The position after a held command, by the free run of the model without friction."""
    model = motor(**dict.fromkeys(VALUES, 0.0))
    controller = emsid.control(model, dt=DT, encoder=2000, limit=12.0)
    sampled = Sampled.of(controller.plants.nominal, DT, 0.0)
    state, positions = np.zeros(2), []
    u = np.sin(np.arange(300) * 0.1)
    for each in u:
        positions.append(state[0])
        state = sampled.transition[0] @ state + sampled.late[0] * each
    speeds = model.run(model.at_rest(0.0, DT), u[:, None])[0][:, 0]
    assert np.diff(positions) / DT == pytest.approx(0.5 * (speeds[1:] + speeds[:-1]), abs=2e-3 * np.abs(speeds).max())


def test_a_wanted_bandwidth_is_met_or_reduced():
    met = emsid.control(motor(), dt=DT, encoder=2000, bandwidth=5.0)
    assert met.bandwidth == pytest.approx(5.0, rel=0.05)
    assert not met.reduced
    less = emsid.control(motor(), dt=DT, encoder=2000, bandwidth=100.0)
    assert less.reduced
    assert less.bandwidth < 50.0
    assert less.margins.phase >= 45


def test_a_longer_delay_makes_it_slower():
    quick, slow = (emsid.control(motor(), dt=DT, encoder=2000, delay=delay) for delay in (0.0, 5e-3))
    assert slow.bandwidth < 0.6 * quick.bandwidth


def test_the_current_loop_follows_from_resistance_and_inductance():
    model = motor(inductance=2e-3)
    controller = emsid.control(model, dt=DT, encoder=2000)
    s = controller.settings
    values = model.parameter_values()
    assert controller.unit == "A"
    assert s.current_dt == pytest.approx(1e-4)
    assert s.current_integral / s.current_proportional == pytest.approx(values["resistance"] / 2e-3)
    assert controller.current_margins.phase >= 45
    assert controller.current_margins.gain >= 2
    assert emsid.control(model, dt=DT, encoder=2000, current=False).unit == "V"


def test_on_the_bench_the_cascade_tracks_better_than_usual_rules(found):
    errors = {(row["controller"], row["reference"], row["plant"]): row["error"] for row in found.bench.table}
    for plant in ("as identified", "friction × 0.7", "friction × 1.3", "backlash"):
        for rule in ("symmetric optimum", "SIMC", "cascade without compensation"):
            for reference in ("reversal", "sine"):
                assert errors["cascade", reference, plant] < 0.5 * errors[rule, reference, plant]
    assert all(
        row["changes"] == 0
        for row in found.bench.table
        if row["controller"] == "cascade" and row["reference"] == "hold"
    )
    assert all(
        row["overshoot"] < 0.05
        for row in found.bench.table
        if row["controller"] == "cascade" and row["reference"] == "step"
    )


def test_friction_is_scaled_in_all_its_parts():
    model = motor(**{"rotor_viscous": 1e-4, "rotor_friction.stribeck": 0.01, "load_friction.coulomb.backward": 0.02})
    lower = scaled(model, "friction", 0.7).plant
    for name in (
        "rotor_viscous",
        "rotor_friction.stribeck",
        "rotor_friction.coulomb",
        "load_friction.coulomb.backward",
    ):
        assert lower.value(name) == pytest.approx(0.7 * model.plant.value(name))
    for name in ("rotor_friction.stribeck_rate", "rotor_inertia", "motor_constant", "voltage_dead_zone.half_width"):
        assert lower.value(name) == model.plant.value(name)


JOINT = {"rotor_friction.coulomb": 0.005, "rotor_inertia": 2e-4, "gravity.torque": 0.05, "gravity.angle": 0.4}
SHAFT = {"rotor_friction.coulomb": 0.005, "load_inertia": 1e-4, "shaft_stiffness": 3.0}


@pytest.mark.parametrize(
    "model",
    [
        as_model(emsid.plants.joint().with_values(JOINT)),
        as_model(emsid.plants.motor().with_values(SHAFT)),
        motor(**{"rotor_friction.stribeck": 0.01, "rotor_friction.stribeck_rate": 0.5}),
    ],
    ids=["joint under gravity", "elastic shaft", "stribeck"],
)
def test_hold_and_reversal_are_never_worse_than_without_compensation(model):
    bench = replace(emsid.control(model, dt=DT, encoder=2000).bench, names=("cascade", "cascade without compensation"))
    for (name, reference, plant), run in bench.runs.items():
        bare = bench.runs["cascade without compensation", reference, plant]
        if name == "cascade" and reference == "hold":
            assert run.changes == 0
            assert run.error <= max(bare.error, bench.resolution)  # a count is all that the encoder shows
        if name == "cascade" and reference == "reversal":
            assert run.error < bare.error


def test_the_load_of_each_direction_makes_wrong_friction_harmless(found):
    wrong = scaled(motor(), "friction", 1.3)
    fixed = found.bench.run(replace(found.settings, adapt=0.0), "reversal", wrong).error
    assert found.bench.run(found.settings, "reversal", wrong).error < 0.5 * fixed


def test_poles_of_the_observer_are_those_asked_for(found):
    (left, way, faster, further), correction = observer(found.plants, DT, 300.0, 40.0)
    a = np.array([[1.0, way, -further], [0.0, left, -faster], [0.0, 0.0, 1.0]])
    gains = np.array([[correction[0]], [correction[1]], [-correction[2]]])
    poles = np.sort(np.linalg.eigvals(a @ (np.eye(3) - gains @ np.eye(3)[:1])).real)
    assert poles == pytest.approx(np.exp(-DT * np.array([300.0, 300.0, 40.0])), abs=1e-6)


def test_a_notch_filter_is_at_the_mode_of_a_shaft_and_makes_the_loop_faster(monkeypatch):
    shaft = as_model(emsid.plants.motor().with_values({**SHAFT, "shaft_damping": 2e-4}))
    shaft = replace(shaft, signals=(emsid.plants.Signal.ROTOR_SPEED,))  # the encoder is at the motor
    with_notch = emsid.control(shaft, dt=DT, encoder=20000)
    frequency, _ = with_notch.plants.mode
    assert frequency == pytest.approx(np.sqrt(SHAFT["shaft_stiffness"] * (1 / 2e-5 + 1 / SHAFT["load_inertia"])))
    assert with_notch.settings.notch != Settings.notch
    monkeypatch.setattr("emsid.controllers.tuning.NOTCHES", ())
    assert with_notch.bandwidth > 1.2 * emsid.control(shaft, dt=DT, encoder=20000).bandwidth
    filtered = notch_of((500.0, 0.02), 0.7, DT)
    z = np.exp(1j * np.array([1e-6, 500.0]) * DT)
    size = np.abs(np.polyval(filtered[:3], z) / np.polyval((1.0, *filtered[3:]), z))
    assert size[0] == pytest.approx(1.0)
    assert size[1] < 0.06  # about the ratio of the damping ratios, 0.03


def test_the_linear_part_goes_to_python_control(found, tmp_path):
    pytest.importorskip("control")
    system = found.to_control()
    w = np.array([3.0, 40.0, 700.0])
    position, reference = controller_response(w, found.settings)
    for k, expected in ((0, -position), (1, reference)):
        response = [system(np.exp(1j * each * DT))[0, k] for each in w]
        assert response == pytest.approx(expected, rel=1e-9)
    write(found, tmp_path, name="m")
    names = {}
    exec((tmp_path / "m_control.py").read_text(), names)
    assert np.abs(names["m"].A - system.A).max() < 1e-12
    assert names["m"].input_labels == ["position", "wanted", "speed", "acceleration"]


def test_a_running_cascade_is_its_linear_part_where_nothing_is_limited(found):
    bare = replace(found.settings.feedback_only(), prefilter=1.0)
    a, b, c, d = controller_of(bare)
    cascade, state = RunningCascade(bare), np.zeros(len(a))
    for k in range(200):
        row = 1e-4 * np.array([np.sin(0.05 * k), 1 - np.cos(0.1 * k), 0.2, 0.1])
        assert cascade.step(*row.tolist()) == pytest.approx(c @ state + d @ row, abs=1e-12)
        state = a @ state + b @ row


# --- in C ------------------------------------------------------------------------------------------------------------

MAIN = """\
#include <stdio.h>
#include "m_gains.h"

int main(void)
{
    cascade_state state;
    double x, r, v, a, i;
    cascade_reset(&state);
    while (scanf("%lf %lf %lf %lf %lf", &x, &r, &v, &a, &i) == 5) {
        const cascade_real out = cascade_step(&m_gains, &state, (cascade_real)x, (cascade_real)r, (cascade_real)v,
                                              (cascade_real)a);
        const int fast = m_gains.current_dt > (cascade_real)0;
        printf("%.17g %.17g\\n", (double)out,
               fast ? (double)cascade_current(&m_gains, &state, out, (cascade_real)i) : 0.0);
    }
    return 0;
}
"""


@needs_gcc
@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("kind", ["position", "speed", "current"])
def test_c_does_what_python_does(kind, single, found, tmp_path):
    settings = found.settings
    if kind == "speed":
        settings = replace(settings, position=0.0, prefilter=0.3)
    if kind == "current":
        settings = replace(
            settings,
            current_dt=1e-4,
            current_proportional=2.0,
            current_integral=900.0,
            current_limit=0.05,
            zone_width=0.0,
        )
    for name, text in sources(settings, "m", "V", "rad").items():
        (tmp_path / name).write_text(text)
    (tmp_path / "main.c").write_text(MAIN)
    real = [] if single else ["-DCASCADE_REAL=double"]
    files = [tmp_path / "main.c", tmp_path / "cascade.c"]
    subprocess.run(["gcc", *FLAGS, *real, "-o", tmp_path / "main", *files, "-lm"], check=True)
    t = DT * np.arange(1500)
    moving = t < 1.0
    r, v = np.where(moving, 1 - np.cos(2 * np.pi * t), 0.0), np.where(moving, 2 * np.pi * np.sin(2 * np.pi * t), 0.0)
    a = np.where(moving, 4 * np.pi**2 * np.cos(2 * np.pi * t), 0.0)
    x = np.round((r + 0.02 * np.sin(40 * t)) / 0.003) * 0.003
    amps = 0.04 * np.sin(90 * t)
    cascade, expected = RunningCascade(settings), []
    for row in zip(x, r, v, a, amps, strict=True):
        out = cascade.step(*map(float, row[:4]))
        expected.append((out, cascade.current(out, float(row[4])) if kind == "current" else 0.0))
    text = "\n".join(" ".join(f"{float(each)!r}" for each in row) for row in zip(x, r, v, a, amps, strict=True))
    done = subprocess.run([tmp_path / "main"], input=text, capture_output=True, text=True, check=True)
    made = np.array([[float(each) for each in line.split()] for line in done.stdout.splitlines()])
    size = np.abs(expected).max()
    assert np.abs(made - np.array(expected)).max() < (2e-3 if single else 1e-11) * size


LOOP = """\
#include <math.h>
#include <stdio.h>
#include "m_gains.h"

/* A motor without inductance, by Euler steps of 5 us, with friction that sticks where the speed changes its sign. */
int main(void)
{
    const double R = MOTOR_R, K = MOTOR_K, J = MOTOR_J, F = MOTOR_F, ZONE = 0.5, h = 5e-6, res = RESOLUTION;
    cascade_state state;
    double x = 0.0, v = 0.0, late = 0.0, sum = 0.0;
    int k, n, changes = 0, sign = 0;
    cascade_reset(&state);
    for (k = 0; k < 4000; k++) {
        const double t = k * 1e-3, w = 2.0 * 3.141592653589793;
        const int moving = t < 2.0;
        const double r = moving ? 2.0 * (1.0 - cos(w * t)) : 0.0;
        const double rv = moving ? 2.0 * w * sin(w * t) : 0.0;
        const double ra = moving ? 2.0 * w * w * cos(w * t) : 0.0;
        const double u = late;
        const int now = u > 0 ? 1 : -1;
        const float shown = (float)(floor(x / res + 0.5) * res);
        late = (double)cascade_step(&m_gains, &state, shown, (float)r, (float)rv, (float)ra);
        sum += moving ? (r - x) * (r - x) / 2000.0 : 0.0;
        for (n = 0; n < 200; n++) {
            const double volts = u > ZONE ? u - ZONE : (u < -ZONE ? u + ZONE : 0.0);
            const double torque = K / R * (volts - K * v);
            const double way = v > 0 ? 1.0 : (v < 0 ? -1.0 : (torque > 0 ? 1.0 : -1.0));
            if (v != 0.0 || fabs(torque) > F) {
                const double after = v + h * (torque - F * way) / J;
                v = after * way < 0 ? 0.0 : after;
            }
            x += h * v;
        }
        if (k > 3000) {
            changes += sign != 0 && now != sign;
            sign = now;
        }
    }
    printf("%.9g %.9g %d\\n", sqrt(sum), x, changes);
    return 0;
}
"""


def error_in_python(found):
    """The same loop with the controller in Python and the program's own plant."""
    t = DT * np.arange(2000)
    w = 2 * np.pi
    reference = 2 * (1 - np.cos(w * t)), 2 * w * np.sin(w * t), 2 * w * w * np.cos(w * t)
    sampler, cascade = emsid.start(motor(), dt=DT).sampler, found.start()
    late, errors, y = 0.0, [], np.empty(1)
    for row in zip(*reference, strict=True):
        position, u = sampler.motion[1], late
        errors.append(row[0] - position)
        late = cascade.step(np.floor(position / found.resolution + 0.5) * found.resolution, *map(float, row))
        sampler.advance(np.array([u]), y)
    return np.sqrt(np.mean(np.square(errors)))


@needs_gcc
def test_the_c_file_controls_an_independent_simulation_of_the_motor(found, tmp_path):
    write(found, tmp_path, name="m")
    values = as_model(motor()).parameter_values()
    define = {"R": values["resistance"], "K": values["motor_constant"], "J": values["rotor_inertia"], "F": 0.02}
    define["J"] += values.get("load_inertia", 0.0)
    text = LOOP.replace("RESOLUTION", repr(found.resolution))
    for name, value in define.items():
        text = text.replace(f"MOTOR_{name}", repr(value))
    (tmp_path / "loop.c").write_text(text)
    files = [tmp_path / "loop.c", tmp_path / "cascade.c"]
    subprocess.run(["gcc", *FLAGS, "-o", tmp_path / "loop", *files, "-lm"], check=True)
    done = subprocess.run([tmp_path / "loop"], capture_output=True, text=True, check=True)
    error, rest, changes = map(float, done.stdout.split())
    assert error == pytest.approx(error_in_python(found), rel=0.02)
    assert error < 2 * found.resolution
    assert abs(rest) <= 1.5 * found.resolution
    assert changes == 0


def test_every_setting_is_in_the_c_struct(found):
    texts = sources(found.settings, "m", "V", "rad")
    for each in fields(Settings):
        assert f" {each.name};" in texts["cascade.h"] or f" {each.name}[" in texts["cascade.h"]
        assert f".{each.name} = " in texts["m_gains.h"]
    assert "malloc" not in texts["cascade.c"]


# --- firmware --------------------------------------------------------------------------------------------------------


def test_gains_of_firmware_are_those_of_the_cascade_in_its_units():
    model = motor(inductance=2e-3)
    controller = emsid.control(model, dt=DT, encoder=2000, pole_pairs=7, current_max=20.0)
    base, constant = replace(controller.settings, adapt=0.0), model.parameter_values()["motor_constant"]
    s = fastest(controller.plants, base, controller.delay, 0.05, observer=False).settings  # firmware has no observer
    tables = {name: {row: value for row, value, _ in rows} for name, rows in controller.firmware.items()}
    assert tables["ODrive"]["controller.config.vel_gain"] == pytest.approx(2 * np.pi * constant * s.proportional)
    assert tables["ODrive"]["controller.config.pos_gain"] == s.position
    # 1 rad/s more: error in electrical rpm, times kp/20, times the largest current
    erpm = 7 * 60 / (2 * np.pi)
    assert erpm * tables["VESC"]["s_pid_kp"] / 20 * 20.0 == pytest.approx(s.proportional)
    assert tables["SimpleFOC"]["PID_velocity.P"] == s.proportional
    volts = emsid.control(model, dt=DT, encoder=2000, current=False)
    wpilib = {row: value for row, value, _ in volts.firmware["WPILib"]}
    values = model.parameter_values()
    ratio = values["resistance"] / constant
    assert wpilib["kS forward"] == pytest.approx(0.5 + ratio * 0.02)
    assert wpilib["kV"] == pytest.approx(2 * np.pi * (constant + ratio * values["rotor_viscous"]), rel=1e-6)


# --- refusals, files -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "options", "message"),
    [
        (motor(), {"bandwidth": 600.0}, "half the sampling frequency"),
        (motor(), {"bandwidth": -1.0}, "positive"),
        (motor(), {"overshoot": 0.0}, "overshoot"),
        (motor(), {"loop": "torque"}, "position or speed"),
        (motor(), {"current": True}, "inductance"),
        (motor(), {"delay": 1.0}, "100 sample times"),
        (motor(), {"limit": 0.4}, "below"),
        (fit_of(motor(), ending=Ending.STALLED), {}, "before a minimum"),
        (fit_of(motor(), np.array([0.1, np.inf, 0.1])), {}, "do not determine rotor_inertia"),
        (emsid.RegressionModel(emsid.Structure.parse("y(t-1)", "u(t-1)"), np.array([0.5, 2.0]), dt=DT), {}, "inertia"),
    ],
)
def test_bad_input_is_refused(model, options, message):
    with pytest.raises(emsid.ModelError, match=message):
        emsid.control(model, dt=DT, **options)


def test_the_command_writes_everything_or_nothing(tmp_path, run):
    model, out = tmp_path / "motor.json", tmp_path / "drive"
    emsid.save(motor(), model)
    status, printed, err = run(
        "control", model, "--out", out, "--sample", "1ms", "--encoder", "2000", "--bandwidth", "5Hz"
    )
    assert status == 0, err
    assert "gain margin" in printed
    names = {
        "cascade.h",
        "cascade.c",
        "rigid_motor_gains.h",
        "rigid_motor.ino",
        "rigid_motor_control.py",
        "CONTROL.md",
        "control.json",
        "report.html",
    }
    assert {path.name for path in out.iterdir()} == names
    data = json.loads((out / "control.json").read_text())
    assert data["margins"]["phase"] >= 45
    assert len(data["bench"]["runs"]) == 5 * 4 * 4
    status, _, err = run("control", model, "--out", out, "--sample", "1ms")
    assert (status, "exists" in err) == (2, True)
    for wrong in (["--bandwidth", "2kHz"], ["--overshoot", "200%"], ["--current"]):
        status, _, err = run("control", model, "--out", tmp_path / "other", "--sample", "1ms", *wrong)
        assert (status, err.count("\n")) == (2, 1), err
    assert not (tmp_path / "other").exists()
