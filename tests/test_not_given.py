"""What a motor is said to be when nobody gave its resistance or its viscous friction.

The records come from a simulator of this file: exact steps of one mass with Coulomb friction, which stops at zero.
"""

import json

import numpy as np
import pytest

import emsid
from emsid.cli.terminal import physical_table as on_screen
from emsid.identification.result import determined
from emsid.models.plants.search.choice import STARTS
from emsid.models.plants.search.estimation import simulation_error
from emsid.report.notebook import parameter_rows
from emsid.report.views.grey_box import physical_table

R, K, J, COULOMB, DT = 0.5, 0.05, 2e-5, 0.004, 1e-3
TRUE = {"resistance": R, "motor_constant": K, "rotor_inertia": J, "rotor_friction.coulomb": COULOMB}


def motor_record(seed=0, viscous=0.0, current=False, samples=1200):
    """Voltage steps, and noisy speed and current of a motor."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-10, 10, samples // 40), 40)
    damping = (K * K / R + viscous) / J
    speed, readings = 0.0, []
    for volts in u:
        readings.append((speed, (volts - K * speed) / R))
        left = DT
        while left > 0:
            torque = K * volts / R
            if speed == 0.0 and abs(torque) <= COULOMB:
                break
            side = np.sign(speed) if speed else np.sign(torque)
            end = (torque - side * COULOMB) / J / damping
            after = end + (speed - end) * np.exp(-damping * left)
            if after * side >= 0:
                speed, left = after, 0.0
            else:
                left -= np.log(1 - speed / end) / damping
                speed = 0.0
    noisy = np.array(readings) + rng.standard_normal((len(u), 2)) * (0.5, 0.02)
    units = ("rad/s", "A") if current else ("rad/s",)
    output = noisy if current else noisy[:, :1]
    names = ("speed", "current")[: len(units)]
    return emsid.Record(
        u, output, DT, input_names=("voltage",), output_names=names, input_units=("V",), output_units=units
    )


def true_quantities(viscous=0.0):
    damping = K * K / R + viscous
    return {
        "mechanical time constant": J / damping,
        "speed per volt": K / R / damping,
        "Coulomb voltage forward": R * COULOMB / K,
        "Coulomb voltage backward": R * COULOMB / K,
    }


def misses(fit, truth):
    """The names of what a fit says without a condition on an assumed value, and what is outside of its interval."""
    rows = {row.name: row.interval for row in determined(fit)}
    rows |= {each.quantity.name: each.interval for each in fit.known_combinations}
    return [name for name, value in truth.items() if name in rows and not rows[name][0] <= value <= rows[name][1]]


@pytest.fixture(scope="module")
def without_help():
    return emsid.identify(motor_record(), models="rigid-motor")


def test_nobody_is_told_a_wrong_inertia(without_help):
    fit = without_help.chosen
    assert [row.name for row in fit.assumed] == ["resistance"]
    known = {row.name for row in determined(fit)}
    assert known.isdisjoint({"rotor_inertia", "rotor_friction.coulomb", "resistance"})
    assert fit["rotor_inertia"].status == "depends on assumed values"
    assert not misses(fit, TRUE | true_quantities())
    assert {"mechanical time constant", "speed per volt"} <= {each.name for each in without_help.characteristics}


def test_the_first_step_is_to_measure_what_was_assumed(without_help):
    why, first, *_ = without_help.recommendation
    assert (why.code, first.code) == ("model-recommended", "next-measure")
    assert first.data == {"parameters": ["resistance"], "current": True}


def test_the_same_is_in_the_file_and_the_table(without_help):
    (fit,) = json.loads(json.dumps(without_help.to_data()))["fits"]
    assert fit["assumed"] == ["resistance"]
    status = {row["name"]: row["status"] for row in fit["parameters"]}
    assert status["rotor_inertia"] == status["rotor_friction.coulomb"] == "depends on assumed values"
    assert {row.name: row.status for row in without_help.chosen.table} == status
    assert without_help.chosen["rotor_inertia"].how == "assuming resistance"


def test_every_quantity_stands_once_and_the_gains_of_a_feedforward_are_named(without_help):
    """Without a dead zone and a higher level at rest, Coulomb voltage and break-away voltage are the voltage lost."""
    known = {each.name: each for each in without_help.characteristics}
    truth = {
        "voltage lost (kS) forward": (R * COULOMB / K, "V"),
        "voltage per speed (kV)": (K, "V*s/rad"),
        "voltage per acceleration (kA)": (R * J / K, "V*s^2/rad"),
    }
    for name, (value, unit) in truth.items():
        assert abs(known[name].value - value) <= 1.5 * known[name].half_width
        assert known[name].unit == unit
    assert not [name for name in known if name.startswith(("Coulomb voltage", "break-away"))]


def test_a_value_whose_interval_includes_zero_is_a_bound_everywhere():
    """A constant torque of the load that is not there."""
    free = ["motor_constant", "rotor_inertia", "rotor_friction.coulomb", "load_torque"]
    known = {"resistance": R, "rotor_viscous": 0.0}
    fit = simulation_error(STARTS["rigid-motor"], motor_record(), fixed=known, free=free)
    row = fit["load_torque"]
    low, high = row.interval
    assert low < 0 < high
    bound = f"less than {max(-low, high):.2g}"
    assert (row.may_be_zero, row.how) == (True, "estimated, interval includes zero")
    assert not fit["rotor_inertia"].may_be_zero
    (line,) = [each for each in parameter_rows(fit) if each.name == "load_torque"]
    assert line.value == bound
    assert "interval includes zero" in line.interval
    (cells,) = [each for each in physical_table(fit)[0].rows if each[0] == "load_torque"]
    assert cells[5] == bound
    columns = [[str(cell) for cell in column.cells] for column in on_screen(fit).columns]
    at = columns[0].index("load_torque")
    assert (columns[2][at], columns[3][at]) == (bound, "")


@pytest.mark.parametrize("help_", [{"fixed": {"resistance": R}}, {"current": True}])
def test_a_resistance_that_is_given_or_measured_makes_the_inertia_known(help_):
    record = motor_record(current="current" in help_)
    fit = simulation_error(STARTS["rigid-motor"], record, fixed=help_.get("fixed"))
    assert not fit.assumed
    low, high = fit["rotor_inertia"].interval
    assert low <= J <= high
    assert high - low < 0.3 * J
    assert not misses(fit, TRUE)


@pytest.mark.parametrize("share", [0.0, 0.02, 0.08])
def test_intervals_include_the_viscous_friction_that_nobody_gave(share):
    """Of the damping by the voltage, K²/R, a share is viscous friction."""
    viscous = share * K * K / R
    fit = simulation_error(STARTS["rigid-motor"], motor_record(viscous=viscous), fixed={"resistance": R})
    assert not misses(fit, TRUE | true_quantities(viscous))
    (finding,) = [each for each in fit.findings if each.code == "damping-open"]
    assert finding.data["most"] == pytest.approx(0.1 * K * K / R, rel=0.3)
    assert {"motor_constant", "rotor_inertia"} <= set(finding.data["parameters"])
    given = simulation_error(
        STARTS["rigid-motor"], motor_record(viscous=viscous), fixed={"resistance": R, "rotor_viscous": viscous}
    )
    assert given["motor_constant"].standard_error < 0.05 * fit["motor_constant"].standard_error
