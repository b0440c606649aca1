"""The grey box where a search begins badly, where a free run ends, and where a record says little or nothing."""

from dataclasses import replace

import numpy as np
import pytest

from coverage_grey_box import EXCESS, FREE, MOTOR, STICTION, coverage_of_an_excess, least_share, simulated_record
from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Ending
from emsid.findings import Finding
from emsid.identification.options import Options
from emsid.identification.workflow import identify
from emsid.models.plants.datasheet import Given
from emsid.models.plants.drive import Bridge, Drive, Feed
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.grey_box import GreyBox, assumptions, check_channels
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search import continuation
from emsid.models.plants.search.choice import STARTS, choose
from emsid.models.plants.search.diagnostics import likelihood_profile
from emsid.models.plants.search.estimation import begun_again, simulation_error
from emsid.models.plants.search.refinements.usual import late_command, slow_sensor
from emsid.models.plants.search.result import Status
from emsid.models.plants.search.task import prepare
from emsid.models.plants.sensor import Sensor
from emsid.plant import Motor
from emsid.plant.motor import Parameter
from emsid.record import Record
from emsid.report.views.grey_box import likelihood
from emsid.report.views.physical_parameters import plant_equations, units_taken

DT = 5e-3
LEVELS = np.repeat(np.random.default_rng(0).uniform(-12, 12, 80), 20)
ONE_MASS = Motor(inductance=0.0).rigid()
USUAL = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")


def driven(drive=Drive(), noise=0.1, signals=(Signal.SPEED,), motor=ONE_MASS):  # noqa: B008  (frozen)
    plant = DrivenMotor(motor, drive)
    output = plant.simulate(LEVELS[:, None], DT, np.zeros(2), signals)
    output = output + noise * np.std(output, axis=0) * np.random.default_rng(1).standard_normal(output.shape)
    units = {Signal.SPEED: "rad/s", Signal.CURRENT: "A"}
    return Record(LEVELS, output, DT, output_units=tuple(units[signal] for signal in signals))


# --- where a search begins ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("drive", "names"),
    [
        (Drive(supply=8.0), ("drive.supply",)),
        (Drive(knee=5.0, beyond=0.5), ("drive.knee", "drive.beyond")),
        (Drive(supply=np.max(np.abs(LEVELS)), freewheel=0.6), ("drive.freewheel",)),
    ],
    ids=["supply", "knee", "freewheel"],
)
def test_limits_of_the_drive_are_found_where_none_are_given(drive, names):
    fit = simulation_error(DrivenMotor(ONE_MASS), driven(drive, 0.002), free=(*USUAL, *names))
    assert fit.names == (*USUAL, *names)
    truth = [DrivenMotor(ONE_MASS, drive).value(name) for name in fit.names]
    assert fit.estimate == pytest.approx(truth, rel=0.01)


KNEES = [(5.0, 0.5), (9.0, 0.0), (5.0, 1.5), (9.0, 2.0), (4.0, 3.0)]


@pytest.mark.parametrize(
    ("knee", "beyond", "noise"),
    [
        *((*knee, 0.1) for knee in KNEES),
        (*KNEES[0], 0.002),
        *(pytest.param(*knee, 0.002, marks=pytest.mark.long) for knee in KNEES[1:]),
    ],
)
def test_a_knee_is_found_whichever_way_the_command_bends_there(knee, beyond, noise):
    record = driven(Drive(knee=knee, beyond=beyond), noise)
    fit = simulation_error(DrivenMotor(ONE_MASS), record, free=(*USUAL, "drive.knee", "drive.beyond"))
    assert fit.names[-2:] == ("drive.knee", "drive.beyond")
    assert fit.estimate[-2:] == pytest.approx([knee, beyond], abs=0.01 if noise < 0.1 else 0.25)
    assert np.all(np.abs(fit.estimate[-2:] - [knee, beyond]) < 4 * fit.standard_error[-2:])
    assert 2 * fit.cost == pytest.approx(len(record) * noise**2 * np.var(record.output), rel=0.03)


def test_a_supply_that_no_command_reaches_is_not_identifiable():
    fit = simulation_error(DrivenMotor(ONE_MASS), driven(noise=0.002), free=(*USUAL, "drive.supply"))
    assert fit.names == USUAL
    (finding,) = [each for each in fit.findings if each.data.get("parameters") == ["drive.supply"]]
    assert finding.code == "not-identifiable"


def test_parameters_kept_from_the_start_have_the_values_of_the_datasheet():
    sheet = {"resistance": Given(2.5), "motor_constant": Given(0.06), "rotor_viscous": Given(3e-5, 0.5)}
    free = ("resistance", "rotor_viscous", *FREE)
    fit = simulation_error(
        MOTOR.with_values({"motor_constant": 0.09}),
        simulated_record(np.random.default_rng(0)),
        free=free,
        datasheet=sheet,
    )
    kept = {row.name: row.value for row in fit.table if row.status is Status.KEPT}
    assert kept
    assert set(kept) <= set(sheet)
    assert kept == {name: sheet[name].value for name in kept}


LATE = DrivenMotor(ONE_MASS, Drive(delay=1.4 * DT), Sensor(ratio=30.0, lag=4 * DT))


@pytest.mark.parametrize("signal", [Signal.SPEED, Signal.POSITION])
def test_a_free_run_through_a_sensor_that_lags_may_begin_in_full_motion(signal):
    inputs = LEVELS[:, None]
    exact = Record(inputs, LATE.simulate(inputs, DT, np.zeros(2), (signal,)), DT)
    rest = replace(exact[990:], output_units=("rad/s" if signal is Signal.SPEED else "rad",))
    run = GreyBox(LATE, (signal,)).simulate(rest)
    error = np.abs(run.output - rest.output)[run.counted]
    assert len(error) == len(rest) - 20
    assert np.max(error) < 1e-6 * np.max(np.abs(rest.output))


def test_delay_and_lag_are_both_found_from_the_counts_of_an_encoder():
    count = 2 * np.pi / 600
    exact = LATE.simulate(LEVELS[:, None], DT, np.zeros(2), (Signal.POSITION,))
    record = Record(LEVELS, np.round(exact / count) * count, DT, output_units=("rad",))
    fit = choose(STARTS["rigid-motor"], record, fixed={"sensor.ratio": 30.0}, refinements=(late_command, slow_sensor))
    found = {row.name: row for row in fit.table}
    assert found["drive.delay"].value == pytest.approx(1.4 * DT, abs=0.1 * DT)
    assert found["sensor.lag"].value == pytest.approx(4 * DT, abs=0.2 * DT)
    assert np.std(fit.simulated()[0] - record.output) == pytest.approx(count / np.sqrt(12), rel=0.05)


# --- where a free run ends ------------------------------------------------------------------------------------------


def problem_of(plant, names, record=None):
    record = record or driven(noise=0.0)
    start = [np.zeros(plant.states)]
    return FreeRunError(plant, (Signal.SPEED,), [record], names, start, [()], all_alike, 1)


def test_derivatives_are_one_sided_where_only_one_side_has_a_free_run(monkeypatch):
    both = problem_of(DrivenMotor(ONE_MASS), USUAL).linearised(problem_of(DrivenMotor(ONE_MASS), USUAL).start)[0][1]
    changed = DrivenMotor.with_values

    def only_below(self, values):
        if values.get("motor_constant", 0.0) > ONE_MASS.motor_constant:
            raise ModelError("too much")
        return changed(self, values)

    monkeypatch.setattr(DrivenMotor, "with_values", only_below)
    problem = problem_of(DrivenMotor(ONE_MASS), USUAL)
    one = problem.linearised(problem.start)[0][1]
    assert np.array_equal(one[:, 1:], both[:, 1:])
    assert np.linalg.norm(one[:, 0] - both[:, 0]) < 1e-4 * np.linalg.norm(both[:, 0])


def test_derivatives_are_exact_where_a_search_ends_and_cheap_where_it_passes(monkeypatch):
    runs = []
    simulate = DrivenMotor.simulate_each
    counted = staticmethod(lambda plants, *rest: (runs.extend(plants), simulate(plants, *rest))[1])
    monkeypatch.setattr(DrivenMotor, "simulate_each", counted)
    problem = problem_of(DrivenMotor(ONE_MASS), USUAL)
    runs.clear()
    cheap = problem.linearised(problem.start)[0][1]
    assert len(runs) == 1 + len(USUAL)
    exact = problem.exactly(problem.start)[0][1]
    assert len(runs) == 1 + 3 * len(USUAL)
    assert problem.linearised(problem.start)[0][1] is exact
    assert len(runs) == 1 + 3 * len(USUAL)
    near = problem.linearised(problem.start * (1 + 5e-5))[0][1]
    assert len(runs) == 2 + 5 * len(USUAL)
    lengths = np.linalg.norm(exact, axis=0)
    assert np.all(np.linalg.norm(cheap - exact, axis=0) < 1e-3 * lengths)
    assert np.all(np.linalg.norm(near - exact, axis=0) < 1e-2 * lengths)


def test_derivatives_with_respect_to_what_is_nearly_zero_are_not_rounding():
    """A mean speed is a difference of positions, which have more rounding than the speed has."""
    motor = replace(ONE_MASS, rotor_viscous=1e-8)
    problem = problem_of(DrivenMotor(motor, sensor=Sensor(average=1.0)), ("rotor_viscous", *USUAL))
    found = problem.exactly(problem.start)[0][1][:, 0]
    above, below = problem.start.copy(), problem.start.copy()
    above[0], below[0] = 2e-8, 0.0
    expected = (problem.residuals(above)[0] - problem.residuals(below)[0]) / 2e-8
    assert np.linalg.norm(found - expected) < 1e-5 * np.linalg.norm(expected)


def test_a_parameter_that_cannot_be_moved_says_why(monkeypatch):
    changed = DrivenMotor.with_values

    def only_here(self, values):
        if values.get("motor_constant", ONE_MASS.motor_constant) != ONE_MASS.motor_constant:
            raise ModelError("out of all proportion")
        return changed(self, values)

    monkeypatch.setattr(DrivenMotor, "with_values", only_here)
    problem = problem_of(DrivenMotor(ONE_MASS), USUAL)
    with pytest.raises(ModelError, match=r"motor_constant cannot be moved from 0.05: out of all proportion"):
        problem.linearised(problem.start)


def test_a_bound_beside_which_there_is_no_free_run_has_a_zero_derivative(monkeypatch):
    simulate = DrivenMotor.simulate_each

    def only_rigid(plants, *arguments):
        if any(plant.motor.inductance > 0 for plant in plants):
            raise ModelError("out of all proportion")
        return simulate(plants, *arguments)

    monkeypatch.setattr(DrivenMotor, "simulate_each", staticmethod(only_rigid))
    problem = problem_of(DrivenMotor(ONE_MASS), ("inductance", *USUAL))
    assert problem.start[0] == 0.0
    slopes = problem.exactly(problem.start)[0][1]
    assert not slopes[:, 0].any()
    assert slopes[:, 1:].any(axis=0).all()


def test_a_problem_with_another_start_reuses_its_free_run(monkeypatch):
    problem = problem_of(DrivenMotor(ONE_MASS), USUAL)
    theta = problem.start * np.array([1.1, 0.9, 1.3])
    expected = problem.linearised(theta)
    monkeypatch.setattr(DrivenMotor, "simulate_each", lambda *arguments: pytest.fail("simulated again"))
    moved = problem.begun_at(theta)
    assert np.array_equal(moved.start, theta)
    assert moved.linearised(theta) is expected
    assert np.array_equal(moved.residuals(theta)[0], expected[0][0])
    assert moved.sizes[:3] == pytest.approx(theta)


# --- where a record says nothing ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("resolution", [0.0, 1.0], ids=["fine", "coarse"])
def test_an_output_of_noise_alone_is_refused(seed, resolution):
    noise = 0.4 * np.random.default_rng(seed).standard_normal(len(LEVELS))
    shown = np.round(noise / resolution) * resolution if resolution else noise
    with pytest.raises(DataError, match="output y1 is noise that has nothing to do with the input; nothing moves"):
        simulation_error(MOTOR, Record(0.01 * LEVELS, 3.0 + shown, DT, output_units=("rad/s",)), free=FREE)


@pytest.mark.parametrize(
    ("plant", "seeds"), [(DrivenMotor(ONE_MASS), (2,)), (LinearAxis(), (2, 3, 4, 5))], ids=["motor", "axis"]
)
def test_motion_far_below_the_noise_is_accepted(plant, seeds):
    signal = Signal.SPEED if isinstance(plant, DrivenMotor) else Signal.POSITION
    exact = plant.simulate(40 * LEVELS[:, None], DT, np.zeros(2), (signal,))
    unit = "rad/s" if signal is Signal.SPEED else "m"
    name = "motor_constant" if isinstance(plant, DrivenMotor) else "mass"
    errors, deviations = [], []
    for seed in seeds:
        output = exact + 3 * np.std(exact) * np.random.default_rng(seed).standard_normal(exact.shape)
        fit = simulation_error(plant, Record(40 * LEVELS, output, DT, output_units=(unit,)))
        k = fit.names.index(name)
        errors.append(fit.estimate[k] / plant.value(name) - 1)
        deviations.append(fit.standard_error[k] / plant.value(name))
    assert np.all(np.abs(errors) < 3 * np.array(deviations))
    assert 3 * np.mean(deviations) < 0.5
    assert np.sqrt(np.mean(np.square(errors))) < 0.15


def test_one_output_that_moves_is_enough():
    record = driven(noise=0.01)
    noise = 100 * np.random.default_rng(3).standard_normal(len(record))  # no current of this motor shows in it
    both = Record(record.input, np.column_stack([record.output[:, 0], noise]), DT, output_units=("rad/s", "A"))
    fit = simulation_error(DrivenMotor(ONE_MASS), both, free=USUAL)
    assert fit.names == USUAL
    truth = np.array([DrivenMotor(ONE_MASS).value(name) for name in USUAL])
    assert np.all(np.abs(fit.estimate - truth) < 3 * fit.standard_error)
    assert fit.standard_error[0] < 0.1 * truth[0]


def test_steps_logged_from_their_edge_on_are_accepted():
    plant, rng = DrivenMotor(ONE_MASS), np.random.default_rng(6)
    steps = []
    for volts in (-12.0, -8.0, -4.0, 3.0, 6.0, 9.0):
        inputs = np.full((150, 1), volts)
        run = plant.simulate(inputs, DT, np.zeros(2), (Signal.SPEED,))
        steps.append(Record(inputs, run + 0.1 * rng.standard_normal(run.shape), DT, output_units=("rad/s",)))
    fit = simulation_error(plant, steps, free=("motor_constant", "rotor_inertia"))
    assert fit.estimate == pytest.approx([ONE_MASS.motor_constant, ONE_MASS.rotor_inertia], rel=2e-3)
    with pytest.raises(DataError, match="input u1 stays at -12 throughout; nothing drives it"):
        simulation_error(plant, steps[:1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"free": "resistence"}, "rigid-motor has no parameter 'resistence'"),
        ({"fixed": "resistance"}, "fixed is 'resistance'; give a table by name"),
        ({"fixed": {"resistance": 2.0, "R": 2.0}}, "fixed has resistance twice, once as 'R'"),
        ({"datasheet": "sheet.toml"}, "datasheet is 'sheet.toml'; give a table"),
        ({"bounds": {"K_m": 0.1}}, "bounds of motor_constant are 0.1; give a pair"),
        ({"signals": "sped"}, "no signal 'sped'; .* did you mean speed?"),
        ({"fixed": {"resistance": "2 V"}}, "rigid-motor resistance is '2 V', which is not in ohm"),
        ({"fixed": {"resistance": "two"}}, "rigid-motor resistance is 'two'; give a number in ohm, or a text such as"),
        ({"datasheet": {"resistance": "2 volts"}}, "resistance is '2 volts', which is not in ohm"),
        ({"datasheet": {"resistance": {"tolerance": 0.1}}}, "has tolerance; write { value"),
        ({"datasheet": {"resistanc": "2 ohm"}}, "no parameter 'resistanc'"),
    ],
)
def test_values_of_another_kind_are_refused(arguments, message):
    with pytest.raises(ModelError, match=message):
        simulation_error(DrivenMotor(ONE_MASS), driven(), **arguments)


def test_what_is_fixed_may_have_a_unit():
    fits = [
        simulation_error(DrivenMotor(ONE_MASS), driven(), free=USUAL[1:], fixed={"motor_constant": value})
        for value in ("51 mN*m/A", 0.051)
    ]
    assert fits[0].estimate == pytest.approx(fits[1].estimate, rel=1e-9)
    assert fits[0].table[-1].value == pytest.approx(0.051)


@pytest.mark.parametrize("noise", [0.002, 0.2])
@pytest.mark.parametrize("plant", [DrivenMotor(ONE_MASS), LinearAxis()], ids=["motor", "axis"])
def test_an_output_with_the_wrong_sign_is_refused(plant, noise):
    signal = Signal.SPEED if isinstance(plant, DrivenMotor) else Signal.POSITION
    exact = plant.simulate(LEVELS[:, None], DT, np.zeros(2), (signal,))
    measured = exact + noise * np.std(exact) * np.random.default_rng(4).standard_normal(exact.shape)
    unit = "rad/s" if signal is Signal.SPEED else "m"
    record = Record(LEVELS, measured, DT, output_units=(unit,), input_names=("v",), output_names=("w",), name="log")
    assert simulation_error(plant, record).names
    message = r"log: 'w' goes against 'v'; if that is how .* turn the sign of one of them with scale w=-1"
    with pytest.raises(DataError, match=message):
        simulation_error(plant, replace(record, output=-record.output))


def two_channels(noise):
    record = driven(noise=noise, signals=(Signal.SPEED, Signal.CURRENT))
    return replace(record, input_names=("v",), output_names=("w", "i"), name="log")


@pytest.mark.parametrize("noise", [0.002, 0.5])
def test_channels_with_the_right_signs_are_fitted(noise):
    fit = simulation_error(DrivenMotor(ONE_MASS), two_channels(noise))
    assert fit.model.plant.value("motor_constant") == pytest.approx(ONE_MASS.motor_constant, rel=0.02)


@pytest.mark.parametrize("noise", [0.002, 0.5])
@pytest.mark.parametrize(
    ("signs", "words"),
    [
        ((1, -1), r"'i' goes against 'v'; .* turn the sign of i with scale i=-1"),
        ((-1, 1), r"'w' goes against 'v'; .* turn the sign of w with scale w=-1"),
        ((-1, -1), r"'w' and 'i' go against 'v'; .* turn the sign of v with scale v=-1"),
    ],
)
def test_the_channel_with_the_wrong_sign_is_named(signs, words, noise):
    record = two_channels(noise)
    with pytest.raises(DataError, match=f"log: {words}"):
        simulation_error(DrivenMotor(ONE_MASS), replace(record, output=record.output * np.array(signs)))


def test_a_current_alone_may_have_the_wrong_sign():
    record = replace(driven(signals=(Signal.CURRENT,)), input_names=("v",), output_names=("i",))
    with pytest.raises(DataError, match=r"'i' goes against 'v'; .* turn the sign of one of them with scale i=-1"):
        simulation_error(DrivenMotor(ONE_MASS), replace(record, output=-record.output))


def test_a_motor_that_lowers_a_load_gives_power_back_and_is_no_wrong_sign():
    lowering = DrivenMotor(ONE_MASS, load_torque=-0.05)
    volts = 3.0 + 0.25 * LEVELS
    exact = lowering.simulate(volts[:, None], DT, np.zeros(2), (Signal.SPEED, Signal.CURRENT))
    noisy = exact + 0.01 * np.std(exact, axis=0) * np.random.default_rng(1).standard_normal(exact.shape)
    record = Record(volts, noisy, DT, output_units=("rad/s", "A"))
    assert np.mean(volts * noisy[:, 1]) < -1.0
    free = ("resistance", "load_torque", *USUAL[:2])  # of torques of one sign only the sum is identifiable
    fit = simulation_error(lowering.with_values({"load_torque": 0.0}), record, free=free)
    assert fit.model.plant.value("load_torque") == pytest.approx(-0.05, rel=0.02)


# --- where it says little -------------------------------------------------------------------------------------------


def test_a_finding_names_inseparable_parameters_and_the_missing_current():
    free = ("resistance", "rotor_viscous", *FREE)
    finding, searches = simulation_error(MOTOR, simulated_record(np.random.default_rng(0)), free=free).findings
    assert (finding.code, searches.code) == ("not-identifiable", "searches-agreeing")
    data = finding.data
    assert data["channels"] == ["voltage", "speed"]
    assert data["parameters"][:4] == ["resistance", "rotor_viscous", "motor_constant", "rotor_inertia"]
    assert data["combinations"] == ["J/(B + K²/R)", "K/(K² + R·B)", "K/(R·J)", "R·T_c/K"]
    assert data["kept"][0] == ["resistance", 2.0, "ohm"]
    assert data["current_missing"]


def test_parameters_found_undetermined_return_to_their_start_values():
    fit = simulation_error(Motor().rigid(), driven(noise=0.002)[:800])
    kept = {row.name: (row.value, row.start) for row in fit.table if row.status is Status.KEPT}
    assert set(kept) == {"resistance", "rotor_viscous"}
    assert kept == {"resistance": (2.0, 2.0), "rotor_viscous": (1e-5, 1e-5)}
    assert fit.model.plant.value("motor_constant") == pytest.approx(0.05, rel=0.003)
    assert fit.ending is Ending.CONVERGED


def test_an_undetermined_parameter_stays_where_its_start_value_has_no_free_run():
    record = driven(noise=0.002)
    weak, slow = DrivenMotor(replace(ONE_MASS, motor_constant=0.045)), {"motor_constant": (0.0, 0.047)}
    fit = simulation_error(weak, record, fixed={"resistance": 2.0}, bounds=slow)
    (viscous,) = [row for row in fit.table if row.name == "rotor_viscous"]
    assert viscous.value > 5 * viscous.start == 5e-5
    assert fit.cost / len(record) < 1.05 * 0.5 * (0.002 * np.std(record.output)) ** 2


def test_an_interruption_on_the_way_back_to_a_start_keeps_the_better_fit(monkeypatch):
    record, calls = driven(noise=0.002), []
    search = continuation._search

    def interrupted(problem, limits, iterations, *rest):
        calls.append(iterations)
        ended = search(problem, limits, 1 if len(calls) == 2 else iterations, *rest)
        cancelled = (Finding("search-cancelled", "", {"steps": 1, "offset": None}),)
        return replace(ended, ending=Ending.INTERRUPTED, findings=cancelled) if len(calls) == 2 else ended

    monkeypatch.setattr(continuation, "_search", interrupted)
    weak = DrivenMotor(replace(ONE_MASS, motor_constant=0.045, rotor_viscous=1e-4))
    slow = {"motor_constant": (0.0, 0.047)}
    fit = simulation_error(weak, record, fixed={"resistance": 2.0}, bounds=slow)
    assert calls[2:] == [0]
    assert fit.ending is Ending.INTERRUPTED
    assert Finding("search-cancelled", "", {"steps": fit.iterations, "offset": None}) in fit.findings
    assert fit.cost / len(record) < 1.05 * 0.5 * (0.002 * np.std(record.output)) ** 2


def test_a_measured_current_is_not_reported_missing():
    record = driven(noise=0.01, signals=(Signal.SPEED, Signal.CURRENT))
    fit = simulation_error(DrivenMotor(ONE_MASS), record, free=("load_inertia", "resistance", *USUAL))
    assert {"load_inertia", "rotor_inertia"} - set(fit.names)
    finding, searches = fit.findings
    assert (finding.code, searches.code) == ("not-identifiable", "searches-agreeing")
    assert finding.data["parameters"] == ["load_inertia", "rotor_inertia"]
    assert finding.data["channels"] == ["voltage", "speed", "current"]
    assert not finding.data["current_missing"]


def test_an_axis_of_unknown_force_is_identified_in_units_of_its_command():
    axis = LinearAxis(mass=2.0, viscous_friction=8.0, drive=Drive(gain=4.0))
    exact = axis.simulate(LEVELS[:, None], DT, np.zeros(2), (Signal.POSITION,))
    noisy = exact + 1e-3 * np.random.default_rng(5).standard_normal(exact.shape)
    fit = simulation_error(
        axis, Record(LEVELS, noisy, DT, output_units=("m",)), free=("drive.gain", *axis.default_free)
    )
    combinations = {c.quantity.name: (c.quantity.formula, c.quantity.unit, c.quantity.value) for c in fit.combinations}
    assert combinations == {
        "time constant": ("M/F_v", "s", pytest.approx(0.25, rel=1e-3)),
        "acceleration per unit of command": ("k_u/M", "m/s^2", pytest.approx(2.0, rel=1e-3)),
        "Coulomb friction in units of command": ("F_c/k_u", "1", pytest.approx(0.025, rel=0.1)),
    }


@pytest.mark.parametrize("noise", [pytest.param(0.002, marks=pytest.mark.long), 0.05])
def test_a_shaft_without_effect_on_the_record_is_a_finding(noise):
    record = driven(noise=noise)[:800]
    fit = simulation_error(STARTS["motor"], record, max_iterations=20)
    assert fit.findings[0].code == "no-shaft-seen"
    rigid = simulation_error(STARTS["rigid-motor"], record)
    assert 2 * (rigid.cost - fit.cost) < 12.0 * fit.noise_variance
    assert rigid.noise_variance == pytest.approx(noise**2 * np.var(driven(noise=0.0).output), rel=0.1)


def test_a_shaft_with_an_effect_on_the_record_is_estimated():
    record = driven(noise=0.002, motor=Motor())
    fit = simulation_error(STARTS["motor"], record, max_iterations=20)
    assert {"shaft_stiffness", "shaft_damping"} <= set(fit.names)
    assert "no-shaft-seen" not in [finding.code for finding in fit.findings]
    assert simulation_error(STARTS["rigid-motor"], record).cost > 20 * fit.cost


def test_an_interval_that_includes_zero_is_a_finding():
    free = (*USUAL, "rotor_friction.stribeck")
    plant = DrivenMotor(replace(ONE_MASS, rotor_friction=replace(ONE_MASS.rotor_friction, stribeck_rate=0.3)))
    fit = simulation_error(plant, driven(noise=0.1), free=free, find_start=False)
    (row,) = [row for row in fit.table if row.name == "rotor_friction.stribeck"]
    assert row.value < 1.96 * row.standard_error
    zero = Finding("intervals-include-zero", "rigid-motor", {"parameters": ["rotor_friction.stribeck"]})
    assert [finding for finding in fit.findings if finding.code == zero.code] == [zero]
    assert all(row.value > 1.96 * row.standard_error for row in fit.table[:-1])


def test_what_is_not_known_to_its_physical_scale_is_a_finding():
    rng = np.random.default_rng(1)
    noisy = (simulated_record(rng, noise=30.0, samples=600, motor=STICTION) for _ in range(5))
    free = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb", EXCESS)
    fits = (simulation_error(STICTION, record, free=free) for record in noisy)
    weakly = next(
        f for fit in fits for f in fit.findings if f.code == "weakly-identified" and EXCESS in f.data["parameters"]
    )
    assert weakly.data["kept"] == []
    clean = simulation_error(STICTION, simulated_record(rng, noise=3.0, motor=STICTION), free=free)
    assert "weakly-identified" not in [each.code for each in clean.findings]


def test_an_excess_estimated_as_zero_has_the_interval_of_its_profile():
    free = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb", EXCESS)
    rng = np.random.default_rng(78)  # the first of few records with this estimate; others take a fit each
    records = (simulated_record(rng, noise=3.0, motor=STICTION) for _ in range(100))
    fit = next(fit for fit in (simulation_error(STICTION, r, free=free) for r in records) if fit.estimate[-1] == 0)
    assert fit.table[-1].status is Status.AT_BOUND
    assert Finding("parameter-at-bound", EXCESS, {"side": "lower", "bound": 0.0, "because": "physical"}) in fit.findings
    profile = likelihood_profile(fit, EXCESS)
    low, high = profile.interval
    assert low == 0 < high
    others = simulation_error(STICTION, fit.segments, free=free[:-1], fixed={EXCESS: high})
    unit = fit.noise_variance * np.max(fit.colour) / 2
    assert (others.cost - fit.cost) / unit == pytest.approx(profile.limit, rel=0.02)
    figure = likelihood(fit, profile)
    assert "; the search ended at a bound, so there is no standard error." in figure.caption
    assert "quadratic approximation" not in [mark.label for mark in figure.plots[0].marks]


@pytest.mark.parametrize("count", [10, pytest.param(25, marks=pytest.mark.long)])  # and 300 by `make coverage`
def test_intervals_of_an_excess_contain_the_true_value_in_heavy_noise(count):
    found = coverage_of_an_excess(count)
    assert found["undetermined"] <= 0.2
    assert found["covered"] >= least_share(count)


def test_exact_data_leave_the_uncertainty_of_the_simulation():
    fit = simulation_error(DrivenMotor(ONE_MASS).with_values({"motor_constant": 0.075}), driven(noise=0.0), free=USUAL)
    truth = np.array([ONE_MASS.motor_constant, ONE_MASS.rotor_inertia, ONE_MASS.rotor_friction.coulomb[0]])
    assert np.all(np.abs(fit.estimate - truth) < 1.96 * fit.standard_error)
    assert np.all(fit.standard_error < 1e-9 * truth)


def test_a_noisy_first_sample_chooses_no_lag():
    plant, rng = DrivenMotor(ONE_MASS), np.random.default_rng(0)
    exact = plant.simulate(LEVELS[:, None], DT, np.zeros(2), (Signal.SPEED,))
    noisy = exact + 0.1 * rng.standard_normal(exact.shape)
    cut = int(0.75 * len(LEVELS))
    noisy[cut] += 60.0  # the first sample of the unseen part
    fit = choose(STARTS["rigid-motor"], Record(LEVELS, noisy, DT, output_units=("rad/s",)), fixed={"resistance": 2.0})
    assert {"sensor.lag", "drive.delay"} & {row.name for row in fit.table} == set()


def test_without_refinements_a_choice_is_a_plain_fit():
    plain = simulation_error(STARTS["rigid-motor"], driven(noise=0.01))
    chosen = choose(STARTS["rigid-motor"], driven(noise=0.01), refinements=())
    assert np.array_equal(chosen.estimate, plain.estimate)
    assert chosen.table == plain.table


@pytest.mark.parametrize(
    ("plant", "units", "message"),
    [
        (
            DrivenMotor(ONE_MASS),
            ("V", ""),
            r"; name the one that drives it, or say which values of a second are codes",
        ),
        (
            DrivenMotor(ONE_MASS, Drive(codes=((2.0, Bridge.BRAKE),))),
            ("V", "", ""),
            "3 inputs .* and the one with its codes",
        ),
    ],
)
def test_too_many_inputs_are_refused(plant, units, message):
    inputs = np.column_stack([LEVELS] * len(units))
    with pytest.raises(DataError, match=message):
        simulation_error(plant, Record(inputs, LEVELS, DT, input_units=units, output_units=("rad/s",)))


def test_a_code_that_never_occurs_is_a_finding():
    record, options = driven(noise=0.01), Options(codes=((999.0, Bridge.COAST), (LEVELS[5], Bridge.BRAKE)))
    result = identify(record, models=("rigid-motor",), options=replace(options, free=USUAL))
    absent = [finding for finding in result.findings if finding.code == "code-never-occurs"]
    assert absent == [Finding("code-never-occurs", "u1", {"value": 999.0})]


CODED = np.where(np.arange(len(LEVELS)) % 400 < 50, 999.0, LEVELS)


@pytest.mark.parametrize(("model", "unit", "nothing"), [("linear-axis", "N", "force"), ("rigid-motor", "A", "torque")])
def test_codes_without_a_bridge_mean_no_drive_or_are_refused(model, unit, nothing):
    plant = replace(STARTS[model], drive=Drive(codes=((999.0, Bridge.COAST),)))
    if unit == "A":
        plant = replace(plant, feed=Feed.CURRENT)
    exact = plant.simulate(CODED[:, None], DT, np.zeros(2), (Signal.SPEED,))
    stopped = plant.simulate(np.where(CODED == 999.0, 0.0, CODED)[:, None], DT, np.zeros(2), (Signal.SPEED,))
    assert np.array_equal(exact, stopped)
    shown = "m/s" if unit == "N" else "rad/s"
    record = Record(CODED, exact, DT, input_units=(unit,), output_units=(shown,), name="log")
    options = Options(free=plant.default_free[1:], codes=((999.0, Bridge.COAST),))
    result = identify(record, models=(model,), options=options)
    assert Finding("codes-without-bridge", model, {"codes": [999.0], "nothing": nothing}) in assumptions(plant, record)
    assert result.chosen.model.plant.drive.codes == options.codes
    with pytest.raises(ModelError, match=f"{model} has no bridge here that could brake with 999; say that nothing dri"):
        identify(record, models=(model,), options=replace(options, codes=((999.0, Bridge.BRAKE),)))


def test_the_assumed_unit_of_a_channel_is_a_finding():
    record = Record(LEVELS, LEVELS, DT, input_names=("u",), output_names=("y",), output_units=("",))
    assert assumptions(STARTS["rigid-motor"], record) == [
        Finding("unit-assumed", "rigid-motor", {"channel": "y", "signal": "speed", "unit": "rad/s"}),
        Finding("command-unit-assumed", "rigid-motor", {"channel": "u", "unit": "volts"}),
    ]
    assert [finding.data["unit"] for finding in assumptions(STARTS["linear-axis"], record)] == ["m", "newtons"]
    said = replace(record, input_units=("V",), output_units=("rad/s",))
    assert assumptions(STARTS["rigid-motor"], said) == []


@pytest.mark.parametrize(
    ("command", "unit", "full"),
    [
        (np.round(LEVELS / np.max(np.abs(LEVELS)) * 255), "", 255.0),
        (np.round(LEVELS / np.max(np.abs(LEVELS)) * 250), "", None),  # no limit of any timer
        (LEVELS / np.max(np.abs(LEVELS)) * 255, "", None),  # no whole numbers
        (np.round(LEVELS / np.max(np.abs(LEVELS)) * 100), "V", None),
    ],
)
def test_a_command_that_ends_like_a_duty_is_asked_about(command, unit, full):
    record = Record(command, LEVELS, DT, input_names=("PWM",), input_units=(unit,), output_units=("rad/s",))
    said = [each.data for each in assumptions(STARTS["rigid-motor"], record) if each.code == "command-may-be-duty"]
    assert said == ([{"channel": "PWM", "full": full}] if full else [])


def test_codes_with_a_bridge_are_no_finding():
    record = Record(CODED, LEVELS, DT, input_units=("V",), output_units=("rad/s",))
    coded = replace(STARTS["rigid-motor"], drive=Drive(codes=((999.0, Bridge.BRAKE),)))
    assert assumptions(coded, record) == []
    check_channels(coded, (Signal.SPEED,), record)


def test_a_motor_with_a_shaft_that_coasts_is_refused_with_what_to_do():
    coded = replace(STARTS["motor"], drive=Drive(codes=((999.0, Bridge.COAST),)))
    record = Record(CODED, LEVELS, DT, input_units=("V",), output_units=("rad/s",))
    with pytest.raises(
        ModelError, match=r"without inductance only; choose rigid-motor, or leave out these samples with a mask"
    ):
        simulation_error(coded, record)


# --- what is said of it ---------------------------------------------------------------------------------------------


def test_codes_need_no_unit():
    plant = DrivenMotor(ONE_MASS, Drive(codes=((2.0, Bridge.BRAKE),)))
    inputs = np.column_stack([LEVELS, np.where(np.arange(len(LEVELS)) % 400 < 50, 2.0, 0.0)])
    record = Record(
        inputs,
        plant.simulate(inputs, DT, np.zeros(2), (Signal.SPEED,)),
        DT,
        input_names=("volts", "state"),
        input_units=("V", ""),
        output_names=("speed",),
        output_units=("rad/s",),
    )
    fit = simulation_error(plant, record, free=USUAL)
    assert units_taken(fit) == ""
    said = units_taken(replace(fit, segments=(replace(record, input_units=("", "")),)))
    assert said.startswith("The record has no unit for volts; it is read as SI.")


def test_an_equation_leaves_out_what_the_plant_does_not_have():
    fit = simulation_error(STARTS["rigid-motor"], driven(noise=0.01), fixed={"resistance": 2.0})
    assert not any(name in fit.model.equation() for name in ("load_inertia", "cogging"))
    assert "resistance = 2 Ω, motor_constant = " in fit.model.equation()
    motion, numbers = plant_equations(fit)
    assert motion.startswith("0 = D_v(v_a) − R_a·i − K_m·ω\n")
    assert "resistance = 2 Ω" in numbers
    assert "N*m" not in numbers
    assert "kg·m²" in numbers


@pytest.mark.parametrize(
    ("unit", "motion", "without"),
    [("A", "K_m·i", ["resistance", "inductance"]), ("N*m", "T", ["resistance", "inductance", "motor_constant"])],
)
def test_a_motor_that_no_voltage_drives_has_no_electrical_equation(unit, motion, without):
    feed = Feed.CURRENT if unit == "A" else Feed.TORQUE
    inputs = LEVELS[:, None] * (0.1 if unit == "A" else 0.005)
    exact = DrivenMotor(ONE_MASS, feed=feed).simulate(inputs, DT, np.zeros(2), (Signal.SPEED,))
    record = Record(inputs, exact, DT, input_units=(unit,), output_units=("rad/s",))
    fit = simulation_error(DrivenMotor(ONE_MASS), record)
    equation, numbers = plant_equations(fit)
    assert equation == f"(J_m + J_L)·dω/dt = {motion} − (B_m + B_L)·ω − T_f(ω) − T_d"
    assert "rotor_inertia = " in numbers
    assert not any(f"{name} = " in numbers for name in without)


# --- a plant of the user's that is not one --------------------------------------------------------------------------


def decay(x, u, p):
    return [-p[0] * x[0] + u[0]]


def whole(x, u, p):
    return x[:1]


OWN = OwnPlant(decay, whole, (Parameter("a", "a", "1/s", "rate"),), (2.0,), 1, name="tank")


@pytest.fixture(scope="module")
def tank():
    """A record of a plant that is not compiled."""
    return Record(LEVELS, OWN.simulate(LEVELS[:, None], DT, np.zeros(1), ()), DT)


def test_a_search_of_an_own_plant_that_stalls_is_begun_again(tank):
    noise = 0.01 * np.random.default_rng(0).standard_normal(tank.output.shape)
    task = prepare(OWN.with_values({"a": 5.0}), replace(tank, output=tank.output + noise))
    stall = Finding("search-stalled", "", {"steps": 1, "offset": 5.0})
    early, found = (continuation.search(task, task.plant, steps) for steps in (1, 30))
    again = [
        begun_again(task, each._replace(minimum=replace(each.minimum, ending=Ending.STALLED, findings=(stall,))), 30)
        for each in (early, found)
    ]
    assert early.minimum.cost > 2 * found.minimum.cost
    assert again[0].minimum.cost == pytest.approx(found.minimum.cost, rel=1e-6)
    assert [each.minimum.ending for each in again] == [Ending.CONVERGED] * 2
    (said,) = again[1].minimum.findings
    assert (said.code, said.data) == ("minimum-not-smooth", {"starts": 4, "agreeing": 4})


def test_a_plant_of_plain_functions_is_fitted(tank):
    assert simulation_error(OWN.with_values({"a": 1.5}), tank).estimate == pytest.approx([2.0], rel=1e-8)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"derivative": lambda x, u, p: [np.nan]}, "the free run of tank is not finite; check the start values"),
        ({"values": (-1e5,)}, "the free run of tank is not finite; check the start values"),
        ({"derivative": lambda x, u, p: [1.0, 2.0]}, r"tank: its derivative has shape \(2,\); it must be \(1,\)"),
        ({"derivative": lambda x, u, p: 1.0}, r"tank: its derivative has shape \(\); it must be \(1,\)"),
        ({"derivative": lambda x, u, p: None}, r"tank: its derivative has shape \(\); it must be \(1,\)"),
        ({"output": lambda x, u, p: [x[0], x[0]]}, r"tank: its output has shape \(2,\); it must be \(1,\)"),
    ],
    ids=["nan", "runaway", "long", "number", "none", "outputs"],
)
def test_a_plant_that_cannot_be_simulated_is_refused(tank, changes, message):
    with pytest.raises(ModelError, match=message):
        simulation_error(replace(OWN, **changes), tank)


# --- what the sample time hides -------------------------------------------------------------------------------------


def test_an_inductance_below_the_sample_time_ends_at_the_bound_of_the_sample_time():
    free = (*USUAL, "inductance")
    fit = simulation_error(DrivenMotor(ONE_MASS), driven(noise=0.01)[:600], free=free)
    (row,) = [row for row in fit.table if row.name == "inductance"]
    assert row.status is Status.AT_BOUND
    assert row.value == pytest.approx(0.05 * DT * ONE_MASS.resistance)
    data = {"side": "lower", "bound": row.value, "because": "sample-time"}
    assert Finding("parameter-at-bound", "inductance", data) in fit.findings


@pytest.mark.parametrize(
    "how", [{"bounds": {"inductance": (1e-4, 1.0)}}, {"datasheet": {"inductance": Given(2e-4, 0.5)}}]
)
def test_bounds_or_a_datasheet_of_the_inductance_replace_that_bound(how):
    motor = replace(ONE_MASS, inductance=2e-4)
    fit = simulation_error(
        DrivenMotor(motor), driven(noise=0.001, motor=motor)[:400], free=(*USUAL, "inductance"), **how
    )
    assert fit.limits["inductance"][0] == pytest.approx(1e-4)
    assert fit.estimate[-1] == pytest.approx(2e-4, rel=0.3)


def test_a_very_stiff_shaft_is_simulated_as_rigid_and_a_less_stiff_one_nearly_so():
    u = np.repeat(np.random.default_rng(0).uniform(-10, 10, 20), 10)[:, None]
    motor = STARTS["motor"].with_values({"rotor_inertia": 1e-4, "load_inertia": 1e-4, "inductance": 1e-3})
    runs = [
        motor.with_values({"shaft_stiffness": stiffness}).simulate(u, 1e-2, np.zeros(3), (Signal.SPEED,))
        for stiffness in (0.9 * 1800.0, 1.1 * 1800.0, 1e12)  # 60 rad per sample in between
    ]
    assert np.array_equal(runs[1], runs[2])
    assert 0 < np.max(np.abs(runs[0] - runs[1])) < 1e-2 * np.ptp(runs[1])


def test_a_strongly_damped_shaft_is_simulated_as_rigid_and_takes_no_longer():
    u = np.repeat(np.random.default_rng(0).uniform(-10, 10, 20), 10)[:, None]
    motor = STARTS["motor"].with_values({"rotor_inertia": 1e-4, "load_inertia": 1e-4, "inductance": 1e-3})
    runs = [
        motor.with_values({"shaft_stiffness": 1e-3, "shaft_damping": damping}).simulate(
            u, 1e-2, np.zeros(3), (Signal.SPEED,)
        )
        for damping in (0.95 * 0.3, 1.1 * 0.3, 1e4)  # 60 rad per sample in between; by steps the last takes minutes
    ]
    assert np.array_equal(runs[1], runs[2])
    assert 0 < np.max(np.abs(runs[0] - runs[1])) < 1e-2 * np.ptp(runs[1])


def test_a_motor_that_takes_too_many_steps_is_refused_at_once():
    u = np.ones((3000, 1))
    motor = STARTS["motor"].with_values({"inductance": 1e-7})
    with pytest.raises(ModelError, match="out of all proportion"):
        motor.simulate(u, 1e-2, np.zeros(3), (Signal.SPEED,))


@pytest.mark.parametrize("plant", [DrivenMotor(Motor().rigid()), LinearAxis()])
@pytest.mark.parametrize("steps", [0, -1, 1.5, []])
def test_steps_per_sample_are_a_positive_whole_number(plant, steps):
    with pytest.raises(ModelError, match=r"steps per sample; give a positive whole number"):
        replace(plant, steps=steps)
