"""What a fit of a plant is given: names, values, bounds and records; those that cannot be are refused."""

from dataclasses import replace

import numpy as np
import pytest

from coverage_grey_box import FREE, MOTOR
from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Ending
from emsid.findings import Finding
from emsid.models.plants.datasheet import Given
from emsid.models.plants.drive import Drive
from emsid.models.plants.free_run_error import Recent
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import QUICKEST, DrivenMotor
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import Status
from emsid.models.plants.sensor import Sensor
from simulated_plants import DT, RIGID, USUAL, codes, driven, record_of

GOOD = record_of(MOTOR)


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (replace(GOOD, output=np.zeros(2000)), "output y1 stays at 0 throughout; nothing moves"),
        (replace(GOOD, input=np.full(2000, 3.0)), "input u1 stays at 3 throughout; nothing drives it"),
        (replace(GOOD, output_units=("m/s",)), "is in m/s, rigid-motor gives a speed in rad/s"),
        (replace(GOOD, input=np.ones((2000, 2)), input_names=(), input_units=()), "2 inputs for rigid-motor"),
    ],
)
def test_records_of_other_channels_are_refused(record, message):
    with pytest.raises(DataError, match=message):
        simulation_error(MOTOR, record, free=FREE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"free": ["resistence"]}, r"rigid-motor has no parameter 'resistence'; did you mean resistance\?"),
        ({"free": ["shaft_stiffness"]}, "rigid-motor has no parameter 'shaft_stiffness'"),
        ({"free": ["resistance"], "fixed": {"resistance": 1.0}}, "resistance is both free and fixed at 1"),
        ({"free": ["resistance"], "bounds": {"resistance": (3.0, 4.0)}}, "of resistance exclude its start 2"),
        ({"free": ["resistance"], "bounds": {"resistance": (4.0, 3.0)}}, "they must ascend"),
        ({"free": ["resistance"], "bounds": {"inductance": (0.0, 1.0)}}, "bounds for inductance, which is not free"),
        (
            {
                "free": ["resistance"],
                "datasheet": {"resistance": Given(2.0, 0.1)},
                "bounds": {"resistance": (5.0, 6.0)},
            },
            "they contradict each other",
        ),
        (
            {"fixed": {"resistance": 9.0}, "datasheet": {"resistance": Given(2.0, 0.1)}},
            r"resistance is fixed at 9 and the datasheet has it within \[1.8, 2.2\]",
        ),
        ({"free": ["rotor_friction.coulomb", "rotor_friction.coulomb.forward"]}, "overlap: both set one value"),
        (
            {"free": ["rotor_friction.coulomb"], "fixed": {"rotor_friction.coulomb.forward": 1e-3}},
            "rotor_friction.coulomb and rotor_friction.coulomb.forward overlap: both set one value",
        ),
        ({"free": []}, "no parameter of rigid-motor is free"),
        ({"fixed": {"resistance": -1.0}}, "motor resistance is -1 Ω; it must be positive"),
    ],
)
def test_impossible_arguments_are_refused(arguments, message):
    with pytest.raises(ModelError, match=message):
        simulation_error(MOTOR, GOOD, **arguments)


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
        simulation_error(DrivenMotor(RIGID), driven(), **arguments)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Given(float("nan")), "datasheet value nan; give a finite number"),
        (lambda: Given(None, 0.1), "datasheet tolerance 0.1 of None"),
        (lambda: Given(1.0, -0.1), "datasheet tolerance -0.1 of 1.0"),
        (lambda: Recent(0.0), r"0\.0 s, order 1; give a positive time"),
        (lambda: Drive(gain=0.0), "drive with gain 0.0 .*the gain not 0"),
        (lambda: Drive(delay=-1.0), "drive with a delay of -1.0 s"),
        (lambda: Drive(supply=0.0), "drive with a supply of 0.0 V"),
        (lambda: Drive(freewheel=0.5), "needs its supply voltage: give drive.supply"),
        (lambda: Drive(freewheel=2.0, supply=1.0), "drive with freewheel 2.0"),
        (lambda: Drive(knee=0.0), "drive with a knee at 0.0 V"),
        (lambda: Drive(beyond=-1.0), "-1.0 times beyond"),
        (lambda: Sensor(ratio=0.0), "sensor with ratio 0.0 .*the ratio not 0"),
        (lambda: Sensor(lag=-1.0), "sensor with a lag of -1.0 s"),
        (lambda: LinearAxis(mass=0.0), "a mass of 0.0 kg"),
        (lambda: LinearAxis(viscous_friction=-1.0), r"viscous friction \(-1.0, -1.0\)"),
        (lambda: LinearAxis(offset=np.inf), "an offset of inf N"),
    ],
)
def test_values_that_are_not_physical_are_refused_by_name(build, message):
    with pytest.raises(ModelError, match=message):
        build()


def test_what_is_fixed_may_have_a_unit():
    fits = [
        simulation_error(DrivenMotor(RIGID), driven(), free=USUAL[1:], fixed={"motor_constant": value})
        for value in ("51 mN*m/A", 0.051)
    ]
    assert fits[0].estimate == pytest.approx(fits[1].estimate, rel=1e-9)
    assert [row.value for row in fits[0].table if row.status is Status.FIXED] == pytest.approx([0.051])


# --- bounds ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "side", "because"),
    [
        ({"bounds": {"motor_constant": (0.0501, 0.06)}}, "lower", "bounds"),
        ({"bounds": {"motor_constant": (0.04, 0.0499)}}, "upper", "bounds"),
        ({"datasheet": {"motor_constant": Given(0.055, 0.05)}}, "lower", "datasheet"),
        ({"fixed": {"voltage_dead_zone.half_width": 1.2}}, "lower", "physical"),
    ],
    ids=["lower", "upper", "datasheet", "physical"],
)
def test_a_parameter_at_a_bound_is_found_with_the_origin_of_the_bound(arguments, side, because):
    free = [name for name in FREE if name not in arguments.get("fixed", {})]
    start = MOTOR.with_values({"motor_constant": arguments.get("bounds", {}).get("motor_constant", (0.055,))[0]})
    fit = simulation_error(start, GOOD, free=free, **arguments)
    (finding,) = [each for each in fit.findings if each.code == "parameter-at-bound"]
    (row,) = [row for row in fit.table if row.status is Status.AT_BOUND]
    assert finding == Finding("parameter-at-bound", row.name, {"side": side, "bound": row.value, "because": because})


def test_a_parameter_whose_bounds_are_one_value_is_not_reported_at_a_bound():
    fit = simulation_error(MOTOR, GOOD, free=FREE, datasheet={"motor_constant": Given(0.051, 0.0)})
    assert "parameter-at-bound" not in codes(fit)


@pytest.mark.parametrize(
    ("wanted", "ending", "code"), [(3, Ending.CONVERGED, "minimum-not-smooth"), (7, Ending.STALLED, "search-stalled")]
)
def test_a_fit_that_stalls_says_whether_others_end_there_too(monkeypatch, wanted, ending, code):
    def in_steps(error, dt):  # its derivative leads astray
        return np.round(error, 3)

    monkeypatch.setattr("emsid.estimation.nonlinear.restarts.AGREEING", wanted)  # of 6
    bounds = {"motor_constant": (0.0501, 0.06)}
    fit = simulation_error(
        MOTOR.with_values({"motor_constant": 0.0501}),
        GOOD,
        free=FREE,
        bounds=bounds,
        weighting=in_steps,
        find_start=False,
    )
    assert fit.ending is ending
    assert {code, "parameter-at-bound"} <= set(codes(fit))
    (said,) = [finding for finding in fit.findings if finding.code == code]
    assert said.data["starts"] == 7
    assert 4 <= said.data["agreeing"] <= 7


def test_an_inductance_below_the_sample_time_ends_at_the_bound_of_the_sample_time():
    free = (*USUAL, "inductance")
    fit = simulation_error(DrivenMotor(RIGID), driven(noise=0.01)[:600], free=free)
    (row,) = [row for row in fit.table if row.name == "inductance"]
    assert row.status is Status.AT_BOUND
    assert row.value == pytest.approx(QUICKEST * DT * RIGID.resistance)
    data = {"side": "lower", "bound": row.value, "because": "sample-time"}
    assert Finding("parameter-at-bound", "inductance", data) in fit.findings


@pytest.mark.parametrize(
    "how", [{"bounds": {"inductance": (1e-4, 1.0)}}, {"datasheet": {"inductance": Given(2e-4, 0.5)}}]
)
def test_bounds_or_a_datasheet_of_the_inductance_replace_that_bound(how):
    motor = replace(RIGID, inductance=2e-4)
    fit = simulation_error(
        DrivenMotor(motor), driven(noise=0.001, motor=motor)[:400], free=(*USUAL, "inductance"), **how
    )
    assert fit.limits["inductance"][0] == pytest.approx(1e-4)
    assert fit.estimate[-1] == pytest.approx(2e-4, rel=0.3)


def test_an_inductance_may_be_known_to_be_zero():
    """With an inductance a motor has a quantity more, its electrical time constant."""
    fit = simulation_error(MOTOR, GOOD, free=FREE, fixed={"inductance": 0.0})
    plain = simulation_error(MOTOR, GOOD, free=FREE)
    assert [each.quantity.name for each in fit.combinations] == [each.quantity.name for each in plain.combinations]
    assert fit.cost == plain.cost
