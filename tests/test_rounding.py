"""Parameters from readings whose only noise is their rounding."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

import coverage_settings
import emsid
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.estimation.uncertainty.rounding import clustered_covariance, extent, runs
from emsid.models.plants.search.estimation import searched
from emsid.models.plants.search.rounding import independent_errors, prevails
from independent.joint import GEAR, JOINTS, STEP, Counts, Joint

FIXED = {"sensor.ratio": GEAR}


def slow(samples: int) -> np.ndarray:
    """(N, 3) effects that change slowly, so that a reading stays for many samples."""
    t = np.linspace(0, 1, samples)
    return np.column_stack([np.ones(samples), np.sin(9 * t), t**2])


def rounded(jacobian: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True values, readings rounded to one, and the estimate of least squares."""
    truth = np.array([0.0, 20.0, 9.0]) + np.random.default_rng(seed).uniform(-0.5, 0.5, 3)
    reading = np.round(jacobian @ truth)
    return truth, reading, np.linalg.lstsq(jacobian, reading, rcond=None)[0]


def test_clusters_are_the_runs_of_one_reading() -> None:
    assert runs(np.array([1.0, 1.0, 2.0, 1.0, 1.0, 1.0]))[0].tolist() == [0, 2, 3]
    rng = np.random.default_rng(0)
    jacobian, residual = rng.standard_normal((6, 2)), rng.standard_normal(6)
    sums = [jacobian[a:b].T @ residual[a:b] for a, b in ((0, 2), (2, 3), (3, 6))]
    bread = np.linalg.inv(jacobian.T @ jacobian)
    expected = 3 / (3 - 2) * bread @ sum(np.outer(each, each) for each in sums) @ bread
    found = clustered_covariance([(residual, jacobian, np.array([5.0, 5.0, 6.0, 5.0, 5.0, 5.0]))])
    np.testing.assert_allclose(found, expected)


def test_clusters_hold_the_truth_where_independent_samples_would_not() -> None:
    jacobian, records = slow(2000), 200
    inside = np.zeros((2, 3))
    for seed in range(records):
        truth, reading, estimate = rounded(jacobian, seed)
        residual = jacobian @ estimate - reading
        white = np.var(residual) * np.linalg.inv(jacobian.T @ jacobian)
        for k, covariance in enumerate((clustered_covariance([(residual, jacobian, reading)]), white)):
            inside[k] += np.abs(estimate - truth) <= 1.96 * np.sqrt(np.diag(covariance))
    assert np.all(inside[0] >= binom.ppf(0.01, records, 0.91))
    assert np.all(inside[1] < binom.ppf(0.01, records, 0.91))


def test_the_set_is_that_of_all_samples_and_holds_the_truth() -> None:
    from scipy.optimize import linprog

    jacobian = slow(2000)
    far = np.full(3, np.inf)
    for seed in range(20):
        truth, reading, estimate = rounded(jacobian, seed)
        residual = jacobian @ estimate - reading
        found = extent(residual, jacobian, np.full(2000, 0.5), -far, far)
        assert found.least <= 0.5
        off = np.abs(estimate + found.centre - truth)
        assert np.all(off <= found.half_width * (1 + 1e-6))
        np.testing.assert_allclose(1.96 * np.sqrt(np.diag(found.covariance)), found.half_width)
        white = np.sqrt(np.diag(np.var(residual) * np.linalg.inv(jacobian.T @ jacobian)))
        assert np.all(found.half_width < 1.96 * white)
    sides = np.vstack([jacobian, -jacobian]), np.concatenate([0.5 - residual, 0.5 + residual])
    for k, axis in enumerate(np.eye(3)):
        low, high = (linprog(sign * axis, *sides, bounds=(None, None)).x[k] for sign in (1, -1))
        assert (high - low) / 2 == pytest.approx(found.half_width[k], rel=1e-3)
        assert (high + low) / 2 == pytest.approx(found.centre[k], abs=1e-3 * found.half_width[k])


def test_the_set_is_empty_where_there_is_other_noise() -> None:
    jacobian = slow(2000)
    reading = np.round(jacobian @ [0.2, 20.0, 9.0] + 0.2 * np.random.default_rng(0).standard_normal(2000))
    residual = jacobian @ np.linalg.lstsq(jacobian, reading, rcond=None)[0] - reading
    far = np.full(3, np.inf)
    found = extent(residual, jacobian, np.full(2000, 0.5), -far, far)
    assert found.least > 0.6
    assert not found.half_width.any()


def test_bounds_of_parameters_bound_the_set() -> None:
    jacobian = slow(2000)
    _, reading, estimate = rounded(jacobian, 1)
    residual, far = jacobian @ estimate - reading, np.full(3, np.inf)
    whole = extent(residual, jacobian, np.full(2000, 0.5), -far, far)
    bounded = extent(residual, jacobian, np.full(2000, 0.5), np.array([-np.inf, whole.centre[1], -np.inf]), far)
    assert bounded.half_width[1] == pytest.approx(0.5 * whole.half_width[1], rel=1e-3)


# --- joints of another simulator -------------------------------------------------------------------------------------


def fitted(joint: Joint, record: emsid.Record) -> tuple[emsid.Fit, dict[str, float]]:
    """A fit, and the data of its findings on rounding by code."""
    fit = emsid.fit(emsid.plants.joint(), record, fixed=FIXED, search=False)
    return fit, {each.code: each.data for each in fit.findings if "rounding" in each.code}


def test_an_encoder_determines_a_joint_within_its_counts() -> None:
    shares = coverage_settings.shares(JOINTS["counts"], 4)
    assert len(shares) == 5
    assert all(share.covered == 1.0 and share.count == 4 for share in shares.values())
    joint = Joint.drawn(1)
    fit, findings = fitted(joint, joint.record(1, 800)[0])
    assert findings["within-rounding"]["narrower"] > 3
    assert findings["within-rounding"]["step"] == pytest.approx(STEP)
    run = fit.simulated()[0][:, 0]
    assert np.max(np.abs(run - joint.record(1, 800)[0].output[:, 0])) <= 0.5 * STEP * (1 + 1e-3)


def test_a_little_noise_leaves_no_set_and_clustered_intervals() -> None:
    joint = Joint.drawn(1)
    record, _ = joint.record(1, 800, noise=0.15)
    _, findings = fitted(joint, record)
    assert findings["outside-rounding"]["least"] > 0.52
    shares = coverage_settings.shares(JOINTS["counts and noise"], 4)
    assert np.mean([share.covered for share in shares.values()]) >= binom.ppf(0.01, 20, 0.91) / 20


@pytest.mark.parametrize("setting", [Counts(noise=1.0), Counts(noise=12**-0.5, white=True)])
def test_other_noise_changes_nothing(setting: Counts) -> None:
    joint = Joint.drawn(2)
    record, _ = joint.record(2, 800, setting.noise, setting.white)
    _, findings = fitted(joint, record)
    assert not findings
    _, _, reached = searched(emsid.plants.joint(), record, fixed=FIXED)
    problem = reached.problem
    assert not prevails(problem, reached.residuals)
    assert independent_errors(problem, reached.residuals) == effective_samples(reached.residuals)


def test_runs_are_the_independent_samples_of_the_criterion() -> None:
    joint = Joint.drawn(2)
    record, _ = joint.record(2, 800)
    _, _, reached = searched(emsid.plants.joint(), record, fixed=FIXED)
    most = len(runs(record.output[:, 0])[0])
    assert most < 0.8 * len(record)
    assert independent_errors(reached.problem, reached.residuals) <= most


def test_a_speed_of_rounded_decimals_is_one_too() -> None:
    t = 5e-3 * np.arange(1000)
    u = 3 * np.sign(np.sin(2 * np.pi * 0.5 * t)) + np.sin(2 * np.pi * 1.3 * t)
    speed = np.zeros(1000)
    for k in range(999):  # dv/dt = 20·u − 10·v, exactly
        speed[k + 1] = 2 * u[k] + (speed[k] - 2 * u[k]) * np.exp(-10 * 5e-3)
    record = emsid.Record(u, np.round(speed, 1), 5e-3, input_units="V", output_units="rad/s")
    free, known = ("motor_constant", "rotor_inertia"), {"resistance": 1.0, "rotor_viscous": 0.0, "load_viscous": 0.0}
    fit = emsid.fit(emsid.plants.rigid_motor(), record, free=free, fixed=known, search=False)
    assert "within-rounding" in {each.code for each in fit.findings}
    for name, true in (("motor_constant", 0.5), ("rotor_inertia", 0.025)):
        low, high = fit[name].interval
        assert low <= true <= high
        assert high - low < 2e-3 * true
