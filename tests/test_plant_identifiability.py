"""What a record does not determine: combinations, kept values, and parameters without effect."""

from dataclasses import replace

import numpy as np
import pytest

from coverage_grey_box import (
    EXCESS,
    FREE,
    MOTOR,
    STICTION,
    simulated_record,
)
from emsid.estimation.fit import Ending
from emsid.estimation.uncertainty.identifiability import identifiability
from emsid.findings import Finding
from emsid.models.plants.datasheet import Given
from emsid.models.plants.drive import Drive
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search import continuation
from emsid.models.plants.search.diagnostics import friction_curve
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import Status
from emsid.plant import Friction, Motor
from emsid.plant.motor import Parameter
from emsid.record import Record
from simulated_plants import DT, LEVELS, RIGID, SPEED, USUAL, VOLTAGE, codes, driven, record_of

# --- combinations ----------------------------------------------------------------------------------------------------


def test_voltage_and_speed_identify_combinations_only():
    record = record_of(MOTOR, noise=0.05)
    fit = simulation_error(MOTOR, record, free=("resistance", "rotor_viscous", *FREE))
    assert set(fit.names).isdisjoint({"resistance", "rotor_viscous"})
    status = {row.name: row.status for row in fit.table}
    assert status["resistance"] is Status.KEPT
    assert status["rotor_inertia"] is Status.ASSUMING
    assert status["voltage_dead_zone.half_width"] == "estimated"
    (finding,) = [each for each in fit.findings if each.code == "not-identifiable"]
    assert "resistance" in finding.data["parameters"]
    true = {q.name: q.value for q in MOTOR.quantities()}
    combinations = {c.quantity.name: c for c in fit.combinations}
    assert {"mechanical time constant", "speed per volt", "acceleration per volt"} <= set(combinations)
    assert "electromechanical time constant" not in combinations
    for name, combination in combinations.items():
        assert abs(combination.quantity.value - true[name]) < 4 * combination.standard_error, name


@pytest.mark.parametrize("kept", [1.0, 1.5, 3.0])
def test_what_only_the_start_does_not_separate_is_estimated(kept):
    """Where q is 1, p and q are the same gain; the start of p must not decide where the search ends."""
    table = tuple(Parameter(name, name, "1", "of the gain") for name in "pq")

    def gain(p, q):
        both = lambda x, u, v: [v[0] * v[1] * x[0] + (v[1] - 1) ** 2 * x[0] ** 3]  # noqa: E731
        return OwnPlant(lambda x, u, v: [5 * (u[0] - x[0])], both, table, (p, q), 1)

    rng = np.random.default_rng(4)
    u = np.repeat(rng.standard_normal(30), 10)[:, None]
    y = gain(2.0, 1.5).simulate(u, 0.1, np.zeros(1), SPEED) + 0.01 * rng.standard_normal((300, 1))
    fit = simulation_error(gain(kept, 1.0), Record(u, y, 0.1))
    assert fit.names == ("p", "q")
    assert fit.estimate == pytest.approx([2.0, 1.5], rel=2e-3)


def test_steps_from_rest_do_not_separate_a_dead_zone_from_coulomb_friction():
    steps = [record_of(MOTOR, np.repeat([0.0, v], [20, 200]), noise=0.02) for v in (2.0, 3.0, 5.0, -2.0, -4.0)]
    fit = simulation_error(MOTOR, steps, free=FREE)
    status = {row.name: row.status for row in fit.table}
    assert {status["voltage_dead_zone.half_width"], status["rotor_friction.coulomb"]} <= {
        Status.KEPT,
        Status.ASSUMING,
    }
    assert Status.KEPT in status.values()
    combinations = {c.quantity.name: c.quantity.value for c in fit.combinations}
    true = {q.name: q.value for q in MOTOR.quantities()}
    assert combinations["break-away voltage forward"] == pytest.approx(true["break-away voltage forward"], rel=0.02)


def test_a_record_that_determines_nothing_gives_one_finding_and_no_estimates():
    rng = np.random.default_rng(0)
    noise = np.convolve(rng.standard_normal(804), np.ones(5), "valid")  # a sensor's that filters, or of vibrations
    fit = simulation_error(MOTOR, Record(1e-3 * rng.standard_normal(800), noise, DT, output_units=("rad/s",)))
    assert fit.names == ()
    assert {row.status for row in fit.table if row.asked} == {Status.KEPT}
    assert "nothing-identifiable" in codes(fit)
    curve = friction_curve(fit, 11)
    assert np.array_equal(curve.low, curve.y)


def test_identifiability_of_a_product():
    x = np.random.default_rng(0).standard_normal((50, 2))
    jacobian = np.column_stack([3.0 * x[:, 0], 2.0 * x[:, 0], x[:, 1]])  # a·b and c at a = 2, b = 3, c = 1
    found = identifiability([jacobian], np.array([2.0, 3.0, 1.0]), ("a", "b", "c"), 0.01)
    assert found.groups == (("a", "b"),)
    assert found.determines(np.array([1.0, 1.0, 0.0]))
    assert not found.determines(np.array([1.0, 0.0, 0.0]))
    assert found.without(["a"]).groups == ()


def test_a_finding_names_inseparable_parameters_and_the_missing_current():
    free = ("resistance", "rotor_viscous", *FREE)
    fit = simulation_error(MOTOR, simulated_record(np.random.default_rng(0)), free=free)
    (finding, searches) = (each for each in fit.findings if each.code != "damping-open")
    assert (finding.code, searches.code) == ("not-identifiable", "searches-agreeing")
    data = finding.data
    assert data["channels"] == ["voltage", "speed"]
    assert data["parameters"][:4] == ["resistance", "rotor_viscous", "motor_constant", "rotor_inertia"]
    assert data["combinations"] == ["J/(B + K²/R)", "K/(K² + R·B)", "K/(R·J)", "R·T_c/K"]
    assert data["kept"][0] == ["resistance", 2.0, "ohm"]
    assert data["current_missing"]


def test_a_measured_current_identifies_the_resistance():
    signals = (Signal.SPEED, Signal.CURRENT)
    output = MOTOR.simulate(VOLTAGE[:, None], DT, np.zeros(2), signals)
    output = output + np.random.default_rng(1).standard_normal(output.shape) * (0.05, 0.002)
    record = Record(VOLTAGE, output, DT, output_names=("speed", "current"), output_units=("rad/s", "A"))
    fit = simulation_error(MOTOR, record, free=("resistance", *FREE))
    assert fit.names == ("resistance", *FREE)
    assert "not-identifiable" not in codes(fit)
    assert fit.estimate[:2] == pytest.approx([MOTOR.value("resistance"), MOTOR.value("motor_constant")], rel=0.01)


def test_a_measured_current_is_not_reported_missing():
    record = driven(noise=0.01, signals=(Signal.SPEED, Signal.CURRENT))
    fit = simulation_error(DrivenMotor(RIGID), record, free=("load_inertia", "resistance", *USUAL))
    assert {"load_inertia", "rotor_inertia"} - set(fit.names)
    finding, searches = (each for each in fit.findings if each.code != "damping-open")
    assert (finding.code, searches.code) == ("not-identifiable", "searches-agreeing")
    kept = [row.name for row in fit.table if row.status is Status.OF_PLANT]
    assert {"rotor_viscous", "voltage_dead_zone.half_width"} <= {*kept}
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


# --- values that are kept --------------------------------------------------------------------------------------------


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


def test_parameters_found_undetermined_return_to_their_start_values():
    fit = simulation_error(Motor().rigid(), driven(noise=0.002)[:800])
    kept = {row.name: (row.value, row.start) for row in fit.table if row.status is Status.KEPT}
    assert set(kept) == {"resistance", "rotor_viscous"}
    assert kept == {"resistance": (2.0, 2.0), "rotor_viscous": (1e-5, 1e-5)}
    assert fit.model.plant.value("motor_constant") == pytest.approx(0.05, rel=0.003)
    assert fit.ending is Ending.CONVERGED


def test_an_undetermined_parameter_stays_where_its_start_value_has_no_free_run():
    record = driven(noise=0.002)
    weak, slow = DrivenMotor(replace(RIGID, motor_constant=0.045)), {"motor_constant": (0.0, 0.047)}
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
    weak = DrivenMotor(replace(RIGID, motor_constant=0.045, rotor_viscous=1e-4))
    slow = {"motor_constant": (0.0, 0.047)}
    fit = simulation_error(weak, record, fixed={"resistance": 2.0}, bounds=slow)
    assert calls[2:] == [0]
    assert fit.ending is Ending.INTERRUPTED
    assert Finding("search-cancelled", "", {"steps": fit.iterations, "offset": None}) in fit.findings
    assert fit.cost / len(record) < 1.05 * 0.5 * (0.002 * np.std(record.output)) ** 2


# --- no effect, or a weak one ----------------------------------------------------------------------------------------


def test_a_supply_that_no_command_reaches_is_not_identifiable():
    fit = simulation_error(DrivenMotor(RIGID), driven(noise=0.002), free=(*USUAL, "drive.supply"))
    assert fit.names == USUAL
    (finding,) = [each for each in fit.findings if each.data.get("parameters") == ["drive.supply"]]
    assert finding.code == "not-identifiable"


WITH_SHAFT = DrivenMotor(replace(Motor(), rotor_friction=Friction(8e-3), load_friction=Friction()))
ONE_MASS = DrivenMotor(replace(WITH_SHAFT.motor, inductance=0.0, load_inertia=1e-15, load_viscous=0.0).rigid())


@pytest.mark.parametrize("noise", [pytest.param(0.002, marks=pytest.mark.long), 0.05])
def test_a_shaft_without_effect_on_the_record_is_a_finding(noise):
    record = driven(noise=noise)[:800]
    fit = simulation_error(WITH_SHAFT, record, max_iterations=20)
    assert fit.findings[0].code == "no-shaft-seen"
    rigid = simulation_error(ONE_MASS, record)
    assert 2 * (rigid.cost - fit.cost) < 12.0 * fit.noise_variance
    assert rigid.noise_variance == pytest.approx(noise**2 * np.var(driven(noise=0.0).output), rel=0.1)


def test_a_shaft_with_an_effect_on_the_record_is_estimated():
    record = driven(noise=0.002, motor=Motor())
    fit = simulation_error(WITH_SHAFT, record, max_iterations=20)
    assert {"shaft_stiffness", "shaft_damping"} <= set(fit.names)
    assert "no-shaft-seen" not in [finding.code for finding in fit.findings]
    assert simulation_error(ONE_MASS, record).cost > 20 * fit.cost


def test_an_interval_that_includes_zero_is_a_finding():
    free = (*USUAL, "rotor_friction.stribeck")
    plant = DrivenMotor(replace(RIGID, rotor_friction=replace(RIGID.rotor_friction, stribeck_rate=0.3)))
    fit = simulation_error(plant, driven(noise=0.1), free=free, find_start=False)
    (row,) = [row for row in fit.table if row.name == "rotor_friction.stribeck"]
    assert row.value < 1.96 * row.standard_error
    zero = Finding(
        "intervals-include-zero",
        "rigid-motor",
        {"parameters": ["rotor_friction.stribeck"], "without": ["rotor_friction.stribeck"]},
    )
    assert [finding for finding in fit.findings if finding.code == zero.code] == [zero]
    others = [row for row in fit.table if row.asked and row.name != "rotor_friction.stribeck"]
    assert all(row.value > 1.96 * row.standard_error for row in others)


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
    assert "weakly-identified" not in [finding.code for finding in clean.findings]


# --- values that nobody gave -----------------------------------------------------------------------------------------


def test_estimates_depend_on_every_value_that_nobody_gave_and_moves_them():
    """A Stribeck level and an inductance scale with the resistance as the inertia does."""
    record = record_of(STICTION, noise=0.05)
    fit = simulation_error(STICTION, record, free=("resistance", *FREE, EXCESS))
    assert [row.name for row in fit.assumed] == ["resistance"]
    scaling = ("rotor_inertia", "rotor_friction.coulomb", "rotor_friction.stribeck")
    assert all("resistance" in fit[name].given for name in scaling)
    assert fit["rotor_friction.stribeck_rate"].given == fit["voltage_dead_zone.half_width"].given == ()
    given = simulation_error(STICTION, record, free=(*FREE, EXCESS), fixed={"resistance": 2.0})
    assert not given.assumed
    assert "resistance" in given["rotor_inertia"].given
    sheet = simulation_error(STICTION, record, free=("resistance", *FREE, EXCESS), datasheet={"resistance": 2.0})
    assert sheet["resistance"].status is Status.KEPT
    assert not sheet.assumed
