r"""The grey box: a physical plant as a model, and its parameters from records.

The parameters θ of a plant and the initial state x₀ of every segment minimise the simulation error

    V(θ, x₀) = ½ Σₜ ‖W·(y(t) − ŷ(t; θ, x₀))‖²,

ŷ being the free run: after x₀ the model sees nothing but the input. That is what makes it honest with friction, whose
sign a one-step prediction would be given by the measured speed. Every output is divided by its standard deviation
where there are several, so that rad/s and A count alike. W may weigh errors by their age, see `Recent`.

The derivative of ŷ is a central difference of free runs, its columns computed in parallel threads: the motion is a
continuous function of θ, located events included, and a run costs microseconds. The initial states of all segments
are moved at once, since no segment feels those of another. The search is `gauss_newton`.

Not every parameter can be told from every record: from voltage and speed of a rigid motor, R_a, K_m and J can be
anything that keeps K_m/(R_a·J) and K_m²/(R_a·J). The information matrix shows that (`emsid.estimation.identifiability`)
at the start and again at the end with the noise found; the parameters to hold are taken in the order in which a
datasheet is likeliest to have them right, and the fit says what it held, at what, and which combinations do not
depend on it.

References:
    Ljung, *System Identification*, 2nd ed., sec. 3.3, 5.4 and 7.5. Schoukens, Ljung, *Nonlinear System
    Identification: A User-Oriented Road Map*, IEEE CSM 39 (2019), on simulation error against prediction error.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, EmsidError, ModelError
from emsid.estimation.coloured import coloured_covariance
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.gauss_newton import Block, Infeasible, Iteration, Minimum, gauss_newton
from emsid.estimation.identifiability import Identifiability, identifiability
from emsid.models.grey_box_start import motions
from emsid.models.model import RUNAWAY, Run
from emsid.models.plants import (
    DrivenMotor,
    Handle,
    LinearAxis,
    OwnPlant,
    Plant,
    Quantity,
    Signal,
    find_handle,
    plant_from_data,
    plant_to_data,
)
from emsid.plant import Motor
from emsid.record import Record, check_same_channels

Array = NDArray[np.float64]
Weighting = Callable[[Array, float], Array]


# --- weightings -----------------------------------------------------------------------------------------------------


def all_alike(error: Array, dt: float) -> Array:
    """Every error counts the same, however long ago its cause: plain output error."""
    return error


@dataclass(frozen=True)
class Recent:
    """Errors count while they grow and are forgotten after a while: ((1 − q⁻¹)/(1 − e^{−dt/τ}·q⁻¹))ⁿ·e.

    A position is an integral of an integral, so its free run keeps for ever what a short disturbance did to it, and
    plain output error bends the parameters to make up for that. With n = 2 the error is seen as an acceleration of
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
        from scipy.signal import lfilter

        decay = np.exp(-dt / self.time)
        for _ in range(self.order):
            error = lfilter([1.0, -1.0], [1.0, -decay], error)
        return error


# --- the model ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class GreyBox:
    """A plant as a model of records.

    Args:
        plant: with its parameters.
        signals: what the outputs of a record are, in their order.
    """

    plant: Plant
    signals: tuple[Signal, ...]

    @property
    def name(self) -> str:
        """That of the plant."""
        return self.plant.name

    @property
    def memory(self) -> int:
        """One sample gives the start of a speed; of a position, twenty."""
        return 20 if Signal.POSITION in self.signals or isinstance(self.plant, OwnPlant) else 1

    def simulate(self, record: Record, transient: int | None = None) -> Run:
        """Free run over every segment, from the state that fits its first samples best."""
        check_channels(self.plant, self.signals, record)
        start = max(self.memory, transient or 0)
        bound = RUNAWAY * max(float(np.max(np.abs(record.output))), np.finfo(float).tiny)
        output, counted = record.output.copy(), np.zeros(len(record), dtype=bool)
        diverged_at, offset = None, 0
        for segment in record.segments:
            if len(segment) > start:
                run = self._run(segment, self.initial(segment, start))
                lost = np.flatnonzero(~(np.abs(run) <= bound).all(axis=1))
                if len(lost):
                    run[lost[0] :] = np.nan
                    diverged_at = offset + int(lost[0]) if diverged_at is None else diverged_at
                output[offset + start : offset + len(segment)] = run[start:]
                counted[offset + start : offset + len(segment)] = True
            offset += len(segment)
        return Run(output, counted, diverged_at)

    def predict(self, record: Record, horizon: int = 1, transient: int | None = None) -> Run:
        """ŷ(t | t − horizon) = ŷ(t) + [y − ŷ](t − horizon): the error of the free run is taken to stay as it is."""
        if horizon < 1:
            raise ModelError(f"{self.name}: a horizon of {horizon}; predictions look at least one sample ahead")
        run = self.simulate(record, transient)
        output, offset = run.output.copy(), 0
        for segment in record.segments:
            here = slice(offset, offset + len(segment))
            error = segment.output - run.output[here]
            late = np.zeros_like(error)
            late[horizon:] = error[:-horizon] if horizon < len(error) else 0.0
            output[here] = np.where(run.counted[here, None], run.output[here] + late, run.output[here])
            offset += len(segment)
        return Run(output, run.counted, run.diverged_at)

    def initial(self, segment: Record, samples: int) -> Array:
        """The state at the start of a segment that its first ``samples`` samples suggest."""
        head = segment[: max(samples, 1)]
        guess = guess_state(self.plant, self.signals, head)
        free = free_states(self.plant, self.signals, head)
        if len(head) * len(self.signals) < 4 * len(free) or not len(free):
            return guess
        problem = _Simulation(self.plant, self.signals, (head,), (), (guess,), (free,), all_alike, 1)
        try:
            return problem.states(gauss_newton(problem, problem.start, max_iterations=10).estimate)[0]
        except EmsidError:
            return guess

    def equation(self) -> str:
        """Every parameter that is not at rest, with its unit."""
        shown = []
        for name, handle in self.plant.handles.items():
            if len(handle.paths) == 1 and self.plant.value(name) != 0:
                shown.append(f"{name} = {self.plant.value(name):.6g} {handle.parameter.unit}")
        return f"{self.name}: " + ", ".join(shown)

    def to_data(self) -> dict[str, Any]:
        """Kind of plant, its parameters, and what the outputs are."""
        return {"plant": plant_to_data(self.plant), "signals": [signal.value for signal in self.signals]}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> GreyBox:
        """The model that `to_data` described."""
        try:
            signals = tuple(Signal(value) for value in data["signals"])
            return cls(plant_from_data(data["plant"]), signals)
        except (KeyError, TypeError, ValueError, AttributeError) as problem:
            raise ModelError(f"not a grey-box model: {problem!r}") from None

    def _run(self, segment: Record, state: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            return self.plant.simulate(segment.input, segment.dt, state, self.signals)


_BY_UNIT = {
    "rad/s": Signal.SPEED, "m/s": Signal.SPEED, "rpm": Signal.SPEED, "deg/s": Signal.SPEED,
    "rad": Signal.POSITION, "m": Signal.POSITION, "deg": Signal.POSITION,
    "A": Signal.CURRENT,
}  # fmt: skip


def signals_of(plant: Plant, record: Record) -> tuple[Signal, ...]:
    """What the outputs of a record are, by their units; without one, a speed, and of a linear axis a position."""
    usual = Signal.POSITION if isinstance(plant, LinearAxis) else Signal.SPEED
    return tuple(_BY_UNIT.get(unit, usual) for unit in record.output_units)


def check_channels(plant: Plant, signals: Sequence[Signal], record: Record) -> None:
    """Refuse a record that a plant has not the channels for, or that was written in units it does not work in."""
    if not isinstance(plant, OwnPlant) and record.input.shape[1] != 1:
        raise DataError(f"{record.name}: {record.input.shape[1]} inputs for {plant.name}; name the one that drives it")
    if record.output.shape[1] != len(signals):
        raise DataError(
            f"{record.name}: {record.output.shape[1]} outputs and {len(signals)} signals said to be in them"
        )
    if isinstance(plant, OwnPlant):
        return
    linear = isinstance(plant, LinearAxis)
    fitting = {
        Signal.SPEED: "m/s" if linear else "rad/s",
        Signal.ROTOR_SPEED: "rad/s",
        Signal.POSITION: "m" if linear else "rad",
        Signal.CURRENT: "A",
    }
    for name, unit, signal in zip(record.output_names, record.output_units, signals, strict=True):
        if unit and unit != fitting[signal]:
            raise DataError(
                f"{record.name}: output {name!r} is in {unit}, {plant.name} gives a {signal.value} in "
                f"{fitting[signal]}; convert it (--units) or choose another model"
            )


# --- initial states -------------------------------------------------------------------------------------------------


def guess_state(plant: Plant, signals: Sequence[Signal], segment: Record) -> Array:
    """A first idea of the state at the first sample: (speed, position) of a motor or axis, zeros of another plant."""
    state = np.zeros(plant.states)
    if isinstance(plant, OwnPlant):
        return state
    assert isinstance(plant, (DrivenMotor, LinearAxis))
    sensor = plant.sensor
    for k, signal in enumerate(signals):
        y = segment.output[:, k]
        if signal in (Signal.SPEED, Signal.ROTOR_SPEED):
            state[0] = (y[0] - sensor.offset) * sensor.ratio
        elif signal is Signal.POSITION:
            state[1] = (y[0] - sensor.offset) * sensor.ratio
            if not any(s in (Signal.SPEED, Signal.ROTOR_SPEED) for s in signals) and np.ptp(y[:20]) > 0:
                head = y[:20]
                slope = np.polyfit(np.arange(len(head)) * segment.dt, head, 1)[0]
                state[0] = 0.0 if _starts_at_rest(y) else slope * sensor.ratio
    return state


def free_states(plant: Plant, signals: Sequence[Signal], segment: Record) -> tuple[int, ...]:
    """Which numbers of the initial state are estimated: what the outputs show and what is not plainly at rest."""
    if isinstance(plant, OwnPlant):
        return tuple(range(plant.states))
    moving = not any(_starts_at_rest(segment.output[:, k]) for k, s in enumerate(signals) if s is not Signal.CURRENT)
    return ((0,) if moving else ()) + ((1,) if Signal.POSITION in signals else ())


def _starts_at_rest(y: Array) -> bool:
    """Whether an output stands still over its first three samples, at exactly zero or exactly the same value."""
    return len(y) > 3 and float(np.ptp(y[:3])) == 0.0


# --- the least-squares problem --------------------------------------------------------------------------------------


class _Simulation:
    """Residuals of free runs and their derivative, as `gauss_newton` wants them; θ then the initial states."""

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
    ) -> None:
        self.plant, self.signals, self.segments, self.free = plant, tuple(signals), tuple(segments), tuple(free)
        self.weighting, self.threads = weighting, threads
        self._initial = [state.copy() for state in states]
        self._places = [
            (segment, index) for segment, indices in enumerate(free_states) for index in indices
        ]  # of the initial states in θ
        whole = np.concatenate([segment.output for segment in segments])
        spread = np.std(whole, axis=0)
        self._scale = np.ones(len(spread)) if len(spread) == 1 else np.where(spread > 0, spread, 1.0)
        self.sizes = np.array([*self._typical(), *(self._state_size(s, i) for s, i in self._places)])

    @property
    def start(self) -> Array:
        """θ and initial states as they are."""
        values = [self.plant.value(name) for name in self.free]
        return np.array([*values, *(self._initial[s][i] for s, i in self._places)])

    @property
    def lower(self) -> Array:
        """The smallest physical values."""
        return np.array([self.plant.handles[n].lower for n in self.free] + [-inf] * len(self._places))

    @property
    def upper(self) -> Array:
        """The largest physical values."""
        return np.array([self.plant.handles[n].upper for n in self.free] + [inf] * len(self._places))

    @property
    def names(self) -> tuple[str, ...]:
        """For messages."""
        return (*self.free, *(f"initial state {i + 1} of segment {s + 1}" for s, i in self._places))

    def plant_at(self, theta: Array) -> Plant:
        """The plant with the parameters in θ."""
        return self.plant.put(dict(zip(self.free, theta.tolist(), strict=False)))

    def states(self, theta: Array) -> list[Array]:
        """The initial states in θ."""
        states = [state.copy() for state in self._initial]
        for (segment, index), value in zip(self._places, theta[len(self.free) :], strict=True):
            states[segment][index] = value
        return states

    def residuals(self, theta: Array) -> list[Array]:
        """W·(ŷ − y) of every segment, its channels one after the other."""
        return [self._weighed(run, segment) for run, segment in zip(self._runs(theta), self.segments, strict=True)]

    def linearised(self, theta: Array) -> list[Block]:
        """Residuals and their derivative by central differences."""
        p = len(self.free)
        step = 1e-5 * np.maximum(np.abs(theta), 1e-2 * self.sizes)
        low, high = np.maximum(theta - step, self.lower), np.minimum(theta + step, self.upper)
        moves: list[list[int]] = [[k] for k in range(p)]
        moves += [
            [p + k for k, (_, i) in enumerate(self._places) if i == index]
            for index in sorted({i for _, i in self._places})
        ]

        def difference(move: list[int]) -> list[Array]:
            below, above = theta.copy(), theta.copy()
            below[move], above[move] = low[move], high[move]
            first, second = self._runs(below), self._runs(above)
            return [
                self._weighed(b, s, derivative=True) - self._weighed(a, s, derivative=True)
                for a, b, s in zip(first, second, self.segments, strict=True)
            ]

        with ThreadPoolExecutor(self.threads) as pool:
            differences = list(pool.map(difference, moves))
        residuals = self.residuals(theta)
        jacobians = [np.zeros((len(r), len(theta)), order="F") for r in residuals]
        for move, columns in zip(moves, differences, strict=True):
            for k in move:
                width = high[k] - low[k]
                if k < p:
                    for jacobian, column in zip(jacobians, columns, strict=True):
                        jacobian[:, k] = column / width
                else:
                    segment = self._places[k - p][0]
                    jacobians[segment][:, k] = columns[segment] / width
        return list(zip(residuals, jacobians, strict=True))

    def _runs(self, theta: Array) -> list[Array]:
        try:
            plant = self.plant_at(theta)
            with np.errstate(all="ignore"):
                return [
                    plant.simulate(segment.input, segment.dt, state, self.signals)
                    for segment, state in zip(self.segments, self.states(theta), strict=True)
                ]
        except ModelError as problem:
            raise Infeasible(str(problem)) from None

    def _weighed(self, run: Array, segment: Record, derivative: bool = False) -> Array:
        error = run / self._scale if derivative else (run - segment.output) / self._scale
        return np.concatenate([self.weighting(error[:, k], segment.dt) for k in range(error.shape[1])])

    def _typical(self) -> list[float]:
        """How large every parameter plausibly is: its value, or what its unit suggests for these records."""
        u = max(float(np.max(np.abs(s.input))) for s in self.segments) or 1.0
        v = max(float(np.max(np.abs(s.output))) for s in self.segments) or 1.0
        dt = self.segments[0].dt
        force = u
        if isinstance(self.plant, DrivenMotor):
            force = u * abs(self.plant.drive.gain) * self.plant.motor.motor_constant / self.plant.motor.resistance
        by_unit = {
            "N*m": 0.1 * force, "N": 0.1 * force, "N*m*s/rad": 0.1 * force / v, "N*s/m": 0.1 * force / v,
            "s/rad": 10 / v, "s/m": 10 / v, "V": 0.1 * u, "s": dt, "1": 1.0, "rad/s": 0.1 * v,
        }  # fmt: skip
        sizes = []
        for name in self.free:
            handle = self.plant.handles[name]
            sizes.append(max(abs(self.plant.value(name)), 1e-3 * by_unit.get(handle.parameter.unit, 0.0)) or 1.0)
        return sizes

    def _state_size(self, segment: int, index: int) -> float:
        size = max(float(np.max(np.abs(self.segments[segment].output))), 1e-12)
        return max(abs(float(self._initial[segment][index])), size)


# --- the estimation -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Given:
    """What a datasheet says of a parameter.

    Args:
        value: in SI units; None where it is unknown.
        tolerance: how far from it the parameter may be, as a part of it; None for a value that is only a start.

    Raises:
        ModelError: for a value that is not finite, a tolerance that is negative, or one of an unknown value.
    """

    value: float | None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.value is not None and not isfinite(self.value):
            raise ModelError(f"datasheet value {self.value}; give a finite number, or say that it is unknown")
        if self.tolerance is not None and (self.value is None or not 0 <= self.tolerance < inf):
            raise ModelError(f"datasheet tolerance {self.tolerance} of {self.value}; give a value and a part of it")


@dataclass(frozen=True)
class Estimate:
    """A row of the table of parameters.

    Attributes:
        name, symbol, unit, description: of the parameter.
        value: in that unit.
        standard_error: of it; None for one that was not estimated.
        status: ``estimated`` from the record; ``conditional`` on what was held, because the record tells only
            combinations; ``held`` because of that; ``fixed`` by the user; ``at a bound``.
        start: the value the search began with.
        datasheet: what the datasheet says, None without.
    """

    name: str
    symbol: str
    unit: str
    description: str
    value: float
    standard_error: float | None
    status: str
    start: float
    datasheet: float | None


@dataclass(frozen=True)
class Combination:
    """A combination of parameters that the record tells whatever was held.

    Attributes:
        quantity: its name, formula, unit and value.
        standard_error: of it.
    """

    quantity: Quantity
    standard_error: float


@dataclass(frozen=True, eq=False)
class GreyBoxFit(Fit[GreyBox]):
    """A `Fit` that knows its physics.

    Attributes:
        table: every parameter that was asked for or fixed.
        combinations: what the record tells although some parameters had to be held; all the quantities of the plant
            that it tells.
        words: what cannot be told apart and what was done about it, one sentence each; empty where all is told.
        identifiability: of the parameters that were asked for, at the estimate.
        segments: the records it was fitted to, without gaps.
        states: their initial states.
        weighting: how errors counted by their age.
        limits: bounds of the free parameters, those of a datasheet and of physics included.
        cost: V at the minimum, half the weighted sum of squares.
        colour: (p,) how many times larger the variance of every parameter is than with a white residual.
    """

    table: tuple[Estimate, ...] = ()
    combinations: tuple[Combination, ...] = ()
    words: tuple[str, ...] = ()
    identifiability: Identifiability | None = None
    segments: tuple[Record, ...] = ()
    states: tuple[Array, ...] = ()
    weighting: Weighting = all_alike
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    cost: float = float("nan")
    colour: Array = field(default_factory=lambda: np.ones(0))

    def simulated(self) -> tuple[Array, ...]:
        """The free run (Nᵢ, ny) of every segment from its estimated initial state."""
        model = self.model
        return tuple(
            model.plant.simulate(segment.input, segment.dt, state, model.signals)
            for segment, state in zip(self.segments, self.states, strict=True)
        )


def simulation_error(
    plant: Plant | Motor,
    records: Record | Iterable[Record],
    *,
    free: Sequence[str] | None = None,
    fixed: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    datasheet: Mapping[str, Given] | None = None,
    signals: Sequence[Signal] | None = None,
    weighting: Weighting = all_alike,
    max_iterations: int = 60,
    max_seconds: float = inf,
    threads: int | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> GreyBoxFit:
    """The physical parameters that minimise the error of the free run over one or several records.

    Args:
        plant: what to fit, with its parameters as the start; a bare `Motor` gets a drive and a sensor without effect.
        records: a record, or several experiments, all with one set of parameters.
        free: the parameters to estimate; by default what plants of this kind usually have unknown.
        fixed: values that are known, by name, in SI units; they are not estimated.
        bounds: (lower, upper) by name, in addition to what is physical.
        datasheet: what is known beforehand, see `Given`. A value is the start, and a tolerance bounds it.
        signals: what the outputs of the records are, by default judged by their units.
        weighting: how errors count by their age: `all_alike`, `Recent`, or any other linear filter (error, dt) → error.
        max_iterations, max_seconds: of the search.
        threads: how many, by default as many as there are cores.
        progress: called after every step.

    Raises:
        ModelError: for names that the plant does not have, bounds that exclude a start, a datasheet that contradicts
            itself.
        DataError: for records without motion, with other channels or in other units.
    """
    subject: Plant = DrivenMotor(plant) if isinstance(plant, Motor) else plant
    segments = _segments(records)
    shown = tuple(signals) if signals is not None else signals_of(subject, segments[0])
    for segment in segments:
        check_channels(subject, shown, segment)
    _check_motion(segments)
    fixed, sheet = dict(fixed or {}), dict(datasheet or {})
    asked = _asked(subject, free, fixed, sheet)
    limits = _limits(subject, asked, bounds or {}, sheet)
    subject = subject.put({n: g.value for n, g in sheet.items() if g.value is not None} | fixed)
    _check_start(subject, asked, limits)

    def problem_for(current: Plant, names: Sequence[str], states: Sequence[Array] | None = None) -> _Simulation:
        guesses = [guess_state(current, shown, s) for s in segments] if states is None else states
        unknown = [free_states(current, shown, s) for s in segments]
        return _Simulation(current, shown, segments, names, guesses, unknown, weighting, threads or os.cpu_count() or 1)

    start = _best_start(subject, asked, limits, problem_for)
    names = _hold(_told(problem_for(start, asked), None), asked, _preference(subject, asked, sheet))
    found, states, steps = start, None, 0
    while True:
        coarse = [name for name in names if name not in found.fine]
        if steps == 0 and 0 < len(coarse) < len(names):  # what moves the output most first
            rough = problem_for(found, coarse, states)
            beginning = _search(rough, limits, max_iterations, max_seconds, progress)
            states = rough.states(beginning.estimate)
            fine = [name for name in names if name not in coarse]
            found = _scan(rough.plant_at(beginning.estimate), fine, limits, states, problem_for)
        problem = problem_for(found, names, states)
        minimum = _search(problem, limits, max_iterations, max_seconds, progress)
        found, states = problem.plant_at(minimum.estimate), problem.states(minimum.estimate)
        steps += minimum.iterations
        inside = [name for name, free in zip(names, minimum.free, strict=False) if free]
        kept = _hold(_told(problem_for(found, inside, states), minimum), inside, _preference(subject, asked, sheet))
        if minimum.ending is Ending.INTERRUPTED or len(kept) == len(inside):
            break
        lost = [name for name in inside if name not in kept]
        names = [name for name in names if name not in lost]
        found = found.put({name: subject.value(name) for name in lost if name in sheet})
    told = _told(problem_for(found, asked, states), minimum)
    words = _in_words(told, names, found, shown)
    fit = minimum.fit(GreyBox(found, shown), tuple(names), "gn")
    return GreyBoxFit(
        **{f: getattr(fit, f) for f in Fit.__dataclass_fields__ if f not in ("message", "iterations")},
        iterations=steps,
        message="; ".join(filter(None, [fit.message, *words])),
        table=_table(found, start, names, asked, fixed, sheet, minimum, told),
        combinations=_combinations(found, names, asked, minimum, told),
        words=tuple(words),
        identifiability=told,
        segments=segments,
        states=tuple(states),
        weighting=weighting,
        limits=limits,
        cost=minimum.cost,
        colour=_colour(minimum, len(names)),
    )


def _colour(minimum: Minimum, parameters: int) -> Array:
    coloured, white = (np.diag(c)[:parameters] for c in (minimum.covariance, minimum.white_covariance))
    return np.divide(coloured, white, out=np.ones(parameters), where=(white > 0) & np.isfinite(white))


def _segments(records: Record | Iterable[Record]) -> tuple[Record, ...]:
    whole = (records,) if isinstance(records, Record) else tuple(records)
    if not whole:
        raise DataError("no record to identify from")
    for other in whole[1:]:
        check_same_channels(whole[0], other)
    return tuple(segment for record in whole for segment in record.segments)


def _check_motion(segments: Sequence[Record]) -> None:
    for names, side in ((segments[0].input_names, "input"), (segments[0].output_names, "output")):
        values = [getattr(segment, side) for segment in segments]
        if not any(np.ptp(v, axis=0).any() for v in values):
            what = "nothing drives it" if side == "input" else "nothing moves"
            raise DataError(
                f"{segments[0].name}: {side} {', '.join(names)} stays at {values[0][0, 0]:g} throughout; {what}, "
                "and no parameter can be found from it"
            )


def _asked(
    plant: Plant, free: Sequence[str] | None, fixed: Mapping[str, float], sheet: Mapping[str, Given]
) -> tuple[str, ...]:
    for name in (*(free or ()), *fixed, *sheet):
        find_handle(plant, name)
    both = [name for name in free or () if name in fixed]
    if both:
        raise ModelError(f"{both[0]} is both free and fixed at {fixed[both[0]]:g}; choose one")
    for name, value in fixed.items():
        given = sheet.get(name)
        if given is not None and given.value is not None and given.tolerance is not None:
            low, high = _around(given.value, given.tolerance)
            if not low <= value <= high:
                raise ModelError(
                    f"{name} is fixed at {value:g} and the datasheet has {given.value:g} ± "
                    f"{100 * given.tolerance:g} %; correct one of them"
                )
    unknown = [name for name, given in sheet.items() if given.value is None]
    names = tuple(free) if free is not None else tuple(dict.fromkeys((*plant.usual, *unknown)))
    names = tuple(name for name in names if name not in fixed)
    places: dict[tuple[str | int, ...], str] = {}
    for name in names:
        for path, _ in plant.handles[name].paths:
            if path in places:
                raise ModelError(f"{places[path]} and {name} are the same thing in part; free one of them")
            places[path] = name
    if not names:
        raise ModelError(f"no parameter of {plant.name} is free; it has {', '.join(plant.handles)}")
    return names


def _around(value: float, tolerance: float) -> tuple[float, float]:
    low, high = sorted((value * (1 - tolerance), value * (1 + tolerance)))
    return low, high


Limits = dict[str, tuple[float, float]]


def _limits(
    plant: Plant, asked: Sequence[str], bounds: Mapping[str, tuple[float, float]], sheet: Mapping[str, Given]
) -> Limits:
    """The narrowest bounds that hold for every parameter that was asked for."""
    limits: Limits = {}
    for name in bounds:
        find_handle(plant, name)
        if name not in asked:
            raise ModelError(f"bounds for {name}, which is not free; free are {', '.join(asked)}")
    for name in asked:
        handle: Handle = plant.handles[name]
        low, high = handle.lower, handle.upper
        if name in bounds:
            given_low, given_high = bounds[name]
            if not given_low <= given_high or given_high < low or given_low > high:
                raise ModelError(
                    f"bounds of {name} are [{given_low:g}, {given_high:g}] {handle.parameter.unit}; they must ascend "
                    f"within [{low:g}, {high:g}]"
                )
            low, high = max(low, given_low), min(high, given_high)
        given = sheet.get(name)
        if given is not None and given.value is not None and given.tolerance is not None:
            sheet_low, sheet_high = _around(given.value, given.tolerance)
            if sheet_low > high or sheet_high < low:
                raise ModelError(
                    f"the datasheet has {name} within [{sheet_low:g}, {sheet_high:g}] and its bounds are "
                    f"[{low:g}, {high:g}] {handle.parameter.unit}; they contradict each other"
                )
            low, high = max(low, sheet_low), min(high, sheet_high)
        limits[name] = (low, high)
    return limits


def _check_start(plant: Plant, asked: Sequence[str], limits: Limits) -> None:
    for name in asked:
        value, (low, high) = plant.value(name), limits[name]
        if not low <= value <= high:
            unit = plant.handles[name].parameter.unit
            raise ModelError(
                f"bounds [{low:g}, {high:g}] {unit} of {name} exclude its start {value:g}; widen them or move the start"
            )


def _best_start(
    plant: Plant, asked: Sequence[str], limits: Limits, problem_for: Callable[[Plant, Sequence[str]], _Simulation]
) -> Plant:
    """The plant as given, or moved to what a regression on the records says, whichever simulates better."""
    best = plant
    first = problem_for(plant, asked)
    lowest = _cost(first)
    if isinstance(plant, OwnPlant):
        return plant
    assert isinstance(plant, (DrivenMotor, LinearAxis))
    channel, is_position = _motion_channel(first.signals)
    if channel is None:
        return plant
    zone = any("dead_zone" in name for name in asked)
    for motion in motions(first.segments, channel, is_position, zone, plant.drive.offset):
        if motion.gain / plant.drive.gain <= 0:
            continue
        try:
            suggested = plant.put_motion(motion)
            moved = plant.put({n: float(np.clip(suggested.value(n), *limits[n])) for n in asked})
            cost = _cost(problem_for(moved, asked))
        except EmsidError:
            continue
        if cost < lowest:
            best, lowest = moved, cost
    return best


SCAN = (0.12, 0.18, 0.25, 0.35, 0.5, 0.7, 1.4, 2.0, 2.8, 4.0)
"""By what factors a fine parameter is moved before the search: the error has many minima over a resonance."""


def _scan(
    plant: Plant,
    names: Sequence[str],
    limits: Limits,
    states: Sequence[Array],
    problem_for: Callable[[Plant, Sequence[str], Sequence[Array]], _Simulation],
) -> Plant:
    """The plant with each of these parameters in turn moved to where it simulates best."""
    best, lowest = plant, _cost(problem_for(plant, (), states))
    for name in names:
        value = best.value(name)
        trials = [best.put({name: float(np.clip(factor * value, *limits[name]))}) for factor in SCAN]
        costs = [_cost(problem_for(trial, (), states)) for trial in trials]
        k = int(np.argmin(costs))
        if costs[k] < lowest:
            best, lowest = trials[k], costs[k]
    return best


def _motion_channel(signals: Sequence[Signal]) -> tuple[int | None, bool]:
    for k, signal in enumerate(signals):
        if signal is not Signal.CURRENT:
            return k, signal is Signal.POSITION
    return None, False


def _cost(problem: _Simulation) -> float:
    try:
        cost = float(sum(np.sum(r**2) for r in problem.residuals(problem.start)))
    except Infeasible:
        return inf
    return cost if isfinite(cost) else inf


def _preference(plant: Plant, asked: Sequence[str], sheet: Mapping[str, Given]) -> tuple[str, ...]:
    """In which order parameters are held: what a datasheet gives, what plants of this kind usually have known."""
    known = sorted(
        (n for n in asked if n in sheet and sheet[n].value is not None), key=lambda n: sheet[n].tolerance or inf
    )
    usual = [name for name in plant.usual if name in asked]
    return tuple(dict.fromkeys((*known, *usual, *reversed(asked))))


def _told(problem: _Simulation, minimum: Minimum | None) -> Identifiability:
    """What the records tell of the parameters of a problem; without noise where nothing is known of that."""
    p = len(problem.free)
    noise = 0.0 if minimum is None else float(np.sqrt(minimum.noise_variance))
    jacobians = [jacobian for _, jacobian in problem.linearised(problem.start)]
    return identifiability(jacobians, problem.sizes[:p], problem.free, noise)


def _hold(told: Identifiability, names: Sequence[str], preference: Sequence[str]) -> list[str]:
    """The parameters that are left when one after the other is held until the others can be told."""
    kept = list(names)
    while kept and (groups := told.without([name for name in names if name not in kept]).groups):
        kept.remove(min(groups[0], key=preference.index))
    return kept


def _search(
    problem: _Simulation,
    limits: Limits,
    max_iterations: int,
    max_seconds: float,
    progress: Callable[[Iteration], None] | None,
) -> Minimum:
    lower, upper = problem.lower, problem.upper
    for k, name in enumerate(problem.free):
        lower[k], upper[k] = limits[name]
    return _with_colour(
        problem,
        gauss_newton(
            problem,
            problem.start,
            lower=lower,
            upper=upper,
            max_iterations=max_iterations,
            max_seconds=max_seconds,
            tolerance=1e-2,
            names=problem.names,
            progress=progress,
        ),
    )


def _with_colour(problem: _Simulation, minimum: Minimum) -> Minimum:
    """The covariance under coloured noise; where the sandwich finds more, the deviations are the sandwich's."""
    columns = np.flatnonzero(minimum.free & np.isfinite(np.diag(minimum.covariance)))
    if minimum.rank < len(columns) or not len(columns):
        return minimum
    pieces, channels = [], len(problem.signals)
    for residual, jacobian in problem.linearised(minimum.estimate):
        parts = np.split(np.arange(len(residual)), channels)
        pieces += [(residual[part], jacobian[np.ix_(part, columns)]) for part in parts]
    covariance = coloured_covariance(pieces)
    within = np.ix_(columns, columns)
    ratio = np.diag(minimum.covariance)[columns] / np.diag(covariance)
    wider = np.sqrt(np.maximum(ratio, 1.0))
    whole = minimum.covariance.copy()
    whole[within] = covariance * np.outer(wider, wider)
    return replace(minimum, covariance=whole)


def _in_words(told: Identifiability, names: Sequence[str], plant: Plant, signals: Sequence[Signal]) -> list[str]:
    held = [name for name in told.names if name not in names]
    channels = "the input and " + " and ".join(signal.value for signal in signals)
    words = []
    for group in told.groups:
        mine = [name for name in group if name in held]
        kept = ", ".join(f"{n} = {plant.value(n):.4g} {plant.handles[n].parameter.unit}" for n in mine)
        if len(group) == 1 and not mine:
            words.append(f"from {channels} alone, {group[0]} is not known to better than 100 %")
        elif mine:
            words.append(
                f"from {channels} alone, {', '.join(group)} cannot be told apart, only combinations of them; held: "
                f"{kept}; fix what you know, or add a channel"
            )
        else:
            words.append(
                f"from {channels} alone, {', '.join(group)} can hardly be told apart; see their intervals, fix one of "
                "them or add a channel"
            )
    return words


def _table(
    plant: Plant,
    start: Plant,
    names: Sequence[str],
    asked: Sequence[str],
    fixed: Mapping[str, float],
    sheet: Mapping[str, Given],
    minimum: Minimum,
    told: Identifiability,
) -> tuple[Estimate, ...]:
    rows = []
    errors = np.sqrt(np.diag(minimum.covariance))
    for name in (*asked, *(n for n in fixed if n not in asked)):
        parameter = plant.handles[name].parameter
        error: float | None = None
        if name in fixed:
            status = "fixed"
        elif name not in names:
            status = "held"
        else:
            k = names.index(name)
            error = float(errors[k])
            alone = told.tells(np.array([1.0 if n == name else 0.0 for n in told.names]))
            status = "at a bound" if not minimum.free[k] else "estimated" if alone else "conditional"
        given = sheet.get(name)
        datasheet = None if given is None else given.value
        rows.append(Estimate(*_described(parameter), plant.value(name), error, status, start.value(name), datasheet))
    return tuple(rows)


def _described(parameter: Any) -> tuple[str, str, str, str]:
    return parameter.name, parameter.symbol, parameter.unit, parameter.description


def _combinations(
    plant: Plant, names: Sequence[str], asked: Sequence[str], minimum: Minimum, told: Identifiability
) -> tuple[Combination, ...]:
    """The quantities of the plant that the record tells, with standard errors to first order."""

    def gradients(which: Sequence[str]) -> Array:
        columns = []
        for name in which:
            value = plant.value(name)
            step = 1e-6 * max(abs(value), 1e-12) * (1 if value < plant.handles[name].upper else -1)
            above = plant.put({name: value + step}).quantities()
            columns.append([(a.value - q.value) / step for a, q in zip(above, plant.quantities(), strict=True)])
        return np.array(columns).T.reshape(-1, len(which))

    quantities = plant.quantities()
    if not quantities:
        return ()
    relative = gradients(asked) * np.array([max(abs(plant.value(n)), 1e-12) for n in asked])
    direct = gradients(names)
    covariance = minimum.covariance[: len(names), : len(names)]
    found = []
    for quantity, whole, part in zip(quantities, relative, direct, strict=True):
        if np.any(whole) and told.tells(whole) and isfinite(quantity.value):
            found.append(Combination(quantity, float(np.sqrt(max(part @ covariance @ part, 0.0)))))
    return tuple(found)
