"""Which motors of a fleet are named: false alarms, faults that are found, changes in time."""

import numpy as np
import pytest

from emsid.fleets.spread import (
    ALPHA,
    Outlier,
    Series,
    Spread,
    causes,
    changes,
    largest_step,
    outliers,
    reasons,
    series_of,
)
from emsid.fleets.work import FleetRow, Value


def series(
    values: np.ndarray, errors: np.ndarray | float, name: str = "inertia", unit: str = "kg*m^2", noise: bool = False
) -> Series:
    motors, periods = values.shape
    names = tuple(f"M{k:03d}" for k in range(motors))
    return Series(
        name,
        unit,
        names,
        tuple(f"p{k:03d}" for k in range(periods)),
        values,
        np.broadcast_to(errors, values.shape),
        noise,
    )


def fleet(rng: np.random.Generator, motors: int, periods: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Estimates (m, T) of healthy motors, with errors of unequal size, and these standard errors."""
    errors = 0.02 * rng.uniform(0.3, 3.0, (motors, periods))
    own = 1 + 0.03 * rng.standard_normal((motors, 1))
    return own + errors * rng.standard_normal((motors, periods)), errors


@pytest.mark.parametrize("motors", [10, 40, 400])
def test_a_healthy_fleet_seldom_has_a_motor_named(motors: int) -> None:
    """Of 400 fleets at most 20 are expected to name a motor; 34 is the 99.9 % point of that number."""
    rng = np.random.default_rng(motors)
    named = sum(bool(outliers([series(*fleet(rng, motors)), series(*fleet(rng, motors), "k")])[0]) for _ in range(400))
    assert named <= 34


def test_a_healthy_fleet_seldom_has_a_change_named() -> None:
    rng = np.random.default_rng(7)
    named = sum(bool(changes([series(*fleet(rng, 12, 30))])) for _ in range(400))
    assert named <= 34


def test_many_worn_motors_do_not_decide_what_is_ordinary() -> None:
    rng = np.random.default_rng(3)
    values, errors = fleet(rng, 100)
    values[:30] += 0.6
    found, ordinary = outliers([series(values, errors)])
    assert {each.motor for each in found} == {f"M{k:03d}" for k in range(30)}
    assert ordinary["inertia"].centre == pytest.approx(1.0, abs=0.05)


def test_an_uncertain_estimate_is_judged_by_its_own_error() -> None:
    values, errors = fleet(np.random.default_rng(4), 100)
    values[0], errors[0] = 2.0, 0.5  # two standard errors away: not unusual
    values[1], errors[1] = 2.0, 0.01
    assert [each.motor for each in outliers([series(values, errors)])[0]] == ["M001"]


def test_an_outlier_has_value_interval_and_fleet() -> None:
    values = np.append(np.linspace(0.9, 1.1, 21), 3.0)[:, None]
    (found,), _ = outliers([series(values, 0.01)])
    assert isinstance(found, Outlier)
    assert (found.motor, found.parameter, found.unit) == ("M021", "inertia", "kg*m^2")
    assert (found.value, found.half_width) == (3.0, pytest.approx(1.96 * 0.01, rel=1e-3))
    assert found.centre == pytest.approx(np.median(values))
    assert found.score > 20


def test_few_motors_have_no_ordinary_spread() -> None:
    values = np.array([1.0, 1.0, 1.01, 0.99, 9.0])[:, None]
    assert outliers([series(values, 0.01)]) == ([], {})


def test_estimates_without_intervals_are_compared_by_their_spread() -> None:
    rows = [FleetRow(f"M{k}", "", estimates={"a1": Value(1 + 0.01 * (k % 5), float("nan"), "")}) for k in range(20)]
    rows.append(FleetRow("M99", "", estimates={"a1": Value(2.0, float("nan"), "")}))
    assert [each.motor for each in outliers(series_of(rows))[0]] == ["M99"]


def test_the_spread_of_motors_is_what_the_errors_leave() -> None:
    rng = np.random.default_rng(5)
    values = 1 + 0.03 * rng.standard_normal(20_000) + 0.04 * rng.standard_normal(20_000)
    found = Spread.of(values, np.full(20_000, 0.04), 3.0)
    assert found.deviation == pytest.approx(0.05, rel=0.03)
    assert found.of_motors == pytest.approx(0.03, rel=0.06)


def test_a_worn_motor_is_named_with_the_period_of_its_change() -> None:
    rng = np.random.default_rng(6)
    values, errors = fleet(rng, 20, 40)
    season = 0.2 * np.sin(np.arange(40) / 6)  # of the whole fleet: no motor has changed by it
    values += season
    values[11, 25:] += 0.15
    (found,) = changes([series(values, errors)])
    assert found.motor == "M011"
    assert found.since in {"p024", "p025", "p026"}
    assert abs(found.after - found.before - 0.15) < 1.5 * found.half_width


def test_a_single_motor_over_time_has_its_change_named() -> None:
    values = np.r_[np.ones(10), np.full(10, 1.2)][None, :] + 0.01 * np.random.default_rng(8).standard_normal((1, 20))
    (found,) = changes([series(values, 0.01)])
    assert found.since == "p010"


def test_missing_periods_are_passed_over() -> None:
    values, errors = fleet(np.random.default_rng(9), 12, 20)
    values[3, 5:9] = np.nan
    values[4, :] = np.nan
    values[3, 12:] += 0.5
    assert [(change.motor, change.since) for change in changes([series(values, errors)])] == [("M003", "p012")]


def test_the_largest_step_is_the_best_of_all_steps() -> None:
    """Against every step, one by one."""
    rng = np.random.default_rng(10)
    x, variance = rng.standard_normal(15), rng.uniform(0.5, 2, 15)

    def score(at: int) -> float:
        ends = [np.average(part, weights=1 / v) for part, v in ((x[:at], variance[:at]), (x[at:], variance[at:]))]
        return (ends[1] - ends[0]) / np.sqrt(1 / (1 / variance[:at]).sum() + 1 / (1 / variance[at:]).sum())

    found = largest_step(x, variance)
    every = {at: score(at) for at in range(2, 14)}
    best = max(every, key=lambda at: abs(every[at]))
    assert found is not None
    assert found[:2] == (pytest.approx(every[best]), best)
    assert largest_step(x[:3], variance[:3]) is None


def test_failures_are_grouped_by_reason() -> None:
    rows = [FleetRow(f"M{k}", "", reason=f"/data/M{k}.csv: row {k} is damaged") for k in range(3)] + [
        FleetRow("X", "", reason="no")
    ]
    assert [len(reason) for reason in reasons(rows).values()] == [3, 1]
    assert 0 < ALPHA < 0.1


UNITS = {"K": "N*m/A", "J": "kg*m^2", "B": "N*m*s/rad", "friction": "N*m", "zone": "V"}
SIZES = {"K": 0.05, "J": 5e-5, "B": 2e-5, "friction": 0.01, "zone": 0.5}


def named_causes(
    rng: np.random.Generator, motors: int, faults: dict[int, dict[str, float]]
) -> list[tuple[str, str, float]]:
    """Motor, likeliest cause and factor in a fleet of motors in which parameters of some have other factors."""
    every = []
    for name, unit in UNITS.items():
        values, errors = fleet(rng, motors)
        for motor, factors in faults.items():
            values[motor] *= factors.get(name, 1.0)
            errors[motor] *= factors.get(name, 1.0)
        every.append(series(SIZES[name] * values, SIZES[name] * errors, name, unit))
    found, ordinary = outliers(every)
    return [(each.motor, each.causes[0], each.factor) for each in causes(every, found, ordinary)]


def test_one_cause_is_named_by_its_signature() -> None:
    """A resistance 1.37 times that of the fleet, a gear, and a drive; a load and worn bearings are no such cause."""
    torque, gear, drive = 1.37, 0.7, 1.4
    faults = {
        3: dict.fromkeys(("J", "B", "friction"), torque),
        5: {"K": gear, "J": gear**2, "B": gear**2, "friction": gear},
        7: {"K": drive, "J": drive**2, "B": drive**2, "friction": drive**2, "zone": drive},
        9: {"J": 1.6},
        11: {"friction": 1.8},
    }
    wanted = {"M003": ("torque", torque), "M005": ("angle", gear), "M007": ("voltage", drive)}
    right = 0
    for seed in range(20):
        for motor, cause, factor in named_causes(np.random.default_rng(seed), 60, faults):
            assert motor in wanted
            assert cause == wanted[motor][0]
            assert factor == pytest.approx(wanted[motor][1], rel=0.15)
            right += 1
    assert right >= 50  # of 60: the differences of some motors are not what a cause leaves


@pytest.mark.parametrize("motors", [10, 40])
def test_a_healthy_fleet_seldom_has_a_cause_named(motors: int) -> None:
    rng = np.random.default_rng(motors)
    assert sum(bool(named_causes(rng, motors, {})) for _ in range(200)) <= 2


def test_a_noise_is_compared_by_its_logarithm_and_upwards_only() -> None:
    rng = np.random.default_rng(12)
    values = np.exp(0.3 * rng.standard_normal((40, 1)))
    values[4], values[5] = 8.0, 1 / 8
    (found,), _ = outliers([series(values, 0.01 * values, "noise", "rad/s", noise=True)])
    assert (found.motor, found.value) == ("M004", 8.0)
    assert found.centre == pytest.approx(1.0, rel=0.2)
    named = sum(
        bool(outliers([series(each, 0.01 * each, noise=True)])[0])
        for each in np.exp(0.3 * rng.standard_normal((400, 40, 1)))
    )
    assert named <= 34


def test_an_error_that_all_motors_share_hides_no_difference() -> None:
    """Intervals that include what no record shows are far wider than the deviation of the estimates."""
    rng = np.random.default_rng(13)
    values = 1 + 0.02 * rng.standard_normal((40, 1))
    values[7] = 1.37
    assert [each.motor for each in outliers([series(values, 0.1)])[0]] == ["M007"]
    healthy = 1 + 0.02 * rng.standard_normal((400, 40, 1))
    assert sum(bool(outliers([series(each, 0.1)])[0]) for each in healthy) <= 34
