"""A structure fitted to its free run, by Gauss–Newton steps with exact derivatives.

Least squares minimises the error one step ahead (equation error). Noise of the measured output enters its regressors
and biases it, the more the shorter the sample time is. Here

    V(θ) = ½ Σₜ (y(t) − ŷ(t; θ))²

is minimised, where ŷ is the free run: after the start of every segment it sees the inputs only (output error).
For ARX this is the output-error model of the textbooks. The derivative is exact, see `sensitivities`.

The outputs at the start of every segment are estimated too, unless there are many segments: measured ones carry noise,
which a slow or lightly damped model would keep for long.

**The start.** The search starts from least squares. Where the free run of that estimate diverges or explains nothing,
it goes from prediction to simulation in steps, see `SHARES`. A trial step whose free run is not finite is shortened.

**Jumps.** A free run with a jump inside, such as friction by the sign of a speed, jumps wherever the sign of a sample
changes. Between such places its derivative is exact, and does not contain how the samples at which signs change move
with θ. The cost has a minimum of its own in many of the pieces, and a search by this derivative ends in one of those
near its start: estimates that are worse than their covariance says, as that is of a piece. Over a range in which many
signs change, the mean derivative contains these moves. With J = U S Vᵀ and the standard deviation σ of the residual,
one standard error in the direction wᵢ = Vᵢ/sᵢ is σ, and

    ∂r/∂θ ≈ Σᵢ (r(θ + hσwᵢ) − r(θ − hσwᵢ)) / (2hσ) · sᵢVᵢᵀ

is the mean derivative over h standard errors to both sides (`Widened`). A search with h from large to small passes the
minima of single pieces, as graduated optimisation does (Blake, Zisserman 1987); from its end, one by the exact
derivative goes to the minimum of the last piece. Where signs of past outputs are among the regressors, a search that
may begin again does this first, and so do those around its end.

References:
    Blake, Zisserman, *Visual Reconstruction* (1987). Ljung, *System Identification*, 2nd ed. (1999), sec. 4.2 and 10.2.
    Piroddi, Spinelli, *An identification algorithm for polynomial NARX models based on simulation error minimization*,
    International Journal of Control 76 (2003).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from emsid.errors import ModelError, some
from emsid.estimation.compiled import read_only
from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import check_excitation, least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Array, Block, Infeasible, Mask, Problem, without
from emsid.estimation.nonlinear.restarts import begun_again, begun_around, confirmed, nearer
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.model import check_samples
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.sensitivities import largest_output_lag, parts, run_with_derivative
from emsid.models.regression.transforms import Transform
from emsid.models.terms import vector
from emsid.record import Record, check_same_channels

# Shares of the model's own output in its past, on the way from prediction to simulation.
SHARES = (0.5, 0.8, 0.9, 0.95, 0.98, 1.0)
# Steps at each share before the last.
ITERATIONS = 15
# Samples for each past output from which the fitted model estimates its state at the start of a run.
SAMPLES_PER_STATE = 8
# Effort of every search with wide differences.
WIDE: dict[str, Any] = {"max_iterations": 20, "tolerance": 0.05, "least_saving": 1e-3, "covariances": False}
# The most rounds of restarts of a search over signs, of which one in ten ends unconfirmed after three.
TURNS = 12
# The largest number of initial outputs that are estimated.
MOST_STATES = 40


class FreeRunError:
    """Residuals ŷ − y of the free runs of a structure, and their exact derivative; see `Problem`.

    θ holds the parameters of the structure and, if they are estimated, the outputs from which every segment starts. The
    residuals then include those of these outputs, which are measured as all others are.

    Args:
        structure: its regressors.
        segments: without gaps, each longer than ``start``.
        start: samples of every segment that give the initial state, at least the largest lag.
        share: of the model's own output in its past; 1 for the free run.
        states: whether the initial outputs are estimated.
    """

    def __init__(
        self, structure: Structure, segments: Sequence[Record], start: int, share: float = 1.0, states: bool = False
    ) -> None:
        self.structure, self.start, self.share = structure, start, share
        self.segments = tuple((read_only(s.output[:, 0]), read_only(s.input.T)) for s in segments)
        self.depth = largest_output_lag(structure.regressors) if states else 0
        self._parts = parts(structure.regressors)

    @property
    def names(self) -> tuple[str, ...]:
        """Names for messages."""
        segments = range(1, len(self.segments) + 1)
        states = (f"initial output {i + 1} of segment {k}" for k in segments for i in range(self.depth))
        return (*self.structure.parameter_names, *states)

    def with_states(self, theta: Array) -> Array:
        """θ with the measured initial outputs."""
        return np.concatenate([theta, *(y[self.start - self.depth : self.start] for y, _ in self.segments)])

    def residuals(self, theta: Array) -> list[Array]:
        """(N − start + depth,) ŷ − y of every segment, where depth is the number of estimated initial outputs."""
        first = self.start - self.depth
        runs = (self._run(k, theta, np.empty((0, 0))) for k in range(len(self.segments)))
        return [run[first:] - y[first:] for run, (y, _) in zip(runs, self.segments, strict=True)]

    def linearised(self, theta: Array) -> list[Block]:
        """The residuals, and their derivative (N − start + depth, n)."""
        blocks, first, n = [], self.start - self.depth, len(self.structure)
        for k, (y, _) in enumerate(self.segments):
            derivative = np.zeros((n + self.depth, len(y)))
            derivative[n:, first : self.start] = np.eye(self.depth)
            residual = self._run(k, theta, derivative)[first:] - y[first:]
            among_all = np.zeros((len(theta), len(y) - first))
            among_all[:n] = derivative[:n, first:]
            among_all[n + k * self.depth : n + (k + 1) * self.depth] = derivative[n:, first:]
            blocks.append((residual, among_all.T))
        return blocks

    def _run(self, segment: int, theta: Array, derivative: Array) -> Array:
        measured, u = self.segments[segment]
        y, n, start = measured.copy(), len(self.structure), self.start
        y[start - self.depth : start] = theta[n + segment * self.depth : n + (segment + 1) * self.depth]
        own = read_only(theta[:n])
        memory = self.structure.memory
        reached = run_with_derivative(y, derivative, u, self._parts, own, memory, start, self.share)
        if reached < len(y):
            raise Infeasible(f"the free run of {self.structure.name} diverges; scale the channels or lower powers")
        return y


def fit_free_run(
    structure: Structure,
    records: Record | Iterable[Record],
    *,
    start: ArrayLike | None = None,
    transient: int | None = None,
    max_iterations: int = 100,
    tolerance: float = 1e-3,
    least_saving: float = 0.0,
    control: Control = FREE,
    covariances: bool = True,
    restarts: bool = False,
    left_out: Sequence[Mask] | None = None,
) -> Fit[Narx]:
    """The parameters that minimise the error of the free run over one or several records.

    Args:
        structure: what to fit, for instance ``emsid.arx(na=2, nb=2)``, which gives an output-error model.
        records: a record, or several experiments; every segment is run on its own.
        start: (n,) parameters to begin with; by default the least-squares estimate.
        transient: samples at the start of every segment that are left out; the last of them give the initial state. At
            least the largest lag, which is the default.
        max_iterations: the largest number of Gauss–Newton steps.
        tolerance, least_saving: see `gauss_newton`.
        control: when to stop.
        covariances: whether they are computed; otherwise they are infinite.
        restarts: whether a search that does not converge is begun again, see `begun_again`, and one over signs of past
            outputs begins with wide differences.
        left_out: (N,) the samples of every segment that are not fitted; the run goes on through them.

    Returns:
        A fit with intervals that allow for coloured residuals and model error.

    Raises:
        ModelError, DataError: for records that the structure cannot be fitted to, or a structure whose free run
            diverges wherever the search begins.
    """
    several = [records] if isinstance(records, Record) else list(records)
    if start is None:
        begin = least_squares(structure, several).estimate
    else:
        begin = given_start(structure, start)
        for record in several:
            structure.check(record)
            check_excitation(record)
            check_same_channels(several[0], record)
    check_samples(structure.name, "a transient", transient, 0)
    skipped = max(structure.memory, transient or 0)
    segments = _longer_than(skipped, several)
    if not _explains_something(FreeRunError(structure, segments, skipped), begin):
        begin = _towards_free_run(structure, segments, skipped, begin, control)
    states = largest_output_lag(structure.regressors) * len(segments)
    problem = FreeRunError(structure, segments, skipped, states=states <= MOST_STATES)
    usual: dict[str, Any] = {"max_iterations": max_iterations, "tolerance": tolerance, "least_saving": least_saving}
    usual |= {"names": problem.names, "control": control, "covariances": covariances}

    def search(theta: Array, of: Problem = problem, **others: Any) -> Minimum:
        return gauss_newton(without(of, left_out), theta, **(usual | others))

    def narrowed(theta: Array, widths: Sequence[float]) -> Array:
        for width in widths:
            with suppress(Infeasible):  # the derivative is too large
                theta = search(theta, Widened(problem, width), **WIDE).estimate
        return theta

    first = problem.with_states(begin)
    found = search(first)
    if restarts and _jumps(structure):
        found = min(search(narrowed(first, WIDTHS)), found, key=lambda each: each.cost)

        def around(theta: Array, **others: Any) -> Minimum:
            return search(narrowed(nearer(problem, theta, found), WIDTHS[1:]), **others)

        found = confirmed(*begun_around(found, search, len(structure), control, around=around, turns=TURNS))
    elif restarts:
        found = begun_again(found, search, len(structure), control)
    shortest = min(map(len, segments))
    samples = min(SAMPLES_PER_STATE * largest_output_lag(structure.regressors), shortest // 4)
    model = replace(structure.model(found.estimate[: len(structure)], several[0]), start=samples)
    return found.judged().fit(model, structure.parameter_names)


def _longer_than(samples: int, records: Sequence[Record]) -> list[Record]:
    """The segments that are longer than so many samples.

    Raises:
        ModelError: if there are none.
    """
    segments = [segment for record in records for segment in record.segments if len(segment) > samples]
    if not segments:
        raise ModelError(
            f"{records[0].name}: no segment is longer than {samples} samples; choose a shorter transient or fewer lags"
        )
    return segments


def given_start(structure: Structure, start: ArrayLike) -> Array:
    """(n,) the parameters to begin with, checked.

    Raises:
        ModelError: for another number of them, or numbers that are not finite.
    """
    theta = vector(start, f"{structure.name}: start values")
    if len(theta) != len(structure):
        raise ModelError(
            f"{structure.name}: {len(theta)} start values for {len(structure)} parameters; give one for each of "
            f"{some(structure.parameter_names)}"
        )
    return theta


def _jumps(structure: Structure) -> bool:
    """Whether the free run of a structure jumps: a sign of a past output is among its regressors."""
    return any(f.channel == 0 and f.transform is Transform.SIGN for r in structure.regressors for f in r.factors)


def _explains_something(problem: FreeRunError, theta: Array) -> bool:
    """Whether the free run is better than the mean of the output."""
    try:
        with np.errstate(over="ignore"):
            error = sum(float(np.sum(r**2)) for r in problem.residuals(theta))
    except Infeasible:
        return False
    return error < sum(float(np.sum((y - y.mean()) ** 2)) for y, _ in problem.segments)


def _towards_free_run(
    structure: Structure, segments: Sequence[Record], start: int, theta: Array, control: Control
) -> Array:
    """A start for the free run: the minimum for every share, each from the one before.

    Where the next share diverges, the step towards it is halved a few times, and then the search starts there at the
    last minimum with a finite run.
    """
    share = 0.0
    for target in SHARES[:-1]:
        for following in (target, 0.5 * (share + target)):
            try:
                found = gauss_newton(
                    FreeRunError(structure, segments, start, following),
                    theta,
                    max_iterations=ITERATIONS,
                    control=control,
                    covariances=False,
                )
            except ModelError:  # infeasible at the start
                continue
            theta, share = found.estimate, following
            break
    return theta


WIDTHS = (8.0, 4.0, 2.0, 1.0)
"""h of one search after another, in standard errors."""
BEYOND = 10.0
"""A residual on either side that is larger by this factor than the linearised one is that of a run that diverges."""
LEAST = 1e-8
"""Directions with a singular value below this part of the largest keep their exact derivative."""


@dataclass(frozen=True, eq=False)
class Widened:
    """A problem with the mean derivative over ``width`` standard errors to both sides.

    Attributes:
        problem: with residuals and the exact derivative between jumps.
        width: h.
    """

    problem: Problem
    width: float

    def residuals(self, theta: Array) -> Sequence[Array]:
        """Those of the problem."""
        return self.problem.residuals(theta)

    def linearised(self, theta: Array) -> list[Block]:
        """The residuals with the mean derivatives; exact ones in directions without a residual on either side."""
        blocks = list(self.problem.linearised(theta))
        residual = np.concatenate([r for r, _ in blocks])
        _, sizes, axes = np.linalg.svd(np.linalg.qr(np.concatenate([j for _, j in blocks]), mode="r"))
        reach = self.width * float(np.sqrt(residual @ residual / effective_samples([r for r, _ in blocks])))
        found = [jacobian.copy() for _, jacobian in blocks]
        for size, axis in zip(sizes, axes, strict=True):
            if not (reach > 0 and size > LEAST * sizes[0]):
                continue
            step = reach / size * axis
            try:
                with np.errstate(over="ignore"):
                    sides = [self.problem.residuals(theta + step), self.problem.residuals(theta - step)]
                    most = max(np.sqrt(sum(r @ r for r in side)) for side in sides)
            except Infeasible:
                continue
            if not most <= BEYOND * (np.linalg.norm(residual) + reach):
                continue
            for jacobian, (_, exact), ahead, behind in zip(found, blocks, *sides, strict=True):
                mean = (ahead - behind) * (size / (2 * reach))
                if np.isfinite(mean).all():
                    jacobian += np.outer(mean - exact @ axis, axis)
        return [(r, jacobian) for (r, _), jacobian in zip(blocks, found, strict=True)]
