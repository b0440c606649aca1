"""The next experiment: its limits, its information, and that its predicted intervals come true."""

import json

import numpy as np
import pytest

import emsid
from emsid.excitation import SIGNALS
from emsid.experiment_design.information import Sensitivities
from emsid.experiment_design.limits import motion
from emsid.plant import Tachometer

DT, NOISE = 5e-3, 0.2
FREE = (
    "motor_constant",
    "rotor_inertia",
    "rotor_friction.coulomb",
    "rotor_friction.stribeck",
    "rotor_friction.stribeck_rate",
    "voltage_dead_zone.half_width",
)
FRICTION = ("friction.coulomb", "dead_zone.half_width")


def bench(motor, voltage, seed):
    return emsid.Bench(sensor=Tachometer(noise=NOISE)).run(motor, voltage, DT, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def fit():
    """A rigid motor of known resistance, fitted to a sum of sines."""
    plant = emsid.plants.rigid_motor().with_values(
        {
            "rotor_friction.coulomb": 0.02,
            "rotor_friction.stribeck": 0.008,
            "rotor_friction.stribeck_rate": 0.5,
            "voltage_dead_zone.half_width": 0.5,
            "rotor_inertia": 5e-5,
        }
    )
    record = bench(plant.motor, SIGNALS["sines"](1200, DT, 8.0, np.random.default_rng(1)), 1)
    return emsid.fit(plant, record, free=FREE, fixed={"rotor_viscous": plant.value("rotor_viscous")})


@pytest.fixture(scope="module")
def designed(fit):
    return emsid.design(fit, limit=12.0, limit_speed=300.0, duration=20.0, dt=DT, wanted=FRICTION)


def test_the_wanted_intervals_are_at_least_half_those_of_the_best_standard_signal(designed):
    assert designed.wanted == ("rotor_friction.coulomb", "voltage_dead_zone.half_width")
    assert designed.gain > 2.0
    for name in designed.wanted:
        assert all(designed.best.half_widths[name] < each.half_widths[name] for each in designed.standard.values())
    assert set(designed.standard) >= {"multisine", "prbs", "ramp"}


def test_the_information_of_a_linear_model_is_that_of_its_regressors():
    """y(t) = b·u(t − 1): ∂y/∂b = u(t − 1)."""
    record = emsid.Record(np.random.default_rng(1).standard_normal(500), np.zeros(500), dt=0.1)
    y = np.concatenate([[0.0], 0.7 * record.input[:-1, 0]]) + 0.01 * np.random.default_rng(2).standard_normal(500)
    fit = emsid.fit(emsid.arx(na=0, nb=1), emsid.Record(record.input, y, dt=0.1))
    u = np.random.default_rng(3).standard_normal(300)
    of = Sensitivities.of(fit.model, fit.names, fit.standard_error, 0.1, np.array([0.5]))
    found = of.information(u[:, None])[0, 0] / of.scale[0] ** 2
    assert found == pytest.approx(np.sum(u[:-1] ** 2) / 0.25, rel=1e-6)


def test_what_is_predicted_is_what_a_fit_reports(fit, designed):
    record = bench(fit.model.plant.motor, designed.record.input[:, 0], 5)
    known = {"rotor_viscous": fit.model.plant.value("rotor_viscous")}
    again = emsid.fit(fit.model.plant, record, free=fit.names, fixed=known)
    for name, half in designed.best.half_widths.items():
        assert again[name].standard_error * 1.96 == pytest.approx(half, rel=0.15)
        assert abs(again[name].value - fit[name].value) < 2.5 * half


@pytest.mark.long
def test_predicted_intervals_are_those_of_fifty_repeated_fits(fit, designed):
    """The standard deviation of 50 values has a standard error of 10 %, so that 25 % is 2.5 of them."""
    found = []
    for seed in range(50):
        record = bench(fit.model.plant.motor, designed.record.input[:, 0], 100 + seed)
        again = emsid.fit(fit.model.plant, record, free=fit.names)
        found.append([again[name].value for name in fit.names])
    for name, spread in zip(fit.names, np.std(found, axis=0, ddof=1).tolist(), strict=True):
        assert designed.best.half_widths[name] / 1.96 == pytest.approx(spread, rel=0.25)


@pytest.mark.parametrize("criterion", ["a", "d"])
def test_the_signal_stays_within_its_limits(fit, criterion):
    limits = {"limit": 6.0, "limit_slew": 200.0, "limit_speed": 40.0, "limit_travel": 30.0}
    found = emsid.design(fit, duration=4.0, dt=DT, criterion=criterion, **limits)
    command = found.record.input[:, 0]
    assert len(command) == 800
    assert np.abs(command).max() <= 6.0
    assert np.abs(np.diff(command, prepend=0.0)).max() <= 200.0 * DT
    speed, position = motion(fit.model, command[:, None], DT)
    assert 10.0 < np.abs(speed).max() <= 40.0
    assert np.ptp(position) <= 30.0


def test_what_voltage_does_not_separate_is_said_with_what_does(designed):
    (finding,) = [each for each in designed.findings if each.code == "not-separable"]
    assert {"resistance", "rotor_inertia", "rotor_friction.coulomb"} <= set(finding.data["names"])
    assert "current" in finding.data["remedies"]


def test_where_nothing_is_gained_the_standard_signal_is_given(fit, monkeypatch):
    monkeypatch.setattr("emsid.experiment_design.verb.searched", lambda *_: np.full((800, 1), 0.01))
    found = emsid.design(fit, limit=12.0, duration=4.0, dt=DT)
    assert found.best.name in found.standard
    assert found.gain == 1.0
    assert "design-gains-nothing" in [finding.code for finding in found.findings]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"limit": 0.3}, "no signal within these limits"),
        ({"limit": -1.0}, "a limit of -1; give a positive one"),
        ({"limit_travel": 1e-9}, "no signal within these limits"),
        ({"duration": 0.1}, "200 to 1,000,000 samples"),
        ({"wanted": ("friction.stribek",)}, "no estimated parameter"),
        ({"wanted": ("resistance",)}, "not estimated"),
        ({"criterion": "e"}, "there are a, d"),
        ({"noise": 0.0}, "give a positive one"),
        ({"dt": None}, "no sample time of its own"),
    ],
)
def test_what_cannot_be_designed_says_so(fit, options, message):
    with pytest.raises(emsid.EmsidError, match=message):
        emsid.design(fit, **({"limit": 12.0, "duration": 4.0, "dt": DT} | options))


def test_a_model_without_estimates_says_so():
    with pytest.raises(emsid.ModelError, match="has no estimates"):
        emsid.design(emsid.models.plants.grey_box.GreyBox(emsid.plants.rigid_motor(), ()), limit=1.0, duration=4.0)


def test_the_command_writes_a_signal_that_reads_back(fit, tmp_path, run):
    model, out = tmp_path / "motor.json", tmp_path / "next.csv"
    emsid.save(fit, model)
    words = ("design", model, "--limit", "12V", "--duration", "4", "--dt", "5ms", "--out", out)
    status, text, err = run(*words, "--for", "friction.coulomb", "--json")
    assert status == 0, err
    found = json.loads(text)
    assert found["wanted"] == ["rotor_friction.coulomb"]
    page = out.with_suffix(".html").read_text()
    assert f"become {found['gain']:.2f} times narrower than with the best standard signal" in page
    assert page.index('id="signal"') < page.index("<table")
    assert f"{found['half_widths']['design']['rotor_friction.coulomb']:.3g}" in page
    record = emsid.read(out, input="voltage", output=(), time="t")
    assert (len(record), record.dt) == (800, pytest.approx(DT))
    status, _, err = run(*words)
    assert (status, "exists" in err) == (2, True)
    status, _, err = run(
        "design", model, "--limit", "0.3V", "--duration", "4", "--dt", "5ms", "--out", tmp_path / "no.csv"
    )
    assert (status, err.count("\n"), "no signal within" in err) == (2, 1, True)
