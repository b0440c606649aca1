"""What a fit of a plant shows of itself: likelihood profiles, curves and standstills."""

from dataclasses import replace

import numpy as np
import pytest

from coverage_grey_box import (
    EXCESS,
    FREE,
    MOTOR,
    STICTION,
    coverage_of_an_excess,
    least_share,
    simulated_record,
)
from emsid.errors import ModelError
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.findings import Finding
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.search.diagnostics import dead_zone_curve, friction_curve, likelihood_profile, stops
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import Status
from emsid.models.plants.sensor import Sensor
from emsid.plant import simulate
from emsid.plant.motor import Parameter
from emsid.record import Record
from emsid.report.views.grey_box import likelihood
from simulated_plants import DT, SPEED, VOLTAGE, record_of


def lag_of(gain, start):
    """dx/dt = 5(u − x), y = gain(p)·x: only the gain is a parameter."""
    table = (Parameter("p", "p", "1", "what the gain depends on"),)
    return OwnPlant(lambda x, u, p: [5 * (u[0] - x[0])], lambda x, u, p: [gain(p[0]) * x[0]], table, (start,), 1)


def noisy_lag(noise, samples=120):
    rng = np.random.default_rng(4)
    u = np.repeat(rng.standard_normal(samples // 10), 10)[:, None]
    y = lag_of(lambda p: p, 1.0).simulate(u, 0.1, np.zeros(1), SPEED)
    return Record(u, y + noise * rng.standard_normal(y.shape), 0.1)


def test_the_profile_of_what_the_output_is_linear_in_is_its_quadratic_approximation():
    profile = likelihood_profile(simulation_error(lag_of(lambda p: p, 0.8), noisy_lag(1.0)), "p")
    steps = (profile.values - profile.estimate) / profile.standard_error
    end = np.sqrt(profile.limit)
    assert steps == pytest.approx([-3, -2.25, -end, -1.5, -0.75, 0, 0.75, 1.5, end, 2.25, 3], abs=0.01)
    colour = profile.deviance[-1] / 9
    assert profile.deviance == pytest.approx(colour * steps**2, rel=1e-4, abs=1e-9)
    assert colour == pytest.approx(1.0, rel=0.01)
    assert profile.between(np.array(profile.interval)) == pytest.approx([profile.limit] * 2)
    assert profile.limit == pytest.approx(3.841459)


def test_a_profile_interval_does_not_depend_on_how_a_parameter_is_written():
    record = noisy_lag(3.0)
    plain = likelihood_profile(simulation_error(lag_of(lambda p: p, 0.8), record), "p")
    bent_fit = simulation_error(lag_of(lambda p: p**3, 0.8), record)
    bent = likelihood_profile(bent_fit, "p")
    low, high = bent.interval
    assert (low**3, high**3) == pytest.approx(plain.interval, rel=1e-3)
    (approximate,) = bent_fit.interval()
    assert np.max(np.abs(approximate - bent.interval)) > 0.1 * np.ptp(approximate)  # which does depend on it


def test_a_profile_ends_at_a_bound_and_is_open_where_the_record_sets_none():
    record = noisy_lag(0.4)
    saturating = simulation_error(lag_of(lambda p: 1.05 * np.tanh(p), 1.5), record)
    profile = likelihood_profile(saturating, "p")
    assert profile.interval[1] == np.inf
    assert 0 < profile.interval[0] < profile.estimate
    assert np.isfinite(profile.interval[0])
    assert profile.interval[1] == np.inf
    bounds = {"p": (0.0, profile.estimate + 1.0)}
    bounded = likelihood_profile(simulation_error(lag_of(lambda p: 1.05 * np.tanh(p), 1.5), record, bounds=bounds), "p")
    assert bounded.interval[1] == bounds["p"][1]
    assert bounded.interval[0] == pytest.approx(profile.interval[0], rel=0.01)


def test_a_profile_fits_every_other_parameter_and_the_initial_states():
    fit = simulation_error(MOTOR, [simulated_record(np.random.default_rng(k), samples=500) for k in (1, 2)], free=FREE)
    profile = likelihood_profile(fit, "rotor_inertia")
    value = float(profile.values[-1])
    again = simulation_error(
        fit.model.plant.with_values({"rotor_inertia": value}),
        fit.segments,
        free=[name for name in FREE if name != "rotor_inertia"],
        find_start=False,
    )
    deviance = 2 * (again.cost - fit.cost) / fit.noise_variance / fit.colour[FREE.index("rotor_inertia")]
    assert profile.deviance[-1] == pytest.approx(deviance, rel=1e-3)


def test_an_interrupted_profile_raises_stopped():
    fit = simulation_error(MOTOR, simulated_record(np.random.default_rng(3), samples=300), free=FREE[:2])
    calls = iter(range(1000))

    with pytest.raises(Stopped):
        likelihood_profile(fit, "motor_constant", control=Control(cancelled=lambda: next(calls) == 12))


def test_an_excess_estimated_as_zero_has_the_interval_of_its_profile():
    free = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb", EXCESS)
    rng = np.random.default_rng(78)  # the first of few records with this estimate; others take a fit each
    records = (simulated_record(rng, noise=3.0, motor=STICTION) for _ in range(100))
    fit = next(fit for fit in (simulation_error(STICTION, r, free=free) for r in records) if fit.estimate[-1] == 0)
    assert fit[EXCESS].status is Status.AT_BOUND
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


def test_curves_standstills_and_profile_of_a_fit():
    fit = simulation_error(MOTOR, simulated_record(np.random.default_rng(3)), free=FREE)
    friction = friction_curve(fit, 51)
    assert repr(friction).endswith("friction torque, 51 points)")
    assert friction.to_frame()["y"].to_list() == friction.y.tolist()
    (axes,) = friction.plot().axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Speed ω [rad/s]", "Friction torque [N·m]")
    assert np.all((friction.low <= friction.y) & (friction.y <= friction.high))
    assert friction.y[25] == 0
    zone = dead_zone_curve(fit, 51)
    assert zone is not None
    assert zone.support.sum() > 0
    sticking = np.concatenate([run[:, 0] == 0 for run in fit.simulated()])
    assert len(stops(fit)) == np.count_nonzero(np.diff(np.concatenate([[0], sticking, [0]])) == 1)
    profile = likelihood_profile(fit, "motor_constant")
    assert profile.interval == pytest.approx(tuple(fit.interval()[0]), rel=2e-3)
    with pytest.raises(ModelError, match="was not estimated; profiles can be had of motor_constant"):
        likelihood_profile(fit, "inductance")


def test_standstills_are_those_of_the_motor_and_not_of_the_sensor_and_say_in_which_segment():
    sensor = Sensor(ratio=-3.0, lag=0.03, offset=0.2, average=True)
    plant = replace(MOTOR, sensor=sensor)
    commands = (VOLTAGE[:400], np.repeat([0.0, 4.0, 0.0], 100))
    pieces = [replace(record_of(plant, u), name=name) for u, name in zip(commands, ("sines", "pulse"), strict=True)]
    pieces[1] = replace(pieces[1], times=(7.0,))
    fit = simulation_error(plant, pieces, free=("motor_constant",), find_start=False)
    found = stops(fit)
    assert [fit.segments[stop.segment].name for stop in found][-2:] == ["pulse", "pulse"]
    for k, u in enumerate(commands):
        exact = simulate(MOTOR.motor, u, DT).load_held
        shown = np.zeros(len(u), dtype=bool)
        for stop in found:
            if stop.segment == k:
                first, last = np.rint((np.array([stop.start, stop.end]) - fit.segments[k].time[0]) / DT).astype(int)
                shown[first : last + 1] = True
        assert np.array_equal(shown, exact)
        assert exact.any()
    speeds = np.abs(simulate(MOTOR.motor, commands[0], DT).load_speed)
    assert friction_curve(fit, 11).x[-1] == pytest.approx(np.max(speeds), rel=1e-4)  # of the motor, not of the log
