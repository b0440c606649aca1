"""Brushless motors, against a drive whose phases are simulated, with switched edges or the mean of its inverter."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid.errors import DataError, ModelError
from emsid.exports.firmware import crossover
from emsid.models.plants.brushless import _mean_side
from emsid.models.plants.park import transformed
from emsid.plants import Brushless, Harmonic, Hold, Signal
from independent.switched_drive import NONE, Drive, Log, driven, logged
from model_examples import DT
from test_export_c import in_c

DRIVE = Drive(switched=False)
LOCKED = {"flux": 5e-3, "inertia": 8e-5, "viscous_friction": 0.0, "friction.coulomb": 10.0}
SIGNALS = (Signal.D_CURRENT, Signal.Q_CURRENT, Signal.SPEED)
COUNTED = {
    "resistance": DRIVE.resistance,
    "inductance_d": DRIVE.inductance_d,
    "inductance_q": DRIVE.inductance_q,
    "flux": DRIVE.flux,
    "inertia": DRIVE.inertia,
    "friction.coulomb": DRIVE.coulomb,
}


def plant_of(drive: Drive) -> Brushless:
    """The same drive as a plant."""
    return emsid.plants.brushless(
        resistance=drive.resistance,
        inductance_d=drive.inductance_d,
        inductance_q=drive.inductance_q,
        flux=drive.flux,
        pole_pairs=drive.pairs,
        inertia=drive.inertia,
        viscous_friction=drive.viscous,
        friction=emsid.Friction(drive.coulomb),
        cogging=tuple(Harmonic(int(n), c, s) for n, c, s in drive.cogging if n),
        torque_ripple=tuple(Harmonic(int(n), c, s) for n, c, s in drive.ripple if n),
        delay=drive.period,
        advance=drive.advance * drive.period,
        dead_time_voltage=drive.dead,
        held_in="stator",
        heating=1 / drive.capacity,
        cooling=drive.conductance / drive.capacity,
        winding_drift=drive.drift,
    )


def simulated(plant: Brushless, log: Log, record: emsid.Record) -> np.ndarray:
    """The free run of a plant with the true voltages before the log."""
    plant = plant.for_command(record)
    first = plant.first_state(SIGNALS, record)
    first[5:] = log.before
    return plant.simulate(record.input, record.dt, first, SIGNALS)


@pytest.mark.parametrize(
    "drive",
    [
        DRIVE,
        DRIVE._replace(advance=0.0),
        DRIVE._replace(cogging=((42.0, 4e-3, -3e-3),), ripple=((42.0, 0.02, 0.04),)),
        DRIVE._replace(capacity=2.0, conductance=0.5),
        DRIVE._replace(drift=1.0),
    ],
    ids=["dead time", "angle not advanced", "ripple", "warming", "drift"],
)
def test_a_plant_follows_a_drive_that_is_simulated_in_the_stator(drive: Drive) -> None:
    log = driven(drive, 3, 0.2, noisy=False)
    record = log.record()
    error = (simulated(replace(plant_of(drive), steps=8), log, record) - record.output).std(axis=0)
    assert np.all(error < [5e-3, 5e-3, 0.02]), error  # of 12 A and 100 rad/s
    other = plant_of(drive._replace(dead_time=0.0, cogging=(NONE,), capacity=1e9, drift=0.0))
    assert np.any((simulated(other, log, record) - record.output).std(axis=0) > [0.1, 0.1, 0.3])


def test_halving_the_step_of_a_drive_without_dead_time_quarters_the_error() -> None:
    drive = DRIVE._replace(dead_time=0.0)
    log = driven(drive, 3, 0.1, noisy=False)
    record = log.record()
    runs = [simulated(replace(plant_of(drive), steps=steps), log, record)[:, 0] for steps in (4, 8, 16)]
    assert np.std(runs[0] - runs[1]) > 3 * np.std(runs[1] - runs[2]) > 0


def test_a_constant_load_acts_once() -> None:
    plant = emsid.plants.brushless(flux=0.0, load_torque=0.01, inertia=1e-4, friction=emsid.Friction(0.0))
    speed = plant.simulate(np.zeros((1000, 2)), 1e-4, np.zeros(7), (Signal.SPEED,))[:, 0]
    assert speed == pytest.approx(-0.01 / 1e-4 * 1e-4 * np.arange(1000))


def test_a_fit_finds_the_constants_of_a_drive() -> None:
    plant = replace(emsid.plants.brushless(delay=1e-4, advance=1.5e-4, held_in="stator"), dead_time_voltage=0.05)
    fit = emsid.fit(plant, driven(DRIVE, 1, 0.4).record())
    for name, truth in COUNTED.items():
        assert abs(fit[name].value - truth) < 4 * fit[name].standard_error
        assert fit[name].standard_error < 0.02 * truth
    assert fit["dead_time_voltage"].value == pytest.approx(DRIVE.dead, rel=0.03)


def followed(speed: np.ndarray, rate: float, dt: float) -> np.ndarray:
    """(N,) the speed as a critically damped phase-locked loop of the angle has it, 1/(1 + s/rate)²."""
    keeps = np.exp(-rate * dt)
    return lfilter([(1 - keeps) ** 2], [1.0, -2 * keeps, keeps**2], speed - speed[0]) + speed[0]


def test_a_fit_finds_the_filter_of_a_speed_and_takes_none_where_there_is_none() -> None:
    record, lag = driven(DRIVE, 5, 0.4).record(), 2.0 / 1000.0
    late = record.output.copy()
    late[:, 2] = followed(late[:, 2], 1000.0, record.dt)
    filtered = replace(record, output=late)
    fit = emsid.identify(filtered, models="brushless", fixed={"pole_pairs": DRIVE.pairs}).recommended_fit
    assert fit["sensor_lag"].value == pytest.approx(lag, rel=0.1)
    for name, true in COUNTED.items():
        low, high = fit[name].interval
        assert low - (high - low) / 2 < true < high + (high - low) / 2, name
    motor = replace(fit.model.plant, sensor_lag=0.0)
    asked = emsid.plants.simulation_error(motor, filtered, free=["inertia", "sensor_lag"])
    assert asked["sensor_lag"].value == pytest.approx(lag, rel=0.1)
    direct = emsid.identify(record, models="brushless", fixed={"pole_pairs": DRIVE.pairs}).recommended_fit
    assert "sensor_lag" not in direct.parameters


def test_dead_time_with_the_ripple_of_a_switched_inverter_leaves_resistance_and_its_voltage_right() -> None:
    """With U_t·i/√(i² + i_t²), the resistance of this record was 4.0 standard errors off, and U_t by 1.9 %."""
    drive = Drive()
    plant = emsid.plants.brushless(delay=drive.period, advance=drive.advance * drive.period, held_in="stator")
    plant = replace(plant, dead_time_voltage=0.05, dead_time_current=0.3)
    record = driven(drive, 5104, 0.4).record()
    fit = emsid.fit(plant, record, free=[*plant.default_free, "dead_time_current"])
    assert abs(fit["resistance"].value - drive.resistance) < 2.5 * fit["resistance"].standard_error
    assert fit["dead_time_voltage"].value == pytest.approx(drive.dead, rel=0.007)


@pytest.mark.parametrize("ripple", [0.0, 0.2])
def test_a_current_stays_where_dead_time_takes_more_than_the_voltage(ripple: float) -> None:
    assert all(_mean_side(ripple, ripple + part, 0.1, ripple) == pytest.approx(part / 0.1) for part in (0.03, 0.09))
    for i, free in ((0.5, 0.1), (0.25, -0.5), (-0.3, 0.4), (0.05, 0.6), (0.4, 0.35)):
        mean = _mean_side(i, free, 0.3, ripple)
        j = free - 0.3 * mean
        points = np.linspace(i, j, 100_001)
        losses = 0.5 * (np.sign(points - ripple) + np.sign(points + ripple))
        assert abs(losses.mean() - mean) < 1e-4
        assert mean == pytest.approx((max(abs(j), ripple) - max(abs(i), ripple)) / (j - i), abs=1e-12)


def test_blocks_samples_files_and_c_give_the_numbers_of_one_run(tmp_path: Path) -> None:
    drive = DRIVE._replace(cogging=((42.0, 0.0, -3e-3),), ripple=((42.0, 0.02, 0.04),), capacity=2.0, conductance=0.5)
    record = driven(drive, 0, 0.02).record()
    model = emsid.plants.GreyBox(replace(plant_of(drive), delay=1.5e-4).for_command(record), SIGNALS)
    assert emsid.plants.GreyBox.from_data(model.to_data()).plant == model.plant
    whole, _ = model.run(model.at_rest(0.0, DT), record.input)
    head, state = model.run(model.at_rest(0.0, DT), record.input[:77])
    assert np.array_equal(np.concatenate([head, model.run(state, record.input[77:])[0]]), whole)
    if shutil.which("gcc"):
        assert np.max(np.abs(in_c(model, record.input, tmp_path) - whole)) < 1e-9


def test_inputs_are_read_by_their_number_and_units() -> None:
    n = 400
    rng = np.random.default_rng(0)
    v, angle, warm = np.repeat(rng.normal(0, 1, n // 20), 20), np.zeros(n), np.full(n, 60.0)

    def motor(units: tuple[str, ...], *columns: np.ndarray) -> Brushless:
        record = emsid.Record(np.column_stack(columns), v, dt=1e-4, input_units=units, output_units=("A",))
        return emsid.plants.brushless().for_command(record)

    assert motor(("V",), v).roles == ("v_q",)
    assert motor(("V", "V", "rad"), v, v, angle).roles == ("v_d", "v_q", "angle")
    assert motor(("V", "V", "degC"), v, v, warm).roles == ("v_d", "v_q", "temperature")
    with pytest.raises(DataError, match="takes v_d and v_q"):
        motor(("A", "V"), v, v)
    duty = motor(("1", "V"), v / 24, np.full(n, 24.0))
    by_duty = duty.simulate(np.column_stack([v / 24, np.full(n, 24.0)]), 1e-4, np.zeros(7), (Signal.Q_CURRENT,))
    by_volts = motor(("V",), v).simulate(v[:, None] / np.sqrt(3), 1e-4, np.zeros(7), (Signal.Q_CURRENT,))
    assert by_duty == pytest.approx(by_volts)
    hot = motor(("V", "degC"), v, warm).simulate(np.column_stack([v, warm]), 1e-4, np.zeros(7), (Signal.Q_CURRENT,))
    cold = replace(motor(("V",), v), resistance=0.1 * (1 + 0.00393 * 40))
    assert hot == pytest.approx(cold.simulate(v[:, None], 1e-4, np.zeros(7), (Signal.Q_CURRENT,)))


def test_currents_are_told_apart_by_their_names() -> None:
    plant = emsid.plants.brushless()
    named = {name: plant.signal_of(name, "A") for name in ("i_d", "Iq_measured", "foc.Id", "d_A", "current")}
    assert [*named.values()] == [
        Signal.D_CURRENT,
        Signal.Q_CURRENT,
        Signal.D_CURRENT,
        Signal.D_CURRENT,
        Signal.Q_CURRENT,
    ]


def test_a_straight_voltage_is_between_its_samples() -> None:
    plant = replace(emsid.plants.brushless(), between=Hold.FIRST)
    t = 1e-4 * np.arange(300)
    exact = replace(plant, steps=200).simulate(np.sin(300 * t)[:, None] * [1, 0], 1e-4, np.zeros(7), SIGNALS)
    found = plant.simulate(np.sin(300 * t)[:, None] * [1, 0], 1e-4, np.zeros(7), SIGNALS)
    fine = np.arange(0, t[-1], 1e-6)
    held = replace(plant, between=Hold.ZERO).simulate(
        np.sin(300 * (fine + 5e-7))[:, None] * [1, 0], 1e-6, np.zeros(7), SIGNALS
    )
    assert found[:, 0] == pytest.approx(exact[:, 0], abs=1e-3)
    assert exact[:290, 0] == pytest.approx(held[::100, 0][:290], abs=2e-3)


@pytest.mark.parametrize("wrong", [{"resistance": 0.0}, {"inputs": "abc"}, {"held_in": "air"}, {"flux": np.nan}])
def test_values_without_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ModelError):
        emsid.plants.brushless(**wrong)


def phases(log: Log, offset: float = 0.0, sign: float = 1.0) -> emsid.Record:
    """Phase currents and the angle of the shaft as a drive logs them that does not know its axes."""
    at = DRIVE.pairs * log.angle[:, None] - 2 * np.pi / 3 * np.arange(3)
    abc = log.i_d[:, None] * np.cos(at) - log.i_q[:, None] * np.sin(at)
    return emsid.Record(
        np.column_stack([log.v_d, log.v_q]),
        np.column_stack([abc, np.mod(sign * log.angle + offset, 2 * np.pi), log.speed]),
        dt=log.period,
        input_names=("v_d", "v_q"),
        input_units=("V", "V"),
        output_names=("ia", "ib", "ic", "theta", "speed"),
        output_units=("A", "A", "A", "rad", "rad/s"),
        name="phases",
    )


def test_phases_become_axes_in_the_convention_that_is_said_and_another_one_is_noticed() -> None:
    n = 2000
    log = logged(DRIVE, np.full(n, 4.0), np.zeros(n), np.full(n, 150.0), 0, added=0.0)
    record = phases(log)
    found = emsid.plants.park(record, {"i": ("ia", "ib", "ic")}, "theta", 7)
    assert found.output_names == ("i_d", "i_q", "theta", "speed")
    assert found.output[:, :2] == pytest.approx(np.column_stack([log.i_d, log.i_q]), abs=1e-9)
    assert np.ptp(found.output[:, 2] - log.angle) < 1e-9  # unwrapped
    two = emsid.plants.park(record, {"i": ("ia", "ib")}, "theta", 7, power_invariant=True)
    assert two.output_names == ("i_d", "i_q", "ic", "theta", "speed")
    assert two.output[:, :2] == pytest.approx(np.sqrt(1.5) * found.output[:, :2], abs=1e-9)
    turned = emsid.plants.park(phases(log, offset=0.1), {"i": ("ia", "ib", "ic")}, "theta", 7, offset=0.7)
    assert turned.output[:, :2] == pytest.approx(found.output[:, :2], abs=1e-9)
    for wrong, how in ((phases(log), {"electrical": True}), (phases(log, sign=-1.0), {})):
        with pytest.raises(DataError, match="7 times" + " backward" * (not how)):
            emsid.plants.park(wrong, {"i": ("ia", "ib", "ic")}, "theta", 7, **how)
    with pytest.raises(DataError, match="no channel 'ix'"):
        emsid.plants.park(record, {"i": ("ia", "ix")}, "theta", 7)


def checked(pairs: int, seed: int, given: int, letter: str, seconds: float = 0.6, **how: float) -> bool | None:
    """Whether a number of pole pairs passes the check of a drive that turns: None where the data do not show it."""
    rng = np.random.default_rng(seed)
    drive = DRIVE._replace(pairs=float(pairs), flux=0.035 / pairs, inertia=8e-5 * rng.uniform(0.5, 3.0), **how)
    n = round(seconds / drive.period)
    top = 60.0 * rng.choice([-1.0, 1.0])
    speed = np.repeat(rng.uniform(0.3, 1.0, 6) * top, -(-n // 6))[:n] if seconds > 0.1 else np.zeros(n)
    log = logged(drive, np.zeros(n), np.zeros(n), speed, seed, added=0.2)
    at = pairs * log.angle[:, None] - 2 * np.pi / 3 * np.arange(3)
    measured = {
        "i": np.column_stack([log.i_a, log.i_b]),
        "v": log.v_d[:, None] * np.cos(at) - log.v_q[:, None] * np.sin(at),
    }
    try:
        return not transformed("log", {letter: measured[letter]}, log.angle, given)[2] or None
    except DataError:
        return False


@pytest.mark.parametrize("pairs", [1, 2, 3, 4, 5, 7, 8, 11, 14, 20])
def test_wrong_pole_pairs_are_noticed_and_right_ones_never_refused(pairs: int) -> None:
    assert all(checked(pairs, 40 + pairs, pairs, letter) is not False for letter in "iv")
    assert checked(pairs, 40 + pairs, pairs, "v") is True
    for wrong in (pairs + 1, pairs - 1 or 3, 2 * pairs):
        assert checked(pairs, 40 + pairs, wrong, "v") is False


def test_pole_pairs_are_not_refused_by_the_torque_of_gravity() -> None:
    for n in (1, 2, 5):
        weight = ((float(n), 0.08, 0.05),)  # five times friction
        assert checked(5, n, 5, "i", 1.5, cogging=weight) is not False
        assert checked(5, n, 5, "v", 1.5, cogging=weight) is True
        assert checked(5, n, 6, "v", 1.5, cogging=weight) is False


def test_at_standstill_pole_pairs_are_not_checked_and_that_is_said() -> None:
    assert checked(7, 3, 6, "v", 0.1) is None
    n = 500
    record = phases(logged(DRIVE, np.full(n, 4.0), np.full(n, 3.0), np.full(n, np.nan), 0, locked=True))
    (found,) = emsid.plants.park(record, {"i": ("ia", "ib", "ic")}, "theta", 6).findings
    assert (found.code, found.data["given"]) == ("axes-unchecked", 6)
    assert found.data["turns"] < 0.01


def test_phases_of_a_file_become_columns_of_the_axes(tmp_path: Path) -> None:
    log = driven(DRIVE, 2, 0.1)
    at = DRIVE.pairs * log.angle[:, None] - 2 * np.pi / 3 * np.arange(3)
    table = {f"v{name}": log.v_d * np.cos(phi) - log.v_q * np.sin(phi) for name, phi in zip("abc", at.T, strict=True)}
    table |= {
        f"i{name}": log.i_d * np.cos(phi) - log.i_q * np.sin(phi) for name, phi in zip("ab", at.T[:2], strict=True)
    }
    table |= {"theta": np.rad2deg(np.mod(log.angle, 2 * np.pi)), "erpm": log.speed * DRIVE.pairs * 60 / (2 * np.pi)}
    given = {
        "input": ["v_d", "v_q", "rotor"], "output": ["i_d", "i_q", "erpm"], "dt": log.period, "rotor_angle": "theta",
        "phases": {"v": "va,vb,vc", "i": "ia,ib"}, "units": {"va": "V", "ia": "A", "theta": "deg", "erpm": "erpm"},
    }  # fmt: skip
    record = emsid.read(table, **given, pole_pairs=7)
    assert record.input[:, :2] == pytest.approx(np.column_stack([log.v_d, log.v_q]), abs=1e-9)
    assert record.output == pytest.approx(np.column_stack([log.i_d, log.i_q, log.speed]), abs=1e-9)
    assert np.ptp(record.input[:, 2] - log.angle) < 1e-9
    assert (record.input_units, record.output_units) == (("V", "V", "rad"), ("A", "A", "rad/s"))
    wrong: tuple[tuple[dict[str, object], str], ...] = (
        ({"pole_pairs": 7, "electrical_angle": True}, "7 times in a turn of the angle, not 1 time"),
        ({}, "number of pole pairs"),
        ({"pole_pairs": 7, "phases": {"v": "va"}}, "two or three columns"),
        ({"pole_pairs": 7, "rotor_angle": "nothing"}, "nothing"),
    )
    for more, message in wrong:
        with pytest.raises(DataError, match=message):
            emsid.read(table, **given | more)


def test_the_frame_and_the_delay_of_an_inverter_are_found() -> None:
    fit = emsid.fit(emsid.plants.brushless(), driven(DRIVE, 4, 0.3).record())
    plant = fit.model.plant
    assert (plant.held_in, plant.delay, plant.advance) == ("stator", DRIVE.period, DRIVE.advance * DRIVE.period)


def test_a_log_with_the_rotor_held_shows_the_winding_and_says_what_it_does_not_show() -> None:
    rng, n = np.random.default_rng(5), 1500
    wanted = np.repeat(rng.uniform(-6, 6, (n // 100, 2)), 100, axis=0)
    log = logged(DRIVE, wanted[:, 0], wanted[:, 1], np.full(n, np.nan), 3, locked=True)
    fit = emsid.fit(emsid.plants.brushless(), log.record("i_d i_q"))
    for name in ("resistance", "inductance_d", "inductance_q"):
        assert fit[name].value == pytest.approx(getattr(DRIVE, name), rel=0.01)
    rows = {row.name: row for row in fit.table}
    assert all(rows[name].status is emsid.plants.Status.KEPT for name in ("flux", "inertia"))
    said = [each.data["parameters"] for each in fit.findings if each.code == "not-identifiable"]
    assert {"flux", "inertia"} <= {name for some in said for name in some}


def test_a_log_whose_voltages_change_between_rows_says_what_it_does_not_show() -> None:
    plant = emsid.plants.brushless(delay=DRIVE.period, advance=DRIVE.advance * DRIVE.period, held_in="stator")
    log = driven(DRIVE, 6, 0.8)
    fit = emsid.fit(plant, log.record(every=10))
    (said,) = (each for each in fit.findings if each.code == "input-between-rows-unknown")
    assert {"resistance", "inductance_d", "inductance_q"} <= {*said.data["parameters"]}
    assert said.data["ratio"] > 1.1
    for name in said.data["parameters"]:
        assert fit[name].interval is None
        assert fit[name].standard_error is None
    whole = emsid.fit(plant, log.record()[:3000])
    assert "input-between-rows-unknown" not in {each.code for each in whole.findings}
    assert whole["resistance"].interval is not None


def constants(text: str) -> dict[str, float]:
    """The numbers of an export, by the word before them."""
    return {name: float(value) for name, value in re.findall(r"([\w.]+)(?:: | = | )(-?\d[\d.e-]*)", text)}


def test_firmware_has_the_constants_in_its_own_conventions(tmp_path: Path) -> None:
    model = emsid.plants.GreyBox(plant_of(DRIVE), SIGNALS)
    written: dict[str, dict[str, float]] = {}
    for firmware in ("odrive", "vesc", "moteus", "simplefoc"):
        emsid.export(model, firmware, tmp_path / firmware, name="m", dt=1e-4, bandwidth=600)
        readme = next((tmp_path / firmware).glob("*.md")).read_text()
        assert not {"temperature_coefficient", "drift_end"} & {*re.findall(r"\w+", readme)}
        (file,) = (each for each in (tmp_path / firmware).iterdir() if each.name.startswith("m_"))
        written[firmware] = constants(file.read_text())
    mean, torque = 0.5 * (DRIVE.inductance_d + DRIVE.inductance_q), 1.5 * DRIVE.pairs * DRIVE.flux
    odrive = {name.rpartition(".")[2]: value for name, value in written["odrive"].items()}
    assert odrive["torque_constant"] == pytest.approx(torque)
    assert odrive["phase_inductance"] == pytest.approx(mean)
    vesc = written["vesc"]
    assert (vesc["foc_motor_r"], vesc["foc_motor_flux_linkage"]) == (DRIVE.resistance, DRIVE.flux)
    assert vesc["foc_motor_l"] - 0.5 * vesc["foc_motor_ld_lq_diff"] == pytest.approx(DRIVE.inductance_d)
    moteus = written["moteus"]
    assert moteus["motor.poles"] == 14
    assert 1.5 / np.sqrt(3) * 60 / (2 * np.pi) / moteus["motor.Kv"] == pytest.approx(torque)  # as in fw/bldc_servo.cc
    beta = crossover(600, 1.5 * DRIVE.period)
    assert odrive["current_control_bandwidth"] == pytest.approx(beta)
    assert moteus["servo.pid_dq.ki"] == pytest.approx(beta * DRIVE.resistance)
    assert written["simplefoc"]["motor.PID_current_q.P"] == pytest.approx(beta * DRIVE.inductance_q, rel=1e-5)


@pytest.mark.parametrize("bandwidth", [500.0, 1000.0, 2000.0])
@pytest.mark.parametrize("axis", ["d", "q"])
def test_the_gains_of_the_current_loop_have_the_bandwidth_that_was_asked_for(bandwidth: float, axis: str) -> None:
    """A sine of the reference comes out at 71 % at the bandwidth, within 10 % of its frequency, at 10 kHz."""
    model = emsid.plants.GreyBox(plant_of(DRIVE), SIGNALS)
    found = emsid.controllers.current_control(model, bandwidth=bandwidth / (2 * np.pi))
    assert not found.reduced
    assert found.dt == 1e-4
    drive = Drive(proportional=found.proportional[axis == "q"], integral=found.integral)
    lower, upper = (answered(drive, axis, part * bandwidth) for part in (0.9, 1.1))
    assert lower > np.sqrt(0.5) > upper


def answered(drive: Drive, axis: str, frequency: float) -> float:
    """The amplitude of the current about 8 A over that of a sine of 2 A of its reference, with the rotor held."""
    n = 4000
    t = drive.period * np.arange(n)
    wanted = {"d": np.zeros(n), "q": np.zeros(n)} | {axis: 8.0 + 2.0 * np.sin(frequency * t)}
    log = logged(drive, wanted["d"], wanted["q"], np.full(n, np.nan), 0, added=0.0, locked=True, noisy=False)
    waves = np.column_stack([np.sin(frequency * t), np.cos(frequency * t), np.ones(n)])[1000:]
    current = (log.i_d if axis == "d" else log.i_q)[1000:]
    return float(np.hypot(*np.linalg.lstsq(waves, current, rcond=None)[0][:2]) / 2.0)


def test_a_bandwidth_that_the_margins_do_not_allow_is_reduced() -> None:
    model = emsid.plants.GreyBox(plant_of(DRIVE), SIGNALS)
    found = emsid.controllers.current_control(model, bandwidth=2000.0)
    assert found.reduced
    assert found.margins.gain >= 2
    assert found.margins.phase >= 45
    assert found.bandwidth == pytest.approx(emsid.controllers.current_control(model).bandwidth, rel=1e-2)
    with pytest.raises(ModelError, match="no current loop of its own"):
        emsid.controllers.current_control(emsid.plants.rigid_motor())


def test_a_motor_begins_as_a_run_has_left_it() -> None:
    plant = emsid.plants.brushless(heating=50.0, cooling=0.1, winding_drift=0.1, drift_end=0.2, winding_rise=0.05)
    u, dt = np.tile([0.0, 0.5], (500, 1)), 1e-4
    first = plant.first_state(SIGNALS, emsid.Record(u, np.zeros((500, 3)), dt))
    begun = plant.start(first, u[0], dt, SIGNALS)
    end = plant.run(begun, u, SIGNALS)[1]
    assert (plant.rise_in(begun), plant.begins_risen) == (0.05, 0.05)
    assert plant.rise_in(end) > 0.055
    left = plant.as_left(end)
    assert left.begins_risen == left.value("drift_end") == plant.rise_in(end)
    again = emsid.plants.GreyBox.from_data(emsid.plants.GreyBox(left, SIGNALS).to_data()).plant
    assert again == left
    constants = [
        {each.name: each.value for each in some.quantities()} for some in (left, replace(left, winding_rise=0))
    ]
    name = "electrical time constant"
    assert constants[0][name] * (1 + left.begins_risen) == pytest.approx(constants[1][name])
    assert "dρ/dt = α·h·3/2·R_s" in left.equations()


@pytest.mark.parametrize(
    ("change", "names"),
    [({"capacity": 0.015}, {"heating"}), ({"drift": 0.6}, {"winding_drift"}), ({}, set())],
    ids=["heating", "drift", "neither"],
)
def test_a_search_finds_what_changes_the_resistance(change: dict[str, float], names: set[str]) -> None:
    rng, n = np.random.default_rng(11), 1500
    wanted = np.repeat(rng.uniform(-6, 6, (n // 50, 2)), 50, axis=0)
    wanted[: n // 2] *= 0.4
    drive = DRIVE._replace(dead_time=0.0, **change)
    log = logged(drive, *wanted.T, np.full(n, np.nan), 4, locked=True)
    plant = emsid.plants.brushless(delay=1e-4, advance=1.5e-4, held_in="stator")
    fit = emsid.fit(plant, log.record("i_d i_q"), fixed=LOCKED)
    assert {"heating", "cooling", "winding_drift"} & {*fit.names} == names
    said = [each.data for each in fit.findings if each.code == "resistance-changes"]
    assert [each["heats"] for each in said] == ["heating" in names] * len(names)
    for each in said:
        assert abs(each["rise"] - 0.00393 * log.warmer[-1]) < 1.5 * each["half"] < 0.1 * each["rise"]
    truth = {"heating": 1 / drive.capacity, "winding_drift": drive.drift, "resistance": drive.resistance}
    for name in ("resistance", *names):
        assert abs(fit[name].value - truth[name]) < 4 * fit[name].standard_error < 0.1 * truth[name]
