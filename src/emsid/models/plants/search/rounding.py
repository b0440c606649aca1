r"""Where the rounding of a reading is most of the error of a free run: what follows for the estimates.

Rounding to steps Δ makes errors of variance Δ²/12. Such errors follow the motion, so that the covariance is that of
clusters, and an exact model is within half a step of every reading, which often determines its parameters far better
than least squares (`emsid.estimation.uncertainty.rounding`). Initial states are then estimated too: a counter at rest
shows them to half a step only. Where no parameters do that, an effect is missing or there is other noise; where an
output stays at exactly one value while it rests, it has hardly any other noise, and a larger error is one of the model,
the same function of the motion everywhere, which intervals from the spread of the errors do not include. The intervals
are then the extent of the parameters with which no error is larger than the largest one of least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.estimation.uncertainty.rounding import EXACT, Extent, extent, quantisation, runs
from emsid.findings import Finding
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.initial_state import InitialState
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.task import Limits, Task

Array = NDArray[np.float64]

ABOVE = 1.3
"""The error is above that of rounding by this factor; noise of a fifth of a step makes 1.2, unseen at rest. A speed
that is the difference of two counts has √2: its error is of another kind."""
STILL = 20
"""Samples at one value, while the input changes, that show an output without noise at rest."""
SETTLED = 0.1
"""The set of parameters is final where the next one has its centre this near, in half widths."""
ROUNDS = 5
"""Linearisations of the model, at most."""


def steps_of(problem: FreeRunError) -> Array | None:
    """(2, ny) the step of every output and its largest error, half a step or a little more; None where one has none.

    They are in the units of the residual.
    """
    if problem.weighting is not all_alike:
        return None
    found = []
    for reading in np.concatenate([segment.output for segment in problem.segments]).T:
        levels = np.unique(reading)
        step = quantisation(levels)
        if step is None:
            return None
        off = levels - levels[0] - step * np.rint((levels - levels[0]) / step)  # of readings that were rounded again
        found.append((step, 0.5 * step + float(np.max(np.abs(off)))))
    return np.array(found).T / problem.output_scale


def prevails(problem: FreeRunError, residuals: Sequence[Array]) -> bool:
    """Whether the error of every output is that of its rounding.

    Args:
        problem: with the records.
        residuals: of every segment, channel after channel.
    """
    steps = steps_of(problem)
    if steps is None:
        return False
    channels = zip(*(np.split(residual, len(problem.signals)) for residual in residuals), strict=True)
    errors = [sqrt(12 * np.mean(np.concatenate(parts) ** 2)) for parts in channels]
    return bool(np.all(errors <= ABOVE * steps[0]))


def readings_of(problem: FreeRunError) -> list[Array]:
    """(N,) every output of every segment, segment by segment."""
    return [reading for segment in problem.segments for reading in segment.output.T]


def independent_errors(problem: FreeRunError, residuals: Sequence[Array]) -> float:
    """The number of independent samples of a residual: where rounding prevails, no more than runs of one reading."""
    found = effective_samples(residuals)
    if not prevails(problem, residuals):
        return found
    return min(found, float(sum(len(runs(reading)[0]) for reading in readings_of(problem))))


class Rounded(NamedTuple):
    """What rounding says of a minimum.

    Attributes:
        problem: begun at the centre of the set of parameters; at the minimum where there is none.
        minimum: its estimate and covariance replaced by those of the set, where there is one.
        findings: what was found.
    """

    problem: FreeRunError
    minimum: Minimum
    findings: tuple[Finding, ...]


def within_rounding(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> Rounded:
    """The parameters with which the model is within half a step of every reading, where rounding prevails.

    Args:
        task: with the records.
        problem: begun at the minimum.
        names: (p,) the parameters that were estimated.
        minimum: where the search ended.
    """
    p, steps = len(names), steps_of(problem)
    free = minimum.free[:p] & np.isfinite(np.diag(minimum.covariance)[:p])
    none = Rounded(problem, minimum, ())
    if steps is None or not free.any():
        return none
    prevailing, of_model = prevails(problem, problem.residuals(problem.start)), _is_of_the_model(task)
    if not prevailing and not of_model:
        return none
    step = float(steps[0, 0] * problem.output_scale[0])
    data = {"step": step, "unit": task.segments[0].output_units[0]}
    about = _Polytope.of(replace(task, begins=InitialState.FREE), problem, names, free, steps[1])
    try:
        found, set_of = about.settled() if prevailing else (about, None)
        if prevailing and set_of is None:
            return none
        inside = set_of is not None and bool(set_of.half_width.any())
        wide = about.widened() if of_model and not inside else None
    except (EmsidError, Stopped, np.linalg.LinAlgError):
        return none
    own, covariance = int(free.sum()), np.zeros((p, p))
    if set_of is not None and inside:
        covariance[np.ix_(free, free)] = set_of.covariance[:own, :own]
        before = np.sqrt(np.diag(minimum.covariance)[:p][free])
        data["narrower"] = float(np.median(before / np.sqrt(np.diag(set_of.covariance)[:own])))
        estimate = found.problem.start[:p]
        refined = replace(minimum, estimate=estimate, covariance=covariance, free=minimum.free[:p])
        return Rounded(found.problem, refined, (Finding("within-rounding", problem.plant.name, data),))
    if wide is not None:
        covariance[np.ix_(free, free)] = wide.covariance[:own, :own]
        minimum = replace(minimum, covariance=covariance, free=minimum.free[:p])
    if set_of is not None:
        finding = Finding("outside-rounding", problem.plant.name, data | {"least": set_of.least})
    else:
        ratio = sqrt(12.0 * minimum.noise_variance) / step
        finding = Finding("error-above-rounding", problem.plant.name, data | {"ratio": ratio})
    return Rounded(problem, minimum, (finding,))


@dataclass(frozen=True)
class _Polytope:
    """The parameters with which a linearised model is near every reading.

    Attributes:
        problem: begun at where it is linearised.
        columns: which of its coordinates are free.
        half: (N,) the largest error of every reading, in the units of the residual.
        limits: of the parameters.
    """

    problem: FreeRunError
    columns: NDArray[np.intp]
    half: Array
    limits: Limits

    @classmethod
    def of(
        cls, task: Task, problem: FreeRunError, names: Sequence[str], free: NDArray[np.bool_], largest: Array
    ) -> _Polytope:
        """About a minimum.

        Args:
            task: in which the initial states are estimated.
            problem: begun at the minimum.
            names: (p,) of the parameters.
            free: (p,) which of them are neither fixed nor at a bound.
            largest: (ny,) the largest error of every reading, in the units of the residual.
        """
        found = task.problem(problem.plant, names, problem.states(problem.start))
        columns = np.flatnonzero(np.append(free, np.ones(len(found.start) - len(names), bool)))
        half = np.concatenate([np.repeat(largest, len(segment)) for segment in task.segments])
        return cls(found, columns, half, task.limits)

    def settled(self) -> tuple[_Polytope, Extent | None]:
        """Linearised at its centre again until that stays; without an extent where it does not settle."""
        found = self
        for _ in range(ROUNDS):
            residual, jacobian, (lower, upper) = found._linear()
            set_of = extent(residual, jacobian, self.half, lower, upper)
            if np.all(np.abs(set_of.centre) <= SETTLED * set_of.half_width):
                return found, set_of
            theta = found.problem.start.copy()
            theta[self.columns] += set_of.centre
            found = replace(found, problem=found.problem.begun_at(theta))
        return found, None if set_of.half_width.any() else set_of

    def widened(self) -> Extent:
        """With the largest error of the minimum in place of that of rounding; its extent is about the minimum.

        An error of the model that is the same function of the motion everywhere is not smaller with other parameters
        that are as good, so these are where no error is larger than the largest one of the minimum.
        """
        residual, jacobian, (lower, upper) = self._linear()
        times = float(np.max(np.abs(residual) / self.half))
        found = extent(residual, jacobian, times * (1 + EXACT) * self.half, lower, upper)
        reach = 1.0 + np.abs(found.centre) / found.half_width
        return found._replace(covariance=found.covariance * np.outer(reach, reach))

    def _linear(self) -> tuple[Array, Array, tuple[Array, Array]]:
        """The residual (N,), its derivative by what is free (N, q), and how far that may go down and up, (q,) each."""
        blocks = self.problem.exactly(self.problem.start)
        start = self.problem.start[self.columns]
        lower, upper = (bound[self.columns] - start for bound in self.problem.within(self.limits))
        jacobian = np.concatenate([each for _, each in blocks])[:, self.columns]
        return np.concatenate([each for each, _ in blocks]), jacobian, (lower, upper)


def _is_of_the_model(task: Task) -> bool:
    """Whether an error above that of rounding is one of the model: the position rests exactly at a value."""
    if task.signals != (Signal.POSITION,):
        return False
    return any(_rests_exactly(segment.input[:, 0], segment.output[:, 0]) for segment in task.segments)


def _rests_exactly(u: Array, y: Array) -> bool:
    """Whether an output (N,) stays at one value for a while, in which its input changes."""
    return any(np.ptp(u[k : k + n]) > 0 for k, n in zip(*runs(y), strict=True) if n >= STILL)
