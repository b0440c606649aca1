"""Lightly damped modes: their form, their fit in free run, the default search, and the plant of a flexible axis."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

import emsid
from emsid import Record, StateSpaceModel
from emsid.cli.first_screen import first_screen
from emsid.estimation.linear.modal_form import Modal
from emsid.estimation.linear.vector_fitting import fitted_poles, without_poles
from emsid.models.linear.subspace_fit import StateSpaceError, state_space, subspace_models
from emsid.plants import Signal, modal_axis, tanks

Array = NDArray[np.float64]
DT = 0.001
FREQUENCIES = np.array([6.0, 21.0, 55.0, 140.0])


def flexible(outputs: int = 1, seed: int = 0) -> StateSpaceModel:
    """Modes with a damping of 0.5 % and a rigid body with friction: force to speeds."""
    rng = np.random.default_rng(seed)
    blocks = [np.array([[0.0, w], [-w, -0.01 * w]]) for w in 2 * np.pi * FREQUENCIES]
    a = block_diag(-2.0, *blocks)
    b, c = np.r_[1.0, np.tile([0.0, 1.0], 4)][:, None], np.zeros((outputs, 9))
    c[:, 0], c[:, 2::2] = 1.0, rng.uniform(0.3, 1.0, (outputs, 4))
    none = np.zeros((outputs, 1))
    a, b, *_ = cont2discrete((a, b, c, none), DT)
    return StateSpaceModel(a, b, c, none, np.zeros((9, outputs)), none[:, 0], DT)


def record_of(model: StateSpaceModel, samples: int, noise: float = 0.02, seed: int = 0) -> Record:
    """A record of a model with white noise of its outputs, a share of their deviation."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 2 + 1), 2)[:samples, None]
    y = model.run(np.zeros(model.order), u)[0]
    y = y + noise * y.std(axis=0) * rng.standard_normal(y.shape)
    names = tuple(f"speed {k + 1}" for k in range(y.shape[1]))
    return Record(u, y, DT, "force", names, "N", ("m/s",) * len(names), name="axis")


def in_hz(a: Array) -> Array:
    """The frequencies of the complex poles of A."""
    poles = np.log(np.linalg.eigvals(a).astype(complex)) / DT
    return np.sort(np.abs(poles[poles.imag > 1e-9])) / (2 * np.pi)


@pytest.mark.parametrize(
    "a",
    [flexible().a, np.diag([0.9, 0.5, -0.3]), np.array([[0.9, 1.0], [0.0, 0.9]]), 0.5 * np.eye(3, k=1)],
    ids=["modes", "real poles", "a double pole", "three poles at zero"],
)
def test_the_modal_form_is_the_same_system(a: Array) -> None:
    rng = np.random.default_rng(0)
    n = len(a)
    b, c = rng.standard_normal((n, 2)), rng.standard_normal((1, n))
    found = Modal.of(a, b, c, np.zeros((1, 2)), np.zeros(1)).matrices()
    for z in np.exp(1j * np.array([0.0, 0.3, 2.0])) * 1.05:
        one, other = (k @ np.linalg.solve(z * np.eye(n) - m, r) for m, r, k in ((a, b, c), found))
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("free_run", [False, True])
def test_the_rows_of_the_factor_have_the_same_sums(free_run: bool) -> None:
    out = [np.arange(300) % 50 == 0]
    data = subspace_models(state_space(3, horizon=6), record_of(flexible(2), 300), out)
    problem = StateSpaceError(data.model(3), data, False, free_run)
    assert problem.samples == 2 * 294
    beta = 1e-3 * np.random.default_rng(0).standard_normal(problem.size)
    for row, (residual, slopes) in zip(problem.columns(beta), problem.linearised(beta), strict=True):
        few, reduced = row.block(problem.size)
        np.testing.assert_allclose(few @ few, residual @ residual)
        scale = np.abs(slopes.T @ slopes).max()
        np.testing.assert_allclose(reduced.T @ reduced, slopes.T @ slopes, atol=1e-9 * scale)
        np.testing.assert_allclose(reduced.T @ few, slopes.T @ residual, atol=1e-9 * scale)


def test_the_start_of_a_fit_has_the_initial_state_of_slow_modes() -> None:
    """A twentieth of a period of the slowest mode says nothing about it under noise; the whole record does."""
    blocks = [np.array([[0.0, w], [-w, -0.01 * w]]) for w in 2 * np.pi * np.array([0.5, 4.5, 4.8, 22.0])]
    b, c, none = np.tile([0.0, 1.0], 4)[:, None], np.tile([0.0, 1.0], 4)[None], np.zeros((1, 1))
    a, b, *_ = cont2discrete((block_diag(*blocks), b, c, none), DT)
    model = StateSpaceModel(a, b, c, none, np.zeros((8, 1)), np.zeros(1), DT)
    data = subspace_models(state_space(8, horizon=12), record_of(model, 6000, seed=61_000))
    problem = StateSpaceError(model, data, False, True)
    (residual,) = problem.residuals(np.zeros(problem.size))
    assert np.sqrt(np.mean(residual**2)) < 0.02 * 1.02  # the outputs are in units of their deviation


def test_poles_that_explain_nothing_are_left_out_last() -> None:
    model = flexible(2)
    record = record_of(model, 4000, 0.0)
    segments = [(record.output, record.input)]
    found = list(without_poles(fitted_poles(segments, 8, False), segments, False))
    (error, a, c) = next(each for each in reversed(found) if len(each[1]) >= 9)
    assert error < 10 * min(each[0] for each in found)
    assert c.shape == (2, len(a))
    np.testing.assert_allclose(in_hz(a)[:4], FREQUENCIES, rtol=1e-3)


def test_modes_far_apart_are_found_with_their_number() -> None:
    """A horizon of 20 samples shows an eighth of a period of the slowest one."""
    model = flexible(3)
    fit = emsid.fit(state_space(direct=True), record_of(model, 6000), free_run=True)
    assert fit.ending is emsid.Ending.CONVERGED
    np.testing.assert_allclose(in_hz(fit.model.a), FREQUENCIES, rtol=1e-3)
    unseen = record_of(model, 4000, 0.0, seed=1)
    error = fit.model.simulate(unseen).output - unseen.output
    assert np.sqrt(np.nanmean(error**2)) < 0.01 * unseen.output.std()
    kept = fit.model.with_estimates(fit.names, fit.estimate)
    np.testing.assert_allclose(kept.response(FREQUENCIES), fit.model.response(FREQUENCIES), rtol=1e-6)
    low, high = fit.interval()[fit.names.index("mode1.a2")]
    assert low < np.exp(-0.01 * 2 * np.pi * 6.0 * DT) < high


def test_the_default_search_finds_them() -> None:
    result = emsid.identify(record_of(flexible(), 4000))
    assert result.is_recommended
    assert result.chosen.model.name == "state-space"
    np.testing.assert_allclose(in_hz(result.chosen.model.a), FREQUENCIES, rtol=1e-3)
    (spared,) = (each for each in result.findings if each.code == "models-not-needed")
    assert {"wiener-hammerstein", "feedback"} <= set(spared.data["models"])
    assert "no-response" not in {each.code for each in result.findings}


def test_models_of_one_output_are_named_for_several(capsys: pytest.CaptureFixture[str]) -> None:
    result = emsid.identify(record_of(flexible(2), 3000))
    (finding,) = (each for each in result.findings if each.code == "models-of-one-output")
    assert finding.data["outputs"] == 2
    assert {"arx", "feedback", "wiener-hammerstein"} <= set(finding.data["models"])
    assert "model-failed" not in {each.code for each in result.findings}
    first_screen(result)
    assert "arx" in " ".join(capsys.readouterr().out.split())


def test_a_quick_look_at_several_outputs_fits_what_has_them() -> None:
    result = emsid.identify(record_of(flexible(2), 2000), quick=True)
    assert [fit.model.name for fit in result.fits] == ["state-space"]
    codes = {finding.code for finding in result.findings}
    assert "models-of-one-output" in codes
    assert "quick-look" not in codes  # nothing that is usual is left out
    assert "quick-look" in {
        finding.code for finding in emsid.identify(record_of(flexible(), 2000), quick=True).findings
    }


AXIS = {
    "mass": 2.0, "viscous_friction": 6.0, "friction.coulomb": 0.8, "offset": 0.2,
    "mode1.frequency": 13.0, "mode1.damping": 0.01, "mode1.participation": 0.7,
    "mode2.frequency": 37.0, "mode2.damping": 0.02, "mode2.participation": 0.5,
}  # fmt: skip


def driven(signal: Signal, values: dict[str, float], samples: int = 2000) -> tuple[emsid.OwnPlant, Record]:
    """An axis and its record."""
    rng = np.random.default_rng(1)
    force = 8 * np.repeat(rng.uniform(-1, 1, samples // 10), 10)
    plant = modal_axis([12.9, 36.7], 0.002, measured=signal)
    out = plant.with_values(values).simulate(force[:, None], 0.002, np.zeros(6), (signal,))
    noisy = out + 0.01 * out.std() * rng.standard_normal(out.shape)
    return plant, Record(force, noisy, 0.002, "force", signal.value, "N", "m/s" if signal is Signal.SPEED else "m")


def test_a_modal_axis_is_found_with_friction_on_its_motor_side() -> None:
    plant, record = driven(Signal.SPEED, AXIS)
    fit = emsid.fit(plant, record)
    for name, value, error in zip(fit.names, fit.estimate, fit.standard_error, strict=True):
        assert abs(value - AXIS.get(name, 0.01)) < 4.5 * error
    assert fit.standard_error[fit.names.index("mode1.frequency")] < 0.01


def test_without_friction_it_is_the_linear_system() -> None:
    for signal, read in ((Signal.SPEED, 1), (Signal.POSITION, 0)):
        _, record = driven(signal, AXIS | {"friction.coulomb": 0.0, "offset": 0.0}, 400)
        a, b = np.zeros((6, 6)), np.zeros((6, 1))
        seen = np.array([0, 1, 0, 0.7, 0, 0.5])
        a[0, 1] = a[2, 3] = a[4, 5] = 1.0
        for row, part in ((1, 1.0), (3, 0.7), (5, 0.5)):
            a[row], b[row] = -part * 6.0 / 2.0 * seen, part / 2.0
        for row, f, zeta in ((3, 13.0, 0.01), (5, 37.0, 0.02)):
            w = 2 * np.pi * f
            a[row, row - 1 : row + 1] -= [w**2, 2 * zeta * w]
        c = seen if read else np.array([1, 0, 0.7, 0, 0.5, 0])
        discrete = cont2discrete((a, b, c[None], np.zeros((1, 1))), 0.002)
        x, out = np.zeros((6, 1)), []
        for u in record.input[:, 0]:
            out.append(float(c @ x[:, 0]))
            x = discrete[0] @ x + discrete[1] * u
        assert np.std(record.output[:, 0] - out) < 0.011 * np.std(out)


@pytest.mark.parametrize("wrong", [lambda: modal_axis([], DT), lambda: modal_axis([5.0], DT, measured=Signal.CURRENT)])
def test_an_axis_has_modes_and_a_measured_motion(wrong: Callable[[], object]) -> None:
    with pytest.raises(emsid.ModelError, match="modal axis"):
        wrong()


def test_a_full_tank_passes_on_what_it_spills() -> None:
    """In steady state the lower outflow is what the pump delivers, less what falls beside."""
    plant = tanks(full=8.0).with_values({"pump": 0.3, "upper.outflow": 0.05, "lower.outflow": 0.3})
    for share in (0.0, 0.5, 1.0):
        level = plant.with_values({"overflow": share}).simulate(
            np.ones((800, 1)), 1.0, np.full(2, 4.0), (Signal.POSITION,)
        )
        above = 8.0 * 0.995  # within its edge
        inflow = 0.05 * np.sqrt(above) + share * (0.3 - 0.05 * np.sqrt(above))
        assert level[-1, 0] == pytest.approx((inflow / 0.3) ** 2, rel=0.02)
    assert tanks(8.0).simulate(np.full((400, 1), 9.0), 4.0, np.full(2, 4.0), (Signal.POSITION,)).max() <= 8.0
