r"""The least-squares problem of a grey box: the free-run error as a `Problem` for `gauss_newton`.

The parameters θ of a plant and the initial state x₀ of every segment minimise the simulation error

    V(θ, x₀) = ½ Σₜ ‖W·(y(t) − ŷ(t; θ, x₀))‖²,

where ŷ is the free run: after x₀ the model sees only the input. This matters for friction, because a one-step
prediction would get its sign from the measured speed. Several outputs are each divided by their standard deviation, so
that rad/s and A have equal weight. W may weight errors by their age, see `Recent`, or the load may drift, see
`drifting_load`.

The derivative of ŷ is a difference of free runs, of long records in parallel threads. The motion is a continuous
function of θ, because events are located, and a run takes microseconds.
Differences are one-sided during a search, and central at its end, where they give the intervals. The initial states
of all segments are changed together, because segments are independent; and so is a parameter that differs by record,
whose column is zero in all other records.

References:
    Ljung, *System Identification*, 2nd ed., sec. 3.3 and 7.5. Schoukens, Ljung, *Nonlinear System Identification: A
    User-Oriented Road Map*, IEEE CSM 39 (2019), on simulation error against prediction error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from itertools import chain
from math import inf, isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.filtering import filtered
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.problem import Block, Infeasible, LastRun
from emsid.estimation.threads import cores, short_tasks
from emsid.models.plants.drifting_load import DriftingLoad, by_sample
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant, Sizes
from emsid.record import Record

Array = NDArray[np.float64]
Weighting = Callable[[Array, float], Array] | tuple[DriftingLoad, ...]
"""One for all segments, or under a load that drifts one for each."""


# --- weightings -----------------------------------------------------------------------------------------------------


def all_alike(error: Array, dt: float) -> Array:
    """Equal weights: the plain output error."""
    return error


@dataclass(frozen=True)
class Recent:
    """High-pass weighting with forgetting: ((1 − q⁻¹)/(1 − e^{−dt/τ}·q⁻¹))ⁿ·e.

    A position is a double integral, so the effect of a short disturbance on its free run never decays, and the plain
    output error would bias the parameters to compensate for it. With n = 2 the error is measured as an acceleration of
    bandwidth 1/τ, with n = 1 as a drift.

    Args:
        time: τ in s.
        order: n.
    """

    time: float
    order: int = 1

    def __post_init__(self) -> None:
        if not (isfinite(self.time) and self.time > 0) or self.order not in (1, 2):
            raise ModelError(f"errors forgotten after {self.time} s, order {self.order}; give a positive time, 1 or 2")

    def __call__(self, error: Array, dt: float) -> Array:
        """(N,) the weighted error of one channel of one segment, scaled by τⁿ to stay in its unit."""
        decay = np.exp(-dt / self.time)
        for _ in range(self.order):
            error = filtered([1.0, -1.0], [1.0, -decay], error)
        return error


def elsewhere(weighting: Weighting, plant: Plant, segments: Sequence[Record], signals: Sequence[Signal]) -> Weighting:
    """A weighting for other segments; the drift of a load is the same process there, linearised at a plant.

    Args:
        weighting: of the fit.
        plant: with its parameters.
        segments: of which every one is to be weighted.
        signals: of their outputs.
    """
    if not isinstance(weighting, tuple) or not isinstance(plant, DrivenPlant):
        return weighting
    drift, none = weighting[0].drift, np.zeros_like(weighting[0].drifted)
    return tuple(
        DriftingLoad.around(plant, segment, plant.first_state(signals, segment), signals, drift, none)
        for segment in segments
    )


# --- the least-squares problem --------------------------------------------------------------------------------------


PRECISION = 1e-11
"""The relative precision of a free run: the tolerance of the simulation."""
SHARED_SAMPLES = 2_000
"""Fewer samples are searched in one thread: their runs are so short that threads wait for each other."""
LOST, WIDER = 100.0, 1e3
"""Below `LOST` times the precision of the runs, their difference is rounding; its step is widened by `WIDER`."""


def threads_for(segments: Sequence[Record]) -> int:
    """The number of threads for searches over these records."""
    return cores() if sum(map(len, segments)) > SHARED_SAMPLES else 1


class _Run(NamedTuple):
    """A θ with its plant, its initial states and its residuals; why another θ has none, where it stands for that."""

    theta: Array
    plant: Plant
    states: list[Array]
    residuals: list[Array]
    why: str = ""


class _Linearised(NamedTuple):
    """A θ with its residuals and derivatives, and whether these are central differences."""

    theta: Array
    blocks: list[Block]
    central: bool


class FreeRunError:
    """Residuals of free runs and their derivative with respect to θ and the initial states."""

    def __init__(
        self,
        plant: Plant,
        signals: Sequence[Signal],
        segments: Sequence[Record],
        free: Sequence[str],
        states: Sequence[Array],
        free_states: Sequence[Sequence[int]],
        weighting: Weighting,
        threads: int,
        counted: Sequence[Array] | None = None,
    ) -> None:
        self.plant, self.signals, self.segments, self.free = plant, tuple(signals), tuple(segments), tuple(free)
        self.weighting, self.threads = weighting, threads
        channels = len(self.signals)  # 0 for samples whose errors do not count; None: all do
        self._counted = None if counted is None else [np.tile(some, channels) for some in counted]
        self._record_of = [plant.record_of(segment) for segment in self.segments]
        self.control = FREE  # looked at before every free run; those of a plant with a stiff shaft take seconds
        self._initial = [state.copy() for state in states]
        self._places = [
            (segment, index) for segment, indices in enumerate(free_states) for index in indices
        ]  # segment and index of the initial states in θ
        bounds = [(plant.handles[name].lower, plant.handles[name].upper) for name in self.free]
        self.lower, self.upper = self._bounds(bounds)
        whole = np.concatenate([segment.output for segment in segments])
        spread = np.std(whole, axis=0)
        self._scale = np.ones(len(spread)) if len(spread) == 1 else np.where(spread > 0, spread, 1.0)
        command = max(float(np.max(np.abs(segment.input))) for segment in segments)
        self._of_records = Sizes(command or 1.0, float(np.max(np.abs(whole))) or 1.0, segments[0].dt)
        self.sizes = self._sizes()
        self.precision = PRECISION * float(np.sqrt(np.mean((whole / self._scale) ** 2)))
        self._last: LastRun[list[Array]] = LastRun()
        self._linearised_at: _Linearised | None = None

    @property
    def start(self) -> Array:
        """The present θ and initial states."""
        values = [self.plant.value(name) for name in self.free]
        return np.array([*values, *(self._initial[s][i] for s, i in self._places)])

    @property
    def output_scale(self) -> Array:
        """(ny,) by which the error of every output was divided."""
        return self._scale

    def within(self, limits: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
        """The bounds of θ, given bounds of its parameters; initial states have no bounds."""
        return self._bounds([limits[name] for name in self.free])

    def _bounds(self, of_parameters: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
        both = np.array([*of_parameters, *[(-inf, inf)] * len(self._places)]).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    @property
    def names(self) -> tuple[str, ...]:
        """Names for messages."""
        return (*self.free, *(f"initial state {i + 1} of segment {s + 1}" for s, i in self._places))

    def plant_at(self, theta: Array) -> Plant:
        """The plant with the parameters in θ."""
        return self.plant.with_values(dict(zip(self.free, theta.tolist(), strict=False)))

    def states(self, theta: Array) -> list[Array]:
        """The initial states in θ."""
        states = [state.copy() for state in self._initial]
        for (segment, index), value in zip(self._places, theta[len(self.free) :], strict=True):
            states[segment][index] = value
        return states

    def begun_at(self, theta: Array) -> FreeRunError:
        """The same problem with θ as its start; cached results are kept."""
        moved = copy(self)
        moved.plant, moved._initial = self.plant_at(theta), self.states(theta)
        moved.sizes = moved._sizes()
        return moved

    def residuals(self, theta: Array) -> list[Array]:
        """W·(ŷ − y) of every segment, channel after channel."""
        return self._last.at(theta, lambda: self._simulated(theta))

    def errors(self) -> Array:
        """(ny, N) W·(ŷ − y) of every output at the start, in its unit, one segment after the other."""
        outputs = len(self.signals)
        errors = np.hstack([each.reshape(outputs, -1) for each in self.residuals(self.start)])
        return np.asarray(errors * self.output_scale[:, None])

    def linearised(self, theta: Array) -> list[Block]:
        """Residuals and their derivative: one-sided differences during a search, `exactly` at its end."""
        known = self._linearised_at
        if known is None or not np.array_equal(known.theta, theta):
            known = self._linearised_at = self._differentiated(theta, False)
        return known.blocks

    def exactly(self, theta: Array) -> list[Block]:
        """Residuals and their derivative by central differences; one-sided if only one side has a free run.

        The derivative is zero at a bound beside which there is no free run: the plant with a tiny inductance, or with a
        very stiff shaft, takes too many steps, and its limit is as good.
        """
        known = self._linearised_at
        if known is None or not (known.central and np.array_equal(known.theta, theta)):
            known = self._linearised_at = self._differentiated(theta, True)
        return known.blocks

    @contextmanager
    def under(self, control: Control) -> Iterator[None]:
        """Within this context, a free run raises `Stopped` when the control ends the search."""
        self.control = control
        try:
            yield
        finally:
            self.control = FREE

    def _simulated(self, theta: Array) -> list[Array]:
        try:
            plant = self.plant_at(theta)
        except ModelError as problem:
            raise Infeasible(str(problem)) from None
        found = self._run(plant, self.states(theta))
        if isinstance(found, str):
            raise Infeasible(found)
        return found

    def _run(self, plant: Plant, states: list[Array]) -> list[Array] | str:
        """The residuals of a plant from its initial states, or the reason why there are none."""
        self.control.check()
        try:
            with np.errstate(all="ignore"):
                found = [self._weighed(self._simulate(plant, k, state), k) for k, state in enumerate(states)]
        except ModelError as problem:
            return str(problem)
        if all(np.isfinite(each).all() for each in found):
            return found
        return f"the free run of {self.plant.name} is not finite; check the start values and the plant"

    def _simulate(self, plant: Plant, k: int, state: Array) -> Array:
        """(N, ny) the free run of a segment, from an initial state, under the load that has drifted there."""
        segment, own = self.segments[k], plant.of_record(self._record_of[k])
        if isinstance(self.weighting, tuple) and isinstance(own, DrivenPlant) and self.weighting[k].drifted.any():
            drift = by_sample(self.weighting[k].drifted, len(segment))
            return own.simulate(segment.input, segment.dt, state, self.signals, drift)
        return own.simulate(segment.input, segment.dt, state, self.signals)

    def _weighed(self, run: Array, k: int) -> Array:
        """(n,) W·(ŷ − y) of a run (N, ny) of a segment, channel after channel."""
        segment = self.segments[k]
        errors = (run - segment.output) / self._scale
        weigh = self.weighting[k] if isinstance(self.weighting, tuple) else self.weighting
        weighed = np.concatenate([weigh(error, segment.dt) for error in errors.T])
        return weighed if self._counted is None else weighed * self._counted[k]

    def _differentiated(self, theta: Array, central: bool) -> _Linearised:
        here = _Run(theta, self.plant_at(theta), self.states(theta), self.residuals(theta))
        step = 1e-5 * np.maximum(np.abs(theta), 1e-2 * self.sizes)
        moves = self._moved_together(theta + step <= self.upper)
        size = max(-(-len(moves) // self.threads), 1)
        parts = [moves[k : k + size] for k in range(0, len(moves), size)]
        in_turn = short_tasks(self.threads) if self.threads > 1 else map  # a pool of one would be shared by all
        found = in_turn(lambda part: self._differences(here, part, step, central), parts)
        jacobians = [np.zeros((len(r), len(theta)), order="F") for r in here.residuals]
        for move, (width, columns) in zip(moves, chain.from_iterable(found), strict=True):
            for k in move:
                for segment in self._touched(k):
                    jacobians[segment][:, k] = columns[segment] / width[k]
        return _Linearised(theta.copy(), list(zip(here.residuals, jacobians, strict=True)), central)

    def _differences(
        self, here: _Run, moves: Sequence[list[int]], step: Array, central: bool
    ) -> list[tuple[Array, list[Array]]]:
        """For every move the change of θ (p,) and of the residuals."""
        sides = self._sides(here, moves, step, central)
        found = [self._difference(here, move, *pair) for move, pair in zip(moves, sides, strict=True)]
        rounding = LOST * self.precision
        sizes = [max(np.max(np.abs(column), initial=0.0) for column in columns) for _, columns in found]
        lost = [k for k, size in enumerate(sizes) if 0 < size < rounding]
        wider = self._sides(here, [moves[k] for k in lost], WIDER * step, central)
        for k, (above, below) in zip(lost, wider, strict=True):
            if (above.theta > below.theta).any():
                found[k] = self._difference(here, moves[k], above, below)
        return found

    def _difference(self, here: _Run, move: list[int], above: _Run, below: _Run) -> tuple[Array, list[Array]]:
        width, theta = above.theta - below.theta, here.theta[move]
        if (width > 0).any():
            return width, [a - b for a, b in zip(above.residuals, below.residuals, strict=True)]
        if np.all((theta <= self.lower[move]) | (theta >= self.upper[move])):
            return np.ones(len(width)), [np.zeros(len(each)) for each in here.residuals]
        raise Infeasible(f"{self.names[move[0]]} cannot be moved from {theta[0]:g}: {below.why}")

    def _sides(self, here: _Run, moves: Sequence[list[int]], step: Array, central: bool) -> list[tuple[_Run, _Run]]:
        """The runs above and below θ for every move; a one-sided difference has θ itself on one side."""
        above = self._beside(here, moves, step)
        both = [k for k, run in enumerate(above) if central or run.theta is here.theta]
        below = dict(zip(both, self._beside(here, [moves[k] for k in both], -step), strict=True))
        return [(run, below.get(k, here)) for k, run in enumerate(above)]

    def _beside(self, here: _Run, moves: Sequence[list[int]], by: Array) -> list[_Run]:
        """The runs after every move, within the physical bounds; where there is none, that at θ, and why."""
        if not moves:
            return []
        runs, there = [], np.minimum(np.maximum(here.theta + by, self.lower), self.upper)
        for move in moves:
            theta = here.theta.copy()
            theta[move] = there[move]
            values = {self.free[k]: float(theta[k]) for k in move if k < len(self.free)}
            try:
                plant = here.plant.with_values(values) if values else here.plant
            except ModelError as problem:
                runs.append(here._replace(why=str(problem)))
                continue
            states = self.states(theta) if len(values) < len(move) else here.states
            runs.append(here if (theta == here.theta).all() else _Run(theta, plant, states, []))
        for k in [k for k, run in enumerate(runs) if not run.residuals]:
            residuals = self._run(runs[k].plant, runs[k].states)
            if isinstance(residuals, str):
                runs[k] = here._replace(why=residuals)
            else:
                runs[k] = runs[k]._replace(residuals=residuals)
        return runs

    def _moved_together(self, may: NDArray[np.bool_]) -> list[list[int]]:
        """Which elements of θ are changed in the same free run, because no segment depends on two of them.

        Args:
            may: (p,) whether an element may be changed together with others; at a bound it is not.
        """
        p = len(self.free)
        groups: dict[object, list[int]] = {}
        for k, name in enumerate(self.free):
            own = self.plant.own_parameter(name)
            groups.setdefault(k if own is None or not may[k] else own[0], []).append(k)
        for k, (_, index) in enumerate(self._places):
            groups.setdefault(("state", index), []).append(p + k)
        return list(groups.values())

    def _touched(self, k: int) -> Sequence[int]:
        """The segments that an element of θ has an effect on."""
        p = len(self.free)
        if k >= p:
            return [self._places[k - p][0]]
        own = self.plant.own_parameter(self.free[k])
        return [segment for segment, record in enumerate(self._record_of) if own is None or record == own[1]]

    def _sizes(self) -> Array:
        """The plausible size of θ: its value, or an estimate from the plant and the samples."""
        return np.array([*self._typical(), *(self._state_size(s, i) for s, i in self._places)])

    @property
    def plausible(self) -> Array:
        """The `scales` of the parameters and the sizes of the initial states."""
        return np.concatenate([self.scales, self.sizes[len(self.free) :]])

    @property
    def scales(self) -> Array:
        """The physical scale of every parameter: its value, or what is plausible in these records if that is larger."""
        plausible = zip(self.free, self._plausible(), strict=True)
        return np.array([max(abs(self.plant.value(name)), scale) or 1.0 for name, scale in plausible])

    def plausible_size(self, name: str) -> float:
        """What is plausible of a parameter in these records; 0 if unknown."""
        return self.plant.plausible(self.plant.handles[name].measure, self._of_records)

    def _typical(self) -> list[float]:
        plausible = zip(self.free, self._plausible(), strict=True)
        return [max(abs(self.plant.value(name)), 1e-3 * scale) or 1.0 for name, scale in plausible]

    def _plausible(self) -> list[float]:
        return [self.plausible_size(name) for name in self.free]

    def _state_size(self, segment: int, index: int) -> float:
        size = max(float(np.max(np.abs(self.segments[segment].output))), 1e-12)
        return max(abs(float(self._initial[segment][index])), size)
