"""`gauss_newton`, the one optimiser for every model that is nonlinear in its parameters.

Given residuals r(θ) ∈ ℝᴺ and their derivative J(θ) = ∂r/∂θ, it solves

    min V(θ) = Σₜ ℓ(rₜ(θ)),      lower ≤ θ ≤ upper,      ℓ(r) = ½r² or a loss that grows more slowly.

**The step.** Around θ the residuals are nearly linear, r(θ + p) ≈ r + Jp, and each iteration solves the
damped linear problem (Levenberg 1944, Marquardt 1963)

    min over p   ½‖√w·(r + Jp)‖² + ½λ‖Dp‖²,      lower − θ ≤ p ≤ upper − θ.

D holds the largest lengths that the columns of √w·J have had (Moré 1978), which makes the search independent of
the units of the parameters. The weights w = ℓ′(r)/r are those of iteratively reweighted least squares; they are
one for squares. `Information` reduces the rows [√w·J, −√w·r], experiment by experiment, to a triangular factor, and
the damping enters as a prior of weight λD². Normal equations, which would square the condition number, are never
formed, and a change of λ needs no new factorisation of length N. Where the step would leave the bounds, the small
triangular problem is solved subject to them (BVLS, Stark & Parker 1995), so the search reaches a bound exactly.
`Box` holds the bounds of all parameters.

**The damping.** With ϱ the ratio of actual to predicted reduction, a step is taken when ϱ > 0. λ is then
multiplied by max(1/10, 1 − (2ϱ − 1)³), and otherwise by 2, 4, 8, … (Nielsen 1999). A trial point without a
residual (an unstable filter, a simulation that overflowed) counts as a failed step; the next one is shorter.

**Acceleration.** Where few data distinguish two parameters, the minimum lies at the end of a narrow valley. A step
along its tangent leaves it where it bends, so that the damping keeps all steps short, and a search uses up its steps
before the minimum. With ``accelerated`` the damped steps follow the bend (`acceleration`). After a part s of a step p
the residual is nearly r + Jp·s + ½r″s². The second derivative takes one residual more,

    r″ = (2/h)·((r(θ + hp) − r(θ))/h − Jp),

and gives the second part of the step that lowers the cost most,

    q = −½(JᵀWJ + λD²)⁻¹ JᵀW r″,

with the weights w on the diagonal of W. This is the geodesic acceleration of Transtrum & Sethna (2012). It is an
extrapolation, of use only while q is small beside p.

**The end.** The search has converged when the undamped step to the linearised minimum is shorter than
``tolerance`` standard errors, the relative offset of Bates & Watts (1981),

    ‖J p‖/√n ≤ tolerance · ‖r‖/√(N − n),

a criterion that is independent of units and scale, or when the step is at the level of rounding, as in a problem
with an exact solution. `Ending` lists the other ways in which a search can end.

**Penalties.** A curve that should be smooth adds ½μ‖Rθ + c‖² to the cost, as further rows of the linear problem. Its
weight μ is chosen from every linearisation (`smoothing`). Intervals treat Rθ + c as normal with variance σ²/μ, so that
they include the bias of a smooth curve (Nychka 1988).

References:
    Bates, Watts, *A relative offset orthogonality convergence criterion for nonlinear least squares*, Technometrics 23
    (1981). Dennis, Schnabel, *Numerical Methods for Unconstrained Optimization and Nonlinear Equations* (1983), ch. 10.
    Moré, *The Levenberg–Marquardt algorithm: implementation and theory* (1978). Nielsen, *Damping parameter in
    Marquardt's method*, IMM-REP-1999-05 (1999). Nocedal, Wright, *Numerical Optimization*, 2nd ed. (2006), ch. 10.
    Nychka, *Bayesian confidence intervals for smoothing splines*, JASA 83 (1988). Stark, Parker, *Bounded-variable
    least-squares*, Computational Statistics 10 (1995). Transtrum, Sethna, *Improvements to the Levenberg–Marquardt
    algorithm for nonlinear least-squares minimization*, arXiv:1201.5885 (2012).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.control import FREE, Activity, Control, Stopped
from emsid.estimation.nonlinear.minimum import Minimum, covariance_matrices, undetermined
from emsid.estimation.nonlinear.problem import (
    SQUARES,
    Array,
    Block,
    Indices,
    Infeasible,
    Linearised,
    Loss,
    Problem,
    cost,
    linearised,
    trial_cost,
)
from emsid.estimation.nonlinear.smoothing import NONE, Penalty, Smoothing, chosen_weights
from emsid.estimation.nonlinear.steps import bounded_step, promised, relative_offset
from emsid.findings import Finding


@dataclass(frozen=True, eq=False)
class Box:
    """Bounds of all parameters.

    Attributes:
        low, high: (p,) the smallest and the largest values.
        varied: (n,) indices of the parameters that are not fixed, of increasing size.
    """

    low: Array
    high: Array
    varied: Indices

    def limits(self, theta: Array) -> tuple[Array, Array]:
        """(n,) each: the steps of the varied parameters from θ (p,) to their lower and upper bounds."""
        return (self.low - theta)[self.varied], (self.high - theta)[self.varied]

    def moved(self, theta: Array, step: Array) -> Array:
        """(p,) θ after a step (n,) of the varied parameters; a step to a bound ends exactly on it."""
        down, up = self.limits(theta)
        new = theta.copy()
        new[self.varied] = np.where(
            step <= down,
            self.low[self.varied],
            np.where(step >= up, self.high[self.varied], theta[self.varied] + step),
        )
        return new


def bounded(start: ArrayLike, lower: ArrayLike, upper: ArrayLike, names: Sequence[str]) -> tuple[Array, Box]:
    """(p,) start values, and their bounds (p,) or a number each.

    Raises:
        ModelError: for start values that are not finite or outside their bounds, bounds that cross, or names of
            another number.
    """
    theta = np.array(start, dtype=float)
    if theta.ndim != 1:
        raise ModelError(f"start values of shape {theta.shape}; give (p,)")
    if names and len(names) != len(theta):
        raise ModelError(f"{len(names)} names for {len(theta)} parameters")
    low = np.broadcast_to(np.asarray(lower, dtype=float), theta.shape)
    high = np.broadcast_to(np.asarray(upper, dtype=float), theta.shape)
    for k, (value, a, b) in enumerate(zip(theta, low, high, strict=True)):
        what = names[k] if names else f"θ{k + 1}"
        if not np.isfinite(value):
            raise ModelError(f"start value of {what} is {value}; give a finite number")
        if not a <= b:
            raise ModelError(f"bounds of {what} are [{a:g}, {b:g}]; the lower one must not exceed the upper one")
        if not a <= value <= b:
            raise ModelError(f"start value {value:g} of {what} is outside its bounds [{a:g}, {b:g}]")
    return theta, Box(low, high, np.flatnonzero(low < high))


# h, the part of a step that the second derivative is taken over, and the largest length of q over that of p.
ALONG, LONGEST = 0.1, 0.375


def acceleration(
    problem: Problem,
    theta: Array,
    blocks: Sequence[Block],
    loss: Loss,
    varied: Indices,
    triangle: Array,
    scale: Array,
    step: Array,
) -> Array | None:
    """(n,) q for a damped step; None where there is no residual along it, or q is not small.

    Args:
        problem: of the residuals.
        theta: (p,) θ.
        blocks: residual and derivative there, of every experiment.
        loss: with the weights W.
        varied: (n,) the parameters that the step moves.
        triangle: (n, n) the factor of JᵀWJ + λD².
        scale: (n,) D, in which lengths are compared.
        step: (n,) p.
    """
    from scipy.linalg.lapack import dtrtrs

    whole = np.zeros(len(theta))
    whole[varied] = step
    try:
        there = problem.residuals(theta + ALONG * whole)
    except Infeasible:
        return None
    slope = np.zeros(len(theta))
    with np.errstate(all="ignore"):
        for (residual, jacobian), after in zip(blocks, there, strict=True):
            second = 2 / ALONG * ((after - residual) / ALONG - jacobian @ whole)
            slope += jacobian.T @ (loss.weight(residual) * second)
        bend = -0.5 * dtrtrs(triangle, dtrtrs(triangle, slope[varied], trans=1)[0])[0]
        small = np.linalg.norm(scale * bend) <= LONGEST * np.linalg.norm(scale * step)
    return bend if small else None


# A step is rounding if it changes no parameter by more than this fraction, or if the predicted reduction of the cost
# is less than this fraction.
ROUNDING = 1e-13
# The largest number of steps.
MOST_STEPS = 100
# The number of successive steps that together must lower the cost by `least_saving`.
PATIENCE = 4
# Limits of the damping. At the largest, a step is a tiny one along the gradient; if even that does not lower the cost,
# the cost is not smooth at this point.
LEAST_DAMPING, MOST_DAMPING = 1e-20, 1e16
FIRST_DAMPING = 1e-3
# The damping grows by this factor after a step to parameters without a derivative.
MORE_DAMPING = 100.0
# A step is accelerated if it promises less than this share of what the undamped step does.
DAMPED = 0.9
# A step that raises the cost of the data by more than this fraction, besides what smoothing takes, is taken again with
# weights of the penalties that are smaller by the second number, at most the third number of times.
RAISED, LIGHTER, MOST_LIGHTENED = 0.05, 0.1, 8


@dataclass(frozen=True, eq=False)
class _Point:
    """A θ with its cost and its linearisation."""

    theta: Array
    linearised: Linearised
    information: Information  # of the parameters that are not fixed, with the penalty
    lengths: Array  # of the columns of √w·J, without the penalty
    weights: Array  # of the penalties
    most: Array  # the largest weights that they may have
    independent: float  # effective samples of the residual, the most so far
    penalty: Penalty  # all of them together, with their weights

    @property
    def cost(self) -> float:
        """The cost without the penalty."""
        return self.linearised.cost

    @property
    def penalised_cost(self) -> float:
        """The cost with the penalty."""
        return self.cost + self.penalty.cost(self.theta)


@dataclass(frozen=True, eq=False)
class _Iterate:
    """The state of a search after a number of steps; immutable, so that the search can stop between any two steps.

    Attributes:
        point: θ with its cost and its linearisation.
        scale: (n,) D, the largest lengths that the columns of √w·J have had.
        damping: λ of the next step.
        remaining: (n,) the undamped step to the linearised minimum, within bounds.
        offset: its length in standard errors.
        offset_before: the same one step ago.
        costs: V at the start and after every step.
    """

    point: _Point
    scale: Array
    damping: float
    remaining: Array
    offset: float
    offset_before: float
    costs: tuple[float, ...]

    @property
    def steps(self) -> int:
        """The number of steps taken."""
        return len(self.costs) - 1

    @property
    def cost_is_rounding(self) -> bool:
        """Whether the predicted reduction of the cost is below its rounding."""
        return promised(self.point.information, self.remaining) <= ROUNDING * self.point.cost


@dataclass(frozen=True, eq=False)
class _End:
    """How a search ended."""

    ending: Ending
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False)
class _Search:
    """A search, step by step; the arguments are those of `gauss_newton`."""

    problem: Problem
    box: Box
    loss: Loss
    max_iterations: int
    tolerance: float
    least_saving: float
    noise: float
    control: Control
    smoothing: Smoothing
    accelerated: bool = False

    def begin(self, theta: Array) -> _Iterate:
        """The state at the start.

        Raises:
            ModelError: if the residual is not finite, or there are fewer residuals than free parameters.
        """
        if not np.isfinite(cost(self.problem, theta, self.loss)):
            raise ModelError("the residual at the start is not finite; check the data and the start values")
        count = len(self.smoothing.penalties)
        point = self._linearise(theta, np.ones(count), np.full(count, np.inf), 0.0)
        if point.information.samples + len(point.penalty.rows) < len(self.box.varied):
            raise ModelError(
                f"{int(point.information.samples)} samples for {len(self.box.varied)} free parameters; "
                "give more data or fix some parameters"
            )
        return self._at(point, np.zeros(len(self.box.varied)), FIRST_DAMPING, np.inf, (point.cost,))

    def advance(self, iterate: _Iterate, lower: tuple[Array | None, float] | None = None) -> _Iterate | None:
        """The state after one more step, the one to `lower` if that is known; None if no step lowers the cost.

        Raises:
            Stopped: if the search has to end before a step is found.
        """
        (theta, damping), before, lightened = lower or self.lower(iterate), iterate.point, 0
        while theta is not None:
            try:
                point = self._linearise(theta, before.weights, before.most, before.independent)
            except Infeasible:  # the cost is lower there, but has no derivative: a smaller step
                iterate = replace(iterate, damping=MORE_DAMPING * iterate.damping)
                theta, damping = self._descend(iterate)
                continue
            if lightened == MOST_LIGHTENED or not self._flattened(point, iterate):
                new = self._at(point, iterate.scale, damping, iterate.offset, (*iterate.costs, point.cost))
                self.control.report(Activity("", new.steps, cost=new.point.cost, offset=new.offset))
                return new
            before = self._linearise(before.theta, before.weights, LIGHTER * before.weights, before.independent)
            iterate = self._at(before, iterate.scale, iterate.damping, iterate.offset_before, iterate.costs)
            theta, damping = self._descend(iterate)
            lightened += 1
        return None

    def end(self, iterate: _Iterate) -> _End | None:
        """How the search ends at this state; None if it continues."""
        settled = iterate.cost_is_rounding and iterate.offset > 0.5 * iterate.offset_before
        if iterate.offset <= self.tolerance or settled or self._step_is_rounding(iterate):
            return _End(Ending.CONVERGED)
        if iterate.steps >= self.max_iterations:
            return self.short_of_minimum(iterate, Ending.OUT_OF_BUDGET, "steps-used-up")
        if (ending := self.control.ending) is not None:
            return self.stopped(iterate, ending)
        if self._cost_hardly_falls(iterate):
            data = {"last_steps": PATIENCE, "least_saving": self.least_saving}
            return self.short_of_minimum(iterate, Ending.OUT_OF_BUDGET, "cost-hardly-falls", **data)
        return None

    def stopped(self, iterate: _Iterate, ending: Ending) -> _End:
        """The end that `control` requests."""
        code = "search-cancelled" if ending is Ending.INTERRUPTED else "time-used-up"
        return self.short_of_minimum(iterate, ending, code)

    def short_of_minimum(self, iterate: _Iterate, ending: Ending, code: str, **data: float) -> _End:
        """An end that is not at a minimum, with the remaining distance to it."""
        return _End(ending, (Finding(code, data={"steps": iterate.steps, "offset": _finite(iterate.offset), **data}),))

    def _at(self, point: _Point, scale: Array, damping: float, before: float, costs: tuple[float, ...]) -> _Iterate:
        scale = np.maximum(scale, point.lengths)
        remaining = bounded_step(point.information, *self.box.limits(point.theta))
        offset = relative_offset(point.information, remaining, self.noise)
        return _Iterate(point, scale, damping, remaining, offset, before, costs)

    def _flattened(self, point: _Point, iterate: _Iterate) -> bool:
        """Whether the penalties have raised the cost of the data by more than smoothing can.

        Their weights are chosen for a residual that is linear in θ. Where it is not, as in a loop, they may be too
        heavy: step after step the fit gets worse while the penalised cost falls.
        """
        smoothed = 2 * len(iterate.point.penalty.rows) / max(point.information.samples, 1)
        return bool(self.smoothing.penalties) and point.cost > (1 + RAISED + smoothed) * min(iterate.costs)

    def _linearise(self, theta: Array, weights: Array, most: Array, independent: float) -> _Point:
        """The linearisation at θ, with the penalties; their weights are chosen, starting from the given ones.

        The number of independent samples in the residual never falls, so that the search settles.
        """
        here = linearised(self.problem, theta, self.box.varied, self.loss)
        information = here.information
        penalties = self.smoothing.penalties
        if penalties:
            independent = max(independent, self.smoothing.samples(here.residuals))
            likely = chosen_weights(penalties, information, theta, self.box.varied, weights, independent)
            weights = np.minimum(likely, most)
        penalty = Penalty.weighted(penalties, weights, len(theta))
        lengths = np.linalg.norm(information.factor[:-1, :-1], axis=0)
        information = penalty.added(information, theta, self.box.varied)
        return _Point(theta, here, information, lengths, weights, most, independent, penalty)

    def lower(self, iterate: _Iterate) -> tuple[Array | None, float]:
        """A θ with a lower cost, or where the change is rounding, and the next damping; None if no step leads there."""
        theta = self._undamped(iterate)
        return self._descend(iterate) if theta is None else (theta, iterate.damping)

    def _undamped(self, iterate: _Iterate) -> Array | None:
        """θ after the undamped step, if the change of the cost is below its rounding; otherwise None."""
        if not iterate.cost_is_rounding:
            return None
        theta = self.box.moved(iterate.point.theta, iterate.remaining)
        return theta if np.isfinite(trial_cost(self.problem, theta, self.loss)) else None

    def _descend(self, iterate: _Iterate) -> tuple[Array | None, float]:
        """A θ with a lower cost and the next damping; None if no step lowers the cost."""
        point, damping, growth = iterate.point, iterate.damping, 2.0
        while damping < MOST_DAMPING:
            damped = point.information.with_prior(damping * iterate.scale**2)
            step = bounded_step(damped, *self.box.limits(point.theta))
            saving = promised(point.information, step)
            if saving <= ROUNDING * point.cost:
                break
            self.control.check()
            ends = [self.box.moved(point.theta, each) for each in self._bent(iterate, damped, step, saving)]
            costs = [trial_cost(self.problem, end, self.loss) + point.penalty.cost(end) for end in ends]
            trial, theta = min(zip(costs, ends, strict=True), key=itemgetter(0))
            ratio = (point.penalised_cost - trial) / saving
            if ratio > 0:
                return theta, max(damping * max(0.1, 1 - (2 * min(ratio, 1.0) - 1) ** 3), LEAST_DAMPING)
            damping *= growth
            growth *= 2.0
        return None, damping

    def _bent(self, iterate: _Iterate, damped: Information, step: Array, saving: float) -> list[Array]:
        """(n,) a damped step, and what follows the bend of the valley if the damping lessens what it saves by much."""
        point = iterate.point
        if not (self.accelerated and saving < DAMPED * promised(point.information, iterate.remaining)):
            return [step]
        triangle, varied = damped.factor[:-1, :-1], self.box.varied
        bend = acceleration(
            self.problem, point.theta, point.linearised.blocks(), self.loss, varied, triangle, iterate.scale, step
        )
        return [step] if bend is None else [step, step + bend]

    def _cost_hardly_falls(self, iterate: _Iterate) -> bool:
        if not self.least_saving or iterate.steps < PATIENCE:
            return False
        return iterate.costs[-1] > (1 - self.least_saving) * iterate.costs[-1 - PATIENCE]

    def _step_is_rounding(self, iterate: _Iterate) -> bool:
        theta = iterate.point.theta[self.box.varied]
        # Without squares, which overflow where a run nearly diverges.
        step, length = (np.hypot.reduce(iterate.scale * each) for each in (iterate.remaining, theta))
        return bool(step <= ROUNDING * length)


def gauss_newton(
    problem: Problem,
    start: ArrayLike,
    *,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
    loss: Loss = SQUARES,
    max_iterations: int = MOST_STEPS,
    tolerance: float = 1e-3,
    least_saving: float = 0.0,
    noise: float = 0.0,
    names: Sequence[str] = (),
    control: Control = FREE,
    covariances: bool = True,
    interruptible: bool = False,
    smoothing: Smoothing = NONE,
    accelerated: bool = False,
) -> Minimum:
    """The θ that minimises Σ ℓ(r(θ)), and penalties if any, within bounds, from a start.

    Args:
        problem: residuals and their derivative. It may raise `Stopped`, which ends the search like ``control``.
        start: (p,) θ to start from, within the bounds.
        lower, upper: (p,) or a number; a parameter whose two bounds coincide is fixed.
        loss: `SQUARES`, `Huber`, `Cauchy` or an object with the same three methods.
        max_iterations: the largest number of steps.
        tolerance: length of the remaining step, in standard errors of the estimate, at which the search has converged.
        least_saving: the search ends if `PATIENCE` steps together lower the cost by less than this fraction. It is for
            comparisons of costs, which need no exact minimum of a flat valley.
        noise: standard deviation of the residual that rounding alone causes; a lower limit on the noise in standard
            errors.
        names: (p,) names for findings, θ1, θ2, … by default.
        control: checked before every trial step; if it ends the search, the best θ so far is returned. It gets a
            report of every step.
        covariances: whether they are computed; otherwise they are infinite.
        interruptible: whether ``control`` may end their computation too, which takes seconds for a long record.
        smoothing: penalties on roughness, whose weights are chosen from the data.
        accelerated: whether damped steps follow the bend of a valley; a `SparseProblem` computes its derivative again.

    Raises:
        ModelError: for a start outside its bounds or without a finite residual, bounds that cross, blocks of other
            shapes, fewer residuals than free parameters, a negative number of steps.
        Stopped: by ``problem``, at the start; by ``control`` during the covariances, where these are interruptible.
    """
    if max_iterations < 0:
        raise ModelError(f"max_iterations {max_iterations}: this is a number of steps; give at least 0")
    theta, box = bounded(start, lower, upper, names)
    search = _Search(
        problem, box, loss, max_iterations, tolerance, least_saving, noise, control, smoothing, accelerated
    )
    iterate = search.begin(theta)
    while (end := search.end(iterate)) is None:
        try:
            following = search.advance(iterate)
        except Stopped as stopped:
            end = search.stopped(iterate, stopped.ending)
            break
        if following is None:
            end = search.short_of_minimum(iterate, Ending.STALLED, "search-stalled")
            break
        iterate = following
    labels = tuple(names) or tuple(f"θ{k + 1}" for k in range(len(theta)))
    check = control.check if interruptible else FREE.check
    return _conclude(iterate, box, loss if covariances else None, labels, end, check)


def each_step(
    problem: Problem,
    start: ArrayLike,
    *,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
    tolerance: float = 1e-3,
    names: Sequence[str] = (),
    control: Control = FREE,
) -> Iterator[Array]:
    """θ (p,) after every step of `gauss_newton`, to compare starts; the derivative there belongs to the next step.

    Raises:
        ModelError: as `gauss_newton`.
        Stopped: by ``problem`` or ``control``.
    """
    theta, box = bounded(start, lower, upper, names)
    search = _Search(problem, box, SQUARES, MOST_STEPS, tolerance, 0.0, 0.0, control, NONE)
    iterate: _Iterate | None = search.begin(theta)
    while iterate is not None and search.end(iterate) is None:
        after = search.lower(iterate)
        if after[0] is not None:
            yield after[0]
        iterate = search.advance(iterate, after)


def _finite(number: float) -> float | None:
    """The number as JSON can store it; None if it is infinite."""
    return number if np.isfinite(number) else None


def _conclude(
    iterate: _Iterate, box: Box, loss: Loss | None, labels: Sequence[str], end: _End, check: Callable[[], None]
) -> Minimum:
    """The result of the search, with covariances if a loss is given.

    Raises:
        Stopped: by ``check``, during the covariances.
    """
    point, theta = iterate.point, iterate.point.theta
    at_bound = _at_bounds(point, box)
    free = (box.low < box.high) & ~at_bound
    columns = np.flatnonzero(free)
    information = point.information.select(np.flatnonzero(free[box.varied]))
    solution = information.solve()
    ending, findings = end.ending, list(end.findings)
    if ending is Ending.CONVERGED and solution.rank < len(columns):
        ending = Ending.RANK_DEFICIENT
        findings.append(undetermined(solution, [labels[k] for k in columns]))
    for k in np.flatnonzero(at_bound):
        side = "lower" if theta[k] <= box.low[k] else "upper"
        findings.append(Finding("parameter-at-bound", labels[k], {"side": side, "bound": float(theta[k])}))
    white = robust = np.diag(np.full(len(columns), np.inf))
    if loss is not None:
        blocks = point.linearised.blocks()
        white, robust = covariance_matrices(
            blocks, columns, solution, loss, point.penalty.rows, point.independent, check
        )
    residuals = point.linearised.residuals
    samples = sum(len(r) for r in residuals)
    square = float(sum(np.sum(r**2) for r in residuals))
    determined = columns[np.isfinite(np.diag(solution.covariance))]
    kept = np.flatnonzero(np.isin(columns, determined))
    freedom = samples - solution.rank + point.penalty.held(information.select(kept), determined)
    return Minimum(
        estimate=theta,
        cost=point.cost,
        residuals=residuals,
        information=information,
        free=free,
        covariance=_among_all(robust, columns, len(theta)),
        white_covariance=_among_all(white, columns, len(theta)),
        noise_variance=square / freedom if freedom > 0 else np.nan,
        samples=samples,
        rank=solution.rank,
        condition=solution.condition,
        ending=ending,
        findings=tuple(findings),
        iterations=iterate.steps,
        costs=iterate.costs,
        penalty=point.penalty,
    )


def _among_all(part: Array, columns: Indices, count: int) -> Array:
    """The covariance of the parameters in ``columns``, padded with zeros for the rest."""
    whole = np.zeros((count, count))
    whole[np.ix_(columns, columns)] = part
    return whole


def _at_bounds(point: _Point, box: Box) -> NDArray[np.bool_]:
    """(p,) which of the parameters that are not fixed are at a bound that the gradient points across."""
    pushed = np.zeros(len(point.theta))
    pushed[box.varied] = -point.information.factor[:-1, :-1].T @ point.information.factor[:-1, -1]
    outwards = ((point.theta <= box.low) & (pushed > 0)) | ((point.theta >= box.high) & (pushed < 0))
    at_bound: NDArray[np.bool_] = outwards & (box.low < box.high)
    return at_bound
