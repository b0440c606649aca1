r"""State-space models of frequency responses, with several inputs and outputs, and of records beside them.

With z = exp(2πi f dt), X = (zI − A)⁻¹B and the extended observability matrix O of q block rows,

    [G; zG; …; z^(q−1)G] = O X + Γ [I; zI; …; z^(q−1)I]

at every frequency. The part of the left side that is orthogonal to the powers of z has the column space of O, of which
A and C follow by least squares (subspace identification; columns are divided by their standard deviation). B and D are
then linear. The result is the start of a search for the least weighted error (`mixed_problem`); another start is the
free run of the records, whose errors also give the noise of their outputs.

References:
    McKelvey, Akçay, Ljung, *Subspace-based multivariable system identification from frequency response data*, IEEE TAC
    41 (1996).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.models.free_run import SAME_DT
from emsid.models.linear.mixed_problem import LinearProblem
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.linear.subspace_fit import StateSpaceStructure, fit_state_space
from emsid.record import FrequencyResponse, Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

STEP, NEAR = 1e-6, 1e-3
"""Relative step of the differences that give derivatives; of small values, relative to this part of the largest."""
LARGEST = 0.9995
"""Poles of the start that are further out are mirrored, and moved here."""


def fit_to_response(
    structure: StateSpaceStructure,
    records: FrequencyResponse | Iterable[FrequencyResponse | Record],
    *,
    refine: bool = True,
    max_iterations: int = 100,
    control: Control = FREE,
) -> Fit[StateSpaceModel]:
    """A model in state space, in discrete time, from a frequency response of inputs that are held, and records.

    The search varies common poles and all residues, so that its result has the states of `state_space` once for every
    input or every output, whichever are fewer; the subspace method alone gives as many as were asked for.

    Args:
        structure: what `emsid.state_space` gives, with an order.
        records: one frequency response with a sample time, and any number of records of its channels and sample time.
        refine: whether the error is minimised after the subspace method.
        max_iterations: the largest number of Gauss–Newton steps.
        control: when to stop, and where to report every step.

    Raises:
        ModelError: without an order, or with more states than the frequencies can determine.
        DataError: for several responses, one without a sample time, or records of other channels or sample times.
    """
    several = (records,) if isinstance(records, FrequencyResponse) else tuple(records)
    responses = [each for each in several if isinstance(each, FrequencyResponse)]
    experiments = [each for each in several if isinstance(each, Record)]
    if len(responses) != 1:
        raise DataError("a state space is fitted to one frequency response, with or without records; give one")
    measured = responses[0]
    if measured.dt is None:
        raise DataError(
            f"{measured.name} has no sample time; a state space is in discrete time: give the response one "
            "(dataclasses.replace(response, dt=…)), or fit a transfer function"
        )
    order = structure.order
    if not isinstance(order, int):
        raise ModelError(f"{structure.name}: give an order to fit to a frequency response", arguments=("order",))
    for record in experiments:
        if (record.output.shape[1], record.input.shape[1]) != measured.response.shape[1:]:
            raise DataError(f"{record.name} has other channels than {measured.name}; select the same ones")
        if not np.isclose(record.dt, measured.dt, rtol=SAME_DT):
            raise DataError(f"{record.name} and {measured.name} have different sample times; resample the record")
    begins, noise = [_by_subspace(measured, order, structure.name)], np.ones(measured.response.shape[1])
    segments = [segment for record in experiments for segment in record.segments if len(segment) > 8 * order]
    if segments:
        alone = fit_state_space(structure, experiments, free_run=True, control=control).model
        missed = np.concatenate([alone.simulate(each).output - each.output for each in segments])
        noise = np.sqrt(np.nanmean(missed**2, axis=0))
        begins = [alone, replace(begins[0], level=alone.level)]
    best: tuple[float, Fit[StateSpaceModel]] | None = None
    for begin in begins:
        values = begin.parameter_values()
        names = [name for name in values if segments or not name.startswith("y0")]
        theta = np.array([values[name] for name in names])
        steps = STEP * np.maximum(np.abs(theta), NEAR * np.abs(theta).max())
        problem = LinearProblem(begin, names, steps, segments, (measured,), _respond, noise)
        how: dict[str, Any] = {"names": names, "control": control}
        minimum = gauss_newton(problem, theta, max_iterations=max_iterations if refine else 0, **how)
        if best is None or minimum.cost < best[0]:
            found = problem.fit(minimum)
            best = (
                minimum.cost,
                found if refine else replace(found, model=begin, ending=Ending.SOLVED, method="subspace", findings=()),
            )
    return best[1]  # type: ignore[index]


def _respond(model: StateSpaceModel, measured: FrequencyResponse) -> Complex:
    return model.response(measured.frequency)


def _by_subspace(measured: FrequencyResponse, order: int, name: str) -> StateSpaceModel:
    g, dt = measured.response, float(measured.dt or 1.0)
    count, outputs, inputs = g.shape
    rows = -(-2 * order // outputs) + 1
    if 2 * count * inputs < rows * (outputs + inputs):
        raise ModelError(f"{name}: {count} frequencies for {order} states; take fewer states")
    z = np.exp(2j * np.pi * measured.frequency * dt)
    weight = 1 / np.sqrt(measured.total_or_relative.mean(axis=(1, 2)))
    powers = z[:, None] ** np.arange(rows) * weight[:, None]  # (F, q)

    def stacked(blocks: Complex) -> Array:
        """(q n, 2 F nu) of (F, n, nu): every power times the block, real and imaginary parts side by side."""
        whole = (powers[:, :, None, None] * blocks[:, None]).reshape(count, -1, inputs)
        flat = whole.transpose(1, 0, 2).reshape(whole.shape[1], -1)
        return np.hstack([flat.real, flat.imag])

    eye = np.broadcast_to(np.eye(inputs, dtype=complex), (count, inputs, inputs))
    both = np.vstack([stacked(eye), stacked(g)])
    lower = np.transpose(np.linalg.qr(both.T)[1])[rows * inputs :, rows * inputs :]
    observed = np.linalg.svd(lower, full_matrices=False)[0][:, :order]
    a = np.linalg.lstsq(observed[:-outputs], observed[outputs:], rcond=None)[0]
    poles, basis = np.linalg.eig(a)
    size = np.abs(poles)
    poles = np.where(size > 1, poles / np.maximum(size, 1e-300) ** 2, poles)
    poles = poles * np.minimum(1.0, LARGEST / np.maximum(np.abs(poles), 1e-300))
    a = np.real(basis @ np.diag(poles) @ np.linalg.inv(basis))
    c = observed[:outputs]
    reach = c @ np.linalg.inv(z[:, None, None] * np.eye(order) - a)  # (F, ny, n)
    regressors = np.concatenate([reach, np.broadcast_to(np.eye(outputs), (count, outputs, outputs))], axis=2)
    left = (regressors * weight[:, None, None]).reshape(-1, order + outputs)
    right = (g * weight[:, None, None]).reshape(-1, inputs)
    solved = np.linalg.lstsq(np.vstack([left.real, left.imag]), np.vstack([right.real, right.imag]), rcond=None)[0]
    none, level = np.zeros((order, outputs)), np.zeros(outputs)
    return StateSpaceModel(a, solved[:order], c, solved[order:], none, level, dt, name=name)
