"""Where a search for a plant begins, and that it ends at the same minimum from there.

The records come from simulators of the tests' own, which share nothing with `emsid.plant`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from emsid import Record
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.restarts import drawn
from emsid.findings import Finding
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.parameters import Measure, Signal
from emsid.models.plants.plant import Sizes
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search import continuation
from emsid.models.plants.search.conclusion import searches_agreeing
from emsid.models.plants.search.estimation import begun_again, beside_kinks, searched, simulation_error
from emsid.models.plants.search.speeds import resolved_rate
from emsid.models.plants.search.starts import motions
from emsid.models.plants.search.task import prepare
from independent.cases import axis, levels
from independent.one_mass import OneMass

RIGID, AXIS = PLANTS["rigid-motor"].start, PLANTS["linear-axis"].start
MOTION = Motion(gain=50.0, damping=4.0, coulomb=30.0, offset=0.0, dead_zone=0.0)


@pytest.mark.parametrize("fixed", [(), ("motor_constant",), ("rotor_inertia",)])
def test_a_motor_has_a_motion_also_with_a_value_that_is_known(fixed):
    known = RIGID.with_values({"motor_constant": 0.03, "rotor_inertia": 1e-3, "rotor_viscous": 0.0, "resistance": 2.0})
    motor = known.with_motion(MOTION, fixed).motor
    inertia = motor.rotor_inertia + motor.load_inertia
    assert motor.motor_constant / (motor.resistance * inertia) == pytest.approx(MOTION.gain, rel=1e-9)
    damping = (motor.motor_constant**2 / motor.resistance + motor.rotor_viscous + motor.load_viscous) / inertia
    assert damping == pytest.approx(max(MOTION.damping, MOTION.gain * motor.motor_constant), rel=1e-6)
    assert motor.rotor_friction.coulomb == pytest.approx((inertia * MOTION.coulomb,) * 2, rel=1e-9)
    for name in fixed:
        assert getattr(motor, name) == getattr(known.motor, name)


def test_a_load_that_is_known_stays_where_a_motor_gets_a_motion():
    known = RIGID.with_values({"resistance": 2.0, "rotor_inertia": 1e-4, "load_inertia": 3e-5})
    motor = known.with_motion(MOTION, ("load_inertia",)).motor
    inertia = motor.motor_constant / (motor.resistance * MOTION.gain)
    assert motor.load_inertia == 3e-5
    assert motor.rotor_inertia == pytest.approx(inertia - 3e-5, rel=1e-9)


@pytest.mark.parametrize(("unit", "torque"), [("V", 0.5 / 4.0), ("A", 0.5), ("N*m", 1.0)])
def test_plausible_friction_is_a_part_of_the_largest_torque(unit, torque):
    motor = RIGID.with_values({"motor_constant": 0.5, "resistance": 4.0})
    motor = motor.for_command(Record(np.ones(9), np.ones(9), 0.01, input_units=unit, output_units="rad/s"))
    assert motor.plausible(Measure.FORCE, Sizes(command=6.0, output=10.0, dt=0.01)) == pytest.approx(0.1 * 6 * torque)


def test_an_axis_of_known_mass_has_the_damping_of_a_motion():
    axis = AXIS.with_values({"mass": 7.0}).with_motion(MOTION, ("mass",))
    assert (axis.mass, axis.viscous_friction) == (7.0, (28.0, 28.0))


def test_friction_of_a_motion_in_one_direction_is_no_offset():
    truth = OneMass(gain=50.0, viscous=(4.0, 4.0), coulomb=(30.0, 30.0), smooth=1e-3)
    u = 2.0 + 0.5 * levels(2000, np.random.default_rng(1), 100)
    record = Record(u, truth.run(u, 2e-3)[0][:2000], 2e-3)
    found = next(motions([record], 0, False, False))
    assert found.offset == 0
    assert found.gain == pytest.approx(50, rel=0.02)
    assert found.coulomb == pytest.approx(30, rel=0.1)


def test_a_draw_moves_no_parameter_further_than_is_plausible():
    rng = np.random.default_rng(0)
    x = rng.standard_normal(400)
    slopes = np.column_stack([x, x + 1e-9 * rng.standard_normal(400), rng.standard_normal(400)])
    residual = rng.standard_normal(400)
    far = drawn(slopes, [residual], np.random.default_rng(1))
    near = drawn(slopes, [residual], np.random.default_rng(1), np.array([2.0, 3.0, 1.0]))
    assert np.abs(far[:2]).min() > 1e4
    assert np.abs(near[:2]).max() < 3
    assert near[2] == pytest.approx(far[2], rel=1e-3)  # well determined: as drawn
    assert near[2] != 0


def test_what_is_kept_is_estimated_where_a_bound_leaves_it_no_choice():
    """Friction by direction and an offset make up for one another, until a friction is zero."""
    truth = OneMass(gain=1.0, viscous=(2.0, 2.0), coulomb=(0.05, 0.05), offset=0.1, smooth=1e-4)
    rng = np.random.default_rng(3)
    u = 0.1 + 3 * lfilter([0.02], [1, -0.98], levels(2400, rng, 150))
    walk = np.cumsum(rng.standard_normal(2400))
    position = truth.run(u, 5e-3, 0.1 * walk / np.std(walk))[1][:2400] + 1e-3 * rng.standard_normal(2400)
    record = Record(u, position, 5e-3, output_units="m")
    others = ("mass", "viscous_friction", "friction.coulomb.forward", "offset")
    reached = searched(AXIS, record, free=(*others, "friction.coulomb.backward"))[2]
    assert reached.problem.plant.value("friction.coulomb.backward") == 0
    without = searched(AXIS, record, free=others, fixed={"friction.coulomb.backward": 0.0})[2]
    assert reached.minimum.cost == pytest.approx(without.minimum.cost, rel=1e-3)


@pytest.mark.parametrize(("most", "again"), [(60, True), (5, False)])
def test_a_search_that_follows_a_rate_without_end_begins_again(most, again):
    truth = OneMass(
        gain=1.0, viscous=(2.0, 2.0), coulomb=(0.2, 0.2), stribeck=(0.2, 0.2), stribeck_speed=0.1, smooth=1e-4
    )
    rng = np.random.default_rng(3)
    u = 1.2 * levels(2000, rng, 60)
    record = Record(u, truth.run(u, 5e-3)[0][:2000] + 5e-3 * rng.standard_normal(2000), 5e-3, output_units="m/s")
    free = ("mass", "viscous_friction", "friction.coulomb", "friction.stribeck", "friction.stribeck_rate")
    start = LinearAxis().with_values({"friction.stribeck": 0.1, "friction.stribeck_rate": 3000.0})
    task = prepare(start, record, free=free, bounds={"friction.stribeck_rate": (0.0, np.inf)})  # no end
    short = continuation.search(task, task.plant, 3)
    finding = Finding("steps-used-up", "", {"steps": 60, "offset": 10.0})
    short = short._replace(minimum=replace(short.minimum, ending=Ending.OUT_OF_BUDGET, findings=(finding,)))
    reached = begun_again(task, short, most)
    assert short.minimum.cost > 1.05 * 0.5 * 2000 * 25e-6
    assert (reached is not short) == again
    if again:
        assert reached.minimum.cost == pytest.approx(0.5 * 2000 * 25e-6, rel=0.1)


def test_no_fit_tells_the_friction_of_simulated_axes_from_a_sharp_one():
    """A free run of a position keeps what creeps at rest, and estimates of friction would make up for it."""
    case = axis(1205, drifts=False)
    sharper = replace(case.truth, smooth=case.truth.smooth / 3)
    runs = [each.run(case.fitted.input[:, 0], case.fitted.dt)[1] for each in (case.truth, sharper)]
    assert np.sum((runs[0] - runs[1]) ** 2) < 3e-4**2, "the likelihood by more than a parameter of noise"


def test_a_search_of_a_position_does_not_end_with_a_mass_that_never_moves():
    """The free run of every start is worse than no motion at all, which no parameter changes."""
    case = axis(102, drifts=True)
    record = replace(case.fitted, output_units=("m",))
    sides = ("viscous_friction.forward", "viscous_friction.backward")
    free = ("mass", *sides, "friction.coulomb", "friction.stribeck", "friction.stribeck_rate")
    reached = searched(AXIS, record, free=free)[2]
    assert reached.minimum.cost < 0.5 * len(record) * case.error_of_truth(case.fitted) ** 2


@pytest.mark.parametrize("is_position", [True, False])
def test_samples_resolve_an_excess_that_lasts_longer_than_a_sample(is_position):
    t = 0.01 * np.arange(300)
    shown, signal = (t**2, Signal.POSITION) if is_position else (2 * t, Signal.SPEED)  # 0.02 m/s per sample
    record = Record(np.ones(300), shown, 0.01)
    assert resolved_rate([record], (signal,)) == pytest.approx(3 / 0.02, rel=0.02)
    assert resolved_rate([record], (Signal.CURRENT,)) == np.inf


def test_noise_that_is_sampled_faster_does_not_lower_the_rate_that_samples_resolve():
    """It lies above the true rate of simulated axes, 1/(15 mm/s), though the change in a sample is mostly noise."""
    rng, found = np.random.default_rng(0), []
    for dt in (1e-3, 2.5e-4, 1e-4):
        t = np.arange(0, 4, dt)
        position = 0.15 * np.sin(2.6 * t) * np.sin(8 * t) + 3e-4 * rng.standard_normal(len(t))
        found.append(resolved_rate([Record(np.ones(len(t)), position, dt)], (Signal.POSITION,)))
    assert found[0] > 1 / 0.015
    assert found[1] > 0.9 * found[0]
    assert found[2] > 0.9 * found[1]


def test_a_search_under_drift_ends_at_the_same_cost_from_other_frictions():
    """With rates beyond what samples resolve, single reversals stick for some samples more or fewer."""
    record = replace(axis(105, drifts=True).fitted, output_units=("m",))
    free = ("mass", "viscous_friction", "friction.coulomb", "friction.stribeck", "friction.stribeck_rate", "offset")
    frictions = ((0.1, 0.0, 0.0), (0.05, 0.03, 60.0), (0.02, 0.08, 2000.0), (0.0, 0.1, 0.1))
    found = [
        searched(AXIS.with_values(dict(zip(free[2:5], values, strict=True))), record, free=free)[2].cost
        for values in frictions
    ]
    assert found == pytest.approx([min(found)] * len(found), rel=0.01)


def stuck_at(values, fixed, free, stopped, record):
    """Where a search ends that does not estimate some parameters, and the same begun again beside its kinks."""
    start = AXIS.with_values({**fixed, **values})
    left = [name for name in free if name not in stopped]
    stuck = continuation.search(prepare(start, record, free=left, fixed=fixed, from_datasheet=False), start, 60)
    task = prepare(start, record, free=free, fixed=fixed, from_datasheet=False)
    return stuck, beside_kinks(task, stuck, 60)


@pytest.mark.parametrize(("lower", "cost", "ends"), [(True, 1.0, (5.0, 4.0, 2.0)), (False, 2.0, (5.0, 4.0, 3.0))])
def test_the_better_of_two_searches_knows_where_the_other_ended(lower, cost, ends):
    record = Record(np.tile([1.0, -1.0], 20).repeat(5), np.zeros(200), 0.01, output_units="m/s")
    record = replace(record, output=np.cumsum(record.input, axis=0))
    found = continuation.search(prepare(AXIS, record, free=("mass",)), AXIS, 0)

    def ended(cost, *ends):
        return found._replace(minimum=replace(found.minimum, cost=cost), ends=ends, compared=7)

    better = ended(2.0, 5.0).or_better(ended(1.0 if lower else 3.0, 4.0)._replace(compared=1))
    assert (better.cost, better.ends, better.compared) == (cost, ends, 7)


def test_searches_agree_that_end_within_one_per_cent_of_a_minimum():
    said = searches_agreeing("linear-axis", 1.0, [0.999, 1.009, 1.02, 3.0])
    assert said.data == {"searches": 5, "agreeing": 3, "compared": 1}


def test_a_fit_says_how_many_searches_ended_at_its_minimum():
    """With an estimated delay a search begins again beside it; without, only the best start is searched to its end."""
    u = 12 * levels(300, np.random.default_rng(0), 15)
    truth = RIGID.with_values({"drive.delay": 0.013})
    at_rest = np.array([0.0, 0.0, 0.0, 1.0])
    speed = truth.simulate(u[:, None], 1e-2, at_rest, (Signal.SPEED,))[:, 0]
    record = Record(u, speed + 0.05 * np.random.default_rng(1).standard_normal(300), 1e-2, output_units="rad/s")

    def said(*free):
        fit = simulation_error(RIGID, record, free=("motor_constant", *free), hold="zero")
        return next(finding.data for finding in fit.findings if finding.code == "searches-agreeing")

    assert said("rotor_inertia")["searches"] == 1
    assert said("rotor_inertia")["compared"] > 10
    beside = said("rotor_inertia", "drive.delay")
    assert beside["searches"] == beside["agreeing"] == 2


@pytest.mark.parametrize(
    ("values", "stopped"),
    [
        ((0.3, 0.0, 1e4), ("friction.stribeck", "friction.stribeck_rate")),
        ((0.15, 0.15, 0.01), ("friction.stribeck", "friction.stribeck_rate")),
        ((0.15, 0.15, 0.6), ("friction.stribeck", "friction.stribeck_rate")),
        ((0.0, 0.8, 40.0), ("friction.coulomb", "friction.stribeck")),
    ],
    ids=["excess zero", "excess that does not fade", "excess that hardly fades", "exchanged"],
)
def test_a_search_of_friction_comes_back_to_both_its_parts(values, stopped):
    truth = OneMass(gain=1.0, viscous=(2.0, 2.0), coulomb=(0.2, 0.2), stribeck=(0.2, 0.2), stribeck_speed=0.1)
    rng = np.random.default_rng(3)
    u = 1.2 * levels(2000, rng, 60)
    record = Record(u, truth.run(u, 5e-3)[0][:2000] + 5e-3 * rng.standard_normal(2000), 5e-3, output_units="m/s")
    friction = ("friction.coulomb", "friction.stribeck", "friction.stribeck_rate")
    free, fixed = ("viscous_friction", *friction), {"mass": 1.0}
    stuck, reached = stuck_at(dict(zip(friction, values, strict=True)), fixed, free, stopped, record)
    assert stuck.cost > 1.05 * reached.cost
    assert reached.cost == pytest.approx(0.5 * 2000 * 25e-6, rel=0.1)


def test_a_search_exchanges_the_lag_of_a_sensor_and_the_time_constant_of_a_mass():
    """They commute in a linear system; friction at rest tells them apart. A small mass is not estimated any more."""
    true = {"mass": 1.0, "viscous_friction": 2.0, "friction.coulomb": 0.3, "sensor.lag": 0.03}
    rng, dt = np.random.default_rng(3), 0.01
    u = levels(2000, rng, 60)
    speed = AXIS.with_values(true).simulate(u[:, None], dt, np.zeros(3), (Signal.SPEED,))[:, 0]
    record = Record(u, speed + 2e-3 * rng.standard_normal(2000), dt, output_units="m/s")
    exchanged = {**true, "mass": 0.06, "sensor.lag": 0.5}
    stuck, reached = stuck_at(exchanged, {}, tuple(true), ("mass",), record)
    assert stuck.cost > 1.5 * reached.cost
    assert reached.problem.plant.value("mass") == pytest.approx(1.0, rel=0.02)
    assert reached.problem.plant.value("sensor.lag") == pytest.approx(0.03, rel=0.1)
