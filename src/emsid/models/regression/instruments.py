r"""Linear regressions estimated with refined instruments (SRIV).

Past outputs contain past noise, which biases least squares. Instruments are regressors that do not depend on the noise:
here the past of the model's own free run x. With the signals filtered by 1/A(q), which makes the equation error that of
the output, the estimate solves

    Σₜ ζ(t) (y_f(t) − φ_f(t)ᵀ θ) = 0        φ_f: lags of y/A and u/A        ζ: the same with x for y

and is repeated with the new A and x until it no longer changes. It is consistent whatever the colour of the noise, as
long as the input is independent of it (no feedback), and efficient for white noise of the output. `Information` holds
[ζ, φ_f, y_f], so that neither products of ζ and φ nor normal equations are formed from the data.

References:
    Young, *Recursive Estimation and Time-Series Analysis*, 2nd ed. (2011), ch. 7. Söderström, Stoica, *System
    Identification* (1989), ch. 8.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.linear.filtering import filtered, is_stable, mirrored
from emsid.estimation.linear.information import Information
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.uncertainty.robust_covariance import long_run_variance
from emsid.models.regression.free_run_fit import given_start
from emsid.models.regression.narx import Narx, Structure
from emsid.record import Record

Array = NDArray[np.float64]

ITERATIONS = 30
"""The largest number of repetitions."""
SETTLED = 1e-4
"""The estimate has settled when its free run changes by less than this part of the output."""
SETTLING_SHARE = 0.1
"""At most this part of a segment is left out at its start, where the filters still settle."""
SMALL = 1e-3
"""How close to the start a filtered signal's transient has to come."""


def fit_instruments(
    structure: Structure,
    records: Record | Iterable[Record],
    *,
    start: Sequence[float] | Array | None = None,
    max_iterations: int = ITERATIONS,
    control: Control = FREE,
) -> Fit[Narx]:
    """A linear structure estimated with refined instruments, with intervals for noise of any colour.

    Args:
        structure: lags of output and inputs to the first power, and perhaps a constant: `emsid.arx`.
        records: a record, or several experiments.
        start: (n,) parameters to begin with; by default least squares.
        max_iterations: the largest number of repetitions.
        control: when to stop.

    Raises:
        ModelError: for a structure that is not linear, or where no repetition gives a stable model.
    """
    several = [records] if isinstance(records, Record) else list(records)
    for regressor in structure.regressors:
        if len(regressor.factors) > 1 or any(f.power > 1 or f.transform for f in regressor.factors):
            raise ModelError(f"{structure.name}: instruments are for linear structures; {regressor} is not a lag")
    theta = least_squares(structure, several).estimate if start is None else given_start(structure, start)
    best, ending = (np.inf, theta), Ending.OUT_OF_BUDGET
    before: Array | None = None
    iterations = 0
    for number in range(max_iterations):
        control.check()
        iterations, theta = number + 1, stable(structure, theta)
        runs = free_runs(structure, theta, several)
        error = sum(float(np.sum((s.output - run.output) ** 2)) for s, run in runs)
        best = min(best, (error, theta), key=lambda each: each[0])
        now = np.concatenate([run.output[:, 0] for _, run in runs])
        if before is not None and np.std(now - before) <= SETTLED * np.std(now):
            ending, best = Ending.CONVERGED, (error, theta)
            break
        before = now
        information = instrument_information(instruments(structure, denominator(structure, theta), runs))
        theta = instrument_estimate(information, range(len(theta)))
    estimate = best[1]
    runs = free_runs(structure, estimate, several)
    blocks = instruments(structure, denominator(structure, estimate), runs)
    information = instrument_information(blocks)
    covariance, variance = _covariance(blocks, information, estimate)
    return Fit(
        replace(structure.model(estimate, several[0]), start=8 * max(structure.memory, 1)),
        structure.parameter_names,
        estimate,
        covariance,
        variance,
        information.samples,
        float("inf"),
        len(estimate),
        ending,
        "iv",
        iterations,
    )


def denominator(structure: Structure, theta: Array) -> Array:
    """A = 1 + a₁q⁻¹ + … of these parameters."""
    a = np.zeros(structure.memory + 1)
    a[0] = 1.0
    for value, regressor in zip(theta, structure.regressors, strict=True):
        for factor in regressor.factors:
            if factor.channel == 0:
                a[factor.lag] = value if regressor.negative else -value
    return a


def stable(structure: Structure, theta: Array) -> Array:
    """The parameters with the roots of A inside the unit circle."""
    a, found = denominator(structure, theta), theta.copy()
    if is_stable(a[1:].tolist()):
        return found
    a = mirrored(a)
    a = np.append(a, np.zeros(structure.memory + 1 - len(a)))
    for k, regressor in enumerate(structure.regressors):
        for factor in regressor.factors:
            if factor.channel == 0:
                found[k] = a[factor.lag] if regressor.negative else -a[factor.lag]
    return found


def free_runs(structure: Structure, theta: Array, records: Sequence[Record]) -> list[tuple[Record, Record]]:
    """Every segment that is long enough, and the same with the free run as its output."""
    found = []
    for segment in (s for record in records for s in record.segments):
        model = replace(structure.model(theta, segment), start=min(8 * structure.memory, len(segment) // 4))
        if len(segment) > 2 * model.memory:
            output = model.simulate(segment).output
            if not np.isfinite(output).all():
                break
            found.append((segment, replace(segment, output=output)))
    else:
        if found:
            return found
    raise ModelError(f"{structure.name}: no stable free run to compute instruments from; choose other orders")


def instruments(structure: Structure, a: Array, runs: Sequence[tuple[Record, Record]]) -> list[Array]:
    """The columns [ζ, φ_f, y_f] (2n + 1, N) of every segment.

    Args:
        structure: its n regressors.
        a: (≥ 1,) A = 1 + a₁q⁻¹ + …, stable, whose inverse filters the signals.
        runs: every segment, and the same with the noise-free output x.
    """
    if not a.sum() > 0:  # a pole at one: a constant has no level behind it
        raise ModelError(f"{structure.name}: the filter of the instruments integrates; choose other orders")
    scale = np.array([1.0 if r.factors else 1.0 / a.sum() for r in structure.regressors])[:, None]
    slowest = float(np.abs(np.roots(a)).max(initial=0.0))
    settling = 2 ** int(np.log2(1 + np.log(SMALL) / np.log(slowest))) if 0 < slowest < 1 else 0  # steps seldom
    blocks = []
    for segment, run in runs:
        first = structure.memory + min(settling, int(SETTLING_SHARE * len(segment)))
        z, phi = (
            np.hstack(list(structure.blocks(each, first, len(each))))
            for each in (_filtered(a, run), _filtered(a, segment))
        )
        blocks.append(np.vstack([z[:-1] * scale, phi[:-1] * scale, phi[-1:]]))
    return blocks


def instrument_information(blocks: Sequence[Array]) -> Information:
    """The information of the columns of `instruments`."""
    information = Information.empty(len(blocks[0]) - 1)
    for block in blocks:
        information = information.add_columns(block)
    return information


def instrument_estimate(information: Information, columns: Sequence[int]) -> Array:
    """θ of the structure with some of the regressors, from the information of the largest one."""
    n = information.parameters // 2
    chosen = information.select([*columns, *(n + k for k in columns)]).factor
    kept = len(columns)
    return np.asarray(np.linalg.lstsq(chosen[:kept, kept:-1], chosen[:kept, -1], rcond=None)[0])


def _covariance(blocks: Sequence[Array], information: Information, theta: Array) -> tuple[Array, float]:
    """The covariance of θ, and the variance of the filtered residual."""
    n = len(theta)
    residuals = [block[-1] - theta @ block[n:-1] for block in blocks]
    variance = sum(float(r @ r) for r in residuals) / max(information.samples - n, 1.0)
    try:
        orthogonal, weight = (np.linalg.inv(information.factor[:n, k : k + n]) for k in (0, n))
    except np.linalg.LinAlgError:
        return np.diag(np.full(n, np.inf)), variance
    scores = [r[:, None] * (block[:n].T @ orthogonal) for r, block in zip(residuals, blocks, strict=True)]
    return np.asarray(weight @ long_run_variance(scores) @ weight.T), variance


def _filtered(a: Array, record: Record) -> Record:
    """A segment with its signals through 1/A, as if it had been at their first values before."""

    def through(signals: Array) -> Array:
        first = signals[0]
        return np.asarray(filtered(1.0, a, (signals - first).T).T + first / a.sum())

    return replace(record, input=through(record.input), output=through(record.output))
